//! The scenes panel: open scenes, their placement, counts, and the path that draws them.

use std::path::PathBuf;

use egui::{DragValue, Ui};

use super::super::comparison::CompareTarget;
use super::super::layers::Layer;
use super::super::screen::Pair;
use super::super::state::Viewer;
use crate::render::{Path, Residency};

pub(super) fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    if viewer.layers.is_empty() {
        ui.label("Drop a scene on the window, or name a file:");
    }
    let has_second = matches!(viewer.comparison.target, CompareTarget::Options(_));
    let mut closed = None;
    for layer in &mut viewer.layers {
        ui.push_id(layer.number, |ui| {
            if show_layer(layer, has_second, ui) {
                closed = Some(layer.number);
            }
        });
    }
    if let Some(number) = closed {
        viewer.close(number);
    }
    ui.horizontal(|ui| {
        let id = ui.id().with("open");
        let mut path = ui.data(|data| data.get_temp::<String>(id)).unwrap_or_default();
        let field =
            ui.add(egui::TextEdit::singleline(&mut path).hint_text("file or cactus:100000").desired_width(190.0));
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        if (ui.button("Open").clicked() || entered) && !path.is_empty() {
            viewer.drop_file(&PathBuf::from(std::mem::take(&mut path)));
        }
        ui.data_mut(|data| data.insert_temp(id, path));
    });
    if let Some(first) = &pair.first {
        let totals = &first.frame.totals;
        // The portable path lists splats by tile, the fast path by bin.
        let listed = match first.path {
            Path::Portable => "instances",
            Path::Fast => "entries",
        };
        ui.label(format!(
            "{} Gaussians, {} visible\n{} {listed}, longest list {}\ndrawn on the {} path",
            first.statistics.count, totals.visible, totals.listed_kept, totals.longest_list, first.path
        ));
        if let Some(Residency { missing, coming, there, fitting, .. }) = first.residency() {
            ui.label(format!(
                "{there} of {fitting} pages in memory, {coming} coming\n{missing} pages drawn coarser than asked for"
            ));
        }
        if let Some(notice) = first.renderer.notice() {
            ui.label(notice);
        }
    }
    if viewer.building.contains(&true) {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label("building");
        });
    }
}

/// The row of a scene; returns true if the user closes it.
fn show_layer(layer: &mut Layer, has_second: bool, ui: &mut Ui) -> bool {
    let mut is_closed = false;
    ui.horizontal(|ui| {
        ui.checkbox(&mut layer.is_shown[0], "").on_hover_text("show it");
        if has_second {
            ui.checkbox(&mut layer.is_shown[1], "").on_hover_text("show it in the second picture");
        }
        ui.label(&layer.name).on_hover_text(&layer.summary);
        is_closed = ui.small_button("x").on_hover_text("close it").clicked();
    });
    if let Some(fraction) = layer.progress {
        ui.add(egui::ProgressBar::new(fraction as f32).show_percentage());
        return is_closed;
    }
    ui.collapsing("placement", |ui| {
        let place = &mut layer.place;
        egui::Grid::new("place").show(ui, |ui| {
            ui.label("moved by");
            for value in &mut place.translation {
                ui.add(DragValue::new(value).speed(0.01));
            }
            ui.end_row();
            ui.label("rotated by, degrees");
            for value in &mut place.rotation {
                ui.add(DragValue::new(value).speed(0.5));
            }
            ui.end_row();
            ui.label("scaled by");
            ui.add(DragValue::new(&mut place.scale).speed(0.01).range(1e-6..=1e6));
            ui.end_row();
        });
    });
    is_closed
}
