//! The state of a viewer: scenes, view, options, and running jobs. Actions change it, panels show it.

use std::time::Instant;

use anyhow::Result;
use glam::{DVec2, DVec3};

use super::cameras::Cameras;
use super::comparison::{CompareTarget, Comparison, PictureContent, PictureOf, with_rules_of_scene};
use super::dialog::Dialog;
use super::drag::{Drag, Pointer};
use super::editing::Editing;
use super::events::Events;
use super::export::Export;
use super::film::Film;
use super::inspector::Inspector;
use super::job_event::Jobs;
use super::keys::Action;
use super::measures::{Measures, Ruler};
use super::measuring::Measuring;
use super::messages::Messages;
use super::panels::Panels;
use super::pictures::Pictures;
use super::plan::{Pair, Plan, Second, Side};
use super::recent::{RecentState, Tab};
use super::requests::Request;
use super::scenes::Scenes;
use super::setup::Setup;
use super::snapshot::Area;
use super::timing::Timing;
use super::view::View;
use crate::camera::Camera;
use crate::options::Options;
use crate::render::Quantity;
use crate::rules::Rules;

/// The state of a viewer.
pub struct Viewer {
    pub setup: Setup,
    pub jobs: Jobs,
    pub events: Events,
    pub messages: Messages,
    pub requests: Vec<Request>,
    pub scenes: Scenes,
    pub cameras: Cameras,
    pub view: View,
    pub options: Options,
    pub pictures: Pictures,
    pub comparison: Comparison,
    pub inspector: Inspector,
    pub measures: Measures,
    pub ruler: Ruler,
    pub timing: Timing,
    pub measuring: Measuring,
    pub film: Film,
    pub export: Export,
    pub editing: Editing,
    pub pointer: Pointer,
    pub panels: Panels,
}

impl Viewer {
    /// A viewer without scenes for a window of `size` pixels.
    pub fn new(setup: Setup, jobs: Jobs, size: [u32; 2]) -> Self {
        let recent = setup.recent_file.as_deref().map(RecentState::read).unwrap_or_default();
        Self {
            jobs,
            events: Events::new(setup.prints_events),
            messages: Messages::default(),
            requests: Vec::new(),
            scenes: Scenes::default(),
            cameras: Cameras::default(),
            view: View::new(size, setup.background),
            options: setup.options,
            pictures: Pictures::default(),
            comparison: Comparison { mode: setup.compare_mode, ..Comparison::default() },
            inspector: Inspector::new(setup.view_mode),
            measures: Measures::default(),
            ruler: Ruler::default(),
            timing: Timing::new(setup.fps, setup.vsync),
            measuring: Measuring::default(),
            film: Film::default(),
            export: Export::default(),
            editing: Editing::default(),
            pointer: Pointer::default(),
            panels: Panels {
                are_hidden: setup.hides_panels,
                are_elsewhere: false,
                shows_help: false,
                dialog: Dialog::default(),
                is_wide: false,
                recent,
            },
            setup,
        }
    }

    /// Shows the scenes, the cameras and the view of another viewer, which has read them.
    pub fn join(&mut self, other: &Self) {
        self.scenes.share(&other.scenes);
        self.messages.share(&other.messages, None);
        (self.cameras.list, self.cameras.file) = (other.cameras.list.clone(), other.cameras.file.clone());
        self.cameras.photographs.clone_from(&other.cameras.photographs);
        let (window, size) = (self.view.window_size, self.view.size);
        self.view = other.view.clone();
        self.view.set_sizes(window, size);
        self.options = other.options;
        self.inspector.settings.ranges = other.inspector.settings.ranges;
        self.pictures.are_stale = true;
    }

    /// Shows the scenes that another viewer has read again, and what it has said since a time. True if there are any.
    pub fn follow(&mut self, other: &Self, since: Instant) -> bool {
        self.messages.share(&other.messages, Some(since));
        let has_changed = self.scenes.follow(&other.scenes);
        if has_changed {
            self.take_antialiasing_of_scenes();
            self.inspector.clear_explanation();
            self.pictures.are_stale = true;
        }
        has_changed
    }

