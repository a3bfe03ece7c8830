//! Plans of pictures, and their builds by jobs: a scene on the GPU with its renderer.

use std::sync::Arc;
use std::time::SystemTime;

use anyhow::{Result, bail};

use super::loaded_scene::{LoadedScene, are_same};
use crate::camera::Camera;
use crate::gpu::{Device, Image};
use crate::options::Options;
use crate::packing::{Layout, Statistics};
use crate::render::{Content, Frame, GpuScene, Inspection, Path, Renderer, Residency, SceneSource, Upload};
use crate::rules::Background;
use crate::scene::{Gaussians, SceneInstances, Transform};

/// One of the two pictures that a window can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    First,
    Second,
}

/// A picture to draw: scenes with their transforms, the options, and the version of the shaders.
#[derive(Clone)]
pub struct Plan {
    pub scenes: Vec<(LoadedScene, Transform)>,
    pub options: Options,
    /// The newest change of shaders that are compiled at run time.
    pub shaders: Option<SystemTime>,
}

/// A scene on the GPU, and its picture.
pub struct Drawn {
    pub plan: Plan,
    /// The joined scenes, in world space; `None` for a paged scene.
    pub gaussians: Option<Arc<Gaussians>>,
    pub statistics: Arc<Statistics>,
    source: SceneSource,
    /// The layout of the scene for the options.
    layout: Layout,
    pub scene: GpuScene,
    pub renderer: Renderer,
    /// Number of the build; distinguishes this picture from one that it replaced.
    pub generation: u64,
    /// The first frame, which is complete; its totals are updated by later frames.
    pub frame: Frame,
    /// The path that drew the frame of these totals.
    pub path: Path,
    pub inspection: Inspection,
}

impl Plan {
    pub fn is_same(&self, other: &Self) -> bool {
        self.options == other.options && self.shaders == other.shaders && self.has_scene_of(other)
    }

    /// True if both plans draw the same Gaussians with the same transforms.
    pub fn has_scene_of(&self, other: &Self) -> bool {
        are_same(&self.scenes, &other.scenes)
    }

    /// True if a scene is paged.
    pub fn is_paged(&self) -> bool {
        self.scenes.iter().any(|(scene, _)| matches!(scene, LoadedScene::Paged(_)))
    }

    /// Uploads the scene and draws it once, reusing equal parts of `reusable`. With a generation, later pictures do not
    /// wait for pages; without one, every picture shows all pages.
    pub fn build(
        self,
        device: &Device,
        reusable: Option<Reusable>,
        view: &Camera,
        background: Background,
        generation: Option<u64>,
    ) -> Result<Drawn> {
        let reusable = reusable.filter(|old| old.plan.has_scene_of(&self));
        let (source, statistics) = match &reusable {
            Some(old) => (old.source.clone(), old.statistics.clone()),
            None => {
                let source = self.source()?;
                let statistics = match &source.content {
                    Content::Memory { statistics, .. } => statistics.clone(),
                    Content::File(file) => Arc::new(file.header().statistics.clone()),
                };
                (source, statistics)
            }
        };
        let options = match self.is_paged() && !self.options.wants_levels() {
            true => Options { lod_fade: self.options.lod_fade, ..self.options.finest() },
            false => self.options,
        };
        let layout = match self.is_paged() {
            true => Layout::of_nodes(&statistics, &options),
            false => Layout::of(&statistics, &options),
        };
        let same_threshold = |old: &Reusable| old.plan.options.rules.alpha_min == options.rules.alpha_min;
        let scene = match reusable.filter(|old| old.layout == layout && same_threshold(old)) {
            Some(old) => old.scene,
            None => {
                let pixels: u64 = view.size_px.iter().map(|side| u64::from(*side)).product();
                source.upload_with(device, &options, Upload::reserving(BYTES_PER_PIXEL * pixels))?
            }
        };
        let mut renderer = Renderer::new(device, &options, &scene)?;
        if generation.is_some() {
            renderer.enable_page_streaming()?;
        }
        // Where rays cannot show the scene, the window goes back to a pinhole, with a message.
        let is_refused = view.lens.is_some() && renderer.refused(view, None).is_some();
        let pinhole = is_refused.then(|| view.with_lens(None));
        let frame = renderer.render(pinhole.as_ref().unwrap_or(view), background)?;
        let path = renderer.path();
        // Inspection and explanations then need not wait for pipelines.
        if !self.is_paged() {
            renderer.prepare_portable()?;
        }
        let (inspection, generation) = (Inspection::default(), generation.unwrap_or_default());
        let gaussians = match &source.content {
            Content::Memory { gaussians, .. } => Some(gaussians.clone()),
            Content::File(_) => None,
        };
        let plan = self;
        Ok(Drawn { plan, gaussians, statistics, source, layout, scene, renderer, generation, frame, path, inspection })
    }

