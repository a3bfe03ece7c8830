//! Images of one number per pixel: depth, splat counts, coverage.

use super::Pixels;

/// An image of one float per pixel, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Width and height.
    pub size: [u32; 2],
    /// `size[0] * size[1]` values.
    pub values: Vec<f32>,
}

/// Depths and splat counts of a picture. A depth is the view z of a splat's mean, in world units.
#[derive(Clone, Debug, PartialEq)]
pub struct Depths {
    /// Mean depth of the blended splats, weighted by their share of the pixel; NaN where there is none.
    pub expected: Plane,
    /// Depth of the splat after which the transmittance is 0.5 or less; NaN where it stays above.
    pub median: Plane,
    /// Number of blended splats, a whole number. Splats behind a transmittance of 1e-12 are not counted.
    pub counts: Plane,
}

impl Plane {
    /// Values from 0 to 1 in 8 bits, clamped and rounded to the nearest step; 1 is white.
    pub fn to_grey8(&self) -> Vec<u8> {
        self.values.iter().map(|v| super::to_byte(*v)).collect()
    }

    /// Values from 0 to 1 in 16 bits, clamped and rounded to the nearest step; 1 is white.
    pub fn to_grey16(&self) -> Vec<u16> {
        self.values.iter().map(|v| super::to_word(*v)).collect()
    }
}

impl Pixels {
    /// Coverage of each pixel, 0 to 1.
    pub fn alpha(&self) -> Plane {
        Plane { size: self.size, values: self.rgba.iter().map(|p| p[3]).collect() }
    }
}
