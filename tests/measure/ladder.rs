//! The bench `ladder`: its rungs, and the counts of a frame, against the CPU; its report.

#[path = "../../benches/ladder/main.rs"]
mod bench;

use std::fs;

use bench::climb::{Evidence, agree};
use bench::host_stages;
use bench::report::LadderReport;
use bench::rungs::{Processor, RUNGS, Rung};
use bench::variant::{Variant, VariantFrame};
use glam::DVec3;
use serde_json::Value;
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::reference::{self, Splat, Tiling};
use smalto::render::{GpuScene, Renderer, Totals};
use smalto::rules::{Background, Rules, TILE};
use smalto::scene::{Gaussians, Raw};

use crate::common::program::path;
use crate::common::{Gpu, Random, gaussians};

fn camera(size: [u32; 2]) -> Camera {
    Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9)
}

fn draw(gpu: &Gpu, rung: &Rung, scene: &Gaussians, cameras: &[Camera]) -> (VariantFrame, Pixels) {
    let scene = GpuScene::new(&gpu.0, scene, &Options::EXACT).unwrap();
    let mut variant = Variant::new(&gpu.0, rung, &Options::EXACT, &scene).unwrap();
    let frames = cameras.iter().map(|camera| variant.render(camera).unwrap());
    (frames.last().unwrap(), variant.pixels().unwrap())
}

#[test]
fn the_last_rung_is_the_frame_of_the_portable_path() {
    let gpu = Gpu::new();
    let (scene, camera) = (cactus(4000).unwrap().gaussians, camera([150, 90]));
    let last = draw(&gpu, &RUNGS[RUNGS.len() - 1], &scene, std::slice::from_ref(&camera));
    assert!(last.1 == gpu.render(&scene, &camera, &Options { portable: true, ..Options::EXACT }));
}

#[test]
fn rungs_with_equal_tiles_agree_bit_for_bit_even_after_growth() {
    let gpu = Gpu::new();
    let scene = cactus(3000).unwrap().gaussians;
    // The second view needs more room than the first.
    let cameras = [camera([40, 40]), camera([130, 90])];
    for group in [&RUNGS[..10], &RUNGS[10..]] {
        let (frame, pixels) = draw(&gpu, &group[0], &scene, &cameras);
        for rung in group.iter().skip(1) {
            let (other_frame, other_pixels) = draw(&gpu, rung, &scene, &cameras);
            let counts = |t: &Totals| (t.visible, t.listed_kept, t.longest_list);
            assert_eq!(counts(&other_frame.totals), counts(&frame.totals), "{}", rung.name);
            // No two splats of this scene lie at one depth.
            assert!(other_pixels == pixels, "{}", rung.name);
        }
    }
}

#[test]
fn rungs_blend_lists_longer_than_a_pass() {
    let gpu = Gpu::new();
    let mut random = Random(7);
    // Faint specks, so that no pixel is ever opaque: every entry of the list counts.
    let speck = |_| {
        let mean = [random.between(-0.5, 0.5), random.between(-0.5, 0.5), random.between(3.0, 4.0)];
        let raw = Raw { mean, log_scale: [-8.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: -5.2 };
        (raw, [0.9, 0.5, 0.2])
    };
    let specks: Vec<_> = (0..70_000).map(speck).collect();
    let scene = gaussians(&specks);
    let camera = [Camera::looking_at(DVec3::ZERO, DVec3::Z, [16, 16], 0.35)];
    let exact = reference::render(&scene, &camera[0], &Options::EXACT.rules, Background::BLACK).to_pixels();
    for rung in &RUNGS {
        let (frame, pixels) = draw(&gpu, rung, &scene, &camera);
        assert!(frame.totals.longest_list > 40_000, "{}", frame.totals.longest_list);
        let psnr = smalto::measure::metrics::psnr(&pixels, &exact);
        assert!(psnr > 60.0, "{}: {psnr} dB", rung.name);
    }
}

#[test]
fn rungs_draw_the_background_of_an_empty_scene() {
    let gpu = Gpu::new();
    let scene = cactus(300).unwrap().gaussians;
    let away = [Camera::looking_at(DVec3::new(0.0, 0.0, -1e4), DVec3::new(0.0, 0.0, -2e4), [33, 17], 0.9)];
    for rung in &RUNGS {
        let (frame, pixels) = draw(&gpu, rung, &scene, &away);
        assert_eq!((frame.totals.visible, frame.totals.listed_kept), (0, 0), "{}", rung.name);
        assert!(pixels.rgba.iter().all(|p| *p == [0.0; 4]), "{}", rung.name);
    }
}

#[test]
fn three_sigma_squares_are_those_of_the_original() {
    let gpu = Gpu::new();
    let mut random = Random(3);
    let mut between = |low, high| random.between(low, high);
    // Needles and discs around the middle of the image: all are visible, many reach over its border.
    let gaussian = |_| {
        let mean = [between(-0.8, 0.8), between(-0.4, 0.4), between(3.0, 5.0)];
        let log_scale = [between(-6.0, -1.0), between(-6.0, -1.0), between(-6.0, -1.0)];
        let rotation = [between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0)];
        (Raw { mean, log_scale, rotation, opacity_logit: 2.0 }, [0.5; 3])
    };
    let scene = gaussians(&(0..2000).map(gaussian).collect::<Vec<_>>());
    let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [300, 150], 0.9);
    let (frame, _) = draw(&gpu, &RUNGS[0], &scene, std::slice::from_ref(&camera));
    let tiling = Tiling::of(camera.size_px);
    let rules = Rules::INRIA;
    let tiles = |id: u32| {
        let splat = reference::project(&scene, id, &camera, &rules);
        reference::tiles(&splat, tiling, &rules).len() as u32
    };
    let expected: u32 = (0..2000).map(tiles).sum();
    let found = frame.totals.listed_kept;
    assert_eq!(frame.totals.visible, 2000);
    // f32 rounds a radius or a border the other way here and there.
    assert!(found.abs_diff(expected) * 1000 < expected, "{found} instances, {expected} expected");
}

