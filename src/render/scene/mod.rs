//! MAP

pub(crate) mod gpu_scene;
mod page_cache;
mod scene_source;
mod self_test_input;

pub use gpu_scene::GpuScene;
pub(crate) use gpu_scene::Paged;
pub use page_cache::PagesRead;
pub(crate) use page_cache::{Pool, ReadPage};
pub use scene_source::{Content, NoLevels, SceneSource};
pub(crate) use self_test_input::{TRIAL, TRIAL_SIZE};
