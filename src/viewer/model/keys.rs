//! Key bindings, and the file that changes them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use egui::{Key, KeyboardShortcut, Modifiers};
use serde::Deserialize;

use crate::files::read_whole;

/// An action that has a key. Actions from `Forward` to `Slow` last while the key is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    Forward,
    Back,
    Left,
    Right,
    Up,
    Down,
    Fast,
    Slow,
    NextCamera,
    PreviousCamera,
    NearestCamera,
    ShowCameras,
    FlipUp,
    Frame,
    Reset,
    FullScreen,
    HidePanels,
    Screenshot,
    CopyPicture,
    OpenFile,
    CopyCommand,
    CopyView,
    PasteView,
    Save,
    ToolView,
    ToolRectangle,
    ToolLasso,
    ToolPolygon,
    ToolBrush,
    ToolBall,
    ToolBox,
    ToolColour,
    ToolPlace,
    SelectAll,
    SelectNone,
    Invert,
    Delete,
    Hide,
    ShowHidden,
    Undo,
    Redo,
    FreezeCulling,
    Flicker,
    Pick,
    Mark,
    AddKey,
    Play,
    NextLook,
    PreviousLook,
    Help,
    Quit,
}

impl Action {
    /// True for edits of scenes, undo and redo.
    pub fn is_edit(self) -> bool {
        use Action::{Delete, Hide, Invert, Redo, SelectAll, SelectNone, ShowHidden, Undo};
        matches!(self, SelectAll | SelectNone | Invert | Delete | Hide | ShowHidden | Undo | Redo)
    }

    /// True if a key that is held acts again and again.
    pub fn repeats(self) -> bool {
        matches!(
            self,
            Self::NextCamera | Self::PreviousCamera | Self::NextLook | Self::PreviousLook | Self::Undo | Self::Redo
        )
    }
}

/// Every action: its name in the file, its default key, and its help text. Actions of a task follow each other.
pub const ACTIONS: [(Action, &str, &str, &str); 51] = [
    (Action::Forward, "forward", "W", "fly ahead"),
    (Action::Back, "back", "S", "fly back"),
    (Action::Left, "left", "A", "fly left"),
    (Action::Right, "right", "D", "fly right"),
    (Action::Up, "up", "E", "fly up"),
    (Action::Down, "down", "Q", "fly down"),
    (Action::Fast, "fast", "Shift", "fly five times as fast"),
    (Action::Slow, "slow", "Ctrl", "fly a fifth as fast"),
    (Action::NextCamera, "next-camera", "N", "next camera of the file"),
    (Action::PreviousCamera, "previous-camera", "P", "previous camera of the file"),
    (Action::NearestCamera, "nearest-camera", "G", "nearest camera of the file"),
    (Action::ShowCameras, "show-cameras", "V", "show the cameras of the file, or hide them"),
    (Action::FlipUp, "flip-up", "U", "flip the up axis"),
    (Action::Frame, "frame", "C", "show all scenes, and turn around their centre"),
    (Action::Reset, "reset", "R", "go back to the first view"),
    (Action::FullScreen, "full-screen", "F", "full screen on or off"),
    (Action::HidePanels, "hide-panels", "H", "hide or show the panels"),
    (Action::Screenshot, "screenshot", "F12", "write a picture of the view"),
    (Action::CopyPicture, "copy-picture", "Shift+F12", "copy the picture to the clipboard, as it is seen"),
    (Action::OpenFile, "open-file", "Ctrl+O", "open scenes, cameras or a picture to compare with"),
    (Action::CopyCommand, "copy-command", "Ctrl+R", "copy the smalto render command that draws the view"),
    (Action::CopyView, "copy-view", "Ctrl+C", "copy the view as JSON"),
    (Action::PasteView, "paste-view", "Ctrl+V", "go to a copied view"),
    (Action::Save, "save", "Ctrl+S", "save a project: scenes, places, edits, measures, options, path and view"),
    (Action::Undo, "undo", "Ctrl+Z", "undo a change of the view, the path, options, scenes, edits or measures"),
    (Action::Redo, "redo", "Ctrl+Y", "make what was undone again"),
    (Action::Help, "help", "Questionmark", "show the keys"),
    (Action::Quit, "quit", "Ctrl+Q", "quit"),
    (Action::ToolView, "tool-view", "1", "tool: the left button turns the view"),
    (Action::ToolRectangle, "tool-rectangle", "2", "tool: select by a rectangle"),
    (Action::ToolLasso, "tool-lasso", "3", "tool: select by a lasso"),
    (Action::ToolPolygon, "tool-polygon", "4", "tool: select by a polygon"),
    (Action::ToolBrush, "tool-brush", "5", "tool: select by a brush"),
    (Action::ToolBall, "tool-ball", "6", "tool: select by a ball"),
    (Action::ToolBox, "tool-box", "7", "tool: select by a box"),
    (Action::ToolColour, "tool-colour", "8", "tool: select by a colour"),
    (Action::ToolPlace, "tool-place", "9", "tool: place a scene"),
    (Action::SelectAll, "select-all", "Ctrl+A", "with a tool or the page Edit: select all Gaussians that are drawn"),
    (Action::SelectNone, "select-none", "Ctrl+D", "with a tool or the page Edit: select none"),
    (Action::Invert, "invert", "Ctrl+I", "with a tool or the page Edit: select the others"),
    (Action::Delete, "delete", "Delete", "with a tool or the page Edit: delete what is selected"),
    (Action::Hide, "hide", "B", "with a tool or the page Edit: hide what is selected"),
    (Action::ShowHidden, "show-hidden", "Shift+B", "with a tool or the page Edit: show what is hidden"),
    (Action::FreezeCulling, "freeze-culling", "K", "freeze culling at this view, or stop that"),
    (Action::Flicker, "flicker", "Space", "while held: the other picture of a comparison"),
    (Action::Pick, "explain", "X", "explain the pixel under the cursor"),
    (Action::Mark, "mark", "M", "add the point under the cursor to a measure, and copy its position"),
    (Action::NextLook, "next-look", "L", "next view mode"),
    (Action::PreviousLook, "previous-look", "J", "previous view mode"),
    (Action::AddKey, "add-key", "I", "add the view to the path"),
    (Action::Play, "play", "O", "play or stop the path"),
];

