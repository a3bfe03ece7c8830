//! A scene's views under given options: how long a frame takes, and how far pictures are from the exact ones.

use std::cell::RefCell;
use std::rc::Rc;

use anyhow::Result;

use super::report::{Point, StageTime};
use crate::measure::bench::{Protocol, Statistics, frame_ms, stage_times};
use crate::camera::Camera;
use crate::gpu::{Device, Timestamps};
use crate::measure::metrics::{Difference, mse};
use crate::options::{Options, Storage};
use crate::rules::{Background, Rules};
use crate::pixels::Pixels;
use crate::reference;
use crate::render::{Frame, GpuScene, Renderer};
use crate::scene::{Gaussians, Requirements};

/// A scene, its views, and the pictures that others are held against.
pub struct Study<'a> {
    pub device: &'a Device,
    pub gaussians: &'a Gaussians,
    pub needs: &'a Requirements,
    /// With no knob turned.
    pub exact: Options,
    /// At full size, where time is measured.
    pub views: Vec<Camera>,
    /// The same views at the size at which the reference is drawn.
    pub small_views: Vec<Camera>,
    pub protocol: Protocol,
    pub background: Background,
    /// Of `views`, drawn exactly on the GPU; and of `small_views`, by the reference.
    exact_pictures: Vec<Pixels>,
    oracle_pictures: Vec<Pixels>,
    scenes: RefCell<Vec<(Kept, Rc<GpuScene>)>>,
}

/// What a scene on the GPU depends on.
type Kept = (u32, [Storage; 2], f32);

/// Scenes that are kept for the next options that store them alike.
const SCENES_KEPT: usize = 4;

impl<'a> Study<'a> {
    /// Draws the exact pictures and those of the reference. `progress` is told the fraction done.
    pub fn new(
        device: &'a Device,
        (gaussians, needs): (&'a Gaussians, &'a Requirements),
        (exact, background): (Options, Background),
        [views, small_views]: [Vec<Camera>; 2],
        protocol: Protocol,
        progress: &dyn Fn(f64),
    ) -> Result<Self> {
        let mut oracle_pictures = Vec::new();
        for (done, view) in small_views.iter().enumerate() {
            progress(done as f64 / small_views.len() as f64);
            oracle_pictures.push(reference::render(gaussians, view, &exact.rules, background).to_pixels());
        }
        let mut study = Self {
            device,
            gaussians,
            needs,
            exact,
            views,
            small_views,
            protocol,
            background,
            exact_pictures: Vec::new(),
            oracle_pictures,
            scenes: RefCell::default(),
        };
        study.exact_pictures = study.draw(&exact, &study.views)?;
        Ok(study)
    }

    /// The scene on the GPU as these options keep it.
    fn scene(&self, options: &Options) -> Result<Rc<GpuScene>> {
        let kept = (options.sh_degree, [options.sh_storage, options.shape_storage], options.rules.alpha_min);
        let mut scenes = self.scenes.borrow_mut();
        if let Some((_, scene)) = scenes.iter().find(|(known, _)| *known == kept) {
            return Ok(scene.clone());
        }
        if scenes.len() == SCENES_KEPT {
            scenes.remove(0);
        }
        let scene = Rc::new(GpuScene::with(self.device, self.gaussians, self.needs, options)?);
        scenes.push((kept, scene.clone()));
        Ok(scene)
    }

    fn draw(&self, options: &Options, views: &[Camera]) -> Result<Vec<Pixels>> {
        let scene = self.scene(options)?;
        draw(&mut Renderer::new(self.device, options, &scene)?, views, self.background)
    }

    /// How long a frame takes, over the views: the median GPU time in milliseconds.
    pub fn gpu_ms(&self, options: &Options) -> Result<f64> {
        let scene = self.scene(options)?;
        self.frame_ms(&mut Renderer::new(self.device, options, &scene)?)
    }

    fn frame_ms(&self, still: &mut Renderer) -> Result<f64> {
        still.set_timestamps(Timestamps::Outermost);
        self.protocol.warm_up(|i| self.frame(still, i).map(drop))?;
        let frames = (0..self.protocol.frames).map(|i| Ok(frame_ms(&self.frame(still, i)?)));
        Ok(Statistics::of(frames.collect::<Result<Vec<f64>>>()?).median)
    }

    fn frame(&self, still: &mut Renderer, i: usize) -> Result<Frame> {
        still.render(&self.views[i % self.views.len()], self.background)
    }

    /// The median GPU time of a frame alone, and the mean squared error of the worst view against the exact one.
    pub(super) fn glance(&self, options: &Options) -> Result<(f64, f64)> {
        let pictures = self.draw(options, &self.views)?;
        let errors = pictures.iter().zip(&self.exact_pictures).map(|(a, b)| mse(a, b));
        Ok((self.gpu_ms(options)?, errors.fold(0.0, f64::max)))
    }

    /// The worst of each measure against the exact pictures, over the views.
    pub fn from_exact(&self, options: &Options) -> Result<Difference> {
        Ok(worst_of(&each(&self.draw(options, &self.views)?, &self.exact_pictures)))
    }

    /// The worst of each measure against the reference, over the small views.
    pub fn from_oracle(&self, options: &Options) -> Result<Difference> {
        Ok(worst_of(&self.each_from_oracle(options)?))
    }

    /// Every small view against the reference.
    pub fn each_from_oracle(&self, options: &Options) -> Result<Vec<Difference>> {
        Ok(each(&self.draw(options, &self.small_views)?, &self.oracle_pictures))
    }

    /// Time, memory and errors under these options.
    pub fn point(&self, name: &str, options: &Options) -> Result<Point> {
        let scene = self.scene(options)?;
        let mut still = Renderer::new(self.device, options, &scene)?;
        let gpu_ms = self.frame_ms(&mut still)?;
        still.set_timestamps(Timestamps::All);
        let staged = (0..self.protocol.frames).map(|i| self.frame(&mut still, i)).collect::<Result<Vec<Frame>>>()?;
        let stage = |(name, ms): (&str, Statistics)| StageTime { stage: name.to_owned(), ms: ms.median };
        let bytes = |buffers: Vec<(&str, u64)>| buffers.iter().map(|(_, bytes)| bytes).sum();
        let (scene_bytes, work_bytes) = (bytes(scene.buffers()), bytes(still.buffers()));
        let mut from = |views: &[Camera], exact: &[Pixels]| {
            draw(&mut still, views, self.background).map(|all| worst_of(&each(&all, exact)))
        };
        Ok(Point {
            name: name.to_owned(),
            options: *options,
            gpu_ms,
            stages: stage_times(staged.iter()).into_iter().map(stage).collect(),
            scene_bytes,
            work_bytes,
            from_oracle: from(&self.small_views, &self.oracle_pictures)?,
            from_exact: from(&self.views, &self.exact_pictures)?,
            is_pareto: false,
        })
    }

    /// The rules of the exact pictures.
    pub fn rules(&self) -> &Rules {
        &self.exact.rules
    }
}

fn draw(still: &mut Renderer, views: &[Camera], background: Background) -> Result<Vec<Pixels>> {
    let picture = |view: &Camera| {
        still.render(view, background)?;
        still.pixels()
    };
    views.iter().map(picture).collect()
}

fn each(pictures: &[Pixels], exact: &[Pixels]) -> Vec<Difference> {
    pictures.iter().zip(exact).map(|(a, b)| Difference::between(a, b)).collect()
}

pub(super) fn worst_of(all: &[Difference]) -> Difference {
    Difference::worst(all).expect("a study has a view")
}
