//! The projection of listed pages on the fast path: of a slab, or of a whole picture.

use anyhow::Result;

use super::draw_list::Listed;
use crate::gpu::{Buffer, Commands, Device, DispatchSize, Stage};
use crate::render::fast::{FastFrame, FastPipeline};
use crate::render::frame::Shot;
use crate::render::inspect::Attribute;
use crate::render::shaders::inspect::NO_ATTRIBUTE;
use crate::render::shaders::pages::{Project, ProjectBindings, ProjectConstants, ProjectPush, QUARTERS};
use crate::render::shaders::{CutState, Slab};

/// The stage, built for one set of options and one layout of a scene.
pub struct PageProjection {
    project: Stage<Project>,
}

/// How many pages are listed.
pub enum Count<'a> {
    Known(usize),
    /// The byte in a state where the dispatch over their quarters lies.
    OnDevice(&'a Buffer<CutState>, usize),
}

impl PageProjection {
    /// Splats have their colours, or an attribute in the place of these.
    pub fn new(device: &Device, fast: &FastPipeline, attribute: Option<Attribute>) -> Result<Self> {
        let (constants, subgroup) = fast.constants();
        let attribute = attribute.map_or(NO_ATTRIBUTE, |attribute| attribute as u32);
        let constants = ProjectConstants { attribute, ..ProjectConstants::of(constants) };
        Ok(Self { project: Stage::of_subgroups(device, &constants, subgroup)? })
    }

    /// Projects the splats of the listed pages in the slab, and appends them to those projected before.
    pub fn record(&self, cmd: &mut Commands, frame: &FastFrame, listed: &Listed, count: Count, slab: Slab) {
        let FastFrame { work, options, shot: Shot { scene, camera }, grid, .. } = *frame;
        let keys = frame.depth_keys();
        let bindings = ProjectBindings {
            bounds: &scene.bounds,
            grids: &scene.grids,
            shapes: scene.shape_planes(),
            sh: scene.sh_planes(),
            gaussian_from_splat: &work.gaussian_from_splat,
            splats: &work.splats,
            depth_keys: &work.depth_keys,
            span_ranges: &work.span_ranges,
            spans: &work.spans,
            counters: &work.counters,
            listed: listed.elements,
            indices: listed.indices,
            levels: listed.levels,
        };
        let push = ProjectPush {
            slab,
            focal_px: camera.focal_px.as_vec2().to_array(),
            centre_px: camera.centre_px.as_vec2().to_array(),
            size_px: camera.size_px,
            near: options.rules.near,
            first_page: listed.first_page,
            visible_capacity: work.visible_capacity(),
            span_capacity: work.spans.len() as u32,
            depth_limit: keys.limit(),
            depth_shift: keys.shift,
            block_height: grid.block_height,
            gaussians: scene.nodes as u32,
            right: camera.right().as_vec3().to_array(),
            down: camera.down().as_vec3().to_array(),
            forward: camera.forward().as_vec3().to_array(),
        };
        match count {
            Count::Known(pages) => {
                let groups = DispatchSize::Groups(u64::from(QUARTERS) * pages as u64);
                cmd.dispatch(&self.project, bindings, push, groups);
            }
            Count::OnDevice(state, offset) => cmd.dispatch_indirect(&self.project, bindings, push, state, offset),
        }
    }
}
