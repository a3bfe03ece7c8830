//! The trial of the fast path at the start: its picture of a part of the scene is compared with the portable path's.

use anyhow::{Result, bail, ensure};

use super::choice::{Path, PathChoice};
use super::fast::BLOCK_HEIGHTS;
use super::frame::{Shot, Target};
use super::gpu_scene::{GpuScene, TRIAL, TRIAL_SIZE};
use super::readback::read_pixels;
use crate::gpu::{Access, Commands, Device, DeviceKind, Image};
use crate::pixels::Pixels;
use crate::rules::Background;

/// More attempts than any frame needs. Buffers grow to the demand of the attempt before, and an overflow hides the demand of
/// the next stage (visible, spans and listed, list length), on either path.
pub(super) const MAX_ATTEMPTS: u32 = 10;

/// The largest difference between the paths, as a part of a channel's value or of 1 if that is more. Rounding at times
/// moves a threshold, which is a step of 1/255; errors are larger.
const TOLERANCE: f32 = 0.03;

/// True if renderers made on this device are tried: shader compilers of GPU drivers make mistakes. On a software device,
/// which the tests run on, the trial's pipelines would take longer to compile than a frame to draw.
pub(super) fn is_due(device: &Device) -> bool {
    device.capabilities().kind != DeviceKind::Cpu
}

impl PathChoice {
    /// The largest difference between the pictures of the two paths, if it is more than rounding explains.
    pub(super) fn disagreement(&mut self, device: &Device, scene: &GpuScene) -> Result<Option<f32>> {
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

    fn draw_trial(&mut self, device: &Device, scene: &GpuScene, needs_tile_lists: bool) -> Result<Pixels> {
        let image = Image::new(device, "trial", TRIAL_SIZE[0], TRIAL_SIZE[1])?;
        for _ in 0..MAX_ATTEMPTS {
            let limits = self.prepare(device, scene.len(), TRIAL_SIZE, needs_tile_lists)?;
            let mut cmd = Commands::new(device)?;
            let target = Target { image: &image, certificate: None, background: Background::BLACK };
            self.record(&mut cmd, Shot { scene, camera: &scene.trial_view }, target, limits, None);
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

/// The largest difference of a channel, as a part of the expected value or of 1 if that is more; 0 where both are not
/// finite.
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
    use crate::gpu::{DeviceChoice, Validation};
    use crate::options::Options;
    use crate::render::FastPipeline;
    use crate::render::Variation;
    use crate::scene::synthetic;

    #[test]
    fn a_fast_path_that_draws_another_picture_is_dropped() {
        let device =
            Device::open(&DeviceChoice::Best, Validation::IfInstalled).expect("GPU tests need a Vulkan device");
        let (options, gaussians) = (Options::EXACT, synthetic::cactus(3000).unwrap().gaussians);
        let scene = GpuScene::new(&device, &gaussians, &options).unwrap();
        let mut paths = PathChoice::new(&device, &options, &scene, Variation::Plain).unwrap();
        assert_eq!(paths.notice, None);

        let mut wrong = options;
        wrong.rules.alpha_max = 0.5;
        let fast = FastPipeline::new(&device, &wrong, scene.layout()).unwrap().expect("the device has a fast path");
        paths.replace_fast(&device, &scene, fast).unwrap();
        assert!(paths.notice.is_some_and(|notice| notice.contains("is not taken")));
    }
}