    /// Filters as the scenes were trained, unless the user or a project said how.
    pub fn take_antialiasing_of_scenes(&mut self) {
        if !self.setup.antialiased_is_explicit && self.scenes.project.is_none() {
            self.options.rules.antialiased = self.scenes.layers.iter().any(|layer| layer.is_antialiased);
        }
    }

    /// True while the user or an animation moves the view.
    pub fn is_moving(&self) -> bool {
        let is_dragged = self.pointer.drag.is_some_and(Drag::moves_view);
        self.view.is_flying || self.view.navigator.is_gliding() || self.film.is_playing || is_dragged
    }

    /// Says a note in the window and in the terminal.
    pub fn remark(&mut self, text: &str) {
        (self.setup.remark)(&format!("note: {text}"));
        self.messages.note(text);
    }

    /// True if pixel values of the pictures are needed on the host.
    pub fn needs_snapshot(&self) -> bool {
        let has_numbers = self.inspector.settings.quantity() != Quantity::Colour;
        self.comparison.target != CompareTarget::Nothing || has_numbers || self.panels.shows(Tab::Inside)
    }

    /// True if lines over the picture are told whether they lie behind it.
    pub fn needs_depths(&self) -> bool {
        let shows_path = self.panels.shows(Tab::Path) && !self.film.timeline.keys().is_empty();
        !self.panels.are_hidden && (self.panels.recent.shows_guides || shows_path)
    }

    /// The options of a preset for the open scenes. Antialiasing is that of the scene, and so is the near plane where
    /// it must be nearer; how much of levels of detail is drawn is no part of a preset.
    pub fn preset(&self, preset: &Options) -> Options {
        let Options { lod_error, lod_psnr, splats, lod_fade, lod_occlusion, .. } = self.options;
        let nearest = self.view.near_limit.unwrap_or(f32::INFINITY);
        let near = if self.setup.near_is_explicit { self.options.rules.near } else { preset.rules.near.min(nearest) };
        let rules = Rules { near, antialiased: self.options.rules.antialiased, ..preset.rules };
        Options { rules, lod_error, lod_psnr, splats, lod_fade, lod_occlusion, ..*preset }
    }

    /// The view of the picture that is seen: the current view, unless it has moved since the last drawing.
    pub fn drawn_view(&self) -> Camera {
        self.pictures.view.clone().unwrap_or_else(|| self.view.camera())
    }

    /// The point of the picture that is seen at a pixel, at this view z in world units.
    pub fn point_at(&self, pixel: [u32; 2], depth: f64) -> DVec3 {
        self.drawn_view().unprojected(DVec2::from(pixel.map(f64::from)) + 0.5, depth)
    }

    /// The content of the first picture; `None` if it shows no scene.
    pub fn picture_content(&self) -> Option<PictureContent> {
        let Plan { scenes, options, .. } = self.plan(Side::First).ok().flatten()?;
        Some(PictureContent {
            view: self.view.camera(),
            scenes,
            rules: options.untraded().rules,
            background: self.view.background,
        })
    }