/// The tasks of actions: a title, and the first action.
pub const TASKS: [(&str, Action); 7] = [
    ("Fly", Action::Forward),
    ("Views and cameras", Action::NextCamera),
    ("Window, files, undo", Action::FullScreen),
    ("Tools", Action::ToolView),
    ("Edits", Action::SelectAll),
    ("Look inside, compare, measure", Action::FreezeCulling),
    ("Camera path", Action::AddKey),
];

/// A key with its modifiers, or modifiers alone, which are held together with other keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Chord {
    Key(KeyboardShortcut),
    Held(Modifiers),
}

/// The key of every action.
#[derive(Clone, Debug)]
pub struct Bindings {
    chords: BTreeMap<Action, Chord>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    keys: BTreeMap<Action, String>,
}

impl Default for Bindings {
    fn default() -> Self {
        let chord = |text| parse(text).expect("every default key in ACTIONS parses");
        Self { chords: ACTIONS.iter().map(|(action, _, key, _)| (*action, chord(key))).collect() }
    }
}

impl Bindings {
    /// Path of the file that is read by default; `None` without a folder for settings.
    pub fn default_file() -> Option<PathBuf> {
        Some(dirs::config_dir()?.join("smalto").join("viewer.toml"))
    }

    /// The default keys, with the changes of the file.
    ///
    /// # Errors
    /// The file cannot be read, a key or an action is unknown, or two actions have the same key.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(std::str::from_utf8(&read_whole(path)?).context("is not UTF-8")?)
    }

    fn parse(text: &str) -> Result<Self> {
        let file: File = toml::from_str(text).map_err(|error| {
            let before = text.get(..error.span().map_or(0, |span| span.start)).unwrap_or_default();
            anyhow::anyhow!("line {}: {}", 1 + before.matches('\n').count(), error.message())
        })?;
        let mut bindings = Self::default();
        for (action, key) in file.keys {
            bindings.chords.insert(action, parse(&key).with_context(|| format!("{}: {key}", name(action)))?);
        }
        let all: Vec<_> = bindings.chords.iter().collect();
        for (i, (action, chord)) in all.iter().enumerate() {
            if let Some((other, _)) = all[..i].iter().find(|(_, c)| c == chord) {
                anyhow::bail!("{} and {} have the same key", name(**other), name(**action));
            }
        }
        Ok(bindings)
    }

    pub fn chord(&self, action: Action) -> Chord {
        self.chords[&action]
    }

    /// The action of a key that is pressed with these modifiers. Of two that it suits, as B and Shift+B, it is the one
    /// with more modifiers.
    pub fn action(&self, key: Key, held: Modifiers) -> Option<Action> {
        let suits = self.chords.iter().filter_map(|(action, chord)| match chord {
            Chord::Key(shortcut) if shortcut.logical_key == key && held.matches_logically(shortcut.modifiers) => {
                let Modifiers { alt, shift, command, .. } = shortcut.modifiers;
                Some((u8::from(alt) + u8::from(shift) + u8::from(command), *action))
            }
            _ => None,
        });
        suits.max_by_key(|(modifiers, _)| *modifiers).map(|(_, action)| action)
    }

    /// The text of an action's key, for the help.
    pub fn text(&self, action: Action) -> String {
        match self.chord(action) {
            Chord::Key(shortcut) => {
                let mut parts = held(shortcut.modifiers);
                parts.push(shortcut.logical_key.symbol_or_name());
                parts.join("+")
            }
            Chord::Held(modifiers) => held(modifiers).join("+"),
        }
    }
}

