//! Plans of pictures, and their builds by jobs: a scene on the GPU with its renderer.

use std::sync::Arc;
use std::time::SystemTime;

use anyhow::{Result, ensure};

use super::appearance::Appearance;
use super::edit::{Edit, joined_sets};
use super::level_error::LevelError;
use super::loaded_scene::{DrawnScene, LoadedScene, are_same, draw_same};
use super::sharing::{Sharing, SharingPlan};
use super::source::Source;
use crate::camera::Camera;
use crate::gpu::{Commands, Device, Image};
use crate::options::Options;
use crate::packing::{Layout, Statistics};
use crate::pagefile::PagedScene;
use crate::pixels::Pixels;
use crate::render::{
    Frame, GpuScene, Inspection, JoinedScenes, LimitSearch, Marker, Path, Quantity, Recorded, Renderer, Residency,
    SampledPsnr, SceneSource, Step, Upload,
};
use crate::rules::Background;
use crate::scene::{Gaussians, Transform};

/// One of the two pictures that a window can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    First,
    Second,
}

/// A picture to draw: scenes, the options, and the version of the shaders.
#[derive(Clone)]
pub struct Plan {
    pub scenes: Vec<DrawnScene>,
    pub options: Options,
    /// The newest change of shaders that are compiled at run time.
    pub shaders: Option<SystemTime>,
}

/// A scene on the GPU, and its picture.
pub struct Drawn {
    pub plan: Plan,
    /// The joined scenes on the device, in world space; `None` for a paged scene.
    pub gaussians: Option<Arc<Gaussians>>,
    pub statistics: Arc<Statistics>,
    source: Source,
    /// The layout of the scene for the options.
    layout: Layout,
    pub scene: GpuScene,
    /// The marks that the scene on the device has; `None` if they are not known.
    pub marks: Option<Marks>,
    /// Only the Gaussians that the edits leave are on the device, where all of them were drawn in pages.
    is_edited: bool,
    pub renderer: Renderer,
    /// Number of the build; distinguishes this picture from one that it replaced.
    pub generation: u64,
    /// The first frame, which is complete; its totals are updated by later frames.
    pub frame: Frame,
    /// The path that drew the frame of these totals.
    pub path: Path,
    pub inspection: Inspection,
    pub level_error: LevelError,
    /// The picture of the renderer has colours of 8 bits: other devices drew bands of it.
    is_rounded: bool,
    /// Set if other devices draw bands of the pictures.
    pub sharing: Option<Sharing>,
    /// The scene on the other devices, where an earlier picture left it.
    other_scenes: Vec<GpuScene>,
    /// The search of the error limit that keeps a PSNR in this view.
    search: Option<LimitSearch>,
    /// The view of the last search.
    searched: Option<(Camera, Background)>,
}

/// The marks of a scene on the device.
#[derive(Clone)]
pub struct Marks {
    pub edits: Vec<Option<Arc<Edit>>>,
    /// True if selected Gaussians are marked, too.
    pub has_selection: bool,
}

impl Marks {
    /// True if they mark the same Gaussians.
    pub fn is_same(&self, other: &Self) -> bool {
        let is_same = |(a, b): (&Option<Arc<Edit>>, &Option<Arc<Edit>>)| match (a, b) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        self.has_selection == other.has_selection
            && self.edits.len() == other.edits.len()
            && self.edits.iter().zip(&other.edits).all(is_same)
    }

    /// True if no Gaussian is marked.
    pub fn are_none(&self) -> bool {
        self.edits.iter().all(Option::is_none)
    }
}

impl Plan {
    pub fn is_same(&self, other: &Self) -> bool {
        self.options == other.options && self.shaders == other.shaders && draw_same(&self.scenes, &other.scenes)
    }

    /// True if both plans need the same Gaussians with the same transforms on the device.
    pub fn has_scene_of(&self, other: &Self) -> bool {
        are_same(&self.scenes, &other.scenes)
    }

    /// True if the scenes are drawn in pages: one has levels of detail, or is drawn at places of a list.
    pub fn is_paged(&self) -> bool {
        self.scenes.iter().any(|drawn| matches!(drawn.scene, LoadedScene::Paged(_)) || drawn.places.is_some())
    }

    /// True if a scene has levels of detail.
    pub fn has_levels(&self) -> bool {
        self.scenes.iter().any(|drawn| matches!(drawn.scene, LoadedScene::Paged(_)))
    }

