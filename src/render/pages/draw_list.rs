//! The pages that a slab draws and the views that they are seen from, as page.glsl reads them.

use super::visibility::PlacedCamera;
use crate::camera::Camera;
use crate::gpu::Buffer;
use crate::render::frame::view;
use crate::render::scene::GpuScene;
use crate::render::shaders::View;
use crate::render::shaders::pages::{HAS_INDICES, PAGE, VIEW_ELEMENTS};
use crate::rules::Rules;
use crate::scene::Transform;

/// An element of the buffer of listed pages.
pub type Element = [u32; 4];

/// What a slab draws.
pub struct Listed<'a> {
    /// The views, the number of pages, the pages.
    pub elements: &'a Buffer<Element>,
    /// The element with the first page.
    pub first_page: u32,
    /// The indices of Gaussians, where pages have them.
    pub indices: &'a Buffer<u32>,
    /// The words of levels, where pages have them.
    pub levels: &'a Buffer<u32>,
}

/// A page that a dispatch draws: ListedPage in page.glsl.
#[derive(Clone, Copy, Debug)]
pub struct ListedPage {
    pub slot: u32,
    /// Of errors, as codes: of its nodes in the lower half, of their parents in the upper half.
    pub limits: u32,
    /// The number of its view.
    pub view: u32,
    /// Number of Gaussians.
    pub filled: u32,
    /// The indices of its Gaussians are in a plane; else they are their places.
    pub has_indices: bool,
}

impl ListedPage {
    pub fn element(self) -> Element {
        [self.slot, self.limits, self.view, self.filled | if self.has_indices { HAS_INDICES } else { 0 }]
    }
}

/// The most pages that a dispatch lists, if more are not in the pool at a time.
const MOST_LISTED: usize = 1 << 16;

/// The element with the first page, behind the views of all placements and the number of pages.
pub fn first_page(scene: &GpuScene) -> u32 {
    VIEW_ELEMENTS * scene.transforms().len() as u32 + 1
}

/// The element before the first of so many pages.
pub fn number_of_pages(pages: usize) -> Element {
    [pages as u32, 0, 0, 0]
}

/// Elements for the pages that a dispatch lists.
pub fn room_for_pages(scene: &GpuScene) -> usize {
    let Some(paged) = scene.paged() else { return scene.len().div_ceil(PAGE as usize) };
    let pool = paged.cache();
    let placed = pool.pages().pages().len().saturating_mul(scene.transforms().len());
    placed.min(MOST_LISTED).max(pool.capacity())
}

/// The views of a scene, one for each of its placements.
pub fn views_of(scene: &GpuScene, camera: &Camera, rules: &Rules) -> Vec<Element> {
    let one = |place: &Transform| {
        let placed = PlacedCamera::of(camera, place);
        let (mut near, scale) = (placed.near(rules) as f32, placed.scale as f32);
        // Rounding must not bring a depth before the near plane of the world: such a key would be the largest.
        while scale * near < rules.near {
            near = near.next_up();
        }
        element(&view(&placed.camera, near), scale)
    };
    scene.transforms().iter().flat_map(one).collect()
}

/// A view of a scene that is placed with this scale: PlacedView in page.glsl.
fn element(view: &View, scale: f32) -> [Element; VIEW_ELEMENTS as usize] {
    let vectors =
        [view.right, view.down, view.forward, view.forward_low, view.position_high, view.position_low].into_iter();
    let floats = vectors.flatten().chain([view.near, scale]);
    let mut words = [[0; 4]; VIEW_ELEMENTS as usize];
    words.as_flattened_mut().iter_mut().zip(floats).for_each(|(word, float)| *word = float.to_bits());
    words
}
