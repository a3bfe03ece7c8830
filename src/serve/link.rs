//! The size of pictures that a connection can take: quality and scale, from how late pictures are shown.

use std::time::{Duration, Instant};

/// The compression of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coding {
    /// Quality of JPEG, 1 to 100.
    pub quality: u8,
    /// Pixels of the picture in one compressed pixel, in each direction.
    pub reduction: u32,
}

/// The codings, the best first, with the bits that a pixel of the picture takes about.
const CODINGS: [(Coding, f64); 9] = [
    (Coding { quality: 95, reduction: 1 }, 3.0),
    (Coding { quality: 90, reduction: 1 }, 1.8),
    (Coding { quality: 80, reduction: 1 }, 1.2),
    (Coding { quality: 65, reduction: 1 }, 0.8),
    (Coding { quality: 50, reduction: 1 }, 0.6),
    (Coding { quality: 35, reduction: 1 }, 0.45),
    (Coding { quality: 60, reduction: 2 }, 0.2),
    (Coding { quality: 40, reduction: 2 }, 0.14),
    (Coding { quality: 25, reduction: 2 }, 0.1),
];

/// Bytes of a picture at first: 36 Mbit/s at 30 pictures a second.
const FIRST_BUDGET: f64 = 150e3;
const BUDGETS: [f64; 2] = [8e3, 4e6];

/// A picture is late if it is shown so much later than one on an idle connection.
const LATE: Duration = Duration::from_millis(25);
/// It is early below this.
const EARLY: Duration = Duration::from_millis(10);
/// Factors on the budget after a late and an early picture.
const FACTORS: [f64; 2] = [0.75, 1.02];

/// Intervals of pictures at the best coding, and at the others.
const INTERVALS: [Duration; 2] = [Duration::from_micros(15_500), Duration::from_millis(33)];

/// After so many pictures, one is sent alone, since a connection that is never idle does not tell its least delay.
const ALONE_AFTER: u32 = 240;

/// What is known of a connection.
#[derive(Clone, Debug)]
pub struct Link {
    /// Bytes that a picture may take.
    budget: f64,
    /// Delay of a picture on an idle connection, from sending to showing.
    least_delay: Option<Duration>,
    /// Pictures since the last one that was sent alone.
    count: u32,
    /// Since when the next picture is to be sent alone.
    alone: Option<Instant>,
    /// Bytes of the last pictures by those of [`CODINGS`].
    complexity: f64,
    coding: usize,
    /// No change of the budget before: pictures that were sent before the last one say nothing new.
    settled: Option<Instant>,
}

impl Default for Link {
    fn default() -> Self {
        Self {
            budget: FIRST_BUDGET,
            least_delay: None,
            count: 0,
            alone: None,
            complexity: 1.0,
            coding: 3,
            settled: None,
        }
    }
}

impl Link {
    /// The compression for the next picture of this many pixels.
    pub fn coding(&mut self, pixels: u64) -> Coding {
        let bytes = |bits: f64| self.complexity * bits * pixels as f64 / 8.0;
        self.coding = CODINGS.iter().position(|(_, bits)| bytes(*bits) <= self.budget).unwrap_or(CODINGS.len() - 1);
        CODINGS[self.coding].0
    }

    /// A picture of this many pixels was compressed to this many bytes at the last coding.
    pub fn compressed(&mut self, pixels: u64, bytes: usize) {
        let usual = CODINGS[self.coding].1 * pixels as f64 / 8.0;
        let found = (bytes as f64 / usual).clamp(0.1, 10.0);
        self.complexity += 0.3 * (found - self.complexity);
    }

    /// A picture that was sent at `sent` is shown `now`.
    pub fn shown(&mut self, sent: Instant, now: Instant) {
        let delay = now.saturating_duration_since(sent);
        self.count += 1;
        let is_alone = self.alone.is_some_and(|since| sent > since);
        if is_alone {
            (self.alone, self.count) = (None, 0);
        } else if self.count >= ALONE_AFTER && self.coding > 1 {
            self.alone.get_or_insert(now);
        }
        let least = self.least_delay.filter(|least| !is_alone && *least < delay).unwrap_or(delay);
        self.least_delay = Some(least);
        let surplus = delay - least;
        if self.settled.is_some_and(|settled| sent < settled) {
            return;
        }
        if surplus > LATE {
            self.budget *= FACTORS[0];
            self.settled = Some(now);
        } else if surplus < EARLY {
            self.budget *= FACTORS[1];
        }
        self.budget = self.budget.clamp(BUDGETS[0], BUDGETS[1]);
    }

    /// The least time from one picture to the next.
    pub fn interval(&self) -> Duration {
        INTERVALS[usize::from(self.coding > 1)]
    }

    /// Number of pictures that may be under way: those that are sent while the first travels, and one more.
    pub fn window(&self) -> u32 {
        if self.alone.is_some() {
            return 1;
        }
        let travelling = self.least_delay.unwrap_or_default().as_secs_f64() / self.interval().as_secs_f64();
        (travelling.ceil() as u32 + 1).clamp(2, 12)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;

    /// Sends pictures for `seconds` through a connection of this rate and delay; returns the mean pictures a second,
    /// the mean delay in ms and the last coding, of the second half.
    fn sent(bits_per_second: f64, one_way_ms: f64, complexity: f64, seconds: f64) -> (f64, f64, Coding) {
        let (begin, pixels) = (Instant::now(), 1920 * 1080);
        let at = |seconds: f64| begin + Duration::from_secs_f64(seconds);
        let mut link = Link::default();
        let (mut now, mut free, mut underway) = (0.0, 0.0_f64, VecDeque::new());
        let (mut count, mut delays, mut coding) = (0, 0.0, CODINGS[0].0);
        while now < seconds {
            while underway.front().is_some_and(|(_, shown)| *shown <= now) {
                let (sent, shown) = underway.pop_front().unwrap();
                link.shown(at(sent), at(shown));
            }
            if (underway.len() as u32) < link.window() {
                coding = link.coding(pixels);
                let bits = CODINGS.iter().find(|(known, _)| *known == coding).unwrap().1;
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
        (f64::from(count) / (seconds / 2.0), delays / f64::from(count), coding)
    }

    #[test]
    fn pictures_suit_the_connection() {
        let (rate, delay, coding) = sent(1e9, 0.1, 1.0, 20.0);
        assert!(rate > 60.0 && delay < 10.0 && coding == CODINGS[0].0, "{rate} {delay} {coding:?}");
        for complexity in [0.5, 1.0, 2.0] {
            let (rate, delay, coding) = sent(20e6, 50.0, complexity, 40.0);
            assert!(rate > 25.0 && delay < 150.0 && coding.quality >= 25, "{complexity}: {rate} {delay} {coding:?}");
        }
        let (rate, delay, _) = sent(5e6, 30.0, 1.0, 60.0);
        assert!(rate > 18.0 && delay < 250.0, "{rate} {delay}");
    }
}
