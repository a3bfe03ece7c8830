//! The cost of merging two nodes, each a Gaussian density of colours that is projected along the three axes.
//!
//! The cost of a merge is the squared difference of the projected densities before and after, summed over the three
//! projections and over red, green, blue and the density itself. Products of Gaussians have closed forms:
//! <a, b> = 2 pi m_a m_b exp(-d^T (S_a + S_b)^-1 d / 2) / sqrt|S_a + S_b| with masses m, covariances S and the distance
//! d of the means.

use std::f32::consts::PI;

use bytemuck::{Pod, Zeroable};
use multiversion::multiversion;

use super::node::Node;
use super::raster::{LANES, exp2};

/// The planes that a density is projected to, as pairs of axes.
const PLANES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];
/// Colour channels, and the density itself.
const CHANNELS: usize = 4;
/// A number for each plane or axis.
type Each = [f32; 3];

/// The projected density of a node.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Density {
    mean: Each,
    /// Variances, blurred.
    var: Each,
    /// Covariances of the axes of each plane.
    cov: Each,
    /// Opacity times area in each plane.
    mass: Each,
    colour: [f32; CHANNELS],
    /// The squared norm.
    norm: f32,
}

/// A number for each axis, as one for the second axis of each plane.
fn second([x, y, z]: Each) -> Each {
    [y, z, x]
}

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Each {
    [f(0), f(1), f(2)]
}

/// Numbers of a density.
const NUMBERS: usize = size_of::<Density>() / size_of::<f32>();
/// A number of each of [`LANES`] densities, for instructions that work on all of them.
type Lanes = [[f32; LANES]; NUMBERS];

/// One of several densities.
#[inline(always)]
fn lane(numbers: &Lanes, i: usize) -> Density {
    let mut one = [0.0; NUMBERS];
    for k in 0..NUMBERS {
        one[k] = numbers[k][i];
    }
    bytemuck::cast(one)
}

/// The costs of merges of a density with each of several. All versions make the same bits.
#[multiversion(targets("x86_64+avx2"))]
pub fn costs(own: &Density, others: &[&Density; LANES]) -> [f32; LANES] {
    let (mut numbers, mut costs) = ([[0.0_f32; LANES]; NUMBERS], [0.0; LANES]);
    for (i, other) in others.iter().enumerate() {
        let other: &[f32; NUMBERS] = bytemuck::cast_ref(*other);
        for k in 0..NUMBERS {
            numbers[k][i] = other[k];
        }
    }
    for (i, cost) in costs.iter_mut().enumerate() {
        *cost = own.cost(&lane(&numbers, i));
    }
    costs
}

/// Densities in an order, with each of their numbers in a row of its own.
pub struct Table {
    /// Row after row.
    numbers: Vec<f32>,
    count: usize,
    /// Numbers of a row, with zeros after the last density.
    row: usize,
}

impl Table {
    pub fn new<'a>(densities: impl ExactSizeIterator<Item = &'a Density>) -> Self {
        let count = densities.len();
        let row = count + LANES;
        let mut numbers = vec![0.0; NUMBERS * row];
        for (i, density) in densities.enumerate() {
            let one: &[f32; NUMBERS] = bytemuck::cast_ref(density);
            (0..NUMBERS).for_each(|k| numbers[k * row + i] = one[k]);
        }
        Self { numbers, count, row }
    }

    /// The distance of each density to the one `offset` places after it, for all that have one.
    pub fn distances(&self, offset: usize, distances: &mut Vec<f32>) {
        let wanted = self.count.saturating_sub(offset);
        distances.resize(wanted.next_multiple_of(LANES), 0.0);
        fill_distances(&self.numbers, self.row, offset, distances);
        distances.truncate(wanted);
    }
}

/// All versions make the same bits.
#[multiversion(targets("x86_64+avx2"))]
fn fill_distances(numbers: &[f32], row: usize, offset: usize, distances: &mut [f32]) {
    for (block, distances) in distances.chunks_exact_mut(LANES).enumerate() {
        let (mut own, mut others) = ([[0.0_f32; LANES]; NUMBERS], [[0.0_f32; LANES]; NUMBERS]);
        for k in 0..NUMBERS {
            let at = k * row + block * LANES;
            own[k].copy_from_slice(&numbers[at..at + LANES]);
            others[k].copy_from_slice(&numbers[at + offset..at + offset + LANES]);
        }
        for (i, distance) in distances.iter_mut().enumerate() {
            *distance = lane(&own, i).distance(&lane(&others, i));
        }
    }
}

