//! The scenes that commands take.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use glam::{DMat3, DQuat, DVec3};

use super::{Usage, progress, remark};
use crate::camera::Up;
use crate::scene::{self, Procedural, Reading, Scene, Transform};

/// What the commands draw, describe or measure.
#[derive(Args)]
pub(super) struct SceneArg {
    /// Scene file (.ply, .compressed.ply, .spz, .sog, .splat, .ksplat, .glb or .gltf), folder of a SOG or model folder of the
    /// original 3DGS, or a procedural scene: cactus, few-large or many-small, with :COUNT for another number of Gaussians
    #[arg(default_value = "cactus")]
    pub scene: PathBuf,
    #[command(flatten)]
    pub reading: ReadingArgs,
}

impl SceneArg {
    /// The procedural scene, if it is one.
    pub fn procedural(&self) -> Option<Result<Procedural>> {
        Procedural::parse(self.scene.to_str()?)
    }

    /// The scene's file, if it is one. In a model folder, the point cloud of the last iteration.
    pub fn path(&self) -> Option<PathBuf> {
        if self.procedural().is_some() {
            return None;
        }
        Some(scene::in_folder(&self.scene))
    }

    /// What reports call the scene: its file name, not where it lies.
    pub fn title(&self) -> String {
        self.scene.file_name().unwrap_or(self.scene.as_os_str()).to_string_lossy().into_owned()
    }

    /// What files made from the scene are named after.
    pub fn stem(&self) -> String {
        if let Some(Ok(procedural)) = self.procedural() {
            return procedural.name().to_owned();
        }
        let path = self.path().unwrap_or_else(|| self.scene.clone());
        let name = path.file_name().map_or_else(|| "scene".into(), |n| n.to_string_lossy().into_owned());
        name.split('.').find(|part| !part.is_empty()).unwrap_or("scene").to_owned()
    }

    /// Reads the file or makes the procedural scene, and says on stderr what had to be dropped.
    pub fn read(&self) -> Result<Scene> {
        let path = self.path().unwrap_or_else(|| self.scene.clone());
        let (name, reading) = (path.display(), self.reading.reading()?);
        let scene = match self.procedural() {
            Some(procedural) => {
                let procedural = procedural.map_err(|e| Usage(format!("{name}: {e:#}")))?;
                reading.make(procedural)?
            }
            None => {
                let bar = progress::Bar::new("reading");
                reading.read(&path, &|fraction| bar.set(fraction))?
            }
        };
        for notice in &scene.notices {
            remark(&format!("note: {name}: {notice}"));
        }
        let tally = &scene.tally;
        if tally.dropped() + tally.clamped_scale > 0 {
            let level = if tally.is_clean() { "note" } else { "warning" };
            remark(&format!("{level}: {name}: of {} Gaussians {tally}", tally.read));
        }
        Ok(scene)
    }
}

const HEADING: &str = "Scene";

/// What scene files do not say, or say wrongly.
#[derive(Args, Clone, Copy, Default)]
pub(super) struct ReadingArgs {
    /// The scene's axis that points up: x, y, z, -x, -y or -z. It is turned, cameras are not [default: -y]
    #[arg(long, help_heading = HEADING, value_name = "AXIS", allow_hyphen_values = true, value_parser = parse_up)]
    up: Option<Up>,
    /// The scene's axes that point the other way than its format says, like y or yz
    #[arg(long, help_heading = HEADING, value_name = "AXES", value_parser = parse_axes)]
    flip: Option<Axes>,
    /// Level of detail of a lod-meta.json, 0 the finest [default: the finest there is]
    #[arg(long, help_heading = HEADING, value_name = "LEVEL")]
    lod: Option<u32>,
}

/// Axes that are flipped.
#[derive(Clone, Copy)]
struct Axes([bool; 3]);

impl ReadingArgs {
    pub fn reading(&self) -> Result<Reading> {
        Ok(Reading {
            level: self.lod,
            flip: self.flip.map_or([false; 3], |Axes(axes)| axes),
            transform: self.up.map_or(Ok(Transform::IDENTITY), upright)?,
        })
    }
}

/// What turns the axis to where up is. The opposite one is turned about x.
fn upright(up: Up) -> Result<Transform> {
    let wanted = Up::default().vector();
    let rotation = if up.flipped() == Up::default() {
        DQuat::from_rotation_x(std::f64::consts::PI)
    } else {
        DQuat::from_rotation_arc(up.vector(), wanted)
    };
    // Quarter turns to the last bit.
    let matrix = DMat3::from_quat(rotation).to_cols_array().map(f64::round);
    Transform::new(DQuat::from_mat3(&DMat3::from_cols_array(&matrix)), DVec3::ZERO, 1.0)
}

fn parse_up(text: &str) -> Result<Up> {
    let wanted = text.trim_start_matches('+');
    let found = Up::ALL.into_iter().find(|up| up.to_string().trim_start_matches('+') == wanted);
    found.context("expected x, y, z, -x, -y or -z")
}

fn parse_axes(text: &str) -> Result<Axes> {
    ensure!(!text.is_empty() && text.chars().all(|c| "xyz".contains(c)), "expected some of x, y and z, like yz");
    Ok(Axes(['x', 'y', 'z'].map(|axis| text.contains(axis))))
}
