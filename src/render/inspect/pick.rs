//! The explanation of one pixel: the splats that it consists of.

use anyhow::Result;

use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::packing::Layout;
use crate::render::constants::shared;
use crate::render::frame::{Shot, tiles};
use crate::render::portable::{PortablePipeline, PortableWorkspace};
use crate::render::rays::RaysFrame;
use crate::render::shaders::Evidence;
use crate::render::shaders::inspect::*;
use crate::rules::{Background, TILE};

/// The splats that a pixel consists of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Explanation {
    /// The splats that were blended, front to back.
    pub splats: Vec<Explained>,
    /// The transmittance of the background.
    pub transmittance: f32,
    /// True if the pixel stopped before its list ended.
    pub is_stopped: bool,
}

/// One splat's contribution to a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Explained {
    /// Index of the Gaussian in the scene.
    pub gaussian: u32,
    /// [Depth](crate::camera::Camera::depth) of its mean, world units.
    pub depth: f32,
    pub alpha: f32,
    /// The transmittance behind the splats before it.
    pub transmittance: f32,
    /// The colour, or the attribute in a picture of one.
    pub colour: [f32; 3],
    /// alpha * transmittance.
    pub share: f32,
}

impl Explanation {
    /// The colour of the pixel: all shares over a background, in the order and with the rounding of the blend.
    pub fn colour(&self, background: Background) -> [f32; 3] {
        let add =
            |share: f32, colour: [f32; 3], sum: [f32; 3]| std::array::from_fn(|i| share.mul_add(colour[i], sum[i]));
        let sum = self.splats.iter().fold([0.0; 3], |sum, splat| add(splat.share, splat.colour, sum));
        add(self.transmittance, background.colour(), sum)
    }

    /// Depth of the splat at which transmittance falls below one half; without one, the mean by shares; `None` where
    /// nothing was blended.
    pub fn depth(&self) -> Option<f32> {
        let median = self.splats.iter().find(|splat| splat.transmittance * (1.0 - splat.alpha) < 0.5);
        let sum = |value: fn(&Explained) -> f64| self.splats.iter().map(value).sum::<f64>();
        let mean = || sum(|s| f64::from(s.share) * f64::from(s.depth)) / sum(|s| s.share.into());
        median.map(|splat| splat.depth).or_else(|| (!self.splats.is_empty()).then(|| mean() as f32))
    }
}

/// The pipeline that reads a list at one pixel.
pub(in crate::render) struct Picker {
    transmittance_min: f32,
    stop: f32,
    stage: Stage<Pick>,
    along_rays: Stage<PickRays>,
}

/// A complete frame whose lists are read.
#[derive(Clone, Copy)]
pub(in crate::render) enum Listed<'f> {
    Portable(Shot<'f>, &'f PortableWorkspace),
    Rays(RaysFrame<'f>),
}

impl Picker {
    pub fn new(device: &Device, options: &Options, layout: &Layout) -> Result<Self> {
        let constants = shared(options, layout, device.capabilities().subgroup_size[1]);
        let (transmittance_min, stop) = (options.rules.transmittance_min, layout.stop(options));
        let stage = Stage::new(device, &PickConstants::of(&constants))?;
        let along_rays = Stage::new(device, &PickRaysConstants::of(&constants))?;
        Ok(Self { transmittance_min, stop, stage, along_rays })
    }

    /// Explains a pixel of a frame.
    pub fn explain(
        &self,
        device: &Device,
        pipeline: &PortablePipeline,
        listed: Listed,
        pixel: [u32; 2],
    ) -> Result<Explanation> {
        let (Shot { scene, camera, .. }, work) = match listed {
            Listed::Portable(shot, work) => (shot, work),
            Listed::Rays(RaysFrame { shot, work, .. }) => (shot, work),
        };
        let mut cmd = Commands::new(device)?;
        let ranges = cmd.read(&work.ranges)?;
        let results = cmd.submit()?.wait()?;
        let [tile_x, tile_y] = pixel.map(|column_or_row| column_or_row / TILE);
        let [first, end] = results.view(&ranges)[(tile_y * tiles(camera.size_px)[0] + tile_x) as usize];
        let count = end - first;

        let gaussians = Buffer::new(device, "explained gaussians", count as usize)?;
        let evidence = Buffer::<Evidence>::new(device, "evidence", count as usize)?;
        let splat_ids = pipeline.splat_ids(work, tiles(camera.size_px).iter().product());
        let (gaussian_from_splat, bounds) = (&work.gaussian_from_splat, &scene.bounds);
        let (view, groups) = (pipeline.view(camera), DispatchSize::Invocations(count.into()));
        let mut cmd = Commands::new(device)?;
        match listed {
            Listed::Portable(..) => {
                let (splats, gaussians, evidence) = (&work.splats, &gaussians, &evidence);
                let bindings = PickBindings { splat_ids, splats, gaussian_from_splat, bounds, gaussians, evidence };
                cmd.dispatch(&self.stage, bindings, PickPush { view, first, count, pixel }, groups);
            }
            Listed::Rays(RaysFrame { tables, splats, .. }) => {
                let (gaussians, evidence, rays) = (&gaussians, &evidence, &tables.lens.rays);
                let bindings =
                    PickRaysBindings { splat_ids, splats, gaussian_from_splat, bounds, gaussians, evidence, rays };
                let pixel = pixel[1] * camera.size_px[0] + pixel[0];
                let push = PickRaysPush { view, first, count, pixel, is_parallel: camera.is_parallel().into() };
                cmd.dispatch(&self.along_rays, bindings, push, groups);
            }
        }
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let (gaussians, evidence) = (cmd.read(&gaussians)?, cmd.read(&evidence)?);
        let results = cmd.submit()?.wait()?;
        Ok(self.walk(results.view(&gaussians), results.view(&evidence)))
    }

    /// Blends a list as blend_splat.glsl does, with the same rounding.
    fn walk(&self, gaussians: &[u32], evidence: &[Evidence]) -> Explanation {
        let mut explanation = Explanation { transmittance: 1.0, ..Explanation::default() };
        for (gaussian, Evidence { depth, alpha, colour }) in gaussians.iter().copied().zip(evidence.iter().copied()) {
            if alpha == 0.0 {
                continue;
            }
            let transmittance = explanation.transmittance;
            let rest = transmittance * (1.0 - alpha);
            explanation.is_stopped = rest < self.transmittance_min;
            if explanation.is_stopped {
                break;
            }
            let share = alpha * transmittance;
            explanation.splats.push(Explained { gaussian, depth, alpha, transmittance, colour, share });
            explanation.transmittance = rest;
            explanation.is_stopped = rest < self.stop;
            if explanation.is_stopped {
                break;
            }
        }
        explanation
    }
}
