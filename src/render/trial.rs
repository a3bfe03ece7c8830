//! The fast path's trial at the start: what it draws of a part of the scene is held to the portable path.

use anyhow::Result;
use glam::DVec3;

use crate::render::portable::blend::Target;
use crate::render::fast::pipeline::BLOCK_HEIGHTS;
use crate::render::gpu_scene::GpuScene;
use crate::render::choice::PathChoice;
use crate::render::renderer::{MAX_ATTEMPTS, read_pixels};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, Image};
use crate::rules::Background;
use crate::pixels::Pixels;
use crate::scene::Gaussians;

/// Gaussians of a trial: the scene's first.
const TRIAL: usize = 1 << 14;
const SIZE: [u32; 2] = [256, 144];
/// Between the paths, of a channel or of 1 if that is more. Rounding moves a threshold at times, which shows as a step of
/// 1/255; what is wrong shows as more.
const TOLERANCE: f32 = 0.03;

/// Whether renderers made on this device are tried: what is feared are the compilers of GPU drivers. A software device, which
/// the tests run on, would compile for longer than it draws.
pub(super) fn is_due(device: &Device) -> bool {
    device.facts().kind != "CPU"
}

/// A view of most of the first Gaussians.
pub(super) fn trial_view(gaussians: &Gaussians, near: f32) -> Camera {
    let means: Vec<_> = gaussians.means().iter().take(TRIAL).map(|mean| DVec3::from(mean.map(f64::from))).collect();
    let median = |mut values: Vec<f64>| {
        let middle = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    let centre = DVec3::from([0, 1, 2].map(|axis| median(means.iter().map(|mean| mean[axis]).collect())));
    let radius = median(means.iter().map(|mean| mean.distance(centre)).collect());
    let position = centre - DVec3::new(0.3, -0.2, 1.0) * (2.0 * radius).max(4.0 * f64::from(near));
    Camera::looking_at(position, centre, SIZE, 0.9)
}

impl PathChoice {
    /// The largest difference between the pictures of the two paths, if it is more than rounding explains.
    pub(super) fn disagreement(&mut self, device: &Device, scene: &GpuScene) -> Result<Option<f32>> {
        let scene = scene.first(TRIAL);
        let expected = self.draw_trial(device, &scene, true)?;
        let mut largest: f32 = 0.0;
        let heights = if is_due(device) { BLOCK_HEIGHTS.len() } else { 1 };
        for height in 0..heights {
            self.set_block_height(Some(height));
            let drawn = self.draw_trial(device, &scene, false)?;
            largest = largest.max(difference(&drawn, &expected));
        }
        self.set_block_height(None);
        Ok((largest > TOLERANCE).then_some(largest))
    }

    fn draw_trial(&mut self, device: &Device, scene: &GpuScene, needs_lists: bool) -> Result<Pixels> {
        let image = Image::new(device, "trial", SIZE[0], SIZE[1])?;
        for _ in 0..MAX_ATTEMPTS {
            let limits = self.prepare(device, scene.len(), SIZE, needs_lists)?;
            let mut cmd = Commands::new(device)?;
            let target = Target { image: &image, certificate: None, background: Background::BLACK };
            self.record(&mut cmd, (scene, &scene.trial_view), target, limits, None);
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
            let totals = cmd.read(self.totals(limits))?;
            let results = cmd.submit()?.wait()?;
            if self.judge(device, &results.view(&totals)[0], limits)? {
                break;
            }
        }
        read_pixels(device, &image)
    }
}

/// The largest, as a part of the expected value or of 1; 0 where both are no numbers.
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
    use crate::render::portable::blend::Variation;
    use crate::render::fast::FastPipeline;
    use crate::scene::synthetic;

    #[test]
    fn a_fast_path_that_draws_another_picture_is_dropped() {
        let device =
            Device::open(&DeviceChoice::Best, Validation::IfInstalled).expect("GPU tests need a Vulkan device");
        let (options, gaussians) = (Options::EXACT, synthetic::cactus(3000).unwrap().gaussians);
        let scene = GpuScene::new(&device, &gaussians, &options).unwrap();
        let mut paths = PathChoice::new(&device, &options, &scene, Variation::default()).unwrap();
        assert_eq!(paths.notice, None);

        let mut wrong = options;
        wrong.rules.alpha_max = 0.5;
        let fast = FastPipeline::new(&device, &wrong, scene.layout()).unwrap().expect("the device has a fast path");
        paths.replace_fast(&device, &scene, fast).unwrap();
        assert!(paths.notice.is_some_and(|notice| notice.contains("is not taken")));
    }
}
