//! MAP

mod frame;
mod selection;
mod tables;
mod target;

#[cfg(test)]
pub(crate) mod fixtures;
#[cfg(test)]
mod frame_tests;
#[cfg(test)]
mod selection_tests;

pub(crate) use frame::{AtOnce, bring_missing};
pub(crate) use selection::{Asked, Chooser, Chosen, ChosenPage};
pub use target::Detailed;
pub(crate) use target::part;
