//! The state of a window: scenes, view, options, and the jobs under way. Plain data; `actions` changes it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Instant, SystemTime};

use glam::DVec3;

use super::comparison::{CompareMode, Comparison, Depicted};
use super::dialog::Dialog;
use super::drag::{Drag, Stroke, Tool};
use super::edit::{How, Selection};
use super::evaluation::Evaluation;
use super::events::Events;
use super::export::Export;
use super::film::Film;
use super::keys::Bindings;
use super::layers::Layer;
use super::loaded_scene::Held;
use super::messages::Messages;
use super::photographs::Photographs;
use super::project::Project;
use super::rate::Rate;
use super::recent::Kept;
use super::snapshot::Still;
use super::undo::Undo;
use super::view_modes::InspectionSettings;
use crate::camera::{Camera, NamedCamera, Navigator};
use crate::formats::Reading;
use crate::gpu::Vsync;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::render::Explanation;
use crate::rules::Background;
use crate::viewer::frame::{History, Pace, Plan, Side};
use crate::viewer::jobs::{Cancel, Costs, Jobs};

/// The settings with which the program was started.
#[derive(Clone)]
pub struct Setup {
    pub scenes: Vec<PathBuf>,
    /// Applies to `scenes`. Scenes that are opened later are read with the defaults.
    pub reading: Reading,
    pub cameras: Option<PathBuf>,
    /// A folder with the photographs of the cameras.
    pub photographs: Option<PathBuf>,
    pub options: Options,
    /// The user set antialiasing explicitly; ignore the scene's flag.
    pub antialiased_is_explicit: bool,
    /// The user set the near plane explicitly; otherwise it moves closer for a small scene without cameras.
    pub near_is_explicit: bool,
    pub bindings: Bindings,
    /// The file of what is kept from one window to the next.
    pub kept: Option<PathBuf>,
    pub vsync: Vsync,
    pub hides_panels: bool,
    pub compares_with: Option<CompareWith>,
    pub compare_mode: CompareMode,
    /// Index of a view mode among [`view_mode_names`](super::view_modes::view_mode_names).
    pub view_mode: usize,
    /// Frames a second that scenes with levels of detail keep, by the number of nodes.
    pub fps: Option<f64>,
    /// Read scene files again when they change.
    pub follows: bool,
    /// Write events to standard output, one line of JSON each.
    pub prints_events: bool,
    /// Receives remarks that belong on the terminal too, such as why the fast path is not taken.
    pub remark: fn(&str),
}

/// The initial target of the comparison.
#[derive(Clone, Debug, PartialEq)]
pub enum CompareWith {
    /// The same scenes, drawn with other options.
    Options(Options),
    /// The float64 reference.
    Reference,
    /// A picture or photograph.
    File(PathBuf),
}

/// An action that needs the device or the window; the session executes it after the panels are laid out.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// The owner of the window executes this one.
    Window(WindowRequest),
    /// Explain this pixel of the first picture.
    Pick([u32; 2]),
    /// Turn around what this pixel shows.
    Focus([u32; 2]),
    /// Mark what this pixel shows, and measure the distance from the mark before.
    Mark([u32; 2]),
    /// Select what lies around the point that this pixel shows.
    SelectBall {
        pixel: [u32; 2],
        radius_px: f64,
        how: How,
    },
    /// Select by what each Gaussian contributes to the view; if true, nothing but what is seen.
    SelectByShares(Selection, How, bool),
    /// Fit the scale of the look to the values of the picture.
    FitRange,
    WritePicture,
    /// Copy what is seen to the clipboard.
    CopyPicture,
    WriteFilm,
    /// Measure what the knobs cost.
    Measure,
    /// Choose options within the budget.
    Choose,
    /// Compare every camera with its photograph.
    Evaluate,
}

/// An action that only the owner of the window can execute.
#[derive(Clone, Debug, PartialEq)]
pub enum WindowRequest {
    ToggleFullScreen,
    Quit,
    Vsync(Vsync),
    /// Put this text on the clipboard.
    Copy(String),
    /// Put this picture on the clipboard.
    CopyPicture(egui::ColorImage),
}

