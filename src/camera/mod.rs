//! Cameras: pose and intrinsics of a pinhole camera, camera files, scripted paths, and navigation by mouse and keys.
//!
//! - `read` - finds camera files beside a scene and reads them
//! - `file` - the content of a camera file, and the check that a camera can be drawn with
//! - `cameras_json` - `cameras.json` of the original 3DGS
//! - `transforms_json` - `transforms.json` of nerfstudio, instant-ngp and the Blender data sets
//! - `dataparser` - `dataparser_transforms.json` of nerfstudio: from its `transforms.json` to the scene
//! - `colmap` - sparse models of COLMAP
//! - `lens` - lenses other than pinholes: where they see a direction, and the way back
//! - `lens_choice` - the lenses that a user chooses, and fields of view
//! - `footprint` - the directions that a pixel of a lens covers
//! - `distortion` - notices of lenses that are drawn as pinholes
//! - `path` - scripted paths: orbit, turn on the spot, keyframes
//! - `timeline` - a path of timed keys, and the smooth motion through them
//! - `path_file` - the file of such a path
//! - `nerfstudio_path` - `camera_path.json` of nerfstudio's viewer
//! - `control` - navigation by mouse and keys
//! - `up` - the up axis of a world

mod cameras_json;
mod colmap;
pub mod control;
mod dataparser;
mod distortion;
mod file;
mod footprint;
mod lens;
mod lens_choice;
mod nerfstudio_path;
pub mod path;
mod path_file;
mod read;
mod timeline;
mod transforms_json;
mod up;

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

pub use cameras_json::{from_json, to_json, write};
pub use control::{FIELDS_OF_VIEW, GLIDE_SECONDS, Navigator};
pub use file::{CameraFile, NamedCamera, Split};
pub use footprint::Footprints;
pub use lens::{FTheta, InPixels, Lens};
pub use lens_choice::LensChoice;
pub use read::{find, read, read_at};
pub use timeline::{Key, Timeline};
pub use up::Up;

/// Most pixels along a side of an image.
pub const MAX_SIDE: u32 = 65536;

/// Largest coordinate of a position in world units. Beyond it, no scene can be drawn in 32-bit floats.
pub const MAX_POSITION: f64 = 1e30;

/// A camera: a pinhole, or one with a lens. View axes are COLMAP's: x right, y down, z forward. A pixel is sampled at
/// its centre: pixel (i, j) at (i + 0.5, j + 0.5).
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// World units.
    pub position: DVec3,
    /// World to view: the rows are right, down and forward in world axes.
    pub rotation: DMat3,
    /// Focal lengths in pixels; of a sphere in pixels per radian, of a parallel lens in pixels per world unit.
    pub focal_px: DVec2,
    /// Principal point in pixels from the top left corner.
    pub centre_px: DVec2,
    /// Width and height.
    pub size_px: [u32; 2],
    /// The lens; none for a pinhole.
    pub lens: Option<Arc<Lens>>,
}

impl Camera {
    /// The same view in an image of another shape. The horizontal field of view stays, pixels become square, and the
    /// direction seen by the middle of the image stays: a principal point off the middle keeps its angle to it, a
    /// central one stays central. At its own size a camera is unchanged, and a sphere keeps all directions.
    pub fn resized(&self, size_px: [u32; 2]) -> Self {
        if size_px == self.size_px {
            return self.clone();
        }
        if self.is_sphere() {
            return self.sampled(size_px);
        }
        let focal = self.focal_px.x * f64::from(size_px[0]) / f64::from(self.size_px[0]);
        let aside = (self.centre_px - centre(self.size_px)) / self.focal_px;
        Self { focal_px: DVec2::splat(focal), centre_px: centre(size_px) + aside * focal, size_px, ..self.clone() }
    }

    /// Where a point of the world is seen, in pixels, and its [depth](Self::depth). `None` if it is behind a pinhole or
    /// outside the domain of the lens.
    pub fn projected(&self, world: DVec3) -> Option<(DVec2, f64)> {
        let seen = self.view(world);
        let plane = match &self.lens {
            None => (seen.z > 0.0).then(|| seen.truncate() / seen.z),
            Some(lens) => lens.plane(seen),
        };
        Some((plane? * self.focal_px + self.centre_px, self.depth(seen)))
    }

    /// True if the rays are parallel.
    pub fn is_parallel(&self) -> bool {
        self.lens.as_ref().is_some_and(|lens| lens.is_parallel())
    }

    /// True if the lens sees all directions.
    pub fn is_sphere(&self) -> bool {
        self.lens.as_ref().is_some_and(|lens| lens.is_sphere())
    }

    /// The depth of a point in view axes, in world units: z of a pinhole and of a parallel lens, the distance from the
    /// camera for other lenses, which also see what has no z ahead.
    pub fn depth(&self, view: DVec3) -> f64 {
        if self.lens.is_none() || self.is_parallel() { view.z } else { view.length() }
    }

