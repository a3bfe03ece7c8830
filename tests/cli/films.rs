//! Many pictures at once: the same files as drawn one by one, on one device or several.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::shards::pictures;
use crate::common::program::{fails, notes, ok, path, run};

const SCENE: [&str; 4] = ["render", "cactus:2000", "--orbit", "7"];

#[test]
fn files_of_a_film_are_those_of_single_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let film = path(&folder, "film.json");
    // A film of a standing camera, a turned one and one of another size.
    let frame = |x: f64, w: u32| {
        format!(
            r#"{{"id": 0, "img_name": "a", "width": {w}, "height": 30, "position": [{x}, -1, -4],
                "rotation": [[1,0,0],[0,1,0],[0,0,1]], "fx": 40, "fy": 40}}"#
        )
    };
    let frames = [frame(0.0, 41), frame(0.5, 41), frame(1.0, 64), frame(-2.0, 17)].join(",");
    fs::write(&film, format!("[{frames}]")).unwrap();
    for (i, options) in [
        "--layers colour,alpha,depth,median-depth,counts",
        "--layers colour,alpha --format png16",
        "--layers colour,depth --portable",
        "--layers colour,alpha --format exr --compression small",
        "--layers alpha,counts --format npy",
        "--background transparent",
        "--background transparent --format exr",
        "--compression small --background white",
    ]
    .into_iter()
    .enumerate()
    {
        let options: Vec<&str> = options.split(' ').collect();
        let [together, alone] = ["together", "alone"].map(|name| path(&folder, &format!("{name}{i}")));
        let scene = ["render", "cactus:2000", "--cameras", &film, "-o"];
        ok(&[&scene[..], &[&together, "--camera", "all"], &options].concat());
        for camera in 0..4 {
            let camera = camera.to_string();
            let range = format!("{camera}..{camera}");
            ok(&[&scene[..], &[&alone, "--camera", &range], &options].concat());
        }
        let [together, alone] = [pictures(&together), pictures(&alone)];
        assert!(together.len() >= 4 && together == alone, "{options:?}");
    }
}

/// Pictures in bands have the bytes of whole ones, for every kind of file, also if a device is lost.
#[test]
fn devices_that_draw_bands_write_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let device = std::env::var("SMALTO_DEVICE").unwrap_or_else(|_| "0".to_owned());
    let devices = format!("{device},{device}");
    let scene = ["render", "cactus:2000", "--orbit", "3", "--size", "70x300"];
    for (i, options) in [
        "--layers colour,alpha,depth,median-depth,counts",
        "--layers colour,alpha --format png16",
        "--layers colour,depth --portable",
        "--background transparent --format npy",
    ]
    .into_iter()
    .enumerate()
    {
        let options: Vec<&str> = options.split(' ').collect();
        let names = ["whole", "bands", "lost"].map(|name| path(&folder, &format!("{name}{i}")));
        ok(&[&scene[..], &["-o", &names[0]], &options].concat());
        let bands = [&scene[..], &["--device", &devices, "--share", "frame", "-o"]].concat();
        ok(&[&bands[..], &[&names[1]], &options].concat());
        let lost = [&bands[..], &[&names[2]], &options].concat();
        let lost = run(&lost, |command| _ = command.env("SMALTO_FAULT", "device@2"));
        let error = String::from_utf8_lossy(&lost.stderr);
        assert!(lost.status.success() && error.contains("draws no more: the GPU was lost"), "{error}");
        let [whole, bands, lost] = names.map(|name| pictures(&name));
        assert!(whole.len() >= 3 && whole == bands && whole == lost, "{options:?}");
    }
    let [json, out] = ["a.json", "a.png"].map(|name| path(&folder, name));
    let one = ["render", "cactus:2000", "--size", "70x300", "--device", &devices, "--json", &json, "-o", &out];
    ok(&[&one[..], &["--share", "frame"]].concat());
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(&json).unwrap()).unwrap();
    let frames = report["frames"].as_array().unwrap();
    assert!(frames.len() == 1 && frames[0]["gpu"]["listed"].as_u64().unwrap() > 0, "{report}");
    // More bins than the fast path draws at once, beside a picture with fewer.
    let film = path(&folder, "film.json");
    let pose = r#""position":[0,-1,-4],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fx":3000,"fy":3000"#;
    let frame = |w: u32, h: u32| format!(r#"{{"id":0,"img_name":"a","width":{w},"height":{h},{pose}}}"#);
    fs::write(&film, format!("[{},{}]", frame(8192, 3712), frame(64, 96))).unwrap();
    let text = ok(&["render", "cactus:300", "--cameras", &film, "--camera", "all", "-o", &path(&folder, "large")]);
    assert!(text.contains("8192x3712") && text.contains("64x96") && !text.contains("portable path"), "{text}");
    let notes = notes(&[&one[..], &["--share", "frame", "--response", "ray"]].concat());
    assert!(notes.contains("pictures along rays are drawn as a whole"), "{notes}");
}

