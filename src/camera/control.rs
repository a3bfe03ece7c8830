//! Navigation: orbiting around a point, panning, flying, and gliding to other views.

use std::f64::consts::PI;
use std::ops::RangeInclusive;
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::path::mixed;
use super::{Camera, Lens, MAX_POSITION, MAX_SIDE, NamedCamera, Up};

/// Default duration of a glide in seconds.
pub const GLIDE_SECONDS: f64 = 0.3;

/// Range of the horizontal field of view of a pinhole in degrees.
pub const FIELDS_OF_VIEW: RangeInclusive<f64> = 0.1..=179.0;

/// Smallest angle in radians between the viewing direction and straight up or down. Closer, the heading would be lost.
const POLE: f64 = 0.1 * PI / 180.0;

/// Factor on the distance to the pivot per dolly step.
const DOLLY: f64 = 0.9;

/// Smallest and largest distance of the pivot that a dolly reaches, in radii of the scene.
const NEAREST: f64 = 1e-6;
const FARTHEST: f64 = 1e6;

/// A camera that the user moves around a pivot, the fixed point of an orbit.
///
/// Pointer motions are in pixels of a window of `size_px`, x right and y down. A motion that is not finite, or would
/// end beyond [`MAX_POSITION`], does nothing.
#[derive(Clone, Debug)]
pub struct Navigator {
    view: View,
    up: Up,
    /// Centre and radius of the sphere around the scene, world units.
    centre: DVec3,
    radius: f64,
    /// World units per second.
    speed: f64,
    glide: Option<Glide>,
}

#[derive(Clone, Debug)]
struct View {
    /// Its size is the one that its intrinsics are for; the window may have another.
    camera: Camera,
    /// The pivot in view axes. It changes when the user dollies or sets another pivot.
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
    /// A view of the whole sphere around `centre`, which becomes the pivot. The speed is a radius in two seconds.
    pub fn new(centre: DVec3, radius: f64, size_px: [u32; 2]) -> Self {
        let (centre, radius) = sound(centre, radius);
        let camera = Camera::framing(centre, radius, sound_size(size_px));
        let pivot_view = camera.view(centre);
        Self { view: View { camera, pivot_view }, up: Up::default(), centre, radius, speed: radius / 2.0, glide: None }
    }

    /// Starts over with a view of this sphere. The up axis stays.
    pub fn frame(&mut self, centre: DVec3, radius: f64, size_px: [u32; 2]) {
        *self = Self { up: self.up, ..Self::new(centre, radius, size_px) };
        self.snap(&self.home(size_px));
    }

    /// The centre of most of the scene, in world units.
    pub fn centre(&self) -> DVec3 {
        self.centre
    }

    /// The radius of most of the scene, in world units.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The camera that shows the whole scene.
    pub fn home(&self, size_px: [u32; 2]) -> Camera {
        self.framing(self.centre, self.radius, size_px)
    }

    /// The camera that shows the whole sphere of `radius` around `centre`, through the lens of the view. A central lens
    /// keeps its field of view.
    fn framing(&self, centre: DVec3, radius: f64, size_px: [u32; 2]) -> Camera {
        let pinhole = self.framing_pinhole(centre, radius, size_px);
        let own = self.camera(size_px);
        let Some(lens) = &own.lens else { return pinhole };
        if lens.is_parallel() {
            let focal_px = pinhole.focal_px / pinhole.position.distance(centre);
            return Camera { focal_px, lens: own.lens, ..pinhole };
        }
        Camera { position: pinhole.position, rotation: pinhole.rotation, ..own }
    }

    fn framing_pinhole(&self, centre: DVec3, radius: f64, size_px: [u32; 2]) -> Camera {
        let camera = Camera::framing(centre, radius, sound_size(size_px));
        if self.up == Up::default() {
            return camera;
        }
        let turn = DQuat::from_rotation_arc(Up::default().vector(), self.up.vector());
        let position = centre + turn * (camera.position - centre);
        Camera { position, rotation: camera.rotation * DMat3::from_quat(turn).transpose(), ..camera }
    }

    /// The camera for a window of this size. After [`Navigator::snap`] it is exactly that camera,
    /// [resized](Camera::resized).
    pub fn camera(&self, size_px: [u32; 2]) -> Camera {
        self.view.camera.resized(sound_size(size_px))
    }

    /// The camera that every window shows, [resized](Camera::resized): windows of other sizes do not change it.
    pub fn own_camera(&self) -> &Camera {
        &self.view.camera
    }

    /// The pivot in world units.
    pub fn pivot(&self) -> DVec3 {
        self.view.pivot()
    }

    /// Sets the pivot (world units) without moving the camera. A point too close to the camera is ignored.
    pub fn set_pivot(&mut self, point: DVec3) {
        let pivot_view = self.view.camera.view(point);
        if pivot_view.length() >= self.radius * NEAREST {
            self.go(View { pivot_view, ..self.view.clone() });
        }
    }

