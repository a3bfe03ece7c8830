//! The typed interfaces of `glsl/*/*.comp`, written by `build.rs`: one module per folder, and the structs that they
//! share.

use crate::gpu::{Binding, BindingKind, Bindings, Buffer, Constants, Element, Image, Resource, Scalar, Shader};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

impl Totals {
    /// Cells touched, over all splats.
    pub fn listed(&self) -> u64 {
        wide(self.listed_high, self.listed_low)
    }

    /// Alphas computed for pixels that had not stopped.
    pub fn evaluations(&self) -> u64 {
        wide(self.evaluations_high, self.evaluations_low)
    }

    /// Alphas computed in all lanes of their subgroups, stopped or not.
    pub fn walked(&self) -> u64 {
        wide(self.walked_high, self.walked_low)
    }

    /// The counts of two parts of a picture together.
    pub(super) fn plus(&self, other: &Self) -> Self {
        let [low, high] = [|sum: u64| sum as u32, |sum: u64| (sum >> 32) as u32];
        let listed = self.listed() + other.listed();
        let evaluations = self.evaluations() + other.evaluations();
        let walked = self.walked() + other.walked();
        Self {
            visible: self.visible.saturating_add(other.visible),
            visible_kept: self.visible_kept.saturating_add(other.visible_kept),
            spans: self.spans.saturating_add(other.spans),
            listed_low: low(listed),
            listed_high: high(listed),
            listed_kept: self.listed_kept.saturating_add(other.listed_kept),
            longest_list: self.longest_list.max(other.longest_list),
            evaluations_low: low(evaluations),
            evaluations_high: high(evaluations),
            walked_low: low(walked),
            walked_high: high(walked),
            stopped_pixels: self.stopped_pixels + other.stopped_pixels,
            listed_tiles: self.listed_tiles.max(other.listed_tiles),
            tiles_in_class: self.tiles_in_class,
        }
    }
}

fn wide(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}
