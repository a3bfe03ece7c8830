//! The trial of the fast path at the start: its picture of a part of the scene is compared with the portable path's.

use std::time::Instant;

use anyhow::{Result, bail, ensure};

use super::fast::BLOCK_HEIGHTS;
use super::frame::{Shot, Target, Variation};
use super::path::Path;
use super::path_choice::PathChoice;
use super::readback::read_pixels;
use super::scene::{GpuScene, TRIAL, TRIAL_SIZE};
use crate::gpu::{Access, Commands, Device, DeviceKind, Image};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::rules::Background;

/// More attempts than any frame needs. Buffers grow to the demand of the attempt before. An overflow hides the demand
/// of the next stage (visible, spans and listed, list length), so a frame may need one retry per stage, and one more
/// for the change of path.
pub(crate) const MAX_ATTEMPTS: u32 = 10;

/// The largest difference between the paths that rounding explains, relative to a channel's value or to 1 if that is
/// larger. Rounding sometimes moves an alpha across a threshold, which is a step of 1/255; errors are larger.
const TOLERANCE: f32 = 0.03;

/// True if the fast path is tried on this device, because shader compilers of GPU drivers make mistakes. On a software
/// device, which the tests run on, the pipelines of the trial would take longer to compile than a frame to draw.
fn is_due(device: &Device) -> bool {
    device.capabilities().kind != DeviceKind::Cpu
}

/// The paths of a renderer, of which the fast one has passed its trial.
pub(crate) fn choose(device: &Device, options: &Options, scene: &GpuScene, variation: Variation) -> Result<PathChoice> {
    let mut choice = PathChoice::new(device, options, scene, variation)?;
    try_fast(&mut choice, device, scene)?;
    Ok(choice)
}

/// Tries the fast path on a device where that is due, and drops it if it does not draw what the portable path does. A
/// device with a memory is not tried again with the same pipelines and Gaussians, unless they failed.
fn try_fast(choice: &mut PathChoice, device: &Device, scene: &GpuScene) -> Result<()> {
    if is_due(device) { choice.try_fast(device, scene) } else { Ok(()) }
}

impl PathChoice {
    fn try_fast(&mut self, device: &Device, scene: &GpuScene) -> Result<()> {
        let Some(fast) = self.fast() else { return Ok(()) };
        // A scene may need stages that the trial of another did not reach.
        let [pipelines, drawn] = [fast.fingerprint(device)?, scene.trial_hash];
        let trial = blake3::Hasher::new().update(pipelines.as_bytes()).update(drawn.as_bytes()).finalize();
        if device.has_passed(trial.as_bytes()) {
            return Ok(());
        }
        let begun = Instant::now();
        self.make_all_pipelines(device)?;
        let disagreement = match self.disagreement(device, scene) {
            Err(error) if error.is::<OutOfMemory>() => {
                // The first guess may have left no room.
                self.release(device)?;
                match self.disagreement(device, scene) {
                    // Without room for the small pictures of a trial there is none, and the next start tries again.
                    Err(error) if error.is::<OutOfMemory>() => {
                        self.force_block_height(None);
                        return self.end_trial(device, scene.len(), None);
                    }
                    other => other?,
                }
            }
            other => other?,
        };
        self.trial_time = Some(begun.elapsed());
        self.end_trial(device, scene.len(), disagreement)?;
        if disagreement.is_none() {
            device.remember_passed(*trial.as_bytes());
        }
        Ok(())
    }

    /// The largest difference between the pictures of the two paths, if it is more than rounding explains.
    fn disagreement(&mut self, device: &Device, scene: &GpuScene) -> Result<Option<f32>> {
        let scene = scene.first(TRIAL);
        let expected = self.draw_trial(device, &scene, true)?;
        let mut largest: f32 = 0.0;
        let heights = if is_due(device) { BLOCK_HEIGHTS.len() } else { 1 };
        for height in 0..heights {
            self.force_block_height(Some(height));
            let drawn = self.draw_trial(device, &scene, false)?;
            largest = largest.max(difference(&drawn, &expected));
        }
        self.force_block_height(None);
        Ok((largest > TOLERANCE).then_some(largest))
    }

    /// The picture of the trial: by the portable path if `needs_tile_lists`, else by the fast path.
    fn draw_trial(&mut self, device: &Device, scene: &GpuScene, needs_tile_lists: bool) -> Result<Pixels> {
        let image = Image::new(device, "trial", TRIAL_SIZE[0], TRIAL_SIZE[1])?;
        for _ in 0..MAX_ATTEMPTS {
            let limits = self.prepare(device, scene, &scene.trial_view, needs_tile_lists, None)?;
            if limits.in_slabs {
                let reason = "there is too little device memory".to_owned();
                return Err(OutOfMemory { name: "trial of the fast path".to_owned(), bytes: None, reason }.into());
            }
            let mut cmd = Commands::new(device)?;
            let target = Target { image: &image, certificate: None, background: Background::BLACK };
            self.record(&mut cmd, Shot { scene, camera: &scene.trial_view }, target, limits, None)?;
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
            let totals = cmd.read(self.totals(limits.path))?;
            let results = cmd.submit()?.wait()?;
            if self.judge(device, &results.view(&totals)[0], limits)? {
                ensure!(needs_tile_lists || limits.path == Path::Fast, "the trial of the fast path ran out of memory");
                return read_pixels(device, &image);
            }
        }
        bail!("the trial of the fast path did not fit its buffers in {MAX_ATTEMPTS} attempts")
    }
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
    use crate::gpu::{DeviceChoice, Remembered, Validation};
    use crate::procedural::cactus;
    use crate::render::fast::FastPipeline;

    #[test]
    fn a_fast_path_that_draws_another_picture_is_dropped() {
        let device =
            Device::open(&DeviceChoice::Best, Validation::IfInstalled).expect("GPU tests need a Vulkan device");
        let device = device.with_memory(Remembered::default(), |_| {});
        let (options, gaussians) = (Options::EXACT, cactus::cactus(3000).unwrap().gaussians);
        let scene = GpuScene::new(&device, &gaussians, &options).unwrap();
        let mut paths = PathChoice::new(&device, &options, &scene, Variation::Plain).unwrap();
        paths.try_fast(&device, &scene).unwrap();
        assert_eq!(paths.notice, None);
        assert!(paths.trial_time.take().is_some());
        paths.try_fast(&device, &scene).unwrap();
        assert!(paths.trial_time.is_none(), "the device remembers the first trial");

        let mut wrong = options;
        wrong.rules.alpha_max = 0.5;
        for trial in ["first", "second"] {
            let mut paths = PathChoice::new(&device, &options, &scene, Variation::Plain).unwrap();
            paths.replace_fast(FastPipeline::new(&device, &wrong, scene.layout()).unwrap().unwrap());
            paths.try_fast(&device, &scene).unwrap();
            assert!(paths.notice.is_some_and(|notice| notice.contains("is not taken")), "{trial} trial");
        }
    }
}
