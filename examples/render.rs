//! Renders a scene file to a PNG: `cargo run --release --example render -- SCENE PICTURE.png`.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::formats;
use smalto::gpu::{Device, DeviceChoice, Validation};
use smalto::options::Options;
use smalto::render::{GpuScene, Renderer};
use smalto::rules::{Background, Rules};
use smalto::scene::Focus;

fn main() -> Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let input = arguments.next().context("the first argument names a scene")?;
    let output = arguments.next().context("the second argument names a PNG file")?;

    let scene = formats::read(Path::new(&input))?;
    let focus = Focus::of(&scene.gaussians);
    let camera = Camera::framing(DVec3::from(focus.centre), focus.radius, [640, 480]);
    let rules = Rules { antialiased: scene.is_antialiased, ..Rules::TRAINED };
    let options = Options { rules, ..Options::BALANCED };

    let device = Device::open(&DeviceChoice::Best, Validation::Off)?;
    let gpu_scene = GpuScene::new(&device, &scene.gaussians, &options)?;
    let mut renderer = Renderer::new(&device, &options, &gpu_scene)?;
    let frame = renderer.render(&camera, Background::BLACK)?;
    ensure!(frame.totals.visible > 0, "no Gaussian is in view");
    renderer.pixels()?.write(Path::new(&output), false)?;

    println!("{} of {} Gaussians are visible", frame.totals.visible, scene.gaussians.len());
    Ok(())
}
