//! The knobs that trade a picture's accuracy for speed or memory, and the presets.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::rules::{ALPHA_MIN, Footprint, Rules};

/// How the GPU keeps numbers of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Storage {
    /// In as few bits as give back what the file holds: an .spz file needs 8.
    Lossless,
    /// In 32-bit floats.
    F32,
    /// In 16-bit floats, or fewer bits where that loses nothing.
    F16,
    /// Spherical harmonics in 8 bits; of a shape, logarithms of scales and opacity in 8 bits and rotations in 32.
    U8,
}

/// What a renderer is built for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Options {
    pub rules: Rules,
    /// A pixel is finished as soon as its transmittance is below this. Moves no colour by more than this part of the
    /// brightest colour.
    pub stop: f32,
    /// Bits of a depth key, 8 to 32: from its upper end, as many as the scene is deep.
    pub key_bits: u32,
    /// Spherical harmonics above this degree are left out.
    pub sh_degree: u32,
    /// Of the spherical harmonics.
    pub sh_storage: Storage,
    /// Of rotations, scales and opacities. Means are 32-bit floats.
    pub shape_storage: Storage,
    /// Pictures are drawn at this part of their width and height, over 0 to 1, and enlarged.
    pub scale: f32,
    /// Runs only what works on every device, with no path chosen for this one.
    pub portable: bool,
}

impl Options {
    /// No knob is turned: f32 throughout, the whole depth, all that the file holds.
    pub const EXACT: Self = Self {
        rules: Rules::TRAINED,
        stop: 0.0,
        key_bits: 32,
        sh_degree: 3,
        sh_storage: Storage::Lossless,
        shape_storage: Storage::Lossless,
        scale: 1.0,
        portable: false,
    };
    /// Looks the same: at least 60 dB from the reference, no 8-bit value more than 3 steps away.
    pub const BALANCED: Self =
        Self { stop: 1e-3, sh_storage: Storage::F16, shape_storage: Storage::F16, ..Self::EXACT };
    /// At least 50 dB from the reference.
    pub const FAST: Self = Self {
        rules: Rules { alpha_min: 1.0 / 224.0, ..Rules::TRAINED },
        stop: 1.0 / 255.0,
        key_bits: 24,
        ..Self::BALANCED
    };
    /// At least 40 dB from the reference.
    pub const PREVIEW: Self = Self {
        rules: Rules { alpha_min: 1.0 / 128.0, ..Rules::TRAINED },
        stop: 1.0 / 128.0,
        key_bits: 16,
        ..Self::FAST
    };

    /// Every named choice of options.
    pub const PRESETS: [(&'static str, Self); 8] = [
        ("balanced", Self::BALANCED),
        ("exact", Self::EXACT),
        ("fast", Self::FAST),
        ("preview", Self::PREVIEW),
        ("inria", Self { rules: Rules::INRIA, ..Self::EXACT }),
        ("gsplat", Self { rules: Rules::GSPLAT, ..Self::EXACT }),
        ("khr", Self { rules: Rules::KHR, ..Self::EXACT }),
        ("portable", Self { portable: true, ..Self::BALANCED }),
    ];

    /// Width and height that a picture of this size is drawn at.
    pub fn drawn_size(&self, size_px: [u32; 2]) -> [u32; 2] {
        size_px.map(|side| ((f64::from(side) * f64::from(self.scale)).round() as u32).clamp(1, side))
    }

    /// No knob turned, by the same rules. A threshold over the trained one is a knob.
    pub fn untraded(&self) -> Self {
        let rules = Rules { alpha_min: self.rules.alpha_min.min(ALPHA_MIN), ..self.rules };
        Self { rules, portable: self.portable, ..Self::EXACT }
    }

    /// Why pictures drawn like this have no certificate; `None` if they have.
    pub fn uncertifiable(&self) -> Option<&'static str> {
        if self.scale != 1.0 {
            Some("a picture that is drawn smaller and enlarged has no certificate")
        } else if self.rules.extent == Footprint::ThreeSigmaSquares {
            Some("a picture in which splats end at the borders of tiles has no certificate")
        } else {
            None
        }
    }

    /// The choice of this name.
    pub fn preset(name: &str) -> Option<Self> {
        Self::PRESETS.iter().find(|(known, _)| *known == name).map(|(_, options)| *options)
    }
}

impl Default for Options {
    fn default() -> Self {
        Self::BALANCED
    }
}
