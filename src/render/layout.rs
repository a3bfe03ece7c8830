//! The packing of a Gaussian's numbers into words for the GPU. `storage.glsl` unpacks them.

use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use crate::options::{Options, Storage};
use crate::render::shaders::Grids;
use crate::render::shaders::shared::{STORED_F16, STORED_F32, STORED_U8};
use crate::scene::{Gaussians, Grid, MAX_SH_DEGREE, Requirements, bands, encode_rotation, sh_coefficients};

/// The SH degree and the number formats of a scene on the GPU: only those that the scene needs and the options allow.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Degree of the spherical harmonics that are stored.
    pub sh_degree: u32,
    /// The format of the spherical harmonics.
    pub sh: Packing,
    /// The format of rotation, scale and opacity.
    pub shape: Packing,
    sh_grids: [Grid; sh_coefficients(MAX_SH_DEGREE)],
    scale_grid: Grid,
    /// The 16-bit code of a scale plus this is the upper part of its bits as a 32-bit float ([`scale_code`]).
    scale_base: u32,
    /// True if some opacity is so high that alphas are clamped to `Rules::alpha_max`.
    pub has_clamped_alphas: bool,
    /// An upper bound on every colour channel of every Gaussian.
    pub brightest: f64,
    /// True if the colours are too bright for 16-bit floats.
    is_bright: bool,
}

/// Largest change of a colour channel by 16-bit floats, in steps of 8 bits: a scene that would change more is kept in
/// 32-bit floats.
const MOST_STEPS: f64 = 2.0;
/// Brightest colour of scenes in which pixels stop as early as the options say. Above it, they stop later in
/// proportion: what is left out grows with the brightest colour.
const STOP_BRIGHT: f64 = 4.0;
/// Limits of scenes that may be kept in 16-bit floats, for the brightest colour and for the root mean square of the
/// distance of all colours from grey: an error of a shape moves a pixel by more the brighter the colours are.
const F16_BRIGHT: [f64; 2] = [16.0, 0.8];

/// The number format of a group of attributes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packing {
    /// Never [`Storage::Lossless`].
    pub storage: Storage,
    /// True if unpacking returns the values of the file exactly.
    pub is_lossless: bool,
}

impl Packing {
    /// The format with the fewest bits that `allowed` permits.
    fn of(allowed: Storage, fits_bytes: bool) -> Self {
        match allowed {
            Storage::Lossless | Storage::F16 if fits_bytes => Self { storage: Storage::U8, is_lossless: true },
            Storage::Lossless | Storage::F32 => Self { storage: Storage::F32, is_lossless: true },
            Storage::F16 => Self { storage: Storage::F16, is_lossless: false },
            Storage::U8 => Self { storage: Storage::U8, is_lossless: fits_bytes },
        }
    }

    /// The number that shaders know the format by.
    pub(super) fn code(self) -> u32 {
        match self.storage {
            Storage::Lossless | Storage::F32 => STORED_F32,
            Storage::F16 => STORED_F16,
            Storage::U8 => STORED_U8,
        }
    }
}

