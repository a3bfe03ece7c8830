//! Procedural scenes, seeded and equal on every machine.
//!
//! - `cactus` - a potted cactus with the statistics of trained scenes
//! - `rooms` - scenes around the camera: a furnished room, and a plain with a horizon
//! - `town/` - a town of a size that depends on the count, with camera paths of its own
//!
//! The two clouds at the extremes of tile density are in this file.

pub mod cactus;
mod rooms;
mod town;

pub use cactus::cactus;
pub use town::TownPath;

use std::ops::Range;

use anyhow::{Context, Result, ensure};
use glam::DVec3;

use crate::scene::harmonics::C0;
use crate::scene::{Builder, Gaussians, LoadReport, Random, Raw, Scene};

use crate::host_memory::OutOfMemory;
use crate::quantities;

/// Largest number of Gaussians of a procedural scene other than the town.
const MAX_COUNT: usize = 200_000_000;

/// A procedural scene: its kind and its number of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Procedural {
    kind: Kind,
    count: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// A potted cactus with the statistics of trained scenes.
    Cactus,
    /// The inside of a furnished room.
    Room,
    /// A plain with a horizon.
    Plain,
    /// A town of a size that depends on the count.
    Town,
    /// A ball of large Gaussians, each in many tiles.
    FewLarge,
    /// A ball of small Gaussians, most of them in a single tile.
    ManySmall,
}

/// The name and the default count of each kind.
const KINDS: [(Kind, &str, usize); 6] = [
    (Kind::Cactus, "cactus", cactus::DEFAULT_COUNT),
    (Kind::Room, "room", 2_000_000),
    (Kind::Plain, "plain", 2_000_000),
    (Kind::Town, "town", 2_000_000),
    (Kind::FewLarge, "few-large", 20_000),
    (Kind::ManySmall, "many-small", 2_000_000),
];

impl Procedural {
    /// Parses `NAME` or `NAME:COUNT`. `None` if the name is unknown: the text is then the path of a file.
    ///
    /// # Errors
    /// If the count is not a number from 1 to 200,000,000, or to 1,000,000,000 for the town.
    pub fn parse(text: &str) -> Option<Result<Self>> {
        let (name, count) = text.split_once(':').map_or((text, None), |(name, count)| (name, Some(count)));
        let (kind, _, default) = *KINDS.iter().find(|(_, known, _)| *known == name)?;
        Some(count.map_or(Ok(default), |text| parse_count(text, kind)).map(|count| Self { kind, count }))
    }

    /// The names of all kinds.
    pub fn names() -> impl Iterator<Item = &'static str> {
        KINDS.iter().map(|(_, name, _)| *name)
    }

    /// The name of the kind.
    pub fn name(self) -> &'static str {
        KINDS.iter().find(|(kind, ..)| *kind == self.kind).map_or("", |(_, name, _)| name)
    }

    /// The text that [`Procedural::parse`] reads.
    pub fn argument(self) -> String {
        format!("{}:{}", self.name(), self.count)
    }

    /// True for the town, which has camera paths of its own.
    pub fn is_town(&self) -> bool {
        self.kind == Kind::Town
    }

    /// Number of Gaussians.
    pub fn count(self) -> usize {
        self.count
    }

    /// Eyes and targets of `views` cameras along a path. `None` if the scene is
    /// no town. The cameras are outside of houses.
    pub fn views(&self, path: TownPath, views: usize) -> Option<Vec<[DVec3; 2]>> {
        self.is_town().then(|| town::views(self.count, path, views))
    }

    /// Generates the scene.
    ///
    /// # Errors
    /// [`OutOfMemory`] if it cannot be allocated.
    pub fn make(self) -> Result<Scene, OutOfMemory> {
        self.fill(0..self.count).map(|(gaussians, report)| Scene::made(self.name(), gaussians, report))
    }

    /// Generates the Gaussians of a range of indices: that part of the whole scene, bit for bit. None is dropped, so
    /// that indices are positions in the scene.
    ///
    /// # Errors
    /// [`OutOfMemory`] if they cannot be allocated.
    ///
    /// # Panics
    /// If the range is not within the scene.
    pub fn fill(&self, range: Range<usize>) -> Result<(Gaussians, LoadReport), OutOfMemory> {
        assert!(range.start <= range.end && range.end <= self.count, "{range:?} is not within 0..{}", self.count);
        match self.kind {
            Kind::Cactus => cactus::fill(self.count, range),
            Kind::Room => rooms::room(self.count, range),
            Kind::Plain => rooms::plain(self.count, range),
            Kind::Town => town::fill(self.count, range),
            // Radii of about 100 px and 1 px, seen from an orbit at 720x720.
            Kind::FewLarge => ball(0.08, range),
            Kind::ManySmall => ball(0.001, range),
        }
    }
}

