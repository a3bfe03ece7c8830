//! The blend of every tile's list into the picture, and on demand a certificate of its error.

use anyhow::Result;

use super::workspace::PortableWorkspace;
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::render::frame::{Shot, SubgroupLimits, Target, Variation, tiles};
use crate::render::scene::GpuScene;
use crate::render::shaders::SharedConstants;
use crate::render::shaders::portable::*;
use crate::rules::LISTED_ALPHA;

/// A walk along the tile lists of a frame, or of one slab of it.
#[derive(Clone, Copy)]
pub(in crate::render) struct Walk {
    /// The number of dispatches.
    pub passes: u32,
    /// True if pixels start from the state that the target holds.
    pub goes_on: bool,
    /// True if the last pass finishes the pixels.
    pub is_last: bool,
}

/// One dispatch of a walk.
#[derive(Clone, Copy)]
pub(in crate::render) struct Pass {
    /// The stage of the pass: 0 begins pixels, 1 resumes them.
    pub stage: usize,
    /// The first entry of every list that the pass takes.
    pub begin: u32,
    /// The most entries of a list that the pass takes.
    pub limit: u32,
    /// 1 if the pass finishes the pixels.
    pub last: u32,
}

impl Walk {
    /// The walk of a frame that is drawn at once.
    pub fn whole(passes: u32) -> Self {
        Self { passes, goes_on: false, is_last: true }
    }

    /// Records the dispatches of the walk, each of which takes at most `limit` entries of a list.
    pub fn record(self, cmd: &mut Commands, limit: u32, dispatch: impl Fn(&mut Commands, Pass)) {
        for pass in 0..self.passes {
            if pass > 0 {
                cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            }
            let stage = usize::from(self.goes_on || pass > 0);
            let last = u32::from(self.is_last && pass + 1 == self.passes);
            dispatch(cmd, Pass { stage, begin: pass * limit, limit, last });
        }
    }
}

/// The pipelines of the blend. The first of each pair begins pixels, the second resumes them.
pub(in crate::render) struct Blending {
    /// The most instances of a tile's list that one dispatch takes.
    pub(in crate::render) entries_per_pass: u32,
    stages: Stages,
}

enum Stages {
    Plain([Stage<Blend>; 2]),
    Certified([Stage<BlendCertified>; 2]),
}

impl Blending {
    pub fn new(
        device: &Device,
        options: &Options,
        variation: Variation,
        constants: &SharedConstants,
        subgroups: SubgroupLimits,
    ) -> Result<Self> {
        let plain = |resume| {
            let cull_pixel_blocks = !options.portable;
            let count = variation == Variation::Counting;
            Stage::new(device, &BlendConstants { cull_pixel_blocks, resume, count, ..BlendConstants::of(constants) })
        };
        let certified =
            |resume| Stage::new(device, &BlendCertifiedConstants { resume, ..BlendCertifiedConstants::of(constants) });
        let entries_per_pass = device.capabilities().loop_limit.map_or(u32::MAX, |limit| {
            // A subgroup takes as many instances at a time as it has lanes: one iteration for each, one for the loop
            // around them, and the iterations over the words of a ballot.
            let iterations = subgroups.smallest + 3 * subgroups.ballot_words + 3;
            limit / iterations * subgroups.smallest
        });
        let stages = match variation {
            Variation::Certifying => Stages::Certified([certified(false)?, certified(true)?]),
            Variation::Plain | Variation::Counting => Stages::Plain([plain(false)?, plain(true)?]),
        };
        Ok(Self { entries_per_pass, stages })
    }

    /// The number of dispatches for a longest tile list of this length.
    pub fn passes(&self, longest_list: u32) -> u32 {
        longest_list.div_ceil(self.entries_per_pass).max(1)
    }

    /// The longest tile list that this number of dispatches finishes.
    pub fn longest_list(&self, passes: u32) -> u32 {
        self.entries_per_pass.saturating_mul(passes)
    }

    /// Blends every tile's list of `splat_ids`.
    pub fn record(
        &self,
        cmd: &mut Commands,
        Shot { scene, camera, band, .. }: Shot,
        work: &PortableWorkspace,
        splat_ids: &Buffer<u32>,
        target: Target,
        walk: Walk,
    ) {
        let image = target.image;
        let tiles: u32 = tiles(image.size()).iter().product();
        let (size_px, top_px, background) = (image.size(), band.top, target.background.colour());
        let (ranges, splats, totals) = (&work.ranges, &work.splats, &work.totals);
        let groups = DispatchSize::Groups(tiles.into());
        walk.record(cmd, self.entries_per_pass, |cmd, pass| {
            let Pass { stage, begin: pass_begin, limit: pass_limit, last: last_pass } = pass;
            match &self.stages {
                Stages::Plain(stages) => {
                    let tiles_by_class = &work.tiles_by_class;
                    let bindings = BlendBindings { ranges, splat_ids, splats, totals, tiles_by_class, image };
                    let push = BlendPush { size_px, top_px, tiles, background, pass_begin, pass_limit, last_pass };
                    cmd.dispatch(&stages[stage], bindings, push, groups);
                }
                Stages::Certified(stages) => {
                    let certificate = target.certificate.expect("a certifying renderer is given an image for it");
                    let bindings = BlendCertifiedBindings { ranges, splat_ids, splats, totals, image, certificate };
                    let push = BlendCertifiedPush {
                        size_px,
                        top_px,
                        tiles,
                        background,
                        pass_begin,
                        pass_limit,
                        last_pass,
                        unlisted: unlisted(scene, background),
                        position_error_px: position_error_px(camera),
                    };
                    cmd.dispatch(&stages[stage], bindings, push, groups);
                }
            }
        });
    }
}

/// An upper bound on the colour of all unlisted Gaussians, counted twice: once directly, and once in the colour behind
/// a listed splat.
pub(in crate::render) fn unlisted(scene: &GpuScene, background: [f32; 3]) -> f32 {
    let brightest = background.map(f64::from).into_iter().fold(scene.layout().brightest, f64::max);
    (2.0 * scene.len() as f64 * f64::from(LISTED_ALPHA) * brightest) as f32
}

/// Upper bound in px on the rounding error of a mean near the middle of the image: 8 * 2^-23 of focal length plus size.
fn position_error_px(camera: &Camera) -> f32 {
    let largest = camera.focal_px.max_element() + f64::from(camera.size_px[0].max(camera.size_px[1]));
    (largest * 8.0 * 0.5_f64.powi(23)) as f32
}
