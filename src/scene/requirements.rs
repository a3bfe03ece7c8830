//! Statistics of a scene that decide how a renderer stores it and which errors it may make.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::columns::Columns;
use super::rotation::{SAME, decode_rotation, encode_rotation, rotation_error};
use super::{Gaussians, Grid, MAX_SH_DEGREE, harmonics, sh_coefficients};

/// The SH degrees and colour bounds of a scene, and the attributes that fit into few bits without loss.
#[derive(Clone, Debug, PartialEq)]
pub struct Requirements {
    /// Highest SH degree with a coefficient that is not zero.
    pub sh_degree: u32,
    /// Effect of each SH degree on colours.
    pub bands: [Band; MAX_SH_DEGREE as usize + 1],
    /// Upper bound on a colour channel of any Gaussian from any direction.
    pub brightest: f64,
    /// Grid of each coefficient, if the file held all coefficients in 8 bits.
    pub sh_grids: Option<[Grid; sh_coefficients(MAX_SH_DEGREE)]>,
    /// Grid of the binary logarithms of the scales, if the file held scales and opacities in 8 bits and rotations in
    /// 32, as .spz does.
    pub scale_grid: Option<Grid>,
}

impl Requirements {
    /// The requirements of two scenes together. Grids of 8 bits differ, and are left out.
    pub fn joined(&self, other: &Self) -> Self {
        let band = |i: usize| {
            let (a, b) = (self.bands[i], other.bands[i]);
            Band { bound: a.bound.max(b.bound), rms: a.rms.max(b.rms) }
        };
        Self {
            sh_degree: self.sh_degree.max(other.sh_degree),
            bands: std::array::from_fn(band),
            brightest: self.brightest.max(other.brightest),
            sh_grids: None,
            scale_grid: None,
        }
    }
}

/// The effect of one SH degree on colours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Band {
    /// Upper bound on its part of a channel of any Gaussian from any direction.
    pub bound: f64,
    /// Root mean square of its part of a channel, over Gaussians and directions.
    pub rms: f64,
}

/// Gaussians whose colours are added up one after another: the sum does not depend on threads or blocks.
pub const SUMMED: usize = 1 << 12;

/// Requirements of the colours of some Gaussians.
#[derive(Clone, Copy, Debug, Default)]
pub struct Colours {
    /// The largest bounds, and the sums of the mean squares.
    bands: [Band; MAX_SH_DEGREE as usize + 1],
    brightest: f64,
}

impl Colours {
    /// Adds a Gaussian. Returns the bounds of the degrees of each channel.
    pub fn add(&mut self, sh: &[[f32; 3]]) -> [[f64; MAX_SH_DEGREE as usize + 1]; 3] {
        [0, 1, 2].map(|channel| {
            let (bands, brightest) = of_channel(sh, channel);
            *self = self.and(&Self { bands, brightest });
            bands.map(|band| band.bound)
        })
    }

    /// Both together. The sums are added in this order.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        let both = |l: usize| {
            let (a, b) = (self.bands[l], other.bands[l]);
            Band { bound: a.bound.max(b.bound), rms: a.rms + b.rms }
        };
        Self { bands: std::array::from_fn(both), brightest: self.brightest.max(other.brightest) }
    }

    /// The highest SH degree with a coefficient that is not zero.
    fn sh_degree(&self) -> u32 {
        (0..=MAX_SH_DEGREE).rev().find(|l| self.bands[*l as usize].bound > 0.0).unwrap_or(0)
    }
}

impl Requirements {
    /// Computes the statistics of a scene.
    pub fn of(gaussians: &Gaussians) -> Self {
        let mut values = StoredValues::new(gaussians.len(), gaussians.sh_degree());
        values.add(gaussians);
        let sums: Vec<Colours> = (0..gaussians.len().div_ceil(SUMMED))
            .into_par_iter()
            .map(|part| {
                let mut colours = Colours::default();
                let range = part * SUMMED..gaussians.len().min((part + 1) * SUMMED);
                range.for_each(|index| _ = colours.add(gaussians.sh(index)));
                colours
            })
            .collect();
        let colours = sums.iter().fold(Colours::default(), |sum, part| sum.and(part));
        Self::from_parts(&colours, gaussians.len(), &values)
    }

