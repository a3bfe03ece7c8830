//! The settings of a run: everything that determines its pictures. Runs with the same settings draw the same files, and
//! shards have the settings of the whole run.

use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::Args;
use super::plan::{Plan, Source};
use crate::cli::drawable::read_places;
use crate::cli::scenes::SceneFile;
use crate::measure::bench::VersionReport;
use crate::options::Options;
use crate::pixels::{Compression, FileKind};
use crate::rules::Background;

/// The settings of a run, as the first line of its record has them.
#[derive(Debug, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Settings(Map<String, Value>);

#[derive(Serialize)]
struct Members {
    program: VersionReport,
    scene: String,
    /// BLAKE3 of the places of the scene, if it is drawn at places.
    places: Option<String>,
    cameras: String,
    files: String,
    layers: Vec<String>,
    options: Options,
    background: Option<[f32; 3]>,
    format: FileKind,
    compression: Compression,
    reference: bool,
    device: Option<String>,
    source: Option<Source>,
}

/// The member that is compared by nothing but [`Settings::scene`]: the same scene may lie in several files.
const SOURCE: &str = "source";

/// The member that is unknown without a device.
const DEVICE: &str = "device";

/// The content of a scene, as far as settings depend on it.
#[derive(Clone, Debug)]
pub(super) struct SceneKey {
    /// BLAKE3 of the Gaussians.
    pub hash: String,
    pub is_antialiased: bool,
}

impl Settings {
    /// The settings of the whole run of `plan`. `device` is `None` for the reference.
    pub fn of(args: &Args, plan: &Plan, scene: &str, options: &Options, device: Option<&str>) -> Result<Self> {
        let instances = read_places(args.place.as_deref())?;
        let members = Members {
            program: VersionReport::current(),
            scene: scene.to_owned(),
            places: instances.map(|instances| instances.hash().to_hex().to_string()),
            cameras: plan.cameras_hash.clone(),
            files: plan.files_hash.clone(),
            layers: plan.outputs.layers().map(|layer| layer.name()).collect(),
            options: *options,
            background: match args.background {
                Background::Colour(colour) => Some(colour),
                Background::Transparent => None,
            },
            format: plan.outputs.kind(),
            compression: args.compression,
            reference: args.reference,
            device: device.map(str::to_owned),
            source: plan.source.clone(),
        };
        match serde_json::to_value(members)? {
            Value::Object(members) => Ok(Self(members)),
            other => bail!("the settings of a run are not a JSON object: {other}"),
        }
    }

    /// The settings on any device.
    pub fn without_device(mut self) -> Self {
        self.0.remove(DEVICE);
        self
    }

    /// The members in which a run had other settings.
    pub fn differences(&self, other: &Self) -> Vec<&str> {
        let differs = |(key, value): &(&String, &Value)| *key != SOURCE && other.0.get(*key) != Some(value);
        self.0.iter().filter(differs).map(|(key, _)| key.as_str()).collect()
    }

    /// The device of the run.
    pub fn device(&self) -> Option<&str> {
        self.0.get(DEVICE)?.as_str()
    }

    /// What the run found in the scene, if it was read from the file that is `now` there.
    pub fn scene(&self, now: &SceneFile) -> Option<SceneKey> {
        let source: Source = serde_json::from_value(self.0.get(SOURCE)?.clone()).ok()?;
        let hash = self.0.get("scene")?.as_str()?.to_owned();
        (source.file == *now).then_some(SceneKey { hash, is_antialiased: source.is_antialiased })
    }
}
