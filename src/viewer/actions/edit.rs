//! Actions that select, hide and delete Gaussians, and save what is left.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};

use crate::formats::{SceneFile, WrittenFile, write_file};
use crate::gpu::Device;
use crate::pagefile::write;
use crate::pagefile::write::Job;
use crate::scene::{Gaussians, Scene};
use crate::viewer::frame::needs_whole;
use crate::viewer::jobs::{JobEvent, Reporter};
use crate::viewer::model::{
    Change, Counts, Edit, Edited, Held, How, Layer, Outline, Part, Property, Request, SEEN, Selection, Shares, Stroke,
    Tool, Viewer,
};

impl Viewer {
    /// True while a selection is not made yet, or the Gaussians that edits leave are not there.
    pub fn is_editing(&self) -> bool {
        self.selecting > 0 || self.layers.iter().any(Layer::is_being_edited)
    }

    /// Numbers of all scenes.
    pub fn edit_counts(&self) -> Counts {
        let all = self.layers.iter().filter_map(|layer| layer.edit.as_deref()).map(Edit::counts);
        all.fold(Counts::default(), |sum, one| Counts {
            selected: sum.selected + one.selected,
            hidden: sum.hidden + one.hidden,
            deleted: sum.deleted + one.deleted,
        })
    }

    /// Selects Gaussians of the scenes that are shown, of which nothing but what is seen if that is asked for.
    pub fn select(&mut self, selection: &Selection, how: How) {
        if self.only_seen || matches!(selection, Selection::Values(Property::Contribution, _)) {
            self.requests.push(Request::SelectByShares(selection.clone(), how, self.only_seen));
        } else {
            self.select_of(selection, how, None);
        }
    }

    /// Finds what the Gaussians contribute to the view, on another thread, and then selects.
    pub fn start_selection(&mut self, selection: Selection, how: How, only_seen: bool, device: Device) {
        let mut parts = Vec::new();
        for place in 0..self.layers.len() {
            let Some((whole, edit)) = self.editable(place) else { continue };
            let layer = &self.layers[place];
            match layer.part(0, false) {
                Ok(Some(placed)) => parts.push(Part { number: layer.number, whole, drawn: edit.drawn(), placed }),
                Ok(None) => {}
                Err(problem) => return self.messages.error(format!("{problem:#}")),
            }
        }
        if parts.is_empty() {
            return;
        }
        let (options, view) = (self.options, self.view());
        self.selecting += 1;
        let least = if only_seen { SEEN } else { 0.0 };
        let work = move |_: &Reporter| Shares::new(&device, parts, &options, view, least);
        self.jobs.start(work, move |shares| JobEvent::Shares(selection, how, shares));
    }

    /// Selects by what the Gaussians contribute, or reports why that is not known.
    pub fn handle_shares(&mut self, selection: &Selection, how: How, shares: Result<Shares>) {
        self.selecting -= 1;
        match shares {
            Ok(shares) => self.select_of(selection, how, Some(&shares)),
            Err(problem) => self.messages.error(format!("cannot find what is seen: {problem:#}")),
        }
    }

    fn select_of(&mut self, selection: &Selection, how: How, shares: Option<&Shares>) {
        let view = shares.map_or_else(|| self.view(), |shares| shares.view.clone());
        let near = f64::from(self.options.rules.near);
        for place in 0..self.layers.len() {
            let Some((whole, before)) = self.editable(place) else { continue };
            let known = match shares.map(|shares| shares.of(self.layers[place].number, &whole)) {
                // It was opened, shown or read again since.
                Some(None) => continue,
                known => known.flatten(),
            };
            let share = |i: usize| known.map_or(0.0, |shares| shares[i]);
            let least = shares.map_or(0.0, |shares| shares.least);
            let is_seen = |i: usize| share(i) >= least;
            let transform = match self.layers[place].place.transform() {
                Ok(transform) => transform,
                Err(problem) => return self.messages.error(format!("{problem:#}")),
            };
            let world = |i: usize| transform.point(DVec3::from(whole.means()[i].map(f64::from)));
            let edit = match selection {
                Selection::Outline(outline) => {
                    let [low, high] = outline.bounds();
                    before.selecting(how, |i| {
                        let is_inside = |at: DVec2| at.cmpge(low).all() && at.cmple(high).all() && outline.contains(at);
                        is_seen(i) && view.projected(world(i)).is_some_and(|(at, z)| z > near && is_inside(at))
                    })
                }
                Selection::Ball(centre, radius) => {
                    before.selecting(how, |i| is_seen(i) && world(i).distance(*centre) <= *radius)
                }
                Selection::Box(low, high) => before.selecting(how, |i| {
                    let place = world(i);
                    is_seen(i) && place.cmpge(*low).all() && place.cmple(*high).all()
                }),
                Selection::Values(property, range) => {
                    before.selecting(how, |i| is_seen(i) && range.contains(&property.of(&whole, i, share(i))))
                }
            };
            self.set_edit(place, Some(Arc::new(edit)));
        }
        let Counts { selected, .. } = self.edit_counts();
        self.messages.note(format!("{} Gaussians are selected", indicatif::HumanCount(selected as u64)));
    }

