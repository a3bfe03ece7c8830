//! The values of a property of all Gaussians, and their histogram.

use std::sync::Arc;

use anyhow::Result;
use kd_tree::KdTree;
use rayon::prelude::*;

use super::contributions::Contributions;
use super::edit::Property;
use super::loaded_scene::DrawnScene;
use super::plan::Plan;
use crate::gpu::{Buffer, Commands, Device};

/// Bars of a histogram.
pub const BARS: usize = 96;

/// The values of a property of the joined scenes of a plan.
pub struct PropertyValues {
    pub property: Property,
    scenes: Vec<DrawnScene>,
    /// The contributions that the values are.
    contributions: Option<Arc<Contributions>>,
    own: Option<(Vec<f32>, Buffer<f32>)>,
    pub histogram: Histogram,
}

/// The numbers of values in intervals of equal width, or of equal ratios where values span several powers of ten.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    pub low: f32,
    pub high: f32,
    pub is_logarithmic: bool,
    pub counts: Vec<u32>,
}

impl Histogram {
    /// The histogram of the values of a property.
    pub fn of(property: Property, values: &[f32]) -> Self {
        let is_logarithmic = !matches!(property, Property::Opacity | Property::Colour(_));
        let none = || (f32::INFINITY, 0.0_f32);
        let (least, most) = values
            .par_iter()
            .filter(|value| **value > 0.0)
            .fold(none, |(low, high), value| (low.min(*value), high.max(*value)))
            .reduce(none, |a, b| (a.0.min(b.0), a.1.max(b.1)));
        // Values beyond the ends are in the first or the last interval.
        let (low, high) = match property {
            _ if most == 0.0 => (0.0, 1.0),
            Property::Opacity | Property::Colour(_) => (0.0, most),
            Property::Scale => (least.max(most * 1e-6), most),
            Property::Anisotropy => (1.0, most.min(1e4)),
            Property::Contribution => (least.max(1e-5), most),
            Property::Isolation => (least.max(1e-3), most.min(1e6)),
        };
        let is_logarithmic = is_logarithmic && low > 0.0 && low < high;
        let mut histogram = Self { low, high, is_logarithmic, counts: Vec::new() };
        let count = |mut counts: Vec<u32>, value: &f32| {
            let place = (histogram.place(*value) * BARS as f32) as usize;
            counts[place.min(BARS - 1)] += 1;
            counts
        };
        let add = |a: Vec<u32>, b: Vec<u32>| a.iter().zip(&b).map(|(a, b)| a + b).collect();
        let counts = values.par_iter().fold(|| vec![0; BARS], count).reduce(|| vec![0; BARS], add);
        histogram.counts = counts;
        histogram
    }

    /// The place of a value between the ends, 0 to 1.
    pub fn place(&self, value: f32) -> f32 {
        let place = match self.is_logarithmic {
            true => (value / self.low).ln() / (self.high / self.low).ln(),
            false => (value - self.low) / (self.high - self.low),
        };
        // A single value has no place.
        if place.is_nan() { 0.0 } else { place.clamp(0.0, 1.0) }
    }

    /// The value at a place between the ends.
    pub fn value(&self, place: f32) -> f32 {
        match self.is_logarithmic {
            true => self.low * (self.high / self.low).powf(place),
            false => self.low + (self.high - self.low) * place,
        }
    }
}

impl PropertyValues {
    /// Computes the values of the Gaussians of a plan, and brings them to the device.
    ///
    /// # Errors
    /// A scene is paged, memory runs out, or the device is lost.
    pub fn new(
        device: &Device,
        plan: &Plan,
        property: Property,
        contributions: Option<Arc<Contributions>>,
    ) -> Result<Self> {
        let scenes = plan.scenes.clone();
        if let Some(contributions) = contributions {
            let histogram = Histogram::of(property, &contributions.all);
            return Ok(Self { property, scenes, contributions: Some(contributions), own: None, histogram });
        }
        let mut values = Vec::new();
        for drawn in &scenes {
            let whole = drawn.whole()?;
            match property {
                Property::Isolation => values.append(&mut isolations(whole.means())),
                _ => values.par_extend((0..whole.len()).into_par_iter().map(|i| property.value(&whole, i))),
            }
        }
        let on_device = Buffer::new(device, "values", values.len())?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&on_device, 0, values.len(), |memory| memory.copy_from_slice(&values))?;
        cmd.submit()?.wait()?;
        let histogram = Histogram::of(property, &values);
        Ok(Self { property, scenes, contributions: None, own: Some((values, on_device)), histogram })
    }

    /// True if these are the values of this property of these scenes.
    pub fn are_of(
        &self,
        property: Property,
        scenes: &[DrawnScene],
        contributions: Option<&Arc<Contributions>>,
    ) -> bool {
        let is_same = match (&self.contributions, contributions) {
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            (one, other) => one.is_none() && other.is_none(),
        };
        // Placements and colours of scenes change no value.
        let are_same = self.scenes.len() == scenes.len()
            && self.scenes.iter().zip(scenes).all(|(one, other)| one.scene.is_same(&other.scene));
        self.property == property && is_same && are_same
    }

    /// The values by Gaussian of the joined scenes, on the host and on the device.
    pub fn all(&self) -> (&[f32], &Buffer<f32>) {
        let of_view = || self.contributions.as_ref().map(|found| (&found.all[..], &found.on_device));
        let own = self.own.as_ref().map(|(values, on_device)| (&values[..], on_device));
        own.or_else(of_view).expect("values are computed or are contributions")
    }
}

