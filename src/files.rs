//! Atomic file writes (temporary file, then rename), whole-file reads, and readable I/O error messages.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::Path;

use anyhow::{Context, Result, anyhow, ensure};
use tempfile::NamedTempFile;

/// Writes a file under a temporary name in the folder of `path` and renames it when it is complete.
///
/// # Errors
/// If the temporary file cannot be made, written or renamed, or `write` fails. A file that was at `path` is then
/// unchanged.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    write_checked(path, write, |_| Ok(()))
}

/// Like [`write_whole`], but renames the file only if `check` accepts it. `check` gets the path of the complete
/// temporary file, which has the extension of `path`, and its result is returned.
///
/// # Errors
/// Those of [`write_whole`], and those of `check`.
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

/// Checks before a long computation that its result can be written to `path`.
///
/// # Errors
/// If `path` is a folder, or [`write_whole`] could not make its temporary file.
pub fn check_writable(path: &Path) -> Result<()> {
    ensure!(!path.is_dir(), "cannot write {}: it is a folder", path.display());
    unfinished(path).map(drop)
}

/// A temporary file in the folder of `path`. It is deleted when dropped.
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
        // The message of the error itself names the temporary file, which the user does not know.
        let why = match error.kind() {
            ErrorKind::NotFound if !folder.exists() => "there is no such folder".to_owned(),
            kind => kind.to_string(),
        };
        anyhow!("cannot write {}: {why}", path.display())
    })
}

/// Reads a whole regular file. Anything else is refused: reading a device may never end.
///
/// # Errors
/// A message without the file's name if `path` is not a regular file or cannot be read.
pub fn read_whole(path: &Path) -> Result<Vec<u8>> {
    let metadata = std::fs::metadata(path).map_err(|e| anyhow!("cannot be opened: {}", describe(&e)))?;
    ensure!(metadata.is_file(), "is not a file");
    std::fs::read(path).map_err(|e| anyhow!("cannot be read: {}", describe(&e)))
}

/// The message of an I/O error without the error number of the operating system.
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
    fn an_error_does_not_name_the_temporary_file() {
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
