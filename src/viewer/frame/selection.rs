//! Selections on the device, and the marks of edited scenes there.

use std::sync::Arc;

use anyhow::Result;
use glam::DVec3;

use super::session::Session;
use crate::camera::Camera;
use crate::render::{Aim, Marker, SelectionMode};
use crate::viewer::model::{
    Contributions, Counts, Edit, Event, JobEvent, MIN_VISIBLE, PictureContent, Plan, Property, PropertyValues,
    Selecting, Selection, Side, are_same, base_colour, needs_whole, part_of_set, set_of,
};

/// The largest difference of a channel of colours that the colour tool selects at first.
const SIMILAR: f32 = 0.08;

impl Session {
    /// Selects Gaussians of the shown scenes. Returns the request if it must wait for a picture; a job goes on with it
    /// if contributions are needed first.
    pub(crate) fn select(&mut self, mut selecting: Selecting) -> Result<Option<Selecting>> {
        if self.viewer.scenes.are_loading() {
            return Ok(Some(selecting));
        }
        if std::mem::take(&mut selecting.restarts) {
            self.viewer.restore_edits();
        }
        let plan = match self.viewer.plan(Side::First) {
            Ok(Some(plan)) => plan,
            Ok(None) => return Ok(None),
            Err(problem) => {
                self.viewer.messages.error(format!("{problem:#}"));
                return Ok(None);
            }
        };
        if plan.is_paged() {
            self.viewer.messages.error(needs_whole("a selection"));
            return Ok(None);
        }
        let is_drawn = self.pair.first.as_ref().is_some_and(|first| first.suits_scenes(&plan));
        if !is_drawn && self.viewer.pictures.refused[0].is_some() {
            self.viewer.messages.error("nothing is selected: the scenes cannot be drawn");
            return Ok(None);
        } else if !is_drawn {
            return Ok(Some(selecting));
        }
        // The scenes may be others now than those that a job looked at.
        selecting.contributions.take_if(|found| !are_same(&found.content.scenes, &plan.scenes));
        let by_contribution = matches!(selecting.selection, Selection::Values(Property::Contribution, _));
        if selecting.contributions.is_none() && (by_contribution || self.viewer.editing.only_visible) {
            let Some(known) = self.known_contributions(&selecting.view) else {
                return self.start_contributions(Some(selecting)).map(|()| None);
            };
            selecting.contributions = Some(known);
        }
        if let Selection::Values(property, _) = selecting.selection
            && !self.has_values(&plan, property, selecting.contributions.as_ref())
        {
            self.start_values(plan, property, selecting.contributions.clone(), Some(selecting));
            return Ok(None);
        }
        self.apply_edits(Some(true))?;
        self.select_now(&plan, &selecting)?;
        let Counts { selected, .. } = self.viewer.scenes.edit_counts();
        if !selecting.goes_on {
            self.viewer.messages.note(format!("{} Gaussians are selected", indicatif::HumanCount(selected as u64)));
        }
        Ok(None)
    }

