//! The rules of the picture, and every knob that trades its accuracy for speed or memory.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A contribution below this is skipped: one 8-bit step, part of the trained model. The 32-bit value, like every
/// threshold here: what an f32 renderer compares with.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// No splat covers more.
pub const ALPHA_MAX: f32 = 0.99;
/// The splat that would take the transmittance below this is not added, and ends the pixel.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// px^2, added to both diagonal entries of a projected covariance.
pub const LOW_PASS: f64 = 0.3_f32 as f64;
/// The least factor on an opacity that makes up for the low-pass, so that small splats do not vanish (gsplat since
/// commit 421f7698).
pub const COMPENSATION_MIN: f64 = 0.005;
/// px, width and height of a tile.
pub const TILE: u32 = 16;

/// What the picture is, in exact arithmetic. A trained scene looks as it was trained under the rules of its trainer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// World units: a Gaussian whose mean is not farther ahead of the camera than this is not drawn.
    pub near: f32,
    pub order: Order,
    pub extent: Extent,
    /// Contributions below this alpha are skipped.
    pub alpha_min: f32,
    /// No splat covers more.
    pub alpha_max: f32,
    /// The splat that would take the transmittance below this is not added, and ends the pixel.
    pub transmittance_min: f32,
    /// The opacity of a splat is lowered as the low-pass widens it (Mip-Splatting, Yu et al. 2024): for scenes that were
    /// trained so.
    pub antialiased: bool,
}

/// What splats are sorted by, front to back. Equal ones stay in the order of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// The view depth of the mean as a 32-bit float: how scenes are trained.
    Depth,
    /// The distance of the mean from the camera as a 32-bit float: KHR_gaussian_splatting.
    Distance,
    /// In every pixel anew, the depth at which the Gaussian is densest along the ray (StopThePop, Radl et al. 2024). The
    /// reference alone can do it.
    PerPixel,
}

/// How far from its mean a splat is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Extent {
    /// Until its alpha falls below the threshold: nothing is cut.
    Exact,
    /// The same, but nowhere beyond three standard deviations: KHR_gaussian_splatting.
    ThreeSigma,
    /// In the tiles of the square that three standard deviations along its longest axis reach: the original 3DGS.
    ThreeSigmaSquares,
}

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

/// Which tiles a splat is listed in. All show the same picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum TileTest {
    /// Those that its ellipse meets (AccuTile, Hanson et al. 2024).
    Ellipse,
    /// Those that the box around its ellipse meets (gsplat).
    Box,
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
    /// Pixels are blended in 16-bit floats, on devices that have them.
    pub half_blend: bool,
    pub tile_test: TileTest,
    /// Pictures are drawn at this part of their width and height, over 0 to 1, and enlarged.
    pub scale: f32,
    /// Runs only what works on every device, with no path chosen for this one.
    pub portable: bool,
}

impl Rules {
    /// Those of the original 3DGS (Kerbl et al. 2023), with footprints that are not cut.
    pub const TRAINED: Self = Self {
        near: 0.2,
        order: Order::Depth,
        extent: Extent::Exact,
        alpha_min: ALPHA_MIN,
        alpha_max: ALPHA_MAX,
        transmittance_min: TRANSMITTANCE_MIN,
        antialiased: false,
    };
    /// The original program (diff-gaussian-rasterization), tiles cut at three standard deviations included.
    pub const INRIA: Self = Self { extent: Extent::ThreeSigmaSquares, ..Self::TRAINED };
    /// gsplat 1.5.3, which also draws a mean that lies at the near plane.
    pub const GSPLAT: Self = Self { near: 0.01_f32.next_down(), alpha_max: 0.999, ..Self::TRAINED };
    /// KHR_gaussian_splatting (glTF), which has no threshold, no cap and no stop; alphas below 1e-5 are skipped all the
    /// same.
    pub const KHR: Self = Self {
        order: Order::Distance,
        extent: Extent::ThreeSigma,
        alpha_min: 1e-5,
        alpha_max: 1.0,
        transmittance_min: 0.0,
        ..Self::TRAINED
    };

    /// The same with hardly a contribution left out: what alpha thresholds and stops approximate.
    pub fn complete(self) -> Self {
        Self { alpha_min: 1e-9, transmittance_min: 0.0, extent: Extent::Exact, ..self }
    }
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
        half_blend: false,
        tile_test: TileTest::Ellipse,
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
        } else if self.half_blend {
            Some("a picture that is blended in 16-bit floats has no certificate")
        } else if self.rules.extent == Extent::ThreeSigmaSquares {
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
