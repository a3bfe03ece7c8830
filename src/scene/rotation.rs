//! Unit quaternions as their three smallest components and the index of the largest; in 32 bits for SPZ and the GPU.

/// The unit quaternion whose component `largest` is positive and left out of `others`, which are in order.
pub(crate) fn from_smallest_three(largest: usize, others: [f64; 3]) -> [f64; 4] {
    let mut others = others.into_iter();
    let mut q: [f64; 4] = std::array::from_fn(|i| if i == largest { 0.0 } else { others.next().unwrap_or(0.0) });
    q[largest] = (1.0 - q.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    q
}

/// One step of a stored component.
const STEP: f32 = std::f32::consts::FRAC_1_SQRT_2 / 511.0;

/// Largest difference of a component of a rotation that was packed before: rounding in 32-bit floats.
pub(crate) const SAME: f64 = 1e-6;

/// A unit quaternion in 32 bits (the scheme of SPZ 3): two for the index of its largest component, which becomes
/// positive, and ten for each of the others, a sign and nine bits of magnitude up to sqrt(1/2).
pub fn encode_rotation(rotation: [f32; 4]) -> u32 {
    let magnitude = |i: usize| rotation[i].abs();
    let largest = (1..4).fold(0, |largest, i| if magnitude(i) > magnitude(largest) { i } else { largest });
    // The encoder that made a file rounded each stored component by up to half a step, which moves the left out one by
    // up to some three halves. So the component that it left out is less than three steps below the largest; the one
    // that gives the rotation back keeps the bits of the file. To leave out a smaller component is an error: the
    // squares of the others can exceed 1, and other decoders then take the root of a negative number.
    let is_near = |i: &usize| *i != largest && magnitude(*i) >= magnitude(largest) - 3.0 * STEP;
    let gives_back = |packed: &u32| rotation_error(decode_rotation(*packed), rotation) < SAME;
    let first = pack_smallest_three(rotation, largest);
    let mut others = (0..4).filter(is_near).map(|i| pack_smallest_three(rotation, i)).peekable();
    if others.peek().is_none() || gives_back(&first) { first } else { others.find(gives_back).unwrap_or(first) }
}

/// Packs a quaternion without component `largest`.
fn pack_smallest_three(rotation: [f32; 4], largest: usize) -> u32 {
    // A file may hold a zero with a sign.
    let flip = rotation[largest].is_sign_negative();
    let others = rotation.iter().enumerate().filter(|(i, _)| *i != largest);
    let packed = others.fold(0, |packed, (_, component)| {
        let steps = (f64::from(component.abs()) * 2_f64.sqrt() * 511.0).round().min(511.0) as u32;
        packed << 10 | u32::from(component.is_sign_negative() != flip) << 9 | steps
    });
    (largest as u32) << 30 | packed
}

/// The quaternion that [`encode_rotation`] packed, up to its sign and rounding.
pub fn decode_rotation(packed: u32) -> [f64; 4] {
    let largest = (packed >> 30) as usize;
    let component = |shift: u32| {
        let bits = packed >> shift & 1023;
        let magnitude = f64::from(bits & 511) / 511.0 * 0.5_f64.sqrt();
        if bits & 512 == 0 { magnitude } else { -magnitude }
    };
    from_smallest_three(largest, [20, 10, 0].map(component))
}

/// Largest difference of a component between two rotations. `q` and `-q` are the same rotation.
pub(crate) fn rotation_error(a: [f64; 4], b: [f32; 4]) -> f64 {
    let with = |sign: f64| a.iter().zip(b).map(|(a, b)| (a - sign * f64::from(b)).abs()).fold(0.0, f64::max);
    with(1.0).min(with(-1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_survive_their_32_bits() {
        // The second has a component of sqrt(1/2), as large as the one left out.
        for packed in [0, 0x1ff, 0x8123_4567, 0xc0ab_cd23_u32, 0x4000_0001] {
            let rotation = decode_rotation(packed).map(|v| v as f32);
            for rotation in [rotation, rotation.map(|v| -v)] {
                assert!(rotation_error(decode_rotation(encode_rotation(rotation)), rotation) < 1e-6, "{packed:x}");
            }
        }
        for rotation in [[0.5, -0.5, 0.5, 0.5], [0.1, -0.7, 0.7, 0.1], [0.600_66, -0.391_92, -0.000_69, 0.696_86]] {
            assert!(rotation_error(decode_rotation(encode_rotation(rotation)), rotation) < 1.5e-3);
        }
    }

    /// The encoder of the reference implementation, whatever it leaves out for nearly equal components.
    #[test]
    fn the_bits_of_a_file_are_kept() {
        let mut random = crate::scene::Random::of(1);
        for i in 0..200_000 {
            // Every other rotation has nearly equal components.
            let spread = [1.0, 0.005][i % 2];
            let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
            let q = [(); 4].map(|()| random.normal()).map(|v| (1.0 - spread) * sign(v) + spread * v);
            let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            let q = q.map(|v| (v / length) as f32);
            let largest = (1..4).fold(0, |largest, i| if q[i].abs() > q[largest].abs() { i } else { largest });
            let packed = pack_smallest_three(q, largest);
            assert_eq!(encode_rotation(decode_rotation(packed).map(|v| v as f32)), packed, "{q:?}");
        }
    }
}
