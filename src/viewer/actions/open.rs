//! Actions that open scenes, cameras and pictures, take in the results of the jobs, and close scenes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;

use crate::camera::CameraFile;
use crate::files::read_whole;
use crate::formats::{LOD_META, Reading, in_folder};
use crate::scene::{Cancelled, SceneInstances, Unreadable};
use crate::viewer::model::{
    CAMERAS, CompareTarget, CompareWith, Event, JobEvent, Layer, LayerSource, Measures, OpenedScene, Origin, PICTURES,
    Photographs, PictureOf, Reporter, SecondPicture, Start, Viewer, holds_photographs, is_project,
};

/// The message that there is nothing to place.
const NO_SCENE: &str = "a list of places needs a scene: open one first";

/// The path of typed or pasted text, which may have surrounding spaces, quotes, file://, or ~ for the home folder. An
/// existing file with that very name has precedence.
fn typed_path(path: &Path) -> PathBuf {
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
    /// Opens the scenes, cameras, photographs and pictures of the setup.
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
        match (self.scenes.layers.first_mut(), self.setup.places.take()) {
            (Some(layer), Some(places)) => layer.places = Some(places),
            (None, Some(_)) => self.messages.error(NO_SCENE),
            (_, None) => {}
        }
        if !self.cameras.are_loading
            && let Some(folder) = self.setup.photographs.take()
        {
            self.open_photographs(&folder);
        }
        match self.setup.compares_with.clone() {
            Some(CompareWith::Options(options)) => self.comparison.target = CompareTarget::Options(Some(options)),
            Some(CompareWith::File(file)) => self.compare_with_picture(&file),
            // The reference needs a view, which the first scene sets.
            Some(CompareWith::Reference) | None => {}
        }
    }

    /// Opens a scene in addition to the open ones. With the first scene, also opens a camera file next to it, unless
    /// the setup names one.
    pub fn open(&mut self, path: &Path, reading: Reading) {
        let source = match LayerSource::of(path) {
            Ok(source) => source,
            Err(problem) => return self.messages.error(format!("{}: {problem:#}", path.display())),
        };
        if let (LayerSource::File(file), true, None) = (&source, self.scenes.layers.is_empty(), &self.setup.cameras)
            && let Some(cameras) = crate::camera::find(file)
        {
            self.read_cameras(&cameras, Origin::Found);
        }
        let number = self.scenes.next_number();
        self.scenes.layers.push(Layer::open(number, source, reading, self.options.wants_levels(), &self.jobs));
    }

    /// Starts to read a camera file that the user named.
    pub fn open_cameras(&mut self, path: &Path) {
        self.read_cameras(path, Origin::Named);
    }

    fn read_cameras(&mut self, path: &Path, origin: Origin) {
        let path = path.to_owned();
        let file = path.clone();
        self.cameras.are_loading = true;
        let lenses = self.setup.lenses.clone();
        let read = move || crate::camera::read(&file).and_then(|read| lenses.applied(read));
        self.jobs.start(move |_| read(), move |cameras| JobEvent::Cameras(path, origin, cameras));
    }

    /// Starts to search a folder for photographs.
    pub fn open_photographs(&mut self, folder: &Path) {
        let folder = folder.to_owned();
        self.cameras.are_loading = true;
        let read =
            move |_: &Reporter| Photographs::read(&folder).map_err(|problem| Unreadable::new(&folder, &problem).into());
        self.jobs.start(read, JobEvent::Photographs);
    }

    /// Starts to search the photographs of the cameras: in the folder of the setup, or beside the camera file.
    fn find_photographs(&mut self) {
        if let Some(folder) = self.setup.photographs.take() {
            return self.open_photographs(&folder);
        }
        // The photographs may have been opened before the cameras.
        let Some(file) = self.cameras.file.clone().filter(|_| !self.cameras.have_photographs()) else { return };
        if !self.setup.searches_photographs {
            return;
        }
        let cameras = self.cameras.list.clone();
        let find = move |_: &Reporter| {
            let found = Photographs::beside(&file).filter(|found| found.count_of(&cameras) > 0);
            found.ok_or_else(|| Cancelled.into())
        };
        self.cameras.photographs = None;
        self.cameras.are_loading = true;
        self.jobs.start(find, JobEvent::Photographs);
    }

    /// Stores the photographs of a folder, or reports why there are none.
    pub fn handle_photographs(&mut self, photographs: Result<Photographs>) {
        self.cameras.are_loading = false;
        self.end_project();
        match photographs {
            Ok(photographs) => {
                let (count, of) = (photographs.count_of(&self.cameras.list), self.cameras.list.len());
                self.messages
                    .note(format!("photographs of {count} of {of} cameras in {}", photographs.folder.display()));
                self.cameras.thumbnails.clear();
                self.cameras.photographs = Some(Arc::new(photographs));
            }
            // No folder was named, and none was found.
            Err(problem) if problem.is::<Cancelled>() => {}
            Err(problem) => {
                self.messages.error(format!("{problem:#}"));
                self.messages.failure.get_or_insert(problem);
            }
        }
    }

    /// Opens a file or folder that was dropped on the window. The extension decides between a camera file, a picture to
    /// compare with, and a scene. A folder contains a scene, photographs, or cameras.
    pub fn drop_file(&mut self, path: &Path) {
        let path = &typed_path(path);
        if path.is_dir() && in_folder(path) == *path {
            // The folder contains no scene.
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
        let is_one_of = |all: &[&str]| all.iter().any(|one| *one == extension);
        match () {
            () if extension == "json" && self.open_places(path) => {}
            () if is_one_of(&CAMERAS) => self.open_cameras(path),
            () if is_one_of(&PICTURES) => self.compare_with_picture(path),
            () => self.open(path, Reading::default()),
        }
    }

    /// Draws the placed scene at every place of a list. Returns false if the file is no list of places.
    fn open_places(&mut self, file: &Path) -> bool {
        // Other JSON files are those of cameras.
        let text = read_whole(file).unwrap_or_default();
        let is_list =
            serde_json::from_slice::<serde_json::Value>(&text).is_ok_and(|value| value.get("places").is_some());
        if !is_list {
            return false;
        }
        let places = match SceneInstances::parse(&text) {
            Ok(places) => places,
            Err(problem) => {
                self.messages.error(Unreadable::new(file, &problem).to_string());
                return true;
            }
        };
        let number = self.placed_layer();
        let Some(layer) = number.and_then(|number| self.scenes.layer_mut(number)) else {
            self.messages.error(NO_SCENE);
            return true;
        };
        let text = format!("{} at {} places", layer.name, places.all().len());
        layer.places = Some((file.to_owned(), places));
        self.pictures.are_stale = true;
        self.messages.note(text);
        true
    }

    /// Writes the state that the next window starts with.
    pub fn save_recent_state(&self) {
        if let Some(file) = &self.setup.recent_file
            && let Err(problem) = self.panels.recent.write(file)
        {
            (self.setup.remark)(&format!("note: {}: {problem:#}", file.display()));
        }
    }

    /// Closes a scene.
    pub fn close(&mut self, number: u64) {
        let Some(index) = self.scenes.index_of(number) else { return };
        let layer = self.scenes.layers.remove(index);
        (self.editing.values, self.editing.contributions) = (None, None);
        if let Some(scene) = &layer.scene {
            let measured = self.measuring.costs.iter_mut().filter_map(|(_, content)| content.as_mut());
            measured.for_each(|content| content.forget(scene));
            if let Some(SecondPicture { of: PictureOf::Content(content), .. }) = &mut self.comparison.picture {
                content.forget(scene);
            }
        }
        if self.scenes.layers.is_empty() {
            // The last scene was closed: reset the view and the cameras for the next one.
            (self.cameras.list, self.cameras.file) = (Vec::new(), None);
            (self.cameras.photographs, self.cameras.evaluation) = (None, None);
            (self.view.camera_index, self.view.last_camera_index) = (None, 0);
            (self.view.is_set, self.view.first, self.view.near_limit) = (false, None, None);
            self.options.rules.near = self.setup.options.rules.near;
            self.inspector.settings.culled_from = None;
            (self.measures, self.ruler.open) = (Measures::default(), None);
        }
        self.pictures.are_stale = true;
    }

    /// Stores a scene that was read, or reports why it could not be read.
    pub fn handle_scene(&mut self, number: u64, scene: Result<OpenedScene>) {
        let Some(index) = self.scenes.index_of(number) else { return };
        let is_again = self.scenes.layers[index].is_loaded;
        if is_again && self.scenes.layers[index].edit.is_some() {
            self.scenes.layers[index].progress = None;
            return self.report_pending_reload(index);
        }
        let opened = scene.and_then(|scene| self.scenes.layers[index].set_opened(scene));
        match opened {
            Ok((loaded, remarks)) => {
                for remark in remarks.into_iter().filter(|_| !is_again) {
                    (self.setup.remark)(&remark);
                    self.messages.note(remark);
                }
                if let LayerSource::File(file) = &self.scenes.layers[index].source
                    && !is_again
                {
                    self.panels.recent.add(file);
                    self.save_recent_state();
                }
                self.take_antialiasing_of_scenes();
                // A view that was set while reading fits only the part read until then.
                let is_first =
                    !self.view.is_set || self.scenes.layers.len() == 1 && !self.view.has_moved() && !is_again;
                let has_project = self.scenes.project.is_some();
                if is_first {
                    self.set_first_view(loaded.focus());
                }
                if is_again {
                    (self.editing.values, self.editing.contributions) = (None, None);
                    self.editing.undo.forget_edits(number);
                } else {
                    self.restore_edit(index);
                    self.end_project();
                    self.reset_undo();
                    if !is_first && !has_project {
                        self.reveal_layer(index);
                    }
                }
                if self.setup.watches_files {
                    self.scenes.layers[index].watch_file(&self.jobs);
                }
            }
            Err(problem) if is_again => {
                self.messages.error(format!("{problem:#}; the scene before it stays"));
                self.scenes.layers[index].progress = None;
                self.scenes.layers[index].watch_file(&self.jobs);
            }
            Err(problem) => {
                let layer = self.scenes.layers.remove(index);
                if !problem.is::<Cancelled>() {
                    let text = format!("{problem:#}");
                    let named = if text.contains(&layer.name) { text } else { format!("{}: {text}", layer.name) };
                    self.messages.error(named);
                    self.messages.failure.get_or_insert(problem);
                }
            }
        }
        self.pictures.are_stale = true;
        // The reference shows all scenes.
        let is_read = !self.scenes.are_loading() && self.view.is_set;
        if is_read && self.setup.compares_with.take_if(|with| *with == CompareWith::Reference).is_some() {
            self.compare_with_reference();
        }
    }

    /// Reads a scene again after its file has changed.
    pub fn handle_change(&mut self, number: u64, changed: Result<()>) {
        let index = self.scenes.index_of(number);
        let Some(index) = index.filter(|_| changed.is_ok()) else { return };
        match self.scenes.layers[index].edit {
            None => self.scenes.layers[index].read(&self.jobs),
            Some(_) => self.report_pending_reload(index),
        }
    }

    /// Reports that a scene is read again later, because its edit refers to the Gaussians that were read before.
    fn report_pending_reload(&mut self, index: usize) {
        let layer = &mut self.scenes.layers[index];
        layer.has_changed = true;
        let text = "the file changed; it is read again when nothing is selected or edited any more";
        self.messages.note(format!("{}: {text}", layer.name));
    }

    /// Stores cameras that were read, or reports why they could not be read. The view stays if nobody named the file.
    pub fn handle_cameras(&mut self, path: &Path, origin: Origin, cameras: Result<CameraFile>) {
        self.cameras.are_loading = false;
        match cameras {
            Ok(CameraFile { cameras, notices, .. }) => {
                if origin == Origin::Found {
                    (self.setup.remark)(&format!("note: cameras of {}", path.display()));
                }
                notices.iter().for_each(|notice| self.messages.note(format!("{}: {notice}", path.display())));
                self.events.emit(&Event::Cameras { count: cameras.len() });
                self.cameras.list = cameras;
                self.cameras.file = std::path::absolute(path).ok();
                self.cameras.thumbnails.clear();
                self.cameras.evaluation = None;
                self.find_photographs();
                let is_of_start = origin == Origin::Found || self.setup.cameras.as_deref() == Some(path);
                let starts = is_of_start && self.setup.start.is_some();
                if starts || !self.go_to_project() {
                    self.options.rules.near = self.setup.options.rules.near;
                    self.view.near_limit = None;
                    match self.scenes.focus().filter(|_| starts) {
                        Some(focus) => self.go_to_start(focus),
                        None => self.go_to_camera(0, true),
                    }
                }
                self.find_camera_of_picture();
                self.view.first = Some(self.view.camera());
                self.reset_undo();
            }
            Err(problem) if origin == Origin::Found => {
                let text = Unreadable::new(path, &problem).as_passed_over();
                (self.setup.remark)(&format!("note: {text}"));
                self.messages.note(text);
                if let (Some(Start::Camera(_)), Some(focus)) = (&self.setup.start, self.scenes.focus()) {
                    self.go_to_start(focus);
                }
            }
            Err(problem) => {
                self.end_project();
                let unreadable = Unreadable::new(path, &problem);
                self.messages.error(unreadable.to_string());
                self.messages.failure.get_or_insert(unreadable.into());
            }
        }
    }
}
