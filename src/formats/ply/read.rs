//! Reads PLY: scenes of the original 3DGS (`x y z`, `f_dc`, `f_rest`, `opacity`, `scale`, `rot`) and their variants,
//! compressed PLY, and point clouds.

use anyhow::{Result, bail};

use super::header::Element;
use super::layout::Layout;
use super::rows::{Rows, skip};
use super::{compressed_read, header, points};
use crate::formats::input::{Input, TakeBlock};
use crate::scene::{BLOCK, Builder, LoadReport, Raw, Scene};

pub(crate) fn read(input: &mut Input) -> Result<Scene> {
    let header::Header { elements, is_antialiased, mut notices } = header::read(input)?;
    if elements.iter().any(|e| e.name == "chunk") {
        return Ok(Scene { is_antialiased, notices, ..compressed_read::read(input, &elements)? });
    }
    for element in &elements {
        if element.name == "vertex" {
            let scene = vertices(input, element)?;
            notices.extend(scene.notices);
            return Ok(Scene { is_antialiased, notices, ..scene });
        }
        skip(input, element)?;
    }
    bail!("the header has no element vertex")
}

/// True if a file can be read block by block.
pub(crate) fn comes_in_blocks(input: &mut Input) -> bool {
    let Ok(header) = header::read(input) else { return false };
    let is_packed = header.elements.iter().any(|e| e.name == "chunk");
    !is_packed && header.elements.iter().any(|e| e.name == "vertex" && !is_point_cloud(e))
}

/// Reads the Gaussians of a file block by block. `None` if its format is read as a whole.
pub(crate) fn read_blocks(input: &mut Input, take: TakeBlock) -> Result<Option<Scene>> {
    let header::Header { elements, is_antialiased, mut notices } = header::read(input)?;
    if elements.iter().any(|e| e.name == "chunk") {
        return Ok(None);
    }
    for element in &elements {
        if element.name == "vertex" {
            let mut rows = Rows::of(input, element)?;
            if is_point_cloud(element) {
                return Ok(None);
            }
            let mut report = LoadReport::default();
            let of = rows.count;
            let flat = blocks(input, &mut rows, |_, sh_degree, count, decode| {
                let mut builder = Builder::new(sh_degree, count)?;
                builder.extend(count, decode);
                let (gaussians, part) = builder.finish();
                report = report.and(&part);
                take(gaussians, of)
            })?;
            notices.extend(flat);
            return Ok(Some(Scene { report, is_antialiased, notices, ..Scene::empty("PLY") }));
        }
        skip(input, element)?;
    }
    bail!("the header has no element vertex")
}

fn is_point_cloud(element: &Element) -> bool {
    !["scale_0", "rot_0", "opacity", "f_dc_0"].iter().any(|name| element.has(name))
}

fn vertices(input: &mut Input, element: &Element) -> Result<Scene> {
    let mut rows = Rows::of(input, element)?;
    if is_point_cloud(element) {
        let kept = rows.kept();
        return points::read(input, &mut rows, &kept);
    }
    let mut builder = Builder::new(Layout::of(element)?.sh_degree, rows.count)?;
    let flat = blocks(input, &mut rows, |input, _, count, decode| {
        input.before_block(&builder)?;
        builder.extend(count, decode);
        Ok(())
    })?;
    let (gaussians, report) = builder.finish();
    Ok(Scene { gaussians, report, notices: flat.into_iter().collect(), ..Scene::empty("PLY") })
}

/// Decodes a Gaussian of a block, and writes its spherical harmonics.
type Decode<'d> = &'d (dyn Fn(usize, &mut [[f32; 3]]) -> Raw + Sync);

/// Reads all rows in blocks. `take` gets the SH degree, the number of Gaussians of a block and what decodes them.
/// Returns a notice about the file, if any.
fn blocks(
    input: &mut Input,
    rows: &mut Rows,
    mut take: impl FnMut(&mut Input, u32, usize, Decode) -> Result<()>,
) -> Result<Option<String>> {
    let kept = rows.kept();
    let layout = Layout::of(&kept)?;
    let (stride, bands) = (kept.stride(), layout.rest.len() / 3);
    for first in (0..rows.count).step_by(BLOCK) {
        let block = BLOCK.min(rows.count - first);
        let bytes = rows.next(input, first, block)?;
        take(input, layout.sh_degree, block, &|index, sh| {
            let row = &bytes[index * stride..][..stride];
            sh[0] = layout.colour.read(row);
            for (i, coefficient) in sh[1..].iter_mut().enumerate() {
                *coefficient = std::array::from_fn(|channel| layout.rest[channel * bands + i].read_f32(row));
            }
            layout.raw(row)
        })?;
    }
    Ok((layout.scale.len() == 2).then(|| "it has two scales, and is drawn as flat Gaussians".to_owned()))
}
