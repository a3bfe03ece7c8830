//! The buffers of a group of nodes, and its upload.

use anyhow::{Result, ensure};

use crate::gpu::{Buffer, Commands, Device, DispatchSize, Element, InFlight};
use crate::lod::{
    COLOUR_ROUNDS, Group, LANES, Node, Nodes, RESIDUALS, ROUND_DIRECTIONS, Round, SUM_TILE, VIEWS, Window,
};
use crate::render::shaders::fit::{FIT_FUNCTIONS, FIT_LANES, FIT_RESIDUALS, FIT_TILE};
use crate::render::shaders::{FitGradient, FitNode, FitRow, FitSpan, FitSplat, FitState, FitTile, FitUse, FitView};
use crate::scene::{harmonics, sh_coefficients};

const _: () = assert!(FIT_FUNCTIONS as usize == harmonics::FUNCTIONS && FIT_LANES as usize == LANES);
const _: () = assert!(FIT_TILE as usize == SUM_TILE && FIT_RESIDUALS as usize == RESIDUALS);

/// Rows and weights that there is room for at first, and at most.
const ROOM: [usize; 2] = [1 << 20, 1 << 21];
const MOST_ROOM: [usize; 2] = [1 << 25, 1 << 28];

/// Nodes of one kind, and what they look like in the pictures of one dispatch.
pub struct Drawn {
    pub nodes: Buffer<FitNode>,
    pub sh: Buffer<f32>,
    pub splats: Buffer<FitSplat>,
    pub spans: Buffer<FitSpan>,
    pub depths: Buffer<u32>,
    pub order: Buffer<u32>,
    pub used: Buffer<FitUse>,
}

impl Drawn {
    fn new(device: &Device) -> Result<Self> {
        Ok(Self {
            nodes: Buffer::new(device, "nodes", 1)?,
            sh: Buffer::new(device, "sh", 1)?,
            splats: Buffer::new(device, "splats", 1)?,
            spans: Buffer::new(device, "spans", 1)?,
            depths: Buffer::new(device, "depths", 1)?,
            order: Buffer::new(device, "order", 1)?,
            used: Buffer::new(device, "used", 1)?,
        })
    }

    fn reserve(&mut self, device: &Device, nodes: &Nodes, views: usize) -> Result<()> {
        let splats = nodes.len() * views;
        reserve(device, &mut self.nodes, nodes.len())?;
        reserve(device, &mut self.sh, 3 * nodes.sh.len())?;
        reserve(device, &mut self.splats, splats)?;
        reserve(device, &mut self.spans, splats)?;
        reserve(device, &mut self.depths, splats)?;
        reserve(device, &mut self.order, splats)
    }

    fn upload(&self, cmd: &mut Commands, nodes: &Nodes, is_new: impl Fn(usize) -> bool) -> Result<()> {
        cmd.upload(&self.nodes, 0, nodes.len(), |memory| {
            for (i, (memory, node)) in memory.iter_mut().zip(&nodes.nodes).enumerate() {
                let Node { mean, rotation, scale, opacity, size, .. } = *node;
                let is_new = f32::from(u8::from(is_new(i)));
                *memory = FitNode { mean, rotation, scale, opacity, size, colour: nodes.sh(i)[0], is_new };
            }
        })?;
        let sh: &[f32] = bytemuck::cast_slice(&nodes.sh);
        cmd.upload(&self.sh, 0, sh.len(), |memory| memory.copy_from_slice(sh))?;
        cmd.fill(&self.used, 0);
        Ok(())
    }
}

/// Makes a buffer of at least this length. Its content is lost if it grows.
fn reserve<T: Element>(device: &Device, buffer: &mut Buffer<T>, len: usize) -> Result<()> {
    if buffer.len() < len {
        *buffer = Buffer::new(device, buffer.name(), len.next_power_of_two())?;
    }
    Ok(())
}

/// The tiles of a window.
pub fn tiles_of(window: &Window) -> usize {
    window.width.div_ceil(SUM_TILE) * window.height.div_ceil(SUM_TILE)
}

