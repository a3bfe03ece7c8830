//! How near a scene comes to the photographs of its cameras, camera by camera.

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::comparison::over;
use crate::camera::{Camera, NamedCamera};
use crate::gpu::Device;
use crate::measure::metrics::{psnr, ssim};
use crate::pixels::Pixels;
use crate::rules::Background;
use crate::viewer::frame::{Plan, Reusable};

/// The picture of a camera against its photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Index of the camera.
    pub camera: usize,
    pub name: String,
    /// In dB; `None` if they are equal.
    pub psnr_db: Option<f64>,
    /// `None` if the photograph is smaller than a window of SSIM.
    pub ssim: Option<f64>,
}

/// What was measured, of which picture.
pub struct Evaluation {
    pub rows: Vec<Row>,
    pub plan: Plan,
    pub background: Background,
}

/// Largest part by which the shape of a photograph differs from that of its camera's picture if it is that picture at
/// another resolution: sides are rounded to whole pixels.
const SHAPE: f64 = 0.01;

/// The camera that takes a photograph of this size: of other pixels or, if it has another shape, cut at its upper and
/// lower side as the window shows it.
fn taking(camera: &Camera, size: [u32; 2]) -> Camera {
    let shape = |[width, height]: [u32; 2]| f64::from(width) / f64::from(height);
    match (shape(size) / shape(camera.size_px) - 1.0).abs() <= SHAPE {
        true => camera.sampled(size),
        false => camera.resized(size),
    }
}

/// A camera, its index, and its photograph.
pub type Pose = (usize, NamedCamera, PathBuf);

impl Evaluation {
    /// Draws every camera in the size of its photograph, and compares the two. `progress` gets the fraction that is
    /// done, and its error ends the work.
    pub fn new(
        device: &Device,
        (plan, reusable): (Plan, Option<Reusable>),
        poses: &[Pose],
        background: Background,
        progress: &dyn Fn(f64) -> Result<()>,
    ) -> Result<Self> {
        let (_, first, _) = poses.first().context("no camera has a photograph")?;
        let mut drawn = plan.clone().build(device, reusable, &first.camera, background, None)?;
        let mut rows = Vec::with_capacity(poses.len());
        for (done, (index, NamedCamera { name, camera }, file)) in poses.iter().enumerate() {
            progress(done as f64 / poses.len() as f64)?;
            let photograph = Pixels::read(file).with_context(|| file.display().to_string())?;
            let photograph = over(&photograph, background);
            drawn.renderer.render(&taking(camera, photograph.size), background)?;
            let mut picture = drawn.renderer.pixels()?;
            // A photograph has no colours over white, and nothing shows them.
            picture.rgba.iter_mut().for_each(|pixel| *pixel = pixel.map(|value| value.clamp(0.0, 1.0)));
            let db = psnr(&picture, &photograph);
            let ssim = ssim(&picture, &photograph);
            rows.push(Row { camera: *index, name: name.clone(), psnr_db: db.is_finite().then_some(db), ssim });
        }
        Ok(Self { rows, plan, background })
    }

    /// The means over all cameras; of PSNR, over those whose pictures are not equal.
    pub fn means(&self) -> [Option<f64>; 2] {
        let mean = |values: Vec<f64>| {
            let count = values.len();
            (count > 0).then(|| values.iter().sum::<f64>() / count as f64)
        };
        let all = [|row: &Row| row.psnr_db, |row: &Row| row.ssim];
        all.map(|value| mean(self.rows.iter().filter_map(value).collect()))
    }

    /// A table: camera, PSNR in dB, SSIM.
    pub fn to_csv(&self) -> String {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let line = |row: &Row| {
            let name = row.name.replace('"', "\"\"");
            format!("\"{name}\",{},{}\n", number(row.psnr_db), number(row.ssim))
        };
        format!("camera,psnr_db,ssim\n{}", self.rows.iter().map(line).collect::<String>())
    }
}
