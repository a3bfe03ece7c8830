//! Commands on whole images: copies to and from the host, and changes of layout.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use anyhow::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;

use super::buffer::{Buffer, Storage};
use super::commands::Commands;
use super::hazards::Access;
use super::image::{Image, Texture, WHOLE};
use super::resource::Resource;
use super::staging::Staging;
use super::submission::Readback;

const LAYER: vk::ImageSubresourceLayers = vk::ImageSubresourceLayers {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    mip_level: 0,
    base_array_layer: 0,
    layer_count: 1,
};

impl Commands {
    /// Copies the `rows` of an image of floats to the host, row by row without gaps.
    ///
    /// # Errors
    /// The memory of the copy cannot be allocated.
    ///
    /// # Panics
    /// If `rows` is empty or not inside the image.
    pub fn read_rows(&mut self, image: &Image, rows: Range<u32>) -> Result<Readback<[f32; 4]>> {
        let [width, height] = image.size();
        assert!(rows.start < rows.end && rows.end <= height, "the rows lie in the image");
        self.reads(image.resource(), "read back", Access::COPY_READ);
        let pixels = width as usize * rows.len();
        let staging = self.readback_storage(pixels as u64 * 16)?;
        self.copy_rows(image, &staging, rows);
        Ok(Readback::new(staging, pixels, self.recording))
    }

    /// Copies rectangles (left, top, width, height) of an image of floats to the host, one after the other, each row by
    /// row.
    ///
    /// # Errors
    /// The memory of the copy cannot be allocated.
    ///
    /// # Panics
    /// If a rectangle is empty or not inside the image.
    pub fn read_rectangles(&mut self, image: &Image, rectangles: &[[u32; 4]]) -> Result<Readback<[f32; 4]>> {
        let [image_width, image_height] = image.size();
        let (mut regions, mut pixels) = (Vec::new(), 0);
        for [left, top, width, height] in rectangles {
            let is_inside = left + width <= image_width && top + height <= image_height && *width > 0 && *height > 0;
            assert!(is_inside, "the rectangles lie in the image");
            let region = vk::BufferImageCopy::default()
                .buffer_offset(16 * pixels as u64)
                .image_subresource(LAYER)
                .image_offset(vk::Offset3D { x: *left as i32, y: *top as i32, z: 0 })
                .image_extent(vk::Extent3D { width: *width, height: *height, depth: 1 });
            regions.push(region);
            pixels += *width as usize * *height as usize;
        }
        self.reads(image.resource(), "read back", Access::COPY_READ);
        let staging = self.readback_storage(pixels as u64 * 16)?;
        self.copy_rectangles(image, &staging, &regions);
        Ok(Readback::new(staging, pixels, self.recording))
    }

    /// Copies all pixels of an image of floats to the host, row by row without gaps: four words each. They are there
    /// after the wait.
    ///
    /// # Panics
    /// If there are fewer words.
    pub fn download_pixels(&mut self, image: &Image, to: &Staging<u32>) {
        let [width, height] = image.size();
        assert!(to.len() >= width as usize * height as usize * 4, "the pixels of `{}` fit", image.texture.name);
        self.reads(image.resource(), "download", Access::COPY_READ);
        self.has_readbacks = true;
        self.copy_rows(image, to.storage(), 0..height);
    }

    /// Copies rows of an image to a buffer that holds at least as many pixels.
    fn copy_rows(&mut self, image: &Image, to: &Arc<Storage>, rows: Range<u32>) {
        let region = vk::BufferImageCopy::default()
            .image_subresource(LAYER)
            .image_offset(vk::Offset3D { x: 0, y: rows.start as i32, z: 0 })
            .image_extent(vk::Extent3D { width: image.size()[0], height: rows.len() as u32, depth: 1 });
        self.copy_rectangles(image, to, &[region]);
    }

    fn copy_rectangles(&mut self, image: &Image, to: &Arc<Storage>, regions: &[vk::BufferImageCopy]) {
        self.keep(image.resource());
        self.keep(Resource::Buffer(to));
        let (from, layout) = (image.texture.raw, vk::ImageLayout::GENERAL);
        // SAFETY: clauses 2 and 4; the image is in GENERAL, and callers checked that the buffer holds the regions.
        unsafe { self.device.0.raw.cmd_copy_image_to_buffer(self.raw(), from, layout, to.raw, regions) };
    }

    /// Writes all pixels of an image of floats, row by row.
    ///
    /// # Errors
    /// The staging buffer cannot be allocated.
    ///
    /// # Panics
    /// If the number of pixels differs from the image's.
    pub fn upload_image(&mut self, image: &Image, pixels: &[[f32; 4]]) -> Result<()> {
        let [width, height] = image.size();
        assert_eq!(pixels.len(), width as usize * height as usize, "there is a value for every pixel");
        let usage = vk::BufferUsageFlags::TRANSFER_SRC;
        let bytes = size_of_val(pixels) as u64;
        let mut staging = Storage::new(&self.device.0, "upload", bytes, usage, MemoryLocation::GpuToCpu)?;
        staging.mapped_mut().copy_from_slice(bytemuck::cast_slice(pixels));
        self.writes(image.resource(), "upload", Access::COPY_WRITE);
        self.fill_image(&Arc::new(staging), image);
        Ok(())
    }

