//! Reads a whole scene into memory, also from a page file.

use std::path::Path;

use anyhow::{Result, ensure};

use super::nodes::put;
use super::page::{PADDING, PAGE};
use super::reader::{PageFile, is_page_file};
use crate::formats::Reading;
use crate::host_memory::OutOfMemory;
use crate::scene::{Cancelled, CanonicalBuilder, NoLevel, Scene, Unreadable, Watch};

/// Pages that are read at a time.
pub const BATCH_PAGES: usize = 64;

/// Reads a scene file of any format. The Gaussians of a page file are in the order of their source.
///
/// # Errors
/// Those of [`Reading::read_watched`].
pub fn read(reading: &Reading, path: &Path, watch: &Watch) -> Result<Scene> {
    if !is_page_file(path) {
        return reading.read_watched(path, watch);
    }
    if reading.level.is_some() {
        return Err(NoLevel::none().of_file(path).into());
    }
    let file = PageFile::open(path)?;
    let scene = whole(&file, watch)?;
    reading.placed(scene)
}

fn whole(file: &PageFile, watch: &Watch) -> Result<Scene> {
    let header = file.header();
    let (count, degree) = (header.statistics.count, header.statistics.sh_degree);
    let named = |problem: OutOfMemory| anyhow::Error::new(problem).context(file.path().display().to_string());
    let mut parts = CanonicalBuilder::new(degree, count).map_err(named)?;
    let (words, layout) = (file.words(), &header.layout);
    let mut geometry = vec![0; BATCH_PAGES * words.geometry()];
    let mut colours = vec![0; BATCH_PAGES * words.colours()];
    let (mut is_filled, mut filled) = (vec![false; count], 0);
    let pages = header.scene_pages();
    for first in (0..pages).step_by(BATCH_PAGES) {
        ensure!(!(watch.is_cancelled)(), Cancelled);
        let range = first..pages.min(first + BATCH_PAGES);
        let geometry = &mut geometry[..range.len() * words.geometry()];
        let colours = &mut colours[..range.len() * words.colours()];
        file.read_geometry(range.clone(), geometry)?;
        file.read_colours(range.clone(), colours)?;
        let both = geometry.chunks_exact(words.geometry()).zip(colours.chunks_exact(words.colours()));
        for (geometry, colours) in both {
            for k in (0..PAGE).filter(|k| geometry[words.ids.start + k] != PADDING) {
                let place = geometry[words.ids.start + k] as usize;
                let is_new = is_filled.get_mut(place).is_some_and(|filled| !std::mem::replace(filled, true));
                ensure!(is_new, Unreadable::new(file.path(), &anyhow::anyhow!("two Gaussians have the index {place}")));
                let shape = words.unpacked(layout, geometry, k);
                layout.unpack_sh(&words.sh_of(colours, k), put(&mut parts, place, shape));
                filled += 1;
            }
        }
        (watch.progress)(range.end as f64 / pages as f64);
    }
    let gaussians = parts.finish().map_err(|problem| Unreadable::new(file.path(), &problem))?;
    let missing = anyhow::anyhow!("{filled} of {count} Gaussians are in its pages");
    ensure!(filled == count, Unreadable::new(file.path(), &missing));
    Ok(Scene {
        gaussians,
        report: header.report,
        format: header.format_of_pages(),
        is_antialiased: header.is_antialiased,
        notices: Vec::new(),
        levels: Vec::new(),
    })
}
