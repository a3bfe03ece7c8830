//! `render --shard`: parts of a run that are drawn at the same time, killed, resumed and mixed.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::program::{fails, ok, path, smalto};

/// A camera file with `count` cameras, whose images are in two folders.
pub fn cameras(folder: &tempfile::TempDir, count: usize) -> String {
    let entry = |i: usize| {
        let z = -3.0 - 0.5 * i as f64;
        format!(
            r#"{{"id": {i}, "img_name": "side {}/{i}.jpg", "width": 32, "height": 24, "position": [0, -1.2, {z}],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 30, "fy": 30}}"#,
            i % 2
        )
    };
    let file = path(folder, "cams.json");
    fs::write(&file, format!("[{}]", (0..count).map(entry).collect::<Vec<_>>().join(","))).unwrap();
    file
}

/// Paths below a folder and the contents of the files, without records.
pub fn pictures(folder: impl AsRef<Path>) -> Vec<(String, Vec<u8>)> {
    let (mut found, mut open) = (Vec::new(), vec![folder.as_ref().to_owned()]);
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).unwrap().map(|entry| entry.unwrap().path()) {
            let name = entry.strip_prefix(folder.as_ref()).unwrap().display().to_string();
            if entry.is_dir() {
                open.push(entry);
            } else if !name.starts_with(".smalto-run") {
                found.push((name, fs::read(entry).unwrap()));
            }
        }
    }
    found.sort();
    found
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Succeeds, and returns what it remarked.
fn remarks(arguments: &[&str]) -> String {
    let output = smalto(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stderr)
}

/// Runs all shards at the same time.
fn at_once(arguments: &[&str], count: usize) {
    let run = |number: usize| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_smalto"));
        command.args(arguments).args(["--shard", &format!("{number}/{count}")]).stderr(Stdio::piped());
        command.stdout(Stdio::piped()).spawn().unwrap()
    };
    let runs: Vec<_> = (1..=count).map(run).collect();
    for run in runs {
        let output: Output = run.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
}

#[test]
fn shards_at_the_same_time_draw_what_one_run_draws() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, 7);
    let [whole, parts] = ["whole/", "parts/"].map(|name| path(&folder, name));
    for more in
        [&["--camera", "all", "--names", "image", "--layers", "colour,depth"][..], &["--camera", "6,1..4", "--video"]]
    {
        let render = |out| [&["render", "cactus:200", "--cameras", &file, "-o", out], more].concat();
        let printed = ok(&render(&whole));
        at_once(&render(&parts), 3);
        let expected = pictures(&whole);
        assert!(expected.len() >= 5 && expected == pictures(&parts), "{more:?}");
        assert_eq!(printed.contains("ffmpeg "), more.contains(&"--video"));
        let verified = ok(&[&render(&parts)[..], &["--verify"]].concat());
        assert!(verified.starts_with(&format!("all {} files are complete\n", expected.len())), "{verified}");
        assert_eq!(verified.contains("ffmpeg "), more.contains(&"--video"));
        let shard = ok(&[&render(&parts)[..], &["--shard", "2/3"]].concat());
        assert!(!shard.contains("ffmpeg "), "a part of a video is none: {shard}");
        [&whole, &parts].into_iter().for_each(|folder| fs::remove_dir_all(folder).unwrap());
    }
}

#[test]
fn a_killed_shard_is_resumed_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 9), path(&folder, "views/"));
    let render = ["render", "cactus:300", "--size", "320x240", "--reference", "--cameras", &file];
    let render = [&render[..], &["--camera", "all", "-o", &out]].concat();
    let shard = |number: &'static str| [&render[..], &["--shard", number, "--resume"]].concat();
    let mut first = Command::new(env!("CARGO_BIN_EXE_smalto"));
    let mut first = first.args(shard("1/2")).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    let record = folder.path().join("views/.smalto-run.1-of-2.jsonl");
    while fs::read_to_string(&record).unwrap_or_default().lines().count() < 3 {
        assert!(start.elapsed() < Duration::from_secs(60), "it completes a file");
        std::thread::sleep(Duration::from_millis(1));
    }
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(
        remarks(&shard("2/2")).contains(" 0 of 4 files have their recorded sizes"),
        "the other shard does not care"
    );
    let before = pictures(&out);
    let error = fails(6, &[&render[..], &["--verify"]].concat());
    assert!(error.contains(" of 9 files are wrong: ") && error.contains(" missing"), "{error}");
    let again = remarks(&shard("1/2"));
    assert!(again.contains(" of 5 files have their recorded sizes and are skipped"), "{again}");
    let after = pictures(&out);
    assert!(after.len() == 9 && before.iter().all(|picture| after.contains(picture)));
    assert!(remarks(&shard("1/2")).contains("nothing left to do, all 5 files have their recorded sizes"));
    assert_eq!(ok(&[&render[..], &["--verify"]].concat()), "all 9 files are complete\n");
}

