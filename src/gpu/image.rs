//! A 2-D image of four floats a pixel that shaders write and the host reads.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Result, ensure};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

use super::buffer::next_id;
use super::device::{Device, Shared};
use super::error::describe;
use super::shader::Resource;
use crate::memory::OutOfMemory;

/// `width` x `height` pixels of format R32G32B32A32_SFLOAT, in the layout GENERAL from its first use on. A clone is the same
/// image.
#[derive(Clone)]
pub struct Image {
    pub(super) texture: Arc<Texture>,
}

impl Image {
    pub fn new(device: &Device, name: &str, width: u32, height: u32) -> Result<Self> {
        ensure!(width > 0 && height > 0, "an image has at least one pixel");
        let limit = device.facts().limits.image;
        if width > limit || height > limit {
            let reason = format!("an image on {} has at most {limit} pixels a side", device.facts().name);
            let bytes = (u64::from(width) * u64::from(height)).saturating_mul(16);
            return Err(OutOfMemory { name: name.to_owned(), bytes: Some(bytes), reason }.into());
        }
        Ok(Self { texture: Arc::new(Texture::new(&device.0, name, width, height)?) })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.texture.size
    }

    pub fn bytes(&self) -> u64 {
        self.texture.bytes
    }

    pub(crate) fn resource(&self) -> Resource<'_> {
        Resource::Image(&self.texture)
    }
}

/// The Vulkan image, its view and its memory.
pub struct Texture {
    pub(super) raw: vk::Image,
    pub(super) view: vk::ImageView,
    pub(super) name: String,
    pub(super) size: [u32; 2],
    pub(super) id: u64,
    /// Whether the first command that uses it is recorded, and before it the change to its layout.
    pub(super) is_general: AtomicBool,
    bytes: u64,
    allocation: Option<Allocation>,
    pub(super) device: Arc<Shared>,
}

pub(super) const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

impl Texture {
    fn new(device: &Arc<Shared>, name: &str, width: u32, height: u32) -> Result<Self> {
        let format = vk::Format::R32G32B32A32_SFLOAT;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC);
        // SAFETY: clause 1, the Texture owns the image from here on and frees it on every path.
        let raw = unsafe { device.raw.create_image(&info, None) }.map_err(|e| describe("vkCreateImage", e))?;
        // SAFETY: clause 1.
        let requirements = unsafe { device.raw.get_image_memory_requirements(raw) };
        let mut texture = Self {
            raw,
            view: vk::ImageView::null(),
            name: name.to_owned(),
            size: [width, height],
            id: next_id(),
            is_general: AtomicBool::new(false),
            bytes: requirements.size,
            allocation: None,
            device: device.clone(),
        };
        let allocation =
            texture.allocation.insert(device.allocate(name, requirements, MemoryLocation::GpuOnly, false)?);
        // SAFETY: clauses 1 and 4, fresh memory that meets the image's requirements.
        unsafe { device.raw.bind_image_memory(raw, allocation.memory(), allocation.offset()) }
            .map_err(|e| describe("vkBindImageMemory", e))?;
        let view = vk::ImageViewCreateInfo::default()
            .image(raw)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(WHOLE);
        // SAFETY: clause 1.
        texture.view =
            unsafe { device.raw.create_image_view(&view, None) }.map_err(|e| describe("vkCreateImageView", e))?;
        device.name(raw, name);
        device.name(texture.view, name);
        Ok(texture)
    }
}

impl Drop for Texture {
    fn drop(&mut self) {
        // SAFETY: clause 2, commands hold an Arc of this until they are done; a null view may be destroyed.
        unsafe {
            self.device.raw.destroy_image_view(self.view, None);
            self.device.raw.destroy_image(self.raw, None);
        }
        if let Some(allocation) = self.allocation.take() {
            self.device.free(allocation);
        }
    }
}
