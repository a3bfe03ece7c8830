//! Reads `.ksplat` of GaussianSplats3D: sections of Gaussians at one of three compression levels. Positions of levels 1
//! and 2 are relative to buckets. The format has no magic number: the name of the file and consistent numbers identify
//! it.

use anyhow::{Result, bail, ensure};
use half::f16;

use super::input::{Input, checked_count, word};
use super::splat::{colour, floats};
use crate::host_memory::host_vec;
use crate::scene::{Activated, BLOCK, Builder, Scene, USUAL_SH_DEGREE, rest_values};

const HEADER: usize = 4096;
const SECTION_HEADER: usize = 1024;
/// Bytes of a bucket, which is its centre.
const BUCKET: usize = 12;

struct Header {
    sections: u32,
    count: u32,
    level: Level,
}

/// Compression level: how the values of a Gaussian are stored.
#[derive(Clone, Copy)]
enum Level {
    /// All values as 32-bit floats.
    Zero,
    /// Positions in 16 bits inside a bucket, other values as 16-bit floats.
    One,
    /// Level 1, with coefficients of degrees 1 and up in 8 bits from `low` to `high`.
    Two { low: f64, high: f64 },
}

impl Level {
    /// Bytes of three values (mean or scales), of a quaternion, and of a coefficient.
    fn bytes(self) -> (usize, usize, usize) {
        match self {
            Self::Zero => (12, 16, 4),
            Self::One => (6, 8, 2),
            Self::Two { .. } => (6, 8, 1),
        }
    }

    fn stride(self, sh_degree: u32) -> usize {
        let (triple, quaternion, coefficient) = self.bytes();
        2 * triple + quaternion + 4 + rest_values(sh_degree) * coefficient
    }

    /// Value `index` of the scales or of the quaternion that begin at byte `at`.
    fn float(self, row: &[u8], at: usize, index: usize) -> f64 {
        match self {
            Self::Zero => f64::from(f32::from_le_bytes(first(&row[at + 4 * index..]))),
            _ => f64::from(f16::from_le_bytes(first(&row[at + 2 * index..])).to_f32()),
        }
    }

    fn coefficient(self, row: &[u8], at: usize, index: usize) -> f64 {
        match self {
            Self::Two { low, high } => low + (high - low) * f64::from(row[at + index]) / 255.0,
            _ => self.float(row, at, index),
        }
    }
}

impl Header {
    fn parse(bytes: &[u8; HEADER]) -> Result<Self> {
        let [major, minor] = [bytes[0], bytes[1]];
        ensure!(major == 0 && minor >= 1, "not a .ksplat file of version 0.1: its version would be {major}.{minor}");
        let (sections, used, count) = (word(bytes, 4), word(bytes, 8), word(bytes, 16));
        ensure!(used <= sections, "the header claims {used} sections, with room for {sections}");
        // Zero stands for the default.
        let bound = |at: usize, default: f64| match f64::from(f32::from_le_bytes(first(&bytes[at..]))) {
            bound if bound == 0.0 || bound.is_nan() => default,
            bound => bound,
        };
        let level = match u16::from_le_bytes(first(&bytes[20..])) {
            0 => Level::Zero,
            1 => Level::One,
            2 => Level::Two { low: bound(36, -1.5), high: bound(40, 1.5) },
            other => bail!("compression level {other} is not supported, only 0, 1 and 2"),
        };
        Ok(Self { sections, count, level })
    }
}

/// The header of a section.
struct Section {
    number: usize,
    count: usize,
    /// Allocated Gaussians; those past `count` are unused.
    room: usize,
    buckets: Buckets,
    sh_degree: u32,
}

/// The buckets of a section. Their Gaussians are relative to a shared centre; full buckets come first.
struct Buckets {
    count: u32,
    bytes_each: u16,
    /// Gaussians of a full bucket.
    capacity: u32,
    full: u32,
    partial: u32,
    /// World units per step of a position.
    step: f64,
    /// The step of the centre.
    middle: f64,
}

