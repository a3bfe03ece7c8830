//! Reads `.splat`: 32 bytes per Gaussian and no header, so the name and plausible values identify the format. Axes are
//! right, down, forward as in PLY; scales and opacities are activated values, colours have degree 0.

use anyhow::{Result, ensure};

use crate::formats::input::{Input, TakeBlock};
use crate::scene::harmonics::C0;
use crate::scene::{Activated, BLOCK, LoadReport, Scene};

/// Bytes of a Gaussian: mean and scales as 32-bit floats; colour, opacity and quaternion w x y z as bytes.
const ROW: usize = 32;
/// Upper bound on plausible means and scales. Arbitrary bytes read as floats are often larger.
const LARGEST: f32 = 1e9;

pub(crate) fn read(input: &mut Input) -> Result<Scene> {
    let mut builder = input.builder(0, count(input)?)?;
    blocks(input, |input, rows| {
        input.before_block(&builder)?;
        builder.extend(rows.len(), |index, sh| decode(&rows[index], sh));
        Ok(())
    })?;
    let (gaussians, report) = builder.finish();
    Ok(Scene { gaussians, report, ..Scene::empty("SPLAT") })
}

/// Reads the Gaussians of a file block by block.
pub(crate) fn read_blocks(input: &mut Input, take: TakeBlock) -> Result<Scene> {
    let (of, mut report) = (count(input)?, LoadReport::default());
    blocks(input, |input, rows| {
        let mut builder = input.builder(0, rows.len())?;
        builder.extend(rows.len(), |index, sh| decode(&rows[index], sh));
        let (gaussians, part) = builder.finish();
        report = report.and(&part);
        take(gaussians, of)
    })?;
    Ok(Scene { report, ..Scene::empty("SPLAT") })
}

fn count(input: &Input) -> Result<usize> {
    let bytes = input.len();
    ensure!(
        bytes.is_multiple_of(ROW as u64),
        "a .splat file has {ROW} bytes for each Gaussian, these {bytes} are not a multiple of that"
    );
    Ok(usize::try_from(bytes / ROW as u64)?)
}

fn blocks(input: &mut Input, mut take: impl FnMut(&mut Input, &[[u8; ROW]]) -> Result<()>) -> Result<()> {
    let count = count(input)?;
    let mut rows = Vec::new();
    for first in (0..count).step_by(BLOCK) {
        let block = BLOCK.min(count - first);
        rows.resize(block * ROW, 0);
        input.fill(&mut rows, "the Gaussians")?;
        let rows = rows.as_chunks().0;
        if first == 0 {
            check_plausible(rows)?;
        }
        take(input, rows)?;
    }
    Ok(())
}

fn decode(row: &[u8; ROW], sh: &mut [[f32; 3]]) -> Activated {
    sh[0] = colour(&row[24..]);
    gaussian(row)
}

/// Refuses a file that has the name of the format but another content. A tenth of the Gaussians may be damaged.
fn check_plausible(rows: &[[u8; ROW]]) -> Result<()> {
    let bad = rows.iter().filter(|row| !is_plausible(row)).count();
    ensure!(
        bad * 10 <= rows.len(),
        "not a .splat file: of its first {} records, {bad} have no finite mean or no positive scale",
        rows.len()
    );
    Ok(())
}

fn is_plausible(row: &[u8; ROW]) -> bool {
    let [mean, scale] = [0, 12].map(|at| floats(&row[at..]));
    mean.iter().all(|v| v.abs() < LARGEST)
        && scale.iter().all(|v| (0.0..LARGEST).contains(v))
        && scale.iter().any(|v| *v > 0.0)
}

fn gaussian(row: &[u8; ROW]) -> Activated {
    Activated {
        mean: floats(&row[..]).map(f64::from),
        scale: floats(&row[12..]).map(f64::from),
        rotation: std::array::from_fn(|i| (f64::from(row[28 + i]) - 128.0) / 128.0),
        opacity: f64::from(row[27]) / 255.0,
    }
}

/// The coefficients of degree 0 for a colour of three bytes.
pub(crate) fn colour(bytes: &[u8]) -> [f32; 3] {
    std::array::from_fn(|i| ((f64::from(bytes[i]) / 255.0 - 0.5) / C0) as f32)
}

/// The first three 32-bit floats of at least 12 bytes.
pub(crate) fn floats(bytes: &[u8]) -> [f32; 3] {
    std::array::from_fn(|i| f32::from_le_bytes(std::array::from_fn(|k| bytes[4 * i + k])))
}
