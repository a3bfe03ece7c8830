//! How large a scene is and where its matter lies.

use super::Gaussians;

/// The box of all means, and the ball that holds most of the visible matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// World units, per axis.
    pub low: [f32; 3],
    pub high: [f32; 3],
    /// Median of the means, weighted by opacity: far floaters do not move it.
    pub centre: [f64; 3],
    /// Distance from `centre` that holds 90 % of the opacity.
    pub radius: f64,
}

impl Bounds {
    /// Of an empty scene: a ball of radius one at the origin.
    pub fn of(gaussians: &Gaussians) -> Self {
        let (means, opacities) = (gaussians.means(), gaussians.opacities());
        if means.is_empty() {
            return Self { low: [0.0; 3], high: [0.0; 3], centre: [0.0; 3], radius: 1.0 };
        }
        let mut low = means[0];
        let mut high = means[0];
        for mean in means {
            for axis in 0..3 {
                low[axis] = low[axis].min(mean[axis]);
                high[axis] = high[axis].max(mean[axis]);
            }
        }
        let weighted = |value: &dyn Fn(&[f32; 3]) -> f64, fraction| {
            let mut values: Vec<_> = means.iter().zip(opacities).map(|(m, o)| (value(m), f64::from(*o))).collect();
            weighted_quantile(&mut values, fraction)
        };
        let centre = std::array::from_fn(|axis| weighted(&|m| f64::from(m[axis]), 0.5));
        let distance = |m: &[f32; 3]| (0..3).map(|i| (f64::from(m[i]) - centre[i]).powi(2)).sum::<f64>().sqrt();
        let radius = weighted(&distance, 0.9);
        Self { low, high, centre, radius: if radius > 0.0 { radius } else { 1.0 } }
    }
}

/// The value that `fraction` of the weight lies at or below. `values` are (value, weight), at least one.
fn weighted_quantile(values: &mut [(f64, f64)], fraction: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let wanted = fraction * values.iter().map(|v| v.1).sum::<f64>();
    let mut sum = 0.0;
    let reached = values.iter().find(|(_, weight)| {
        sum += weight;
        sum >= wanted
    });
    reached.unwrap_or(&values[values.len() - 1]).0
}

/// The values below which these fractions of `values` lie (nearest rank). `values` is not empty.
pub fn percentiles<const N: usize>(mut values: Vec<f32>, fractions: [f64; N]) -> [f32; N] {
    values.sort_unstable_by(f32::total_cmp);
    fractions.map(|f| values[((values.len() - 1) as f64 * f).round() as usize])
}
