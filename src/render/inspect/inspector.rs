//! Looking inside the pipeline: pictures of what the Gaussians are and of what the stages do, a frame culled from
//! elsewhere, a Gaussian alone.

use std::mem::offset_of;

use anyhow::Result;

use crate::render::portable::blend::{Blending, Target, Variation, extent_code};
use crate::render::gpu_scene::GpuScene;
use crate::render::layout::Layout;
use crate::render::portable::pipeline::{chunks, subgroups};
use crate::render::shaders::inspect::*;
use crate::render::shaders::*;
use crate::render::frame::tiles;
use crate::render::portable::workspace::PortableWorkspace;
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::rules::Background;
use crate::pixels::{Depths, Pixels, Plane};

/// What a frame is looked at for. By default it is an ordinary one, and costs what that costs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inspection {
    pub look: Look,
    /// Gaussians are culled as seen from here, so that the camera may leave what is drawn and look at it from outside.
    pub culled_from: Option<Camera>,
    /// Only this Gaussian is drawn: its index in the scene.
    pub isolated: Option<u32>,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    /// The scene.
    #[default]
    Colour,
    /// An attribute of the Gaussians instead of their colours, blended as these are, over 0: the number as it is in all
    /// channels where it is one. Divided by alpha it is the mean over what is seen.
    Attribute(Attribute),
    /// What a pixel takes, counted or drawn instead of blended, over black.
    Work(Work),
}

/// In the order of recolour.comp's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// View z of the mean, world units.
    Depth,
    /// The shortest axis n, turned to the camera, in world axes: 0.5 + 0.5 n.
    Normal,
    /// Of the Gaussian, before antialiasing changes it.
    Opacity,
    /// log2 of the longest scale in world units; -126 for none.
    Size,
    /// log2 of the longest scale over the shortest.
    Anisotropy,
    /// Spherical harmonics of degree 0 alone.
    BaseColour,
    /// A colour for every index, the same in every frame.
    Identity,
}

/// The first three are counts, in all channels, with an alpha of 1. In the order of inspect.comp's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Entries of the tile's list.
    TileLoad,
    /// Entries of the list up to the one that stopped the pixel, that one included.
    Evaluations,
    /// Entries that were blended.
    Contributions,
    /// A dot of 1.5 px radius at the mean of every splat, the nearest on top; none beyond the tiles that list the splat.
    Centres,
    /// The outermost pixel of what every splat is drawn on, half transparent, front to back.
    Outlines,
    /// Not a picture but [`depths`]: the mean depth, the median, which is 0 where there is none, and the count of what was
    /// blended; and coverage.
    Depths,
}

/// What a picture of [`Work::Depths`] holds.
pub fn depths(picture: &Pixels) -> Depths {
    let plane =
        |value: fn(&[f32; 4]) -> f32| Plane { size: picture.size, values: picture.rgba.iter().map(value).collect() };
    Depths {
        expected: plane(|[mean, _, count, _]| if *count > 0.0 { *mean } else { f32::NAN }),
        median: plane(|[_, median, _, _]| if *median > 0.0 { *median } else { f32::NAN }),
        counts: plane(|[_, _, count, _]| *count),
    }
}

/// The pipelines of an inspection.
pub struct Inspector {
    pub(super) inspection: Inspection,
    narrow: Stage<Intersect>,
    picture: Picture,
}

enum Picture {
    Colour,
    Attribute(Stage<ShadeAttribute>),
    Work {
        /// The second resumes what the first began.
        stages: [Stage<Inspect>; 2],
        /// Where depths are what is looked at.
        recolour: Option<Stage<ShadeAttribute>>,
    },
}

impl Inspector {
    pub fn new(device: &Device, options: &Options, layout: &Layout, inspection: Inspection) -> Result<Self> {
        let recolour = |attribute: Attribute| {
            let constants = ShadeAttributeConstants {
                sh_degree: layout.sh_degree,
                sh_storage: layout.sh.code(),
                shape_storage: layout.shape.code(),
                attribute: attribute as u32,
            };
            Stage::new(device, &constants)
        };
        let picture = match inspection.look {
            Look::Colour => Picture::Colour,
            Look::Attribute(attribute) => Picture::Attribute(recolour(attribute)?),
            Look::Work(work) => {
                let rules = &options.rules;
                let stage = |resume| {
                    let constants = InspectConstants {
                        resume,
                        work: work as u32,
                        alpha_min: rules.alpha_min,
                        extent: extent_code(rules.extent),
                        alpha_max: rules.alpha_max,
                        transmittance_min: rules.transmittance_min,
                        stop: options.stop,
                    };
                    Stage::new(device, &constants)
                };
                Picture::Work {
                    stages: [stage(false)?, stage(true)?],
                    recolour: (work == Work::Depths).then(|| recolour(Attribute::Depth)).transpose()?,
                }
            }
        };
        Ok(Self { inspection, narrow: Stage::new(device, &())?, picture })
    }

