//! Test images for the metrics, which other languages can reproduce: they come from an integer hash.

use crate::pixels::Pixels;

pub(super) const SIZE: [u32; 2] = [67, 45];

/// An independent value for every channel of every pixel.
pub(super) fn noise(seed: u32) -> Pixels {
    image(|x, y, channel| value(seed * 65536 + (y * SIZE[0] + x) * 3 + channel))
}

/// Blocks of 8x8 pixels with one random colour each.
pub(super) fn blocks(seed: u32) -> Pixels {
    image(|x, y, channel| value(seed * 65536 + (y / 8 * 256 + x / 8) * 3 + channel))
}

/// The sum of 7/8 of the image and 1/8 of `noise(4)`.
pub(super) fn noisy(pixels: &Pixels) -> Pixels {
    let noise = noise(4);
    image(|x, y, channel| pixels.at(x, y)[channel as usize] * 0.875 + noise.at(x, y)[channel as usize] * 0.125)
}

fn image(value: impl Fn(u32, u32, u32) -> f32) -> Pixels {
    let [width, height] = SIZE;
    let pixel = |i: u32| {
        let (x, y) = (i % width, i / width);
        [value(x, y, 0), value(x, y, 1), value(x, y, 2), 1.0]
    };
    Pixels { size: SIZE, rgba: (0..width * height).map(pixel).collect() }
}

/// A value from 0 (inclusive) to 1 (exclusive): the upper 24 bits of the hash "lowbias32".
fn value(number: u32) -> f32 {
    let mut x = number;
    x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    x ^= x >> 16;
    (x >> 8) as f32 / 16_777_216.0
}
