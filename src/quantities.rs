//! Numbers as people write them: counts like 60K, sizes like 4GB, fractions like 2/255.

/// A whole number, optionally with K, M or G for powers of 1000: 60000, 60_000, 60K, 1.5M.
pub fn count(text: &str) -> Option<u64> {
    let (number, factor) = match text.char_indices().next_back()? {
        (at, 'K' | 'k') => (&text[..at], 1e3),
        (at, 'M' | 'm') => (&text[..at], 1e6),
        (at, 'G' | 'g') => (&text[..at], 1e9),
        _ => (text, 1.0),
    };
    scaled(number, factor).filter(|count| count.fract() == 0.0).map(|count| count as u64)
}

/// A number of bytes with a unit of powers of 1000, like MB, or of 1024, like MiB; without a unit, bytes.
pub fn bytes(text: &str) -> Option<u64> {
    let digits = text.find(|c: char| !(c.is_ascii_digit() || c == '.' || c == '_')).unwrap_or(text.len());
    let factor = match text[digits..].trim().to_lowercase().as_str() {
        "" | "b" => 1.0,
        "kb" | "k" => 1e3,
        "mb" | "m" => 1e6,
        "gb" | "g" => 1e9,
        "tb" | "t" => 1e12,
        "kib" => 1024.0,
        "mib" => 1024.0 * 1024.0,
        "gib" => 1024.0 * 1024.0 * 1024.0,
        _ => return None,
    };
    scaled(&text[..digits], factor).map(|bytes| bytes as u64)
}

/// A number, or one number divided by another, like 2/255.
pub fn fraction(text: &str) -> Option<f64> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let fraction = match text.split_once('/') {
        Some((above, below)) => number(above)? / number(below)?,
        None => number(text)?,
    };
    fraction.is_finite().then_some(fraction)
}

/// A product that a float holds exactly if it is a whole number.
fn scaled(number: &str, factor: f64) -> Option<f64> {
    const EXACT: f64 = (1_u64 << 53) as f64;
    let is_number = number.chars().all(|c| c.is_ascii_digit() || c == '.' || c == '_');
    let number: f64 = number.replace('_', "").parse().ok().filter(|_| is_number)?;
    Some(number * factor).filter(|product| *product <= EXACT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_are_numbers_with_units() {
        for (text, expected) in
            [("60K", 60_000), ("60k", 60_000), ("1.5M", 1_500_000), ("3M", 3_000_000), ("2G", 2_000_000_000)]
        {
            assert_eq!(count(text), Some(expected), "{text}");
        }
        assert_eq!([count("0"), count("60_000")], [Some(0), Some(60_000)]);
        for text in ["", "K", "-1", "1e3", "1.5", "60KB", "x", "1.0001K", "1 K", "99999999999999999999"] {
            assert_eq!(count(text), None, "{text}");
        }
        for (text, expected) in [("4GB", 4_000_000_000), ("1.5 gb", 1_500_000_000), ("700MiB", 700 << 20), ("64", 64)] {
            assert_eq!(bytes(text), Some(expected), "{text}");
        }
        for text in ["", "GB", "-5MB", "4XB", "1e3"] {
            assert_eq!(bytes(text), None, "{text}");
        }
        assert_eq!([fraction("0.02"), fraction("2/255")], [Some(0.02), Some(2.0 / 255.0)]);
        for text in ["", "nan", "1/0", "2/", "x", "inf"] {
            assert_eq!(fraction(text), None, "{text}");
        }
    }
}