    /// The up axis.
    pub fn up(&self) -> Up {
        self.up
    }

    /// Sets the up axis and turns the view around the pivot until it is upright.
    pub fn set_up(&mut self, up: Up) {
        if up == self.up.flipped() {
            self.flip_up();
        } else if up != self.up {
            self.up = up;
            let (heading, elevation) = self.heading(self.view.camera.forward());
            self.go(self.view.around_pivot(self.facing(heading, elevation, 0.0)));
        }
    }

    /// Reverses the up axis: the picture turns by 180 degrees around its middle. Twice restores every bit.
    pub fn flip_up(&mut self) {
        self.up = self.up.flipped();
        self.glide = None;
        let View { camera, pivot_view } = &mut self.view;
        let half_turn = DVec3::new(-1.0, -1.0, 1.0);
        camera.rotation = DMat3::from_diagonal(half_turn) * camera.rotation;
        *pivot_view *= half_turn;
    }

    /// Flying speed in world units per second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Sets the flying speed. A value that is not positive or over [`MAX_POSITION`] is ignored.
    pub fn set_speed(&mut self, speed: f64) {
        if speed > 0.0 && speed <= MAX_POSITION {
            self.speed = speed;
        }
    }

    /// Horizontal field of view in degrees; of a parallel lens that of the pinhole that sees the same at the distance
    /// of the pivot.
    pub fn field_of_view(&self) -> f64 {
        self.view.camera.field_of_view(self.view.pivot_view.length())
    }

    /// The fields of view that the lens can have, in degrees.
    pub fn fields_of_view(&self) -> RangeInclusive<f64> {
        fields_of_view(&self.view.camera)
    }

    /// Sets the horizontal field of view in degrees, clamped to what the lens can have. The principal point and the
    /// shape of the pixels stay.
    pub fn set_field_of_view(&mut self, degrees: f64) {
        let View { camera, pivot_view } = &self.view;
        let fields = self.fields_of_view();
        let seeing = camera.seeing(degrees.clamp(*fields.start(), *fields.end()), pivot_view.length());
        if let Some(camera) = seeing {
            self.go(View { camera, ..self.view });
        }
    }

    /// Looks through another lens; none is a pinhole. The field of view stays where the lens can have it; after a
    /// panorama it is 90 degrees.
    pub fn set_lens(&mut self, lens: Option<Arc<Lens>>) {
        let View { camera, pivot_view } = &self.view;
        let distance = pivot_view.length();
        let was_sphere = camera.is_sphere();
        let degrees = if was_sphere { 90.0 } else { camera.field_of_view(distance) };
        let camera = camera.with_lens(lens);
        let fields = fields_of_view(&camera);
        let seeing = camera.seeing(degrees.clamp(*fields.start(), *fields.end()), distance);
        self.go(View { camera: seeing.unwrap_or(camera), ..self.view });
    }

    /// Orbits around the pivot, which keeps its place in the picture. A drag across the shorter side of the window
    /// turns by 180 degrees. The view stays upright and never passes straight up or down. A rolled camera loses as much
    /// of its roll as it is turned.
    pub fn orbit(&mut self, delta_px: DVec2, size_px: [u32; 2]) {
        let [width, height] = sound_size(size_px);
        self.turn(delta_px * PI / f64::from(width.min(height)), View::around_pivot);
    }

    /// Turns the camera in place by as many pixels, measured in the middle of the picture. The pivot turns with it.
    pub fn look(&mut self, delta_px: DVec2, size_px: [u32; 2]) {
        let focal_px = self.camera(size_px).focal_px;
        let in_place = |view: &View, rotation| View { camera: Camera { rotation, ..view.camera.clone() }, ..*view };
        let View { camera, pivot_view } = &self.view;
        // A parallel lens turns as the pinhole that sees the same at the pivot.
        let focal_px = if camera.is_parallel() { focal_px * pivot_view.length() } else { focal_px };
        self.turn(delta_px / focal_px, in_place);
    }

    /// Moves camera and pivot sideways, so that points at the depth of the pivot follow the pointer exactly.
    pub fn pan(&mut self, delta_px: DVec2, size_px: [u32; 2]) {
        let View { camera, pivot_view } = &self.view;
        let depth = match pivot_view.z {
            _ if camera.is_parallel() => 1.0,
            z if z > 0.0 => z,
            _ => pivot_view.length(),
        };
        let step_view = (delta_px * depth / self.camera(size_px).focal_px).extend(0.0);
        self.shift(-(camera.rotation.transpose() * step_view));
    }

