//! The panels as they were laid out last. While the pointer is over the picture they are painted again, so that a
//! motion does not wait for layouts of what has not changed.

use std::sync::Arc;
use std::time::Instant;

use egui::epaint::{ClippedShape, Primitive};
use egui::{Rect, Shape, Ui};

use crate::viewer::model::{KeptPanels, Viewer};

/// Lays the panels out, and keeps their shapes. Returns the rectangle that they leave.
pub(super) fn laid_out(viewer: &mut Viewer, ui: &mut Ui, lay_out: impl FnOnce(&mut Viewer, &mut Ui)) -> Rect {
    let (layer, window) = (ui.layer_id(), ui.max_rect());
    let first = ui.ctx().graphics_mut(|graphics| graphics.entry(layer).next_idx().0);
    lay_out(viewer, ui);
    let free = ui.available_rect_before_wrap();
    let shapes = ui.ctx().graphics(|graphics| {
        graphics.get(layer).map_or_else(Vec::new, |list| list.all_entries().skip(first).cloned().collect())
    });
    let now = Instant::now();
    viewer.panels.kept = Some(KeptPanels { at: now, window, free, shapes });
    free
}

/// Paints the kept panels. Returns the rectangle that they leave; `None` if none are kept.
pub(super) fn painted(viewer: &mut Viewer, ui: &Ui) -> Option<Rect> {
    let kept = viewer.panels.kept.as_mut()?;
    if !kept.shapes.iter().all(|shape| matches!(shape.shape, Shape::Mesh(_))) {
        // Shapes are made into triangles once.
        let triangles = ui.ctx().tessellate(std::mem::take(&mut kept.shapes), ui.ctx().pixels_per_point());
        let mesh = |clipped: egui::ClippedPrimitive| match clipped.primitive {
            Primitive::Mesh(mesh) => {
                Some(ClippedShape { clip_rect: clipped.clip_rect, shape: Shape::Mesh(Arc::new(mesh)) })
            }
            Primitive::Callback(_) => None,
        };
        kept.shapes = triangles.into_iter().filter_map(mesh).collect();
    }
    ui.ctx().graphics_mut(|graphics| {
        let list = graphics.entry(ui.layer_id());
        for ClippedShape { clip_rect, shape } in &kept.shapes {
            list.add(*clip_rect, shape.clone());
        }
    });
    Some(kept.free)
}
