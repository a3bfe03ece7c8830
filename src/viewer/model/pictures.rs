//! The state of the two pictures: drawing and building them.

use std::time::SystemTime;

use super::plan::Plan;
use crate::camera::Camera;

/// The state of the two pictures. Arrays are indexed by [`Side`](super::plan::Side).
pub struct Pictures {
    /// The pictures must be drawn again.
    pub are_stale: bool,
    /// The view of the last drawing, of which depths and explanations are; `None` before it.
    pub view: Option<Camera>,
    /// Numbers of the builds under way.
    pub building: [Option<u64>; 2],
    /// The last build to which other devices were given, or are being given.
    pub shared: Option<u64>,
    /// True while other devices are being prepared.
    pub is_sharing: bool,
    /// Plans whose build failed, so that the build is not repeated every frame.
    pub refused: [Option<Plan>; 2],
    /// Messages about shaders that could not be compiled.
    pub shader_errors: [Option<String>; 2],
    /// The newest change of the shaders that are compiled at run time; `None` if all shaders are built in.
    pub shaders: Option<SystemTime>,
    /// Number of the last build.
    generation: u64,
}

impl Default for Pictures {
    fn default() -> Self {
        Self {
            are_stale: true,
            view: None,
            building: [None; 2],
            shared: None,
            is_sharing: false,
            refused: [None, None],
            shader_errors: [None, None],
            shaders: None,
            generation: 0,
        }
    }
}

impl Pictures {
    /// True while a picture is being built.
    pub fn is_any_building(&self) -> bool {
        self.building.iter().any(Option::is_some)
    }

    /// The number of the next build.
    pub fn next_generation(&mut self) -> u64 {
        self.generation += 1;
        self.generation
    }
}
