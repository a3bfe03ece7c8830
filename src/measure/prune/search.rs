//! The search for the most Gaussians that can be dropped within a limit.

use anyhow::Result;

use super::limit::{Change, Limit};
use super::order::Order;
use crate::camera::Camera;
use crate::pixels::Pixels;
use crate::render::Pruner;

/// A number of dropped Gaussians, and the change of the views.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Number of dropped Gaussians, the first of the order.
    pub dropped: usize,
    /// The measured change of each view.
    pub measured: Vec<Change>,
    /// A bound on the change of each view.
    pub bounds: Vec<Change>,
}

/// A step of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Views are drawn, and the cut is made smaller where one of them changes by too much.
    Search,
    /// The change of all views is measured.
    Check,
    /// The change of all views is bounded.
    Bound,
}

/// Searches for the largest cut that keeps every view within the limit. The change is measured: all views are drawn
/// with the whole and with the pruned scene. Gaussians without a share are dropped in any case, unless they are spared,
/// and one Gaussian is always kept. `progress` receives the step and the completed fraction of it.
///
/// The change of a view is not monotonic in the size of the cut, so the search may miss a larger one; the cut that it
/// returns was measured.
///
/// # Errors
/// If memory runs out or the device is lost.
pub fn search(
    pruner: &mut Pruner,
    views: &[Camera],
    order: &Order,
    limit: Limit,
    progress: &dyn Fn(Step, f64),
) -> Result<Cut> {
    let mut dropped = order.most();
    // Neighbouring views are alike: bit-reversed order spreads the first few over all views.
    let mut spread: Vec<usize> = (0..views.len()).collect();
    spread.sort_by_key(|view| view.reverse_bits());
    for (done, view) in spread.into_iter().enumerate() {
        progress(Step::Search, done as f64 / views.len() as f64);
        dropped = within(pruner, &views[view], order, limit, dropped)?.0;
    }
    let measured = 'again: loop {
        let mut measured = Vec::new();
        for (done, view) in views.iter().enumerate() {
            progress(Step::Check, done as f64 / views.len() as f64);
            let (allowed, change) = within(pruner, view, order, limit, dropped)?;
            if allowed < dropped {
                dropped = allowed;
                continue 'again;
            }
            measured.push(change);
        }
        break measured;
    };
    pruner.set_dropped(order.dropped(dropped))?;
    let mut bounds = Vec::new();
    for (done, view) in views.iter().enumerate() {
        progress(Step::Bound, done as f64 / views.len() as f64);
        let bound = pruner.bounds(view)?;
        bounds.push(Change { largest: bound.largest(), mean_square: bound.mean_square() });
    }
    Ok(Cut { dropped, measured, bounds })
}

/// The change of every view by a cut. `progress` receives the completed fraction.
///
/// # Errors
/// As [`search`].
pub fn compare(
    pruner: &mut Pruner,
    views: &[Camera],
    order: &Order,
    dropped: usize,
    progress: &dyn Fn(f64),
) -> Result<Vec<Change>> {
    pruner.set_dropped(order.dropped(dropped))?;
    let change = |(done, view): (usize, &Camera)| {
        progress(done as f64 / views.len() as f64);
        let whole = pruner.whole(view)?;
        Ok(Change::between(&whole, &pruner.pruned(view)?))
    };
    views.iter().enumerate().map(change).collect()
}

/// A cut of at most `dropped` Gaussians that keeps one view to the limit, and the change of the view by it. Dropping
/// only Gaussians without a share changes nothing, which is within every limit.
fn within(pruner: &mut Pruner, view: &Camera, order: &Order, limit: Limit, dropped: usize) -> Result<(usize, Change)> {
    let whole = pruner.whole(view)?;
    let mut change = |dropped: usize, whole: &Pixels| {
        pruner.set_dropped(order.dropped(dropped))?;
        anyhow::Ok(Change::between(whole, &pruner.pruned(view)?))
    };
    let first = change(dropped, &whole)?;
    if limit.allows(first) {
        return Ok((dropped, first));
    }
    let (mut low, mut high) = ((order.unseen().min(dropped), Change::default()), dropped);
    while high - low.0 > 1 {
        let middle = low.0 + (high - low.0) / 2;
        let found = change(middle, &whole)?;
        if limit.allows(found) {
            low = (middle, found);
        } else {
            high = middle;
        }
    }
    Ok(low)
}
