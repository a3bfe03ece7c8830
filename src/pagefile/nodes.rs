//! Reads nodes of a page file as Gaussians.

use std::ops::Range;

use anyhow::Result;

use super::page::PAGE;
use super::page_lod::{LEVEL_WORDS, NO_NODE};
use super::reader::PageFile;
use crate::host_memory::OutOfMemory;
use crate::lod::value_of_code;
use crate::packing::Shape;
use crate::scene::{CanonicalBuilder, Gaussians, Unreadable};

/// Reads nodes as Gaussians of any format. Opacities above 1, which no other format holds, become wider Gaussians.
pub struct NodeReader<'f> {
    file: &'f PageFile,
    geometry: Vec<u32>,
    colours: Vec<u32>,
    parts: CanonicalBuilder,
    /// Number of nodes that were read.
    taken: usize,
}

impl<'f> NodeReader<'f> {
    /// A reader of `count` nodes.
    ///
    /// # Errors
    /// [`OutOfMemory`].
    pub fn new(file: &'f PageFile, count: usize) -> Result<Self, OutOfMemory> {
        let (words, degree) = (file.words(), file.statistics().sh_degree);
        let parts = CanonicalBuilder::new(degree, count)?;
        Ok(Self { file, geometry: vec![0; words.geometry()], colours: vec![0; words.colours()], parts, taken: 0 })
    }

    /// Reads the nodes of a page whose words of levels `is_taken` accepts.
    ///
    /// # Errors
    /// [`Unreadable`].
    pub fn take(
        &mut self,
        page: usize,
        words: &[[u32; LEVEL_WORDS]],
        is_taken: impl Fn(&[u32; LEVEL_WORDS]) -> bool,
    ) -> Result<()> {
        if !words.iter().any(&is_taken) {
            return Ok(());
        }
        let Self { file, geometry, colours, parts, taken } = self;
        let (layout, of_page) = (file.layout(), file.words());
        file.read_geometry(page..page + 1, geometry)?;
        file.read_colours(page..page + 1, colours)?;
        for (k, words) in words.iter().enumerate().filter(|(_, words)| is_taken(words)) {
            let mut shape = of_page.unpacked(layout, geometry, k);
            if page >= file.header().scene_pages() {
                shape.opacity = value_of_code(words[1] as u16) as f32;
            }
            layout.unpack_sh(&of_page.sh_of(colours, k), put(parts, *taken, opaque_at_most(shape)));
            *taken += 1;
        }
        Ok(())
    }

    /// The `count` nodes that were read.
    ///
    /// # Errors
    /// [`Unreadable`] if a node has invalid values.
    pub fn finish(self) -> Result<Gaussians> {
        self.parts.finish().map_err(|problem| Unreadable::new(self.file.path(), &problem).into())
    }
}

/// All nodes of some pages of a file with levels.
///
/// # Errors
/// [`Unreadable`]; [`OutOfMemory`].
pub fn nodes_of(file: &PageFile, pages: &[Range<usize>]) -> Result<Gaussians> {
    let mut words = vec![0; pages.iter().map(ExactSizeIterator::len).sum::<usize>() * LEVEL_WORDS * PAGE];
    let mut rest = &mut words[..];
    for range in pages {
        let (of_range, behind) = rest.split_at_mut(range.len() * LEVEL_WORDS * PAGE);
        file.read_levels(range.clone(), of_range)?;
        rest = behind;
    }
    let is_node = |words: &[u32; LEVEL_WORDS]| *words != NO_NODE;
    let words: &[[u32; LEVEL_WORDS]] = words.as_chunks().0;
    let mut reader = NodeReader::new(file, words.iter().filter(|words| is_node(words)).count())?;
    for (page, words) in pages.iter().cloned().flatten().zip(words.chunks_exact(PAGE)) {
        reader.take(page, words, is_node)?;
    }
    reader.finish()
}

/// Stores the shape of Gaussian `place` of a scene. Returns the place of its spherical harmonics.
pub fn put(parts: &mut CanonicalBuilder, place: usize, shape: Shape) -> &mut [[f32; 3]] {
    let Shape { mean, rotation, scale, opacity } = shape;
    (parts.means[place], parts.rotations[place], parts.scales[place]) = (mean, rotation, scale);
    // Opacities of 16 bits may be rounded to 0, which scenes do not allow.
    parts.opacities[place] = opacity.max(f32::from_bits(1));
    let stride = parts.sh.len() / parts.means.len();
    &mut parts.sh[place * stride..][..stride]
}

/// A Gaussian whose opacity is at most 1, with the same sum of alpha over the picture. Alpha is clamped to 1, so that
/// sum, for an opacity o above 1, is that of opacity 1 times 1 + ln o.
fn opaque_at_most(shape: Shape) -> Shape {
    if shape.opacity <= 1.0 {
        return shape;
    }
    let wider = (1.0 + shape.opacity.ln()).sqrt();
    Shape { scale: shape.scale.map(|scale| scale * wider), opacity: 1.0, ..shape }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_opacity_above_1_becomes_area() {
        let shape = Shape { mean: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], scale: [2.0, 2.0, 1.0], opacity: 5.0 };
        let sum = |shape: Shape| {
            let alpha =
                |r: f64| (f64::from(shape.opacity) * (-0.5 * (r / f64::from(shape.scale[0])).powi(2)).exp()).min(1.0);
            (0..100_000).map(|i| f64::from(i) * 1e-3).map(|r| alpha(r) * r * 1e-3).sum::<f64>()
        };
        let made = opaque_at_most(shape);
        assert!(made.opacity == 1.0 && (sum(made) / sum(shape) - 1.0).abs() < 1e-4, "{} {}", sum(made), sum(shape));
        assert_eq!(opaque_at_most(Shape { opacity: 0.7, ..shape }).scale, shape.scale);
    }
}
