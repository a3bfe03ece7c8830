//! The pages of a scene in the layout of a renderer, from a page file or from memory.

use std::ops::Range;
use std::sync::Arc;

use anyhow::Result;
use rayon::prelude::*;

use super::page::{PADDING, PAGE, Page, PageWords};
use super::page_lod::{LEVEL_WORDS, PageLod};
use super::reader::PageFile;
use crate::options::{Options, Storage};
use crate::packing::{Layout, Packing, Shape, Statistics, reach};
use crate::scene::Gaussians;

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
    notice: Option<String>,
}

enum Source {
    /// A file with the words of the layout, but without its reaches if `has_reaches` is false.
    File { file: Arc<PageFile>, has_reaches: bool },
    /// A lossless file, whose words are packed again.
    Repacked(Arc<PageFile>),
    /// Gaussians, and their indices in the order of the pages.
    Memory { gaussians: Arc<Gaussians>, order: Vec<u32> },
}

impl Pages {
    /// The pages of a file in the layout of `options`. A file that was stored with loss keeps its layout. The pages of
    /// its levels of detail are included if the options use levels.
    pub fn of_file(file: Arc<PageFile>, options: &Options) -> Self {
        let header = file.header();
        let (statistics, alpha_min) = (header.statistics.clone(), options.rules.alpha_min);
        let (stored, has_reaches) = (&header.layout, header.alpha_min == alpha_min);
        let has_levels = options.wants_levels() && header.levels.is_some();
        let (wanted, all) = match has_levels {
            true => (Layout::of_nodes(&statistics, options), file.pages()),
            false => (Layout::of(&statistics, options), &file.pages()[..header.scene_pages()]),
        };
        let plain = |pages: &[Page]| match has_reaches {
            true => pages.to_vec(),
            false => pages.iter().map(|page| page.at(alpha_min, 1.0, 0.0)).collect(),
        };
        let is_whole = |packing: Packing| packing.storage == Storage::F32 && packing.is_lossless;
        let is_lossless =
            is_whole(stored.sh) && is_whole(stored.shape) && stored.sh_degree >= statistics.requirements.sh_degree;
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
        Self(Arc::new(Inner { source, statistics, layout, alpha_min, words, pages, has_levels, notice }))
    }

    /// The pages of Gaussians in memory, in the layout of `options`. They are packed when they are read.
    pub fn of_gaussians(gaussians: Arc<Gaussians>, statistics: Statistics, options: &Options) -> Self {
        let layout = Layout::of(&statistics, options);
        let (words, alpha_min) = (PageWords::of(&layout), options.rules.alpha_min);
        let order = statistics.curve().order(gaussians.means());
        let page = |indices: &[u32]| {
            let mut geometry = vec![0; words.geometry()];
            let shape = |k: usize| Shape::of(&gaussians, indices[k] as usize);
            words.fill_geometry((&layout, alpha_min), indices.len(), shape, |k| indices[k], &mut geometry);
            Page::of(&words, &layout, &geometry)
        };
        let pages = order.par_chunks(PAGE).map(page).collect();
        let source = Source::Memory { gaussians, order };
        let (has_levels, notice) = (false, None);
        Self(Arc::new(Inner { source, statistics, layout, alpha_min, words, pages, has_levels, notice }))
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
            _ => None,
        }
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
                    inner
                        .words
                        .fill_colours(&inner.layout, indices.len(), words, |k| gaussians.sh(indices[k] as usize));
                });
                Ok(())
            }
        }
    }
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
