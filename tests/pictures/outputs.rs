//! What `smalto render` writes beside a picture, and where: layers against the f64 reference, kinds of files, names, films,
//! runs that are resumed.

use std::fs;
use std::path::Path;

use crate::common::agree::{GREEN, RED, ahead, ball};
use crate::common::cloud::{camera, cloud};
use crate::common::free::build;
use crate::common::listed::Listed;
use crate::common::program::{fails, ok, path, smalto};
use crate::common::{Gpu, Random, captured_cameras, gaussians, read_captured};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::pixels::{Depths, Pixels, Plane};
use smalto::reference;
use smalto::render::{GpuScene, Inspection, Look, Renderer, Work, depths};
use smalto::rules::{Background, Rules};
use smalto::scene::{Gaussians, synthetic};

/// What f32 arithmetic may change of an expected depth, as a part of it: 3e-6 measured; and of a median, one splat's depth.
const ROUNDING: f64 = 1e-5;
const ROUNDING_OF_ONE: f64 = 1e-6;

const DEPTHS: Look = Look::Work(Work::Depths);

fn drawn(gpu: &Gpu, scene: &Gaussians, camera: &Camera, options: &Options) -> Depths {
    let scene = GpuScene::new(&gpu.0, scene, options).unwrap();
    let mut still = Renderer::new(&gpu.0, options, &scene).unwrap();
    still.set_inspection(Inspection { look: DEPTHS, ..Inspection::default() }).unwrap();
    // The background lies nowhere.
    still.render(camera, Background::Colour([0.3; 3])).unwrap();
    depths(&still.pixels().unwrap())
}

fn exact(scene: &Gaussians, camera: &Camera, rules: &Rules) -> reference::Rendering {
    reference::render(scene, camera, rules, Background::BLACK)
}

/// A random scene and a procedural one, each with a view.
fn cases() -> Vec<(Gaussians, Camera)> {
    let from = DVec3::new(1.5, -2.5, -4.0);
    let cactus = synthetic::cactus(8000).unwrap().gaussians;
    vec![
        (build(&cloud(&mut Random(5), 400, 2, 0.3), 2), camera()),
        (cactus, Camera::looking_at(from, DVec3::new(0.0, -1.2, 0.0), [100, 70], 0.9)),
    ]
}

fn captured_case() -> Vec<(Gaussians, Camera)> {
    let camera = captured_cameras("biker.orbit.cameras.json", &[10], [120, 80]).remove(0);
    vec![(read_captured("biker.spz"), camera)]
}

/// One behind the other, in the middle of the middle pixel, with nothing around them.
fn two_balls() -> (Gaussians, Camera) {
    let scene = gaussians(&[(ball([0.0, 0.0, 4.0], 0.2, 0.5), GREEN), (ball([0.0, 0.0, 2.0], 0.1, 0.4), RED)]);
    (scene, ahead([41, 31], 40.0))
}

/// As a part of what is expected; 0 if there is none of either.
fn apart(value: f32, expected: f32) -> f64 {
    if value.is_nan() && expected.is_nan() { 0.0 } else { f64::from((value - expected).abs() / expected) }
}

