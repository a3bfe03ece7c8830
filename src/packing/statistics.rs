//! Statistics of a whole scene, from one pass over its Gaussians.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::halves::half;
use crate::scene::{
    Bounds, Colours, Curve, FOCUSED, Focus, Gaussians, MAX_SH_DEGREE, Requirements, SUMMED, StoredValues, bands,
    sh_coefficients,
};

/// The input of a [`Layout`](super::Layout), and the extent of a scene. The same Gaussians in the same order have the
/// same statistics, bit for bit, for blocks of any size.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Number of Gaussians.
    pub count: usize,
    /// SH degree of the Gaussians, which may be higher than required.
    pub sh_degree: u32,
    /// The bounding box of the means.
    pub extent: Bounds,
    /// As [`Focus::of`].
    pub focus: Focus,
    pub requirements: Requirements,
    /// The smallest scale over 0 and the largest; both 0 if there is none.
    pub scales: [f32; 2],
    /// True if a scale is 0.
    pub is_flat: bool,
    pub highest_opacity: f32,
    /// Smallest and largest value of each coefficient of the spherical harmonics.
    pub sh: [[f32; 2]; sh_coefficients(MAX_SH_DEGREE)],
    /// The largest change of a colour channel by 16-bit floats, for each SH degree that may be kept. Changes below
    /// 1.98 / 255 may be given as 0.
    pub half_errors: [f64; MAX_SH_DEGREE as usize + 1],
}

/// Colour channels up to which coefficients need no examination: rounding to 16-bit floats changes a value by at most
/// 2^-11 of it.
pub const EXAMINED: f64 = 0.99 * 2.0 / 255.0 * 2048.0;

impl Statistics {
    /// The statistics of a scene in memory.
    pub fn of(gaussians: &Gaussians) -> Self {
        let mut all = Accumulator::new(gaussians.len(), gaussians.sh_degree());
        all.add(gaussians);
        all.finish()
    }

    /// Statistics that suit several scenes together: bounds of what they need. The extent and the focus are those
    /// around all of them, as if they were at one place.
    ///
    /// # Panics
    /// If there is no scene.
    pub fn joined<'a>(scenes: impl Iterator<Item = &'a Self>) -> Self {
        let joined = scenes.cloned().reduce(|a, b| {
            let smallest = match (a.scales[0], b.scales[0]) {
                (0.0, other) | (other, 0.0) => other,
                (a, b) => a.min(b),
            };
            let sh = std::array::from_fn(|i| [a.sh[i][0].min(b.sh[i][0]), a.sh[i][1].max(b.sh[i][1])]);
            Self {
                count: a.count + b.count,
                sh_degree: a.sh_degree.max(b.sh_degree),
                extent: a.extent.around(b.extent),
                focus: a.focus.joined(b.focus),
                requirements: a.requirements.joined(&b.requirements),
                scales: [smallest, a.scales[1].max(b.scales[1])],
                is_flat: a.is_flat || b.is_flat,
                highest_opacity: a.highest_opacity.max(b.highest_opacity),
                sh,
                half_errors: std::array::from_fn(|i| a.half_errors[i].max(b.half_errors[i])),
            }
        });
        joined.expect("there is a scene")
    }

    /// The statistics of the same scene with levels of detail, whose nodes may be as large as the scene.
    #[must_use]
    pub fn with_room_for_levels(mut self) -> Self {
        let Bounds { low, high } = self.extent;
        let diagonal = (0..3).map(|axis| (high[axis] - low[axis]).powi(2)).sum::<f32>().sqrt();
        if self.scales[1] > 0.0 && diagonal.is_finite() {
            self.scales[1] = self.scales[1].max(diagonal);
        }
        self.highest_opacity = self.highest_opacity.max(1.0);
        self
    }

    /// The Morton curve of the pages. It covers the part of the scene near its focus, since a stray Gaussian far away
    /// would put all others into one cell.
    pub fn curve(&self) -> Curve {
        let Focus { centre, radius } = self.focus;
        let side = |axis: usize, sign: f64| (centre[axis] + sign * NEAR * radius) as f32;
        let low = std::array::from_fn(|axis| self.extent.low[axis].max(side(axis, -1.0)));
        let high = std::array::from_fn(|axis| self.extent.high[axis].min(side(axis, 1.0)));
        Curve::through(low, high)
    }
}

