//! A level of detail for all views: as many nodes of a page file as are asked for, as a scene.

use std::ops::Range;

use anyhow::{Result, anyhow, ensure};

use super::level::{LEVEL_WORDS, Level, NO_PAGE};
use super::page::PAGE;
use super::page_file::PageFile;
use super::read_back::TOGETHER;
use crate::levels::{CODES_PER_OCTAVE, FINEST, NEVER, value};
use crate::scene::{Cancelled, LoadReport, Parts, Scene, Unreadable, Watch, sh_coefficients};
use crate::storage::planes::Shape;

/// The nodes of a page file within one limit.
pub struct StaticLevel {
    pub scene: Scene,
    /// The largest own error of a node, over the width of its page; 0 if all are Gaussians of the scene.
    pub error: f64,
}

/// Codes of errors over widths lie between minus and plus this.
const MOST_CODE: i32 = 1 << 17;

/// The place of a node among all that a limit may leave: it is drawn if its own code is within the limit, and that of
/// its parent is not.
#[derive(Clone, Copy)]
struct Codes {
    own: i32,
    parent: i32,
}

/// The nodes of a file with levels that keep the pictures best with at most `most` of them: those whose errors over the
/// width of their page, as `width` says it, are within one limit. Widths must not fall from pages to the pages of their
/// parents' places; see [`Level::width_from`].
///
/// # Errors
/// If the file has no levels, or its coarsest nodes are more than `most`; [`Unreadable`]; [`Cancelled`];
/// [`OutOfMemory`](crate::host_memory::OutOfMemory).
pub fn static_level(
    file: &PageFile,
    most: usize,
    width: &dyn Fn(&Level) -> f64,
    watch: &Watch,
) -> Result<StaticLevel> {
    let levels = file.levels().ok_or_else(|| anyhow!("{}: the file has no levels of detail", file.path().display()))?;
    let steps = |level: &Level| {
        let steps = (width(level).max(f64::MIN_POSITIVE).log2() * CODES_PER_OCTAVE).round() as i32;
        steps.clamp(-MOST_CODE / 2, MOST_CODE / 2)
    };
    let steps: Vec<i32> = levels.iter().map(steps).collect();
    let codes_of = |page: usize, words: &[u32; LEVEL_WORDS]| -> Option<Codes> {
        let (own, parent) = (words[0] as u16, (words[0] >> 16) as u16);
        let parents_page = levels[page].parent;
        let finest = if own == FINEST { -MOST_CODE } else { i32::from(own) - steps[page] };
        let has_parent = parents_page != NO_PAGE && parent != NEVER;
        let parent = if has_parent { i32::from(parent) - steps[parents_page as usize] } else { MOST_CODE };
        (own != NEVER).then_some(Codes { own: finest, parent })
    };
    let chunks = || (0..levels.len()).step_by(TOGETHER).map(|first| first..levels.len().min(first + TOGETHER));
    let mut words = vec![0; TOGETHER * LEVEL_WORDS * PAGE];
    let mut change = vec![0_i64; 2 * MOST_CODE as usize + 1];
    for pages in chunks() {
        ensure!(!(watch.is_cancelled)(), Cancelled);
        for (page, words) in level_words(file, pages.clone(), &mut words)? {
            for codes in words.iter().filter_map(|words| codes_of(page, words)) {
                // From its own code to its parent's a node is drawn.
                change[(codes.own + MOST_CODE) as usize] += 1;
                change[(codes.parent + MOST_CODE) as usize] -= 1;
            }
        }
        (watch.progress)(0.3 * pages.end as f64 / levels.len() as f64);
    }
    let mut left = 0;
    let fits = |change: &i64| {
        left += change;
        left <= most as i64
    };
    let place = change[..2 * MOST_CODE as usize].iter().position(fits);
    let limit = place.ok_or_else(|| anyhow!("the coarsest level has {left} Gaussians, more than {most}"))? as i32;
    let limit = limit - MOST_CODE;
    let is_drawn = |codes: Codes| codes.own <= limit && limit < codes.parent;

    let header = file.header();
    let degree = header.statistics.sh_degree;
    let mut parts = Parts::new(degree, left as usize)?;
    let (layout, of_page, scene_pages) = (&header.layout, file.words(), header.scene_pages());
    let (kept, stride) = (sh_coefficients(layout.sh_degree), sh_coefficients(degree));
    let (mut geometry, mut colours) = (vec![0; of_page.geometry()], vec![0; of_page.colours()]);
    let (mut next, mut error) = (0, 0.0_f64);
    for pages in chunks() {
        ensure!(!(watch.is_cancelled)(), Cancelled);
        for (page, words) in level_words(file, pages.clone(), &mut words)? {
            let is_in_level = |words: &[u32; LEVEL_WORDS]| codes_of(page, words).is_some_and(is_drawn);
            if !words.iter().any(is_in_level) {
                continue;
            }
            file.read_geometry(page..page + 1, &mut geometry)?;
            file.read_colours(page..page + 1, &mut colours)?;
            for (k, words) in words.iter().enumerate().filter(|(_, words)| is_in_level(words)) {
                let mut shape = of_page.unpacked(layout, &geometry, k);
                if page >= scene_pages {
                    shape.opacity = value(words[1] as u16) as f32;
                }
                let Shape { mean, rotation, scale, opacity } = opaque_at_most(shape);
                (parts.means[next], parts.rotations[next], parts.scales[next]) = (mean, rotation, scale);
                parts.opacities[next] = opacity.max(f32::from_bits(1));
                let sh = layout.unpacked_sh(&of_page.sh_of(&colours, k));
                parts.sh[next * stride..][..kept].copy_from_slice(&sh[..kept]);
                error = error.max(value(words[0] as u16) / width(&levels[page]));
                next += 1;
            }
        }
        (watch.progress)(0.3 + 0.7 * pages.end as f64 / levels.len() as f64);
    }
    let gaussians = parts.finish().map_err(|problem| Unreadable::new(file.path(), &problem))?;
    let scene = Scene {
        gaussians,
        report: LoadReport { read: next, ..LoadReport::default() },
        format: header.format_of_pages(),
        is_antialiased: header.is_antialiased,
        notices: Vec::new(),
        levels: Vec::new(),
    };
    Ok(StaticLevel { scene, error })
}

/// The words of levels of some pages, page by page.
fn level_words<'w>(
    file: &PageFile,
    pages: Range<usize>,
    words: &'w mut [u32],
) -> Result<impl Iterator<Item = (usize, &'w [[u32; LEVEL_WORDS]])> + use<'w>> {
    let words = &mut words[..pages.len() * LEVEL_WORDS * PAGE];
    file.read_levels(pages.clone(), words)?;
    Ok(pages.zip(words.as_chunks().0.chunks_exact(PAGE)))
}

/// A Gaussian whose opacity is at most 1 with the same sum of alpha. Alpha is clamped to 1, so the sum over the picture
/// of one with the opacity o above 1 and the variances s t is 2 pi s t (1 + ln o).
fn opaque_at_most(shape: Shape) -> Shape {
    if shape.opacity <= 1.0 {
        return shape;
    }
    let wider = (1.0 + shape.opacity.ln()).sqrt();
    Shape { scale: shape.scale.map(|scale| scale * wider), opacity: 1.0, ..shape }
}
