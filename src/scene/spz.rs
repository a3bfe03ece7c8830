//! SPZ versions 2, 3 (gzip) and 4 (zstd streams): quantized planes, axes right, up, back.

use std::io::{BufReader, Read};

use anyhow::{Context, Result, bail, ensure};
use flate2::bufread::GzDecoder;
use rayon::prelude::*;

use super::canonical::{BLOCK, Builder, Raw};
use super::source::Source;
use super::{MAX_SH_DEGREE, Scene, sh_coefficients};

const MAGIC: u32 = 0x5053_474e; // "NGSP"
/// Most Gaussians per compressed byte that is believed: the reference implementation's cap on the compression ratio.
const MAX_RATIO: u64 = 1024;
/// Bytes of a Gaussian without rotation, scale, colour and opacity: no honest file has fewer before compression.
const MIN_BYTES: u64 = 9;

struct Header {
    version: u32,
    count: usize,
    sh_degree: u32,
    fractional_bits: u32,
}

impl Header {
    fn parse(bytes: &[u8; 16], file_bytes: u64) -> Result<Self> {
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        ensure!(word(0) == MAGIC, "the SPZ header does not begin with NGSP");
        let (version, count, sh_degree, fractional_bits) = (word(4), word(8), u32::from(bytes[12]), u32::from(bytes[13]));
        ensure!(sh_degree <= MAX_SH_DEGREE, "SH degree {sh_degree} is not supported, only 0 to {MAX_SH_DEGREE}");
        ensure!(fractional_bits < 24, "{fractional_bits} fractional bits do not fit into a 24-bit position");
        let most = file_bytes.saturating_mul(MAX_RATIO) / MIN_BYTES;
        ensure!(u64::from(count) <= most, "the header claims {count} Gaussians, a file of {file_bytes} bytes holds {most} at most");
        Ok(Self { version, count: count as usize, sh_degree, fractional_bits })
    }

    /// The planes in file order, with the bytes that one Gaussian has in each.
    fn planes(&self) -> Vec<(&'static str, usize)> {
        let rotation = if self.version == 2 { 3 } else { 4 };
        let sh = 3 * (sh_coefficients(self.sh_degree) - 1);
        let mut planes = vec![("positions", 9), ("alphas", 1), ("colours", 3), ("scales", 3), ("rotations", rotation), ("sh", sh)];
        planes.retain(|(_, bytes)| *bytes > 0);
        planes
    }
}

/// A gzip stream with all planes one after another.
pub(super) fn read_gzip(source: &mut Source) -> Result<Scene> {
    let file_bytes = source.len();
    let mut stream = GzDecoder::new(source);
    let mut bytes = [0; 16];
    stream.read_exact(&mut bytes).context("the gzip stream ends inside the SPZ header")?;
    let header = Header::parse(&bytes, file_bytes)?;
    match header.version {
        2 | 3 => {}
        1 => bail!("SPZ version 1 is not supported; no released encoder wrote it"),
        other => bail!("SPZ version {other} is not supported in a gzip stream, only 2 and 3"),
    }
    let mut planes = Vec::new();
    for (name, bytes) in header.planes() {
        let wanted = header.count * bytes;
        let mut plane = Vec::new();
        // Grows with what is there, so a lying header costs nothing.
        (&mut stream).take(wanted as u64).read_to_end(&mut plane).with_context(|| format!("the {name} cannot be decompressed"))?;
        ensure!(plane.len() == wanted, "the {name} end after {} of {wanted} bytes", plane.len());
        planes.push(std::io::Cursor::new(plane));
    }
    decode(&header, planes)
}

/// A plain header, a table of contents, and a zstd stream per plane.
pub(super) fn read_v4(source: &mut Source) -> Result<Scene> {
    let mut bytes = [0; 32];
    source.fill(&mut bytes, "the SPZ header")?;
    let header = Header::parse(bytes.first_chunk().expect("32 bytes begin with 16"), source.len())?;
    ensure!(header.version == 4, "SPZ version {} is not supported, only 2, 3 and 4", header.version);
    let (streams, toc) = (bytes[15] as usize, u32::from_le_bytes([bytes[16], bytes[17], bytes[18], bytes[19]]));
    let planes = header.planes();
    ensure!(streams == planes.len(), "SH degree {} has {} streams, the header says {streams}", header.sh_degree, planes.len());
    // Extension records lie between the header and the table of contents; none changes the picture.
    let gap = u64::from(toc).checked_sub(32).context("the table of contents begins inside the header")?;
    ensure!(gap <= source.left(), "the table of contents begins at byte {toc}, past the end of the file");
    std::io::copy(&mut source.take(gap), &mut std::io::sink())?;
    let mut sizes = Vec::new();
    for (name, bytes) in &planes {
        let mut entry = [0; 16];
        source.fill(&mut entry, "the table of contents")?;
        let [compressed, plain] = [0, 8].map(|at| u64::from_le_bytes(std::array::from_fn(|i| entry[at + i])));
        let wanted = (header.count * bytes) as u64;
        ensure!(plain == wanted, "{} Gaussians have {wanted} bytes of {name}, the file says {plain}", header.count);
        sizes.push(compressed);
    }
    let mut readers = Vec::new();
    for ((name, _), size) in planes.iter().zip(sizes) {
        ensure!(size <= source.left(), "the {name} take {size} bytes, the file has {} left", source.left());
        let mut compressed = vec![0; usize::try_from(size)?];
        source.fill(&mut compressed, name)?;
        let decoder = zstd::Decoder::new(std::io::Cursor::new(compressed)).with_context(|| format!("the {name} are not zstd"))?;
        readers.push(BufReader::with_capacity(1 << 16, decoder));
    }
    decode(&header, readers)
}

