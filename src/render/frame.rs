//! The parts of a frame that both paths share: target, view, depth keys, sort positions, limits of subgroups.

use std::ops::Range;

use glam::DVec3;

use super::band::Band;
use super::patches::Patches;
use super::scene::GpuScene;
use super::shaders::{Slab, View};
use crate::camera::Camera;
use crate::gpu::{Device, Image};
use crate::options::Options;
use crate::rules::{Background, Footprint, LISTED_ALPHA, Order, Rules, TILE};
use crate::scene::Bounds;

/// The camera of a picture as it is drawn, before the picture is enlarged.
pub fn drawn_camera(options: &Options, camera: &Camera) -> Camera {
    camera.sampled(options.drawn_size(camera.size_px))
}

/// The scene and the camera of one frame, and the part of the picture that it draws.
#[derive(Clone, Copy)]
pub struct Shot<'a> {
    pub scene: &'a GpuScene,
    pub camera: &'a Camera,
    /// The rows that are drawn.
    pub band: Band,
    /// The patches that are drawn, if not all are. The rest of the image has no meaning.
    pub patches: Option<&'a Patches>,
}

impl<'a> Shot<'a> {
    /// The whole picture of a camera.
    pub fn new(scene: &'a GpuScene, camera: &'a Camera) -> Self {
        Self { scene, camera, band: Band::whole(camera.size_px), patches: None }
    }

    /// Width and height of the image.
    pub(super) fn size(&self) -> [u32; 2] {
        self.band.size(self.camera.size_px)
    }

    /// The number of tiles of the image.
    pub(super) fn tiles(&self) -> u32 {
        tiles(self.size()).iter().product()
    }

    /// A bit for each cell of a grid over the image, set if the cell is drawn.
    pub(super) fn open_cells(&self, cell_px: [u32; 2], cells: [u32; 2]) -> Vec<u32> {
        let all = || vec![u32::MAX; cells.iter().product::<u32>().div_ceil(32) as usize];
        self.patches.map_or_else(all, |patches| patches.cells(self.band, cell_px, cells))
    }

    /// The camera as the shaders read it.
    pub(super) fn view(&self, near: f32) -> View {
        View { band: self.band.word(), ..view(self.camera, near) }
    }
}

/// The images that a frame is drawn into, and the background.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    pub image: &'a Image,
    /// For [`Variation::Certifying`]: an image of the same size.
    pub certificate: Option<&'a Image>,
    pub background: Background,
}

/// The variants of a pipeline. All draw the same pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Variation {
    /// Only draws.
    #[default]
    Plain,
    /// The blend counts its work ([`Totals`](super::Totals) from `evaluations_low` on), which takes longer.
    Counting,
    /// Makes a certificate of every picture, which takes much longer.
    Certifying,
}

impl Variation {
    /// The alpha and the footprint by which splats are listed: a certificate needs lists with the splats that the
    /// picture omits.
    pub(in crate::render) fn listing(self, rules: &Rules) -> (f32, Footprint) {
        match self {
            Self::Plain | Self::Counting => (rules.alpha_min, rules.extent),
            Self::Certifying => (LISTED_ALPHA, Footprint::Exact),
        }
    }
}

/// The subgroup sizes of the pipelines of the portable path.
#[derive(Clone, Copy)]
pub(super) struct SubgroupLimits {
    pub smallest: u32,
    /// The number of 32-bit words in a ballot of the largest subgroup.
    pub ballot_words: u32,
}

/// The smallest subgroup that the portable path is built for.
const PORTABLE_SUBGROUP: u32 = 4;

impl SubgroupLimits {
    pub fn of(device: &Device, options: &Options) -> Self {
        let [smallest, largest] = device.capabilities().subgroup_size;
        match options.portable {
            true => Self { smallest: PORTABLE_SUBGROUP, ballot_words: 4 },
            false => Self { smallest, ballot_words: largest.div_ceil(32) },
        }
    }
}

/// The number of a footprint in shaders: `EXTENT_*` in rules.glsl.
pub(super) fn footprint_code(footprint: Footprint) -> u32 {
    use super::shaders::shared::{EXTENT_EXACT, EXTENT_THREE_SIGMA, EXTENT_THREE_SIGMA_SQUARES};
    match footprint {
        Footprint::Exact => EXTENT_EXACT,
        Footprint::ThreeSigma => EXTENT_THREE_SIGMA,
        Footprint::ThreeSigmaSquares => EXTENT_THREE_SIGMA_SQUARES,
    }
}

