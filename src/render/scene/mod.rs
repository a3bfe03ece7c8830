//! Scenes before and in device memory: [`SceneSource`] is uploaded to a device as a [`GpuScene`], whole or as a cache
//! of pages.
//!
//! - `scene_source` - a scene before it is on a device: Gaussians in memory or a page file, with scene instances
//! - `joined_scenes` - several scenes that are drawn together from one page cache
//! - `gpu_scene` - the planes of Gaussians in device memory, with all of them or with the resident pages
//! - `features` - numbers that are drawn in the place of colours
//! - `page_cache` - the pages in device memory: it evicts the least recently used page, or in streamed frames the pages
//!   that `streaming/schedule` chooses by priority
//! - `self_test_input` - the Gaussians and the camera of the self-test of the fast path

mod features;
pub(crate) mod gpu_scene;
mod joined_scenes;
mod page_cache;
mod scene_source;
mod self_test_input;

pub use features::Features;
pub use gpu_scene::GpuScene;
pub(crate) use gpu_scene::{Paged, SceneInput};
pub use joined_scenes::JoinedScenes;
pub use page_cache::PagesRead;
pub(crate) use page_cache::{LoadedPage, PageCache};
pub use scene_source::{Content, NoLevels, SceneSource, Upload};
pub(crate) use self_test_input::{
    SELF_TEST_GAUSSIANS, SELF_TEST_SIZE, SelfTest, SelfTestInput, self_test, self_test_camera,
};
