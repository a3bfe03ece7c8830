//! Page files with the levels of a streamed SOG: they hold all of its levels, and one of each leaf is in every cut.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use smalto::formats::{self, Leaf, Reading};
use smalto::lod::NEVER;
use smalto::pagefile::{NO_PAGE, PageFile, nodes_of, static_level};
use smalto::scene::{Gaussians, NoLevel, Watch};

use super::sog::{change, copied};
use crate::common::program::{self, fails, ok, path};
use crate::common::table::{fixture, read};

fn level(folder: &Path, level: u32) -> Gaussians {
    Reading { level: Some(level), ..Reading::default() }.read(folder).unwrap().gaussians
}

/// Means with opacities and colours, in an order of their own.
fn sorted(gaussians: &Gaussians) -> Vec<([f32; 3], f32, [f32; 3])> {
    let row = |i: usize| (gaussians.means()[i], gaussians.opacities()[i], gaussians.sh(i)[0]);
    let mut rows: Vec<_> = (0..gaussians.len()).map(row).collect();
    rows.sort_by(|a, b| a.partial_cmp(b).unwrap());
    rows
}

#[test]
fn all_levels_of_a_streamed_sog_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let [streamed, out] = ["streamed/lod-meta.json", "a.smalto"].map(|name| path(&folder, name));
    ok(&["lod", "cactus:40000", "-o", &streamed]);
    let said = ok(&["lod", &streamed, "--keep-levels", "-o", &out]);
    assert!(said.contains("pages of streamed SOG, 40000 Gaussians"), "{said}");
    let (file, streamed) = (PageFile::open(Path::new(&out)).unwrap(), folder.path().join("streamed"));
    assert!(file.header().has_source_levels());
    assert!(read_pages(&out) == level(&streamed, 0), "the scene, in its order");
    let lods = file.levels().unwrap();
    for number in 0..6 {
        let pages = (0..lods.len()).filter(|page| u32::from(lods[*page].level) == number);
        let found = nodes_of(&file, &pages.map(|page| page..page + 1).collect::<Vec<_>>()).unwrap();
        // Opacities of nodes have 512 steps for each power of two.
        let (found, expected) = (sorted(&found), sorted(&level(&streamed, number)));
        assert_eq!(found.len(), expected.len(), "level {number}");
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!((found.0, found.2), (expected.0, expected.2), "level {number}");
            assert!((found.1 / expected.1 - 1.0).abs() < 1e-3, "level {number}: {} {}", found.1, expected.1);
        }
    }
    for (page, lod) in lods.iter().enumerate() {
        let errors = [lod.least_error, lod.errors[7]];
        assert!(errors[0] == errors[1] && lod.parent_errors[0] == lod.parent_errors[7], "one error of a level");
        assert_eq!(errors[0] == 0, lod.level == 0);
        assert_eq!(page < file.header().scene_pages(), lod.level == 0);
        if lod.parent == NO_PAGE {
            assert_eq!((lod.level, lod.parent_errors[0]), (5, NEVER));
        } else {
            let parent = lods[lod.parent as usize];
            assert_eq!((parent.low, parent.high, parent.level), (lod.low, lod.high, lod.level + 1), "of the same leaf");
            assert_eq!(parent.least_error, lod.parent_errors[0]);
            assert!(parent.least_error >= lod.least_error);
        }
    }
    let about = ok(&["info", &out]);
    assert!(
        about.contains("pages       40 of up to 1024 Gaussians") && about.contains("pages of the levels of the source")
    );
    // One thread makes the same file.
    let again = path(&folder, "b.smalto");
    let arguments = ["lod", &streamed.join("lod-meta.json").display().to_string(), "--keep-levels", "-o", &again];
    let output = program::run(&arguments, |command| _ = command.env("RAYON_NUM_THREADS", "1"));
    assert!(output.status.success() && fs::read(&out).unwrap() == fs::read(&again).unwrap());
}

fn read_pages(path: &str) -> Gaussians {
    smalto::pagefile::read(&Reading::default(), Path::new(path), &Watch::NONE).unwrap().gaussians
}

