//! The destination of an output: a file that is replaced as a whole, or a device or descriptor that content is copied
//! into.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, IsTerminal, Seek, Write};
use std::path::{Path, PathBuf};

use anyhow::{Error, Result, bail, ensure};

use super::partial::PartialFile;
use super::{describe, described};

/// The name of standard output.
pub(crate) const STDOUT: &str = "-";

/// Symbolic links that are followed, as many as Linux follows.
const MOST_LINKS: usize = 40;

/// The resolved destination of a path.
pub(crate) enum Destination {
    /// A regular file, and its metadata if it exists. Its path is not a link.
    File {
        path: PathBuf,
        old: Option<Metadata>,
    },
    /// A device or a FIFO.
    Device(PathBuf),
    Stdout,
    Stderr,
    /// Another open descriptor of the process, such as the end of a pipe that the shell names /dev/fd/63.
    Descriptor(PathBuf),
}

impl Destination {
    /// The destination of `path`, whose links are followed. Fails if it cannot be written.
    pub fn of(path: &Path) -> Result<Self> {
        if path == Path::new(STDOUT) {
            return Ok(Self::Stdout);
        }
        let mut path = path.to_owned();
        for _ in 0..MOST_LINKS {
            match descriptor(&path).as_deref() {
                Some("1") => return Ok(Self::Stdout),
                Some("2") => return Ok(Self::Stderr),
                Some(_) => return Ok(Self::Descriptor(path)),
                None => {}
            }
            let data = match fs::symlink_metadata(&path) {
                Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self::File { path, old: None }),
                data => data.map_err(|error| described(&error))?,
            };
            let kind = data.file_type();
            if kind.is_symlink() {
                path = folder(&path).join(fs::read_link(&path).map_err(|error| described(&error))?);
                continue;
            }
            ensure!(!kind.is_dir(), "it is a folder");
            if kind.is_file() {
                check_permitted(&path, &data)?;
                return Ok(Self::File { path, old: Some(data) });
            }
            #[cfg(unix)]
            ensure!(!std::os::unix::fs::FileTypeExt::is_socket(&kind), "it is a socket");
            return Ok(Self::Device(path));
        }
        bail!("it is a circle of symbolic links")
    }

    /// A new temporary file for the content, with a name that ends in `ending`: in the folder of the file, or where
    /// temporary files are kept.
    pub fn partial_file(&self, ending: &str) -> Result<PartialFile> {
        let Self::File { path, old } = self else {
            let folder = std::env::temp_dir();
            return PartialFile::beside(&folder, ending, true).map_err(|error| {
                Error::msg(format!("no temporary file in {}: {}", folder.display(), describe(&error)))
            });
        };
        let folder = folder(path);
        // The message of the error itself names the temporary file, which the user does not know.
        PartialFile::beside(folder, ending, old.is_some()).map_err(|error| match error.kind() {
            ErrorKind::NotFound if !folder.exists() => Error::msg("there is no such folder"),
            _ => described(&error),
        })
    }

    /// Replaces the file by the complete content, or copies the content into the device or descriptor.
    pub fn commit(&self, partial: PartialFile) -> Result<()> {
        match self {
            Self::File { path, old } => {
                if let Some(old) = old {
                    keep_attributes(partial.file(), old).map_err(|error| described(&error))?;
                    // Otherwise a power failure could leave neither the old content nor the new.
                    partial.file().sync_all().map_err(|error| described(&error))?;
                }
                partial.persist(path).map_err(|error| described(&error))
            }
            _ => self.copy(partial.file()).map_err(|error| described(&error)),
        }
    }

    fn copy(&self, mut content: &File) -> io::Result<()> {
        content.rewind()?;
        let mut out: Box<dyn Write> = match self {
            Self::Stdout => Box::new(io::stdout().lock()),
            Self::Stderr => Box::new(io::stderr().lock()),
            Self::Device(path) | Self::File { path, .. } => Box::new(OpenOptions::new().write(true).open(path)?),
            // A descriptor may be a regular file, to which the shell has redirected output.
            Self::Descriptor(path) => Box::new(OpenOptions::new().append(true).open(path)?),
        };
        io::copy(&mut content, &mut out)?;
        out.flush()
    }

    pub fn is_terminal(&self) -> bool {
        match self {
            Self::File { .. } => false,
            Self::Stdout => io::stdout().is_terminal(),
            Self::Stderr => io::stderr().is_terminal(),
            // A FIFO is not opened: that waits for its reader, which would then see an end.
            Self::Device(path) | Self::Descriptor(path) => {
                is_character_device(path) && File::open(path).is_ok_and(|file| file.is_terminal())
            }
        }
    }
}

/// The folder of a file.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The number of the open descriptor of this process that a path in /proc/self/fd or /dev/fd names.
fn descriptor(path: &Path) -> Option<String> {
    let number = path.file_name()?.to_str()?;
    number.parse::<u32>().ok()?;
    let folder = folder(path).canonicalize().ok()?;
    let own = format!("/proc/{}", std::process::id());
    let is_own = folder.starts_with(own) && folder.ends_with("fd") || folder == Path::new("/dev/fd");
    is_own.then(|| number.to_owned())
}

/// Fails if an existing file may not be written. Renaming would replace it nevertheless, and root may write any file,
/// but the owner has protected it.
fn check_permitted(path: &Path, data: &Metadata) -> Result<()> {
    #[cfg(unix)]
    let is_read_only = std::os::unix::fs::MetadataExt::mode(data) & 0o200 == 0;
    #[cfg(not(unix))]
    let is_read_only = data.permissions().readonly();
    ensure!(!is_read_only, "it is read-only: remove it or make it writable first");
    OpenOptions::new().write(true).open(path).map(drop).map_err(|error| described(&error))
}

/// Gives a new file the mode and, as far as permitted, the owner and the group of the old one.
pub(crate) fn keep_attributes(file: &File, old: &Metadata) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, fchown};
        // Only root may give files away. The group alone may be one that the user is in.
        if fchown(file, Some(old.uid()), Some(old.gid())).is_err() {
            _ = fchown(file, None, Some(old.gid()));
        }
    }
    file.set_permissions(old.permissions())
}

fn is_character_device(path: &Path) -> bool {
    #[cfg(unix)]
    return fs::metadata(path).is_ok_and(|data| std::os::unix::fs::FileTypeExt::is_char_device(&data.file_type()));
    #[cfg(not(unix))]
    return path.exists();
}
