//! Converts stored values to canonical ones in f64: finite values, unit quaternions, sigmoids, exponentials.

use std::ops::Range;

use rayon::prelude::*;

use super::{Gaussians, LoadReport, sh_coefficients};
use crate::host_memory::OutOfMemory;

/// One Gaussian as files store it, in the axes right, down, forward.
#[derive(Clone, Copy, Debug)]
pub struct Raw {
    /// World units.
    pub mean: [f64; 3],
    /// Natural logarithm of the standard deviations.
    pub log_scale: [f64; 3],
    /// Quaternion w x y z of any length.
    pub rotation: [f64; 4],
    /// Opacity before the sigmoid.
    pub opacity_logit: f64,
}

/// The inverse of the sigmoid; infinite for 0 and 1.
pub(crate) fn logit(opacity: f64) -> f64 {
    (opacity / (1.0 - opacity)).ln()
}

/// Builds [`Gaussians`] from stored values, block by block.
#[derive(Debug)]
pub struct Builder {
    /// Allocated for the whole capacity, so that threads decode in place. The first `kept` are complete, and the
    /// spherical harmonics of the others are 0.
    gaussians: Gaussians,
    kept: usize,
    report: LoadReport,
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
        Ok(Self { gaussians: Gaussians::zeros(sh_degree, capacity)?, kept: 0, report: LoadReport::default() })
    }

    /// Adds `count` Gaussians; Gaussians that cannot be drawn are dropped and counted. `decode(index, sh)` returns
    /// Gaussian
    /// `index` from 0 to `count - 1` and writes its spherical harmonics, which are 0 before; it runs on many threads.
    pub fn extend(&mut self, count: usize, decode: impl Fn(usize, &mut [[f32; 3]]) -> Raw + Sync) {
        let range = self.kept..self.kept + count;
        let all = &mut self.gaussians;
        if all.len() < range.end {
            resize(all, range.end);
        }
        let parts = parts(all, range.clone()).enumerate();
        let reports: Vec<_> = parts.map(|(i, part)| part.fill(|k, sh| decode(i * PART + k, sh))).collect();
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
    fn fill(self, decode: impl Fn(usize, &mut [[f32; 3]]) -> Raw) -> LoadReport {
        let mut report = LoadReport::default();
        let stride = self.sh.len() / self.means.len();
        let mut kept = 0;
        for index in 0..self.means.len() {
            let sh = &mut self.sh[kept * stride..][..stride];
            report.read += 1;
            match canonical(&decode(index, sh), sh) {
                Ok(gaussian) => {
                    self.means[kept] = gaussian.mean;
                    self.scales[kept] = gaussian.scale;
                    self.rotations[kept] = gaussian.rotation;
                    self.opacities[kept] = gaussian.opacity;
                    report.clamped_scale += usize::from(gaussian.has_clamped_scale);
                    kept += 1;
                    continue;
                }
                Err(Flaw::NotFinite) => report.not_finite += 1,
                Err(Flaw::ZeroRotation) => report.zero_rotation += 1,
                Err(Flaw::Transparent) => report.transparent += 1,
            }
            // The next one is decoded here.
            sh.fill([0.0; 3]);
        }
        report
    }
}

#[derive(Debug)]
struct Canonical {
    mean: [f32; 3],
    scale: [f32; 3],
    has_clamped_scale: bool,
    rotation: [f32; 4],
    opacity: f32,
}

/// Upper bound on a coefficient: the sum of all of them times their basis functions does not overflow.
const MAX_SH: f32 = 1e36;

/// Upper bound on a coordinate: the camera that frames such a scene is within 32-bit floats, too.
const MAX_MEAN: f32 = 1e34;

/// Why a Gaussian cannot be drawn.
#[derive(Debug)]
enum Flaw {
    NotFinite,
    ZeroRotation,
    Transparent,
}

fn canonical(raw: &Raw, sh: &[[f32; 3]]) -> Result<Canonical, Flaw> {
    // Legal infinities: an infinite logit is an opacity of 0 or 1, a log scale of minus infinity is a flat Gaussian.
    let mean = raw.mean.map(|v| v as f32);
    let is_finite = mean.iter().all(|v| v.abs() <= MAX_MEAN)
        && raw.rotation.iter().all(|v| v.is_finite())
        && raw.log_scale.iter().all(|v| *v < f64::INFINITY)
        && !raw.opacity_logit.is_nan()
        && sh.as_flattened().iter().all(|v| v.abs() < MAX_SH);
    if !is_finite {
        return Err(Flaw::NotFinite);
    }
    let rotation = unit(raw.rotation).ok_or(Flaw::ZeroRotation)?.map(|v| v as f32);
    let opacity = (1.0 / (1.0 + (-raw.opacity_logit).exp())) as f32;
    if opacity == 0.0 {
        return Err(Flaw::Transparent);
    }
    let scale = raw.log_scale.map(|s| s.exp() as f32);
    let has_clamped_scale = scale.contains(&f32::INFINITY);
    Ok(Canonical { mean, scale: scale.map(|s| s.min(f32::MAX)), has_clamped_scale, rotation, opacity })
}

/// Largest error of the squared length of a unit quaternion after rounding to 32-bit floats.
const UNIT_TOLERANCE: f64 = 2.4e-7;

/// The quaternion normalized; `None` for length zero. It is scaled first so that no square over- or underflows. A
/// rounded unit quaternion is returned unchanged, so that writing and reading keep its bits.
fn unit(q: [f64; 4]) -> Option<[f64; 4]> {
    if (q.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < UNIT_TOLERANCE {
        return Some(q);
    }
    let largest = q.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if largest == 0.0 {
        return None;
    }
    let q = q.map(|v| v / largest);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    Some(q.map(|v| v / length))
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

    const GOOD: Raw =
        Raw { mean: [1.0, 2.0, 3.0], log_scale: [0.0, -1.0, -2.0], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: 0.0 };

    fn build(raw: Raw) -> (Gaussians, LoadReport) {
        build_coloured(raw, [0.5; 3])
    }

    fn build_coloured(raw: Raw, colour: [f32; 3]) -> (Gaussians, LoadReport) {
        let mut builder = Builder::new(0, 1).unwrap();
        builder.extend(1, |_, sh| {
            sh[0] = colour;
            raw
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
            Raw { mean: [1e39, 0.0, 0.0], ..GOOD },
            Raw { mean: [0.0, -2e34, 0.0], ..GOOD },
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
        for colour in [f32::NAN, f32::INFINITY, -3e38] {
            assert_eq!(build_coloured(GOOD, [0.0, colour, 0.0]).1.not_finite, 1);
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
        assert_eq!(
            report.to_string(),
            "2 dropped as not finite or too large for 32-bit floats, 1 dropped for a zero quaternion"
        );
    }
}
