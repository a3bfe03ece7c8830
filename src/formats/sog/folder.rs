//! Writes a SOG into a folder, where it may replace an older SOG; removes a SOG.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path};

use anyhow::{Context, Result};
use serde_json::Value;

use super::write::{META, STEMS, files, texture_name};
use crate::files::{check_writable, lock, make_folder, read_whole, write_batch};
use crate::scene::Gaussians;

/// Writes a scene that is arranged as SOG 2 into a folder, which is made if needed: textures and `meta.json`. `check`
/// gets the path of a `meta.json` of the complete set before any file of the folder is replaced, and its result is
/// returned.
///
/// A SOG in the folder stays readable until the new one takes its place: the new textures have other names,
/// which `meta.json` records, and the old textures are removed after `meta.json` was replaced. So the folder holds the
/// old set or the new one at any time, and never a mixture.
///
/// # Errors
/// If the folder cannot be made, a file in it cannot be written, another run writes into it, or `check` fails.
pub fn write_sog_folder<T>(
    gaussians: &Gaussians,
    is_antialiased: bool,
    folder: &Path,
    check: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    in_locked(folder, || replace(gaussians, is_antialiased, folder, check))
}

/// Makes a folder if needed, and keeps other runs out of it while `write` works. If that fails, what was made is
/// removed.
pub(crate) fn in_locked<T>(folder: &Path, write: impl FnOnce() -> Result<T>) -> Result<T> {
    let made: Vec<&Path> =
        folder.ancestors().take_while(|above| !above.as_os_str().is_empty() && !above.exists()).collect();
    make_folder(folder)?;
    // A system that cannot open folders has no lock; there the user must not start two runs at once.
    let opened = fs::File::open(folder).ok();
    let locked = opened.as_ref().map_or(Ok(()), lock).with_context(|| folder.display().to_string());
    let written = locked.and_then(|()| write());
    if written.is_err() {
        made.iter().for_each(|folder| _ = fs::remove_dir(folder));
    }
    written
}

fn replace<T>(
    gaussians: &Gaussians,
    is_antialiased: bool,
    folder: &Path,
    check: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let meta = folder.join(META);
    check_writable(&meta)?;
    let old = textures(&read_whole(&meta).unwrap_or_default());
    let is_free = |name: String| fs::symlink_metadata(folder.join(name)).is_err();
    let generation = (0..u32::MAX).find(|n| STEMS.iter().all(|stem| is_free(texture_name(stem, *n))));
    let new = files(gaussians, is_antialiased, generation.context("no name is free for the textures")?)?;
    let found = write_batch(folder, &new, check)?;
    for name in old.iter().filter(|name| new.iter().all(|(new, _)| new != *name)) {
        // The new set is complete; a file that cannot be removed does no harm.
        _ = fs::remove_file(folder.join(name));
    }
    Ok(found)
}

/// The WebP files in the folder of a `meta.json` that it names; none if it is not a SOG's.
fn textures(meta: &[u8]) -> BTreeSet<String> {
    let meta: Value = serde_json::from_slice(meta).unwrap_or_default();
    let attributes = meta.as_object().into_iter().flat_map(|members| members.values());
    let names = attributes.filter_map(|attribute| attribute.get("files")?.as_array()).flatten();
    let is_beside = |name: &&str| {
        let mut parts = Path::new(name).components();
        matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None)) && name.ends_with(".webp")
    };
    names.filter_map(Value::as_str).filter(is_beside).map(str::to_owned).collect()
}

/// Removes the SOG folder of a `meta.json` that an old `lod-meta.json` names, and the folders above it that are empty
/// then. Other files, and names that lead out of the folder, stay; what cannot be removed does no harm.
pub(crate) fn remove_unit(folder: &Path, name: &str) {
    let name = Path::new(name);
    let is_inside = name.components().all(|part| matches!(part, Component::Normal(_)));
    let Some(unit) = name.parent().filter(|unit| is_inside && !unit.as_os_str().is_empty()) else { return };
    if name.file_name().is_none_or(|name| name != META) {
        return;
    }
    let meta = folder.join(name);
    for texture in textures(&read_whole(&meta).unwrap_or_default()) {
        _ = fs::remove_file(folder.join(unit).join(texture));
    }
    _ = fs::remove_file(meta);
    for above in unit.ancestors().filter(|above| !above.as_os_str().is_empty()) {
        _ = fs::remove_dir(folder.join(above));
    }
}
