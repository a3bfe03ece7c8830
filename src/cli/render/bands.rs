//! Pictures in bands: which views devices draw band by band, and how their bands become one picture.

use std::collections::HashMap;
use std::sync::{Condvar, Mutex, MutexGuard};

use crate::cli::one_of;
use crate::gpu::Timing;
use crate::pixels::{Integers, Pixels};
use crate::render::{BAND_ROWS, Band, Frame, HostFrame, SlabReport, Totals};

/// How several devices share the work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Share {
    /// Whole views, and bands where that pays.
    #[default]
    Auto,
    /// Bands of every view.
    Frame,
    /// Whole views.
    Views,
}

const SHARES: [(&str, &str, Share); 3] = [
    ("auto", "Whole views; bands of a page file of 50 million Gaussians if views are fewer than devices", Share::Auto),
    ("frame", "Bands of every picture", Share::Frame),
    ("views", "Whole views", Share::Views),
];

/// The parser of `--share`.
pub(crate) fn parse_share() -> impl clap::builder::TypedValueParser<Value = Share> {
    one_of(SHARES)
}

/// Pixels of a band of a large picture. Bands are copied while others are drawn.
const BAND_PIXELS: u64 = 4_000_000;

/// Bands of each device of a picture: more even work than with one, at the cost of more culls of the scene.
const BANDS_EACH: u64 = 4;

/// The bands of a view that this number of devices draw; empty if one draws it as a whole.
pub(super) fn bands_of(size: [u32; 2], devices: usize) -> Vec<Band> {
    if devices == 1 && !Band::is_needed(size) {
        return Vec::new();
    }
    let pixels = size.iter().map(|side| u64::from(*side)).product::<u64>();
    let for_devices = if devices > 1 { BANDS_EACH * devices as u64 } else { 1 };
    let bands = pixels.div_ceil(BAND_PIXELS).max(for_devices);
    let rows = u64::from(size[1]).div_ceil(bands).next_multiple_of(BAND_ROWS.into()) as u32;
    let borders = Vec::from_iter((rows..size[1]).step_by(rows as usize));
    if borders.is_empty() { Vec::new() } else { Band::between(&borders, size[1]) }
}

/// The pixels of a picture, in consecutive parts of whole rows.
#[derive(Default)]
pub(super) struct Parts {
    integers: Vec<(Integers, Vec<Vec<u8>>)>,
    floats: Vec<[f32; 4]>,
    depths: Vec<[f32; 4]>,
}

/// The bands of pictures that are not written.
pub(super) struct Bands {
    incomplete: Mutex<HashMap<usize, Vec<HostBand>>>,
    /// The number of complete pictures that are not written, and the most of them before devices wait.
    complete: Mutex<usize>,
    most: usize,
    written: Condvar,
}

/// A band of a picture: its frames, as far as they were drawn, and its pixels.
type HostBand = (Band, Vec<Frame>, Parts);

/// A complete picture. When it is dropped, there is room for another.
pub(super) struct Complete<'b> {
    pub frames: Vec<Frame>,
    pub parts: Parts,
    bands: &'b Bands,
}

impl Drop for Complete<'_> {
    fn drop(&mut self) {
        *self.bands.complete() -= 1;
        self.bands.written.notify_all();
    }
}

impl Bands {
    /// `most` is the number of complete pictures in host memory.
    pub fn new(most: usize) -> Self {
        Self { incomplete: Mutex::default(), complete: Mutex::new(0), most, written: Condvar::new() }
    }

    /// True if devices may draw more bands. If a device `waits`, it waits for that.
    pub fn have_room(&self, waits: bool) -> bool {
        let is_full = |complete: &mut usize| *complete >= self.most;
        if waits {
            drop(self.written.wait_while(self.complete(), is_full).expect(PANICKED));
            return true;
        }
        !is_full(&mut self.complete())
    }

    /// Takes over a band of the view `number`, whose picture has so many rows. Returns the picture if that was its last
    /// band.
    pub fn add(
        &self,
        (number, height): (usize, u32),
        band: Band,
        frames: Vec<Frame>,
        host: &mut HostFrame,
    ) -> Option<Complete<'_>> {
        let part = Parts::of(host);
        let mut pictures = self.incomplete.lock().expect(PANICKED);
        let drawn = pictures.entry(number).or_default();
        drawn.push((band, frames, part));
        let rows: u32 = drawn.iter().map(|(band, ..)| band.rows).sum();
        if rows < height {
            return None;
        }
        let mut drawn = pictures.remove(&number)?;
        drop(pictures);
        *self.complete() += 1;
        drawn.sort_unstable_by_key(|(band, ..)| band.top);
        let (mut frames, mut parts) = (Vec::new(), Parts::default());
        for (_, of_band, part) in drawn {
            frames.push(of_band);
            parts.append(part);
        }
        Some(Complete { frames: joined(&frames), parts, bands: self })
    }

    fn complete(&self) -> MutexGuard<'_, usize> {
        self.complete.lock().expect(PANICKED)
    }
}

const PANICKED: &str = "no holder of the bands panics";

