//! Draws the triangles of an immediate-mode user interface (egui) over an image.

use anyhow::{Context, Result};
use ash::vk;
use egui::epaint::ImageDelta;
use egui::{ClippedPrimitive, TextureId};
use egui_ash_renderer::{DynamicRendering, Options, RenderMode, Renderer};

use super::commands::Commands;
use super::device::Device;
use super::error::describe;
use super::hazards::Access;
use super::image::Image;
use super::overlay_memory::OverlayMemory;

/// Draws the output of egui.
pub struct Overlay {
    painter: Option<Renderer<OverlayMemory>>,
    pool: vk::CommandPool,
    format: vk::Format,
    /// Unused textures, and the last submission that may read each.
    unused: Vec<(TextureId, u64)>,
    device: Device,
}

/// Recordings that may be on the GPU at the same time.
const IN_FLIGHT: usize = 4;

impl Overlay {
    /// An overlay for images of the same format as `like`.
    ///
    /// # Errors
    /// The pipeline or its memory cannot be created.
    pub fn new(device: &Device, like: &Image) -> Result<Self> {
        let shared = &device.0;
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(shared.capabilities.queue_family);
        // SAFETY: clause 1, the Overlay below owns the pool and frees it on every path.
        let pool = unsafe { shared.raw.create_command_pool(&info, None) };
        let format = like.texture.format;
        let mut overlay = Self {
            painter: None,
            pool: pool.map_err(|e| describe("vkCreateCommandPool", e))?,
            format,
            unused: Vec::new(),
            device: device.clone(),
        };
        let target = DynamicRendering {
            color_attachment_format: format,
            depth_attachment_format: None,
            stencil_attachment_format: None,
        };
        let painter = Renderer::with_allocator(
            OverlayMemory(shared.clone()),
            shared.raw.clone(),
            RenderMode::DynamicRendering(target),
            Options { in_flight_frames: IN_FLIGHT, ..Options::default() },
        );
        overlay.painter = Some(painter.context("cannot create the pipeline of the panels")?);
        Ok(overlay)
    }

    /// True if the overlay can draw over this image.
    pub fn fits(&self, image: &Image) -> bool {
        self.format == image.texture.format
    }

    /// Creates or changes a texture, for example when the panels show new glyphs. Waits for the GPU.
    pub fn set_texture(&mut self, id: TextureId, change: &ImageDelta) -> Result<()> {
        let queue = self.device.0.queue.lock().expect("no holder of the queue panics");
        let painter = self.painter.as_mut().expect("the painter lives until drop");
        painter.set_texture(queue.raw, self.pool, id, change).context("cannot store a texture of the panels")
    }

    /// Frees a texture after everything submitted so far is done.
    pub fn free_texture(&mut self, id: TextureId) {
        self.unused.push((id, self.device.submitted()));
    }

    fn free_unused(&mut self) -> Result<()> {
        let painter = self.painter.as_mut().expect("the painter lives until drop");
        let done = if self.unused.is_empty() { 0 } else { self.device.completed()? };
        while let Some(place) = self.unused.iter().position(|(_, last)| *last <= done) {
            painter.free_texture(self.unused.swap_remove(place).0).context("cannot free a texture of the panels")?;
        }
        Ok(())
    }
}

impl Commands {
    /// Draws `triangles` over `image`. When the commands are submitted, at most three other recordings with this
    /// overlay may be on the GPU.
    ///
    /// # Errors
    /// The memory for the triangles cannot be allocated.
    ///
    /// # Panics
    /// If the overlay does not fit the image.
    pub fn overlay(
        &mut self,
        overlay: &mut Overlay,
        image: &Image,
        pixels_per_point: f32,
        triangles: &[ClippedPrimitive],
    ) -> Result<()> {
        assert!(overlay.fits(image), "an overlay draws over images like the one that it was made for");
        overlay.free_unused()?;
        self.writes(image.resource(), "overlay", Access::DRAW);
        self.keep(image.resource());
        let [width, height] = image.size();
        let extent = vk::Extent2D { width, height };
        let attachment = vk::RenderingAttachmentInfo::default()
            .image_view(image.texture.view)
            .image_layout(vk::ImageLayout::GENERAL)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE);
        let info = vk::RenderingInfo::default()
            .render_area(vk::Rect2D { offset: vk::Offset2D::default(), extent })
            .layer_count(1)
            .color_attachments(std::slice::from_ref(&attachment));
        let raw = self.raw();
        let device = &overlay.device.0.raw;
        let painter = overlay.painter.as_mut().expect("the painter lives until drop");
        // SAFETY: clauses 2 and 4; the painter keeps the meshes of `IN_FLIGHT` recordings.
        unsafe {
            device.cmd_begin_rendering(raw, &info);
            let drawn = painter.cmd_draw(raw, extent, pixels_per_point, triangles);
            device.cmd_end_rendering(raw);
            drawn.context("cannot draw the panels")
        }
    }
}

impl Drop for Overlay {
    fn drop(&mut self) {
        let _ = self.device.wait_idle();
        drop(self.painter.take());
        // SAFETY: clause 2, the device is idle.
        unsafe { self.device.0.raw.destroy_command_pool(self.pool, None) };
    }
}
