//! The state of a viewer, which actions change and panels show.
//!
//! The viewer and its parts:
//! - `viewer` - `Viewer`, which owns the parts below, and the plans of its pictures
//! - `setup` - the settings with which a viewer is started
//! - `requests` - requests of panels and keys that need the device or the window
//! - `scenes`, `layers`, `loaded_scene`, `appearance` - the open scenes, one layer each, and their Gaussians
//! - `view`, `cameras`, `photographs`, `evaluation` - the view, the camera file, and its photographs
//! - `plan`, `source` - plans of the two pictures, and their builds: a scene on the GPU with its renderer
//! - `sharing` - the other devices that draw bands of the first picture
//! - `pictures` - which of the two pictures are stale, building or refused
//! - `comparison`, `snapshot` - the second picture, and pixel values read back for numbers
//! - `inspector`, `view_modes` - view modes, and the explained pixel
//! - `seen_line` - lines of the world as they are seen in a picture
//! - `measures`, `alignment` - points, distances, angles and areas, and the alignment of scenes by pairs of points
//! - `timing`, `frame_times`, `rate` - frame times, the pace of the window, and the control that keeps a frame rate
//! - `measuring` - costs of knobs and error budgets
//! - `film`, `export` - the camera path, and the files to write
//! - `editing`, `edit`, `undo` - tools, selections, hidden and deleted Gaussians, and undo
//! - `contributions`, `property_values` - numbers of all Gaussians, by which they are selected
//! - `drag`, `gizmo` - the pointer over the picture, and the handles of a scene
//! - `panels`, `dialog`, `recent`, `messages` - panels, file dialogs, the state kept between windows, messages
//! - `keys`, `events`, `job_event`, `project` - key bindings, events for scripts, events of jobs, and project files

mod alignment;
mod appearance;
mod cameras;
mod comparison;
mod contributions;
mod dialog;
mod drag;
mod edit;
mod editing;
mod evaluation;
mod events;
mod export;
mod film;
mod frame_times;
mod gizmo;
mod inspector;
mod job_event;
mod keys;
mod layers;
mod level_error;
mod loaded_scene;
mod measures;
mod measuring;
mod messages;
mod panels;
mod photographs;
mod pictures;
mod plan;
mod project;
mod property_values;
mod rate;
mod recent;
mod requests;
mod scenes;
mod seen_line;
mod setup;
mod sharing;
mod snapshot;
mod source;
mod timing;
mod undo;
mod view;
mod view_modes;
mod viewer;

pub(crate) use alignment::aligning;
pub(crate) use appearance::Appearance;
pub use comparison::{CompareMode, CompareTarget};
pub(crate) use comparison::{Comparison, PictureContent, PictureOf, SecondPicture, covered, fitted, over};
pub(crate) use contributions::{Contributions, MIN_VISIBLE};
pub(crate) use dialog::{CAMERAS, DialogResult, PICTURES, SaveTarget};
pub use drag::Tool;
pub(crate) use drag::{Drag, DragMotion, Handle, ToolStroke};
pub use edit::{Change, Counts, Property, Selection};
pub(crate) use edit::{Edit, base_colour, part_of_set, set_of};
pub(crate) use evaluation::{Evaluation, EvaluationRow, PosedPhotograph};
pub use events::Event;
pub(crate) use film::KeyChange;
pub use frame_times::Digest;
pub(crate) use gizmo::{BoxHandles, Gizmo};
pub(crate) use inspector::{Depths, ExplainedPixel};
pub(crate) use job_event::{JobEvent, Jobs, Origin, Reporter};
pub use keys::Bindings;
pub(crate) use keys::{ACTIONS, Action, Chord, TASKS};
pub(crate) use layers::{Layer, LayerSource, Placement};
pub(crate) use level_error::LevelError;
pub(crate) use loaded_scene::{LoadedScene, OpenedScene, are_same};
pub use measures::MeasureKind;
pub(crate) use measures::{LengthUnit, Measure, Measures};
pub(crate) use measuring::{MAX_ERRORS, MIN_PSNRS, Measurement, Purpose};
pub(crate) use photographs::{Photographs, camera_of, holds_photographs};
pub(crate) use plan::{Drawn, MeasuredScene, Pair, Plan, Reusable, Second, Side, needs_whole};
pub(crate) use project::{PROJECT_ENDING, PlacedScene, Project, ProjectView, is_project, relative_to};
pub(crate) use property_values::{Histogram, PropertyValues};
pub(crate) use rate::RateControl;
pub use recent::{RecentState, Tab};
pub use requests::{Request, Selecting, WindowRequest};
pub(crate) use seen_line::{CURVE_PARTS, before_camera, curve_pieces, line_pieces};
pub use setup::{CompareWith, Setup, Start};
pub(crate) use sharing::Sharing;
pub(crate) use snapshot::{Area, PairDifference, area_between, cropped};
pub(crate) use undo::{LayerState, Undo, UndoState};
pub(crate) use view_modes::{InspectionSettings, Numbers, VIEW_MODES};
pub use view_modes::{view_mode, view_mode_names};
pub use viewer::Viewer;
pub(crate) use viewer::preset_name;
