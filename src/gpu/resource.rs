//! A buffer or an image, as commands and bindings handle both.

use std::sync::Arc;

use super::buffer::{Buffer, Storage};
use super::device::Shared;
use super::element::Element;
use super::image::{Image, Texture};

/// A buffer of any element type, or an image.
#[derive(Clone, Copy)]
pub enum Resource<'a> {
    Buffer(&'a Arc<Storage>),
    Image(&'a Arc<Texture>),
}

impl Resource<'_> {
    pub(super) fn device(&self) -> &Arc<Shared> {
        match self {
            Self::Buffer(storage) => &storage.device,
            Self::Image(texture) => &texture.device,
        }
    }

    pub(super) fn id(&self) -> u64 {
        match self {
            Self::Buffer(storage) => storage.id,
            Self::Image(texture) => texture.id,
        }
    }

    pub(super) fn name(&self) -> &str {
        match self {
            Self::Buffer(storage) => &storage.name,
            Self::Image(texture) => &texture.name,
        }
    }
}

impl<T: Element> Buffer<T> {
    pub(crate) fn resource(&self) -> Resource<'_> {
        Resource::Buffer(&self.storage)
    }
}

impl Image {
    pub(crate) fn resource(&self) -> Resource<'_> {
        Resource::Image(&self.texture)
    }
}
