//! The cameras of the file over the picture, and the table of their photographs.

use egui::{Align2, Color32, ColorImage, Grid, RichText, ScrollArea, Stroke, TextureOptions, Ui, vec2};

use super::overlay::label;
use super::quality::progress;
use super::theme::{MARK, PATH};
use super::world_painter::WorldPainter;
use crate::pixels::Pixels;
use crate::viewer::model::{Evaluation, EvaluationRow, Plan, Purpose, Request, Side, Viewer, WindowRequest};

/// Depth of a drawn frustum, as a fraction of the scene's radius.
const SIZE: f64 = 0.06;

/// With more cameras, only their positions are drawn.
const MAX_FRUSTUMS: usize = 400;

/// Width of a photograph over the picture, in points.
const THUMBNAIL: f32 = 220.0;

/// Draws the cameras, and the photograph of the camera under the cursor.
pub(super) fn over_picture(viewer: &mut Viewer, world: &WorldPainter, ui: &Ui) {
    let deep = SIZE * viewer.view.navigator.radius();
    let colour = |index: usize| match Some(index) == viewer.pointer.camera {
        true => MARK,
        false => PATH,
    };
    // The frustum of the current camera would only frame the picture.
    for (index, named) in
        viewer.cameras.list.iter().enumerate().filter(|(index, _)| viewer.view.camera_index != Some(*index))
    {
        if viewer.cameras.list.len() <= MAX_FRUSTUMS {
            world.frustum(&named.camera, deep, Stroke::new(1.0, colour(index)));
        }
        world.dot(named.camera.position, 2.5, colour(index), "");
    }
    let Some((index, at)) =
        viewer.pointer.camera.and_then(|i| Some((i, world.position(viewer.cameras.list[i].camera.position)?)))
    else {
        return;
    };
    let painter = super::overlay::painter(ui);
    label(
        &painter,
        (at + vec2(8.0, -8.0), Align2::LEFT_BOTTOM),
        format!("{index}  {}", viewer.cameras.list[index].name),
    );
    viewer.read_thumbnail(index);
    let Some(Some(pixels)) = viewer.cameras.thumbnails.get(&index) else { return };
    let id = ui.id().with("thumbnail");
    let kept = ui.data(|data| data.get_temp::<(usize, egui::TextureHandle)>(id)).filter(|(of, _)| *of == index);
    let (_, texture) = kept.unwrap_or_else(|| {
        let texture = ui.ctx().load_texture("thumbnail", image(pixels), TextureOptions::LINEAR);
        ui.data_mut(|data| data.insert_temp(id, (index, texture.clone())));
        (index, texture)
    });
    let size = vec2(THUMBNAIL, THUMBNAIL * pixels.size[1] as f32 / pixels.size[0].max(1) as f32);
    // The photograph stays inside the picture.
    let free = ui.clip_rect();
    let low = (free.max - size).max(free.min);
    let rect = egui::Rect::from_min_size((at + vec2(12.0, 12.0)).clamp(free.min, low), size);
    let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
    painter.image(texture.id(), rect, whole, Color32::WHITE);
    painter.rect_stroke(rect, 0.0, Stroke::new(1.0, Color32::WHITE), egui::StrokeKind::Outside);
}

fn image(pixels: &Pixels) -> ColorImage {
    ColorImage::from_rgb(pixels.size.map(|side| side as usize), &pixels.to_rgb8())
}

/// The table of cameras and their photographs.
pub(super) fn table(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(photographs) = &viewer.cameras.photographs else { return };
    let (count, of) = (photographs.count_of(&viewer.cameras.list), viewer.cameras.list.len());
    ui.label(format!("{count} of {of} cameras have a photograph."))
        .on_hover_text(photographs.folder.display().to_string());
    ui.horizontal(|ui| {
        let hint =
            "Draws every camera in the size of its photograph, with these options; colours are clamped to 0 and 1";
        let can = count > 0 && viewer.measuring.running.is_none();
        if ui.add_enabled(can, egui::Button::new("Measure all")).on_hover_text(hint).clicked() {
            viewer.requests.push(Request::Evaluate);
        }
        if let Some(evaluation) = &viewer.cameras.evaluation
            && ui.button("Copy").on_hover_text("the table, as CSV").clicked()
        {
            viewer.requests.push(Request::Window(WindowRequest::Copy(evaluation.to_csv())));
        }
    });
    progress(viewer, Purpose::Evaluation, ui);
    let Some(evaluation) = &viewer.cameras.evaluation else { return };
    let Evaluation { rows, plan, background } = evaluation;
    let now = viewer.plan(Side::First).ok().flatten();
    let is_old =
        !now.is_some_and(|now: Plan| now.is_same(plan)) || background.colour() != viewer.view.background.colour();
    if is_old {
        ui.weak("These numbers are of other scenes, options or another background.");
    }
    let [psnr, ssim] = evaluation.means();
    let mut order: Vec<&EvaluationRow> = rows.iter().collect();
    // Equal pictures come last.
    let db = |row: &EvaluationRow| row.psnr_db.unwrap_or(f64::INFINITY);
    order.sort_by(|a, b| db(a).total_cmp(&db(b)));
    let mut wanted = None;
    ScrollArea::vertical().max_height(240.0).show(ui, |ui| {
        Grid::new("evaluation").num_columns(3).striped(true).show(ui, |ui| {
            for title in ["Camera", "PSNR, dB", "SSIM"] {
                ui.strong(title);
            }
            ui.end_row();
            let number =
                |value: Option<f64>, digits: usize| value.map_or_else(String::new, |v| format!("{v:.digits$}"));
            let line = |ui: &mut Ui, name: &str, numbers: [String; 2]| {
                let is_chosen = ui.link(name).clicked();
                for text in numbers {
                    let text = RichText::new(text).monospace();
                    ui.label(if is_old { text.weak() } else { text });
                }
                ui.end_row();
                is_chosen
            };
            line(ui, "mean", [number(psnr, 2), number(ssim, 4)]);
            for EvaluationRow { camera, name, psnr_db, ssim } in order {
                let db = psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.2}"));
                if line(ui, name, [db, number(*ssim, 4)]) {
                    wanted = Some(*camera);
                }
            }
        });
    });
    if let Some(camera) = wanted {
        viewer.compare_with_photograph_of(camera);
    }
}
