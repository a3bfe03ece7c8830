//! A page file that is open for reading.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Result, anyhow, ensure};
use rayon::prelude::*;
use twox_hash::XxHash3_64;

use super::fault::{ReadFault, simulated};
use super::header::{HEADER, Header};
use super::page::{Entry, PAGE, Page, PageWords};
use super::page_lod::{LEVEL_WORDS, PageLod};
use super::write::levels_of_pages;
use crate::files::{describe, open_regular, read_exact_at};
use crate::formats::PAGE_FILE_SIGNATURE;
use crate::host_memory::host_zeros;
use crate::packing::{Layout, Statistics};
use crate::scene::Unreadable;

/// An open page file. Any number of threads may read pages at the same time. Every read is checked against the
/// checksums of the file, and fails if the file was changed since it was opened.
pub struct PageFile {
    path: PathBuf,
    file: File,
    modified: Option<SystemTime>,
    header: Header,
    words: PageWords,
    pages: Vec<Page>,
    /// The checksums of the geometry and of the colours of each page.
    checksums: Vec<[u64; 2]>,
    /// The table of levels; empty in files without levels of detail.
    levels: Vec<PageLod>,
}

/// The streams of a page file.
#[derive(Clone, Copy)]
enum Stream {
    Geometry,
    Colours,
    Levels,
}

/// True if the file begins as a page file does.
pub fn is_page_file(path: &Path) -> bool {
    let mut begin = [0; PAGE_FILE_SIGNATURE.len()];
    open_regular(path).is_ok_and(|file| read_exact_at(&file, &mut begin, 0).is_ok()) && begin == PAGE_FILE_SIGNATURE
}

impl PageFile {
    /// Opens a page file, and reads its header and its table.
    ///
    /// # Errors
    /// [`Unreadable`] if it is no page file, or its header, its table or its length is damaged;
    /// [`OutOfMemory`](crate::host_memory::OutOfMemory) if its table does not fit into memory.
    pub fn open(path: &Path) -> Result<Self> {
        Self::opened(path).map_err(|problem| Unreadable::or_too_large(path, problem))
    }

