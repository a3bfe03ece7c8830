//! Actions that make the second picture of a comparison.

use std::path::Path;

use crate::pixels::Pixels;
use crate::viewer::comparison::Depicted;
use crate::viewer::jobs::JobEvent;
use crate::viewer::pictures::{Side, needs_whole};
use crate::viewer::state::Viewer;

impl Viewer {
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