/// The state of a window.
pub struct Viewer {
    pub setup: Setup,
    pub jobs: Jobs,
    pub events: Events,
    pub messages: Messages,
    /// The first failure to open or build something, for callers without a window that shows it.
    pub failure: Option<anyhow::Error>,
    pub layers: Vec<Layer>,
    pub cameras: Vec<NamedCamera>,
    /// The file of the cameras.
    pub camera_file: Option<PathBuf>,
    /// Cameras, or their photographs, are being found.
    pub is_reading_cameras: bool,
    /// The photographs of the cameras.
    pub photographs: Option<Photographs>,
    /// By camera: its photograph, small; `None` while it is read, and if it cannot be read.
    pub thumbnails: BTreeMap<usize, Option<Pixels>>,
    /// How near the picture came to the photographs when that was measured last.
    pub evaluation: Option<Evaluation>,
    /// Index of the camera of the file that the view is at or moves to; `None` after the view has left it.
    pub camera: Option<usize>,
    /// The camera of the file that the view was at last.
    pub last_camera: usize,
    pub navigator: Navigator,
    /// The first view has been set for an open scene.
    pub has_view: bool,
    pub(crate) first_view: Option<Camera>,
    /// The largest near plane for the first scene, if it is small and there are no cameras.
    pub nearest: Option<f32>,
    pub options: Options,
    pub background: Background,
    /// The newest change of the shaders that are compiled at run time; `None` if all shaders are built in.
    pub shaders: Option<SystemTime>,
    pub comparison: Comparison,
    pub inspection: InspectionSettings,
    /// The pictures, read back, while they stand still and somebody asks for their values.
    pub still: Option<Still>,
    /// Number of pictures that were read back.
    pub stills: u64,
    /// The pixel under the cursor, if that is over the picture.
    pub cursor: Option<[u32; 2]>,
    /// The camera of the file that is seen under the cursor.
    pub pointed: Option<usize>,
    /// Points that were marked last, world units: at most three.
    pub marks: Vec<DVec3>,
    /// By side: a build is under way.
    pub building: [bool; 2],
    /// By side: the plan that could not be built, so that it is not tried again every frame.
    pub refused: [Option<Plan>; 2],
    /// By side: the message about shaders that could not be compiled.
    pub shader_errors: [Option<String>; 2],
    pub generation: u64,
    pub history: History,
    /// Set if scenes with levels of detail keep a rate of frames.
    pub rate: Option<Rate>,
    pub pace: Pace,
    /// What knobs cost, and the picture that was measured.
    pub costs: Option<(Costs, Option<Depicted>)>,
    /// The measurement that goes on.
    pub measurement: Option<Measurement>,
    pub budget: BudgetInput,
    pub film: Film,
    pub undo: Undo,
    pub export: Export,
    /// The pixel that was picked, and what it is made of.
    pub explanation: Option<ExplainedPixel>,
    pub panels: Panels,
    pub dialog: Dialog,
    /// The project that is being opened.
    pub project: Option<Project>,
    /// What the next window begins with.
    pub kept: Kept,
    pub vsync: Vsync,
    /// The pictures must be drawn again.
    pub is_stale: bool,
    pub requests: Vec<Request>,
    /// What the left button does over the picture while the page of edits is open.
    pub tool: Tool,
    /// The number of the scene that handles place, if one was chosen.
    pub placed: Option<u64>,
    /// The field of view before it was made flat, in degrees.
    pub unflat_degrees: f64,
    /// The radius of the brush, in pixels.
    pub brush_px: f64,
    /// Nothing is selected that has no part of the picture.
    pub only_seen: bool,
    /// The number of selections that are being made on other threads.
    pub selecting: usize,
    /// The stroke of a tool that goes on.
    pub stroke: Option<Stroke>,
    /// The drag over the picture that goes on.
    pub drag: Option<Drag>,
    /// The view flies, by keys that are held.
    pub is_flying: bool,
    /// Width and height of the window in pixels.
    pub window: [u32; 2],
    /// Width and height of the picture in pixels: of the part of the window that the panels leave.
    pub size: [u32; 2],
    /// The time of the first input that no frame has answered yet.
    pub input_at: Option<Instant>,
    pub started: Instant,
    /// The refresh interval of the screen in milliseconds.
    pub refresh_ms: f64,
    last_layer_number: u64,
}

/// The error budget that the panel edits.
pub struct BudgetInput {
    /// The budget is a PSNR, not a largest error.
    pub is_psnr: bool,
    /// Largest difference of a colour channel, in colour values from 0 to 1.
    pub max_error: f64,
    /// In dB.
    pub min_psnr: f64,
    /// What was chosen last, and why.
    pub chosen: Option<String>,
}

