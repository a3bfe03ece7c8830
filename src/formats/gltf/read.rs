//! Reads glTF 2.0 with KHR_gaussian_splatting: `.glb`, and `.gltf` with buffers in other files. Axes: right, up, back.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use glam::{DMat4, DQuat, DVec3};
use rayon::prelude::*;
use serde::Deserialize;

use super::buffers;
use super::buffers::Buffer;
use crate::formats::input::{Input, checked_count, word};
use crate::scene::{
    Activated, BLOCK, Builder, Gaussians, LoadReport, RIGHT_UP_BACK, Scene, Transform, USUAL_SH_DEGREE, sh_coefficients,
};

pub(crate) const MAGIC: u32 = 0x4654_6c67; // "glTF"
pub(crate) const JSON: u32 = 0x4e4f_534a;
pub(crate) const BINARY: u32 = 0x004e_4942;
pub(crate) const EXTENSION: &str = "KHR_gaussian_splatting";
/// The only supported colour space: values are drawn as they are.
pub(crate) const DISPLAY: &str = "srgb_rec709_display";
/// Largest JSON document that is read.
const MAX_JSON_BYTES: u64 = 1 << 26;
/// Extensions that a file may require: the second allows attributes in few bits, which are read anyway.
const KNOWN: [&str; 2] = [EXTENSION, "KHR_mesh_quantization"];
/// The mode of primitives that are points.
const POINTS: u32 = 0;
/// Largest depth of the node tree.
const MAX_DEPTH: usize = 64;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    scene: Option<usize>,
    #[serde(default)]
    extensions_required: Vec<String>,
    #[serde(default)]
    scenes: Vec<Nodes>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
    #[serde(default)]
    buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Nodes {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
struct Node {
    mesh: Option<usize>,
    #[serde(default)]
    children: Vec<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    /// The splat-transform of 2026 leaves it out, which should mean triangles.
    mode: Option<u32>,
    attributes: HashMap<String, usize>,
    #[serde(default)]
    extensions: HashMap<String, serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: u64,
    component_type: u32,
    count: u64,
    #[serde(rename = "type")]
    shape: String,
    #[serde(default)]
    normalized: bool,
    sparse: Option<serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: Option<u64>,
}

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
    let document: Document = serde_json::from_slice(text).context("the glTF description cannot be understood")?;
    if let Some(other) = document.extensions_required.iter().find(|name| !KNOWN.contains(&name.as_str())) {
        bail!("the file requires the glTF extension {other}, which is not supported");
    }
    let placed = document.placed()?;
    ensure!(!placed.is_empty(), "the glTF scene shows no mesh with {EXTENSION}");
    let buffers = buffers::load(&document.buffers, path, embedded)?;
    let (mut parts, mut report, mut has_logarithms) = (Vec::new(), LoadReport::default(), false);
    for (primitive, transform) in placed {
        let part = Part::of(&document, &buffers, primitive)?;
        has_logarithms |= part.has_logarithms;
        let (gaussians, read) = part.read(input)?;
        report = report.and(&read);
        let is_moved = transform != Transform::IDENTITY;
        parts.push(if is_moved { gaussians.transformed(&transform)? } else { gaussians });
    }
    let gaussians = if parts.len() == 1 { parts.remove(0) } else { Gaussians::joined(parts.iter())? };
    let format = if has_logarithms { "glTF, scales as logarithms" } else { "glTF" };
    let gaussians = gaussians.flipped(RIGHT_UP_BACK);
    Ok(Scene {
        gaussians,
        report,
        format: format.to_owned(),
        is_antialiased: false,
        notices: Vec::new(),
        levels: Vec::new(),
    })
}

