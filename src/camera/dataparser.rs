//! `dataparser_transforms.json` of nerfstudio: the similarity from the coordinates of its `transforms.json` to those of
//! the scene that it trains and exports.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use glam::{DMat3, DMat4, DVec3, DVec4};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::cameras_json::without_byte_order_mark;
use crate::files::read_whole;

pub(super) const FILE: &str = "dataparser_transforms.json";

/// The first three rows of a matrix whose last row is 0, 0, 0, 1.
type Rows = [[f64; 4]; 3];

/// The file: a matrix, then a scale, from the captured data to the trained scene.
#[derive(Deserialize)]
struct Written {
    transform: Rows,
    scale: f64,
}

/// The part of that transform that is already applied to `transforms.json`.
#[derive(Deserialize)]
struct Applied {
    applied_transform: Option<Rows>,
    applied_scale: Option<f64>,
}

/// The transform from the cameras of a `transforms.json` to the scene that was trained with them.
pub(super) struct Dataparser {
    matrix: DMat4,
    scale: f64,
}

impl Dataparser {
    /// Reads the file in `folder`, if there is one, for this `transforms.json`.
    pub fn beside(folder: &Path, transforms: &Map<String, Value>) -> Result<Option<Self>> {
        let path = folder.join(FILE);
        // A file that cannot be read is no reason to draw the cameras elsewhere.
        if path.symlink_metadata().is_err() {
            return Ok(None);
        }
        let read = read_whole(&path).and_then(|text| Self::parse(&text, transforms));
        read.with_context(|| FILE.to_owned()).map(Some)
    }

    fn parse(text: &[u8], transforms: &Map<String, Value>) -> Result<Self> {
        let Written { transform, scale } = serde_json::from_slice(without_byte_order_mark(text))
            .context("is not a transform of three rows of four numbers and a scale")?;
        let applied: Applied =
            Applied::deserialize(transforms).context("applied_transform or applied_scale of transforms.json")?;
        let (before, applied_scale) =
            (applied.applied_transform.map_or(DMat4::IDENTITY, matrix), applied.applied_scale.unwrap_or(1.0));
        let (matrix, scale) = (matrix(transform) * before.inverse(), scale / applied_scale);
        let turn = DMat3::from_mat4(matrix);
        let is_rotation = (turn * turn.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-4) && turn.determinant() > 0.0;
        ensure!(is_rotation && matrix.is_finite(), "its transform is not a rotation and a translation");
        ensure!(scale.is_finite() && scale > 0.0, "its scale is not over 0 and finite");
        Ok(Self { matrix, scale })
    }

    /// Position and world-to-view rotation of a camera in the trained scene.
    pub fn moved(&self, position: DVec3, rotation: DMat3) -> (DVec3, DMat3) {
        let position = self.scale * self.matrix.transform_point3(position);
        (position, rotation * DMat3::from_mat4(self.matrix).transpose())
    }
}

fn matrix(rows: Rows) -> DMat4 {
    let [x, y, z] = rows.map(DVec4::from);
    DMat4::from_cols(x, y, z, DVec4::W).transpose()
}