    /// Selects in scenes that are on the device and have the marks of their edits there.
    fn select_now(&mut self, plan: &Plan, selecting: &Selecting) -> Result<()> {
        let Selecting { selection, mode, view, contributions, .. } = selecting;
        let (figure, near) = (selection.figure(), self.viewer.options.rules.near);
        let least = if self.viewer.editing.only_visible { MIN_VISIBLE } else { 0.0 };
        let Some(first) = &mut self.pair.first else { return Ok(()) };
        let by_value = matches!(selection, Selection::Values(..));
        let is_through_lens = matches!(selection, Selection::Outline(_)) && view.lens.is_some();
        let counts = plan.scenes.iter().map(|drawn| drawn.scene.count());
        let begins = counts.clone().scan(0, |next, count| Some(std::mem::replace(next, *next + count)));
        let edits: Vec<Edit> = if !first.has_marks() || is_through_lens {
            // Pages have no marks, and the device knows no lenses.
            let values = self.viewer.editing.values.as_ref().map(|values| values.all().0);
            let mut edits = Vec::new();
            for (drawn, begin) in plan.scenes.iter().zip(begins) {
                let whole = drawn.whole()?;
                let contribution = |i: usize| contributions.as_ref().map_or(0.0, |found| found.all[begin + i]);
                let value = |i: usize| match selection {
                    Selection::Values(..) => values.map_or(0.0, |values| values[begin + i]),
                    _ => 0.0,
                };
                let centre = |i: usize| drawn.transform.point(DVec3::from(whole.means()[i].map(f64::from)));
                let inside = set_of(whole.len(), |i| {
                    contribution(i) >= least && figure.contains(view, near.into(), centre(i), value(i))
                });
                edits.push(edit_of(&drawn.edit, whole.len()).combined(*mode, &inside));
            }
            edits
        } else {
            let device = self.screen.device();
            let marker = Marker::of(&mut self.marker, device)?;
            let editing = &mut self.viewer.editing;
            let aim = Aim {
                view,
                near,
                values: editing.values.as_ref().filter(|_| by_value).map(|values| values.all().1),
                contributions: contributions.as_ref().map(|found| (&found.on_device, least)),
            };
            let (words, ms) = marker.select(&first.scene, &figure, *mode, aim)?;
            editing.selection_ms = Some(ms);
            let parts = plan.scenes.iter().zip(begins.zip(counts));
            parts
                .map(|(drawn, (begin, count))| {
                    edit_of(&drawn.edit, count).selecting(part_of_set(&words, begin, count).into_iter())
                })
                .collect()
        };
        let viewer = &mut self.viewer;
        let is_shown = |index: &usize| matches!(viewer.scenes.layers[*index].drawn_scene(0), Ok(Some(_)));
        let shown: Vec<usize> = (0..viewer.scenes.layers.len()).filter(is_shown).collect();
        for (index, edit) in shown.into_iter().zip(edits) {
            viewer.set_edit(index, Some(Arc::new(edit)));
        }
        // The device has these marks already.
        if let Ok(Some(plan)) = viewer.plan(Side::First)
            && first.has_marks()
            && !is_through_lens
        {
            (first.marks, first.plan.scenes) = (Some(plan.marks(true)), plan.scenes);
        }
        Ok(())
    }

    /// Marks the Gaussians of both pictures as the scenes are edited now. `has_selection` is false if selected ones
    /// have their own colours; `None` stands for what the window shows.
    pub(crate) fn apply_edits(&mut self, has_selection: Option<bool>) -> Result<()> {
        let has_selection = has_selection.unwrap_or(self.viewer.shows_selection());
        for side in [Side::First, Side::Second] {
            let Some(drawn) = self.pair.drawn().find(|(of, _)| *of == side).map(|(_, drawn)| drawn) else { continue };
            let Ok(Some(plan)) = self.viewer.plan(side) else { continue };
            if !drawn.suits_scenes(&plan) {
                continue; // another picture is being made
            }
            let marks = plan.marks(has_selection);
            if drawn.marks.as_ref().is_some_and(|known| known.is_same(&marks)) {
                continue;
            }
            // Without a marker nothing has been marked.
            let needs_none = marks.are_none() && self.marker.is_none() && drawn.marks.is_none();
            if drawn.has_marks() && !needs_none {
                plan.mark(&drawn.scene, Marker::of(&mut self.marker, self.screen.device())?, has_selection)?;
                self.viewer.pictures.are_stale = true;
            }
            (drawn.marks, drawn.plan.scenes) = (Some(marks), plan.scenes);
        }
        Ok(())
    }

    /// Reports the numbers of selected, hidden and deleted Gaussians, if they have changed.
    pub(crate) fn report_edits(&mut self) {
        let counts = self.viewer.scenes.edit_counts();
        if std::mem::replace(&mut self.reported_edits, counts) != counts {
            let Counts { selected, hidden, deleted } = counts;
            self.viewer.events.emit(&Event::Edited { selected, hidden, deleted });
        }
    }

    /// The contributions to the current picture from a view, if a job has found them.
    fn known_contributions(&self, view: &Camera) -> Option<Arc<Contributions>> {
        let content = PictureContent { view: view.clone(), ..self.viewer.picture_content()? };
        let (known, first) = (self.viewer.editing.contributions.as_ref()?, self.pair.first.as_ref()?);
        let is_same_scene = known.alpha_min == first.plan.options.rules.alpha_min;
        (is_same_scene && known.content.difference(&content).is_none()).then(|| known.clone())
    }