/// Extent of the curve around the focus, in radii of the focus.
const NEAR: f64 = 32.0;

/// Accumulates the statistics of a scene that is read in blocks.
pub struct Accumulator {
    count: usize,
    added: usize,
    sh_degree: u32,
    colours: Colours,
    /// The colours of the last [`SUMMED`] Gaussians, if they are not complete.
    begun: Colours,
    extremes: Extremes,
    values: StoredValues,
    /// Means and opacities of the Gaussians that the focus is computed from.
    focused: (Vec<[f32; 3]>, Vec<f32>),
}

impl Accumulator {
    /// For a scene of `count` Gaussians of this SH degree.
    pub fn new(count: usize, sh_degree: u32) -> Self {
        Self {
            count,
            added: 0,
            sh_degree,
            colours: Colours::default(),
            begun: Colours::default(),
            extremes: Extremes::NONE,
            values: StoredValues::new(count, sh_degree),
            focused: Default::default(),
        }
    }

    /// Adds the next Gaussians.
    ///
    /// # Panics
    /// If they are of another SH degree.
    pub fn add(&mut self, gaussians: &Gaussians) {
        assert_eq!(gaussians.sh_degree(), self.sh_degree, "all Gaussians of a scene are of one SH degree");
        let (first, len) = (self.added, gaussians.len());
        // Sums are over fixed ranges of the scene, so that they do not depend on the blocks.
        let ends = (1..).map(|part| (first / SUMMED + part) * SUMMED - first).take_while(|end| *end < len);
        let ends: Vec<usize> = [0].into_iter().chain(ends).chain([len]).collect();
        let begun = self.begun;
        let parts: Vec<_> = (ends.par_windows(2).enumerate())
            .map(|(i, ends)| {
                let mut part = (if i == 0 { begun } else { Colours::default() }, Extremes::NONE);
                part.1.add(gaussians, ends[0]..ends[1], &mut part.0);
                part
            })
            .collect();
        self.begun = Colours::default();
        for ((colours, extremes), end) in parts.iter().zip(&ends[1..]) {
            self.extremes = self.extremes.and(extremes);
            if (first + end).is_multiple_of(SUMMED) {
                self.colours = self.colours.and(colours);
            } else {
                self.begun = *colours;
            }
        }
        self.values.add(gaussians);
        self.focus_on(gaussians);
        self.added += len;
    }

    fn focus_on(&mut self, gaussians: &Gaussians) {
        let places = (self.focused.0.len()..FOCUSED).map(|k| Focus::sampled(k, self.count));
        for index in places.map(|place| place - self.added).take_while(|index| *index < gaussians.len()) {
            self.focused.0.push(gaussians.means()[index]);
            self.focused.1.push(gaussians.opacities()[index]);
        }
    }

    /// Number of Gaussians that were added.
    pub fn added(&self) -> usize {
        self.added
    }

    /// True if the announced number of Gaussians was added.
    pub fn is_complete(&self) -> bool {
        self.added == self.count
    }

    /// Some means, evenly spread over the scene.
    pub fn sample(&self) -> &[[f32; 3]] {
        &self.focused.0
    }

    /// The statistics of all added Gaussians.
    ///
    /// # Panics
    /// If the number of Gaussians is not the announced one.
    pub fn finish(self) -> Statistics {
        assert_eq!(self.added, self.count, "all Gaussians of the scene are added");
        let colours = self.colours.and(&self.begun);
        let Extremes { scales: [smallest, largest], is_flat, highest_opacity, sh, half_errors, .. } = self.extremes;
        Statistics {
            count: self.count,
            sh_degree: self.sh_degree,
            extent: self.extremes.extent(),
            focus: Focus::of_weighted(&self.focused.0, &self.focused.1),
            requirements: Requirements::from_parts(&colours, self.count, &self.values),
            scales: [smallest.min(largest), largest],
            is_flat,
            highest_opacity,
            sh,
            half_errors,
        }
    }
}

/// Smallest and largest values, which do not depend on the order of the Gaussians.
#[derive(Clone, Copy)]
struct Extremes {
    low: Vec3,
    high: Vec3,
    scales: [f32; 2],
    is_flat: bool,
    highest_opacity: f32,
    sh: [[f32; 2]; sh_coefficients(MAX_SH_DEGREE)],
    half_errors: [f64; MAX_SH_DEGREE as usize + 1],
}

