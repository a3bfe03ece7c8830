//! Reads glTF 2.0 with KHR_gaussian_splatting: `.glb`, and `.gltf` with buffers in other files. Axes: right, up, back.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use rayon::prelude::*;

use super::document::{Document, Primitive, Shown, ShownMesh};
use super::values::{Data, Values};
use super::{BINARY, DISPLAY, EXTENSION, JSON, buffers};
use crate::formats::input::{Input, word};
use crate::scene::{Activated, BLOCK, Builder, Placer, RIGHT_UP_BACK, Scene, USUAL_SH_DEGREE, sh_coefficients};

/// Largest JSON document that is read.
const MAX_JSON_BYTES: u64 = 1 << 26;

/// Reads a `.glb`: a header, the JSON document and the first buffer.
pub(crate) fn read_binary(input: &mut Input, path: &Path) -> Result<Scene> {
    let mut header = [0; 12];
    input.fill(&mut header, "the glTF header")?;
    let version = word(&header, 4);
    ensure!(version == 2, "glTF version {version} is not supported, only 2");
    let (kind, text) = chunk(input)?.context("the file ends after the glTF header")?;
    ensure!(kind == JSON, "the first chunk of the file is not JSON");
    let mut embedded = None;
    while let Some((kind, bytes)) = chunk(input)? {
        if kind == BINARY && embedded.is_none() {
            embedded = Some(bytes);
        }
    }
    read_document(input, path, &text, embedded)
}

/// Reads a `.gltf`: the JSON document, with its buffers in other files or in data URIs.
pub(crate) fn read_text(input: &mut Input, path: &Path) -> Result<Scene> {
    let len = input.len();
    ensure!(len <= MAX_JSON_BYTES, "a glTF description of {len} bytes is not supported, only up to {MAX_JSON_BYTES}");
    let text = input.bytes(len, "the glTF description")?;
    read_document(input, path, &text, None)
}

/// Kind and bytes of the next chunk, or `None` at the end of the file.
fn chunk(input: &mut Input) -> Result<Option<(u32, Vec<u8>)>> {
    if input.left() < 8 {
        return Ok(None);
    }
    let mut header = [0; 8];
    input.fill(&mut header, "the header of a chunk")?;
    let (bytes, kind) = (word(&header, 0), word(&header, 4));
    Ok(Some((kind, input.bytes(bytes.into(), "a chunk")?)))
}

fn read_document(input: &mut Input, path: &Path, text: &[u8], embedded: Option<Vec<u8>>) -> Result<Scene> {
    let document = Document::parse(text)?;
    let buffers = buffers::load(&document.buffers, path, embedded)?;
    let data = document.data(&buffers);
    let Shown { primitives, meshes, others } = document.shown(&data)?;
    ensure!(!meshes.is_empty(), "the glTF scene shows no mesh with {EXTENSION}");
    let parts = primitives.iter().map(|primitive| Part::of(&data, primitive)).collect::<Result<Vec<_>>>()?;
    let scales = Scales::of(&parts);

    // A mesh may be shown many times, so memory for all of them is reserved before the first is decoded.
    let parts_of = |mesh: &ShownMesh| &parts[mesh.primitives.clone()];
    let gaussians_of = |mesh: &ShownMesh| parts_of(mesh).iter().map(|part| part.mean.count).sum::<usize>();
    let counts = meshes.iter().map(|mesh| gaussians_of(mesh).saturating_mul(mesh.count()));
    let count = counts.fold(0, usize::saturating_add);
    let sh_degree = parts.iter().map(|part| part.sh_degree).max().unwrap_or(0);
    let mut builder = input.builder(sh_degree, count)?;
    let (placement, mut stretched) = (input.placement(), 0);
    for mesh in meshes.iter().filter(|mesh| gaussians_of(mesh) > 0) {
        for instance in 0..mesh.count() {
            let placer = Placer::new(&placement.after(&mesh.place(instance)?, RIGHT_UP_BACK));
            let is_stretched = placer.stretches();
            builder.place(placer);
            for part in parts_of(mesh) {
                stretched += if is_stretched && part.sh_degree > 0 { part.mean.count } else { 0 };
                part.read(input, &mut builder, &scales)?;
            }
        }
    }

    let mut notices: Vec<String> = scales.notice().into_iter().collect();
    if stretched > 0 {
        notices.push(format!(
            "nodes scale the axes of {stretched} Gaussians differently, and their spherical harmonics only follow the \
             rotation"
        ));
    }
    let unread = document.unread_extensions();
    if !unread.is_empty() {
        notices.push(format!("what it stores in {} is not read", unread.join(", ")));
    }
    if others > 0 {
        notices
            .push(format!("its scene has {others} primitives without Gaussians (like triangles), which are not drawn"));
    }
    let (gaussians, report) = builder.finish();
    let format = if scales.are_logarithms { "glTF, scales as logarithms" } else { "glTF" };
    Ok(Scene { gaussians, report, notices, ..Scene::empty(format) })
}