fn held(modifiers: Modifiers) -> Vec<&'static str> {
    let all = [(modifiers.ctrl || modifiers.command, "Ctrl"), (modifiers.shift, "Shift"), (modifiers.alt, "Alt")];
    all.into_iter().filter_map(|(is_held, name)| is_held.then_some(name)).collect()
}

fn name(action: Action) -> &'static str {
    ACTIONS.iter().find(|(known, ..)| *known == action).map_or("", |(_, name, ..)| *name)
}

/// Parses text like `Ctrl+Shift+N`: modifiers, and at most one other key.
fn parse(text: &str) -> Result<Chord> {
    let mut modifiers = Modifiers::NONE;
    let mut key = None;
    for part in text.split('+').map(str::trim) {
        match part.to_lowercase().as_str() {
            "ctrl" | "cmd" => modifiers |= Modifiers::COMMAND,
            "shift" => modifiers |= Modifiers::SHIFT,
            "alt" => modifiers |= Modifiers::ALT,
            _ => {
                ensure!(key.is_none(), "a shortcut has one key besides Ctrl, Shift and Alt");
                key = Some(Key::from_name(part).with_context(|| format!("there is no key {part}"))?);
            }
        }
    }
    Ok(match key {
        Some(key) => Chord::Key(KeyboardShortcut::new(modifiers, key)),
        None => Chord::Held(modifiers),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_action_has_a_key_of_its_own() {
        assert!(Bindings::parse("").is_ok());
        let bindings = Bindings::default();
        assert_eq!(bindings.text(Action::CopyView), "Ctrl+C");
        assert_eq!(bindings.text(Action::Fast), "Shift");
        assert_eq!(bindings.text(Action::Forward), "W");
    }

    #[test]
    fn a_key_with_modifiers_is_told_from_the_key_alone() {
        let bindings = Bindings::default();
        assert_eq!(bindings.action(Key::B, Modifiers::NONE), Some(Action::Hide));
        assert_eq!(bindings.action(Key::B, Modifiers::SHIFT), Some(Action::ShowHidden));
        assert_eq!(bindings.action(Key::Z, Modifiers::NONE), None);
    }

    #[test]
    fn a_file_changes_keys() {
        let bindings = Bindings::parse("[keys]\nnext-camera = \"Ctrl+Shift+N\"\nforward = \"Up\"").unwrap();
        assert_eq!(bindings.text(Action::NextCamera), "Ctrl+Shift+N");
        assert_eq!(bindings.chord(Action::Back), Bindings::default().chord(Action::Back));
    }

    #[test]
    fn a_file_that_makes_no_sense_is_refused_with_the_reason() {
        for (text, expected) in [
            ("[keys]\nnext-camera = \"Nn\"", "there is no key Nn"),
            ("[keys]\nnext-camera = \"A+B\"", "one key besides"),
            ("[keys]\nnext-camera = \"W\"", "forward and next-camera have the same key"),
            ("[keys]\njump = \"W\"", "jump"),
            ("keys", "line 1: "),
        ] {
            let error = format!("{:#}", Bindings::parse(text).unwrap_err());
            assert!(error.contains(expected), "{error}");
        }
    }
}
