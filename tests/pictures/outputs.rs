//! Where `smalto render` writes: layers, kinds of files, names, films, runs that are resumed.

use std::fs;
use std::path::Path;

use super::depths::{ROUNDING, apart};
use crate::common::program::{fails, ok, path, smalto};
use smalto::pixels::{Pixels, Plane};

/// One channel of an OpenEXR file.
fn exr(path: impl AsRef<Path>) -> Plane {
    let image = exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    let layer = image.layer_data;
    let [channel] = &layer.channel_data.list[..] else { panic!("it has one channel") };
    assert_eq!(channel.name.to_string(), "Y");
    let size = [layer.size.0, layer.size.1].map(|side| side as u32);
    Plane { size, values: channel.sample_data.values_as_f32().collect() }
}

fn npy(path: impl AsRef<Path>) -> Plane {
    let array = npyz::NpyFile::new(fs::File::open(path).unwrap()).unwrap();
    let [height, width] = array.shape() else { panic!("it has two dimensions") };
    Plane { size: [*width as u32, *height as u32], values: array.into_vec().unwrap() }
}

fn bits(plane: &Plane) -> ([u32; 2], Vec<u32>) {
    (plane.size, plane.values.iter().map(|v| v.to_bits()).collect())
}

/// Three cameras: two of one size, and one that sees nothing.
pub(super) fn cameras(folder: &tempfile::TempDir, names: [&str; 3]) -> String {
    let z = [-5.0, -2.5, 50.0];
    let entry = |i: usize| {
        format!(
            r#"{{"id": {i}, "img_name": {}, "width": 64, "height": 48, "position": [0, -1.2, {}],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 60, "fy": 60}}"#,
            serde_json::json!(names[i]),
            z[i]
        )
    };
    let file = path(folder, "cams.json");
    fs::write(&file, format!("[{}, {}, {}]", entry(0), entry(1), entry(2))).unwrap();
    file
}

/// Every file in a folder and below, by its path there, without the hidden record of a run.
fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
            } else if !entry.ends_with(".smalto-run.jsonl") {
                found.push(entry.strip_prefix(folder).unwrap().display().to_string());
            }
        }
    }
    found.sort();
    found
}

#[test]
fn layers_are_written_beside_a_file_or_into_folders() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, ["a", "b", "c"]);
    let layers = "colour,alpha,depth,median-depth,counts";
    let render = |more: &[&str]| {
        let common = ["render", "cactus:3000", "--cameras", &file, "--background", "transparent", "--preset", "exact"];
        ok(&[&common[..], more].concat())
    };
    render(&["--layers", layers, "-o", &path(&folder, "one.npy")]);
    render(&["--layers", layers, "-o", &path(&folder, "exact.npy"), "--reference"]);
    render(&["--layers", layers, "-o", &path(&folder, "some"), "--camera", "0,2"]);
    render(&["--layers", "depth", "-o", &path(&folder, "depth"), "--camera", "0,2"]);
    let some = ["alpha", "colour", "counts", "depth", "median-depth"].map(|layer| {
        let kind = if ["alpha", "colour"].contains(&layer) { "png" } else { "exr" };
        [format!("{layer}/00000.{kind}"), format!("{layer}/00002.{kind}")]
    });
    assert_eq!(files(&folder.path().join("some")), some.concat());
    assert_eq!(files(&folder.path().join("depth")), ["00000.exr", "00002.exr"]);

    // The same in every kind of file.
    let of = |name: &str| npy(path(&folder, name));
    for layer in ["depth", "median-depth", "counts"] {
        let one = of(&format!("one.{layer}.npy"));
        assert_eq!(one.size, [64, 48]);
        assert_eq!(bits(&exr(folder.path().join(format!("some/{layer}/00000.exr")))), bits(&one));
        let pairs = one.values.iter().zip(of(&format!("exact.{layer}.npy")).values);
        let differing = pairs.filter(|(a, b)| apart(**a, *b) > ROUNDING).count();
        assert!(differing <= 3, "{layer}: {differing} pixels differ from the reference");
    }
    assert_eq!(bits(&exr(folder.path().join("depth/00000.exr"))), bits(&of("one.depth.npy")));
    let pixels = Pixels::read(&folder.path().join("one.npy")).unwrap();
    assert_eq!(bits(&pixels.alpha()), bits(&of("one.alpha.npy")));
    let grey = image::open(folder.path().join("some/alpha/00000.png")).unwrap();
    assert_eq!(grey.color(), image::ColorType::L8);
    assert_eq!(grey.into_bytes(), pixels.alpha().to_grey8());
    // Nothing is in view of the third camera.
    assert!(exr(folder.path().join("some/depth/00002.exr")).values.iter().all(|v| v.is_nan()));
    assert!(exr(folder.path().join("some/counts/00002.exr")).values.iter().all(|v| *v == 0.0));
}

