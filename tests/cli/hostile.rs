//! Hostile surroundings: pipes without an end, huge files, links in the way, signals, full devices and disks. The
//! script `tests/hostile.py` tries more of them at random moments.

use std::fs::{self, File};
use std::io::Write;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::program::{fails, fails_within, path, run};

const BIN: &str = env!("CARGO_BIN_EXE_smalto");

fn error_of(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).unwrap().next().is_none()
}

fn signal(name: &str, process: u32) {
    assert!(Command::new("kill").args(["-s", name, &process.to_string()]).status().unwrap().success());
}

#[test]
fn a_pipe_without_an_end_is_refused_at_its_first_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for (script, expected) in [
        ("\"$0\" info - < /dev/zero", "standard input: not a scene that smalto reads: expected .ply"),
        ("\"$0\" info - < /dev/null", "standard input: the file is empty"),
        ("yes '{' | \"$0\" info -", "standard input: JSON names other files of the scene"),
        ("\"$0\" info <(yes)", "not a scene that smalto reads"),
    ] {
        let limited = format!("ulimit -t 10; {script}");
        let output = Command::new("bash").args(["-c", &limited, BIN]).env("TMPDIR", folder.path()).output().unwrap();
        let error = error_of(&output);
        assert!(output.status.code() == Some(4) && error.contains(expected), "{script}: {error}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_scene_from_a_pipe_leaves_nothing_in_the_folder_of_temporary_files() {
    let folder = tempfile::tempdir().unwrap();
    // Under nohup, HUP is ignored.
    let mut command = Command::new("env");
    command
        .args(["--default-signal=TERM,HUP", BIN, "info", "-"])
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .env("TMPDIR", folder.path());
    for name in ["TERM", "HUP", "KILL"] {
        let mut child = command.spawn().unwrap();
        let mut stdin = child.stdin.take().unwrap();
        stdin.write_all(b"ply\n").unwrap();
        // A pipe holds 64 KiB, so most of these bytes are copied.
        stdin.write_all(&vec![b' '; 1 << 20]).unwrap();
        assert!(is_empty(folder.path()));
        signal(name, child.id());
        assert_eq!(child.wait().unwrap().code(), None);
        assert!(is_empty(folder.path()), "{name}");
    }
}

#[test]
fn files_beside_a_scene_are_not_read_if_they_are_huge() {
    let folder = tempfile::tempdir().unwrap();
    let huge = path(&folder, "huge.json");
    File::create(&huge).unwrap().set_len(10 << 30).unwrap();
    let out = path(&folder, "a.png");
    for arguments in [
        ["render", "cactus:10", "-o", &out, "--cameras", &huge],
        ["render", "cactus:10", "-o", &out, "--place", &huge],
        ["bench", "cactus:10", "--size", "8x8", "--baseline", &huge],
    ] {
        let error = fails_within("-t 10", 4, &arguments);
        assert!(error.contains("huge.json: has 10737418240 bytes, at most 268435456 are read"), "{error}");
    }
}

#[test]
fn names_that_the_program_chooses_follow_no_links() {
    let folder = tempfile::tempdir().unwrap();
    let (victim, out) = (folder.path().join("victim"), folder.path().join("out"));
    let is_safe = || fs::read_to_string(&victim).unwrap() == "precious";
    fs::write(&victim, "precious").unwrap();
    fs::create_dir(&out).unwrap();
    let record = out.join(".smalto-run.jsonl");
    symlink(&victim, &record).unwrap();
    let out_text = out.display().to_string();
    let render = ["render", "cactus:10", "--orbit", "2", "--size", "8x8", "-o", &out_text];
    let error = fails(1, &render);
    assert!(error.contains(".smalto-run.jsonl: is a symbolic link, which is not followed") && is_safe(), "{error}");
    // A FIFO is no record, either, and does not make the program wait.
    fs::remove_file(&record).unwrap();
    assert!(Command::new("mkfifo").arg(&record).status().unwrap().success());
    let error = fails(1, &[&render[..], &["--resume"]].concat());
    assert!(error.contains(".smalto-run.jsonl: is not a file"), "{error}");

    let unfinished = folder.path().join(".a.smalto.unfinished");
    fs::create_dir(&unfinished).unwrap();
    fs::write(unfinished.join("unfinished"), "").unwrap();
    let output = folder.path().join("a.smalto").display().to_string();
    // What is not part of an earlier run is removed, but not what it leads to.
    for name in ["scene", "state.json", "header", "pages"] {
        symlink(&victim, unfinished.join(name)).unwrap();
    }
    let ended = run(&["lod", "cactus:5000", "-o", &output], |_| {});
    assert!(
        is_safe() && (ended.status.success() || error_of(&ended).contains("symbolic link")),
        "{}",
        error_of(&ended)
    );
}

#[test]
fn a_damaged_record_is_an_unreadable_report() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "out");
    fs::create_dir(&out).unwrap();
    fs::write(format!("{out}/.smalto-run.jsonl"), "garbage\n").unwrap();
    let error = fails(4, &["render", "cactus:10", "--orbit", "2", "--size", "8x8", "-o", &out, "--resume"]);
    assert!(error.contains("is damaged: run without --resume to start over"), "{error}");
}

