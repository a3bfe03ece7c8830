//! A page: Gaussians that are read together, their words, and their entry in the table of a file.

use std::ops::Range;

use crate::packing::{Layout, MAX_FLOATS, Shape, pack_sh, pack_shapes, plane_widths, put, reach, take};

/// Gaussians of a page.
pub const PAGE: usize = 1024;

/// The index in the padding of the last page.
pub const PADDING: u32 = u32::MAX;

/// The reach of a Gaussian that is never drawn, and of a page without any that is drawn.
const NEVER_DRAWN: f32 = -1.0;

/// The bounds of a page, which are in the table of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Page {
    /// Smallest coordinates of the means, world units.
    pub low: [f32; 3],
    /// Largest coordinates of the means, world units.
    pub high: [f32; 3],
    /// No Gaussian of the page is drawn farther from its mean than this, world units; -1 if none is drawn at all.
    pub reach: f32,
    /// An upper bound on the scales, world units.
    pub largest_scale: f32,
    /// An upper bound on the opacities. Those of nodes that stand for several Gaussians may exceed 1.
    pub highest_opacity: f32,
    /// Gaussians in the page: [`PAGE`] of them, or fewer in the last.
    pub count: u32,
}

/// A page in the table of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    pub page: Page,
    /// XXH3 of the bytes of its geometry, and of its colours.
    pub checksums: [u64; 2],
}

/// Steps of a stored opacity.
const OPACITIES: f32 = 65535.0;

impl Page {
    /// The page with these words of geometry.
    pub fn of(words: &PageWords, layout: &Layout, geometry: &[u32]) -> Self {
        let mut page = Self {
            low: [f32::INFINITY; 3],
            high: [f32::NEG_INFINITY; 3],
            reach: NEVER_DRAWN,
            largest_scale: 0.0,
            highest_opacity: 0.0,
            count: 0,
        };
        let ids = &geometry[words.ids.clone()];
        for k in (0..PAGE).filter(|k| ids[*k] != PADDING) {
            let bounds = &geometry[4 * k..][..4];
            for ((low, high), bits) in page.low.iter_mut().zip(&mut page.high).zip(bounds) {
                let value = f32::from_bits(*bits);
                (*low, *high) = (low.min(value), high.max(value));
            }
            let (_, scale, opacity) = layout.unpacked_shape(&words.shape_of(geometry, k));
            page.reach = page.reach.max(f32::from_bits(bounds[3] & 0xffff_0000));
            page.largest_scale = scale.iter().copied().fold(page.largest_scale, f32::max);
            page.highest_opacity = page.highest_opacity.max(opacity);
            page.count += 1;
        }
        page.largest_scale = rounded_up(page.largest_scale);
        page.highest_opacity = (page.highest_opacity * OPACITIES).ceil().min(OPACITIES) / OPACITIES;
        page
    }

    /// The page with bounds for the alpha threshold `alpha_min`, after packing that makes scales larger by the factor
    /// `wider` and opacities by `denser` at most.
    #[must_use]
    pub fn at(&self, alpha_min: f32, wider: f32, denser: f32) -> Self {
        let largest_scale = rounded_up((self.largest_scale * wider).min(f32::MAX));
        let highest_opacity = (self.highest_opacity + denser).min(self.highest_opacity.max(1.0));
        let bits = reach([largest_scale; 3], highest_opacity, alpha_min.into());
        Self { reach: f32::from_bits(bits & 0xffff_0000), largest_scale, highest_opacity, ..*self }
    }
}

/// The least bfloat16 that is not less than `value`, which is not negative.
fn rounded_up(value: f32) -> f32 {
    f32::from_bits(value.to_bits().div_ceil(1 << 16) << 16)
}

impl Entry {
    /// Bytes of an entry.
    pub const BYTES: usize = 48;

