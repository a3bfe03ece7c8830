//! Gaussians as files store them, before they are validated and rounded.

/// One Gaussian as trainers store it, before the activations, in the axes right, down, forward.
#[derive(Clone, Copy, Debug)]
pub struct Raw {
    /// World units.
    pub mean: [f64; 3],
    /// Natural logarithm of the standard deviations.
    pub log_scale: [f64; 3],
    /// Quaternion w x y z of any length.
    pub rotation: [f64; 4],
    /// Opacity before the sigmoid.
    pub opacity_logit: f64,
}

/// One Gaussian as other files store it, after the activations, in the axes right, down, forward.
#[derive(Clone, Copy, Debug)]
pub struct Activated {
    /// World units.
    pub mean: [f64; 3],
    /// Standard deviations in world units.
    pub scale: [f64; 3],
    /// Quaternion w x y z of any length.
    pub rotation: [f64; 4],
    /// From 0 to 1.
    pub opacity: f64,
}

impl From<Raw> for Activated {
    /// An infinite logit is an opacity of 0 or 1, and a log scale of minus infinity is a flat Gaussian. A finite log
    /// scale is a finite scale.
    fn from(raw: Raw) -> Self {
        let scale = |log: f64| if log.is_finite() { log.exp().min(f64::MAX) } else { log.exp() };
        Self {
            mean: raw.mean,
            scale: raw.log_scale.map(scale),
            rotation: raw.rotation,
            opacity: 1.0 / (1.0 + (-raw.opacity_logit).exp()),
        }
    }
}

/// The inverse of the sigmoid; infinite for 0 and 1.
pub(crate) fn logit(opacity: f64) -> f64 {
    (opacity / (1.0 - opacity)).ln()
}

/// Largest error of the squared length of a unit quaternion after rounding to 32-bit floats.
const UNIT_TOLERANCE: f64 = 2.4e-7;

/// The quaternion normalized; `None` for length zero. It is scaled first so that no square over- or underflows. A
/// rounded unit quaternion is returned unchanged, so that writing and reading keep its bits.
pub(super) fn unit(q: [f64; 4]) -> Option<[f64; 4]> {
    if (q.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < UNIT_TOLERANCE {
        return Some(q);
    }
    let largest = q.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if largest == 0.0 {
        return None;
    }
    let q = q.map(|v| v / largest);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    Some(q.map(|v| v / length))
}