impl Layout {
    /// The layout of a scene with the requirements `needs` under these options.
    pub fn of(gaussians: &Gaussians, needs: &Requirements, options: &Options) -> Self {
        let sh_degree = needs.sh_degree.min(options.sh_degree);
        let sh = Packing::of(options.sh_storage, needs.sh_grids.is_some());
        // A logarithm in 8 bits cannot represent a scale of 0.
        let is_flat = gaussians.scales().par_iter().with_min_len(1 << 14).any(|scale| scale.contains(&0.0));
        let allowed = if is_flat { options.shape_storage.min(Storage::F16) } else { options.shape_storage };
        let [smallest, largest] = scale_range(gaussians);
        let scale_base = upper_bits(largest).saturating_sub(u32::from(u16::MAX));
        // Scales over more than 63 octaves do not fit into 16 bits.
        let is_wide = smallest < largest && upper_bits(smallest) <= scale_base;
        let rms = needs.bands.iter().map(|band| band.rms.powi(2)).sum::<f64>().sqrt();
        let is_bright = needs.brightest > F16_BRIGHT[0] || rms > F16_BRIGHT[1];
        let allowed = if (is_wide || is_bright) && allowed == Storage::F16 { Storage::Lossless } else { allowed };
        let shape = Packing::of(allowed, needs.scale_grid.is_some());
        let sh_grids = needs.sh_grids.unwrap_or_else(|| match sh.storage {
            Storage::U8 => std::array::from_fn(|i| spanning_coefficient(gaussians, sh_degree, i)),
            _ => [UNUSED; sh_coefficients(MAX_SH_DEGREE)],
        });
        let logarithms = || gaussians.scales().par_iter().flat_map_iter(|s| s.map(|s| f64::from(s).log2()));
        let scale_grid = needs.scale_grid.unwrap_or_else(|| match shape.storage {
            Storage::U8 => Grid::spanning(logarithms()),
            _ => UNUSED,
        });
        // 1 % lower, because packing and rounding may increase an alpha.
        let clamped = 0.99 * options.rules.alpha_max;
        let has_clamped_alphas =
            gaussians.opacities().par_iter().with_min_len(1 << 14).any(|opacity| *opacity > clamped);
        let mut layout = Self {
            sh_degree,
            sh,
            shape,
            sh_grids,
            scale_grid,
            scale_base,
            has_clamped_alphas,
            brightest: needs.brightest,
            is_bright,
        };
        // Rounding changes a value by at most 2^-11 of it, so few scenes need their coefficients examined.
        let most = MOST_STEPS / 255.0;
        let rounding = needs.bands.iter().map(|band| band.bound).sum::<f64>() / 2048.0;
        if sh.storage == Storage::F16 && rounding > 0.99 * most && layout.packing_error(gaussians) > most {
            layout.sh = Packing::of(Storage::F32, false);
        }
        layout
    }

    /// The transmittance at which a pixel is finished: the options' stop, lower in bright scenes.
    pub(super) fn stop(&self, options: &Options) -> f32 {
        options.stop * (STOP_BRIGHT / self.brightest).min(1.0) as f32
    }

    /// True if the fast path stores the colours of splats as 16-bit floats: if the options allow that for the spherical
    /// harmonics and let pixels stop early, and no colour is so bright that rounding it shows.
    pub(super) fn is_compact(&self, options: &Options) -> bool {
        let is_allowed = matches!(options.sh_storage, Storage::F16 | Storage::U8) && options.stop > 0.0;
        is_allowed && !self.is_bright
    }

    /// An upper bound on the change of any colour channel of any Gaussian, seen from any direction, by this packing and
    /// by the degrees that are left out: |dc| <= sum over l of sqrt((2 l + 1) / 4 pi) |dk_l|. A picture changes by at
    /// most as much, since a pixel is a convex combination of colours.
    pub fn colour_error(&self, gaussians: &Gaussians) -> f64 {
        if self.sh.is_lossless && self.sh_degree == gaussians.sh_degree() {
            return 0.0;
        }
        self.change(gaussians, |value| value.into())
    }

    /// The part of [`colour_error`](Self::colour_error) that is due to the packing.
    fn packing_error(&self, gaussians: &Gaussians) -> f64 {
        self.change(gaussians, |_| 0.0)
    }

    /// As [`colour_error`](Self::colour_error), where a coefficient of a degree that is left out changes by
    /// `left_out(value)`.
    fn change(&self, gaussians: &Gaussians, left_out: impl Fn(f32) -> f64 + Sync) -> f64 {
        let kept = sh_coefficients(self.sh_degree);
        let of_gaussian = |index: usize| {
            let sh = gaussians.sh(index);
            let change = |i: usize, channel: usize| match sh.get(i) {
                Some(value) if i < kept => f64::from(self.kept(i, value[channel])) - f64::from(value[channel]),
                Some(value) => left_out(value[channel]),
                None => 0.0,
            };
            (0..3).map(|channel| bands(|i| change(i, channel)).iter().sum()).fold(0.0, f64::max)
        };
        (0..gaussians.len()).into_par_iter().with_min_len(4096).map(of_gaussian).reduce(|| 0.0, f64::max)
    }

