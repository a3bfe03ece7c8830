//! Converts stored values to canonical ones in f64: finite values, unit quaternions, sigmoids, exponentials. Values a
//! rounding step out of range are clamped; Gaussians with values further out are dropped, and counted by their reason.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::placement::{Placement, Placer};
use super::stored::{Activated, unit};
use super::{Gaussians, LoadReport, sh_coefficients};
use crate::host_memory::OutOfMemory;

/// Builds [`Gaussians`] from stored values, block by block.
#[derive(Debug)]
pub struct Builder {
    /// Allocated for the whole capacity, so that threads decode in place. The first `kept` are complete, and the
    /// spherical harmonics of the others are 0.
    gaussians: Gaussians,
    kept: usize,
    report: LoadReport,
    placer: Placer,
}

/// Gaussians per block of a reader: enough to share among threads, few enough to need little memory.
pub const BLOCK: usize = 1 << 16;

/// Gaussians that a thread decodes at a time.
const PART: usize = 1 << 10;

impl Builder {
    /// A builder with capacity for `capacity` Gaussians of this SH degree.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the capacity cannot be allocated.
    pub fn new(sh_degree: u32, capacity: usize) -> Result<Self, OutOfMemory> {
        let (gaussians, report) = (Gaussians::zeros(sh_degree, capacity)?, LoadReport::default());
        Ok(Self { gaussians, kept: 0, report, placer: Placer::new(&Placement::IDENTITY) })
    }

    /// Sets where the Gaussians lie that are added from now on.
    pub(crate) fn place(&mut self, placer: Placer) {
        self.placer = placer;
    }

    /// Adds `count` Gaussians; Gaussians that cannot be drawn are dropped and counted. `decode(index, sh)` returns
    /// Gaussian `index` from 0 to `count - 1`, a [`Raw`](super::Raw) or an [`Activated`], and writes its spherical
    /// harmonics, which are 0 before; it runs on many threads.
    pub fn extend<G: Into<Activated>>(&mut self, count: usize, decode: impl Fn(usize, &mut [[f32; 3]]) -> G + Sync) {
        let range = self.kept..self.kept + count;
        let all = &mut self.gaussians;
        if all.len() < range.end {
            resize(all, range.end);
        }
        let parts = parts(all, range.clone()).enumerate();
        let placed = |index, sh: &mut [[f32; 3]]| self.placer.placed(decode(index, sh).into(), sh);
        let reports: Vec<_> = parts.map(|(i, part)| part.fill(|k, sh| placed(i * PART + k, sh))).collect();
        for (i, report) in reports.iter().enumerate() {
            let (from, len) = (range.start + i * PART, report.read - report.dropped());
            if from != self.kept {
                move_down(all, from..from + len, self.kept);
            }
            self.kept += len;
            self.report = self.report.and(report);
        }
        let stride = sh_coefficients(all.sh_degree);
        all.sh[self.kept * stride..range.end * stride].fill([0.0; 3]);
    }

    /// Number of Gaussians kept so far.
    pub(crate) fn len(&self) -> usize {
        self.kept
    }

    /// A copy of the Gaussians kept so far.
    ///
    /// # Errors
    /// [`OutOfMemory`] if it cannot be allocated.
    pub fn so_far(&self) -> Result<Gaussians, OutOfMemory> {
        let all: Vec<u32> = (0..self.len() as u32).collect();
        self.gaussians.selected(&all)
    }

    /// The Gaussians, and the report on what was dropped or changed.
    pub fn finish(mut self) -> (Gaussians, LoadReport) {
        resize(&mut self.gaussians, self.kept);
        (self.gaussians, self.report)
    }
}

impl Gaussians {
    /// The Gaussians at this place, and what was dropped or changed. Opacities keep their bits.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the copy cannot be allocated.
    pub(crate) fn placed(&self, placement: &Placement) -> Result<(Self, LoadReport), OutOfMemory> {
        let mut builder = Builder::new(self.sh_degree, self.len())?;
        builder.place(Placer::new(placement));
        builder.extend(self.len(), |i, sh| {
            sh.copy_from_slice(self.sh(i));
            Activated {
                mean: self.means[i].map(f64::from),
                scale: self.scales[i].map(f64::from),
                rotation: self.rotations[i].map(f64::from),
                opacity: self.opacities[i].into(),
            }
        });
        Ok(builder.finish())
    }
}