#[test]
fn pictures_in_a_folder_can_have_any_format() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, ["a", "b", "c"]);
    let render = |kind: &str, background: &str| {
        let out = path(&folder, &format!("{kind}-{background}"));
        let common = ["render", "cactus:500", "--cameras", &file, "--camera", "0..1", "-o", &out, "--format", kind];
        ok(&[&common[..], &["--background", background, "--layers", "colour,alpha"]].concat());
        out
    };
    for background in ["0,0.5,1", "transparent"] {
        let floats = Pixels::read(&Path::new(&render("npy", background)).join("colour/00001.npy")).unwrap();
        let exr = Pixels::read(&Path::new(&render("exr", background)).join("colour/00001.exr")).unwrap();
        assert_eq!(exr, floats);
        let read = |kind: &str, layer: &str| {
            image::open(Path::new(&render(kind, background)).join(layer).join("00001.png")).unwrap()
        };
        let (eight, sixteen) = (read("png", "colour"), read("png16", "colour"));
        if background == "transparent" {
            assert_eq!(eight.as_rgba8().unwrap().as_raw(), &floats.to_rgba8());
            assert_eq!(sixteen.as_rgba16().unwrap().as_raw(), &floats.to_rgba16());
            assert_eq!(read("png16", "alpha").as_luma16().unwrap().as_raw(), &floats.alpha().to_grey16());
        } else {
            assert_eq!(eight.as_rgb8().unwrap().as_raw(), &floats.to_rgb8());
            assert_eq!(sixteen.as_rgb16().unwrap().as_raw(), &floats.to_rgb16());
            assert!(sixteen.as_rgb16().unwrap().iter().any(|v| v % 257 != 0), "more than 8 bits");
        }
    }
    let one = path(&folder, "one.png");
    ok(&["render", "cactus:500", "--size", "8x8", "-o", &one, "--format", "png16"]);
    assert_eq!(image::open(&one).unwrap().color(), image::ColorType::Rgb16);
    let error = fails(2, &["render", "cactus:500", "--size", "8x8", "-o", &one, "--format", "exr"]);
    assert!(error.contains("--format needs a file that ends in .exr, but --output is "), "{error}");
}

#[test]
fn pictures_are_named_after_images_and_stay_in_their_folder() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, ["left/0001.JPG", "../../up.png", "/abs/frame.7"]);
    let out = path(&folder, "in/out");
    let common = ["render", "cactus:100", "--size", "8x8", "--cameras", &file, "--names", "image", "-o", &out];
    ok(&[&common[..], &["--camera", "all"]].concat());
    assert_eq!(files(folder.path()), ["cams.json", "in/out/abs/frame.7.png", "in/out/left/0001.png", "in/out/up.png"]);
    ok(&[&common[..], &["--camera", "1", "--layers", "alpha,colour"]].concat());
    assert!(folder.path().join("in/out/alpha/up.png").is_file());
    cameras(&folder, ["a/1.jpg", "b.jpg", "a/../a/1.png"]);
    let error = fails(2, &[&common[..], &["--camera", "all"]].concat());
    assert!(error.contains("cameras 0 and 2 would both be written to "), "{error}");
    cameras(&folder, ["a/1.jpg", "..", "c"]);
    let error = fails(2, &[&common[..], &["--camera", "all"]].concat());
    assert!(error.contains("--names image: camera 1: the image name '..' is not a file name"), "{error}");
    let error = fails(2, &["render", "cactus:100", "--size", "8x8", "--names", "image", "-o", &out]);
    assert!(error.contains("--names image needs a camera file"), "{error}");
}

