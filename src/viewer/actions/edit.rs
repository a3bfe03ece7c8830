//! Actions that select, hide and delete Gaussians, and save the scene.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};

use crate::formats::{SceneFile, WrittenFile, write_file};
use crate::pagefile::write;
use crate::pagefile::write::Job;
use crate::render::{Outline, SelectionMode};
use crate::scene::{Gaussians, Scene};
use crate::viewer::model::{
    BoxHandles, Change, Contributions, Counts, DragMotion, Edit, JobEvent, Layer, LoadedScene, Property,
    PropertyValues, Reporter, Request, Selecting, Selection, Tool, ToolStroke, Viewer, needs_whole,
};

/// Distance in pixels within which a click closes a polygon.
const CLOSE_PX: f64 = 8.0;

impl Viewer {
    /// True while a job finds what selections need.
    pub fn has_running_edits(&self) -> bool {
        self.editing.is_finding
    }

    /// Selects Gaussians of the shown scenes.
    pub fn select(&mut self, selection: &Selection, mode: SelectionMode) {
        self.request_selection(selection.clone(), mode, (false, false));
    }

    /// Selects Gaussians in the place of the request of a pixel's colour.
    pub fn select_alike(&mut self, selection: Selection, mode: SelectionMode) {
        self.go_on_selecting(Some(self.selecting(selection, mode, (false, false))));
    }

    /// Selects during a drag of a range, or at its end.
    pub fn select_while_dragging(&mut self, selection: &Selection, goes_on: bool) {
        self.request_selection(selection.clone(), SelectionMode::Replace, (false, goes_on));
    }

    /// Requests a selection: true if it starts from the edits at the beginning of the stroke, and if its stroke goes
    /// on.
    fn request_selection(&mut self, selection: Selection, mode: SelectionMode, flags: (bool, bool)) {
        let selecting = self.selecting(selection, mode, flags);
        self.requests.push(Request::Select(selecting));
    }

    /// The request of a selection from the current view.
    fn selecting(&self, selection: Selection, mode: SelectionMode, (restarts, goes_on): (bool, bool)) -> Selecting {
        Selecting { selection, mode, view: self.view.camera(), restarts, contributions: None, goes_on }
    }

    /// Stores contributions, and goes on with the selection that waits for them.
    pub fn handle_contributions(&mut self, waiting: Option<Selecting>, found: Result<Contributions>) {
        self.editing.is_finding = false;
        match found {
            Ok(found) => {
                let found = Arc::new(found);
                self.editing.contributions = Some(found.clone());
                let waiting = waiting.map(|waiting| Selecting { contributions: Some(found), ..waiting });
                self.go_on_selecting(waiting);
            }
            Err(problem) => self.refuse_values(waiting, Property::Contribution, &problem),
        }
    }

    /// Stores values of a property, and goes on with the selection that waits for them.
    pub fn handle_values(&mut self, waiting: Option<Selecting>, values: Result<PropertyValues>) {
        self.editing.is_finding = false;
        match values {
            Ok(values) => {
                self.editing.values = Some(values);
                self.go_on_selecting(waiting);
            }
            Err(problem) => self.refuse_values(waiting, self.editing.property, &problem),
        }
    }

    /// Goes on with a selection that waited, before those that were requested meanwhile.
    fn go_on_selecting(&mut self, waiting: Option<Selecting>) {
        if let Some(waiting) = waiting {
            self.requests.insert(0, Request::Select(waiting));
        }
    }

    fn refuse_values(&mut self, waiting: Option<Selecting>, property: Property, problem: &anyhow::Error) {
        let text = format!("the {} of Gaussians cannot be found: {problem:#}", property.name());
        match waiting {
            Some(_) => self.messages.error(text),
            None => self.editing.refused = Some((property, text)),
        }
    }

    /// Changes the sets of the Gaussians of all shown scenes.
    pub fn change(&mut self, change: Change) {
        for index in 0..self.scenes.layers.len() {
            if let Some(before) = self.editable(index) {
                self.set_edit(index, Some(Arc::new(before.changed(change))));
            }
        }
    }

    /// Makes a scene of its own of what is selected of each shown scene, at the same place. The originals stay in their
    /// scenes only if it `copies`. The handles then place the first new scene.
    pub fn separate(&mut self, copies: bool) {
        let before = self.scenes.layers.len();
        let mut parts = Vec::new();
        for index in 0..before {
            let Some(edit) = self.editable(index) else { continue };
            let (number, whole) = (self.scenes.next_number(), &self.scenes.layers[index]);
            let layers = self.scenes.layers.iter().chain(parts.iter().map(|(_, part, _)| part));
            let others = layers.filter(|layer| layer.part.is_some() && layer.source == whole.source).count();
            match Layer::part_of(whole, number, format!("{}, part {}", whole.source.name(), others + 1)) {
                Ok(Some(part)) => parts.push((index, part, edit)),
                Ok(None) => {}
                Err(problem) => return self.messages.error(format!("nothing is separated: {problem:#}")),
            }
        }
        let change = if copies { Change::SelectNone } else { Change::Delete };
        for (index, part, edit) in parts {
            self.scenes.layers.push(part);
            self.set_edit(index, Some(Arc::new(edit.changed(change))));
        }
        let Some(first) = self.scenes.layers.get(before) else { return self.messages.note("nothing is selected") };
        let what = if copies { "copied into" } else { "moved into" };
        let text = format!("{what} a scene of its own: {}", first.name);
        (self.editing.placed_layer, self.editing.tool) = (Some(first.number), Tool::Place);
        self.pictures.are_stale = true;
        self.messages.note(text);
    }

