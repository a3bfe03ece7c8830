//! Actions that select, hide and delete Gaussians, and save the scene.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};

use crate::formats::{SceneFile, WrittenFile, write_file};
use crate::gpu::Device;
use crate::pagefile::write;
use crate::pagefile::write::Job;
use crate::scene::{Gaussians, Scene};
use crate::viewer::model::{
    Change, Contributions, Counts, DrawnScene, Edit, EditResult, JobEvent, Layer, LoadedScene, MIN_VISIBLE, Outline,
    Property, Reporter, Request, Selection, SelectionMode, Tool, ToolStroke, Viewer, needs_whole,
};

impl Viewer {
    /// True while jobs compute selections or the results of edits.
    pub fn has_running_edits(&self) -> bool {
        self.editing.running_selections > 0 || self.scenes.layers.iter().any(Layer::has_running_edit)
    }

    /// Selects Gaussians of the shown scenes. If contributions are needed, a job computes them first.
    pub fn select(&mut self, selection: &Selection, mode: SelectionMode) {
        if self.editing.only_visible || matches!(selection, Selection::Values(Property::Contribution, _)) {
            self.requests.push(Request::SelectByContributions(selection.clone(), mode, self.editing.only_visible));
        } else {
            self.select_of(selection, mode, None);
        }
    }

    /// Starts a job that computes the contributions to the view, for a selection.
    pub fn start_selection(&mut self, selection: Selection, mode: SelectionMode, only_visible: bool, device: Device) {
        let mut scenes = Vec::new();
        for index in 0..self.scenes.layers.len() {
            let Some((whole, edit)) = self.editable(index) else { continue };
            let layer = &self.scenes.layers[index];
            match layer.drawn_scene(0, false) {
                Ok(Some(placed)) => {
                    scenes.push(DrawnScene { number: layer.number, whole, drawn: edit.drawn(), placed })
                }
                Ok(None) => {}
                Err(problem) => return self.messages.error(format!("{problem:#}")),
            }
        }
        if scenes.is_empty() {
            return;
        }
        let (options, view) = (self.options, self.view.camera());
        self.editing.running_selections += 1;
        let min = if only_visible { MIN_VISIBLE } else { 0.0 };
        let work = move |_: &Reporter| Contributions::new(&device, scenes, &options, view, min);
        self.jobs.start(work, move |found| JobEvent::Contributions(selection, mode, found));
    }

    /// Selects by contributions, or reports why they could not be computed.
    pub fn handle_contributions(&mut self, selection: &Selection, mode: SelectionMode, found: Result<Contributions>) {
        self.editing.running_selections -= 1;
        match found {
            Ok(found) => self.select_of(selection, mode, Some(&found)),
            Err(problem) => self.messages.error(format!("cannot find what is seen: {problem:#}")),
        }
    }

    fn select_of(&mut self, selection: &Selection, mode: SelectionMode, contributions: Option<&Contributions>) {
        let view = contributions.map_or_else(|| self.view.camera(), |found| found.view.clone());
        let near = f64::from(self.options.rules.near);
        for index in 0..self.scenes.layers.len() {
            let Some((whole, before)) = self.editable(index) else { continue };
            let known = match contributions.map(|found| found.of(self.scenes.layers[index].number, &whole)) {
                // The layer was opened, shown or read again meanwhile.
                Some(None) => continue,
                known => known.flatten(),
            };
            let contribution = |i: usize| known.map_or(0.0, |known| known[i]);
            let min = contributions.map_or(0.0, |found| found.min);
            let is_visible = |i: usize| contribution(i) >= min;
            let transform = match self.scenes.layers[index].placement.transform() {
                Ok(transform) => transform,
                Err(problem) => return self.messages.error(format!("{problem:#}")),
            };
            let world = |i: usize| transform.point(DVec3::from(whole.means()[i].map(f64::from)));
            let edit = match selection {
                Selection::Outline(outline) => {
                    let [low, high] = outline.bounds();
                    before.selecting(mode, |i| {
                        let is_inside = |at: DVec2| at.cmpge(low).all() && at.cmple(high).all() && outline.contains(at);
                        is_visible(i) && view.projected(world(i)).is_some_and(|(at, z)| z > near && is_inside(at))
                    })
                }
                Selection::Ball(centre, radius) => {
                    before.selecting(mode, |i| is_visible(i) && world(i).distance(*centre) <= *radius)
                }
                Selection::Box(low, high) => before.selecting(mode, |i| {
                    let point = world(i);
                    is_visible(i) && point.cmpge(*low).all() && point.cmple(*high).all()
                }),
                Selection::Values(property, range) => before
                    .selecting(mode, |i| is_visible(i) && range.contains(&property.value(&whole, i, contribution(i)))),
            };
            self.set_edit(index, Some(Arc::new(edit)));
        }
        let Counts { selected, .. } = self.scenes.edit_counts();
        self.messages.note(format!("{} Gaussians are selected", indicatif::HumanCount(selected as u64)));
    }

