//! Actions that move the view: to scenes, to cameras of the file, and to copied views.

use std::path::Path;
use std::sync::Arc;

use anyhow::anyhow;
use glam::DVec3;

use crate::camera::{Lens, LensChoice, NamedCamera};
use crate::scene::Focus;
use crate::viewer::model::{Action, Event, Layer, LoadedScene, Request, Start, Viewer, WindowRequest, camera_of};

/// The index of a camera by its position, from -1 on backwards, or by its name with or without an ending.
fn position_of(cameras: &[NamedCamera], wanted: &str) -> Option<usize> {
    let number = wanted.parse().ok().filter(|number: &i64| number.to_string() == wanted);
    let position = number.map(|number| if number < 0 { number + cameras.len() as i64 } else { number });
    let by_position = position.and_then(|position| usize::try_from(position).ok()).filter(|i| *i < cameras.len());
    let by_name = || cameras.iter().position(|camera| camera.name == wanted);
    by_position.or_else(by_name).or_else(|| camera_of(Path::new(wanted), cameras))
}

const NO_CAMERAS: &str = "there is no camera file: drop one on the window, such as a cameras.json";

impl Viewer {
    /// Goes to the first view of a scene: the first camera of the file, or a view of the whole scene.
    pub fn set_first_view(&mut self, focus: Focus) {
        let (centre, radius) = (DVec3::from(focus.centre), focus.radius);
        self.view.navigator.frame(centre, radius, self.view.size);
        self.inspector.settings.set_scene_radius(radius);
        let has_project = self.scenes.project.is_some();
        if self.cameras.list.is_empty() && !self.setup.near_is_explicit && !has_project {
            // `smalto render` moves the near plane closer for a small scene, too.
            let distance = self.view.camera().position.distance(self.view.navigator.pivot());
            let nearest = distance as f32 / 100.0;
            self.view.near_limit = Some(nearest);
            self.options.rules.near = self.setup.options.rules.near.min(nearest);
        }
        if let LensChoice::All(lens) = &self.setup.lenses {
            self.view.navigator.set_lens(lens.clone());
        }
        if !self.go_to_project() || self.setup.start.is_some() {
            self.go_to_start(focus);
        }
        self.view.is_set = true;
        self.view.first = Some(self.view.camera());
        self.pictures.are_stale = true;
    }

    /// Goes to the view that the program was started with, or to the first camera of the file.
    pub fn go_to_start(&mut self, focus: Focus) {
        match self.setup.start.clone() {
            None => self.go_to_camera(0, true),
            Some(Start::Camera(wanted)) => match position_of(&self.cameras.list, &wanted) {
                Some(index) => self.go_to_camera(index, true),
                // The cameras, once they are read, call this again.
                None if self.cameras.are_loading && self.cameras.file.is_none() => {}
                None => {
                    let count = self.cameras.list.len();
                    let why = if count == 0 { "there is no camera file" } else { "the file has no such camera" };
                    self.refuse_start(anyhow!("--camera {wanted}: {why}"));
                }
            },
            Some(Start::Eye(camera)) => match camera(focus, self.view.size) {
                Ok((camera, nearest)) => {
                    self.view.snap(&camera);
                    if !self.setup.near_is_explicit {
                        self.options.rules.near = self.setup.options.rules.near.min(nearest);
                    }
                }
                Err(problem) => self.refuse_start(problem),
            },
        }
    }

    fn refuse_start(&mut self, problem: anyhow::Error) {
        self.messages.error(format!("{problem:#}"));
        self.messages.failure.get_or_insert(problem);
    }

    /// Goes to a camera of the file, at once or in a glide. Does nothing if there is no such camera.
    pub fn go_to_camera(&mut self, index: usize, at_once: bool) {
        let Some(named) = self.cameras.list.get(index) else { return };
        let (camera, name) = (named.camera.clone(), named.name.clone());
        if at_once {
            self.view.navigator.snap(&camera);
        } else {
            self.view.navigator.glide_to(&camera, crate::camera::GLIDE_SECONDS);
        }
        if self.view.camera_index.replace(index) != Some(index) {
            self.events.emit(&Event::Camera { index, name });
        }
        self.view.last_camera_index = index;
        self.pictures.are_stale = true;
        self.compare_photograph_at(index);
    }

    /// Goes to the next camera of the file, or to the previous one.
    pub fn step_camera(&mut self, forward: bool) {
        let count = self.cameras.list.len();
        if count == 0 {
            return self.messages.note(NO_CAMERAS);
        }
        // After the view has left a camera, steps continue from that camera.
        let last = self.view.last_camera_index.min(count - 1);
        let next = if forward { (last + 1) % count } else { (last + count - 1) % count };
        self.go_to_camera(next, false);
    }

