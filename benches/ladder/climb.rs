//! Measures all rungs on one scene, and checks that they draw the same picture.

use std::time::Instant;

use anyhow::{Result, bail, ensure};
use smalto::camera::Camera;
use smalto::measure::bench::{Bench, ClockProbe, Clocks, SceneReport, Statistics, WarmUpLimits, image_hash};
use smalto::measure::metrics::psnr;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::render::GpuScene;

use super::report::{Climb, RungReport, RungStage};
use super::rungs::{Duplication, RUNGS, Rung};
use super::variant::{Variant, VariantFrame};

/// Least PSNR in dB of rungs with different tiles: squares of three standard deviations cut off splats farther out.
const OTHER_TILES_DB: f64 = 30.0;
/// Least PSNR in dB of rungs of which one leaves the order of equal depths undefined.
const OPEN_ORDER_DB: f64 = 60.0;

/// Counts of a rung for every view (visible splats and instances), and its picture of the last view.
pub struct Evidence {
    pub rung: &'static Rung,
    pub counts: Vec<[u32; 2]>,
    pub pixels: Pixels,
}

/// Measures all rungs over `views`, which are of one size.
///
/// # Errors
/// If rungs that must agree count or draw differently, or if rendering fails.
pub fn climb(
    bench: &Bench,
    scene: &SceneReport,
    gpu_scene: &GpuScene,
    options: &Options,
    views: &[Camera],
) -> Result<Climb> {
    let probe = ClockProbe::new(&bench.device);
    // The first rung of each tile test: the others are compared with it.
    let mut first: Vec<Evidence> = Vec::new();
    let (mut rungs, mut warm_up) = (Vec::new(), None);
    let (mut protocol, mut shown) = (bench.protocol, views.to_vec());
    for rung in &RUNGS {
        let mut variant = Variant::new(&bench.device, rung, options, gpu_scene)?;
        if let (Some(patience), true) = (bench.patience, rungs.is_empty()) {
            // The first rung is the slowest; its first frame may grow buffers. All rungs show the same views.
            variant.render(&views[0])?;
            let second = Instant::now();
            variant.render(&views[0])?;
            protocol = protocol.within(patience, second.elapsed());
            let count = protocol.frames.min(views.len());
            shown = (0..count).map(|i| views[i * views.len() / count].clone()).collect();
        }
        let mut render = |i: usize| variant.render(&shown[i % shown.len()]);
        let limits = WarmUpLimits::THOROUGH.after(warm_up);
        warm_up = protocol.warm_up(shown.len(), limits, |view| Ok(gpu_ms(&render(view)?)))?;
        let frames = (0..protocol.frames).map(&mut render).collect::<Result<Vec<_>>>()?;
        let clocks = probe.now();
        let counts = frames.iter().map(|f| [f.totals.visible, f.totals.listed_kept]).collect();
        let new = Evidence { rung, counts, pixels: variant.pixels()? };
        first.iter().try_for_each(|earlier| agree(earlier, &new))?;
        let baseline = first.first().map(|baseline| &baseline.pixels);
        rungs.push(RungReport { warm_up, ..report(rung, &frames, clocks, &new.pixels, baseline) });
        if first.iter().all(|earlier| earlier.rung.exact_tiles != rung.exact_tiles) {
            first.push(new);
        }
    }
    Ok(Climb { scene: scene.clone(), size: views[0].size_px, near: options.rules.near, frames: protocol.frames, rungs })
}

/// GPU time of a frame, without the stages on the CPU.
fn gpu_ms(frame: &VariantFrame) -> f64 {
    frame.stages.iter().map(|stage| stage.gpu_ms).sum()
}

/// Fails if two rungs differ in something in which they must agree.
pub fn agree(a: &Evidence, b: &Evidence) -> Result<()> {
    let names = (a.rung.name, b.rung.name);
    let visible = |e: &Evidence| e.counts.iter().map(|c| c[0]).collect::<Vec<_>>();
    ensure!(visible(a) == visible(b), "the rungs {} and {} see different Gaussians", names.0, names.1);
    let at_least = |wanted_db: f64| {
        let psnr_db = psnr(&a.pixels, &b.pixels);
        if psnr_db.is_nan() || psnr_db < wanted_db {
            bail!("the rungs {} and {} draw different pictures: {psnr_db:.1} dB", names.0, names.1);
        }
        Ok(())
    };
    if a.rung.exact_tiles != b.rung.exact_tiles {
        return at_least(OTHER_TILES_DB);
    }
    ensure!(a.counts == b.counts, "the rungs {} and {} count different instances", names.0, names.1);
    if [a, b].iter().any(|e| e.rung.duplication == Duplication::SingleAllocation) {
        return at_least(OPEN_ORDER_DB);
    }
    ensure!(a.pixels == b.pixels, "the rungs {} and {} draw different bits", names.0, names.1);
    Ok(())
}

fn report(
    rung: &Rung,
    frames: &[VariantFrame],
    clocks: Option<Clocks>,
    pixels: &Pixels,
    baseline: Option<&Pixels>,
) -> RungReport {
    let of = |value: &dyn Fn(&VariantFrame) -> f64| Statistics::of(frames.iter().map(value));
    let stage = |name: &'static str| {
        let times = |f: &VariantFrame| f.stages.iter().find(|s| s.name == name).map(|s| (s.gpu_ms, s.host_ms));
        let times = |f: &VariantFrame| times(f).unwrap_or_default();
        let host_ms = of(&|f| times(f).1).median;
        RungStage { name: name.to_owned(), ms: of(&|f| times(f).0 + times(f).1), host_ms }
    };
    RungReport {
        name: rung.name.to_owned(),
        from: rung.from.map(str::to_owned),
        stage: rung.stage.to_owned(),
        warm_up: None,
        clocks,
        wall_ms: of(&|f| f.wall_ms),
        stages: frames[0].stages.iter().map(|s| stage(s.name)).collect(),
        visible: of(&|f| f.totals.visible.into()),
        instances: of(&|f| f.totals.listed_kept.into()),
        longest_list: of(&|f| f.totals.longest_list.into()),
        image_hash: image_hash(pixels),
        to_baseline_db: baseline.map(|first| psnr(pixels, first)).filter(|db| db.is_finite()),
    }
}
