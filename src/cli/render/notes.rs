//! Notes on pictures: without Gaussians, cut by the near plane, drawn in depth slabs for lack of memory.

use glam::DVec3;

use crate::camera::Camera;
use crate::cli::remark;
use crate::render::{Content, Frame, SceneSource};

/// The Gaussians of a scene in memory that are examined for each picture, evenly spread over their order. Their
/// projection takes some 20 us of the thread that reports.
const EXAMINED: usize = 4096;

/// The part of the examined Gaussians in view from which on a note says that the near plane cuts them away. In scenes
/// of usual size, few are that close to a camera.
const LARGE: f64 = 0.25;

/// What the notes of a run depend on. Each kind is printed once, but for empty pictures, which all have one.
pub(super) struct Notes {
    scene: SceneSource,
    /// World units.
    near: f64,
    near_is_noted: bool,
    slabs_are_noted: bool,
}

impl Notes {
    pub fn new(scene: &SceneSource, near: f32) -> Self {
        Self { scene: scene.clone(), near: near.into(), near_is_noted: false, slabs_are_noted: false }
    }

    /// Prints the notes on a frame of the GPU.
    pub fn on_frame(&mut self, files: &str, camera: &Camera, frame: &Frame) {
        self.on_view(files, camera, frame.totals.visible == 0);
        // Scenes in files and at places are drawn in slabs whatever the memory.
        let is_whole = matches!(self.scene.content, Content::Memory { .. }) && self.scene.instances.is_none();
        if frame.parts.is_some_and(|parts| parts.slabs > 1) && is_whole && !self.slabs_are_noted {
            self.slabs_are_noted = true;
            remark(
                "note: the scene or its lists exceed the memory or the largest buffer of the device: pictures are \
                 drawn in depth slabs, which changes no pixel and takes longer. A higher --memory, a smaller --size \
                 or --preset portable may be faster",
            );
        }
    }

    /// Prints the note on a picture, if it needs one. `is_empty` says that no Gaussian was drawn.
    pub fn on_view(&mut self, files: &str, camera: &Camera, is_empty: bool) {
        if !is_empty && self.near_is_noted {
            return;
        }
        match (self.cut(camera), is_empty) {
            (Some(cut), _) => {
                self.near_is_noted = true;
                let near = self.near as f32;
                remark(&format!(
                    "note: {files}: {cut} between the camera and the near plane of {near}; --near sets it"
                ));
            }
            (None, true) => remark(&format!("note: {files}: no Gaussian is in view")),
            (None, false) => {}
        }
    }

    /// What the near plane cuts away, as the beginning of a sentence, if that is much.
    fn cut(&self, camera: &Camera) -> Option<String> {
        let gaussians = match &self.scene.content {
            _ if self.scene.instances.is_some() => return None,
            Content::Memory { gaussians, .. } => gaussians,
            // A page file states where its scene is, and not more.
            Content::File(file) => {
                let centre = DVec3::from(file.header().statistics.focus.centre);
                let is_cut = camera.sees(centre) && camera.view(centre).z < self.near;
                return is_cut.then(|| "the middle of the scene lies".to_owned());
            }
        };
        let count = |step: usize| {
            let means = gaussians.means().iter().step_by(step).map(|mean| DVec3::from(mean.map(f64::from)));
            means
                .filter(|mean| camera.sees(*mean))
                .fold([0, 0], |[cut, all], mean| [cut + usize::from(camera.view(mean).z < self.near), all + 1])
        };
        let [cut, all] = count(gaussians.len().div_ceil(EXAMINED).max(1));
        if cut == 0 || (cut as f64) < LARGE * all as f64 {
            return None;
        }
        let [cut, all] = count(1);
        Some(format!("{cut} of {all} Gaussians in view lie"))
    }
}
