//! The pairs of pictures of a comparison. Pictures of two folders are paired by their paths in these folders, without
//! the endings.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use crate::cli::{Usage, remark};

/// Endings of pictures that are compared.
const ENDINGS: [&str; 5] = ["png", "jpg", "jpeg", "exr", "npy"];

/// Two files to compare.
pub(super) struct Files {
    pub paths: [PathBuf; 2],
    /// Name of the pair in the table.
    pub title: String,
    /// The file name of their heatmap in a folder.
    pub heatmap: PathBuf,
}

impl Files {
    fn of(paths: [PathBuf; 2], [a, b]: [&Path; 2]) -> Self {
        let title = if a == b { a.display().to_string() } else { format!("{}, {}", a.display(), b.display()) };
        let mut heatmap = OsString::from(a);
        if a.extension().is_none_or(|ending| ending != "png") {
            heatmap.push(".png");
        }
        Self { paths, title, heatmap: heatmap.into() }
    }
}

/// The files to compare: `a` and `b`, or files of two folders whose paths in them agree but for the ending. With
/// `partial`, pictures without a partner are left out.
pub(super) fn pairs(a: &Path, b: &Path, partial: bool) -> Result<Vec<Files>> {
    match [a, b].map(Path::is_dir) {
        [false, false] => {
            let names = [a, b].map(|file| Path::new(file.file_name().unwrap_or_default()));
            Ok(vec![Files::of([a.to_owned(), b.to_owned()], names)])
        }
        [true, true] => matched(&Folder::read(a)?, &Folder::read(b)?, partial),
        [is_folder, _] => {
            let (folder, file) = if is_folder { (a, b) } else { (b, a) };
            let (folder, file) = (folder.display(), file.display());
            Err(Usage(format!("{folder} is a folder and {file} is not: expected two files or two folders")).into())
        }
    }
}

/// The pictures of a folder and the folders below it.
struct Folder {
    path: PathBuf,
    /// Endings of the pictures, by path in the folder without the ending.
    pictures: BTreeMap<PathBuf, BTreeSet<OsString>>,
}

impl Folder {
    /// Lists the pictures. Other files are left out with a note, hidden files without a note.
    fn read(path: &Path) -> Result<Self> {
        let mut folder = Self { path: path.to_owned(), pictures: BTreeMap::new() };
        let mut others = BTreeSet::new();
        folder.add(Path::new(""), &mut others)?;
        if let Some(first) = others.first() {
            let first = path.join(first);
            remark(&format!("note: {} files are no pictures, the first is {}", others.len(), first.display()));
        }
        Ok(folder)
    }

    fn add(&mut self, below: &Path, others: &mut BTreeSet<PathBuf>) -> Result<()> {
        let path = self.path.join(below);
        let unreadable = || format!("cannot read the folder {}", path.display());
        for entry in fs::read_dir(&path).with_context(unreadable)? {
            let entry = entry.with_context(unreadable)?;
            if entry.file_name().as_encoded_bytes().starts_with(b".") {
                continue;
            }
            let name = below.join(entry.file_name());
            // Links to folders are not followed: they may lead in a circle.
            if entry.file_type().with_context(unreadable)?.is_dir() {
                self.add(&name, others)?;
                continue;
            }
            let ending = name.extension().unwrap_or_default().to_owned();
            let is_picture = ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)) && entry.path().is_file();
            if is_picture {
                self.pictures.entry(name.with_extension("")).or_default().insert(ending);
            } else {
                others.insert(name);
            }
        }
        Ok(())
    }

    /// The names in the folder of the pictures that have this path without an ending.
    fn names(&self, stem: &Path) -> Vec<PathBuf> {
        let endings = self.pictures.get(stem).into_iter().flatten();
        endings.map(|ending| [stem.as_os_str(), ending].join(".".as_ref()).into()).collect()
    }

    /// Handles the pictures of these names, which have no partner in `other`.
    fn lack(&self, alone: &[PathBuf], other: &Self, partial: bool) -> Result<()> {
        let Some(first) = alone.first() else { return Ok(()) };
        let (folder, other) = (self.path.display(), other.path.display());
        if partial {
            remark(&format!("note: {} pictures of {folder} have no partner in {other}", alone.len()));
            return Ok(());
        }
        let more = if alone.len() > 1 { format!(", and {} more have none", alone.len() - 1) } else { String::new() };
        bail!(
            "{} has no partner in {other}{more}; --partial compares those that have one",
            self.path.join(first).display()
        )
    }
}

fn matched(a: &Folder, b: &Folder, partial: bool) -> Result<Vec<Files>> {
    let (mut pairs, mut alone) = (Vec::new(), [Vec::new(), Vec::new()]);
    let stems: BTreeSet<&PathBuf> = a.pictures.keys().chain(b.pictures.keys()).collect();
    ensure!(!stems.is_empty(), "{} and {} hold no pictures", a.path.display(), b.path.display());
    for stem in stems {
        let names = [a.names(stem), b.names(stem)];
        let mut add = |x: &Path, y: &Path| pairs.push(Files::of([a.path.join(x), b.path.join(y)], [x, y]));
        match &names {
            [x, y] if x == y => x.iter().for_each(|name| add(name, name)),
            [x, y] if x.is_empty() || y.is_empty() => {
                alone.iter_mut().zip(&names).for_each(|(alone, names)| alone.extend(names.clone()));
            }
            [x, y] => match (&x[..], &y[..]) {
                ([x], [y]) => add(x, y),
                _ => {
                    let (folder, names) = if x.len() > 1 { (a, x) } else { (b, y) };
                    let [one, other] = [0, 1].map(|i| folder.path.join(&names[i]));
                    bail!("{} and {} have the same name: only one can be compared", one.display(), other.display());
                }
            },
        }
    }
    a.lack(&alone[0], b, partial)?;
    b.lack(&alone[1], a, partial)?;
    ensure!(!pairs.is_empty(), "no picture of {} has a partner in {}", a.path.display(), b.path.display());
    Ok(pairs)
}
