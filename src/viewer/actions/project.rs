//! Actions that save and open projects.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::DVec3;

use crate::formats::Reading;
use crate::procedural::Procedural;
use crate::rules::Background;
use crate::scene::{SceneInstances, Unreadable};
use crate::viewer::model::{
    Appearance, Edit, Layer, LayerSource, LoadedScene, PROJECT_ENDING, PlacedScene, Project, ProjectView, Undo,
    VIEW_MODES, Viewer, is_project, relative_to, view_mode,
};

impl Viewer {
    /// Saves scenes, placements, edits, view, options and path. The ending is added if the name lacks it.
    pub fn save_project(&mut self, file: &Path) {
        let mut name = file.as_os_str().to_owned();
        if !is_project(file) {
            name.push(PROJECT_ENDING);
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
        let named = |path: &PathBuf| relative_to(&folder, path);
        let scene = |layer: &Layer| PlacedScene {
            scene: match &layer.source {
                LayerSource::File(path) => named(path).display().to_string(),
                LayerSource::Procedural(_) => layer.source.argument(),
            },
            position: layer.placement.translation,
            rotation: layer.placement.rotation,
            scale: layer.placement.scale,
            shown: layer.is_shown,
            places: layer.places.as_ref().map(|(file, _)| named(file)),
            edit: layer.edit.as_deref().map(Edit::to_runs).unwrap_or_default(),
            part: layer.part.as_deref().map(Edit::to_runs).unwrap_or_default(),
            name: layer.part.is_some().then(|| layer.name.clone()),
            appearance: layer.appearance,
        };
        let (view, options, path) = (&self.view.camera(), &self.options, &self.film.timeline);
        let mut project = Project::new(&ProjectView { view, up: self.view.navigator.up(), options, path });
        project.scenes = self.scenes.layers.iter().map(scene).collect();
        project.cameras = self.cameras.file.as_ref().map(named);
        project.photographs = self.cameras.photographs.as_ref().map(|photographs| named(&photographs.folder));
        project.pivot = self.view.navigator.pivot().to_array();
        project.background = self.view.background.colour();
        project.repeats = self.film.repeats;
        project.measures.clone_from(&self.measures);
        project.look = VIEW_MODES[self.inspector.settings.mode].name.to_owned();
        project
    }

    /// Opens a project in place of the open scenes.
    pub fn open_project(&mut self, file: &Path) {
        if let Err(problem) = self.try_project(file) {
            let unreadable = Unreadable::new(file, &problem);
            self.messages.error(unreadable.to_string());
            self.messages.failure.get_or_insert(unreadable.into());
        }
    }

    fn try_project(&mut self, file: &Path) -> Result<()> {
        let project = Project::read(file)?;
        let (options, path) = (project.options()?, project.path()?);
        let folder = file.parent().unwrap_or(Path::new(""));
        let sources = project.scenes.iter().map(|scene| match Procedural::parse(&scene.scene) {
            Some(procedural) => Ok(LayerSource::Procedural(procedural.with_context(|| scene.scene.clone())?)),
            None => Ok(LayerSource::File(folder.join(&scene.scene))),
        });
        let sources: Vec<LayerSource> = sources.collect::<Result<_>>()?;
        let read = |list: &PathBuf| {
            let file = folder.join(list);
            let places = SceneInstances::read(&file).with_context(|| list.display().to_string())?;
            anyhow::Ok((file, places))
        };
        let places = project.scenes.iter().map(|scene| scene.places.as_ref().map(read).transpose());
        let places: Vec<_> = places.collect::<Result<_>>()?;
        // Nothing fails from here on.
        self.editing.undo = Undo::default();
        while let Some(number) = self.scenes.layers.first().map(|layer| layer.number) {
            self.close(number);
        }
        self.options = options;
        (self.film.timeline, self.film.repeats, self.film.now) = (path, project.repeats, 0.0);
        self.view.background = Background::Colour(project.background);
        self.measures.clone_from(&project.measures);
        self.ruler.open = None;
        if let Some(mode) = view_mode(&project.look) {
            self.inspector.settings.mode = mode;
        }
        if let Some(cameras) = &project.cameras {
            self.setup.photographs = project.photographs.as_ref().map(|folder_of| folder.join(folder_of));
            self.open_cameras(&folder.join(cameras));
        }
        for ((scene, source), places) in project.scenes.iter().zip(sources).zip(places) {
            let number = self.scenes.next_number();
            // Edits, parts and appearances are of scenes in memory.
            let is_plain = scene.edit.is_empty() && scene.part.is_empty() && scene.appearance == Appearance::default();
            let wants_levels = options.wants_levels() && is_plain;
            let mut layer = Layer::open(number, source, Reading::default(), wants_levels, &self.jobs);
            (layer.placement, layer.is_shown, layer.project_edit) =
                (scene.placement(), scene.shown, scene.edit.clone());
            (layer.appearance, layer.places) = (scene.appearance, places);
            if let Some(name) = &scene.name {
                layer.name.clone_from(name);
            }
            layer.part = Edit::from_runs(&scene.part).filter(|part| part.gaussians() > 0).map(Arc::new);
            self.scenes.layers.push(layer);
        }
        self.scenes.project = Some(project);
        self.pictures.are_stale = true;
        Ok(())
    }

    /// Goes to the view of the project that is being opened. Returns false without one.
    pub(super) fn go_to_project(&mut self) -> bool {
        let Some(project) = &self.scenes.project else { return false };
        if let (Ok(view), Ok(up)) = (project.view(), project.up()) {
            self.view.navigator.set_up(up);
            self.view.navigator.snap(&view.resized(self.view.size));
            self.view.navigator.set_pivot(DVec3::from(project.pivot));
            self.view.camera_index = None;
        }
        true
    }

    /// Ends the opening of a project once its scenes and cameras are read.
    pub(super) fn end_project(&mut self) {
        if !self.scenes.are_loading() && !self.cameras.are_loading {
            self.scenes.project = None;
        }
    }

    /// Applies the project's edit to a scene that was read.
    pub(super) fn restore_edit(&mut self, index: usize) {
        let layer = &mut self.scenes.layers[index];
        let runs = std::mem::take(&mut layer.project_edit);
        if runs.is_empty() {
            return;
        }
        let count = layer.scene.as_ref().map_or(0, LoadedScene::count);
        match Edit::from_runs(&runs).filter(|edit| edit.gaussians() == count) {
            Some(edit) => self.set_edit(index, Some(Arc::new(edit))),
            None => {
                let text =
                    "what was selected, hidden and deleted is of a file with other Gaussians, and not done again";
                let name = layer.name.clone();
                self.messages.error(format!("{name}: {text}"));
            }
        }
    }
}
