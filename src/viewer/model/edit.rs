//! Edits: flags for selected, hidden and deleted Gaussians, and the ways to select.

use std::ops::RangeInclusive;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::scene::Gaussians;

const SELECTED: u8 = 1;
const HIDDEN: u8 = 2;
const DELETED: u8 = 4;

/// Flags of the Gaussians of a scene, by index.
#[derive(Clone, PartialEq, Eq)]
pub struct Edit {
    flags: Vec<u8>,
    counts: Counts,
}

/// Numbers of Gaussians. A deleted Gaussian is not hidden, and neither is selected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub selected: usize,
    pub hidden: usize,
    pub deleted: usize,
}

/// Combination of a selection with the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelectionMode {
    Replace,
    Add,
    Subtract,
}

/// A change of all Gaussians, by their flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    Hide,
    Delete,
    /// Deletes all Gaussians that are drawn and not selected.
    Crop,
    ShowHidden,
    SelectAll,
    SelectNone,
    Invert,
}

impl Edit {
    /// An edit of this number of Gaussians without flags.
    pub fn new(count: usize) -> Self {
        Self::with(vec![0; count])
    }

    fn with(flags: Vec<u8>) -> Self {
        let has = |flag: u8| flags.par_iter().filter(|flags| **flags & flag != 0).count();
        let counts = Counts { selected: has(SELECTED), hidden: has(HIDDEN), deleted: has(DELETED) };
        Self { flags, counts }
    }

    /// Number of Gaussians of the scene. The edit takes a byte for each.
    pub fn gaussians(&self) -> usize {
        self.flags.len()
    }

    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// True if not all Gaussians are drawn.
    pub fn leaves_out(&self) -> bool {
        self.counts.hidden + self.counts.deleted > 0
    }

    pub fn is_selected(&self, index: usize) -> bool {
        self.flags[index] & SELECTED != 0
    }

    /// Indices of the drawn Gaussians.
    pub fn drawn(&self) -> Vec<u32> {
        (0..self.flags.len() as u32).filter(|i| self.flags[*i as usize] & (HIDDEN | DELETED) == 0).collect()
    }

    /// Indices of the Gaussians that are not deleted.
    pub fn kept(&self) -> Vec<u32> {
        (0..self.flags.len() as u32).filter(|i| self.flags[*i as usize] & DELETED == 0).collect()
    }

    /// True if the same Gaussians are drawn.
    pub fn draws_same(&self, other: &Self) -> bool {
        let is_drawn = |flags: &u8| flags & (HIDDEN | DELETED) == 0;
        self.flags.iter().map(is_drawn).eq(other.flags.iter().map(is_drawn))
    }

    /// Selects the drawn Gaussians for which `is_inside` is true, combined with the selection before.
    #[must_use]
    pub fn selecting(&self, mode: SelectionMode, is_inside: impl Fn(usize) -> bool + Sync) -> Self {
        let flags = self.flags.par_iter().enumerate().map(|(i, flags)| {
            let is_inside = flags & (HIDDEN | DELETED) == 0 && is_inside(i);
            let is_selected = match mode {
                SelectionMode::Replace => is_inside,
                SelectionMode::Add => is_inside || flags & SELECTED != 0,
                SelectionMode::Subtract => !is_inside && flags & SELECTED != 0,
            };
            (flags & !SELECTED) | if is_selected { SELECTED } else { 0 }
        });
        Self::with(flags.collect())
    }

    #[must_use]
    pub fn changed(&self, change: Change) -> Self {
        let one = |flags: &u8| {
            let is_drawn = flags & (HIDDEN | DELETED) == 0;
            match change {
                Change::Hide if flags & SELECTED != 0 => HIDDEN,
                Change::Delete if flags & SELECTED != 0 => DELETED,
                Change::Crop if is_drawn && flags & SELECTED == 0 => DELETED,
                Change::ShowHidden => flags & !HIDDEN,
                Change::SelectAll if is_drawn => SELECTED,
                Change::SelectNone => flags & !SELECTED,
                Change::Invert if is_drawn => flags ^ SELECTED,
                _ => *flags,
            }
        };
        Self::with(self.flags.par_iter().map(one).collect())
    }

