//! Decodes one `meta.json` with its textures to Gaussians.

use std::ops::Range;

use anyhow::{Result, bail, ensure};
use rayon::prelude::*;

use super::files::Files;
use super::meta::{self, Meta};
use super::texture::{self, Texture};
use crate::formats::input::Input;
use crate::scene::{BLOCK, Builder, Raw, Scene, Watch, from_smallest_three, sh_coefficients};

/// Bytes of all texels of a Gaussian, without the coefficients of degrees 1 and up.
const TEXEL_BYTES: u64 = 20;
/// Position of the palette in [`Meta::textures`]. Every other texture has a texel per Gaussian.
const PALETTE: usize = 5;
/// Largest accepted compression ratio of textures.
const MAX_RATIO: u64 = 1024;

/// Decodes several SOG files to one scene. `input` is the file that was opened; it reports partial scenes and
/// cancelling.
pub(crate) fn decode_all(input: &mut Input, units: Vec<Unit>, format: String, watch: &Watch) -> Result<Scene> {
    let total: usize = units.iter().map(|unit| unit.meta.count).sum();
    let sh_degree = units.iter().map(|unit| unit.sh_degree).max().unwrap_or(0);
    let is_antialiased = units.iter().any(|unit| unit.meta.is_antialiased);
    let mut builder = input.builder(sh_degree, total)?;
    let mut before = 0;
    for unit in units {
        let count = unit.meta.count;
        let progress = |done| (watch.progress)((before + done) as f64 / total.max(1) as f64);
        unit.decoded(input, &builder)?.add(0..count, input, &mut builder, progress)?;
        before += count;
    }
    let (gaussians, report) = builder.finish();
    Ok(Scene { gaussians, report, format, is_antialiased, notices: Vec::new(), levels: Vec::new() })
}

/// One `meta.json`, and the files with its textures.
pub(crate) struct Unit {
    pub meta: Meta,
    files: Files,
    pub sh_degree: u32,
}

impl Unit {
    pub fn open(mut files: Files, json: &str) -> Result<Self> {
        let json = files.read(json, meta::MAX_BYTES)?;
        Self::parse(&json, files)
    }

    pub fn parse(json: &[u8], mut files: Files) -> Result<Self> {
        let meta = Meta::parse(json)?;
        let names: Vec<&str> = meta.textures().map(|(_, name)| name).collect();
        let bytes = files.bytes(&names)?;
        let most = bytes.saturating_mul(MAX_RATIO) / TEXEL_BYTES;
        ensure!(
            meta.count as u64 <= most,
            "meta.json claims {} Gaussians, textures of {bytes} bytes hold {most} at most",
            meta.count
        );
        let sh_degree = match &meta.palette {
            None => 0,
            Some(palette) => {
                let centroids = files.read(&palette.centroids, meta::CENTROIDS.most_bytes())?;
                palette.sh_degree(texture::size(&palette.centroids, &centroids)?)?
            }
        };
        Ok(Self { meta, files, sh_degree })
    }

    /// The decoded textures. `builder` gets the Gaussians, and holds those that were read before.
    pub fn decoded(mut self, input: &mut Input, builder: &Builder) -> Result<Texels> {
        input.before_block(builder)?;
        let texels = Texels { textures: self.textures()?, meta: self.meta, sh_degree: self.sh_degree };
        texels.check_labels()?;
        Ok(texels)
    }

    /// Decodes all textures in parallel.
    fn textures(&mut self) -> Result<Vec<Texture>> {
        let mut files = Vec::new();
        for (bounds, name) in self.meta.textures() {
            files.push((bounds, name, self.files.read(name, bounds.most_bytes())?));
        }
        // All are decoded, so that of several problems the first in their order is reported in every run.
        let decoded = files.par_iter().map(|(bounds, name, bytes)| Texture::decode(name, bytes, *bounds));
        let decoded: Vec<_> = decoded.collect();
        let textures = decoded.into_iter().collect::<Result<Vec<_>>>()?;
        // Textures of scenes with about as many Gaussians have the same size: they cannot be told apart.
        let [width, height] = textures[0].size;
        for (index, (_, name, _)) in files.iter().enumerate().filter(|(index, _)| *index != PALETTE) {
            let [w, h] = textures[index].size;
            ensure!(
                [w, h] == [width, height],
                "{name} is {w}x{h} texels large and {} {width}x{height}: they are not of one scene",
                files[0].1
            );
        }
        Ok(textures)
    }
}

