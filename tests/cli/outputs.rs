//! What is written: whole or not at all, into what is there, with its mode, and without leavings.

use std::fs;
use std::io::Read;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::program::{fails, limit, ok, path, run, smalto};
use smalto::formats;

const PLUSH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/plush.ply");

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Names in a folder, in order.
fn names(folder: impl AsRef<Path>) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<_> = entries.collect();
    names.sort();
    names
}

/// A shell command in which $0 is the program and $1 and so on are `arguments`.
fn shell(script: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new("bash");
    command.args(["-c", script, env!("CARGO_BIN_EXE_smalto")]).args(arguments).env("SMALTO_VALIDATION", "1");
    command.output().unwrap()
}

/// Waits until `is_so`, for a minute at most.
fn wait(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn make_fifo(path: &str) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

#[test]
fn a_fifo_is_written_through() {
    let folder = tempfile::tempdir().unwrap();
    let [fifo, file] = ["fifo.png", "file.png"].map(|name| path(&folder, name));
    make_fifo(&fifo);
    let render = |out: &str| ok(&["render", "cactus:100", "--size", "16x12", "-o", out]);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| fs::read(&fifo).unwrap());
        render(&fifo);
        render(&file);
        assert_eq!(reader.join().unwrap(), fs::read(&file).unwrap());
    });
    assert!(fs::symlink_metadata(&fifo).unwrap().file_type().is_fifo());
    // Scenes are read back before they are copied.
    let fifo = path(&folder, "fifo.splat");
    make_fifo(&fifo);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| fs::read(&fifo).unwrap());
        ok(&["convert", PLUSH, &fifo]);
        assert_eq!(reader.join().unwrap().len(), 61 * 32);
    });
    assert_eq!(names(&folder), ["fifo.png", "fifo.splat", "file.png"]);
}

/// Where nodes can be made, a node of its own; everywhere, the device through a link.
#[test]
fn a_device_stays_a_device() {
    let folder = tempfile::tempdir().unwrap();
    let [node, link] = ["null.ply", "link.json"].map(|name| path(&folder, name));
    if Command::new("mknod").args([&node, "c", "1", "3"]).stderr(Stdio::null()).status().unwrap().success() {
        ok(&["convert", PLUSH, &node]);
        assert!(fs::metadata(&node).unwrap().file_type().is_char_device());
    }
    symlink("/dev/null", &link).unwrap();
    ok(&["info", PLUSH, "--json", &link]);
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    let error = fails(1, &["convert", PLUSH, "/dev/full", "--format", "ply"]);
    assert_eq!(error, "smalto: cannot write /dev/full: No space left on device\n");
}

#[test]
fn the_target_of_a_link_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let below = folder.path().join("below");
    fs::create_dir(&below).unwrap();
    let [link, second] = ["link.ply", "second.ply"].map(|name| folder.path().join(name));
    symlink("below/target.ply", &second).unwrap();
    symlink("second.ply", &link).unwrap();
    let target = below.join("target.ply");
    for before in [None, Some("old")] {
        _ = fs::remove_file(&target);
        before.map_or(Ok(()), |text| fs::write(&target, text)).unwrap();
        ok(&["convert", PLUSH, link.to_str().unwrap()]);
        assert!([&link, &second].iter().all(|link| fs::symlink_metadata(link).unwrap().is_symlink()));
        assert_eq!(formats::read(&target).unwrap().gaussians.len(), 61);
        assert_eq!(names(&below), ["target.ply"]);
    }
    let [a, b] = ["a.ply", "b.ply"].map(|name| path(&folder, name));
    symlink(&a, &b).unwrap();
    symlink(&b, &a).unwrap();
    assert!(fails(1, &["convert", PLUSH, &a]).contains("a circle of symbolic links"));
}

#[test]
fn a_replaced_file_keeps_its_mode_and_owner() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.ply");
    fs::write(&out, "old").unwrap();
    fs::set_permissions(&out, fs::Permissions::from_mode(0o640)).unwrap();
    // Only root may give a file away.
    let is_given = std::os::unix::fs::chown(&out, Some(1234), Some(4321)).is_ok();
    ok(&["convert", PLUSH, &out]);
    let data = fs::metadata(&out).unwrap();
    assert!(data.len() > 3);
    assert_eq!(data.mode() & 0o7777, 0o640);
    if is_given {
        assert_eq!((data.uid(), data.gid()), (1234, 4321));
    }
}

