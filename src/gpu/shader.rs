//! The traits that `build.rs` implements for every shader.

use std::sync::Arc;

use bytemuck::Pod;

use super::buffer::Storage;
use super::image::Texture;

/// A compute shader with its reflected interface.
pub trait Shader {
    /// The stem of its file, and the name of its stage in labels and messages.
    const NAME: &'static str;
    /// The module, little-endian words.
    const SPIRV: &'static [u8];
    /// Invocations in a workgroup.
    const WORKGROUP: [u32; 3];
    const BINDINGS: &'static [Binding];
    type Bindings<'a>: Bindings;
    /// `()` for a shader without push constants.
    type Push: Pod;
    type Constants: Constants;
}

/// One binding of a shader.
pub struct Binding {
    pub number: u32,
    pub name: &'static str,
    /// Descriptors in it.
    pub count: u32,
    pub kind: BindingKind,
    pub reads: bool,
    pub writes: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BindingKind {
    Buffer,
    Image,
}

/// The resources for one dispatch.
pub trait Bindings {
    /// Visits every descriptor in the order of [`Shader::BINDINGS`].
    fn each(&self, bind: &mut dyn FnMut(Resource));
}

/// The values of the specialization constants of one pipeline.
pub trait Constants: Default {
    /// `constant_id` and bits.
    fn entries(&self) -> Vec<(u32, u32)>;
}

/// A buffer or an image, whatever its element type.
#[derive(Clone, Copy)]
pub enum Resource<'a> {
    Buffer(&'a Arc<Storage>),
    Image(&'a Arc<Texture>),
}

impl Resource<'_> {
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