    /// Number of Gaussians that are neither hidden nor deleted.
    pub fn drawn_count(&self) -> usize {
        let left_out = |edit: &Arc<Edit>| edit.counts().hidden + edit.counts().deleted;
        self.scenes.iter().map(|drawn| drawn.scene.count() - drawn.edit.as_ref().map_or(0, left_out)).sum()
    }

    fn leaves_out(&self) -> bool {
        self.scenes.iter().any(DrawnScene::leaves_out)
    }

    /// The marks of the edits, with the selected Gaussians or without.
    pub fn marks(&self, has_selection: bool) -> Marks {
        Marks { edits: self.scenes.iter().map(|drawn| drawn.edit.clone()).collect(), has_selection }
    }

    /// Marks the Gaussians of the joined scenes on the device.
    ///
    /// # Errors
    /// Memory runs out, or the device is lost.
    pub fn mark(&self, scene: &GpuScene, marker: &Marker, has_selection: bool) -> Result<()> {
        let sets = |set: &dyn Fn(&Edit) -> Vec<u32>| {
            joined_sets(self.scenes.iter().map(|drawn| {
                let count = drawn.scene.count();
                (count, drawn.edit.as_ref().map_or_else(|| vec![0; count.div_ceil(32)], |edit| set(edit)))
            }))
        };
        let left_out = sets(&|edit| edit.left_out().collect());
        let selected = match has_selection {
            true => sets(&|edit| edit.selected().to_vec()),
            false => vec![0; left_out.len()],
        };
        marker.mark(scene, &left_out, &selected)
    }

    /// Uploads the scene and draws it once, reusing equal parts of `reusable`. With a generation, later pictures do not
    /// wait for pages, and the caller marks a scene that is reused; without one, every picture shows all pages, the
    /// edits of the plan are marked, and the scene shares no marks with that of the window.
    pub fn build(
        self,
        device: &Device,
        reusable: Option<Reusable>,
        view: &Camera,
        background: Background,
        generation: Option<u64>,
    ) -> Result<Drawn> {
        let reusable = reusable.filter(|old| match old.has_marks() {
            true => old.plan.has_scene_of(&self),
            false => draw_same(&old.plan.scenes, &self.scenes),
        });
        let (mut source, mut statistics) = match &reusable {
            Some(old) => (old.source.clone(), old.statistics.clone()),
            None => {
                let source = self.source()?;
                let statistics = source.statistics();
                (source, statistics)
            }
        };
        let options = match self.has_levels() && !self.options.wants_levels() {
            true => Options { lod_fade: self.options.lod_fade, ..self.options.finest() },
            false => self.options,
        };
        let layout_of = |statistics: &Statistics| match self.has_levels() {
            true => Layout::of_nodes(statistics, &options),
            false => Layout::of(statistics, &options),
        };
        let mut layout = layout_of(&statistics);
        let same_threshold = |old: &Reusable| old.plan.options.rules.alpha_min == options.rules.alpha_min;
        let upload = |source: &Source| source.upload(device, &options, upload_of(view.size_px));
        let mut is_edited = reusable.as_ref().is_some_and(|old| old.is_edited);
        let reused = reusable.filter(|old| old.layout == layout && same_threshold(old));
        let is_reused = reused.is_some();
        let (reused, other_scenes) = reused.map(|old| (old.scene, old.other_scenes)).unzip();
        let mut scene = reused.map_or_else(|| upload(&source), Ok)?;
        if !is_reused && !is_edited && scene.is_paged() && source.gaussians().is_some() && self.leaves_out() {
            // Pages have no marks, so only the drawn Gaussians are in them.
            drop(scene);
            is_edited = true;
            let gaussians = self.edited()?;
            statistics = Arc::new(Statistics::of(&gaussians));
            source = Source::Scene(SceneSource::shared(gaussians, statistics.clone()));
            layout = layout_of(&statistics);
            scene = upload(&source)?;
        }
        let mut marks = (!is_reused).then(|| Marks { edits: vec![None; self.scenes.len()], has_selection: false });
        let has_marks = !scene.is_paged() && !is_edited;
        // The scene of the window is marked by its thread.
        if has_marks && if is_reused { generation.is_none() } else { self.leaves_out() } {
            let marker = Marker::new(device)?;
            scene = if is_reused { marker.separated(&scene)? } else { scene };
            self.mark(&scene, &marker, false)?;
            marks = Some(self.marks(false));
        }
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
        let gaussians = source.gaussians();
        let plan = self;
        Ok(Drawn {
            plan,
            gaussians,
            statistics,
            source,
            layout,
            scene,
            marks,
            is_edited,
            renderer,
            generation,
            frame,
            path,
            inspection,
            level_error: LevelError::default(),
            is_rounded: false,
            sharing: None,
            other_scenes: other_scenes.unwrap_or_default(),
            search: None,
            searched: None,
        })
    }

