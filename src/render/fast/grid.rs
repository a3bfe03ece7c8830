//! A picture in bins and blocks.

use super::stages::BLOCK_FORMS;
use crate::render::band::Band;
use crate::render::shaders::fast::{BIN_COLUMNS, BIN_ROWS, BLOCK_WIDTH};

/// The sizes of one picture in bins and blocks.
#[derive(Clone, Copy)]
pub struct BinGrid {
    /// Columns and rows of bins.
    pub bins: [u32; 2],
    /// The row of the picture with which the first bins begin.
    pub top_px: u32,
    /// px
    pub block_height: u32,
    /// The index in [`BLOCK_FORMS`] of the form of its blocks.
    pub form_index: usize,
}

impl BinGrid {
    pub fn new(size_px: [u32; 2], form_index: usize) -> Self {
        Self::of_band(Band::whole(size_px), size_px, form_index)
    }

    /// The bins of a band of a picture.
    pub(in crate::render) fn of_band(band: Band, size_px: [u32; 2], form_index: usize) -> Self {
        let block_height = BLOCK_FORMS[form_index].height;
        let bin_px = [BIN_COLUMNS * BLOCK_WIDTH, BIN_ROWS * block_height];
        assert!(band.top.is_multiple_of(bin_px[1]), "a band begins with a row of bins");
        let size = band.size(size_px);
        let bins = std::array::from_fn(|axis| size[axis].div_ceil(bin_px[axis]));
        Self { bins, top_px: band.top, block_height, form_index }
    }

    /// Width and height of a bin, px.
    pub(in crate::render) fn bin_px(&self) -> [u32; 2] {
        [BIN_COLUMNS * BLOCK_WIDTH, BIN_ROWS * self.block_height]
    }

    /// Bins of the picture.
    pub fn count(&self) -> u32 {
        self.bins.iter().product()
    }
}