#[test]
fn cameras_can_be_chosen_by_lists_and_ranges() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, ["a", "0..2", "c,d"]);
    let common = ["render", "cactus:100", "--size", "8x8", "--cameras", &file];
    let written = |camera: &str| {
        let out = tempfile::tempdir().unwrap();
        let place = out.path().display().to_string();
        ok(&[&common[..], &["-o", &place, "--camera", camera]].concat());
        files(out.path())
    };
    assert_eq!(written("2,0"), ["00000.png", "00002.png"]);
    assert_eq!(written("1..2"), ["00001.png", "00002.png"]);
    assert_eq!(written("a,1..2"), ["00000.png", "00001.png", "00002.png"]);
    // What is a name is no range and no list.
    assert_eq!([written("0..2"), written("c,d")], [["00001.png"], ["00002.png"]]);
    let refused = |camera: &str| fails(2, &[&common[..], &["-o", &path(&folder, "no"), "--camera", camera]].concat());
    assert!(refused("0,0").contains("cameras 0 and 0 would both be written to "));
    assert!(refused("2..1").contains("--camera 2..1 is empty: 2 is greater than 1"));
    for (camera, item) in [("0..3", "0..3"), ("0,9", "9"), ("0..99999999999999999999", "0..9"), ("0,", ""), ("x", "x")]
    {
        let error = refused(camera);
        let sentence = format!("there is no camera {item}");
        assert!(error.contains(&sentence) && error.contains(": they are 0 to 2, from 'a' to 'c,d'"), "{error}");
    }
    assert!(!folder.path().join("no").exists(), "nothing is made before all is checked");
}

#[test]
fn a_film_is_numbered_frames_and_a_command() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, ["a", "b", "c"]);
    let out = path(&folder, "my film");
    let common = ["render", "cactus:100", "--cameras", &file, "--video", "-o", &out];
    // A camera may be there twice.
    let text = ok(&[&common[..], &["--camera", "2,0,2", "--size", "15x8"]].concat());
    assert_eq!(files(Path::new(&out)), ["00000.png", "00001.png", "00002.png"]);
    let words = shlex::split(text.lines().last().unwrap()).unwrap();
    let expected = format!(
        "ffmpeg -framerate 30 -i {out}/%05d.png -vf pad=ceil(iw/2)*2:ceil(ih/2)*2 \
         -c:v libx264 -pix_fmt yuv420p {out}.mp4"
    );
    assert_eq!(words.join(" "), expected);
    let layers = ["--camera", "all", "--layers", "colour,depth", "--fps", "23.976", "--format", "png16"];
    let text = ok(&[&common[..], &layers].concat());
    assert!(text.ends_with(&format!("'{out}.mp4'\n")) && text.contains("-framerate 23.976 -i '"), "{text}");
    assert!(text.contains("my film/colour/%05d.png") && !text.contains("pad"), "{text}");
}