    /// Moves towards the pivot, or away if `steps` is negative. A step is a tenth of the distance, so the camera never
    /// passes the pivot.
    pub fn dolly(&mut self, steps: f64) {
        let View { camera, pivot_view } = &self.view;
        let distance = pivot_view.length();
        let (low, high) = ((self.radius * NEAREST).min(distance), (self.radius * FARTHEST).max(distance));
        let wanted = distance * DOLLY.powf(steps);
        if steps != 0.0 && !wanted.is_nan() {
            let ratio = wanted.clamp(low, high) / distance;
            let pivot_view = *pivot_view * ratio;
            let position = self.pivot() - camera.rotation.transpose() * pivot_view;
            // Through a parallel lens, nothing grows by coming closer.
            let focal_px = if camera.is_parallel() { camera.focal_px / ratio } else { camera.focal_px };
            self.go(View { camera: Camera { position, focal_px, ..camera.clone() }, pivot_view });
        }
    }

    /// Moves camera and pivot along `direction` for `seconds` at `pace` times the speed. `direction` is in view axes
    /// (right, down, forward); its length is limited to 1.
    pub fn fly(&mut self, direction: DVec3, seconds: f64, pace: f64) {
        let step = self.view.camera.rotation.transpose() * direction.clamp_length_max(1.0);
        self.shift(step * self.speed * pace * seconds);
    }

    /// Starts a glide that turns towards this point (world units), and makes it the pivot.
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

    /// Jumps to exactly this camera. The pivot lies straight ahead at the depth of the middle of the scene.
    pub fn snap(&mut self, camera: &Camera) {
        self.go(self.seen_from(camera));
    }

    /// Starts a glide to this camera. [`Navigator::advance`] moves it along.
    pub fn glide_to(&mut self, camera: &Camera, seconds: f64) {
        self.glide_towards(self.seen_from(camera), seconds);
    }

    /// Starts a glide to a view of the whole sphere of `radius` around `centre`, which becomes the pivot.
    pub fn glide_around(&mut self, centre: DVec3, radius: f64, size_px: [u32; 2], seconds: f64) {
        let (centre, radius) = sound(centre, radius);
        let camera = self.framing(centre, radius, size_px);
        let pivot_view = camera.view(centre);
        self.glide_towards(View { camera, pivot_view }, seconds);
    }

    /// Advances a glide by `seconds`. Returns true while it goes on. Any other motion ends a glide where it is.
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

    /// True while a glide goes on.
    pub fn is_gliding(&self) -> bool {
        self.glide.is_some()
    }

    /// Index of the camera whose view is most similar to this one. A distance as long as that to the pivot counts as
    /// much as a turn by 60 degrees.
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
            // Nothing lies between two lenses.
            let seconds = if to.camera.lens == self.view.camera.lens { seconds.max(0.0) } else { 0.0 };
            self.glide = Some(Glide { from: self.view.clone(), to, elapsed: 0.0, seconds });
        }
    }

    /// Sets the view and ends a glide. Every motion by the user goes through here.
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

    /// Turns to the right and down by these angles in radians; `moved` makes the view with the new rotation.
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

    /// The heading of a direction in the ground plane, unit length, and its elevation above it in radians.
    fn heading(&self, forward: DVec3) -> (DVec3, f64) {
        let up = self.up.vector();
        let height = forward.dot(up);
        let flat = forward - up * height;
        // Looking straight down, the heading is the top of the picture; straight up, its bottom.
        let ahead = self.view.camera.down() * height.signum();
        let any = up.any_orthonormal_vector();
        let heading = if flat.length() > 1e-9 { flat } else { ahead - up * ahead.dot(up) };
        (heading.normalize_or(any), height.atan2(flat.length()))
    }

    /// Rotation from world to view. `roll` turns the axes of the picture from right to down.
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
    /// The view at `t` from 0 to 1, with ease-in and ease-out.
    fn view(&self, t: f64) -> View {
        let eased = t * t * (3.0 - 2.0 * t);
        let from = self.from.camera.resized(self.to.camera.size_px);
        View {
            camera: mixed(&from, &self.to.camera, eased),
            pivot_view: self.from.pivot_view.lerp(self.to.pivot_view, eased),
        }
    }
}

/// The horizontal fields of view that the lens of a camera can have, in degrees.
fn fields_of_view(camera: &Camera) -> RangeInclusive<f64> {
    let low = *FIELDS_OF_VIEW.start();
    match &camera.lens {
        Some(lens) if lens.is_sphere() => 360.0..=360.0,
        // A little less than where the lens ends, which it does not see.
        Some(lens) if !lens.is_parallel() => low..=1.999 * lens.field().to_degrees(),
        _ => FIELDS_OF_VIEW,
    }
}

fn is_near(position: DVec3) -> bool {
    position.is_finite() && position.abs().max_element() <= MAX_POSITION
}

/// This sphere if a camera can look at it, else the unit sphere; the radius is clamped.
fn sound(centre: DVec3, radius: f64) -> (DVec3, f64) {
    let is_sound = is_near(centre) && radius > 0.0;
    if is_sound { (centre, radius.clamp(1e-20, 1e20)) } else { (DVec3::ZERO, 1.0) }
}

/// This size with sides from 1 to [`MAX_SIDE`]: a minimized window has none.
fn sound_size(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.clamp(1, MAX_SIDE))
}
