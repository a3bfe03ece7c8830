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
    sample: Sample,
    /// World units.
    near: f64,
    /// The scene is in memory, and is drawn as it is.
    is_whole: bool,
    near_is_noted: bool,
    slabs_are_noted: bool,
}

/// Places in the scene.
enum Sample {
    /// Every so many Gaussians.
    Means(Vec<DVec3>, usize),
    /// A page file states no more.
    Middle(DVec3),
}

impl Notes {
    pub fn new(scene: &SceneSource, near: f32) -> Self {
        let is_placed = scene.instances.is_some();
        let sample = match &scene.content {
            Content::Memory { .. } if is_placed => Sample::Means(Vec::new(), 1),
            Content::Memory { gaussians, .. } => {
                let step = gaussians.len().div_ceil(EXAMINED).max(1);
                let means = gaussians.means().iter().step_by(step).map(|mean| DVec3::from(mean.map(f64::from)));
                Sample::Means(means.collect(), step)
            }
            Content::File(file) => Sample::Middle(DVec3::from(file.header().statistics.focus.centre)),
        };
        let is_whole = matches!(scene.content, Content::Memory { .. }) && !is_placed;
        Self { sample, near: near.into(), is_whole, near_is_noted: false, slabs_are_noted: false }
    }

    /// Prints the notes on a frame of the GPU.
    pub fn on_frame(&mut self, files: &str, camera: &Camera, frame: &Frame) {
        self.on_view(files, camera, frame.totals.visible == 0);
        // Scenes in files and at places are drawn in slabs whatever the memory.
        if frame.parts.is_some_and(|parts| parts.slabs > 1) && self.is_whole && !self.slabs_are_noted {
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
        match self.cut(camera) {
            Some(cut) => {
                self.near_is_noted = true;
                let near = self.near as f32;
                remark(&format!(
                    "note: {files}: {cut} between the camera and the near plane of {near}; --near sets it"
                ));
            }
            None if is_empty => remark(&format!("note: {files}: no Gaussian is in view")),
            None => {}
        }
    }

    /// What the near plane cuts away, as the beginning of a sentence, if that is much.
    fn cut(&self, camera: &Camera) -> Option<String> {
        let is_cut = |place: &&DVec3| camera.view(**place).z < self.near;
        match &self.sample {
            Sample::Means(means, step) => {
                let in_view: Vec<_> = means.iter().filter(|mean| camera.sees(**mean)).collect();
                let cut = in_view.iter().copied().filter(is_cut).count();
                if cut == 0 || (cut as f64) < LARGE * in_view.len() as f64 {
                    return None;
                }
                let about = if *step > 1 { "about " } else { "" };
                Some(format!("{about}{} of {} Gaussians in view lie", cut * step, in_view.len() * step))
            }
            Sample::Middle(middle) => {
                (camera.sees(*middle) && is_cut(&middle)).then(|| "the middle of the scene lies".to_owned())
            }
        }
    }
}
