//! Camera files against COLMAP's own reading of them, splits, and principal points in pictures.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::program::{fails, ok, path, smalto};
use crate::common::{Gpu, compare};
use glam::{DMat3, DVec2, DVec3};
use smalto::camera::{self, Camera, CameraFile, NamedCamera, Split, Timeline};
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::rules::Background;

use super::camera_choice::pictures;
use super::lenses::as_pinholes;

pub(super) fn fixture(name: &str) -> PathBuf {
    Path::new("tests/fixtures/colmap").join(name)
}

pub(super) fn read(path: impl AsRef<Path>) -> CameraFile {
    camera::read(path.as_ref()).unwrap_or_else(|problem| panic!("{}: {problem:#}", path.as_ref().display()))
}

/// Why the file is not read.
pub(super) fn refused(path: impl AsRef<Path>) -> String {
    match camera::read(path.as_ref()) {
        Ok(read) => panic!("{} was read: {read:?}", path.as_ref().display()),
        Err(problem) => format!("{problem:#}"),
    }
}

/// A camera as COLMAP reads it, its model, and how far it puts what a pinhole sees in the corners.
pub(super) struct Expected {
    pub(super) named: NamedCamera,
    pub(super) model: String,
    pub(super) corner_px: f64,
}

pub(super) fn expected() -> Vec<Expected> {
    let text = fs::read_to_string(fixture("cameras.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse::<f64>().unwrap();
        let vector = |i: usize| DVec3::new(number(i), number(i + 1), number(i + 2));
        let camera = Camera {
            position: vector(1),
            rotation: DMat3::from_cols(vector(4), vector(7), vector(10)).transpose(),
            focal_px: DVec2::new(number(13), number(14)),
            centre_px: DVec2::new(number(15), number(16)),
            size_px: [number(17) as u32, number(18) as u32],
            lens: None,
        };
        let named = NamedCamera::new(cells[0].to_owned(), camera);
        Expected { named, model: cells[19].to_owned(), corner_px: number(20) }
    };
    text.lines().skip(1).map(row).collect()
}

#[track_caller]
fn assert_same(read: &[NamedCamera], expected: &[Expected]) {
    let names = |of: &[NamedCamera]| of.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    let wanted: Vec<_> = expected.iter().map(|e| e.named.clone()).collect();
    assert_eq!(names(read), names(&wanted));
    for (NamedCamera { name, camera, .. }, expected) in read.iter().zip(&wanted) {
        let expected = &expected.camera;
        assert!(camera.position.distance(expected.position) < 1e-12, "{name}: {camera:?}");
        assert!(camera.rotation.abs_diff_eq(expected.rotation, 1e-12), "{name}: {camera:?}");
        let intrinsics = |c: &Camera| (c.focal_px, c.centre_px, c.size_px);
        assert_eq!(intrinsics(camera), intrinsics(expected), "{name}");
    }
}

#[test]
fn colmap_models_agree_with_colmap() {
    let expected = expected();
    assert_eq!(expected.len(), 12);
    let paths = ["", "sparse", "sparse/1", "sparse/1/images.bin", "sparse/1/cameras.bin", "text", "text/images.txt"];
    for path in paths {
        let file = read(fixture(path));
        assert_same(&file.cameras, &expected);
        assert_eq!(file.splits, None);
        let chosen = file.notices.iter().any(|n| n == "model 1 with 12 photographs is used, the largest of 2 models");
        assert_eq!(chosen, ["", "sparse"].contains(&path), "{path}: {:?}", file.notices);
    }
    let small = read(fixture("sparse/0"));
    assert_eq!(small.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["left/003.jpg", "left/012.jpg"]);
    assert_eq!(small.notices, Vec::<String>::new());
}

#[test]
fn lens_distortion_is_reported_with_colmaps_distance() {
    let folder = tempfile::tempdir().unwrap();
    let [images, cameras] = ["images", "cameras"].map(|name| {
        let text = fs::read_to_string(fixture("text").join(name).with_extension("txt")).unwrap();
        text.lines().map(str::to_owned).collect::<Vec<_>>()
    });
    let mut said = 0;
    for Expected { named: NamedCamera { name, .. }, model, corner_px } in expected() {
        let image = images.iter().find(|line| line.ends_with(name.as_str())).unwrap();
        let id = image.split(' ').nth(8).unwrap();
        let camera = cameras.iter().find(|line| line.split(' ').next() == Some(id)).unwrap();
        assert!(camera.contains(&format!(" {model} ")));
        fs::write(folder.path().join("images.txt"), format!("{image}\n\n")).unwrap();
        fs::write(folder.path().join("cameras.txt"), camera).unwrap();
        let notices = as_pinholes(read(folder.path()));
        let told = format!("1 of 1 cameras have lenses that distort ({model}), and are drawn as pinholes");
        match model.as_str() {
            _ if corner_px > 0.0 => assert_eq!(notices, [format!("{told}, with corners up to {corner_px:.1} px off")]),
            _ => assert_eq!(notices, Vec::<String>::new(), "{model}"),
        }
        said += notices.len();
    }
    assert_eq!(said, 8);
    let all = read(fixture("text"));
    let told = as_pinholes(all.clone()).concat();
    assert!(told.starts_with("8 of 12 cameras") && told.ends_with("with corners up to 25.8 px off"), "{told}");
    let models: Vec<_> = all.cameras.iter().map(|named| Some(named.camera.lens.as_ref()?.model())).collect();
    let bent = expected().into_iter().map(|e| (e.corner_px > 0.0).then_some(e.model));
    assert_eq!(models, bent.collect::<Vec<_>>().iter().map(Option::as_deref).collect::<Vec<_>>());
}

/// A `transforms.json` of these cameras: OpenGL's axes, up and back.
pub(super) fn transforms(cameras: &[&NamedCamera], rest: &str) -> String {
    let frame = |NamedCamera { name, camera, .. }: &NamedCamera| {
        let (right, up, back, p) = (camera.right(), -camera.down(), -camera.forward(), camera.position);
        let row = |i: usize| format!("[{}, {}, {}, {}]", right[i], up[i], back[i], p[i]);
        let Camera { focal_px, centre_px, size_px: [w, h], .. } = camera;
        format!(
            r#"{{"file_path": "./{name}", "transform_matrix": [{}, {}, {}, [0, 0, 0, 1]], "w": {w}, "h": {h}.0,
            "fl_x": {}, "fl_y": {}, "cx": {}, "cy": {}}}"#,
            row(0),
            row(1),
            row(2),
            focal_px.x,
            focal_px.y,
            centre_px.x,
            centre_px.y
        )
    };
    let frames: Vec<_> = cameras.iter().map(|named| frame(named)).collect();
    format!("{{{rest} \"frames\": [{}]}}", frames.join(",\n"))
}

