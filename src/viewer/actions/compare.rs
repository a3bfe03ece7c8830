//! Actions that make the second picture of a comparison.

use std::path::Path;

use glam::DVec2;

use crate::pixels::Pixels;
use crate::render::Quantity;
use crate::viewer::comparison::{CompareTarget, Depicted};
use crate::viewer::drag::Drag;
use crate::viewer::jobs::JobEvent;
use crate::viewer::kept::Tab;
use crate::viewer::pictures::{Side, needs_whole};
use crate::viewer::state::{Request, Viewer, WindowRequest};
use crate::viewer::still::fitted_range;

impl Viewer {
    /// True if somebody asks for the values of pixels.
    pub fn wants_still(&self) -> bool {
        let inside = self.kept.tab == Tab::Inside && !self.panels.are_hidden;
        self.comparison.target != CompareTarget::Nothing || self.inspection.quantity() != Quantity::Colour || inside
    }

    /// True while the view moves by itself or by the user.
    pub fn moves(&self) -> bool {
        self.is_flying || self.navigator.is_gliding() || self.film.is_playing || self.drag.is_some_and(Drag::moves_view)
    }

    /// Compares the two pictures that were read back, on another thread, if they were not compared yet.
    pub fn compare_stills(&mut self) {
        let comparison = &mut self.comparison;
        let area = comparison.area;
        let Some(still) = &self.still else { return };
        let is_known =
            comparison.apart.as_ref().is_some_and(|apart| (apart.number, apart.area) == (still.number, area));
        if comparison.is_measuring || is_known || comparison.target == CompareTarget::Nothing {
            return;
        }
        if let Some(work) = still.apart(area) {
            comparison.is_measuring = true;
            self.jobs.start(move |_| Ok(work()), JobEvent::Compared);
        }
    }

    /// Fits the ends of the scale to the values of the first picture.
    pub fn fit_range(&mut self) {
        let quantity = self.inspection.quantity();
        match self.still.as_ref().and_then(|still| fitted_range(&still.first, quantity)) {
            Some(range) => self.inspection.ranges[self.inspection.mode] = range,
            None => self.messages.note("there are no values to fit the scale to yet"),
        }
    }

    /// Marks the point that a pixel shows, copies its place, and says how far it is from the mark before; `depth` is
    /// its view z in world units.
    pub fn mark(&mut self, pixel: [u32; 2], depth: Option<f32>) {
        let Some(depth) = depth else { return self.messages.note("there is nothing at this pixel") };
        let point = self.view().unprojected(DVec2::from(pixel.map(f64::from)) + 0.5, f64::from(depth));
        if self.marks.len() == 2 {
            self.marks.remove(0);
        }
        self.marks.push(point);
        let place = format!("{:.6}, {:.6}, {:.6}", point.x, point.y, point.z);
        let distance = match self.marks[..] {
            [before, now] => format!("; {:.6} world units from the mark before", before.distance(now)),
            _ => String::new(),
        };
        self.messages.note(format!("marked and copied: {place}{distance}"));
        self.requests.push(Request::Window(WindowRequest::Copy(place)));
    }

    /// Reads a photograph or another picture to compare with, on another thread.
    pub fn compare_with_picture(&mut self, path: &Path) {
        let path = path.to_owned();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.comparison.is_drawing = true;
        self.comparison.drawn_of = None;
        self.jobs.start(move |_| Pixels::read(&path), move |pixels| JobEvent::Picture(name, pixels));
    }

    /// Draws the view with the float64 reference to compare with, on another thread.
    pub fn compare_with_reference(&mut self) {
        let Ok(Some(plan)) = self.plan(Side::First) else { return };
        if plan.is_in_pages() {
            return self.messages.error(needs_whole("the reference"));
        }
        self.comparison.is_drawing = true;
        self.comparison.drawn_of = self.depicted();
        let Some(Depicted { view, rules, background, .. }) = self.comparison.drawn_of.clone() else { return };
        self.jobs.start(
            move |_| {
                let scene = plan.joined()?;
                Ok(crate::reference::render(&scene, &view, &rules, background).to_pixels())
            },
            |pixels| JobEvent::Picture("float64 reference".to_owned(), pixels),
        );
    }
}
