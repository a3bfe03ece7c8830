//! The lenses that a user chooses: for all cameras of a file, or for one view; and its field of view.

use std::f64::consts::PI;
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::{DVec2, DVec3};

use super::{Camera, CameraFile, Lens};

/// The lenses of the cameras of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum LensChoice {
    /// Those of the file.
    #[default]
    Own,
    /// This lens for all; none for pinholes.
    All(Option<Arc<Lens>>),
    /// None: pinholes of the same poses.
    Undistorted,
}

impl LensChoice {
    /// The cameras of a file with these lenses, and notices of what follows from them.
    ///
    /// # Errors
    /// If a camera has no pinhole that is wanted: [`Camera::undistorted`].
    pub fn applied(&self, mut read: CameraFile) -> Result<CameraFile> {
        if *self == Self::Undistorted {
            return read.into_pinholes();
        }
        read.cameras.iter_mut().for_each(|named| self.apply(&mut named.camera));
        let notices = read.lens_notices();
        read.notices.splice(0..0, notices);
        Ok(read)
    }

    /// Gives a camera the lens for all, if there is one.
    pub fn apply(&self, camera: &mut Camera) {
        if let Self::All(lens) = self {
            *camera = camera.with_lens(lens.clone());
        }
    }
}

impl Lens {
    /// The lens of a text like `FISHEYE` or `FOV:0.9`: the name of a model, in any case, and its numbers. `None` for a
    /// pinhole.
    ///
    /// # Errors
    /// One sentence if the text is none, or those of [`Lens::named`].
    pub fn parse(text: &str) -> Result<Option<Self>> {
        let (model, parameters) = text.split_once(':').unwrap_or((text, ""));
        let number = |text: &str| text.trim().parse::<f64>().with_context(|| format!("{text:?} is not a number"));
        let numbers =
            parameters.split(',').filter(|_| !parameters.is_empty()).map(number).collect::<Result<Vec<_>>>()?;
        Self::named(&model.trim().to_uppercase(), &numbers)
    }

    /// The text of which [`Lens::parse`] makes the same lens.
    pub fn text(&self) -> String {
        let numbers: Vec<String> = self.parameters().iter().map(f64::to_string).collect();
        let colon = if numbers.is_empty() { "" } else { ":" };
        format!("{}{colon}{}", self.model(), numbers.join(","))
    }
}

impl Camera {
    /// The same view through another lens, with the same focal lengths. A sphere fills the picture.
    pub fn with_lens(&self, lens: Option<Arc<Lens>>) -> Self {
        let through = Self { lens, ..self.clone() };
        let [focal_px, centre_px] = match (self.is_sphere(), through.is_sphere()) {
            (_, true) => Lens::sphere_px(DVec2::from(self.size_px.map(f64::from))),
            (true, false) => [DVec2::splat(self.focal_px.x), self.centre_px],
            (false, false) => return through,
        };
        Self { focal_px, centre_px, ..through }
    }

    /// The same view with this horizontal field of view, in degrees, as if its principal point were in the middle. A
    /// parallel lens sees what the pinhole sees at `distance`; a sphere always sees everything. `None` if the lens sees
    /// less.
    pub fn seeing(&self, degrees: f64, distance: f64) -> Option<Self> {
        let half_width = f64::from(self.size_px[0]) / 2.0;
        let half = degrees.to_radians() / 2.0;
        let focal = match &self.lens {
            None => half_width / half.tan(),
            Some(lens) if lens.is_sphere() => return Some(self.clone()),
            Some(lens) if lens.is_parallel() => half_width / half.tan() / distance,
            Some(lens) => half_width / lens.plane(DVec3::new(half.sin(), 0.0, half.cos()))?.x,
        };
        let focal_px = DVec2::new(focal, focal * (self.focal_px.y / self.focal_px.x));
        Some(Self { focal_px, ..self.clone() })
    }

    /// The horizontal field of view, in degrees, with which [`seeing`](Self::seeing) makes this view.
    pub fn field_of_view(&self, distance: f64) -> f64 {
        let edge = f64::from(self.size_px[0]) / 2.0 / self.focal_px.x;
        let half = match &self.lens {
            None => edge.atan(),
            Some(lens) if lens.is_sphere() => PI,
            Some(lens) if lens.is_parallel() => (edge / distance).atan(),
            Some(lens) => {
                let reaches = |angle: f64| {
                    lens.plane(DVec3::new(angle.sin(), 0.0, angle.cos())).is_none_or(|plane| plane.x >= edge)
                };
                let (mut low, mut high) = (0.0, lens.field());
                // Bisection to the last bit.
                for _ in 0..64 {
                    let middle = (low + high) / 2.0;
                    *(if reaches(middle) { &mut high } else { &mut low }) = middle;
                }
                low
            }
        };
        2.0 * half.to_degrees()
    }

    /// The length across a ray that a pixel covers in the middle of the picture, in world units: at this
    /// [depth](Self::depth).
    pub fn pixel_world(&self, depth: f64) -> f64 {
        if self.is_parallel() { 1.0 / self.focal_px.x } else { depth / self.focal_px.x }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_lenses_are_read_back() {
        for text in ["FISHEYE", "OPENCV:-0.1,0.01,0,0.002", "EQUIRECTANGULAR", "ORTHOGRAPHIC", "FOV:0.9"] {
            assert_eq!(Lens::parse(text).unwrap().unwrap().text(), text);
        }
        assert_eq!(Lens::parse(" pinhole").unwrap(), None);
        assert!(Lens::parse("FOV:wide").is_err() && Lens::parse("PAINT").is_err());
    }

    #[test]
    fn fields_of_view_are_those_that_were_set() {
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [640, 480], 1.0);
        for (text, degrees) in [
            ("PINHOLE", 75.0),
            ("FISHEYE", 220.0),
            ("OPENCV:-0.02,0.001,0.003,-0.002", 60.0),
            ("ORTHOGRAPHIC", 40.0),
            ("EQUIRECTANGULAR", 360.0),
        ] {
            let through = camera.with_lens(Lens::parse(text).unwrap().map(Arc::new));
            let seen = through.seeing(degrees, 3.0).unwrap();
            assert!((seen.field_of_view(3.0) - degrees).abs() < 1e-9, "{text}: {}", seen.field_of_view(3.0));
            let again = through.seeing(seen.field_of_view(3.0), 3.0).unwrap();
            assert!((again.focal_px / seen.focal_px - 1.0).abs().max_element() < 1e-12, "{text}");
        }
        let narrow = camera.with_lens(Lens::parse("OPENCV:-0.2,0,0,0").unwrap().map(Arc::new));
        assert!(narrow.seeing(150.0, 3.0).is_none() && narrow.seeing(80.0, 3.0).is_some());
    }

    #[test]
    fn a_panorama_becomes_a_view_with_square_pixels() {
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [640, 480], 1.0);
        let panorama = camera.with_lens(Lens::parse("EQUIRECTANGULAR").unwrap().map(Arc::new));
        assert_eq!(panorama.focal_px, DVec2::new(320.0, 480.0) / PI);
        assert_eq!(panorama.with_lens(None).focal_px, DVec2::splat(320.0 / PI));
    }
}
