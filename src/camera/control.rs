//! What hands do to a camera: turning around a point, panning, flying, and gliding to other views.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::path::mixed;
use super::{Camera, MAX_POSITION, MAX_SIDE, NamedCamera, Up};

/// Seconds that a glide takes if there is no reason for another time.
pub const GLIDE_SECONDS: f64 = 0.3;

/// Horizontal fields of view that can be set, in degrees.
pub const FIELDS_OF_VIEW: std::ops::RangeInclusive<f64> = 0.1..=179.0;

/// Radians from straight up or down that turning stops at: nearer, the heading would be lost.
const POLE: f64 = 0.1 * PI / 180.0;

/// What one step of a dolly leaves of the distance.
const DOLLY: f64 = 0.9;

/// How near and far the pivot may be brought, in radii of the scene.
const NEAREST: f64 = 1e-6;
const FARTHEST: f64 = 1e6;

/// A camera that is moved by hand around a pivot: the point that turning leaves where it is.
///
/// Motions of a hand are in pixels of a window of `size_px`, x right and y down. One that is not finite, or would end
/// beyond [`MAX_POSITION`], does nothing.
#[derive(Clone, Debug)]
pub struct Navigator {
    view: View,
    up: Up,
    /// The ball that holds the scene, world units.
    centre: DVec3,
    radius: f64,
    /// World units per second.
    speed: f64,
    glide: Option<Glide>,
}

#[derive(Clone, Debug)]
struct View {
    /// Its size is the one that its intrinsics are for, whatever the window's.
    camera: Camera,
    /// The pivot in view axes, which only dollying and choosing another change.
    pivot_view: DVec3,
}

#[derive(Clone, Debug)]
struct Glide {
    from: View,
    to: View,
    elapsed: f64,
    seconds: f64,
}

impl Navigator {
    /// Sees the whole ball around `centre`, which is the pivot; flies a radius in two seconds.
    pub fn new(centre: DVec3, radius: f64, size_px: [u32; 2]) -> Self {
        let (centre, radius) = sound(centre, radius);
        let camera = Camera::framing(centre, radius, sound_size(size_px));
        let pivot_view = camera.view(centre);
        Self { view: View { camera, pivot_view }, up: Up::default(), centre, radius, speed: radius / 2.0, glide: None }
    }

    /// Begins anew with this ball, but for which way is up.
    pub fn frame(&mut self, centre: DVec3, radius: f64, size_px: [u32; 2]) {
        *self = Self { up: self.up, ..Self::new(centre, radius, size_px) };
        self.snap(&self.home(size_px));
    }

    /// The camera that sees the whole scene.
    pub fn home(&self, size_px: [u32; 2]) -> Camera {
        let camera = Camera::framing(self.centre, self.radius, sound_size(size_px));
        if self.up == Up::default() {
            return camera;
        }
        let turn = DQuat::from_rotation_arc(Up::default().vector(), self.up.vector());
        let position = self.centre + turn * (camera.position - self.centre);
        Camera { position, rotation: camera.rotation * DMat3::from_quat(turn).transpose(), ..camera }
    }

    /// The camera for a window. After [`Navigator::snap`] exactly that camera, [resized](Camera::resized).
    pub fn camera(&self, size_px: [u32; 2]) -> Camera {
        self.view.camera.resized(sound_size(size_px))
    }

    /// World units.
    pub fn pivot(&self) -> DVec3 {
        self.view.pivot()
    }

    /// Chooses the point to turn around without moving. A point at the camera is no pivot.
    pub fn set_pivot(&mut self, point: DVec3) {
        let pivot_view = self.view.camera.view(point);
        if pivot_view.length() >= self.radius * NEAREST {
            self.go(View { pivot_view, ..self.view.clone() });
        }
    }

    pub fn up(&self) -> Up {
        self.up
    }

    /// Turns the view upright for this axis, around the pivot.
    pub fn set_up(&mut self, up: Up) {
        if up == self.up.flipped() {
            self.flip_up();
        } else if up != self.up {
            self.up = up;
            let (heading, elevation) = self.heading(self.view.camera.forward());
            self.go(self.view.around_pivot(self.facing(heading, elevation, 0.0)));
        }
    }

    /// Turns the world upside down; twice is nothing at all. The picture turns by half around its middle.
    pub fn flip_up(&mut self) {
        self.up = self.up.flipped();
        self.glide = None;
        let View { camera, pivot_view } = &mut self.view;
        let half_turn = DVec3::new(-1.0, -1.0, 1.0);
        camera.rotation = DMat3::from_diagonal(half_turn) * camera.rotation;
        *pivot_view *= half_turn;
    }

    /// World units per second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Over 0; anything else changes nothing.
    pub fn set_speed(&mut self, speed: f64) {
        if speed > 0.0 && speed <= MAX_POSITION {
            self.speed = speed;
        }
    }

