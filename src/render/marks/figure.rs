//! Figures that select Gaussians, in 64-bit floats: the twin of `glsl/marks/select.comp`, which also selects where the
//! device cannot.

use std::ops::RangeInclusive;

use glam::{DVec2, DVec3};

use crate::camera::Camera;
use crate::render::shaders::marks::*;

/// Combination of a selection with the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelectionMode {
    Replace = MODE_REPLACE as isize,
    Add = MODE_ADD as isize,
    Subtract = MODE_SUBTRACT as isize,
}

/// A set of Gaussians to select.
#[derive(Clone, Debug, PartialEq)]
pub enum Figure {
    /// Centres beyond the near plane, inside an outline in the picture.
    Outline(Outline),
    /// Centres within a ball of the world: its centre and radius.
    Ball(DVec3, f64),
    /// Centres within a box of the world: its least and its greatest corner.
    Box(DVec3, DVec3),
    /// Gaussians whose value is within a range.
    Values(RangeInclusive<f32>),
}

impl Figure {
    /// True if a Gaussian with this centre and value is inside. `near` is the near plane, world units.
    pub fn contains(&self, view: &Camera, near: f64, mean: DVec3, value: f32) -> bool {
        match self {
            Self::Outline(outline) => {
                let [low, high] = outline.bounds();
                let is_near = |place: DVec2| place.cmpge(low).all() && place.cmple(high).all();
                view.projected(mean).is_some_and(|(place, z)| z > near && is_near(place) && outline.contains(place))
            }
            Self::Ball(centre, radius) => mean.distance(*centre) <= *radius,
            Self::Box(low, high) => mean.cmpge(*low).all() && mean.cmple(*high).all(),
            Self::Values(range) => range.contains(&value),
        }
    }
}

/// A figure in the picture, in pixels.
#[derive(Clone, Debug, PartialEq)]
pub enum Outline {
    Rectangle(DVec2, DVec2),
    /// A closed polygon, filled by the even-odd rule.
    Lasso(Vec<DVec2>),
    /// A polyline, drawn with a brush of this radius.
    Brush(Vec<DVec2>, f64),
}

impl Outline {
    /// The corners of the bounding rectangle.
    pub fn bounds(&self) -> [DVec2; 2] {
        let around = |way: &[DVec2], margin: f64| {
            let low = way.iter().copied().reduce(DVec2::min).unwrap_or(DVec2::ZERO);
            let high = way.iter().copied().reduce(DVec2::max).unwrap_or(DVec2::ZERO);
            [low - margin, high + margin]
        };
        match self {
            Self::Rectangle(a, b) => around(&[*a, *b], 0.0),
            Self::Lasso(corners) => around(corners, 0.0),
            Self::Brush(way, radius) => around(way, *radius),
        }
    }

    pub fn contains(&self, place: DVec2) -> bool {
        match self {
            Self::Rectangle(a, b) => place.cmpge(a.min(*b)).all() && place.cmple(a.max(*b)).all(),
            Self::Lasso(corners) => {
                let ends = corners.iter().zip(corners.iter().cycle().skip(1));
                let crosses = |(a, b): &(&DVec2, &DVec2)| {
                    (a.y > place.y) != (b.y > place.y) && place.x < (b.x - a.x) * (place.y - a.y) / (b.y - a.y) + a.x
                };
                ends.filter(crosses).count() % 2 == 1
            }
            Self::Brush(way, radius) => {
                let near = |a: DVec2, b: DVec2| from_segment(place, [a, b]) <= *radius;
                way.first().is_some_and(|first| near(*first, *first))
                    || way.windows(2).any(|ends| near(ends[0], ends[1]))
            }
        }
    }
}

/// The distance of a point from a segment.
pub fn from_segment(place: DVec2, [a, b]: [DVec2; 2]) -> f64 {
    let step = b - a;
    let along = (place - a).dot(step) / step.length_squared().max(f64::MIN_POSITIVE);
    place.distance(a + step * along.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_contain_points_inside() {
        let at = DVec2::new;
        let rectangle = Outline::Rectangle(at(10.0, 2.0), at(4.0, 8.0));
        assert!(rectangle.contains(at(5.0, 5.0)) && !rectangle.contains(at(3.0, 5.0)));
        // The letter U: its middle is outside.
        let corners = [[0, 0], [0, 9], [9, 9], [9, 0], [6, 0], [6, 6], [3, 6], [3, 0]];
        let lasso = Outline::Lasso(corners.map(|c| DVec2::from(c.map(f64::from))).to_vec());
        assert!(lasso.contains(at(1.0, 1.0)) && lasso.contains(at(4.5, 7.5)) && !lasso.contains(at(4.5, 3.0)));
        let brush = Outline::Brush(vec![at(0.0, 0.0), at(10.0, 0.0), at(10.0, 10.0)], 2.0);
        assert!(brush.contains(at(5.0, 1.9)) && brush.contains(at(11.9, 8.0)) && !brush.contains(at(5.0, 5.0)));
        let dab = Outline::Brush(vec![at(3.0, 3.0)], 1.0);
        assert!(dab.contains(at(3.5, 3.5)) && !dab.contains(at(5.0, 3.0)));
        assert!(!Outline::Lasso(Vec::new()).contains(at(0.0, 0.0)));
    }
}