    /// The requirements of `count` Gaussians with these colours and values.
    pub fn from_parts(colours: &Colours, count: usize, values: &StoredValues) -> Self {
        let sh_degree = colours.sh_degree();
        let rms = |sum: f64| (sum / (3 * count.max(1)) as f64).sqrt();
        Self {
            sh_degree,
            bands: colours.bands.map(|band| Band { rms: rms(band.rms), ..band }),
            brightest: colours.brightest,
            sh_grids: values.sh_grids(sh_degree),
            scale_grid: values.scale_grid(),
        }
    }
}

/// The values of Gaussians that come in blocks, as far as they may be on grids.
#[derive(Clone, Debug)]
pub struct StoredValues {
    sh: Columns<3>,
    scales: Columns<3>,
    /// All opacities and rotations so far may have been in few bits.
    are_few: bool,
}

impl StoredValues {
    /// The values of a scene with `count` Gaussians.
    pub fn new(count: usize, sh_degree: u32) -> Self {
        let sh = Columns::new(count, sh_coefficients(sh_degree));
        Self { sh, scales: Columns::new(count, 1), are_few: true }
    }

    /// Adds the next Gaussians.
    pub fn add(&mut self, gaussians: &Gaussians) {
        self.sh.add(gaussians.len(), |row, i| gaussians.sh(row)[i].map(f64::from));
        self.scales.add(gaussians.len(), |row, _| gaussians.scales()[row].map(|s| f64::from(s).log2()));
        if self.are_few && self.scales.may_have_grids() {
            self.are_few = gaussians.opacities().par_iter().with_min_len(4096).all(is_on_bytes)
                && gaussians.rotations().par_iter().with_min_len(4096).all(is_in_few_bits);
        }
    }

    /// False if the spherical harmonics, or the scales, are on no grid.
    pub fn may_be_on_grids(&self) -> [bool; 2] {
        [self.sh.may_have_grids(), self.scales.may_have_grids() && self.are_few]
    }

    fn sh_grids(&self, degree: u32) -> Option<[Grid; sh_coefficients(MAX_SH_DEGREE)]> {
        let mut grids = [Grid::UNUSED; sh_coefficients(MAX_SH_DEGREE)];
        let coefficients = sh_coefficients(degree);
        grids[..coefficients].copy_from_slice(&self.sh.grids(coefficients)?);
        Some(grids)
    }

    fn scale_grid(&self) -> Option<Grid> {
        self.scales.grids(1).filter(|_| self.are_few).map(|grids| grids[0])
    }
}

fn is_on_bytes(opacity: &f32) -> bool {
    let steps = f64::from(*opacity) * 255.0;
    steps.round() >= 1.0 && (steps - steps.round()).abs() < 1e-4
}

fn is_in_few_bits(rotation: &[f32; 4]) -> bool {
    rotation_error(decode_rotation(encode_rotation(*rotation)), *rotation) < SAME
}

/// For one channel of a Gaussian: per SH degree, the bound and the mean square of its part; and the bound of the
/// channel.
fn of_channel(sh: &[[f32; 3]], channel: usize) -> ([Band; MAX_SH_DEGREE as usize + 1], f64) {
    let bands = bands(sh.len(), |i| sh[i][channel].into());
    let brightest = 0.5 + harmonics::C0 * f64::from(sh[0][channel]) + bands[1..].iter().sum::<f64>();
    // The mean square of a basis function over the directions is 1 / 4 pi.
    (std::array::from_fn(|l| Band { bound: bands[l], rms: bands[l].powi(2) / (2 * l + 1) as f64 }), brightest)
}