impl Section {
    fn parse(number: usize, bytes: &[u8]) -> Result<Self> {
        let [count, room] = [0, 4].map(|at| word(bytes, at));
        ensure!(count <= room, "section {number} claims {count} Gaussians, with room for {room}");
        let sh_degree = u32::from(u16::from_le_bytes(first(&bytes[40..])));
        ensure!(
            sh_degree <= USUAL_SH_DEGREE,
            "section {number} has SH degree {sh_degree}, only 0 to {USUAL_SH_DEGREE} are supported"
        );
        let middle = match word(bytes, 24) {
            0 => 32767.0,
            range => f64::from(range),
        };
        let buckets = Buckets {
            count: word(bytes, 12),
            bytes_each: u16::from_le_bytes(first(&bytes[20..])),
            capacity: word(bytes, 8),
            full: word(bytes, 32),
            partial: word(bytes, 36),
            step: f64::from(f32::from_le_bytes(first(&bytes[16..]))) / 2.0 / middle,
            middle,
        };
        Ok(Self { number, count: count as usize, room: room as usize, buckets, sh_degree })
    }
}

/// The centres of the buckets of a section.
struct Centres {
    means: Vec<[f32; 3]>,
    capacity: usize,
    full: usize,
    /// Index of the first Gaussian of each partial bucket, ascending.
    starts: Vec<usize>,
    step: f64,
    middle: f64,
}

impl Centres {
    fn read(input: &mut Input, section: &Section, level: Level) -> Result<Self> {
        let (buckets, number) = (&section.buckets, section.number);
        let lengths = bytes(input, buckets.partial, 4, "partial buckets")?;
        let centres = bytes(input, buckets.count, u64::from(buckets.bytes_each), "buckets")?;
        let mut all = Self {
            means: Vec::new(),
            capacity: buckets.capacity as usize,
            full: buckets.full as usize,
            starts: host_vec(lengths.len() / 4, "partial buckets")?,
            step: buckets.step,
            middle: buckets.middle,
        };
        if matches!(level, Level::Zero) {
            return Ok(all);
        }
        ensure!(
            buckets.bytes_each as usize == BUCKET || buckets.count == 0,
            "section {number} has buckets of {} bytes, only {BUCKET} are supported",
            buckets.bytes_each
        );
        all.means = centres.chunks_exact(BUCKET).map(floats).collect();
        let mut start = all.capacity.saturating_mul(all.full);
        for length in lengths.as_chunks().0 {
            all.starts.push(start);
            start = start.saturating_add(u32::from_le_bytes(*length) as usize);
        }
        let named = all.full.saturating_add(all.starts.len());
        ensure!(
            named <= all.means.len(),
            "section {number} has {named} full and partial buckets, but {} centres",
            all.means.len()
        );
        ensure!(start >= section.count, "section {number} has {} Gaussians, its buckets hold {start}", section.count);
        Ok(all)
    }

    /// The centre of the bucket of Gaussian `index`.
    fn of(&self, index: usize) -> [f32; 3] {
        if index < self.capacity.saturating_mul(self.full) {
            return self.means[index / self.capacity];
        }
        self.means[self.full + self.starts.partition_point(|start| *start <= index) - 1]
    }
}

pub(crate) fn read(input: &mut Input) -> Result<Scene> {
    let mut bytes = [0; HEADER];
    input.fill(&mut bytes, "the header")?;
    let header = Header::parse(&bytes)?;
    let sections = sections(input, &header)?;
    let sh_degree = sections.iter().filter(|s| s.count > 0).map(|s| s.sh_degree).max().unwrap_or(0);
    let mut builder = input.builder(sh_degree, header.count as usize)?;
    for section in &sections {
        read_section(input, section, header.level, &mut builder)?;
    }
    let (gaussians, report) = builder.finish();
    Ok(Scene {
        gaussians,
        report,
        format: "KSPLAT".to_owned(),
        is_antialiased: false,
        notices: Vec::new(),
        levels: Vec::new(),
    })
}