    /// The scene to upload.
    fn source(&self) -> Result<SceneSource> {
        match &self.scenes[..] {
            [(LoadedScene::Paged(file), transform)] => {
                let placed = (*transform != Transform::IDENTITY).then(|| SceneInstances::new(vec![*transform]));
                Ok(SceneSource { instances: placed.transpose()?, ..SceneSource::of_file(file.clone()) })
            }
            _ => {
                let gaussians = self.joined()?;
                let statistics = Arc::new(Statistics::of(&gaussians));
                Ok(SceneSource::shared(gaussians, statistics))
            }
        }
    }

    /// The scenes, transformed and joined.
    pub fn joined(&self) -> Result<Arc<Gaussians>> {
        let whole = |scene: &LoadedScene| match scene {
            LoadedScene::Whole(gaussians) => Ok(gaussians.clone()),
            LoadedScene::Paged(_) => bail!("a scene with levels of detail is drawn alone: hide or close the others"),
        };
        if let [(LoadedScene::Whole(gaussians), transform)] = &self.scenes[..]
            && *transform == Transform::IDENTITY
        {
            return Ok(gaussians.clone());
        }
        let placed = self.scenes.iter().map(|(scene, transform)| whole(scene)?.transformed(transform));
        let placed = placed.collect::<Result<Vec<_>>>()?;
        Ok(Arc::new(Gaussians::joined(placed.iter())?))
    }
}

/// The parts of a picture that the build of another picture may reuse.
pub struct Reusable {
    plan: Plan,
    source: SceneSource,
    statistics: Arc<Statistics>,
    layout: Layout,
    scene: GpuScene,
}

/// The message that `what` needs a whole scene, but the scene is paged.
pub fn needs_whole(what: &str) -> String {
    format!(
        "{what} needs the whole scene in memory, but scenes with levels of detail are read page by page: open the file \
         that they were made from"
    )
}

/// Device memory for pictures and panels, per pixel of the window.
const BYTES_PER_PIXEL: u64 = 64;

impl Drawn {
    pub fn reusable(&self) -> Reusable {
        Reusable {
            plan: self.plan.clone(),
            source: self.source.clone(),
            statistics: self.statistics.clone(),
            layout: self.layout.clone(),
            scene: self.scene.clone(),
        }
    }

    /// The residency of its pages, if it is drawn without waiting for them.
    pub fn residency(&self) -> Option<Residency> {
        self.renderer.residency()
    }

    /// Device memory: name and bytes of every buffer.
    pub fn buffers(&self) -> Vec<(String, u64)> {
        let all = self.scene.buffers().into_iter().chain(self.renderer.buffers());
        all.map(|(name, bytes)| (name.to_owned(), bytes)).collect()
    }
}

/// The two pictures of a viewer.
#[derive(Default)]
pub struct Pair {
    pub first: Option<Drawn>,
    pub second: Option<Second>,
}

/// The picture with which the first one is compared.
pub enum Second {
    Drawn(Box<Drawn>),
    /// A picture that the GPU did not draw, in the size of the first.
    Image(Image),
}

impl Second {
    pub fn drawn(&self) -> Option<&Drawn> {
        match self {
            Self::Drawn(drawn) => Some(drawn),
            Self::Image(_) => None,
        }
    }
}

impl Pair {
    /// The pictures that the GPU draws, by side.
    pub fn drawn(&mut self) -> impl Iterator<Item = (Side, &mut Drawn)> {
        let second = self.second.as_mut().and_then(|second| match second {
            Second::Drawn(drawn) => Some((Side::Second, &mut **drawn)),
            Second::Image(_) => None,
        });
        self.first.as_mut().map(|drawn| (Side::First, drawn)).into_iter().chain(second)
    }
}
