//! The knobs, one at a time.

use crate::options::{Options, Storage};
use crate::rules::{ALPHA_MIN, Footprint, Rules};
use crate::scene::Requirements;

/// What each knob may be turned to, from the most exact on; where nothing is lost by it, nothing is gained by the ones
/// before.
pub(super) const STOPS: [f32; 5] = [0.0, 1e-3, ALPHA_MIN, 1e-2, 1.0 / 32.0];
pub(super) const ALPHAS: [f32; 4] = [ALPHA_MIN, 1.0 / 192.0, 1.0 / 128.0, 1.0 / 64.0];
pub(super) const KEY_BITS: [u32; 3] = [32, 24, 16];
pub(super) const STORAGES: [Storage; 3] = [Storage::Lossless, Storage::F16, Storage::U8];
pub(super) const SCALES: [f32; 3] = [1.0, 0.75, 0.5];

/// Every knob of `base`, which is exact, turned alone: what it is called, and the options.
pub fn knobs(base: &Options, needs: &Requirements) -> Vec<(String, Options)> {
    let rules = base.rules;
    let mut all = Vec::new();
    let mut add = |name: String, options: Options| all.push((name, options));
    for stop in &STOPS[1..] {
        add(format!("stop {}", fraction(*stop)), Options { stop: *stop, ..*base });
    }
    for alpha_min in &ALPHAS[1..] {
        let rules = Rules { alpha_min: *alpha_min, ..rules };
        add(format!("alpha-min {}", fraction(*alpha_min)), Options { rules, ..*base });
    }
    for (name, extent) in [("three-sigma", Footprint::ThreeSigma), ("three-sigma-squares", Footprint::ThreeSigmaSquares)] {
        add(format!("extent {name}"), Options { rules: Rules { extent, ..rules }, ..*base });
    }
    for key_bits in &KEY_BITS[1..] {
        add(format!("key-bits {key_bits}"), Options { key_bits: *key_bits, ..*base });
    }
    for sh_degree in (0..needs.sh_degree).rev() {
        add(format!("sh-degree {sh_degree}"), Options { sh_degree, ..*base });
    }
    for (name, storage) in [("f32", Storage::F32), ("f16", Storage::F16), ("u8", Storage::U8)] {
        // Where the file held bytes, 16-bit floats are never needed.
        if needs.sh_grids.is_none() || storage == Storage::F32 {
            add(format!("sh-storage {name}"), Options { sh_storage: storage, ..*base });
        }
        if needs.scale_grid.is_none() || storage == Storage::F32 {
            add(format!("shape-storage {name}"), Options { shape_storage: storage, ..*base });
        }
    }
    for scale in &SCALES[1..] {
        add(format!("scale {scale}"), Options { scale: *scale, ..*base });
    }
    let antialiased = !rules.antialiased;
    add(format!("antialiased {antialiased}"), Options { rules: Rules { antialiased, ..rules }, ..*base });
    add("near 0.01".to_owned(), Options { rules: Rules { near: rules.near.min(0.01), ..rules }, ..*base });
    add("portable".to_owned(), Options { portable: true, ..*base });
    all
}

/// As one writes it: 1/255, or 0.001.
fn fraction(value: f32) -> String {
    let inverse = 1.0 / f64::from(value);
    if inverse < 1000.0 && (inverse - inverse.round()).abs() < 1e-3 && inverse.round() != 100.0 {
        return format!("1/{}", inverse.round());
    }
    value.to_string()
}
