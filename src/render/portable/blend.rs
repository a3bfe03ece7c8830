//! The last act of a frame: the list of every tile into the picture, and on demand a certificate of its error.

use anyhow::Result;

use crate::render::gpu_scene::GpuScene;
use crate::render::shaders::portable::*;
use crate::render::shaders::*;
use crate::render::frame::tiles;
use crate::render::portable::workspace::PortableWorkspace;
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Image, Stage};
use crate::options::Options;
use crate::rules::{Background, Footprint};

/// Where the certificate is made, splats are listed as far as their alpha reaches this.
pub(super) const LISTED_ALPHA: f32 = 1e-12;

/// What a frame is drawn into.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    pub image: &'a Image,
    /// Of a renderer that certifies: an image of the same size.
    pub certificate: Option<&'a Image>,
    pub background: Background,
}

/// The pipelines of the blend, of which the second resumes what the first began.
pub(super) struct Blending {
    /// Entries of a tile's list that one dispatch may take.
    pub(super) entries_per_pass: u32,
    stages: Stages,
}

enum Stages {
    Plain([Stage<Blend>; 2]),
    Certified([Stage<BlendCertified>; 2]),
}

impl Blending {
    /// `smallest_subgroup` is the least subgroup size that it may run with, `ballot_words` the words of a ballot.
    pub fn new(
        device: &Device,
        options: &Options,
        variation: Variation,
        [smallest_subgroup, ballot_words]: [u32; 2],
    ) -> Result<Self> {
        let rules = &options.rules;
        let extent = extent_code(rules.extent);
        let (alpha_min, alpha_max, transmittance_min) = (rules.alpha_min, rules.alpha_max, rules.transmittance_min);
        let plain = |resume| {
            let constants = BlendConstants {
                cull_pixel_blocks: !options.portable,
                resume,
                count: variation.counts_work,
                alpha_min,
                extent,
                alpha_max,
                transmittance_min,
                stop: options.stop,
                ballot_words,
            };
            Stage::new(device, &constants)
        };
        let certified = |resume| {
            let stop = options.stop;
            let constants = BlendCertifiedConstants { resume, alpha_min, extent, alpha_max, transmittance_min, stop };
            Stage::new(device, &constants)
        };
        let entries_per_pass = device.facts().loop_limit.map_or(u32::MAX, |limit| {
            // For a subgroup of entries: an iteration each, one around them, and in the loops over the words of a
            // ballot one a word, one to leave each word, and as many to see that a pixel still goes on.
            let iterations = smallest_subgroup + 3 * ballot_words + 3;
            limit / iterations * smallest_subgroup
        });
        let stages = match variation.certifies {
            false => Stages::Plain([plain(false)?, plain(true)?]),
            true => Stages::Certified([certified(false)?, certified(true)?]),
        };
        Ok(Self { entries_per_pass, stages })
    }

    /// Dispatches that a longest tile list of this length takes.
    pub fn passes(&self, longest_list: u32) -> u32 {
        longest_list.div_ceil(self.entries_per_pass).max(1)
    }

    /// The longest tile list that so many dispatches finish.
    pub fn longest_list(&self, passes: u32) -> u32 {
        self.entries_per_pass.saturating_mul(passes)
    }

    /// Blends every tile's list of `splat_ids`.
    pub fn record(
        &self,
        cmd: &mut Commands,
        (scene, camera): (&GpuScene, &Camera),
        work: &PortableWorkspace,
        splat_ids: &Buffer<u32>,
        target: Target,
        passes: u32,
    ) {
        let image = target.image;
        let tiles: u32 = tiles(image.size()).iter().product();
        for pass in 0..passes {
            if pass > 0 {
                cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            }
            let (size_px, background) = (image.size(), target.background.colour());
            let (pass_begin, pass_limit) = (pass * self.entries_per_pass, self.entries_per_pass);
            let last_pass = u32::from(pass + 1 == passes);
            let (ranges, splats, totals) = (&work.ranges, &work.splats, &work.totals);
            let groups = DispatchSize::Groups(tiles.into());
            match &self.stages {
                Stages::Plain(stages) => {
                    let tiles_by_class = &work.tiles_by_class;
                    let bindings = BlendBindings { ranges, splat_ids, splats, totals, tiles_by_class, image };
                    let push = BlendPush { size_px, tiles, background, pass_begin, pass_limit, last_pass };
                    cmd.dispatch(&stages[usize::from(pass > 0)], bindings, push, groups);
                }
                Stages::Certified(stages) => {
                    let certificate = target.certificate.expect("a renderer that certifies is given an image for it");
                    let bindings = BlendCertifiedBindings { ranges, splat_ids, splats, totals, image, certificate };
                    let push = BlendCertifiedPush {
                        size_px,
                        tiles,
                        background,
                        pass_begin,
                        pass_limit,
                        last_pass,
                        unlisted: unlisted(scene, background),
                        position_error_px: position_error_px(camera),
                    };
                    cmd.dispatch(&stages[usize::from(pass > 0)], bindings, push, groups);
                }
            }
        }
    }
}

/// What the contributions of all Gaussians where they are not listed add up to at most: as themselves, and as part of
/// what lies behind a listed one.
fn unlisted(scene: &GpuScene, background: [f32; 3]) -> f32 {
    let brightest = background.map(f64::from).into_iter().fold(scene.brightest, f64::max);
    (2.0 * scene.len() as f64 * f64::from(LISTED_ALPHA) * brightest) as f32
}

/// How far rounding moves a mean near the middle of the image: some 2^-23 of the focal length and of the size.
fn position_error_px(camera: &Camera) -> f32 {
    let largest = camera.focal_px.max_element() + f64::from(camera.size_px[0].max(camera.size_px[1]));
    (largest * 8.0 * 0.5_f64.powi(23)) as f32
}

/// As the shaders call it.
pub(super) fn extent_code(extent: Footprint) -> u32 {
    match extent {
        Footprint::Exact => 0,
        Footprint::ThreeSigma => 1,
        Footprint::ThreeSigmaSquares => 2,
    }
}

/// How a renderer that measures differs from one that draws: not at all, by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variation {
    /// Blend counts its work: `Totals` from `evaluations_low` on. It takes longer.
    pub counts_work: bool,
    /// A certificate is made beside the picture, which is the same. It takes much longer.
    pub certifies: bool,
}
