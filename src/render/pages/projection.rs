//! The projection of the pages of a draw list on the fast path, for a slab or for a whole frame.

use anyhow::Result;

use super::draw_list::DrawList;
use crate::gpu::{Buffer, Commands, Device, DispatchSize, Stage};
use crate::render::fast::{FastFrame, FastPipeline};
use crate::render::frame::Shot;
use crate::render::inspect::Attribute;
use crate::render::shaders::inspect::NO_ATTRIBUTE;
use crate::render::shaders::pages::{Project, ProjectBindings, ProjectConstants, ProjectPush, QUARTERS};
use crate::render::shaders::{SelectionState, Slab};

/// The stage `project`, built for one set of options and one scene layout.
pub struct PageProjection {
    project: Stage<Project>,
}

/// The number of pages in the draw list.
pub enum PageCount<'a> {
    Known(usize),
    /// The number is in device memory: the byte offset of the dispatch over quarters of pages in a state.
    OnDevice(&'a Buffer<SelectionState>, usize),
}

impl PageProjection {
    /// With an `attribute`, splats show it instead of their colours.
    pub fn new(device: &Device, fast: &FastPipeline, attribute: Option<Attribute>) -> Result<Self> {
        let (constants, subgroup) = fast.constants();
        let attribute = attribute.map_or(NO_ATTRIBUTE, |attribute| attribute as u32);
        let constants = ProjectConstants { attribute, ..ProjectConstants::of(constants) };
        Ok(Self { project: Stage::of_subgroups(device, &constants, subgroup)? })
    }

    /// Projects the Gaussians of these pages that are in the slab, and appends their splats to those of the frame.
    pub fn record(&self, cmd: &mut Commands, frame: &FastFrame, draw_list: &DrawList, count: PageCount, slab: Slab) {
        let FastFrame { work, options, shot: Shot { scene, camera, band, .. }, grid, .. } = *frame;
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
            draw_list: draw_list.elements,
            indices: draw_list.indices,
            levels: draw_list.levels,
        };
        let push = ProjectPush {
            slab,
            focal_px: camera.focal_px.as_vec2().to_array(),
            centre_px: camera.centre_px.as_vec2().to_array(),
            size_px: camera.size_px,
            band: band.word(),
            near: options.rules.near,
            first_page: draw_list.first_page,
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
            PageCount::Known(pages) => {
                let groups = DispatchSize::Groups(u64::from(QUARTERS) * pages as u64);
                cmd.dispatch(&self.project, bindings, push, groups);
            }
            PageCount::OnDevice(state, offset) => cmd.dispatch_indirect(&self.project, bindings, push, state, offset),
        }
    }
}