#[test]
fn several_devices_draw_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let [one, two, report] = ["one", "two", "two.json"].map(|name| path(&folder, name));
    let text = ok(&[&SCENE[..], &["--size", "64x48", "-o", &one]].concat());
    assert!(text.contains("7 pictures in "), "{text}");
    let device = std::env::var("SMALTO_DEVICE").unwrap_or_else(|_| "0".to_owned());
    let devices = format!("{device},{device}");
    let rest = ["--size", "64x48", "--timings", "--json", &report, "--device", &devices, "-o", &two];
    let text = ok(&[&SCENE[..], &rest].concat());
    assert!(text.contains("encoding") && text.contains("threads"), "{text}");
    assert!(pictures(&one).len() == 7 && pictures(&one) == pictures(&two));
    // Reports are in the order of the cameras, whichever picture was complete first.
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(report).unwrap()).unwrap();
    let order = report["frames"].as_array().unwrap().iter().map(|frame| frame["camera"]["index"].as_u64().unwrap());
    assert_eq!(order.collect::<Vec<_>>(), Vec::from_iter(0..7));
    ok(&[&SCENE[..], &["--size", "64x48", "--device", "all", "-o", &one]].concat());
    let error = fails(3, &[&SCENE[..], &["--device", &format!("{device},none"), "-o", &one]].concat());
    assert!(error.contains("none"), "{error}");
}

#[test]
fn pictures_of_a_lost_device_are_drawn_by_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, other] = ["whole", "other"].map(|name| path(&folder, name));
    ok(&[&SCENE[..], &["--size", "64x48", "-o", &whole]].concat());
    let device = std::env::var("SMALTO_DEVICE").unwrap_or_else(|_| "0".to_owned());
    let devices = format!("{device},{device}");
    for lost_after in ["device@0", "device@1"] {
        let arguments = [&SCENE[..], &["--size", "64x48", "--device", &devices, "-o", &other]].concat();
        let output = run(&arguments, |command| _ = command.env("SMALTO_FAULT", lost_after));
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && error.contains("draws no more: the GPU was lost"), "{error}");
        assert!(pictures(&whole) == pictures(&other));
        fs::remove_dir_all(&other).unwrap();
    }
    // Alone, its loss ends the run, which can be resumed.
    let arguments = [&SCENE[..], &["--size", "64x48", "--resume", "-o", &other]].concat();
    let output = run(&arguments, |command| _ = command.env("SMALTO_FAULT", "device@3"));
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(pictures(&other).len(), 3);
    let text = ok(&arguments);
    assert!(text.contains("4 pictures in ") && pictures(&whole) == pictures(&other), "{text}");
}

