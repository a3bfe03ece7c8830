//! Scene instances: copies of a scene with a transform each, and the file that lists them (docs/side-files.md).

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, ensure};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Bounds, Focus, Transform};
use crate::files::read_whole;

/// The instances of a scene, at least one. Their order is that of the Gaussians of equal depth. A clone shares them.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneInstances(Arc<[Transform]>);

/// A list of places, as `--place` reads it.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "PlacesFile")]
pub struct InstancesFile {
    /// At least one.
    pub places: Vec<SceneInstance>,
}

/// A place of a scene: a point p of the scene comes to position + scale * (p, turned by rotation).
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Place")]
pub struct SceneInstance {
    /// World units; each coordinate within 1e30.
    pub position: [f64; 3],
    /// A quaternion w, x, y, z of any length but 0; none: not turned.
    #[serde(default)]
    pub rotation: Option<[f64; 4]>,
    /// World units per unit of the scene, from 1e-6 to 1e6; none: 1.
    #[serde(default)]
    pub scale: Option<f64>,
}

/// The list before its entries are looked at, so that errors name the entry.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    places: Vec<serde_json::Value>,
}

/// Largest coordinate of a position. Beyond it, no scene can be drawn in 32-bit floats.
const MAX_POSITION: f64 = 1e30;
/// Smallest and largest scale.
const SCALES: [f64; 2] = [1e-6, 1e6];

impl SceneInstances {
    /// Instances with these transforms.
    ///
    /// # Errors
    /// If the list is empty, or an instance is too far away, too small or too large for 32-bit floats.
    pub fn new(transforms: Vec<Transform>) -> Result<Self> {
        ensure!(!transforms.is_empty(), "there is no place in the list");
        transforms.par_iter().enumerate().try_for_each(|(number, transform)| named(number, check(transform)))?;
        Ok(Self(transforms.into()))
    }

    /// Reads a list of places.
    ///
    /// # Errors
    /// A clause without the file's name if it cannot be read or is no such list.
    pub fn read(file: &Path) -> Result<Self> {
        Self::parse(&read_whole(file)?)
    }

    /// The instances in the bytes of a list of places.
    ///
    /// # Errors
    /// If it is no such list. The error names the entry.
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        let raw: Raw = serde_json::from_slice(bytes)
            .map_err(|error| anyhow!("expected an object with the list \"places\": {error}"))?;
        let parse = |(number, place): (usize, serde_json::Value)| {
            let place = serde_json::from_value::<SceneInstance>(place).map_err(anyhow::Error::new);
            named(number, place.and_then(|place| place.transform()))
        };
        Self::new(raw.places.into_par_iter().enumerate().map(parse).collect::<Result<_>>()?)
    }

    /// The transforms of all instances.
    pub fn all(&self) -> &[Transform] {
        &self.0
    }

    /// The box around all instances of a box.
    pub fn extent(&self, extent: &Bounds) -> Bounds {
        if self.is_unmoved() {
            return *extent;
        }
        let corner = |i: usize| {
            DVec3::from_array(std::array::from_fn(|axis| {
                f64::from(if i >> axis & 1 == 0 { extent.low[axis] } else { extent.high[axis] })
            }))
        };
        let of_one = |transform: &Transform| {
            let corners: [DVec3; 8] = std::array::from_fn(|i| transform.point(corner(i)));
            corners.into_iter().fold(EMPTY, |all, corner| [all[0].min(corner), all[1].max(corner)])
        };
        let both = |a: [DVec3; 2], b: [DVec3; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let [low, high] = self.0.par_iter().map(of_one).reduce(|| EMPTY, both);
        // Rounding to 32 bits must not make the box smaller.
        let rounded = |v: f64| v.clamp(f32::MIN.into(), f32::MAX.into()) as f32;
        Bounds {
            low: low.to_array().map(|v| rounded(v - v.abs() * 1e-6)),
            high: high.to_array().map(|v| rounded(v + v.abs() * 1e-6)),
        }
    }

    /// The sphere around all instances of a sphere. Its centre is the mean of their centres.
    pub fn focus(&self, focus: Focus) -> Focus {
        if self.is_unmoved() {
            return focus;
        }
        let centres = || self.0.iter().map(|transform| transform.point(focus.centre.into()));
        let centre = centres().map(|centre| centre / self.0.len() as f64).sum::<DVec3>();
        let reaches = centres().zip(self.0.iter()).map(|(c, place)| c.distance(centre) + place.scale() * focus.radius);
        Focus { centre: centre.to_array(), radius: reaches.fold(0.0, f64::max) }
    }

    /// BLAKE3 of the instances.
    pub fn hash(&self) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new();
        for place in self.0.iter() {
            let (turn, at) = (place.rotation().to_array(), place.translation().to_array());
            turn.iter().chain(&at).chain([&place.scale()]).for_each(|v| {
                hasher.update(&v.to_le_bytes());
            });
        }
        hasher.finalize()
    }

    /// True if there is a single instance with the identity as its transform.
    fn is_unmoved(&self) -> bool {
        *self.0 == [Transform::IDENTITY]
    }
}

/// The box of nothing.
const EMPTY: [DVec3; 2] = [DVec3::INFINITY, DVec3::NEG_INFINITY];

impl SceneInstance {
    fn transform(&self) -> Result<Transform> {
        let [w, x, y, z] = self.rotation.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        Transform::new(DQuat::from_xyzw(x, y, z, w), self.position.into(), self.scale.unwrap_or(1.0))
    }
}