/// The range of no values.
pub const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

fn wider([low, high]: [f32; 2], [l, h]: [f32; 2]) -> [f32; 2] {
    [low.min(l), high.max(h)]
}

impl Extremes {
    const NONE: Self = Self {
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
        scales: [f32::INFINITY, 0.0],
        is_flat: false,
        highest_opacity: 0.0,
        sh: [NOTHING; sh_coefficients(MAX_SH_DEGREE)],
        half_errors: [0.0; MAX_SH_DEGREE as usize + 1],
    };

    fn extent(&self) -> Bounds {
        if self.low.x > self.high.x {
            return Bounds { low: [0.0; 3], high: [0.0; 3] };
        }
        let [low, high] = [self.low, self.high].map(|v| (v + Vec3::ZERO).to_array()); // 0 is +0
        Bounds { low, high }
    }

    fn and(&self, other: &Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            scales: wider(self.scales, other.scales),
            is_flat: self.is_flat || other.is_flat,
            highest_opacity: self.highest_opacity.max(other.highest_opacity),
            sh: std::array::from_fn(|i| wider(self.sh[i], other.sh[i])),
            half_errors: std::array::from_fn(|l| self.half_errors[l].max(other.half_errors[l])),
        }
    }

    /// Adds some Gaussians, and their colours to `colours`.
    fn add(&mut self, gaussians: &Gaussians, range: Range<usize>, colours: &mut Colours) {
        for index in range {
            let (mean, sh) = (Vec3::from(gaussians.means()[index]), gaussians.sh(index));
            (self.low, self.high) = (self.low.min(mean), self.high.max(mean));
            for scale in gaussians.scales()[index] {
                self.is_flat |= scale == 0.0;
                if scale > 0.0 {
                    self.scales = wider(self.scales, [scale; 2]);
                }
            }
            self.highest_opacity = self.highest_opacity.max(gaussians.opacities()[index]);
            for (range, values) in self.sh.iter_mut().zip(sh) {
                // 0 is +0: threads meet zeros of both signs in any order.
                *range = values.iter().fold(*range, |range, value| wider(range, [value + 0.0; 2]));
            }
            for (channel, bounds) in colours.add(sh).iter().enumerate() {
                if bounds.iter().sum::<f64>() > EXAMINED {
                    self.examine(sh, channel);
                }
            }
        }
    }

    fn examine(&mut self, sh: &[[f32; 3]], channel: usize) {
        let value = |i: usize| sh[i][channel];
        let change = bands(sh.len(), |i| f64::from(half(value(i)).to_f32()) - f64::from(value(i)));
        let mut sum = 0.0;
        for (most, change) in self.half_errors.iter_mut().zip(change) {
            sum += change;
            *most = most.max(sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::cactus;

    #[test]
    fn statistics_do_not_depend_on_the_blocks() {
        let scene = cactus::cactus(20_011).unwrap().gaussians;
        let whole = Statistics::of(&scene);
        assert_eq!(whole.requirements, Requirements::of(&scene));
        assert_eq!((whole.extent, whole.focus), (Bounds::of(&scene), Focus::of(&scene)));
        for block in [1, 100, 4095, 4096, 4097, 20_010] {
            let mut all = Accumulator::new(scene.len(), scene.sh_degree());
            for first in (0..scene.len()).step_by(block) {
                let indices: Vec<u32> = (first..scene.len().min(first + block)).map(|i| i as u32).collect();
                all.add(&scene.selected(&indices).unwrap());
            }
            assert_eq!(all.finish(), whole, "blocks of {block}");
        }
    }

    #[test]
    fn the_focus_of_a_large_scene_is_that_of_a_sample() {
        let scene = cactus::cactus(FOCUSED + 1000).unwrap().gaussians;
        let exact = Focus::of_weighted(scene.means(), scene.opacities());
        let estimate = Statistics::of(&scene).focus;
        assert_eq!(estimate, Focus::of(&scene));
        assert!((estimate.radius / exact.radius - 1.0).abs() < 0.01, "{estimate:?} for {exact:?}");
    }
}
