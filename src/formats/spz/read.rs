//! Reads SPZ versions 1, 2, 3 (gzip) and 4 (zstd streams): quantized planes in the axes right, up, back, unless an
//! extension names others. Servers may take off the gzip of versions 1 to 3.

use std::io::{BufReader, Cursor, Read};

use anyhow::{Context, Result, bail, ensure};
use flate2::bufread::GzDecoder;
use glam::{DMat3, DQuat};
use rayon::prelude::*;

use crate::formats::input::{Input, word};
use crate::scene::harmonics::{Turn, flip_sign};
use crate::scene::{
    BLOCK, Builder, MAX_SH_DEGREE, Placer, RIGHT_UP_BACK, Raw, Scene, axis_signs, decode_rotation, logit, rest_values,
    rotation_signs,
};

pub(crate) const MAGIC: u32 = 0x5053_474e; // "NGSP"
/// Factor from a coefficient of degree 0 to the range of a byte.
pub(crate) const COLOUR_SCALE: f64 = 0.15;
/// Bytes that a zstd stream may take beyond twice its content: its headers, of content that cannot be compressed.
const MAX_OVERHEAD: u64 = 1 << 16;
/// Progress when all bytes are read. A gzip stream is decompressed by then, zstd streams are not.
const READ_GZIP: f64 = 0.4;
const READ_V4: f64 = 0.05;
/// Largest accepted compression ratio, as in the reference implementation.
const MAX_RATIO: u64 = 1024;

struct Header {
    version: u32,
    count: usize,
    sh_degree: u32,
    fractional_bits: u32,
    has_extensions: bool,
    is_antialiased: bool,
    unknown_flags: u8,
}

impl Header {
    fn parse(bytes: &[u8; 16], file_bytes: u64) -> Result<Self> {
        let word = |at: usize| word(bytes, at);
        ensure!(word(0) == MAGIC, "the SPZ header does not begin with NGSP");
        let (version, count, sh_degree, fractional_bits) =
            (word(4), word(8), u32::from(bytes[12]), u32::from(bytes[13]));
        ensure!(sh_degree <= MAX_SH_DEGREE, "SH degree {sh_degree} is not supported, only 0 to {MAX_SH_DEGREE}");
        ensure!(fractional_bits < 24, "{fractional_bits} fractional bits do not fit into a 24-bit position");
        let flag = |bit: u8| bytes[14] & bit != 0;
        ensure!(!flag(0x80), "the file is a tree of levels of detail (flag 0x80), which is not supported");
        let (is_antialiased, has_extensions) = (flag(1), flag(2));
        let unknown_flags = bytes[14] & !3;
        let header = Self {
            version,
            count: count as usize,
            sh_degree,
            fractional_bits,
            has_extensions,
            is_antialiased,
            unknown_flags,
        };
        let bytes_each: usize = header.planes().iter().map(|(_, bytes)| bytes).sum();
        let most = file_bytes.saturating_mul(MAX_RATIO) / bytes_each as u64;
        ensure!(
            u64::from(count) <= most,
            "the header claims {count} Gaussians, a file of {file_bytes} bytes holds {most} at most"
        );
        Ok(header)
    }

    /// The planes in file order, with their bytes per Gaussian.
    fn planes(&self) -> Vec<(&'static str, usize)> {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version <= 2 { 3 } else { 4 };
        let sh = rest_values(self.sh_degree);
        let mut planes = vec![
            ("positions", position),
            ("alphas", 1),
            ("colours", 3),
            ("scales", 3),
            ("rotations", rotation),
            ("sh", sh),
        ];
        planes.retain(|(_, bytes)| *bytes > 0);
        planes
    }
}

/// Reads a file of any version.
pub(crate) fn read(input: &mut Input) -> Result<Scene> {
    let file_bytes = input.len();
    match input.peek(8)? {
        begin if !begin.starts_with(&MAGIC.to_le_bytes()) => {
            input.set_read_fraction(READ_GZIP);
            let content = Content::read(GzDecoder::new(&mut *input), file_bytes).context("in the gzip stream")?;
            content.decode(input)
        }
        [_, _, _, _, 1..=3, 0, 0, 0] => {
            input.set_read_fraction(READ_GZIP);
            Content::read(&mut *input, file_bytes)?.decode(input)
        }
        _ => read_v4(input),
    }
}

/// The content of versions 1 to 3: one plane after another.
struct Content {
    header: Header,
    planes: Vec<Cursor<Vec<u8>>>,
    records: Vec<u8>,
    builder: Builder,
}