    /// The entry as it is stored.
    pub fn encoded(&self) -> [u8; Self::BYTES] {
        let Page { low, high, reach, largest_scale, highest_opacity, count } = self.page;
        let mut bytes = [0; Self::BYTES];
        let floats = low.iter().chain(&high).flat_map(|v| v.to_le_bytes());
        let upper = |value: f32| (value.to_bits() >> 16) as u16;
        let halves = [upper(reach), upper(largest_scale), (highest_opacity * OPACITIES).round() as u16, count as u16];
        let all = floats.chain(halves.into_iter().flat_map(u16::to_le_bytes));
        let all = all.chain(self.checksums.into_iter().flat_map(u64::to_le_bytes));
        bytes.iter_mut().zip(all).for_each(|(to, from)| *to = from);
        bytes
    }

    /// The entry in these bytes.
    pub fn decoded(bytes: &[u8; Self::BYTES]) -> Self {
        let float = |i: usize| f32::from_le_bytes(std::array::from_fn(|k| bytes[4 * i + k]));
        let half = |i: usize| u16::from_le_bytes([bytes[24 + 2 * i], bytes[25 + 2 * i]]);
        let long = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| bytes[32 + 8 * i + k]));
        let page = Page {
            low: [float(0), float(1), float(2)],
            high: [float(3), float(4), float(5)],
            reach: f32::from_bits(u32::from(half(0)) << 16),
            largest_scale: f32::from_bits(u32::from(half(1)) << 16),
            highest_opacity: f32::from(half(2)) / OPACITIES,
            count: half(3).into(),
        };
        Self { page, checksums: [long(0), long(1)] }
    }

    /// True if no value is out of its range.
    pub fn is_plausible(&self) -> bool {
        let Page { low, high, reach, largest_scale, count, .. } = self.page;
        let is_box = low.iter().zip(high).all(|(low, high)| low.is_finite() && high.is_finite() && *low <= high);
        is_box && (reach >= 0.0 || reach == NEVER_DRAWN) && largest_scale >= 0.0 && (1..=PAGE as u32).contains(&count)
    }
}

/// The layout of the words of a page. Its geometry is a plane of bounds, the planes of shapes and a plane of indices;
/// its colours are the planes of spherical harmonics.
#[derive(Clone, Debug)]
pub struct PageWords {
    /// The words of each plane of shapes in the geometry.
    shapes: Vec<Range<usize>>,
    shape_words: usize,
    /// The words of the indices in the geometry.
    pub ids: Range<usize>,
    /// The words of each plane of spherical harmonics in the colours.
    sh: Vec<Range<usize>>,
    sh_words: usize,
}

impl PageWords {
    pub fn of(layout: &Layout) -> Self {
        let planes = |words: usize, mut start: usize| -> Vec<Range<usize>> {
            let plane = |width: usize| {
                let range = start..start + width * PAGE;
                start = range.end;
                range
            };
            plane_widths(words).map(plane).collect()
        };
        let (shape_words, sh_words) = (layout.shape_words(), layout.sh_words());
        let shapes = planes(shape_words, 4 * PAGE);
        let end = shapes.last().map_or(4 * PAGE, |plane| plane.end);
        Self { shapes, shape_words, ids: end..end + PAGE, sh: planes(sh_words, 0), sh_words }
    }

    /// Words of the geometry of a page.
    pub fn geometry(&self) -> usize {
        self.ids.end
    }

    /// Words of the colours of a page.
    pub fn colours(&self) -> usize {
        self.sh.last().map_or(0, |plane| plane.end)
    }

    /// The words of the rotation, scale and opacity of Gaussian `k` of a page.
    pub fn shape_of(&self, geometry: &[u32], k: usize) -> [u32; 8] {
        let mut words = [0; 8];
        let planes = self.shapes.iter().map(|plane| &geometry[plane.clone()]);
        take(planes, k, &mut words[..self.shape_words]);
        words
    }

    /// Gaussian `k` of a page, unpacked from words of this layout.
    pub fn unpacked(&self, layout: &Layout, geometry: &[u32], k: usize) -> Shape {
        let mean = std::array::from_fn(|axis| f32::from_bits(geometry[4 * k + axis]));
        let (rotation, scale, opacity) = layout.unpacked_shape(&self.shape_of(geometry, k));
        Shape { mean, rotation, scale, opacity }
    }

