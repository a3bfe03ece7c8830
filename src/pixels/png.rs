//! PNG files: small ones by the image library, large ones in strips, which all cores compress at the same time.
//!
//! A strip is some rows whose first row is filtered without the row above (`Sub`), so that strips depend on nothing but
//! their rows: the bytes of a file do not depend on the number of threads. fdeflate compresses each strip to a zlib
//! stream of one block. Such blocks become one stream when an empty stored block fills each up to whole bytes, as by
//! a sync flush of zlib (RFC 1951, 3.2.4), and their checksums are joined.

use std::io::Write;

use anyhow::{Context, Result, ensure};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;

use super::compression::Compression;

/// Pictures with at least this many bytes are written in strips.
const STRIPS_FROM: usize = 16 << 20;

/// About the bytes of a strip before compression.
const STRIP_BYTES: usize = 4 << 20;

/// Strips that are compressed before the first of them is written: the memory of their streams is limited.
const STRIPS_AT_ONCE: usize = 64;

/// Writes pixels as PNG. `parts` are the bytes of consecutive rows, each a whole number of rows. Integers of 16 bits
/// have the byte order of this machine.
///
/// # Errors
/// If the file cannot be written, or PNG cannot hold pictures of this size.
pub(super) fn write(
    file: impl Write,
    [width, height]: [u32; 2],
    parts: &[&[u8]],
    kind: ExtendedColorType,
    compression: Compression,
) -> Result<()> {
    let bytes: usize = parts.iter().map(|part| part.len()).sum();
    if compression == Compression::Fast && bytes >= STRIPS_FROM {
        return write_strips(file, [width, height], parts, kind, STRIP_BYTES);
    }
    let quality = match compression {
        Compression::Fast => CompressionType::Fast,
        Compression::Small => CompressionType::Default,
    };
    let encoder = PngEncoder::new_with_quality(file, quality, FilterType::Adaptive);
    match parts {
        [whole] => Ok(encoder.write_image(whole, width, height, kind)?),
        parts => Ok(encoder.write_image(&parts.concat(), width, height, kind)?),
    }
}

fn write_strips(
    file: impl Write,
    [width, height]: [u32; 2],
    parts: &[&[u8]],
    kind: ExtendedColorType,
    strip_bytes: usize,
) -> Result<()> {
    let form = Form::of(kind, width)?;
    let rows: Vec<&[u8]> = parts.iter().flat_map(|part| part.chunks(form.row_bytes)).collect();
    let is_whole = rows.len() == height as usize && rows.iter().all(|row| row.len() == form.row_bytes);
    ensure!(is_whole, "a picture of {width}x{height} needs {height} rows of {} bytes", form.row_bytes);
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(form.colour);
    encoder.set_depth(form.depth);
    let mut writer = encoder.write_header()?;
    let strips = Vec::from_iter(rows.chunks((strip_bytes / form.row_bytes).max(1)));
    let mut checksum = Adler32 { a: 1, b: 0 };
    for (number, group) in strips.chunks(STRIPS_AT_ONCE).enumerate() {
        let streams: Vec<_> = group.par_iter().map(|strip| fdeflate::compress_to_vec(&form.filtered(strip))).collect();
        for (place, (strip, mut stream)) in group.iter().zip(streams).enumerate() {
            let number = number * STRIPS_AT_ONCE + place;
            let own = stream.split_off(stream.len() - 4);
            let is_one_block = stream[ZLIB_HEADER] & 1 == 1 && stream.last().is_some_and(|last| *last != 0);
            ensure!(is_one_block, "fdeflate made another stream than the one block that strips are joined from");
            let own = Adler32::of(own.try_into().expect("a zlib stream ends with four bytes of checksum"));
            checksum = checksum.followed_by(own, strip.len() * (form.row_bytes + 1));
            if number + 1 < strips.len() {
                open_block(&mut stream);
            } else {
                stream.extend(checksum.bytes());
            }
            // Only the first stream keeps the header of zlib.
            let chunk = if number == 0 { &stream } else { &stream[ZLIB_HEADER..] };
            writer.write_chunk(png::chunk::IDAT, chunk)?;
        }
    }
    Ok(writer.finish()?)
}

const ZLIB_HEADER: usize = 2;

/// Makes the only block of a zlib stream without checksum one that others follow, and fills it up to whole bytes.
fn open_block(stream: &mut Vec<u8>) {
    stream[ZLIB_HEADER] &= !1; // the bit of the last block
    // The last bit of fdeflate's code of the end of a block is 1; the bits above it are free.
    let free = stream.last().map_or(0, |last| last.leading_zeros());
    // An empty stored block: three bits 0, zeros up to a whole byte, its length 0 and the complement of that.
    if free < 3 {
        stream.push(0);
    }
    stream.extend([0, 0, 0xff, 0xff]);
}

