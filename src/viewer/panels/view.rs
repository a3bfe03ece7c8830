//! The view panel: cameras of the file, field of view, near plane, up axis, vsync, background.

use egui::{ComboBox, DragValue, Slider, Ui};

use super::super::state::{Request, Viewer, WindowRequest};
use crate::camera::{FIELDS_OF_VIEW, Up};
use crate::gpu::Vsync;
use crate::rules::Background;

pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    cameras(viewer, ui);
    let mut degrees = viewer.navigator.field_of_view();
    if ui.add(Slider::new(&mut degrees, FIELDS_OF_VIEW).suffix("°").text("field of view")).changed() {
        viewer.navigator.set_field_of_view(degrees);
        viewer.camera = None;
    }
    let near = &mut viewer.options.rules.near;
    ui.horizontal(|ui| {
        ui.add(DragValue::new(near).speed(0.002).range(1e-6..=1e6));
        ui.label("near plane, world units");
    });
    ui.horizontal(|ui| {
        let mut speed = viewer.navigator.speed();
        let step = speed * 0.01;
        if ui.add(DragValue::new(&mut speed).speed(step).range(1e-9..=1e9)).changed() {
            viewer.navigator.set_speed(speed);
        }
        ui.label("flying speed, world units per second");
    });
    ui.horizontal(|ui| {
        let mut up = viewer.navigator.up();
        ComboBox::from_label("up").width(50.0).selected_text(up.to_string()).show_ui(ui, |ui| {
            for axis in Up::ALL {
                ui.selectable_value(&mut up, axis, axis.to_string());
            }
        });
        if up != viewer.navigator.up() {
            viewer.navigator.set_up(up);
            viewer.camera = None;
        }
        let mut vsync = viewer.vsync;
        ComboBox::from_label("vsync").width(70.0).selected_text(format!("{vsync:?}")).show_ui(ui, |ui| {
            for mode in [Vsync::On, Vsync::Off, Vsync::Mailbox] {
                ui.selectable_value(&mut vsync, mode, format!("{mode:?}"));
            }
        });
        if vsync != viewer.vsync {
            viewer.requests.push(Request::Window(WindowRequest::Vsync(vsync)));
        }
    });
    ui.horizontal(|ui| {
        let mut colour = viewer.background.colour();
        if ui.color_edit_button_rgb(&mut colour).changed() {
            viewer.background = Background::Colour(colour);
            viewer.is_stale = true;
            viewer.comparison.is_stale = true;
        }
        ui.label("background");
        if ui.button("Copy view").clicked() {
            viewer.copy_view();
        }
        if ui.button("Reset view").clicked() {
            viewer.reset_view();
        }
    });
}

fn cameras(viewer: &mut Viewer, ui: &mut Ui) {
    if viewer.cameras.is_empty() {
        return;
    }
    let label = |i: usize, viewer: &Viewer| format!("{i}  {}", viewer.cameras[i].name);
    let chosen = viewer.camera.map_or_else(|| "camera".to_owned(), |i| label(i, viewer));
    ui.horizontal(|ui| {
        let mut wanted = None;
        ComboBox::from_id_salt("cameras").width(150.0).selected_text(chosen).show_ui(ui, |ui| {
            for i in 0..viewer.cameras.len() {
                if ui.selectable_label(viewer.camera == Some(i), label(i, viewer)).clicked() {
                    wanted = Some(i);
                }
            }
        });
        if let Some(index) = wanted {
            viewer.go_to_camera(index, false);
        }
        if ui.button("<").clicked() {
            viewer.step_camera(false);
        }
        if ui.button(">").clicked() {
            viewer.step_camera(true);
        }
        if ui.button("nearest").clicked() {
            viewer.go_to_nearest_camera();
        }
    });
}