/// Exactly one level of each leaf is in a cut, and the environment is in every cut.
#[test]
fn a_cut_has_one_level_of_each_leaf() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.smalto");
    ok(&["lod", fixture("lod").to_str().unwrap(), "--keep-levels", "-o", &out]);
    let file = PageFile::open(Path::new(&out)).unwrap();
    assert_eq!(file.statistics().count, 305 + 61);
    assert_eq!([file.header().scene_pages(), file.pages().len()], [3, 5], "a leaf has pages of its own");
    // The leaves have 163 and 142 Gaussians, or 50 and 72.
    let cut = |most: usize| static_level(&file, most, &Watch::NONE).map(|scene| scene.gaussians.len());
    assert_eq!(cut(366).unwrap(), 366);
    assert_eq!(cut(183).unwrap(), 50 + 72 + 61);
    let [first, second] = [50 + 142 + 61, 163 + 72 + 61];
    assert!([first, second].contains(&cut(365).unwrap()), "{}", cut(365).unwrap());
    let error = cut(182).unwrap_err();
    assert!(error.to_string().contains("the coarsest level has 183 Gaussians, more than 182"), "{error}");
}

/// A leaf whose coarser Gaussians cannot be drawn has its finest level only.
#[test]
fn gaussians_that_cannot_be_drawn_leave_the_other_levels() {
    let (streamed, folder) = (copied("lod"), tempfile::tempdir().unwrap());
    // Colours have no values but the first one of the codebook.
    change(&streamed.path().join("1_0/meta.json"), |meta| meta["sh0"]["codebook"] = json!([0.5]));
    let levels = Reading::default().read_levels(streamed.path(), &Watch::NONE).unwrap();
    let report = levels.scene.report;
    assert_eq!((report.read, report.dropped()), (366, 0), "the report is of the scene");
    assert_eq!(levels.coarser.len(), 0);
    let why = "122 Gaussians of coarser levels are left out: they, or those that they stand for, cannot be drawn";
    assert_eq!(levels.scene.notices, [why]);
    assert_eq!(levels.leaves.iter().map(|leaf| leaf.coarser.len()).collect::<Vec<_>>(), [0; 3]);
    let out = path(&folder, "a.smalto");
    let said = program::notes(&["lod", streamed.path().to_str().unwrap(), "--keep-levels", "-o", &out]);
    assert!(said.contains(why), "{said}");
    let file = PageFile::open(Path::new(&out)).unwrap();
    assert_eq!(file.pages().len(), file.header().scene_pages());
    assert!(read_pages(&out) == read(streamed.path()).gaussians);
    // Nothing stands for a leaf whose finest level cannot be drawn.
    let streamed = copied("lod");
    change(&streamed.path().join("0_0/meta.json"), |meta| meta["sh0"]["codebook"] = json!([0.5]));
    let levels = Reading::default().read_levels(streamed.path(), &Watch::NONE).unwrap();
    assert_eq!((levels.scene.gaussians.len(), levels.coarser.len(), levels.leaves.len()), (61, 0, 1));
    assert_eq!((levels.scene.report.dropped(), &levels.scene.notices[..]), (305, &[why.to_owned()][..]));
}

