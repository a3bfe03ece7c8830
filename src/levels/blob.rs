//! A node as the choice of pairs sees it: a Gaussian density of colours, projected along the three axes.
//!
//! The cost of a merge is the squared difference of the projected densities before and after, summed over the three
//! projections and over red, green, blue and the density itself. Products of Gaussians have closed forms:
//! <a, b> = 2 pi m_a m_b exp(-d^T (S_a + S_b)^-1 d / 2) / sqrt|S_a + S_b| with masses m, covariances S and the distance
//! d of the means.

use std::f32::consts::PI;

use super::node::Node;
use super::raster::exp2;

/// The pairs of axes that a density is projected to.
const PLANES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];
/// Colour channels, and the density itself.
const CHANNELS: usize = 4;

#[derive(Clone, Copy, Debug)]
pub struct Blob {
    pub mean: [f32; 3],
    /// Variances, blurred.
    var: [f32; 3],
    /// Covariances of the axes of each plane.
    cov: [f32; 3],
    /// Opacity times area in each plane.
    mass: [f32; 3],
    colour: [f32; CHANNELS],
    /// The squared norm.
    norm: f32,
}

impl Blob {
    /// `blur`: a variance that is added, the square of a length under which differences do not count.
    pub fn of(node: &Node, colour: [f32; 3], origin: [f32; 3], blur: f32) -> Self {
        let covariance = node.covariance();
        let entry = |i: usize, j: usize| covariance.col(i)[j];
        let opacity = f64::from(node.opacity);
        let mass = PLANES.map(|[u, v]| {
            let area = (entry(u, u) * entry(v, v) - entry(u, v).powi(2)).max(0.0).sqrt();
            (opacity * area).max(1e-30) as f32
        });
        let mut blob = Self {
            mean: [0, 1, 2].map(|i| node.mean[i] - origin[i]),
            var: [0, 1, 2].map(|i| entry(i, i) as f32 + blur),
            cov: PLANES.map(|[u, v]| entry(u, v) as f32),
            mass,
            colour: [colour[0], colour[1], colour[2], 1.0],
            norm: 0.0,
        };
        blob.norm = blob.product(&blob);
        blob
    }

    fn total(&self) -> f32 {
        self.mass.iter().sum()
    }

    /// The inner product of two densities.
    fn product(&self, other: &Self) -> f32 {
        let alike: f32 = (0..CHANNELS).map(|i| self.colour[i] * other.colour[i]).sum();
        let mut sum = 0.0;
        for (plane, [u, v]) in PLANES.into_iter().enumerate() {
            let (a, b) = (self.var[u] + other.var[u], self.cov[plane] + other.cov[plane]);
            let c = self.var[v] + other.var[v];
            let determinant = (a * c - b * b).max(1e-6 * a * c);
            let (x, y) = (self.mean[u] - other.mean[u], self.mean[v] - other.mean[v]);
            let power = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant;
            let density = exp2(-0.5 * std::f32::consts::LOG2_E * power) / determinant.sqrt();
            sum += self.mass[plane] * other.mass[plane] * density;
        }
        2.0 * PI * alike * sum
    }

    /// The node that stands for both.
    #[must_use]
    pub fn merged(&self, other: &Self) -> Self {
        let (a, b) = (self.total(), other.total());
        let (s, t) = (a / (a + b), b / (a + b));
        let apart = [0, 1, 2].map(|i| other.mean[i] - self.mean[i]);
        let mut blob = Self {
            mean: [0, 1, 2].map(|i| self.mean[i] + t * apart[i]),
            var: [0, 1, 2].map(|i| s * self.var[i] + t * other.var[i] + s * t * apart[i] * apart[i]),
            cov: [0, 1, 2].map(|plane| {
                let [u, v] = PLANES[plane];
                s * self.cov[plane] + t * other.cov[plane] + s * t * apart[u] * apart[v]
            }),
            mass: [0, 1, 2].map(|plane| self.mass[plane] + other.mass[plane]),
            colour: [0, 1, 2, 3].map(|i| s * self.colour[i] + t * other.colour[i]),
            norm: 0.0,
        };
        blob.norm = blob.product(&blob);
        blob
    }

    /// The cost of a merge of the two.
    pub fn cost(&self, other: &Self) -> f32 {
        let both = self.merged(other);
        let before = self.norm + other.norm + 2.0 * self.product(other);
        let across = both.product(self) + both.product(other);
        (before + both.norm - 2.0 * across).max(0.0)
    }

    /// A quick guess at which of several others is the cheapest to merge with.
    pub fn distance(&self, other: &Self) -> f32 {
        let apart: f32 = (0..3).map(|i| (self.mean[i] - other.mean[i]).powi(2)).sum();
        let size: f32 = (0..3).map(|i| self.var[i] + other.var[i]).sum();
        let hue: f32 = (0..3).map(|i| (self.colour[i] - other.colour[i]).powi(2)).sum();
        let smaller = self.total().min(other.total());
        (apart / size + hue) * smaller
    }
}
