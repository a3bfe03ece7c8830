//! The state of the panels and dialogs.

use super::dialog::Dialog;
use super::recent::{RecentState, Tab};

/// The state of the panels and dialogs.
pub struct Panels {
    pub are_hidden: bool,
    pub shows_help: bool,
    pub dialog: Dialog,
    /// The state that the next window starts with.
    pub recent: RecentState,
}

impl Panels {
    /// True if this page is visible.
    pub fn shows(&self, tab: Tab) -> bool {
        self.recent.tab == tab && !self.are_hidden
    }
}
