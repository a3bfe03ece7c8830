//! Parsers of the values of options, with one message for each kind.

use std::ops::RangeInclusive;

use anyhow::{Context, Result, ensure};

use crate::camera::MAX_SIDE;
use crate::quantities;

/// Parses a whole number in a range, like 500 or 60K.
pub(super) fn whole<T: TryFrom<u64> + Clone>(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<T> + Clone {
    move |text| {
        let number = quantities::count(text).filter(|number| range.contains(number));
        number.and_then(|number| T::try_from(number).ok()).with_context(|| {
            let (low, high) = (range.start(), range.end());
            let example = if *high >= 1000 { ", like 500 or 60K" } else { "" };
            format!("expected a whole number from {low} to {high}{example}")
        })
    }
}

/// Parses a number in a range.
pub(super) fn number(range: RangeInclusive<f64>) -> impl Fn(&str) -> Result<f64> + Clone {
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.with_context(|| format!("expected a number from {} to {}", range.start(), range.end()))
    }
}

/// Largest error of colour values that a limit may allow. Colours brighter than white have errors above 1.
pub(super) const MOST_ERROR: f64 = 1e6;

/// Parses an error of colour values up to `most`, as a number or as steps of 8 bits.
pub(super) fn error(most: f64) -> impl Fn(&str) -> Result<f64> + Clone {
    move |text| {
        let error = quantities::fraction(text).filter(|error| (0.0..=most).contains(error));
        error.with_context(|| format!("expected a number from 0 to {most}, or steps of 8 bits like 2/255"))
    }
}

/// Parses a PSNR.
pub(super) fn decibels(text: &str) -> Result<f64> {
    let db = text.parse().ok().filter(|db| (f64::MIN_POSITIVE..1000.0).contains(db));
    db.context("expected a PSNR in dB, above 0 and below 1000")
}

/// Parses a size of memory. Nothing can be drawn or sorted in less than a megabyte: the unit is missing.
pub(super) fn memory(text: &str) -> Result<u64> {
    let bytes = quantities::bytes(text).context("expected a size like 4GB, 1.5GB or 700MiB")?;
    ensure!(bytes >= 1_000_000, "{bytes} bytes are too few: write a unit, like 4GB or 700MiB");
    Ok(bytes)
}

/// Parses `WIDTHxHEIGHT` in pixels.
pub(super) fn size(text: &str) -> Result<[u32; 2]> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let size = sides.filter(|sides| sides.iter().all(|side| (1..=MAX_SIDE).contains(side)));
    size.with_context(|| format!("expected WIDTHxHEIGHT in pixels, like 1280x720, each from 1 to {MAX_SIDE}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_or_refused_in_a_sentence() {
        assert_eq!(whole::<u16>(1..=60_000)("60K").unwrap(), 60_000);
        let refused = |outcome: Result<u16>| outcome.unwrap_err().to_string();
        assert_eq!(refused(whole(3..=4)("5")), "expected a whole number from 3 to 4");
        assert_eq!(refused(whole(1..=1000)("x")), "expected a whole number from 1 to 1000, like 500 or 60K");
        assert_eq!(error(1.0)("4/255").unwrap(), 4.0 / 255.0);
        assert!(error(1.0)("-0.1").is_err() && error(1.0)("300/255").is_err());
        assert_eq!(memory("2GB").unwrap(), 2_000_000_000);
        assert_eq!(memory("2048").unwrap_err().to_string(), "2048 bytes are too few: write a unit, like 4GB or 700MiB");
        assert!(decibels("0").is_err() && decibels("nan").is_err() && decibels("50").is_ok());
    }
}