    /// The edit of a scene that is shown and loaded. A paged scene is refused with a message.
    fn editable(&mut self, index: usize) -> Option<Edit> {
        let layer = &self.scenes.layers[index];
        if !layer.is_shown[0] || layer.progress.is_some() {
            return None;
        }
        match &layer.scene {
            Some(LoadedScene::Whole(whole)) => {
                let edit = layer.edit.as_deref().filter(|edit| edit.gaussians() == whole.len());
                Some(edit.cloned().unwrap_or_else(|| Edit::new(whole.len())))
            }
            Some(LoadedScene::Paged(_)) => {
                self.messages.error(needs_whole("a selection"));
                None
            }
            None => None,
        }
    }

    /// Sets the edit of a layer.
    pub(in crate::viewer) fn set_edit(&mut self, index: usize, edit: Option<Arc<Edit>>) {
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
        layer.edit = edit;
        self.pictures.are_stale = true;
        self.inspector.clear_explanation();
        if layer.edit.is_none() && std::mem::take(&mut layer.has_changed) {
            layer.read(&self.jobs);
        }
    }

    /// Begins a stroke of a tool at a place in the picture, in pixels.
    pub fn begin_stroke(&mut self, place: DVec2, mode: SelectionMode) {
        if self.editing.tool == Tool::Polygon {
            return self.add_corner(place, mode);
        }
        self.requests.push(Request::BeginStroke);
        self.pointer.stroke = Some(ToolStroke { points: vec![place], mode, painted: 0 });
    }

    /// Adds a corner to the polygon, or closes it and selects what it holds.
    fn add_corner(&mut self, place: DVec2, mode: SelectionMode) {
        let corners = &mut self.editing.polygon;
        let closes = |corner: Option<&DVec2>| corner.is_some_and(|corner| corner.distance(place) <= CLOSE_PX);
        if corners.len() < 3 || !(closes(corners.first()) || closes(corners.last())) {
            return corners.push(place);
        }
        let corners = std::mem::take(corners);
        self.request_selection(Selection::Outline(Outline::Lasso(corners)), mode, (false, false));
    }

    /// Selects what the stroke under way holds so far. `goes_on` is false at its end.
    pub fn apply_stroke(&mut self, goes_on: bool) {
        // Before the contributions are known, only the whole stroke selects.
        if goes_on && self.editing.only_visible {
            return;
        }
        let Some(stroke) = &mut self.pointer.stroke else { return };
        let (mut mode, points) = (stroke.mode, &stroke.points);
        let (Some(first), Some(last)) = (points.first().copied(), points.last().copied()) else { return };
        let outline = match self.editing.tool {
            Tool::Rectangle => Outline::Rectangle(first, last),
            Tool::Lasso => Outline::Lasso(points.clone()),
            Tool::Brush => {
                // What is painted stays, so only the new part selects.
                let (begin, radius) = (stroke.painted.saturating_sub(1), self.editing.brush_px);
                let way = points[begin..].to_vec();
                if stroke.painted > 0 && mode == SelectionMode::Replace {
                    mode = SelectionMode::Add;
                }
                if !self.editing.only_visible {
                    stroke.painted = points.len();
                }
                let brush = Selection::Outline(Outline::Brush(way, radius));
                return self.request_selection(brush, mode, (false, goes_on));
            }
            Tool::Ball => {
                let pixel = first.to_array().map(|side| side.max(0.0) as u32);
                let radius_px = first.distance(last);
                self.drop_strokes();
                return self.requests.push(Request::SelectBall { pixel, radius_px, mode, goes_on });
            }
            Tool::Colour if goes_on => return,
            Tool::Colour => {
                let pixel = last.to_array().map(|side| side.max(0.0) as u32);
                return self.requests.push(Request::SelectColour(pixel, mode));
            }
            Tool::Look | Tool::Place | Tool::Polygon | Tool::Box => return,
        };
        self.drop_strokes();
        self.request_selection(Selection::Outline(outline), mode, (true, goes_on));
    }

    /// Drops requests of the stroke under way that a longer part of it replaces.
    fn drop_strokes(&mut self) {
        self.requests.retain(|request| match request {
            Request::Select(selecting) => !selecting.goes_on,
            Request::SelectBall { goes_on, .. } => !goes_on,
            _ => true,
        });
    }

