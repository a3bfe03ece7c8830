//! The selection of pages against its twin in plain Rust, and properties of its cuts.

use std::ops::RangeInclusive;
use std::sync::Arc;

use super::fixtures::{open, opened_scene, with_levels, with_source_levels};
use super::selection::LodSelector;
use super::tables::{errors_of_pages, page_box, steps};
use super::target::{LodReport, LodTarget, NODE_UNITS};
use crate::camera::Camera;
use crate::lod::{NEVER, value_of_code};
use crate::options::Options;
use crate::pagefile::write::Settings;
use crate::pagefile::{LEVEL_WORDS, PAGE, PARTS, Pages};
use crate::procedural::cactus;
use crate::render::fast::BinGrid;
use crate::render::frame::{DepthKeys, Shot};
use crate::render::pages::{Element, PageCuller, PlacedCamera, views_of};
use crate::render::scene::GpuScene;
use crate::render::shaders::fast::{BIN_COLUMNS, BIN_ROWS, BLOCK_WIDTH, BLOCKS};
use crate::render::shaders::lod::*;
use crate::render::shaders::pages::VIEW_ELEMENTS;
use crate::render::shaders::{PageBox, PageErrors};
use crate::render::streaming::fallback::{FallbackLimits, PageHierarchy};
use crate::rules::Rules;
use crate::scene::{Focus, Transform};

/// The stages of a selection in plain Rust, with the roundings of the shaders.
struct Twin {
    boxes: Vec<PageBox>,
    errors: Vec<PageErrors>,
    steps: [u32; 256],
    view: [f32; 20],
    focal_px: [f32; 2],
    centre_px: [f32; 2],
    size_px: [u32; 2],
    per_focal_squared: f32,
    /// Codes above a limit over which nodes cross-fade.
    fade: u32,
    known: Option<TwinOcclusion>,
}

/// What is hidden, in plain Rust.
struct TwinOcclusion {
    factor_squared: f32,
    is_of_this_camera: bool,
    view: [f32; 20],
    grid: BinGrid,
    depths: Vec<f32>,
}

impl TwinOcclusion {
    /// True if a box lies behind the stop depths.
    fn hides(&self, twin: &Twin, low: [f32; 3], high: [f32; 3]) -> bool {
        let vector = |number: usize| -> [f32; 3] { std::array::from_fn(|axis| self.view[3 * number + axis]) };
        let [position_high, position_low] = [vector(4), vector(5)];
        let seen = |corner: [f32; 3]| std::array::from_fn(|i| (corner[i] - position_high[i]) - position_low[i]);
        let (low, high): ([f32; 3], [f32; 3]) = (seen(low), seen(high));
        let [x, y, z] = [0, 1, 2].map(|number| {
            let axis = vector(number);
            let least: [f32; 3] = std::array::from_fn(|i| (axis[i] * low[i]).min(axis[i] * high[i]));
            let most: [f32; 3] = std::array::from_fn(|i| (axis[i] * low[i]).max(axis[i] * high[i]));
            [least, most].map(|sum| (sum[0] + sum[1]) + sum[2])
        });
        let [near, scale] = [self.view[18], self.view[19]];
        if z[0] <= near {
            return false;
        }
        let size = twin.size_px.map(|side| side as f32);
        let ends = [(x, 0), (y, 1)].map(|([from, to], axis)| {
            let px = |end: f32| twin.focal_px[axis] * end + twin.centre_px[axis];
            [px((from / z[0]).min(from / z[1])), px((to / z[0]).max(to / z[1]))]
        });
        let is_inside = (0..2).all(|axis| ends[axis][0] >= 0.0 && ends[axis][1] <= size[axis]);
        if !self.is_of_this_camera && !is_inside {
            return false;
        }
        let depth = z[0] * scale;
        let BinGrid { bins, block_height, .. } = self.grid;
        let cells = |cell_px: [u32; 2]| {
            let at = |axis: usize, end: usize| ends[axis][end].clamp(0.0, size[axis] - 1.0) as u32 / cell_px[axis];
            [0, 1].map(|axis| at(axis, 0)..=at(axis, 1))
        };
        let blocks = cells([BLOCK_WIDTH, block_height]);
        let whole_bins = cells([BLOCK_WIDTH * BIN_COLUMNS, block_height * BIN_ROWS]);
        let is_few = |[columns, rows]: &[RangeInclusive<u32>; 2]| {
            (columns.end() - columns.start() + 1) * (rows.end() - rows.start() + 1) <= 64
        };
        let places: Vec<u32> = if is_few(&blocks) {
            let of_block = |x: u32, y: u32| {
                let bin = y / BIN_ROWS * bins[0] + x / BIN_COLUMNS;
                bin * BLOCKS + y % BIN_ROWS * BIN_COLUMNS + x % BIN_COLUMNS
            };
            blocks[1].clone().flat_map(|y| blocks[0].clone().map(move |x| of_block(x, y))).collect()
        } else if is_few(&whole_bins) {
            let first = bins[0] * bins[1] * BLOCKS;
            whole_bins[1].clone().flat_map(|y| whole_bins[0].clone().map(move |x| first + y * bins[0] + x)).collect()
        } else {
            return false;
        };
        places.iter().all(|place| self.depths[*place as usize] < depth)
    }
}

