//! An image in memory, and the files that hold one.

mod read;
mod write;

pub use write::{FileKind, write_rgba8};

/// Row by row from the top left, four floats a pixel: colour over the background as displayed (no transfer function
/// is applied, as in the original 3DGS), and coverage 1 - T. Over nothing, colour is premultiplied by coverage.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Width and height.
    pub size: [u32; 2],
    pub rgba: Vec<[f32; 4]>,
}

impl Pixels {
    /// The largest colour value of any pixel, 0 at least.
    pub fn largest(&self) -> f32 {
        self.rgba.iter().flat_map(|p| &p[..3]).fold(0.0, |largest: f32, v| largest.max(*v))
    }

    /// Pixel (x, y).
    pub fn at(&self, x: u32, y: u32) -> [f32; 4] {
        self.rgba[y as usize * self.size[0] as usize + x as usize]
    }

    /// Red, green, blue in 8 bits, rounded to the nearest step.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.rgba.iter().flat_map(|p| [to_byte(p[0]), to_byte(p[1]), to_byte(p[2])]).collect()
    }

    /// Red, green, blue and alpha in 8 bits, alpha not multiplied in, as PNG wants it.
    pub fn to_rgba8(&self) -> Vec<u8> {
        let straight = |p: &[f32; 4]| {
            let [r, g, b, a] = *p;
            let scale = if a > 0.0 { 1.0 / a } else { 0.0 };
            [to_byte(r * scale), to_byte(g * scale), to_byte(b * scale), to_byte(a)]
        };
        self.rgba.iter().flat_map(straight).collect()
    }
}

/// A value in 8 bits, rounded to the nearest step.
pub(crate) fn to_byte(value: f32) -> u8 {
    // The cast saturates, and turns NaN into 0.
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_round_to_the_nearest_step_and_clamp() {
        let pixels = Pixels { size: [2, 1], rgba: vec![[0.5, -1.0, 2.0, 1.0], [f32::NAN, 0.0019, 0.0020, 1.0]] };
        assert_eq!(pixels.to_rgb8(), [128, 0, 255, 0, 0, 1]);
    }

    #[test]
    fn pixels_without_background_are_written_with_straight_alpha() {
        let pixels = Pixels { size: [2, 1], rgba: vec![[0.25, 0.5, 0.0, 0.5], [0.0; 4]] };
        assert_eq!(pixels.to_rgba8(), [128, 255, 0, 128, 0, 0, 0, 0]);
    }
}
