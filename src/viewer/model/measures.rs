//! Measures of the scenes: marked points, and the distances, angles and areas between them.

use anyhow::{Result, ensure};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What is measured of the points of a measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MeasureKind {
    /// Distances between neighbours, and their sum.
    #[default]
    Distance,
    /// The angle at the second of three points.
    Angle,
    /// The area of a polygon.
    Area,
    /// Pairs of points, the first one on a scene that is aligned and the second one where it belongs.
    Pairs,
}

impl MeasureKind {
    /// Every kind with its name and a help text.
    pub const ALL: [(Self, &str, &str); 4] = [
        (Self::Distance, "distance", "between neighbouring points, and the sum"),
        (Self::Angle, "angle", "at the second of three points"),
        (Self::Area, "area", "of the polygon of the points, and its circumference"),
        (
            Self::Pairs,
            "pairs",
            "a point of the scene that is to be aligned, then the point where it belongs, again and again",
        ),
    ];

    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

/// Points in world units, and what is measured of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Measure {
    pub kind: MeasureKind,
    pub points: Vec<[f64; 3]>,
}

impl Measure {
    pub fn points(&self) -> impl DoubleEndedIterator<Item = DVec3> + ExactSizeIterator + '_ {
        self.points.iter().map(|point| DVec3::from(*point))
    }

    /// The lines between its points.
    pub fn lines(&self) -> Vec<[DVec3; 2]> {
        let points: Vec<DVec3> = self.points().collect();
        let mut lines: Vec<[DVec3; 2]> = match self.kind {
            MeasureKind::Pairs => points.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect(),
            _ => points.windows(2).map(|pair| [pair[0], pair[1]]).collect(),
        };
        if let (MeasureKind::Area, [first, _, .., last]) = (self.kind, &points[..]) {
            lines.push([*last, *first]);
        }
        lines
    }

    /// The sum of the lengths of its lines, in world units.
    pub fn length(&self) -> f64 {
        self.lines().iter().map(|[a, b]| a.distance(*b)).sum()
    }

    /// The root of the mean squared length of its lines, in world units; `None` without lines.
    pub fn root_mean_square(&self) -> Option<f64> {
        let lines = self.lines();
        let squares: f64 = lines.iter().map(|[a, b]| a.distance_squared(*b)).sum();
        (!lines.is_empty()).then(|| (squares / lines.len() as f64).sqrt())
    }

    /// The angle at the second of its first three points, in degrees.
    pub fn angle(&self) -> Option<f64> {
        let mut points = self.points();
        let (a, b, c) = (points.next()?, points.next()?, points.next()?);
        Some((a - b).angle_between(c - b).to_degrees())
    }

    /// The area of the polygon of its points in square world units, and how far the farthest of them lies from the
    /// plane that fits the polygon, in world units. `None` for less than three points. Of a polygon that is not flat it
    /// is the area of its image in that plane (half the length of the sum of the cross products of its sides).
    pub fn area(&self) -> Option<(f64, f64)> {
        let points: Vec<DVec3> = self.points().collect();
        let [first, _, _, ..] = points[..] else { return None };
        let twice: DVec3 = points.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum();
        let normal = twice.try_normalize().unwrap_or(DVec3::ZERO);
        let middle = points.iter().sum::<DVec3>() / points.len() as f64;
        let apart = points.iter().map(|point| normal.dot(*point - middle).abs()).fold(0.0, f64::max);
        Some((twice.length() / 2.0, apart))
    }
}

/// The unit of lengths.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LengthUnit {
    pub name: String,
    /// Units per world unit.
    pub per_world: f64,
}

/// All measures, and their unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Measures {
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub all: Vec<Measure>,
    /// `None` for world units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<LengthUnit>,
}

impl Measures {
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Checks what was read.
    ///
    /// # Errors
    /// A point is not finite, or the unit has no length.
    pub fn check(&self) -> Result<()> {
        let mut numbers = self.all.iter().flat_map(|one| one.points.iter().flatten());
        ensure!(numbers.all(|number| number.is_finite()), "a point of its measures is not finite");
        let unit = self.unit.as_ref().map_or(1.0, |unit| unit.per_world);
        ensure!(unit.is_finite() && unit > 0.0, "its unit of length is not over 0 and finite");
        Ok(())
    }

    /// A length in world units as text, in the unit.
    pub fn length(&self, world: f64) -> String {
        match &self.unit {
            Some(LengthUnit { name, per_world }) => format!("{} {name}", short(world * per_world)),
            None => short(world),
        }
    }

    /// An area in square world units as text, in the unit.
    pub fn area(&self, world: f64) -> String {
        match &self.unit {
            Some(LengthUnit { name, per_world }) => format!("{} {name}²", short(world * per_world * per_world)),
            None => short(world),
        }
    }

    /// What a measure says, as text; empty while it has too few points.
    pub fn reading(&self, measure: &Measure) -> String {
        match measure.kind {
            MeasureKind::Distance => {
                let lines = measure.lines();
                let last = lines.last().map(|[a, b]| self.length(a.distance(*b)));
                match (last, lines.len()) {
                    (Some(last), 1) => last,
                    (Some(last), _) => format!("{last}, {} in all", self.length(measure.length())),
                    (None, _) => String::new(),
                }
            }
            MeasureKind::Angle => measure.angle().map_or_else(String::new, |angle| format!("{angle:.2}°")),
            MeasureKind::Area => measure.area().map_or_else(String::new, |(area, apart)| {
                let (area, around, apart) = (self.area(area), self.length(measure.length()), self.length(apart));
                format!("{area}, {around} around, flat to {apart}")
            }),
            MeasureKind::Pairs => measure.root_mean_square().map_or_else(String::new, |apart| {
                format!("{} pairs, {} apart, root mean square", measure.lines().len(), self.length(apart))
            }),
        }
    }

