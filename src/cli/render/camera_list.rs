//! The value of `--camera`: positions, image names, ranges, and lists of these.

use super::outputs::without_ending;
use crate::camera::{Camera, NamedCamera};
use crate::cli::Usage;
use crate::cli::cameras::Numbered;

/// A camera to draw from.
pub(in crate::cli) struct SelectedCamera {
    /// Position in the file, or number of the frame of a path.
    pub index: usize,
    /// `None` for a camera that is of no file.
    pub name: Option<String>,
    pub camera: Camera,
}

impl SelectedCamera {
    pub fn named(index: usize, named: &NamedCamera) -> Self {
        Self { index, name: Some(named.name.clone()), camera: named.camera.clone() }
    }
}

/// The cameras that `wanted` names. The second value is true if `wanted` is a list, a range or `all`.
pub(in crate::cli) fn select_cameras(all: &Numbered, wanted: &str) -> Result<(Vec<SelectedCamera>, bool), Usage> {
    let selected = |position: usize| SelectedCamera::named(all.cameras[position].0, &all.cameras[position].1);
    if wanted == "all" {
        return Ok(((0..all.cameras.len()).map(selected).collect(), true));
    }
    // An image name may contain commas and dots.
    if let Some(position) = find(all, wanted)? {
        return Ok((vec![selected(position)], false));
    }
    let mut found = Vec::new();
    for item in wanted.split(',') {
        match find(all, item)? {
            Some(position) => found.push(selected(position)),
            None => found.extend(range(all, item)?.into_iter().map(selected)),
        }
    }
    Ok((found, true))
}

/// The index in `all` of a camera that is named by its number or its image.
fn find(all: &Numbered, wanted: &str) -> Result<Option<usize>, Usage> {
    // A number with leading zeros, such as 0007, is a name.
    let number: Option<i64> = wanted.parse().ok().filter(|number: &i64| number.to_string() == wanted);
    let at = |index: usize| all.cameras.iter().position(|(own, _)| *own == index);
    let by_position = number.and_then(|number| at(index_of(all, number)?));
    let by_name = || all.cameras.iter().position(|(_, named)| named.name == wanted);
    if let Some(position) = by_position.or_else(by_name) {
        return Ok(Some(position));
    }
    let mut by_stem = all.cameras.iter().enumerate().filter(|(_, (_, named))| without_ending(&named.name) == wanted);
    match (by_stem.next(), by_stem.next()) {
        (Some((_, (_, one))), Some((_, (_, other)))) => {
            let (one, other) = (&one.name, &other.name);
            Err(Usage(format!("--camera {wanted} may be '{one}' or '{other}': write one of these names")))
        }
        (first, _) => Ok(first.map(|(position, _)| position)),
    }
}

/// The position in the file for a number on the command line; -1 is the last camera of the split.
fn index_of(all: &Numbered, number: i64) -> Option<usize> {
    let cameras = &all.cameras;
    let back = || cameras.len().checked_sub(usize::try_from(number.unsigned_abs()).ok()?);
    usize::try_from(number).ok().or_else(|| Some(cameras[back()?].0))
}

/// The indices in `all` of the cameras in a range of positions, both ends included.
fn range(all: &Numbered, item: &str) -> Result<Vec<usize>, Usage> {
    let cameras = &all.cameras;
    let unknown = || {
        let ((first, from), (last, to)) = (&cameras[0], &cameras[cameras.len() - 1]);
        let (from, to) = (&from.name, &to.name);
        let which = if cameras.len() < all.count { " in this split" } else { "" };
        Usage(format!("there is no camera {item}{which}: they are {first} to {last}, from '{from}' to '{to}'"))
    };
    let end = |text: &str, default: usize| {
        if text.is_empty() {
            return Ok(default);
        }
        let index = text.parse().ok().and_then(|number| index_of(all, number));
        index.filter(|index| *index < all.count).ok_or_else(unknown)
    };
    let (from, to) = item.split_once("..").ok_or_else(unknown)?;
    let (from, to) = (end(from, 0)?, end(to, all.count - 1)?);
    if from > to {
        return Err(Usage(format!("--camera {item} is empty: {from} is greater than {to}")));
    }
    let positions: Vec<_> = (0..cameras.len()).filter(|position| (from..=to).contains(&cameras[*position].0)).collect();
    if positions.is_empty() { Err(unknown()) } else { Ok(positions) }
}
