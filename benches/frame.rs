//! GPU time of a frame and of its stages over the cameras of a file, 30 warm-up and 100 measured frames.
//!
//! `cargo bench --bench frame -- SCENE CAMERAS.json WIDTHxHEIGHT...`; without arguments, the cactus seen from an orbit.
//! `--portable` measures the portable path, `--check` compares the first camera's picture with the f64 reference.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use glam::DVec3;
use smalto::camera::{self, Camera};
use smalto::cli;
use smalto::environment::Environment;
use smalto::gpu::{Device, Timestamps, Validation};
use smalto::metrics::{max_error, psnr};
use smalto::options::{Background, Options};
use smalto::reference;
use smalto::render::{Frame, GpuScene, Still};
use smalto::scene::{self, Focus, synthetic};

const WARM_UP: usize = 30;
const FRAMES: usize = 100;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let environment = Environment::read();
    let device = Device::open(&environment.device, environment.validation.unwrap_or(Validation::Off))?;
    let portable = std::env::args().any(|a| a == "--portable");
    println!("{}, {}{}", device.facts().name, device.facts().driver, if portable { ", portable path" } else { "" });

    let name = arguments.first().map_or("cactus", String::as_str);
    let started = Instant::now();
    let scene = match synthetic::parse(name) {
        Some(count) => synthetic::cactus(count?)?,
        None => scene::read(Path::new(name), &|_| {})?,
    };
    let read_s = started.elapsed().as_secs_f64();
    let cameras: Vec<Camera> = match arguments.get(1).filter(|_| synthetic::parse(name).is_none()) {
        Some(file) => camera::read(Path::new(file))?.into_iter().map(|c| c.camera).collect(),
        None => orbit(&Focus::of(&scene.gaussians)),
    };
    let started = Instant::now();
    let gpu_scene = GpuScene::new(&device, &scene.gaussians)?;
    let upload_s = started.elapsed().as_secs_f64();
    println!(
        "{name}: {} Gaussians, SH degree {}, read {read_s:.2} s, upload {upload_s:.2} s, {} MB",
        gpu_scene.len(),
        gpu_scene.sh_degree(),
        gpu_scene.bytes() >> 20
    );
    let sizes = arguments.iter().skip(2).map(|text| cli::parse_size(text));
    let sizes = sizes.collect::<Result<Vec<_>>>()?;
    let options = Options { portable, ..Options::default() };
    let mut still = Still::new(&device, &options, &gpu_scene)?;
    for size in if sizes.is_empty() { vec![[720, 720]] } else { sizes } {
        let cameras: Vec<Camera> = cameras.iter().map(|c| c.resized(size)).collect();
        measure(&mut still, &cameras, size)?;
        if std::env::args().any(|a| a == "--check") {
            still.render(&cameras[0], Background::BLACK)?;
            let (pixels, options) = (still.pixels()?, Options { portable, ..Options::default() });
            let exact = reference::render(&scene.gaussians, &cameras[0], &options, Background::BLACK).to_pixels();
            println!(
                "  {:.1} dB to the f64 reference, largest difference {:.5}",
                psnr(&pixels, &exact),
                max_error(&pixels, &exact)
            );
        }
    }
    Ok(())
}

fn measure(still: &mut Still, cameras: &[Camera], size: [u32; 2]) -> Result<()> {
    let mut run = |timestamps: Timestamps| -> Result<(Vec<Frame>, f64)> {
        still.set_timestamps(timestamps);
        let mut frames = Vec::new();
        let mut started = Instant::now();
        for i in 0..WARM_UP + FRAMES {
            if i == WARM_UP {
                started = Instant::now();
                frames.clear();
            }
            frames.push(still.render(&cameras[i % cameras.len()], Background::BLACK)?);
        }
        Ok((frames, started.elapsed().as_secs_f64() * 1e3 / FRAMES as f64))
    };
    let (whole, wall_ms) = run(Timestamps::Outermost)?;
    let (staged, _) = run(Timestamps::All)?;
    let frame_ms = |frames: &[Frame]| {
        quantiles(frames.iter().map(|f| f.timings.iter().find(|t| t.depth == 0).map_or(0.0, |t| t.duration_ms)))
    };
    let (median, p95) = frame_ms(&whole);
    let (staged_median, _) = frame_ms(&staged);
    let counts = |pick: fn(&Frame) -> u32| quantiles(whole.iter().map(|f| f64::from(pick(f)))).0 / 1e6;
    println!(
        "{}x{}: frame {median:.3} ms median, {p95:.3} p95, {wall_ms:.3} wall; {staged_median:.3} with stage timestamps; \
         {:.2} M visible, {:.2} M spans, {:.2} M instances; longest list {}; {} MB of buffers",
        size[0],
        size[1],
        counts(|f| f.totals.visible),
        counts(|f| f.totals.spans),
        counts(|f| f.totals.instances_kept),
        whole.iter().map(|f| f.totals.longest_list).max().unwrap_or(0),
        still.bytes() >> 20
    );
    let mut stages: Vec<_> = staged[0].timings.iter().filter(|t| t.depth > 0).collect();
    stages.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
    for stage in stages {
        let times = staged.iter().flat_map(|f| &f.timings).filter(|t| t.name == stage.name).map(|t| t.duration_ms);
        let (median, p95) = quantiles(times);
        println!("  {:<12} {median:8.4} ms median, {p95:8.4} p95", stage.name);
    }
    Ok(())
}

/// Median and 95th percentile.
fn quantiles(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    let at = |fraction: f64| values[((values.len() - 1) as f64 * fraction).round() as usize];
    (at(0.5), at(0.95))
}

/// A hundred views around the scene, nearer and farther.
fn orbit(focus: &Focus) -> Vec<Camera> {
    let centre = DVec3::from(focus.centre);
    let view = |i: i32| {
        let turn = f64::from(i) / 100.0 * std::f64::consts::TAU;
        let distance = focus.radius * (2.2 + 0.8 * (2.0 * turn).sin());
        let offset = DVec3::new(turn.cos(), -0.35, turn.sin()) * distance;
        Camera::looking_at(centre + offset, centre, [720, 720], 60f64.to_radians())
    };
    (0..100).map(view).collect()
}
