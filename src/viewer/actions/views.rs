//! Actions that move the view: to the open scenes, to cameras of the file, to a copied view.

use glam::{DVec2, DVec3};

use crate::camera::NamedCamera;
use crate::scene::Focus;
use crate::viewer::model::{Action, Event, Held, Layer, Request, Viewer, WindowRequest};

const NO_CAMERAS: &str = "there is no camera file: drop one on the window, such as a cameras.json";

impl Viewer {
    /// Goes to the first view of a scene: the first camera of the file, or a view of the whole scene.
    pub fn set_first_view(&mut self, focus: Focus) {
        let (centre, radius) = (DVec3::from(focus.centre), focus.radius);
        self.navigator.frame(centre, radius, self.size);
        self.inspection.set_scene_radius(radius);
        let has_project = self.project.is_some();
        if self.cameras.is_empty() && !self.setup.near_is_explicit && !has_project {
            // `smalto render` also moves the near plane closer for a small scene.
            let distance = self.view().position.distance(self.navigator.pivot());
            let nearest = distance as f32 / 100.0;
            self.nearest = Some(nearest);
            self.options.rules.near = self.setup.options.rules.near.min(nearest);
        }
        if !self.go_to_project() {
            self.go_to_camera(0, true);
        }
        self.has_view = true;
        self.first_view = Some(self.view());
        self.is_stale = true;
    }

    /// Goes to a camera of the file, at once or in a glide. Does nothing if there is no such camera.
    pub fn go_to_camera(&mut self, index: usize, at_once: bool) {
        let Some(named) = self.cameras.get(index) else { return };
        let (camera, name) = (named.camera.clone(), named.name.clone());
        if at_once {
            self.navigator.snap(&camera);
        } else {
            self.navigator.glide_to(&camera, crate::camera::GLIDE_SECONDS);
        }
        if self.camera.replace(index) != Some(index) {
            self.events.emit(&Event::Camera { index, name });
        }
        self.last_camera = index;
        self.is_stale = true;
        self.follow_camera(index);
    }

    /// The camera of the file whose place is seen nearest to a place in the picture, within so many pixels.
    pub fn camera_at(&self, place: DVec2, within: f64) -> Option<usize> {
        let view = self.view();
        let apart = |camera: &NamedCamera| {
            let (at, _) = view.projected(camera.camera.position)?;
            Some(at.distance(place)).filter(|apart| *apart <= within)
        };
        let near = self.cameras.iter().enumerate().filter_map(|(i, camera)| Some((i, apart(camera)?)));
        near.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(i, _)| i)
    }

    /// Goes to the next camera of the file, or to the previous one.
    pub fn step_camera(&mut self, forward: bool) {
        let count = self.cameras.len();
        if count == 0 {
            return self.messages.note(NO_CAMERAS);
        }
        // After the view has left a camera, the next one is still that after it.
        let last = self.last_camera.min(count - 1);
        let next = if forward { (last + 1) % count } else { (last + count - 1) % count };
        self.go_to_camera(next, false);
    }

    pub fn go_to_nearest_camera(&mut self) {
        match self.navigator.nearest(&self.cameras) {
            Some(index) => self.go_to_camera(index, false),
            None => self.messages.note(NO_CAMERAS),
        }
    }

    /// Goes back to the first view. The speed of flying and the near plane stay.
    pub fn reset_view(&mut self) {
        let first = || self.layers.iter().find_map(|layer| layer.held.as_ref()).map(Held::focus);
        if let Some(focus) = self.focus_of_all().or_else(first) {
            let (speed, near) = (self.navigator.speed(), self.options.rules.near);
            self.set_first_view(focus);
            self.navigator.set_speed(speed);
            self.options.rules.near = near;
        }
    }

    /// Where most of the shown scenes lies; `None` if none is shown or read.
    fn focus_of_all(&self) -> Option<Focus> {
        let shown = self.layers.iter().filter(|layer| layer.is_shown[0]);
        shown.filter_map(Layer::placed_focus).reduce(Focus::joined)
    }

    /// Glides to a view of all shown scenes.
    pub fn frame_scene(&mut self) {
        let own = || Focus { centre: self.navigator.centre().to_array(), radius: self.navigator.radius() };
        self.glide_around(self.focus_of_all().unwrap_or_else(own));
    }

    /// Glides to a view of one scene.
    pub fn frame_layer(&mut self, number: u64) {
        let layer = self.layers.iter().find(|layer| layer.number == number);
        if let Some(focus) = layer.and_then(Layer::placed_focus) {
            self.glide_around(focus);
        }
    }

    fn glide_around(&mut self, Focus { centre, radius }: Focus) {
        self.navigator.glide_around(DVec3::from(centre), radius, self.size, crate::camera::GLIDE_SECONDS);
        self.camera = None;
    }

    /// Shows all scenes if one that was opened beside others lies out of sight. A view of a camera of the file stays.
    pub fn bring_into_sight(&mut self, place: usize) {
        let layer = &self.layers[place];
        let (Some(own), Some(all)) = (layer.placed_focus(), self.focus_of_all()) else { return };
        if self.camera.is_some() || self.view().sees(DVec3::from(own.centre)) {
            return;
        }
        if !self.has_moved() {
            return self.set_first_view(all);
        }
        let key = self.setup.bindings.text(Action::Undo);
        let text = format!("{} lay out of sight, so the view shows all scenes ({key} goes back)", layer.name);
        self.messages.note(text);
        self.note_changes();
        self.glide_around(all);
    }

    /// Copies the view to the clipboard, as an entry of a cameras.json.
    pub fn copy_view(&mut self) {
        let text = crate::camera::to_json(&self.view());
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
                self.navigator.snap(&camera);
                self.camera = None;
                self.is_stale = true;
            }
            Err(problem) => self.messages.note(format!("the clipboard does not hold a view: {problem:#}")),
        }
    }

    /// Freezes culling at this view, or lets it follow the camera again.
    pub fn toggle_frozen_culling(&mut self) {
        if self.layers.is_empty() {
            return self.messages.note("there is no scene whose culling could be frozen");
        }
        self.inspection.culled_from = match self.inspection.culled_from {
            Some(_) => None,
            None => Some(self.view()),
        };
    }

    /// Moves the pivot to what a pixel shows; `depth` is its view z in world units, `None` where nothing is drawn.
    pub fn focus(&mut self, pixel: [u32; 2], depth: Option<f32>) {
        let Some(depth) = depth else { return self.messages.note("there is nothing at this pixel") };
        let point = self.view().unprojected(DVec2::from(pixel.map(f64::from)) + 0.5, f64::from(depth));
        self.navigator.focus(point);
    }
}
