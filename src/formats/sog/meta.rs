//! Parses `meta.json`: the names of the textures, and the meaning of their bytes.

use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;

use super::texture::Bounds;
use crate::scene::{USUAL_SH_DEGREE, sh_coefficients};

/// Largest `meta.json` in bytes.
pub(crate) const MAX_BYTES: u64 = 1 << 24;
/// Palette entries in a row of the texture that holds them.
const ENTRIES: u32 = 64;
/// Texels of the palette texture: at most the entries that 16-bit labels can name.
pub(crate) const CENTROIDS: Bounds = Bounds { least: 1, most: 65536 * (sh_coefficients(USUAL_SH_DEGREE) as u64 - 1) };

/// The value of each byte.
pub(crate) type Table = [f32; 256];

pub(crate) struct Meta {
    pub version: u32,
    pub count: usize,
    pub is_antialiased: bool,
    /// Smallest and largest coordinate of each axis, as sign(x) ln(1 + |x|).
    pub means: [[f64; 2]; 3],
    pub log_scales: [Table; 3],
    /// Coefficients of degree 0.
    pub colours: [Table; 3],
    pub opacity_logits: [f64; 256],
    pub palette: Option<Palette>,
    /// Low bytes of means, high bytes, scales, rotations, colours.
    files: [String; 5],
}

/// The palette of the coefficients of degrees 1 and up: entries that Gaussians share.
pub(crate) struct Palette {
    /// Number of entries; by default as many as fit into the texture.
    pub count: Option<usize>,
    /// The SH degree that the file states; by default the width of the texture defines it.
    degree: Option<u32>,
    pub values: Table,
    pub centroids: String,
    labels: String,
}

impl Meta {
    pub fn parse(json: &[u8]) -> Result<Self> {
        let written: Written = serde_json::from_slice(json).context("meta.json is not that of a SOG scene")?;
        let version = written.version.unwrap_or(1);
        ensure!((1..=2).contains(&version), "SOG version {version} is not supported, only 1 and 2");
        let count = written.count.or(written.means.shape.first().copied());
        let count = count.context("meta.json does not say how many Gaussians there are")?;
        let Means { mins, maxs, files: [low, high], .. } = written.means;
        let alphas =
            if written.sh0.codebook.is_none() { Some(written.sh0.range(3).context("sh0 in meta.json")?) } else { None };
        let ([scales], [quats], [sh0]) = (&written.scales.files, &written.quats.files, &written.sh0.files);
        let files = [low, high, scales.clone(), quats.clone(), sh0.clone()];
        Ok(Self {
            version,
            count: usize::try_from(count)?,
            is_antialiased: written.antialias,
            means: std::array::from_fn(|axis| [mins[axis], maxs[axis]]),
            log_scales: written.scales.tables("scales")?,
            colours: written.sh0.tables("sh0")?,
            opacity_logits: std::array::from_fn(|byte| match alphas {
                Some([min, max]) => min + (max - min) * byte as f64 / 255.0,
                None => (byte as f64 / (255 - byte) as f64).ln(),
            }),
            palette: written.sh_n.map(WrittenPalette::palette).transpose()?.flatten(),
            files,
        })
    }

    pub fn format(&self) -> String {
        format!("SOG {}", self.version)
    }

    /// The files of all textures with bounds on their size: low bytes of means, high bytes, scales, rotations, colours,
    /// and, if there is a palette, its entries and labels.
    pub fn textures(&self) -> impl Iterator<Item = (Bounds, &str)> {
        let count = self.count as u64;
        // Encoders round sides up, to 4 or 16.
        let each = Bounds { least: count, most: count.saturating_mul(2).saturating_add(1 << 16) };
        let palette = self.palette.iter().flat_map(move |p| [(CENTROIDS, p.centroids.as_str()), (each, &p.labels)]);
        self.files.iter().map(move |name| (each, name.as_str())).chain(palette)
    }
}

