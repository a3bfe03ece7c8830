//! Planes of words of many Gaussians.

use super::Layout;
use super::widths::plane_widths;
use crate::scene::Gaussians;

/// A Gaussian without its colour.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    pub mean: [f32; 3],
    pub rotation: [f32; 4],
    pub scale: [f32; 3],
    pub opacity: f32,
}

impl Shape {
    /// The shape of Gaussian `index`.
    pub fn of(gaussians: &Gaussians, index: usize) -> Self {
        Self {
            mean: gaussians.means()[index],
            rotation: gaussians.rotations()[index],
            scale: gaussians.scales()[index],
            opacity: gaussians.opacities()[index],
        }
    }
}

/// Fills parts of the planes of bounds and of shapes, with four words per element: element `k` of the bounds, which is
/// the mean and the [`reach`], is of `shape(k)`. Gaussians with alphas below `alpha_min` may be culled there.
pub fn pack_shapes(
    layout: &Layout,
    alpha_min: f32,
    shape: impl Fn(usize) -> Shape,
    bounds: &mut [[u32; 4]],
    planes: &mut [&mut [[u32; 4]]],
) {
    clear_last(planes);
    for (k, element) in bounds.iter_mut().enumerate() {
        let Shape { mean, rotation, scale, opacity } = shape(k);
        let [x, y, z] = mean.map(f32::to_bits);
        let (kept_scale, kept) = layout.kept_shape(scale, opacity);
        // A Gaussian that is too faint to be drawn stays so. Opacities above 1 are in the words of levels.
        let drawn = if opacity < alpha_min || opacity > 1.0 { opacity } else { kept };
        *element = [x, y, z, reach(kept_scale, drawn, alpha_min.into())];
        put(planes, k, layout.shape_words(), |word| layout.shape_word(rotation, scale, opacity, word));
    }
}

/// Fills parts of the planes of spherical harmonics for `count` Gaussians.
pub fn pack_sh<'s>(
    layout: &Layout,
    count: usize,
    sh: impl Fn(usize) -> &'s [[f32; 3]],
    planes: &mut [&mut [[u32; 4]]],
) {
    clear_last(planes);
    for k in 0..count {
        let packed = layout.packed_sh(sh(k));
        put(planes, k, layout.sh_words(), |word| packed[word]);
    }
}

/// Clears the last element, which more Gaussians may share.
fn clear_last(planes: &mut [&mut [[u32; 4]]]) {
    planes.iter_mut().filter_map(|plane| plane.last_mut()).for_each(|last| *last = [0; 4]);
}

/// Writes the words of Gaussian `k`, which has `words` in all planes together.
pub fn put(planes: &mut [&mut [[u32; 4]]], k: usize, words: usize, word: impl Fn(usize) -> u32) {
    let mut first = 0;
    for (plane, width) in planes.iter_mut().zip(plane_widths(words)) {
        for (i, place) in plane.as_flattened_mut()[k * width..][..width].iter_mut().enumerate() {
            let wanted = first + i;
            *place = if wanted < words { word(wanted) } else { 0 };
        }
        first += width;
    }
}

/// Reads the words of Gaussian `k` from planes of words, one after another, into `words`.
pub fn take<'w>(planes: impl Iterator<Item = &'w [u32]>, k: usize, words: &mut [u32]) {
    let mut rest = words;
    for (plane, width) in planes.zip(plane_widths(rest.len())) {
        let (part, others) = rest.split_at_mut(width.min(rest.len()));
        part.iter_mut().zip(&plane[k * width..][..width]).for_each(|(to, from)| *to = *from);
        rest = others;
    }
}

/// Two bfloat16, rounded up. The lower half is the number of standard deviations from the mean at which alpha falls to
/// `alpha_min`. The upper half is the same in world units along the longest axis, or -1 if alpha is lower everywhere.
/// Their signs are marks on the device (`glsl/shared/marks.glsl`).
pub fn reach(scale: [f32; 3], opacity: f32, alpha_min: f64) -> u32 {
    let opacity = f64::from(opacity);
    if opacity < alpha_min {
        return (-1.0_f32).to_bits();
    }
    let longest = f64::from(scale[0].max(scale[1]).max(scale[2]));
    let deviations = (2.0 * (opacity / alpha_min).ln()).sqrt();
    upper_half(deviations * longest) << 16 | upper_half(deviations)
}

/// The bits of the least bfloat16 that is not less than `value`, which is not negative.
fn upper_half(value: f64) -> u32 {
    let single = (value * (1.0 + 1e-6)) as f32;
    single.to_bits().div_ceil(1 << 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::ALPHA_MIN;

    #[test]
    fn reach_is_rounded_up_and_hardly_more() {
        for (scale, opacity) in [(1.0_f32, 1.0_f32), (1e-8, 0.5), (3.7e5, 0.004), (f32::MAX, 1.0)] {
            let bits = reach([scale, 0.0, scale / 2.0], opacity, ALPHA_MIN.into());
            let [world, deviations] = [bits & 0xffff_0000, bits << 16].map(|b| f64::from(f32::from_bits(b)));
            let exact = (2.0 * (f64::from(opacity) / f64::from(ALPHA_MIN)).ln()).sqrt();
            assert!(deviations >= exact && deviations <= exact * 1.01, "{opacity}: {deviations} for {exact}");
            let exact = (exact * f64::from(scale)).min(f64::INFINITY);
            assert!(
                world >= exact && (world <= exact * 1.01 || world == f64::INFINITY),
                "{scale}: {world} for {exact}"
            );
        }
        assert!(f32::from_bits(reach([1.0; 3], 0.003, ALPHA_MIN.into()) & 0xffff_0000) < 0.0);
        assert_eq!(reach([1.0; 3], ALPHA_MIN, ALPHA_MIN.into()) << 16, 0, "alpha 1/255 is at the mean alone");
    }
}
