//! Packs the attributes of a Gaussian into words, and unpacks them. `glsl/shared/storage.glsl` unpacks them on the GPU.

use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::halves::{finite_half, half, halves, joined, of_scale_code, scale_code, separated, upper_bits};
use super::statistics::Statistics;
use super::widths::plane_widths;
use crate::options::{Options, Storage};
use crate::scene::{
    Gaussians, Grid, MAX_SH_DEGREE, Requirements, bands, decode_rotation, encode_rotation, sh_coefficients,
};

// Exact pictures leave out no degree.
const _: () = assert!(Options::EXACT.sh_degree == MAX_SH_DEGREE);

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
/// Brightest colour up to which pixels stop at the transmittance of the options. Above it, they stop later in
/// proportion, since the omitted light grows with the brightest colour.
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
}

impl Layout {
    /// The layout of a scene with these statistics under these options.
    pub fn of(statistics: &Statistics, options: &Options) -> Self {
        let needs = &statistics.requirements;
        let sh_degree = needs.sh_degree.min(options.sh_degree);
        let mut sh = Packing::of(options.sh_storage, needs.sh_grids.is_some());
        if sh.storage == Storage::F16 && statistics.half_errors[sh_degree as usize] > MOST_STEPS / 255.0 {
            sh = Packing::of(Storage::F32, false);
        }
        // A logarithm in 8 bits cannot represent a scale of 0.
        let allowed = if statistics.is_flat { options.shape_storage.min(Storage::F16) } else { options.shape_storage };
        let [smallest, largest] = statistics.scales;
        let scale_base = upper_bits(largest).saturating_sub(u32::from(u16::MAX));
        // Scales over more than 63 octaves do not fit into 16 bits.
        let is_wide = smallest < largest && upper_bits(smallest) <= scale_base;
        let rms = needs.bands.iter().map(|band| band.rms.powi(2)).sum::<f64>().sqrt();
        let is_bright = needs.brightest > F16_BRIGHT[0] || rms > F16_BRIGHT[1];
        let allowed = if (is_wide || is_bright) && allowed == Storage::F16 { Storage::Lossless } else { allowed };
        let shape = Packing::of(allowed, needs.scale_grid.is_some());
        let spanning = |i: usize| {
            let is_kept = sh.storage == Storage::U8 && i < sh_coefficients(sh_degree);
            if is_kept { Grid::spanning(statistics.sh[i].map(f64::from)) } else { Grid::UNUSED }
        };
        let sh_grids = needs.sh_grids.unwrap_or_else(|| std::array::from_fn(spanning));
        let scale_grid = needs.scale_grid.unwrap_or_else(|| match shape.storage {
            Storage::U8 if largest > 0.0 => Grid::spanning([smallest, largest].map(|scale| f64::from(scale).log2())),
            _ => Grid::UNUSED,
        });
        // 1 % lower, because packing and rounding may increase an alpha.
        let has_clamped_alphas = statistics.highest_opacity > 0.99 * options.rules.alpha_max;
        let brightest = needs.brightest;
        Self { sh_degree, sh, shape, sh_grids, scale_grid, scale_base, has_clamped_alphas, brightest, is_bright }
    }

    /// The layout of a scene and of nodes that stand for several of its Gaussians. Nodes lie on no grid that the values
    /// of a scene lie on.
    pub fn of_nodes(statistics: &Statistics, options: &Options) -> Self {
        let requirements = Requirements { sh_grids: None, scale_grid: None, ..statistics.requirements.clone() };
        Self::of(&Statistics { requirements, ..statistics.clone() }, options)
    }

    /// The transmittance at which a pixel is finished: the options' stop, lower in bright scenes.
    pub fn stop(&self, options: &Options) -> f32 {
        options.stop * (STOP_BRIGHT / self.brightest).min(1.0) as f32
    }

