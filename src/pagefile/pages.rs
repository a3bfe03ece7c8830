//! The pages of a scene in the layout of a renderer, from a page file or from memory.

use std::ops::Range;
use std::sync::Arc;

use anyhow::Result;
use rayon::prelude::*;

use super::page::{PADDING, PAGE, Page, PageWords};
use super::page_lod::{ALWAYS, LEVEL_WORDS, NO_NODE, PageLod};
use super::reader::PageFile;
use crate::options::{Options, Storage};
use crate::packing::{Layout, Shape, Statistics, reach};
use crate::scene::{Gaussians, MAX_SH_DEGREE, sh_coefficients};

/// The pages of a scene. A clone shares them, and any number of threads may read.
#[derive(Clone)]
pub struct Pages(Arc<Inner>);

struct Inner {
    source: Source,
    statistics: Statistics,
    layout: Layout,
    alpha_min: f32,
    words: PageWords,
    pages: Vec<Page>,
    /// The pages include those of the levels of detail.
    has_levels: bool,
    /// The table of levels of several scenes together.
    joined_levels: Vec<PageLod>,
    notice: Option<String>,
}

/// A scene of which pages are made.
#[derive(Clone)]
pub enum PagedScene {
    File(Arc<PageFile>),
    Memory(Arc<Gaussians>, Arc<Statistics>),
}

impl PagedScene {
    pub fn statistics(&self) -> &Statistics {
        match self {
            Self::File(file) => &file.header().statistics,
            Self::Memory(_, statistics) => statistics,
        }
    }
}

enum Source {
    /// A file with the words of the layout, but without its reaches if `has_reaches` is false.
    File { file: Arc<PageFile>, has_reaches: bool },
    /// A lossless file, whose words are packed again.
    Repacked(Arc<PageFile>),
    /// Gaussians, and their indices in the order of the pages.
    Memory { gaussians: Arc<Gaussians>, order: Vec<u32> },
    /// Several scenes of one layout, each with its first page and the index of its first Gaussian.
    Joined(Vec<(Pages, usize, u32)>),
}

impl Pages {
    /// The pages of a file in the layout of `options`. A file that was stored with loss keeps its layout. The pages of
    /// its levels of detail are included if the options use levels.
    pub fn of_file(file: Arc<PageFile>, options: &Options) -> Self {
        let header = file.header();
        let (statistics, alpha_min) = (&header.statistics, options.rules.alpha_min);
        let has_levels = options.wants_levels() && header.levels.is_some();
        let wanted = layout_of(statistics, options, has_levels);
        Self::of_file_in(file, wanted, alpha_min, has_levels, false)
    }

    /// The pages of a file in a layout, or in its own layout if it was stored with loss and the layout does not keep
    /// all of that.
    fn of_file_in(file: Arc<PageFile>, wanted: Layout, alpha_min: f32, has_levels: bool, may_widen: bool) -> Self {
        let header = file.header();
        let (statistics, stored) = (header.statistics.clone(), &header.layout);
        let has_reaches = header.alpha_min == alpha_min;
        let all = if has_levels { file.pages() } else { &file.pages()[..header.scene_pages()] };
        let plain = |pages: &[Page]| match has_reaches {
            true => pages.to_vec(),
            false => pages.iter().map(|page| page.at(alpha_min, 1.0, 0.0)).collect(),
        };
        let keeps_all = may_widen && is_whole(&wanted) && wanted.sh_degree >= stored.sh_degree;
        let is_lossless = is_whole(stored) && stored.sh_degree >= statistics.requirements.sh_degree || keeps_all;
        let is_same = stored.has_words_of(&wanted);
        let (layout, pages, notice) = if is_same {
            (wanted, plain(all), None)
        } else if is_lossless {
            let (wider, denser) = largest_growth(&wanted);
            let pages = all.iter().map(|page| page.at(alpha_min, wider, denser)).collect();
            (wanted, pages, None)
        } else {
            let notice = format!(
                "the file stores spherical harmonics of degree {} as {} and shapes as {}, and is drawn so",
                stored.sh_degree, stored.sh.storage, stored.shape.storage
            );
            (stored.clone(), plain(all), Some(notice))
        };
        let words = PageWords::of(&layout);
        let source = if is_lossless && !is_same { Source::Repacked(file) } else { Source::File { file, has_reaches } };
        let joined_levels = Vec::new();
        Self(Arc::new(Inner { source, statistics, layout, alpha_min, words, pages, has_levels, joined_levels, notice }))
    }