/// The neighbour whose distance says how isolated a centre is. Fewer would call pairs of floaters crowded.
const NEIGHBOUR: usize = 8;

/// The distance of each centre from its eighth nearest, or from the farthest of fewer, over the median of all.
fn isolations(means: &[[f32; 3]]) -> Vec<f32> {
    let tree = KdTree::par_build_by_ordered_float(means.to_vec());
    let distance = |mean: &[f32; 3]| {
        // The nearest is the centre itself.
        let farthest =
            tree.nearests(mean, NEIGHBOUR + 1).iter().map(|found| found.squared_distance).fold(0.0, f32::max);
        farthest.sqrt()
    };
    let mut distances: Vec<f32> = means.par_iter().map(distance).collect();
    let mut sorted = distances.clone();
    let middle = sorted.len() / 2;
    let median = sorted.get(middle).is_some().then(|| *sorted.select_nth_unstable_by(middle, f32::total_cmp).1);
    let unit = median.filter(|median| *median > 0.0).unwrap_or(1.0);
    distances.iter_mut().for_each(|distance| *distance /= unit);
    distances
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the distances of all pairs.
    #[test]
    fn what_floats_alone_is_isolated() {
        let mut means: Vec<[f32; 3]> =
            (0..400).map(|i| [(i % 20) as f32, (i / 20) as f32, (i * i % 7) as f32 * 0.1]).collect();
        means.push([500.0, 0.0, 0.0]);
        let distance = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
        let eighth = |a: &[f32; 3]| {
            let mut all: Vec<f32> = means.iter().map(|b| distance(a, b)).collect();
            all.sort_by(f32::total_cmp);
            all[NEIGHBOUR]
        };
        let mut sorted: Vec<f32> = means.iter().map(eighth).collect();
        sorted.sort_by(f32::total_cmp);
        for (mean, found) in means.iter().zip(isolations(&means)) {
            let expected = eighth(mean) / sorted[means.len() / 2];
            assert!((found / expected - 1.0).abs() < 1e-5, "{found} instead of {expected}");
        }
        assert!(isolations(&means)[400] > 100.0);
        assert_eq!(isolations(&[[1.0; 3]; 20]), [0.0; 20]);
        assert!(isolations(&[]).is_empty());
    }

    #[test]
    fn a_histogram_counts_every_value_once() {
        let scales = Histogram::of(Property::Scale, &[0.0, 1e-3, 2e-2, 2e-1, 1.0]);
        assert!(scales.is_logarithmic && (scales.low, scales.high) == (1e-3, 1.0));
        assert_eq!([0, 41, 73, 95].map(|bar| scales.counts[bar]), [2, 1, 1, 1]);
        let opacities = Histogram::of(Property::Opacity, &[2.0, 3.0, 4.0, 0.0]);
        assert!(!opacities.is_logarithmic && (opacities.low, opacities.high) == (0.0, 4.0));
        assert_eq!([0, 48, 72, 95].map(|bar| opacities.counts[bar]), [1; 4]);
        for place in [0.0, 0.25, 1.0] {
            assert!((scales.place(scales.value(place)) - place).abs() < 1e-5);
            assert!((opacities.place(opacities.value(place)) - place).abs() < 1e-5);
        }
        let flat = Histogram::of(Property::Anisotropy, &[1.0; 7]);
        assert_eq!((flat.low, flat.high, flat.counts[0]), (1.0, 1.0, 7));
        let nothing = Histogram::of(Property::Contribution, &[0.0, 0.0]);
        assert_eq!((nothing.low, nothing.high, nothing.counts[0]), (0.0, 1.0, 2));
    }
}