impl Parts {
    fn of(host: &mut HostFrame) -> Self {
        let all = [Integers::Rgb8, Integers::Rgb16, Integers::Grey8, Integers::Grey16];
        let integers = all.into_iter().filter_map(|kind| Some((kind, vec![host.integers(kind)?.to_vec()]))).collect();
        let floats = host.picture().map_or_else(Vec::new, |pixels| pixels.rgba);
        Self { integers, floats, depths: host.depths().map_or_else(Vec::new, |pixels| pixels.rgba) }
    }

    fn append(&mut self, below: Self) {
        for (kind, parts) in below.integers {
            match self.integers.iter_mut().find(|(known, _)| *known == kind) {
                Some((_, above)) => above.extend(parts),
                None => self.integers.push((kind, parts)),
            }
        }
        self.floats.extend(below.floats);
        self.depths.extend(below.depths);
    }

    /// The bytes of the picture as integers, if it has them.
    pub fn integers(&self, integers: Integers) -> Option<Vec<&[u8]>> {
        let (_, parts) = self.integers.iter().find(|(kind, _)| *kind == integers)?;
        Some(parts.iter().map(Vec::as_slice).collect())
    }

    /// The picture as floats, if it has them.
    pub fn picture(&mut self, size: [u32; 2]) -> Option<Pixels> {
        (!self.floats.is_empty()).then(|| Pixels { size, rgba: std::mem::take(&mut self.floats) })
    }

    /// The input of [`depths`](crate::render::depths), if it has one.
    pub fn depths(&mut self, size: [u32; 2]) -> Option<Pixels> {
        (!self.depths.is_empty()).then(|| Pixels { size, rgba: std::mem::take(&mut self.depths) })
    }
}

/// The reports of a view from those of its bands: sums, the longest list, and the most attempts of a band.
fn joined(bands: &[Vec<Frame>]) -> Vec<Frame> {
    let mut bands = bands.iter();
    let mut whole = bands.next().cloned().unwrap_or_default();
    for band in bands {
        for (sum, frame) in whole.iter_mut().zip(band) {
            add(sum, frame);
        }
    }
    whole
}

fn add(sum: &mut Frame, band: &Frame) {
    let listed = |totals: &Totals| u64::from(totals.listed_high) << 32 | u64::from(totals.listed_low);
    let all = listed(&sum.totals) + listed(&band.totals);
    let (into, from) = (&mut sum.totals, &band.totals);
    into.visible = into.visible.saturating_add(from.visible);
    into.visible_kept = into.visible_kept.saturating_add(from.visible_kept);
    into.spans = into.spans.saturating_add(from.spans);
    into.listed_kept = into.listed_kept.saturating_add(from.listed_kept);
    (into.listed_low, into.listed_high) = (all as u32, (all >> 32) as u32);
    into.longest_list = into.longest_list.max(from.longest_list);
    sum.attempts = sum.attempts.max(band.attempts);
    for timing in &band.timings {
        match sum.timings.iter_mut().find(|known| (known.name, known.depth) == (timing.name, timing.depth)) {
            Some(Timing { duration_ms, .. }) => *duration_ms += timing.duration_ms,
            None => sum.timings.push(timing.clone()),
        }
    }
    sum.parts = match (sum.parts, band.parts) {
        (Some(above), Some(below)) => Some(SlabReport {
            slabs: above.slabs.max(below.slabs),
            wall_ms: above.wall_ms + below.wall_ms,
            pages_in_view: above.pages_in_view + below.pages_in_view,
            pages_read: above.pages_read + below.pages_read,
            bytes_read: above.bytes_read + below.bytes_read,
        }),
        (above, below) => above.or(below),
    };
    if let (Some(above), Some(below)) = (&mut sum.detail, &band.detail) {
        above.pages += below.pages;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_device_draws_only_large_pictures_in_bands() {
        let count = |size, devices| bands_of(size, devices).len();
        let (full_hd, dome) = ([1920, 1080], [16384, 8192]);
        assert_eq!([1, 2, 4].map(|devices| count(full_hd, devices)), [0, 6, 9]);
        assert_eq!([1, 2, 4].map(|devices| count(dome, devices)), [32; 3]);
        assert_eq!([1, 2].map(|devices| count([7680, 4320], devices)), [9; 2]);
        assert_eq!([1, 2].map(|devices| count([5120, 4096], devices)), [0, 8]);
        assert_eq!(count([500, 64], 2), 0, "it is one row of bins");
        let (fits, too_many) = ([90 * 64, 80 * 64], [5430, 5430]);
        assert_eq!([fits, too_many].map(|size| count(size, 1)), [0, 8], "85 by 85 bins are more than 7200");
        for size in [dome, full_hd, [100, 30_000], [9000, 3333], [64, 65]] {
            for devices in [1, 2, 3, 8] {
                let bands = bands_of(size, devices);
                let rows: u32 = bands.iter().map(|band| band.rows).sum();
                assert!(bands.is_empty() || rows == size[1], "{bands:?}");
                assert!(bands.iter().all(|band| band.top.is_multiple_of(BAND_ROWS) && band.rows > 0));
            }
        }
    }
}
