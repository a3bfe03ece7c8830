//! The cut through the levels of detail of a scene: for each page, the largest error of a node that is drawn.
//!
//! A node is drawn if its own error is within the limit of its page, and its parent's is not within that of its own
//! page. The limit of a page follows from the width of a pixel at its box. Boxes hold those of their children and
//! errors do not fall towards the root, so on the way from any Gaussian to the root exactly one node is drawn.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::visible::{PlacedCamera, Sight, VisiblePage};
use crate::levels::{FINEST, code_below, value};
use crate::options::Options;
use crate::storage::{Level, NO_PAGE, PARTS, Page};

/// A cut through levels of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Detailed {
    /// The limit: the change of the picture per node that is saved, in pixels times steps of 1/255.
    pub lod_error: f64,
    /// Nodes of the cut on the pages in view, as the table of levels tells: about those that are drawn.
    pub nodes: f64,
    /// The PSNR that the measured errors of the nodes predict, dB: of all that are in view, hidden or not.
    pub predicted_psnr: f64,
}

/// Steps of the search for a limit.
const STEPS: usize = 24;
/// The limits that are searched, as powers of two, in colours from 0 to 1.
const RANGE: [f64; 2] = [-30.0, 20.0];

/// A page in view.
struct Seen<'l> {
    level: &'l Level,
    /// What the limit is multiplied with: of this page, and of that with its parents.
    widths: [f64; 2],
    count: f64,
    place: VisiblePage,
}

/// The pages of the cut that the cameras may see, with their limits, and what is known of the cut.
pub fn cut(
    sight: &Sight,
    (pages, levels): (&[Page], &[Level]),
    cameras: &[PlacedCamera],
    options: &Options,
) -> (Vec<VisiblePage>, Detailed) {
    let given = f64::from(options.lod_error) / 255.0;
    let is_searched = options.lod_psnr > 0.0 || options.splats > 0;
    let seen: Vec<Seen> = (cameras.iter().enumerate())
        .flat_map(|(view, camera)| {
            let widths: Vec<f64> = levels
                .par_iter()
                .with_min_len(4096)
                .map(|level| width(level, camera, camera.near(sight.rules)))
                .collect();
            // Without a search, pages that are not in the cut need not be looked for in the picture.
            let in_view = |number: usize| {
                let (page, level) = (&pages[number], &levels[number]);
                let parent = if level.parent == NO_PAGE { 0.0 } else { widths[level.parent as usize] };
                let widths = [widths[number], parent];
                if !is_searched && !is_in(level, limits(widths, given)) {
                    return None;
                }
                let place = sight.page(number as u32, page, view as u32, camera)?;
                Some(Seen { level, widths, count: page.count.into(), place })
            };
            (0..pages.len()).into_par_iter().with_min_len(1024).filter_map(in_view).collect::<Vec<_>>()
        })
        .collect();
    let size = cameras.first().map_or([1, 1], |placed| placed.camera.size_px);
    let values = 3.0 * size.iter().map(|side| f64::from(*side)).product::<f64>();
    let limit = if is_searched { searched(&seen, options, values) } else { given };
    let (nodes, energy) = summed(&seen, limit);
    let in_cut = |seen: &Seen| {
        let [own, parent] = limits(seen.widths, limit);
        let limits = u32::from(own) | u32::from(parent) << 16;
        let drawn = (seen.count * part(seen.level, [own, parent])).ceil() as u32;
        is_in(seen.level, [own, parent]).then_some(VisiblePage { limits, drawn, ..seen.place })
    };
    let drawn = seen.par_iter().with_min_len(4096).filter_map(in_cut).collect();
    (drawn, Detailed { lod_error: 255.0 * limit, nodes, predicted_psnr: psnr(energy, values) })
}

