//! Pictures as messages: JPEG in strips, on all cores, while the view moves, and PNG without loss at rest.
//!
//! A binary message is a header of 32-bit little-endian words and the bytes of files. The header has the kind (1: JPEG,
//! 2: PNG, 3: PNG that `smalto render` writes), the number of the picture, the number of the last message `input` that
//! it answers, its width and its height in pixels, and two words of its kind. JPEG: these are the reduction of
//! [`Coding`] and the number of strips; for each strip follow its first row, its rows and its bytes, then the files.
//! PNG, in parts: these are the place of the part in the file and the bytes of the file; the part follows.

use anyhow::Result;
use jpeg_encoder::{ColorType, Encoder};
use rayon::prelude::*;

use super::link::Coding;
use crate::pixels::png_of_rgb8;

/// A picture as it is seen: red, green, blue and 255, row by row.
pub struct ShownPicture {
    pub size: [u32; 2],
    pub rgba: Vec<[u8; 4]>,
}

const KIND_JPEG: u32 = 1;
const KIND_PNG: u32 = 2;
const KIND_RENDER: u32 = 3;

/// Rows of a strip are a multiple of this: the blocks of JPEG with halved colours.
const BLOCK: u32 = 16;

/// Bytes of a part of a PNG, after which a newer picture can be sent.
const PART_BYTES: usize = 32 << 10;

/// A strip of a compressed picture.
struct Strip {
    /// In pixels of the whole picture.
    top: u32,
    rows: u32,
    file: Vec<u8>,
}

/// A compressed picture.
pub struct Jpeg {
    numbers: [u32; 2],
    size: [u32; 2],
    coding: Coding,
    strips: Vec<Strip>,
}

impl ShownPicture {
    /// Red, green and blue of these rows, each pixel the mean of a square of `reduction` pixels.
    fn rgb(&self, rows: std::ops::Range<u32>, reduction: u32) -> (u32, u32, Vec<u8>) {
        let width = self.size[0];
        let (columns, lines) = (width.div_ceil(reduction), rows.len() as u32);
        let lines = lines.div_ceil(reduction);
        let mut rgb = Vec::with_capacity(3 * (columns * lines) as usize);
        for line in 0..lines {
            for column in 0..columns {
                let (mut sum, mut count) = ([0u32; 3], 0);
                for y in rows.start + line * reduction..(rows.start + (line + 1) * reduction).min(rows.end) {
                    for x in column * reduction..((column + 1) * reduction).min(width) {
                        let pixel = self.rgba[(y * width + x) as usize];
                        (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
                        count += 1;
                    }
                }
                rgb.extend(sum.map(|sum| ((sum + count / 2) / count) as u8));
            }
        }
        (columns, lines, rgb)
    }

    /// Compresses the picture, each strip on a core of its own. `numbers` are those of the picture and of the input
    /// that it answers.
    ///
    /// # Errors
    /// If JPEG cannot hold pictures of this size.
    pub fn compressed(&self, numbers: [u32; 2], coding: Coding) -> Result<Jpeg> {
        let height = self.size[1];
        let unit = BLOCK * coding.reduction;
        let strips = (rayon::current_num_threads() as u32).clamp(1, 16);
        let rows = height.div_ceil(strips).div_ceil(unit) * unit;
        let tops = Vec::from_iter((0..height).step_by(rows as usize));
        let strip = |top: &u32| {
            let end = (top + rows).min(height);
            let mut file = Vec::new();
            let encoder = Encoder::new(&mut file, coding.quality);
            if coding.reduction == 1 {
                let begin = (top * self.size[0]) as usize..(end * self.size[0]) as usize;
                let bytes = bytemuck::cast_slice(&self.rgba[begin]);
                encoder.encode(bytes, side(self.size[0])?, side(end - top)?, ColorType::Rgba)?;
            } else {
                let (width, lines, rgb) = self.rgb(*top..end, coding.reduction);
                encoder.encode(&rgb, side(width)?, side(lines)?, ColorType::Rgb)?;
            }
            Ok(Strip { top: *top, rows: end - top, file })
        };
        let strips = tops.par_iter().map(strip).collect::<Result<_>>()?;
        Ok(Jpeg { numbers, size: self.size, coding, strips })
    }

    /// The file that `smalto render` writes of these pixels.
    ///
    /// # Errors
    /// If PNG cannot hold pictures of this size.
    pub fn png(&self) -> Result<Vec<u8>> {
        let rgb: Vec<u8> = self.rgba.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
        png_of_rgb8(self.size, &rgb)
    }

    /// The peak signal-to-noise ratio of a compressed picture to this one, in dB: as the web page shows it, with a
    /// compressed pixel for each of its pixels. `None` if no pixel differs.
    ///
    /// # Errors
    /// If a strip cannot be read.
    pub fn loss(&self, jpeg: &Jpeg) -> Result<Option<f64>> {
        let strip = |strip: &Strip| {
            let read = image::load_from_memory_with_format(&strip.file, image::ImageFormat::Jpeg)?.into_rgb8();
            let (width, reduction) = (self.size[0], jpeg.coding.reduction);
            let mut squares = 0u64;
            for y in 0..strip.rows {
                for x in 0..width {
                    let shown = read.get_pixel(x / reduction, y / reduction).0;
                    let own = self.rgba[((strip.top + y) * width + x) as usize];
                    squares += (0..3).map(|c| u64::from(shown[c].abs_diff(own[c])).pow(2)).sum::<u64>();
                }
            }
            Ok(squares)
        };
        let squares: u64 = jpeg.strips.par_iter().map(strip).collect::<Result<Vec<_>>>()?.iter().sum();
        let mse = squares as f64 / (3.0 * f64::from(self.size[0]) * f64::from(self.size[1]));
        Ok((squares > 0).then(|| 10.0 * (255.0 * 255.0 / mse).log10()))
    }
}

fn side(pixels: u32) -> Result<u16> {
    Ok(u16::try_from(pixels)?)
}

fn header(words: &[u32], bytes: usize) -> Vec<u8> {
    let mut message = Vec::with_capacity(4 * words.len() + bytes);
    message.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    message
}

impl Jpeg {
    /// The message of the picture.
    pub fn message(&self) -> Vec<u8> {
        let ([number, answered], [width, height]) = (self.numbers, self.size);
        let strips = self.strips.len() as u32;
        let mut words = vec![KIND_JPEG, number, answered, width, height, self.coding.reduction, strips];
        words.extend(self.strips.iter().flat_map(|strip| [strip.top, strip.rows, strip.file.len() as u32]));
        let mut message = header(&words, self.strips.iter().map(|strip| strip.file.len()).sum());
        self.strips.iter().for_each(|strip| message.extend(&strip.file));
        message
    }
}

/// A PNG that is sent in parts.
pub struct Exact {
    /// Those of the picture and of the input that it answers.
    numbers: [u32; 2],
    size: [u32; 2],
    file: Vec<u8>,
    kind: u32,
    /// The first byte of the next part.
    begin: usize,
}

impl Exact {
    /// `is_of_render`: `smalto render` writes this file.
    pub fn new(numbers: [u32; 2], size: [u32; 2], file: Vec<u8>, is_of_render: bool) -> Self {
        Self { numbers, size, file, kind: if is_of_render { KIND_RENDER } else { KIND_PNG }, begin: 0 }
    }