#[test]
fn a_shard_that_runs_already_is_refused_and_others_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 4), path(&folder, "views/"));
    let render = ["render", "cactus:100", "--cameras", &file, "--camera", "all", "-o", &out, "--shard"];
    let shard = |number: &'static str, more: &[&'static str]| [&render[..], &[number], more].concat();
    ok(&shard("1/2", &[]));
    let record = fs::File::open(folder.path().join("views/.smalto-run.1-of-2.jsonl")).unwrap();
    record.lock().unwrap();
    assert!(fails(1, &shard("1/2", &["--resume"])).contains("another run of smalto is writing there"));
    // Files of others are no obstacle to --no-clobber, its own are.
    ok(&shard("2/2", &["--no-clobber"]));
    drop(record);
    assert!(fails(1, &shard("1/2", &["--no-clobber"])).contains("00000.png: it exists, and --no-clobber"));
    assert!(remarks(&shard("1/2", &["--no-clobber", "--resume"])).contains("nothing left to do"));
}

#[test]
fn what_is_complete_counts_for_other_numbers_of_shards_of_the_same_settings() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 7), path(&folder, "views/"));
    let render = ["render", "cactus:200", "--cameras", &file, "--camera", "all", "-o", &out];
    let run = |more: &[&'static str]| [&render[..], more].concat();
    remarks(&run(&["--shard", "1/3"]));
    let says = |more: &[&'static str], sentence: &str| {
        let said = remarks(&run(more));
        assert!(said.contains(sentence), "{more:?}: {said}");
    };
    // Cameras 0, 3 and 6 are there.
    says(&["--shard", "2/2", "--resume"], "1 of 3 files have their recorded sizes");
    says(&["--resume"], "5 of 7 files have their recorded sizes");
    says(&["--shard", "4/5", "--resume"], "nothing left to do, all 1 files");
    let black = pictures(&out);

    let other = ["--shard", "1/4", "--resume", "--background", "white"];
    let error = fails(2, &run(&other));
    assert!(error.contains("had other settings (background); run without --resume to start over"), "{error}");
    assert!(!folder.path().join("views/.smalto-run.1-of-4.jsonl").exists());
    let error = fails(2, &run(&["--shard", "1/3", "--resume", "--layers", "alpha"]));
    assert!(error.contains("had other settings (layers)"), "{error}");
    // A run that starts over leaves the records of the shards, which know their files by content.
    remarks(&run(&["--background", "white"]));
    assert!(pictures(&out).iter().zip(&black).all(|(white, black)| white != black));
    let output = smalto(&run(&["--verify"]));
    assert_eq!(output.status.code(), Some(6));
    assert_eq!(text(&output.stdout).matches("of other settings (background)").count(), 7);
    says(&["--shard", "1/3", "--resume"], "0 of 3 files have their recorded sizes");
    says(&["--shard", "1/3", "--resume"], "nothing left to do");
    let now = pictures(&out);
    assert!((0..7).all(|i| (now[i] == black[i]) == (i % 3 == 0)));

    // What no run drew is not taken.
    fs::remove_dir_all(&out).unwrap();
    fs::create_dir(&out).unwrap();
    fs::write(folder.path().join("views/00001.png"), "precious").unwrap();
    remarks(&run(&["--shard", "1/2", "--resume"]));
    assert!(fails(2, &run(&["--shard", "2/2", "--resume"])).contains("exists, but there is no record of a run"));
    assert_eq!(fs::read(folder.path().join("views/00001.png")).unwrap(), b"precious");
}

