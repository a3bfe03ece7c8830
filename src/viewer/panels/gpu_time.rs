//! The panels of GPU time by stage and of device memory by buffer.

use egui::{Color32, Grid, Mesh, Rect, Sense, Ui, pos2, vec2};
use indicatif::HumanCount;

use super::theme::stage_colour;
use crate::gpu::MemoryUse;
use crate::measure::bench::{Clocks, Statistics};
use crate::render::{DeviceBand, SlabReport};
use crate::viewer::model::{Digest, Pair, Sharing, Viewer};

/// Frames in the plot.
const PLOTTED: usize = 120;
/// Least height of a drawn bar, in points.
const MIN_HEIGHT: f32 = 0.25;

/// A square of a colour.
pub(super) fn swatch(ui: &mut Ui, colour: Color32) -> egui::Response {
    let (response, painter) = ui.allocate_painter(vec2(10.0, 10.0), Sense::hover());
    painter.rect_filled(response.rect, 2.0, colour);
    painter.rect_stroke(response.rect, 2.0, (1.0, Color32::GRAY), egui::StrokeKind::Inside);
    response
}

pub(super) fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    viewer.timing.frame_times.summarize();
    if pair.second.as_ref().is_some_and(|second| second.drawn().is_some()) {
        ui.label("both pictures together");
    }
    let Some(Digest { stages, whole }) = viewer.timing.frame_times.digest() else {
        ui.label("no frame yet");
        return;
    };
    plot(viewer, whole.p95.max(1e-3) as f32 * 1.25, ui);
    Grid::new("stages").num_columns(4).striped(true).show(ui, |ui| {
        ui.label("GPU ms");
        for (title, help) in [
            ("median", "Half of the last frames took less"),
            ("p95", "95 of 100 frames took less"),
            ("p99", "99 of 100 frames took less"),
        ] {
            ui.label(title).on_hover_text(help);
        }
        ui.end_row();
        for (name, times) in stages {
            ui.horizontal(|ui| {
                swatch(ui, stage_colour(name));
                ui.label(*name).on_hover_text(stage_help(name));
            });
            milliseconds(times, ui);
            ui.end_row();
        }
        ui.strong("frame");
        milliseconds(whole, ui);
        ui.end_row();
    });
    if let Some(Clocks { shader_mhz, memory_mhz }) = viewer.timing.clocks {
        let hint = "A GPU that has little to do lowers its clocks, and each frame then takes longer";
        ui.label(format!("clocks: {shader_mhz} MHz, memory {memory_mhz} MHz")).on_hover_text(hint);
    }
    if let Some(sharing) = pair.first.as_ref().and_then(|first| first.sharing.as_ref()) {
        devices(sharing, ui);
    }
    let pace = &viewer.timing.pace;
    let frames = if pace.drawn == 1 { "frame" } else { "frames" };
    let late =
        if pace.dropped > 0 { format!(", {} missed a refresh", HumanCount(pace.dropped)) } else { String::new() };
    ui.label(format!("{} {frames} drawn{late}", HumanCount(pace.drawn)));
    if pace.mean_latency_ms > 0.0 {
        ui.label(format!("{:.1} ms from an input to the submission of its frame, mean", pace.mean_latency_ms))
            .on_hover_text("The GPU's time and the screen's refresh come after it");
    }
}

/// The bands of the first picture by device.
fn devices(sharing: &Sharing, ui: &mut Ui) {
    let bands = sharing.devices.last_bands();
    if bands.is_empty() {
        ui.label("one device draws").on_hover_text(
            "Bands on several devices are tried where pictures take long, and kept where they are faster. They are of \
             pictures in colours, without edits, at full scale and not along rays",
        );
    }
    for DeviceBand { device, band, ms } in bands {
        ui.label(format!("rows {} to {}: {device}, {ms:.3} ms", band.top, band.top + band.rows - 1));
    }
}

