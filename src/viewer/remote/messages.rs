//! The messages between a client and the server: JSON texts, described by `serve-client` and `serve-server` in
//! `docs/schemas/`.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::measure::bench::Clocks;
use crate::viewer::model::{LengthUnit, MeasureKind, Measures, Placement};

/// A message of a client to the server.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ClientMessage {
    /// The first message of every connection.
    Hello {
        /// The token, if the server asks for one.
        token: Option<String>,
        /// Width and height of pictures in pixels.
        size: [u32; 2],
        /// The view to begin at, as an entry of a cameras.json.
        view: Option<serde_json::Value>,
    },
    /// What the user did with pointer and keys, in this order.
    Input {
        /// Pictures name the last one that they answer.
        #[serde(default)]
        number: u32,
        events: Vec<InputEvent>,
    },
    /// Pictures get this width and height in pixels.
    Resize { size: [u32; 2] },
    /// Do what the key of an action does: a name of `actions` in [`ServerMessage::Welcome`].
    Act { action: String },
    /// Turn a knob; the value is written as on the command line.
    Set { knob: String, value: String },
    /// Take the options of a preset.
    Preset { name: String },
    /// Choose the fastest options for which pictures of the current view, and of some cameras of the file, differ from
    /// those of `exact` no more than this. It takes seconds to minutes.
    Budget { budget: BudgetEntry },
    /// Stop choosing options.
    StopBudget,
    /// Show something in place of colours: a name of `looks`.
    Look {
        name: String,
        /// Low and high end of the scale; those of the last time without them.
        range: Option<[f32; 2]>,
    },
    /// Go to a camera of the file, by its index.
    Camera { index: usize },
    /// Go to a view, an entry of a cameras.json.
    View { view: serde_json::Value },
    /// Compare with a preset, the float64 `reference`, `photographs` of the cameras, or `nothing`.
    Compare { with: String },
    /// How the comparison is shown.
    CompareBy {
        mode: CompareBy,
        /// The fraction of the width to the left of the split.
        split: Option<f32>,
        /// The factor on differences.
        gain: Option<f32>,
    },
    /// Explain a pixel.
    Explain { pixel: [u32; 2] },
    /// Move the point around which the view turns to this pixel.
    Focus { pixel: [u32; 2] },
    /// Add the point of the scene at a pixel to the open measure.
    Mark { pixel: [u32; 2] },
    /// The next point begins a measure of this kind.
    Measure { kind: MeasureKind },
    /// Replace all measures.
    Measures { measures: Measures },
    /// Set the unit of lengths by the length of the last line of the open measure.
    Unit { name: String, length: f64 },
    /// Replace the camera path, by one as [`ServerMessage::Path`] gives it; the empty list removes it.
    Path { keys: serde_json::Value },
    /// Replace the camera path by a turn around the point in the middle.
    Turn,
    /// Add the first view of the camera path as its last one: the path is then played again and again.
    ClosePath,
    /// Go to the view of the camera path at this time.
    Time { seconds: f64 },
    /// Write the camera path with this many frames a second: as a video, for which [`ServerMessage::Film`] follows; in
    /// `smalto view --control` as this video or folder of pictures, for which [`Rest`](Self::Rest) waits.
    Film { fps: f64, file: Option<PathBuf> },
    /// Stop writing a film.
    StopFilm,
    /// Answered with [`ServerMessage::Rests`] once all that was asked for before is done and shown.
    Rest { number: u32 },
    /// Show or hide a scene, by its place in the list.
    Show { scene: usize, is_shown: bool },
    /// Set the placement of a scene, by its place in the list.
    Place { scene: usize, placement: Placement },
    /// Close a scene, by its place in the list.
    Close { scene: usize },
    /// List a folder below that of `--folder`; the empty text is that folder.
    Files { folder: String },
    /// Open a scene, a camera file or a picture, in addition: of the folder; of any folder in `smalto view --control`.
    Open { file: String },
    /// Write the picture as .png or .exr, in `smalto view --control` only. [`Rest`](Self::Rest) waits for the file.
    Picture { file: PathBuf },
    /// The picture of this number is on the screen.
    Shown { picture: u32 },
    /// Answered at once with [`ServerMessage::Pong`].
    Ping { time: f64 },
}

/// The largest difference of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum BudgetEntry {
    /// Of a channel of a pixel, in colour values: 0.00001 to 1.
    MaxError(f64),
    /// The PSNR in dB: 20 to 120.
    MinPsnr(f64),
}

/// How two pictures are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CompareBy {
    Split,
    Flicker,
    Difference,
}

