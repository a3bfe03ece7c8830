//! Reads PLY: scenes of the original 3DGS (`x y z`, `f_dc`, `f_rest`, `opacity`, `scale`, `rot`) and their variants,
//! compressed PLY, and point clouds.

mod header;
mod layout;
mod packed;
mod points;
mod rows;

use anyhow::{Result, bail};

use self::header::Element;
use self::layout::Layout;
use self::rows::{Rows, skip};
use super::Scene;
use super::canonical::{BLOCK, Builder};
use super::source::Source;

pub(super) use packed::CHUNK;

pub(super) fn read(source: &mut Source) -> Result<Scene> {
    let header::Header { elements, is_antialiased, mut notices } = header::read(source)?;
    if elements.iter().any(|e| e.name == "chunk") {
        return Ok(Scene { is_antialiased, notices, ..packed::read(source, &elements)? });
    }
    for element in &elements {
        if element.name == "vertex" {
            let scene = vertices(source, element)?;
            notices.extend(scene.notices);
            return Ok(Scene { is_antialiased, notices, ..scene });
        }
        skip(source, element)?;
    }
    bail!("the header has no element vertex")
}

fn vertices(source: &mut Source, element: &Element) -> Result<Scene> {
    let mut rows = Rows::of(source, element)?;
    let kept = rows.kept();
    if !["scale_0", "rot_0", "opacity", "f_dc_0"].iter().any(|name| element.has(name)) {
        return points::read(source, &mut rows, &kept);
    }
    let layout = Layout::of(&kept)?;
    let mut builder = Builder::new(layout.sh_degree, rows.count)?;
    let (stride, bands) = (kept.stride(), layout.rest.len() / 3);
    for first in (0..rows.count).step_by(BLOCK) {
        source.before_block(&builder)?;
        let block = BLOCK.min(rows.count - first);
        let bytes = rows.next(source, first, block)?;
        builder.extend(block, |index, sh| {
            let row = &bytes[index * stride..][..stride];
            sh[0] = layout.colour.read(row);
            for (i, coefficient) in sh[1..].iter_mut().enumerate() {
                *coefficient = std::array::from_fn(|channel| layout.rest[channel * bands + i].read_f32(row));
            }
            layout.raw(row)
        });
    }
    let (gaussians, report) = builder.finish();
    let flat = (layout.scale.len() == 2).then(|| "it has two scales, and is drawn as flat Gaussians".to_owned());
    let notices = flat.into_iter().collect();
    Ok(Scene { gaussians, report, format: "PLY".to_owned(), is_antialiased: false, notices, levels: Vec::new() })
}