/// A page in view.
struct Seen {
    page: usize,
    weight: u32,
    widths: [f32; 2],
}

impl Twin {
    fn new(pages: &Pages, view: &[Element], camera: &Camera, options: &Options) -> Self {
        let focal = camera.focal_px.max_element();
        let words: Vec<f32> = view.as_flattened().iter().map(|word| f32::from_bits(*word)).collect();
        Self {
            boxes: (0..pages.pages().len()).map(|number| page_box(pages, number, &(0..1))).collect(),
            errors: errors_of_pages(pages),
            steps: steps(),
            view: words.try_into().unwrap(),
            focal_px: camera.focal_px.as_vec2().to_array(),
            centre_px: camera.centre_px.as_vec2().to_array(),
            size_px: camera.size_px,
            per_focal_squared: (1.0 / (focal * focal)) as f32,
            fade: LodTarget::of(options).fade,
            known: None,
        }
    }

    fn vector(&self, number: usize) -> [f32; 3] {
        std::array::from_fn(|axis| self.view[3 * number + axis])
    }

    fn near(&self) -> f32 {
        self.view[18]
    }

    fn in_view(&self, point: [f32; 3]) -> [f32; 3] {
        let [right, down, forward, _, high, low] = [0, 1, 2, 3, 4, 5].map(|number| self.vector(number));
        let p: [f32; 3] = std::array::from_fn(|axis| (point[axis] - high[axis]) - low[axis]);
        [right, down, forward].map(|axis| (axis[0] * p[0] + axis[1] * p[1]) + axis[2] * p[2])
    }

