//! The rules of the picture, those of the original 3DGS (Kerbl et al. 2023), and every knob that trades quality or speed.

/// A contribution below this is skipped: one 8-bit step, part of the trained model. The 32-bit value, like every
/// threshold here: what an f32 renderer compares with.
pub const ALPHA_MIN: f64 = (1.0_f32 / 255.0) as f64;
/// No splat covers more.
pub const ALPHA_MAX: f64 = 0.99_f32 as f64;
/// The splat that would take the transmittance below this is not added, and ends the pixel.
pub const TRANSMITTANCE_MIN: f64 = 1e-4_f32 as f64;
/// px^2, added to both diagonal entries of a projected covariance.
pub const LOW_PASS: f64 = 0.3_f32 as f64;
/// px, width and height of a tile.
pub const TILE: u32 = 16;

/// What a renderer is built for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// World units: a Gaussian whose mean is not farther ahead of the camera than this is not drawn.
    pub near: f32,
    /// Runs only what works on every device, with no path chosen for this one.
    pub portable: bool,
}

impl Options {
    /// Every named choice of options.
    pub const PRESETS: [(&'static str, Self); 2] =
        [("default", Self { near: 0.2, portable: false }), ("portable", Self { near: 0.2, portable: true })];

    /// The choice of this name.
    pub fn preset(name: &str) -> Option<Self> {
        Self::PRESETS.iter().find(|(known, _)| *known == name).map(|(_, options)| *options)
    }
}

impl Default for Options {
    /// The rules of the original 3DGS: near plane at 0.2.
    fn default() -> Self {
        Self::PRESETS[0].1
    }
}

/// What lies behind the scene: a colour, or nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Red, green, blue as displayed; 1 is white.
    Colour([f32; 3]),
    Transparent,
}

impl Background {
    pub const BLACK: Self = Self::Colour([0.0; 3]);

    /// What is blended behind the last splat.
    pub fn colour(self) -> [f32; 3] {
        match self {
            Self::Colour(colour) => colour,
            Self::Transparent => [0.0; 3],
        }
    }
}
