//! Execution of the requests that need the device.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use egui::ColorImage;

use super::screen::{Arrangement, Screen};
use super::session::Session;
use crate::gpu::DeviceLost;
use crate::host_memory::OutOfMemory;
use crate::render::{Attribute, Compare, Explanation, Inspection, Quantity};
use crate::viewer::model::{
    Depths, Drawn, Event, ExplainedPixel, Pair, Request, Reusable, Second, Side, WindowRequest, needs_whole,
};

impl Session {
    /// Executes the requests that need the device; returns those for the owner of the window.
    pub(crate) fn execute_requests(&mut self) -> Result<Vec<WindowRequest>> {
        let mut for_window = Vec::new();
        let mut later = Vec::new();
        // One at a time: a mark adds a request to copy its position.
        while !self.viewer.requests.is_empty() {
            match self.viewer.requests.remove(0) {
                // Edits are made in their order.
                request if request.is_edit() && (self.viewer.has_running_edits() || !later.is_empty()) => {
                    later.push(request);
                }
                Request::Window(request) => for_window.push(request),
                Request::Pick(pixel) => self.pick(pixel)?,
                Request::Focus(pixel) => {
                    let Some(depth) = self.depth_at(pixel)? else { continue };
                    self.viewer.focus(pixel, depth);
                }
                Request::Mark(pixel) => {
                    let Some(depth) = self.depth_at(pixel)? else { continue };
                    self.viewer.mark(pixel, depth);
                }
                Request::Select(selecting) => later.extend(self.select(selecting)?.map(Request::Select)),
                Request::SelectBall { pixel, radius_px, mode, goes_on } => {
                    let Some(depth) = self.depth_at(pixel)? else { continue };
                    self.viewer.select_ball((pixel, depth), radius_px, mode, goes_on);
                }
                Request::SelectColour(pixel, mode) => self.select_colour(pixel, mode)?,
                Request::Act(action) => self.viewer.act_now(action, None),
                Request::Escape => self.viewer.escape_now(),
                Request::BeginStroke => self.viewer.note_edits(),
                Request::FitRange => self.viewer.fit_range(),
                Request::WritePicture(file) => self.write_picture(file)?,
                Request::CopyPicture => {
                    if let Some(pixels) = self.shown_pixels()? {
                        self.viewer.messages.note("the picture is copied");
                        let size = self.viewer.view.size.map(|side| side as usize);
                        let image = ColorImage::from_rgba_unmultiplied(size, bytemuck::cast_slice(&pixels));
                        for_window.push(WindowRequest::CopyPicture(image));
                    }
                }
                Request::WriteFilm(file) => {
                    self.viewer.write_film(self.screen.device(), reusable(&self.pair), file);
                }
                Request::Evaluate => self.viewer.start_evaluation(self.screen.device().clone(), reusable(&self.pair)),
                request @ (Request::Measure | Request::Choose) => {
                    let Some(first) = &self.pair.first else { continue };
                    let Some(scene) = first.measured() else {
                        self.viewer.messages.error(needs_whole("this measurement"));
                        continue;
                    };
                    let device = self.screen.device().clone();
                    match request {
                        Request::Measure => self.viewer.start_measuring(device, scene),
                        _ => self.viewer.start_choosing(device, scene),
                    }
                }
            }
        }
        self.viewer.requests = later;
        Ok(for_window)
    }

    /// The depth of the picture at a pixel: `Some(None)` where nothing is drawn. `None`, with a message, if the picture
    /// has no depths.
    fn depth_at(&mut self, pixel: [u32; 2]) -> Result<Option<Option<f32>>> {
        let Some((_, drawn)) = self.drawn_at(pixel) else { return Ok(None) };
        if drawn.gaussians.is_none() && !drawn.renderer.can_show(&Inspection::of_attribute(Attribute::Depth)) {
            self.viewer.messages.error(needs_whole("the depth of a pixel"));
            return Ok(None);
        }
        let depth = drawn.renderer.depth_at(pixel);
        self.or_message(depth)
    }

    /// The splats of a pixel of the first picture; `None`, with a message, if they cannot be listed.
    pub(super) fn explained(&mut self, pixel: [u32; 2]) -> Result<Option<Explanation>> {
        let Some((side, drawn)) = self.drawn_at(pixel) else { return Ok(None) };
        if side == Side::Second {
            self.viewer.messages.note("only the first picture is edited");
            return Ok(None);
        }
        if drawn.gaussians.is_none() {
            self.viewer.messages.error(needs_whole("a pixel's explanation"));
            return Ok(None);
        }
        let explanation = drawn.renderer.explain(pixel);
        self.or_message(explanation)
    }

    /// What was found at a pixel; a message in the place of an error that the picture outlives.
    fn or_message<T>(&mut self, found: Result<T>) -> Result<Option<T>> {
        match found {
            Err(problem) if !problem.is::<DeviceLost>() && !problem.is::<OutOfMemory>() => {
                self.viewer.messages.error(format!("{problem:#}"));
                Ok(None)
            }
            found => found.map(Some),
        }
    }

