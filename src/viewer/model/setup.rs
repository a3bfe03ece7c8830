//! The settings with which a viewer is started.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;

use super::comparison::CompareMode;
use super::keys::Bindings;
use crate::camera::{Camera, LensChoice};
use crate::formats::Reading;
use crate::gpu::{Device, Vsync};
use crate::options::Options;
use crate::rules::Background;
use crate::scene::{Focus, SceneInstances};

/// The settings with which the program was started.
#[derive(Clone)]
pub struct Setup {
    pub scenes: Vec<PathBuf>,
    /// Applies to `scenes`. Scenes that are opened later are read with the defaults.
    pub reading: Reading,
    /// The options of a command line for `reading`.
    pub reading_options: Vec<String>,
    pub cameras: Option<PathBuf>,
    /// The list of places of the first scene, with its file.
    pub places: Option<(PathBuf, SceneInstances)>,
    /// The first view; `None` for the first camera of the file, or a view of the whole scene.
    pub start: Option<Start>,
    pub background: Background,
    /// The lenses of all cameras, and of the first view where there are none.
    pub lenses: LensChoice,
    /// Folder with the photographs of the cameras.
    pub photographs: Option<PathBuf>,
    /// Photographs are searched beside a camera file, also above its folder.
    pub searches_photographs: bool,
    pub options: Options,
    /// The user set antialiasing explicitly, so the scene's flag is ignored.
    pub antialiased_is_explicit: bool,
    /// The user set the near plane explicitly. Otherwise it moves closer for a small scene without cameras.
    pub near_is_explicit: bool,
    pub bindings: Bindings,
    /// The file of the state kept from one window to the next.
    pub recent_file: Option<PathBuf>,
    pub vsync: Vsync,
    pub hides_panels: bool,
    pub compares_with: Option<CompareWith>,
    pub compare_mode: CompareMode,
    /// Index of a view mode among [`view_mode_names`](super::view_modes::view_mode_names).
    pub view_mode: usize,
    /// Frames a second to keep.
    pub fps: Option<f64>,
    /// Read scene files again when they change.
    pub watches_files: bool,
    /// Write events to standard output, one line of JSON each.
    pub prints_events: bool,
    /// Devices that draw bands of the window's pictures, beside its own.
    pub other_devices: Vec<Device>,
    /// Receives remarks for the terminal, such as the reason why the fast path is not used.
    pub remark: fn(&str),
}

impl Default for Setup {
    /// An empty window.
    fn default() -> Self {
        Self {
            scenes: Vec::new(),
            reading: Reading::default(),
            reading_options: Vec::new(),
            cameras: None,
            places: None,
            start: None,
            background: Background::BLACK,
            lenses: LensChoice::default(),
            photographs: None,
            searches_photographs: true,
            options: Options::default(),
            antialiased_is_explicit: false,
            near_is_explicit: false,
            bindings: Bindings::default(),
            recent_file: None,
            vsync: Vsync::On,
            hides_panels: false,
            compares_with: None,
            compare_mode: CompareMode::Split,
            view_mode: 0,
            fps: None,
            watches_files: false,
            prints_events: false,
            other_devices: Vec::new(),
            remark: |_| {},
        }
    }
}

/// The first view.
#[derive(Clone)]
pub enum Start {
    /// The camera of the file with this position or name.
    Camera(String),
    Eye(Arc<Eye>),
}

/// The camera of scenes with this focus for a picture of this size, and the largest distance of its near plane.
pub type Eye = dyn Fn(Focus, [u32; 2]) -> Result<(Camera, f32)> + Send + Sync;

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