    pub fn go_to_nearest_camera(&mut self) {
        match self.view.navigator.nearest(&self.cameras.list) {
            Some(index) => self.go_to_camera(index, false),
            None => self.messages.note(NO_CAMERAS),
        }
    }

    /// Goes back to the first view. The speed of flying and the near plane stay.
    pub fn reset_view(&mut self) {
        let first = || self.scenes.layers.iter().find_map(|layer| layer.scene.as_ref()).map(LoadedScene::focus);
        if let Some(focus) = self.scenes.focus().or_else(first) {
            let (speed, near) = (self.view.navigator.speed(), self.options.rules.near);
            self.set_first_view(focus);
            self.view.navigator.set_speed(speed);
            self.options.rules.near = near;
        }
    }

    /// Glides to a view of all shown scenes.
    pub fn frame_scene(&mut self) {
        let own = || Focus { centre: self.view.navigator.centre().to_array(), radius: self.view.navigator.radius() };
        let Focus { centre, radius } = self.scenes.focus().unwrap_or_else(own);
        self.view.glide_around(DVec3::from(centre), radius);
    }

    /// Glides to a view of one scene.
    pub fn frame_layer(&mut self, number: u64) {
        let layer = self.scenes.layer(number);
        if let Some(Focus { centre, radius }) = layer.and_then(Layer::placed_focus) {
            self.view.glide_around(DVec3::from(centre), radius);
        }
    }

    /// Shows all scenes if the layer, opened in addition to others, is out of view. A view at a camera of the file
    /// stays.
    pub fn reveal_layer(&mut self, place: usize) {
        let layer = &self.scenes.layers[place];
        let (Some(own), Some(all)) = (layer.placed_focus(), self.scenes.focus()) else { return };
        if self.view.camera_index.is_some() || self.view.camera().sees(DVec3::from(own.centre)) {
            return;
        }
        if !self.view.has_moved() {
            return self.set_first_view(all);
        }
        let key = self.setup.bindings.text(Action::Undo);
        let text = format!("{} lay out of sight, so the view shows all scenes ({key} goes back)", layer.name);
        self.messages.note(text);
        self.record_undo_step();
        self.view.glide_around(DVec3::from(all.centre), all.radius);
    }

    /// Copies the view to the clipboard, as an entry of a cameras.json.
    pub fn copy_view(&mut self) {
        let text = crate::camera::to_json(&self.view.camera());
        if let Ok(view) = serde_json::from_str(&text) {
            self.events.emit(&Event::Copied { view });
        }
        self.requests.push(Request::Window(WindowRequest::Copy(text)));
        self.messages.note("the view is copied");
    }

    /// Goes to a view that was copied as JSON.
    pub fn paste_view(&mut self, text: &str) {
        match crate::camera::from_json(text) {
            Ok(camera) => {
                self.view.snap(&camera);
                self.pictures.are_stale = true;
            }
            Err(problem) => self.messages.note(format!("the clipboard does not hold a view: {problem:#}")),
        }
    }

    /// Freezes culling at this view, or lets it follow the camera again.
    pub fn toggle_frozen_culling(&mut self) {
        if self.scenes.layers.is_empty() {
            return self.messages.note("there is no scene whose culling could be frozen");
        }
        self.inspector.settings.culled_from = match self.inspector.settings.culled_from {
            Some(_) => None,
            None => Some(self.view.camera()),
        };
    }

    /// Moves the pivot to the point at a pixel; `depth` is its view z in world units, `None` where nothing is drawn.
    pub fn focus(&mut self, pixel: [u32; 2], depth: Option<f32>) {
        let Some(depth) = depth else { return self.messages.note("there is nothing at this pixel") };
        let point = self.point_at(pixel, depth.into());
        self.view.navigator.focus(point);
    }

    /// Looks through the lens of a text of [`Lens::parse`], or says why there is none.
    pub fn set_lens(&mut self, text: &str) {
        match Lens::parse(text) {
            Ok(lens) => {
                self.record_undo_step();
                self.view.navigator.set_lens(lens.map(Arc::new));
                self.view.camera_index = None;
                self.pictures.are_stale = true;
            }
            Err(problem) => self.messages.error(format!("the lens {text}: {problem:#}")),
        }
    }

    /// Makes the view flat, or perspective again. A flat view has no lens.
    pub fn toggle_flat(&mut self) {
        if self.view.camera().lens.is_some() {
            self.view.navigator.set_lens(None);
        }
        self.view.toggle_flat();
        self.pictures.are_stale = true;
    }
}
