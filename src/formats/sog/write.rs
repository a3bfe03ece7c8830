//! Writes SOG 2 of PlayCanvas: lossless WebP textures with one texel per Gaussian, and a `meta.json` that defines their
//! values, in a zip archive or a folder.

use std::io::{Cursor, Write};

use anyhow::{Context, Result};
use image_webp::{ColorType, WebPEncoder};
use rayon::prelude::*;
use serde_json::{Value, json};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::codebook::Codebook;
use super::kmeans;
use crate::scene::{Gaussians, sh_coefficients};

/// Largest number of palette entries, which 16-bit labels can name.
const MAX_ENTRIES: usize = 1 << 16;
/// The file that names the others and defines their values.
pub(crate) const META: &str = "meta.json";
/// The stems of the names of all textures.
pub(crate) const STEMS: [&str; 7] = ["means_l", "means_u", "scales", "quats", "sh0", "shN_centroids", "shN_labels"];
/// Palette entries per row of their texture.
const ROW_ENTRIES: usize = 64;
/// Smallest log scale; it replaces that of scale 0.
const LEAST_LOG_SCALE: f32 = -87.0;

/// The name and the bytes of a file of a SOG.
type File = (String, Vec<u8>);

/// Writes the zip archive. Gaussians in spatial order make textures that compress well. The same Gaussians give the
/// same bytes on any number of threads.
pub(crate) fn write(gaussians: &Gaussians, is_antialiased: bool, out: &mut impl Write) -> Result<()> {
    // In memory, because an archive that cannot be finished prints to stderr.
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    // WebP is already compressed.
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in files(gaussians, is_antialiased, 0)? {
        archive.start_file(name, options)?;
        archive.write_all(&bytes)?;
    }
    Ok(out.write_all(archive.finish()?.get_ref())?)
}

/// The textures, and last `meta.json`, which names them. Names of `generation` 0 are those of the specification;
/// others let two sets be in one folder.
pub(crate) fn files(gaussians: &Gaussians, is_antialiased: bool, generation: u32) -> Result<Vec<File>> {
    let ranges = [0, 1, 2].map(|axis| range(gaussians, axis));
    let log_scales = gaussians.scales().as_flattened().par_iter().map(|s| s.ln().max(LEAST_LOG_SCALE));
    let log_scales = Codebook::of(log_scales.collect());
    let stride = sh_coefficients(gaussians.sh_degree());
    let colours = (0..3 * gaussians.len()).into_par_iter().map(|i| gaussians.sh(i / 3)[0][i % 3]);
    let colours = Codebook::of(colours.collect());
    let palette = (stride > 1 && !gaussians.is_empty()).then(|| Palette::of(gaussians));

    let steps = |i: usize| -> [[u8; 2]; 3] {
        std::array::from_fn(|axis| steps(gaussians.means()[i][axis], ranges[axis]).to_le_bytes())
    };
    let scale = |i: usize| gaussians.scales()[i].map(|s| log_scales.byte(s.ln().max(LEAST_LOG_SCALE)));
    let colour = |i: usize| {
        let [red, green, blue] = gaussians.sh(i)[0].map(|coefficient| colours.byte(coefficient));
        [red, green, blue, (gaussians.opacities()[i] * 255.0).round() as u8]
    };
    let name = |stem: &str| texture_name(stem, generation);
    let count = gaussians.len();
    let mut textures = vec![
        Texture::of("means_l", count, |i| steps(i).map(|s| s[0])),
        Texture::of("means_u", count, |i| steps(i).map(|s| s[1])),
        Texture::of("scales", count, scale),
        Texture::of("quats", count, |i| pack_smallest_three(gaussians.rotations()[i])),
        Texture::of("sh0", count, colour),
    ];
    let mut meta = json!({
        "version": 2,
        "asset": { "generator": "smalto" },
        "count": count,
        "antialias": is_antialiased,
        "means": {
            "mins": ranges.map(|[min, _]| min),
            "maxs": ranges.map(|[_, max]| max),
            "files": [name("means_l"), name("means_u")],
        },
        "scales": { "codebook": log_scales.values(), "files": [name("scales")] },
        "quats": { "files": [name("quats")] },
        "sh0": { "codebook": colours.values(), "files": [name("sh0")] },
    });
    if let Some(palette) = &palette {
        textures.extend(palette.textures());
        meta["shN"] = palette.meta(gaussians.sh_degree());
        meta["shN"]["files"] = json!([name("shN_centroids"), name("shN_labels")]);
    }
    let encoded = textures.par_iter().map(|texture| Ok((name(texture.stem), texture.encode()?)));
    let mut files = encoded.collect::<Result<Vec<_>>>()?;
    files.push((META.to_owned(), serde_json::to_vec(&meta)?));
    Ok(files)
}

/// The name of a texture file.
pub(crate) fn texture_name(stem: &str, generation: u32) -> String {
    if generation == 0 { format!("{stem}.webp") } else { format!("{stem}.{generation}.webp") }
}

