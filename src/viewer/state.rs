//! What the window shows and is asked to do: scenes, view, options, and what is under way.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::comparison::{Comparison, Way, With};
use super::events::{Event, Events};
use super::export::Export;
use super::history::{History, Pace};
use super::jobs::{Jobs, News, Side};
use super::keys::Bindings;
use super::layers::{Layer, Source};
use super::looks::Looks;
use super::measuring::{Costs, costs};
use super::messages::Messages;
use super::pictures::Plan;
use super::timeline::Film;
use crate::camera::{Camera, CameraFile, NamedCamera, Navigator};
use crate::gpu::{Device, Vsync};
use crate::options::Options;
use crate::rules::Background;
use crate::render::Explanation;
use crate::scene::{Cancelled, Gaussians, Reading, Requirements, Scene, Unreadable};
use crate::measure::trade::{Budget, choose_for, spread};

/// What the program was started with.
#[derive(Clone)]
pub struct Setup {
    pub scenes: Vec<PathBuf>,
    /// How these are read. Scenes that come later say all themselves.
    pub reading: Reading,
    pub cameras: Option<PathBuf>,
    pub options: Options,
    /// Whether the options say by hand what scenes say of their antialiasing.
    pub antialiased_by_hand: bool,
    /// The same of the near plane, which else comes closer for a small scene without cameras.
    pub near_by_hand: bool,
    pub bindings: Bindings,
    pub vsync: Vsync,
    pub hides_panels: bool,
    pub compares_with: Option<CompareWith>,
    pub way: Way,
    /// The number of a way of looking among [`sight_names`](super::sight_names).
    pub sight: usize,
    /// Tell what happens on standard output, a line of JSON each.
    pub tells_events: bool,
}

/// What the picture is held against from the start.
#[derive(Clone, Debug, PartialEq)]
pub enum CompareWith {
    /// The same scenes by other options: those of a preset.
    Options(Options),
    /// The float64 reference.
    Reference,
    /// A picture or photograph.
    File(PathBuf),
}

/// What the window itself has to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Wish {
    FullScreen,
    Quit,
    Vsync(Vsync),
    Copy(String),
    /// Pick this pixel of the first picture.
    Pick([u32; 2]),
    /// Turn around what is seen at this pixel.
    Focus([u32; 2]),
    WritePicture,
    WriteFilm,
    /// Measure what the knobs cost.
    Measure,
    /// Choose options within the budget.
    Choose,
}

/// The state of a window.
pub struct Viewer {
    pub setup: Setup,
    pub jobs: Jobs,
    pub events: Events,
    pub messages: Messages,
    /// The first thing that could not be opened, for whoever has no window to read of it.
    pub failure: Option<anyhow::Error>,
    pub layers: Vec<Layer>,
    pub cameras: Vec<NamedCamera>,
    pub is_reading_cameras: bool,
    /// The camera of the file that was gone to last.
    pub camera: Option<usize>,
    pub navigator: Navigator,
    /// Whether the view has been set for what is open.
    pub has_view: bool,
    pub(super) first_view: Option<Camera>,
    pub options: Options,
    pub background: Background,
    pub comparison: Comparison,
    pub looks: Looks,
    /// A build of this side is under way.
    pub building: [bool; 2],
    /// The plans that could not be built, not to be tried again and again.
    pub refused: [Option<Plan>; 2],
    pub generation: u64,
    pub history: History,
    pub pace: Pace,
    pub costs: Option<Costs>,
    pub is_measuring: bool,
    pub budget: BudgetWish,
    pub film: Film,
    pub export: Export,
    pub explanation: Option<([u32; 2], Explanation)>,
    pub panels: Panels,
    pub vsync: Vsync,
    /// The pictures have to be drawn anew.
    pub is_stale: bool,
    pub wishes: Vec<Wish>,
    /// Of the window, in pixels.
    pub size: [u32; 2],
    /// When an input came that no frame has answered yet.
    pub input_at: Option<Instant>,
    pub started: Instant,
    /// Milliseconds that a refresh of the screen takes.
    pub refresh_ms: f64,
    numbers: u64,
}