fn check(transform: &Transform) -> Result<()> {
    let (at, scale) = (transform.translation(), transform.scale());
    ensure!(at.abs().max_element() <= MAX_POSITION, "the position {:?} is not within {MAX_POSITION:e}", at.to_array());
    let [least, most] = SCALES;
    ensure!((least..=most).contains(&scale), "the scale {scale:?} is not from {least:e} to {most:e}");
    Ok(())
}

fn named<T>(number: usize, result: Result<T>) -> Result<T> {
    result.with_context(|| format!("place {number}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(text: &str) -> String {
        format!("{:#}", SceneInstances::parse(text.as_bytes()).unwrap_err())
    }

    #[test]
    fn rotation_and_scale_of_a_place_are_optional() {
        let text = r#"{"places": [{"position": [1, 2, 3]},
            {"position": [0, 0, -1.5], "rotation": [2, 0, 0, 0], "scale": 0.5}]}"#;
        let expected = [(DVec3::new(1.0, 2.0, 3.0), 1.0), (DVec3::new(0.0, 0.0, -1.5), 0.5)];
        let expected = expected.map(|(at, scale)| Transform::new(DQuat::IDENTITY, at, scale).unwrap());
        assert_eq!(SceneInstances::parse(text.as_bytes()).unwrap().all(), expected);
    }

    #[test]
    fn errors_name_the_entry() {
        let second = |place: &str| problem(&format!(r#"{{"places": [{{"position": [0, 0, 0]}}, {place}]}}"#));
        let all = [
            (second(r#"{"position": [0, 0]}"#), "place 1: invalid length 2"),
            (second(r#"{"position": [0, 0, 0], "turn": 1}"#), "place 1: unknown field `turn`"),
            (second(r#"{"rotation": [1, 0, 0, 0]}"#), "place 1: missing field `position`"),
            (second(r#"{"position": [0, 0, 0], "rotation": [0, 0, 0, 0]}"#), "is not a rotation"),
            (second(r#"{"position": [0, 0, 0], "scale": 0}"#), "place 1: the scale 0.0 is not over 0"),
            (second(r#"{"position": [0, 0, 0], "scale": 1e7}"#), "place 1: the scale 10000000.0 is not from 1e-6"),
            (second(r#"{"position": [0, 2e30, 0]}"#), "place 1: the position [0.0, 2e30, 0.0] is not within 1e30"),
            (problem(r#"{"places": []}"#), "there is no place in the list"),
            (problem(r#"{"place": []}"#), "expected an object with the list \"places\": unknown field `place`"),
            (problem("[1]"), "expected an object with the list"),
        ];
        for (problem, expected) in all {
            assert!(problem.contains(expected), "{problem}");
        }
    }

    #[test]
    fn box_and_sphere_are_around_all_places() {
        let (bounds, focus) =
            (Bounds { low: [-1.0, -2.0, -3.0], high: [1.0, 2.0, 3.0] }, Focus { centre: [0.5, 0.0, 0.0], radius: 2.0 });
        let one = SceneInstances::new(vec![Transform::IDENTITY]).unwrap();
        assert_eq!((one.extent(&bounds), one.focus(focus)), (bounds, focus));
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let place = |at: f64, turn, scale| Transform::new(turn, DVec3::new(at, 0.0, 0.0), scale).unwrap();
        let two = SceneInstances::new(vec![place(-10.0, DQuat::IDENTITY, 1.0), place(20.0, turn, 2.0)]).unwrap();
        let (extent, around) = (two.extent(&bounds), two.focus(focus));
        let expected = [[-11.0, -2.0, -6.0], [24.0, 2.0, 6.0]];
        for (found, expected) in [extent.low, extent.high].as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-4, "{extent:?}");
        }
        assert!(extent.low[0] <= -11.0 && extent.high[0] >= 24.0, "the box is not made smaller");
        // Centres at (-9.5, 0, 0) and (20, 1, 0).
        assert!(DVec3::from(around.centre).distance(DVec3::new(5.25, 0.5, 0.0)) < 1e-9, "{around:?}");
        assert!((around.radius - (14.75_f64.hypot(0.5) + 4.0)).abs() < 1e-9, "{around:?}");
    }

    #[test]
    fn the_hash_depends_on_every_number_and_on_the_order() {
        let hash = |text: &str| SceneInstances::parse(format!(r#"{{"places": [{text}]}}"#).as_bytes()).unwrap().hash();
        let all = [
            r#"{"position": [1, 2, 3]}"#,
            r#"{"position": [1, 2, 4]}"#,
            r#"{"position": [1, 2, 3], "scale": 2}"#,
            r#"{"position": [1, 2, 3], "rotation": [1, 0, 0, 1]}"#,
            r#"{"position": [1, 2, 3]}, {"position": [1, 2, 4]}"#,
            r#"{"position": [1, 2, 4]}, {"position": [1, 2, 3]}"#,
        ];
        let hashes: std::collections::BTreeSet<_> = all.map(|text| hash(text).to_hex().to_string()).into();
        assert_eq!(hashes.len(), all.len());
        assert_eq!(hash(all[0]), hash(r#"{"scale": 1, "position": [1, 2, 3], "rotation": [1, 0, 0, 0]}"#));
    }
}
