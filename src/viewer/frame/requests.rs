//! Requests of panels and keys that need the device.

use std::sync::Arc;

use anyhow::Result;
use egui::ColorImage;

use super::pictures::{Drawn, Reusable, Side, needs_whole};
use super::screen::{Arrangement, Pair, Screen, Second};
use super::session::Session;
use crate::render::{Attribute, Compare, Inspection, Quantity};
use crate::viewer::model::{Event, ExplainedPixel, Request, Still, WindowRequest};

impl Session {
    /// Executes the requests that need the device; returns those for the owner of the window.
    pub(crate) fn execute_requests(&mut self) -> Result<Vec<WindowRequest>> {
        let mut for_window = Vec::new();
        let mut later = Vec::new();
        // One at a time, since a mark asks for its place to be copied.
        while !self.viewer.requests.is_empty() {
            match self.viewer.requests.remove(0) {
                // What is written and measured is what the edit leaves.
                request if self.viewer.is_editing() && !matches!(request, Request::Window(_)) => later.push(request),
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
                Request::SelectBall { pixel, radius_px, how } => {
                    let Some(depth) = self.depth_at(pixel)? else { continue };
                    self.viewer.select_ball(pixel, radius_px, depth, how);
                }
                Request::SelectByShares(selection, how, only_seen) => {
                    self.viewer.start_selection(selection, how, only_seen, self.screen.device().clone());
                }
                Request::FitRange => self.viewer.fit_range(),
                Request::WritePicture => self.write_picture()?,
                Request::CopyPicture => {
                    if let Some(pixels) = self.seen()? {
                        self.viewer.messages.note("the picture is copied");
                        let size = self.viewer.size.map(|side| side as usize);
                        let image = ColorImage::from_rgba_unmultiplied(size, bytemuck::cast_slice(&pixels));
                        for_window.push(WindowRequest::CopyPicture(image));
                    }
                }
                Request::WriteFilm => self.viewer.write_film(self.screen.device(), reusable(&self.pair)),
                Request::Evaluate => self.viewer.start_evaluation(self.screen.device().clone(), reusable(&self.pair)),
                request @ (Request::Measure | Request::Choose) => {
                    let Some(first) = &self.pair.first else { continue };
                    let Some(gaussians) = first.gaussians.clone() else {
                        self.viewer.messages.error(needs_whole("this measurement"));
                        continue;
                    };
                    let (device, scene) = (self.screen.device().clone(), (gaussians, first.statistics.clone()));
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

    /// The depth of the picture at a pixel of the window, if there is something; none if it cannot be asked for, which
    /// is said.
    fn depth_at(&mut self, pixel: [u32; 2]) -> Result<Option<Option<f32>>> {
        let Some((_, drawn)) = self.drawn_at(pixel) else { return Ok(None) };
        if drawn.gaussians.is_none() && !drawn.renderer.can_show(&Inspection::of_attribute(Attribute::Depth)) {
            self.viewer.messages.error(needs_whole("the depth of a pixel"));
            return Ok(None);
        }
        drawn.renderer.depth_at(pixel).map(Some)
    }

    /// Reads the pictures back if they stand still and somebody asks for their values, and compares them.
    pub(crate) fn take_still(&mut self) -> Result<()> {
        let has_full_scale = self.has_full_scale();
        let viewer = &mut self.viewer;
        let stands = !viewer.is_stale && !viewer.moves() && viewer.building == [false; 2] && !self.screen.is_drawing();
        if !stands || !has_full_scale || !viewer.wants_still() {
            return Ok(());
        }
        let Some(first) = &self.pair.first else { return Ok(()) };
        if viewer.still.is_none() {
            viewer.stills += 1;
            let second = match &self.pair.second {
                Some(Second::Drawn(drawn)) => Some(Arc::new(drawn.renderer.pixels()?)),
                Some(Second::Image(_)) => viewer.comparison.fitted.clone(),
                None => None,
            };
            let first = Arc::new(first.renderer.pixels()?);
            viewer.still = Some(Still { number: viewer.stills, first, second });
        }
        viewer.compare_stills();
        Ok(())
    }

    /// Writes the picture: as `smalto render` does if the window shows its colours alone, otherwise what the window
    /// shows, without panels.
    fn write_picture(&mut self) -> Result<()> {
        if self.pair.first.is_none() {
            self.viewer.messages.note("there is nothing to write yet");
            return Ok(());
        }
        let device = self.screen.device().clone();
        let shown = self.arrangement();
        let (compare, quantity) = (shown.compare, shown.quantity);
        let is_plain = compare == Compare::First && quantity == Quantity::Colour;
        if is_plain && self.viewer.inspection.inspection() == Inspection::default() {
            self.viewer.write_picture(&device, reusable(&self.pair));
            return Ok(());
        }
        if let Some(pixels) = self.seen()? {
            self.viewer.write_screen(self.viewer.size, pixels);
        }
        Ok(())
    }

    /// What the window shows without its panels: red, green, blue and alpha row by row. None, with a message, if that
    /// is not the picture as it is at rest.
    fn seen(&mut self) -> Result<Option<Vec<[u8; 4]>>> {
        if self.pair.first.is_none() || !self.has_full_scale() {
            self.viewer.messages.error(if self.pair.first.is_none() { "there is no picture yet" } else { MOVES });
            return Ok(None);
        }
        self.retire_frames(true)?;
        let shown = self.arrangement();
        let (compare, quantity) = (shown.compare, shown.quantity);
        let mut screen = Screen::offscreen(&self.screen.device().clone(), self.viewer.size)?;
        screen.show(&mut self.pair, &Arrangement { compare, quantity, triangles: &[], pixels_per_point: 1.0 })?;
        screen.read(&mut self.pair)
    }

    /// The picture that is seen at a pixel; `None`, with a message, where the GPU has drawn none.
    fn drawn_at(&mut self, pixel: [u32; 2]) -> Option<(Side, &mut Drawn)> {
        if !self.has_full_scale() {
            self.viewer.messages.note(MOVES);
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

    /// Explains a pixel of the picture that is seen there.
    fn pick(&mut self, pixel: [u32; 2]) -> Result<()> {
        let Some((side, drawn)) = self.drawn_at(pixel) else { return Ok(()) };
        if drawn.gaussians.is_none() {
            self.viewer.messages.error(needs_whole("a pixel's explanation"));
            return Ok(());
        }
        let explanation = drawn.renderer.explain(pixel)?;
        let colour = explanation.colour(self.viewer.background);
        let splats = explanation.splats.len();
        self.viewer.events.emit(&Event::Explained { pixel, splats, colour });
        let view = self.viewer.view();
        self.viewer.explanation = Some(ExplainedPixel { pixel, side, view, explanation });
        Ok(())
    }
}

/// Why a picture of a lower scale answers no questions.
const MOVES: &str = "the view moves, and its picture has a lower scale: ask again when it rests";

/// The parts of the first picture that a job which writes files may take over.
fn reusable(pair: &Pair) -> Option<Reusable> {
    pair.first.as_ref().map(Drawn::reusable)
}
