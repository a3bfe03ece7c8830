//! Where the view goes: to what is open, to cameras of the file, to a view that was copied.

use std::sync::Arc;

use glam::DVec3;

use super::events::Event;
use super::state::Viewer;
use crate::scene::{Focus, Gaussians};

impl Viewer {
    /// Makes the first view once there is something to see: the file's first camera, or the whole scene.
    pub fn set_first_view(&mut self, gaussians: &Gaussians) {
        let focus = Focus::of(gaussians);
        let (centre, radius) = (DVec3::from(focus.centre), focus.radius);
        self.navigator.frame(centre, radius, self.size);
        self.looks.set_extent(radius);
        if self.cameras.is_empty() && !self.setup.near_by_hand {
            // As `render` does: closer for a small scene.
            let distance = self.view().position.distance(self.navigator.pivot());
            let nearest = distance as f32 / 100.0;
            self.options.rules.near = self.setup.options.rules.near.min(nearest);
        }
        self.go_to_camera(0, true);
        self.has_view = true;
        self.first_view = Some(self.view());
        self.is_stale = true;
    }

    /// Goes to a camera of the file, at once or in a glide.
    pub fn go_to_camera(&mut self, index: usize, at_once: bool) {
        let Some(named) = self.cameras.get(index) else { return };
        let (camera, name) = (named.camera.clone(), named.name.clone());
        if at_once {
            self.navigator.snap(&camera);
        } else {
            self.navigator.glide_to(&camera, crate::camera::GLIDE_SECONDS);
        }
        self.camera = Some(index);
        self.events.tell(&Event::Camera { index, name });
        self.is_stale = true;
    }

    /// The next camera of the file, or the one before.
    pub fn step_camera(&mut self, forward: bool) {
        let count = self.cameras.len();
        if count == 0 {
            return self.messages.note("there is no camera file: drop one on the window, such as a cameras.json");
        }
        let next = match (self.camera, forward) {
            (None, _) => 0,
            (Some(index), true) => (index + 1) % count,
            (Some(index), false) => (index + count - 1) % count,
        };
        self.go_to_camera(next, false);
    }

    pub fn go_to_nearest_camera(&mut self) {
        match self.navigator.nearest(&self.cameras) {
            Some(index) => self.go_to_camera(index, false),
            None => self.messages.note("there is no camera file: drop one on the window, such as a cameras.json"),
        }
    }

    pub fn reset_view(&mut self) {
        let joined: Option<Arc<Gaussians>> = self.layers.iter().find_map(|layer| layer.gaussians.clone());
        if let Some(gaussians) = joined {
            self.set_first_view(&gaussians);
        }
    }

    pub fn paste_view(&mut self, text: &str) {
        match crate::camera::from_json(text) {
            Ok(camera) => {
                self.navigator.snap(&camera);
                self.camera = None;
                self.is_stale = true;
            }
            Err(problem) => self.messages.note(format!("what was pasted is no view: {problem:#}")),
        }
    }
}
