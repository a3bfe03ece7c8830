//! The values of a property of all Gaussians, and their histogram.

use std::sync::Arc;

use anyhow::Result;
use rayon::prelude::*;

use super::contributions::Contributions;
use super::edit::Property;
use super::loaded_scene::{DrawnScene, are_same};
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
    on_device: Option<Buffer<f32>>,
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
        let is_logarithmic = matches!(property, Property::Scale | Property::Anisotropy | Property::Contribution);
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
            return Ok(Self { property, scenes, contributions: Some(contributions), on_device: None, histogram });
        }
        let mut values = Vec::new();
        for drawn in &scenes {
            let whole = drawn.whole()?;
            values.par_extend((0..whole.len()).into_par_iter().map(|i| property.value(&whole, i)));
        }
        let on_device = Buffer::new(device, "values", values.len())?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&on_device, 0, values.len(), |memory| memory.copy_from_slice(&values))?;
        cmd.submit()?.wait()?;
        let histogram = Histogram::of(property, &values);
        Ok(Self { property, scenes, contributions: None, on_device: Some(on_device), histogram })
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
        self.property == property && is_same && are_same(&self.scenes, scenes)
    }

    /// The values on the device, by Gaussian of the joined scenes.
    pub fn on_device(&self) -> &Buffer<f32> {
        let of_view = self.contributions.as_ref().map(|contributions| &contributions.on_device);
        self.on_device.as_ref().or(of_view).expect("values are computed or are contributions")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_counts_every_value_once() {
        let scales = Histogram::of(Property::Scale, &[0.0, 1e-3, 1e-2, 1e-1, 1.0]);
        assert!(scales.is_logarithmic && (scales.low, scales.high) == (1e-3, 1.0));
        assert_eq!([0, 32, 64, 95].map(|bar| scales.counts[bar]), [2, 1, 1, 1]);
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
