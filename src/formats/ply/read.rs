//! Reads PLY: scenes of the original 3DGS (`x y z`, `f_dc`, `f_rest`, `opacity`, `scale`, `rot`) and their variants,
//! compressed PLY, and point clouds.

use anyhow::{Context, Result};

use super::dialects;
use super::header::{Element, Header};
use super::layout::Layout;
use super::rows::{Rows, skip};
use super::{compressed_read, header, points};
use crate::formats::input::{Input, TakeBlock};
use crate::scene::{Activated, BLOCK, LoadReport, Scene};

pub(crate) fn read(input: &mut Input) -> Result<Scene> {
    let header = header::read(input)?;
    let scene = if is_packed(&header) {
        compressed_read::read(input, &header.elements)?
    } else {
        let element = skip_to_vertices(input, &header)?;
        vertices(input, element)?
    };
    Ok(with_notices(scene, header))
}

/// True if a file can be read block by block.
pub(crate) fn comes_in_blocks(input: &mut Input) -> bool {
    let Ok(header) = header::read(input) else { return false };
    !is_packed(&header) && header.elements.iter().any(|e| e.name == "vertex" && !is_point_cloud(e))
}

/// Reads the Gaussians of a file block by block. `None` if its format is read as a whole.
pub(crate) fn read_blocks(input: &mut Input, take: TakeBlock) -> Result<Option<Scene>> {
    let header = header::read(input)?;
    if is_packed(&header) {
        return Ok(None);
    }
    let element = skip_to_vertices(input, &header)?;
    let mut rows = Rows::of(input, element)?;
    if is_point_cloud(element) {
        return Ok(None);
    }
    let mut report = LoadReport::default();
    let of = rows.count;
    let notices = blocks(input, &mut rows, |input, sh_degree, count, decode| {
        let mut builder = input.builder(sh_degree, count)?;
        builder.extend(count, decode);
        let (gaussians, part) = builder.finish();
        report = report.and(&part);
        take(gaussians, of)
    })?;
    Ok(Some(with_notices(Scene { report, notices, ..Scene::empty("PLY") }, header)))
}

fn is_packed(header: &Header) -> bool {
    header.elements.iter().any(|e| e.name == "chunk")
}

fn is_point_cloud(element: &Element) -> bool {
    dialects::hint(element).is_none()
}

/// The scene with what the header states.
fn with_notices(scene: Scene, header: Header) -> Scene {
    let Header { elements, is_antialiased, mut notices } = header;
    notices.extend(scene.notices);
    notices.extend(dialects::element_notice(&elements));
    Scene { is_antialiased, notices, ..scene }
}

/// Skips the elements before the vertices.
fn skip_to_vertices<'h>(input: &mut Input, header: &'h Header) -> Result<&'h Element> {
    let at = header.elements.iter().position(|element| element.name == "vertex").with_context(|| {
        let names: Vec<&str> = header.elements.iter().map(|element| element.name.as_str()).collect();
        match names[..] {
            [] => "the header has no element vertex".to_owned(),
            _ => format!("the header has no element vertex, only {}", names.join(", ")),
        }
    })?;
    header.elements[..at].iter().try_for_each(|element| skip(input, element))?;
    Ok(&header.elements[at])
}

fn vertices(input: &mut Input, element: &Element) -> Result<Scene> {
    let mut rows = Rows::of(input, element)?;
    if is_point_cloud(element) {
        let kept = rows.kept();
        return points::read(input, &mut rows, &kept);
    }
    let mut builder = input.builder(Layout::of(element)?.sh_degree, rows.count)?;
    let notices = blocks(input, &mut rows, |input, _, count, decode| {
        input.before_block(&builder)?;
        builder.extend(count, decode);
        Ok(())
    })?;
    let (gaussians, report) = builder.finish();
    Ok(Scene { gaussians, report, notices, ..Scene::empty("PLY") })
}

/// Decodes a Gaussian of a block, and writes its spherical harmonics.
type Decode<'d> = &'d (dyn Fn(usize, &mut [[f32; 3]]) -> Activated + Sync);

/// Reads all rows in blocks. `take` gets the SH degree, the number of Gaussians of a block and what decodes them.
/// Returns notices about the file.
fn blocks(
    input: &mut Input,
    rows: &mut Rows,
    mut take: impl FnMut(&mut Input, u32, usize, Decode) -> Result<()>,
) -> Result<Vec<String>> {
    let kept = rows.kept();
    let layout = Layout::of(&kept)?;
    let mut notices = layout.notices();
    notices.extend(dialects::notices(&kept));
    let (stride, bands) = (kept.stride(), layout.rest.len() / 3);
    for first in (0..rows.count).step_by(BLOCK) {
        let block = BLOCK.min(rows.count - first);
        let bytes = rows.next(input, first, block)?;
        if first == 0 {
            notices.extend(layout.doubts(bytes, stride));
        }
        take(input, layout.sh_degree, block, &|index, sh| {
            let row = &bytes[index * stride..][..stride];
            sh[0] = layout.colour.read(row);
            for (i, coefficient) in sh[1..].iter_mut().enumerate() {
                *coefficient = std::array::from_fn(|channel| layout.rest[channel * bands + i].read_f32(row));
            }
            layout.gaussian(row)
        })?;
    }
    Ok(notices)
}