/// Reads the headers of all sections, and checks that the file can hold their Gaussians.
fn sections(input: &mut Input, header: &Header) -> Result<Vec<Section>> {
    let room = checked_count(header.sections.into(), SECTION_HEADER as u64, input.left(), "sections")?;
    let mut all = host_vec(room, "sections")?;
    let mut bytes = [0; SECTION_HEADER];
    for number in 0..room {
        input.fill(&mut bytes, "the section headers")?;
        all.push(Section::parse(number, &bytes)?);
    }
    let needed = |section: &Section| section.room as u64 * header.level.stride(section.sh_degree) as u64;
    let needed = all.iter().map(needed).fold(0, u64::saturating_add);
    ensure!(
        needed <= input.left(),
        "the file is truncated or its headers wrong: the Gaussians need {needed} bytes, {} are left",
        input.left()
    );
    let count: u64 = all.iter().map(|section| section.count as u64).sum();
    ensure!(
        count == u64::from(header.count),
        "the header claims {} Gaussians, those of its sections {count}",
        header.count
    );
    Ok(all)
}

fn read_section(input: &mut Input, section: &Section, level: Level, builder: &mut Builder) -> Result<()> {
    let centres = Centres::read(input, section, level)?;
    let stride = level.stride(section.sh_degree);
    let mut rows = Vec::new();
    for first in (0..section.count).step_by(BLOCK) {
        input.before_block(builder)?;
        let block = BLOCK.min(section.count - first);
        rows.resize(block * stride, 0);
        input.fill(&mut rows, "the Gaussians")?;
        builder.extend(block, |index, sh| {
            gaussian(&rows[index * stride..][..stride], first + index, section.sh_degree, level, &centres, sh)
        });
    }
    input.skip((section.room - section.count) as u64 * stride as u64, "unused room")
}

/// One Gaussian from its bytes. Coefficients above the degree of the section stay zero.
fn gaussian(
    row: &[u8],
    index: usize,
    sh_degree: u32,
    level: Level,
    centres: &Centres,
    sh: &mut [[f32; 3]],
) -> Activated {
    let (triple, quaternion, _) = level.bytes();
    let mean = match level {
        Level::Zero => floats(row).map(f64::from),
        _ => {
            let centre = centres.of(index);
            std::array::from_fn(|axis| {
                let steps = f64::from(u16::from_le_bytes(self::first(&row[2 * axis..])));
                (steps - centres.middle) * centres.step + f64::from(centre[axis])
            })
        }
    };
    let rgba = 2 * triple + quaternion;
    sh[0] = colour(&row[rgba..]);
    for degree in 1..=sh_degree as usize {
        // Degree after degree; within a degree, channel after channel.
        let (before, width) = (degree * degree, 2 * degree + 1);
        for (i, coefficient) in sh[before..][..width].iter_mut().enumerate() {
            *coefficient = std::array::from_fn(|channel| {
                level.coefficient(row, rgba + 4, 3 * (before - 1) + channel * width + i) as f32
            });
        }
    }
    Activated {
        mean,
        scale: std::array::from_fn(|i| level.float(row, triple, i)),
        rotation: std::array::from_fn(|i| level.float(row, 2 * triple, i)),
        opacity: f64::from(row[rgba + 3]) / 255.0,
    }
}

/// Reads `count` elements of `each` bytes.
fn bytes(input: &mut Input, count: u32, each: u64, what: &str) -> Result<Vec<u8>> {
    let count = checked_count(count.into(), each, input.left(), what)?;
    let mut bytes = host_vec(count * each as usize, what)?;
    bytes.resize(count * each as usize, 0);
    input.fill(&mut bytes, what)?;
    Ok(bytes)
}

/// The first `N` bytes of a row that has them.
fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    std::array::from_fn(|i| bytes[i])
}