/// What a limit is multiplied with on a page: the width of a pixel in the units of the scene, wider where pixels are
/// wider than the page's detail, since errors then fall.
/// Nothing nearer than `near` is drawn.
fn width(level: &Level, placed: &PlacedCamera, near: f64) -> f64 {
    let camera = &placed.camera;
    let [low, high] = [level.low, level.high].map(|corner| glam::DVec3::from(corner.map(f64::from)));
    let distance = camera.position.distance(camera.position.clamp(low, high)).max(near);
    let px = distance / camera.focal_px.max_element();
    px * (px / f64::from(level.detail)).max(1.0)
}

/// The largest errors within the limit, as codes: on a page, and on that with its parents.
fn limits(widths: [f64; 2], limit: f64) -> [u16; 2] {
    widths.map(|width| code_below(limit * width))
}

/// True if some nodes of a page are drawn.
fn is_in(level: &Level, [own, parent]: [u16; 2]) -> bool {
    level.least <= own && level.parents[PARTS - 1] > parent
}

/// The number of nodes that are drawn and their squared error, in pixels, of all pages in view.
fn summed(seen: &[Seen], limit: f64) -> (f64, f64) {
    let of_page = |seen: &Seen| {
        let Seen { level, widths, count, .. } = seen;
        let limits = limits(*widths, limit);
        let (within, part) = (below(&level.errors, level.least, limits[0]), part(level, limits));
        // The mean over those whose own error is within the limit.
        let whole = within * PARTS as f64;
        let energies = level.energies.iter().enumerate();
        let energy: f64 = energies.map(|(i, code)| value(*code) * (whole - i as f64).clamp(0.0, 1.0)).sum();
        let mean = if whole > 0.0 { energy / whole } else { 0.0 };
        let squared = if widths[0] > 0.0 { mean / (widths[0] * widths[0]) } else { 0.0 };
        (part * count, part * count * squared)
    };
    // In a fixed order, so that every run finds the same limit.
    let parts: Vec<(f64, f64)> = seen.par_chunks(1024).map(|part| add(part.iter().map(of_page))).collect();
    add(parts.into_iter())
}

/// The part of the nodes of a page that is drawn, as the table of levels tells.
fn part(level: &Level, [own, parent]: [u16; 2]) -> f64 {
    (below(&level.errors, level.least, own) - below(&level.parents, FINEST, parent)).max(0.0)
}

/// The number of nodes that are drawn.
fn counted(seen: &[Seen], limit: f64) -> f64 {
    let of_page = |seen: &Seen| seen.count * part(seen.level, limits(seen.widths, limit));
    // In a fixed order, so that every run finds the same limit.
    let parts: Vec<f64> = seen.par_chunks(1024).map(|pages| pages.iter().map(of_page).sum()).collect();
    parts.into_iter().sum()
}

fn add(parts: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    parts.fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
}

/// The part of the nodes whose error is at most `limit`; `largest`: of each eighth of them.
fn below(largest: &[u16; PARTS], least: u16, limit: u16) -> f64 {
    let whole = largest.partition_point(|code| *code <= limit);
    if whole == PARTS {
        return 1.0;
    }
    let from = f64::from(if whole == 0 { least } else { largest[whole - 1] });
    let inside = ((f64::from(limit) - from) / (f64::from(largest[whole]) - from).max(1.0)).clamp(0.0, 1.0);
    (whole as f64 + inside) / PARTS as f64
}

fn psnr(energy: f64, values: f64) -> f64 {
    if energy > 0.0 { -10.0 * (energy / values).log10() } else { f64::INFINITY }
}

/// The limit that the options ask for: the largest whose predicted PSNR is not too low, or a larger one that leaves no
/// more nodes than they allow.
fn searched(seen: &[Seen], options: &Options, values: f64) -> f64 {
    let mut limit = f64::from(options.lod_error) / 255.0;
    if options.lod_psnr > 0.0 {
        limit = between(|limit| psnr(summed(seen, limit).1, values) >= f64::from(options.lod_psnr))[0];
    }
    let most = f64::from(options.splats);
    if options.splats > 0 && counted(seen, limit) > most {
        limit = between(|limit| counted(seen, limit) > most)[1];
    }
    limit
}