/// An event of the pointer or of a key. Positions are in pixels of the picture, from its upper left corner.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum InputEvent {
    Move {
        x: f32,
        y: f32,
    },
    Button {
        x: f32,
        y: f32,
        button: Button,
        is_pressed: bool,
        #[serde(default)]
        held: Held,
    },
    /// A wheel was turned by this many points, upwards if positive.
    Wheel {
        points: f32,
    },
    /// Two fingers moved apart by this factor.
    Zoom {
        factor: f32,
    },
    /// A key that lasts while it is held: of the actions with `is_held` in [`ServerMessage::Welcome`].
    Key {
        action: String,
        is_pressed: bool,
        #[serde(default)]
        held: Held,
    },
    /// The pointer has left the picture.
    Gone,
    /// The client has lost the keyboard: all keys are released.
    Blur,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Button {
    Left,
    Middle,
    Right,
}

/// The keys that are held with others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Held {
    pub shift: bool,
    pub ctrl: bool,
    pub alt: bool,
}

/// A message of the server to a client. Pictures are binary messages: see `docs/control.md`.
#[cfg_attr(not(feature = "serve"), expect(dead_code, reason = "some are of servers only"))]
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "say", rename_all = "kebab-case")]
pub enum ServerMessage {
    /// The first message: what does not change.
    Welcome(Box<Welcome>),
    /// What the client shows beside the picture, whenever some of it has changed.
    State(Box<State>),
    /// The names of the cameras of the file.
    Cameras {
        names: Vec<String>,
    },
    /// The measured loss of a compressed picture against its own pixels in 8 bits.
    Loss {
        picture: u32,
        /// Peak signal-to-noise ratio in dB; null if no pixel differs.
        psnr: Option<f64>,
    },
    /// The camera path, as a cameras.json with a time for each camera, whenever it has changed.
    Path {
        keys: serde_json::Value,
    },
    /// A film is written: its address, relative to that of the web page, until the connection ends or another film is
    /// written.
    Film {
        file: String,
    },
    /// All that was asked for before [`ClientMessage::Rest`] of this number is done and shown.
    Rests {
        number: u32,
        state: Box<State>,
    },
    /// A folder below that of `--folder`.
    Files {
        folder: String,
        folders: Vec<String>,
        files: Vec<String>,
    },
    /// Something that was asked for is not done.
    Refused {
        why: String,
        /// The number of a request for rest that is refused.
        #[serde(skip_serializing_if = "Option::is_none")]
        number: Option<u32>,
    },
    Pong {
        time: f64,
    },
}

