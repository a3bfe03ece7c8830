//! The choice between pictures in bands and pictures that one device draws alone, by their times.

/// The GPU time of a frame alone from which bands are tried, in milliseconds, and what each million of pixels adds, as
/// their colours are copied. Measured on two H200 (docs/films.md).
const FROM_MS: f64 = 0.9;
const FROM_MS_PER_MEGAPIXEL: f64 = 0.65;

/// The times of bands that are kept.
const RECENT: usize = 4;

/// Frames in bands, and their milliseconds, before their times count: the first ones allocate memory and find their
/// borders, and a GPU that was idle takes a while until its clocks are high: longer than 0.15 s in half of the runs on
/// two H200.
const SETTLING: u32 = 8;
const SETTLING_MS: f64 = 600.0;

/// Frames in bands until one is drawn alone, to see which is faster.
const TRIED: u32 = 100;

/// Frames that are drawn alone after bands were not faster. Their number doubles each time, so many times at most.
const PAUSE: u32 = 400;
const DOUBLINGS: u32 = 4;

/// The part of the time of a frame that bands must save at least.
const GAIN: f64 = 0.03;

/// Decides for each frame of a view whether it is drawn in bands.
#[derive(Clone, Debug, Default)]
pub struct Trial {
    /// All frames are drawn in bands.
    pub is_forced: bool,
    alone_ms: f64,
    /// The times of the last frames in bands.
    recent_ms: [f64; RECENT],
    /// The time in which the first device joins bands.
    join_ms: f64,
    /// Frames in bands since the last comparison.
    tried: u32,
    /// The time of the frames in bands since bands were not faster.
    settled_ms: f64,
    /// Frames that are drawn alone before the next one in bands.
    left_alone: u32,
    /// The next frame alone is compared with those in bands.
    is_compared: bool,
    /// Comparisons since bands were faster.
    failed: u32,
}

impl Trial {
    /// True if the next frame, a picture of this size, shall be drawn in bands.
    pub fn is_on(&self, size_px: [u32; 2]) -> bool {
        let megapixels = 1e-6 * f64::from(size_px[0]) * f64::from(size_px[1]);
        let pays = self.alone_ms >= FROM_MS + FROM_MS_PER_MEGAPIXEL * megapixels;
        self.is_forced || self.left_alone == 0 && pays
    }

    /// Takes over the GPU time of a frame that one device drew alone.
    pub fn learn_alone(&mut self, ms: f64) {
        self.alone_ms = ms;
        self.left_alone = self.left_alone.saturating_sub(1);
        if self.is_compared && self.left_alone == 0 {
            self.is_compared = false;
            if self.is_faster() {
                self.failed = 0;
            } else {
                (self.left_alone, self.settled_ms) = (PAUSE << self.failed.min(DOUBLINGS), 0.0);
                self.failed += 1;
            }
        }
    }

    /// Takes over the GPU time in which bands were joined.
    pub fn learn_join(&mut self, ms: f64) {
        self.join_ms = ms;
    }

    /// Takes over the time of a frame in bands, from its begin until the first device could read all of them.
    pub fn learn_bands(&mut self, ms: f64) {
        self.recent_ms[self.tried as usize % RECENT] = ms;
        self.tried += 1;
        self.settled_ms += ms;
        let is_settled = self.tried >= SETTLING && self.settled_ms >= SETTLING_MS;
        if is_settled && (self.tried >= TRIED || !self.is_faster()) {
            (self.left_alone, self.is_compared, self.tried) = (1, true, 0);
        }
    }

    /// The least of the last times counts: single frames are slow for reasons of the system.
    fn is_faster(&self) -> bool {
        let least = self.recent_ms.iter().copied().fold(f64::INFINITY, f64::min);
        least + self.join_ms <= (1.0 - GAIN) * self.alone_ms
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [1920, 1080];

    /// The number of frames in bands among so many, of a view whose frames take so long alone and in bands.
    fn in_bands(trial: &mut Trial, frames: u32, times: impl Fn(u32) -> [f64; 2]) -> u32 {
        let mut bands = 0;
        for frame in 0..frames {
            let [alone, together] = times(frame);
            if trial.is_on(SIZE) {
                trial.learn_bands(together);
                trial.learn_join(0.2);
                bands += 1;
            } else {
                trial.learn_alone(alone);
            }
        }
        bands
    }

    #[test]
    fn bands_go_on_while_they_are_faster() {
        let mut trial = Trial::default();
        assert!(!trial.is_on(SIZE));
        // The first frames are slow, and single ones later.
        let slow = |frame: u32| if frame < 7 || frame.is_multiple_of(7) { 50.0 } else { 6.0 };
        assert!(in_bands(&mut trial, 1000, |frame| [10.0, slow(frame)]) >= 985);
    }

    #[test]
    fn bands_that_are_slower_cost_few_frames() {
        for together in [9.6, 12.0] {
            let mut trial = Trial::default();
            let bands = in_bands(&mut trial, 10_000, |_| [10.0, together]);
            assert!((200..=400).contains(&bands), "{bands} frames in bands");
            // They are used again where they become faster.
            assert!(in_bands(&mut trial, 8000, |_| [10.0, 5.0]) >= 1500);
        }
    }

    #[test]
    fn a_frame_in_flight_is_not_compared() {
        let mut trial = Trial::default();
        trial.learn_alone(10.0);
        trial.learn_bands(50.0);
        // Recorded before the first bands.
        trial.learn_alone(10.0);
        assert!(trial.is_on(SIZE));
    }

    #[test]
    fn fast_frames_are_not_tried() {
        assert_eq!(in_bands(&mut Trial::default(), 1000, |_| [1.9, 0.1]), 0);
        // A view that becomes costly is tried, and one whose bands become slow is drawn alone.
        let mut trial = Trial::default();
        assert!(in_bands(&mut trial, 100, |frame| [if frame < 50 { 1.0 } else { 9.0 }, 5.0]) >= 48);
        assert!(in_bands(&mut trial, 100, |_| [9.0, 20.0]) <= 25);
        // The clocks of the other device become high.
        let mut trial = Trial::default();
        assert!(in_bands(&mut trial, 100, |frame| [9.0, if frame < 7 { 20.0 } else { 5.0 }]) >= 98);
    }

    #[test]
    fn tests_may_ask_for_bands() {
        let mut trial = Trial { is_forced: true, ..Trial::default() };
        assert_eq!(in_bands(&mut trial, 1000, |_| [1.0, 9.0]), 1000);
    }

    #[test]
    fn large_pictures_are_tried_where_they_take_longer() {
        let mut trial = Trial::default();
        trial.learn_alone(3.0);
        assert!(trial.is_on(SIZE) && !trial.is_on([3840, 2160]));
        trial.learn_alone(7.0);
        assert!(trial.is_on([3840, 2160]));
    }
}