/// A run with other settings was stopped before it recorded what it wrote: the sizes of arrays do not tell.
#[test]
fn pictures_that_another_run_wrote_are_drawn_again() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 4), path(&folder, "views"));
    let render = ["render", "cactus:200", "--cameras", &file, "--camera", "all", "--format", "npy", "-o", &out];
    ok(&render);
    let whole = pictures(&out);
    ok(&[&render[..], &["--shard", "1/2", "--background", "white"]].concat());
    assert!(pictures(&out) != whole);
    let [own, other] = ["", ".1-of-2"].map(|shard| Path::new(&out).join(format!(".smalto-run{shard}.jsonl")));
    let settings = |record: &Path| fs::read_to_string(record).unwrap().lines().next().unwrap().to_owned() + "\n";
    for settings in [settings(&other), settings(&own)] {
        fs::write(&other, settings).unwrap();
        ok(&[&render[..], &["--resume"]].concat());
        assert!(pictures(&out) == whole);
        ok(&[&render[..], &["--shard", "1/2", "--background", "white"]].concat());
    }
}

/// A picture was written and its run killed before the record named it.
#[test]
fn a_picture_that_is_in_no_record_is_drawn_again() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 4), path(&folder, "views"));
    let render = ["render", "cactus:200", "--cameras", &file, "--camera", "all", "-o", &out];
    ok(&[&render[..], &["--shard", "1/2"]].concat());
    let whole = pictures(&out);
    let record = Path::new(&out).join(".smalto-run.1-of-2.jsonl");
    let text = fs::read_to_string(&record).unwrap();
    fs::write(&record, text.lines().next().unwrap().to_owned() + "\n").unwrap();
    ok(&[&render[..], &["--shard", "1/4", "--resume"]].concat());
    assert!(pictures(&out) == whole);
}

/// Shards of different machines may be written to their own folders, and merged with their records.
#[test]
fn folders_of_shards_can_be_merged() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, 3);
    let [merged, apart] = ["merged/", "apart/"].map(|name| path(&folder, name));
    let render = |out: &str, more: &[&str]| {
        ok(&[&["render", "cactus:100", "--cameras", &file, "--camera", "all", "-o", out], more].concat())
    };
    render(&merged, &["--shard", "1/2"]);
    render(&apart, &["--shard", "2/2"]);
    for entry in fs::read_dir(&apart).unwrap().map(|entry| entry.unwrap()) {
        fs::copy(entry.path(), Path::new(&merged).join(entry.file_name())).unwrap();
    }
    assert_eq!(render(&merged, &["--verify"]), "all 3 files are complete\n");
}

#[test]
fn a_shard_without_cameras_succeeds() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 3), path(&folder, "views/"));
    let render = ["render", "cactus:100", "--cameras", &file, "--camera", "all", "-o", &out, "--shard", "5/8"];
    for more in [&[][..], &["--resume"], &["--reference"]] {
        let said = remarks(&[&render[..], more].concat());
        assert_eq!(said, "smalto: note: --shard 5/8 has nothing to do: the number of cameras is 3\n");
    }
    assert!(pictures(&out).is_empty());
}

#[test]
fn wrong_shards_are_exit_code_2() {
    for wrong in ["0/3", "4/3", "1/0", "1", "text", "1/2/3"] {
        let error = fails(2, &["render", "cactus:10", "-o", "views/", "--shard", wrong]);
        assert_eq!(
            error,
            format!("smalto: --shard {wrong}: expected K/N, the shard K of N, with K from 1 to N, like 3/8\n")
        );
    }
    for (line, sentence) in [
        ("--shard 1/2 -o a.png", "--output a.png: several pictures, --names, --video, --resume, --shard and --verify"),
        ("--verify -o a.png", "need a folder"),
        ("--shard 1/2 -o views --dump buffers", "--shard cannot be combined with --dump"),
        ("--shard 1/2 -o views --max-error 0.1", "--shard cannot be combined with --max-error"),
        ("--verify -o views --resume", "--verify cannot be combined with --resume"),
    ] {
        let error = fails(2, &[&["render", "cactus:10"], &line.split(' ').collect::<Vec<_>>()[..]].concat());
        assert!(error.contains(sentence), "{line}: {error}");
    }
}
