//! Patches: squares of a picture that are drawn by themselves, as a sample of it.

use super::band::Band;

/// Width and height of a patch, px: those of the largest bins.
pub const PATCH_PX: u32 = 64;

/// Some of the patches of a picture. Patches at the right and lower edge may be smaller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patches {
    size_px: [u32; 2],
    /// The numbers of the patches, row by row, in ascending order.
    chosen: Vec<u32>,
}

impl Patches {
    /// These patches of a picture of this size, by their numbers, row by row.
    ///
    /// # Panics
    /// If the picture has no such patch, or one is chosen twice.
    pub fn of(size_px: [u32; 2], mut chosen: Vec<u32>) -> Self {
        chosen.sort_unstable();
        assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]), "no patch is chosen twice");
        assert!(chosen.last().is_none_or(|last| *last < Self::number_in(size_px)), "the patches lie in the picture");
        Self { size_px, chosen }
    }

    /// The number of all patches of a picture of this size.
    pub fn number_in(size_px: [u32; 2]) -> u32 {
        Self::grid(size_px).iter().product()
    }

    /// Columns and rows of patches.
    pub(super) fn grid(size_px: [u32; 2]) -> [u32; 2] {
        size_px.map(|side| side.div_ceil(PATCH_PX))
    }

    /// The numbers of the patches, in ascending order.
    pub fn numbers(&self) -> impl Iterator<Item = u32> {
        self.chosen.iter().copied()
    }

    /// Left, top, width and height of each patch, px.
    pub fn rectangles(&self) -> impl Iterator<Item = [u32; 4]> {
        let ([width, height], [columns, _]) = (self.size_px, Self::grid(self.size_px));
        self.chosen.iter().map(move |patch| {
            let [left, top] = [patch % columns, patch / columns].map(|place| place * PATCH_PX);
            [left, top, PATCH_PX.min(width - left), PATCH_PX.min(height - top)]
        })
    }

    /// Those of the patches that lie in a band. Patches do not cross the border of a band.
    pub(super) fn within(&self, band: Band) -> Self {
        let columns = Self::grid(self.size_px)[0];
        let rows = band.top / PATCH_PX..(band.top + band.rows).div_ceil(PATCH_PX);
        let chosen = self.numbers().filter(|patch| rows.contains(&(patch / columns))).collect();
        Self { size_px: self.size_px, chosen }
    }

    /// A bit for each cell of a grid over a band, set for the cells in these patches. A patch consists of whole cells,
    /// and lies in the band.
    pub(super) fn cells(&self, band: Band, cell_px: [u32; 2], cells: [u32; 2]) -> Vec<u32> {
        assert!(cell_px.iter().all(|side| PATCH_PX.is_multiple_of(*side)), "a patch consists of whole cells");
        let mut bits = vec![0; cells.iter().product::<u32>().div_ceil(32) as usize];
        for [left, top, width, height] in self.rectangles() {
            let top = top - band.top;
            for row in top / cell_px[1]..(top + height).div_ceil(cell_px[1]) {
                for column in left / cell_px[0]..(left + width).div_ceil(cell_px[0]) {
                    let cell = row * cells[0] + column;
                    bits[cell as usize / 32] |= 1 << (cell % 32);
                }
            }
        }
        bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_cover_the_pixels_of_the_patches_and_no_others() {
        let size = [200, 130];
        assert_eq!(Patches::number_in(size), 12);
        let patches = Patches::of(size, vec![11, 0, 6]);
        let rectangles = Vec::from_iter(patches.rectangles());
        assert_eq!(rectangles, [[0, 0, 64, 64], [128, 64, 64, 64], [192, 128, 8, 2]]);
        for cell_px in [[16, 16], [64, 32], [64, 64]] {
            let cells = [0, 1].map(|axis| size[axis].div_ceil(cell_px[axis]));
            let bits = patches.cells(Band::whole(size), cell_px, cells);
            for (x, y) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))) {
                let cell = y / cell_px[1] * cells[0] + x / cell_px[0];
                let is_open = bits[cell as usize / 32] >> (cell % 32) & 1 == 1;
                let inside = |[left, top, width, height]: &[u32; 4]| {
                    (*left..left + width).contains(&x) && (*top..top + height).contains(&y)
                };
                assert_eq!(is_open, rectangles.iter().any(inside), "{x}, {y}, {cell_px:?}");
            }
        }
    }

    #[test]
    fn the_patches_of_bands_are_all_patches() {
        let patches = Patches::of([200, 300], vec![1, 4, 9, 15, 19]);
        let bands = [Band { top: 0, rows: 64 }, Band { top: 64, rows: 128 }, Band { top: 192, rows: 108 }];
        let within = bands.map(|band| Vec::from_iter(patches.within(band).numbers()));
        assert_eq!(within, [vec![1], vec![4, 9], vec![15, 19]]);
        // The second band has rows 64 to 191: two rows of patches with four columns each.
        let bits = patches.within(bands[1]).cells(bands[1], [64, 64], [4, 2]);
        assert_eq!(bits, [1 << 0 | 1 << 5]);
    }
}
