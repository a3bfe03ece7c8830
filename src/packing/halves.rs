//! Numbers in 16 bits: floats, and scales.

use half::f16;

/// The exponent and the upper 10 bits of the mantissa of a float that is not negative, rounded to the nearest even
/// finite value.
pub fn upper_bits(value: f32) -> u32 {
    let bits = value.to_bits();
    ((bits + 0xfff + (bits >> 13 & 1)) >> 13).min(f32::MAX.to_bits() >> 13)
}

/// A scale in 16 bits without sign: 6 bits of exponent and 10 of mantissa, as precise as a 16-bit float over twice as
/// many octaves. 0 stands for 0.
pub fn scale_code(base: u32, scale: f32) -> u32 {
    upper_bits(scale).saturating_sub(base)
}

/// The scale of a [`scale_code`].
pub fn of_scale_code(base: u32, code: u32) -> f32 {
    if code == 0 { 0.0 } else { f32::from_bits((code + base) << 13) }
}

/// The nearest value in the range of finite 16-bit floats.
pub fn finite_half(value: f32) -> f32 {
    const MOST: f32 = f16::MAX.to_f32_const();
    value.clamp(-MOST, MOST)
}

/// The nearest finite 16-bit float.
pub fn half(value: f32) -> f16 {
    f16::from_f32(finite_half(value))
}

/// Two 16-bit floats in one word.
pub fn halves(values: [f32; 2]) -> u32 {
    joined(values.map(half))
}

pub fn joined([low, high]: [f16; 2]) -> u32 {
    u32::from(low.to_bits()) | u32::from(high.to_bits()) << 16
}

/// The two 16-bit floats of a word.
pub fn separated(word: u32) -> [f32; 2] {
    [word as u16, (word >> 16) as u16].map(|bits| f16::from_bits(bits).to_f32())
}