    /// Horizontal, in degrees.
    pub fn field_of_view(&self) -> f64 {
        let Camera { focal_px, size_px, .. } = &self.view.camera;
        2.0 * (f64::from(size_px[0]) / 2.0 / focal_px.x).atan().to_degrees()
    }

    /// Horizontal, in degrees, clamped to [`FIELDS_OF_VIEW`]. Principal point and shape of the pixels stay.
    pub fn set_field_of_view(&mut self, degrees: f64) {
        let half = degrees.clamp(*FIELDS_OF_VIEW.start(), *FIELDS_OF_VIEW.end()).to_radians() / 2.0;
        let mut view = self.view.clone();
        let focal = f64::from(view.camera.size_px[0]) / 2.0 / half.tan();
        view.camera.focal_px *= focal / view.camera.focal_px.x;
        self.go(view);
    }

    /// Turns the scene with the hand around the pivot, which stays where it is in the picture: half around for a drag across
    /// the shorter side. Up stays up, and straight up and down are never passed; a camera that is tilted loses as much of
    /// that as it is turned.
    pub fn orbit(&mut self, delta_px: DVec2, size_px: [u32; 2]) {
        let [width, height] = sound_size(size_px);
        self.turn(delta_px * PI / f64::from(width.min(height)), View::around_pivot);
    }

    /// Turns the camera in place to where the hand goes, by as many pixels of the middle of the picture. The pivot turns
    /// along.
    pub fn look(&mut self, delta_px: DVec2, size_px: [u32; 2]) {
        let focal_px = self.camera(size_px).focal_px;
        let in_place = |view: &View, rotation| View { camera: Camera { rotation, ..view.camera.clone() }, ..*view };
        self.turn(delta_px / focal_px, in_place);
    }

    /// Moves sideways, with the pivot, so that what is as deep as the pivot follows the hand exactly.
    pub fn pan(&mut self, delta_px: DVec2, size_px: [u32; 2]) {
        let View { camera, pivot_view } = &self.view;
        let depth = if pivot_view.z > 0.0 { pivot_view.z } else { pivot_view.length() };
        let step_view = (delta_px * depth / self.camera(size_px).focal_px).extend(0.0);
        self.shift(-(camera.rotation.transpose() * step_view));
    }

    /// Nears the pivot, or leaves it if `steps` is negative: by a tenth of the distance a step, so never through it.
    pub fn dolly(&mut self, steps: f64) {
        let View { camera, pivot_view } = &self.view;
        let distance = pivot_view.length();
        let (low, high) = ((self.radius * NEAREST).min(distance), (self.radius * FARTHEST).max(distance));
        let wanted = distance * DOLLY.powf(steps);
        if steps != 0.0 && !wanted.is_nan() {
            let pivot_view = *pivot_view * (wanted.clamp(low, high) / distance);
            let position = self.pivot() - camera.rotation.transpose() * pivot_view;
            self.go(View { camera: Camera { position, ..camera.clone() }, pivot_view });
        }
    }

    /// Moves along `direction`, which is in view axes (right, down, forward) and at most of length one, at `pace` times
    /// the speed, for `seconds`. The pivot comes along.
    pub fn fly(&mut self, direction: DVec3, seconds: f64, pace: f64) {
        let step = self.view.camera.rotation.transpose() * direction.clamp_length_max(1.0);
        self.shift(step * self.speed * pace * seconds);
    }

    /// Glides to a view of this point from here, and makes it the pivot.
    pub fn focus(&mut self, point: DVec3) {
        let camera = &self.view.camera;
        let Some(forward) = (point - camera.position).try_normalize() else { return };
        let (heading, elevation) = self.heading(forward);
        let camera = Camera { rotation: self.facing(heading, elevation, 0.0), ..camera.clone() };
        let pivot_view = camera.view(point);
        if pivot_view.length() >= self.radius * NEAREST {
            self.glide_towards(View { camera, pivot_view }, GLIDE_SECONDS);
        }
    }

    /// Takes a file's camera as it is. The pivot lies ahead, as deep as the middle of the scene.
    pub fn snap(&mut self, camera: &Camera) {
        self.go(self.seen_from(camera));
    }

    /// The same in a smooth motion, which [`Navigator::advance`] makes.
    pub fn glide_to(&mut self, camera: &Camera, seconds: f64) {
        self.glide_towards(self.seen_from(camera), seconds);
    }

    /// Lets time pass; whether there is still motion. Any other motion ends a glide where it is.
    pub fn advance(&mut self, seconds: f64) -> bool {
        let Some(mut glide) = self.glide.take() else { return false };
        glide.elapsed += seconds.max(0.0);
        let t = glide.elapsed / glide.seconds;
        if t < 1.0 {
            self.view = glide.view(t);
            self.glide = Some(glide);
        } else {
            self.view = glide.to;
        }
        t < 1.0
    }

    /// Whether a glide is on its way.
    pub fn is_gliding(&self) -> bool {
        self.glide.is_some()
    }

