//! The ladder of optimizations that this renderer started from, rung by rung, with all other code shared: from a frame
//! that keeps its books on the CPU and blends without workgroup memory to the frame that `render` draws.
//!
//! A rung differs from the one it is measured against in one step. [`climb`] measures all of them on one scene, and
//! fails if two that must agree count or draw differently.

mod climb;
mod report;
mod steps;
mod twins;
mod variant;

pub use climb::climb;
pub use report::{Climb, LadderReport, Paper, RungReport, RungStage, plot};
pub use variant::{Variant, VariantFrame};

/// Where a stage runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    Cpu,
    Gpu,
}

/// How instances are made from splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Duplication {
    Cpu,
    /// Count, scan, scatter: an invocation for every splat.
    TwoPass,
    /// The same without a scan: a splat takes the place of its instances from a counter.
    SingleAllocation,
    /// As `render` duplicates: count, scan, then an invocation for every instance, whatever the splats' sizes.
    Balanced,
}

/// By which keys instances are sorted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sort {
    /// Every instance by 32 bits of depth, then by 32 bits of tile: what a 64-bit key is.
    AllDigits,
    /// The visible splats, not the instances, by the depth bits that the scene has; then the instances by the tile bits
    /// that the image has.
    DigitsNeeded,
}

/// How a tile is blended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Blend {
    /// Every pixel reads every splat from memory.
    FromMemory,
    /// Batches of this many splats in workgroup memory; lanes count those that stopped.
    Batches(u32),
    /// Batches of 256; subgroups that stopped are found by ballot.
    BallotExit,
    /// As `render` blends: subgroups hold blocks of 8x4 pixels or so and walk the splats that reach them, batches are
    /// loaded ahead, and the longest lists come first.
    PixelBlocks,
}

/// One variant of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rung {
    pub name: &'static str,
    /// The rung whose difference to this one is its step; `None` for the first.
    pub from: Option<&'static str>,
    /// The stage that the change is about; "frame" if it is about several.
    pub stage: &'static str,
    pub compaction: Place,
    pub duplication: Duplication,
    pub ranges: Place,
    pub blend: Blend,
    /// Tiles by the ellipse of alpha = 1/255, not by the square of three standard deviations.
    pub exact_tiles: bool,
    pub sort: Sort,
}

/// What every rung starts from: the paper's baseline.
const BASELINE: Rung = Rung {
    name: "baseline",
    from: None,
    stage: "frame",
    compaction: Place::Cpu,
    duplication: Duplication::Cpu,
    ranges: Place::Cpu,
    blend: Blend::FromMemory,
    exact_tiles: false,
    sort: Sort::AllDigits,
};

const DUPLICATION: Rung = Rung {
    name: "+1 GPU duplication",
    from: Some(BASELINE.name),
    stage: "duplicate",
    duplication: Duplication::TwoPass,
    ..BASELINE
};
const SINGLE_PASS: Rung =
    Rung { name: "+1 in a single pass", duplication: Duplication::SingleAllocation, ..DUPLICATION };
const RANGES: Rung =
    Rung { name: "+2 GPU ranges", from: Some(DUPLICATION.name), stage: "ranges", ranges: Place::Gpu, ..DUPLICATION };
const BATCHES: Rung =
    Rung { name: "+3 batches of 256", from: Some(RANGES.name), stage: "blend", blend: Blend::Batches(256), ..RANGES };
const COMPACTION: Rung =
    Rung { name: "+4 GPU compaction", from: Some(BATCHES.name), stage: "cull", compaction: Place::Gpu, ..BATCHES };
const BALLOT_EXIT: Rung = Rung {
    name: "+5 ballot exit",
    from: Some(COMPACTION.name),
    stage: "blend",
    blend: Blend::BallotExit,
    ..COMPACTION
};
const EXACT_TILES: Rung =
    Rung { name: "+6 exact tiles", from: Some(BALLOT_EXIT.name), stage: "frame", exact_tiles: true, ..BALLOT_EXIT };
const DIGITS: Rung = Rung {
    name: "+7 digits needed",
    from: Some(EXACT_TILES.name),
    stage: "sort",
    sort: Sort::DigitsNeeded,
    ..EXACT_TILES
};
const BALANCED: Rung = Rung {
    name: "+8 by instance",
    from: Some(DIGITS.name),
    stage: "duplicate",
    duplication: Duplication::Balanced,
    ..DIGITS
};
const PIXEL_BLOCKS: Rung =
    Rung { name: "+9 pixel blocks", from: Some(BALANCED.name), stage: "blend", blend: Blend::PixelBlocks, ..BALANCED };

/// Every rung, from the paper's baseline to the frame that `render` draws.
pub const RUNGS: [Rung; 14] = [
    BASELINE,
    DUPLICATION,
    SINGLE_PASS,
    RANGES,
    Rung { name: "+3 batches of 32", blend: Blend::Batches(32), ..BATCHES },
    Rung { name: "+3 batches of 64", blend: Blend::Batches(64), ..BATCHES },
    Rung { name: "+3 batches of 128", blend: Blend::Batches(128), ..BATCHES },
    BATCHES,
    COMPACTION,
    BALLOT_EXIT,
    EXACT_TILES,
    DIGITS,
    BALANCED,
    PIXEL_BLOCKS,
];
