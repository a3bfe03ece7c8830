//! The inspector: frames of the portable path that show attributes or work instead of colours, that are culled from
//! another camera, or that draw one Gaussian alone.

use std::cell::OnceCell;
use std::mem::offset_of;

use anyhow::Result;

use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::packing::Layout;
use crate::pixels::{Depths, Pixels, Plane};
use crate::render::band::Band;
use crate::render::constants::shared;
use crate::render::frame::{Shot, Target, tiles};
use crate::render::portable::{Pass, PortablePipeline, PortableWorkspace, Walk, chunks};
use crate::render::rays::{RaysFrame, RaysPipeline};
use crate::render::shaders::inspect::*;
use crate::render::shaders::{PortableDispatches, View};
use crate::rules::Background;

/// The settings of an inspection. The default is an ordinary frame and costs no more than one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inspection {
    pub look: Look,
    /// Gaussians are culled as seen from this camera, so that the frame's camera can look at them from outside.
    pub culled_from: Option<Camera>,
    /// Only this Gaussian is drawn: its index in the scene.
    pub isolated: Option<u32>,
}

impl Inspection {
    /// Shows an attribute.
    pub fn of_attribute(attribute: Attribute) -> Self {
        Self { look: Look::Attribute(attribute), ..Self::default() }
    }

    /// The attribute that is shown, if it is the only thing that is inspected.
    pub fn attribute(&self) -> Option<Attribute> {
        match self {
            Self { look: Look::Attribute(attribute), culled_from: None, isolated: None } => Some(*attribute),
            _ => None,
        }
    }

    /// True if pictures along rays can show it: there, no splat has a centre or an outline in pixels.
    pub(in crate::render) fn suits_rays(&self) -> bool {
        let has_glyphs = matches!(self.look, Look::Work(Work::Centres | Work::Outlines));
        !has_glyphs && self.culled_from.is_none() && self.isolated.is_none()
    }

    /// Draws the input of [`depths`].
    pub fn of_depths() -> Self {
        Self { look: Look::Work(Work::Depths), ..Self::default() }
    }
}

/// The quantity that a picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    /// The scene.
    #[default]
    Colour,
    /// An attribute of the Gaussians instead of their colours, blended like colours over 0. A number is in all three
    /// channels; divided by alpha it is the mean over the visible splats.
    Attribute(Attribute),
    /// The work that a pixel takes, counted or drawn instead of blended, over black.
    Work(Work),
}

/// An attribute of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// [Depth](Camera::depth) of the mean, world units.
    Depth = ATTRIBUTE_DEPTH as isize,
    /// 0.5 + 0.5 n in world axes, where n is the shortest axis, turned to the camera.
    Normal = ATTRIBUTE_NORMAL as isize,
    /// The opacity of the Gaussian, before antialiasing changes it.
    Opacity = ATTRIBUTE_OPACITY as isize,
    /// log2 of the longest scale in world units; -126 where all scales are 0.
    Size = ATTRIBUTE_SIZE as isize,
    /// log2 of the longest scale over the shortest.
    Anisotropy = ATTRIBUTE_ANISOTROPY as isize,
    /// The colour by spherical harmonics of degree 0 alone.
    BaseColour = ATTRIBUTE_BASE_COLOUR as isize,
    /// A colour per index, the same in every frame.
    Identity = ATTRIBUTE_IDENTITY as isize,
    /// The level of a node: 0 for a Gaussian of the scene, one more for each halving of their number.
    Level = ATTRIBUTE_LEVEL as isize,
    /// log2 of the root mean squared error of a pixel that a node alone causes in its footprint, as the table of levels
    /// predicts it, in steps of 1/255. -12 for no error.
    PredictedError = ATTRIBUTE_PREDICTED_ERROR as isize,
    /// The number of levels by which a node is coarser than requested, because pages with finer ones are missing.
    Lag = ATTRIBUTE_LAG as isize,
}

/// The work of a pixel. The first three are counts, in all channels, with an alpha of 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Instances in the tile's list.
    TileLoad = WORK_TILE_LOAD as isize,
    /// Instances of the list up to and including the one that stopped the pixel.
    Evaluations = WORK_EVALUATIONS as isize,
    /// Instances that were blended.
    Contributions = WORK_CONTRIBUTIONS as isize,
    /// A dot of 1.5 px radius at the mean of every splat, the nearest on top, within the tiles that list the splat.
    Centres = WORK_CENTRES as isize,
    /// The outermost pixels that every splat covers, half transparent, front to back.
    Outlines = WORK_OUTLINES as isize,
    /// Input of [`depths`], not a picture: red is the mean depth, green the median depth or 0, blue the number of
    /// blended splats, alpha the coverage.
    Depths = WORK_DEPTHS as isize,
}

/// Splits a picture of [`Work::Depths`] into planes.
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
    pub(in crate::render) inspection: Inspection,
    intersect: Stage<Intersect>,
    picture: Picture,
    /// Made for the first frame along rays.
    along_rays: OnceCell<RaysPicture>,
}