    /// The value of a coefficient after packing and unpacking.
    fn kept(&self, coefficient: usize, value: f32) -> f32 {
        match self.sh.storage {
            Storage::Lossless | Storage::F32 => value,
            Storage::F16 => half(value).to_f32(),
            Storage::U8 => {
                let grid = self.sh_grids[coefficient];
                grid.decode(grid.encode(value.into()))
            }
        }
    }

    /// Device memory in bytes that a Gaussian takes. A last plane with one or two words per Gaussian is shared by four
    /// or two Gaussians; three words are padded to four.
    pub fn bytes_each(&self) -> u64 {
        let padded = |words: usize| words + usize::from(words % 4 == 3);
        4 * (4 + padded(self.shape_words()) + padded(self.sh_words())) as u64
    }

    /// Words of spherical harmonics that a Gaussian takes.
    pub(super) fn sh_words(&self) -> usize {
        let floats = 3 * sh_coefficients(self.sh_degree);
        match self.sh.storage {
            Storage::Lossless | Storage::F32 => floats,
            Storage::F16 => floats.div_ceil(2),
            Storage::U8 => floats.div_ceil(4),
        }
    }

    /// Words of rotation, scale and opacity that a Gaussian takes.
    pub(super) fn shape_words(&self) -> usize {
        match self.shape.storage {
            Storage::Lossless | Storage::F32 => 8,
            Storage::F16 => 4,
            Storage::U8 => 2,
        }
    }

    /// The words of the spherical harmonics `sh`, of which [`sh_words`](Self::sh_words) are stored.
    pub(super) fn packed_sh(&self, sh: &[[f32; 3]]) -> [u32; MAX_FLOATS] {
        let floats = sh[..sh_coefficients(self.sh_degree)].as_flattened();
        let mut words = [0; MAX_FLOATS];
        match self.sh.storage {
            Storage::Lossless | Storage::F32 => {
                words.iter_mut().zip(floats).for_each(|(w, float)| *w = float.to_bits())
            }
            Storage::F16 => {
                // All at once: the processor converts several in one instruction.
                let mut finite = [0.0; MAX_FLOATS];
                finite.iter_mut().zip(floats).for_each(|(to, float)| *to = finite_half(*float));
                let mut halves = [f16::ZERO; MAX_FLOATS];
                halves.convert_from_f32_slice(&finite);
                let pairs = halves.as_chunks::<2>().0.iter();
                words.iter_mut().zip(pairs).for_each(|(word, pair)| *word = joined(*pair));
            }
            Storage::U8 => {
                for (i, float) in floats.iter().enumerate() {
                    words[i / 4] |= u32::from(self.sh_grids[i / 3].encode((*float).into())) << (8 * (i % 4));
                }
            }
        }
        words
    }

    /// Word `word` of Gaussian `index`'s rotation, scale and opacity.
    pub(super) fn shape_word(&self, gaussians: &Gaussians, index: usize, word: usize) -> u32 {
        let (q, scale, opacity) =
            (gaussians.rotations()[index], gaussians.scales()[index], gaussians.opacities()[index]);
        let [x, y, z] = scale;
        match self.shape.storage {
            Storage::Lossless | Storage::F32 => [q, [x, y, z, opacity]].as_flattened()[word].to_bits(),
            Storage::F16 => {
                let [x, y, z] = scale.map(|s| scale_code(self.scale_base, s));
                let opacity = u32::from(half(opacity).to_bits());
                [halves([q[0], q[1]]), halves([q[2], q[3]]), x | y << 16, z | opacity << 16][word]
            }
            Storage::U8 if word == 0 => {
                let [x, y, z] = scale.map(|s| self.scale_grid.encode(f64::from(s).log2()));
                u32::from_le_bytes([x, y, z, opacity_byte(opacity)])
            }
            Storage::U8 => encode_rotation(q),
        }
    }