/// This ffmpeg writes to its output when its input has ended, which is after the program has removed the file.
#[test]
fn an_interrupted_video_leaves_nothing() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (bin, films) = (folder.path().join("bin"), folder.path().join("films"));
    fs::create_dir(&bin).unwrap();
    fs::create_dir(&films).unwrap();
    let ended = folder.path().join("ended");
    let script = "#!/bin/bash\n[ \"$1\" = -version ] && exit 0\ntrap '' INT TERM HUP\ncat > /dev/null\nsleep 0.2\n\
        echo late > \"${@: -1}\"\ntouch \"$ENDED\"\n";
    fs::write(bin.join("ffmpeg"), script).unwrap();
    fs::set_permissions(bin.join("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    let search = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let video = films.join("v.mp4").display().to_string();
    for name in ["INT", "TERM", "HUP"] {
        _ = fs::remove_file(&ended);
        let mut command = Command::new("env");
        command.args(["--default-signal=INT,TERM,HUP", BIN, "render", "cactus:500", "--orbit", "100000", "--size"]);
        command.args(["8x8", "--video", &video]).env("PATH", &search).env("ENDED", &ended);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let started = Instant::now();
        let wait = |is_so: &dyn Fn() -> bool| {
            while !is_so() {
                assert!(started.elapsed() < Duration::from_secs(60), "{name}");
                std::thread::sleep(Duration::from_millis(20));
            }
        };
        wait(&|| !is_empty(&films));
        std::thread::sleep(Duration::from_millis(300));
        signal(name, child.id());
        child.wait().unwrap();
        wait(&|| ended.exists());
        assert!(is_empty(&films), "{name}");
    }
}

#[test]
fn help_to_a_full_device_is_a_failure() {
    for option in ["--help", "--version", "render -h"] {
        let script = format!("\"$0\" {option} > /dev/full");
        let output = Command::new("sh").args(["-c", &script, BIN]).output().unwrap();
        let error = error_of(&output);
        assert_eq!(
            (output.status.code(), error.contains("cannot write to standard output: ")),
            (Some(1), true),
            "{error}"
        );
        assert!(!error.contains("os error"), "{error}");
    }
}

/// A reader of text may have enough; a part of a scene is of no use.
#[test]
fn a_scene_that_its_reader_does_not_take_is_a_failure() {
    let script = "\"$0\" convert cactus:20000 - --format ply | head -c 10 > /dev/null; echo ${PIPESTATUS[0]}";
    let output = Command::new("bash").args(["-c", script, BIN]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), "1\n");
    assert!(error_of(&output).contains("its reader has closed it"), "{}", error_of(&output));
}

#[test]
fn control_characters_of_names_are_escaped() {
    let folder = tempfile::tempdir().unwrap();
    let name = std::ffi::OsStr::from_bytes(b"\x1b[31m\n\xff.png");
    let output = run(&["render", "cactus:10", "--size", "8x8", "--json", "report", "-o"], |command| {
        command.arg(name).current_dir(folder.path());
    });
    let shown = String::from_utf8_lossy(&output.stdout);
    assert!(shown.starts_with("\\u{1b}[31m\\n") && shown.lines().count() == 1, "{shown}");
    assert!(folder.path().join(name).exists());
    let report: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("report")).unwrap()).unwrap();
    assert_eq!(report["frames"][0]["files"][0]["path"], "\u{1b}[31m\n\\xff.png");
    let error = error_of(&run(&["info", "no\u{1b}[31m.ply"], |_| {}));
    assert!(error.starts_with("smalto: no\\u{1b}[31m.ply: "), "{error}");
}

#[test]
fn lines_of_views_are_in_the_order_of_the_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "out");
    let output = run(&["render", "cactus:1000", "--orbit", "24", "--size", "40x30", "-o", &out], |_| {});
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let names: Vec<_> =
        text.lines().filter_map(|line| line.split("  ").next()).filter(|n| n.ends_with("png")).collect();
    assert!(names.len() == 24 && names.is_sorted(), "{text}");
}

#[test]
fn a_relative_folder_of_caches_is_not_made() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(&["render", "cactus:10", "--size", "8x8", "-o", "a.png"], |command| {
        command.current_dir(folder.path()).env("XDG_CACHE_HOME", "relative").env("HOME", env!("CARGO_TARGET_TMPDIR"));
    });
    assert!(output.status.success(), "{}", error_of(&output));
    assert!(!folder.path().join("relative").exists());
}

#[test]
#[ignore = "needs unshare and the right to mount in a namespace"]
fn a_full_folder_of_caches_is_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let script = "mount -t tmpfs -o size=300k none \"$1\" && { cat /dev/zero > \"$1/all\"; \
        XDG_CACHE_HOME=\"$1\" exec \"$0\" doctor; }";
    let output = Command::new("unshare").args(["-rm", "sh", "-c", script, BIN]).arg(folder.path()).output().unwrap();
    let error = error_of(&output);
    assert!(output.status.success() && error.contains("there is no free space in"), "{error}");
    assert!(error.contains("drivers cache no shaders"), "{error}");
}