/// The stages of an inspection along rays, as those of [`Picture`].
struct RaysPicture {
    shade: Option<Stage<ShadeRays>>,
    inspect: Option<[Stage<InspectRays>; 2]>,
}

enum Picture {
    Colour,
    Attribute(Stage<ShadeAttribute>),
    Work {
        /// The first begins pixels, the second resumes them.
        stages: [Stage<Inspect>; 2],
        /// Shades splats by depth, for [`Work::Depths`].
        depth: Option<Stage<ShadeAttribute>>,
    },
}

impl Inspector {
    pub fn new(device: &Device, options: &Options, layout: &Layout, inspection: Inspection) -> Result<Self> {
        let constants = shared(options, layout, device.capabilities().subgroup_size[1]);
        let shade = |attribute: Attribute| {
            let attribute = attribute as u32;
            Stage::new(device, &ShadeAttributeConstants { attribute, ..ShadeAttributeConstants::of(&constants) })
        };
        let picture = match inspection.look {
            Look::Colour => Picture::Colour,
            Look::Attribute(attribute) => Picture::Attribute(shade(attribute)?),
            Look::Work(work) => {
                let stage = |resume| {
                    let constants = InspectConstants { resume, work: work as u32, ..InspectConstants::of(&constants) };
                    Stage::new(device, &constants)
                };
                Picture::Work {
                    stages: [stage(false)?, stage(true)?],
                    depth: (work == Work::Depths).then(|| shade(Attribute::Depth)).transpose()?,
                }
            }
        };
        Ok(Self { inspection, intersect: Stage::new(device, &())?, picture, along_rays: OnceCell::new() })
    }

    /// Makes the stages of frames along rays, if there are none yet.
    ///
    /// # Errors
    /// If a pipeline cannot be made.
    pub(in crate::render) fn prepare_rays(&self, device: &Device, options: &Options, layout: &Layout) -> Result<()> {
        if self.along_rays.get().is_some() {
            return Ok(());
        }
        let constants = shared(options, layout, device.capabilities().subgroup_size[1]);
        let (attribute, work) = match self.inspection.look {
            Look::Colour => (None, None),
            Look::Attribute(attribute) => (Some(attribute), None),
            Look::Work(work) => ((work == Work::Depths).then_some(Attribute::Depth), Some(work as u32)),
        };
        let shade = |attribute: Attribute| {
            let attribute = attribute as u32;
            Stage::new(device, &ShadeRaysConstants { attribute, ..ShadeRaysConstants::of(&constants) })
        };
        let inspect = |work| {
            let stage = |resume| {
                Stage::new(device, &InspectRaysConstants { resume, work, ..InspectRaysConstants::of(&constants) })
            };
            anyhow::Ok([stage(false)?, stage(true)?])
        };
        let made = RaysPicture { shade: attribute.map(shade).transpose()?, inspect: work.map(inspect).transpose()? };
        self.along_rays.set(made).ok().expect("there were none");
        Ok(())
    }

    /// Records a frame along rays that shows the inspected quantity in place of colours.
    ///
    /// # Panics
    /// If its stages are not [prepared](Self::prepare_rays).
    pub(in crate::render) fn record_rays(
        &self,
        cmd: &mut Commands,
        (pipeline, portable): (&RaysPipeline, &PortablePipeline),
        frame: RaysFrame,
        target: Target,
        passes: u32,
    ) {
        let RaysPicture { shade, inspect } = self.along_rays.get().expect("an inspection along rays is prepared");
        let RaysFrame { shot: Shot { scene, camera, .. }, tables, work, splats } = frame;
        pipeline.record_splats(cmd, portable, frame);
        if let Some(stage) = shade {
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            let bindings = ShadeRaysBindings {
                totals: &work.totals,
                gaussian_from_splat: &work.gaussian_from_splat,
                bounds: &scene.bounds,
                grids: &scene.grids,
                shapes: scene.shape_planes(),
                sh: scene.sh_planes(),
                splats,
            };
            let push = ShadeRaysPush { view: portable.view(camera), is_parallel: camera.is_parallel().into() };
            let groups = offset_of!(PortableDispatches, over_visible);
            cmd.scope("shade attribute", |cmd| cmd.dispatch_indirect(stage, bindings, push, &work.dispatches, groups));
        }
        let splat_ids = pipeline.record_lists(cmd, portable, frame);
        let target = match shade {
            Some(_) => Target { background: Background::Transparent, ..target },
            None => target,
        };
        let Some(stages) = inspect else {
            return cmd.scope("blend", |cmd| pipeline.blend(cmd, portable, frame, splat_ids, target, passes));
        };
        let (image, rays) = (target.image, &tables.lens.rays);
        let tiles: u32 = tiles(image.size()).iter().product();
        let (size_px, background) = (image.size(), Background::Transparent.colour());
        let (ranges, totals) = (&work.ranges, &work.totals);
        cmd.scope("inspect", |cmd| {
            Walk::whole(passes).record(cmd, portable.blending.entries_per_pass, |cmd, pass| {
                let Pass { stage, begin: pass_begin, limit: pass_limit, last: last_pass } = pass;
                let bindings = InspectRaysBindings { ranges, splat_ids, splats, totals, image, rays };
                let push = InspectRaysPush { size_px, tiles, background, pass_begin, pass_limit, last_pass };
                cmd.dispatch(&stages[stage], bindings, push, DispatchSize::Groups(tiles.into()));
            });
        });
    }

