//! Seeded random numbers, equal on every machine.

use std::f64::consts::TAU;

use glam::{DVec3, dvec3};

/// The SplitMix64 generator (Steele et al. 2014).
pub(crate) struct Random(u64);

impl Random {
    /// The generator of number `index`. Each Gaussian has its own, so that they can be made in any order.
    pub(crate) fn of(index: usize) -> Self {
        let mut seed = Self(0x5eed_cac7 ^ (index as u64) << 20);
        Self(seed.next())
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normally distributed with mean 0 and standard deviation 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (TAU * self.unit()).cos()
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        let (z, angle) = (2.0 * self.unit() - 1.0, TAU * self.unit());
        let r = (1.0 - z * z).sqrt();
        dvec3(r * angle.cos(), r * angle.sin(), z)
    }
}
