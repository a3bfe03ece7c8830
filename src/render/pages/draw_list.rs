//! The draw list: the pages that a dispatch draws and the views it draws them for, as page.glsl reads them.

use super::visibility::PlacedCamera;
use crate::camera::Camera;
use crate::gpu::Buffer;
use crate::render::frame::view;
use crate::render::scene::GpuScene;
use crate::render::shaders::View;
use crate::render::shaders::pages::{HAS_INDICES, PAGE, VIEW_ELEMENTS};
use crate::rules::Rules;
use crate::scene::Transform;

/// An element of a draw list.
pub type Element = [u32; 4];

/// A draw list in device memory, and the words of its pages beside the planes of the scene.
pub struct DrawList<'a> {
    /// The views, the number of pages, the pages: [`PageDraw`].
    pub elements: &'a Buffer<Element>,
    /// The number of the element with the first page.
    pub first_page: u32,
    /// The indices of Gaussians, if pages have them.
    pub indices: &'a Buffer<u32>,
    /// The words of levels of detail, if pages have them.
    pub levels: &'a Buffer<u32>,
}

/// One page of a draw list: `PageDraw` in page.glsl.
#[derive(Clone, Copy, Debug)]
pub struct PageDraw {
    pub slot: u32,
    /// Error limits, as codes: for its nodes in the lower half, for their parents in the upper half.
    pub error_limits: u32,
    /// The number of its view.
    pub view: u32,
    /// Number of Gaussians.
    pub count: u32,
    /// True if a plane has the indices of its Gaussians; otherwise these are their positions in the planes.
    pub has_indices: bool,
}

impl PageDraw {
    pub fn element(self) -> Element {
        [self.slot, self.error_limits, self.view, self.count | if self.has_indices { HAS_INDICES } else { 0 }]
    }
}

/// Largest number of pages of a draw list, unless the page cache holds more.
const MAX_PAGES: usize = 1 << 16;

/// The number of the element with the first page, after the views of all instances and the number of pages.
pub fn first_page(scene: &GpuScene) -> u32 {
    VIEW_ELEMENTS * scene.transforms().len() as u32 + 1
}

/// The element before the pages, with their number.
pub fn number_of_pages(pages: usize) -> Element {
    [pages as u32, 0, 0, 0]
}

/// Largest number of pages in a draw list of this scene.
pub fn max_pages(scene: &GpuScene) -> usize {
    let Some(paged) = scene.paged() else { return scene.len().div_ceil(PAGE as usize) };
    let cache = paged.cache();
    let placed = cache.pages().pages().len().saturating_mul(scene.transforms().len());
    placed.min(MAX_PAGES).max(cache.capacity())
}

/// The views of a scene, one for each of its instances.
pub fn views_of(scene: &GpuScene, camera: &Camera, rules: &Rules) -> Vec<Element> {
    let one = |place: &Transform| {
        let placed = PlacedCamera::of(camera, place);
        let (mut near, scale) = (placed.near(rules) as f32, placed.scale as f32);
        // A depth rounded to less than the near plane of the world would have the largest key.
        while scale * near < rules.near {
            near = near.next_up();
        }
        element(&view(&placed.camera, near), scale)
    };
    scene.transforms().iter().flat_map(one).collect()
}

/// The view of a placement with this scale: `PlacedView` in page.glsl.
fn element(view: &View, scale: f32) -> [Element; VIEW_ELEMENTS as usize] {
    let vectors =
        [view.right, view.down, view.forward, view.forward_low, view.position_high, view.position_low].into_iter();
    let floats = vectors.flatten().chain([view.near, scale]);
    let mut words = [[0; 4]; VIEW_ELEMENTS as usize];
    words.as_flattened_mut().iter_mut().zip(floats).for_each(|(word, float)| *word = float.to_bits());
    words
}
