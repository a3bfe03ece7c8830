//! Scenes that are read page by page while the window goes on: what their pictures lack.

use super::pictures::Drawn;
use super::screen::Second;
use super::session::Session;
use crate::render::Residency;
use crate::viewer::model::Event;

impl Session {
    /// How far the pages of the pictures are there: of the one that lacks more.
    pub fn residency(&self) -> Option<Residency> {
        let second = self.pair.second.as_ref().and_then(Second::drawn);
        let both = self.pair.first.iter().chain(second).filter_map(Drawn::residency);
        both.max_by_key(|residency| (!residency.is_settled(), residency.missing))
    }

    /// The title of the window: the names of the scenes, the look, and what their picture lacks.
    pub fn title(&self) -> String {
        let names: Vec<&str> = self.viewer.layers.iter().map(|layer| layer.name.as_str()).collect();
        let lacks = match self.residency() {
            Some(Residency { missing, loading: 0, .. }) if missing > 0 => {
                format!(" ({missing} pages of levels do not fit into memory)")
            }
            Some(Residency { missing, .. }) if missing > 0 => format!(" ({missing} pages of levels are missing yet)"),
            _ => self.said_of_motion(),
        };
        // Where the panels are hidden, nothing else says what is shown.
        let look = match self.viewer.inspection.view_mode() {
            mode if mode.name == "colour" => String::new(),
            mode => format!(", {}", mode.title.to_lowercase()),
        };
        if names.is_empty() { "smalto".to_owned() } else { format!("{}{look}{lacks} - smalto", names.join(", ")) }
    }

    /// Reports that a shown picture begins to wait for pages, or waits no longer.
    pub(crate) fn report_residency(&mut self) {
        // What a picture lacked is known when it is drawn.
        if self.viewer.is_stale || self.screen.is_drawing() {
            return;
        }
        let residency = self.residency();
        let state = residency.map(|residency| (residency.is_settled(), residency.missing == 0));
        if state == std::mem::replace(&mut self.reported_pages, state) {
            return;
        }
        if let Some(residency) = residency {
            let Residency { missing, loading, resident, capacity, .. } = residency;
            let is_settled = residency.is_settled();
            self.viewer.events.emit(&Event::Residency {
                is_settled,
                missing,
                coming: loading,
                there: resident,
                fitting: capacity,
            });
        }
    }

    /// Looks for pages that were read since the last picture, or could not be read.
    pub(crate) fn poll_pages(&mut self) {
        for (_, drawn) in self.pair.drawn() {
            self.viewer.is_stale |= drawn.renderer.has_news();
            if let Some(problem) = drawn.renderer.take_problem() {
                self.viewer.messages.error(format!("{problem:#}; coarser levels are shown there"));
                self.viewer.failure.get_or_insert(problem);
            }
        }
    }
}