/// Columns and rows of tiles of an image.
pub(crate) fn tiles(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.div_ceil(TILE))
}

/// The number of bits of a tile number.
pub(super) fn tile_bits(tiles: u32) -> u32 {
    tiles.next_power_of_two().trailing_zeros()
}

/// The camera in f32, as the shaders read it. The vectors that decide a depth come in two parts, high and low.
pub fn view(camera: &Camera, near: f32) -> View {
    let split = |v: DVec3| (v.as_vec3().to_array(), (v - DVec3::from(v.as_vec3())).as_vec3().to_array());
    let (forward, forward_low) = split(camera.forward());
    let (position_high, position_low) = split(camera.position);
    View {
        right: camera.right().as_vec3().to_array(),
        down: camera.down().as_vec3().to_array(),
        forward,
        forward_low,
        position_high,
        position_low,
        focal_px: camera.focal_px.as_vec2().to_array(),
        centre_px: camera.centre_px.as_vec2().to_array(),
        size_px: camera.size_px,
        band: Band::whole(camera.size_px).word(),
        near,
    }
}

/// The number of bits of a key that has a value for every float from `near` to `far`, and one more.
pub(crate) fn depth_bits(near: f32, far: f64) -> u32 {
    let far = far.clamp(near.into(), f32::MAX.into()) as f32;
    u32::BITS - (far.to_bits() - near.to_bits() + 2).leading_zeros()
}

/// The format of depth keys. A key is the number of floats between the near plane and the depth of a splat, without its
/// lowest `shift` bits. With a shift of 0 it is exact, and it takes only the bits that the depth range of the scene
/// needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DepthKeys {
    /// The number of bits of a key: [`depth_bits`] from the near plane to the far end of the scene, less `shift`.
    pub bits: u32,
    pub shift: u32,
}

impl DepthKeys {
    /// The largest key of this number of bits.
    pub fn limit(self) -> u32 {
        ((1_u64 << self.bits) - 1) as u32
    }

    /// The depth keys of a scene within `extent`, seen by `camera`.
    pub fn of(camera: &Camera, options: &Options, extent: &Bounds) -> Self {
        let near = options.rules.near;
        let corner = |i: usize| {
            let pick = |axis: usize| f64::from(if i >> axis & 1 == 0 { extent.low[axis] } else { extent.high[axis] });
            let view = camera.view(DVec3::new(pick(0), pick(1), pick(2)));
            if options.rules.order == Order::Distance { view.length() } else { view.z }
        };
        let far = (0..8).map(corner).fold(f64::from(near), f64::max);
        let needed = depth_bits(near, far * (1.0 + 1e-5));
        let shift = needed.saturating_sub(options.key_bits);
        Self { bits: needed - shift, shift }
    }
}

/// A position in the total order of splats: the depth key in the upper 32 bits, the index of the Gaussian in the lower
/// ones.
pub(crate) type SortPosition = u64;

/// The first position of a depth key.
pub(crate) fn position_of(key: u32) -> SortPosition {
    u64::from(key) << 32
}

/// The slab of these positions, as shaders read it.
pub(crate) fn slab(range: &Range<SortPosition>) -> Slab {
    let pair = |position: SortPosition| [(position >> 32) as u32, position as u32];
    Slab { begin: pair(range.start), end: pair(range.end) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::Rules;

    #[test]
    fn depth_bits_grow_with_the_logarithm_of_the_depth_range() {
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [64, 64], 1.0);
        let keys = |far: f32, key_bits: u32| {
            let extent = Bounds { low: [-1.0, -1.0, 0.0], high: [1.0, 1.0, far] };
            let rules = Rules { near: 0.25, ..Rules::TRAINED };
            DepthKeys::of(&camera, &Options { rules, key_bits, ..Options::EXACT }, &extent)
        };
        let bits = |far: f32| {
            assert_eq!(keys(far, 32).shift, 0);
            keys(far, 32).bits
        };
        // From 0.25 to 2^k lie k + 2 octaves of 2^23 floats each.
        assert_eq!([0.49, 0.99, 3.9, 15.9, 1000.0].map(bits), [23, 24, 25, 26, 27]);
        assert!(bits(0.1) < 8, "nothing is ahead of the near plane");
        assert!(bits(f32::MAX) <= 31);
        assert_eq!(keys(15.9, 16), DepthKeys { bits: 16, shift: 10 });
        assert_eq!(keys(0.1, 16).shift, 0);
    }
}
