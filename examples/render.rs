//! Renders a scene file of any format to a PNG: `cargo run --release --example render -- SCENE PICTURE.png`.

use std::path::Path;

use anyhow::{Context, Result};
use smalto::camera::Camera;
use smalto::gpu::{Device, DeviceChoice, Validation};
use smalto::options::Options;
use smalto::pixels::Alpha;
use smalto::render::{Frame, Renderer, SceneSource};
use smalto::rules::Background;

fn main() -> Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let scene = arguments.next().context("the first argument names a scene")?;
    let picture = arguments.next().context("the second argument names a PNG file")?;
    let frame = render(Path::new(&scene), Path::new(&picture), &DeviceChoice::Best)?;
    println!("{} Gaussians are visible", frame.totals.visible);
    Ok(())
}

/// Draws a scene file within 1 GiB of device memory, and at most about 100,000 splats if it has levels of detail.
pub fn render(scene: &Path, picture: &Path, device: &DeviceChoice) -> Result<Frame> {
    let source = SceneSource::open(scene)?;
    let options = source.suited(&Options { splats: 100_000, ..Options::BALANCED });
    let focus = source.focus();
    let camera = Camera::framing(focus.centre.into(), focus.radius, [640, 480]);

    let device = Device::open(device, Validation::Off)?.with_memory_limit(Some(1 << 30))?;
    let on_device = source.upload(&device, &options)?;
    let mut renderer = Renderer::new(&device, &options, &on_device)?;
    let frame = renderer.render(&camera, Background::BLACK)?;
    renderer.pixels()?.write(picture, Alpha::Opaque)?;
    Ok(frame)
}