    /// The scene to upload: in pages if a scene has levels of detail, or is drawn at places of a list.
    fn source(&self) -> Result<Source> {
        if !self.is_paged() {
            let gaussians = self.joined(|drawn| drawn.whole())?;
            let statistics = Arc::new(Statistics::of(&gaussians));
            return Ok(Source::Scene(SceneSource::shared(gaussians, statistics)));
        }
        if let [DrawnScene { scene: LoadedScene::Paged(file), transform, places: None, .. }] = &self.scenes[..]
            && *transform == Transform::IDENTITY
        {
            return Ok(Source::Scene(SceneSource::of_file(file.clone())));
        }
        let placed = |drawn: &DrawnScene| {
            let LoadedScene::Paged(file) = &drawn.scene else {
                let gaussians = drawn.appearance.applied_to(drawn.drawn()?);
                let statistics = Arc::new(Statistics::of(&gaussians));
                return Ok((PagedScene::Memory(gaussians, statistics), drawn.instances()?));
            };
            Ok((PagedScene::File(file.clone()), drawn.instances()?))
        };
        Ok(Source::Joined(JoinedScenes::new(self.scenes.iter().map(placed).collect::<Result<_>>()?)?))
    }

    /// The drawn Gaussians of the scenes, transformed and joined.
    pub fn edited(&self) -> Result<Arc<Gaussians>> {
        self.joined(DrawnScene::drawn)
    }

    fn joined(&self, gaussians: impl Fn(&DrawnScene) -> Result<Arc<Gaussians>>) -> Result<Arc<Gaussians>> {
        if let [drawn] = &self.scenes[..]
            && drawn.transform == Transform::IDENTITY
            && drawn.appearance == Appearance::default()
        {
            return gaussians(drawn);
        }
        let placed = |drawn: &DrawnScene| gaussians(drawn)?.transformed(&drawn.transform);
        let placed = self.scenes.iter().map(|drawn| Ok(drawn.appearance.applied(placed(drawn)?)));
        let placed = placed.collect::<Result<Vec<_>>>()?;
        Ok(Arc::new(Gaussians::joined(placed.iter())?))
    }
}

/// The parts of a picture that the build of another picture may reuse.
#[derive(Clone)]
pub struct Reusable {
    plan: Plan,
    source: Source,
    statistics: Arc<Statistics>,
    layout: Layout,
    scene: GpuScene,
    /// The scene on the other devices, if it is there.
    other_scenes: Vec<GpuScene>,
    is_edited: bool,
}

impl Reusable {
    /// True if a plan needs the same Gaussians on the device.
    pub fn has_scene_of(&self, plan: &Plan) -> bool {
        self.plan.has_scene_of(plan)
    }

    /// As [`Drawn::has_marks`].
    fn has_marks(&self) -> bool {
        !self.scene.is_paged() && !self.is_edited
    }
}

/// The scene of a measurement.
pub enum MeasuredScene {
    Known((Arc<Gaussians>, Arc<Statistics>)),
    /// The drawn Gaussians of a plan, which a job has to put together.
    Edited(Plan),
}

impl MeasuredScene {
    /// The Gaussians and their statistics.
    ///
    /// # Errors
    /// Memory runs out, or no Gaussian is left.
    pub fn resolved(self) -> Result<(Arc<Gaussians>, Arc<Statistics>)> {
        match self {
            Self::Known(known) => Ok(known),
            Self::Edited(plan) => {
                let gaussians = plan.edited()?;
                ensure!(!gaussians.is_empty(), "no Gaussian is left: all are deleted or hidden");
                let statistics = Arc::new(Statistics::of(&gaussians));
                Ok((gaussians, statistics))
            }
        }
    }
}

/// The message that `what` needs a whole scene, but the scene is paged.
pub fn needs_whole(what: &str) -> String {
    format!(
        "{what} needs a scene that is in memory as a whole and drawn once: scenes with levels of detail, and scenes at \
         places of a list, are drawn in pages"
    )
}