/// The palette of the coefficients of degrees 1 and up: shared entries, and the label of each Gaussian.
struct Palette {
    /// Entry after entry: red, green and blue of each coefficient.
    entries: Vec<f32>,
    /// Number of values of an entry.
    width: usize,
    labels: Vec<u16>,
    codebook: Codebook,
}

impl Palette {
    fn of(gaussians: &Gaussians) -> Self {
        let count = gaussians.len();
        let point = |i: usize| gaussians.sh(i)[1..].as_flattened();
        // The number that splat-transform uses: a power of two, at most the number of Gaussians.
        let most = (1 << count.ilog2()).min(MAX_ENTRIES);
        let (entries, labels) = kmeans::cluster(count, point, most);
        let codebook = Codebook::of(entries.clone());
        Self { entries, width: point(0).len(), labels, codebook }
    }

    fn textures(&self) -> [Texture; 2] {
        let coefficients = self.width / 3;
        let width = ROW_ENTRIES * coefficients;
        let texels = self.entries.len() / 3;
        let centroid = |i: usize| [0, 1, 2].map(|channel| self.codebook.byte(self.entries[3 * i + channel]));
        let label = |i: usize| {
            let [low, high] = self.labels[i].to_le_bytes();
            [low, high, 0]
        };
        [
            Texture::sized("shN_centroids", [width, texels.div_ceil(width)], texels, centroid),
            Texture::of("shN_labels", self.labels.len(), label),
        ]
    }

    fn meta(&self, sh_degree: u32) -> Value {
        json!({
            "count": self.entries.len() / self.width,
            "bands": sh_degree,
            "codebook": self.codebook.values(),
        })
    }
}

/// A texture: one byte per channel and texel, row after row.
struct Texture {
    stem: &'static str,
    size: [usize; 2],
    colours: ColorType,
    bytes: Vec<u8>,
}

impl Texture {
    /// One texel per Gaussian, in the size that splat-transform uses: nearly square, with sides that are multiples of
    /// 4.
    fn of<const N: usize>(stem: &'static str, count: usize, texel: impl Fn(usize) -> [u8; N] + Sync) -> Self {
        let width = ((count as f64).sqrt() / 4.0).ceil().max(1.0) as usize * 4;
        let height = count.div_ceil(width * 4).max(1) * 4;
        Self::sized(stem, [width, height], count, texel)
    }

    /// A texture of this size; texels from `count` on are zero.
    fn sized<const N: usize>(
        stem: &'static str,
        size: [usize; 2],
        count: usize,
        texel: impl Fn(usize) -> [u8; N] + Sync,
    ) -> Self {
        let mut bytes = vec![0; size[0] * size[1] * N];
        bytes.as_chunks_mut().0[..count].par_iter_mut().enumerate().for_each(|(i, bytes)| *bytes = texel(i));
        Self { stem, size, colours: if N == 4 { ColorType::Rgba8 } else { ColorType::Rgb8 }, bytes }
    }

    fn encode(&self) -> Result<Vec<u8>> {
        let mut webp = Vec::new();
        let [width, height] = self.size;
        let (width, height) = (u32::try_from(width)?, u32::try_from(height)?);
        WebPEncoder::new(&mut webp)
            .encode(&self.bytes, width, height, self.colours)
            .with_context(|| format!("{}.webp cannot be made of {width}x{height} texels", self.stem))?;
        Ok(webp)
    }
}

/// Smallest and largest [`compressed`] coordinate of an axis.
fn range(gaussians: &Gaussians, axis: usize) -> [f64; 2] {
    let values = gaussians.means().iter().map(|mean| compressed(mean[axis]));
    let range = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[min, max], v| [min.min(v), max.max(v)]);
    if gaussians.is_empty() { [0.0; 2] } else { range }
}

/// sign(x) ln(1 + |x|), which makes steps fine near the origin.
fn compressed(value: f32) -> f64 {
    let value = f64::from(value);
    value.abs().ln_1p().copysign(value)
}

/// A coordinate as the nearest of 65,536 steps.
fn steps(value: f32, [min, max]: [f64; 2]) -> u16 {
    let fraction = if max > min { (compressed(value) - min) / (max - min) } else { 0.0 };
    (65535.0 * fraction).round() as u16
}

/// Packs a unit quaternion w x y z: three components in a byte each, and 252 plus the index of the largest, which is
/// made positive and left out.
fn pack_smallest_three(q: [f32; 4]) -> [u8; 4] {
    let largest = (0..4).fold(0, |largest, i| if q[i].abs() > q[largest].abs() { i } else { largest });
    let sign = f64::from(q[largest]).signum();
    let mut others = (0..4).filter(|i| *i != largest).map(|i| sign * f64::from(q[i]) * 2_f64.sqrt());
    let bytes = [(); 3].map(|()| ((others.next().unwrap_or(0.0) * 0.5 + 0.5) * 255.0).round().clamp(0.0, 255.0) as u8);
    [bytes[0], bytes[1], bytes[2], 252 + largest as u8]
}