#[test]
fn a_read_only_file_is_refused_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.png");
    fs::write(&out, "precious").unwrap();
    fs::set_permissions(&out, fs::Permissions::from_mode(0o444)).unwrap();
    let error = fails(1, &["render", "cactus:100", "--size", "8x8", "-o", &out]);
    assert_eq!(error, format!("smalto: cannot write {out}: it is read-only: remove it or make it writable first\n"));
    assert_eq!(fs::read(&out).unwrap(), b"precious");
}

#[test]
fn standard_output_and_descriptors_take_pictures_and_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let png = path(&folder, "a.png");
    let render = ["render", "cactus:100", "--size", "16x12", "-o"];
    ok(&[&render[..], &[&png]].concat());
    let png = fs::read(png).unwrap();
    for out in ["-", "/dev/stdout", "/proc/self/fd/1"] {
        let output = smalto(&[&render[..], &[out, "--format", "png"]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert!(output.stdout == png, "{out}: nothing but the picture is printed");
    }
    // A shell's redirection keeps what it holds.
    let file = path(&folder, "mix");
    let script = "(echo a; \"$0\" convert \"$1\" /dev/stdout --format spz; echo b) > \"$2\"";
    assert!(shell(script, &[PLUSH, &file]).status.success());
    let mix = fs::read(&file).unwrap();
    assert!(mix.starts_with(b"a\nNGSP") && mix.ends_with(b"b\n"));
    let script = "\"$0\" convert \"$1\" >(cat > \"$2\") --format ply; wait $!";
    assert!(shell(script, &[PLUSH, &file]).status.success());
    wait("the process behind the substitution is done", || fs::read(&file).unwrap().starts_with(b"ply"));

    for (code, arguments, sentence) in [
        (2, &["convert", PLUSH, "-"][..], "add --format"),
        (2, &["convert", PLUSH, "-", "--format", "ply", "--json", "-"], "standard output"),
        (2, &["convert", PLUSH, "/dev/stdout", "--format", "ply", "--json", "-"], "cannot both go to standard output"),
        (2, &["convert", PLUSH, "a.ply", "--format", "spz"], "has the name of another format"),
        (2, &[&render[..], &["-"]].concat(), "add --format"),
        (2, &[&render[..], &["-", "--format", "png", "--layers", "colour,depth"]].concat(), "several layers need"),
        (2, &[&render[..], &["-", "--format", "png", "--video"]].concat(), "need a folder"),
    ] {
        assert!(fails(code, arguments).contains(sentence), "{arguments:?}");
    }
    assert_eq!(names(&folder), ["a.png", "mix"]);
}

/// A limit of the size of a file, in KiB, has the errors of a full disk in the midst of every encoder.
#[test]
fn a_full_disk_is_one_sentence_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let limited = |arguments: &[&str]| run(arguments, |command| limit(command, "-f 1"));
    let refuses = |out: &str, output: Output| {
        let error = text(&output.stderr);
        let last = error.lines().last().unwrap_or_default();
        assert_eq!((last, output.status.code()), (&*format!("smalto: cannot write {out}: File too large"), Some(1)));
        let only_notes = error.lines().filter(|line| !line.starts_with("smalto: warning: ")).count() == 1;
        assert!(only_notes, "{error}");
    };
    for ending in ["sog", "glb", "ply", "compressed.ply", "splat", "spz"] {
        let out = path(&folder, &format!("a.{ending}"));
        refuses(&out, limited(&["convert", PLUSH, &out]));
    }
    for ending in ["png", "exr", "npy"] {
        let out = path(&folder, &format!("a.{ending}"));
        refuses(&out, limited(&["render", "cactus:500", "--size", "200x200", "-o", &out]));
    }
    let [depth, counts] = ["a.exr", "a.counts.exr"].map(|name| path(&folder, name));
    let render = ["render", "cactus:500", "--size", "200x200", "-o", &depth, "--layers", "counts"];
    refuses(&depth, limited(&render));
    assert!(!Path::new(&counts).exists());
    assert_eq!(names(&folder), [""; 0]);
}