impl Content {
    /// Reads the content of a file of `file_bytes`.
    fn read(mut stream: impl Read, file_bytes: u64) -> Result<Self> {
        let mut bytes = [0; 16];
        stream.read_exact(&mut bytes).context("it ends inside the SPZ header")?;
        let header = Header::parse(&bytes, file_bytes)?;
        match header.version {
            1..=3 => {}
            other => bail!("SPZ version {other} is not supported there, only 1 to 3"),
        }
        // Without room for the Gaussians nothing is decompressed.
        let builder = Builder::new(header.sh_degree, header.count)?;
        let mut planes = Vec::new();
        for (name, bytes) in header.planes() {
            let wanted = header.count * bytes;
            let mut plane = Vec::new();
            // Grows with the content, so a wrong count costs no memory.
            (&mut stream)
                .take(wanted as u64)
                .read_to_end(&mut plane)
                .with_context(|| format!("the {name} cannot be decompressed"))?;
            ensure!(plane.len() == wanted, "the {name} end after {} of {wanted} bytes", plane.len());
            planes.push(Cursor::new(plane));
        }
        // Reading to the end of the stream verifies its checksum, with or without extensions.
        let mut records = Vec::new();
        stream.take(MAX_EXTENSION_BYTES + 1).read_to_end(&mut records).context("it is damaged")?;
        ensure!(records.len() as u64 <= MAX_EXTENSION_BYTES, "over {MAX_EXTENSION_BYTES} bytes follow the Gaussians");
        Ok(Self { header, planes, records, builder })
    }

    fn decode(self, input: &mut Input) -> Result<Scene> {
        let Self { header, planes, records, builder } = self;
        let extensions = Extensions::parse(if header.has_extensions { &records } else { &[] })?;
        decode(input, &header, &extensions, planes, builder)
    }
}

/// Reads version 4: a plain header, a table of contents, and a zstd stream per plane.
fn read_v4(input: &mut Input) -> Result<Scene> {
    input.set_read_fraction(READ_V4);
    let mut bytes = [0; 32];
    input.fill(&mut bytes, "the SPZ header")?;
    let header = Header::parse(bytes.first_chunk().expect("32 bytes begin with 16"), input.len())?;
    ensure!(header.version == 4, "SPZ version {} is not supported, only 1 to 4", header.version);
    let (streams, toc) = (bytes[15] as usize, u32::from_le_bytes([bytes[16], bytes[17], bytes[18], bytes[19]]));
    let planes = header.planes();
    ensure!(
        streams == planes.len(),
        "SH degree {} has {} streams, the header says {streams}",
        header.sh_degree,
        planes.len()
    );
    // Extension records lie between the header and the table of contents.
    let gap = u64::from(toc).checked_sub(32).context("the table of contents begins inside the header")?;
    ensure!(gap <= input.left(), "the table of contents begins at byte {toc}, past the end of the file");
    ensure!(gap <= MAX_EXTENSION_BYTES, "{gap} bytes of extensions lie before the table of contents");
    let records = input.bytes(gap, "the extensions")?;
    let extensions = Extensions::parse(if header.has_extensions { &records } else { &[] })?;
    let mut sizes = Vec::new();
    for (name, bytes) in &planes {
        let mut entry = [0; 16];
        input.fill(&mut entry, "the table of contents")?;
        let [compressed, plain] = [0, 8].map(|at| u64::from_le_bytes(std::array::from_fn(|i| entry[at + i])));
        let wanted = (header.count * bytes) as u64;
        ensure!(plain == wanted, "{} Gaussians have {wanted} bytes of {name}, the file says {plain}", header.count);
        sizes.push(compressed);
    }
    let builder = Builder::new(header.sh_degree, header.count)?;
    let mut readers = Vec::new();
    for ((name, bytes), size) in planes.iter().zip(sizes) {
        let plain = (header.count * bytes) as u64;
        let most = 2 * plain + MAX_OVERHEAD;
        ensure!(size <= most, "the stream of the {name} takes {size} bytes for {plain}, more than any encoder needs");
        let compressed = input.bytes(size, &format!("the stream of the {name}"))?;
        let decoder =
            zstd::Decoder::new(Cursor::new(compressed)).with_context(|| format!("the {name} are not zstd"))?;
        readers.push(BufReader::with_capacity(1 << 16, decoder));
    }
    decode(input, &header, &extensions, readers, builder)
}