/// Drops the last Gaussians, or adds zeros that are to be overwritten.
fn resize(all: &mut Gaussians, len: usize) {
    all.means.resize(len, [0.0; 3]);
    all.scales.resize(len, [0.0; 3]);
    all.rotations.resize(len, [0.0; 4]);
    all.opacities.resize(len, 0.0);
    all.sh.resize(len * sh_coefficients(all.sh_degree), [0.0; 3]);
}

fn move_down(all: &mut Gaussians, from: Range<usize>, to: usize) {
    let stride = sh_coefficients(all.sh_degree);
    all.sh.copy_within(from.start * stride..from.end * stride, to * stride);
    all.means.copy_within(from.clone(), to);
    all.scales.copy_within(from.clone(), to);
    all.rotations.copy_within(from.clone(), to);
    all.opacities.copy_within(from, to);
}

/// Some Gaussians in a row that one thread decodes.
struct Part<'g> {
    means: &'g mut [[f32; 3]],
    scales: &'g mut [[f32; 3]],
    rotations: &'g mut [[f32; 4]],
    opacities: &'g mut [f32],
    sh: &'g mut [[f32; 3]],
}

/// The Gaussians in `range`, [`PART`] at a time.
fn parts(all: &mut Gaussians, range: Range<usize>) -> impl IndexedParallelIterator<Item = Part<'_>> {
    let stride = sh_coefficients(all.sh_degree);
    let sh = all.sh[range.start * stride..range.end * stride].par_chunks_mut(PART * stride);
    let shapes = (all.scales[range.clone()].par_chunks_mut(PART))
        .zip(all.rotations[range.clone()].par_chunks_mut(PART))
        .zip(all.opacities[range.clone()].par_chunks_mut(PART));
    let parts = all.means[range].par_chunks_mut(PART).zip(shapes).zip(sh);
    parts.map(|((means, ((scales, rotations), opacities)), sh)| Part { means, scales, rotations, opacities, sh })
}

impl Part<'_> {
    /// Decodes Gaussians up to the capacity of the block, and moves drawable ones to the front.
    fn fill(self, decode: impl Fn(usize, &mut [[f32; 3]]) -> Activated) -> LoadReport {
        let mut report = LoadReport::default();
        let stride = self.sh.len() / self.means.len();
        let mut kept = 0;
        for index in 0..self.means.len() {
            let sh = &mut self.sh[kept * stride..][..stride];
            report.read += 1;
            let stored = decode(index, sh);
            match canonical(&stored, sh) {
                Ok(gaussian) => {
                    report.count_rounding(&stored, &gaussian);
                    self.means[kept] = gaussian.mean;
                    self.scales[kept] = gaussian.scale;
                    self.rotations[kept] = gaussian.rotation;
                    self.opacities[kept] = gaussian.opacity;
                    report.clamped_scale += usize::from(gaussian.has_clamped_scale);
                    report.clamped_opacity += usize::from(gaussian.has_clamped_opacity);
                    kept += 1;
                    continue;
                }
                Err(Flaw::NotFinite) => report.not_finite += 1,
                Err(Flaw::TooLarge) => report.too_large += 1,
                Err(Flaw::NegativeScale) => report.negative_scale += 1,
                Err(Flaw::OpacityRange) => report.opacity_range += 1,
                Err(Flaw::ZeroRotation) => report.zero_rotation += 1,
                Err(Flaw::Transparent) => report.transparent += 1,
            }
            // The next one is decoded here.
            sh.fill([0.0; 3]);
        }
        report
    }
}

/// Distance by which a mean may be rounded, in largest standard deviations: it changes no alpha by more than 0.06.
const MAX_ROUNDING: f64 = 0.1;