impl Palette {
    /// The SH degree of a palette texture of this size.
    pub fn sh_degree(&self, (width, _): (u32, u32)) -> Result<u32> {
        let wide = |degree: &u32| ENTRIES * (sh_coefficients(*degree) as u32 - 1) == width;
        let name = &self.centroids;
        let degree = (1..=USUAL_SH_DEGREE).find(wide);
        let degree = degree
            .with_context(|| format!("{name} is {width} texels wide, 192, 512 or 960 make SH degree 1, 2 or 3"))?;
        match self.degree {
            Some(claimed) if claimed != degree => {
                bail!("{name} is {width} texels wide, as of SH degree {degree}, but meta.json says {claimed} bands")
            }
            _ => Ok(degree),
        }
    }
}

#[derive(Deserialize)]
struct Written {
    /// Missing in version 1.
    version: Option<u32>,
    count: Option<u64>,
    #[serde(default)]
    antialias: bool,
    means: Means,
    scales: Values,
    quats: Rotations,
    sh0: Values,
    #[serde(rename = "shN")]
    sh_n: Option<WrittenPalette>,
}

#[derive(Deserialize)]
struct Means {
    /// In version 1: number of Gaussians, then of axes.
    #[serde(default)]
    shape: Vec<u64>,
    mins: [f64; 3],
    maxs: [f64; 3],
    files: [String; 2],
}

#[derive(Deserialize)]
struct Rotations {
    files: [String; 1],
}

/// The values of bytes: a list, or, in version 1, linear between a minimum and a maximum per channel.
#[derive(Deserialize)]
struct Values {
    codebook: Option<Vec<Option<f64>>>,
    #[serde(default)]
    mins: Vec<f64>,
    #[serde(default)]
    maxs: Vec<f64>,
    files: [String; 1],
}

#[derive(Deserialize)]
struct WrittenPalette {
    count: Option<usize>,
    bands: Option<u32>,
    codebook: Option<Vec<Option<f64>>>,
    mins: Option<f64>,
    maxs: Option<f64>,
    files: [String; 2],
}

impl Values {
    fn range(&self, channel: usize) -> Result<[f64; 2]> {
        let range = self.mins.get(channel).zip(self.maxs.get(channel)).map(|(min, max)| [*min, *max]);
        range.with_context(|| format!("no codebook, nor a smallest and largest of channel {channel}"))
    }

    fn tables(&self, what: &str) -> Result<[Table; 3]> {
        let table = |channel| match &self.codebook {
            Some(codebook) => from_codebook(codebook),
            None => Ok(between(self.range(channel)?)),
        };
        let tables = [table(0), table(1), table(2)];
        let [red, green, blue] = tables.map(|table| table.with_context(|| format!("{what} in meta.json")));
        Ok([red?, green?, blue?])
    }
}

impl WrittenPalette {
    /// `None` if the palette has degree 0.
    fn palette(self) -> Result<Option<Palette>> {
        if self.bands == Some(0) {
            return Ok(None);
        }
        let values = match (&self.codebook, self.mins, self.maxs) {
            (Some(codebook), ..) => from_codebook(codebook).context("shN in meta.json")?,
            (None, Some(min), Some(max)) => between([min, max]),
            _ => bail!("shN in meta.json: no codebook, nor a smallest and largest"),
        };
        let [centroids, labels] = self.files;
        Ok(Some(Palette { count: self.count, degree: self.bands, values, centroids, labels }))
    }
}

/// Bytes past the end of the list become NaN, so Gaussians that use them are dropped.
fn from_codebook(codebook: &[Option<f64>]) -> Result<Table> {
    let entries = codebook.len();
    ensure!((1..=256).contains(&entries), "the codebook has {entries} values, expected 256");
    let mut table: Table =
        std::array::from_fn(|i| codebook.get(i).copied().flatten().map_or(f32::NAN, |value| value as f32));
    // Some encoders write null as the first value. Their readers extrapolate it by one mean step.
    if codebook[0].is_none() {
        table[0] = table[1] + (table[1] - table[255]) / 255.0;
    }
    Ok(table)
}

fn between([min, max]: [f64; 2]) -> Table {
    std::array::from_fn(|byte| (min + (max - min) * byte as f64 / 255.0) as f32)
}
