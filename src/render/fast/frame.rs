//! The inputs of a frame of the fast path that is drawn from pages or in slabs.

use super::grid::BinGrid;
use super::pipeline::FastPipeline;
use super::workspace::FastWorkspace;
use crate::options::Options;
use crate::render::frame::{DepthKeys, Shot, Target};

/// A frame of the fast path: the stages and the buffers that draw it, and what it shows.
#[derive(Clone, Copy)]
pub struct FastFrame<'a> {
    pub pipeline: &'a FastPipeline,
    pub work: &'a FastWorkspace,
    /// The options of the frame. Their LOD limits may differ from those that the pipeline was built with.
    pub options: &'a Options,
    pub shot: Shot<'a>,
    pub target: Target<'a>,
    pub grid: BinGrid,
}

impl<'a> FastFrame<'a> {
    pub fn new(
        pipeline: &'a FastPipeline,
        work: &'a FastWorkspace,
        options: &'a Options,
        shot: Shot<'a>,
        target: Target<'a>,
    ) -> Self {
        let grid = pipeline.grid_of(shot, shot.scene.drawn_len(options));
        Self { pipeline, work, options, shot, target, grid }
    }

    /// The format of the depth keys of the frame.
    pub fn depth_keys(&self) -> DepthKeys {
        DepthKeys::of(self.shot.camera, self.options, &self.shot.scene.extent)
    }
}