/// The textures of a SOG in a folder have other sizes than those of another SOG with as many Gaussians, so some fit
/// where others do not.
#[test]
fn a_sog_folder_is_replaced_as_a_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let meta = path(&folder, "s/meta.json");
    ok(&["convert", PLUSH, &meta]);
    let old = names(folder.path().join("s"));
    assert_eq!(old[..2], ["means_l.webp", "means_u.webp"]);
    let read = || formats::read(Path::new(&meta)).unwrap().gaussians;
    let (plush, cactus) = (read(), ["convert", "cactus:3000", &meta]);
    let content = |name: &String| fs::read(folder.path().join("s").join(name)).unwrap();
    let before: Vec<_> = old.iter().map(content).collect();
    // From no file that fits to all but one.
    for blocks in [0, 4, 9, 11, 12] {
        let output = run(&cactus, |command| limit(command, &format!("-f {blocks}")));
        let error = text(&output.stderr);
        assert!(error.ends_with("File too large\n") && error.lines().count() == 1, "{blocks}: {error}");
        assert_eq!(names(folder.path().join("s")), old);
        assert!(old.iter().map(content).eq(before.iter().cloned()));
    }
    ok(&cactus);
    let replaced = names(folder.path().join("s"));
    assert!(replaced.len() == old.len() && replaced[0] == "means_l.1.webp", "{replaced:?}");
    assert!(read().len() > 2000);
    // And back, to the names of the specification.
    ok(&["convert", PLUSH, &meta]);
    assert_eq!(names(folder.path().join("s")), old);
    assert!(read() == plush);
    // What no meta.json names is not ours to remove, and its names are not taken.
    let new = path(&folder, "other/meta.json");
    fs::create_dir(folder.path().join("other")).unwrap();
    fs::write(folder.path().join("other/sh0.webp"), "a photograph").unwrap();
    ok(&["convert", PLUSH, &new]);
    assert_eq!(fs::read(folder.path().join("other/sh0.webp")).unwrap(), b"a photograph");
    assert_eq!(names(folder.path().join("other")).len(), old.len() + 1);
    // A failure leaves no folder that it made.
    let out = path(&folder, "new/deep/meta.json");
    let output = run(&["convert", PLUSH, &out], |command| limit(command, "-f 0"));
    assert_eq!(output.status.code(), Some(1));
    assert!(!folder.path().join("new").exists());
}

#[test]
fn a_scene_is_not_converted_onto_itself() {
    let folder = tempfile::tempdir().unwrap();
    let [place, meta] = ["s", "s/meta.json"].map(|name| path(&folder, name));
    ok(&["convert", PLUSH, &meta]);
    let with_slash = format!("{place}/");
    let link = path(&folder, "link");
    symlink(&place, &link).unwrap();
    for input in [&place, &meta, &with_slash, &link] {
        assert!(fails(2, &["convert", input, &meta]).contains("is both an input and the output"), "{input}");
    }
    let ply = folder.path().join("model/point_cloud/iteration_7/point_cloud.ply");
    fs::create_dir_all(ply.parent().unwrap()).unwrap();
    fs::copy(PLUSH, &ply).unwrap();
    let error = fails(2, &["convert", &path(&folder, "model"), ply.to_str().unwrap()]);
    assert!(error.contains("is both an input and the output"), "{error}");
}

#[test]
fn a_folder_that_is_being_written_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let meta = path(&folder, "s/meta.json");
    ok(&["convert", PLUSH, &meta]);
    let lock = fs::File::open(folder.path().join("s")).unwrap();
    lock.lock().unwrap();
    assert!(fails(1, &["convert", "cactus:100", &meta]).contains("s: another run of smalto is writing there"));
}

#[test]
fn no_clobber_keeps_what_exists() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, png, meta, views] = ["a.ply", "a.png", "meta.json", "views"].map(|name| path(&folder, name));
    let convert = |out: &str| smalto(&["convert", PLUSH, out, "--no-clobber"]);
    let render = |more: &[&str]| smalto(&[&["render", "cactus:100", "--size", "8x8", "--no-clobber"], more].concat());
    let refuses = |out: &str, output: Output| {
        let expected = format!("smalto: cannot write {out}: it exists, and --no-clobber keeps what exists\n");
        assert_eq!((text(&output.stderr), output.status.code()), (expected, Some(1)));
    };
    for out in [&ply, &meta] {
        assert!(convert(out).status.success());
        let before = fs::read(out).unwrap();
        refuses(out, convert(out));
        assert_eq!(fs::read(out).unwrap(), before);
    }
    assert!(convert("/dev/null").status.code() == Some(2), "the name says no format");
    assert!(smalto(&["convert", PLUSH, "/dev/null", "--format", "ply", "--no-clobber"]).status.success());
    assert!(render(&["-o", &png]).status.success());
    refuses(&png, render(&["-o", &png]));
    let bound = path(&folder, "bound.exr");
    fs::write(&bound, "old").unwrap();
    refuses(&bound, render(&["-o", &path(&folder, "b.png"), "--certificate", &bound]));
    // In a folder, the pictures of a run that is resumed are its own.
    fs::create_dir(&views).unwrap();
    let folder_run = ["-o", &format!("{views}/")];
    assert!(render(&folder_run).status.success());
    refuses(&format!("{views}/00000.png"), render(&folder_run));
    assert!(render(&[&folder_run[..], &["--resume"]].concat()).status.success());
}

