//! Files that appear whole or not at all, and what is wrong with those that cannot be read.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::Path;

use anyhow::{Context, Result, anyhow, ensure};
use tempfile::NamedTempFile;

/// Writes a file under a temporary name beside `path` and renames it when it is complete.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    write_checked(path, write, |_| Ok(()))
}

/// The same, but the complete file takes its name only if `check`, given the temporary one, finds nothing wrong. The
/// temporary name ends like the other.
pub fn write_checked<T>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>,
    check: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let target = || format!("cannot write {}", path.display());
    let file = unfinished(path)?;
    let mut writer = BufWriter::new(file.as_file());
    write(&mut writer).and_then(|()| Ok(writer.flush()?)).with_context(target)?;
    drop(writer);
    let found = check(file.path()).with_context(target)?;
    file.persist(path).map_err(|e| e.error).with_context(target)?;
    Ok(found)
}

/// Fails if [`write_whole`] would: for what takes long to make.
pub fn check_writable(path: &Path) -> Result<()> {
    ensure!(!path.is_dir(), "cannot write {}: it is a folder", path.display());
    unfinished(path).map(drop)
}

/// A file beside `path` that goes when it is dropped.
fn unfinished(path: &Path) -> Result<NamedTempFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let ending = name.rfind('.').map_or("", |dot| &name[dot..]);
    let suffix = format!(".part{ending}");
    builder.prefix(".smalto-").suffix(&suffix);
    #[cfg(unix)]
    {
        // Temporary files are private by default; a result has the permissions of any other new file.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).map_err(|error| {
        // The error's own sentence names the temporary file, which means nothing to who asked for another.
        let why = match error.kind() {
            ErrorKind::NotFound if !folder.exists() => "there is no such folder".to_owned(),
            kind => kind.to_string(),
        };
        anyhow!("cannot write {}: {why}", path.display())
    })
}

/// The whole file, if it is one: a device would have no end.
pub fn read_whole(path: &Path) -> Result<Vec<u8>> {
    let metadata = std::fs::metadata(path).map_err(|e| anyhow!("cannot be opened: {}", describe(&e)))?;
    ensure!(metadata.is_file(), "is not a file");
    std::fs::read(path).map_err(|e| anyhow!("cannot be read: {}", describe(&e)))
}

/// What went wrong, without the operating system's error number.
pub fn describe(error: &std::io::Error) -> String {
    match error.kind() {
        ErrorKind::NotFound => "there is no such file".to_owned(),
        ErrorKind::PermissionDenied => "permission denied".to_owned(),
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_that_takes_no_file_is_said_without_the_temporary_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("none/a.png");
        let expected = format!("cannot write {}: there is no such folder", path.display());
        assert_eq!(format!("{:#}", check_writable(&path).unwrap_err()), expected);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, "old").unwrap();
        let result = write_whole(&path, |file| {
            file.write_all(b"half")?;
            anyhow::bail!("no")
        });
        assert!(result.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