#[test]
fn counting_frames_agree_with_the_reference_and_draw_the_same_picture() {
    let gpu = Gpu::new();
    let (scene, camera) = (cactus(3000).unwrap().gaussians, camera([96, 70]));
    let options = Options { portable: true, ..Options::EXACT };
    let gpu_scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
    let count = |options: &Options| {
        let mut still = Renderer::new(&gpu.0, options, &gpu_scene).unwrap();
        still.render(&camera, Background::BLACK).unwrap();
        let plain = still.pixels().unwrap();
        still.count_work(true).unwrap();
        let totals = still.render(&camera, Background::BLACK).unwrap().totals;
        // What is counted is the portable path's.
        let counted = still.pixels().unwrap();
        assert!(counted == plain || !options.portable && smalto::measure::metrics::psnr(&counted, &plain) >= 110.0);
        totals
    };
    let (portable, default) = (count(&options), count(&Options::EXACT));
    let (evaluations, stopped) = reference_counts(&scene, &camera, &options.rules);
    // f32 decides a few thresholds otherwise than f64.
    let near = |found: u32, expected: u32| found.abs_diff(expected) <= expected / 1000 + 2;
    assert!(near(portable.evaluations_low, evaluations), "{} of {evaluations}", portable.evaluations_low);
    assert!(near(portable.stopped_pixels, stopped), "{} of {stopped}", portable.stopped_pixels);
    assert_eq!(default.stopped_pixels, portable.stopped_pixels);
    assert!(default.evaluations_low < portable.evaluations_low, "splats that miss a block are not walked");
    assert!(portable.walked_low >= portable.evaluations_low);
    assert_eq!((portable.listed_tiles, portable.evaluations_high, portable.walked_high), (30, 0, 0));
}

