//! Levels of a `.rad` with a tree: each stands for all leaves, and they are drawn as the levels of page files are.

use std::fs;
use std::path::Path;

use smalto::formats::Reading;
use smalto::pagefile::{PageFile, nodes_of};
use smalto::scene::{Gaussians, NoLevel, Watch, harmonics};

use crate::common::program::{fails, ok, path};
use crate::common::table::{Table, fixture, read};

fn rad(name: &str) -> String {
    fixture(&format!("rad/plush-{name}.rad")).display().to_string()
}

/// The nodes of a file, as Spark's decoder reads them.
struct Nodes(Table);

impl Nodes {
    fn read(name: &str) -> Self {
        Self(Table::read(&fixture(&format!("rad/plush-{name}.csv"))))
    }

    fn children(&self, node: usize) -> std::ops::Range<usize> {
        let [count, start] = ["child_count", "child_start"].map(|name| self.0.value(node, name) as usize);
        start..start + count
    }

    /// The node with these values.
    fn find(&self, gaussians: &Gaussians, i: usize) -> usize {
        let (mean, colour) = (gaussians.means()[i], gaussians.sh(i)[0]);
        let apart = |node: &usize| {
            let of = |names: [&str; 3]| names.map(|name| self.0.value(*node, name));
            let places = of(["x", "y", "z"]).into_iter().zip(mean).map(|(a, b)| (a - f64::from(b)).abs());
            let colours = of(["r", "g", "b"]).into_iter().zip(colour);
            let colours = colours.map(|(a, b)| ((a - 0.5) / harmonics::C0 - f64::from(b)).abs());
            places.chain(colours).fold(0.0, f64::max)
        };
        let nearest = (0..self.0.rows.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap();
        assert!(apart(&nearest) < 1e-4, "node {nearest} is {} apart", apart(&nearest));
        nearest
    }

    /// The number of these nodes on the way from the root to each leaf.
    fn on_ways(&self, level: &[usize]) -> Vec<usize> {
        let (mut to_visit, mut found) = (vec![(0, 0)], Vec::new());
        while let Some((node, above)) = to_visit.pop() {
            let above = above + level.iter().filter(|one| **one == node).count();
            if self.children(node).is_empty() {
                found.push(above);
            }
            to_visit.extend(self.children(node).map(|child| (child, above)));
        }
        found
    }
}

#[test]
fn each_level_of_a_rad_stands_for_all_leaves() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["default-lod", "clusters-lod"] {
        let out = path(&folder, &format!("{name}.smalto"));
        let said = ok(&["lod", &rad(name), "--keep-levels", "-o", &out]);
        assert!(said.contains("pages of RAD, the leaves of 79 nodes, 61 Gaussians"), "{said}");
        let (file, nodes) = (PageFile::open(Path::new(&out)).unwrap(), Nodes::read(name));
        let mut counts = Vec::new();
        for (page, lod) in file.levels().unwrap().iter().enumerate() {
            let found = nodes_of(&file, std::slice::from_ref(&(page..page + 1))).unwrap();
            let level: Vec<usize> = (0..found.len()).map(|i| nodes.find(&found, i)).collect();
            assert_eq!(nodes.on_ways(&level), [1; 61], "{name}, level {}", lod.level);
            counts.push(level.len());
        }
        assert!(counts[0] == 61 && (2..=7).contains(&counts[1]) && counts[2..] == [1], "{counts:?}");
    }
}

/// Chunks may lie in files of their own.
#[test]
fn chunks_change_no_level() {
    let levels = |name| Reading::default().read_levels(Path::new(&rad(name)), &Watch::NONE).unwrap();
    let (one, other) = (levels("default-lod"), levels("chunked-lod"));
    assert_eq!(one.leaves, other.leaves);
    assert_eq!(one.coarser.means(), other.coarser.means());
    assert_eq!(one.scene.gaussians.len(), read(Path::new(&rad("default-lod"))).gaussians.len());
}

#[test]
fn a_rad_is_drawn_by_its_levels() {
    let folder = tempfile::tempdir().unwrap();
    let [kept, a, b] = ["kept.smalto", "a.png", "b.png"].map(|name| path(&folder, name));
    ok(&["lod", &rad("default-lod"), "--keep-levels", "-o", &kept]);
    let draw = |scene: &str, limit: &str, out: &str| {
        let said = ok(&["render", scene, "--size", "96x64", "--splats", limit, "-o", out]);
        (said, fs::read(out).unwrap())
    };
    let (said, all) = draw(&rad("default-lod"), "61", &a);
    assert!(said.contains("of the levels") && all == draw(&kept, "61", &b).1, "{said}");
    let fewer = draw(&rad("default-lod"), "10", &a).1;
    assert!(fewer != all && fewer == draw(&kept, "10", &b).1);
    let error = fails(2, &["render", &rad("nolod"), "--splats", "10", "-o", &a]);
    assert!(error.contains("there are no levels of detail here"), "{error}");
    let error = fails(2, &["render", &rad("default-lod"), "--sog-level", "1", "-o", &a]);
    assert!(error.contains("there are no numbered levels of detail; only a lod-meta.json has them"), "{error}");
    let without = Reading::default().read_levels(Path::new(&rad("nolod")), &Watch::NONE).err().unwrap();
    assert!(without.is::<NoLevel>(), "{without}");
}

/// Any byte of a file may be wrong.
#[test]
fn damage_of_levels_is_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let (file, whole) = (folder.path().join("a.rad"), fs::read(rad("default-lod")).unwrap());
    for at in (0..whole.len()).step_by(37) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x55;
        fs::write(&file, bytes).unwrap();
        if let Ok(levels) = Reading::default().read_levels(&file, &Watch::NONE) {
            let ends = levels.leaves.iter().map(|leaf| leaf.finest.end);
            assert_eq!(ends.max(), Some(levels.scene.gaussians.len()), "byte {at}");
        }
    }
}
