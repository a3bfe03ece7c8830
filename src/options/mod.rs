//! The options of a renderer: the knobs that trade accuracy for speed or memory, and the presets.
//!
//! - `mod` - [`Options`] and the presets
//! - `knobs` - the table of knobs, which command line, `trade`, panels and documents read
//! - `setting` - the types of settings, as values of knobs

mod knobs;
mod setting;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::rules::{ALPHA_MIN, Footprint, Order, Rules, by_name};

pub use knobs::{Effect, Group, Held, KNOBS, Kind, Knob};
pub use setting::Value;

/// Number format in which the GPU keeps the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Storage {
    /// The fewest bits that give back exactly what the file holds: 8 for an .spz file.
    Lossless,
    /// 32-bit floats.
    F32,
    /// 16-bit floats, or fewer bits where that loses nothing.
    F16,
    /// 8 bits for spherical harmonics, logarithms of scales and opacities; 32 bits for a rotation.
    U8,
}

impl Storage {
    /// Every format with its name on the command line and in reports.
    pub const NAMES: [(&'static str, Self); 4] =
        [("lossless", Self::Lossless), ("f32", Self::F32), ("f16", Self::F16), ("u8", Self::U8)];
}

by_name!(Storage);

/// The options of a renderer, including the rules of its pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Options {
    pub rules: Rules,
    /// A pixel is finished as soon as its transmittance is below this. No colour moves by more than this fraction of
    /// the brightest colour.
    pub stop: f32,
    /// Most significant bits of the depth key that are sorted, 8 to 32. A scene whose depths need fewer bits uses
    /// fewer.
    pub key_bits: u32,
    /// Spherical harmonics above this degree are left out.
    pub sh_degree: u32,
    /// Storage of spherical harmonics.
    pub sh_storage: Storage,
    /// Storage of rotations, scales and opacities. Means are always 32-bit floats.
    pub shape_storage: Storage,
    /// Pictures are drawn at this fraction of their width and height, above 0 and at most 1, and enlarged.
    pub scale: f32,
    /// The error limit of nodes that stand for several Gaussians: the root of the squared difference of the picture's
    /// colours per saved node, summed over pixels and channels, in steps of 1/255. 0: nothing is simplified.
    #[serde(default)]
    pub lod_error: f32,
    /// The PSNR to the picture of all Gaussians that each picture keeps, dB; of frames that do not wait for pages, the
    /// PSNR that is predicted from the errors of the nodes. Replaces `lod_error`. 0: none.
    #[serde(default)]
    pub lod_psnr: f32,
    /// Splat budget: most nodes of a picture, which raises the error limit if needed. 0: unlimited.
    #[serde(default)]
    pub splats: u32,
    /// Width of the cross-fade, in powers of two above the error limit: nodes with such errors and their children are
    /// both drawn in part. 0: no cross-fade.
    #[serde(default)]
    pub lod_fade: f32,
    /// Powers of two by which the error limit of hidden groups of nodes is raised. 0: none is known to be hidden.
    #[serde(default)]
    pub lod_occlusion: f32,
    /// Uses only features that every device has.
    pub portable: bool,
}

impl Options {
    /// No knob is turned: 32-bit floats, full depth keys, all spherical harmonics of the file.
    pub const EXACT: Self = Self {
        rules: Rules::TRAINED,
        stop: 0.0,
        key_bits: 32,
        sh_degree: 4,
        sh_storage: Storage::Lossless,
        shape_storage: Storage::Lossless,
        scale: 1.0,
        lod_error: 0.0,
        lod_psnr: 0.0,
        splats: 0,
        lod_fade: 0.0,
        lod_occlusion: 0.0,
        portable: false,
    };
    /// Visually equal: a PSNR to the reference of at least 60 dB, no 8-bit value more than 3 steps away.
    pub const BALANCED: Self =
        Self { stop: 1e-3, sh_storage: Storage::F16, shape_storage: Storage::F16, ..Self::EXACT };
    /// A PSNR to the reference of at least 50 dB.
    pub const FAST: Self = Self {
        rules: Rules { alpha_min: 1.0 / 224.0, ..Rules::TRAINED },
        stop: 1.0 / 255.0,
        key_bits: 24,
        ..Self::BALANCED
    };
    /// A PSNR to the reference of at least 40 dB.
    pub const PREVIEW: Self = Self {
        rules: Rules { alpha_min: 1.0 / 128.0, ..Rules::TRAINED },
        stop: 1.0 / 128.0,
        key_bits: 16,
        ..Self::FAST
    };

    /// Every preset with its name.
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

    /// Width and height in pixels at which a picture of size `size_px` is drawn before it is enlarged.
    pub fn drawn_size(&self, size_px: [u32; 2]) -> [u32; 2] {
        size_px.map(|side| ((f64::from(side) * f64::from(self.scale)).round() as u32).clamp(1, side))
    }

    /// The exact options with the same rules. An alpha threshold above the trained one counts as a knob and is lowered.
    pub fn untraded(&self) -> Self {
        let rules = Rules { alpha_min: self.rules.alpha_min.min(ALPHA_MIN), ..self.rules };
        Self { rules, portable: self.portable, ..Self::EXACT }
    }

    /// True if scenes with levels of detail may be drawn simplified.
    pub fn wants_levels(&self) -> bool {
        self.lod_error > 0.0 || self.lod_psnr > 0.0 || self.splats > 0
    }

    /// True if what is hidden is drawn coarser.
    pub fn simplifies_hidden(&self) -> bool {
        self.lod_occlusion > 0.0 && self.wants_levels()
    }

    /// The same options without simplification: pictures have the bits of the scene.
    pub fn finest(&self) -> Self {
        Self { lod_error: f32::MIN_POSITIVE, lod_psnr: 0.0, splats: 0, lod_fade: 0.0, lod_occlusion: 0.0, ..*self }
    }

    /// The reason why pictures drawn with these options have no certificate; `None` if they have one.
    pub fn uncertifiable(&self) -> Option<&'static str> {
        if self.scale != 1.0 {
            Some("a picture that is drawn smaller and enlarged has no certificate")
        } else if self.wants_levels() {
            Some("a picture with levels of detail has no certificate: their errors are predictions")
        } else if self.rules.extent == Footprint::ThreeSigmaSquares {
            Some("a picture in which splats end at the borders of tiles has no certificate")
        } else {
            None
        }
    }

    /// The reason why no GPU path draws with these options; `None` if one does.
    pub fn undrawable(&self) -> Option<&'static str> {
        (self.rules.order == Order::PerPixel).then_some("order per-pixel is drawn only by the reference")
    }

    /// The preset with this name.
    pub fn preset(name: &str) -> Option<Self> {
        Self::PRESETS.iter().find(|(known, _)| *known == name).map(|(_, options)| *options)
    }
}

impl Default for Options {
    fn default() -> Self {
        Self::BALANCED
    }
}
