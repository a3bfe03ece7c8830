//! Evaluation of a scene: PSNR and SSIM of every camera's picture against its photograph, where the camera sees
//! something.

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::comparison::over;
use super::plan::{Plan, Reusable};
use crate::camera::{Camera, NamedCamera};
use crate::gpu::Device;
use crate::measure::metrics::Scored;
use crate::pixels::Pixels;
use crate::rules::Background;

/// The difference of a camera's picture from its photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationRow {
    /// Index of the camera.
    pub camera: usize,
    pub name: String,
    /// In dB; `None` if the two are equal.
    pub psnr_db: Option<f64>,
    /// `None` if the photograph is smaller than a window of SSIM.
    pub ssim: Option<f64>,
}

/// The measured cameras, and the plan and background of their pictures.
pub struct Evaluation {
    pub rows: Vec<EvaluationRow>,
    pub plan: Plan,
    pub background: Background,
}

/// Largest relative difference in aspect ratio between a photograph and its camera that counts as rounding of the sides
/// to whole pixels.
const SHAPE: f64 = 0.01;

/// The camera for a photograph of this size: sampled at another resolution or, if the aspect ratio differs, cropped at
/// top and bottom as in the window.
fn taking(camera: &Camera, size: [u32; 2]) -> Camera {
    let shape = |[width, height]: [u32; 2]| f64::from(width) / f64::from(height);
    match (shape(size) / shape(camera.size_px) - 1.0).abs() <= SHAPE {
        true => camera.sampled(size),
        false => camera.resized(size),
    }
}

/// A camera, its index, and its photograph.
pub type PosedPhotograph = (usize, NamedCamera, PathBuf);

impl Evaluation {
    /// Draws every camera at the size of its photograph, and compares the two. `progress` receives the fraction done;
    /// its error ends the work.
    pub fn new(
        device: &Device,
        (plan, reusable): (Plan, Option<Reusable>),
        poses: &[PosedPhotograph],
        background: Background,
        progress: &dyn Fn(f64) -> Result<()>,
    ) -> Result<Self> {
        let (_, first, _) = poses.first().context("no camera has a photograph")?;
        let mut drawn = plan.clone().build(device, reusable, &first.camera, background, None)?;
        let mut rows = Vec::with_capacity(poses.len());
        for (done, (index, NamedCamera { name, camera, .. }, file)) in poses.iter().enumerate() {
            progress(done as f64 / poses.len() as f64)?;
            let photograph = Pixels::read(file).with_context(|| file.display().to_string())?;
            let photograph = over(&photograph, background);
            let camera = taking(camera, photograph.size);
            drawn.renderer.render(&camera, background)?;
            let mut picture = drawn.renderer.pixels()?;
            // A photograph has no colours beyond 0 and 1.
            picture.rgba.iter_mut().for_each(|pixel| *pixel = pixel.map(|value| value.clamp(0.0, 1.0)));
            let scored = Scored::new(&picture, &photograph, camera.seen());
            let (db, ssim) = (scored.psnr(), scored.ssim());
            rows.push(EvaluationRow {
                camera: *index,
                name: name.clone(),
                psnr_db: db.is_finite().then_some(db),
                ssim,
            });
        }
        Ok(Self { rows, plan, background })
    }

    /// Means of PSNR and SSIM over the cameras that have a value.
    pub fn means(&self) -> [Option<f64>; 2] {
        let mean = |values: Vec<f64>| {
            let count = values.len();
            (count > 0).then(|| values.iter().sum::<f64>() / count as f64)
        };
        let all = [|row: &EvaluationRow| row.psnr_db, |row: &EvaluationRow| row.ssim];
        all.map(|value| mean(self.rows.iter().filter_map(value).collect()))
    }

    /// A table: camera, PSNR in dB, SSIM.
    pub fn to_csv(&self) -> String {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let line = |row: &EvaluationRow| {
            let name = row.name.replace('"', "\"\"");
            format!("\"{name}\",{},{}\n", number(row.psnr_db), number(row.ssim))
        };
        format!("camera,psnr_db,ssim\n{}", self.rows.iter().map(line).collect::<String>())
    }
}