/// Begins a command, sends it a signal once it has begun a file, and returns how it ended.
fn interrupted(signal: &str, arguments: &[&str], folder: &Path) -> Output {
    // A test that runs in the background has SIGINT ignored, and so would the program.
    let mut command = Command::new("env");
    command.args(["--default-signal=INT,TERM,HUP", env!("CARGO_BIN_EXE_smalto")]);
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    wait("it begins a file", || {
        names(folder).iter().any(|name| name.starts_with(".smalto-") && name.contains(".part"))
    });
    assert!(Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap().success());
    child.wait_with_output().unwrap()
}

#[test]
fn a_signal_ends_the_program_and_leaves_no_part_of_a_file() {
    use std::os::unix::process::ExitStatusExt;
    let folder = tempfile::tempdir().unwrap();
    let sog = path(&folder, "a.sog");
    fs::write(&sog, "old").unwrap();
    for (signal, number) in [("INT", 2), ("TERM", 15), ("HUP", 1)] {
        // The palette of a SOG takes seconds.
        let output = interrupted(signal, &["convert", "cactus:60000", &sog], folder.path());
        assert_eq!(output.status.signal(), Some(number), "{}", text(&output.stderr));
        assert_eq!(text(&output.stderr), "");
        assert_eq!(names(&folder), ["a.sog"], "{signal}");
        assert_eq!(fs::read(&sog).unwrap(), b"old");
    }
}

/// What nohup asks for.
#[test]
fn an_ignored_signal_stays_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.sog");
    let script = "trap '' HUP; \"$0\" convert cactus:8000 \"$1\" & \
        until ls -A \"$2\" | grep -q part; do sleep 0.01; done; kill -HUP $!; wait $!";
    let output = shell(script, &[&out, folder.path().to_str().unwrap()]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(names(&folder), ["a.sog"]);
}

/// The record of a run is locked while the run lasts.
#[test]
fn a_second_run_into_a_folder_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let views = format!("{}/", path(&folder, "views"));
    let render = ["render", "cactus:100", "--size", "8x8", "-o", &views];
    ok(&render);
    let record = fs::File::open(folder.path().join("views/.smalto-run.jsonl")).unwrap();
    record.lock().unwrap();
    let error = fails(1, &render);
    assert!(error.contains("views/: another run of smalto is writing there"), "{error}");
    drop(record);
    ok(&render);
    // A run that was killed has no lock any more.
    let slow = ["render", "cactus:100", "--size", "3000x3000", "--reference", "-o", &views];
    let begun = fs::metadata(folder.path().join("views/.smalto-run.jsonl")).unwrap().len();
    let mut first = Command::new(env!("CARGO_BIN_EXE_smalto")).args(slow).stderr(Stdio::null()).spawn().unwrap();
    let record = || fs::File::open(folder.path().join("views/.smalto-run.jsonl")).unwrap();
    wait("it has the lock", || record().try_lock().is_err());
    assert_eq!(smalto(&render).status.code(), Some(1));
    first.kill().unwrap();
    first.wait().unwrap();
    let output = smalto(&render);
    assert!(output.status.success() && text(&output.stderr).contains("starting over"), "{}", text(&output.stderr));
    assert_eq!(fs::metadata(folder.path().join("views/.smalto-run.jsonl")).unwrap().len(), begun);
}

#[test]
fn a_terminal_gets_no_pictures() {
    let script = "script -qec \"$0 render cactus:100 --size 8x8 -o - --format png\" /dev/null < /dev/null";
    if shell("command -v script", &[]).status.success() {
        let output = shell(script, &[]);
        assert!(text(&output.stdout).contains("which a terminal cannot show"), "{}", text(&output.stdout));
        assert_eq!(output.status.code(), Some(1));
    }
}

/// Bytes that arrive before the picture is complete would be lost on a failure.
#[test]
fn a_pipe_gets_a_complete_picture_or_nothing() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_smalto"));
    child.args(["render", "no/such.ply", "-o", "-", "--format", "npy"]).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = child.spawn().unwrap();
    let mut bytes = Vec::new();
    child.stdout.take().unwrap().read_to_end(&mut bytes).unwrap();
    assert_eq!((child.wait().unwrap().code(), bytes.len()), (Some(4), 0));
    let output = run(&["render", "cactus:100", "--size", "8x8", "-o", "-", "--format", "npy"], |_| {});
    assert!(output.stdout.starts_with(b"\x93NUMPY"));
}
