//! Measurements of a scene's views under given options: time of a frame, and error of the pictures.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use anyhow::Result;

use super::Progress;
use super::report::{Point, StageTime};
use super::timing::Timing;
use crate::camera::Camera;
use crate::gpu::{Device, Timestamps};
use crate::measure::bench::{Protocol, Statistics, notice, stage_times};
use crate::measure::metrics::{Difference, mse};
use crate::options::{Options, Storage};
use crate::packing;
use crate::pixels::Pixels;
use crate::reference;
use crate::render::{Frame, GpuScene, Renderer};
use crate::rules::{Background, Rules};
use crate::scene::Gaussians;

/// A scene, its views, and the pictures that others are compared with.
pub struct Study<'a> {
    pub device: &'a Device,
    pub gaussians: &'a Gaussians,
    pub statistics: &'a packing::Statistics,
    /// The exact options: the rules of the pictures, and every knob at its most exact step.
    pub exact: Options,
    /// The views at full size, at which time is measured.
    pub views: Vec<Camera>,
    /// The same views at the size of the reference pictures.
    pub small_views: Vec<Camera>,
    timing: Timing,
    pub background: Background,
    /// `views`, drawn by the GPU with the exact options.
    exact_pictures: Vec<Pixels>,
    /// `small_views`, drawn by the reference.
    oracle_pictures: Vec<Pixels>,
    scenes: RefCell<Vec<(SceneKey, Rc<GpuScene>)>>,
}

/// The options that a scene on the GPU depends on: SH degree, storages, alpha threshold.
type SceneKey = (u32, [Storage; 2], f32);

/// Number of scenes that are kept on the GPU for other options with the same key.
const SCENES_KEPT: usize = 4;

impl<'a> Study<'a> {
    /// Draws the exact pictures and those of the reference. Warm-ups are brief.
    pub fn new(
        device: &'a Device,
        (gaussians, statistics): (&'a Gaussians, &'a packing::Statistics),
        (exact, background): (Options, Background),
        [views, small_views]: [Vec<Camera>; 2],
        protocol: Protocol,
        progress: Progress,
    ) -> Result<Self> {
        let mut oracle_pictures = Vec::new();
        for (done, view) in small_views.iter().enumerate() {
            progress(done as f64 / small_views.len() as f64)?;
            oracle_pictures.push(reference::render(gaussians, view, &exact.rules, background).to_pixels());
        }
        let mut study = Self {
            device,
            gaussians,
            statistics,
            exact,
            views,
            small_views,
            timing: Timing::new(protocol),
            background,
            exact_pictures: Vec::new(),
            oracle_pictures,
            scenes: RefCell::default(),
        };
        study.exact_pictures = study.draw(&exact, &study.views)?;
        Ok(study)
    }

    /// Uses the warm-up limits of reported times.
    #[must_use]
    pub fn thorough(self) -> Self {
        Self { timing: self.timing.thorough(), ..self }
    }

    /// Reduces frames and views so that a measurement takes at most about `patience`; warm-ups are brief if this
    /// cuts any.
    ///
    /// # Errors
    /// If rendering fails.
    pub fn within(mut self, patience: Duration) -> Result<Self> {
        let Some(view) = self.views.first() else { return Ok(self) };
        let scene = self.scene(&self.exact)?;
        let mut renderer = Renderer::new(self.device, &self.exact, &scene)?;
        self.timing.within(patience, &mut renderer, (view, self.background))?;
        let kept = self.timing.views(self.views.len());
        (self.views, self.exact_pictures) =
            kept.map(|i| (self.views[i].clone(), self.exact_pictures[i].clone())).unzip();
        Ok(self)
    }

    /// The scene on the GPU, stored as these options require.
    fn scene(&self, options: &Options) -> Result<Rc<GpuScene>> {
        let key = (options.sh_degree, [options.sh_storage, options.shape_storage], options.rules.alpha_min);
        let mut scenes = self.scenes.borrow_mut();
        if let Some((_, scene)) = scenes.iter().find(|(known, _)| *known == key) {
            return Ok(scene.clone());
        }
        if scenes.len() == SCENES_KEPT {
            scenes.remove(0);
        }
        let scene = Rc::new(GpuScene::with(self.device, self.gaussians, self.statistics, options)?);
        scenes.push((key, scene.clone()));
        Ok(scene)
    }

