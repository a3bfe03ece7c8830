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
}

fn wide(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}
