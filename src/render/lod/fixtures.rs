//! Page files with levels of detail, devices and scenes for tests.

use std::cell::OnceCell;
use std::sync::{Arc, Condvar, LazyLock, Mutex};

use anyhow::Result;

use crate::formats::{Leaf, SourceLevels};
use crate::gpu::{Device, DeviceChoice, Validation};
use crate::options::Options;
use crate::pagefile::PageFile;
use crate::pagefile::write::{Finished, Job, Settings, write_source_levels, write_whole};
use crate::pixels::Pixels;
use crate::procedural::cactus;
use crate::render::scene::{GpuScene, SceneSource, Upload};
use crate::scene::{Gaussians, Random, Scene, SceneInstances, Transform, along_curve, sh_coefficients};

/// Writes a scene to a page file with levels of detail.
pub(crate) fn with_levels(scene: Scene, options: Options) -> Arc<PageFile> {
    written(options, |job| write_whole(job, &scene))
}

/// Writes a scene to a page file with levels as those of a streamed SOG: a third and a ninth of the Gaussians of each
/// leaf of `most` Gaussians, but the first leaf has its finest level alone, as an environment has.
pub(crate) fn with_source_levels(scene: Scene, most: usize, options: Options) -> Arc<PageFile> {
    let gaussians = scene.gaussians.selected(&along_curve(scene.gaussians.means())).unwrap();
    let (mut leaves, mut of_coarser) = (Vec::new(), Vec::new());
    for begin in (0..gaussians.len()).step_by(most) {
        let finest = begin..gaussians.len().min(begin + most);
        let steps: &[usize] = if begin == 0 { &[] } else { &[3, 9] };
        let level = |step: &usize| {
            let first = of_coarser.len();
            of_coarser.extend(finest.clone().step_by(*step).map(|index| index as u32));
            first..of_coarser.len()
        };
        let coarser = steps.iter().map(level).collect();
        leaves.push(Leaf { finest, coarser });
    }
    let coarser = gaussians.selected(&of_coarser).unwrap();
    let levels = SourceLevels { scene: Scene { gaussians, ..scene }, coarser, leaves };
    written(options, |job| write_source_levels(job, &levels))
}

fn written(options: Options, write: impl FnOnce(&Job) -> Result<Finished>) -> Arc<PageFile> {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("levels.smalto");
    let settings = Settings { options, has_levels: true, ..Settings::default() };
    let job = Job::new(&output, settings, "test");
    write(&job).unwrap();
    // The open file outlives the folder.
    Arc::new(PageFile::open(&output).unwrap())
}

/// A cactus with coefficients of degree 4.
pub(crate) fn cactus_of_degree_4(count: usize) -> Scene {
    let scene = cactus::cactus(count).unwrap();
    let mut random = Random::of(4);
    let mut sh = Vec::new();
    for i in 0..scene.gaussians.len() {
        sh.extend_from_slice(scene.gaussians.sh(i));
        sh.resize_with((i + 1) * sh_coefficients(4), || [(); 3].map(|()| 0.1 * random.normal() as f32));
    }
    Scene { gaussians: Gaussians { sh, sh_degree: 4, ..scene.gaussians }, ..scene }
}

/// The right of a test to use devices. One test has it at a time, until its thread ends: in a run of two tests at once
/// on the shared software device, the program once ended by a signal.
struct Turn;

static IS_TAKEN: (Mutex<bool>, Condvar) = (Mutex::new(false), Condvar::new());

impl Turn {
    fn take() -> Self {
        let is_taken = IS_TAKEN.0.lock().expect("no holder of the lock panics");
        *IS_TAKEN.1.wait_while(is_taken, |is_taken| *is_taken).expect("no holder of the lock panics") = true;
        Self
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        *IS_TAKEN.0.lock().expect("no holder of the lock panics") = false;
        IS_TAKEN.1.notify_one();
    }
}

thread_local! {
    static TURN: OnceCell<Turn> = const { OnceCell::new() };
}

/// A device with this limit of its memory. Tests without a limit share one device. Every device keeps its pipelines: a
/// software device takes far longer to compile them than to draw a small picture.
pub(crate) fn open(limit: Option<u64>) -> Device {
    TURN.with(|turn| _ = turn.get_or_init(Turn::take));
    static UNLIMITED: LazyLock<Device> = LazyLock::new(|| {
        let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled);
        let device = device.expect("GPU tests need a Vulkan device");
        device.keep_pipelines();
        device
    });
    let Some(limit) = limit else { return UNLIMITED.clone() };
    let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap().with_small_limit(limit).unwrap();
    device.keep_pipelines();
    device
}

/// Opens a page file on a device, with these instances.
pub(crate) fn opened_scene(device: &Device, file: &Arc<PageFile>, places: &[Transform], options: &Options) -> GpuScene {
    let instances = (!places.is_empty()).then(|| SceneInstances::new(places.to_vec()).unwrap());
    let source = SceneSource { instances, ..SceneSource::of_file(file.clone()) };
    source.upload_with(device, options, Upload::reserving(1 << 20)).unwrap()
}

/// The number of pixels that differ in a bit.
pub(crate) fn differing(a: &Pixels, b: &Pixels) -> usize {
    a.rgba.iter().zip(&b.rgba).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count()
}

/// The PSNR of the colours of a picture, dB.
pub(crate) fn psnr(a: &Pixels, b: &Pixels) -> f64 {
    let colours = |pixels: &Pixels| -> Vec<f32> { pixels.rgba.iter().flat_map(|p| [p[0], p[1], p[2]]).collect() };
    let (a, b) = (colours(a), colours(b));
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (squares / a.len() as f64).log10()
}