    /// The camera whose view is most like this one: a step as long as the pivot is away counts as much as a turn by 60
    /// degrees.
    pub fn nearest(&self, cameras: &[NamedCamera]) -> Option<usize> {
        let here = &self.view.camera;
        let distance = self.view.pivot_view.length();
        let unlike = |there: &Camera| {
            let step = (there.position - here.position) / distance;
            step.length_squared() + (there.forward() - here.forward()).length_squared()
        };
        let all = cameras.iter().map(|named| unlike(&named.camera)).enumerate();
        all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
    }

    fn seen_from(&self, camera: &Camera) -> View {
        let depth = camera.view(self.centre).z;
        let depth = if depth > 0.01 * self.radius { depth } else { self.radius };
        View { camera: camera.clone(), pivot_view: DVec3::Z * depth }
    }

    fn glide_towards(&mut self, to: View, seconds: f64) {
        if to.is_sound() {
            self.glide = Some(Glide { from: self.view.clone(), to, elapsed: 0.0, seconds: seconds.max(0.0) });
        }
    }

    /// Every motion by hand ends here.
    fn go(&mut self, view: View) {
        if view.is_sound() {
            self.view = view;
            self.glide = None;
        }
    }

    fn shift(&mut self, step_world: DVec3) {
        if step_world != DVec3::ZERO {
            let camera = &self.view.camera;
            let camera = Camera { position: camera.position + step_world, ..camera.clone() };
            self.go(View { camera, ..self.view });
        }
    }

    /// Turns to the right and down by these angles; `moved` makes the view with the new rotation.
    fn turn(&mut self, right_down: DVec2, moved: impl Fn(&View, DMat3) -> View) {
        if right_down == DVec2::ZERO {
            return;
        }
        let camera = &self.view.camera;
        let (heading, elevation) = self.heading(camera.forward());
        let level = self.facing(heading, elevation, 0.0);
        let roll = camera.right().dot(level.row(1)).atan2(camera.right().dot(level.row(0)));
        let roll = roll.signum() * (roll.abs() - right_down.length()).max(0.0);
        let heading = DQuat::from_axis_angle(self.up.vector(), -right_down.x) * heading;
        self.go(moved(&self.view, self.facing(heading, elevation - right_down.y, roll)));
    }

    /// Where a direction points on the ground, unit length, and its angle above it.
    fn heading(&self, forward: DVec3) -> (DVec3, f64) {
        let up = self.up.vector();
        let height = forward.dot(up);
        let flat = forward - up * height;
        // Looking straight down, ahead is the top of the picture; straight up, its bottom.
        let ahead = self.view.camera.down() * height.signum();
        let any = up.any_orthonormal_vector();
        let heading = if flat.length() > 1e-9 { flat } else { ahead - up * ahead.dot(up) };
        (heading.normalize_or(any), height.atan2(flat.length()))
    }

    /// World to view. `roll` turns the picture's axes from right to down.
    fn facing(&self, heading: DVec3, elevation: f64, roll: f64) -> DMat3 {
        let up = self.up.vector();
        let limit = PI / 2.0 - POLE;
        let (sin, cos) = elevation.clamp(-limit, limit).sin_cos();
        let forward = (heading * cos + up * sin).normalize();
        let level = forward.cross(up).normalize();
        let below = forward.cross(level);
        let right = level * roll.cos() + below * roll.sin();
        DMat3::from_cols(right, forward.cross(right), forward).transpose()
    }
}

impl View {
    fn pivot(&self) -> DVec3 {
        self.camera.position + self.camera.rotation.transpose() * self.pivot_view
    }

    fn around_pivot(&self, rotation: DMat3) -> Self {
        let position = self.pivot() - rotation.transpose() * self.pivot_view;
        Self { camera: Camera { position, rotation, ..self.camera.clone() }, ..*self }
    }

    fn is_sound(&self) -> bool {
        let Camera { position, rotation, focal_px, centre_px, .. } = &self.camera;
        let is_finite = rotation.is_finite() && focal_px.is_finite() && centre_px.is_finite();
        is_finite && is_near(*position) && is_near(self.pivot())
    }
}

impl Glide {
    /// At `t` from 0 to 1: slow at both ends.
    fn view(&self, t: f64) -> View {
        let eased = t * t * (3.0 - 2.0 * t);
        let from = self.from.camera.resized(self.to.camera.size_px);
        View {
            camera: mixed(&from, &self.to.camera, eased),
            pivot_view: self.from.pivot_view.lerp(self.to.pivot_view, eased),
        }
    }
}

fn is_near(position: DVec3) -> bool {
    position.is_finite() && position.abs().max_element() <= MAX_POSITION
}

/// A ball that can be looked at.
fn sound(centre: DVec3, radius: f64) -> (DVec3, f64) {
    let is_sound = is_near(centre) && radius > 0.0;
    if is_sound { (centre, radius.clamp(1e-20, 1e20)) } else { (DVec3::ZERO, 1.0) }
}

/// A window may be of no size.
fn sound_size(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.clamp(1, MAX_SIDE))
}
