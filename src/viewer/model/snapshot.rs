//! The pictures at rest, read back to the host, for pixel values and the difference of two pictures.

use std::sync::Arc;

use crate::camera::Camera;
use crate::measure::metrics::{Difference, Scored};
use crate::pixels::Pixels;
use crate::render::Quantity;

/// The pictures that the window shows, read back.
pub struct Snapshot {
    /// Identifies the snapshot.
    pub number: u64,
    pub first: Arc<Pixels>,
    pub second: Option<Arc<Pixels>>,
    /// What a photograph covers, which is smaller than the view if it has another shape; `None` if the second picture
    /// covers the view.
    pub covered: Option<Area>,
}

/// A rectangle of a picture in pixels: left, top, right, bottom; right and bottom are exclusive.
pub type Area = [u32; 4];

/// The measured difference of two pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct PairDifference {
    /// The number of the measured [`Snapshot`].
    pub number: u64,
    /// The area that was asked for; `None` for the whole picture.
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
    /// The comparison of the two pictures where both show something and their `camera` sees something, as work for a
    /// job; `None` without such a place, and without a second picture of the same size.
    pub fn compare(
        &self,
        area: Option<Area>,
        camera: &Camera,
    ) -> Option<impl FnOnce() -> PairDifference + Send + use<>> {
        let (number, first, second) = (self.number, self.first.clone(), self.second.clone()?);
        let camera = camera.sampled(first.size);
        let measured = match (area, self.covered) {
            (Some(area), Some(covered)) => Some(shared(area, covered)?),
            (one, other) => one.or(other),
        };
        (first.size == second.size).then_some(move || {
            let (width, seen) = (first.size[0], camera.seen());
            let difference = match measured {
                Some(area) => {
                    let seen = seen.map(|seen| within(&seen, width, area));
                    Scored::new(&cropped(&first, area), &cropped(&second, area), seen).difference()
                }
                None => Scored::new(&first, &second, seen).difference(),
            };
            PairDifference { number, area, difference }
        })
    }
}

/// The part that two areas share; `None` without one.
fn shared(a: Area, b: Area) -> Option<Area> {
    let [left, top, right, bottom] = [a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])];
    (left < right && top < bottom).then_some([left, top, right, bottom])
}

/// The pixels of an area.
pub fn cropped(pixels: &Pixels, area @ [left, top, right, bottom]: Area) -> Pixels {
    Pixels { size: [right - left, bottom - top], rgba: within(&pixels.rgba, pixels.size[0], area) }
}

/// The values of an area, of one value per pixel.
fn within<T: Copy>(values: &[T], width: u32, [left, top, right, bottom]: Area) -> Vec<T> {
    let row = |y: u32| values[(y * width + left) as usize..(y * width + right) as usize].iter().copied();
    (top..bottom).flat_map(row).collect()
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
    use glam::DVec3;

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
        let still = Snapshot { number: 7, first: Arc::new(first), second: Some(Arc::new(second)), covered: None };
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [40, 20], 1.0);
        let of = |area| (still.compare(area, &camera).unwrap())();
        assert_eq!(of(Some([0, 0, 20, 20])).difference.psnr_db, None, "the left half is equal");
        let PairDifference { number, difference, .. } = of(Some([20, 3, 40, 20]));
        assert_eq!((number, difference.max_error), (7, 0.25));
        assert!((of(None).difference.mse - difference.mse / 2.0).abs() < 1e-12);
        // A photograph that covers the left half has nothing to compare on the right.
        let still = Snapshot { covered: Some([0, 0, 20, 20]), ..still };
        for area in [None, Some([5, 0, 40, 20])] {
            let measured = still.compare(area, &camera).unwrap()();
            assert_eq!((measured.area, measured.difference.psnr_db), (area, None));
        }
        assert!(still.compare(Some([20, 3, 40, 20]), &camera).is_none());
        assert!(Snapshot { second: None, ..still }.compare(None, &camera).is_none());
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
