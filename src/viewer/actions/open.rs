//! Actions that open scenes, cameras and pictures, and take them in when they are read.

use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::camera::CameraFile;
use crate::formats::{LOD_META, Reading, in_folder};
use crate::scene::{Cancelled, Unreadable};
use crate::viewer::jobs::{JobEvent, Reporter};
use crate::viewer::model::{
    CompareTarget, CompareWith, Event, Layer, Opened, Photographs, Source, Viewer, holds_photographs, is_project,
};

/// The path that a user means who types or pastes one: without spaces around it, quotes and file://, and with ~ for
/// the home folder. A file that has such a name is meant itself.
fn named(path: &Path) -> PathBuf {
    let Some(text) = path.to_str().filter(|_| !path.exists()) else { return path.to_owned() };
    let text = text.trim();
    let quoted = ['"', '\''].iter().find_map(|quote| text.strip_prefix(*quote)?.strip_suffix(*quote));
    let text = quoted.unwrap_or(text);
    let text = text.strip_prefix("file://").unwrap_or(text);
    match (text.strip_prefix("~/"), std::env::home_dir()) {
        (Some(inside), Some(home)) => home.join(inside),
        _ => PathBuf::from(text),
    }
}

impl Viewer {
    /// Opens what the program was started with.
    pub fn open_setup(&mut self) {
        if let Some(cameras) = self.setup.cameras.clone() {
            self.open_cameras(&cameras);
        }
        for scene in self.setup.scenes.clone() {
            match is_project(&scene) {
                true => self.open_project(&scene),
                false => self.open(&scene, self.setup.reading),
            }
        }
        if !self.is_reading_cameras
            && let Some(folder) = self.setup.photographs.take()
        {
            self.open_photographs(&folder);
        }
        match self.setup.compares_with.clone() {
            Some(CompareWith::Options(options)) => self.comparison.target = CompareTarget::Options(Some(options)),
            Some(CompareWith::File(file)) => self.compare_with_picture(&file),
            // The reference needs a view, which the first scene that is read gives.
            Some(CompareWith::Reference) | None => {}
        }
    }

    /// Opens a scene in addition to the open ones. For the first scene, also opens a camera file that lies next to it,
    /// unless the setup names one.
    pub fn open(&mut self, path: &Path, reading: Reading) {
        let source = match Source::of(path) {
            Ok(source) => source,
            Err(problem) => return self.messages.error(format!("{}: {problem:#}", path.display())),
        };
        if let (Source::File(file), true, None) = (&source, self.layers.is_empty(), &self.setup.cameras)
            && let Some(cameras) = crate::camera::find(file)
        {
            (self.setup.remark)(&format!("note: cameras of {}", cameras.display()));
            self.open_cameras(&cameras);
        }
        let number = self.next_layer_number();
        self.layers.push(Layer::open(number, source, reading, &self.jobs));
    }

    /// Reads a camera file, on another thread.
    pub fn open_cameras(&mut self, path: &Path) {
        let path = path.to_owned();
        let file = path.clone();
        self.is_reading_cameras = true;
        self.jobs.start(move |_| crate::camera::read(&file), move |cameras| JobEvent::Cameras(path, cameras));
    }

    /// Finds the photographs of a folder, on another thread.
    pub fn open_photographs(&mut self, folder: &Path) {
        let folder = folder.to_owned();
        self.is_reading_cameras = true;
        let read =
            move |_: &Reporter| Photographs::read(&folder).map_err(|problem| Unreadable::new(&folder, &problem).into());
        self.jobs.start(read, JobEvent::Photographs);
    }

    /// Looks for the photographs of the cameras, on another thread: in the folder that is named, or beside their file.
    fn find_photographs(&mut self) {
        if let Some(folder) = self.setup.photographs.take() {
            return self.open_photographs(&folder);
        }
        // They may have been dropped before their cameras.
        let are_there = self.photographs.as_ref().is_some_and(|there| there.count_of(&self.cameras) > 0);
        let Some(file) = self.camera_file.clone().filter(|_| !are_there) else { return };
        let cameras = self.cameras.clone();
        let find = move |_: &Reporter| {
            let found = Photographs::beside(&file).filter(|found| found.count_of(&cameras) > 0);
            found.ok_or_else(|| Cancelled.into())
        };
        self.photographs = None;
        self.is_reading_cameras = true;
        self.jobs.start(find, JobEvent::Photographs);
    }

    /// Takes in the photographs of a folder, or reports why there are none.
    pub fn handle_photographs(&mut self, photographs: Result<Photographs>) {
        self.is_reading_cameras = false;
        self.end_project();
        match photographs {
            Ok(photographs) => {
                let (count, of) = (photographs.count_of(&self.cameras), self.cameras.len());
                self.messages
                    .note(format!("photographs of {count} of {of} cameras in {}", photographs.folder.display()));
                self.thumbnails.clear();
                self.photographs = Some(photographs);
            }
            // None were asked for, and none are there.
            Err(problem) if problem.is::<Cancelled>() => {}
            Err(problem) => {
                self.messages.error(format!("{problem:#}"));
                self.failure.get_or_insert(problem);
            }
        }
    }