    /// The ray of a place in pixels, in view axes: a direction of length 1, or of depth 1 for a pinhole. The rays of a
    /// parallel lens differ in their origins: (x, y, 1) is the ray along z through (x, y). `None` if nothing is seen
    /// there.
    pub fn ray(&self, place_px: DVec2) -> Option<DVec3> {
        let plane = (place_px - self.centre_px) / self.focal_px;
        match &self.lens {
            Some(lens) if !lens.is_parallel() => lens.direction(plane),
            _ => Some(plane.extend(1.0)),
        }
    }

    /// Whether each pixel has a ray, row-major; `None` if all have one.
    pub fn seen(&self) -> Option<Vec<bool>> {
        self.lens.as_ref()?;
        let [width, height] = self.size_px.map(u64::from);
        let place = |i: u64| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let seen: Vec<bool> = (0..width * height).into_par_iter().map(|i| self.ray(place(i)).is_some()).collect();
        seen.contains(&false).then_some(seen)
    }

    /// The same view with a lens, so that it is drawn along rays: that of a pinhole does not distort.
    pub fn along_rays(&self) -> Self {
        let lens = self.lens.clone().unwrap_or_else(|| Arc::new(Lens::straight()));
        Self { lens: Some(lens), ..self.clone() }
    }

    /// True if a point of the world is seen inside the image.
    pub fn sees(&self, world: DVec3) -> bool {
        let size = DVec2::from(self.size_px.map(f64::from));
        self.projected(world).is_some_and(|(at, _)| at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all())
    }

    /// The point in world units that is seen at a place in pixels, at this [depth](Self::depth): NaN where a lens sees
    /// nothing.
    pub fn unprojected(&self, place_px: DVec2, depth: f64) -> DVec3 {
        let ray = self.ray(place_px).unwrap_or(DVec3::NAN);
        let point_view = if self.is_parallel() { ray.truncate().extend(depth) } else { ray * depth };
        self.position + self.rotation.transpose() * point_view
    }

    /// The same view with another number of pixels: the borders of the image see what they saw.
    pub fn sampled(&self, size_px: [u32; 2]) -> Self {
        let ratio = DVec2::from(size_px.map(f64::from)) / DVec2::from(self.size_px.map(f64::from));
        Self { focal_px: self.focal_px * ratio, centre_px: self.centre_px * ratio, size_px, ..self.clone() }
    }

    /// A camera at `position` that looks at `target`, with the up direction of the world (-y) up in the image.
    /// `horizontal_fov` is in radians.
    pub fn looking_at(position: DVec3, target: DVec3, size_px: [u32; 2], horizontal_fov: f64) -> Self {
        Self::looking_upright([position, target], DVec3::NEG_Y, size_px, horizontal_fov)
    }

    /// As [`Camera::looking_at`], with the direction `up`, which is not zero, up in the image.
    pub fn looking_upright([position, target]: [DVec3; 2], up: DVec3, size_px: [u32; 2], horizontal_fov: f64) -> Self {
        let forward = (target - position).normalize_or(DVec3::Z);
        let up = up.normalize_or(DVec3::NEG_Y);
        // For a view along `up`, any direction across it is valid.
        let across = [DVec3::X, DVec3::Z].map(|axis| axis.reject_from_normalized(up).try_normalize());
        let across = across.into_iter().flatten().next().unwrap_or(DVec3::X);
        let right = forward.cross(up).try_normalize().unwrap_or(across);
        let down = forward.cross(right);
        let focal = f64::from(size_px[0]) / 2.0 / (horizontal_fov / 2.0).tan();
        Self {
            position,
            rotation: DMat3::from_cols(right, down, forward).transpose(),
            focal_px: DVec2::splat(focal),
            centre_px: centre(size_px),
            size_px,
            lens: None,
        }
    }

    /// A view, slightly from above, that contains the sphere of `radius` around `centre`.
    pub fn framing(centre: DVec3, radius: f64, size_px: [u32; 2]) -> Self {
        let fov = 50f64.to_radians();
        let [width, height] = size_px.map(f64::from);
        let narrower = 2.0 * ((fov / 2.0).tan() * (height / width).min(1.0)).atan();
        let distance = radius / (narrower / 2.0).sin();
        let direction = DVec3::new(0.5, -0.45, -1.0).normalize();
        Self::looking_at(centre + direction * distance, centre, size_px, fov)
    }

    /// The largest near plane that cuts nothing off a small scene around `centre`, in world units.
    pub fn framed_near(&self, centre: DVec3) -> f32 {
        self.position.distance(centre) as f32 / 100.0
    }

    /// Direction of the x axis of the image in world axes, unit length.
    pub fn right(&self) -> DVec3 {
        self.rotation.row(0)
    }

    /// Direction of the y axis of the image in world axes, unit length.
    pub fn down(&self) -> DVec3 {
        self.rotation.row(1)
    }

