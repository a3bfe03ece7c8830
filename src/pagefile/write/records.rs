//! Gaussians as records of words, which are kept in temporary files until all Gaussians near them have come.

use anyhow::Result;

use crate::scene::{Gaussians, Parts, sh_coefficients};

/// Words of a record: the index in the scene, then mean, scale, rotation, opacity and spherical harmonics.
pub fn record_words(sh_degree: u32) -> usize {
    12 + 3 * sh_coefficients(sh_degree)
}

/// Appends the record of a Gaussian.
pub fn put_record(gaussians: &Gaussians, index: usize, id: u32, words: &mut Vec<u32>) {
    words.push(id);
    let floats = gaussians.means()[index].into_iter();
    let floats = floats.chain(gaussians.scales()[index]).chain(gaussians.rotations()[index]);
    words.extend(floats.chain([gaussians.opacities()[index]]).map(f32::to_bits));
    words.extend(gaussians.sh(index).as_flattened().iter().map(|value| value.to_bits()));
}

/// The mean in a record.
pub fn mean_of(record: &[u32]) -> [f32; 3] {
    std::array::from_fn(|axis| f32::from_bits(record[1 + axis]))
}

/// The Gaussians in records.
///
/// # Errors
/// If memory runs out, or the records are damaged.
pub fn gaussians_of(records: &[u32], sh_degree: u32) -> Result<Gaussians> {
    let each = record_words(sh_degree);
    let mut parts = Parts::new(sh_degree, records.len() / each)?;
    let stride = sh_coefficients(sh_degree);
    for (index, record) in records.chunks_exact(each).enumerate() {
        let float = |i: usize| f32::from_bits(record[i]);
        parts.means[index] = mean_of(record);
        parts.scales[index] = std::array::from_fn(|i| float(4 + i));
        parts.rotations[index] = std::array::from_fn(|i| float(7 + i));
        parts.opacities[index] = float(11);
        let sh = parts.sh[index * stride..][..stride].as_flattened_mut();
        sh.iter_mut().zip(&record[12..]).for_each(|(to, from)| *to = f32::from_bits(*from));
    }
    parts.finish()
}