    fn draw(&self, options: &Options, views: &[Camera]) -> Result<Vec<Pixels>> {
        let scene = self.scene(options)?;
        draw(&mut Renderer::new(self.device, options, &scene)?, views, self.background)
    }

    /// Median GPU time of a frame over the views, in milliseconds.
    pub fn gpu_ms(&self, options: &Options) -> Result<f64> {
        let scene = self.scene(options)?;
        self.frame_ms(&mut Renderer::new(self.device, options, &scene)?)
    }

    fn frame_ms(&self, renderer: &mut Renderer) -> Result<f64> {
        self.timing.median_ms(renderer, &self.views, self.background)
    }

    fn frame(&self, renderer: &mut Renderer, i: usize) -> Result<Frame> {
        renderer.render(&self.views[i % self.views.len()], self.background)
    }

    /// Median GPU time of a frame, and the mean squared error of the worst view against the exact picture.
    pub(super) fn glance(&self, options: &Options) -> Result<(f64, f64)> {
        let pictures = self.draw(options, &self.views)?;
        let errors = pictures.iter().zip(&self.exact_pictures).map(|(a, b)| mse(a, b));
        Ok((self.gpu_ms(options)?, errors.fold(0.0, f64::max)))
    }

    /// Worst value of each measure against the exact pictures, over the views.
    pub fn from_exact(&self, options: &Options) -> Result<Difference> {
        Ok(worst_of(&each(&self.draw(options, &self.views)?, &self.exact_pictures)))
    }

    /// Worst value of each measure against the reference, over the small views.
    pub fn from_oracle(&self, options: &Options) -> Result<Difference> {
        Ok(worst_of(&self.each_from_oracle(options)?))
    }

    /// Difference of every small view from the reference.
    pub fn each_from_oracle(&self, options: &Options) -> Result<Vec<Difference>> {
        Ok(each(&self.draw(options, &self.small_views)?, &self.oracle_pictures))
    }

    /// Time, memory and errors under these options.
    pub fn point(&self, name: &str, options: &Options) -> Result<Point> {
        let scene = self.scene(options)?;
        let mut renderer = Renderer::new(self.device, options, &scene)?;
        let gpu_ms = self.frame_ms(&mut renderer)?;
        let warm_up = self.timing.warm_up.get();
        renderer.set_timestamps(Timestamps::All);
        let frame = |i: usize| Ok((self.frame(&mut renderer, i)?, renderer.path()));
        let staged = (0..self.protocol().frames).map(frame).collect::<Result<Vec<_>>>()?;
        let (staged, paths): (Vec<Frame>, Vec<_>) = staged.into_iter().unzip();
        let stage = |(name, ms): (&str, Statistics)| StageTime { stage: name.to_owned(), ms: ms.median };
        let bytes = |buffers: Vec<(&str, u64)>| buffers.iter().map(|(_, bytes)| bytes).sum();
        let (scene_bytes, work_bytes) = (bytes(scene.buffers()), bytes(renderer.buffers()));
        let notice = notice(&renderer, &paths);
        let mut from = |views: &[Camera], exact: &[Pixels]| {
            draw(&mut renderer, views, self.background).map(|all| worst_of(&each(&all, exact)))
        };
        Ok(Point {
            name: name.to_owned(),
            options: *options,
            drawn_by: paths[0],
            notice,
            warm_up,
            gpu_ms,
            stages: stage_times(staged.iter()).into_iter().map(stage).collect(),
            scene_bytes,
            work_bytes,
            from_oracle: from(&self.small_views, &self.oracle_pictures)?,
            from_exact: from(&self.views, &self.exact_pictures)?,
            is_pareto: false,
        })
    }

    /// The frames of every measurement.
    pub fn protocol(&self) -> Protocol {
        self.timing.protocol
    }

    /// The rules of the exact pictures.
    pub fn rules(&self) -> &Rules {
        &self.exact.rules
    }
}

pub(super) fn draw(renderer: &mut Renderer, views: &[Camera], background: Background) -> Result<Vec<Pixels>> {
    let picture = |view: &Camera| {
        renderer.render(view, background)?;
        renderer.pixels()
    };
    views.iter().map(picture).collect()
}

pub(super) fn each(pictures: &[Pixels], exact: &[Pixels]) -> Vec<Difference> {
    pictures.iter().zip(exact).map(|(a, b)| Difference::between(a, b)).collect()
}

pub(super) fn worst_of(all: &[Difference]) -> Difference {
    Difference::worst(all).expect("a study has at least one view")
}
