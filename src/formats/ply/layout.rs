//! Finds the values of a Gaussian in a vertex.

use anyhow::{Context, Result};

use super::header::{Element, Property, Scalar};
use crate::scene::harmonics::C0;
use crate::scene::{MAX_SH_DEGREE, Raw, rest_values};

/// The properties of a vertex that hold the values of a Gaussian.
pub(crate) struct Layout<'e> {
    mean: [&'e Property; 3],
    /// Three, or two for a surfel, which is flat along the third axis.
    pub scale: Vec<&'e Property>,
    rotation: [&'e Property; 4],
    opacity: &'e Property,
    pub colour: Colour<'e>,
    /// Coefficients of degrees 1 and up, channel-major: all red, all green, all blue.
    pub rest: Vec<&'e Property>,
    pub sh_degree: u32,
}

/// The properties of a vertex that hold its colour.
#[derive(Clone, Copy)]
pub(crate) enum Colour<'e> {
    /// Coefficients of degree 0.
    Coefficients([&'e Property; 3]),
    /// Red, green and blue, and their largest value.
    Channels([&'e Property; 3], f64),
}

impl<'e> Layout<'e> {
    pub fn of(element: &'e Element) -> Result<Self> {
        let rest_count = element.run("f_rest_");
        let sh_degree = (0..=MAX_SH_DEGREE).find(|d| rest_values(*d) == rest_count);
        let sh_degree = sh_degree.with_context(|| {
            format!("there are {rest_count} f_rest properties; 0, 9, 24, 45 or 72 make SH degree 0, 1, 2, 3 or 4")
        })?;
        let rest: Vec<String> = (0..rest_count).map(|i| format!("f_rest_{i}")).collect();
        let scales = ["scale_0", "scale_1", "scale_2"];
        let axes = if element.has("scale_0") && !element.has("scale_2") { 2 } else { 3 };
        Ok(Self {
            mean: all(element, ["x", "y", "z"])?,
            scale: scales[..axes].iter().map(|name| element.property(name)).collect::<Result<_>>()?,
            rotation: all(element, ["rot_0", "rot_1", "rot_2", "rot_3"])?,
            opacity: element.property("opacity")?,
            colour: Colour::of(element)?,
            rest: rest.iter().map(|name| element.property(name)).collect::<Result<_>>()?,
            sh_degree,
        })
    }

    pub fn raw(&self, row: &[u8]) -> Raw {
        let scale = |axis: usize| self.scale.get(axis).map_or(f64::NEG_INFINITY, |p| p.read(row));
        Raw {
            mean: self.mean.map(|p| p.read(row)),
            log_scale: [0, 1, 2].map(scale),
            rotation: self.rotation.map(|p| p.read(row)),
            opacity_logit: self.opacity.read(row),
        }
    }
}

impl<'e> Colour<'e> {
    pub fn of(element: &'e Element) -> Result<Self> {
        if !element.has("f_dc_0") && element.has("red") {
            let channels = all(element, ["red", "green", "blue"])?;
            let most = match channels[0].kind {
                Scalar::F32 | Scalar::F64 => 1.0,
                Scalar::U16 => 65535.0,
                _ => 255.0,
            };
            return Ok(Self::Channels(channels, most));
        }
        Ok(Self::Coefficients(all(element, ["f_dc_0", "f_dc_1", "f_dc_2"])?))
    }

    /// The colour as coefficients of degree 0.
    pub fn read(self, row: &[u8]) -> [f32; 3] {
        match self {
            Self::Coefficients(coefficients) => coefficients.map(|p| p.read_f32(row)),
            Self::Channels(channels, most) => channels.map(|p| ((p.read(row) / most - 0.5) / C0) as f32),
        }
    }
}

/// The properties with these names.
pub(crate) fn all<'e, const N: usize>(element: &'e Element, names: [&str; N]) -> Result<[&'e Property; N]> {
    let properties: Vec<_> = names.iter().map(|name| element.property(name)).collect::<Result<_>>()?;
    Ok(std::array::from_fn(|i| properties[i]))
}
