//! One pixel explained: the splats that it is made of.

use anyhow::Result;

use crate::render::portable::blend::extent_code;
use crate::render::gpu_scene::GpuScene;
use crate::render::portable::pipeline::PortablePipeline;
use crate::render::shaders::inspect::*;
use crate::render::shaders::*;
use crate::render::frame::tiles;
use crate::render::portable::workspace::PortableWorkspace;
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::rules::{Background, TILE};

/// What a pixel is made of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Explanation {
    /// The splats that were blended, front to back.
    pub splats: Vec<Explained>,
    /// What is left for the background.
    pub transmittance: f32,
    /// The pixel ended before its list did.
    pub is_stopped: bool,
}

/// A splat's part of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Explained {
    /// Its index in the scene.
    pub gaussian: u32,
    /// View z of its mean, world units.
    pub depth: f32,
    pub alpha: f32,
    /// What those before it left.
    pub transmittance: f32,
    /// The attribute, where a picture of one is explained.
    pub colour: [f32; 3],
    /// alpha * transmittance.
    pub share: f32,
}

impl Explanation {
    /// The pixel: all shares over a background, in the order and the roundings of the blend.
    pub fn colour(&self, background: Background) -> [f32; 3] {
        let add =
            |share: f32, colour: [f32; 3], sum: [f32; 3]| std::array::from_fn(|i| share.mul_add(colour[i], sum[i]));
        let sum = self.splats.iter().fold([0.0; 3], |sum, splat| add(splat.share, splat.colour, sum));
        add(self.transmittance, background.colour(), sum)
    }

    /// View z of the splat behind which less than half is seen; where none is, the mean over what is seen, and nothing
    /// where nothing is.
    pub fn depth(&self) -> Option<f32> {
        let median = self.splats.iter().find(|splat| splat.transmittance * (1.0 - splat.alpha) < 0.5);
        let sum = |value: fn(&Explained) -> f64| self.splats.iter().map(value).sum::<f64>();
        let mean = || sum(|s| f64::from(s.share) * f64::from(s.depth)) / sum(|s| s.share.into());
        median.map(|splat| splat.depth).or_else(|| (!self.splats.is_empty()).then(|| mean() as f32))
    }
}

/// The pipeline that looks into a list.
pub(super) struct Explainer {
    options: Options,
    stage: Stage<Pick>,
}

impl Explainer {
    pub fn new(device: &Device, options: &Options) -> Result<Self> {
        let (rules, rest) = (&options.rules, PickConstants::default());
        let (alpha_min, alpha_max, extent) = (rules.alpha_min, rules.alpha_max, extent_code(rules.extent));
        let stage = Stage::new(device, &PickConstants { alpha_min, alpha_max, extent, ..rest })?;
        Ok(Self { options: *options, stage })
    }

    /// Explains a pixel of the complete frame that `work` holds, drawn by `renderer` and seen by `camera`.
    pub fn explain(
        &self,
        device: &Device,
        renderer: &PortablePipeline,
        (scene, camera): (&GpuScene, &Camera),
        work: &PortableWorkspace,
        pixel: [u32; 2],
    ) -> Result<Explanation> {
        let mut cmd = Commands::new(device)?;
        let ranges = cmd.read(&work.ranges)?;
        let results = cmd.submit()?.wait()?;
        let [tile_x, tile_y] = pixel.map(|place| place / TILE);
        let [first, end] = results.view(&ranges)[(tile_y * tiles(camera.size_px)[0] + tile_x) as usize];
        let count = end - first;

        let gaussians = Buffer::new(device, "explained gaussians", count as usize)?;
        let evidence = Buffer::<Evidence>::new(device, "evidence", count as usize)?;
        let bindings = PickBindings {
            splat_ids: renderer.splat_ids(work, camera),
            splats: &work.splats,
            gaussian_from_splat: &work.gaussian_from_splat,
            bounds: &scene.bounds,
            gaussians: &gaussians,
            evidence: &evidence,
        };
        let mut cmd = Commands::new(device)?;
        let push = PickPush { view: renderer.view(camera), first, count, pixel };
        cmd.dispatch(&self.stage, bindings, push, DispatchSize::Invocations(count.into()));
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let (gaussians, evidence) = (cmd.read(&gaussians)?, cmd.read(&evidence)?);
        let results = cmd.submit()?.wait()?;
        Ok(self.walk(results.view(&gaussians), results.view(&evidence)))
    }

    /// What blend_splat.glsl makes of a list, in its roundings.
    fn walk(&self, gaussians: &[u32], evidence: &[Evidence]) -> Explanation {
        let mut explanation = Explanation { transmittance: 1.0, ..Explanation::default() };
        for (gaussian, Evidence { depth, alpha, colour }) in gaussians.iter().copied().zip(evidence.iter().copied()) {
            if alpha == 0.0 {
                continue;
            }
            let transmittance = explanation.transmittance;
            let rest = transmittance * (1.0 - alpha);
            explanation.is_stopped = rest < self.options.rules.transmittance_min;
            if explanation.is_stopped {
                break;
            }
            let share = alpha * transmittance;
            explanation.splats.push(Explained { gaussian, depth, alpha, transmittance, colour, share });
            explanation.transmittance = rest;
            explanation.is_stopped = rest < self.options.stop;
            if explanation.is_stopped {
                break;
            }
        }
        explanation
    }
}
