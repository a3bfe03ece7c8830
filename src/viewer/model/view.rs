//! The view: the navigator, the sizes of window and picture, and the background.

use glam::DVec3;

use crate::camera::{Camera, GLIDE_SECONDS, Navigator};
use crate::rules::Background;

/// Horizontal field of view of a flat view, in degrees. An object one picture width behind another looks smaller by
/// 0.35 %: across a picture of 500 pixels, less than a pixel to each side.
const FLAT_DEGREES: f64 = 0.2;

/// The view of the scenes.
#[derive(Clone)]
pub struct View {
    pub navigator: Navigator,
    /// Index of the camera of the file that the view is at or moves to; `None` after the view has left it.
    pub camera_index: Option<usize>,
    /// Index of the camera of the file that the view was at last.
    pub last_camera_index: usize,
    /// The first view has been set for an open scene.
    pub is_set: bool,
    /// The view that [`View::is_set`] refers to.
    pub first: Option<Camera>,
    /// The largest near plane for the first scene, in world units; set if the scene is small and has no cameras.
    pub near_limit: Option<f32>,
    /// Held keys move the view.
    pub is_flying: bool,
    /// Horizontal field of view before the view was made flat, in degrees.
    perspective_degrees: f64,
    /// Width and height of the window in pixels.
    pub window_size: [u32; 2],
    /// Width and height of the picture in pixels: the part of the window beside the panels.
    pub size: [u32; 2],
    pub background: Background,
}

impl View {
    /// A view of the unit ball in a window of `size` pixels.
    pub fn new(size: [u32; 2], background: Background) -> Self {
        Self {
            navigator: Navigator::new(DVec3::ZERO, 1.0, size),
            camera_index: None,
            last_camera_index: 0,
            is_set: false,
            first: None,
            near_limit: None,
            is_flying: false,
            perspective_degrees: 60.0,
            window_size: size,
            size,
            background,
        }
    }

    /// The camera of the picture.
    pub fn camera(&self) -> Camera {
        self.navigator.camera(self.size)
    }

    /// True if the view has moved since the first view was set.
    pub fn has_moved(&self) -> bool {
        self.first.as_ref().is_some_and(|first| first.resized(self.size) != self.camera())
    }

    /// Sets the sizes of window and picture in pixels, the picture at least a pixel. Returns true if the picture's size
    /// changed.
    pub fn set_sizes(&mut self, window: [u32; 2], picture: [u32; 2]) -> bool {
        let size = [0, 1].map(|side: usize| picture[side].clamp(1, window[side].max(1)));
        let has_changed = self.size != size;
        (self.window_size, self.size) = (window, size);
        has_changed
    }

    /// Goes to a camera that is none of the file, at once.
    pub fn snap(&mut self, camera: &Camera) {
        self.navigator.snap(camera);
        self.camera_index = None;
    }

    /// Glides to a view of a ball.
    pub fn glide_around(&mut self, centre: DVec3, radius: f64) {
        self.navigator.glide_around(centre, radius, self.size, GLIDE_SECONDS);
        self.camera_index = None;
    }

    /// Glides to a view of the pivot from this direction, at the same distance.
    pub fn look_from(&mut self, from: DVec3) {
        let (view, pivot) = (self.camera(), self.navigator.pivot());
        let distance = view.position.distance(pivot);
        let up = self.navigator.up().vector();
        // Straight from above or below, the up direction of the picture changes as little as possible.
        let upright = match from.cross(up).length() > 1e-6 {
            true => up,
            false => {
                let axes = DVec3::AXES.into_iter().filter(|axis| axis.dot(up) == 0.0);
                let signed = axes.flat_map(|axis| [axis, -axis]);
                let seen_up = -view.rotation.row(1);
                signed.max_by(|a, b| a.dot(seen_up).total_cmp(&b.dot(seen_up))).unwrap_or(DVec3::X)
            }
        };
        let position = pivot + from * distance;
        let turned = Camera::looking_upright([position, pivot], upright, view.size_px, 1.0);
        let camera = Camera { position, rotation: turned.rotation, ..view };
        self.navigator.glide_to(&camera, GLIDE_SECONDS);
        self.camera_index = None;
    }

    /// Makes the view flat, or perspective again. The pivot keeps its size in the picture.
    pub fn toggle_flat(&mut self) {
        let degrees = if self.is_flat() { self.perspective_degrees } else { FLAT_DEGREES };
        if !self.is_flat() {
            self.perspective_degrees = self.navigator.field_of_view();
        }
        let (view, pivot) = (self.camera(), self.navigator.pivot());
        let half = |degrees: f64| (degrees.to_radians() / 2.0).tan();
        let factor = half(self.navigator.field_of_view()) / half(degrees);
        let position = pivot + (view.position - pivot) * factor;
        self.snap(&Camera { position, focal_px: view.focal_px * factor, ..view });
        self.navigator.set_pivot(pivot);
    }

    /// True if the rays of the view are nearly parallel.
    pub fn is_flat(&self) -> bool {
        self.navigator.field_of_view() <= FLAT_DEGREES * 1.01
    }
}
