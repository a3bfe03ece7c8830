//! Bands: rows of a picture that are drawn by themselves.

use super::shaders::fast::MAX_BINS;

/// Consecutive rows of a picture. Their pixels are those of the whole picture, bit by bit, on a device of the same
/// kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Band {
    /// The first row, a multiple of [`BAND_ROWS`] or of [`Renderer::band_rows`](super::Renderer::band_rows).
    pub top: u32,
    /// Number of rows, a multiple likewise unless the band ends with the picture.
    pub rows: u32,
}

/// Bands of any picture may begin at multiples of this many rows: the height of the highest bins.
pub const BAND_ROWS: u32 = 64;

impl Band {
    /// All rows of a picture of this size.
    pub fn whole(size_px: [u32; 2]) -> Self {
        Self { top: 0, rows: size_px[1] }
    }

    /// The bands of a picture of `height` rows that begin at 0 and at `borders`, in their order.
    pub fn between(borders: &[u32], height: u32) -> Vec<Self> {
        let tops = || std::iter::once(0).chain(borders.iter().copied());
        let ends = borders.iter().copied().chain([height]);
        tops().zip(ends).map(|(top, end)| Self { top, rows: end - top }).collect()
    }

    /// Width and height of the band of a picture of this size.
    pub fn size(self, size_px: [u32; 2]) -> [u32; 2] {
        [size_px[0], self.rows]
    }

    /// True if the fast path draws a picture of this size only in bands: it has too many bins.
    pub fn is_needed(size_px: [u32; 2]) -> bool {
        // Bins of large pictures are as wide as they are high.
        size_px.iter().map(|side| side.div_ceil(BAND_ROWS)).product::<u32>() > MAX_BINS
    }

    /// True if a picture of this size has these rows, and bands may begin at multiples of `unit` rows.
    pub(super) fn is_of(self, size_px: [u32; 2], unit: u32) -> bool {
        let end = u64::from(self.top) + u64::from(self.rows);
        let is_whole = end == u64::from(size_px[1]) || self.rows.is_multiple_of(unit);
        self.rows > 0 && end <= u64::from(size_px[1]) && self.top.is_multiple_of(unit) && is_whole
    }

    /// The band as shaders read it: `View.band`.
    pub(super) fn word(self) -> u32 {
        self.top | (self.rows - 1) << 16
    }
}
