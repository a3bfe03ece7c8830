//! Polynomials of one variable, as coefficients from the constant term on: values, products, and the first root.

/// Value of a polynomial.
pub(super) fn value(polynomial: &[f64], x: f64) -> f64 {
    polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// Value and derivative of a polynomial.
pub(super) fn value_and_slope(polynomial: &[f64], x: f64) -> [f64; 2] {
    polynomial.iter().rev().fold([0.0; 2], |[value, slope], c| [value * x + c, slope * x + value])
}

pub(super) fn derivative(polynomial: &[f64]) -> Vec<f64> {
    polynomial.iter().enumerate().skip(1).map(|(power, coefficient)| power as f64 * coefficient).collect()
}

pub(super) fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; a.len() + b.len()];
    for (i, a) in a.iter().enumerate() {
        for (j, b) in b.iter().enumerate() {
            product[i + j] += a * b;
        }
    }
    product
}

/// `a + factor b`
pub(super) fn sum(a: &[f64], factor: f64, b: &[f64]) -> Vec<f64> {
    let at = |of: &[f64], i: usize| of.get(i).copied().unwrap_or(0.0);
    (0..a.len().max(b.len())).map(|i| at(a, i) + factor * at(b, i)).collect()
}

/// The first `x` in (0, `end`) at which a polynomial that is positive at 0 no longer is.
pub(super) fn first_root(polynomial: &[f64], end: f64) -> Option<f64> {
    roots(polynomial, end).into_iter().next()
}

/// The places in (0, `end`) where the sign of a polynomial changes. Between the roots of its derivative it is monotone.
fn roots(polynomial: &[f64], end: f64) -> Vec<f64> {
    let degree = polynomial.iter().rposition(|coefficient| *coefficient != 0.0).unwrap_or(0);
    if degree == 0 {
        return Vec::new();
    }
    let polynomial = &polynomial[..=degree];
    let mut borders = roots(&derivative(polynomial), end);
    borders.push(end);
    let (mut low, mut found) = (0.0, Vec::new());
    for high in borders {
        let is_positive = value(polynomial, low) > 0.0;
        if is_positive != (value(polynomial, high) > 0.0) {
            found.push(bisected(low, high, |x| (value(polynomial, x) > 0.0) == is_positive));
        }
        low = high;
    }
    found
}

/// The place between `low` and `high` up to which a condition holds, to the last bit.
pub(super) fn bisected(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return low;
        }
        match holds(middle) {
            true => low = middle,
            false => high = middle,
        }
    }
}

/// Relative size of a step of Newton's method that may be the rounding of a value.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// The place in (0, `end`) at which a growing function, given with its slope, has the value `wanted`: close below `end`
/// if it is less there. By Newton's method, and by bisection where a step leaves the interval or does not halve it.
pub(super) fn solved(end: f64, wanted: f64, function: impl Fn(f64) -> [f64; 2]) -> f64 {
    let ([mut low, mut high], mut last_step) = ([0.0, end], f64::INFINITY);
    let mut x = wanted.min(0.5 * end);
    loop {
        let [value, slope] = function(x);
        if value < wanted {
            low = x
        } else {
            high = x
        }
        let step = (wanted - value) / slope;
        let next = x + step;
        let comes_closer = step.abs() < 0.5 * last_step;
        // What is left is the rounding of the value. A bisection would begin anew.
        if step.abs() <= f64::EPSILON * x || !comes_closer && step.abs() <= ROUNDING * x {
            return x;
        }
        let is_newton = next > low && next < high && comes_closer;
        let next = if is_newton { next } else { 0.5 * (low + high) };
        last_step = (next - x).abs();
        // Rounding of the last step, or an interval without a number inside.
        if last_step <= f64::EPSILON * x || next <= low || next >= high {
            return x;
        }
        x = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growing_functions_are_solved_up_to_their_end() {
        // x - x^3 / 3 grows up to 1, where it is 2 / 3.
        let function = |x: f64| value_and_slope(&[0.0, 1.0, 0.0, -1.0 / 3.0], x);
        for wanted in [0.0, 1e-300, 1e-9, 0.1, 0.5, 0.66, 0.6666, 2.0 / 3.0 - 1e-12] {
            let (solved, bisected) = (solved(1.0, wanted, function), bisected(0.0, 1.0, |x| function(x)[0] < wanted));
            assert!((solved - bisected).abs() <= 1e-9 * bisected, "{wanted}: {solved} {bisected}");
            assert!((function(solved)[0] - wanted).abs() <= 4e-16 * wanted, "{wanted}");
        }
        for wanted in [0.7, 1e300, f64::INFINITY] {
            let solved = solved(1.0, wanted, function);
            assert!(solved < 1.0 && solved > 1.0 - 1e-12, "{wanted}: {solved}");
        }
    }

    #[test]
    fn roots_of_products_of_their_factors_are_found() {
        let places = [0.25, 0.26, 1.0, 3.5, 900.0];
        let whole = places.iter().fold(vec![1.0, 0.0, 0.5], |whole, x| product(&whole, &[1.0, -1.0 / x]));
        let found = roots(&whole, 1e6);
        assert_eq!(found.len(), places.len(), "{found:?}");
        for (found, place) in found.iter().zip(places) {
            assert!((found / place - 1.0).abs() < 1e-10, "{found} {place}");
        }
        assert_eq!(first_root(&whole, 0.2), None);
        assert_eq!(first_root(&[1.0, 0.0, 2.0, 0.0], 1e6), None);
        assert_eq!(first_root(&[1.0], 1e6), None);
    }
}
