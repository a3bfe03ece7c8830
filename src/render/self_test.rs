//! The self-tests of the fast paths: of the one at the start, of the one along rays before its first picture. A picture
//! of some Gaussians of the scene is compared with that of the path that runs on every device.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, bail, ensure};

use super::capacity::MAX_ATTEMPTS;
use super::fast::BLOCK_FORMS;
use super::frame::{Shot, Target, Variation};
use super::path::{Path, PathPair};
use super::path_choice::PathChoice;
use super::readback::read_pixels;
use super::scene::{GpuScene, SELF_TEST_GAUSSIANS, SELF_TEST_SIZE};
use crate::camera::{Camera, Lens};
use crate::gpu::{Access, Commands, Device, DeviceKind, Image};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::rules::Background;

/// The largest difference between the paths that rounding explains, relative to a channel's value or to 1 if that is
/// larger. Rounding sometimes moves an alpha across a threshold, which is a step of 1/255; errors are larger.
const TOLERANCE: f32 = 0.03;

/// True if the fast path is tested on this device, because shader compilers of GPU drivers make mistakes. On a software
/// device, which the tests run on, the pipelines of the self-test would take longer to compile than a frame to draw.
fn is_due(device: &Device) -> bool {
    device.capabilities().kind != DeviceKind::Cpu
}

/// The camera of the self-test of a scene.
fn camera(pair: PathPair, scene: &GpuScene) -> Result<Camera> {
    let camera = scene.self_test.camera.clone();
    Ok(match pair {
        PathPair::Projected => camera,
        PathPair::Rays => Camera { lens: Lens::named("FISHEYE", &[])?.map(Arc::new), ..camera },
    })
}

/// The paths of a renderer, of which the fast one has passed its self-test.
pub(crate) fn choose(device: &Device, options: &Options, scene: &GpuScene, variation: Variation) -> Result<PathChoice> {
    let mut paths = PathChoice::new(device, options, scene, variation)?;
    if is_due(device) {
        test(&mut paths, device, scene, PathPair::Projected)?;
    }
    Ok(paths)
}

/// Tests the fast path along rays, unless it was tested or `camera` needs none.
pub(crate) fn test_rays(paths: &mut PathChoice, device: &Device, scene: &GpuScene, camera: &Camera) -> Result<()> {
    if camera.lens.is_none() || !paths.rays_need_test() || !is_due(device) {
        return Ok(());
    }
    test(paths, device, scene, PathPair::Rays)
}

/// Tests a fast path, and drops it if its picture differs from that of the other path. A device that remembers a passed
/// test is not tested again with the same pipelines and Gaussians.
fn test(paths: &mut PathChoice, device: &Device, scene: &GpuScene, pair: PathPair) -> Result<()> {
    let Some(pipelines) = paths.fingerprint(device, pair)? else { return Ok(()) };
    // A scene may need stages that the self-test of another did not reach.
    let drawn = scene.self_test.hash;
    let test = blake3::Hasher::new().update(pipelines.as_bytes()).update(drawn.as_bytes()).finalize();
    if device.has_passed(test.as_bytes()) {
        return paths.end_self_test(device, scene.len(), pair, None);
    }
    let begun = Instant::now();
    if pair == PathPair::Projected {
        paths.make_all_pipelines(device)?;
    }
    let disagreement = match disagreement(paths, device, scene, pair) {
        Err(error) if error.is::<OutOfMemory>() => {
            // The buffers of the first guess may leave too little memory.
            paths.release(device)?;
            match disagreement(paths, device, scene, pair) {
                // Without memory for its small pictures the self-test is skipped, and the next start tests again.
                Err(error) if error.is::<OutOfMemory>() => {
                    paths.force_block_form(None);
                    return paths.end_self_test(device, scene.len(), pair, None);
                }
                other => other?,
            }
        }
        other => other?,
    };
    paths.self_test_time = Some(paths.self_test_time.unwrap_or_default() + begun.elapsed());
    paths.end_self_test(device, scene.len(), pair, disagreement)?;
    if disagreement.is_none() {
        device.remember_passed(*test.as_bytes());
    }
    Ok(())
}