#[test]
fn a_run_is_resumed_where_it_was_interrupted() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, ["a", "b", "c"]);
    let out = folder.path().join("views");
    let place = out.display().to_string();
    let common = ["render", "cactus:200", "--size", "16x12", "--cameras", &file, "--camera", "all", "-o", &place];
    let run = |more: &[&str]| smalto(&[&common[..], &["--layers", "colour,depth"], more].concat());
    let says = |output: &std::process::Output, text: &str| {
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains(text), "{error}");
    };
    let record = out.join(".smalto-run.jsonl");
    let [first, second, third] = [0, 1, 2].map(|i| out.join(format!("colour/{i:05}.png")));
    for reference in [&[][..], &["--reference"]] {
        _ = fs::remove_dir_all(&out);
        assert!(run(reference).status.success());
        let all = ["colour", "depth"].map(|layer| (0..3).map(move |i| (layer, i)));
        let name = |(layer, i)| format!("{layer}/{i:05}.{}", if layer == "depth" { "exr" } else { "png" });
        let names: Vec<_> = all.into_iter().flatten().map(name).collect();
        assert_eq!(files(&out), names);
        // As if the program had been stopped while it wrote the line about the second picture.
        let (whole, text) = (fs::read(&first).unwrap(), fs::read_to_string(&record).unwrap());
        // Views are complete in any order.
        let is_kept = |(number, line): &(usize, &str)| *number == 0 || line.contains("00000.");
        let mut part: String = text.lines().enumerate().filter(is_kept).map(|(_, line)| format!("{line}\n")).collect();
        part += "{\"file\":\"colour/00001";
        fs::write(&record, part).unwrap();
        let kept = vec![b'k'; whole.len()];
        fs::write(&first, &kept).unwrap();
        fs::remove_file(&second).unwrap();
        fs::write(&third, "of another run").unwrap();

        let output = run(&[reference, &["--resume", "--background", "1,1,1"]].concat());
        assert_eq!(output.status.code(), Some(2));
        says(&output, "had other settings (background); run without --resume to start over");
        let output = run(&[reference, &["--resume"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        says(&output, "2 of 6 files have their recorded sizes and are skipped");
        assert_eq!(fs::read(&first).unwrap(), kept, "what is complete is not drawn again");
        assert!(Pixels::read(&second).is_ok() && Pixels::read(&third).is_ok(), "what is not is");

        // What was damaged since is drawn again, also after a complete run.
        for damaged in [&b""[..], &whole[..whole.len() / 2]] {
            fs::write(&first, damaged).unwrap();
            let output = run(&[reference, &["--resume"]].concat());
            says(&output, "5 of 6 files have their recorded sizes and are skipped");
            assert_eq!(fs::read(&first).unwrap(), whole);
        }
        let before = fs::read(&record).unwrap();
        for _ in 0..2 {
            let output = run(&[reference, &["--resume"]].concat());
            assert!(output.status.success() && output.stdout.is_empty());
            says(&output, "nothing left to do, all 6 files have their recorded sizes");
        }
        assert_eq!(fs::read(&record).unwrap(), before, "the record does not grow");
    }
    // A run that is not to be resumed begins anew, and says so if it forgets one that could be.
    let output = run(&[]);
    assert!(output.status.success() && !String::from_utf8_lossy(&output.stderr).contains("starting over"));
    fs::write(&record, "damaged").unwrap();
    says(&run(&["--resume"]), "is damaged: run without --resume to start over");
    says(&run(&[]), "starting over; --resume would continue the unfinished run");
    fs::remove_file(&record).unwrap();
    let output = run(&["--resume"]);
    assert_eq!(output.status.code(), Some(2));
    says(&output, "exists, but there is no record of a run");
    assert!(!record.exists());
}

/// Before anything is drawn, however many pictures come first.
#[test]
fn a_run_that_cannot_write_a_picture_does_not_begin() {
    let folder = tempfile::tempdir().unwrap();
    let (file, place) = (cameras(&folder, ["a", "b", "c"]), path(&folder, "views"));
    fs::create_dir_all(folder.path().join("views/00002.png")).unwrap();
    let error = fails(1, &["render", "cactus:200", "--cameras", &file, "--camera", "all", "-o", &place]);
    assert_eq!(error, format!("smalto: cannot write {place}/00002.png: it is a folder\n"));
    assert_eq!(fs::read_dir(&place).unwrap().count(), 1);
}

#[test]
fn wrong_output_arguments_are_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, ["a", "b", "c"]);
    let place = path(&folder, "x");
    for (more, sentence) in [
        (&["--layers", "depth", "-o", "a.png"][..], "--layers depth needs .exr or .npy"),
        (
            &["--layers", "counts", "-o", &place, "--camera", "all", "--format", "png"],
            "--layers counts needs .exr or .npy",
        ),
        (&["--layers", "depth", "--scale", "0.5", "-o", "a.exr"], "--layers depth needs --scale 1"),
        (
            &["--layers", "depth", "--certificate", "b.exr", "-o", "a.exr"],
            "--certificate cannot be combined with --layers depth",
        ),
        (&["--layers", "depth", "--dump", &place, "-o", "a.exr"], "--dump cannot be combined with --layers depth"),
        (&["--camera", "all", "--dump", &place], "--dump writes the buffers of a single picture"),
        (&["--layers", "heat"], "--layers heat: expected colour, alpha, depth, median-depth, counts"),
        (&["--names", "image", "-o", "a.png"], "--output a.png: several pictures, --names, --video, --resume, "),
        (&["--resume", "-o", "a.png"], "need a folder"),
        (&["--video", "-o", "film.mp4"], "need a folder"),
        (&["--camera", "all", "-o", "a.exr"], "need a folder"),
        (&["--fps", "24", "-o", &place], "--fps needs --video or --path"),
        (&["--video", "--fps", "0", "-o", &place], "expected frames per second"),
        (&["--video", "--names", "image", "-o", &place], "--video cannot be combined with --names"),
        (&["--video", "--format", "exr", "-o", &place], "--video needs colours as PNG"),
        (&["--video", "--layers", "alpha", "-o", &place], "--video needs colours as PNG"),
        (&["--video", "--background", "transparent", "-o", &place], "--video cannot be transparent"),
    ] {
        let error = fails(2, &[&["render", "cactus:100", "--cameras", &file][..], more].concat());
        assert!(error.contains(sentence), "{more:?}: {error}");
    }
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replacen("\"width\": 64", "\"width\": 32", 1)).unwrap();
    let error = fails(2, &["render", "cactus:100", "--cameras", &file, "--camera", "all", "--video", "-o", &place]);
    assert!(error.contains("--video needs pictures of one size, not 32x48 and 64x48: set --size"), "{error}");
    assert_eq!(files(folder.path()), ["cams.json"]);
}
