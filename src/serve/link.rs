//! The size of pictures that a connection can take: quality and scale, from how late pictures are shown.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The compression of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level {
    /// Quality of JPEG, 1 to 100.
    pub quality: u8,
    /// Pixels of the picture in one compressed pixel, in each direction.
    pub reduction: u32,
}

/// The levels, the best first, with the bits that a pixel of the picture takes about.
const LEVELS: [(Level, f64); 9] = [
    (Level { quality: 95, reduction: 1 }, 3.0),
    (Level { quality: 90, reduction: 1 }, 1.8),
    (Level { quality: 80, reduction: 1 }, 1.2),
    (Level { quality: 65, reduction: 1 }, 0.8),
    (Level { quality: 50, reduction: 1 }, 0.6),
    (Level { quality: 35, reduction: 1 }, 0.45),
    (Level { quality: 60, reduction: 2 }, 0.2),
    (Level { quality: 40, reduction: 2 }, 0.14),
    (Level { quality: 25, reduction: 2 }, 0.1),
];

/// Bytes of a picture at first: 36 Mbit/s at 30 pictures a second.
const FIRST_BUDGET: f64 = 150e3;
const BUDGETS: [f64; 2] = [8e3, 4e6];

/// A picture is late if it is shown so much later than the fastest of the last ones.
const LATE: Duration = Duration::from_millis(50);
/// It is early below this.
const EARLY: Duration = Duration::from_millis(25);

/// Intervals of pictures at the best level, and at the others.
const INTERVALS: [Duration; 2] = [Duration::from_micros(15_500), Duration::from_millis(33)];

/// Number of pictures whose fastest is the delay of an idle connection.
const KEPT: usize = 120;

/// What is known of a connection.
#[derive(Clone, Debug)]
pub struct Link {
    /// Bytes that a picture may take.
    budget: f64,
    /// Delays of the last pictures from sending to showing.
    delays: VecDeque<Duration>,
    /// Bytes of the last pictures by those of [`LEVELS`].
    complexity: f64,
    level: usize,
    /// No change of the budget before: pictures that were sent before the last one say nothing new.
    settled: Option<Instant>,
}

impl Default for Link {
    fn default() -> Self {
        Self { budget: FIRST_BUDGET, delays: VecDeque::new(), complexity: 1.0, level: 3, settled: None }
    }
}

impl Link {
    /// The compression for the next picture of this many pixels.
    pub fn level(&mut self, pixels: u64) -> Level {
        let bytes = |bits: f64| self.complexity * bits * pixels as f64 / 8.0;
        self.level = LEVELS.iter().position(|(_, bits)| bytes(*bits) <= self.budget).unwrap_or(LEVELS.len() - 1);
        LEVELS[self.level].0
    }

    /// A picture of this many pixels was compressed to this many bytes at the last level.
    pub fn compressed(&mut self, pixels: u64, bytes: usize) {
        let usual = LEVELS[self.level].1 * pixels as f64 / 8.0;
        let found = (bytes as f64 / usual).clamp(0.1, 10.0);
        self.complexity += 0.3 * (found - self.complexity);
    }

    /// A picture that was sent at `sent` is shown `now`.
    pub fn shown(&mut self, sent: Instant, now: Instant) {
        let delay = now.saturating_duration_since(sent);
        if self.delays.len() == KEPT {
            self.delays.pop_front();
        }
        self.delays.push_back(delay);
        let surplus = delay - self.least_delay();
        if self.settled.is_some_and(|settled| sent < settled) {
            return;
        }
        if surplus > LATE {
            self.budget *= 0.75;
            self.settled = Some(now);
        } else if surplus < EARLY {
            self.budget *= 1.06;
        }
        self.budget = self.budget.clamp(BUDGETS[0], BUDGETS[1]);
    }

    /// The delay of an idle connection.
    pub fn least_delay(&self) -> Duration {
        self.delays.iter().min().copied().unwrap_or(Duration::ZERO)
    }

    /// The least time from one picture to the next.
    pub fn interval(&self) -> Duration {
        INTERVALS[usize::from(self.level > 1)]
    }

    /// Number of pictures that may be under way: those that are sent while the first travels, and one more.
    pub fn window(&self) -> u32 {
        let travelling = self.least_delay().as_secs_f64() / self.interval().as_secs_f64();
        (travelling.ceil() as u32 + 1).clamp(2, 12)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends pictures for `seconds` through a connection of this rate and delay; returns the mean pictures a second, the
    /// mean delay in ms and the last level, of the second half.
    fn sent(bits_per_second: f64, one_way_ms: f64, complexity: f64, seconds: f64) -> (f64, f64, Level) {
        let (begin, pixels) = (Instant::now(), 1920 * 1080);
        let at = |seconds: f64| begin + Duration::from_secs_f64(seconds);
        let mut link = Link::default();
        let (mut now, mut free, mut underway) = (0.0, 0.0_f64, VecDeque::new());
        let (mut count, mut delays, mut level) = (0, 0.0, LEVELS[0].0);
        while now < seconds {
            while underway.front().is_some_and(|(_, shown)| *shown <= now) {
                let (sent, shown) = underway.pop_front().unwrap();
                link.shown(at(sent), at(shown));
            }
            if (underway.len() as u32) < link.window() {
                level = link.level(pixels);
                let bits = LEVELS.iter().find(|(known, _)| *known == level).unwrap().1;
                let bytes = complexity * bits * pixels as f64 / 8.0;
                link.compressed(pixels, bytes as usize);
                free = free.max(now) + 8.0 * bytes / bits_per_second;
                let shown = free + 2e-3 * one_way_ms;
                underway.push_back((now, shown));
                if now > seconds / 2.0 {
                    (count, delays) = (count + 1, delays + 1e3 * (shown - now));
                }
            }
            now += link.interval().as_secs_f64();
        }
        (f64::from(count) / (seconds / 2.0), delays / f64::from(count), level)
    }

    #[test]
    fn pictures_suit_the_connection() {
        let (rate, delay, level) = sent(1e9, 0.1, 1.0, 20.0);
        assert!(rate > 60.0 && delay < 10.0 && level == LEVELS[0].0, "{rate} {delay} {level:?}");
        for complexity in [0.5, 1.0, 2.0] {
            let (rate, delay, level) = sent(20e6, 50.0, complexity, 40.0);
            assert!(rate > 20.0 && delay < 200.0 && level.quality >= 25, "{complexity}: {rate} {delay} {level:?}");
        }
        let (rate, delay, _) = sent(3e6, 30.0, 1.0, 60.0);
        assert!(rate > 8.0 && delay < 350.0, "{rate} {delay}");
    }
}