    /// Names what the second picture was drawn of and the first was not; `None` if both can be compared. What is
    /// shown, named and measured of the second picture asks this.
    pub fn mismatch(&self, pair: &Pair) -> Option<&'static str> {
        if !matches!(self.comparison.target, CompareTarget::Reference | CompareTarget::Picture) {
            return None;
        }
        let (picture, first) = (self.comparison.picture.as_ref()?, pair.first.as_ref()?);
        match &picture.of {
            // The first picture may still be that of the plan before.
            PictureOf::Content(content) => content.difference(&PictureContent {
                view: self.view.camera(),
                scenes: first.plan.scenes.clone(),
                rules: first.plan.options.untraded().rules,
                background: self.view.background,
            }),
            PictureOf::Camera(camera) => (self.view.camera_index != Some(*camera)).then_some("another view"),
            PictureOf::File(_) => None,
        }
    }

    /// What a photograph covers of the view; `None` if the second picture covers all of it.
    pub fn covered(&self, pair: &Pair) -> Option<Area> {
        self.comparison.covered.filter(|_| matches!(pair.second, Some(Second::Image(_))))
    }

    /// The reason why the picture shows nothing of the scenes, as a sentence; `None` if it shows something.
    pub fn why_nothing_is_seen(&self, pair: &Pair) -> Option<String> {
        let key = |action| self.setup.bindings.text(action);
        let Some(first) = &pair.first else {
            let is_shown = self.scenes.layers.iter().any(|layer| layer.is_shown[0]);
            return match () {
                () if self.scenes.layers.is_empty() || self.pictures.refused[0].is_some() => None,
                () if !is_shown => Some("no scene is shown: tick one in the page Scene".to_owned()),
                () => Some("the first picture is being prepared".to_owned()),
            };
        };
        // The counts are those of the last frame.
        if first.frame.totals.visible > 0 || self.pictures.are_stale {
            return None;
        }
        if first.plan.drawn_count() == 0 {
            let undo = key(Action::Undo);
            return Some(format!("no Gaussian is left: all are deleted or hidden ({undo} undoes)"));
        }
        let (near, frame) = (self.options.rules.near, key(Action::Frame));
        Some(format!("no Gaussian is in view beyond the near plane at {near} ({frame} shows all scenes)"))
    }

    /// The plan for a side; `None` if the GPU draws nothing for it.
    ///
    /// # Errors
    /// The placement of a scene is not a valid transform.
    pub fn plan(&self, side: Side) -> Result<Option<Plan>> {
        let options = match side {
            Side::First => self.options,
            Side::Second => match self.comparison.options(&self.options) {
                Some(options) => options,
                None => return Ok(None),
            },
        };
        let scenes = self.scenes.layers.iter().filter_map(|layer| layer.drawn_scene(side as usize).transpose());
        let scenes = scenes.collect::<Result<Vec<_>>>()?;
        Ok((!scenes.is_empty()).then_some(Plan { scenes, options, shaders: self.pictures.shaders }))
    }

    /// The plan for the picture in the window: [`Viewer::plan`] at the scale of the motion.
    ///
    /// # Errors
    /// Those of [`Viewer::plan`].
    pub fn shown_plan(&self, side: Side) -> Result<Option<Plan>> {
        let mut plan = self.plan(side)?;
        if let Some(plan) = plan.as_mut().filter(|plan| !plan.is_paged()) {
            plan.options.scale *= self.timing.motion_scale();
        }
        Ok(plan)
    }

    /// True if selected Gaussians are tinted: pictures that are compared have their own colours.
    pub fn shows_selection(&self) -> bool {
        self.comparison.target == CompareTarget::Nothing
    }

    /// True if a picture of this plan shows the current scenes completely.
    pub fn is_current(&self, plan: &Plan) -> bool {
        self.shown_plan(Side::First).is_ok_and(|planned| planned.is_some_and(|planned| planned.has_scene_of(plan)))
    }

    /// The name of the first picture of a comparison, by the options that it was drawn with.
    pub fn first_name(&self, pair: &Pair) -> String {
        let drawn = pair.first.as_ref().map_or(self.options, |drawn| drawn.plan.options);
        let like = |preset: &Options| {
            let wanted = self.preset(preset);
            // A picture in motion has a smaller scale.
            Options { rules: Rules { near: drawn.rules.near, ..wanted.rules }, scale: drawn.scale, ..wanted } == drawn
        };
        preset_name(like).unwrap_or("these options").to_owned()
    }

    /// The name of the second picture of a comparison, likewise.
    pub fn second_name(&self, pair: &Pair) -> String {
        match &self.comparison.target {
            CompareTarget::Nothing => String::new(),
            CompareTarget::Options(None) => "other scenes".to_owned(),
            CompareTarget::Options(Some(options)) => {
                let drawn = pair.second.as_ref().and_then(Second::drawn);
                let drawn = drawn.map_or(with_rules_of_scene(options, &self.options), |drawn| drawn.plan.options);
                let like = |preset: &Options| {
                    Options { scale: drawn.scale, ..with_rules_of_scene(preset, &self.options) } == drawn
                };
                preset_name(like).unwrap_or("other options").to_owned()
            }
            CompareTarget::Reference | CompareTarget::Picture => {
                self.comparison.picture.as_ref().map_or_else(String::new, |picture| picture.name.clone())
            }
        }
    }
}

/// The name of the preset that is like this.
pub fn preset_name(is_like: impl Fn(&Options) -> bool) -> Option<&'static str> {
    Options::PRESETS.iter().find(|(_, preset)| is_like(preset)).map(|(name, _)| *name)
}