/// An error budget as one types it.
pub struct BudgetWish {
    pub is_psnr: bool,
    pub max_error: f64,
    pub min_psnr: f64,
    pub is_choosing: bool,
}

/// Which panels are open.
pub struct Panels {
    pub are_hidden: bool,
    pub shows_help: bool,
}

impl Viewer {
    pub fn new(setup: Setup, jobs: Jobs, size: [u32; 2]) -> Self {
        let mut viewer = Self {
            options: setup.options,
            vsync: setup.vsync,
            events: Events::new(setup.tells_events),
            jobs,
            messages: Messages::default(),
            failure: None,
            layers: Vec::new(),
            cameras: Vec::new(),
            is_reading_cameras: false,
            camera: None,
            navigator: Navigator::new(DVec3::ZERO, 1.0, size),
            has_view: false,
            first_view: None,
            background: Background::BLACK,
            comparison: Comparison::default(),
            looks: Looks::default(),
            building: [false; 2],
            refused: [None, None],
            generation: 0,
            history: History::default(),
            pace: Pace::default(),
            costs: None,
            is_measuring: false,
            budget: BudgetWish { is_psnr: false, max_error: 0.02, min_psnr: 60.0, is_choosing: false },
            film: Film::default(),
            export: Export::default(),
            explanation: None,
            panels: Panels { are_hidden: setup.hides_panels, shows_help: false },
            is_stale: true,
            wishes: Vec::new(),
            size,
            input_at: None,
            started: Instant::now(),
            refresh_ms: 1000.0 / 60.0,
            numbers: 0,
            setup,
        };
        if let Some(cameras) = viewer.setup.cameras.clone() {
            viewer.open_cameras(&cameras);
        }
        for scene in viewer.setup.scenes.clone() {
            viewer.open(&scene, viewer.setup.reading);
        }
        viewer.looks.sight = viewer.setup.sight;
        viewer.comparison.way = viewer.setup.way;
        match viewer.setup.compares_with.clone() {
            Some(CompareWith::Options(options)) => viewer.comparison.with = With::Options(Some(options)),
            Some(CompareWith::File(file)) => viewer.compare_with_picture(&file),
            Some(CompareWith::Reference) | None => {}
        }
        viewer
    }

    /// The camera of the picture.
    pub fn view(&self) -> Camera {
        self.navigator.camera(self.size)
    }

    /// Opens a scene beside those that are open. Where there is a camera file beside the first, opens that too.
    pub fn open(&mut self, path: &Path, reading: Reading) {
        let source = match Source::of(path) {
            Ok(source) => source,
            Err(problem) => return self.messages.error(format!("{}: {problem:#}", path.display())),
        };
        if let (Source::File(file), true, None) = (&source, self.layers.is_empty(), &self.setup.cameras)
            && let Some(cameras) = crate::camera::find(file)
        {
            self.open_cameras(&cameras);
        }
        self.numbers += 1;
        self.layers.push(Layer::open(self.numbers, source, reading, &self.jobs));
    }

    /// Reads a camera file.
    pub fn open_cameras(&mut self, path: &Path) {
        let path = path.to_owned();
        let file = path.clone();
        self.is_reading_cameras = true;
        self.jobs.start(move |_| crate::camera::read(&file), move |cameras| News::Cameras(path, cameras));
    }

