//! Finds the values of a Gaussian in a vertex.

use anyhow::{Context, Result};

use super::dialects;
use super::header::{Element, Property, Scalar};
use crate::scene::harmonics::C0;
use crate::scene::{Activated, MAX_SH_DEGREE, Raw, rest_values};

/// Rows of which [`Layout::doubts`] looks at the values, and the least number that it judges.
const SAMPLE: usize = 4096;
const LEAST_SAMPLE: usize = 100;

/// The properties of a vertex that hold the values of a Gaussian.
pub(crate) struct Layout<'e> {
    mean: [&'e Property; 3],
    /// Three, or two for a surfel, which is flat along the third axis.
    pub scale: Vec<&'e Property>,
    rotation: [&'e Property; 4],
    opacity: &'e Property,
    /// The smoothing filter of Mip-Splatting, if it is not fused into scales and opacities.
    filter: Option<&'e Property>,
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
    /// # Errors
    /// If a property is missing. The error says why the element is not taken for points.
    pub fn of(element: &'e Element) -> Result<Self> {
        Self::complete(element).with_context(|| match (dialects::foreign(element), dialects::hint(element)) {
            (Some(foreign), _) => foreign,
            (None, hint) => format!("it has {}, as Gaussians have", hint.unwrap_or("properties")),
        })
    }

    fn complete(element: &'e Element) -> Result<Self> {
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
            filter: element.property("filter_3D").ok(),
            colour: Colour::of(element)?,
            rest: rest.iter().map(|name| element.property(name)).collect::<Result<_>>()?,
            sh_degree,
        })
    }

    pub fn gaussian(&self, row: &[u8]) -> Activated {
        let log_scale = |axis: usize| self.scale.get(axis).map_or(f64::NEG_INFINITY, |p| p.read(row));
        let opacity = self.opacity.read(row);
        let mut gaussian = Activated::from(Raw {
            mean: self.mean.map(|p| p.read(row)),
            log_scale: [0, 1, 2].map(log_scale),
            rotation: self.rotation.map(|p| p.read(row)),
            opacity_logit: opacity,
        });
        // As mesh2splat writes opacities in bytes.
        if let Some(one) = self.opacity.kind.one() {
            gaussian.opacity = opacity / one;
        }
        if let Some(filter) = self.filter {
            smooth(&mut gaussian, filter.read(row), self.scale.len());
        }
        gaussian
    }

    /// Notes on how the values are read.
    pub fn notices(&self) -> Vec<String> {
        let flat = (self.scale.len() == 2).then_some("it has two scales, and is drawn as flat Gaussians");
        let filter = "its filter_3D, the smoothing filter of Mip-Splatting, is applied to scales and opacities";
        let all = [flat, self.filter.map(|_| filter)];
        all.into_iter().flatten().map(str::to_owned).collect()
    }

    /// Notes on values that look as if they were activated already. Readers take all files alike, because no header
    /// says which values it holds: opacities as pixelSplat writes them look like faint logits.
    pub fn doubts(&self, rows: &[u8], stride: usize) -> Vec<String> {
        let step = (rows.len() / stride / SAMPLE).max(1);
        let rows = || rows.chunks_exact(stride).step_by(step);
        let are = |properties: &[&Property], is: fn(f64) -> bool| {
            let values = rows().flat_map(|row| properties.iter().map(|p| p.read(row))).filter(|v| v.is_finite());
            let (count, like) = values.fold((0, 0), |(count, like), v| (count + 1, like + usize::from(is(v))));
            count >= LEAST_SAMPLE && 200 * like >= 199 * count
        };
        let opacities = self.opacity.kind.one().is_none() && are(&[self.opacity], |v| (0.0..=1.0).contains(&v));
        let opacities = opacities.then(|| {
            "its opacities lie between 0 and 1 as if they were no logits, and are read as logits all the same"
                .to_owned()
        });
        let scales = are(&self.scale, |v| v > 0.0 && v <= 1.0).then(|| {
            "its scales lie between 0 and 1 as if they were no logarithms, and are read as logarithms all the same"
                .to_owned()
        });
        opacities.into_iter().chain(scales).collect()
    }
}

/// Widens a Gaussian by a filter in world units, and lowers its opacity so that its integral stays the same
/// (the 3D smoothing filter of Mip-Splatting, Yu et al. 2024). A surfel is widened in its plane.
fn smooth(gaussian: &mut Activated, filter: f64, axes: usize) {
    for scale in &mut gaussian.scale[..axes] {
        let wide = scale.hypot(filter);
        gaussian.opacity *= if wide == 0.0 { 1.0 } else { *scale / wide };
        *scale = wide;
    }
}

impl<'e> Colour<'e> {
    pub fn of(element: &'e Element) -> Result<Self> {
        if !element.has("f_dc_0")
            && let Some(channels) = Self::channels(element)?
        {
            let most = match channels[0].kind {
                Scalar::F32 | Scalar::F64 => 1.0,
                kind => kind.one().unwrap_or(255.0),
            };
            return Ok(Self::Channels(channels, most));
        }
        Ok(Self::Coefficients(all(element, ["f_dc_0", "f_dc_1", "f_dc_2"])?))
    }

    /// The properties of red, green and blue, by their usual names or those of Brush or Blender.
    pub fn channels(element: &'e Element) -> Result<Option<[&'e Property; 3]>> {
        let names = [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];
        let named = names.into_iter().find(|[red, ..]| element.has(red));
        named.map(|names| all(element, names)).transpose()
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