/// What a measurement is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// What the knobs cost.
    Costs,
    /// A choice within a budget.
    Choice,
    /// The cameras against their photographs.
    Evaluation,
}

/// A measurement that goes on.
pub struct Measurement {
    pub purpose: Purpose,
    /// What is measured.
    pub of: Option<Depicted>,
    /// The fraction done, 0 to 1.
    pub fraction: f64,
    pub since: Instant,
    pub cancel: Cancel,
}

/// What a pixel was made of when it was picked.
pub struct ExplainedPixel {
    pub pixel: [u32; 2],
    pub side: Side,
    pub view: Camera,
    pub explanation: Explanation,
}

/// The panels that are open.
pub struct Panels {
    pub are_hidden: bool,
    pub shows_help: bool,
}

impl Viewer {
    /// A viewer with nothing open yet; `size` is the window's in pixels.
    pub fn new(setup: Setup, jobs: Jobs, size: [u32; 2]) -> Self {
        Self {
            options: setup.options,
            vsync: setup.vsync,
            events: Events::new(setup.prints_events),
            jobs,
            messages: Messages::default(),
            failure: None,
            layers: Vec::new(),
            cameras: Vec::new(),
            camera_file: None,
            is_reading_cameras: false,
            photographs: None,
            thumbnails: BTreeMap::new(),
            evaluation: None,
            camera: None,
            last_camera: 0,
            nearest: None,
            navigator: Navigator::new(DVec3::ZERO, 1.0, size),
            has_view: false,
            first_view: None,
            background: Background::BLACK,
            shaders: None,
            comparison: Comparison { mode: setup.compare_mode, ..Comparison::default() },
            inspection: InspectionSettings { mode: setup.view_mode, ..InspectionSettings::default() },
            still: None,
            stills: 0,
            cursor: None,
            pointed: None,
            marks: Vec::new(),
            building: [false; 2],
            refused: [None, None],
            shader_errors: [None, None],
            generation: 0,
            history: History::default(),
            rate: setup.fps.map(Rate::of),
            pace: Pace::default(),
            costs: None,
            measurement: None,
            budget: BudgetInput { is_psnr: false, max_error: 0.02, min_psnr: 60.0, chosen: None },
            film: Film::default(),
            undo: Undo::default(),
            export: Export::default(),
            explanation: None,
            panels: Panels { are_hidden: setup.hides_panels, shows_help: false },
            dialog: Dialog::default(),
            project: None,
            kept: setup.kept.as_deref().map(Kept::read).unwrap_or_default(),
            is_stale: true,
            requests: Vec::new(),
            tool: Tool::Look,
            placed: None,
            unflat_degrees: 60.0,
            brush_px: 20.0,
            only_seen: false,
            selecting: 0,
            stroke: None,
            drag: None,
            is_flying: false,
            window: size,
            size,
            input_at: None,
            started: Instant::now(),
            refresh_ms: 1000.0 / 60.0,
            last_layer_number: 0,
            setup,
        }
    }

    /// Gives the picture this part of the window, at least a pixel. Both sizes are in pixels.
    pub fn make_room(&mut self, window: [u32; 2], picture: [u32; 2]) {
        let size = [0, 1].map(|side: usize| picture[side].clamp(1, window[side].max(1)));
        self.is_stale |= self.size != size;
        (self.window, self.size) = (window, size);
    }

    /// The camera of the picture.
    pub fn view(&self) -> Camera {
        self.navigator.camera(self.size)
    }

    /// True if the view has moved since the first view was set.
    pub fn has_moved(&self) -> bool {
        self.first_view.as_ref().is_some_and(|first| first.resized(self.size) != self.view())
    }

    /// True while scenes are being read.
    pub fn is_reading(&self) -> bool {
        self.layers.iter().any(|layer| layer.progress.is_some())
    }

    /// True if a scene is read page by page.
    pub fn is_in_pages(&self) -> bool {
        self.layers.iter().any(|layer| matches!(layer.held, Some(Held::Pages(_))))
    }

    /// A number that no scene of this window has had.
    pub(crate) fn next_layer_number(&mut self) -> u64 {
        self.last_layer_number += 1;
        self.last_layer_number
    }

    /// The number of the next build.
    pub fn next_generation(&mut self) -> u64 {
        self.generation += 1;
        self.generation
    }
}