/// The checksum of zlib: the sums of RFC 1950 modulo 65521.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Adler32 {
    a: u64,
    b: u64,
}

impl Adler32 {
    const MODULUS: u64 = 65521;

    fn of([b1, b0, a1, a0]: [u8; 4]) -> Self {
        Self { a: u16::from_be_bytes([a1, a0]).into(), b: u16::from_be_bytes([b1, b0]).into() }
    }

    /// The checksum of bytes with this checksum and, behind them, `length` bytes with another one.
    fn followed_by(self, next: Self, length: usize) -> Self {
        let length = length as u64 % Self::MODULUS;
        let a = (self.a + next.a + Self::MODULUS - 1) % Self::MODULUS;
        let b = (self.b + next.b + length * (self.a + Self::MODULUS - 1)) % Self::MODULUS;
        Self { a, b }
    }

    fn bytes(self) -> [u8; 4] {
        ((self.b << 16 | self.a) as u32).to_be_bytes()
    }
}

/// What the bytes of rows are.
struct Form {
    colour: png::ColorType,
    depth: png::BitDepth,
    pixel_bytes: usize,
    row_bytes: usize,
}

impl Form {
    fn of(kind: ExtendedColorType, width: u32) -> Result<Self> {
        use png::{BitDepth, ColorType};
        let (colour, depth) = match kind {
            ExtendedColorType::L8 => (ColorType::Grayscale, BitDepth::Eight),
            ExtendedColorType::L16 => (ColorType::Grayscale, BitDepth::Sixteen),
            ExtendedColorType::Rgb8 => (ColorType::Rgb, BitDepth::Eight),
            ExtendedColorType::Rgb16 => (ColorType::Rgb, BitDepth::Sixteen),
            ExtendedColorType::Rgba8 => (ColorType::Rgba, BitDepth::Eight),
            ExtendedColorType::Rgba16 => (ColorType::Rgba, BitDepth::Sixteen),
            other => None.with_context(|| format!("PNG does not hold {other:?}"))?,
        };
        let pixel_bytes = usize::from(kind.bits_per_pixel()) / 8;
        Ok(Self { colour, depth, pixel_bytes, row_bytes: pixel_bytes * width as usize })
    }

    /// The rows of a strip, each behind the number of its filter: the one whose bytes, as numbers with a sign, have the
    /// least sum of magnitudes (the heuristic that the specification of PNG proposes).
    fn filtered(&self, strip: &[&[u8]]) -> Vec<u8> {
        let mut out = Vec::with_capacity(strip.len() * (self.row_bytes + 1));
        let [mut above, mut row] = [(); 2].map(|()| Vec::with_capacity(self.row_bytes));
        let [mut best, mut other] = [(); 2].map(|()| vec![0; self.row_bytes]);
        for (number, bytes) in strip.iter().enumerate() {
            self.ordered(bytes, &mut row);
            let filters = if number == 0 { &FILTERS[1..2] } else { &FILTERS[..] };
            let (mut chosen, mut least) = (0, u64::MAX);
            for (filter, apply) in filters {
                apply(&row, &above, self.pixel_bytes, &mut other);
                let sum = other.chunks(256).map(magnitudes).sum();
                if sum < least {
                    (chosen, least) = (*filter, sum);
                    std::mem::swap(&mut best, &mut other);
                }
            }
            out.push(chosen);
            out.extend_from_slice(&best);
            std::mem::swap(&mut above, &mut row);
        }
        out
    }

    /// The bytes of a row in the order of PNG: integers of 16 bits begin with the upper byte.
    fn ordered(&self, bytes: &[u8], row: &mut Vec<u8>) {
        row.clear();
        row.extend_from_slice(bytes);
        if self.depth == png::BitDepth::Sixteen && cfg!(target_endian = "little") {
            row.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
        }
    }
}

/// The sum of the magnitudes of at most 256 numbers with a sign. In 16 bits, a processor adds many at a time.
fn magnitudes(bytes: &[u8]) -> u64 {
    bytes.iter().map(|byte| u16::from((*byte as i8).unsigned_abs())).sum::<u16>().into()
}

/// Writes the differences of a row to what is expected from its left neighbours and the row above.
type Filter = fn(&[u8], &[u8], usize, &mut [u8]);