/// The views of one dispatch, and the number of nodes in them.
#[derive(Clone, Copy)]
pub struct Part {
    pub nodes: u32,
    pub first_view: u32,
    pub views: u32,
    /// Most tiles of a view.
    pub tiles: u32,
}

impl Part {
    fn of(windows: &[Window], nodes: usize, first_view: usize, views: usize) -> Self {
        let tiles = windows[first_view..][..views].iter().map(tiles_of).max().unwrap_or(0);
        let [nodes, first_view, views, tiles] = [nodes, first_view, views, tiles].map(|number| number as u32);
        Self { nodes, first_view, views, tiles }
    }

    /// Workgroups for all nodes in all views, with this number of nodes in each.
    pub fn groups(self, nodes: u32) -> DispatchSize {
        DispatchSize::Groups(u64::from(self.views) * u64::from(self.nodes.div_ceil(nodes)))
    }

    /// A workgroup for each tile of all views.
    pub fn all_tiles(self) -> DispatchSize {
        DispatchSize::Groups(u64::from(self.views) * u64::from(self.tiles))
    }
}

/// What is recorded for a group.
pub struct Plan {
    pub coefficients: u32,
    /// All views of the children.
    pub children: Part,
    /// The views of each round of the fit of opacities and colours.
    pub corrections: Vec<Part>,
    /// The rounds of the fit of shapes, and the views of each.
    pub shapes: Vec<(Round, Part)>,
    /// The views in which errors are measured.
    pub measured: Part,
    pub bounds: ([f32; 3], [f32; 3]),
}

impl Plan {
    fn of(group: &Group, windows: &[Window], parents: usize) -> Self {
        let descent = &group.descent;
        let some = |first_view: usize| Part::of(windows, parents, first_view, ROUND_DIRECTIONS);
        let rounds = (VIEWS..windows.len()).step_by(ROUND_DIRECTIONS).cycle();
        Self {
            coefficients: sh_coefficients(descent.children.sh_degree) as u32,
            children: Part::of(windows, descent.children.len(), 0, windows.len()),
            corrections: (0..VIEWS).step_by(ROUND_DIRECTIONS).cycle().take(COLOUR_ROUNDS).map(some).collect(),
            shapes: descent.each_round().zip(rounds.map(some)).collect(),
            measured: Part::of(windows, parents, 0, VIEWS),
            bounds: descent.bounds,
        }
    }
}

/// The buffers of a group. They grow to what groups need.
pub struct Workspace {
    pub views: Buffer<FitView>,
    pub children: Drawn,
    pub parents: Drawn,
    pub states: Buffer<FitState>,
    pub rows: Buffer<FitRow>,
    /// Red, green, blue and transmittance of the pictures of the children.
    pub pictures: Buffer<[f32; 4]>,
    /// Those of the parents, where they are compared.
    pub drawn: Buffer<[f32; 4]>,
    pub covered: Buffer<f32>,
    pub weights: Buffer<f32>,
    pub slopes: Buffer<f32>,
    /// What is summed over the pixels of a node: several values of each pixel.
    pub values: Buffer<f32>,
    pub sums: Buffer<f32>,
    pub tiles: Buffer<FitTile>,
    pub gradients: Buffer<FitGradient>,
}

impl Workspace {
    pub fn new(device: &Device) -> Result<Self> {
        Ok(Self {
            views: Buffer::new(device, "views", 1)?,
            children: Drawn::new(device)?,
            parents: Drawn::new(device)?,
            states: Buffer::new(device, "states", 1)?,
            rows: Buffer::new(device, "rows", ROOM[0])?,
            pictures: Buffer::new(device, "pictures", 1)?,
            weights: Buffer::new(device, "weights", ROOM[1])?,
            slopes: Buffer::new(device, "slopes", ROOM[1])?,
            drawn: Buffer::new(device, "drawn", 1)?,
            covered: Buffer::new(device, "covered", 1)?,
            values: Buffer::new(device, "values", 1)?,
            sums: Buffer::new(device, "sums", 1)?,
            tiles: Buffer::new(device, "tiles", 1)?,
            gradients: Buffer::new(device, "gradients", 1)?,
        })
    }