/// Decodes the Gaussians block by block. While one is decoded, the next one is decompressed, all planes in parallel.
fn decode<R: Read + Send>(
    input: &mut Input,
    header: &Header,
    extensions: &Extensions,
    mut planes: Vec<R>,
    mut builder: Builder,
) -> Result<Scene> {
    builder.place(Placer::new(&input.placement()));
    let layout = header.planes();
    let step = 0.5_f64.powi(header.fractional_bits as i32);
    let [mut blocks, mut next] = [(); 2].map(|()| vec![Vec::new(); layout.len()]);
    read_blocks(&mut planes, &mut blocks, header, 0)?;
    for first in (0..header.count).step_by(BLOCK) {
        input.before_block(&builder)?;
        let row = |plane: usize, index: usize| {
            let bytes = layout[plane].1;
            &blocks[plane][index * bytes..][..bytes]
        };
        let (read, ()) = rayon::join(
            || read_blocks(&mut planes, &mut next, header, first + BLOCK),
            || {
                let decode = |index, sh: &mut [_]| {
                    let raw = gaussian(header.version, |plane| row(plane, index), step, extensions.flips, sh);
                    extensions.turn.as_ref().map_or(raw, |turn| upright(raw, sh, turn))
                };
                builder.extend(BLOCK.min(header.count - first), decode);
            },
        );
        read?;
        input.report_decoded((first + BLOCK).min(header.count) as f64 / header.count as f64);
        std::mem::swap(&mut blocks, &mut next);
    }
    for (plane, (name, _)) in planes.iter_mut().zip(&layout) {
        let rest = plane.read(&mut [0]).with_context(|| format!("the {name} are damaged"))?;
        ensure!(rest == 0, "the {name} go on after those of {} Gaussians", header.count);
    }
    let (gaussians, report) = builder.finish();
    Ok(Scene {
        gaussians,
        report,
        format: format!("SPZ {}", header.version),
        is_antialiased: header.is_antialiased,
        notices: notices(header, extensions),
        levels: Vec::new(),
    })
}

/// Decompresses the block of Gaussians from `first` on of every plane.
fn read_blocks<R: Read + Send>(planes: &mut [R], blocks: &mut [Vec<u8>], header: &Header, first: usize) -> Result<()> {
    let count = BLOCK.min(header.count.saturating_sub(first));
    let parts = planes.par_iter_mut().zip(blocks).zip(header.planes());
    parts.try_for_each(|((plane, block), (name, bytes))| {
        block.resize(count * bytes, 0);
        let place = || format!("the {name} of Gaussians {first} to {} of {} are damaged", first + count, header.count);
        plane.read_exact(block).with_context(place)
    })
}

/// One Gaussian from its bytes in each plane.
fn gaussian<'b>(
    version: u32,
    row: impl Fn(usize) -> &'b [u8],
    step: f64,
    flips: [bool; 3],
    sh: &mut [[f32; 3]],
) -> Raw {
    let sign = axis_signs(flips).map(f64::from);
    let (position, colour, scale) = (row(0), row(2), row(3));
    let mean = std::array::from_fn(|axis| {
        if version == 1 {
            return sign[axis] * half::f16::from_le_bytes([position[2 * axis], position[2 * axis + 1]]).to_f64();
        }
        let bits = i32::from_le_bytes([0, position[3 * axis], position[3 * axis + 1], position[3 * axis + 2]]) >> 8;
        sign[axis] * f64::from(bits) * step
    });
    let alpha = f64::from(row(1)[0]) / 255.0;
    sh[0] = std::array::from_fn(|i| ((f64::from(colour[i]) / 255.0 - 0.5) / COLOUR_SCALE) as f32);
    for (i, coefficient) in sh[1..].iter_mut().enumerate() {
        let sign = flip_sign(i + 1, flips);
        *coefficient = std::array::from_fn(|channel| sign * (f32::from(row(5)[3 * i + channel]) - 128.0) / 128.0);
    }
    let stored = if version <= 2 { rotation_first_three(row(4)) } else { unpack_smallest_three(row(4)) };
    let turned = rotation_signs(flips);
    let rotation = std::array::from_fn(|i| f64::from(turned[i]) * stored[i]);
    let log_scale = std::array::from_fn(|i| f64::from(scale[i]) / 16.0 - 10.0);
    Raw { mean, log_scale, rotation, opacity_logit: logit(alpha) }
}

