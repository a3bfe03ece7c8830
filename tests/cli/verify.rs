//! `render --verify`: what is missing or wrong is found without a device, and mostly without the scene.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::shards::cameras;
use crate::common::program::{fails, ok, path, run};

const PLUSH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/plush.ply");

/// Exit code, standard output and standard error of a command that finds no device.
fn without_device(arguments: &[&str]) -> (i32, String, String) {
    let output = run(arguments, |command| _ = command.env("SMALTO_DEVICE", "no such device"));
    let [out, error] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code().unwrap(), out, error)
}

fn flip(file: impl AsRef<Path>) {
    let mut bytes = fs::read(&file).unwrap();
    let last = bytes.len() - 30;
    bytes[last] ^= 1;
    fs::write(file, bytes).unwrap();
}

#[test]
fn every_kind_of_damage_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 8), path(&folder, "views"));
    let render = ["render", "cactus:200", "--cameras", &file, "--camera", "all", "--layers", "colour,depth"];
    let render = [&render[..], &["--background", "grey", "-o", &out]].concat();
    let verify = [&render[..], &["--verify"]].concat();
    let (code, _, error) = without_device(&verify);
    assert_eq!(code, 6);
    assert!(error.ends_with("16 of 16 files are wrong: 16 missing; --resume draws them\n"));
    assert!(!Path::new(&out).exists(), "nothing is made");

    ok(&[&render[..], &["--shard", "2/2"]].concat());
    ok(&[&render[..], &["--shard", "1/2"]].concat());
    assert_eq!(without_device(&verify), (0, "all 16 files are complete\n".to_owned(), String::new()));

    let colour = |i: usize| format!("{out}/colour/{i:05}.png");
    let depth = |i: usize| format!("{out}/depth/{i:05}.exr");
    fs::remove_file(colour(0)).unwrap();
    let half = fs::read(colour(1)).unwrap();
    fs::write(colour(1), &half[..half.len() / 2]).unwrap();
    flip(colour(2));
    flip(depth(2));
    ok(&["render", "cactus:200", "--size", "9x7", "-o", &colour(3)]);
    // Another picture of the same size in pixels, of which no record knows.
    fs::copy(colour(7), colour(4)).unwrap();
    let other = ["render", "cactus:200", "--cameras", &file, "--layers", "colour,depth", "-o", &out, "--camera", "5,5"];
    assert!(fails(2, &other).contains("would both be written"));
    ok(&[&other[..8], &["--camera", "5..5"]].concat());

    let (code, lines, error) = without_device(&verify);
    assert_eq!(code, 6);
    let expected = [
        (colour(0), "missing".to_owned()),
        (colour(1), format!("truncated: {} of {} bytes", half.len() / 2, half.len())),
        (colour(2), "damaged: cannot be decoded".to_owned()),
        (depth(2), "damaged: ".to_owned()),
        (colour(3), "of 9x7 pixels, not 32x24".to_owned()),
        (colour(4), "damaged: its bytes are not those that were written".to_owned()),
        (colour(5), "of other settings (".to_owned()),
        // Its depths do not depend on the background and are the same.
    ];
    for (line, (file, problem)) in lines.lines().zip(&expected) {
        assert!(line.starts_with(&format!("{file}: {problem}")), "{line}");
    }
    assert_eq!(lines.lines().count(), expected.len(), "{lines}");
    let summary = "smalto: 7 of 16 files are wrong: 1 missing, 1 truncated, 3 damaged, 1 of another size, \
         1 of other settings; remove them, and --resume draws them again\n";
    assert_eq!(error, summary);

    let report = path(&folder, "report.json");
    let (code, printed, _) = without_device(&[&verify[..], &["--json", &report]].concat());
    assert_eq!((code, printed), (6, lines));
    let report: Value = serde_json::from_str(&fs::read_to_string(report).unwrap()).unwrap();
    assert_eq!((&report["format"], &report["files"]), (&"smalto verify 1".into(), &16.into()));
    let wrong = report["wrong"].as_array().unwrap();
    let problems: Vec<_> = wrong.iter().map(|file| file["problem"].as_str().unwrap()).collect();
    let expected = ["missing", "truncated", "damaged", "damaged", "size", "damaged", "settings"];
    assert_eq!(problems, expected);
    assert_eq!((&wrong[3]["layer"], &wrong[3]["camera"]), (&"depth".into(), &2.into()));

    // The advice of the summary.
    wrong.iter().for_each(|file| _ = fs::remove_file(file["path"].as_str().unwrap()));
    for shard in ["1/2", "2/2"] {
        ok(&[&render[..], &["--resume", "--shard", shard]].concat());
    }
    assert_eq!(without_device(&verify).0, 0);
    // A file that no record names, and a shard alone.
    fs::remove_file(format!("{out}/.smalto-run.2-of-2.jsonl")).unwrap();
    let (_, lines, error) = without_device(&verify);
    assert!(lines.contains("00001.png: in no record of these settings"), "{lines}");
    assert!(error.contains("8 of 16 files are wrong: "), "{error}");
    assert_eq!(without_device(&[&verify[..], &["--shard", "1/2"]].concat()).1, "all 8 files are complete\n");
}

/// A scene file with the same name, size and time is taken to be the same; otherwise its Gaussians are compared.
#[test]
fn the_scene_is_read_only_if_its_file_changed() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out, scene) = (cameras(&folder, 2), path(&folder, "views"), path(&folder, "scene.ply"));
    fs::copy(PLUSH, &scene).unwrap();
    let render = ["render", &scene, "--cameras", &file, "--camera", "all", "-o", &out];
    let verify = [&render[..], &["--verify"]].concat();
    ok(&render);
    let (original, modified) = (fs::read(&scene).unwrap(), fs::metadata(&scene).unwrap().modified().unwrap());
    let replace = |content: &[u8], age: u64| {
        fs::write(&scene, content).unwrap();
        let time = modified + std::time::Duration::from_secs(age);
        fs::File::options().append(true).open(&scene).unwrap().set_modified(time).unwrap();
    };
    replace(&vec![b'x'; original.len()], 0);
    assert_eq!(without_device(&verify), (0, "all 2 files are complete\n".to_owned(), String::new()));
    replace(&vec![b'x'; original.len()], 10);
    assert_eq!(without_device(&verify).0, 4);
    replace(&original, 10);
    assert_eq!(without_device(&verify).0, 0);
    let mut moved = original;
    let last = moved.len() - 1;
    moved[last] ^= 1;
    replace(&moved, 20);
    let (code, lines, _) = without_device(&verify);
    assert_eq!((code, lines.matches("of other settings (scene)").count()), (6, 2), "{lines}");
    // Cameras that are made from the scene need it, and settings of the reference are its own.
    let turn = ["render", &scene, "--orbit", "3", "--size", "8x8", "--reference", "-o", &out];
    ok(&turn);
    assert_eq!(without_device(&[&turn[..], &["--verify"]].concat()).0, 0);
    let (_, lines, _) = without_device(&[&turn[..6], &["--verify", "-o", &out]].concat());
    assert!(lines.contains("00000.png: of other settings (") && lines.contains("reference"), "{lines}");
}

#[test]
fn the_reference_of_a_lower_degree_is_of_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 2), path(&folder, "views"));
    let render = ["render", "cactus:200", "--cameras", &file, "--camera", "all", "--reference", "--sh-degree", "0"];
    ok(&[&render[..], &["-o", &out]].concat());
    assert_eq!(ok(&[&render[..], &["-o", &out, "--verify"]].concat()), "all 2 files are complete\n");
}
