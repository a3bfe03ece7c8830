//! What the pictures of a window are to show: the plans of both, and what can be compared with them.

use anyhow::Result;

use super::comparison::{CompareTarget, Comparison, Depicted};
use super::state::Viewer;
use crate::options::Options;
use crate::rules::Rules;
use crate::viewer::frame::{Plan, Side};

impl Viewer {
    /// The options of a preset for the open scenes. Antialiasing is that of the scene, and so is the near plane where
    /// it must be nearer; how much of levels of detail is drawn is no part of a preset.
    pub fn preset(&self, preset: &Options) -> Options {
        let Options { lod_error, lod_psnr, splats, lod_fade, .. } = self.options;
        let nearest = self.nearest.unwrap_or(f32::INFINITY);
        let near = if self.setup.near_is_explicit { self.options.rules.near } else { preset.rules.near.min(nearest) };
        let rules = Rules { near, antialiased: self.options.rules.antialiased, ..preset.rules };
        Options { rules, lod_error, lod_psnr, splats, lod_fade, ..*preset }
    }

    /// What the first picture depicts; `None` if it shows nothing.
    pub fn depicted(&self) -> Option<Depicted> {
        let Plan { parts, options, .. } = self.plan(Side::First).ok().flatten()?;
        Some(Depicted { view: self.view(), parts, rules: options.untraded().rules, background: self.background })
    }

    /// What the reference was drawn of, if the picture shows something else now, so that it cannot be compared.
    pub fn reference_of_another(&self) -> Option<&'static str> {
        let Comparison { target: CompareTarget::Reference, drawn_of, .. } = &self.comparison else { return None };
        match (self.depicted(), drawn_of) {
            (Some(depicted), Some(drawn)) => drawn.difference(&depicted),
            _ => Some("other scenes or places"),
        }
    }

    /// The plan for a side; `None` if the GPU draws nothing for it.
    ///
    /// # Errors
    /// The placement of a scene is not a valid transform.
    pub fn plan(&self, side: Side) -> Result<Option<Plan>> {
        self.plan_of(side, false)
    }

    fn plan_of(&self, side: Side, is_tinted: bool) -> Result<Option<Plan>> {
        let options = match side {
            Side::First => self.options,
            Side::Second => match self.comparison.options(&self.options) {
                Some(options) => options,
                None => return Ok(None),
            },
        };
        let parts = self.layers.iter().filter_map(|layer| layer.part(side as usize, is_tinted).transpose());
        let parts = parts.collect::<Result<Vec<_>>>()?;
        Ok((!parts.is_empty()).then_some(Plan { parts, options, shaders: self.shaders }))
    }

    /// The fraction of their scale that pictures have while the view moves.
    pub fn motion_scale(&self) -> f32 {
        self.rate.as_ref().map_or(1.0, |rate| rate.scale)
    }

    /// The plan of what the window shows: that of [`Viewer::plan`], at a lower scale while the view moves, and
    /// with another colour of what is selected.
    ///
    /// # Errors
    /// Those of [`Viewer::plan`].
    pub fn shown_plan(&self, side: Side) -> Result<Option<Plan>> {
        // Pictures are compared as they are.
        let mut plan = self.plan_of(side, self.comparison.target == CompareTarget::Nothing)?;
        if let Some(plan) = plan.as_mut().filter(|plan| !plan.is_in_pages()) {
            plan.options.scale *= self.motion_scale();
        }
        Ok(plan)
    }

    /// True if the picture of this plan shows the scenes that are open now, whole.
    pub fn draws(&self, plan: &Plan) -> bool {
        self.shown_plan(Side::First).is_ok_and(|planned| planned.is_some_and(|planned| planned.has_scene_of(plan)))
    }

    /// The name of the first picture of a comparison.
    pub fn first_name(&self) -> String {
        let like = |preset: &Options| {
            let wanted = self.preset(preset);
            Options { rules: Rules { near: self.options.rules.near, ..wanted.rules }, ..wanted } == self.options
        };
        let known = Options::PRESETS.iter().find(|(_, preset)| like(preset));
        known.map_or_else(|| "these options".to_owned(), |(name, _)| (*name).to_owned())
    }

    /// The name of the second picture of a comparison.
    pub fn second_name(&self) -> String {
        match &self.comparison.target {
            CompareTarget::Nothing => String::new(),
            CompareTarget::Options(None) => "other scenes".to_owned(),
            CompareTarget::Options(Some(options)) => {
                let known = Options::PRESETS.iter().find(|(_, preset)| preset == options);
                known.map_or_else(|| "other options".to_owned(), |(name, _)| (*name).to_owned())
            }
            CompareTarget::Reference | CompareTarget::Picture => {
                let name = self.comparison.picture.as_ref().map_or("", |(name, _)| name);
                match self.comparison.of_camera {
                    Some(camera) if self.camera != Some(camera) => format!("{name}, of another view"),
                    _ => name.to_owned(),
                }
            }
        }
    }
}
