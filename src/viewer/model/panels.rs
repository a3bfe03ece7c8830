//! The state of the panels and dialogs.

use std::time::{Duration, Instant};

use egui::Rect;
use egui::epaint::ClippedShape;

use super::dialog::Dialog;
use super::recent::{RecentState, Tab};

/// The state of the panels and dialogs.
pub struct Panels {
    pub are_hidden: bool,
    pub shows_help: bool,
    pub dialog: Dialog,
    /// The window has room for two pages beside each other.
    pub is_wide: bool,
    /// The panels of the last whole layout.
    pub kept: Option<KeptPanels>,
    /// The next layout paints the kept panels in place of laying them out.
    pub keeps: bool,
    /// The state that the next window starts with.
    pub recent: RecentState,
}

/// Panels that were laid out.
pub struct KeptPanels {
    pub at: Instant,
    /// The window, and what the panels leave of it, in points.
    pub window: Rect,
    pub free: Rect,
    pub shapes: Vec<ClippedShape>,
}

/// Time for which panels are kept: numbers in them are never older.
pub const KEPT: Duration = Duration::from_millis(100);

/// Distance from the panels in points in which they may answer the pointer.
const EDGE: f32 = 10.0;

impl KeptPanels {
    /// True if panels need no layout for these events: the pointer moves over the picture.
    pub fn suit(&self, events: &[egui::Event]) -> bool {
        let inside = self.free.shrink(EDGE);
        let is_over_picture = |event: &egui::Event| match event {
            egui::Event::PointerMoved(pos) => inside.contains(*pos),
            egui::Event::MouseMoved(_) => true,
            _ => false,
        };
        self.at.elapsed() < KEPT && events.iter().all(is_over_picture)
    }
}

impl Panels {
    /// True if this page is visible.
    pub fn shows(&self, tab: Tab) -> bool {
        !self.are_hidden && (self.recent.tab == tab || self.beside() == Some(tab))
    }

    /// The page beside the others, if it is visible.
    pub fn beside(&self) -> Option<Tab> {
        self.recent.beside.filter(|tab| self.is_wide && !self.are_hidden && *tab != self.recent.tab)
    }
}