    /// True if the fast path stores the colours of splats as 16-bit floats: if the options allow that for the spherical
    /// harmonics and let pixels stop early, and no colour is so bright that rounding it shows.
    pub fn is_compact(&self, options: &Options) -> bool {
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
        let kept = sh_coefficients(self.sh_degree);
        let of_gaussian = |index: usize| {
            let sh = gaussians.sh(index);
            let change = |i: usize, channel: usize| {
                let value = sh[i][channel];
                if i < kept { f64::from(self.kept(i, value)) - f64::from(value) } else { value.into() }
            };
            (0..3).map(|channel| bands(sh.len(), |i| change(i, channel)).iter().sum()).fold(0.0, f64::max)
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

    /// Device memory in bytes that a Gaussian takes, padding of planes included.
    pub fn bytes_each(&self) -> u64 {
        let planes = plane_widths(self.shape_words()).chain(plane_widths(self.sh_words()));
        4 * (4 + planes.sum::<usize>()) as u64
    }

    /// Words of spherical harmonics that a Gaussian takes.
    pub fn sh_words(&self) -> usize {
        let floats = 3 * sh_coefficients(self.sh_degree);
        match self.sh.storage {
            Storage::Lossless | Storage::F32 => floats,
            Storage::F16 => floats.div_ceil(2),
            Storage::U8 => floats.div_ceil(4),
        }
    }

    /// Words of rotation, scale and opacity that a Gaussian takes.
    pub fn shape_words(&self) -> usize {
        match self.shape.storage {
            Storage::Lossless | Storage::F32 => 8,
            Storage::F16 => 4,
            Storage::U8 => 2,
        }
    }

    /// The words of the spherical harmonics `sh`, of which [`sh_words`](Self::sh_words) are stored.
    pub fn packed_sh(&self, sh: &[[f32; 3]]) -> [u32; MAX_FLOATS] {
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
                let mut halves = [f16::ZERO; MAX_FLOATS.next_multiple_of(2)];
                halves[..floats.len()].convert_from_f32_slice(&finite[..floats.len()]);
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

    /// Word `word` of a rotation, scale and opacity.
    pub fn shape_word(&self, q: [f32; 4], scale: [f32; 3], opacity: f32, word: usize) -> u32 {
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

    /// Scale and opacity after packing and unpacking.
    pub fn kept_shape(&self, scale: [f32; 3], opacity: f32) -> ([f32; 3], f32) {
        let on_grid = |s: f32| self.scale_grid.decode(self.scale_grid.encode(f64::from(s).log2())).exp2();
        match self.shape.storage {
            Storage::Lossless | Storage::F32 => (scale, opacity),
            Storage::F16 => {
                (scale.map(|s| of_scale_code(self.scale_base, scale_code(self.scale_base, s))), half(opacity).to_f32())
            }
            Storage::U8 => (scale.map(on_grid), f32::from(opacity_byte(opacity)) / 255.0),
        }
    }

    /// The grids that 8-bit numbers are unpacked with: of each coefficient, and of the binary logarithms of scales.
    pub fn grids(&self) -> ([Grid; sh_coefficients(MAX_SH_DEGREE)], Grid) {
        (self.sh_grids, self.scale_grid)
    }

    /// 32-bit floats up to this SH degree. Values that do not affect the words are those of no scene.
    pub fn plain(sh_degree: u32) -> Self {
        let plain = Packing { storage: Storage::F32, is_lossless: true };
        let grids = ([Grid::UNUSED; sh_coefficients(MAX_SH_DEGREE)], Grid::UNUSED);
        Self::from_parts((sh_degree, plain, plain), grids, 0, (false, 0.0, false))
    }

    /// A layout with these SH degree, number formats and grids, as [`grids`](Self::grids) returns them.
    pub fn from_parts(
        (sh_degree, sh, shape): (u32, Packing, Packing),
        (sh_grids, scale_grid): ([Grid; sh_coefficients(MAX_SH_DEGREE)], Grid),
        scale_base: u32,
        (has_clamped_alphas, brightest, is_bright): (bool, f64, bool),
    ) -> Self {
        Self { sh_degree, sh, shape, sh_grids, scale_grid, scale_base, has_clamped_alphas, brightest, is_bright }
    }

    /// True if the colours are too bright for 16-bit floats.
    pub fn is_bright(&self) -> bool {
        self.is_bright
    }

    /// True if a Gaussian has the same words in both layouts.
    pub fn has_words_of(&self, other: &Self) -> bool {
        let formats = |layout: &Self| (layout.sh_degree, layout.sh.storage, layout.shape.storage);
        let has_scales = match self.shape.storage {
            Storage::Lossless | Storage::F32 => true,
            Storage::F16 => self.scale_base == other.scale_base,
            Storage::U8 => self.scale_grid == other.scale_grid,
        };
        let has_sh = self.sh.storage != Storage::U8 || self.sh_grids == other.sh_grids;
        formats(self) == formats(other) && has_scales && has_sh
    }

    /// The offset of the 16-bit codes of scales.
    pub fn scale_base(&self) -> u32 {
        self.scale_base
    }

    /// The spherical harmonics in these words, as the shaders unpack them; those above the stored degree are 0.
    ///
    /// # Panics
    /// If there are fewer words than the layout has.
    pub fn unpacked_sh(&self, sh: &[u32]) -> [[f32; 3]; sh_coefficients(MAX_SH_DEGREE)] {
        let mut all = [[0.0; 3]; sh_coefficients(MAX_SH_DEGREE)];
        self.unpack_sh(sh, &mut all);
        all
    }

    /// Unpacks the first of the spherical harmonics in these words; those above the stored degree become 0.
    ///
    /// # Panics
    /// If there are fewer words than the layout has.
    pub fn unpack_sh(&self, words: &[u32], sh: &mut [[f32; 3]]) {
        let (stored, missing) = sh.split_at_mut(sh_coefficients(self.sh_degree).min(sh.len()));
        for (i, float) in stored.as_flattened_mut().iter_mut().enumerate() {
            *float = match self.sh.storage {
                Storage::Lossless | Storage::F32 => f32::from_bits(words[i]),
                Storage::F16 => separated(words[i / 2])[i % 2],
                Storage::U8 => self.sh_grids[i / 3].decode(words[i / 4].to_le_bytes()[i % 4]),
            };
        }
        missing.fill([0.0; 3]);
    }

    /// The rotation, scale and opacity in the words of a shape, as the shaders unpack them.
    ///
    /// # Panics
    /// If there are fewer words than the layout has.
    pub fn unpacked_shape(&self, shape: &[u32]) -> ([f32; 4], [f32; 3], f32) {
        match self.shape.storage {
            Storage::Lossless | Storage::F32 => {
                let float = |i: usize| f32::from_bits(shape[i]);
                (std::array::from_fn(float), std::array::from_fn(|i| float(4 + i)), float(7))
            }
            Storage::F16 => {
                let [[w, x], [y, z]] = [separated(shape[0]), separated(shape[1])];
                let length = [w, x, y, z].iter().map(|v| v * v).sum::<f32>().sqrt();
                let codes = [shape[2] & 0xffff, shape[2] >> 16, shape[3] & 0xffff];
                let scale = codes.map(|code| of_scale_code(self.scale_base, code));
                ([w, x, y, z].map(|v| v / length), scale, separated(shape[3])[1])
            }
            Storage::U8 => {
                let [x, y, z, opacity] = shape[0].to_le_bytes();
                let scale = [x, y, z].map(|number| self.scale_grid.decode(number).exp2());
                (decode_rotation(shape[1]).map(|v| v as f32), scale, f32::from(opacity) / 255.0)
            }
        }
    }
}

/// Most spherical harmonics of a Gaussian, of all channels.
pub const MAX_FLOATS: usize = 3 * sh_coefficients(MAX_SH_DEGREE);

/// An opacity in steps of 1/255, at least one step: nothing that is drawn becomes transparent.
fn opacity_byte(opacity: f32) -> u8 {
    (opacity * 255.0).round().max(1.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::cactus;

    #[test]
    fn unpacking_inverts_packing() {
        let scene = cactus::cactus(500).unwrap().gaussians;
        let statistics = Statistics::of(&scene);
        for storage in [Storage::Lossless, Storage::F16, Storage::U8] {
            let options = Options { sh_storage: storage, shape_storage: storage, ..Options::EXACT };
            let layout = Layout::of(&statistics, &options);
            for index in 0..scene.len() {
                let (q, scale, opacity) = (scene.rotations()[index], scene.scales()[index], scene.opacities()[index]);
                let word = |word| layout.shape_word(q, scale, opacity, word);
                let shape: Vec<u32> = (0..layout.shape_words()).map(word).collect();
                let (rotation, kept_scale, kept_opacity) = layout.unpacked_shape(&shape);
                assert_eq!((kept_scale, kept_opacity), layout.kept_shape(scale, opacity), "{storage}");
                let sh = layout.unpacked_sh(&layout.packed_sh(scene.sh(index)));
                for (i, value) in scene.sh(index).iter().enumerate() {
                    assert_eq!(sh[i], value.map(|v| layout.kept(i, v)), "{storage}");
                }
                let cosine: f32 = rotation.iter().zip(q).map(|(a, b)| a * b).sum();
                assert!(cosine.abs() > 0.99999, "{storage}: {rotation:?}");
                if storage == Storage::Lossless {
                    assert_eq!(rotation, q);
                }
            }
        }
    }
}