/// The filters of PNG with their numbers.
const FILTERS: [(u8, Filter); 5] = [
    (0, |row, _, _, out| out.copy_from_slice(row)),
    (1, |row, _, pixel, out| {
        out[..pixel].copy_from_slice(&row[..pixel]);
        for ((out, byte), left) in out[pixel..].iter_mut().zip(&row[pixel..]).zip(row) {
            *out = byte.wrapping_sub(*left);
        }
    }),
    (2, |row, above, _, out| {
        for ((out, byte), above) in out.iter_mut().zip(row).zip(above) {
            *out = byte.wrapping_sub(*above);
        }
    }),
    (3, |row, above, pixel, out| {
        for i in 0..pixel {
            out[i] = row[i].wrapping_sub(above[i] / 2);
        }
        let left = row.iter().zip(&above[pixel..]);
        for ((out, byte), (left, above)) in out[pixel..].iter_mut().zip(&row[pixel..]).zip(left) {
            *out = byte.wrapping_sub(((u16::from(*left) + u16::from(*above)) / 2) as u8);
        }
    }),
    (4, |row, above, pixel, out| {
        for i in 0..pixel {
            out[i] = row[i].wrapping_sub(above[i]);
        }
        let neighbours = row.iter().zip(&above[pixel..]).zip(above);
        for ((out, byte), ((left, above), corner)) in out[pixel..].iter_mut().zip(&row[pixel..]).zip(neighbours) {
            *out = byte.wrapping_sub(paeth([*left, *above, *corner]));
        }
    }),
];

/// Of the left, the upper and the upper left neighbour the one nearest to left + upper - upper left; of equally near
/// ones the first.
fn paeth([left, above, corner]: [u8; 3]) -> u8 {
    let [a, b, c] = [left, above, corner].map(i16::from);
    let distances = [(b - c).abs(), (a - c).abs(), (a + b - 2 * c).abs()];
    let upper = if distances[1] <= distances[2] { above } else { corner };
    if distances[0] <= distances[1] && distances[0] <= distances[2] { left } else { upper }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::ImageDecoder;
    use image::codecs::png::PngDecoder;

    const KINDS: [ExtendedColorType; 6] = [
        ExtendedColorType::L8,
        ExtendedColorType::L16,
        ExtendedColorType::Rgb8,
        ExtendedColorType::Rgb16,
        ExtendedColorType::Rgba8,
        ExtendedColorType::Rgba16,
    ];

    /// Smooth rows, noise, and rows of one value: every filter is the best of some.
    fn some_bytes(count: usize) -> Vec<u8> {
        let mut state = 1_u32;
        let mut byte = |i: usize| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            match i / 500 % 4 {
                0 => (i / 7) as u8,
                1 => (state >> 24) as u8,
                2 => 17,
                _ => (i % 90 * i % 31) as u8,
            }
        };
        (0..count).map(&mut byte).collect()
    }

    fn decoded(file: &[u8], kind: ExtendedColorType, size: [u32; 2]) -> Vec<u8> {
        let decoder = PngDecoder::new(std::io::Cursor::new(file)).unwrap();
        assert_eq!((decoder.original_color_type(), decoder.dimensions()), (kind, size.into()));
        let mut bytes = vec![0; decoder.total_bytes() as usize];
        decoder.read_image(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn pictures_in_strips_hold_their_pixels() {
        for kind in KINDS {
            for (size, strip_bytes) in
                [([1, 1], 1), ([7, 40], 1), ([7, 40], 100), ([33, 65], 700), ([100, 150], 1 << 20), ([3, 200], 9)]
            {
                let row = usize::from(kind.bits_per_pixel()) / 8 * size[0] as usize;
                let bytes = some_bytes(row * size[1] as usize);
                let (first, rest) = bytes.split_at(row * (size[1] as usize / 3));
                let mut files = [Vec::new(), Vec::new()];
                write_strips(&mut files[0], size, &[&bytes], kind, strip_bytes).unwrap();
                write_strips(&mut files[1], size, &[first, rest], kind, strip_bytes).unwrap();
                assert_eq!(files[0], files[1], "{kind:?} {size:?}: parts change the file");
                assert!(decoded(&files[0], kind, size) == bytes, "{kind:?} {size:?} in strips of {strip_bytes} bytes");
            }
        }
    }

    #[test]
    fn every_number_of_free_bits_behind_a_block_is_filled() {
        let mut seen = [false; 8];
        for length in 1..400 {
            let bytes = some_bytes(length);
            let stream = fdeflate::compress_to_vec(&bytes);
            seen[stream[stream.len() - 5].leading_zeros() as usize] = true;
            let mut file = Vec::new();
            write_strips(&mut file, [1, length as u32], &[&bytes], ExtendedColorType::L8, 1).unwrap();
            assert!(decoded(&file, ExtendedColorType::L8, [1, length as u32]) == bytes, "{length} strips");
        }
        assert_eq!(seen, [true; 8]);
    }

    #[test]
    fn a_picture_without_all_its_rows_is_refused() {
        let write = |size, bytes: usize| {
            write_strips(Vec::new(), size, &[&vec![0; bytes]], ExtendedColorType::Rgb8, 100).map_err(|e| e.to_string())
        };
        assert_eq!(write([4, 5], 60), Ok(()));
        assert_eq!(write([4, 5], 48), Err("a picture of 4x5 needs 5 rows of 12 bytes".to_owned()));
        assert!(write([4, 5], 59).is_err() && write([4, 5], 72).is_err());
    }
}