/// Gaussians of a range of a ball: of about this standard deviation, uniform in the unit ball.
fn ball(scale: f64, range: Range<usize>) -> Result<(Gaussians, LoadReport), OutOfMemory> {
    let mut builder = Builder::new(0, range.len())?;
    builder.extend(range.len(), |i, sh| {
        let mut random = Random::of(range.start + i);
        let mean = random.direction() * random.unit().cbrt();
        let axis = random.direction();
        let log_scale = DVec3::from_array([(); 3].map(|()| scale.ln() + 0.4 * random.normal()));
        let opacity = 0.1 + 0.8 * random.unit();
        // The colour encodes the position.
        sh[0] = (0.45 * mean / C0).to_array().map(|v| v as f32);
        Raw {
            mean: mean.to_array(),
            log_scale: log_scale.to_array(),
            rotation: [random.normal(), axis.x, axis.y, axis.z],
            opacity_logit: (opacity / (1.0 - opacity)).ln(),
        }
    });
    Ok(builder.finish())
}

fn parse_count(text: &str, kind: Kind) -> Result<usize> {
    let (scene, most) =
        if kind == Kind::Town { ("the town", town::MAX_COUNT) } else { ("a procedural scene", MAX_COUNT) };
    let count = quantities::count(text).and_then(|count| usize::try_from(count).ok());
    let count = count.with_context(|| format!("'{text}' is not a number of Gaussians, like 20000 or 20K"))?;
    ensure!((1..=most).contains(&count), "{scene} has 1 to {most} Gaussians, not {count}");
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn procedural_names_are_read_with_and_without_a_count() {
        let parse = |text| Procedural::parse(text).map(|p| p.map(|p| (p.kind, p.count)).map_err(|e| format!("{e:#}")));
        assert_eq!(parse("cactus"), Some(Ok((Kind::Cactus, 139_410))));
        assert_eq!(parse("many-small:3_000"), Some(Ok((Kind::ManySmall, 3000))));
        assert_eq!(parse("many-small:3K"), Some(Ok((Kind::ManySmall, 3000))));
        assert_eq!(parse("cactus.ply"), None);
        assert_eq!(parse("cacti:3"), None);
        assert!(parse("few-large:0").unwrap().unwrap_err().contains("1 to 200000000"));
        assert!(parse("few-large:many").unwrap().unwrap_err().contains("'many' is not a number"));
    }

    #[test]
    fn every_kind_is_the_same_every_time_and_has_its_count() {
        for (kind, name, _) in KINDS {
            let scene = || Procedural { kind, count: 700 }.make().unwrap();
            let (one, other) = (scene(), scene());
            assert_eq!(one.gaussians, other.gaussians, "{name}");
            assert_eq!((one.gaussians.len(), one.format), (700, format!("procedural {name}")));
        }
    }

    #[test]
    fn a_range_of_every_kind_is_that_part_of_the_whole() {
        for (kind, name, _) in KINDS {
            let scene = Procedural { kind, count: 3000 };
            let whole = scene.make().unwrap().gaussians;
            for range in [0..3000, 0..1, 7..7, 1023..1025, 100..2900, 2999..3000, 3000..3000] {
                let (part, report) = scene.fill(range.clone()).unwrap();
                let indices: Vec<u32> = range.clone().map(|i| i as u32).collect();
                assert_eq!(part, whole.selected(&indices).unwrap(), "{name} {range:?}");
                assert_eq!((report.read, report.dropped()), (range.len(), 0), "{name} {range:?}");
            }
        }
    }

    #[test]
    fn procedural_clouds_are_of_their_size() {
        for (kind, scale) in [(Kind::FewLarge, 0.08_f32), (Kind::ManySmall, 0.001)] {
            let cloud = Procedural { kind, count: 500 };
            let gaussians = cloud.make().unwrap().gaussians;
            let mut widths: Vec<f32> = gaussians.scales().iter().map(|s| s[0]).collect();
            widths.sort_unstable_by(f32::total_cmp);
            assert!((0.9..1.1).contains(&(widths[250] / scale)), "median {}", widths[250]);
        }
    }
}
