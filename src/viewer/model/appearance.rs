//! The appearance of a scene: factors on its colours and its opacities.

use std::sync::Arc;

use anyhow::{Result, ensure};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::scene::Gaussians;

/// The part of red, green and blue in the luminance of a colour (ITU-R BT.709).
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Factors on the colours and opacities of a scene. The default changes no bit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Appearance {
    /// Factors on red, green and blue.
    pub tint: [f32; 3],
    /// A factor on all channels.
    pub brightness: f64,
    /// 0 leaves the luminance alone, 1 changes nothing.
    pub saturation: f64,
    /// A factor on opacities, which stay at most 1.
    pub opacity: f64,
}

impl Default for Appearance {
    fn default() -> Self {
        Self { tint: [1.0; 3], brightness: 1.0, saturation: 1.0, opacity: 1.0 }
    }
}

impl Appearance {
    /// Fails if a factor is negative or not finite.
    pub fn check(&self) -> Result<()> {
        let all = self.tint.map(f64::from).into_iter().chain([self.brightness, self.saturation, self.opacity]);
        ensure!({ all }.all(|factor| (0.0..=1e6).contains(&factor)), "factors of colours are from 0 to 1,000,000");
        Ok(())
    }

    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// The linear map of colours: saturation first.
    fn colours(&self) -> DMat3 {
        let grey = DMat3::from_cols_array_2d(&LUMINANCE.map(|part| [part; 3]));
        let saturated = DMat3::IDENTITY * self.saturation + grey * (1.0 - self.saturation);
        DMat3::from_diagonal(DVec3::from(self.tint.map(f64::from)) * self.brightness) * saturated
    }

    /// A shared scene with this appearance.
    pub fn applied_to(&self, gaussians: Arc<Gaussians>) -> Arc<Gaussians> {
        match self.is_default() {
            true => gaussians,
            false => Arc::new(self.applied(Gaussians::clone(&gaussians))),
        }
    }

    /// A scene with this appearance.
    pub fn applied(&self, gaussians: Gaussians) -> Gaussians {
        match self.is_default() {
            true => gaussians,
            false => gaussians.adjusted(self.colours(), self.opacity),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_tinted_brightened_and_lose_their_hue() {
        let orange = DVec3::new(0.8, 0.4, 0.1);
        let of = |appearance: Appearance| appearance.colours() * orange;
        assert_eq!(of(Appearance::default()), orange);
        assert!(of(Appearance { brightness: 0.5, ..Appearance::default() }).distance(orange * 0.5) < 1e-12);
        let tinted = of(Appearance { tint: [0.5, 1.0, 2.0], ..Appearance::default() });
        assert!(tinted.distance(DVec3::new(0.4, 0.4, 0.2)) < 1e-12);
        let grey = of(Appearance { saturation: 0.0, ..Appearance::default() });
        let luminance = orange.dot(DVec3::from(LUMINANCE));
        assert!(grey.distance(DVec3::splat(luminance)) < 1e-12, "{grey}");
        let vivid = of(Appearance { saturation: 1.5, ..Appearance::default() });
        assert!((vivid.dot(DVec3::from(LUMINANCE)) - luminance).abs() < 1e-12 && vivid.x > orange.x);
    }
}
