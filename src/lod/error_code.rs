//! Codes of 16 bits for errors and opacities over many orders of magnitude: binary logarithms in steps of 1/512.

use std::sync::LazyLock;

/// Codes per power of two.
pub const CODES_PER_OCTAVE: f64 = 512.0;
/// The power of two of code 0, which itself stands for 0.
pub const LOWEST_EXPONENT: f64 = -64.0;
/// The code of 0: the error of a Gaussian of the scene.
pub const FINEST: u16 = 0;
/// The code of an error that is within no limit.
pub const NEVER: u16 = u16::MAX;

/// The nearest code of a positive number; [`FINEST`] for all others.
pub fn code_of(value: f64) -> u16 {
    if value > 0.0 { steps(value).round().clamp(1.0, f64::from(NEVER - 1)) as u16 } else { FINEST }
}

/// The largest code whose value is not above this one, but not [`NEVER`].
pub fn code_below(value: f64) -> u16 {
    if value > 0.0 { steps(value).floor().clamp(0.0, f64::from(NEVER - 1)) as u16 } else { FINEST }
}

/// The number of a code.
pub fn value_of_code(code: u16) -> f64 {
    static VALUES: LazyLock<Vec<f64>> = LazyLock::new(|| {
        let value = |code: u16| {
            if code == FINEST { 0.0 } else { (f64::from(code) / CODES_PER_OCTAVE + LOWEST_EXPONENT).exp2() }
        };
        (0..=u16::MAX).map(value).collect()
    });
    VALUES[usize::from(code)]
}

fn steps(value: f64) -> f64 {
    (value.log2() - LOWEST_EXPONENT) * CODES_PER_OCTAVE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_keep_three_digits_and_the_order() {
        assert_eq!([code_of(0.0), code_of(-1.0), code_of(f64::NAN)], [FINEST; 3]);
        assert_eq!([code_of(1e-300), code_of(1e300), code_below(1e300)], [1, NEVER - 1, NEVER - 1]);
        let mut before = 0;
        for exponent in -60..60 {
            for part in [1.0, 1.3, 1.7] {
                let number = part * f64::from(exponent).exp2();
                let own = code_of(number);
                assert!((value_of_code(own) / number - 1.0).abs() < 7e-4 && own > before, "{number}");
                assert!(value_of_code(code_below(number)) <= number * (1.0 + 1e-12), "{number}");
                before = own;
            }
        }
    }
}