/// Reads block after block from all planes at once.
fn decode<R: Read + Send>(header: &Header, mut planes: Vec<R>) -> Result<Scene> {
    let layout = header.planes();
    // The header was checked against the file, but a bomb may still claim a thousand times what it holds.
    let mut builder = Builder::new(header.sh_degree, header.count.min(1 << 24));
    let mut blocks: Vec<Vec<u8>> = vec![Vec::new(); layout.len()];
    let step = 0.5_f64.powi(header.fractional_bits as i32);
    for first in (0..header.count).step_by(BLOCK) {
        let count = BLOCK.min(header.count - first);
        let parts = planes.par_iter_mut().zip(&mut blocks).zip(&layout);
        parts.try_for_each(|((plane, block), (name, bytes))| {
            block.resize(count * bytes, 0);
            let place = || format!("the {name} of Gaussians {first} to {} of {}", first + count, header.count);
            plane.read_exact(block).with_context(place)
        })?;
        builder.extend(count, |index, sh| gaussian(header.version, &layout, &blocks, index, step, sh));
    }
    let (gaussians, tally) = builder.finish();
    Ok(Scene { gaussians, tally, format: format!("SPZ {}", header.version) })
}

fn gaussian(version: u32, layout: &[(&str, usize)], blocks: &[Vec<u8>], index: usize, step: f64, sh: &mut [[f32; 3]]) -> Raw {
    let row = |plane: usize| {
        let bytes = layout[plane].1;
        &blocks[plane][index * bytes..][..bytes]
    };
    let (position, colour, scale) = (row(0), row(2), row(3));
    let [x, y, z] = [0, 3, 6].map(|at| {
        let bits = i32::from_le_bytes([0, position[at], position[at + 1], position[at + 2]]) >> 8;
        f64::from(bits) * step
    });
    let alpha = f64::from(row(1)[0]) / 255.0;
    sh[0] = std::array::from_fn(|i| ((f64::from(colour[i]) / 255.0 - 0.5) / 0.15) as f32);
    for (i, coefficient) in sh[1..].iter_mut().enumerate() {
        *coefficient = std::array::from_fn(|channel| SH_SIGN[i] * (f32::from(row(5)[3 * i + channel]) - 128.0) / 128.0);
    }
    let [w, qx, qy, qz] = if version == 2 { rotation_first_three(row(4)) } else { rotation_smallest_three(row(4)) };
    // Right, up, back to right, down, forward.
    Raw {
        mean: [x, -y, -z],
        log_scale: std::array::from_fn(|i| f64::from(scale[i]) / 16.0 - 10.0),
        rotation: [w, qx, -qy, -qz],
        opacity_logit: (alpha / (1.0 - alpha)).ln(),
    }
}

/// Signs of the basis functions past the first when y and z change sign: the parity of each in y z.
const SH_SIGN: [f32; 15] = [
    -1.0, -1.0, 1.0, // y, z, x
    -1.0, 1.0, 1.0, -1.0, 1.0, // xy, yz, zz, xz, xx - yy
    -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0, // y(xx), xyz, y(zz), z(zz), x(zz), z(xx - yy), x(xx)
];

/// Version 2: x, y, z as bytes, w not negative.
fn rotation_first_three(bytes: &[u8]) -> [f64; 4] {
    let [x, y, z] = [0, 1, 2].map(|i| f64::from(bytes[i]) / 127.5 - 1.0);
    [(1.0 - (x * x + y * y + z * z)).max(0.0).sqrt(), x, y, z]
}

/// Versions 3 and 4: two bits for the largest of x y z w, which is positive, then sign and nine bits for each other.
fn rotation_smallest_three(bytes: &[u8]) -> [f64; 4] {
    let packed = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let largest = (packed >> 30) as usize;
    let mut shifts = [20, 10, 0].into_iter();
    let mut q = [0.0; 4];
    for (i, component) in q.iter_mut().enumerate() {
        if i != largest {
            let bits = packed >> shifts.next().unwrap_or(0) & 1023;
            let magnitude = f64::from(bits & 511) / 511.0 * 0.5_f64.sqrt();
            *component = if bits & 512 != 0 { -magnitude } else { magnitude };
        }
    }
    q[largest] = (1.0 - q.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    let [x, y, z, w] = q;
    [w, x, y, z]
}
