//! 2-D images that shaders write: four floats per pixel for the host, or 8 bits per channel for a screen.

use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Result, ensure};
use ash::vk;
use gpu_allocator::MemoryLocation;

use super::device::{Device, Held, Shared};
use super::error::{TooLarge, describe};
use super::id::next_id;

/// An image of `width` x `height` pixels in the format R32G32B32A32_SFLOAT, or in 8 bits per channel for a screen. Its
/// layout is GENERAL from the first use on. A clone is the same image.
#[derive(Clone)]
pub struct Image {
    pub(super) texture: Arc<Texture>,
}

impl Image {
    /// Allocates an image of four floats per pixel. Its content is undefined.
    ///
    /// # Errors
    /// A side is 0; [`TooLarge`] if a side exceeds the limit of the device;
    /// [`OutOfMemory`](crate::host_memory::OutOfMemory).
    pub fn new(device: &Device, name: &str, width: u32, height: u32) -> Result<Self> {
        ensure!(width > 0 && height > 0, "an image has at least one pixel");
        let limit = device.capabilities().limits.image;
        if width > limit || height > limit {
            return Err(TooLarge { device: device.capabilities().name.clone(), limit, size: [width, height] }.into());
        }
        let usage =
            vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        let format = vk::Format::R32G32B32A32_SFLOAT;
        Ok(Self { texture: Arc::new(Texture::new(&device.0, name, (format, usage), [width, height])?) })
    }

    /// Allocates an image with red, green, blue and alpha in 8 bits each. It takes the place of a window's image where
    /// there is no window.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::host_memory::OutOfMemory) if device memory is exhausted.
    pub fn screen(device: &Device, name: &str, size: [u32; 2]) -> Result<Self> {
        let usage = vk::ImageUsageFlags::STORAGE
            | vk::ImageUsageFlags::COLOR_ATTACHMENT
            | vk::ImageUsageFlags::TRANSFER_SRC
            | vk::ImageUsageFlags::TRANSFER_DST;
        let kind = (vk::Format::R8G8B8A8_UNORM, usage);
        Ok(Self { texture: Arc::new(Texture::new(&device.0, name, kind, size)?) })
    }

    /// Replaces the image by a new one of floats if it has another size.
    ///
    /// # Errors
    /// As [`Image::new`].
    pub fn fit(&mut self, device: &Device, name: &str, size: [u32; 2]) -> Result<()> {
        if self.size() != size {
            *self = Self::new(device, name, size[0], size[1])?;
        }
        Ok(())
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.texture.size
    }

    pub fn bytes(&self) -> u64 {
        self.texture.bytes
    }
}

/// The Vulkan image, its view and its memory.
pub struct Texture {
    pub(super) raw: vk::Image,
    pub(super) view: vk::ImageView,
    pub(super) name: String,
    pub(super) size: [u32; 2],
    pub(super) format: vk::Format,
    pub(super) id: u64,
    /// True once the change to the layout GENERAL and the first command after it are recorded.
    pub(super) is_general: AtomicBool,
    bytes: u64,
    /// None for an image of a swapchain, which owns the memory.
    allocation: Option<Held>,
    /// The swapchain that owns the image, kept alive as long as this.
    swapchain: Option<Arc<dyn Any + Send + Sync>>,
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
    fn new(
        device: &Arc<Shared>,
        name: &str,
        (format, usage): (vk::Format, vk::ImageUsageFlags),
        size: [u32; 2],
    ) -> Result<Self> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width: size[0], height: size[1], depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage);
        // SAFETY: clause 1, the Texture owns the image from here on and frees it on every path.
        let raw = unsafe { device.raw.create_image(&info, None) }.map_err(|e| describe("vkCreateImage", e))?;
        // SAFETY: clause 1.
        let requirements = unsafe { device.raw.get_image_memory_requirements(raw) };
        let mut texture = Self::unbound(device, name, raw, format, size);
        texture.bytes = requirements.size;
        let allocation = device.allocate(name, requirements, MemoryLocation::GpuOnly, false);
        let allocation = match allocation {
            Ok(allocation) => texture.allocation.insert(allocation),
            Err(error) => {
                // SAFETY: clause 1; nothing has used it.
                unsafe { device.raw.destroy_image(raw, None) };
                return Err(error);
            }
        };
        // SAFETY: clauses 1 and 4, fresh memory that meets the image's requirements.
        unsafe { device.raw.bind_image_memory(raw, allocation.memory(), allocation.offset()) }
            .map_err(|e| describe("vkBindImageMemory", e))?;
        texture.add_view()?;
        Ok(texture)
    }

    /// Wraps image `raw` of a swapchain and keeps the swapchain alive.
    pub(super) fn of_swapchain(
        device: &Arc<Shared>,
        raw: vk::Image,
        format: vk::Format,
        size: [u32; 2],
        swapchain: Arc<dyn Any + Send + Sync>,
    ) -> Result<Self> {
        let mut texture = Self::unbound(device, "window", raw, format, size);
        texture.swapchain = Some(swapchain);
        texture.add_view()?;
        Ok(texture)
    }

    fn unbound(device: &Arc<Shared>, name: &str, raw: vk::Image, format: vk::Format, size: [u32; 2]) -> Self {
        Self {
            raw,
            view: vk::ImageView::null(),
            name: name.to_owned(),
            size,
            format,
            id: next_id(),
            is_general: AtomicBool::new(false),
            bytes: 0,
            allocation: None,
            swapchain: None,
            device: device.clone(),
        }
    }

    fn add_view(&mut self) -> Result<()> {
        let device = &self.device;
        let view = vk::ImageViewCreateInfo::default()
            .image(self.raw)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(self.format)
            .subresource_range(WHOLE);
        // SAFETY: clause 1.
        self.view =
            unsafe { device.raw.create_image_view(&view, None) }.map_err(|e| describe("vkCreateImageView", e))?;
        device.name(self.raw, &self.name);
        device.name(self.view, &self.name);
        Ok(())
    }
}

impl Drop for Texture {
    fn drop(&mut self) {
        // SAFETY: clause 2, commands hold an Arc of this until they are done; a null view may be destroyed.
        unsafe { self.device.raw.destroy_image_view(self.view, None) };
        if let Some(allocation) = self.allocation.take() {
            // SAFETY: as above; with memory of its own, the image is no swapchain's.
            unsafe { self.device.raw.destroy_image(self.raw, None) };
            self.device.free(allocation);
        }
    }
}