    /// Opens a file or folder that was dropped on the window. Its ending decides: a camera file, a picture to compare
    /// with, or else a scene. A folder holds a scene, photographs, or cameras.
    pub fn drop_file(&mut self, path: &Path) {
        let path = &named(path);
        if path.is_dir() && in_folder(path) == *path {
            // It holds no scene.
            return match holds_photographs(path) {
                true => self.open_photographs(path),
                false => self.open_cameras(path),
            };
        }
        let is_sog = ["meta.json", LOD_META].iter().any(|name| path.file_name().is_some_and(|own| own == *name));
        if is_project(path) {
            return self.open_project(path);
        }
        if is_sog {
            return self.open(path, Reading::default());
        }
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("json" | "bin" | "txt") => self.open_cameras(path),
            Some("png" | "exr" | "npy" | "jpg" | "jpeg") => self.compare_with_picture(path),
            _ => self.open(path, Reading::default()),
        }
    }

    /// Writes what the next window begins with.
    pub fn keep(&self) {
        if let Some(file) = &self.setup.kept
            && let Err(problem) = self.kept.write(file)
        {
            (self.setup.remark)(&format!("note: {}: {problem:#}", file.display()));
        }
    }

    /// Closes a scene.
    pub fn close(&mut self, number: u64) {
        let Some(place) = self.layers.iter().position(|layer| layer.number == number) else { return };
        let layer = self.layers.remove(place);
        for held in layer.held.iter().chain(layer.edited.as_ref().map(|edited| &edited.kept)) {
            let measured = self.costs.iter_mut().filter_map(|(_, of)| of.as_mut());
            measured.chain(&mut self.comparison.drawn_of).for_each(|of| of.forget(held));
        }
        if self.layers.is_empty() {
            // The next scene is another one: it gets a view of its own, and the cameras are not its.
            (self.cameras, self.camera_file, self.camera, self.last_camera) = (Vec::new(), None, None, 0);
            (self.photographs, self.evaluation) = (None, None);
            (self.has_view, self.first_view, self.nearest) = (false, None, None);
            self.options.rules.near = self.setup.options.rules.near;
            self.inspection.culled_from = None;
        }
        self.is_stale = true;
    }

    /// Takes in a scene that was read, or reports why it could not be read.
    pub fn handle_scene(&mut self, number: u64, scene: Result<Opened>) {
        let Some(place) = self.layers.iter().position(|layer| layer.number == number) else { return };
        let is_again = self.layers[place].is_read;
        if is_again && self.layers[place].edit.is_some() {
            self.layers[place].progress = None;
            return self.note_stays(place);
        }
        match scene {
            Ok(scene) => {
                let (held, remarks) = self.layers[place].fill(scene);
                for remark in remarks.into_iter().filter(|_| !is_again) {
                    (self.setup.remark)(&remark);
                    self.messages.note(remark);
                }
                if let Source::File(file) = &self.layers[place].source
                    && !is_again
                {
                    self.kept.note(file);
                    self.keep();
                }
                if !self.setup.antialiased_is_explicit && self.project.is_none() {
                    self.options.rules.antialiased = self.layers.iter().any(|layer| layer.is_antialiased);
                }
                // A view set while reading knew only a part of the scene.
                let is_first = !self.has_view || self.layers.len() == 1 && !self.has_moved() && !is_again;
                let has_project = self.project.is_some();
                if is_first {
                    self.set_first_view(held.focus());
                }
                if is_again {
                    self.undo.forget_edits(number);
                } else {
                    self.restore_edit(place);
                    self.end_project();
                    self.begin_undo();
                    if !is_first && !has_project {
                        self.bring_into_sight(place);
                    }
                }
                if self.setup.follows {
                    self.layers[place].follow(&self.jobs);
                }
            }
            Err(problem) if is_again => {
                self.messages.error(format!("{problem:#}; the scene before it stays"));
                self.layers[place].progress = None;
                self.layers[place].follow(&self.jobs);
            }
            Err(problem) => {
                let layer = self.layers.remove(place);
                if !problem.is::<Cancelled>() {
                    let text = format!("{problem:#}");
                    let named = if text.contains(&layer.name) { text } else { format!("{}: {text}", layer.name) };
                    self.messages.error(named);
                    self.failure.get_or_insert(problem);
                }
            }
        }
        self.is_stale = true;
        // A reference is drawn of all scenes.
        let is_read = !self.is_reading() && self.has_view;
        if is_read && self.setup.compares_with.take_if(|with| *with == CompareWith::Reference).is_some() {
            self.compare_with_reference();
        }
    }

    /// Reads a scene again whose file changed.
    pub fn handle_change(&mut self, number: u64, changed: Result<()>) {
        let place = self.layers.iter().position(|layer| layer.number == number);
        let Some(place) = place.filter(|_| changed.is_ok()) else { return };
        match self.layers[place].edit {
            None => self.layers[place].read(&self.jobs),
            Some(_) => self.note_stays(place),
        }
    }

    /// An edit is of the Gaussians that the scene had when it was made.
    fn note_stays(&mut self, place: usize) {
        let layer = &mut self.layers[place];
        layer.has_changed = true;
        let text = "the file changed; it is read again when nothing is selected or edited any more";
        self.messages.note(format!("{}: {text}", layer.name));
    }

    /// Takes in cameras that were read, or reports why they could not be read.
    pub fn handle_cameras(&mut self, path: &Path, cameras: Result<CameraFile>) {
        self.is_reading_cameras = false;
        match cameras {
            Ok(CameraFile { cameras, notices, .. }) => {
                notices.iter().for_each(|notice| self.messages.note(format!("{}: {notice}", path.display())));
                self.events.emit(&Event::Cameras { count: cameras.len() });
                self.cameras = cameras;
                self.camera_file = std::path::absolute(path).ok();
                self.thumbnails.clear();
                self.evaluation = None;
                self.find_photographs();
                if !self.go_to_project() {
                    self.options.rules.near = self.setup.options.rules.near;
                    self.nearest = None;
                    self.go_to_camera(0, true);
                }
                self.find_camera_of_picture();
                self.first_view = Some(self.view());
                self.begin_undo();
            }
            Err(problem) => {
                self.end_project();
                let unreadable = Unreadable::new(path, &problem);
                self.messages.error(unreadable.to_string());
                self.failure.get_or_insert(unreadable.into());
            }
        }
    }
}