/// The meaning of the scales of a file.
struct Scales {
    /// Number of scales, and of those below 0.
    count: usize,
    negative: usize,
    /// They are logarithms, as in the review draft of 2025; otherwise linear, as ratified.
    are_logarithms: bool,
}

impl Scales {
    /// A file does not record which version of the extension it follows. Logarithms are mostly negative: standard
    /// deviations are mostly below one unit. Linear scales are never negative, but for faults.
    fn of(parts: &[Part]) -> Self {
        let count = parts.iter().map(|part| 3 * part.scale.count).sum();
        let of_part = |part: &Part| -> usize {
            let rows = (0..part.scale.count).into_par_iter();
            rows.map(|i| part.scale.row::<3>(i).iter().filter(|s| **s < 0.0).count()).sum()
        };
        let negative = parts.iter().map(of_part).sum();
        Self { count, negative, are_logarithms: 2 * negative > count }
    }

    /// The standard deviations for scales as the file stores them.
    fn activated(&self, stored: [f64; 3]) -> [f64; 3] {
        if self.are_logarithms { stored.map(f64::exp) } else { stored }
    }

    fn notice(&self) -> Option<String> {
        let Self { count, negative, are_logarithms } = self;
        are_logarithms.then(|| {
            format!("{negative} of {count} scales are negative, so all are read as logarithms, as in the draft of 2025")
        })
    }
}

/// The attributes of one primitive.
struct Part<'b> {
    mean: Values<'b>,
    rotation: Values<'b>,
    scale: Values<'b>,
    opacity: Values<'b>,
    sh: Vec<Values<'b>>,
    sh_degree: u32,
}

impl<'b> Part<'b> {
    fn of(data: &Data<'b>, primitive: &Primitive) -> Result<Self> {
        let space = primitive.extensions.get(EXTENSION).and_then(|e| e.get("colorSpace")).and_then(|s| s.as_str());
        ensure!(
            space.is_none_or(|space| space == DISPLAY),
            "colours in {} are not supported, only {DISPLAY}",
            space.unwrap_or_default()
        );
        let own = |name: &str| format!("{EXTENSION}:{name}");
        let values = |name: &str, components: usize| {
            let index = primitive.attributes.get(name).with_context(|| format!("attribute {name} is missing"))?;
            data.values(*index, components, name)
        };
        let (mut sh, mut sh_degree) = (vec![values(&own("SH_DEGREE_0_COEF_0"), 3)?], 0);
        let has = |degree: u32| primitive.attributes.contains_key(&own(&format!("SH_DEGREE_{degree}_COEF_0")));
        ensure!(
            !has(USUAL_SH_DEGREE + 1),
            "SH degree {} is not supported, only 0 to {USUAL_SH_DEGREE}",
            USUAL_SH_DEGREE + 1
        );
        while sh_degree < USUAL_SH_DEGREE && has(sh_degree + 1) {
            sh_degree += 1;
            for i in 0..2 * sh_degree + 1 {
                sh.push(values(&own(&format!("SH_DEGREE_{sh_degree}_COEF_{i}")), 3)?);
            }
        }
        let part = Self {
            mean: values("POSITION", 3)?,
            rotation: values(&own("ROTATION"), 4)?,
            scale: values(&own("SCALE"), 3)?,
            opacity: values(&own("OPACITY"), 1)?,
            sh,
            sh_degree,
        };
        let others = [&part.rotation, &part.scale, &part.opacity].into_iter().chain(&part.sh);
        if let Some(other) = others.map(|values| values.count).find(|count| *count != part.mean.count) {
            bail!("there are {} positions, but {other} values of another attribute", part.mean.count);
        }
        Ok(part)
    }

    /// Adds the Gaussians to the builder, where it places them.
    fn read(&self, input: &mut Input, builder: &mut Builder, scales: &Scales) -> Result<()> {
        let count = self.mean.count;
        debug_assert_eq!(self.sh.len(), sh_coefficients(self.sh_degree));
        for first in (0..count).step_by(BLOCK) {
            input.before_block(builder)?;
            builder.extend(BLOCK.min(count - first), |index, sh| {
                let index = first + index;
                sh.iter_mut().zip(&self.sh).for_each(|(c, values)| *c = values.row(index).map(|v: f64| v as f32));
                let [x, y, z, w] = self.rotation.row(index);
                let [opacity] = self.opacity.row(index);
                Activated {
                    mean: self.mean.row(index),
                    scale: scales.activated(self.scale.row(index)),
                    rotation: [w, x, y, z],
                    opacity,
                }
            });
        }
        Ok(())
    }
}