#[test]
fn depths_and_counts_are_those_of_the_reference() {
    check_depths(cases());
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn depths_and_counts_of_a_captured_scene_are_those_of_the_reference() {
    check_depths(captured_case());
}

fn check_depths(cases: Vec<(Gaussians, Camera)>) {
    let gpu = Gpu::new();
    let by = |rules: Rules| Options { rules, ..Options::EXACT };
    for (scene, camera) in cases {
        for options in [Options::EXACT, by(Rules::GSPLAT), by(Rules::KHR), by(Rules::INRIA)] {
            let depths = drawn(&gpu, &scene, &camera, &options);
            let rendering = exact(&scene, &camera, &options.rules);
            let expected = rendering.depths();
            let (mut compared, mut medians, mut apart_most) = (0, 0, 0.0_f64);
            for (i, _) in rendering.pixels.iter().enumerate().filter(|(_, exact)| exact.doubt == 0.0) {
                let own = [&depths.expected, &depths.median, &depths.counts].map(|plane| plane.values[i]);
                let of = [&expected.expected, &expected.median, &expected.counts].map(|plane| plane.values[i]);
                // Where hardly any light is left, rounding decides how many splats it takes until none is.
                let counted = rendering.pixels[i].transmittance > 1e-9;
                assert!(!counted || own[2] == of[2], "{own:?} for {of:?} in pixel {i}");
                assert!(apart(own[0], of[0]) <= ROUNDING, "{own:?} for {of:?} in pixel {i}");
                // A transmittance of a half to the last digits passes it a splat earlier or later.
                medians += usize::from(apart(own[1], of[1]) <= ROUNDING_OF_ONE);
                apart_most = apart_most.max(apart(own[0], of[0]));
                compared += 1;
            }
            println!("{:?}: {compared} pixels, {apart_most:.1e}, {} medians", options.rules, compared - medians);
            assert!(compared > rendering.pixels.len() * 9 / 10, "{compared} compared");
            assert!(compared - medians <= compared / 2000, "{} of {compared} medians differ", compared - medians);
        }
    }
}

/// The reference itself, against every pixel's list taken apart.
#[test]
fn depths_of_the_reference_come_from_the_blended_splats() {
    check_depths_of_the_reference(cases());
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn depths_of_the_reference_come_from_the_blended_splats_in_a_captured_scene() {
    check_depths_of_the_reference(captured_case());
}

fn check_depths_of_the_reference(cases: Vec<(Gaussians, Camera)>) {
    let mut kinds = [0; 3];
    for (scene, camera) in cases.into_iter().chain([two_balls()]) {
        let lists = Listed::of(&scene, &camera);
        let depths = exact(&scene, &camera, &Rules::TRAINED).depths();
        for pixel in 0..depths.counts.values.len() {
            let (blended, (_, centre)) = (lists.walk(pixel).blended, lists.list(pixel));
            let (mut left, mut sum, mut median) = (1.0, 0.0, f64::NAN);
            for splat in blended.iter().map(|id| &lists.splats[*id as usize]) {
                let alpha =
                    (splat.opacity * (-0.5 * splat.distance(centre)).exp()).min(Rules::TRAINED.alpha_max.into());
                sum += alpha * left * splat.depth;
                left *= 1.0 - alpha;
                median = if median.is_nan() && left <= 0.5 { splat.depth } else { median };
            }
            let own = [&depths.expected, &depths.median, &depths.counts].map(|plane| plane.values[pixel]);
            let mean = if blended.is_empty() { f64::NAN } else { sum / (1.0 - left) };
            assert!(apart(own[0], mean as f32) < 1e-6, "{own:?} for {mean} in pixel {pixel}");
            assert_eq!((own[1].to_bits(), own[2]), ((median as f32).to_bits(), blended.len() as f32), "pixel {pixel}");
            kinds[if mean.is_nan() { 0 } else { 1 + usize::from(!median.is_nan()) }] += 1;
        }
    }
    assert!(kinds.iter().all(|pixels| *pixels > 10), "without anything, without a median, with one: {kinds:?}");
}

#[test]
fn depths_of_two_balls_match_a_calculation_by_hand() {
    let gpu = Gpu::new();
    let (scene, camera) = two_balls();
    let of_reference = exact(&scene, &camera, &Rules::TRAINED).depths();
    for depths in [drawn(&gpu, &scene, &camera, &Options::EXACT), of_reference] {
        let at = |plane: &Plane, x: usize, y: usize| plane.values[y * 41 + x];
        let middle = [&depths.expected, &depths.median, &depths.counts].map(|plane| at(plane, 20, 15));
        // 0.4 of the light stays at 2, half of the rest at 4: less than a half is left there.
        assert!((middle[0] - (0.4 * 2.0 + 0.3 * 4.0) / 0.7).abs() < 1e-5, "{middle:?}");
        assert_eq!(middle[1..], [4.0, 2.0]);
        let corner = [&depths.expected, &depths.median, &depths.counts].map(|plane| at(plane, 0, 0));
        assert!(corner[0].is_nan() && corner[1].is_nan() && corner[2] == 0.0, "{corner:?}");
        assert_eq!(depths.median.size, [41, 31]);
        let faint = depths.median.values.iter().zip(&depths.expected.values).filter(|(m, e)| m.is_nan() && !e.is_nan());
        assert!(faint.count() > 10, "around the balls more than half of the light is left");
    }
}

/// More entries in one tile than llvmpipe lets a loop run, so that it is walked in several passes.
#[test]
fn depths_of_a_list_longer_than_65535_are_complete() {
    let entry = |i: u32| {
        let z = 5.0 + 1e-4 * f64::from(i);
        // The second kind alone is seen in most pixels, little by little.
        if i % 100 == 99 { (ball([0.1, 0.1, z], 0.4, 0.02), GREEN) } else { (ball([-0.35, -0.35, z], 0.002, 0.5), RED) }
    };
    let scene = gaussians(&(0..70_000).map(entry).collect::<Vec<_>>());
    let camera = ahead([16, 16], 100.0);
    let gpu = Gpu::new();
    let depths = drawn(&gpu, &scene, &camera, &Options::EXACT);
    let rendering = exact(&scene, &camera, &Rules::TRAINED);
    let expected = rendering.depths();
    let certain = (0..256).filter(|i| rendering.pixels[*i].doubt == 0.0);
    for i in certain.clone() {
        assert_eq!(depths.counts.values[i], expected.counts.values[i]);
        assert!(apart(depths.expected.values[i], expected.expected.values[i]) < ROUNDING);
        assert!(apart(depths.median.values[i], expected.median.values[i]) < ROUNDING_OF_ONE);
    }
    assert!(certain.count() > 100 && expected.counts.values.iter().any(|count| *count > 200.0));
}

#[test]
fn depths_are_refused_for_scaled_pictures() {
    let gpu = Gpu::new();
    let options = Options { scale: 0.5, ..Options::EXACT };
    let scene = GpuScene::new(&gpu.0, &gaussians(&[(ball([0.0, 0.0, 4.0], 0.2, 0.5), RED)]), &options).unwrap();
    let mut still = Renderer::new(&gpu.0, &options, &scene).unwrap();
    let inspection = Inspection { look: DEPTHS, ..Inspection::default() };
    let error = still.set_inspection(inspection).unwrap_err().to_string();
    assert_eq!(error, "depths need --scale 1: they cannot be enlarged");
}

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
fn cameras(folder: &tempfile::TempDir, names: [&str; 3]) -> String {
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

/// Every file in a folder and below, by its path there.
fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
            } else {
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
        "ffmpeg -framerate 30 -i {out}/%05d.png -vf pad=ceil(iw/2)*2:ceil(ih/2)*2 -c:v libx264 -pix_fmt yuv420p {out}.mp4"
    );
    assert_eq!(words.join(" "), expected);
    let layers = ["--camera", "all", "--layers", "colour,depth", "--fps", "23.976", "--format", "png16"];
    let text = ok(&[&common[..], &layers].concat());
    assert!(text.ends_with(&format!("'{out}.mp4'\n")) && text.contains("-framerate 23.976 -i '"), "{text}");
    assert!(text.contains("my film/colour/%05d.png") && !text.contains("pad"), "{text}");
}

#[test]
fn only_an_interrupted_run_is_resumed() {
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
    for reference in [&[][..], &["--reference"]] {
        _ = fs::remove_dir_all(&out);
        // A folder in the place of a picture interrupts the run there.
        let obstacle = out.join("colour/00001.png");
        fs::create_dir_all(&obstacle).unwrap();
        let output = run(reference);
        assert_eq!(output.status.code(), Some(1));
        says(&output, "cannot write ");
        fs::remove_dir(&obstacle).unwrap();
        let [first, ghost] = [out.join("colour/00000.png"), out.join("colour/00002.png")];
        fs::write(&first, "kept").unwrap();
        // Is there, but was never completed by this run.
        fs::write(&ghost, "old").unwrap();

        let output = run(&[reference, &["--resume", "--background", "1,1,1"]].concat());
        assert_eq!(output.status.code(), Some(2));
        says(&output, "had other settings (background); run without --resume to start over");
        let record = out.join(".smalto-run.jsonl");
        let text = fs::read_to_string(&record).unwrap();
        // As if the program had been stopped in the middle of a line.
        fs::write(&record, format!("{text}\"colour/000")).unwrap();

        let output = run(&[reference, &["--resume"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let done = if reference.is_empty() { 1 } else { 2 };
        says(&output, &format!("{done} of 6 files are complete and are skipped"));
        assert_eq!(fs::read(&first).unwrap(), b"kept", "what is complete is not drawn again");
        assert!(Pixels::read(&ghost).is_ok(), "what is not is");
        let all = ["colour", "depth"].map(|layer| (0..3).map(move |i| (layer, i)));
        let name = |(layer, i)| format!("{layer}/{i:05}.{}", if layer == "depth" { "exr" } else { "png" });
        assert_eq!(files(&out), all.into_iter().flatten().map(name).collect::<Vec<_>>(), "no record is left");

        let output = run(&[reference, &["--resume"]].concat());
        assert_eq!(output.status.code(), Some(2));
        says(&output, "exists, but there is no unfinished run");
    }
    // A run that is not to be resumed begins anew, and says so.
    fs::write(out.join(".smalto-run.jsonl"), "damaged").unwrap();
    let output = run(&["--resume"]);
    says(&output, "is damaged: run without --resume to start over");
    let output = run(&[]);
    assert!(output.status.success());
    says(&output, "starting over; --resume would continue the unfinished run");
    assert_ne!(fs::read(out.join("colour/00000.png")).unwrap(), b"kept");
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
        (&["--layers", "heat"], "invalid value 'heat'"),
        (&["--names", "image", "-o", "a.png"], "--output a.png: several pictures, --names, --video and --resume"),
        (&["--resume", "-o", "a.png"], "need a folder"),
        (&["--video", "-o", "film.mp4"], "need a folder"),
        (&["--camera", "all", "-o", "a.exr"], "need a folder"),
        (&["--fps", "24", "-o", &place], "--fps needs --video or --path"),
        (&["--video", "--fps", "0", "-o", &place], "expected frames per second"),
        (&["--video", "--names", "image", "-o", &place], "cannot be used with"),
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
