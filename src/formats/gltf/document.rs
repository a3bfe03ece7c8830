//! The description of a glTF file: which primitives with Gaussians its scene shows, and where.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::Range;

use anyhow::{Context, Result, bail, ensure};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use serde::Deserialize;

use super::EXTENSION;
use super::buffers::Buffer;
use super::values::{Accessor, Data, Values, View};

const INSTANCING: &str = "EXT_mesh_gpu_instancing";
const VISIBILITY: &str = "KHR_node_visibility";
/// Extensions that are read. KHR_mesh_quantization allows attributes in few bits, which are read anyway.
const READ: [&str; 4] = [EXTENSION, "KHR_mesh_quantization", INSTANCING, VISIBILITY];
/// Beginnings of the names of extensions that do not concern Gaussians: surfaces, lights and metadata.
const IRRELEVANT: [&str; 6] =
    ["KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp"];
/// The mode of primitives that are points.
const POINTS: u32 = 0;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Document {
    scene: Option<usize>,
    #[serde(default)]
    extensions_used: Vec<String>,
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
    pub buffers: Vec<Buffer>,
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
    #[serde(default)]
    extensions: NodeExtensions,
}

#[derive(Default, Deserialize)]
struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    instancing: Option<Instancing>,
    #[serde(rename = "KHR_node_visibility")]
    visibility: Option<Visibility>,
}

/// Places at which the mesh of a node is shown: accessors by the names of attributes.
#[derive(Deserialize)]
struct Instancing {
    attributes: HashMap<String, usize>,
}

#[derive(Deserialize)]
struct Visibility {
    #[serde(default = "visible")]
    visible: bool,
}

fn visible() -> bool {
    true
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(crate) struct Primitive {
    /// The splat-transform of 2026 leaves it out, which should mean triangles.
    mode: Option<u32>,
    pub attributes: HashMap<String, usize>,
    #[serde(default)]
    pub extensions: HashMap<String, serde_json::Value>,
}

/// What the scene of a file shows.
pub(crate) struct Shown<'d> {
    /// The primitives with Gaussians, each once.
    pub primitives: Vec<&'d Primitive>,
    pub meshes: Vec<ShownMesh<'d>>,
    /// Number of primitives without Gaussians.
    pub others: usize,
}

/// A mesh that a node shows.
pub(crate) struct ShownMesh<'d> {
    /// Indices of its primitives with Gaussians.
    pub primitives: Range<usize>,
    node: DAffine3,
    instances: Option<Instances<'d>>,
}

/// The places at which the mesh of a node is shown, relative to the node.
struct Instances<'d> {
    count: usize,
    translation: Option<Values<'d>>,
    rotation: Option<Values<'d>>,
    scale: Option<Values<'d>>,
}

impl Document {
    /// The description in a JSON text.
    ///
    /// # Errors
    /// If it is none, or requires an extension that is not read.
    pub fn parse(text: &[u8]) -> Result<Self> {
        let document: Self = serde_json::from_slice(text).context("the glTF description cannot be understood")?;
        if let Some(other) = document.extensions_required.iter().find(|name| !READ.contains(&name.as_str())) {
            bail!("the file requires the glTF extension {other}, which is not supported");
        }
        Ok(document)
    }

    /// The extensions that may change the picture and are not read.
    pub fn unread_extensions(&self) -> Vec<&str> {
        let is_read = |name: &&str| READ.contains(name) || IRRELEVANT.iter().any(|begin| name.starts_with(begin));
        self.extensions_used.iter().map(String::as_str).filter(|name| !is_read(name)).collect()
    }

    /// The accessors, with the bytes of all buffers.
    pub fn data<'d>(&'d self, buffers: &'d [Vec<u8>]) -> Data<'d> {
        Data { accessors: &self.accessors, views: &self.buffer_views, buffers }
    }

    /// What the scene shows.
    ///
    /// # Errors
    /// If a node, a mesh or an accessor is missing or has no meaning.
    pub fn shown<'d>(&'d self, data: &Data<'d>) -> Result<Shown<'d>> {
        let mut shown = Shown { primitives: Vec::new(), meshes: Vec::new(), others: 0 };
        // For each mesh that was met, the indices of its primitives with Gaussians.
        let mut met = HashMap::<usize, Range<usize>>::new();
        let mut is_met = vec![false; self.nodes.len()];
        let mut waiting: Vec<_> = self.roots()?.into_iter().map(|root| (root, DAffine3::IDENTITY)).collect();
        while let Some((index, above)) = waiting.pop() {
            let node = self.nodes.get(index).with_context(|| format!("node {index} is missing"))?;
            ensure!(!std::mem::replace(&mut is_met[index], true), "node {index} has two parents, or is its own");
            let named = || format!("node {index}");
            let here = above * node.affine().with_context(named)?;
            ensure!(here.is_finite(), "node {index} lies beyond 64-bit floats");
            // By the standard, a node without extent is hidden.
            let is_hidden = node.extensions.visibility.as_ref().is_some_and(|visibility| !visibility.visible);
            if is_hidden || here.matrix3 == DMat3::ZERO {
                continue;
            }
            waiting.extend(node.children.iter().map(|child| (*child, here)));
            let Some(number) = node.mesh else { continue };
            let mesh = self.meshes.get(number).with_context(|| format!("mesh {number} is missing"))?;
            let primitives = match met.entry(number) {
                Entry::Occupied(met) => met.get().clone(),
                Entry::Vacant(new) => new.insert(mesh.add_to(&mut shown.primitives)?).clone(),
            };
            shown.others += mesh.primitives.len() - primitives.len();
            if !primitives.is_empty() {
                let instancing = node.extensions.instancing.as_ref();
                let instances = instancing.map(|all| all.read(data)).transpose().with_context(named)?;
                shown.meshes.push(ShownMesh { primitives, node: here, instances });
            }
        }
        Ok(shown)
    }