/// The largest difference between the pictures of a pair of paths, if it is more than rounding explains.
fn disagreement(paths: &mut PathChoice, device: &Device, scene: &GpuScene, pair: PathPair) -> Result<Option<f32>> {
    let scene = scene.first(SELF_TEST_GAUSSIANS);
    let camera = camera(pair, &scene)?;
    let shot = Shot::new(&scene, &camera);
    let [tested, other] = pair.paths();
    let expected = draw(paths, device, shot, other)?;
    let mut largest: f32 = 0.0;
    let forms: Vec<usize> = paths.fast().map_or_else(Vec::new, |fast| fast.forms().collect());
    for form in forms.into_iter().take(if is_due(device) { BLOCK_FORMS.len() } else { 1 }) {
        paths.force_block_form(Some(form));
        let drawn = draw(paths, device, shot, tested)?;
        largest = largest.max(difference(&drawn, &expected));
    }
    paths.force_block_form(None);
    Ok((largest > TOLERANCE).then_some(largest))
}

/// The picture of the self-test on a path.
fn draw(paths: &mut PathChoice, device: &Device, shot: Shot, path: Path) -> Result<Pixels> {
    let image = Image::new(device, "self-test", SELF_TEST_SIZE[0], SELF_TEST_SIZE[1])?;
    let needs_tile_lists = matches!(path, Path::Portable | Path::Rays);
    for _ in 0..MAX_ATTEMPTS {
        let limits = paths.prepare(device, shot, needs_tile_lists, None)?;
        if limits.in_slabs {
            let reason = "there is too little device memory".to_owned();
            return Err(OutOfMemory { name: "self-test of the fast path".to_owned(), bytes: None, reason }.into());
        }
        let mut cmd = Commands::new(device)?;
        let target = Target { image: &image, certificate: None, background: Background::BLACK };
        paths.record(device, &mut cmd, shot, target, limits, None)?;
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let totals = cmd.read(paths.totals(limits.path))?;
        let results = cmd.submit()?.wait()?;
        if paths.judge(device, &results.view(&totals)[0], limits)? {
            ensure!(limits.path == path, "the self-test of the fast path ran out of memory");
            return read_pixels(device, &image);
        }
    }
    bail!("the self-test of the fast path did not fit its buffers in {MAX_ATTEMPTS} attempts")
}

/// The largest difference of a channel, relative to the expected value or to 1 if that is larger: 0 where neither value
/// is finite, infinite where only one is.
fn difference(drawn: &Pixels, expected: &Pixels) -> f32 {
    let channels = drawn.rgba.iter().flatten().zip(expected.rgba.iter().flatten());
    let difference = |(a, b): (&f32, &f32)| match (a.is_finite(), b.is_finite()) {
        (true, true) => (a - b).abs() / b.abs().max(1.0),
        (a, b) => {
            if a == b {
                0.0
            } else {
                f32::INFINITY
            }
        }
    };
    channels.map(difference).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{CachedPipelines, DeviceChoice, Validation};
    use crate::procedural::cactus;
    use crate::render::fast::FastPipeline;

    #[test]
    fn a_fast_path_that_draws_another_picture_is_dropped() {
        let device =
            Device::open(&DeviceChoice::Best, Validation::IfInstalled).expect("GPU tests need a Vulkan device");
        let device = device.with_pipeline_cache(CachedPipelines::default(), |_| {});
        let (options, gaussians) = (Options::EXACT, cactus::cactus(3000).unwrap().gaussians);
        let scene = GpuScene::new(&device, &gaussians, &options).unwrap();
        let mut paths = PathChoice::new(&device, &options, &scene, Variation::Plain).unwrap();
        for pair in [PathPair::Projected, PathPair::Rays] {
            paths.self_test_time = None;
            test(&mut paths, &device, &scene, pair).unwrap();
            assert_eq!(paths.notice, None);
            assert!(paths.self_test_time.take().is_some(), "{pair:?}");
            test(&mut paths, &device, &scene, pair).unwrap();
            assert!(paths.self_test_time.is_none(), "the device remembers the first self-test: {pair:?}");
        }

        let mut wrong = options;
        wrong.rules.alpha_max = 0.5;
        for pair in [PathPair::Projected, PathPair::Rays] {
            for number in ["first", "second"] {
                let mut paths = PathChoice::new(&device, &options, &scene, Variation::Plain).unwrap();
                paths.replace_fast(FastPipeline::new(&device, &wrong, scene.layout()).unwrap().unwrap());
                test(&mut paths, &device, &scene, pair).unwrap();
                assert!(
                    paths.notice.is_some_and(|notice| notice.contains("is not taken")),
                    "{number} self-test, {pair:?}"
                );
            }
        }
    }
}