    /// Viewing direction in world axes, unit length.
    pub fn forward(&self) -> DVec3 {
        self.rotation.row(2)
    }

    /// A world point in view axes: right, down, forward from the camera.
    pub fn view(&self, world: DVec3) -> DVec3 {
        self.rotation * (world - self.position)
    }
}

fn centre(size_px: [u32; 2]) -> DVec2 {
    DVec2::from(size_px.map(f64::from)) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looking_at_puts_the_target_in_the_middle_and_up_upwards() {
        let camera = Camera::looking_at(DVec3::new(3.0, -2.0, 1.0), DVec3::ZERO, [640, 480], 1.0);
        let target = camera.view(DVec3::ZERO);
        assert!(target.x.abs() < 1e-12 && target.y.abs() < 1e-12 && target.z > 0.0);
        let above = camera.view(DVec3::new(0.0, -1.0, 0.0));
        assert!(above.y < 0.0, "up is -y in the world and in the image");
        assert!((camera.rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn points_in_the_image_are_seen() {
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [200, 100], 1.0);
        let at = |x: f64, y: f64| camera.unprojected(DVec2::new(x, y), 3.0);
        assert!(camera.sees(at(0.5, 0.5)) && camera.sees(at(199.5, 99.5)));
        assert!(!camera.sees(at(-0.5, 50.0)) && !camera.sees(at(200.5, 50.0)) && !camera.sees(at(100.0, 100.5)));
        assert!(!camera.sees(DVec3::NEG_Z), "it lies behind the camera");
    }

    #[test]
    fn looking_straight_down_is_a_rotation() {
        let camera = Camera::looking_at(DVec3::new(0.0, -5.0, 0.0), DVec3::ZERO, [64, 64], 1.0);
        assert!((camera.rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn resized_keeps_the_horizontal_field_of_view() {
        let camera = Camera {
            focal_px: DVec2::new(1000.0, 1010.0),
            centre_px: DVec2::new(970.0, 530.0),
            ..Camera::looking_at(DVec3::ZERO, DVec3::Z, [1920, 1080], 1.0)
        };
        assert_eq!(camera.resized([1920, 1080]), camera);
        let small = camera.resized([480, 480]);
        assert_eq!(small.focal_px, DVec2::splat(250.0));
        // The middle of the image sees the same direction as before.
        let middle = |c: &Camera| (centre(c.size_px) - c.centre_px) / c.focal_px;
        assert!(middle(&small).distance(middle(&camera)) < 1e-15, "{}", small.centre_px);
        assert!(small.centre_px.distance(DVec2::new(242.5, 240.0 - 2500.0 / 1010.0)) < 1e-12, "{}", small.centre_px);
    }

    #[test]
    fn resized_at_the_same_aspect_is_the_same_picture_with_other_pixels() {
        let camera = Camera {
            centre_px: DVec2::new(910.0, 700.5),
            ..Camera::looking_at(DVec3::ZERO, DVec3::Z, [1920, 1080], 1.0)
        };
        let (small, sampled) = (camera.resized([480, 270]), camera.sampled([480, 270]));
        assert!(small.centre_px.distance(sampled.centre_px) < 1e-12);
        assert!(small.focal_px.distance(sampled.focal_px) < 1e-12);
    }

    #[test]
    fn resized_keeps_a_principal_point_in_the_middle_to_the_last_bit() {
        let camera = Camera {
            focal_px: DVec2::new(1234.567, 0.1),
            ..Camera::looking_at(DVec3::ZERO, DVec3::Z, [1921, 1079], 1.0)
        };
        for size in [[1, 1], [301, 203], [65536, 7]] {
            assert_eq!(camera.resized(size).centre_px, centre(size));
        }
    }

    #[test]
    fn sampled_sees_the_same_between_the_same_borders() {
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [1920, 1080], 1.0);
        let small = camera.sampled([960, 27]);
        assert_eq!((small.centre_px, small.size_px), (DVec2::new(480.0, 13.5), [960, 27]));
        let point =
            |c: &Camera| (c.focal_px * DVec2::new(0.1, -0.2) + c.centre_px) / DVec2::from(c.size_px.map(f64::from));
        assert!(point(&camera).distance(point(&small)) < 1e-12);
    }

    #[test]
    fn framing_contains_the_sphere_in_a_narrow_image() {
        let camera = Camera::framing(DVec3::ONE, 2.0, [200, 800]);
        for axis in [camera.right(), camera.down()] {
            for sign in [-1.0, 1.0] {
                // A point close to the silhouette of the sphere.
                let p = camera.view(DVec3::ONE + axis * sign * 2.0 * 0.99);
                let px = camera.focal_px * p.truncate() / p.z + camera.centre_px;
                assert!(px.x >= 0.0 && px.x <= 200.0 && px.y >= 0.0 && px.y <= 800.0, "{px}");
            }
        }
    }
}