impl LoadReport {
    /// Counts what the rounding to 32-bit floats does to a Gaussian.
    fn count_rounding(&mut self, stored: &Activated, rounded: &Canonical) {
        let (mean, is_point) = (rounded.mean.map(f64::from), rounded.scale == [0.0; 3]);
        if mean == stored.mean && !is_point {
            return;
        }
        // Squares of tiny distances would be 0.
        let [x, y, z] = (DVec3::from(stored.mean) - DVec3::from(mean)).to_array();
        let distance = x.hypot(y).hypot(z);
        let size = stored.scale.into_iter().fold(0.0, f64::max);
        self.displacement = self.displacement.max(distance);
        self.displacement_squares += distance * distance;
        self.displaced += usize::from(distance > MAX_ROUNDING * size);
        self.vanished += usize::from(is_point && size > 0.0);
    }
}

#[derive(Debug)]
struct Canonical {
    mean: [f32; 3],
    scale: [f32; 3],
    has_clamped_scale: bool,
    rotation: [f32; 4],
    opacity: f32,
    has_clamped_opacity: bool,
}

/// Upper bound on a coefficient: the sum of all of them times their basis functions does not overflow.
const MAX_SH: f32 = 1e36;

/// Upper bound on a coordinate: the camera that frames such a scene is within 32-bit floats, too.
const MAX_MEAN: f32 = 1e34;

/// Largest excess of an opacity below 0 or above 1 that is taken for a rounding: more than a step of bfloat16 above 1
/// (2^-7) and of 7 bits (1/127).
const OPACITY_EXCESS: f64 = 0.01;

/// Why a Gaussian cannot be drawn.
#[derive(Debug)]
enum Flaw {
    NotFinite,
    TooLarge,
    NegativeScale,
    OpacityRange,
    ZeroRotation,
    Transparent,
}

fn canonical(stored: &Activated, sh: &[[f32; 3]]) -> Result<Canonical, Flaw> {
    let mean = stored.mean.map(|v| v as f32);
    let is_in_range = mean.iter().all(|v| v.abs() <= MAX_MEAN)
        && stored.rotation.iter().all(|v| v.is_finite())
        && stored.scale.iter().all(|v| (0.0..f64::INFINITY).contains(v))
        && (0.0..=1.0).contains(&stored.opacity)
        && sh.as_flattened().iter().all(|v| v.abs() < MAX_SH);
    let mut opacity = stored.opacity;
    if !is_in_range {
        if let Some(flaw) = flaw(stored, sh) {
            return Err(flaw);
        }
        opacity = opacity.clamp(0.0, 1.0);
    }
    let rotation = unit(stored.rotation).ok_or(Flaw::ZeroRotation)?.map(|v| v as f32);
    let has_clamped_opacity = opacity != stored.opacity;
    let opacity = opacity as f32;
    if opacity == 0.0 {
        return Err(Flaw::Transparent);
    }
    let scale = stored.scale.map(|s| s as f32);
    let has_clamped_scale = scale.contains(&f32::INFINITY);
    let scale = scale.map(|s| s.min(f32::MAX));
    Ok(Canonical { mean, scale, has_clamped_scale, rotation, opacity, has_clamped_opacity })
}

/// Why a Gaussian with a value out of range cannot be drawn; `None` if that value is an opacity that is clamped.
fn flaw(stored: &Activated, sh: &[[f32; 3]]) -> Option<Flaw> {
    let Activated { mean, scale, rotation, opacity } = stored;
    let mut numbers = mean.iter().chain(scale).chain(rotation).chain(std::iter::once(opacity));
    if !numbers.all(|v| v.is_finite()) || !sh.as_flattened().iter().all(|v| v.is_finite()) {
        return Some(Flaw::NotFinite);
    }
    if mean.iter().any(|v| v.abs() > MAX_MEAN.into()) || sh.as_flattened().iter().any(|v| v.abs() >= MAX_SH) {
        return Some(Flaw::TooLarge);
    }
    if scale.iter().any(|v| *v < 0.0) {
        return Some(Flaw::NegativeScale);
    }
    let is_near = (-OPACITY_EXCESS..=1.0 + OPACITY_EXCESS).contains(opacity);
    (!is_near).then_some(Flaw::OpacityRange)
}