    /// Runs of Gaussians with equal flags: length and flags, for a file.
    pub fn to_runs(&self) -> Vec<(usize, u8)> {
        let mut runs: Vec<(usize, u8)> = Vec::new();
        for flags in &self.flags {
            match runs.last_mut() {
                Some((length, last)) if last == flags => *length += 1,
                _ => runs.push((1, *flags)),
            }
        }
        runs
    }

    /// The inverse of [`Edit::to_runs`]; `None` if a run is invalid.
    pub fn from_runs(runs: &[(usize, u8)]) -> Option<Self> {
        const MAX: usize = u32::MAX as usize;
        let mut flags = Vec::new();
        for (length, of) in runs {
            if *of > (SELECTED | HIDDEN | DELETED) || *length > MAX - flags.len() {
                return None;
            }
            flags.resize(flags.len() + length, *of);
        }
        Some(Self::with(flags))
    }
}

/// A property by which Gaussians are selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Property {
    Opacity,
    /// The largest standard deviation, world units of the file.
    Scale,
    /// The largest standard deviation over the smallest.
    Anisotropy,
    /// The largest alpha times transmittance at a pixel of the view.
    Contribution,
}

impl Property {
    pub const ALL: [(Self, &str); 4] = [
        (Self::Opacity, "opacity"),
        (Self::Scale, "largest scale"),
        (Self::Anisotropy, "anisotropy"),
        (Self::Contribution, "contribution"),
    ];

    /// The property of a Gaussian with this contribution.
    pub fn value(self, gaussians: &Gaussians, index: usize, contribution: f32) -> f32 {
        let scales = gaussians.scales()[index];
        let (low, high) = scales.iter().fold((f32::MAX, 0.0), |(low, high): (f32, f32), s| (low.min(*s), high.max(*s)));
        match self {
            Self::Opacity => gaussians.opacities()[index],
            Self::Scale => high,
            Self::Anisotropy => high / low.max(f32::MIN_POSITIVE),
            Self::Contribution => contribution,
        }
    }
}

/// A set of Gaussians to select.
#[derive(Clone, Debug, PartialEq)]
pub enum Selection {
    /// Centres inside an outline in the picture.
    Outline(Outline),
    /// Centres within a ball of the world: its centre and radius.
    Ball(DVec3, f64),
    /// Centres within a box of the world: its least and its greatest corner.
    Box(DVec3, DVec3),
    /// A property within a range.
    Values(Property, RangeInclusive<f32>),
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

/// The colour of selected Gaussians, and its weight.
pub const TINT: ([f32; 3], f32) = ([1.0, 0.72, 0.1], 0.7);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selections_combine() {
        let edit = Edit::new(6).selecting(SelectionMode::Replace, |i| i < 3);
        assert_eq!(edit.counts(), Counts { selected: 3, hidden: 0, deleted: 0 });
        let added = edit.selecting(SelectionMode::Add, |i| i == 4);
        assert_eq!((0..6).map(|i| added.is_selected(i)).collect::<Vec<_>>(), [true, true, true, false, true, false]);
        let fewer = added.selecting(SelectionMode::Subtract, |i| i < 2);
        assert_eq!(fewer.counts().selected, 2);
        assert_eq!(fewer.changed(Change::Invert).counts().selected, 4);
        // Gaussians that are not drawn are not selected.
        let hidden = fewer.changed(Change::Hide);
        assert_eq!(hidden.counts(), Counts { selected: 0, hidden: 2, deleted: 0 });
        assert_eq!(hidden.drawn(), [0, 1, 3, 5]);
        assert_eq!(hidden.kept().len(), 6);
        let all = hidden.changed(Change::SelectAll).changed(Change::Delete);
        assert_eq!((all.drawn().len(), all.kept()), (0, vec![2, 4]), "hidden Gaussians are kept");
        assert_eq!(all.changed(Change::ShowHidden).drawn(), [2, 4]);
        let cropped = fewer.changed(Change::Crop);
        assert_eq!((cropped.drawn(), cropped.counts().selected), (vec![2, 4], 2));
        assert!(cropped.changed(Change::SelectNone).draws_same(&cropped) && !cropped.draws_same(&fewer));
        assert_eq!(Edit::from_runs(&all.to_runs()).map(|edit| edit.counts()), Some(all.counts()));
        assert!(Edit::from_runs(&[(3, 8)]).is_none() && Edit::from_runs(&[(usize::MAX, 0)]).is_none());
    }

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