impl Document {
    /// The primitives with Gaussians, with their transforms to the scene.
    fn placed(&self) -> Result<Vec<(&Primitive, Transform)>> {
        let mut placed = Vec::new();
        let shown = self.scenes.get(self.scene.unwrap_or(0));
        if let Some(scene) = self.scene.filter(|_| shown.is_none()) {
            bail!("the file shows glTF scene {scene}, but has {}", self.scenes.len());
        }
        let roots: Vec<usize> = match shown {
            Some(scene) => scene.nodes.clone(),
            None => (0..self.nodes.len()).filter(|i| !self.nodes.iter().any(|n| n.children.contains(i))).collect(),
        };
        let mut waiting: Vec<_> = roots.into_iter().map(|root| (root, DMat4::IDENTITY, 0)).collect();
        while let Some((index, above, depth)) = waiting.pop() {
            let node = self.nodes.get(index).with_context(|| format!("node {index} is missing"))?;
            // These limits end the walk in a file whose nodes form a cycle.
            ensure!(depth < MAX_DEPTH, "nodes lie over {MAX_DEPTH} deep");
            ensure!(waiting.len() + placed.len() <= self.nodes.len(), "a node has two parents");
            let matrix = above * node.matrix();
            waiting.extend(node.children.iter().map(|child| (*child, matrix, depth + 1)));
            let Some(mesh) = node.mesh else { continue };
            let mesh = self.meshes.get(mesh).with_context(|| format!("mesh {mesh} is missing"))?;
            for primitive in mesh.primitives.iter().filter(|p| p.extensions.contains_key(EXTENSION)) {
                let mode = primitive.mode.unwrap_or(POINTS);
                ensure!(mode == POINTS, "a primitive with {EXTENSION} has mode {mode}, not {POINTS} (points)");
                let transform = Transform::from_matrix(&matrix).with_context(|| format!("node {index}"))?;
                placed.push((primitive, transform));
            }
        }
        Ok(placed)
    }

    /// The values of an accessor with this number of components.
    fn values<'b>(&self, buffers: &'b [Vec<u8>], index: usize, components: usize, name: &str) -> Result<Values<'b>> {
        let accessor = self.accessors.get(index).with_context(|| format!("accessor {index} of {name} is missing"))?;
        ensure!(accessor.sparse.is_none(), "{name} is a sparse accessor, which is not supported");
        let shape = ["SCALAR", "VEC2", "VEC3", "VEC4"][components - 1];
        ensure!(accessor.shape == shape, "{name} is {}, not {shape}", accessor.shape);
        let component = Component::of(accessor.component_type)
            .with_context(|| format!("{name} has components of the unknown type {}", accessor.component_type))?;
        let view = accessor.buffer_view.and_then(|view| self.buffer_views.get(view));
        let view = view.with_context(|| format!("{name} has no buffer view"))?;
        let buffer = buffers.get(view.buffer).with_context(|| format!("{name} has no buffer"))?;
        let row = (components * component.bytes()) as u64;
        let stride = view.byte_stride.unwrap_or(row);
        ensure!(stride >= row && stride <= 252.max(row), "{name} has {stride} bytes from one element to the next");
        let end = view.byte_offset.checked_add(view.byte_length).filter(|end| *end <= buffer.len() as u64);
        let end = end.with_context(|| format!("{name} lies outside of its buffer of {} bytes", buffer.len()))?;
        let start = view.byte_offset.saturating_add(accessor.byte_offset);
        let available = (end + stride - row).saturating_sub(start);
        let count = checked_count(accessor.count, stride, available, &format!("values of {name}"))?;
        let bytes = if count == 0 { &[] } else { &buffer[start as usize..end as usize] };
        Ok(Values { bytes, stride: stride as usize, component, is_normalized: accessor.normalized, count })
    }
}

