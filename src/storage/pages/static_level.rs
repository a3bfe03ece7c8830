//! A level of detail for all views: the nodes of a page file that one limit leaves, as a scene.

use anyhow::{Result, ensure};

use super::level::LEVEL_WORDS;
use super::page::PAGE;
use super::page_file::PageFile;
use super::read_back::TOGETHER;
use crate::levels::{NEVER, value};
use crate::scene::{Cancelled, LoadReport, NoLevel, Parts, Scene, Unreadable, Watch, sh_coefficients};
use crate::storage::planes::Shape;

/// The nodes of a file with levels within the least limit that leaves at most `most`, wherever they are seen from, by
/// the rules of the antialiased picture. Opacities above 1, which no other format holds, become wider Gaussians.
///
/// # Errors
/// [`NoLevel`] if the file has no levels, or more than `most` nodes in the coarsest; [`Unreadable`]; [`Cancelled`];
/// [`OutOfMemory`](crate::host_memory::OutOfMemory).
pub fn static_level(file: &PageFile, most: usize, watch: &Watch) -> Result<Scene> {
    let missing = |problem: String| NoLevel { path: file.path().display().to_string(), problem };
    let pages = file.levels().ok_or_else(|| missing("the file has no levels of detail".to_owned()))?.len();
    let mut words = vec![0; TOGETHER.min(pages) * LEVEL_WORDS * PAGE];
    // How many more nodes are drawn with a limit than with the one before.
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

    let header = file.header();
    let degree = header.statistics.sh_degree;
    let mut parts = Parts::new(degree, left as usize)?;
    let (layout, of_page) = (&header.layout, file.words());
    let (kept, stride) = (sh_coefficients(layout.sh_degree), sh_coefficients(degree));
    let (mut geometry, mut colours) = (vec![0; of_page.geometry()], vec![0; of_page.colours()]);
    let mut next = 0;
    each_page(file, &mut words, &|done| (watch.progress)(0.3 + 0.7 * done), watch, |page, words| {
        if !words.iter().any(is_left) {
            return Ok(());
        }
        file.read_geometry(page..page + 1, &mut geometry)?;
        file.read_colours(page..page + 1, &mut colours)?;
        for (k, words) in words.iter().enumerate().filter(|(_, words)| is_left(words)) {
            let mut shape = of_page.unpacked(layout, &geometry, k);
            if page >= header.scene_pages() {
                shape.opacity = value(words[1] as u16) as f32;
            }
            let Shape { mean, rotation, scale, opacity } = opaque_at_most(shape);
            (parts.means[next], parts.rotations[next], parts.scales[next]) = (mean, rotation, scale);
            // An opacity of 16 bits may be rounded to 0, which no other scene has.
            parts.opacities[next] = opacity.max(f32::from_bits(1));
            let sh = layout.unpacked_sh(&of_page.sh_of(&colours, k));
            parts.sh[next * stride..][..kept].copy_from_slice(&sh[..kept]);
            next += 1;
        }
        Ok(())
    })?;
    let gaussians = parts.finish().map_err(|problem| Unreadable::new(file.path(), &problem))?;
    let report = LoadReport { read: next, ..LoadReport::default() };
    let is_antialiased = header.is_antialiased;
    Ok(Scene { gaussians, report, is_antialiased, ..Scene::empty(&format!("level of {}", header.format)) })
}

/// The codes of the own error of a node and of that of its parent.
fn codes(words: &[u32; LEVEL_WORDS]) -> [u16; 2] {
    [words[0] as u16, (words[0] >> 16) as u16]
}

/// Gives each page and its words of levels.
fn each_page(
    file: &PageFile,
    words: &mut [u32],
    progress: &dyn Fn(f64),
    watch: &Watch,
    mut take: impl FnMut(usize, &[[u32; LEVEL_WORDS]]) -> Result<()>,
) -> Result<()> {
    let pages = file.pages().len();
    for first in (0..pages).step_by(TOGETHER) {
        ensure!(!(watch.is_cancelled)(), Cancelled);
        let range = first..pages.min(first + TOGETHER);
        let words = &mut words[..range.len() * LEVEL_WORDS * PAGE];
        file.read_levels(range.clone(), words)?;
        for (page, words) in range.clone().zip(words.as_chunks().0.chunks_exact(PAGE)) {
            take(page, words)?;
        }
        progress(range.end as f64 / pages as f64);
    }
    Ok(())
}

/// A Gaussian whose opacity is at most 1, with the same sum of alpha over the picture. Alpha is clamped to 1, so that
/// sum, for an opacity o above 1, is that of opacity 1 times 1 + ln o.
fn opaque_at_most(shape: Shape) -> Shape {
    if shape.opacity <= 1.0 {
        return shape;
    }
    let wider = (1.0 + shape.opacity.ln()).sqrt();
    Shape { scale: shape.scale.map(|scale| scale * wider), opacity: 1.0, ..shape }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_opacity_above_1_becomes_area() {
        let shape = Shape { mean: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], scale: [2.0, 2.0, 1.0], opacity: 5.0 };
        let sum = |shape: Shape| {
            let alpha =
                |r: f64| (f64::from(shape.opacity) * (-0.5 * (r / f64::from(shape.scale[0])).powi(2)).exp()).min(1.0);
            (0..100_000).map(|i| f64::from(i) * 1e-3).map(|r| alpha(r) * r * 1e-3).sum::<f64>()
        };
        let made = opaque_at_most(shape);
        assert!(made.opacity == 1.0 && (sum(made) / sum(shape) - 1.0).abs() < 1e-4, "{} {}", sum(made), sum(shape));
        assert_eq!(opaque_at_most(Shape { opacity: 0.7, ..shape }).scale, shape.scale);
    }
}
