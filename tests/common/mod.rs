//! What the tests share: a device whose validation messages fail the test, scenes, and the comparison with the
//! reference.
#![allow(dead_code, reason = "each test file uses its own part")]

pub mod agree;
pub mod cloud;
#[cfg(target_os = "linux")]
pub mod desktop;
pub mod free;
pub mod lens;
pub mod listed;
pub mod program;
pub mod random;
pub mod table;
#[cfg(target_os = "linux")]
pub mod window;

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, LazyLock, Mutex};

use smalto::camera::{self, Camera};
use smalto::formats;
use smalto::gpu::{Buffer, Commands, Device, DeviceChoice, Element, Validation};
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::reference::{self, Rendering};
use smalto::render::{Frame, GpuScene, Renderer};
use smalto::rules::Background;
use smalto::scene::{Builder, Gaussians, Raw};

pub use random::Random;

/// A device with validation on. A missing device fails the test; so does every message of the validation layer and of
/// the missing-barrier check since the last test ended: with two tests at once, it may be a message of the other.
pub struct Gpu(pub Device, Sharing, Turn);

enum Sharing {
    Shared,
    Own,
}

impl Gpu {
    /// The device that the tests of a program share. It keeps its pipelines, which take a software device far longer to
    /// compile than a small picture takes to draw.
    pub fn new() -> Self {
        static SHARED: LazyLock<Device> = LazyLock::new(|| {
            let validation = match std::env::var("SMALTO_VALIDATION").as_deref() {
                Ok("0") => Validation::Off,
                _ => Validation::Required,
            };
            let device = open(validation);
            device.keep_pipelines();
            device
        });
        let turn = Turn::take();
        Self(SHARED.clone(), Sharing::Shared, turn)
    }

    /// A device that no other test uses.
    pub fn own() -> Self {
        let turn = Turn::take();
        Self(open(Validation::Required), Sharing::Own, turn)
    }

    pub fn render(&self, gaussians: &Gaussians, camera: &Camera, options: &Options) -> Pixels {
        let scene = GpuScene::new(&self.0, gaussians, options).expect("the scene fits");
        let mut still = Renderer::new(&self.0, options, &scene).expect("the renderer can be built");
        still.render(camera, Background::BLACK).expect("the frame can be rendered");
        still.pixels().expect("the picture can be read")
    }
}

/// A frame with a copy of every buffer that its stages wrote.
pub struct Captured {
    pub frame: Frame,
    pub pixels: Pixels,
    buffers: Vec<(String, Vec<u8>)>,
}

impl Captured {
    /// The content of a buffer at the end of the last scope that wrote it.
    pub fn buffer<T: bytemuck::Pod>(&self, name: &str) -> Vec<T> {
        let found = self.buffers.iter().rfind(|(n, _)| n == name);
        bytemuck::pod_collect_to_vec(&found.unwrap_or_else(|| panic!("no stage wrote {name}")).1)
    }
}

impl Gpu {
    /// Renders, and copies every buffer after every stage.
    pub fn capture(&self, gaussians: &Gaussians, camera: &Camera, options: &Options) -> Captured {
        let scene = GpuScene::new(&self.0, gaussians, options).expect("the scene fits");
        let mut still = Renderer::new(&self.0, options, &scene).expect("the renderer can be built");
        let prepare = |cmd: &mut Commands| cmd.capture_scopes();
        let (frame, results) =
            still.render_with(camera, Background::BLACK, prepare).expect("the frame can be rendered");
        let named = |c: &smalto::gpu::Capture| (c.buffer().to_owned(), c.bytes().to_vec());
        let buffers = results.captures().iter().map(named).collect();
        Captured { frame, pixels: still.pixels().expect("the picture can be read"), buffers }
    }

    /// A buffer with this content.
    pub fn upload<T: Element>(&self, name: &str, content: &[T]) -> Buffer<T> {
        let buffer = Buffer::new(&self.0, name, content.len()).expect("the buffer fits");
        let mut cmd = Commands::new(&self.0).expect("commands can be recorded");
        cmd.upload(&buffer, 0, content.len(), |memory| memory.copy_from_slice(content)).expect("the upload fits");
        cmd.submit().and_then(|c| c.wait()).expect("the upload succeeds");
        buffer
    }

    pub fn download<T: Element>(&self, buffer: &Buffer<T>) -> Vec<T> {
        let mut cmd = Commands::new(&self.0).expect("commands can be recorded");
        let readback = cmd.read(buffer).expect("the copy fits");
        let results = cmd.submit().and_then(|c| c.wait()).expect("the copy succeeds");
        results.view(&readback).to_vec()
    }

    /// Runs the recorded commands and waits for their end.
    pub fn run(&self, record: impl FnOnce(&mut Commands)) {
        let mut cmd = Commands::new(&self.0).expect("commands can be recorded");
        record(&mut cmd);
        cmd.submit().and_then(|c| c.wait()).expect("the commands succeed");
    }
}

/// Canonical Gaussians from raw ones with one constant colour each.
pub fn gaussians(raws: &[(Raw, [f32; 3])]) -> Gaussians {
    let mut builder = Builder::new(0, raws.len()).unwrap();
    builder.extend(raws.len(), |i, sh| {
        sh[0] = raws[i].1.map(|c| (c - 0.5) / 0.282_094_8);
        raws[i].0
    });
    builder.finish().0
}

