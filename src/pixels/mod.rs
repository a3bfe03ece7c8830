//! Images in memory and in files.
//!
//! - `plane` - images of one number per pixel: depth, splat counts, coverage
//! - `read` - reads images from files
//! - `write` - writes images to files
//! - `compression` - how hard files are compressed
//! - `png` - PNG files, large ones by all cores
//! - `video` - videos, made by the installed ffmpeg

mod compression;
mod plane;
mod png;
mod read;
mod video;
mod write;

pub use compression::Compression;
pub use plane::{Depths, Plane};
pub use read::{Channels, Picture};
pub(crate) use video::{VIDEO_KINDS, Video, has_ffmpeg, is_video, plain_for_ffmpeg, video_padding};
pub use write::{Alpha, FileKind, Integers, png_of_rgb8, write_rgba8};

/// An image of four floats per pixel, row by row from the top left: colour over the background as displayed (no
/// transfer function is applied, as in the original 3DGS), and coverage 1 - T. Without a background, colour is
/// premultiplied by coverage.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Width and height.
    pub size: [u32; 2],
    /// Red, green, blue and coverage; `size[0] * size[1]` pixels.
    pub rgba: Vec<[f32; 4]>,
}

impl Pixels {
    /// The largest colour value of any pixel, at least 0.
    pub fn largest(&self) -> f32 {
        self.rgba.iter().flat_map(|p| &p[..3]).fold(0.0, |largest: f32, v| largest.max(*v))
    }

    /// Pixel (x, y).
    ///
    /// # Panics
    /// If `y` is not below the height.
    pub fn at(&self, x: u32, y: u32) -> [f32; 4] {
        self.rgba[y as usize * self.size[0] as usize + x as usize]
    }

    /// The image with the mean of each square of `side` by `side` pixels as one pixel.
    ///
    /// # Panics
    /// If `side` is 0 or does not divide width and height.
    #[must_use]
    pub fn averaged(&self, side: u32) -> Self {
        let [width, height] = self.size;
        assert!(width % side == 0 && height % side == 0, "squares of {side} pixels fill {width}x{height}");
        let mut rgba = vec![[0.0; 4]; (width / side * (height / side)) as usize];
        let weight = 1.0 / (side * side) as f32;
        for (i, pixel) in self.rgba.iter().enumerate() {
            let (x, y) = (i as u32 % width / side, i as u32 / width / side);
            let mean: &mut [f32; 4] = &mut rgba[(y * (width / side) + x) as usize];
            (0..4).for_each(|c| mean[c] += weight * pixel[c]);
        }
        Self { size: [width / side, height / side], rgba }
    }

    /// Red, green, blue in 8 bits, rounded to the nearest step.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.opaque().map(to_byte).collect()
    }

    /// Red, green, blue in 16 bits, rounded to the nearest step.
    pub fn to_rgb16(&self) -> Vec<u16> {
        self.opaque().map(to_word).collect()
    }

    /// Red, green, blue and alpha in 8 bits with straight (not premultiplied) alpha, as PNG requires.
    pub fn to_rgba8(&self) -> Vec<u8> {
        self.straight().map(to_byte).collect()
    }

    /// Red, green, blue and alpha in 16 bits with straight alpha.
    pub fn to_rgba16(&self) -> Vec<u16> {
        self.straight().map(to_word).collect()
    }

    fn opaque(&self) -> impl Iterator<Item = f32> {
        self.rgba.iter().flat_map(|[r, g, b, _]| [*r, *g, *b])
    }

    fn straight(&self) -> impl Iterator<Item = f32> {
        self.rgba.iter().flat_map(|[r, g, b, a]| {
            let scale = if *a > 0.0 { 1.0 / a } else { 0.0 };
            [r * scale, g * scale, b * scale, *a]
        })
    }
}

/// A value from 0 to 1 in 8 bits, clamped and rounded to the nearest step.
pub(crate) fn to_byte(value: f32) -> u8 {
    // The cast saturates, and turns NaN into 0.
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A value from 0 to 1 in 16 bits, clamped and rounded to the nearest step.
fn to_word(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65535.0).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_round_to_the_nearest_step_and_clamp() {
        let pixels = Pixels { size: [2, 1], rgba: vec![[0.5, -1.0, 2.0, 1.0], [f32::NAN, 0.0019, 0.0020, 1.0]] };
        assert_eq!(pixels.to_rgb8(), [128, 0, 255, 0, 0, 1]);
        assert_eq!(pixels.to_rgb16(), [32768, 0, 65535, 0, 125, 131]);
    }

    #[test]
    fn squares_of_pixels_become_their_mean() {
        let rgba = (0..16).map(|i| [i as f32, 0.0, 1.0, i as f32 / 4.0]).collect();
        let small = Pixels { size: [8, 2], rgba }.averaged(2);
        let means = [4.5, 6.5, 8.5, 10.5].map(|mean| [mean, 0.0, 1.0, mean / 4.0]);
        assert_eq!(small, Pixels { size: [4, 1], rgba: means.to_vec() });
    }

    #[test]
    fn pixels_without_background_are_written_with_straight_alpha() {
        let pixels = Pixels { size: [2, 1], rgba: vec![[0.25, 0.5, 0.0, 0.5], [0.0; 4]] };
        assert_eq!(pixels.to_rgba8(), [128, 255, 0, 128, 0, 0, 0, 0]);
        assert_eq!(pixels.to_rgba16(), [32768, 65535, 0, 32768, 0, 0, 0, 0]);
        assert_eq!(pixels.alpha().to_grey8(), [128, 0]);
        assert_eq!(pixels.alpha().to_grey16(), [32768, 0]);
    }
}
