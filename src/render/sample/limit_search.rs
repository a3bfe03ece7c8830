//! The search of the largest error limit whose picture keeps a PSNR.

use crate::render::lod::SampledPsnr;

/// The lowest and highest error limit of a search, as those of [`Options::lod_error`](crate::options::Options).
const LIMITS: [f64; 2] = [1e-3, 1e6];

/// The limit with which a search begins where none is known: few see what it leaves out.
pub const FIRST_LIMIT: f64 = 8.0;

/// The interval of limits in which a search ends, as the ratio of its ends.
const RESOLUTION: f64 = 1.03;

/// The surplus in dB with which a search ends.
const NEAR_DB: f64 = 0.05;

/// Looks for the largest error limit with which the estimate of a picture, less one standard error, is at least a PSNR.
///
/// The PSNR falls nearly linearly with the logarithm of the limit. So the next limit is where the line through the ends
/// of the interval meets the PSNR, or beside an end if it would be too near to that.
#[derive(Clone, Debug)]
pub struct LimitSearch {
    wanted: f64,
    /// The logarithm of the largest limit to try.
    highest: f64,
    /// The logarithms of the highest limit that is known to keep the PSNR and of the lowest that does not, with the
    /// surplus.
    good: Option<(f64, f64, SampledPsnr)>,
    bad: Option<(f64, f64)>,
    at: f64,
    /// A factor of the steps while only one end is known.
    stride: f64,
}

/// What follows from an estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// The next limit to try.
    Try(f64),
    /// The limit, and the estimate of its picture.
    Found(f64, SampledPsnr),
    /// Not even the lowest limit keeps the PSNR.
    AllGaussians,
}

impl LimitSearch {
    /// A search that begins with the limit `first`, for a PSNR in dB.
    pub fn new(wanted: f64, first: f64) -> Self {
        let [lowest, highest] = LIMITS.map(f64::ln);
        Self { wanted, highest, good: None, bad: None, stride: 1.0, at: first.ln().clamp(lowest, highest) }
    }

    /// The search without limits above `most`.
    #[must_use]
    pub fn up_to(self, most: f64) -> Self {
        let highest = most.ln().clamp(LIMITS[0].ln(), self.highest);
        Self { highest, at: self.at.min(highest), ..self }
    }

    /// The limit to try.
    pub fn limit(&self) -> f64 {
        self.at.exp()
    }

    /// Takes the estimate of the picture by [`LimitSearch::limit`].
    pub fn step(&mut self, estimate: SampledPsnr) -> Step {
        const DECADE: f64 = std::f64::consts::LN_10;
        let (lowest, highest, at) = (LIMITS[0].ln(), self.highest, self.at);
        let surplus = estimate.surplus(self.wanted);
        if surplus >= 0.0 {
            self.good = Some((at, surplus, estimate));
            if surplus <= NEAR_DB || at >= highest {
                return Step::Found(at.exp(), estimate);
            }
        } else {
            self.bad = Some((at, surplus));
            if at <= lowest {
                return Step::AllGaussians;
            }
        }
        let next = match (self.good, self.bad) {
            // Errors grow in proportion to the limit, 20 dB in a decade, or slower.
            (Some(_), None) => at + (surplus / 20.0).clamp(0.3, 1.0) * self.stride * DECADE,
            (None, _) => at + (surplus / 20.0).clamp(-1.0, -0.3) * self.stride * DECADE,
            (Some((low, above, estimate)), Some((high, below))) => {
                let width = high - low;
                if width <= RESOLUTION.ln() {
                    return Step::Found(low.exp(), estimate);
                }
                let margin = (0.1 * width).max(0.5 * RESOLUTION.ln()).min(0.5 * width);
                (low + width * above / (above - below)).clamp(low + margin, high - margin)
            }
        };
        self.stride *= 2.0;
        self.at = next.clamp(lowest, highest);
        Step::Try(self.at.exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The estimate of a picture whose errors grow with the power `slope` of the limit.
    fn estimate(limit: f64, slope: f64) -> SampledPsnr {
        let mse = 1e-5 * limit.powf(slope);
        SampledPsnr { mse, standard_error: 0.1 * mse, patches: [64, 510] }
    }

    /// Searches, and returns the result and the number of pictures.
    fn search(wanted: f64, first: f64, measure: impl Fn(f64) -> SampledPsnr) -> (Option<(f64, SampledPsnr)>, usize) {
        let mut search = LimitSearch::new(wanted, first);
        for pictures in 1..40 {
            match search.step(measure(search.limit())) {
                Step::Try(limit) => assert_eq!(limit, search.limit()),
                Step::Found(limit, estimate) => return (Some((limit, estimate)), pictures),
                Step::AllGaussians => return (None, pictures),
            }
        }
        panic!("the search does not end")
    }

    #[test]
    fn a_search_ends_at_the_largest_limit_that_keeps_the_psnr() {
        let cases = [0.3, 1.0, 2.0].into_iter().flat_map(|slope| [20.0, 35.0, 47.3, 60.0, 80.0].map(|db| (slope, db)));
        for ((slope, wanted), first) in cases.flat_map(|case| [1e-3, 8.0, 5e4].map(|first| (case, first))) {
            let what = format!("{wanted} dB, slope {slope}, from {first}");
            let surplus = |limit: f64| estimate(limit, slope).surplus(wanted);
            let (found, pictures) = search(wanted, first, |limit| estimate(limit, slope));
            assert!(pictures <= 16, "{what}: {pictures} pictures");
            let Some((limit, found)) = found else {
                assert!(surplus(LIMITS[0]) < 0.0, "{what}: none found");
                continue;
            };
            assert_eq!(found, estimate(limit, slope), "{what}");
            assert!(surplus(limit) >= 0.0, "{what}: {limit}");
            let is_largest = surplus(limit) <= NEAR_DB || surplus(limit * RESOLUTION * 1.001) < 0.0;
            assert!(is_largest || limit > 0.999 * LIMITS[1], "{what}: {limit}");
        }
    }

    /// Cuts change by steps, so the PSNR may jump over the wanted one.
    #[test]
    fn the_psnr_may_change_by_steps() {
        let (found, pictures) = search(40.0, 8.0, |limit| estimate(if limit < 17.0 { 1.0 } else { 1e3 }, 1.0));
        let (limit, found) = found.unwrap();
        assert!((17.0 / RESOLUTION..17.0).contains(&limit) && found.surplus(40.0) > 9.0, "{limit}, {found:?}");
        assert!(pictures <= 16, "{pictures}");
    }

    #[test]
    fn no_limit_above_the_largest_is_tried() {
        let mut search = LimitSearch::new(40.0, 8.0).up_to(3.0);
        assert!((search.limit() - 3.0).abs() < 1e-9);
        let good = estimate(3.0, 1.0);
        assert!(matches!(search.clone().step(good), Step::Found(limit, found) if limit < 3.01 && found == good));
        assert!(matches!(search.step(estimate(1e3, 1.0)), Step::Try(limit) if limit < 3.0));
        assert_eq!(LimitSearch::new(40.0, 8.0).up_to(0.0).step(estimate(1e3, 1.0)), Step::AllGaussians);
    }

    #[test]
    fn what_no_limit_keeps_is_drawn_with_all_gaussians() {
        let bad = SampledPsnr { mse: 0.1, standard_error: 0.0, patches: [2, 9] };
        assert_eq!(search(40.0, 8.0, |_| bad).0, None);
        let (limit, _) = search(40.0, 8.0, |_| SampledPsnr { mse: 0.0, ..bad }).0.unwrap();
        assert!(limit > 0.99 * LIMITS[1], "{limit}");
    }
}