    /// The pages of several scenes, one after another, in one layout: that of `options` if each scene can be brought
    /// into it without loss, otherwise in 32-bit floats. Indices of a scene continue those of the one before.
    pub fn joined(scenes: &[PagedScene], options: &Options) -> Self {
        let statistics = Statistics::joined(scenes.iter().map(PagedScene::statistics));
        let has_levels = options.wants_levels();
        let wanted = |options: &Options| layout_of(&statistics, options, has_levels);
        let alpha_min = options.rules.alpha_min;
        let pages_in = |layout: &Layout| {
            let of_scene = |scene: &PagedScene| match scene {
                PagedScene::File(file) => Self::of_file_in(file.clone(), layout.clone(), alpha_min, has_levels, true),
                PagedScene::Memory(gaussians, statistics) => {
                    Self::of_gaussians_in(gaussians.clone(), Statistics::clone(statistics), layout.clone(), alpha_min)
                }
            };
            scenes.iter().map(of_scene).collect::<Vec<_>>()
        };
        let mut layout = wanted(options);
        let mut all = pages_in(&layout);
        if all.iter().any(|pages| !pages.layout().has_words_of(&layout)) {
            let (sh_storage, shape_storage) = (Storage::F32, Storage::F32);
            layout = wanted(&Options { sh_storage, shape_storage, sh_degree: MAX_SH_DEGREE, ..*options });
            all = pages_in(&layout);
        }
        let (mut joined, mut pages, mut joined_levels, mut nodes) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for scene in all {
            let first = pages.len();
            if has_levels {
                joined_levels.extend((0..scene.pages().len()).map(|page| scene.level(page).after(first as u32)));
            }
            pages.extend_from_slice(scene.pages());
            let count = scene.nodes() as u32;
            joined.push((scene, first, nodes));
            nodes += count;
        }
        let (words, source) = (PageWords::of(&layout), Source::Joined(joined));
        let notice = None;
        Self(Arc::new(Inner { source, statistics, layout, alpha_min, words, pages, has_levels, joined_levels, notice }))
    }

    /// The entry of a page in the table of levels. A page of a scene without levels is in every cut.
    pub fn level(&self, page: usize) -> PageLod {
        self.levels().map_or_else(|| PageLod::always(&self.pages()[page]), |levels| levels[page])
    }

    /// The pages of Gaussians in memory, in the layout of `options`. They are packed when they are read.
    pub fn of_gaussians(gaussians: Arc<Gaussians>, statistics: Statistics, options: &Options) -> Self {
        let layout = Layout::of(&statistics, options);
        Self::of_gaussians_in(gaussians, statistics, layout, options.rules.alpha_min)
    }

    fn of_gaussians_in(gaussians: Arc<Gaussians>, statistics: Statistics, layout: Layout, alpha_min: f32) -> Self {
        let words = PageWords::of(&layout);
        let order = statistics.curve().order(gaussians.means());
        let page = |indices: &[u32]| {
            let mut geometry = vec![0; words.geometry()];
            let shape = |k: usize| Shape::of(&gaussians, indices[k] as usize);
            words.fill_geometry((&layout, alpha_min), indices.len(), shape, |k| indices[k], &mut geometry);
            Page::of(&words, &layout, &geometry)
        };
        let pages = order.par_chunks(PAGE).map(page).collect();
        let source = Source::Memory { gaussians, order };
        let (has_levels, joined_levels, notice) = (false, Vec::new(), None);
        Self(Arc::new(Inner { source, statistics, layout, alpha_min, words, pages, has_levels, joined_levels, notice }))
    }