    /// True if a group needed much more than others usually do.
    pub fn is_large(&self) -> bool {
        self.rows.len() > 4 * ROOM[0] || self.weights.len() > 4 * ROOM[1]
    }

    /// Makes room for more rows and weights.
    pub fn grow(&mut self, device: &Device) -> Result<()> {
        let room = [self.rows.len(), self.weights.len()];
        ensure!(room != MOST_ROOM, "the pictures of a group have too many rows");
        let [rows, weights] = [0, 1].map(|i| MOST_ROOM[i].min(2 * room[i]));
        reserve(device, &mut self.rows, rows)?;
        // Before the weights, by whose number the room is known.
        reserve(device, &mut self.slopes, weights)?;
        reserve(device, &mut self.weights, weights)
    }

    /// Makes room for a group, and submits its upload.
    pub fn load(&mut self, device: &Device, group: &Group, parents: &Nodes) -> Result<(Plan, InFlight)> {
        let (children, is_fitted) = (group.descent.children, group.descent.is_fitted);
        let windows = Vec::from_iter(group.windows.iter().chain(&group.descent.windows).copied());
        let (plan, views) = (Plan::of(group, &windows, parents.len()), views_of(&windows));
        reserve(device, &mut self.views, views.len())?;
        self.children.reserve(device, children, views.len())?;
        self.parents.reserve(device, parents, VIEWS)?;
        reserve(device, &mut self.states, parents.len())?;
        reserve(device, &mut self.gradients, parents.len() * ROUND_DIRECTIONS)?;
        reserve(device, &mut self.sums, parents.len() * VIEWS.max(ROUND_DIRECTIONS * RESIDUALS))?;
        reserve(device, &mut self.tiles, VIEWS * plan.measured.tiles as usize)?;
        let pixels = |windows: &[Window]| windows.iter().map(|window| window.width * window.height).sum::<usize>();
        let (all, measured) = (pixels(&windows), pixels(&group.windows));
        reserve(device, &mut self.pictures, all)?;
        reserve(device, &mut self.drawn, measured)?;
        reserve(device, &mut self.covered, measured)?;
        let of_round = |windows: &[Window]| windows.chunks(ROUND_DIRECTIONS).map(pixels).max().unwrap_or(0);
        let values = [RESIDUALS * of_round(&group.windows), 3 * of_round(&group.descent.windows), measured];
        reserve(device, &mut self.values, values.into_iter().max().unwrap_or(0))?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&self.views, 0, views.len(), |memory| memory.copy_from_slice(&views))?;
        self.children.upload(&mut cmd, children, |_| false)?;
        self.parents.upload(&mut cmd, parents, |parent| group.is_new[parent])?;
        cmd.upload(&self.states, 0, parents.len(), |memory| {
            for ((memory, node), is_fitted) in memory.iter_mut().zip(&parents.nodes).zip(is_fitted) {
                *memory = FitState {
                    merged_scale: node.scale,
                    merged_opacity: node.opacity,
                    is_fitted: f32::from(u8::from(*is_fitted)),
                    ..bytemuck::Zeroable::zeroed()
                };
            }
        })?;
        Ok((plan, cmd.submit()?))
    }
}

/// The windows as the shaders know them.
fn views_of(windows: &[Window]) -> Vec<FitView> {
    let words = |value: f64| [value.to_bits() as u32, (value.to_bits() >> 32) as u32];
    let mut pixels = 0;
    let view = |window: &Window| {
        let Window { direction, origin, px, width, height } = *window;
        let first_pixel = pixels as u32;
        pixels += width * height;
        FitView {
            right: direction.right.to_array().map(words),
            down: direction.down.to_array().map(words),
            forward: direction.forward.to_array().map(words),
            origin: [origin.x, origin.y].map(words),
            px: words(px),
            basis: harmonics::basis(direction.forward.to_array()).map(words),
            width: width as u32,
            height: height as u32,
            first_pixel,
        }
    };
    windows.iter().map(view).collect()
}