    /// Starts a job that finds the contributions to the current picture, from the view of the selection that waits for
    /// them.
    fn start_contributions(&mut self, waiting: Option<Selecting>) -> Result<()> {
        self.apply_edits(None)?;
        let (Some(first), Some(content)) = (&self.pair.first, self.viewer.picture_content()) else { return Ok(()) };
        if first.scene.is_paged() {
            let what = "what is seen cannot be found: the scene is drawn in pages, as it does not fit into memory";
            match waiting {
                Some(_) => self.viewer.messages.error(what),
                None => self.viewer.editing.refused = Some((Property::Contribution, what.to_owned())),
            }
            return Ok(());
        }
        let view = waiting.as_ref().map_or_else(|| content.view.clone(), |waiting| waiting.view.clone());
        let content = PictureContent { view, ..content };
        let (device, options) = (self.screen.device().clone(), first.plan.options);
        // The marks of the window's scene may change before the job has drawn it.
        let scene = Marker::of(&mut self.marker, &device)?.separated(&first.scene)?;
        self.viewer.editing.is_finding = true;
        self.viewer.jobs.start(
            move |_| Contributions::new(&device, &scene, &options, content),
            move |found| JobEvent::Contributions(waiting, found),
        );
        Ok(())
    }

    /// True if the values of a property are known.
    fn has_values(&self, plan: &Plan, property: Property, contributions: Option<&Arc<Contributions>>) -> bool {
        let contributions = contributions.filter(|_| property == Property::Contribution);
        let known = self.viewer.editing.values.as_ref();
        known.is_some_and(|known| known.are_of(property, &plan.scenes, contributions))
    }

    /// Starts a job that computes the values of a property.
    fn start_values(
        &mut self,
        plan: Plan,
        property: Property,
        contributions: Option<Arc<Contributions>>,
        waiting: Option<Selecting>,
    ) {
        let contributions = contributions.filter(|_| property == Property::Contribution);
        let device = self.screen.device().clone();
        self.viewer.editing.is_finding = true;
        self.viewer.jobs.start(
            move |_| PropertyValues::new(&device, &plan, property, contributions),
            move |values| JobEvent::Values(waiting, values),
        );
    }

    /// Starts the job that the page Edit waits for: the values of its property.
    pub(crate) fn prepare_values(&mut self) -> Result<()> {
        let editing = &mut self.viewer.editing;
        let (is_due, property) = (std::mem::take(&mut editing.are_values_due), editing.property);
        editing.refused.take_if(|(refused, _)| *refused != property);
        let is_wanted = is_due && !editing.is_finding && editing.refused.is_none();
        if !is_wanted || self.viewer.scenes.are_loading() || self.viewer.is_moving() {
            return Ok(());
        }
        let Ok(Some(plan)) = self.viewer.plan(Side::First) else { return Ok(()) };
        if plan.is_paged() || !self.pair.first.as_ref().is_some_and(|first| first.suits_scenes(&plan)) {
            return Ok(());
        }
        let contributions = self.known_contributions(&self.viewer.view.camera());
        if property == Property::Contribution && contributions.is_none() {
            return self.start_contributions(None);
        }
        if !self.has_values(&plan, property, contributions.as_ref()) {
            self.start_values(plan, property, contributions, None);
        }
        Ok(())
    }

    /// Selects Gaussians whose colour is like that of the Gaussian with the largest part of a pixel.
    pub(crate) fn select_colour(&mut self, pixel: [u32; 2], mode: SelectionMode) -> Result<()> {
        let Some(explanation) = self.explained(pixel)? else { return Ok(()) };
        let Some(most) = explanation.splats.iter().max_by(|a, b| a.share.total_cmp(&b.share)) else {
            self.viewer.messages.note("there is nothing at this pixel");
            return Ok(());
        };
        let origin = self.pair.first.as_ref().and_then(|first| first.origin(most.gaussian as usize));
        let Some((drawn, index)) = origin else { return Ok(()) };
        let property = Property::Colour(base_colour(&*drawn.whole()?, index));
        let editing = &mut self.viewer.editing;
        if !matches!(editing.property, Property::Colour(_)) {
            editing.range = [0.0, SIMILAR];
        }
        editing.property = property;
        let [low, high] = editing.range;
        self.viewer.select_alike(Selection::Values(property, low..=high), mode);
        Ok(())
    }
}

/// The edit of a scene with this number of Gaussians.
fn edit_of(edit: &Option<Arc<Edit>>, count: usize) -> Edit {
    edit.as_deref().cloned().unwrap_or_else(|| Edit::new(count))
}
