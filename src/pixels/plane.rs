//! One number a pixel: what there is to know of a picture beside its colours.

use super::Pixels;

/// Row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Width and height.
    pub size: [u32; 2],
    pub values: Vec<f32>,
}

/// How deep a picture is, and of how much it is made. A depth is the view z of a splat's mean, in world units.
#[derive(Clone, Debug, PartialEq)]
pub struct Depths {
    /// The mean depth of what was blended, each splat by its share of the pixel; NaN where nothing was.
    pub expected: Plane,
    /// Of the splat after which the transmittance is 0.5 or less; NaN where it stays above.
    pub median: Plane,
    /// Splats that were blended, a whole number. Behind a transmittance of 1e-12 none is counted.
    pub counts: Plane,
}

impl Plane {
    /// In 8 bits, rounded to the nearest step; 1 is white.
    pub fn to_grey8(&self) -> Vec<u8> {
        self.values.iter().map(|v| super::to_byte(*v)).collect()
    }

    /// The same in 16 bits.
    pub fn to_grey16(&self) -> Vec<u16> {
        self.values.iter().map(|v| super::to_word(*v)).collect()
    }
}

impl Pixels {
    /// How much of each pixel is covered.
    pub fn alpha(&self) -> Plane {
        Plane { size: self.size, values: self.rgba.iter().map(|p| p[3]).collect() }
    }
}