    /// Notes the edits from which a stroke starts, after an undo step.
    pub fn note_edits(&mut self) {
        self.end_undo_step();
        self.editing.before = self.scenes.edits();
    }

    /// Goes back to the edits at the beginning of the stroke.
    pub fn restore_edits(&mut self) {
        for (number, edit) in self.editing.before.clone() {
            let Some(index) = self.scenes.index_of(number) else { continue };
            // The scene may have been read again.
            let count = self.scenes.layers[index].scene.as_ref().map_or(0, LoadedScene::count);
            if edit.as_ref().is_none_or(|edit| edit.gaussians() == count) {
                self.set_edit(index, edit);
            }
        }
    }

    /// Ends the stroke of a tool.
    pub fn end_stroke(&mut self) {
        self.apply_stroke(false);
        self.pointer.stroke = None;
    }

    /// Ends a drag, a stroke or a polygon without an effect.
    pub fn cancel_stroke(&mut self) {
        if self.pointer.stroke.take().is_some() {
            self.drop_strokes();
            // In the frame in which it began nothing has been selected yet.
            match self.requests.iter().rposition(|request| matches!(request, Request::BeginStroke)) {
                Some(place) => drop(self.requests.remove(place)),
                None => self.restore_edits(),
            }
        }
        self.editing.polygon.clear();
        self.pointer.cancel();
    }

    /// Selects the centres in a ball around the point at a pixel. `depth` is its view z in world units; the radius has
    /// this number of pixels there.
    pub fn select_ball(
        &mut self,
        (pixel, depth): ([u32; 2], Option<f32>),
        radius_px: f64,
        mode: SelectionMode,
        goes_on: bool,
    ) {
        let Some(depth) = depth.map(f64::from) else {
            if !goes_on {
                self.messages.note("there is nothing at this pixel");
            }
            return;
        };
        let radius = radius_px * self.drawn_view().pixel_world(depth);
        let ball = Selection::Ball(self.point_at(pixel, depth), radius);
        self.go_on_selecting(Some(self.selecting(ball, mode, (true, goes_on))));
    }

    /// The box that selects: around the pivot, before it is moved.
    pub fn bounds(&self) -> [DVec3; 2] {
        let around = DVec3::splat(0.5 * self.view.navigator.radius());
        let pivot = self.view.navigator.pivot();
        self.editing.bounds.unwrap_or([pivot - around, pivot + around])
    }

    /// The drag of the face of the box at a position in the picture, in pixels; `points` is the number of pixels per
    /// point.
    pub fn face_at(&self, place: DVec2, points: f64) -> Option<DragMotion> {
        let (axis, is_greater) = BoxHandles::new(&self.view.camera(), self.bounds()).at(place, points)?;
        Some(DragMotion::Face(axis, is_greater))
    }

    /// Drags a face of the box from one position in the picture to another, in pixels, and selects what is inside.
    pub fn drag_face(&mut self, face: (usize, bool), from: DVec2, to: DVec2) {
        let corners = BoxHandles::new(&self.view.camera(), self.bounds()).dragged(face, from, to);
        self.editing.bounds = Some(corners);
        let selection = Selection::Box(corners[0], corners[1]);
        self.request_selection(selection, SelectionMode::Replace, (false, true));
    }

    /// Starts to write the shown scenes into one file: placed, without deleted Gaussians.
    pub fn save_scene(&mut self, file: &Path) {
        let file = file.to_owned();
        let mut parts = Vec::new();
        for layer in self.scenes.shown() {
            let Some(LoadedScene::Whole(whole)) = layer.scene.clone().filter(|_| layer.progress.is_none()) else {
                return self.messages.error(needs_whole("saving a scene"));
            };
            if layer.places.is_some() {
                return self.messages.error(format!("{}: a scene at places of a list is not saved", layer.name));
            }
            match layer.placement.transform() {
                Ok(transform) => parts.push((whole, layer.edit.clone(), transform, layer.appearance)),
                Err(problem) => return self.messages.error(format!("{problem:#}")),
            }
        }
        if parts.is_empty() {
            return self.messages.note("there is no scene to save");
        }
        let is_antialiased = self.scenes.layers.iter().any(|layer| layer.is_shown[0] && layer.is_antialiased);
        self.export.progress = Some(0.0);
        let work = move |reporter: &Reporter| {
            let kept = parts.iter().map(|(whole, edit, transform, appearance)| {
                let selected = edit.as_ref().map(|edit| whole.selected(&edit.kept())).transpose()?;
                Ok(appearance.applied(selected.as_ref().unwrap_or(whole).transformed(transform)?))
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
        let title = file.file_name().unwrap_or_default().to_string_lossy();
        let job = Job { progress, ..Job::new(file, write::Settings::default(), &title) };
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