    /// Changes the flags of the Gaussians of all shown scenes.
    pub fn change(&mut self, change: Change) {
        for index in 0..self.scenes.layers.len() {
            if let Some((_, before)) = self.editable(index) {
                self.set_edit(index, Some(Arc::new(before.changed(change))));
            }
        }
    }

    /// The Gaussians of a scene that is shown and loaded, with its edit. A paged scene is refused with a message.
    fn editable(&mut self, index: usize) -> Option<(Arc<Gaussians>, Edit)> {
        let layer = &self.scenes.layers[index];
        if !layer.is_shown[0] || layer.progress.is_some() {
            return None;
        }
        match &layer.scene {
            Some(LoadedScene::Whole(whole)) => {
                let edit = layer.edit.as_deref().cloned();
                Some((whole.clone(), edit.unwrap_or_else(|| Edit::new(whole.len()))))
            }
            Some(LoadedScene::Paged(_)) => {
                self.messages.error(needs_whole("a selection"));
                None
            }
            None => None,
        }
    }

    /// Sets the edit of a layer, and starts a job that computes its result.
    pub(super) fn set_edit(&mut self, index: usize, edit: Option<Arc<Edit>>) {
        let layer = &mut self.scenes.layers[index];
        let edit = edit.filter(|edit| edit.counts() != Counts::default());
        let is_same = match (&edit, &layer.edit) {
            (None, None) => true,
            (Some(one), Some(other)) => Arc::ptr_eq(one, other) || one == other,
            _ => false,
        };
        if is_same {
            return;
        }
        layer.edit.clone_from(&edit);
        self.pictures.are_stale = true;
        self.inspector.clear_explanation();
        let Some(edit) = edit else {
            layer.edit_result = None;
            if std::mem::take(&mut layer.has_changed) {
                layer.read(&self.jobs);
            }
            return;
        };
        let Some(LoadedScene::Whole(whole)) = layer.scene.clone() else { return };
        let before = layer.edit_result.as_ref().map(|before| (before.edit.clone(), before.scene.clone()));
        let number = layer.number;
        self.jobs.start(
            move |_: &Reporter| EditResult::new(edit, &whole, before),
            move |result| JobEvent::Edited(number, result),
        );
    }

    /// Stores the result of an edit, unless the layer has another edit by now.
    pub fn handle_edit_result(&mut self, number: u64, result: Result<EditResult>) {
        let Some(layer) = self.scenes.layer_mut(number) else { return };
        match result {
            Ok(result) if layer.edit.as_ref().is_some_and(|edit| Arc::ptr_eq(edit, &result.edit)) => {
                layer.edit_result = Some(result);
                self.pictures.are_stale = true;
            }
            Ok(_) => {}
            Err(problem) => {
                // The picture shows the result of the edit before.
                layer.edit = layer.edit_result.as_ref().map(|result| result.edit.clone());
                self.messages.error(format!("the edit is taken back: {problem:#}"));
            }
        }
    }

    /// Ends the stroke of a tool, and selects.
    pub fn end_stroke(&mut self) {
        let Some(ToolStroke { points, mode }) = self.pointer.stroke.take() else { return };
        let (Some(first), Some(last)) = (points.first().copied(), points.last().copied()) else { return };
        let outline = match self.editing.tool {
            Tool::Rectangle => Outline::Rectangle(first, last),
            Tool::Lasso => Outline::Lasso(points),
            Tool::Brush => Outline::Brush(points, self.editing.brush_px),
            Tool::Ball => {
                let pixel = first.to_array().map(|side| side.max(0.0) as u32);
                return self.requests.push(Request::SelectBall { pixel, radius_px: first.distance(last), mode });
            }
            Tool::Look | Tool::Place => return,
        };
        self.select(&Selection::Outline(outline), mode);
    }

