//! Lens distortion: how far the corners of a photograph are from their pinhole positions.

use std::collections::BTreeSet;

use glam::DVec2;

use super::Camera;

/// A lens by the distortion models of OpenCV and COLMAP, as a map of slopes x / z and y / z.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lens {
    model: String,
    bend: Bend,
}

#[derive(Clone, Debug, PartialEq)]
enum Bend {
    /// Slopes are multiplied by `over / under`, polynomials in their squared length whose constant term is 1; two
    /// tangential terms are added.
    Perspective { over: [f64; 4], under: [f64; 3], tangential: [f64; 2] },
    /// The distance from the centre is the angle from the axis times a polynomial in its square whose constant term is
    /// 1.
    Fisheye([f64; 4]),
    /// A distortion that is not computed here.
    Other,
}

const STRAIGHT: Bend = Bend::Perspective { over: [0.0; 4], under: [0.0; 3], tangential: [0.0; 2] };

impl Lens {
    pub fn perspective(model: &str, over: &[f64], under: &[f64], tangential: [f64; 2]) -> Self {
        let bend = Bend::Perspective { over: padded(over), under: padded(under), tangential };
        Self { model: model.to_owned(), bend }
    }

    pub fn fisheye(model: &str, over: &[f64]) -> Self {
        Self { model: model.to_owned(), bend: Bend::Fisheye(padded(over)) }
    }

    pub fn other(model: &str) -> Self {
        Self { model: model.to_owned(), bend: Bend::Other }
    }

    /// The distorted slope of a pinhole slope. `None` for [`Bend::Other`].
    fn bent(&self, slope: DVec2) -> Option<DVec2> {
        let square = slope.length_squared();
        let sum = |k: &[f64], square: f64| k.iter().rev().fold(0.0, |sum, k| (sum + k) * square) + 1.0;
        match &self.bend {
            Bend::Perspective { over, under, tangential: [p1, p2] } => {
                let DVec2 { x, y } = slope;
                let aside = DVec2::new(
                    2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                    2.0 * p2 * x * y + p1 * (square + 2.0 * y * y),
                );
                Some(slope * sum(over, square) / sum(under, square) + aside)
            }
            Bend::Fisheye(over) => {
                let angle = square.sqrt().atan();
                Some(slope.normalize_or_zero() * angle * sum(over, angle * angle))
            }
            Bend::Other => None,
        }
    }
}

/// The first `N` values, filled up with zeros.
fn padded<const N: usize>(values: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0))
}

/// Statistics of the cameras of a file that have distortion.
#[derive(Default)]
pub(super) struct Bent {
    models: BTreeSet<String>,
    cameras: usize,
    /// Largest shift of a corner.
    farthest_px: f64,
    /// Some camera has a distortion that is not computed.
    has_uncomputed: bool,
}

impl Bent {
    pub fn add(&mut self, lens: &Lens, camera: &Camera) {
        if lens.bend == STRAIGHT {
            return;
        }
        self.cameras += 1;
        if !self.models.contains(&lens.model) {
            self.models.insert(lens.model.clone());
        }
        let off_px = corners_off_px(lens, camera);
        self.farthest_px = self.farthest_px.max(off_px.unwrap_or(0.0));
        self.has_uncomputed |= off_px.is_none();
    }

    /// The notice for a file with `of` cameras; `None` if all are pinholes.
    pub fn notice(&self, of: usize) -> Option<String> {
        let Self { cameras, farthest_px, .. } = self;
        if *cameras == 0 {
            return None;
        }
        let models = self.models.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        let off = match self.has_uncomputed {
            false => format!(", with corners up to {farthest_px:.1} px off"),
            true if *farthest_px > 0.0 => format!(", with corners {farthest_px:.1} px off and more"),
            true => String::new(),
        };
        Some(format!("{cameras} of {of} cameras have lenses that distort ({models}), and are drawn as pinholes{off}"))
    }
}

fn corners_off_px(lens: &Lens, camera: &Camera) -> Option<f64> {
    let [width, height] = camera.size_px.map(f64::from);
    let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
    let mut farthest = 0.0_f64;
    for corner in corners {
        let slope = (DVec2::from(corner) - camera.centre_px) / camera.focal_px;
        farthest = farthest.max(((lens.bent(slope)? - slope) * camera.focal_px).length());
    }
    Some(farthest)
}