/// Largest size of the extension records.
const MAX_EXTENSION_BYTES: u64 = 1 << 20;
/// Type of the extension that names the axes of the file.
const COORDINATE_SYSTEM: u32 = 0xadbe_0003;
/// Type of the extension with the cameras that a viewer should allow.
const SAFE_ORBIT_CAMERA: u32 = 0xadbe_0002;

/// Largest number of unknown extensions that are named.
const MOST_UNKNOWN: usize = 4;

/// What the extension records state.
struct Extensions {
    /// The axes that must be reversed to get right, down, forward, or before the turn right, forward, up.
    flips: [bool; 3],
    /// The turn of harmonics from right, forward, up to right, down, forward.
    turn: Option<Turn>,
    unknown: Vec<u32>,
}

impl Extensions {
    /// Parses records (type, length, payload).
    fn parse(records: &[u8]) -> Result<Self> {
        let mut found = Self { flips: RIGHT_UP_BACK, turn: None, unknown: Vec::new() };
        let mut rest = records;
        while let Some((head, tail)) = rest.split_first_chunk::<8>() {
            let [kind, bytes] = [0, 4].map(|at| u32::from_le_bytes(std::array::from_fn(|i| head[at + i])));
            let Some((payload, next)) = tail.split_at_checked(bytes as usize) else {
                bail!("an extension claims {bytes} bytes, {} are left", tail.len());
            };
            match kind {
                COORDINATE_SYSTEM => {
                    let system = payload.first_chunk().map(|b| u32::from_le_bytes(*b));
                    found.take_axes(system.context("the coordinate system is missing")?)?;
                }
                SAFE_ORBIT_CAMERA => {}
                other if found.unknown.len() < MOST_UNKNOWN && !found.unknown.contains(&other) => {
                    found.unknown.push(other)
                }
                _ => {}
            }
            rest = next;
        }
        Ok(found)
    }

    /// Takes a coordinate system by its number in SPZ's `splat-types.h`.
    fn take_axes(&mut self, system: u32) -> Result<()> {
        let Some(bits) = system.checked_sub(1) else { return Ok(()) };
        // The first bit is right, the second up.
        let (is_right, is_up, third) = (bits & 1 != 0, bits & 2 != 0, bits & 4 != 0);
        match bits {
            // x, up or down, front (the third bit) or back.
            0..8 => self.flips = [!is_right, is_up, !third],
            // x, front or back (the third bit), up or down.
            8..16 => {
                self.flips = [!is_right, third, !is_up];
                self.turn = Some(Turn::new(DMat3::from_quat(quarter_turn())));
            }
            _ => bail!("coordinate system {system} is unknown, only 0 to 16 are known"),
        }
        Ok(())
    }
}

/// Notes on flags and extensions that may change the picture.
fn notices(header: &Header, extensions: &Extensions) -> Vec<String> {
    let flags = header.unknown_flags;
    let flags = (flags != 0).then(|| format!("its flags {flags:#04x} are unknown and not used"));
    let kinds = extensions.unknown.iter().map(|kind| format!("its extension {kind:#010x} is unknown and not used"));
    flags.into_iter().chain(kinds).collect()
}

/// The rotation from right, forward, up to right, down, forward.
fn quarter_turn() -> DQuat {
    DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)
}

/// A Gaussian in the axes right, forward, up in the axes right, down, forward.
fn upright(raw: Raw, sh: &mut [[f32; 3]], turn: &Turn) -> Raw {
    let ([x, y, z], [w, i, j, k]) = (raw.mean, raw.rotation);
    let q = quarter_turn() * DQuat::from_xyzw(i, j, k, w);
    turn.apply(sh);
    Raw { mean: [x, -z, y], rotation: [q.w, q.x, q.y, q.z], ..raw }
}

/// The rotation of versions 1 and 2: x, y, z as bytes; w is not negative.
fn rotation_first_three(bytes: &[u8]) -> [f64; 4] {
    let [x, y, z] = [0, 1, 2].map(|i| f64::from(bytes[i]) / 127.5 - 1.0);
    [(1.0 - (x * x + y * y + z * z)).max(0.0).sqrt(), x, y, z]
}

/// The rotation of versions 3 and 4: x, y, z, w in the packing of [`encode_rotation`](crate::scene::encode_rotation).
fn unpack_smallest_three(bytes: &[u8]) -> [f64; 4] {
    let [x, y, z, w] = decode_rotation(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
    [w, x, y, z]
}