/// The help text of a stage.
fn stage_help(stage: &str) -> &'static str {
    match stage {
        "cull" => "Finds the Gaussians that can be seen",
        "project" => "Makes splats of the Gaussians that can be seen",
        "scan" => "Adds up the numbers of tiles, so that every splat has a place in the lists",
        "duplicate" | "list" => "Lists the splats by tile or bin",
        "offsets" | "ranges" => "Finds where the list of each tile or bin begins",
        "sort" | "sort depths" | "sort tiles" => "Sorts the lists by depth",
        "merge" => "Joins lists that were sorted in parts",
        "masks" => "Notes which blocks of pixels each splat meets",
        "blend" => "Blends the splats of each pixel from front to back",
        "look" | "count" | "choose" => "Chooses the pages of levels of detail",
        "upscale" => "Enlarges a picture that was drawn smaller",
        "other devices" => "Waits for the bands of the other devices",
        "join" => "Brings the bands of all devices together",
        "inspect" | "shade attribute" => "Finds what the look shows in place of colours",
        "display" => "Brings the pictures to the screen",
        "panels" => "Draws the panels",
        _ => "",
    }
}

fn milliseconds(times: &Statistics, ui: &mut Ui) {
    for ms in [times.median, times.p95, times.p99] {
        ui.monospace(if ms < 100.0 { format!("{ms:.3}") } else { format!("{ms:.1}") });
    }
}

/// The last frames as stacked bars, one colour per stage.
fn plot(viewer: &Viewer, top_ms: f32, ui: &mut Ui) {
    let (response, painter) = ui.allocate_painter(vec2(ui.available_width(), 90.0), Sense::hover());
    let rect = response.rect;
    painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let stages = viewer.timing.frame_times.stages();
    let width = rect.width() / PLOTTED as f32;
    let frames = viewer.timing.frame_times.frames();
    let (first, skipped) = (PLOTTED.saturating_sub(frames.len()), frames.len().saturating_sub(PLOTTED));
    // One mesh instead of thousands of shapes.
    let mut bars = Mesh::default();
    let colours: Vec<Color32> = stages.iter().map(|stage| stage_colour(stage)).collect();
    for (i, frame) in frames.skip(skipped).enumerate() {
        let x = rect.left() + (first + i) as f32 * width;
        let mut below = rect.bottom();
        for (stage, ms) in frame.iter().enumerate() {
            let above = (below - ms / top_ms * rect.height()).max(rect.top());
            if below - above > MIN_HEIGHT {
                bars.add_colored_rect(Rect::from_min_max(pos2(x, above), pos2(x + width, below)), colours[stage]);
            }
            below = above;
        }
    }
    painter.add(bars);
    let text = format!("{top_ms:.2} ms");
    let font = egui::FontId::monospace(10.0);
    painter.text(rect.left_top() + vec2(3.0, 2.0), egui::Align2::LEFT_TOP, text, font, ui.visuals().weak_text_color());
}

/// The device memory of the first picture by buffer, the largest first.
pub(super) fn memory(pair: &Pair, ui: &mut Ui) {
    let Some(first) = &pair.first else { return };
    let mut buffers = first.buffers();
    buffers.sort_by_key(|(_, bytes)| std::cmp::Reverse(*bytes));
    let MemoryUse { user_limit, limit, used, peak, driver_used } = first.renderer.memory();
    let megabytes = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    let row = |ui: &mut Ui, name: &str, bytes: Option<u64>| {
        ui.label(name);
        ui.monospace(bytes.map_or_else(|| "-".to_owned(), megabytes));
        ui.end_row();
    };
    Grid::new("ledger").num_columns(2).show(ui, |ui| {
        row(ui, "limit (--memory)", user_limit.or(limit));
        row(ui, "allocated", Some(used));
        row(ui, "the most so far", Some(peak));
        row(ui, "in use, by the driver", driver_used);
    });
    if let Some(SlabReport { slabs, pages_read, pages_in_view, .. }) = first.frame.parts.filter(|parts| parts.slabs > 1)
    {
        let pages =
            if pages_in_view > 0 { format!(", {pages_read} of {pages_in_view} pages read") } else { String::new() };
        ui.label(format!("drawn in {slabs} parts{pages}"));
    }
    let all: u64 = buffers.iter().map(|(_, bytes)| bytes).sum();
    ui.label(format!("first picture: {:.1} MB in {} buffers", all as f64 / 1e6, buffers.len()));
    Grid::new("memory").num_columns(2).striped(true).show(ui, |ui| {
        for (name, bytes) in buffers {
            ui.label(name);
            ui.monospace(format!("{:9.3} MB", bytes as f64 / 1e6));
            ui.end_row();
        }
    });
}
