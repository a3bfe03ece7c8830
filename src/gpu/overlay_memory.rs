//! Device memory for the vertices, indices and textures of the overlay.

use std::sync::Arc;

use ash::vk;
use egui_ash_renderer::allocator::Allocator;
use egui_ash_renderer::{RendererError, RendererResult};
use gpu_allocator::MemoryLocation;

use super::device::{Held, Shared};

/// Allocates from the device's allocator, like all other resources.
pub(super) struct OverlayMemory(pub Arc<Shared>);

const NAME: &str = "panels";

impl OverlayMemory {
    fn allocate(
        &self,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> RendererResult<Held> {
        let allocation = self.0.allocate(NAME, requirements, location, linear);
        allocation.map_err(|problem| RendererError::Allocator(format!("{problem:#}")))
    }
}

impl Allocator for OverlayMemory {
    type Allocation = Held;

    fn create_buffer(
        &mut self,
        device: &ash::Device,
        size: usize,
        usage: vk::BufferUsageFlags,
    ) -> RendererResult<(vk::Buffer, Held)> {
        let info = vk::BufferCreateInfo::default().size(size as u64).usage(usage);
        // SAFETY: clauses 1 and 4, fresh memory that meets the buffer's requirements; the painter owns both.
        unsafe {
            let buffer = device.create_buffer(&info, None)?;
            let requirements = device.get_buffer_memory_requirements(buffer);
            let allocation = self.allocate(requirements, MemoryLocation::CpuToGpu, true)?;
            device.bind_buffer_memory(buffer, allocation.memory(), allocation.offset())?;
            Ok((buffer, allocation))
        }
    }

    fn create_image(&mut self, device: &ash::Device, width: u32, height: u32) -> RendererResult<(vk::Image, Held)> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(vk::Format::R8G8B8A8_SRGB)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::SAMPLED);
        // SAFETY: as above.
        unsafe {
            let image = device.create_image(&info, None)?;
            let requirements = device.get_image_memory_requirements(image);
            let allocation = self.allocate(requirements, MemoryLocation::GpuOnly, false)?;
            device.bind_image_memory(image, allocation.memory(), allocation.offset())?;
            Ok((image, allocation))
        }
    }

    fn destroy_buffer(&mut self, device: &ash::Device, buffer: vk::Buffer, memory: Held) -> RendererResult<()> {
        // SAFETY: clause 2, the painter waits until the GPU has finished with it.
        unsafe { device.destroy_buffer(buffer, None) };
        self.0.free(memory);
        Ok(())
    }

    fn destroy_image(&mut self, device: &ash::Device, image: vk::Image, memory: Held) -> RendererResult<()> {
        // SAFETY: as above.
        unsafe { device.destroy_image(image, None) };
        self.0.free(memory);
        Ok(())
    }

    fn update_buffer<T: Copy>(&mut self, _: &ash::Device, memory: &mut Held, data: &[T]) -> RendererResult<()> {
        let mapped =
            memory.mapped_slice_mut().ok_or_else(|| RendererError::Allocator("it is not mapped".to_owned()))?;
        // SAFETY: clause 6, vertices and indices; any bytes of theirs may be read.
        let bytes = unsafe { std::slice::from_raw_parts(data.as_ptr().cast::<u8>(), size_of_val(data)) };
        mapped[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }
}