    /// Selects the centres in a ball around the point at a pixel. `depth` is its view z in world units; the radius has
    /// this number of pixels there.
    pub fn select_ball(&mut self, pixel: [u32; 2], radius_px: f64, depth: Option<f32>, mode: SelectionMode) {
        let Some(depth) = depth.map(f64::from) else { return self.messages.note("there is nothing at this pixel") };
        let view = self.view.camera();
        let centre = view.unprojected(DVec2::from(pixel.map(f64::from)) + 0.5, depth);
        self.select(&Selection::Ball(centre, radius_px * view.pixel_world(depth)), mode);
    }

    /// Starts to write the shown scenes into one file: placed, without deleted Gaussians.
    pub fn save_scene(&mut self, file: &Path) {
        let file = file.to_owned();
        let mut parts = Vec::new();
        for layer in self.scenes.shown() {
            let Some(LoadedScene::Whole(whole)) = layer.scene.clone().filter(|_| layer.progress.is_none()) else {
                return self.messages.error(needs_whole("saving a scene"));
            };
            match layer.placement.transform() {
                Ok(transform) => parts.push((whole, layer.edit.clone(), transform)),
                Err(problem) => return self.messages.error(format!("{problem:#}")),
            }
        }
        if parts.is_empty() {
            return self.messages.note("there is no scene to save");
        }
        let is_antialiased = self.scenes.layers.iter().any(|layer| layer.is_shown[0] && layer.is_antialiased);
        self.export.progress = Some(0.0);
        let work = move |reporter: &Reporter| {
            let kept = parts.iter().map(|(whole, edit, transform)| {
                let selected = edit.as_ref().map(|edit| whole.selected(&edit.kept())).transpose()?;
                selected.as_ref().unwrap_or(whole).transformed(transform)
            });
            let mut kept: Vec<Gaussians> = kept.collect::<Result<_>>()?;
            let gaussians = if kept.len() == 1 { kept.remove(0) } else { Gaussians::joined(kept.iter())? };
            drop(kept);
            ensure!(!gaussians.is_empty(), "all Gaussians are deleted: there is nothing to save");
            let progress = |fraction| reporter.send(JobEvent::Writing(fraction));
            write_edited(&file, gaussians, is_antialiased, &progress)
        };
        self.jobs.start(work, JobEvent::Written);
    }
}

/// Writes a scene in the format of the file's name. Returns a text about the file for the user.
fn write_edited(
    file: &Path,
    gaussians: Gaussians,
    is_antialiased: bool,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<String> {
    let count = |gaussians: usize| indicatif::HumanCount(gaussians as u64);
    if file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("smalto")) {
        let title = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let settings = write::Settings::default();
        let job = Job { output: file, settings, title, progress, is_cancelled: &|| false };
        let number = gaussians.len();
        let scene = Scene { gaussians, is_antialiased, ..Scene::empty("edited") };
        write::write_whole(&job, &scene)?;
        return Ok(format!("{} written, {} Gaussians", file.display(), count(number)));
    }
    let kind = SceneFile::of(file)?;
    let arranged = kind.arranged(&gaussians).context("it cannot be arranged")?;
    ensure!(!arranged.is_empty(), "the format rounds the opacity of all Gaussians to 0");
    let WrittenFile { format, bytes, loss } = write_file(file, kind, &arranged, is_antialiased, progress)?;
    let bytes = indicatif::HumanBytes(bytes);
    let mut text = format!("{} written: {} Gaussians, {format}, {bytes}", file.display(), count(arranged.len()));
    let changed: Vec<String> = loss
        .iter()
        .filter(|loss| loss.largest > 0.0)
        .map(|loss| format!("{} by up to {:.2e} {}", loss.attribute, loss.largest, loss.unit))
        .collect();
    if !changed.is_empty() {
        text += &format!("; the format changes {}", changed.join(", "));
    }
    if arranged.len() < gaussians.len() {
        text += &format!("; {} round to no opacity and are left out", count(gaussians.len() - arranged.len()));
    }
    if arranged.sh_degree() < gaussians.sh_degree() {
        text += &format!("; the format holds spherical harmonics up to degree {} only", arranged.sh_degree());
    }
    if is_antialiased && !kind.says_antialiased() {
        text += "; the format cannot say that the scene was trained with antialiasing";
    }
    Ok(text)
}
