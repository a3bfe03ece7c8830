//! A procedural town of any number of Gaussians, from a hundred thousand to a thousand million: the test of scenes that
//! are larger than memory.
//!
//! Each Gaussian is a function of the count and its index. The order is spatial: sky and surroundings first, then the
//! blocks along a Hilbert curve, and in a block one part after another. Units are metres, up is -y. It has the
//! properties of trained scenes that `docs/town.md` lists.
//!
//! - `plan`, `layout`, `hilbert` - streets, blocks and houses: the plan, its elements, the order of its blocks
//! - `parts` - the parts of a block, and the spots of their Gaussians
//! - `facade`, `roof`, `ground`, `objects` - textures and shapes of these parts
//! - `outside` - fields, woods and sky around the town
//! - `splat` - the Gaussian at a spot of a surface
//! - `path` - camera paths

mod facade;
mod ground;
mod hilbert;
mod layout;
mod objects;
mod outside;
mod parts;
mod path;
mod plan;
mod roof;
mod splat;
#[cfg(test)]
mod tests;

use std::ops::Range;

use glam::DVec3;

use crate::host_memory::OutOfMemory;
use crate::scene::Random;
use crate::scene::{Builder, Gaussians, LoadReport, Raw};
use outside::Surroundings;
use parts::Part;
use plan::Layout;
use splat::{Layer, SH_DEGREE};

pub use path::TownPath;

/// Largest number of Gaussians.
pub const MAX_COUNT: usize = 1_000_000_000;

/// Number of Gaussians of a block at the density that `parts` states, mean of all kinds.
const BLOCK_COUNT: f64 = 6.3e6;

/// Fewest blocks along a side of the town. Towns with fewer Gaussians than those blocks need have larger ones.
const FEWEST: usize = 4;

/// Fraction of all Gaussians and largest number, of the sky, of the fields and of the woods.
const OUTSIDE: [(f64, f64); 3] = [(0.03, 3e5), (0.04, 6e5), (0.02, 3e5)];

/// The plan of a town, and the index ranges of its parts.
struct Town {
    layout: Layout,
    surroundings: Surroundings,
    /// The ends of the sky, of the fields and of the woods.
    outside: [usize; 3],
    /// The end of each block.
    ends: Vec<usize>,
}

/// The plan of the town with this many Gaussians.
fn layout(count: usize) -> Layout {
    let side = (count as f64 / BLOCK_COUNT).sqrt() as usize;
    Layout::new(side.max(FEWEST))
}

/// The end indices of parts, among which `count` Gaussians from `begin` on are divided by weight.
fn divided(begin: usize, count: usize, weights: impl Iterator<Item = f64> + Clone) -> Vec<usize> {
    let whole: f64 = weights.clone().sum();
    let sums = weights.scan(0.0, |sum, weight| {
        *sum += weight;
        Some(*sum)
    });
    sums.map(|sum| begin + ((count as f64 * sum / whole).round() as usize).min(count)).collect()
}

impl Town {
    fn new(count: usize) -> Self {
        let layout = layout(count);
        let surroundings = Surroundings::new(layout.half());
        let mut outside = [0; 3];
        let mut end = 0;
        for (slot, (share, most)) in outside.iter_mut().zip(OUTSIDE) {
            end += (count as f64 * share).min(most) as usize;
            *slot = end;
        }
        let weight = |block| parts::parts(block).iter().map(|part| part.weight).sum::<f64>();
        let weights: Vec<f64> = layout.blocks.iter().map(weight).collect();
        let ends = divided(end, count - end, weights.iter().copied());
        Self { layout, surroundings, outside, ends }
    }

    /// Gaussian `index` of the surroundings.
    fn outer(&self, index: usize, sh: &mut [[f32; 3]]) -> Raw {
        let random = &mut Random::of(index);
        let at = [random.unit(), random.unit()];
        let [sky, fields, woods] = self.outside;
        let around = self.surroundings;
        let (spot, area, count) = match index {
            _ if index < sky => (around.sky(random, at), around.sky_area(), sky),
            _ if index < fields => (around.field(random, at), around.area(), fields - sky),
            _ => (around.wood(random, at), around.area(), woods - fields),
        };
        splat::gaussian(random, &self.layout, &spot, Layer::Front, (area / count as f64).sqrt(), sh)
    }

    /// Adds the Gaussians `wanted` of a block with the index range `all`.
    fn add_block(&self, builder: &mut Builder, block: usize, all: Range<usize>, wanted: Range<usize>) {
        let block = &self.layout.blocks[block];
        let parts: Vec<Part> = parts::parts(block);
        let ends = divided(all.start, all.len(), parts.iter().map(|part| part.weight));
        builder.extend(wanted.len(), |i, sh| {
            let index = wanted.start + i;
            let number = ends.partition_point(|end| *end <= index).min(parts.len() - 1);
            let begin = if number == 0 { all.start } else { ends[number - 1] };
            let random = &mut Random::of(index);
            let place = parts[number].place(index - begin, ends[number] - begin);
            let (spot, spacing) = parts[number].spot(&self.layout, block, random, &place);
            splat::gaussian(random, &self.layout, &spot, place.layer, spacing, sh)
        });
    }
}

/// The eyes and targets of `views` cameras along a path of the town with `count` Gaussians.
pub fn views(count: usize, path: TownPath, views: usize) -> Vec<[DVec3; 2]> {
    path.views(&layout(count), views)
}

/// The Gaussians of a range of the town with `count` Gaussians. The same count gives the same town on every machine.
///
/// # Errors
/// [`OutOfMemory`] if they cannot be allocated.
pub fn fill(count: usize, range: Range<usize>) -> Result<(Gaussians, LoadReport), OutOfMemory> {
    let mut builder = Builder::new(SH_DEGREE, range.len())?;
    let town = Town::new(count);
    let within = |begin: usize, end: usize| range.start.max(begin)..range.end.min(end);
    let mut begin = town.outside[2];
    let outer = within(0, begin);
    builder.extend(outer.len(), |i, sh| town.outer(outer.start + i, sh));
    for (block, end) in town.ends.iter().enumerate() {
        let wanted = within(begin, *end);
        if !wanted.is_empty() {
            town.add_block(&mut builder, block, begin..*end, wanted);
        }
        begin = *end;
    }
    Ok(builder.finish())
}
