//! The nodes of a hierarchy, in the numbers that merging needs.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DQuat, DVec3};

use crate::scene::{Gaussians, sh_coefficients};

/// A Gaussian of the scene, or one that stands for several.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Node {
    pub mean: [f32; 3],
    /// Unit quaternion w x y z, local to world.
    pub rotation: [f32; 4],
    /// Standard deviations, world units.
    pub scale: [f32; 3],
    /// The largest alpha before it is clamped: may exceed 1 in a node that stands for several Gaussians.
    pub opacity: f32,
    /// The sum of the opacities of its Gaussians. If all of them are smaller than a pixel, the classic rules widen each
    /// to a pixel and keep its opacity, so this is the opacity of all together.
    pub opacity_sum: f32,
    /// The own error, world units: the root of the squared difference between pictures of the node and of its children,
    /// summed over the area and the colour channels (0 to 1), per saved node. 0 for a Gaussian of the scene; not less
    /// than the error of any descendant.
    pub error: f32,
    /// The largest standard deviation of this node and of all merged descendants, world units.
    pub size: f32,
    /// The squared error against the Gaussians of the scene in pixels of the reference width, world units squared: the
    /// sum over all merges below.
    pub squared_error: f32,
}

impl Node {
    /// A Gaussian of the scene.
    pub fn leaf(mean: [f32; 3], rotation: [f32; 4], scale: [f32; 3], opacity: f32) -> Self {
        Self { mean, rotation, scale, opacity, opacity_sum: opacity, error: 0.0, size: 0.0, squared_error: 0.0 }
    }

    pub fn centre(&self) -> DVec3 {
        DVec3::from(self.mean.map(f64::from))
    }

    /// The rotation times the scales: the columns are the half axes.
    pub fn axes(&self) -> DMat3 {
        let turn = DMat3::from_quat(self.turn());
        let [a, b, c] = self.scale.map(f64::from);
        DMat3::from_cols(turn.x_axis * a, turn.y_axis * b, turn.z_axis * c)
    }

    /// The rotation, local to world.
    pub fn turn(&self) -> DQuat {
        let [w, x, y, z] = self.rotation.map(f64::from);
        DQuat::from_xyzw(x, y, z, w).normalize()
    }

    pub fn covariance(&self) -> DMat3 {
        let axes = self.axes();
        axes * axes.transpose()
    }

    /// The side of a square of its [`Node::area`].
    pub fn width(&self) -> f64 {
        self.area().sqrt()
    }

    /// The area of its projection, averaged over all directions, up to a constant: the sum of the three faces of the
    /// box around the ellipsoid.
    pub fn area(&self) -> f64 {
        area(self.scale.map(f64::from))
    }
}

/// See [`Node::area`].
pub fn area([a, b, c]: [f64; 3]) -> f64 {
    a * b + b * c + c * a
}

/// The corners of the box around points.
pub fn corners(points: impl Iterator<Item = [f32; 3]>) -> ([f32; 3], [f32; 3]) {
    points.fold(([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]), |(low, high), point| {
        ([0, 1, 2].map(|i| low[i].min(point[i])), [0, 1, 2].map(|i| high[i].max(point[i])))
    })
}

/// The median; 0 of no values.
pub fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Nodes and their spherical harmonics.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Nodes {
    pub nodes: Vec<Node>,
    /// Red, green, blue of each basis function, node by node.
    pub sh: Vec<[f32; 3]>,
    pub sh_degree: u32,
}

impl Nodes {
    pub fn new(sh_degree: u32) -> Self {
        Self { sh_degree, ..Self::default() }
    }

    /// The Gaussians of a scene with these indices.
    pub fn of(scene: &Gaussians, indices: impl IntoIterator<Item = usize>) -> Self {
        let mut nodes = Self::new(scene.sh_degree());
        for i in indices {
            let node = Node::leaf(scene.means()[i], scene.rotations()[i], scene.scales()[i], scene.opacities()[i]);
            nodes.push(node, scene.sh(i));
        }
        nodes
    }

    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    pub fn sh(&self, index: usize) -> &[[f32; 3]] {
        let stride = sh_coefficients(self.sh_degree);
        &self.sh[index * stride..][..stride]
    }

    pub fn sh_mut(&mut self, index: usize) -> &mut [[f32; 3]] {
        let stride = sh_coefficients(self.sh_degree);
        &mut self.sh[index * stride..][..stride]
    }

    /// Adds a node.
    ///
    /// # Panics
    /// If it has fewer spherical harmonics than the others.
    pub fn push(&mut self, node: Node, sh: &[[f32; 3]]) {
        self.nodes.push(node);
        self.sh.extend_from_slice(&sh[..sh_coefficients(self.sh_degree)]);
    }

    /// Adds all nodes of another set of the same degree.
    pub fn append(&mut self, other: &Self) {
        assert_eq!(self.sh_degree, other.sh_degree, "nodes of one hierarchy have one degree");
        self.nodes.extend_from_slice(&other.nodes);
        self.sh.extend_from_slice(&other.sh);
    }

    /// The corners of the box around all means.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        corners(self.nodes.iter().map(|node| node.mean))
    }

    /// The width of the median node.
    pub fn width(&self) -> f64 {
        median(self.nodes.iter().map(Node::width).collect())
    }

    /// The nodes with these indices.
    #[must_use]
    pub fn selected(&self, indices: &[u32]) -> Self {
        let mut selected = Self::new(self.sh_degree);
        indices.iter().for_each(|i| selected.push(self.nodes[*i as usize], self.sh(*i as usize)));
        selected
    }
}
