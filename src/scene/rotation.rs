//! Unit quaternions in few bits: the three smallest components, and which one is left out.

/// The quaternion of unit length with these components, in their order, around the largest, which is positive.
pub(super) fn from_smallest_three(largest: usize, others: [f64; 3]) -> [f64; 4] {
    let mut others = others.into_iter();
    let mut q: [f64; 4] = std::array::from_fn(|i| if i == largest { 0.0 } else { others.next().unwrap_or(0.0) });
    q[largest] = (1.0 - q.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    q
}

/// A unit quaternion in 32 bits: two for its largest component, made positive, and ten, a sign and nine of magnitude up to
/// sqrt(1/2), for each of the others (the scheme of SPZ 3).
pub fn encode_rotation(rotation: [f32; 4]) -> u32 {
    // Where two components are nearly the largest, a file may have chosen either.
    let error = |packed: &u32| rotation_error(decode_rotation(*packed), rotation);
    let candidates = (0..4).map(|largest| encode_around(rotation, largest));
    candidates.min_by(|a, b| error(a).total_cmp(&error(b))).unwrap_or(0)
}

fn encode_around(rotation: [f32; 4], largest: usize) -> u32 {
    let flip = rotation[largest] < 0.0;
    let others = rotation.iter().enumerate().filter(|(i, _)| *i != largest);
    let packed = others.fold(0, |packed, (_, component)| {
        let steps = (f64::from(component.abs()) * 2_f64.sqrt() * 511.0).round().min(511.0) as u32;
        packed << 10 | u32::from((*component < 0.0) != flip) << 9 | steps
    });
    (largest as u32) << 30 | packed
}

/// What [`encode_rotation`] kept.
pub fn decode_rotation(packed: u32) -> [f64; 4] {
    let largest = (packed >> 30) as usize;
    let component = |shift: u32| {
        let bits = packed >> shift & 1023;
        let magnitude = f64::from(bits & 511) / 511.0 * 0.5_f64.sqrt();
        if bits & 512 == 0 { magnitude } else { -magnitude }
    };
    from_smallest_three(largest, [20, 10, 0].map(component))
}

/// The largest difference of a component, whichever of the two quaternions of a rotation is meant.
pub(super) fn rotation_error(a: [f64; 4], b: [f32; 4]) -> f64 {
    let with = |sign: f64| a.iter().zip(b).map(|(a, b)| (a - sign * f64::from(b)).abs()).fold(0.0, f64::max);
    with(1.0).min(with(-1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_survive_their_32_bits() {
        // The second has a component of sqrt(1/2) beside the one left out.
        for packed in [0, 0x1ff, 0x8123_4567, 0xc0ab_cdef_u32, 0x4000_0001] {
            let rotation = decode_rotation(packed).map(|v| v as f32);
            for rotation in [rotation, rotation.map(|v| -v)] {
                assert!(rotation_error(decode_rotation(encode_rotation(rotation)), rotation) < 1e-6, "{packed:x}");
            }
        }
        for rotation in [[0.5, -0.5, 0.5, 0.5], [0.1, -0.7, 0.7, 0.1]] {
            assert!(rotation_error(decode_rotation(encode_rotation(rotation)), rotation) < 1.5e-3);
        }
    }
}