/// A file in a folder that goes with it.
pub(super) fn written(name: &str, content: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    (folder, path)
}

#[test]
fn transforms_json_and_colmap_hold_the_same_cameras() {
    let expected = expected();
    let cameras: Vec<_> = expected.iter().map(|e| &e.named).collect();
    let (_folder, file) = written("transforms.json", transforms(&cameras, ""));
    let read = read(&file);
    assert_same(&read.cameras, &expected);
    assert_eq!((read.splits, read.notices), (None, vec![]));
}

/// One frame at the origin as OpenGL has it: looks along -z, up is y.
pub(super) const FRAME: &str = r#"{"file_path": "./train/r_0",
    "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}"#;

#[test]
fn blender_transforms_have_angles_and_photographs() {
    let text = format!(r#"{{"camera_angle_x": 1.5707963267948966, "frames": [{FRAME}]}}"#);
    let (folder, file) = written("transforms_train.json", text);
    let problem = refused(&file);
    assert!(problem.starts_with("frame 0: it has no size (w and h), and its photograph "), "{problem}");
    fs::create_dir(folder.path().join("train")).unwrap();
    let photograph = folder.path().join("train/r_0.png");
    fs::write(&photograph, "no picture").unwrap();
    assert!(refused(&file).contains("r_0.png has none: "));
    image::RgbImage::new(40, 30).save(&photograph).unwrap();
    let read = read(&file);
    let NamedCamera { name, camera, .. } = &read.cameras[0];
    assert_eq!((name.as_str(), camera.size_px), ("train/r_0", [40, 30]));
    assert!(camera.focal_px.distance(DVec2::splat(20.0)) < 1e-12, "90 degrees across 40 pixels");
    assert_eq!(camera.centre_px, DVec2::new(20.0, 15.0));
    assert_eq!((camera.forward(), camera.down()), (-DVec3::Z, -DVec3::Y));
    assert_eq!(read.splits, Some(vec![vec![Split::Train]]));
}

#[test]
fn frames_of_transforms_json_override_the_file() {
    let frame = |own: &str| FRAME.replacen('{', &format!("{{{own}"), 1);
    let (plain, own) = (frame(""), frame(r#""fl_x": 50, "cx": 7, "h": 60, "k1": 0, "camera_model": "PINHOLE","#));
    let top = r#""w": 80, "h": 40.0, "fl_x": 100, "fl_y": 101, "cy": null, "k1": 0.1, "camera_model": "OPENCV","#;
    let (_folder, file) = written("transforms.json", format!(r#"{{{top} "frames": [{plain}, {own}]}}"#));
    let read = read(&file);
    let seen = |i: usize| {
        let Camera { focal_px, centre_px, size_px, .. } = &read.cameras[i].camera;
        (focal_px.to_array(), centre_px.to_array(), *size_px)
    };
    assert_eq!(seen(0), ([100.0, 101.0], [40.0, 20.0], [80, 40]));
    assert_eq!(seen(1), ([50.0, 101.0], [7.0, 30.0], [80, 60]));
    // A corner at the slope (0.4, 20 / 101) is moved by 0.1 of its squared length.
    let slope = DVec2::new(0.4, 20.0 / 101.0);
    let off = 0.1 * slope.length_squared() * (slope * DVec2::new(100.0, 101.0)).length();
    let told = format!(
        "1 of 2 cameras have lenses that distort (OPENCV), and are drawn as pinholes, \
             with corners up to {off:.1} px off"
    );
    assert_eq!(as_pinholes(read), [told]);
    for (from, to) in [("\"OPENCV\"", "\"OPENCV_FISHEYE\""), ("\"camera_model\": \"OPENCV\"", "\"is_fisheye\": true")] {
        let text = fs::read_to_string(&file).unwrap().replace(from, to).replace("\"k1\": 0.1", "\"k1\": 0");
        let (_folder, file) = written("transforms.json", text);
        let notices = as_pinholes(camera::read(&file).unwrap());
        assert!(notices[0].contains("(OPENCV_FISHEYE)"), "{to}: {notices:?}");
    }
}

/// nerfstudio's own arithmetic (`nerfstudio_dataparser.py`, `save_dataparser_transform`), in NumPy:
///
/// `t = T @ inv(A); c2w = t @ pose; c2w[:3, 3] *= scale / applied_scale`
#[test]
fn dataparser_transforms_move_the_cameras_to_the_nerfstudio_scene() {
    let pose = "[[0.6, 0, 0.8, 1], [0, 1, 0, 2], [-0.8, 0, 0.6, 3], [0, 0, 0, 1]]";
    let applied = r#""applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], "applied_scale": 0.5"#;
    let frame = format!(r#"{{"file_path": "a", "w": 64, "h": 48, "fl_x": 50, "transform_matrix": {pose}}}"#);
    let (folder, file) = written("transforms.json", format!(r#"{{{applied}, "frames": [{frame}]}}"#));
    let beside = folder.path().join("dataparser_transforms.json");
    let plain = read(&file);
    assert!(plain.notices.is_empty());
    fs::write(&beside, r#"{"transform": [[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6]], "scale": 0.25}"#).unwrap();
    let placed = read(&file);
    assert_eq!(placed.notices.len(), 1, "{:?}", placed.notices);
    let camera = &placed.cameras[0].camera;
    assert!((camera.position - DVec3::new(3.5, 3.0, 4.0)).length() < 1e-12, "{}", camera.position);
    for (axis, expected) in [
        (camera.right(), DVec3::new(-0.8, 0.6, 0.0)),
        (camera.down(), DVec3::new(0.0, 0.0, -1.0)),
        (camera.forward(), DVec3::new(-0.6, -0.8, 0.0)),
    ] {
        assert!((axis - expected).length() < 1e-12, "{axis}, not {expected}");
    }
    for (text, expected) in [
        ("{}", "is not a transform of three rows"),
        (
            r#"{"transform": [[2, 0, 0, 4], [0, 1, 0, 5], [0, 0, 1, 6]], "scale": 1}"#,
            "not a rotation and a translation",
        ),
        (r#"{"transform": [[1, 0, 0, 4], [0, 1, 0, 5], [0, 0, 1, 6]], "scale": 0}"#, "its scale is not over 0"),
    ] {
        fs::write(&beside, text).unwrap();
        let problem = refused(&file);
        assert!(problem.starts_with("dataparser_transforms.json: ") && problem.contains(expected), "{problem}");
    }
}

#[test]
fn splits_come_from_the_file_or_take_every_eighth_by_name() {
    let names = |file: CameraFile, split: Split| file.of(split).into_iter().map(|c| c.name).collect::<Vec<_>>();
    let model = read(fixture("text"));
    assert_eq!(names(model.clone(), Split::Test), ["left/001.jpg", "right/004.jpg"]);
    assert_eq!(names(model.clone(), Split::Train).len(), 10);
    assert_eq!(names(model.clone(), Split::Val), Vec::<String>::new());
    // By name, whatever the order of the file; which stays.
    let mut backwards = model.cameras.clone();
    backwards.reverse();
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("cameras.json");
    camera::write(&json, &backwards).unwrap();
    assert_eq!(names(read(&json), Split::Test), ["right/004.jpg", "left/001.jpg"]);

    let expected = expected();
    let cameras: Vec<_> = expected.iter().map(|e| &e.named).collect();
    let lists = r#""train_filenames": ["left/001.jpg", "./left/002.jpg"], "val_filenames": ["right/001.jpg"],
        "test_filenames": ["right/001.jpg", "no/such.jpg"],"#;
    let (_folder, file) = written("transforms.json", transforms(&cameras, lists));
    assert_eq!(names(read(&file), Split::Train), ["left/001.jpg", "left/002.jpg"]);
    assert_eq!(names(read(&file), Split::Val), ["right/001.jpg"]);
    assert_eq!(names(read(&file), Split::Test), ["right/001.jpg"]);

    // The files of Blender's sets together.
    let folder = tempfile::tempdir().unwrap();
    for (name, part) in [("train", &cameras[..7]), ("val", &cameras[7..9]), ("test", &cameras[9..])] {
        fs::write(folder.path().join(format!("transforms_{name}.json")), transforms(part, "")).unwrap();
    }
    let all = read(folder.path());
    assert_same(&all.cameras, &expected);
    let counts = [Split::Train, Split::Val, Split::Test].map(|split| all.clone().of(split).len());
    assert_eq!(counts, [7, 2, 3]);
}

#[test]
fn cameras_are_found_beside_a_scene_and_above_it() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().canonicalize().unwrap();
    let scene = root.join("a/b/c/scene.ply");
    fs::create_dir_all(scene.parent().unwrap()).unwrap();
    fs::write(&scene, "").unwrap();
    assert_eq!(camera::find(&scene), None);
    fs::create_dir(root.join("sparse")).unwrap();
    assert_eq!(camera::find(&scene), None, "a folder without a model");
    for name in ["cameras.bin", "images.bin"] {
        fs::create_dir_all(root.join("sparse/0")).unwrap();
        fs::copy(fixture("sparse/1").join(name), root.join("sparse/0").join(name)).unwrap();
    }
    for (new, is_file) in
        [("sparse", false), ("transforms.json", true), ("cameras.json", true), ("a/transforms.json", true)]
    {
        if is_file {
            fs::write(root.join(new), "").unwrap();
        }
        assert_eq!(camera::find(&scene), Some(root.join(new)));
    }
    let deeper = root.join("a/b/c/d/e/scene.ply");
    assert_eq!(camera::find(&deeper), None, "over three folders above");
}

/// The cactus from in front, with the principal point far beside the middle.
fn aside() -> Camera {
    let camera = Camera::looking_at(DVec3::new(1.5, -2.0, -3.0), DVec3::new(0.0, -1.2, 0.0), [96, 64], 1.0);
    Camera { centre_px: DVec2::new(20.25, 50.5), ..camera }
}

#[test]
fn off_centre_principal_points_match_the_reference_on_both_paths() {
    let gaussians = cactus(20_000).unwrap().gaussians;
    let gpu = Gpu::new();
    for camera in [aside(), aside().resized([201, 77])] {
        let rendering = reference::render(&gaussians, &camera, &Options::EXACT.rules, Background::BLACK);
        for options in [Options::EXACT, Options { portable: true, ..Options::EXACT }] {
            let comparison = compare(&gpu.render(&gaussians, &camera, &options), &rendering);
            assert!(comparison.psnr >= 90.0 && comparison.unexplained == 0, "{options:?}: {comparison:?}");
        }
    }
}

#[test]
fn commands_read_models_and_splits_and_report_what_they_ignore() {
    let folder = tempfile::tempdir().unwrap();
    let model = fixture("").display().to_string();
    let common = ["render", "cactus:300", "--cameras", &model, "--size", "32x24", "-o"];
    let output = smalto(&[&common[..], &[&path(&folder, "test"), "--camera", "all", "--split", "test"]].concat());
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    assert!(error.contains("8 of 12 cameras have lenses (") && error.contains("of 2 models"), "{error}");
    assert_eq!(pictures(&path(&folder, "test")), ["00000.png", "00008.png"], "positions in the file");
    ok(&[&common[..], &[&path(&folder, "one.png"), "--camera", "right/004.jpg"]].concat());
    let bytes = |name: &str| fs::read(path(&folder, name)).unwrap();
    assert_eq!(bytes("one.png"), bytes("test/00008.png"));

    let error = fails(2, &[&common[..], &[&path(&folder, "a.png"), "--split", "val"]].concat());
    assert!(error.contains("--split val: tests/fixtures/colmap/ has 12 cameras, and none is in this split"), "{error}");
    let error = fails(2, &["render", "cactus:300", "--split", "test"]);
    assert!(error.contains("--split needs a camera file, and there is none"), "{error}");
    fails(2, &["bench", "cactus:300", "--split", "test", "--frames", "1", "--warmup", "0"]);
    let error = fails(4, &["render", "cactus:300", "--cameras", "src"]);
    assert!(error.contains("src: is a folder with neither cameras.json"), "{error}");
}

#[test]
fn render_draws_the_frames_of_a_path() {
    let folder = tempfile::tempdir().unwrap();
    let mut timeline = Timeline::default();
    for (seconds, x) in [(1.0, -1.0), (1.5, 1.0)] {
        let camera = Camera::looking_at(DVec3::new(x, -1.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [48, 32], 1.0);
        timeline.insert(seconds, camera).unwrap();
    }
    let file = path(&folder, "path.json");
    timeline.write(Path::new(&file)).unwrap();
    let common = ["render", "cactus:300", "--path", &file];
    let film = path(&folder, "film");
    ok(&[&common[..], &["--fps", "4", "-o", &film]].concat());
    assert_eq!(pictures(&film).len(), 3);
    let command = ok(&[&common[..], &["--fps", "4", "-o", &film, "--video"]].concat());
    assert!(command.contains("ffmpeg -framerate 4 -i "), "{command}");
    for (frame, camera) in timeline.frames(4.0).enumerate() {
        let (cameras, out) = (path(&folder, "one.json"), path(&folder, "one.png"));
        camera::write(Path::new(&cameras), &[NamedCamera::new(String::new(), camera)]).unwrap();
        ok(&["render", "cactus:300", "--cameras", &cameras, "-o", &out]);
        assert_eq!(fs::read(out).unwrap(), fs::read(format!("{film}/{frame:05}.png")).unwrap(), "frame {frame}");
    }
    for wrong in ["0", "-1", "nan", "1001"] {
        fails(2, &[&common[..], &[&format!("--fps={wrong}")]].concat());
    }
    fails(2, &[&common[..], &["--camera", "all"]].concat());
    fails(2, &["render", "cactus:300", "--fps", "10"]);
    let key = fs::read_to_string(&file).unwrap().replace("\"seconds\":1.5", "\"seconds\":900000");
    fs::write(&file, key).unwrap();
    let error = fails(2, &common);
    assert!(error.contains("are 26999971 frames, over 100000"), "{error}");
    fs::write(&file, "{}").unwrap();
    assert!(fails(4, &common).contains("path.json: is no camera path"));
}
