//! The words of a Gaussian in each of its planes.

/// Most planes of spherical harmonics: as many as shaders bind.
pub const SH_PLANES: usize = 12;

/// The words of a Gaussian in each plane, where each takes `words` words in all planes together. A plane has one
/// element of four words per Gaussian, or two if [`SH_PLANES`] planes are too few. In the last plane, four or two
/// Gaussians with one or two words share an element; three words are padded to four.
pub fn plane_widths(words: usize) -> impl Iterator<Item = usize> + Clone {
    let most = if words > 4 * SH_PLANES { 8 } else { 4 };
    (0..words.div_ceil(most)).map(move |plane| (words - most * plane).min(most).next_power_of_two())
}