/// What does not change while a connection lasts.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Welcome {
    pub version: String,
    pub device: String,
    /// The client may open files of a folder.
    pub has_folder: bool,
    /// Films can be written.
    pub has_films: bool,
    pub presets: Vec<String>,
    pub knobs: Vec<KnobEntry>,
    pub looks: Vec<LookEntry>,
    pub actions: Vec<ActionEntry>,
    /// False colours from low to high, as #rrggbb.
    pub colours: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct KnobEntry {
    pub name: String,
    pub help: String,
    /// Of scenes with levels of detail only.
    pub is_of_levels: bool,
    pub kind: KnobKind,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum KnobKind {
    Number,
    Count,
    Name { names: Vec<String> },
    Flag,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct LookEntry {
    pub name: String,
    pub title: String,
    pub unit: String,
    /// Its values have a scale, whose ends can be set.
    pub has_scale: bool,
}

/// An action, with the key of the window for it.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ActionEntry {
    pub name: String,
    pub key: String,
    pub help: String,
    /// It lasts while its key is held.
    pub is_held: bool,
}

/// What a client shows beside the picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct State {
    pub title: String,
    pub scenes: Vec<SceneEntry>,
    /// Index of the camera of the file that the view is at, and the number of cameras.
    pub camera: Option<usize>,
    pub cameras: usize,
    /// The preset that the options are those of.
    pub preset: Option<String>,
    /// The values of all knobs, in the order of [`Welcome::knobs`].
    pub knobs: Vec<String>,
    /// The fraction of choosing options by a budget that is done; null while nothing is chosen.
    pub choosing: Option<f64>,
    /// What was chosen last, and what it keeps.
    pub chosen: Option<String>,
    /// A camera has a photograph to compare with.
    pub has_photographs: bool,
    pub look: String,
    /// Low and high end of its scale.
    pub range: [f32; 2],
    pub comparison: Option<ComparisonEntry>,
    pub explanation: Option<ExplanationEntry>,
    /// The kind of the next measure.
    pub measures_next: MeasureKind,
    pub measures: Vec<MeasureEntry>,
    /// The unit of lengths; null for world units.
    pub unit: Option<LengthUnit>,
    /// Time on the camera path in seconds, and whether it is played.
    pub time: f64,
    pub is_playing: bool,
    /// The fraction of a film that is written, or of a picture; null while nothing is written.
    pub writing: Option<f64>,
    /// The path that draws, fast or portable.
    pub path: Option<String>,
    /// Gaussians that passed the culling of the last frame.
    pub visible: u32,
    /// GPU time of a frame and of its stages: medians of the last frames, ms.
    pub gpu_ms: Option<f64>,
    pub stages: Vec<(String, f64)>,
    /// The clocks of the GPU with these times, where they are known: it lowers them when it has little to do.
    pub clocks: Option<Clocks>,
    /// A scene has levels of detail.
    pub has_levels: bool,
    /// PSNR of the levels of detail against all Gaussians, as text, once it is measured.
    pub levels: Option<String>,
    /// Pages of levels that are not in memory yet.
    pub missing_pages: u32,
    pub messages: Vec<MessageEntry>,
    /// The reason why nothing is seen.
    pub nothing: Option<String>,
    /// At rest: the view, as an entry of a cameras.json, and the command line that draws the picture.
    pub rest: Option<Rest>,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Rest {
    pub view: serde_json::Value,
    pub command: String,
    /// What the command line leaves out.
    pub left_out: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct SceneEntry {
    pub name: String,
    pub summary: String,
    pub is_shown: bool,
    pub placement: Placement,
    /// The fraction that is read; null once all is.
    pub progress: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MeasureEntry {
    pub kind: MeasureKind,
    /// World units.
    pub points: Vec<[f64; 3]>,
    /// What is measured, as text in the unit; empty while it has too few points.
    pub reading: String,
    /// It gets the next point.
    pub is_open: bool,
    /// At rest: where its points are in the picture, in pixels; null for those that are not in front of the camera.
    pub pixels: Vec<Option<[f64; 2]>>,
    /// At rest: the pieces of its lines in the picture, each from one pixel to another. Lenses bend lines.
    pub lines: Vec<[[f64; 2]; 2]>,
    /// At rest: its lengths, angle and area.
    pub labels: Vec<LabelEntry>,
}

/// What is written over the picture.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct LabelEntry {
    /// The middle of the text.
    pub pixel: [f64; 2],
    pub text: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ComparisonEntry {
    pub first: String,
    pub second: String,
    pub mode: CompareBy,
    pub split: f32,
    pub gain: f32,
    pub is_loading: bool,
    /// Of the whole pictures in dB; null if they are equal, or not compared yet.
    pub psnr: Option<f64>,
    pub flip: Option<f64>,
    /// The reason why both cannot be compared.
    pub mismatch: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ExplanationEntry {
    pub pixel: [u32; 2],
    /// The picture still has the view of the explanation.
    pub is_of_view: bool,
    pub colour: [f32; 3],
    /// World units along the view; null where nothing is drawn.
    pub depth: Option<f32>,
    /// The number of splats that were blended.
    pub splats: usize,
    /// The first of them, front to back.
    pub first: Vec<SplatEntry>,
    /// The light of the background that is left.
    pub transmittance: f32,
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct SplatEntry {
    pub gaussian: u32,
    pub depth: f32,
    pub alpha: f32,
    /// Its part of the light of the pixel.
    pub share: f32,
    pub colour: [f32; 3],
}

#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MessageEntry {
    pub is_error: bool,
    pub text: String,
}

impl ClientMessage {
    /// Reads a message.
    ///
    /// # Errors
    /// A sentence about what is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|problem| format!("this is no message: {problem}"))
    }
}

impl ServerMessage {
    /// Something that was asked for is not done, for this reason.
    pub fn refused(why: String) -> Self {
        Self::Refused { why, number: None }
    }

    pub fn text(&self) -> String {
        serde_json::to_string(self).expect("messages are plain data")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_read_and_nonsense_is_refused() {
        let parsed = ClientMessage::parse(r#"{"do":"input","events":[{"kind":"move","x":1,"y":2.5},{"kind":"gone"}]}"#);
        assert_eq!(
            parsed,
            Ok(ClientMessage::Input { number: 0, events: vec![InputEvent::Move { x: 1.0, y: 2.5 }, InputEvent::Gone] })
        );
        let key =
            r#"{"do":"input","events":[{"kind":"key","action":"forward","is_pressed":true,"held":{"shift":true}}]}"#;
        assert!(ClientMessage::parse(key).is_ok());
        let deep = "[".repeat(100_000);
        for wrong in [
            "",
            "null",
            "{}",
            r#"{"do":"nothing"}"#,
            r#"{"do":"camera","index":-1}"#,
            r#"{"do":"camera","index":0,"more":1}"#,
            r#"{"do":"resize","size":[1]}"#,
            r#"{"do":"input","events":[{"kind":"move","x":null,"y":0}]}"#,
            &deep,
            &format!(r#"{{"do":"view","view":{deep}"#),
        ] {
            assert!(ClientMessage::parse(wrong).is_err(), "{wrong:.40}");
        }
    }
}