    pub fn pages(&self) -> &[Page] {
        &self.0.pages
    }

    pub fn statistics(&self) -> &Statistics {
        &self.0.statistics
    }

    /// The layout of the words.
    pub fn layout(&self) -> &Layout {
        &self.0.layout
    }

    /// Gaussians may be culled where their alpha is below this.
    pub fn alpha_min(&self) -> f32 {
        self.0.alpha_min
    }

    /// The reason why the layout is not that of the options, as a clause.
    pub fn notice(&self) -> Option<&str> {
        self.0.notice.as_deref()
    }

    /// The table of levels; none if the pages are those of the scene alone.
    pub fn levels(&self) -> Option<&[PageLod]> {
        match &self.0.source {
            Source::File { file, .. } | Source::Repacked(file) if self.0.has_levels => file.levels(),
            Source::Joined(_) if self.0.has_levels => Some(&self.0.joined_levels),
            _ => None,
        }
    }

    /// The pages of each scene, one after another.
    pub fn scenes(&self) -> Vec<Range<usize>> {
        let range = |(pages, first, _): &(Self, usize, u32)| *first..first + pages.pages().len();
        match &self.0.source {
            Source::Joined(joined) => joined.iter().map(range).collect(),
            _ => std::iter::once(0..self.pages().len()).collect(),
        }
    }

    /// The number of Gaussians of each of the scenes, nodes included.
    pub fn nodes_of_scenes(&self) -> Vec<usize> {
        match &self.0.source {
            Source::Joined(joined) => joined.iter().map(|(pages, ..)| pages.nodes()).collect(),
            _ => vec![self.nodes()],
        }
    }

    /// Reads neighbouring pages scene by scene: `read` gets the scene, the index of its first Gaussian, its pages and
    /// their words, of which each page has `each`.
    fn by_scene(
        joined: &[(Self, usize, u32)],
        pages: &Range<usize>,
        each: usize,
        mut words: &mut [u32],
        read: impl Fn(&Self, u32, Range<usize>, &mut [u32]) -> Result<()>,
    ) -> Result<()> {
        for (scene, first, index) in joined {
            let own = pages.start.max(*first)..pages.end.min(first + scene.pages().len());
            if own.is_empty() {
                continue;
            }
            let (of_scene, rest) = words.split_at_mut(each * own.len());
            read(scene, *index, own.start - first..own.end - first, of_scene)?;
            words = rest;
        }
        Ok(())
    }

    /// Number of Gaussians in all pages, nodes included.
    pub fn nodes(&self) -> usize {
        self.0.pages.iter().map(|page| page.count as usize).sum()
    }

    /// Words of levels of a page: none if the pages are those of the scene alone.
    pub fn level_words(&self) -> usize {
        if self.0.has_levels { LEVEL_WORDS * PAGE } else { 0 }
    }

    /// As [`read_geometry`](Self::read_geometry), for the words of levels.
    ///
    /// # Errors
    /// Those of [`read_geometry`](Self::read_geometry).
    ///
    /// # Panics
    /// Where [`read_geometry`](Self::read_geometry) does.
    pub fn read_levels(&self, pages: Range<usize>, words: &mut [u32]) -> Result<()> {
        match &self.0.source {
            Source::File { file, .. } | Source::Repacked(file) if self.0.has_levels => file.read_levels(pages, words),
            Source::Joined(joined) if self.0.has_levels => {
                Self::by_scene(joined, &pages, self.level_words(), words, |scene, _, pages, words| {
                    match scene.levels().is_some() {
                        true => scene.read_levels(pages, words),
                        false => {
                            let all = words.chunks_exact_mut(LEVEL_WORDS * PAGE);
                            for (page, words) in scene.pages()[pages].iter().zip(all) {
                                let (nodes, padding) = words.as_chunks_mut().0.split_at_mut(page.count as usize);
                                nodes.fill(ALWAYS);
                                padding.fill(NO_NODE);
                            }
                            Ok(())
                        }
                    }
                })
            }
            _ => Ok(()),
        }
    }

