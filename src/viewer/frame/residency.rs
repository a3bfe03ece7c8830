//! Residency of the pages of paged scenes: the title, events, and polling.

use super::session::Session;
use crate::render::Residency;
use crate::viewer::model::{Drawn, Event, Second};

impl Session {
    /// Residency of the picture that has more missing pages.
    pub fn residency(&self) -> Option<Residency> {
        let second = self.pair.second.as_ref().and_then(Second::drawn);
        let both = self.pair.first.iter().chain(second).filter_map(Drawn::residency);
        both.max_by_key(|residency| (!residency.is_settled(), residency.missing))
    }

    /// The title of the window: the names of the scenes, the view mode, and missing pages or the PSNR of levels.
    pub fn title(&self) -> String {
        let names: Vec<&str> = self.viewer.scenes.layers.iter().map(|layer| layer.name.as_str()).collect();
        let missing_pages = match self.residency() {
            Some(Residency { missing, loading: 0, .. }) if missing > 0 => {
                format!(" ({missing} pages of levels do not fit into memory)")
            }
            Some(Residency { missing, .. }) if missing > 0 => format!(" ({missing} pages of levels are missing yet)"),
            _ => match self.level_psnr() {
                Some(psnr) => format!(" ({psnr} to all Gaussians)"),
                None => self.motion_title(),
            },
        };
        // With hidden panels, nothing else shows the view mode.
        let look = match self.viewer.inspector.settings.view_mode() {
            mode if mode.name == "colour" => String::new(),
            mode => format!(", {}", mode.title.to_lowercase()),
        };
        if names.is_empty() {
            "smalto".to_owned()
        } else {
            format!("{}{look}{missing_pages} - smalto", names.join(", "))
        }
    }

    /// The PSNR of the levels of the first picture as text, if it is known.
    pub(crate) fn level_psnr(&self) -> Option<String> {
        let (camera, background) = (self.viewer.pictures.view.as_ref(), self.viewer.view.background);
        self.pair.first.as_ref()?.level_psnr(camera, background)
    }

    /// Reports that a shown picture began or ceased to wait for pages.
    pub(crate) fn report_residency(&mut self) {
        // The missing pages are known once the picture is drawn.
        if self.viewer.pictures.are_stale || self.screen.is_drawing() {
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

    /// Polls for pages that were loaded since the last picture, or could not be read.
    pub(crate) fn poll_pages(&mut self) {
        for (_, drawn) in self.pair.drawn() {
            self.viewer.pictures.are_stale |= drawn.renderer.has_news();
            if let Some(problem) = drawn.renderer.take_problem() {
                self.viewer.messages.error(format!("{problem:#}; coarser levels are shown there"));
                self.viewer.messages.failure.get_or_insert(problem);
            }
        }
    }
}