    fn opened(path: &Path) -> Result<Self> {
        let file = open_regular(path)?;
        let data = file.metadata()?;
        let mut bytes = [0; HEADER];
        ensure!(data.len() >= HEADER as u64, "the file ends at byte {}, inside its header", data.len());
        read(&file, &mut bytes, 0)?;
        let header = Header::decoded(&bytes)?;
        let expected = header.file_bytes();
        ensure!(data.len() == expected, "the file has {} bytes, but {expected} by its header", data.len());
        let mut table = host_zeros(header.pages() * Entry::BYTES, "table of pages")?;
        read(&file, &mut table, HEADER as u64)?;
        let end = HEADER + table.len();
        ensure!(
            XxHash3_64::oneshot(&table) == header.table_checksum,
            "bytes {HEADER} to {end}, the table of pages, are damaged"
        );
        let entries: Vec<Entry> = table.as_chunks().0.iter().map(Entry::decoded).collect();
        let count: usize = entries[..header.scene_pages()].iter().map(|entry| entry.page.count as usize).sum();
        let wrong = entries.iter().position(|entry| !entry.is_plausible());
        ensure!(wrong.is_none() && count == header.statistics.count, "the table of pages contradicts the header");
        let levels = levels(&file, &header)?;
        let mut pages: Vec<Page> = entries.iter().map(|entry| entry.page).collect();
        pages.iter_mut().zip(&levels).for_each(|(page, level)| page.highest_opacity = level.highest_opacity);
        Ok(Self {
            path: path.to_owned(),
            modified: data.modified().ok(),
            file,
            words: PageWords::of(&header.layout),
            header,
            pages,
            checksums: entries.iter().map(|entry| entry.checksums).collect(),
            levels,
        })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn header(&self) -> &Header {
        &self.header
    }

    pub fn statistics(&self) -> &Statistics {
        &self.header.statistics
    }

    /// The layout of the words.
    pub fn layout(&self) -> &Layout {
        &self.header.layout
    }

    /// The table of the file.
    pub fn pages(&self) -> &[Page] {
        &self.pages
    }

    /// The table of levels; none if the file has no levels.
    pub fn levels(&self) -> Option<&[PageLod]> {
        self.header.levels.map(|_| &*self.levels)
    }

    /// The layout of the words of a page.
    pub fn words(&self) -> &PageWords {
        &self.words
    }

    /// Words of the geometry of a page.
    pub fn geometry_words(&self) -> usize {
        self.words.geometry()
    }

    /// Words of the colours of a page.
    pub fn colour_words(&self) -> usize {
        self.words.colours()
    }

    /// Reads the geometry of neighbouring pages into as many words as they have.
    ///
    /// # Errors
    /// [`Unreadable`] if they cannot be read, are damaged, or the file was changed.
    ///
    /// # Panics
    /// If the number of words is not that of the pages, or the pages do not exist.
    pub fn read_geometry(&self, pages: Range<usize>, words: &mut [u32]) -> Result<()> {
        self.read(Stream::Geometry, pages, words)
    }

    /// As [`read_geometry`](Self::read_geometry), for the colours.
    ///
    /// # Errors
    /// Those of [`read_geometry`](Self::read_geometry).
    ///
    /// # Panics
    /// Where [`read_geometry`](Self::read_geometry) does.
    pub fn read_colours(&self, pages: Range<usize>, words: &mut [u32]) -> Result<()> {
        self.read(Stream::Colours, pages, words)
    }

    /// As [`read_geometry`](Self::read_geometry), for the words of levels.
    ///
    /// # Errors
    /// Those of [`read_geometry`](Self::read_geometry).
    ///
    /// # Panics
    /// Where [`read_geometry`](Self::read_geometry) does, and if the file has no levels.
    pub fn read_levels(&self, pages: Range<usize>, words: &mut [u32]) -> Result<()> {
        self.read(Stream::Levels, pages, words)
    }

    fn read(&self, stream: Stream, pages: Range<usize>, words: &mut [u32]) -> Result<()> {
        let (start, each) = match stream {
            Stream::Geometry => (self.header.geometry_at, self.geometry_words()),
            Stream::Colours => (self.header.colours_at, self.colour_words()),
            Stream::Levels => (self.header.levels.expect("the file has levels").words_at, LEVEL_WORDS * PAGE),
        };
        assert_eq!(words.len(), each * pages.len(), "as many words as the pages have");
        assert!(pages.end <= self.pages.len(), "pages of the file");
        if pages.is_empty() {
            return Ok(());
        }
        let place = |page: usize| start + (page * each * 4) as u64;
        let of = match stream {
            Stream::Geometry => "geometry",
            Stream::Colours => "colours",
            Stream::Levels => "levels",
        };
        let unreadable = |page: usize, why: &str| {
            let (from, to) = (place(page), place(page + 1));
            let problem = anyhow!("the {of} of page {page}, bytes {from} to {to}, {why}");
            anyhow::Error::from(Unreadable::new(&self.path, &problem))
        };
        match simulated() {
            Some(ReadFault::Page(page)) if pages.contains(&page) => {
                return Err(unreadable(page, "cannot be read: simulated fault"));
            }
            Some(ReadFault::Slow(time)) => std::thread::sleep(time),
            _ => {}
        }
        let read = read_exact_at(&self.file, bytemuck::cast_slice_mut(words), place(pages.start));
        self.check_unchanged()?;
        read.map_err(|error| unreadable(pages.start, &format!("cannot be read: {}", describe(&error))))?;
        let check = |(i, words): (usize, &mut [u32])| {
            let page = pages.start + i;
            let checksum = match stream {
                Stream::Geometry | Stream::Colours => self.checksums[page][stream as usize],
                Stream::Levels => self.levels[page].checksum,
            };
            let is_whole = XxHash3_64::oneshot(bytemuck::cast_slice(words)) == checksum;
            if cfg!(target_endian = "big") {
                words.iter_mut().for_each(|word| *word = u32::from_le(*word));
            }
            if is_whole { Ok(()) } else { Err(unreadable(page, "are damaged")) }
        };
        words.par_chunks_exact_mut(each).enumerate().with_min_len(16).try_for_each(check)
    }

    fn check_unchanged(&self) -> Result<()> {
        let unchanged = |data: io::Result<std::fs::Metadata>| {
            data.is_ok_and(|data| data.len() == self.header.file_bytes() && data.modified().ok() == self.modified)
        };
        if unchanged(self.file.metadata()) {
            return Ok(());
        }
        let problem = anyhow!("the file was changed while it was read");
        Err(Unreadable::new(&self.path, &problem).into())
    }
}

/// Reads the table of levels; empty in files without levels.
fn levels(file: &File, header: &Header) -> Result<Vec<PageLod>> {
    let Some(parts) = header.levels else { return Ok(Vec::new()) };
    let mut table = host_zeros(header.pages() * PageLod::BYTES, "table of levels")?;
    read(file, &mut table, parts.table_at)?;
    let (from, to) = (parts.table_at, header.file_bytes());
    ensure!(XxHash3_64::oneshot(&table) == parts.checksum, "bytes {from} to {to}, the table of levels, are damaged");
    let mut levels: Vec<PageLod> = table.as_chunks().0.iter().map(PageLod::decoded).collect();
    if !header.has_source_levels() {
        let numbers = levels_of_pages(header.statistics.count);
        ensure!(numbers.len() == levels.len(), "it claims {} pages of levels", parts.pages);
        levels.iter_mut().zip(numbers).for_each(|(level, number)| level.level = number);
    }
    let is_sound =
        levels.iter().enumerate().all(|(own, level)| level.is_plausible(own, levels.len(), parts.scene_pages));
    ensure!(is_sound, "the table of levels contradicts itself");
    Ok(levels)
}

fn read(file: &File, bytes: &mut [u8], at: u64) -> Result<()> {
    let end = at + bytes.len() as u64;
    let read = read_exact_at(file, bytes, at);
    read.map_err(|error| anyhow!("bytes {at} to {end} cannot be read: {}", describe(&error)))
}
