//! The pictures at rest, read back to the host, for pixel values and the difference of two pictures.

use std::sync::Arc;

use crate::measure::metrics::Difference;
use crate::pixels::Pixels;
use crate::render::Quantity;

/// The pictures that the window shows, read back.
pub struct Snapshot {
    /// Identifies the snapshot.
    pub number: u64,
    pub first: Arc<Pixels>,
    pub second: Option<Arc<Pixels>>,
}

/// A rectangle of a picture in pixels: left, top, right, bottom; right and bottom are exclusive.
pub type Area = [u32; 4];

/// The measured difference of two pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct PairDifference {
    /// The number of the measured [`Snapshot`].
    pub number: u64,
    /// `None` for the whole picture.
    pub area: Option<Area>,
    pub difference: Difference,
}

/// Least side of an area in pixels: the side of a window of SSIM.
const MIN_SIDE: u32 = 11;

/// The area spanned by two pixels, both inclusive, in a picture of this size. `None` if it is too small to measure.
pub fn area_between(a: [u32; 2], b: [u32; 2], size: [u32; 2]) -> Option<Area> {
    let [low, high] = [u32::min, u32::max].map(|of| [0, 1].map(|side: usize| of(a[side], b[side]).min(size[side] - 1)));
    let has_side = |side: usize| high[side] + 1 - low[side] >= MIN_SIDE;
    (has_side(0) && has_side(1)).then_some([low[0], low[1], high[0] + 1, high[1] + 1])
}

impl Snapshot {
    /// The comparison of the two pictures, as work for a job; `None` without a second picture of the same size.
    pub fn compare(&self, area: Option<Area>) -> Option<impl FnOnce() -> PairDifference + Send + use<>> {
        let (number, first, second) = (self.number, self.first.clone(), self.second.clone()?);
        (first.size == second.size).then_some(move || {
            let difference = match area {
                Some(area) => Difference::between(&cropped(&first, area), &cropped(&second, area)),
                None => Difference::between(&first, &second),
            };
            PairDifference { number, area, difference }
        })
    }
}

/// The pixels of an area.
pub fn cropped(pixels: &Pixels, [left, top, right, bottom]: Area) -> Pixels {
    let row = |y: u32| {
        let begin = (y * pixels.size[0]) as usize;
        pixels.rgba[begin + left as usize..begin + right as usize].iter().copied()
    };
    Pixels { size: [right - left, bottom - top], rgba: (top..bottom).flat_map(row).collect() }
}

/// The ends of a scale between the first and the last percentile of the values of a picture. `None` without values.
pub fn fitted_range(pixels: &Pixels, quantity: Quantity) -> Option<[f32; 2]> {
    let mut values: Vec<f32> = pixels.rgba.iter().filter_map(|pixel| quantity.value(*pixel)).collect();
    if values.is_empty() {
        return None;
    }
    values.sort_unstable_by(f32::total_cmp);
    let cut = values.len() / 100;
    let [low, high] = [values[cut], values[values.len() - 1 - cut]];
    Some([low, if high > low { high } else { low + low.abs().max(1.0) }])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Scale;

    #[test]
    fn an_area_has_both_of_its_ends() {
        assert_eq!(area_between([20, 5], [2, 17], [100, 100]), Some([2, 5, 21, 18]));
        assert_eq!(area_between([0, 0], [999, 999], [30, 20]), Some([0, 0, 30, 20]));
        assert_eq!(area_between([4, 4], [14, 13], [30, 20]), None, "it has ten rows");
    }

    #[test]
    fn an_area_is_measured_alone() {
        let pixel = |i: u32| if i % 40 < 20 { [0.5, 0.5, 0.5, 1.0] } else { [0.25, 0.5, 0.5, 1.0] };
        let second = Pixels { size: [40, 20], rgba: (0..800).map(pixel).collect() };
        let first = Pixels { size: [40, 20], rgba: vec![[0.5, 0.5, 0.5, 1.0]; 800] };
        let still = Snapshot { number: 7, first: Arc::new(first), second: Some(Arc::new(second)) };
        let of = |area| (still.compare(area).unwrap())();
        assert_eq!(of(Some([0, 0, 20, 20])).difference.psnr_db, None, "the left half is equal");
        let PairDifference { number, difference, .. } = of(Some([20, 3, 40, 20]));
        assert_eq!((number, difference.max_error), (7, 0.25));
        assert!((of(None).difference.mse - difference.mse / 2.0).abs() < 1e-12);
        assert!(Snapshot { second: None, ..still }.compare(None).is_none());
    }

    #[test]
    fn a_scale_is_fitted_to_the_values_of_a_picture() {
        let scale = Scale { low: 0.0, high: 1.0, is_logarithmic: false };
        let pixel = |i: u32| [i as f32 / 2.0, 0.0, 0.0, if i < 1000 { 0.5 } else { 0.0 }];
        let pixels = Pixels { size: [1100, 1], rgba: (0..1100).map(pixel).collect() };
        // Pixels without coverage have no mean.
        assert_eq!(fitted_range(&pixels, Quantity::Mean(scale)), Some([10.0, 989.0]));
        assert_eq!(fitted_range(&Pixels { size: [1, 1], rgba: vec![[3.0; 4]] }, Quantity::Colour), None);
        assert_eq!(
            fitted_range(&Pixels { size: [1, 1], rgba: vec![[3.0; 4]] }, Quantity::Number(scale)),
            Some([3.0, 6.0])
        );
    }
}