    /// The nodes at the top of the scene; without a scene, those without parents.
    fn roots(&self) -> Result<Vec<usize>> {
        let shown = self.scenes.get(self.scene.unwrap_or(0));
        if let Some(scene) = self.scene.filter(|_| shown.is_none()) {
            bail!("the file shows glTF scene {scene}, but has {}", self.scenes.len());
        }
        if let Some(scene) = shown {
            return Ok(scene.nodes.clone());
        }
        let mut has_parent = vec![false; self.nodes.len()];
        for child in self.nodes.iter().flat_map(|node| &node.children) {
            has_parent.get_mut(*child).into_iter().for_each(|has_parent| *has_parent = true);
        }
        Ok((0..self.nodes.len()).filter(|node| !has_parent[*node]).collect())
    }
}

impl Mesh {
    /// Adds the primitives with Gaussians. Returns their indices.
    fn add_to<'d>(&'d self, all: &mut Vec<&'d Primitive>) -> Result<Range<usize>> {
        let first = all.len();
        for primitive in self.primitives.iter().filter(|p| p.extensions.contains_key(EXTENSION)) {
            let mode = primitive.mode.unwrap_or(POINTS);
            ensure!(mode == POINTS, "a primitive with {EXTENSION} has mode {mode}, not {POINTS} (points)");
            all.push(primitive);
        }
        Ok(first..all.len())
    }
}

impl Node {
    /// The map to the axes of the parent.
    fn affine(&self) -> Result<DAffine3> {
        let Some(matrix) = &self.matrix else {
            let [scale, translation] = [self.scale.unwrap_or([1.0; 3]), self.translation.unwrap_or([0.0; 3])];
            return affine(scale, self.rotation.unwrap_or(UNTURNED), translation);
        };
        let matrix = DMat4::from_cols_array(matrix);
        ensure!(matrix.row(3).to_array() == [0.0, 0.0, 0.0, 1.0], "the last row of its matrix is not 0 0 0 1");
        Ok(DAffine3::from_mat4(matrix))
    }
}

impl Instancing {
    fn read<'d>(&self, data: &Data<'d>) -> Result<Instances<'d>> {
        let values = |name: &str, components: usize| {
            let accessor = self.attributes.get(name);
            accessor.map(|index| data.values(*index, components, &format!("{name} of {INSTANCING}"))).transpose()
        };
        let (translation, rotation, scale) = (values("TRANSLATION", 3)?, values("ROTATION", 4)?, values("SCALE", 3)?);
        let counts = || [&translation, &rotation, &scale].into_iter().flatten().map(|values| values.count);
        let count = counts().next().with_context(|| format!("{INSTANCING} has no attribute"))?;
        ensure!(counts().all(|other| other == count), "the attributes of {INSTANCING} have different lengths");
        Ok(Instances { count, translation, rotation, scale })
    }
}

impl ShownMesh<'_> {
    /// Number of times that the mesh is shown.
    pub fn count(&self) -> usize {
        self.instances.as_ref().map_or(1, |instances| instances.count)
    }

    /// The map from the axes of the mesh to those of the scene.
    ///
    /// # Errors
    /// If the place has no meaning.
    pub fn place(&self, instance: usize) -> Result<DAffine3> {
        let Some(Instances { translation, rotation, scale, .. }) = &self.instances else { return Ok(self.node) };
        let place = affine(
            scale.as_ref().map_or([1.0; 3], |values| values.row(instance)),
            rotation.as_ref().map_or(UNTURNED, |values| values.row(instance)),
            translation.as_ref().map_or([0.0; 3], |values| values.row(instance)),
        );
        Ok(self.node * place.with_context(|| format!("instance {instance} of a node"))?)
    }
}

/// The quaternion x y z w of no rotation.
const UNTURNED: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

fn affine(scale: [f64; 3], rotation: [f64; 4], translation: [f64; 3]) -> Result<DAffine3> {
    let [x, y, z, w] = rotation;
    let turn = DQuat::from_array(rotation).normalize();
    ensure!(turn.is_finite(), "{x} {y} {z} {w} is not a rotation");
    Ok(DAffine3::from_scale_rotation_translation(DVec3::from(scale), turn, DVec3::from(translation)))
}
