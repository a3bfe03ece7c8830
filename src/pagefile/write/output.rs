//! The pages of a file that is being written.

use std::fs::File;
use std::io;

use anyhow::{Result, ensure};
use rayon::prelude::*;
use twox_hash::XxHash3_64;

use super::group_checkpoint::GroupBounds;
use crate::files::{read_exact_at, write_all_at};
use crate::host_memory::host_zeros;
use crate::lod::Node;
use crate::packing::{Layout, Shape};
use crate::pagefile::{
    Entry, HEADER, Header, LEVEL_WORDS, LodSections, NO_NODE, PAGE, Page, PageLod, PageWords, level_words,
};
use crate::scene::Gaussians;

/// A page file that is being written. Pages are written in any order, on many threads.
pub struct Output<'f> {
    pub(crate) file: &'f File,
    pub(crate) layout: &'f Layout,
    pub(crate) alpha_min: f32,
    pub(crate) words: PageWords,
    /// Byte offsets of the three streams and of the table of levels.
    pub(crate) offsets: [u64; 4],
}

/// The largest opacity that fits into 16-bit floats, with room for rounding.
pub const MOST_OPACITY: f32 = 60_000.0;

/// Pages that a thread packs at a time.
const BATCH_PAGES: usize = 16;

impl<'f> Output<'f> {
    /// A file with at most `pages` pages.
    pub fn new(file: &'f File, (layout, alpha_min): (&'f Layout, f32), pages: usize) -> Self {
        let words = PageWords::of(layout);
        Self { file, layout, alpha_min, offsets: Header::stream_offsets(pages, &words), words }
    }

    /// The same layout in another file.
    pub fn for_file(&self, file: &'f File) -> Self {
        Self { file, words: PageWords::of(self.layout), ..*self }
    }

    /// Writes the Gaussians `order` from page `first` on. `id` is the index of a Gaussian in the whole scene.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(
        &self,
        first: usize,
        gaussians: &Gaussians,
        order: &[u32],
        id: impl Fn(u32) -> u32 + Sync,
    ) -> io::Result<()> {
        let parts = order.par_chunks(BATCH_PAGES * PAGE).enumerate();
        parts.try_for_each(|(i, order)| self.write_part(first + i * BATCH_PAGES, gaussians, order, &id))
    }

    fn write_part(
        &self,
        first: usize,
        gaussians: &Gaussians,
        order: &[u32],
        id: impl Fn(u32) -> u32,
    ) -> io::Result<()> {
        let pages = order.len().div_ceil(PAGE);
        let each = [self.words.geometry(), self.words.colours()];
        let mut streams = each.map(|words| vec![0_u32; pages * words]);
        let mut entries = Vec::with_capacity(pages * Entry::BYTES);
        let [geometry, colours] = &mut streams;
        let both = geometry.chunks_exact_mut(each[0]).zip(colours.chunks_exact_mut(each[1]));
        for ((geometry, colours), order) in both.zip(order.chunks(PAGE)) {
            let index = |k: usize| order[k] as usize;
            let shape = |k: usize| Shape::of(gaussians, index(k));
            self.words.fill_geometry((self.layout, self.alpha_min), order.len(), shape, |k| id(order[k]), geometry);
            self.words.fill_colours(self.layout, order.len(), colours, |k| gaussians.sh(index(k)));
            entries.extend(self.entry(geometry, colours).encoded());
        }
        self.put(first, &streams, &entries)
    }

    /// Writes page `page`, which `fill` makes in its geometry and colours.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_page(&self, page: usize, fill: impl FnOnce(&mut [u32], &mut [u32])) -> io::Result<()> {
        let mut streams = [self.words.geometry(), self.words.colours()].map(|words| vec![0; words]);
        let [geometry, colours] = &mut streams;
        fill(geometry, colours);
        let entry = self.entry(geometry, colours);
        self.put(page, &streams, &entry.encoded())
    }

    /// The entry of a page. Its words become little-endian.
    fn entry(&self, geometry: &mut [u32], colours: &mut [u32]) -> Entry {
        let page = Page::of(&self.words, self.layout, geometry);
        Entry { page, checksums: [geometry, colours].map(sealed) }
    }

    /// Writes the streams and the entries of pages from page `first` on.
    fn put(&self, first: usize, streams: &[Vec<u32>; 2], entries: &[u8]) -> io::Result<()> {
        let each = [self.words.geometry(), self.words.colours()];
        for ((words, each), offset) in streams.iter().zip(each).zip(self.offsets) {
            write_all_at(self.file, bytemuck::cast_slice(words), offset + (first * each * 4) as u64)?;
        }
        write_all_at(self.file, entries, (HEADER + first * Entry::BYTES) as u64)
    }

    /// Writes the words of levels of a page with these nodes, Gaussians of the scene or others, whose own errors and
    /// parents' errors are codes. Returns its entry in the table of levels, which lacks the page of the parents.
    pub fn write_words(
        &self,
        page: usize,
        (nodes, is_scene): (&[Node], bool),
        [own, parents]: [&[u16]; 2],
        bounds: &GroupBounds,
    ) -> io::Result<PageLod> {
        let mut words = vec![0; LEVEL_WORDS * PAGE];
        for (k, words) in words.as_chunks_mut::<LEVEL_WORDS>().0.iter_mut().enumerate() {
            *words = match nodes.get(k) {
                None => NO_NODE,
                Some(node) => {
                    let opacities = [node.opacity, node.opacity_sum].map(|value| value.min(MOST_OPACITY));
                    level_words(own[k], parents[k], (!is_scene).then_some(opacities))
                }
            };
        }
        let checksum = sealed(&mut words);
        let [.., words_at, _] = self.offsets;
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        write_all_at(self.file, bytes, words_at + (page * bytes.len()) as u64)?;
        let GroupBounds { low, high, reference_width, own_reference_width } = *bounds;
        let lod = PageLod::of(nodes, [own, parents], (own_reference_width / reference_width).min(1.0).powi(2));
        let highest_opacity = lod.highest_opacity.min(MOST_OPACITY);
        Ok(PageLod { low, high, reference_width, highest_opacity, checksum, ..lod })
    }

    /// Writes the entry of a page in the table of levels.
    pub fn write_lod(&self, page: usize, lod: &PageLod) -> io::Result<()> {
        let [.., table_at] = self.offsets;
        write_all_at(self.file, &lod.encoded(), table_at + (page * PageLod::BYTES) as u64)
    }

    /// The header with the offsets of this file.
    pub fn with_offsets(&self, mut header: Header) -> Header {
        let [geometry_at, colours_at, words_at, table_at] = self.offsets;
        (header.geometry_at, header.colours_at) = (geometry_at, colours_at);
        header.levels = header.levels.map(|levels| LodSections { words_at, table_at, ..levels });
        header
    }

    /// Writes the header of a file that has all of its pages.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn finish(&self, header: Header) -> Result<()> {
        let mut header = self.with_offsets(header);
        let mut table: Vec<u8> = host_zeros(header.pages() * Entry::BYTES, "table of pages")?;
        read_exact_at(self.file, &mut table, HEADER as u64)?;
        let entries: Vec<Entry> = table.as_chunks().0.iter().map(Entry::decoded).collect();
        let count: usize = entries[..header.scene_pages()].iter().map(|entry| entry.page.count as usize).sum();
        let is_sound = entries.iter().all(Entry::is_plausible) && count == header.statistics.count;
        ensure!(is_sound, "the checkpoint of an earlier run is damaged: run it again");
        header.table_checksum = XxHash3_64::oneshot(&table);
        if let Some(levels) = &mut header.levels {
            let mut table: Vec<u8> = host_zeros(entries.len() * PageLod::BYTES, "table of levels")?;
            read_exact_at(self.file, &mut table, levels.table_at)?;
            levels.checksum = XxHash3_64::oneshot(&table);
        }
        self.file.set_len(header.file_bytes())?;
        write_all_at(self.file, &header.encoded(), 0)?;
        Ok(())
    }
}

/// Makes words little-endian, as they are stored, and returns their checksum.
pub fn sealed(words: &mut [u32]) -> u64 {
    words.iter_mut().for_each(|word| *word = word.to_le());
    XxHash3_64::oneshot(bytemuck::cast_slice(words))
}