/// Alphas up to the end of each pixel, and the pixels that end before their list does.
fn reference_counts(scene: &Gaussians, camera: &Camera, rules: &Rules) -> (u32, u32) {
    let [alpha_min, alpha_max, transmittance_min] =
        [rules.alpha_min, rules.alpha_max, rules.transmittance_min].map(f64::from);
    let tiling = Tiling::of(camera.size_px);
    let mut splats: Vec<Splat> = {
        let visible = reference::cull(scene, camera, rules).into_iter();
        visible.map(|id| reference::project(scene, id, camera, rules)).collect()
    };
    splats.sort_by(|a, b| (a.depth as f32).total_cmp(&(b.depth as f32)));
    let mut lists = vec![Vec::new(); tiling.tiles()];
    for splat in &splats {
        reference::tiles(splat, tiling, rules).into_iter().for_each(|tile| lists[tile as usize].push(splat));
    }
    let (mut evaluations, mut stopped) = (0, 0);
    for y in 0..camera.size_px[1] {
        for x in 0..camera.size_px[0] {
            let mut transmittance = 1.0;
            for splat in &lists[(y / TILE * tiling.counts[0] + x / TILE) as usize] {
                evaluations += 1;
                let distance = splat.distance(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                let alpha = (splat.opacity * (-0.5 * distance).exp()).min(alpha_max);
                if alpha < alpha_min {
                    continue;
                }
                if transmittance * (1.0 - alpha) < transmittance_min {
                    stopped += 1;
                    break;
                }
                transmittance *= 1.0 - alpha;
            }
        }
    }
    (evaluations, stopped)
}

#[test]
fn the_report_has_every_rung_and_keeps_to_its_schema() {
    let folder = tempfile::tempdir().unwrap();
    let (out, table, plot) = (path(&folder, "a.json"), path(&folder, "a.csv"), path(&folder, "a.svg"));
    let mut arguments =
        vec!["ladder", "cactus:1000", "few-large:20", "--size", "48x40", "--warmup", "0", "--frames", "3"];
    arguments.extend(["--json", &out, "--csv", &table]);
    if cfg!(feature = "plots") {
        arguments.extend(["--plot", &plot]);
    }
    bench::run(arguments.into_iter().map(str::to_owned)).unwrap();
    let report: Value = serde_json::from_str(&fs::read_to_string(&out).unwrap()).unwrap();
    let schema = include_str!("../../docs/schemas/ladder.schema.json");
    let current = format!("{:#}\n", schemars::schema_for!(LadderReport).as_value());
    assert!(
        schema == current,
        "ladder.schema.json is old: `cargo bench --bench ladder -- --schema` prints the new one"
    );
    let validator = jsonschema::validator_for(&serde_json::from_str(schema).unwrap()).unwrap();
    assert!(validator.is_valid(&report), "{:?}", validator.validate(&report).err());
    assert_eq!(report["climbs"].as_array().unwrap().len(), 2);
    let rungs = report["climbs"][0]["rungs"].as_array().unwrap();
    let names: Vec<_> = rungs.iter().map(|r| r["name"].as_str().unwrap()).collect();
    assert_eq!(names, RUNGS.map(|rung| rung.name));
    for (rung, report) in RUNGS.iter().zip(rungs) {
        let host: f64 = report["stages"].as_array().unwrap().iter().map(|s| s["host_ms"].as_f64().unwrap()).sum();
        assert_eq!(host > 0.0, rung.compaction == Processor::Cpu, "{}: {host} ms on the CPU", rung.name);
    }
    assert!(fs::read_to_string(&table).unwrap().contains("baseline,ranges ms"));
    assert!(!cfg!(feature = "plots") || fs::metadata(&plot).unwrap().len() > 1000);
}

#[test]
fn pictures_with_more_tiles_than_loops_reach_are_refused() {
    if Gpu::new().0.capabilities().loop_limit.is_some() {
        let arguments = ["ladder", "cactus:10", "--size", "256x65520"].map(str::to_owned);
        let error = bench::run(arguments.into_iter()).unwrap_err().to_string();
        assert!(error.contains("limits loops to fewer iterations than 65520 tiles need"), "{error}");
    }
}

fn evidence(rung: &'static Rung, counts: [u32; 2], grey: f32) -> Evidence {
    Evidence { rung, counts: vec![counts], pixels: Pixels { size: [1, 1], rgba: vec![[grey, grey, grey, 1.0]] } }
}

#[test]
fn rungs_that_differ_where_they_must_not_are_found() {
    let named = |name: &str| RUNGS.iter().find(|r| r.name == name).unwrap();
    let (base, single, exact) = (named("baseline"), named("+1 in a single pass"), named("+6 exact tiles"));
    let error = |a: Evidence, b: Evidence| agree(&a, &b).err().map(|e| e.to_string());
    assert_eq!(error(evidence(base, [5, 9], 0.5), evidence(named("+2 GPU ranges"), [5, 9], 0.5)), None);
    let seen = error(evidence(base, [5, 9], 0.5), evidence(exact, [6, 8], 0.5)).unwrap();
    assert!(seen.contains("see different"), "{seen}");
    let counted = error(evidence(base, [5, 9], 0.5), evidence(single, [5, 8], 0.5)).unwrap();
    assert!(counted.contains("count different"), "{counted}");
    let bits = error(evidence(base, [5, 9], 0.5), evidence(named("+2 GPU ranges"), [5, 9], 0.500_01)).unwrap();
    assert!(bits.contains("different bits"), "{bits}");
    assert_eq!(error(evidence(base, [5, 9], 0.5), evidence(single, [5, 9], 0.500_01)), None);
    assert_eq!(error(evidence(base, [5, 9], 0.5), evidence(exact, [5, 7], 0.501)), None);
    let pictures = error(evidence(base, [5, 9], 0.5), evidence(exact, [5, 7], 0.6)).unwrap();
    assert!(pictures.contains("20.0 dB"), "{pictures}");
}

#[test]
fn compact_lists_the_bits_that_are_set() {
    let mut ids = [0; 3];
    assert_eq!(host_stages::compact(&[0b101, 0, 1 << 31], &mut ids), 3);
    assert_eq!(ids, [0, 2, 95]);
    assert_eq!(host_stages::compact(&[u32::MAX], &mut ids), 32, "bits that do not fit are counted");
}

#[test]
fn duplicate_walks_rows_and_columns() {
    let span = |first: u32, end: u32| first | end << 16;
    let (mut keys, mut ids) = ([0; 8], [0; 8]);
    let ranges = [[1, 2 | 2 << 16], [0, 0], [0, 1 << 16]];
    let count = host_stages::duplicate(&ranges, &[span(4, 5), span(0, 2), span(3, 4)], 10, &mut keys, &mut ids);
    assert_eq!((&keys[..count], &ids[..count]), (&[20, 21, 33, 4][..], &[0, 0, 0, 2][..]));
}