    /// Records a frame of the portable path that shows the inspected quantity in place of colours.
    pub(in crate::render) fn record(
        &self,
        cmd: &mut Commands,
        pipeline: &PortablePipeline,
        shot: Shot,
        work: &PortableWorkspace,
        target: Target,
        passes: u32,
    ) {
        let view = shot.view(pipeline.view(shot.camera).near);
        let culled_from = self.inspection.culled_from.as_ref();
        pipeline.clear(cmd, work);
        cmd.scope("cull", |cmd| {
            pipeline.cull(cmd, shot.scene, culled_from.map_or(view, |camera| pipeline.sampled_view(camera)), work);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            self.intersect(cmd, shot, view, work);
            pipeline.compact(cmd, shot.scene, work);
        });
        pipeline.project_visible(cmd, shot, view, work);
        self.shade(cmd, shot, view, work);
        let splat_ids = pipeline.bin(cmd, shot, work);
        match &self.picture {
            Picture::Colour => cmd.scope("blend", |cmd| pipeline.blend(cmd, shot, work, splat_ids, target, passes)),
            Picture::Attribute(_) => {
                let target = Target { background: Background::Transparent, ..target };
                cmd.scope("blend", |cmd| pipeline.blend(cmd, shot, work, splat_ids, target, passes));
            }
            Picture::Work { stages, .. } => cmd.scope("inspect", |cmd| {
                let (entries_per_pass, walk) = (pipeline.blending.entries_per_pass, Walk::whole(passes));
                walk_lists(cmd, stages, entries_per_pass, work, splat_ids, (target, shot.band), walk);
            }),
        }
    }

    /// True if it draws depths, the only inspection that slabs draw.
    pub(in crate::render) fn is_of_depths(&self) -> bool {
        self.inspection == Inspection::of_depths()
    }

    /// Walks the lists of one slab.
    pub(in crate::render) fn walk_slab(
        &self,
        cmd: &mut Commands,
        pipeline: &PortablePipeline,
        work: &PortableWorkspace,
        splat_ids: &Buffer<u32>,
        target: (Target, Band),
        walk: Walk,
    ) {
        let Picture::Work { stages, .. } = &self.picture else {
            unreachable!("of all inspections, slabs draw depths only")
        };
        walk_lists(cmd, stages, pipeline.blending.entries_per_pass, work, splat_ids, target, walk);
    }

    /// Intersects the visible set, which was culled from another camera, with the Gaussians that `view` may see; if a
    /// Gaussian is isolated, keeps only that one. Begins after a barrier and ends with one.
    fn intersect(&self, cmd: &mut Commands, Shot { scene, .. }: Shot, view: View, work: &PortableWorkspace) {
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
        let words = work.visible_masks.len() as u64;
        cmd.dispatch(&self.intersect, bindings, push, DispatchSize::Invocations(words));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
    }

    /// Gives the splats the colours of the inspected attribute, if there is one.
    fn shade(&self, cmd: &mut Commands, Shot { scene, .. }: Shot, view: View, work: &PortableWorkspace) {
        let (Picture::Attribute(stage) | Picture::Work { depth: Some(stage), .. }) = &self.picture else { return };
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
        cmd.scope("shade attribute", |cmd| {
            cmd.dispatch_indirect(stage, bindings, ShadeAttributePush { view }, &work.dispatches, groups);
        });
    }
}

/// Walks every tile's list of `splat_ids`. It takes fewer loop iterations per instance than a blend, so it can take the
/// `entries_per_pass` of a blend.
fn walk_lists(
    cmd: &mut Commands,
    stages: &[Stage<Inspect>; 2],
    entries_per_pass: u32,
    work: &PortableWorkspace,
    splat_ids: &Buffer<u32>,
    (target, band): (Target, Band),
    walk: Walk,
) {
    let image = target.image;
    let tiles: u32 = tiles(image.size()).iter().product();
    let (ranges, splats, totals) = (&work.ranges, &work.splats, &work.totals);
    let (size_px, background) = (image.size(), Background::Transparent.colour());
    walk.record(cmd, entries_per_pass, |cmd, pass| {
        let Pass { stage, begin: pass_begin, limit: pass_limit, last: last_pass } = pass;
        let bindings = InspectBindings { ranges, splat_ids, splats, totals, image };
        let push = InspectPush { size_px, top_px: band.top, tiles, background, pass_begin, pass_limit, last_pass };
        cmd.dispatch(&stages[stage], bindings, push, DispatchSize::Groups(tiles.into()));
    });
}
