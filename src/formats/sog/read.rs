//! Reads SOG of PlayCanvas, versions 1 and 2: WebP textures with one texel per Gaussian, and a `meta.json` that defines
//! their values, in a zip archive or a folder. Axes are right, down, forward, as in PLY.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::LOD_META;
use super::files::Files;
use super::read_streamed;
use super::unit::{Unit, decode_all};
use crate::formats::input::Input;
use crate::formats::{Request, SourceLevels};
use crate::scene::{NoLevel, Scene, Watch};

/// Progress when an archive is read but not yet decoded.
const READ: f64 = 0.25;

/// The JSON file of the SOG in this folder. Any other path is returned unchanged.
pub(crate) fn in_folder(path: &Path) -> PathBuf {
    let jsons = [LOD_META, "meta.json"].map(|name| path.join(name));
    jsons.into_iter().find(|json| json.is_file()).unwrap_or_else(|| path.to_owned())
}

/// The `lod-meta.json` that `path` names, or that is in its folder.
pub(crate) fn streamed_in(path: &Path) -> Option<PathBuf> {
    Some(in_folder(path)).filter(|path| path.file_name().is_some_and(|name| name == LOD_META))
}

/// Reads a zip archive.
pub(crate) fn read_bundle(input: Input, watch: &Watch) -> Result<Scene> {
    let reading = Watch { progress: &|fraction| (watch.progress)(READ * fraction), ..*watch };
    let mut input = input.watched_by(&reading);
    let unit = Unit::open(Files::archive(&mut input)?, "meta.json")?;
    let decoding = Watch { progress: &|fraction| (watch.progress)(READ + (1.0 - READ) * fraction), ..*watch };
    let format = unit.meta.format();
    decode_all(&mut input, vec![unit], format, &decoding)
}

/// Reads a `meta.json`, or one level of a `lod-meta.json`. The textures lie in the same folder.
pub(crate) fn read_json(input: Input, request: &Request) -> Result<Scene> {
    let Request { path, level, watch } = *request;
    let quiet = Watch { progress: &|_| {}, ..*watch };
    let mut input = input.watched_by(&quiet);
    let (json, keys) = json_of(&mut input)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    match keys {
        Keys { tree: Some(_), .. } => read_streamed::read(&mut input, &json, folder, level, watch),
        Keys { means: Some(_), .. } => {
            ensure!(level.is_none(), NoLevel::none());
            let unit = Unit::parse(&json, Files::Folder(folder.to_owned()))?;
            let format = unit.meta.format();
            decode_all(&mut input, vec![unit], format, watch)
        }
        _ => bail!(
            "the JSON is not that of a scene: it has neither means, as meta.json has, nor a tree, as lod-meta.json has"
        ),
    }
}

/// Reads all levels of a `lod-meta.json`.
pub(crate) fn read_all_levels(input: Input, request: &Request) -> Result<SourceLevels> {
    let Request { path, watch, .. } = *request;
    let quiet = Watch { progress: &|_| {}, ..*watch };
    let mut input = input.watched_by(&quiet);
    let (json, keys) = json_of(&mut input)?;
    ensure!(keys.tree.is_some(), NoLevel::no_levels());
    read_streamed::read_levels(&mut input, &json, path.parent().unwrap_or(Path::new(".")), watch)
}

/// The keys that tell what a JSON file is.
#[derive(Deserialize)]
struct Keys {
    means: Option<IgnoredAny>,
    tree: Option<IgnoredAny>,
}

/// The content of a JSON file.
fn json_of(input: &mut Input) -> Result<(Vec<u8>, Keys)> {
    let json = input.rest(read_streamed::MAX_BYTES, "the JSON")?;
    let keys = serde_json::from_slice(&json).context("not the JSON of a scene")?;
    Ok((json, keys))
}
