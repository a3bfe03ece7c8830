//! Bands: rows of a picture that are drawn by themselves.

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

    /// The band as shaders read it.
    pub(super) fn word(self) -> u32 {
        self.top | self.rows << 16
    }
}