    fn width_squared(&self, page: u32) -> f32 {
        let (own, [high, low]) = (&self.boxes[page as usize], [4, 5].map(|number| self.vector(number)));
        let d: [f32; 3] = std::array::from_fn(|axis| {
            let below = (own.lod_low[axis] - high[axis]) - low[axis];
            let above = (high[axis] - own.lod_high[axis]) + low[axis];
            below.max(above).max(0.0)
        });
        let distance = ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]).max(self.near() * self.near());
        let px = distance * self.per_focal_squared;
        let width = px * (px * own.per_width_squared).max(1.0);
        if self.hides(page) { width * self.known.as_ref().unwrap().factor_squared } else { width }
    }

    fn hides(&self, page: u32) -> bool {
        let own = &self.boxes[page as usize];
        self.known.as_ref().is_some_and(|known| known.hides(self, own.lod_low, own.lod_high))
    }

    fn samples_in_image(&self, page: usize) -> u32 {
        let PageBox { low, high, .. } = &self.boxes[page];
        let is_inside = |place: &&u32| {
            let place = [0, 10, 20].map(|shift| (*place >> shift & 1023) as f32 + 0.5);
            let point =
                std::array::from_fn(|axis| low[axis] + place[axis] * ((high[axis] - low[axis]) * (1.0 / 1024.0)));
            let p = self.in_view(point);
            let is_within = |axis: usize| {
                let from = self.focal_px[axis] * p[axis] + self.centre_px[axis] * p[2];
                from >= 0.0 && from <= self.size_px[axis] as f32 * p[2]
            };
            p[2] > self.near() && is_within(0) && is_within(1)
        };
        self.errors[page].samples.iter().filter(is_inside).count() as u32
    }

    fn may_be_seen(&self, page: usize) -> bool {
        let [right, down, forward, _, high] = [0, 1, 2, 3, 4].map(|number| self.vector(number));
        let own = &self.boxes[page];
        let half: [f32; 3] = std::array::from_fn(|axis| 0.5 * (own.high[axis] - own.low[axis]));
        let centre = self.in_view(std::array::from_fn(|axis| own.low[axis] + half[axis]));
        let sum = |corner: [f32; 3]| corner.map(f32::abs).iter().sum::<f32>();
        let slack = 1e-6 * (sum(high) + sum(own.low) + sum(own.high));
        let reach = [right, down, forward].map(|axis| (0..3).map(|k| axis[k].abs() * half[k]).sum::<f32>() + slack);
        if own.reach < 0.0 || centre[2] + reach[2] < self.near() {
            return false;
        }
        let depth = [centre[2] - reach[2], centre[2] + reach[2]].map(|z| z.max(self.near()));
        (0..2).all(|axis| {
            let (focal, middle, size) = (self.focal_px[axis], self.centre_px[axis], self.size_px[axis] as f32);
            let ends = [centre[axis] - reach[axis], centre[axis] + reach[axis]];
            let least = (ends[0] / depth[0]).min(ends[0] / depth[1]);
            let most = (ends[1] / depth[0]).max(ends[1] / depth[1]);
            let (first, last) = ((-middle - 0.15 * size) / focal, (size - middle + 0.15 * size) / focal);
            let steepest = least.clamp(first, last).abs().max(most.clamp(first, last).abs());
            let extent = focal / depth[0] * (1.0 + steepest * steepest).sqrt() * own.reach * 1.01 + own.margin_px;
            let (from, to) = (focal * least + middle, focal * most + middle);
            let more = extent + 1e-5 * (extent + from.abs().max(to.abs()) + focal) + 1.0;
            !(to + more < 0.0 || from - more > size)
        })
    }

    fn seen(&self) -> Vec<Seen> {
        let seen = |page: usize| {
            let parent = self.errors[page].parent;
            let of_parent = if parent == NO_PAGE { 0.0 } else { self.width_squared(parent) };
            let weight = if self.may_be_seen(page) { self.samples_in_image(page).max(1) } else { 0 };
            Seen { page, weight, widths: [self.width_squared(page as u32), of_parent] }
        };
        (0..self.boxes.len()).map(seen).collect()
    }

    fn code_below(&self, squared: f32) -> u32 {
        let (bits, significand) = (squared.to_bits(), squared.to_bits() & 0x7f_ffff);
        if bits < 1 << 23 {
            return 0;
        }
        let step = self.steps.partition_point(|least| *least <= significand) as u32 - 1;
        (((bits >> 23) + 1) * 256 + step).min(65534)
    }

    fn limits(&self, seen: &Seen, limit_squared: f32) -> [u32; 2] {
        seen.widths.map(|width| self.code_below(limit_squared * width))
    }

    fn is_in(&self, seen: &Seen, [own, parent]: [u32; 2]) -> bool {
        let errors = &self.errors[seen.page];
        errors.least_error <= own + self.fade && errors.parent_errors[PARTS / 2 - 1] >> 16 > parent
    }

    /// The nodes in culler in units, and their squared error.
    fn remaining(&self, seen: &Seen, limit_squared: f32) -> (u32, f64) {
        let (errors, [own, parent]) = (&self.errors[seen.page], self.limits(seen, limit_squared));
        if !self.is_in(seen, [own, parent]) {
            return (0, 0.0);
        }
        let codes = |words: [u32; PARTS / 2]| words.map(|word| [word & 0xffff, word >> 16]).into_iter().flatten();
        let below = |words: [u32; PARTS / 2], least: u32, limit: u32| {
            let codes: Vec<u32> = codes(words).collect();
            let whole = codes.iter().take_while(|code| **code <= limit).count();
            let from = if whole == 0 { least } else { codes[whole - 1] };
            let inside = codes.get(whole).map_or(0, |to| limit.saturating_sub(from) * 256 / (to - from).max(1));
            256 * whole as u32 + inside.min(256)
        };
        let within = below(errors.errors, errors.least_error, own + self.fade);
        let drawn = errors.count * within.saturating_sub(below(errors.parent_errors, 0, parent)) * seen.weight;
        let whole = f64::from(within) / 256.0;
        let squared_errors = codes(errors.squared_errors).enumerate();
        let sum: f64 =
            squared_errors.map(|(i, code)| value_of_code(code as u16) * (whole - i as f64).clamp(0.0, 1.0)).sum();
        let squared = if whole > 0.0 { sum / whole / f64::from(seen.widths[0]) } else { 0.0 };
        (drawn / 2048, f64::from(drawn) / (2048.0 * NODE_UNITS) * squared)
    }

    /// The nodes in units, and the squared error relative to that of an image with an error of 1 everywhere.
    fn sums(&self, seen: &[Seen], limit_squared: f32) -> (u64, f64) {
        let values = 3.0 * f64::from(self.size_px[0]) * f64::from(self.size_px[1]);
        let remaining = seen.iter().map(|seen| self.remaining(seen, limit_squared));
        remaining.fold((0, 0.0), |sum, page| (sum.0 + u64::from(page.0), sum.1 + page.1 / values))
    }

    /// The square of the limit that meets the target of the options.
    fn limit_squared(&self, seen: &[Seen], options: &Options) -> f32 {
        let number = |is_below: &dyn Fn(f32) -> bool| {
            (0..ROUNDS).fold(0, |number, round| {
                let step = 1 << (3 * (ROUNDS - 1 - round));
                let digits = (1..=CANDIDATES).map(|digit| limit_squared_of(number + digit * step));
                number + step * digits.filter(|limit| is_below(*limit)).count() as u32
            })
        };
        let mut limit = LodTarget::of(options).given_squared;
        if options.lod_psnr > 0.0 {
            let most = 10_f64.powf(-f64::from(options.lod_psnr) / 10.0);
            let number = number(&|limit| self.sums(seen, limit).1 <= most);
            limit = if number == 0 { 0.0 } else { limit_squared_of(number) };
        }
        if options.splats > 0 {
            let number = number(&|limit| self.sums(seen, limit).0 > u64::from(options.splats) * NODE_UNITS as u64);
            limit = if number == 0 { limit } else { limit.max(limit_squared_of(number + 1)) };
        }
        limit
    }
}

