//! Films that are written for clients, and that their browsers fetch.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result};

use super::admission::new_token;
use crate::files::PartialFolder;

/// The written films, by the keys in their addresses.
#[derive(Clone, Default)]
pub struct Films(Arc<Mutex<HashMap<String, PathBuf>>>);

/// A film of a client, in a folder for temporary files that is removed with it, also when a signal ends the program.
pub struct Film {
    folder: PartialFolder,
    /// Nobody can guess it, so that its address needs no token.
    key: String,
    films: Films,
    pub is_written: bool,
}

impl Films {
    fn all(&self) -> MutexGuard<'_, HashMap<String, PathBuf>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The file of a film.
    pub fn file(&self, key: &str) -> Option<PathBuf> {
        self.all().get(key).cloned()
    }
}

impl Film {
    /// A film that is to be written.
    ///
    /// # Errors
    /// If there is no folder for temporary files.
    pub fn new(films: &Films) -> Result<Self> {
        let folder = PartialFolder::inside(&std::env::temp_dir()).context("there is no folder for a film")?;
        Ok(Self { folder, key: new_token()?, films: films.clone(), is_written: false })
    }

    pub fn file(&self) -> PathBuf {
        self.folder.path().join("film.mp4")
    }

    /// Lets browsers fetch the film. Returns its address, relative to that of the web page; `None` if it was not
    /// written.
    pub fn publish(&mut self) -> Option<String> {
        self.is_written = true;
        let file = Some(self.file()).filter(|file| file.is_file())?;
        self.films.all().insert(self.key.clone(), file);
        Some(format!("film/{}", self.key))
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        self.films.all().remove(&self.key);
    }
}