/// Device memory for pictures and panels, per pixel of the window.
const BYTES_PER_PIXEL: u64 = 64;

/// An upload that leaves memory for pictures of this size.
fn upload_of(size_px: [u32; 2]) -> Upload {
    Upload::reserving(BYTES_PER_PIXEL * size_px.iter().map(|side| u64::from(*side)).product::<u64>())
}

impl Drawn {
    /// The parts that another build may reuse.
    pub fn reusable(&self) -> Reusable {
        Reusable {
            plan: self.plan.clone(),
            source: self.source.clone(),
            statistics: self.statistics.clone(),
            layout: self.layout.clone(),
            scene: self.scene.clone(),
            other_scenes: self.sharing.as_ref().map_or(&self.other_scenes, |sharing| &sharing.scenes).clone(),
            is_edited: self.is_edited,
        }
    }

    /// What other devices need to draw bands of the pictures of a view; `None` if they do, or if such pictures are
    /// drawn by one device: in pages, along rays, or at a lower scale.
    pub fn sharing_plan(&self, view: &Camera) -> Option<SharingPlan> {
        let options = &self.plan.options;
        let is_alone = Renderer::is_along_rays(options, view) || Renderer::whole_because(options, view).is_some();
        let can_share = !self.scene.is_paged() && !is_alone;
        (self.sharing.is_none() && can_share).then(|| SharingPlan {
            reserve: upload_of(view.size_px),
            options: *options,
            source: self.source.clone(),
            scenes: self.other_scenes.clone(),
            generation: self.generation,
        })
    }