    /// Words of the geometry of a page.
    pub fn geometry_words(&self) -> usize {
        self.0.words.geometry()
    }

    /// Words of the colours of a page.
    pub fn colour_words(&self) -> usize {
        self.0.words.colours()
    }

    /// True if the words come from memory, not from a file.
    pub fn is_in_memory(&self) -> bool {
        matches!(self.0.source, Source::Memory { .. })
    }

    /// Reads the geometry of neighbouring pages into as many words as they have.
    ///
    /// # Errors
    /// [`Unreadable`](crate::scene::Unreadable) if a page of a file cannot be read.
    ///
    /// # Panics
    /// If the number of words is not that of the pages, or the pages do not exist.
    pub fn read_geometry(&self, pages: Range<usize>, words: &mut [u32]) -> Result<()> {
        let inner = &*self.0;
        assert_eq!(words.len(), pages.len() * self.geometry_words(), "as many words as the pages have");
        match &inner.source {
            Source::File { file, has_reaches } => {
                file.read_geometry(pages, words)?;
                if !has_reaches {
                    let each = words.par_chunks_exact_mut(self.geometry_words());
                    each.for_each(|words| inner.renew_reaches(file, words));
                }
                Ok(())
            }
            Source::Repacked(file) => {
                let mut stored = vec![0; file.geometry_words() * pages.len()];
                file.read_geometry(pages, &mut stored)?;
                let each = words.par_chunks_exact_mut(self.geometry_words());
                each.zip(stored.par_chunks_exact(file.geometry_words())).for_each(|(words, stored)| {
                    inner.repack_geometry(file, stored, words);
                });
                Ok(())
            }
            Source::Memory { gaussians, order } => {
                let each = words.par_chunks_exact_mut(self.geometry_words());
                let parts = order[pages.start * PAGE..order.len().min(pages.end * PAGE)].par_chunks(PAGE);
                each.zip(parts).for_each(|(words, indices)| {
                    let shape = |k: usize| Shape::of(gaussians, indices[k] as usize);
                    inner.words.fill_geometry(inner.packing(), indices.len(), shape, |k| indices[k], words);
                });
                Ok(())
            }
            Source::Joined(joined) => {
                Self::by_scene(joined, &pages, self.geometry_words(), words, |scene, first, pages, words| {
                    scene.read_geometry(pages, words)?;
                    let ids = words.par_chunks_exact_mut(inner.words.geometry());
                    let ids = ids.flat_map(|page| &mut page[inner.words.ids.clone()]);
                    ids.filter(|id| **id != PADDING).for_each(|id| *id += first);
                    Ok(())
                })
            }
        }
    }