    /// Reads the pictures back if they are at rest and their values are needed, and compares them.
    pub(crate) fn take_snapshot(&mut self) -> Result<()> {
        let has_full_scale = self.has_full_scale();
        let viewer = &mut self.viewer;
        let is_at_rest = !viewer.pictures.are_stale
            && !viewer.is_moving()
            && !viewer.pictures.is_any_building()
            && !self.screen.is_drawing();
        if !is_at_rest || !has_full_scale {
            return Ok(());
        }
        if viewer.needs_depths()
            && self.pair.first.as_ref().and_then(Drawn::residency).is_none_or(|pages| pages.is_settled())
            && viewer.inspector.depths.is_none()
            && let Some(first) = &mut self.pair.first
        {
            let pixels = match first.renderer.depths() {
                Err(problem) if problem.is::<DeviceLost>() || problem.is::<OutOfMemory>() => return Err(problem),
                // A picture without depths hides nothing.
                found => found.unwrap_or_default(),
            };
            viewer.inspector.depths = Some(Arc::new(Depths { view: viewer.drawn_view(), pixels }));
            self.request_layout();
        }
        let viewer = &mut self.viewer;
        if !viewer.needs_snapshot() {
            return Ok(());
        }
        let is_of_first = viewer.mismatch(&self.pair).is_none();
        let covered = viewer.covered(&self.pair);
        let Some(first) = &mut self.pair.first else { return Ok(()) };
        if viewer.inspector.snapshot.is_none() {
            let second = match self.pair.second.as_ref().filter(|_| is_of_first) {
                Some(Second::Drawn(drawn)) => Some(Arc::new(drawn.renderer.pixels()?)),
                Some(Second::Image(_)) => viewer.comparison.fitted.clone(),
                None => None,
            };
            let first = Arc::new(first.pixels(viewer.pictures.view.as_ref(), viewer.view.background)?);
            viewer.inspector.set_snapshot(first, second, covered);
        }
        viewer.compare_snapshot();
        Ok(())
    }

    /// Writes the picture: as `smalto render` does if the window shows plain colours, otherwise as the window shows it,
    /// without panels.
    fn write_picture(&mut self, file: Option<PathBuf>) -> Result<()> {
        if self.pair.first.is_none() {
            self.viewer.write_nothing("there is nothing to write yet");
            return Ok(());
        }
        let device = self.screen.device().clone();
        let shown = self.arrangement();
        let (compare, quantity) = (shown.compare, shown.quantity);
        let is_plain = compare == Compare::First && quantity == Quantity::Colour;
        if is_plain && self.viewer.inspector.settings.inspection() == Inspection::default() {
            self.viewer.write_picture(&device, reusable(&self.pair), file);
            return Ok(());
        }
        if let Some(pixels) = self.shown_pixels()? {
            self.viewer.write_screen(self.viewer.view.size, pixels, file);
        }
        Ok(())
    }

    /// The picture as the window shows it, without panels: red, green, blue and alpha, row by row. `None`, with a
    /// message, without a picture at full scale.
    fn shown_pixels(&mut self) -> Result<Option<Vec<[u8; 4]>>> {
        if self.pair.first.is_none() || !self.has_full_scale() {
            self.viewer.messages.error(if self.pair.first.is_none() { "there is no picture yet" } else { IN_MOTION });
            return Ok(None);
        }
        self.retire_frames(true)?;
        let shown = self.arrangement();
        let (compare, quantity) = (shown.compare, shown.quantity);
        let mut screen = Screen::offscreen(&self.screen.device().clone(), self.viewer.view.size)?;
        screen.show(&mut self.pair, &Arrangement { compare, quantity, triangles: &[], pixels_per_point: 1.0 })?;
        screen.read(&mut self.pair)
    }

    /// The picture shown at a pixel; `None`, with a message, if the GPU has not drawn it.
    fn drawn_at(&mut self, pixel: [u32; 2]) -> Option<(Side, &mut Drawn)> {
        if !self.has_full_scale() {
            self.viewer.messages.note(IN_MOTION);
            return None;
        }
        let side = match self.arrangement().compare {
            Compare::Second => Side::Second,
            Compare::Split(x) if pixel[0] as f32 + 0.5 > x => Side::Second,
            _ => Side::First,
        };
        let drawn = match (side, &mut self.pair) {
            (Side::First, pair) => pair.first.as_mut(),
            (Side::Second, Pair { second: Some(Second::Drawn(drawn)), .. }) => Some(&mut **drawn),
            (Side::Second, _) => {
                self.viewer.messages.note("the picture at this pixel has no Gaussians: it was not drawn by the GPU");
                None
            }
        };
        drawn.map(|drawn| (side, drawn))
    }

    /// Explains a pixel of the picture shown there.
    fn pick(&mut self, pixel: [u32; 2]) -> Result<()> {
        let Some((side, drawn)) = self.drawn_at(pixel) else { return Ok(()) };
        if drawn.gaussians.is_none() {
            self.viewer.messages.error(needs_whole("a pixel's explanation"));
            return Ok(());
        }
        let explanation = drawn.renderer.explain(pixel);
        let Some(explanation) = self.or_message(explanation)? else { return Ok(()) };
        let colour = explanation.colour(self.viewer.view.background);
        let splats = explanation.splats.len();
        self.viewer.events.emit(&Event::Explained { pixel, splats, colour });
        let view = self.viewer.drawn_view();
        self.viewer.inspector.explanation = Some(ExplainedPixel { pixel, side, view, explanation });
        Ok(())
    }
}

/// The message that a picture of a lower scale has no values for requests.
const IN_MOTION: &str = "the view moves, and its picture has a lower scale: ask again when it rests";

/// The parts of the first picture that another build may reuse.
fn reusable(pair: &Pair) -> Option<Reusable> {
    pair.first.as_ref().map(Drawn::reusable)
}