    /// Records the drawing of a picture. With `may_share`, it is in bands where other devices help and it pays, and the
    /// function returns true with the frame: its colours are rounded, and it has no alpha. Edited and inspected
    /// pictures are drawn by the first device.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn record(
        &mut self,
        cmd: &mut Commands,
        (camera, background): (&Camera, Background),
        may_share: bool,
    ) -> Result<(Recorded, bool)> {
        let is_plain = self.inspection == Inspection::default() && self.marks.as_ref().is_some_and(Marks::are_none);
        let sharing = self.sharing.as_mut().filter(|_| may_share && is_plain);
        let sharing = sharing.filter(|sharing| sharing.devices.are_used(camera));
        self.is_rounded = false;
        let recorded = match sharing {
            Some(Sharing { devices, .. }) => {
                let recorded = devices.record(&mut self.renderer, cmd, camera, background)?;
                self.is_rounded = !devices.last_bands().is_empty();
                recorded
            }
            None => {
                self.sharing.iter_mut().for_each(|sharing| sharing.devices.forget_bands());
                self.renderer.record(cmd, camera, background)?
            }
        };
        Ok((recorded, self.is_rounded))
    }

    /// The pixels of the picture drawn last, which was one of this view.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn pixels(&mut self, view: Option<&Camera>, background: Background) -> Result<Pixels> {
        if let Some(camera) = view.filter(|_| self.is_rounded) {
            self.renderer.render(camera, background)?;
            self.is_rounded = false;
        }
        self.renderer.pixels()
    }

    /// True if all Gaussians are on the device, with marks that leave some out: pages have no marks.
    pub fn has_marks(&self) -> bool {
        !self.scene.is_paged() && !self.is_edited
    }

    /// True if the scenes of this plan need no other build: at most other marks.
    pub fn suits_scenes(&self, plan: &Plan) -> bool {
        match self.has_marks() {
            true => self.plan.has_scene_of(plan),
            false => draw_same(&self.plan.scenes, &plan.scenes),
        }
    }

    /// The scene of the plan that has a Gaussian of the joined scenes on the device, and its index there.
    pub fn origin(&self, gaussian: usize) -> Option<(&DrawnScene, usize)> {
        let mut left = gaussian;
        for drawn in &self.plan.scenes {
            let remaining = drawn.edit.as_ref().filter(|_| self.is_edited).map(|edit| edit.drawn());
            let count = remaining.as_ref().map_or(drawn.scene.count(), Vec::len);
            if left < count {
                return Some((drawn, remaining.map_or(left, |remaining| remaining[left] as usize)));
            }
            left -= count;
        }
        None
    }

    /// True if a picture of this plan needs no other build.
    pub fn suits(&self, plan: &Plan) -> bool {
        self.plan.options == plan.options && self.plan.shaders == plan.shaders && self.suits_scenes(plan)
    }

    /// The drawn Gaussians and their statistics, for a measurement; `None` for a paged scene.
    pub fn measured(&self) -> Option<MeasuredScene> {
        let known = (self.gaussians.clone()?, self.statistics.clone());
        let is_whole = self.is_edited || !self.plan.leaves_out();
        Some(if is_whole { MeasuredScene::Known(known) } else { MeasuredScene::Edited(self.plan.clone()) })
    }

    /// The residency of its pages, if it is drawn without waiting for them.
    pub fn residency(&self) -> Option<Residency> {
        self.renderer.residency()
    }

    /// True if it shows the levels of detail that are asked for, and their error can be measured.
    pub fn has_measurable_levels(&self) -> bool {
        self.renderer.measures_levels() && self.residency().is_none_or(|pages| pages.missing == 0)
    }

    /// True if the error of this picture of it is known, or cannot be known.
    pub fn is_measured(&self, camera: &Camera, background: Background) -> bool {
        let LevelError::Ended(measurement, _) = &self.level_error else { return false };
        self.has_measurable_levels() && self.renderer.is_measured_by(measurement, camera, background)
    }

    /// Begins to measure the error of the levels of a picture. True if the levels changed instead: a search begins.
    ///
    /// # Errors
    /// If the camera sees no levels.
    pub fn begin_measurement(&mut self, camera: &Camera, background: Background, patches: u32) -> Result<bool> {
        let view = (camera.clone(), background);
        if self.searched.as_ref() != Some(&view) {
            self.searched = Some(view);
            let limit = self.renderer.error_limit();
            self.search = self.renderer.wanted_psnr().map(|wanted| LimitSearch::new(wanted, limit));
            if let Some(search) = &self.search {
                self.renderer.set_error_limit(search.limit());
                return Ok(true);
            }
        }
        let measurement = self.renderer.begin_measurement(camera, background, patches)?;
        self.level_error = LevelError::Running(Box::new(measurement));
        Ok(false)
    }

    /// Ends a measurement. True if the levels change, so that the wanted PSNR is kept.
    pub fn end_measurement(&mut self, found: SampledPsnr) -> bool {
        self.level_error.end(Some(found));
        let Some(mut search) = self.search.take() else { return false };
        let drawn = search.limit();
        let limit = match search.step(found) {
            Step::Try(limit) => {
                self.search = Some(search);
                limit
            }
            Step::Found(limit, _) if limit == drawn => return false,
            Step::Found(limit, _) => limit,
            Step::AllGaussians => Options::default().finest().lod_error.into(),
        };
        self.renderer.set_error_limit(limit);
        true
    }

    /// The PSNR of the levels of this picture as text, if it is known.
    pub fn level_psnr(&self, camera: Option<&Camera>, background: Background) -> Option<String> {
        self.level_error.text().filter(|_| camera.is_some_and(|camera| self.is_measured(camera, background)))
    }

    /// Device memory: name and bytes of every buffer.
    pub fn buffers(&self) -> Vec<(String, u64)> {
        let shared = self.sharing.iter().flat_map(|sharing| sharing.devices.buffers());
        let all = self.scene.buffers().into_iter().chain(self.renderer.buffers()).chain(shared);
        all.map(|(name, bytes)| (name.to_owned(), bytes)).collect()
    }
}

/// The two pictures of a viewer.
#[derive(Default)]
pub struct Pair {
    pub first: Option<Drawn>,
    pub second: Option<Second>,
    /// Parts of the picture of another session, for the first build of this one.
    pub lent: Option<Reusable>,
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
    /// True if pictures may be drawn in bands, whose colours are rounded and which have no alpha: nothing but colours
    /// of the first is shown.
    pub fn may_share(&self, quantity: Quantity) -> bool {
        self.second.is_none() && quantity == Quantity::Colour
    }

    /// True if the first picture is in bands although more is shown of it than they have.
    pub fn lacks(&self, quantity: Quantity) -> bool {
        !self.may_share(quantity) && self.first.as_ref().is_some_and(|first| first.is_rounded)
    }

    /// The pictures that the GPU draws, by side.
    pub fn drawn(&mut self) -> impl Iterator<Item = (Side, &mut Drawn)> {
        let second = self.second.as_mut().and_then(|second| match second {
            Second::Drawn(drawn) => Some((Side::Second, &mut **drawn)),
            Second::Image(_) => None,
        });
        self.first.as_mut().map(|drawn| (Side::First, drawn)).into_iter().chain(second)
    }
}