    /// Scale and opacity of Gaussian `index` after packing and unpacking.
    pub(super) fn kept_shape(&self, gaussians: &Gaussians, index: usize) -> ([f32; 3], f32) {
        let (scale, opacity) = (gaussians.scales()[index], gaussians.opacities()[index]);
        let on_grid = |s: f32| self.scale_grid.decode(self.scale_grid.encode(f64::from(s).log2())).exp2();
        match self.shape.storage {
            Storage::Lossless | Storage::F32 => (scale, opacity),
            Storage::F16 => {
                (scale.map(|s| of_scale_code(self.scale_base, scale_code(self.scale_base, s))), half(opacity).to_f32())
            }
            Storage::U8 => (scale.map(on_grid), f32::from(opacity_byte(opacity)) / 255.0),
        }
    }

    /// The grids and the base that the shaders unpack with.
    pub(super) fn grids(&self) -> Grids {
        let pair = |grid: Grid| [grid.offset, grid.step];
        Grids { sh: self.sh_grids.map(pair), log2_scale: pair(self.scale_grid), scale_base: self.scale_base as f32 }
    }
}

/// Most spherical harmonics of a Gaussian, of all channels.
const MAX_FLOATS: usize = 3 * sh_coefficients(MAX_SH_DEGREE);

const UNUSED: Grid = Grid { offset: 0.0, step: 1.0 };

/// The grid of coefficient `i` that spans its values in all Gaussians.
fn spanning_coefficient(gaussians: &Gaussians, degree: u32, i: usize) -> Grid {
    if i >= sh_coefficients(degree) {
        return UNUSED;
    }
    Grid::spanning((0..gaussians.len()).into_par_iter().flat_map_iter(|index| gaussians.sh(index)[i].map(f64::from)))
}

/// The smallest scale over 0 and the largest; both 0 if there is none.
fn scale_range(gaussians: &Gaussians) -> [f32; 2] {
    let none = || [f32::INFINITY, 0.0];
    let wider = |[low, high]: [f32; 2], [l, h]: [f32; 2]| [low.min(l), high.max(h)];
    let positive = gaussians.scales().as_flattened().par_iter().with_min_len(1 << 14).filter(|scale| **scale > 0.0);
    let [low, high] = positive.map(|scale| [*scale; 2]).fold(none, wider).reduce(none, wider);
    [low.min(high), high]
}

/// The exponent and the upper 10 bits of the mantissa of a float that is not negative, rounded to the nearest even
/// finite value.
fn upper_bits(value: f32) -> u32 {
    let bits = value.to_bits();
    ((bits + 0xfff + (bits >> 13 & 1)) >> 13).min(f32::MAX.to_bits() >> 13)
}

/// A scale in 16 bits without sign: 6 bits of exponent and 10 of mantissa, as precise as a 16-bit float over twice as
/// many octaves. 0 stands for 0.
fn scale_code(base: u32, scale: f32) -> u32 {
    upper_bits(scale).saturating_sub(base)
}

/// The scale of a [`scale_code`].
fn of_scale_code(base: u32, code: u32) -> f32 {
    if code == 0 { 0.0 } else { f32::from_bits((code + base) << 13) }
}

/// The nearest value in the range of finite 16-bit floats.
fn finite_half(value: f32) -> f32 {
    const MOST: f32 = f16::MAX.to_f32_const();
    value.clamp(-MOST, MOST)
}

/// The nearest finite 16-bit float.
fn half(value: f32) -> f16 {
    f16::from_f32(finite_half(value))
}

/// An opacity in steps of 1/255, at least one step: nothing that is drawn becomes transparent.
fn opacity_byte(opacity: f32) -> u8 {
    (opacity * 255.0).round().max(1.0) as u8
}

/// Two 16-bit floats in one word.
fn halves(values: [f32; 2]) -> u32 {
    joined(values.map(half))
}

fn joined([low, high]: [f16; 2]) -> u32 {
    u32::from(low.to_bits()) | u32::from(high.to_bits()) << 16
}
