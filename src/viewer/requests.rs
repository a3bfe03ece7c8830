//! Requests of panels and keys that need the device.

use anyhow::Result;

use super::events::Event;
use super::pictures::{Drawn, Reusable, needs_whole};
use super::screen::{Arrangement, Pair, Screen};
use super::session::Session;
use super::state::{Request, WindowRequest};
use crate::render::{Attribute, Compare, Inspection, Quantity};

impl Session {
    /// Executes the requests that need the device; returns those for the owner of the window.
    pub(super) fn execute_requests(&mut self) -> Result<Vec<WindowRequest>> {
        let mut for_window = Vec::new();
        for request in std::mem::take(&mut self.viewer.requests) {
            match request {
                Request::Window(request) => for_window.push(request),
                Request::Pick(pixel) => self.pick(pixel)?,
                Request::Focus(pixel) => {
                    let Some(first) = &mut self.pair.first else { continue };
                    let depths = Inspection::of_attribute(Attribute::Depth);
                    if first.gaussians.is_none() && !first.renderer.can_show(&depths) {
                        self.viewer.messages.error(needs_whole("the depth of a pixel"));
                        continue;
                    }
                    let depth = first.renderer.depth_at(pixel)?;
                    self.viewer.focus(pixel, depth);
                }
                Request::WritePicture => self.write_picture()?,
                Request::WriteFilm => self.viewer.write_film(self.screen.device(), reusable(&self.pair)),
                Request::Measure | Request::Choose => {
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
        Ok(for_window)
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
        self.retire_frames(true)?;
        let size = self.viewer.size;
        let mut screen = Screen::offscreen(&device, size)?;
        screen.show(&mut self.pair, &Arrangement { compare, quantity, triangles: &[], pixels_per_point: 1.0 })?;
        let pixels = screen.read(&mut self.pair)?.expect("this screen is no window");
        self.viewer.write_screen(size, pixels);
        Ok(())
    }

    /// Explains a pixel of the first picture.
    fn pick(&mut self, pixel: [u32; 2]) -> Result<()> {
        let Some(first) = &mut self.pair.first else { return Ok(()) };
        if first.gaussians.is_none() {
            self.viewer.messages.error(needs_whole("a pixel's explanation"));
            return Ok(());
        }
        let explanation = first.renderer.explain(pixel)?;
        let colour = explanation.colour(self.viewer.background);
        let splats = explanation.splats.len();
        self.viewer.events.emit(&Event::Explained { pixel, splats, colour });
        self.viewer.explanation = Some((pixel, explanation));
        Ok(())
    }
}

/// The parts of the first picture that a job which writes files may take over.
fn reusable(pair: &Pair) -> Option<Reusable> {
    pair.first.as_ref().map(Drawn::reusable)
}
