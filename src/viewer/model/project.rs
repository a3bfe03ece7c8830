//! Project files: the state of a window, to continue later.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::appearance::Appearance;
use super::edit::Edit;
use super::layers::Placement;
use super::measures::Measures;
use crate::camera::{Camera, Timeline, Up, from_json, to_json};
use crate::files::{read_whole, write_whole};
use crate::options::{KNOBS, Knob, Options};

/// The ending of names of project files.
pub const PROJECT_ENDING: &str = ".project.json";

const FORMAT: &str = "smalto project 1";

/// A project. Paths of files are relative to the folder of the project.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Project {
    format: String,
    pub scenes: Vec<PlacedScene>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cameras: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photographs: Option<PathBuf>,
    /// A camera, as an entry of a `cameras.json`.
    view: Value,
    pub pivot: [f64; 3],
    up: String,
    /// Every knob by its name, as on the command line.
    options: BTreeMap<String, String>,
    pub background: [f32; 3],
    /// A camera path (docs/side-files.md).
    path: Value,
    pub repeats: bool,
    /// The name of the view mode.
    pub look: String,
    #[serde(default, skip_serializing_if = "Measures::is_empty")]
    pub measures: Measures,
}

/// A scene of a project.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacedScene {
    /// A file, or a procedural scene.
    pub scene: String,
    pub position: [f64; 3],
    /// Degrees around x, y and z. The rotation is Ry Rx Rz: around z first.
    pub rotation: [f64; 3],
    pub scale: f64,
    /// In the first picture, and in the second.
    pub shown: [bool; 2],
    /// A list of places at which the scene is drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub places: Option<PathBuf>,
    /// Runs of Gaussians with equal flags: their number, and 1 for selected, 2 for hidden, 4 for deleted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub edit: Vec<(usize, u8)>,
    /// If the scene is a part of the file, runs of the file's Gaussians: their number, and 0 for those that are in it,
    /// 4 for others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub part: Vec<(usize, u8)>,
    /// The name in the list of scenes, if the scene is a part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    #[serde(default, skip_serializing_if = "Appearance::is_default")]
    pub appearance: Appearance,
}

/// View, options and path of a project.
pub struct ProjectView<'a> {
    pub view: &'a Camera,
    pub up: Up,
    pub options: &'a Options,
    pub path: &'a Timeline,
}

/// True if a file has the name of a project.
pub fn is_project(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().to_ascii_lowercase().ends_with(PROJECT_ENDING))
}

impl PlacedScene {
    pub fn placement(&self) -> Placement {
        Placement { translation: self.position, rotation: self.rotation, scale: self.scale }
    }
}

impl Project {
    pub fn new(shown: &ProjectView) -> Self {
        let ProjectView { view, up, options, path } = shown;
        let option = |knob: &Knob| (knob.name.to_owned(), (knob.get)(options).to_string());
        Self {
            format: FORMAT.to_owned(),
            scenes: Vec::new(),
            cameras: None,
            photographs: None,
            view: serde_json::from_str(&to_json(view)).expect("a camera that was written is JSON"),
            pivot: [0.0; 3],
            up: up.to_string(),
            options: KNOBS.iter().map(option).collect(),
            background: [0.0; 3],
            path: path.to_value(),
            repeats: false,
            look: "colour".to_owned(),
            measures: Measures::default(),
        }
    }

    /// Reads a project.
    ///
    /// # Errors
    /// The file is no project, or of another version. The sentence does not name the file.
    pub fn read(file: &Path) -> Result<Self> {
        let value: Value = serde_json::from_slice(&read_whole(file)?).context("is not a project: it is no JSON")?;
        match value.get("format").and_then(Value::as_str) {
            Some(FORMAT) => {}
            Some(other) => bail!("is of the format {other:?}, this program reads {FORMAT:?}"),
            None => bail!("is not a project: it has no format"),
        }
        let project: Self = serde_json::from_value(value).context("is not a whole project")?;
        project.options()?;
        project.view()?;
        project.path()?;
        project.up()?;
        project.measures.check()?;
        for scene in &project.scenes {
            scene.placement().transform().with_context(|| scene.scene.clone())?;
            scene.appearance.check().with_context(|| scene.scene.clone())?;
            let has_runs = Edit::from_runs(&scene.part).is_some() && Edit::from_runs(&scene.edit).is_some();
            ensure!(has_runs, "{}: its edit or its part has no valid runs", scene.scene);
        }
        Ok(project)
    }

    /// Writes the file. An existing file is replaced at the end.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        write_whole(file, |writer| Ok(serde_json::to_writer_pretty(writer, self)?))
    }

    /// The options. Knobs that the file omits have their defaults.
    pub fn options(&self) -> Result<Options> {
        let mut options = Options::default();
        for (name, text) in &self.options {
            let knob = Knob::named(name).with_context(|| format!("there is no option {name:?}"))?;
            let value = knob.parse(text).map_err(|problem| anyhow::anyhow!("{name} {text:?}: {problem}"))?;
            (knob.set)(&mut options, value);
        }
        ensure!(options.undrawable().is_none(), "nothing can be drawn with its options");
        Ok(options)
    }

    pub fn view(&self) -> Result<Camera> {
        from_json(&self.view.to_string()).context("its view")
    }

    pub fn path(&self) -> Result<Timeline> {
        Timeline::of_value(&self.path).context("its path")
    }

    pub fn up(&self) -> Result<Up> {
        let known = Up::ALL.into_iter().find(|up| up.to_string() == self.up);
        known.with_context(|| format!("there is no axis {:?}", self.up))
    }
}

/// The path of a file relative to a folder; its absolute path if it is not in the folder.
pub fn relative_to(folder: &Path, file: &Path) -> PathBuf {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    file.strip_prefix(folder).map(Path::to_owned).unwrap_or(file)
}
