//! The cost of merging two nodes, each a Gaussian density of colours that is projected along the three axes.
//!
//! The cost of a merge is the squared difference of the projected densities before and after, summed over the three
//! projections and over red, green, blue and the density itself. Products of Gaussians have closed forms:
//! <a, b> = 2 pi m_a m_b exp(-d^T (S_a + S_b)^-1 d / 2) / sqrt|S_a + S_b| with masses m, covariances S and the distance
//! d of the means.

use std::f32::consts::PI;

use super::node::Node;
use super::raster::exp2;

/// The planes that a density is projected to, as pairs of axes.
const PLANES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];
/// Colour channels, and the density itself.
const CHANNELS: usize = 4;
/// A number per plane or per axis, and a fourth that is 0 or harmless: one instruction works on four.
type Lanes = [f32; 4];

/// The projected density of a node.
#[derive(Clone, Copy, Debug)]
pub struct Density {
    mean: Lanes,
    /// Variances, blurred.
    var: Lanes,
    /// Covariances of the axes of each plane.
    cov: Lanes,
    /// Opacity times area in each plane.
    mass: Lanes,
    colour: [f32; CHANNELS],
    /// The squared norm.
    norm: f32,
}

/// A number for each axis, as one for the second axis of each plane.
fn second([x, y, z, w]: Lanes) -> Lanes {
    [y, z, x, w]
}

fn each(f: impl Fn(usize) -> f32) -> Lanes {
    std::array::from_fn(f)
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
        let lanes = |[x, y, z]: [f32; 3], rest: f32| [x, y, z, rest];
        let mut density = Self {
            mean: lanes([0, 1, 2].map(|i| node.mean[i] - origin[i]), 0.0),
            var: lanes([0, 1, 2].map(|i| entry(i, i) as f32 + blur), 1.0),
            cov: lanes(PLANES.map(|[u, v]| entry(u, v) as f32), 0.0),
            mass: lanes(mass, 0.0),
            colour: lanes(colour, 1.0),
            norm: 0.0,
        };
        density.norm = density.squared();
        density
    }

    pub fn mean(&self) -> [f32; 3] {
        [0, 1, 2].map(|i| self.mean[i])
    }

    fn total(&self) -> f32 {
        self.mass.iter().sum()
    }

    /// The inner product of two densities.
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
            colour: each(|i| s * self.colour[i] + t * other.colour[i]),
            norm: 0.0,
        };
        density.norm = density.squared();
        density
    }

    /// The cost of a merge of the two.
    pub fn cost(&self, other: &Self) -> f32 {
        let both = self.merged(other);
        let before = self.norm + other.norm + 2.0 * self.product(other);
        let across = both.product(self) + both.product(other);
        (before + both.norm - 2.0 * across).max(0.0)
    }

    /// A fast estimate of the cost, to order candidates.
    pub fn distance(&self, other: &Self) -> f32 {
        let apart: f32 = (0..3).map(|i| (self.mean[i] - other.mean[i]).powi(2)).sum();
        let size: f32 = (0..3).map(|i| self.var[i] + other.var[i]).sum();
        let hue: f32 = (0..3).map(|i| (self.colour[i] - other.colour[i]).powi(2)).sum();
        let smaller = self.total().min(other.total());
        (apart / size + hue) * smaller
    }
}
