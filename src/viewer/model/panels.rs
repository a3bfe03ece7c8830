//! The state of the panels and dialogs.

use super::dialog::Dialog;
use super::recent::{RecentState, Tab};

/// The state of the panels and dialogs.
pub struct Panels {
    pub are_hidden: bool,
    /// A web page has them: nothing is laid out over the picture.
    pub are_elsewhere: bool,
    pub shows_help: bool,
    pub dialog: Dialog,
    /// The window has room for two pages beside each other.
    pub is_wide: bool,
    /// The state that the next window starts with.
    pub recent: RecentState,
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
