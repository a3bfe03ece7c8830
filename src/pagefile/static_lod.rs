//! A view-independent level of detail: the nodes of a page file within one error limit, as a scene.

use anyhow::{Result, ensure};

use super::nodes::NodeReader;
use super::page::PAGE;
use super::page_lod::LEVEL_WORDS;
use super::read_whole::BATCH_PAGES;
use super::reader::PageFile;
use crate::lod::NEVER;
use crate::scene::{Cancelled, LoadReport, NoLevel, Scene, Watch};

/// The nodes of the cut with the least error limit that leaves at most `most` nodes, for the rules of antialiased
/// pictures. Opacities above 1, which no other format holds, become wider Gaussians.
///
/// # Errors
/// [`NoLevel`] if the file has no levels, or more than `most` nodes in the coarsest; [`Cancelled`];
/// [`Unreadable`](crate::scene::Unreadable); [`OutOfMemory`](crate::host_memory::OutOfMemory).
pub fn static_level(file: &PageFile, most: usize, watch: &Watch) -> Result<Scene> {
    let missing = |problem: String| NoLevel { path: file.path().display().to_string(), problem };
    let pages = file.levels().ok_or_else(|| missing("the file has no levels of detail".to_owned()))?.len();
    let mut words = vec![0; BATCH_PAGES.min(pages) * LEVEL_WORDS * PAGE];
    // The difference of the number of drawn nodes from each limit to the next.
    let mut change = vec![0_i64; usize::from(NEVER) + 1];
    each_page(file, &mut words, &|done| (watch.progress)(0.3 * done), watch, |_, words| {
        for [own, parent] in words.iter().map(codes).filter(|[own, _]| *own != NEVER) {
            change[usize::from(own)] += 1;
            change[usize::from(parent)] -= 1;
        }
        Ok(())
    })?;
    let mut left = 0;
    let is_enough = |change: &i64| {
        left += change;
        left <= most as i64
    };
    let limit = change[..usize::from(NEVER)].iter().position(is_enough);
    let limit = limit.ok_or_else(|| missing(format!("the coarsest level has {left} Gaussians, more than {most}")))?;
    let is_left = |words: &[u32; LEVEL_WORDS]| {
        let [own, parent] = codes(words).map(usize::from);
        own <= limit && limit < parent
    };

    let mut reader = NodeReader::new(file, left as usize)?;
    each_page(file, &mut words, &|done| (watch.progress)(0.3 + 0.7 * done), watch, |page, words| {
        reader.take(page, words, is_left)
    })?;
    let (gaussians, header) = (reader.finish()?, file.header());
    let report = LoadReport { read: gaussians.len(), ..LoadReport::default() };
    let is_antialiased = header.is_antialiased;
    Ok(Scene { gaussians, report, is_antialiased, ..Scene::empty(&format!("level of {}", header.format)) })
}

/// The codes of the own error of a node and of that of its parent.
fn codes(words: &[u32; LEVEL_WORDS]) -> [u16; 2] {
    [words[0] as u16, (words[0] >> 16) as u16]
}

/// Calls `take` with each page and its words of levels.
fn each_page(
    file: &PageFile,
    words: &mut [u32],
    progress: &dyn Fn(f64),
    watch: &Watch,
    mut take: impl FnMut(usize, &[[u32; LEVEL_WORDS]]) -> Result<()>,
) -> Result<()> {
    let pages = file.pages().len();
    for first in (0..pages).step_by(BATCH_PAGES) {
        ensure!(!(watch.is_cancelled)(), Cancelled);
        let range = first..pages.min(first + BATCH_PAGES);
        let words = &mut words[..range.len() * LEVEL_WORDS * PAGE];
        file.read_levels(range.clone(), words)?;
        for (page, words) in range.clone().zip(words.as_chunks().0.chunks_exact(PAGE)) {
            take(page, words)?;
        }
        progress(range.end as f64 / pages as f64);
    }
    Ok(())
}