    /// The texts of a measure, each with the point of the world at which it is written: the lengths of its lines and
    /// its area, or its angle.
    pub fn labels(&self, measure: &Measure) -> Vec<(DVec3, String)> {
        let points: Vec<DVec3> = measure.points().collect();
        if measure.kind == MeasureKind::Angle {
            let corner = points.get(1).filter(|_| measure.angle().is_some());
            return corner.map(|corner| (*corner, self.reading(measure))).into_iter().collect();
        }
        let lengths = measure.lines().into_iter().map(|[a, b]| ((a + b) / 2.0, self.length(a.distance(b))));
        let area = measure.area().filter(|_| measure.kind == MeasureKind::Area);
        let middle = points.iter().sum::<DVec3>() / points.len() as f64;
        lengths.chain(area.map(|(area, _)| (middle, self.area(area)))).collect()
    }

    /// Adds a point to a measure; a full one, or none, is followed by another of this kind. Returns the index of the
    /// measure that has the point.
    pub fn add(&mut self, to: Option<usize>, kind: MeasureKind, point: DVec3) -> usize {
        let is_open = |index: &usize| {
            let is_full = |one: &Measure| one.kind == MeasureKind::Angle && one.points.len() == 3;
            self.all.get(*index).is_some_and(|one| !is_full(one))
        };
        let index = to.filter(is_open).unwrap_or_else(|| {
            self.all.push(Measure { kind, points: Vec::new() });
            self.all.len() - 1
        });
        self.all[index].points.push(point.to_array());
        index
    }
}

/// The settings for measuring.
pub struct Ruler {
    /// Index of the measure that gets the next point.
    pub open: Option<usize>,
    /// The kind of the next measure.
    pub kind: MeasureKind,
    /// The length that is known, and the name of its unit.
    pub known: f64,
    pub unit: String,
    /// An alignment changes the scale, too.
    pub scales: bool,
}

impl Default for Ruler {
    fn default() -> Self {
        Self { open: None, kind: MeasureKind::Distance, known: 1.0, unit: "m".to_owned(), scales: true }
    }
}

/// A number with five significant digits.
fn short(value: f64) -> String {
    if value.abs() < 1e-9 {
        return "0".to_owned();
    }
    let digits = 4 - value.abs().max(1e-9).log10().floor() as i32;
    format!("{value:.*}", digits.clamp(0, 12) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measure(kind: MeasureKind, points: &[[f64; 3]]) -> Measure {
        Measure { kind, points: points.to_vec() }
    }

    #[test]
    fn lengths_angles_and_areas_are_those_of_geometry() {
        let square = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 2.0, 1.0], [0.0, 2.0, 1.0]];
        let distance = measure(MeasureKind::Distance, &square);
        assert_eq!((distance.length(), distance.angle()), (6.0, Some(90.0)));
        let area = measure(MeasureKind::Area, &square);
        assert_eq!((area.length(), area.area()), (8.0, Some((4.0, 0.0))));
        let bent = measure(MeasureKind::Area, &[[0.0; 3], [2.0, 0.0, 0.0], [2.0, 2.0, 0.4], [0.0, 2.0, 0.0]]);
        let (size, apart) = bent.area().unwrap();
        assert!(size > 4.0 && size < 4.2 && apart > 0.05 && apart < 0.2, "{size} {apart}");
        let pairs =
            measure(MeasureKind::Pairs, &[[0.0; 3], [0.0, 3.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 4.0], [9.0; 3]]);
        assert_eq!((pairs.lines().len(), pairs.root_mean_square()), (2, Some(12.5f64.sqrt())));
        assert_eq!(measure(MeasureKind::Area, &square[..2]).area(), None);
    }

    #[test]
    fn labels_lie_at_lines_corners_and_in_the_middle() {
        let measures = Measures::default();
        let corners = [[0.0; 3], [2.0, 0.0, 0.0], [2.0, 4.0, 0.0]];
        let labels = |kind, points: &[[f64; 3]]| measures.labels(&measure(kind, points));
        let text = |x: f64, y: f64, text: &str| (DVec3::new(x, y, 0.0), text.to_owned());
        let lengths = [text(1.0, 0.0, "2.0000"), text(2.0, 2.0, "4.0000")];
        assert_eq!(labels(MeasureKind::Distance, &corners), lengths);
        assert_eq!(labels(MeasureKind::Angle, &corners), [text(2.0, 0.0, "90.00°")]);
        assert_eq!(labels(MeasureKind::Angle, &corners[..2]), []);
        let area = labels(MeasureKind::Area, &corners);
        assert_eq!((area.len(), area[3].1.as_str()), (4, "4.0000"));
        assert_eq!(labels(MeasureKind::Area, &[]), []);
    }

    #[test]
    fn points_go_into_the_open_measure() {
        let mut measures = Measures::default();
        let mut open = None;
        for i in 0..4 {
            open = Some(measures.add(open, MeasureKind::Angle, DVec3::splat(f64::from(i))));
        }
        let counts: Vec<usize> = measures.all.iter().map(|one| one.points.len()).collect();
        assert_eq!((counts, open), (vec![3, 1], Some(1)));
    }

    #[test]
    fn numbers_are_in_the_unit() {
        let mut measures = Measures::default();
        assert_eq!((measures.length(1.0 / 3.0), measures.area(2.0)), ("0.33333".to_owned(), "2.0000".to_owned()));
        measures.unit = Some(LengthUnit { name: "m".to_owned(), per_world: 2.0 });
        assert_eq!((measures.length(617.25), measures.area(2.0)), ("1234.5 m".to_owned(), "8.0000 m²".to_owned()));
    }
}