/// Runs that are killed at any moment leave whole files, and the last one completes them.
#[test]
fn killed_runs_are_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, killed] = ["whole", "killed"].map(|name| path(&folder, name));
    let run = ["render", "cactus:2000", "--orbit", "60", "--size", "96x64", "--layers", "colour,depth", "-o"];
    ok(&[&run[..], &[&whole]].concat());
    let expected = pictures(&whole);
    let again = [&run[..], &[&killed, "--resume"]].concat();
    let mut done = 0;
    for attempt in 0..10 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_smalto"))
            .args(&again)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(150 + 97 * attempt % 400));
        child.kill().unwrap();
        child.wait().unwrap();
        let so_far = if Path::new(&killed).exists() { pictures(&killed) } else { Vec::new() };
        assert!(so_far.iter().all(|file| expected.contains(file)), "a file is not whole after attempt {attempt}");
        assert!(so_far.len() >= done, "a file is lost after attempt {attempt}");
        done = so_far.len();
    }
    let text = ok(&again);
    assert!(pictures(&killed) == expected, "{text}");
}

#[test]
fn a_file_that_cannot_be_written_ends_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "out");
    ok(&[&SCENE[..], &["--size", "64x48", "-o", &out]].concat());
    fs::remove_file(format!("{out}/00003.png")).unwrap();
    fs::create_dir(format!("{out}/00003.png")).unwrap();
    let error = fails(1, &[&SCENE[..], &["--size", "64x48", "-o", &out]].concat());
    assert!(error.contains("cannot write") && error.contains("00003.png"), "{error}");
}

/// An ffmpeg that keeps what it gets, or fails.
fn false_ffmpeg(folder: &Path, script: &str) -> String {
    let bin = folder.join("bin");
    fs::create_dir_all(&bin).unwrap();
    fs::write(bin.join("ffmpeg"), format!("#!/bin/bash\n[ \"$1\" = -version ] && exit 0\n{script}\n")).unwrap();
    fs::set_permissions(bin.join("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    format!("{}:{}", bin.display(), std::env::var("PATH").unwrap())
}

#[test]
fn a_video_gets_all_frames_in_their_order() {
    let folder = tempfile::tempdir().unwrap();
    let [video, out] = ["a.mkv", "out"].map(|name| path(&folder, name));
    let search = false_ffmpeg(folder.path(), "cat > \"${@: -1}\"; echo \"$@\" > \"$0.words\"");
    let arguments = [&SCENE[..], &["--size", "33x24", "--fps", "24", "--video", &video]].concat();
    let output = run(&arguments, |command| _ = command.env("PATH", &search));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    ok(&[&SCENE[..], &["--size", "33x24", "-o", &out]].concat());
    let rgb = |name: &String| image::open(Path::new(&out).join(name)).unwrap().into_rgb8().into_raw();
    let expected: Vec<u8> = pictures(&out).iter().flat_map(|(name, _)| rgb(name)).collect();
    assert!(fs::read(&video).unwrap() == expected);
    let words = fs::read_to_string(folder.path().join("bin/ffmpeg.words")).unwrap();
    assert!(words.contains("-pixel_format rgb24 -video_size 33x24 -framerate 24 -i - -vf pad="), "{words}");

    // A failure leaves the old file.
    let search = false_ffmpeg(folder.path(), "head -c 100 > /dev/null; echo 'no such codec' >&2; exit 1");
    let output = run(&arguments, |command| _ = command.env("PATH", &search));
    assert_eq!(output.status.code(), Some(1));
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("cannot write") && error.contains("ffmpeg failed: no such codec"), "{error}");
    assert!(fs::read(&video).unwrap() == expected);

    // Without ffmpeg there are pictures and the command.
    let output = run(&arguments, |command| _ = command.env("PATH", folder.path()));
    assert!(output.status.success());
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("there is no ffmpeg"), "{error}");
    assert_eq!(pictures(path(&folder, "a")).len(), 7);
    assert!(String::from_utf8_lossy(&output.stdout).contains("ffmpeg -framerate 24"));

    for (options, sentence) in [
        (&["--video", "scene.ply"][..], "expected a name that ends in .mp4"),
        (&["--video", &video, "-o", &out], "--video VIDEO cannot be combined with --output"),
        (&["--video", &video, "--layers", "depth"], "--video VIDEO cannot be combined with --layers"),
        (&["--video", &video, "--background", "transparent"], "cannot be transparent"),
    ] {
        let output = run(&[&SCENE[..], options].concat(), |command| _ = command.env("PATH", &search));
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && error.contains(sentence), "{error}");
    }
}