/// Leaves take whole pages, so a file of tiny leaves would be large without a reason.
#[test]
fn tiny_leaves_and_many_levels_are_refused() {
    let (streamed, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    ok(&["convert", "cactus:6000", &path(&streamed, "a.sog")]);
    let write = |leaves: Vec<Value>| {
        let meta = json!({ "filenames": ["a.sog"], "tree": { "children": leaves } });
        fs::write(streamed.path().join("lod-meta.json"), meta.to_string()).unwrap();
    };
    let range = |first: usize, count: usize| json!({ "file": 0, "offset": first, "count": count });
    let out = path(&folder, "a.smalto");
    write((0..6000).map(|i| json!({ "lods": { "0": range(i, 1) } })).collect());
    let error = fails(1, &["lod", &path(&streamed, "lod-meta.json"), "--keep-levels", "-o", &out]);
    assert!(error.contains("its leaves are too small: they take 6000 pages"), "{error}");
    let lods: serde_json::Map<_, _> = (0..1001).map(|i| (i.to_string(), range(i, 1))).collect();
    write(vec![json!({ "lods": lods }), json!({ "lods": { "0": range(1001, 4999) } })]);
    let error = fails(4, &["lod", &path(&streamed, "lod-meta.json"), "--keep-levels", "-o", &out]);
    assert!(error.contains("a leaf in lod-meta.json has 1001 levels, expected at most 1000"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn ranges_that_contradict_the_files_are_refused() {
    type Change = fn(&mut Value);
    let cases: Vec<(&str, Change)> = vec![
        ("overlap", |m| m["tree"]["children"][1]["lods"]["0"]["offset"] = json!(162)),
        ("gap", |m| m["tree"]["children"][1]["lods"]["0"]["offset"] = json!(164)),
        ("short", |m| m["tree"]["children"][1]["lods"]["0"]["count"] = json!(141)),
        ("long", |m| m["tree"]["children"][1]["lods"]["0"]["count"] = json!(u64::MAX)),
        ("missing", |m| drop(m["tree"]["children"][0]["lods"].as_object_mut().unwrap().remove("0"))),
    ];
    for (name, lie) in cases {
        let folder = copied("lod");
        change(&folder.path().join("lod-meta.json"), lie);
        let error = Reading::default().read_levels(folder.path(), &Watch::NONE).err().expect(name).to_string();
        let expected = "lod-meta.json does not assign each of the 305 Gaussians of 0_0/meta.json once";
        assert!(error.contains(expected), "{name}: {error}");
    }
    let folder = copied("lod");
    change(&folder.path().join("lod-meta.json"), |meta| meta["tree"] = json!({}));
    let error = Reading::default().read_levels(folder.path(), &Watch::NONE).err().unwrap().to_string();
    assert!(error.contains("the tree in lod-meta.json has no Gaussians"), "{error}");
}

/// Files may hold several levels, and a leaf may lack some.
#[test]
fn a_file_may_hold_several_levels() {
    let folder = copied("lod");
    change(&folder.path().join("lod-meta.json"), |meta| {
        let leaf = |lods: Value| json!({ "lods": lods });
        let range = |file: u32, offset: u32, count: u32| json!({ "file": file, "offset": offset, "count": count });
        meta["tree"]["children"] = json!([
            leaf(json!({ "0": range(0, 0, 163), "2": range(0, 163, 142) })),
            leaf(json!({ "1": range(1, 0, 50), "4": range(1, 50, 72), "5": range(1, 122, 0) })),
        ]);
    });
    assert!(formats::read(folder.path()).unwrap_err().to_string().contains("files of several levels"));
    let levels = Reading::default().read_levels(folder.path(), &Watch::NONE).unwrap();
    let [first, second] = ["lod/0_0", "lod/1_0"].map(|name| read(&fixture(name)).gaussians);
    let around = read(&fixture("lod/env/meta.json")).gaussians;
    let (scene, coarser) = (levels.scene.gaussians.means(), levels.coarser.means());
    assert_eq!(scene, [&first.means()[..163], &second.means()[..50], around.means()].concat());
    assert_eq!(coarser, [&first.means()[163..], &second.means()[50..]].concat());
    let ends = |leaf: &Leaf| (leaf.finest.start, leaf.coarser.iter().map(|range| [range.start, range.end]).collect());
    let ranges: Vec<(usize, Vec<[usize; 2]>)> = levels.leaves.iter().map(ends).collect();
    assert_eq!(ranges, [(0, vec![[0, 142]]), (163, vec![[142, 214]]), (213, vec![])]);
}

#[test]
fn what_has_no_levels_to_keep_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (out, streamed) = (path(&folder, "a.smalto"), fixture("lod").display().to_string());
    let rad = |name| fixture(&format!("rad/plush-{name}.rad")).display().to_string();
    for scene in ["cactus:10".to_owned(), fixture("plush.sog").display().to_string(), rad("nolod")] {
        let error = fails(2, &["lod", &scene, "--keep-levels", "-o", &out]);
        let expected = format!("--keep-levels needs a lod-meta.json, or a .rad with a tree, and {scene} is none");
        assert!(error.contains(&expected), "{error}");
    }
    let error = Reading::default().read_levels(&fixture("plush.v1/meta.json"), &Watch::NONE).err().unwrap();
    assert!(error.is::<NoLevel>(), "{error}");
    let error = fails(2, &["lod", &streamed, "--keep-levels", "-o", &path(&folder, "lod-meta.json")]);
    assert!(error.contains("--keep-levels writes a .smalto file"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    // A level of the kept ones is written as any scene; levels of a streamed SOG are made anew.
    let one = path(&folder, "one.ply");
    ok(&["lod", &streamed, "--keep-levels", "--splats", "183", "-o", &one]);
    assert_eq!(read(Path::new(&one)).gaussians.len(), 183);
    ok(&["lod", &streamed, "--keep-levels", "-o", &out]);
    let made = path(&folder, "made.smalto");
    ok(&["lod", &out, "-o", &made]);
    let error = fails(2, &["lod", &made, "--keep-levels", "--level", "1", "-o", &one]);
    let expected = format!("--keep-levels needs a lod-meta.json, or a .rad with a tree, and {made} is none");
    assert!(error.contains(&expected), "{error}");
    ok(&["lod", &out, "--keep-levels", "--splats", "183", "-o", &one]);
    assert_eq!(read(Path::new(&one)).gaussians.len(), 183);
    ok(&["lod", &out, "-o", &path(&folder, "new/lod-meta.json")]);
    assert_eq!(level(&folder.path().join("new"), 0).len(), 366);
}

/// Commands draw the levels of a streamed SOG as they draw those of a page file, and leave no file behind.
#[test]
fn a_streamed_sog_is_drawn_by_its_levels() {
    let folder = tempfile::tempdir().unwrap();
    let [streamed, kept, a, b] = ["s/lod-meta.json", "kept.smalto", "a.png", "b.png"].map(|name| path(&folder, name));
    ok(&["lod", "cactus:40000", "-o", &streamed]);
    ok(&["lod", &streamed, "--keep-levels", "-o", &kept]);
    let temporary = tempfile::tempdir().unwrap();
    let draw = |scene: &str, more: &[&str], out: &str| {
        let arguments = [&["render", scene, "--size", "96x64", "-o", out], more].concat();
        let output = program::run(&arguments, |command| _ = command.env("TMPDIR", temporary.path()));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(fs::read_dir(temporary.path()).unwrap().count(), 0, "{arguments:?}");
        (String::from_utf8(output.stdout).unwrap(), fs::read(out).unwrap())
    };
    for limit in [["--splats", "6000"], ["--lod-psnr", "30"]] {
        let (said, own) = draw(&streamed, &limit, &a);
        assert!(said.contains("of the levels"), "{said}");
        assert!(own == draw(&kept, &limit, &b).1, "{limit:?}");
    }
    // The folder names the same scene; without a limit, the finest level is drawn from memory.
    assert!(draw(&path(&folder, "s"), &["--splats", "6000"], &a).1 == draw(&kept, &["--splats", "6000"], &b).1);
    let (said, own) = draw(&streamed, &[], &a);
    assert!(!said.contains("levels") && own == draw(&kept, &[], &b).1, "{said}");
    // Files of a run are known again, whatever names the scene.
    let (out, scene) = (path(&folder, "out"), path(&folder, "s"));
    let orbit = |scene| ["render", scene, "--size", "48x32", "--splats", "6000", "--orbit", "2", "-o", &out];
    ok(&orbit(&streamed));
    let said = program::notes(&[&orbit(&scene)[..], &["--resume"]].concat());
    assert!(said.contains("nothing left to do"), "{said}");
    ok(&[&orbit(&streamed)[..], &["--verify"]].concat());
    let one_level = ["render", &streamed, "--sog-level", "0", "--splats", "6000", "-o", &a];
    assert!(fails(2, &one_level).contains("there are no levels of detail here"));
}