/// True if the values of a Gaussian are as [`canonical`] makes them. Rotations may be rounded to 16 bits.
pub(crate) fn is_canonical(gaussians: &Gaussians, index: usize) -> bool {
    let length: f32 = gaussians.rotations[index].iter().map(|v| v * v).sum();
    let opacity = gaussians.opacities[index];
    gaussians.means[index].iter().all(|v| v.abs() <= MAX_MEAN)
        && gaussians.scales[index].iter().all(|v| (0.0..=f32::MAX).contains(v))
        && (length - 1.0).abs() < 1e-2
        && opacity > 0.0
        && opacity <= 1.0
        && gaussians.sh(index).as_flattened().iter().all(|v| v.abs() < MAX_SH)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Raw;

    const GOOD: Raw =
        Raw { mean: [1.0, 2.0, 3.0], log_scale: [0.0, -1.0, -2.0], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: 0.0 };

    fn build(raw: Raw) -> (Gaussians, LoadReport) {
        build_coloured(raw, [0.5; 3])
    }

    fn build_coloured<G: Into<Activated> + Copy + Sync>(stored: G, colour: [f32; 3]) -> (Gaussians, LoadReport) {
        let mut builder = Builder::new(0, 1).unwrap();
        builder.extend(1, |_, sh| {
            sh[0] = colour;
            stored
        });
        builder.finish()
    }

    fn report(raw: Raw) -> LoadReport {
        build(raw).1
    }

    #[test]
    fn canonical_drops_non_finite_values() {
        let nan = [f64::NAN, 0.0, 0.0];
        let bad = [
            Raw { mean: nan, ..GOOD },
            Raw { mean: [f64::INFINITY, 0.0, 0.0], ..GOOD },
            Raw { log_scale: nan, ..GOOD },
            Raw { log_scale: [f64::INFINITY, 0.0, 0.0], ..GOOD },
            Raw { rotation: [f64::NAN, 0.0, 0.0, 1.0], ..GOOD },
            Raw { rotation: [f64::INFINITY, 0.0, 0.0, 1.0], ..GOOD },
            Raw { opacity_logit: f64::NAN, ..GOOD },
        ];
        for raw in bad {
            let (gaussians, report) = build(raw);
            assert_eq!(report, LoadReport { read: 1, not_finite: 1, ..LoadReport::default() }, "{raw:?}");
            assert!(gaussians.is_empty());
        }
        for colour in [f32::NAN, f32::INFINITY] {
            assert_eq!(build_coloured(GOOD, [0.0, colour, 0.0]).1.not_finite, 1);
        }
    }

    #[test]
    fn every_reason_of_a_drop_is_counted_apart() {
        let one = LoadReport { read: 1, ..LoadReport::default() };
        for mean in [[1e39, 0.0, 0.0], [0.0, -2e34, 0.0]] {
            assert_eq!(report(Raw { mean, ..GOOD }), LoadReport { too_large: 1, ..one });
        }
        assert_eq!(build_coloured(GOOD, [0.0, -3e38, 0.0]).1, LoadReport { too_large: 1, ..one });
        let good = Activated::from(GOOD);
        let found = |activated: Activated| build_coloured(activated, [0.5; 3]).1;
        assert_eq!(found(Activated { scale: [1.0, -1e-3, 1.0], ..good }), LoadReport { negative_scale: 1, ..one });
        for opacity in [1.02, 255.0, -0.02] {
            assert_eq!(found(Activated { opacity, ..good }), LoadReport { opacity_range: 1, ..one }, "{opacity}");
        }
        assert_eq!(found(Activated { rotation: [0.0; 4], ..good }), LoadReport { zero_rotation: 1, ..one });
        for opacity in [0.0, -1e-7, -0.005] {
            assert_eq!(found(Activated { opacity, ..good }), LoadReport { transparent: 1, ..one }, "{opacity}");
        }
        assert_eq!(found(Activated { opacity: f64::NAN, ..good }), LoadReport { not_finite: 1, ..one });
    }

    #[test]
    fn opacities_a_rounding_above_1_become_1_and_are_counted() {
        // Steps above 1: of 32-bit floats, of 16-bit floats, of bfloat16.
        for excess in [1.2e-7, 4.9e-4, 7.9e-3] {
            let (gaussians, report) = build_coloured(Activated { opacity: 1.0 + excess, ..GOOD.into() }, [0.5; 3]);
            assert_eq!(report, LoadReport { read: 1, clamped_opacity: 1, ..LoadReport::default() });
            assert_eq!(gaussians.opacities(), [1.0]);
            assert!(report.is_clean());
        }
    }

    #[test]
    fn canonical_keeps_the_order_of_the_rest() {
        let mut builder = Builder::new(0, 10).unwrap();
        builder.extend(10, |i, _| Raw { mean: [if i % 3 == 0 { f64::NAN } else { i as f64 }, 0.0, 0.0], ..GOOD });
        let (gaussians, report) = builder.finish();
        assert_eq!(gaussians.means().iter().map(|m| m[0]).collect::<Vec<_>>(), [1.0, 2.0, 4.0, 5.0, 7.0, 8.0]);
        assert_eq!((report.read, report.not_finite), (10, 4));
    }

    #[test]
    fn dropped_gaussians_leave_no_coefficients_behind() {
        let mut builder = Builder::new(1, 4).unwrap();
        builder.extend(2, |i, sh| {
            sh.fill([1.0 + i as f32; 3]);
            Raw { opacity_logit: [f64::NAN, 0.0][i], ..GOOD }
        });
        builder.extend(2, |_, _| GOOD);
        let (gaussians, _) = builder.finish();
        assert_eq!(gaussians.sh(0), [[2.0; 3]; 4]);
        assert_eq!([gaussians.sh(1), gaussians.sh(2)], [[[0.0; 3]; 4]; 2]);
    }

    #[test]
    fn canonical_takes_infinite_logits_as_opacities_one_and_zero() {
        assert_eq!(build(Raw { opacity_logit: f64::INFINITY, ..GOOD }).0.opacities(), [1.0]);
        assert_eq!(report(Raw { opacity_logit: f64::NEG_INFINITY, ..GOOD }).transparent, 1);
        assert_eq!(build(Raw { opacity_logit: 100.0, ..GOOD }).0.opacities(), [1.0]);
        assert!(build(Raw { opacity_logit: -100.0, ..GOOD }).0.opacities()[0] > 0.0);
    }

    #[test]
    fn canonical_keeps_flat_and_huge_scales() {
        assert_eq!(build(Raw { log_scale: [f64::NEG_INFINITY, 0.0, 0.0], ..GOOD }).0.scales(), [[0.0, 1.0, 1.0]]);
        let (gaussians, report) = build(Raw { log_scale: [1000.0, 88.0, 0.0], ..GOOD });
        assert_eq!(report.clamped_scale, 1);
        assert_eq!(gaussians.scales()[0][0], f32::MAX);
    }

    #[test]
    fn canonical_normalizes_quaternions_of_any_length() {
        for length in [1e-300, 1e-25, 1.0, 1e20, 1e300] {
            let rotation = [0.5, -0.5, 0.5, 0.5].map(|v| v * length);
            assert_eq!(build(Raw { rotation, ..GOOD }).0.rotations(), [[0.5, -0.5, 0.5, 0.5]]);
        }
        assert_eq!(report(Raw { rotation: [0.0; 4], ..GOOD }).zero_rotation, 1);
    }

    #[test]
    fn a_load_report_counts_by_reason() {
        assert_eq!(LoadReport::default().to_string(), "nothing dropped");
        let report = LoadReport { read: 9, not_finite: 2, zero_rotation: 1, ..LoadReport::default() };
        assert_eq!(report.to_string(), "2 dropped as not finite, 1 dropped for a zero quaternion");
    }
}