    /// Copies the first `rows` rows of an image of floats to the top of another one of the same width.
    ///
    /// # Panics
    /// If the widths differ, or an image has fewer rows.
    pub fn copy_top(&mut self, from: &Image, to: &Image, rows: u32) {
        let ([width, height], [to_width, to_height]) = (from.size(), to.size());
        assert!(width == to_width && rows <= height && rows <= to_height, "both images have the rows");
        self.reads(from.resource(), "copy of rows", Access::COPY_READ);
        self.writes(to.resource(), "copy of rows", Access::COPY_WRITE);
        self.keep(from.resource());
        self.keep(to.resource());
        let (layer, extent) = (LAYER, vk::Extent3D { width, height: rows, depth: 1 });
        let region = vk::ImageCopy::default().src_subresource(layer).dst_subresource(layer).extent(extent);
        let (from, to, layout) = (from.texture.raw, to.texture.raw, vk::ImageLayout::GENERAL);
        // SAFETY: clauses 2 and 4; both images are in GENERAL, have the same format, and hold the region.
        unsafe { self.device.0.raw.cmd_copy_image(self.raw(), from, layout, to, layout, &[region]) };
    }

    /// Copies pixels of 8 bits per channel, one word each and row by row, into an image for a screen.
    ///
    /// # Panics
    /// If the buffer has fewer words than the image has pixels.
    pub fn copy_to_screen(&mut self, from: &Buffer<u32>, to: &Image) {
        let [width, height] = to.size();
        assert!(from.len() >= width as usize * height as usize, "there is a word for every pixel");
        self.reads(from.resource(), "copy to screen", Access::COPY_READ);
        self.writes(to.resource(), "copy to screen", Access::COPY_WRITE);
        self.fill_image(&from.storage, to);
    }

    /// Copies all pixels of an image from a buffer that holds at least as many.
    fn fill_image(&mut self, from: &Arc<Storage>, to: &Image) {
        self.keep(Resource::Buffer(from));
        self.keep(to.resource());
        let [width, height] = to.size();
        let region = vk::BufferImageCopy::default().image_subresource(LAYER).image_extent(vk::Extent3D {
            width,
            height,
            depth: 1,
        });
        let (buffer, image, layout) = (from.raw, to.texture.raw, vk::ImageLayout::GENERAL);
        // SAFETY: clauses 2 and 4; the image is in GENERAL, and callers checked that the buffer has its pixels.
        unsafe { self.device.0.raw.cmd_copy_buffer_to_image(self.raw(), buffer, image, layout, &[region]) };
    }

    /// Copies an image for a screen to the host: red, green, blue and alpha of each pixel, row by row.
    ///
    /// # Errors
    /// The memory of the copy cannot be allocated.
    pub fn read_screen(&mut self, image: &Image) -> Result<Readback<[u8; 4]>> {
        let [width, height] = image.size();
        self.reads(image.resource(), "read back", Access::COPY_READ);
        let pixels = width as usize * height as usize;
        let staging = self.readback_storage(pixels as u64 * 4)?;
        self.copy_rows(image, &staging, 0..height);
        Ok(Readback::new(staging, pixels, self.recording))
    }

    /// Changes the layout of a new image to GENERAL, in which it stays.
    pub(super) fn make_general(&mut self, texture: &Arc<Texture>) {
        if texture.is_general.swap(true, Ordering::Relaxed) {
            return;
        }
        let barrier = vk::ImageMemoryBarrier2::default()
            // After the wait for an image of a swapchain.
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_access_mask(vk::AccessFlags2::MEMORY_WRITE | vk::AccessFlags2::MEMORY_READ)
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(vk::ImageLayout::GENERAL)
            .image(texture.raw)
            .subresource_range(WHOLE);
        self.pipeline_barrier(&vk::DependencyInfo::default().image_memory_barriers(&[barrier]));
        self.fresh.push(texture.clone());
    }

    /// Changes the layout of a window's image for presentation.
    pub(super) fn make_presentable(&mut self, image: &Image) {
        self.keep(image.resource());
        let barrier = vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::NONE)
            .old_layout(vk::ImageLayout::GENERAL)
            .new_layout(vk::ImageLayout::PRESENT_SRC_KHR)
            .image(image.texture.raw)
            .subresource_range(WHOLE);
        self.pipeline_barrier(&vk::DependencyInfo::default().image_memory_barriers(&[barrier]));
    }
}