/// Two limits next to each other: this is true of the first and of all below, and not of the second.
fn between(is_true: impl Fn(f64) -> bool) -> [f64; 2] {
    let [mut low, mut high] = RANGE;
    for _ in 0..STEPS {
        let middle = (low + high) / 2.0;
        if is_true(middle.exp2()) {
            low = middle;
        } else {
            high = middle;
        }
    }
    [low, high].map(f64::exp2)
}

/// A page file with levels of detail of a scene.
#[cfg(test)]
pub(super) fn with_levels(scene: crate::scene::Scene, options: Options) -> std::sync::Arc<crate::storage::PageFile> {
    use crate::storage::PageFile;
    use crate::storage::convert::{Job, Settings, write_whole};

    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("levels.smalto");
    let settings = Settings { options, has_levels: true, ..Settings::default() };
    let job = Job { output: &output, settings, title: "test".to_owned(), progress: &|_| {}, is_cancelled: &|| false };
    write_whole(&job, &scene).unwrap();
    // The open file outlives the folder.
    std::sync::Arc::new(PageFile::open(&output).unwrap())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::scene::{Focus, synthetic};
    use crate::storage::convert::Settings;
    use crate::storage::{LEVEL_WORDS, PAGE};

    /// Each Gaussian adds its opacity to one node on each way to the root, so every cut has the same sum.
    #[test]
    fn every_cut_stands_for_every_gaussian_once() {
        let scene = synthetic::cactus(30_000).unwrap();
        let (focus, sum) = (Focus::of(&scene.gaussians), scene.gaussians.opacities().iter().sum::<f32>());
        let file = with_levels(scene, Settings::LOSSLESS);
        let (levels, pages) = (file.levels().unwrap(), file.pages());
        let mut words = vec![0; pages.len() * LEVEL_WORDS * PAGE];
        file.read_levels(0..pages.len(), &mut words).unwrap();
        let mut geometry = vec![0; pages.len() * file.geometry_words()];
        file.read_geometry(0..pages.len(), &mut geometry).unwrap();
        let mut sizes = Vec::new();
        for (number, zoom) in [0.1, 0.3, 1.0, 5.0, 30.0].into_iter().enumerate() {
            let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, [640, 480]);
            let placed = PlacedCamera { camera, scale: 1.0 };
            let widths: Vec<f64> = levels.iter().map(|level| width(level, &placed, 0.01)).collect();
            for exponent in (-40..-4).step_by(9).chain(-4..16) {
                let limit = f64::from(exponent).exp2() / 255.0;
                let (mut nodes, mut opacity) = (0, 0.0);
                for (page, level) in levels.iter().enumerate() {
                    let parent = if level.parent == NO_PAGE { 0.0 } else { widths[level.parent as usize] };
                    let [own, of_parent] = limits([widths[page], parent], limit);
                    let mut drawn = 0;
                    for k in 0..pages[page].count as usize {
                        let [errors, opacities] = words[(page * PAGE + k) * LEVEL_WORDS..][..2] else { panic!() };
                        if errors & 0xffff <= own.into() && errors >> 16 > of_parent.into() {
                            let shape = file.words().shape_of(&geometry[page * file.geometry_words()..], k);
                            let of_scene = f64::from(file.layout().unpacked_shape(&shape).2);
                            opacity += if opacities == 0 { of_scene } else { value((opacities >> 16) as u16) };
                            drawn += 1;
                        }
                    }
                    assert!(drawn == 0 || is_in(level, [own, of_parent]), "page {page} is in the cut");
                    nodes += drawn;
                }
                assert!((opacity / f64::from(sum) - 1.0).abs() < 1e-3, "{number}, {limit}: {opacity} of {sum}");
                sizes.push(nodes);
            }
        }
        assert!(sizes.contains(&30_000) && sizes.iter().any(|nodes| *nodes < 1000), "{sizes:?}");
    }
}
