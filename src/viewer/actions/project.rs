//! Actions that save what a window shows, and open it again.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::DVec3;

use crate::formats::Reading;
use crate::procedural::Procedural;
use crate::rules::Background;
use crate::scene::Unreadable;
use crate::viewer::model::{
    ENDING, Edit, Held, Layer, PlacedScene, Project, Shown, Source, VIEW_MODES, Viewer, is_project, seen_from,
    view_mode,
};

impl Viewer {
    /// Saves scenes, places, edits, view, options and path. The ending is added where the name has another.
    pub fn save_project(&mut self, file: &Path) {
        let mut name = file.as_os_str().to_owned();
        if !is_project(file) {
            name.push(ENDING);
        }
        let file = PathBuf::from(name);
        let saved = self.project(&file).write(&file);
        match saved {
            Ok(()) => self.messages.note(format!("{} saved", file.display())),
            Err(problem) => self.messages.error(format!("{problem:#}")),
        }
    }

    fn project(&self, file: &Path) -> Project {
        let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        let named = |path: &PathBuf| seen_from(&folder, path);
        let scene = |layer: &Layer| PlacedScene {
            scene: match &layer.source {
                Source::File(path) => named(path).display().to_string(),
                Source::Procedural(_) => layer.source.argument(),
            },
            position: layer.place.translation,
            rotation: layer.place.rotation,
            scale: layer.place.scale,
            shown: layer.is_shown,
            edit: layer.edit.as_deref().map(Edit::to_runs).unwrap_or_default(),
        };
        let (view, options, path) = (&self.view(), &self.options, &self.film.timeline);
        let mut project = Project::new(&Shown { view, up: self.navigator.up(), options, path });
        project.scenes = self.layers.iter().map(scene).collect();
        project.cameras = self.camera_file.as_ref().map(named);
        project.photographs = self.photographs.as_ref().map(|photographs| named(&photographs.folder));
        project.pivot = self.navigator.pivot().to_array();
        project.background = self.background.colour();
        project.repeats = self.film.repeats;
        project.look = VIEW_MODES[self.inspection.mode].name.to_owned();
        project
    }

    /// Opens a project in place of what is open.
    pub fn open_project(&mut self, file: &Path) {
        if let Err(problem) = self.try_project(file) {
            let unreadable = Unreadable::new(file, &problem);
            self.messages.error(unreadable.to_string());
            self.failure.get_or_insert(unreadable.into());
        }
    }

    fn try_project(&mut self, file: &Path) -> Result<()> {
        let project = Project::read(file)?;
        let (options, path) = (project.options()?, project.path()?);
        let folder = file.parent().unwrap_or(Path::new(""));
        let sources = project.scenes.iter().map(|scene| match Procedural::parse(&scene.scene) {
            Some(procedural) => Ok(Source::Procedural(procedural.with_context(|| scene.scene.clone())?)),
            None => Ok(Source::File(folder.join(&scene.scene))),
        });
        let sources: Vec<Source> = sources.collect::<Result<_>>()?;
        // From here on nothing fails.
        while let Some(number) = self.layers.first().map(|layer| layer.number) {
            self.close(number);
        }
        self.options = options;
        (self.film.timeline, self.film.repeats, self.film.now) = (path, project.repeats, 0.0);
        self.background = Background::Colour(project.background);
        if let Some(mode) = view_mode(&project.look) {
            self.inspection.mode = mode;
        }
        if let Some(cameras) = &project.cameras {
            self.setup.photographs = project.photographs.as_ref().map(|folder_of| folder.join(folder_of));
            self.open_cameras(&folder.join(cameras));
        }
        for (scene, source) in project.scenes.iter().zip(sources) {
            let number = self.next_layer_number();
            let mut layer = Layer::open(number, source, Reading::default(), &self.jobs);
            (layer.place, layer.is_shown, layer.saved_edit) = (scene.place(), scene.shown, scene.edit.clone());
            self.layers.push(layer);
        }
        self.project = Some(project);
        self.is_stale = true;
        Ok(())
    }

    /// Goes to the view of the project that is being opened. Returns true if there is one.
    pub(super) fn go_to_project(&mut self) -> bool {
        let Some(project) = &self.project else { return false };
        if let (Ok(view), Ok(up)) = (project.view(), project.up()) {
            self.navigator.set_up(up);
            self.navigator.snap(&view.resized(self.size));
            self.navigator.set_pivot(DVec3::from(project.pivot));
            self.camera = None;
        }
        true
    }

    /// Ends opening a project, once its scenes and cameras are read.
    pub(super) fn end_project(&mut self) {
        if !self.is_reading() && !self.is_reading_cameras {
            self.project = None;
        }
    }

    /// Does again what was done to a scene of a project, now that it is read.
    pub(super) fn restore_edit(&mut self, place: usize) {
        let layer = &mut self.layers[place];
        let runs = std::mem::take(&mut layer.saved_edit);
        if runs.is_empty() {
            return;
        }
        let count = layer.held.as_ref().map_or(0, Held::count);
        match Edit::from_runs(&runs).filter(|edit| edit.gaussians() == count) {
            Some(edit) => self.set_edit(place, Some(Arc::new(edit))),
            None => {
                let text =
                    "what was selected, hidden and deleted is of a file with other Gaussians, and not done again";
                let name = layer.name.clone();
                self.messages.error(format!("{name}: {text}"));
            }
        }
    }
}
