//! Occlusion: the stop depths of a picture. Groups of nodes behind them are hidden, and drawn coarser
//! (`glsl/lod/hidden.glsl`).
//!
//! A frame that waits for its pages draws its view twice, first as if nothing were hidden, so that it depends on the
//! view alone. A streamed frame takes the stop depths of the last one.

use anyhow::Result;

use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::render::fast::{BinGrid, FastFrame};
use crate::render::frame::Shot;
use crate::render::pages::{Element, views_of};
use crate::render::scene::GpuScene;
use crate::render::shaders;
use crate::render::shaders::fast::BLOCKS;
use crate::render::shaders::lod::{StopDepths, StopDepthsBindings, StopDepthsPush};
use crate::render::shaders::pages::VIEW_ELEMENTS;

/// What is hidden in a view: the stop depths of a picture, which selections read.
pub struct Occlusion {
    /// Made for the first picture.
    stage: Option<Stage<StopDepths>>,
    /// Of every block of the picture, then of every bin.
    pub(super) depths: Buffer<f32>,
    /// The views of its camera.
    pub(super) views: Buffer<Element>,
    picture: Option<DrawnPicture>,
    role: Role,
    /// A frame that took the stop depths is complete.
    is_used: bool,
    /// The last frame took stop depths of another camera than its own.
    is_behind: bool,
}

/// What frames do with stop depths.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    /// They take them, and leave them.
    Take,
    /// They take none, and replace them.
    Measure,
    /// They take those of the last frame, and replace them.
    Follow,
}

/// The picture that made the stop depths.
#[derive(Clone)]
struct DrawnPicture {
    camera: Camera,
    options: Options,
    grid: BinGrid,
}

impl Occlusion {
    /// # Errors
    /// If memory runs out.
    pub fn new(device: &Device, scene: &GpuScene) -> Result<Self> {
        let views = VIEW_ELEMENTS as usize * scene.transforms().len();
        Ok(Self {
            stage: None,
            depths: Buffer::new(device, "stop depths", 1)?,
            views: Buffer::new(device, "views of stop depths", views)?,
            picture: None,
            role: Role::Take,
            is_used: false,
            is_behind: false,
        })
    }

    /// Frames take the stop depths of the frame before them from now on.
    pub fn follow(&mut self) {
        self.role = Role::Follow;
    }

    /// Nothing is hidden, until [`Occlusion::keep`] keeps the stop depths that the frames until then make.
    pub fn measure(&mut self) {
        (self.picture, self.role) = (None, Role::Measure);
    }

    /// Frames take the present stop depths from now on.
    pub fn keep(&mut self) {
        (self.role, self.is_used) = (Role::Take, false);
    }

    /// A frame that took the stop depths is complete.
    pub fn set_used(&mut self) {
        self.is_used = true;
    }

    /// A frame begins.
    pub fn begin_frame(&mut self) {
        self.is_behind = false;
    }

    /// True if another frame with the same camera would take the stop depths of its own view.
    pub fn is_behind(&self) -> bool {
        self.is_behind
    }

    /// Frames take the stop depths of another selection of the scene from now on; with `None`, none.
    pub fn share(&mut self, other: Option<&Self>) {
        (self.picture, self.role) = (None, Role::Take);
        if let Some(Self { depths, views, picture, .. }) = other {
            (self.depths, self.views, self.picture) = (depths.clone(), views.clone(), picture.clone());
        }
    }

    /// True if frames take the stop depths of the picture of this camera by these options. Unless `may_be_used`, no
    /// complete frame may have done so.
    pub fn is_of(&self, camera: &Camera, options: &Options, may_be_used: bool) -> bool {
        let is_taken = self.role == Role::Take && (may_be_used || !self.is_used);
        is_taken && self.picture.as_ref().is_some_and(|p| p.camera == *camera && p.options == *options)
    }

    /// The stop depths that the selection for a picture takes.
    pub(super) fn words(&self, camera: &Camera, options: &Options) -> shaders::Occlusion {
        let projection = |camera: &Camera| (camera.size_px, camera.focal_px, camera.centre_px);
        let is_taken =
            |picture: &&DrawnPicture| self.role != Role::Measure && projection(&picture.camera) == projection(camera);
        let Some(picture) = self.picture.as_ref().filter(is_taken) else {
            return shaders::Occlusion { factor_squared: 1.0, is_of_this_camera: 0, block_height: 0, bins: [0; 2] };
        };
        shaders::Occlusion {
            factor_squared: (2.0 * options.lod_occlusion).exp2(),
            is_of_this_camera: (picture.camera == *camera).into(),
            block_height: picture.grid.block_height,
            bins: picture.grid.bins,
        }
    }

    /// Records the stop depths of a frame behind its blend, if it measures them.
    ///
    /// # Errors
    /// If memory runs out, or the pipeline cannot be made.
    pub fn record(&mut self, device: &Device, cmd: &mut Commands, frame: &FastFrame) -> Result<()> {
        let FastFrame { work, options, shot: Shot { scene, camera, .. }, grid, .. } = *frame;
        if self.role == Role::Take {
            return Ok(());
        }
        if !options.simplifies_hidden() {
            self.picture = None;
            return Ok(());
        }
        self.is_behind = self.picture.as_ref().is_none_or(|picture| picture.camera != *camera);
        let length = (grid.count() * (BLOCKS + 1)) as usize;
        if self.depths.len() != length {
            self.depths = Buffer::new(device, "stop depths", length)?;
        }
        let stage = match &mut self.stage {
            Some(stage) => stage,
            none => none.insert(Stage::new(device, &())?),
        };
        let views = views_of(scene, camera, &options.rules);
        // The selection of this frame reads the former ones.
        cmd.barrier(Access::SHADER, Access::SHADER | Access::COPY_WRITE);
        cmd.upload(&self.views, 0, views.len(), |memory| memory.copy_from_slice(&views))?;
        let bindings = StopDepthsBindings { stop_keys: &work.stop_keys, stop_depths: &self.depths };
        let push = StopDepthsPush {
            size_px: camera.size_px,
            bins: grid.bins,
            block_height: grid.block_height,
            depth_shift: frame.depth_keys().shift,
            near: options.rules.near,
        };
        let groups = DispatchSize::Groups(grid.count().into());
        cmd.scope("occlusion", |cmd| cmd.dispatch(stage, bindings, push, groups));
        cmd.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::SHADER_READ);
        self.picture = Some(DrawnPicture { camera: camera.clone(), options: *options, grid });
        Ok(())
    }

    /// Takes these stop depths of a picture.
    #[cfg(test)]
    pub fn set(
        &mut self,
        device: &Device,
        Shot { scene, camera, .. }: Shot,
        options: &Options,
        grid: BinGrid,
        depths: &[f32],
    ) -> Result<()> {
        let views = views_of(scene, camera, &options.rules);
        self.depths = Buffer::new(device, "stop depths", depths.len())?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&self.depths, 0, depths.len(), |memory| memory.copy_from_slice(depths))?;
        cmd.upload(&self.views, 0, views.len(), |memory| memory.copy_from_slice(&views))?;
        cmd.submit()?.wait()?;
        self.picture = Some(DrawnPicture { camera: camera.clone(), options: *options, grid });
        Ok(())
    }
}