impl Drop for Gpu {
    fn drop(&mut self) {
        static REPORTED: AtomicUsize = AtomicUsize::new(0);
        let messages = self.0.validation_messages();
        let reported = match self.1 {
            Sharing::Shared => REPORTED.swap(messages.len(), Ordering::Relaxed),
            Sharing::Own => 0,
        };
        if !std::thread::panicking() {
            let new = &messages[reported.min(messages.len())..];
            assert!(new.is_empty(), "messages of the validation: {new:?}");
        }
    }
}

/// A device of a test's own, as `SMALTO_DEVICE` and `SMALTO_SHADERS` say.
pub fn open(validation: Validation) -> Device {
    let variable = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
    let choice = variable("SMALTO_DEVICE").map_or(DeviceChoice::Best, |name| name.as_str().into());
    let device = Device::open(&choice, validation).expect("GPU tests need a Vulkan device");
    device.with_shaders(variable("SMALTO_SHADERS").as_deref().map(Path::new)).expect("the shaders can be watched")
}

/// Tests that use devices at once: drivers refuse to open many, and a software device uses every core to draw, but one
/// to compile.
const AT_ONCE: usize = 2;

/// A test's turn to use devices.
pub struct Turn;

/// Turns that are taken.
static TAKEN: (Mutex<usize>, Condvar) = (Mutex::new(0), Condvar::new());

thread_local! {
    /// Devices of this test: they share a turn.
    static DEVICES: Cell<usize> = const { Cell::new(0) };
}

impl Turn {
    pub fn take() -> Self {
        if DEVICES.replace(DEVICES.get() + 1) == 0 {
            let taken = TAKEN.0.lock().unwrap();
            *TAKEN.1.wait_while(taken, |taken| *taken == AT_ONCE).unwrap() += 1;
        }
        Self
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        if DEVICES.replace(DEVICES.get() - 1) == 1 {
            *TAKEN.0.lock().unwrap() -= 1;
            TAKEN.1.notify_one();
        }
    }
}

/// A file in the folder of captured scenes: `SMALTO_TEST_SCENES`, or else `../shared/scenes`. Tests that call this are
/// ignored by default and have `captured` in their names, by which `.ci/run` selects them.
pub fn captured(name: &str) -> PathBuf {
    let folder =
        std::env::var_os("SMALTO_TEST_SCENES").map_or_else(|| PathBuf::from("../shared/scenes"), PathBuf::from);
    let path = folder.join(name);
    assert!(path.exists(), "{} does not exist: set SMALTO_TEST_SCENES to the captured scenes", path.display());
    path
}

pub fn read_captured(name: &str) -> Gaussians {
    formats::read(captured(name)).expect("a captured scene can be read").gaussians
}

pub fn captured_cameras(name: &str, which: &[usize], size: [u32; 2]) -> Vec<Camera> {
    let cameras = camera::read(&captured(name)).expect("a captured scene's cameras can be read").cameras;
    which.iter().map(|i| cameras[*i].camera.resized(size)).collect()
}

/// The difference of a GPU picture from the reference.
#[derive(Debug)]
pub struct Comparison {
    pub psnr: f64,
    pub max_error: f32,
    /// Pixels that differ by more than [`ROUNDING`].
    pub different: usize,
    /// Pixels that differ by more than [`ROUNDING`] and the doubt of the reference.
    pub unexplained: usize,
}

/// Largest difference that f32 arithmetic alone may make to a pixel whose decisions are not in doubt.
pub const ROUNDING: f64 = 1e-4;

/// The largest difference of a colour channel; infinite if a value is not finite.
pub fn difference((pixel, exact): (&[f32; 4], &reference::Pixel)) -> f64 {
    let channel = |i: usize| (f64::from(pixel[i]) - exact.colour[i]).abs();
    if pixel.iter().all(|v| v.is_finite()) { channel(0).max(channel(1)).max(channel(2)) } else { f64::INFINITY }
}

pub fn compare(pixels: &Pixels, reference: &Rendering) -> Comparison {
    let exact = reference.to_pixels();
    let pairs = || pixels.rgba.iter().zip(&reference.pixels);
    Comparison {
        psnr: smalto::measure::metrics::psnr(pixels, &exact),
        max_error: smalto::measure::metrics::max_error(pixels, &exact),
        different: pairs().filter(|p| difference(*p) > ROUNDING).count(),
        unexplained: pairs().filter(|p| difference(*p) > ROUNDING + p.1.doubt).count(),
    }
}

/// Runs tests of this program again on llvmpipe with vectors of 128 bits, which makes its subgroups four wide: what
/// processors without wider vectors have. Other devices take no notice. `arguments` are those of the test program:
/// parts of the paths of tests, and what to skip.
pub fn again_in_subgroups_of_four(arguments: &[&str]) {
    let mut again = Command::new(std::env::current_exe().unwrap());
    let output = again.args(arguments).env("LP_NATIVE_VECTOR_WIDTH", "128").output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}");
    assert!(!text.contains("test result: ok. 0 passed"), "no test has such a name: {arguments:?}");
}