    /// As [`read_geometry`](Self::read_geometry), for the colours.
    ///
    /// # Errors
    /// Those of [`read_geometry`](Self::read_geometry).
    ///
    /// # Panics
    /// Where [`read_geometry`](Self::read_geometry) does.
    pub fn read_colours(&self, pages: Range<usize>, words: &mut [u32]) -> Result<()> {
        let inner = &*self.0;
        assert_eq!(words.len(), pages.len() * self.colour_words(), "as many words as the pages have");
        match &inner.source {
            Source::File { file, .. } => file.read_colours(pages, words),
            Source::Repacked(file) => {
                let mut stored = vec![0; file.colour_words() * pages.len()];
                file.read_colours(pages.clone(), &mut stored)?;
                let each = words.par_chunks_exact_mut(self.colour_words());
                each.zip(stored.par_chunks_exact(file.colour_words())).enumerate().for_each(|(i, (words, stored))| {
                    inner.repack_colours(file, pages.start + i, stored, words);
                });
                Ok(())
            }
            Source::Memory { gaussians, order } => {
                let each = words.par_chunks_exact_mut(self.colour_words());
                let parts = order[pages.start * PAGE..order.len().min(pages.end * PAGE)].par_chunks(PAGE);
                each.zip(parts).for_each(|(words, indices)| {
                    let sh = |k: usize| gaussians.sh(indices[k] as usize);
                    let (layout, count) = (&inner.layout, indices.len());
                    if gaussians.sh_degree() >= layout.sh_degree {
                        return inner.words.fill_colours(layout, count, words, sh);
                    }
                    // Beside a scene of a higher degree, the coefficients of that are 0.
                    let padded = |k: usize| {
                        let mut all = [[0.0; 3]; sh_coefficients(MAX_SH_DEGREE)];
                        all[..sh(k).len()].copy_from_slice(sh(k));
                        all
                    };
                    let all: Vec<_> = (0..count).map(padded).collect();
                    inner.words.fill_colours(layout, count, words, |k| &all[k]);
                });
                Ok(())
            }
            Source::Joined(joined) => {
                Self::by_scene(joined, &pages, self.colour_words(), words, |scene, _, pages, words| {
                    scene.read_colours(pages, words)
                })
            }
        }
    }
}

/// The layout of a scene, with the nodes of its levels if it has them.
fn layout_of(statistics: &Statistics, options: &Options, has_levels: bool) -> Layout {
    if has_levels { Layout::of_nodes(statistics, options) } else { Layout::of(statistics, options) }
}

/// True if words of the layout keep all bits of what they are made of.
fn is_whole(layout: &Layout) -> bool {
    [layout.sh, layout.shape].iter().all(|packing| packing.storage == Storage::F32 && packing.is_lossless)
}

impl Inner {
    fn packing(&self) -> (&Layout, f32) {
        (&self.layout, self.alpha_min)
    }

    /// Computes the reaches of a page for the threshold of the renderer. Gaussians that the file's threshold culled
    /// stay culled, unless the threshold of the renderer is lower.
    fn renew_reaches(&self, file: &PageFile, geometry: &mut [u32]) {
        let stays_culled = self.alpha_min >= file.header().alpha_min;
        for k in 0..PAGE {
            let is_culled = f32::from_bits(geometry[4 * k + 3]) < 0.0;
            if (is_culled && stays_culled) || geometry[self.words.ids.start + k] == PADDING {
                continue;
            }
            let (_, scale, opacity) = self.layout.unpacked_shape(&self.words.shape_of(geometry, k));
            geometry[4 * k + 3] = reach(scale, opacity, self.alpha_min.into());
        }
    }

    fn repack_geometry(&self, file: &PageFile, stored: &[u32], words: &mut [u32]) {
        let (layout, places) = (&file.header().layout, file.words());
        let ids = &stored[places.ids.clone()];
        let count = ids.iter().take_while(|id| **id != PADDING).count();
        let shape = |k: usize| places.unpacked(layout, stored, k);
        self.words.fill_geometry(self.packing(), count, shape, |k| ids[k], words);
    }

    fn repack_colours(&self, file: &PageFile, page: usize, stored: &[u32], words: &mut [u32]) {
        let layout = &file.header().layout;
        let unpacked = |k: usize| layout.unpacked_sh(&file.words().sh_of(stored, k));
        let all: Vec<_> = (0..file.pages()[page].count as usize).map(unpacked).collect();
        self.words.fill_colours(&self.layout, all.len(), words, |k| &all[k]);
    }
}

/// The largest factor by which packing increases a scale, and the most it adds to an opacity.
fn largest_growth(layout: &Layout) -> (f32, f32) {
    match layout.shape.storage {
        Storage::Lossless | Storage::F32 => (1.0, 0.0),
        // Half a step of 10 bits of mantissa.
        Storage::F16 => (1.0 + 1.0 / 2048.0, 1.0 / 2048.0),
        // Half a step of the grid, and the least opacity.
        Storage::U8 => ((0.51 * layout.grids().1.step).exp2(), 1.0 / 255.0),
    }
}