    /// Opens whatever was dropped on the window: a camera file, a photograph to compare with, or a scene.
    pub fn drop_file(&mut self, path: &Path) {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("json" | "bin" | "txt") => self.open_cameras(path),
            Some("png" | "exr" | "npy" | "jpg" | "jpeg") => self.compare_with_picture(path),
            _ => self.open(path, Reading::default()),
        }
    }

    /// Whether scenes are being read.
    pub fn is_reading(&self) -> bool {
        self.layers.iter().any(|layer| layer.progress.is_some())
    }

    /// Closes a scene.
    pub fn close(&mut self, number: u64) {
        self.layers.retain(|layer| layer.number != number);
        self.is_stale = true;
    }

    /// What a side is to show; none while there is nothing.
    pub fn plan(&self, side: Side) -> anyhow::Result<Option<Plan>> {
        let options = match side {
            Side::First => self.options,
            Side::Second => match self.comparison.options(&self.options) {
                Some(options) => options,
                None => return Ok(None),
            },
        };
        let parts = self.layers.iter().filter_map(|layer| layer.part(side as usize).transpose());
        let parts = parts.collect::<anyhow::Result<Vec<_>>>()?;
        Ok((!parts.is_empty()).then_some(Plan { parts, options }))
    }

    /// Takes a scene that was read, or says why it was not.
    pub fn take_scene(&mut self, number: u64, scene: anyhow::Result<Scene>) {
        let Some(place) = self.layers.iter().position(|layer| layer.number == number) else { return };
        match scene {
            Ok(scene) => {
                let layer = &mut self.layers[place];
                layer.fill(scene);
                let gaussians = layer.gaussians.clone().expect("it was filled");
                if !self.setup.antialiased_by_hand {
                    self.options.rules.antialiased = self.layers.iter().any(|layer| layer.is_antialiased);
                }
                // Of what came before, only a part was known.
                if !self.has_view || self.layers.len() == 1 && !self.has_moved() {
                    self.set_first_view(&gaussians);
                }
                if self.setup.compares_with.take_if(|with| *with == CompareWith::Reference).is_some() {
                    self.compare_with_reference();
                }
            }
            Err(problem) => {
                let layer = self.layers.remove(place);
                let is_cancelled = problem.is::<Cancelled>();
                if !is_cancelled {
                    let told = format!("{problem:#}");
                    let named = if told.contains(&layer.name) { told } else { format!("{}: {told}", layer.name) };
                    self.messages.error(named);
                    self.failure.get_or_insert(problem);
                }
            }
        }
        self.is_stale = true;
    }

    /// Whether the view is another than the first.
    fn has_moved(&self) -> bool {
        self.first_view.as_ref().is_some_and(|first| *first != self.view())
    }

    /// Takes cameras that were read, or says why they were not.
    pub fn take_cameras(&mut self, path: &Path, cameras: anyhow::Result<CameraFile>) {
        self.is_reading_cameras = false;
        match cameras {
            Ok(CameraFile { cameras, notices, .. }) => {
                notices.iter().for_each(|notice| self.messages.note(format!("{}: {notice}", path.display())));
                self.events.tell(&Event::Cameras { count: cameras.len() });
                self.cameras = cameras;
                self.options.rules.near = self.setup.options.rules.near;
                self.go_to_camera(0, true);
                self.first_view = Some(self.view());
            }
            Err(problem) => {
                let unreadable = Unreadable::new(path, &problem);
                self.messages.error(unreadable.to_string());
                self.failure.get_or_insert(unreadable.into());
            }
        }
    }

    /// Begins to measure what the knobs cost, or to choose them within the budget.
    pub fn start_measuring(&mut self, device: Device, scene: (Arc<Gaussians>, Arc<Requirements>), chooses: bool) {
        let (options, view, background) = (self.options, self.view(), self.background);
        if chooses {
            let budget = match self.budget.is_psnr {
                true => Budget::MinPsnr(self.budget.min_psnr),
                false => Budget::MaxError(self.budget.max_error),
            };
            // What is looked at, and a few cameras of the file beside it.
            let cameras: Vec<Camera> = self.cameras.iter().map(|named| named.camera.resized(self.size)).collect();
            let views = std::iter::once(view).chain(spread(&cameras, 7)).collect::<Vec<_>>();
            self.budget.is_choosing = true;
            self.jobs.start(
                move |_| {
                    let exact = (options.untraded(), background);
                    let choice = choose_for(&device, (&scene.0, &scene.1), exact, &views, budget, &|_| {})?;
                    Ok((choice.options, choice.explain()))
                },
                News::Chosen,
            );
        } else {
            self.is_measuring = true;
            self.jobs.start(move |_| costs(&device, (&scene.0, &scene.1), &options, &view, background), News::Measured);
        }
    }

    /// The number of the next build.
    pub fn next_generation(&mut self) -> u64 {
        self.generation += 1;
        self.generation
    }
}