    /// Hides, deletes or selects Gaussians of the scenes that are shown.
    pub fn change(&mut self, change: Change) {
        for place in 0..self.layers.len() {
            if let Some((_, before)) = self.editable(place) {
                self.set_edit(place, Some(Arc::new(before.changed(change))));
            }
        }
    }

    /// The Gaussians of a scene that is shown and read, and its edit. A scene in pages is refused with a message.
    fn editable(&mut self, place: usize) -> Option<(Arc<Gaussians>, Edit)> {
        let layer = &self.layers[place];
        if !layer.is_shown[0] || layer.progress.is_some() {
            return None;
        }
        match &layer.held {
            Some(Held::Whole(whole)) => {
                let edit = layer.edit.as_deref().cloned();
                Some((whole.clone(), edit.unwrap_or_else(|| Edit::of(whole.len()))))
            }
            Some(Held::Pages(_)) => {
                self.messages.error(needs_whole("a selection"));
                None
            }
            None => None,
        }
    }

    /// Sets what is done to the Gaussians of a scene. What that leaves is found on another thread.
    pub(super) fn set_edit(&mut self, place: usize, edit: Option<Arc<Edit>>) {
        let layer = &mut self.layers[place];
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
        self.is_stale = true;
        self.explanation = None;
        self.inspection.isolated = None;
        let Some(edit) = edit else {
            layer.edited = None;
            if std::mem::take(&mut layer.has_changed) {
                layer.read(&self.jobs);
            }
            return;
        };
        let Some(Held::Whole(whole)) = layer.held.clone() else { return };
        let before = layer.edited.as_ref().map(|edited| (edited.of.clone(), edited.kept.clone()));
        let number = layer.number;
        self.jobs.start(
            move |_: &Reporter| Edited::new(edit, &whole, before),
            move |edited| JobEvent::Edited(number, edited),
        );
    }

    /// Takes in what an edit leaves of a scene, unless another one is wanted since.
    pub fn handle_edited(&mut self, number: u64, edited: Result<Edited>) {
        let Some(layer) = self.layers.iter_mut().find(|layer| layer.number == number) else { return };
        match edited {
            Ok(edited) if layer.edit.as_ref().is_some_and(|edit| Arc::ptr_eq(edit, &edited.of)) => {
                layer.edited = Some(edited);
                self.is_stale = true;
            }
            Ok(_) => {}
            Err(problem) => {
                // What is seen is what the edit before left.
                layer.edit = layer.edited.as_ref().map(|edited| edited.of.clone());
                self.messages.error(format!("the edit is taken back: {problem:#}"));
            }
        }
    }

    /// Ends a stroke of a tool over the picture.
    pub fn end_stroke(&mut self) {
        let Some(Stroke { way, how }) = self.stroke.take() else { return };
        let (Some(first), Some(last)) = (way.first().copied(), way.last().copied()) else { return };
        let outline = match self.tool {
            Tool::Rectangle => Outline::Rectangle(first, last),
            Tool::Lasso => Outline::Lasso(way),
            Tool::Brush => Outline::Brush(way, self.brush_px),
            Tool::Ball => {
                let pixel = first.to_array().map(|side| side.max(0.0) as u32);
                return self.requests.push(Request::SelectBall { pixel, radius_px: first.distance(last), how });
            }
            Tool::Look | Tool::Place => return,
        };
        self.select(&Selection::Outline(outline), how);
    }

    /// Selects what lies around the point that a pixel shows. `depth` is its view z, and the radius is seen there as
    /// this number of pixels.
    pub fn select_ball(&mut self, pixel: [u32; 2], radius_px: f64, depth: Option<f32>, how: How) {
        let Some(depth) = depth.map(f64::from) else { return self.messages.note("there is nothing at this pixel") };
        let view = self.view();
        let centre = view.unprojected(DVec2::from(pixel.map(f64::from)) + 0.5, depth);
        self.select(&Selection::Ball(centre, radius_px * depth / view.focal_px.x), how);
    }

    /// Writes the scenes that are shown into one file, on another thread: where they are placed, without what is
    /// deleted.
    pub fn save_scene(&mut self, file: &Path) {
        let file = file.to_owned();
        let mut parts = Vec::new();
        for layer in self.layers.iter().filter(|layer| layer.is_shown[0]) {
            let Some(Held::Whole(whole)) = layer.held.clone().filter(|_| layer.progress.is_none()) else {
                return self.messages.error(needs_whole("saving a scene"));
            };
            match layer.place.transform() {
                Ok(transform) => parts.push((whole, layer.edit.clone(), transform)),
                Err(problem) => return self.messages.error(format!("{problem:#}")),
            }
        }
        if parts.is_empty() {
            return self.messages.note("there is no scene to save");
        }
        let is_antialiased = self.layers.iter().any(|layer| layer.is_shown[0] && layer.is_antialiased);
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
            written(&file, gaussians, is_antialiased, &progress)
        };
        self.jobs.start(work, JobEvent::Written);
    }
}

/// Writes a scene in the format that its name stands for. Returns what is said of that.
fn written(file: &Path, gaussians: Gaussians, is_antialiased: bool, progress: &(dyn Fn(f64) + Sync)) -> Result<String> {
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