    pub(super) fn culled_from(&self) -> Option<&Camera> {
        self.inspection.culled_from.as_ref()
    }

    /// Of what was culled from elsewhere leaves what `view` may see too, and of all Gaussians the isolated one. Begins
    /// behind a barrier, and ends with one.
    pub(super) fn narrow(&self, cmd: &mut Commands, scene: &GpuScene, view: View, work: &PortableWorkspace) {
        let Inspection { culled_from, isolated, .. } = &self.inspection;
        if culled_from.is_none() && isolated.is_none() {
            return;
        }
        let bindings = IntersectBindings {
            bounds: &scene.bounds,
            visible_masks: &work.visible_masks,
            chunk_counts: &work.chunk_counts,
        };
        let push = IntersectPush { view, chunks: chunks(scene), isolated: isolated.unwrap_or(u32::MAX) };
        cmd.dispatch(&self.narrow, bindings, push, DispatchSize::Invocations(work.visible_masks.len() as u64));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
    }

    /// Gives the splats the colours of an attribute, if one is looked at.
    pub(super) fn recolour(&self, cmd: &mut Commands, scene: &GpuScene, view: View, work: &PortableWorkspace) {
        let (Picture::Attribute(recolour) | Picture::Work { recolour: Some(recolour), .. }) = &self.picture
        else {
            return;
        };
        let bindings = ShadeAttributeBindings {
            totals: &work.totals,
            gaussian_from_splat: &work.gaussian_from_splat,
            bounds: &scene.bounds,
            grids: &scene.grids,
            shapes: scene.shape_planes(),
            sh: scene.sh_planes(),
            splats: &work.splats,
        };
        let groups = offset_of!(PortableDispatches, over_visible);
        cmd.scope("recolour", |cmd| {
            cmd.dispatch_indirect(recolour, bindings, ShadeAttributePush { view }, &work.dispatches, groups);
        });
    }

    /// The last act: every tile's part of the list of splats into the picture that is looked at. `blending` is what an
    /// ordinary frame ends with.
    pub(super) fn draw(
        &self,
        cmd: &mut Commands,
        blending: &Blending,
        view: (&GpuScene, &Camera),
        (work, splat_ids): (&PortableWorkspace, &Buffer<u32>),
        target: Target,
        passes: u32,
    ) {
        match &self.picture {
            Picture::Colour => cmd.scope("blend", |cmd| blending.record(cmd, view, work, splat_ids, target, passes)),
            Picture::Attribute(_) => {
                let target = Target { background: Background::Transparent, ..target };
                cmd.scope("blend", |cmd| blending.record(cmd, view, work, splat_ids, target, passes));
            }
            Picture::Work { stages, .. } => cmd.scope("inspect", |cmd| {
                walk(cmd, stages, blending.entries_per_pass, work, splat_ids, target, passes);
            }),
        }
    }
}

/// Walks every tile's list of `splat_ids`. What a blend can do in a pass, in more loops, is little enough for this.
fn walk(
    cmd: &mut Commands,
    stages: &[Stage<Inspect>; 2],
    entries_per_pass: u32,
    work: &PortableWorkspace,
    splat_ids: &Buffer<u32>,
    target: Target,
    passes: u32,
) {
    let image = target.image;
    let tiles: u32 = tiles(image.size()).iter().product();
    let (ranges, splats, totals) = (&work.ranges, &work.splats, &work.totals);
    for pass in 0..passes {
        if pass > 0 {
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        }
        let bindings = InspectBindings { ranges, splat_ids, splats, totals, image };
        let push = InspectPush {
            size_px: image.size(),
            tiles,
            background: Background::Transparent.colour(),
            pass_begin: pass * entries_per_pass,
            pass_limit: entries_per_pass,
            last_pass: u32::from(pass + 1 == passes),
        };
        cmd.dispatch(&stages[usize::from(pass > 0)], bindings, push, DispatchSize::Groups(tiles.into()));
    }
}