/// Upper bound on the part of each SH degree in a channel with these `count` coefficients. By Cauchy-Schwarz it is the
/// length of the coefficients times that of the basis functions, whose squares sum to (2 l + 1) / 4 pi in every
/// direction (the addition theorem).
pub fn bands(count: usize, coefficient: impl Fn(usize) -> f64) -> [f64; MAX_SH_DEGREE as usize + 1] {
    std::array::from_fn(|l| {
        if l * l >= count {
            return 0.0;
        }
        let squares: f64 = (l * l..(l + 1) * (l + 1)).map(|i| coefficient(i).powi(2)).sum();
        (squares * (2 * l + 1) as f64 / (4.0 * PI)).sqrt()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Builder, Raw};

    fn scene(coefficients: &[[f32; 3]], opacity_logit: f64, rotation: [f64; 4]) -> Gaussians {
        let degree = coefficients.len().isqrt() as u32 - 1;
        let mut builder = Builder::new(degree, 1).unwrap();
        builder.extend(1, |_, sh| {
            sh.copy_from_slice(coefficients);
            Raw { mean: [0.0; 3], log_scale: [-1.0, -2.0, -3.0], rotation, opacity_logit }
        });
        builder.finish().0
    }

    /// Upper bound on what spherical harmonics above `degree` add to a channel of any Gaussian.
    fn above(needs: &Requirements, degree: usize) -> f64 {
        needs.bands.iter().skip(degree + 1).map(|band| band.bound).sum()
    }

    #[test]
    fn a_degree_of_zeros_is_not_required() {
        let mut sh = vec![[0.0; 3]; 16];
        sh[0] = [1.0; 3];
        sh[2] = [0.5, 0.0, 0.0];
        let needs = Requirements::of(&scene(&sh, 0.0, [1.0, 0.0, 0.0, 0.0]));
        assert_eq!(needs.sh_degree, 1);
        assert_eq!(above(&needs, 1), 0.0);
        assert!((above(&needs, 0) - 0.5 * 0.4886025119).abs() < 1e-9, "C1 times the coefficient");
    }

    /// Searches for a direction in which the colour exceeds the bound.
    #[test]
    fn no_direction_passes_the_bounds() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1_u64 << 23) as f64 - 1.0
        };
        let mut closest = 0.0_f64;
        for _ in 0..50 {
            let sh: Vec<[f32; 3]> = (0..16).map(|_| [random() as f32; 3]).collect();
            let needs = Requirements::of(&scene(&sh, 0.0, [1.0, 0.0, 0.0, 0.0]));
            for _ in 0..2000 {
                let d = glam::DVec3::new(random(), random(), random()).normalize();
                let basis = harmonics::basis(d.to_array());
                let part =
                    |range: std::ops::Range<usize>| -> f64 { range.map(|i| basis[i] * f64::from(sh[i][0])).sum() };
                for degree in 0..4 {
                    let beyond = part((degree + 1) * (degree + 1)..16).abs();
                    assert!(beyond <= above(&needs, degree) + 1e-12);
                    closest = closest.max(beyond / above(&needs, degree).max(1e-9));
                }
                assert!(0.5 + part(0..16) <= needs.brightest + 1e-12);
            }
        }
        assert!(closest > 0.8, "the bound is not loose: {closest}");
    }

    #[test]
    fn grids_are_found_where_a_file_held_bytes() {
        let opacity = 100.0 / 255.0_f64;
        let logit = (opacity / (1.0 - opacity)).ln();
        let needs = Requirements::of(&scene(&[[0.5, -0.25, 0.125]], logit, [1.0, 0.0, 0.0, 0.0]));
        assert!(needs.sh_grids.is_some() && needs.scale_grid.is_some());
        let needs = Requirements::of(&scene(&[[0.5, -0.25, 0.125]], 0.1234, [1.0, 0.0, 0.0, 0.0]));
        assert!(needs.scale_grid.is_none(), "the opacity is between two steps");
        let needs = Requirements::of(&scene(&[[0.5, -0.25, 0.125]], logit, [0.9, 0.1, 0.3, 0.2]));
        assert!(needs.scale_grid.is_none(), "the rotation is between two steps");
    }
}
