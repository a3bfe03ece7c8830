//! Writes several files into a folder as one batch: all of them, or none.

use std::fs::{self, File, Metadata};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::destination::Destination;
use super::partial::{PartialFolder, uninterrupted};
use super::{described, fill};

/// Writes files into an existing folder: names that are free there, and last the file that names the others and may
/// replace one. All are complete and on the disk before the first gets its name, and until the last has its own,
/// readers see the old files. `check` gets the path of the last file in a folder with the complete batch; its result is
/// returned.
///
/// # Errors
/// If a file cannot be written or renamed, or `check` fails. The folder is then as it was.
pub fn write_batch<T>(folder: &Path, files: &[(String, Vec<u8>)], check: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    let failed = |name: &str| format!("cannot write {}", folder.join(name).display());
    let (last, _) = files.last().context("the batch has no files")?;
    let (replaced, old, parts) = begin(folder, last).with_context(|| failed(last))?;
    for (name, bytes) in files {
        write_new(&parts.path().join(name), bytes).with_context(|| failed(name))?;
    }
    let found = check(&parts.path().join(last))?;
    if let Some(old) = old {
        fs::set_permissions(parts.path().join(last), old.permissions()).map_err(|error| described(&error))?;
    }

    let uninterrupted = uninterrupted();
    let (main, others) = files.split_last().context("the batch has no files")?;
    let mut moved = Vec::new();
    let mut rename = |name: &str, to: &Path| {
        fs::rename(parts.path().join(name), to).map_err(|error| described(&error)).with_context(|| failed(name))?;
        moved.push(to.to_owned());
        Ok(())
    };
    let renamed = others.iter().try_for_each(|(name, _)| {
        let path = folder.join(name);
        ensure!(!path.exists(), "{}: the name is taken", failed(name));
        rename(name, &path)
    });
    sync(folder);
    if let Err(error) = renamed.and_then(|()| rename(&main.0, &replaced)) {
        moved.iter().for_each(|path| _ = fs::remove_file(path));
        return Err(error);
    }
    drop(uninterrupted);
    sync(folder);
    Ok(found)
}

/// As [`write_batch`], for a folder `tree` with files, whose name is free, and a file `main` that names them and may
/// replace one. `fill` writes both into the folder that it gets.
///
/// # Errors
/// If a file cannot be written or renamed, or `fill` fails. The folder is then as it was.
pub fn write_tree<T>(folder: &Path, tree: &str, main: &str, fill: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    let failed = || format!("cannot write {}", folder.join(main).display());
    let (replaced, old, parts) = begin(folder, main).with_context(failed)?;
    let found = fill(parts.path())?;
    let (tree, new_tree, new_main) = (folder.join(tree), parts.path().join(tree), parts.path().join(main));
    let finish = || {
        if let Some(old) = old {
            fs::set_permissions(&new_main, old.permissions())?;
        }
        let _uninterrupted = uninterrupted();
        fs::rename(&new_tree, &tree)?;
        sync(folder);
        fs::rename(&new_main, &replaced).inspect_err(|_| _ = fs::rename(&tree, &new_tree))
    };
    finish().map_err(|error| described(&error)).with_context(failed)?;
    sync(folder);
    Ok(found)
}

/// The path of the main file of a batch, its metadata if it exists, and a folder for the new batch.
fn begin(folder: &Path, main: &str) -> Result<(PathBuf, Option<Metadata>, PartialFolder)> {
    let Destination::File { path, old } = Destination::of(&folder.join(main))? else {
        anyhow::bail!("it is not a regular file");
    };
    Ok((path, old, PartialFolder::inside(folder).map_err(|error| described(&error))?))
}

/// Writes a new file, and syncs it to the disk.
///
/// # Errors
/// A message without the name of the file.
pub fn write_new(path: &Path, bytes: &[u8]) -> Result<()> {
    let file = File::create_new(path).map_err(|error| described(&error))?;
    fill(&file, |out| Ok(std::io::Write::write_all(out, bytes)?))?;
    file.sync_all().map_err(|error| described(&error))
}

/// Syncs the entries of a folder to the disk, on systems where folders can be opened.
fn sync(folder: &Path) {
    _ = File::open(folder).and_then(|folder| folder.sync_all());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<_> = names.collect();
        names.sort();
        names
    }

    #[test]
    fn a_batch_that_cannot_be_completed_leaves_the_folder_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let batch = |number: &str| {
            ["a", "b", "main"]
                .map(|name| (if name == "main" { name.into() } else { format!("{name}{number}") }, vec![7]))
        };
        write_batch(folder, &batch("0"), |_| Ok(())).unwrap();
        assert_eq!(names(folder), ["a0", "b0", "main"]);
        fs::write(folder.join("main"), "old").unwrap();
        // The check fails; the second name is taken; the last name cannot be taken.
        assert!(
            write_batch(folder, &batch("1"), |main| -> Result<()> { anyhow::bail!("{}", main.display()) }).is_err()
        );
        fs::create_dir(folder.join("b2")).unwrap();
        let error = write_batch(folder, &batch("2"), |_| Ok(())).unwrap_err();
        assert!(format!("{error:#}").ends_with("b2: the name is taken"), "{error:#}");
        assert_eq!(names(folder), ["a0", "b0", "b2", "main"]);
        assert_eq!(fs::read(folder.join("main")).unwrap(), b"old");
        fs::remove_file(folder.join("main")).unwrap();
        let obstructed = write_batch(folder, &batch("3"), |_| Ok(fs::create_dir(folder.join("main"))?));
        assert!(obstructed.is_err());
        assert_eq!(names(folder), ["a0", "b0", "b2", "main"]);
    }

    #[test]
    fn a_tree_that_cannot_be_completed_leaves_the_folder_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let fill = |parts: &Path| {
            fs::create_dir(parts.join("tree"))?;
            write_new(&parts.join("tree/a"), &[7])?;
            write_new(&parts.join("main"), b"new")
        };
        write_tree(folder, "tree", "main", fill).unwrap();
        assert_eq!(names(folder), ["main", "tree"]);
        assert_eq!(fs::read(folder.join("tree/a")).unwrap(), [7]);
        // The name is taken; the work fails; the main file cannot be replaced.
        let error = write_tree(folder, "tree", "main", fill).unwrap_err();
        assert!(format!("{error:#}").contains("main"), "{error:#}");
        let other = |parts: &Path| fs::create_dir(parts.join("b")).map_err(anyhow::Error::from);
        let fails = |parts: &Path| other(parts).and_then(|()| Err::<(), _>(anyhow::anyhow!("full")));
        assert_eq!(write_tree(folder, "b", "main", fails).unwrap_err().to_string(), "full");
        let obstructed = |parts: &Path| {
            fs::remove_file(folder.join("main"))?;
            fs::create_dir(folder.join("main"))?;
            other(parts).and_then(|()| write_new(&parts.join("main"), b"new"))
        };
        assert!(write_tree(folder, "b", "main", obstructed).is_err());
        assert_eq!(names(folder), ["main", "tree"]);
    }
}
