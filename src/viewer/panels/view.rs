//! The view panel: cameras of the file, field of view, near plane, up axis, vsync, background.

use egui::{ComboBox, DragValue, Grid, Slider, TextEdit, Ui};

use crate::camera::Up;
use crate::gpu::Vsync;
use crate::rules::Background;
use crate::viewer::actions::Program;
use crate::viewer::model::{Action, Request, Viewer, WindowRequest};

const PINHOLE: &str = "PINHOLE";

pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    cameras(viewer, ui);
    let hint = "The axes of the world, a grid on the ground, and directions to look from";
    ui.checkbox(&mut viewer.panels.recent.shows_guides, "Show axes and a grid").on_hover_text(hint);
    Grid::new("view").num_columns(2).show(ui, |ui| {
        ui.label("Field of view");
        field_of_view(viewer, ui);
        ui.end_row();
        lens(viewer, ui);
        ui.end_row();
        ui.label("Near plane");
        let near = &mut viewer.options.rules.near;
        let field = ui.add(DragValue::new(near).speed(0.002).range(1e-6..=1e6));
        field.on_hover_text("World units. Gaussians closer to the camera are not drawn");
        ui.end_row();
        ui.label("Fly speed");
        let mut speed = viewer.view.navigator.speed();
        let step = speed * 0.01;
        let field = ui.add(DragValue::new(&mut speed).speed(step).range(1e-9..=1e9));
        if field.on_hover_text("World units a second").changed() {
            viewer.view.navigator.set_speed(speed);
        }
        ui.end_row();
        ui.label("Up");
        let mut up = viewer.view.navigator.up();
        ComboBox::from_id_salt("up").width(50.0).selected_text(up.to_string()).show_ui(ui, |ui| {
            for axis in Up::ALL {
                ui.selectable_value(&mut up, axis, axis.to_string());
            }
        });
        if up != viewer.view.navigator.up() {
            viewer.view.navigator.set_up(up);
            viewer.view.camera_index = None;
        }
        ui.end_row();
        ui.label("Vertical sync");
        let mut vsync = viewer.timing.vsync;
        ComboBox::from_id_salt("vsync").width(70.0).selected_text(format!("{vsync:?}")).show_ui(ui, |ui| {
            for mode in [Vsync::On, Vsync::Off, Vsync::Mailbox] {
                ui.selectable_value(&mut vsync, mode, format!("{mode:?}"));
            }
        });
        if vsync != viewer.timing.vsync {
            viewer.requests.push(Request::Window(WindowRequest::Vsync(vsync)));
        }
        ui.end_row();
        ui.label("Background");
        let mut colour = viewer.view.background.colour();
        if ui.color_edit_button_rgb(&mut colour).changed() {
            viewer.view.background = Background::Colour(colour);
            viewer.pictures.are_stale = true;
            viewer.comparison.is_stale = true;
        }
        ui.end_row();
    });
    ui.horizontal_wrapped(|ui| {
        let keys = [Action::Reset, Action::CopyView, Action::CopyCommand].map(|key| viewer.setup.bindings.text(key));
        let hint = "A narrow view from far away, nearly orthographic: its rays differ by less than two degrees";
        if ui.selectable_label(viewer.view.is_flat(), "Flat").on_hover_text(hint).clicked() {
            viewer.toggle_flat();
        }
        if ui.button("First view").on_hover_text(format!("Go back to it ({})", keys[0])).clicked() {
            viewer.reset_view();
        }
        let hint = format!("As an entry of a cameras.json ({}); paste it in another window", keys[1]);
        if ui.button("Copy view").on_hover_text(hint).clicked() {
            viewer.copy_view();
        }
        let menu = ui.menu_button("Copy command", |ui| {
            for (program, name) in Program::ALL {
                if ui.button(format!("smalto {name}")).clicked() {
                    viewer.copy_command(program);
                    ui.close();
                }
            }
        });
        menu.response.on_hover_text(format!("The command line that draws this view ({} for render)", keys[2]));
    });
}

fn field_of_view(viewer: &mut Viewer, ui: &mut Ui) {
    let mut degrees = viewer.view.navigator.field_of_view();
    let fields = viewer.view.navigator.fields_of_view();
    if fields.start() == fields.end() {
        ui.label(format!("{degrees:.0}°"));
        return;
    }
    // Few views are narrower than a degree, so the slider gives them little room.
    let slider = Slider::new(&mut degrees, fields).suffix("°").logarithmic(true).smallest_positive(5.0);
    if ui.add(slider).on_hover_text("Horizontal, in degrees").changed() {
        viewer.view.navigator.set_field_of_view(degrees);
        viewer.view.camera_index = None;
    }
}

/// The lens as a text of `--lens`, and the lenses without numbers to choose from.
fn lens(viewer: &mut Viewer, ui: &mut Ui) {
    ui.label("Lens");
    let own = viewer.view.camera().lens.map_or_else(|| PINHOLE.to_owned(), |lens| lens.text());
    let id = ui.id().with("lens");
    let mut text = ui.data(|data| data.get_temp::<String>(id)).unwrap_or_else(|| own.clone());
    let mut wanted = None;
    ui.horizontal(|ui| {
        let hint = "The name of a model and its numbers, as of smalto render --lens, like OPENCV:-0.1,0.01,0,0";
        let field = ui.add(TextEdit::singleline(&mut text).desired_width(130.0)).on_hover_text(hint);
        if field.has_focus() {
            ui.data_mut(|data| data.insert_temp(id, text.clone()));
        }
        if field.lost_focus() {
            ui.data_mut(|data| data.remove::<String>(id));
            wanted = Some(text);
        }
        ui.menu_button("…", |ui| {
            for name in [PINHOLE, "FISHEYE", "EQUIRECTANGULAR", "ORTHOGRAPHIC"] {
                if ui.button(name).clicked() {
                    wanted = Some(name.to_owned());
                    ui.close();
                }
            }
        });
    });
    if let Some(text) = wanted.filter(|text| *text != own) {
        viewer.set_lens(&text);
    }
}

fn cameras(viewer: &mut Viewer, ui: &mut Ui) {
    if viewer.cameras.list.is_empty() {
        return;
    }
    let label = |i: usize, viewer: &Viewer| format!("{i}  {}", viewer.cameras.list[i].name);
    let chosen = viewer.view.camera_index.map_or_else(|| "camera".to_owned(), |i| label(i, viewer));
    ui.horizontal(|ui| {
        let mut wanted = None;
        ComboBox::from_id_salt("cameras").width(150.0).selected_text(chosen).show_ui(ui, |ui| {
            for i in 0..viewer.cameras.list.len() {
                if ui.selectable_label(viewer.view.camera_index == Some(i), label(i, viewer)).clicked() {
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
    let key = viewer.setup.bindings.text(Action::ShowCameras);
    let hint = format!("Over the picture; a click goes to one ({key})");
    ui.checkbox(&mut viewer.panels.recent.shows_cameras, "Show the cameras").on_hover_text(hint);
}