    /// Number of the picture.
    pub fn number(&self) -> u32 {
        self.numbers[0]
    }
}

impl Iterator for Exact {
    type Item = Vec<u8>;

    /// The message of the next part.
    fn next(&mut self) -> Option<Vec<u8>> {
        let begin = self.begin;
        let part = self.file.get(begin..(begin + PART_BYTES).min(self.file.len())).filter(|part| !part.is_empty())?;
        self.begin += part.len();
        let ([number, answered], [width, height]) = (self.numbers, self.size);
        let words = [self.kind, number, answered, width, height, begin as u32, self.file.len() as u32];
        let mut message = header(&words, part.len());
        message.extend(part);
        Some(message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(size: [u32; 2]) -> ShownPicture {
        let pixel = |i: u32| {
            let (x, y) = (i % size[0], i / size[0]);
            [(x * 2 % 256) as u8, (y * 3 % 256) as u8, ((x + y) / 2 % 256) as u8, 255]
        };
        ShownPicture { size, rgba: (0..size[0] * size[1]).map(pixel).collect() }
    }

    #[test]
    fn better_levels_lose_less() {
        for size in [[1, 1], [17, 33], [200, 131]] {
            let picture = picture(size);
            let loss = |quality, reduction| {
                let jpeg = picture.compressed([7, 9], Coding { quality, reduction }).unwrap();
                let rows: u32 = jpeg.strips.iter().map(|strip| strip.rows).sum();
                assert_eq!(rows, size[1]);
                assert_eq!(jpeg.message()[..12], [1, 0, 0, 0, 7, 0, 0, 0, 9, 0, 0, 0]);
                picture.loss(&jpeg).unwrap().unwrap_or(f64::INFINITY)
            };
            let losses = [loss(95, 1), loss(50, 1), loss(50, 2)];
            assert!(losses[0] > 30.0 && losses.is_sorted_by(|a, b| a >= b), "{size:?} {losses:?}");
        }
    }

    #[test]
    fn parts_of_a_png_make_the_file() {
        let picture = picture([300, 200]);
        let file = picture.png().unwrap();
        let mut joined = Vec::<u8>::new();
        for part in Exact::new([3, 0], picture.size, file.clone(), true) {
            assert_eq!(part[20..24], (joined.len() as u32).to_le_bytes());
            joined.extend_from_slice(&part[28..]);
        }
        assert_eq!(joined, file);
        let read = image::load_from_memory(&file).unwrap().into_rgba8();
        assert_eq!(read.as_raw()[..], *bytemuck::cast_slice::<_, u8>(&picture.rgba));
    }
}
