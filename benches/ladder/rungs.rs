//! The rungs of the ladder: variants of one frame that share all other code. The first does its bookkeeping on the CPU
//! and blends without workgroup memory, the last is the frame of the portable path.

/// The processor that runs a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Processor {
    Cpu,
    Gpu,
}

/// The method that makes instances from splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Duplication {
    Cpu,
    /// Count, scan, scatter; one invocation per splat.
    TwoPass,
    /// The same without the scan: an atomic counter gives every splat the place of its instances.
    SingleAllocation,
    /// As the portable path: count, scan, then one invocation per instance, independent of the splats' sizes.
    Balanced,
}

/// The keys that instances are sorted by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sort {
    /// All instances by 32 bits of depth, then by 32 bits of tile: the order of a 64-bit key.
    AllDigits,
    /// The visible splats (not the instances) by the depth bits that the scene needs, then the instances by the tile
    /// bits that the image needs.
    DigitsNeeded,
}

/// The method that blends a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Blend {
    /// Every pixel reads every splat from memory.
    FromMemory,
    /// Batches of this many splats in workgroup memory; stopped pixels are counted by atomics.
    Batches(u32),
    /// Batches of 256; stopped pixels are found by ballot.
    BallotExit,
    /// As the portable path: every subgroup owns a block of pixels (8x4 for 32 lanes) and walks the splats that reach
    /// it, the next batch is loaded ahead, and the tiles with the longest lists come first.
    PixelBlocks,
}

/// One variant of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rung {
    pub name: &'static str,
    /// The rung that this one is compared with; `None` for the first.
    pub from: Option<&'static str>,
    /// The stage that the step changes; "frame" if it changes several.
    pub stage: &'static str,
    pub compaction: Processor,
    pub duplication: Duplication,
    pub ranges: Processor,
    pub blend: Blend,
    /// Tiles are those that the ellipse of alpha = 1/255 touches, not the square of three standard deviations.
    pub exact_tiles: bool,
    pub sort: Sort,
}

/// The paper's baseline, from which all rungs start.
const BASELINE: Rung = Rung {
    name: "baseline",
    from: None,
    stage: "frame",
    compaction: Processor::Cpu,
    duplication: Duplication::Cpu,
    ranges: Processor::Cpu,
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
const RANGES: Rung = Rung {
    name: "+2 GPU ranges",
    from: Some(DUPLICATION.name),
    stage: "ranges",
    ranges: Processor::Gpu,
    ..DUPLICATION
};
const BATCHES: Rung =
    Rung { name: "+3 batches of 256", from: Some(RANGES.name), stage: "blend", blend: Blend::Batches(256), ..RANGES };
const COMPACTION: Rung =
    Rung { name: "+4 GPU compaction", from: Some(BATCHES.name), stage: "cull", compaction: Processor::Gpu, ..BATCHES };
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

/// All rungs, from the paper's baseline to the frame of the portable path.
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