    /// The words of the spherical harmonics of Gaussian `k` of a page.
    pub fn sh_of(&self, colours: &[u32], k: usize) -> [u32; MAX_FLOATS] {
        let mut words = [0; MAX_FLOATS];
        take(self.sh.iter().map(|plane| &colours[plane.clone()]), k, &mut words[..self.sh_words]);
        words
    }

    /// Fills the geometry of a page with `count` Gaussians: place `k` with `shape(k)`, which has this `id` in the whole
    /// scene. The other places are padded.
    pub fn fill_geometry(
        &self,
        (layout, alpha_min): (&Layout, f32),
        count: usize,
        shape: impl Fn(usize) -> Shape,
        id: impl Fn(usize) -> u32,
        words: &mut [u32],
    ) {
        words.fill(0);
        let (bounds, rest) = words.split_at_mut(4 * PAGE);
        let (shapes, ids) = rest.split_at_mut(self.ids.start - 4 * PAGE);
        for (k, place) in ids.iter_mut().enumerate() {
            *place = if k < count { id(k) } else { PADDING };
        }
        let (bounds, padding) = bounds.as_chunks_mut().0.split_at_mut(count);
        padding.iter_mut().for_each(|bounds: &mut [u32; 4]| bounds[3] = NEVER_DRAWN.to_bits());
        pack_shapes(layout, alpha_min, shape, bounds, &mut split(&self.shapes, shapes));
    }

    /// Number of words of a record.
    pub fn record_words(&self) -> usize {
        4 + 1 + self.shape_words + self.sh_words
    }

    /// Appends the record of Gaussian `k` of a page: all of its words.
    pub fn append_record(&self, geometry: &[u32], colours: &[u32], k: usize, records: &mut Vec<u32>) {
        records.extend_from_slice(&geometry[4 * k..][..4]);
        records.push(geometry[self.ids.start + k]);
        records.extend_from_slice(&self.shape_of(geometry, k)[..self.shape_words]);
        records.extend_from_slice(&self.sh_of(colours, k)[..self.sh_words]);
    }

    /// Fills the geometry and the colours of a page with records. The other places are padded.
    pub fn fill_records(&self, records: &[&[u32]], geometry: &mut [u32], colours: &mut [u32]) {
        geometry.fill(0);
        colours.fill(0);
        let (bounds, rest) = geometry.split_at_mut(4 * PAGE);
        let (shapes, ids) = rest.split_at_mut(self.ids.start - 4 * PAGE);
        ids.fill(PADDING);
        bounds.as_chunks_mut().0.iter_mut().for_each(|bounds: &mut [u32; 4]| bounds[3] = NEVER_DRAWN.to_bits());
        let (mut shapes, mut sh) = (split(&self.shapes, shapes), split(&self.sh, colours));
        for (k, record) in records.iter().enumerate() {
            let (own_bounds, rest) = record.split_at(4);
            bounds[4 * k..][..4].copy_from_slice(own_bounds);
            ids[k] = rest[0];
            let (own_shape, own_sh) = rest[1..].split_at(self.shape_words);
            put(&mut shapes, k, self.shape_words, |word| own_shape[word]);
            put(&mut sh, k, self.sh_words, |word| own_sh[word]);
        }
    }

    /// Fills the colours of a page with `count` Gaussians: place `k` with the spherical harmonics `sh(k)`.
    pub fn fill_colours<'s>(
        &self,
        layout: &Layout,
        count: usize,
        words: &mut [u32],
        sh: impl Fn(usize) -> &'s [[f32; 3]],
    ) {
        words.fill(0);
        pack_sh(layout, count, sh, &mut split(&self.sh, words));
    }
}

/// The planes in words that hold them one after another.
fn split<'w>(planes: &[Range<usize>], mut words: &'w mut [u32]) -> Vec<&'w mut [[u32; 4]]> {
    let mut parts = Vec::with_capacity(planes.len());
    for plane in planes {
        let (part, rest) = words.split_at_mut(plane.len());
        parts.push(part.as_chunks_mut().0);
        words = rest;
    }
    parts
}
