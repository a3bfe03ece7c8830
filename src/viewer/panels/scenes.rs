//! The list of scenes: visibility, placement, counts, and the path that draws them.

use std::path::PathBuf;

use egui::{DragValue, Ui};
use indicatif::HumanCount as count;

use crate::render::{Path, Residency};
use crate::viewer::model::{Action, Appearance, Layer, LoadedScene, Pair, Viewer};

pub(super) fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    let mut request = None;
    for layer in &mut viewer.scenes.layers {
        ui.push_id(layer.number, |ui| {
            if let Some(what) = show_layer(layer, ui) {
                request = Some((what, layer.number));
            }
        });
    }
    match request {
        Some((RowRequest::GoTo, number)) => viewer.frame_layer(number),
        Some((RowRequest::Close, number)) => viewer.close(number),
        None => {}
    }
    ui.horizontal(|ui| {
        let id = ui.id().with("open");
        let mut path = ui.data(|data| data.get_temp::<String>(id)).unwrap_or_default();
        let field =
            ui.add(egui::TextEdit::singleline(&mut path).hint_text("file or cactus:100000").desired_width(170.0));
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        if entered && !path.is_empty() {
            viewer.drop_file(&PathBuf::from(&path));
            ui.data_mut(|data| data.insert_temp(id, true));
        }
        // What cannot be opened stays, to be mended.
        if ui.data(|data| data.get_temp(id)).unwrap_or(false) && !viewer.scenes.are_loading() {
            ui.data_mut(|data| data.remove::<bool>(id));
            if !viewer.messages.shown().iter().any(|message| message.is_error) {
                path.clear();
            }
        }
        let key = viewer.setup.bindings.text(Action::OpenFile);
        if ui.button("Open...").on_hover_text(format!("Choose files ({key})")).clicked() {
            viewer.panels.dialog.open_files();
        }
        recent(viewer, ui);
        ui.data_mut(|data| data.insert_temp(id, path));
    });
    if let Some(first) = &pair.first {
        let totals = &first.frame.totals;
        // The portable path lists splats by tile, the fast path by bin.
        let listed = match first.path {
            Path::Portable | Path::Rays => "instances",
            Path::Fast | Path::FastRays => "entries",
        };
        ui.label(format!(
            "{} Gaussians, {} visible\n{} {listed}, longest list {}\ndrawn on the {} path",
            count(first.statistics.count as u64),
            count(totals.visible.into()),
            count(totals.listed_kept.into()),
            count(totals.longest_list.into()),
            first.path
        ));
        if let Some(Residency { missing, loading, resident, capacity, .. }) = first.residency() {
            ui.label(format!(
                "{} of {} pages in memory, {loading} loading\n{} pages drawn coarser than asked for",
                count(resident as u64),
                count(capacity as u64),
                count(missing.into())
            ));
        }
        if let Some(psnr) = first.level_psnr(viewer.pictures.view.as_ref(), viewer.view.background) {
            let explained = "PSNR of the levels of detail against all Gaussians, with its standard error: an estimate \
                             from 64 squares of 64x64 pixels that are drawn with all Gaussians, too";
            ui.label(format!("{psnr} to all Gaussians")).on_hover_text(explained);
        }
        if let Some(notice) = first.renderer.notice() {
            ui.label(notice);
        }
    }
}

/// The menu of recent files.
fn recent(viewer: &mut Viewer, ui: &mut Ui) {
    if viewer.panels.recent.files.is_empty() {
        return;
    }
    let mut chosen = None;
    ui.menu_button("⏷", |ui| {
        for file in &viewer.panels.recent.files {
            let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
            if ui.button(name).on_hover_text(file.display().to_string()).clicked() {
                chosen = Some(file.clone());
                ui.close();
            }
        }
    })
    .response
    .on_hover_text("Opened lately");
    if let Some(file) = chosen {
        viewer.drop_file(&file);
    }
}

/// The request of a row.
enum RowRequest {
    GoTo,
    Close,
}

/// The row of a layer.
fn show_layer(layer: &mut Layer, ui: &mut Ui) -> Option<RowRequest> {
    let mut request = None;
    ui.horizontal(|ui| {
        ui.checkbox(&mut layer.is_shown[0], "").on_hover_text("show it");
        ui.label(&layer.name).on_hover_text(&layer.summary);
        if layer.is_loaded && ui.small_button("go to").on_hover_text("move the view so that it is seen whole").clicked()
        {
            request = Some(RowRequest::GoTo);
        }
        if ui.small_button("x").on_hover_text("close it").clicked() {
            request = Some(RowRequest::Close);
        }
    });
    if let Some(fraction) = layer.progress {
        ui.add(egui::ProgressBar::new(fraction as f32).show_percentage());
        return request;
    }
    if let Some((file, places)) = &layer.places {
        let mut is_once = false;
        ui.horizontal(|ui| {
            let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
            ui.label(format!("at {} places of {name}", count(places.all().len() as u64)));
            is_once = ui.small_button("x").on_hover_text("draw it once").clicked();
        });
        if is_once {
            layer.places = None;
        }
    }
    ui.collapsing("Placement", |ui| {
        let placement = &mut layer.placement;
        egui::Grid::new("place").show(ui, |ui| {
            ui.label("Position x y z");
            for value in &mut placement.translation {
                ui.add(DragValue::new(value).speed(0.01));
            }
            ui.end_row();
            ui.label("Rotation x y z, °").on_hover_text("around z first, then x, then y");
            for value in &mut placement.rotation {
                ui.add(DragValue::new(value).speed(0.5));
            }
            ui.end_row();
            ui.label("Scale");
            ui.add(DragValue::new(&mut placement.scale).speed(0.01).range(1e-6..=1e6));
            ui.end_row();
        });
    });
    // Pages of a file are drawn as they are.
    if matches!(layer.scene, Some(LoadedScene::Paged(_))) {
        return request;
    }
    ui.collapsing("Colours and opacity", |ui| {
        let appearance = &mut layer.appearance;
        egui::Grid::new("appearance").show(ui, |ui| {
            ui.label("Tint").on_hover_text("factors on red, green and blue");
            // The button rounds what it shows.
            let mut tint = appearance.tint;
            if ui.color_edit_button_rgb(&mut tint).changed() {
                appearance.tint = tint;
            }
            ui.end_row();
            for (name, value, most) in [
                ("Brightness", &mut appearance.brightness, 10.0),
                ("Saturation", &mut appearance.saturation, 10.0),
                ("Opacity", &mut appearance.opacity, 100.0),
            ] {
                ui.label(name);
                ui.add(DragValue::new(value).speed(0.01).range(0.0..=most));
                ui.end_row();
            }
        });
        if !appearance.is_default() && ui.small_button("as in the file").clicked() {
            *appearance = Appearance::default();
        }
    });
    request
}