impl Density {
    /// `blur`: a variance that is added; shorter differences than its root do not count.
    pub fn of(node: &Node, colour: [f32; 3], origin: [f32; 3], blur: f32) -> Self {
        let covariance = node.covariance();
        let entry = |i: usize, j: usize| covariance.col(i)[j];
        let opacity = f64::from(node.opacity);
        let mass = PLANES.map(|[u, v]| {
            let area = (entry(u, u) * entry(v, v) - entry(u, v).powi(2)).max(0.0).sqrt();
            (opacity * area).max(1e-30) as f32
        });
        let mut density = Self {
            mean: each(|i| node.mean[i] - origin[i]),
            var: each(|i| entry(i, i) as f32 + blur),
            cov: PLANES.map(|[u, v]| entry(u, v) as f32),
            mass,
            colour: [colour[0], colour[1], colour[2], 1.0],
            norm: 0.0,
        };
        density.norm = density.squared();
        density
    }

    pub fn mean(&self) -> [f32; 3] {
        self.mean
    }

    #[inline(always)]
    fn total(&self) -> f32 {
        self.mass.iter().sum()
    }

    /// The inner product of two densities.
    #[inline(always)]
    fn product(&self, other: &Self) -> f32 {
        let alike: f32 = (0..CHANNELS).map(|i| self.colour[i] * other.colour[i]).sum();
        let a = each(|i| self.var[i] + other.var[i]);
        let x = each(|i| self.mean[i] - other.mean[i]);
        let (c, y) = (second(a), second(x));
        let b = each(|i| self.cov[i] + other.cov[i]);
        let determinant = each(|i| (a[i] * c[i] - b[i] * b[i]).max(1e-6 * a[i] * c[i]));
        let power = each(|i| (c[i] * x[i] * x[i] - 2.0 * b[i] * x[i] * y[i] + a[i] * y[i] * y[i]) / determinant[i]);
        let density = each(|i| exp2(-0.5 * std::f32::consts::LOG2_E * power[i]) / determinant[i].sqrt());
        let sum: f32 = each(|i| self.mass[i] * other.mass[i] * density[i]).iter().sum();
        2.0 * PI * alike * sum
    }

    /// The product of a density with itself.
    #[inline(always)]
    fn squared(&self) -> f32 {
        let alike: f32 = self.colour.iter().map(|colour| colour * colour).sum();
        let (a, b) = (each(|i| 2.0 * self.var[i]), each(|i| 2.0 * self.cov[i]));
        let c = second(a);
        let determinant = each(|i| (a[i] * c[i] - b[i] * b[i]).max(1e-6 * a[i] * c[i]));
        let sum: f32 = each(|i| self.mass[i] * self.mass[i] / determinant[i].sqrt()).iter().sum();
        2.0 * PI * alike * sum
    }

    /// The density of the parent of both.
    #[must_use]
    #[inline(always)]
    pub fn merged(&self, other: &Self) -> Self {
        let (a, b) = (self.total(), other.total());
        let (s, t) = (a / (a + b), b / (a + b));
        let apart = each(|i| other.mean[i] - self.mean[i]);
        let across = second(apart);
        let mut density = Self {
            mean: each(|i| self.mean[i] + t * apart[i]),
            var: each(|i| s * self.var[i] + t * other.var[i] + s * t * apart[i] * apart[i]),
            cov: each(|i| s * self.cov[i] + t * other.cov[i] + s * t * apart[i] * across[i]),
            mass: each(|i| self.mass[i] + other.mass[i]),
            colour: std::array::from_fn(|i| s * self.colour[i] + t * other.colour[i]),
            norm: 0.0,
        };
        density.norm = density.squared();
        density
    }

    /// The cost of a merge of the two.
    #[inline(always)]
    fn cost(&self, other: &Self) -> f32 {
        let both = self.merged(other);
        let before = self.norm + other.norm + 2.0 * self.product(other);
        let across = both.product(self) + both.product(other);
        (before + both.norm - 2.0 * across).max(0.0)
    }

    /// A fast estimate of the cost, to order candidates.
    #[inline(always)]
    pub fn distance(&self, other: &Self) -> f32 {
        let apart: f32 = (0..3).map(|i| (self.mean[i] - other.mean[i]).powi(2)).sum();
        let size: f32 = (0..3).map(|i| self.var[i] + other.var[i]).sum();
        let hue: f32 = (0..3).map(|i| (self.colour[i] - other.colour[i]).powi(2)).sum();
        let smaller = self.total().min(other.total());
        (apart / size + hue) * smaller
    }
}