impl Node {
    fn matrix(&self) -> DMat4 {
        if let Some(matrix) = &self.matrix {
            return DMat4::from_cols_array(matrix);
        }
        let [scale, translation] =
            [self.scale.unwrap_or([1.0; 3]), self.translation.unwrap_or([0.0; 3])].map(DVec3::from);
        let rotation = DQuat::from_array(self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        DMat4::from_scale_rotation_translation(scale, rotation, translation)
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    F32,
}

impl Component {
    fn of(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::F32 => 4,
        }
    }
}

/// The values of an accessor: rows of numbers in a buffer.
struct Values<'b> {
    bytes: &'b [u8],
    stride: usize,
    component: Component,
    is_normalized: bool,
    count: usize,
}

impl Values<'_> {
    fn row<const N: usize>(&self, index: usize) -> [f64; N] {
        let size = self.component.bytes();
        std::array::from_fn(|i| self.number(&self.bytes[index * self.stride + i * size..][..size]))
    }

    fn number(&self, bytes: &[u8]) -> f64 {
        let (value, most) = match (self.component, bytes) {
            (Component::I8, [a, ..]) => (f64::from(*a as i8), 127.0),
            (Component::U8, [a, ..]) => (f64::from(*a), 255.0),
            (Component::I16, [a, b, ..]) => (f64::from(i16::from_le_bytes([*a, *b])), 32767.0),
            (Component::U16, [a, b, ..]) => (f64::from(u16::from_le_bytes([*a, *b])), 65535.0),
            (_, [a, b, c, d, ..]) => return f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            _ => return f64::NAN,
        };
        if self.is_normalized { (value / most).max(-1.0) } else { value }
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
    /// Some scale is negative, so scales are logarithms, as in the draft of 2025.
    has_logarithms: bool,
}

impl<'b> Part<'b> {
    fn of(document: &Document, buffers: &'b [Vec<u8>], primitive: &Primitive) -> Result<Self> {
        let space = primitive.extensions.get(EXTENSION).and_then(|e| e.get("colorSpace")).and_then(|s| s.as_str());
        ensure!(
            space.is_none_or(|space| space == DISPLAY),
            "colours in {} are not supported, only {DISPLAY}",
            space.unwrap_or_default()
        );
        let own = |name: &str| format!("{EXTENSION}:{name}");
        let values = |name: &str, components: usize| {
            let index = primitive.attributes.get(name).with_context(|| format!("attribute {name} is missing"))?;
            document.values(buffers, *index, components, name)
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
        let scale = values(&own("SCALE"), 3)?;
        let has_logarithms = (0..scale.count).into_par_iter().any(|i| scale.row::<3>(i).iter().any(|s| *s < 0.0));
        let part = Self {
            mean: values("POSITION", 3)?,
            rotation: values(&own("ROTATION"), 4)?,
            scale,
            opacity: values(&own("OPACITY"), 1)?,
            sh,
            sh_degree,
            has_logarithms,
        };
        let others = [&part.rotation, &part.scale, &part.opacity].into_iter().chain(&part.sh);
        if let Some(other) = others.map(|values| values.count).find(|count| *count != part.mean.count) {
            bail!("there are {} positions, but {other} values of another attribute", part.mean.count);
        }
        Ok(part)
    }

    fn read(&self, input: &mut Input) -> Result<(Gaussians, LoadReport)> {
        let count = self.mean.count;
        let mut builder = Builder::new(self.sh_degree, count)?;
        debug_assert_eq!(self.sh.len(), sh_coefficients(self.sh_degree));
        for first in (0..count).step_by(BLOCK) {
            input.before_block(&builder)?;
            builder.extend(BLOCK.min(count - first), |index, sh| {
                let index = first + index;
                sh.iter_mut().zip(&self.sh).for_each(|(c, values)| *c = values.row(index).map(|v: f64| v as f32));
                let [x, y, z, w] = self.rotation.row(index);
                let [opacity] = self.opacity.row(index);
                let scale = self.scale.row(index);
                Activated {
                    mean: self.mean.row(index),
                    scale: if self.has_logarithms { scale.map(f64::exp) } else { scale },
                    rotation: [w, x, y, z],
                    opacity,
                }
            });
        }
        Ok(builder.finish())
    }
}