/// The textures in the order of [`Meta::textures`], and the meaning of their values.
pub(crate) struct Texels {
    textures: Vec<Texture>,
    meta: Meta,
    sh_degree: u32,
}

impl Texels {
    /// Adds the Gaussians in a range to `builder`. `progress` gets the number of them that were added so far.
    pub fn add(
        &self,
        range: Range<usize>,
        input: &mut Input,
        builder: &mut Builder,
        progress: impl Fn(usize),
    ) -> Result<()> {
        for first in range.clone().step_by(BLOCK) {
            input.before_block(builder)?;
            let count = BLOCK.min(range.end - first);
            builder.extend(count, |index, sh| self.gaussian(first + index, sh));
            progress(first + count - range.start);
        }
        Ok(())
    }

    fn label(&self, index: usize) -> usize {
        let [low, high, ..] = self.textures[6].texel(index);
        usize::from(u16::from_le_bytes([low, high]))
    }

    /// Fails if the label of a Gaussian is outside of the palette.
    fn check_labels(&self) -> Result<()> {
        let Some(palette) = &self.meta.palette else { return Ok(()) };
        let room = self.textures[PALETTE].texels() / (sh_coefficients(self.sh_degree) - 1);
        let entries = palette.count.unwrap_or(room);
        ensure!(entries <= room, "meta.json claims {entries} palette entries, {} holds {room}", palette.centroids);
        let outside = (0..self.meta.count).into_par_iter().find_first(|index| self.label(*index) >= entries);
        match outside {
            Some(index) => bail!("Gaussian {index} has palette entry {}, there are {entries}", self.label(index)),
            None => Ok(()),
        }
    }

    fn gaussian(&self, index: usize, sh: &mut [[f32; 3]]) -> Raw {
        let meta = &self.meta;
        let [low, high, scale, rotation, colour] = std::array::from_fn(|i| self.textures[i].texel(index));
        let look_up = |tables: &[meta::Table; 3], texel: [u8; 4]| -> [f32; 3] {
            std::array::from_fn(|i| tables[i][usize::from(texel[i])])
        };
        sh[0] = look_up(&meta.colours, colour);
        if let Some(palette) = &meta.palette {
            let coefficients = sh_coefficients(self.sh_degree) - 1;
            // A row holds 64 entries, and an entry as many texels as it has coefficients, so entries are contiguous.
            let entry = self.label(index) * coefficients;
            for (i, coefficient) in sh[1..=coefficients].iter_mut().enumerate() {
                let bytes = self.textures[PALETTE].texel(entry + i);
                *coefficient = std::array::from_fn(|channel| palette.values[usize::from(bytes[channel])]);
            }
        }
        Raw {
            mean: std::array::from_fn(|axis| {
                let [min, max] = meta.means[axis];
                let range = if max == min { 1.0 } else { max - min };
                let t = min + range * f64::from(u16::from_le_bytes([low[axis], high[axis]])) / 65535.0;
                t.abs().exp_m1().copysign(t)
            }),
            log_scale: look_up(&meta.log_scales, scale).map(f64::from),
            rotation: unpack_smallest_three(rotation),
            opacity_logit: meta.opacity_logits[usize::from(colour[3])],
        }
    }
}

/// Unpacks a quaternion w x y z: three components in a byte each, and in the last byte 252 plus the index of the
/// largest, which is positive and left out. Other last bytes stand for the identity.
fn unpack_smallest_three([a, b, c, last]: [u8; 4]) -> [f64; 4] {
    let Some(largest) = last.checked_sub(252).map(usize::from) else { return [1.0, 0.0, 0.0, 0.0] };
    from_smallest_three(largest, [a, b, c].map(|byte| (f64::from(byte) / 127.5 - 1.0) / 2_f64.sqrt()))
}