fn limit_squared_of(number: u32) -> f32 {
    f32::from_bits(FIRST_BITS + (number << SEARCH_SHIFT))
}

#[test]
fn pages_are_selected_as_in_plain_rust() {
    let scene = cactus::cactus(40_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let of_source = with_source_levels(cactus::cactus(40_000).unwrap(), 5000, Settings::LOSSLESS);
    let (file, device) = (with_levels(scene, Settings::LOSSLESS), open(None));
    let beside = Transform::new(glam::DQuat::from_rotation_y(0.7), [3.0, 0.0, 1.0].into(), 1.5).unwrap();
    let two = [Transform::IDENTITY, beside];
    let plain = Options::EXACT;
    let targets = [
        plain,
        Options { lod_error: 1e-12, ..plain },
        Options { lod_error: 4.0, ..plain },
        Options { splats: 5000, ..plain },
        Options { splats: 500_000, ..plain },
        Options { lod_psnr: 38.0, ..plain },
        Options { splats: 5000, lod_fade: 0.5, ..plain },
        Options { lod_psnr: 45.0, splats: 3000, ..plain },
    ];
    let made = targets.iter().flat_map(|options| [&[][..], &two[..]].map(|places| (&file, options, places)));
    // With fewer splats than that, errors of pages in front are beyond what the shader can add up.
    let kept = [Options { lod_error: 4.0, ..plain }, Options { splats: 50_000, ..plain }];
    let kept = kept.iter().map(|options| (&of_source, options, &two[..]));
    for (file, options, places) in made.chain(kept) {
        let scene = opened_scene(&device, file, places, options);
        let mut selector = LodSelector::new(&device, &scene, scene.paged().unwrap()).unwrap();
        selector.set_capacity(&device, &scene, 5).unwrap();
        let pages = scene.paged().unwrap().cache().pages().clone();
        for zoom in [0.05, 0.4, 1.0, 6.0] {
            let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, [300, 200]);
            let case =
                format!("{} {} {} at {places:?}, zoom {zoom}", options.lod_error, options.lod_psnr, options.splats);
            let selection = selector.select(&device, Shot::new(&scene, &camera), options).unwrap();
            let views = views_of(&scene, &camera, &options.rules);
            let twins: Vec<_> =
                views.chunks(VIEW_ELEMENTS as usize).map(|view| Twin::new(&pages, view, &camera, options)).collect();
            let seen: Vec<_> = twins.iter().flat_map(Twin::seen).collect();
            let limit = twins[0].limit_squared(&seen, options);
            let (nodes, energy) = twins[0].sums(&seen, limit);
            if let Some(LodReport { lod_error, nodes: counted, predicted_psnr, pages, .. }) = selection.detail {
                let expected = 255.0 * f64::from(limit).sqrt();
                // Devices round logarithms and roots of the sums of squared errors differently.
                let slack = if options.lod_psnr > 0.0 { 0.005 } else { 0.0 };
                assert!((lod_error - expected).abs() <= slack * expected, "{case}: {lod_error}, not {expected}");
                let expected = nodes as f64 / NODE_UNITS;
                assert!((counted - expected).abs() <= 2.0 * slack * expected, "{case}: {counted}, not {expected}");
                let (expected, found) = (-10.0 * energy.log10(), predicted_psnr.unwrap_or(f64::INFINITY));
                assert!((found - expected).abs() < 0.05 || energy < 1e-11, "{case}: {found}, not {expected}");
                assert_eq!(pages, selection.pages.len() as u64);
            }
            let limit = selection.detail.map_or(0.0, |detail| (detail.lod_error / 255.0).powi(2) as f32);
            check_pages(
                &case,
                &selection.pages,
                (&twins, limit, selection.detail.is_some()),
                &pages,
                (&scene, &camera, options),
            );
        }
    }
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

#[test]
fn hidden_groups_are_those_of_plain_rust() {
    let scene = cactus::cactus(60_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Settings::LOSSLESS), open(None));
    let beside = Transform::new(glam::DQuat::from_rotation_y(0.7), [3.0, 0.0, 1.0].into(), 1.5).unwrap();
    let options = Options { lod_error: 6.0, lod_occlusion: 3.0, ..Options::EXACT };
    let scene = opened_scene(&device, &file, &[Transform::IDENTITY, beside], &options);
    let mut selector = LodSelector::new(&device, &scene, scene.paged().unwrap()).unwrap();
    let pages = scene.paged().unwrap().cache().pages().clone();
    let camera = Camera::framing(focus.centre.into(), focus.radius, [300, 200]);
    let moved = Camera { position: camera.position + glam::DVec3::new(0.3, -0.1, 0.4), ..camera.clone() };
    let (mut hidden, mut visible) = (0, 0);
    for (form, drawn, nearer) in [(0, &camera, 0.5), (2, &camera, 0.7), (2, &moved, 0.5), (3, &moved, 0.7)] {
        let grid = BinGrid::new(drawn.size_px, form);
        let count = (grid.count() * BLOCKS) as usize;
        // The picture stops at depths that grow to the right, and not at all in a few blocks.
        let mut depths: Vec<f32> = (0..count)
            .map(|place| {
                let column = (place as u32 / BLOCKS % grid.bins[0] * BIN_COLUMNS + place as u32 % BIN_COLUMNS) as f32;
                let depth = focus.radius as f32 * (nearer + 0.02 * column);
                if place % 97 == 0 { f32::INFINITY } else { depth }
            })
            .collect();
        let of_bins: Vec<f32> =
            depths.chunks(BLOCKS as usize).map(|blocks| blocks.iter().copied().fold(0.0, f32::max)).collect();
        depths.extend(of_bins);
        selector.occlusion.set(&device, Shot::new(&scene, drawn), &options, grid, &depths).unwrap();
        let selection = selector.select(&device, Shot::new(&scene, &camera), &options).unwrap();
        let [views, known] = [&camera, drawn].map(|camera| views_of(&scene, camera, &options.rules));
        let twins: Vec<_> = views
            .chunks(VIEW_ELEMENTS as usize)
            .zip(known.chunks(VIEW_ELEMENTS as usize))
            .map(|(view, known)| {
                let words: Vec<f32> = known.as_flattened().iter().map(|word| f32::from_bits(*word)).collect();
                let known = TwinOcclusion {
                    factor_squared: 64.0,
                    is_of_this_camera: *drawn == camera,
                    view: words.try_into().unwrap(),
                    grid,
                    depths: depths.clone(),
                };
                Twin { known: Some(known), ..Twin::new(&pages, view, &camera, &options) }
            })
            .collect();
        for twin in &twins {
            for page in 0..pages.pages().len() as u32 {
                let (is_hidden, parent) = (twin.hides(page), twin.errors[page as usize].parent);
                assert!(is_hidden || parent == NO_PAGE || !twin.hides(parent), "page {page} is in a hidden box");
                *if is_hidden { &mut hidden } else { &mut visible } += 1;
            }
        }
        let limit = LodTarget::of(&options).given_squared;
        let case = format!("form {form}, {nearer}");
        check_pages(&case, &selection.pages, (&twins, limit, true), &pages, (&scene, &camera, &options));
    }
    // Another focal length shows other blocks.
    let zoomed = Camera { focal_px: 1.5 * camera.focal_px, ..camera.clone() };
    let factors = [&camera, &zoomed].map(|camera| selector.occlusion.words(camera, &options).factor_squared);
    assert_eq!(factors, [64.0, 1.0]);
    assert!(hidden > 20 && visible > 20, "{hidden} hidden, {visible} visible");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// Fails unless these are exactly the pages of the cut that may be in view.
fn check_pages(
    case: &str,
    selection: &[super::selection::SelectedPage],
    (twins, limit, is_by_levels): (&[Twin], f32, bool),
    pages: &Pages,
    (scene, camera, options): (&GpuScene, &Camera, &Options),
) {
    let mut listed: Vec<_> = selection.iter().map(|page| (page.view, page.page)).collect();
    listed.sort_unstable();
    assert!(listed.windows(2).all(|pair| pair[0] != pair[1]), "{case}: no page twice");
    let keys = DepthKeys::of(camera, options, &scene.extent);
    let culler = PageCuller {
        rules: &options.rules,
        alpha_min: pages.alpha_min(),
        keys,
        bin_px: [64, 32],
        top_px: 0,
        bins: [5, 7],
        largest_key: keys.limit(),
    };
    let cameras: Vec<_> = scene.transforms().iter().map(|place| PlacedCamera::of(camera, place)).collect();
    for (view, twin) in twins.iter().enumerate() {
        for seen in twin.seen() {
            let limits = twin.limits(&seen, limit);
            // The limit was rounded in the report.
            let is_near_edge = is_by_levels
                && [0.9999, 1.0001].map(|factor| twin.is_in(&seen, twin.limits(&seen, factor * limit)))
                    != [twin.is_in(&seen, limits); 2];
            let is_listed = listed.binary_search(&(view as u32, seen.page as u32)).is_ok();
            let may_be_seen =
                culler.page(seen.page as u32, &pages.pages()[seen.page], view as u32, &cameras[view]).is_some();
            if is_near_edge {
                continue;
            }
            assert!(!is_listed || twin.is_in(&seen, limits), "{case}: {} is not in the cut", seen.page);
            let is_missed = !is_listed && may_be_seen && twin.is_in(&seen, limits);
            assert!(!is_missed, "{case}: {} is missing", seen.page);
        }
    }
    for page in selection {
        let twin = &twins[page.view as usize];
        let seen = Seen {
            page: page.page as usize,
            weight: 0,
            widths: [page.page, twin.errors[page.page as usize].parent]
                .map(|page| if page == NO_PAGE { 0.0 } else { twin.width_squared(page) }),
        };
        for (own, expected) in page.error_limits.iter().zip(twin.limits(&seen, limit)) {
            assert!((i64::from(*own) - i64::from(expected)).abs() <= 1, "{case}: limit {own}, not {expected}");
        }
    }
}

/// Each Gaussian adds its opacity to one node on each path to the root, so every cut has the same sum: also with
/// missing pages, whose fallback limits select coarser nodes.
#[test]
fn every_cut_stands_for_every_gaussian_once() {
    let scene = cactus::cactus(30_000).unwrap();
    let (focus, sum) = (Focus::of(&scene.gaussians), scene.gaussians.opacities().iter().sum::<f32>());
    let file = with_levels(scene, Settings::LOSSLESS);
    let (pages, device) = (file.pages(), open(None));
    let mut words = vec![0; pages.len() * LEVEL_WORDS * PAGE];
    file.read_levels(0..pages.len(), &mut words).unwrap();
    let mut geometry = vec![0; pages.len() * file.geometry_words()];
    file.read_geometry(0..pages.len(), &mut geometry).unwrap();
    let options = Options { splats: 1, lod_fade: 0.5, rules: Rules { near: 0.01, ..Rules::TRAINED }, ..Options::EXACT };
    let scene = opened_scene(&device, &file, &[], &options);
    let all = scene.paged().unwrap().cache().pages().clone();
    let levels = file.levels().unwrap();
    let mut fallback = FallbackLimits::new(Arc::new(PageHierarchy::new(levels, |_| 0)));
    let mut state = 7_u64;
    let mut below = |count: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % count
    };
    let mut sizes = Vec::new();
    for (number, zoom) in [0.1, 0.3, 1.0, 5.0, 30.0].into_iter().enumerate() {
        let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, [640, 480]);
        let twin = Twin::new(&all, &views_of(&scene, &camera, &options.rules), &camera, &options);
        for exponent in (-40..-4).step_by(9).chain(-4..16) {
            let limit = (f64::from(exponent).exp2() / 255.0).powi(2) as f32;
            let one_in = [0, 2, 20, 200][(exponent & 3) as usize];
            let is_missing = |page: usize| page + 1 < pages.len() && one_in > 0 && below(one_in) == 0;
            let is_resident: Vec<bool> = (0..pages.len()).map(is_missing).map(|is_missing| !is_missing).collect();
            fallback.set_resident(&is_resident);
            fallback.fade(u16::MAX);
            // As in nodes.glsl, and without fading for every other limit.
            let fade = if exponent % 2 == 0 { twin.fade } else { 0 };
            let replaced_fraction = |error: u32, limit: u32| match fade {
                _ if error == u32::from(NEVER) => 0.0,
                0 => f64::from(u8::from(error <= limit)),
                _ => ((f64::from(limit) + f64::from(fade) - f64::from(error)) / f64::from(fade)).clamp(0.0, 1.0),
            };
            let (mut nodes, mut opacity) = (0, 0.0);
            for seen in twin.seen() {
                let (page, fallback) = (seen.page, fallback.words()[seen.page]);
                let [own, of_parent] = twin.limits(&seen, limit);
                let [own, of_parent] = [own.max(fallback & 0xffff), of_parent.max(fallback >> 16)];
                let mut drawn = 0;
                for k in 0..pages[page].count as usize {
                    let [errors, opacities] = words[(page * PAGE + k) * LEVEL_WORDS..][..2] else { panic!() };
                    let fraction = replaced_fraction(errors & 0xffff, own) - replaced_fraction(errors >> 16, of_parent);
                    assert!(fraction >= 0.0, "errors do not fall towards the root");
                    if fraction > 0.0 {
                        let shape = file.words().shape_of(&geometry[page * file.geometry_words()..], k);
                        let of_scene = f64::from(file.layout().unpacked_shape(&shape).2);
                        opacity +=
                            fraction * if opacities == 0 { of_scene } else { value_of_code((opacities >> 16) as u16) };
                        drawn += 1;
                    }
                }
                assert!(drawn == 0 || is_resident[page], "page {page} is missing");
                assert!(drawn == 0 || twin.is_in(&seen, [own, of_parent]), "page {page} is in the cut");
                nodes += drawn;
            }
            assert!((opacity / f64::from(sum) - 1.0).abs() < 1e-3, "{number}, {limit}: {opacity} of {sum}");
            sizes.push(nodes);
        }
    }
    assert!(sizes.contains(&30_000) && sizes.iter().any(|nodes| *nodes < 1000), "{sizes:?}");
}
