//! Lenses of camera files: every model is read, and notices state what pictures of lenses and of pinholes show.

use std::f64::consts::{FRAC_PI_2, PI};
use std::fs;

use glam::DVec3;
use smalto::camera::{CameraFile, Lens, NamedCamera};

use super::cameras::{FRAME, fixture, read, written};

const AHEAD: DVec3 = DVec3::new(0.6, -0.4, 1.0);

/// A text model of COLMAP with one photograph of this camera, 2000 by 1500 pixels.
fn model(camera: &str) -> CameraFile {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cameras.txt"), format!("1 {}", camera.replacen(' ', " 2000 1500 ", 1))).unwrap();
    fs::write(folder.path().join("images.txt"), "1 1 0 0 0 0 0 0 1 a.jpg\n\n").unwrap();
    read(folder.path())
}

/// The lens of a transforms.json with these members.
fn transforms(members: &str) -> CameraFile {
    let text = format!(r#"{{"w": 2000, "h": 1500, "fl_x": 900, {members} "frames": [{FRAME}, {FRAME}]}}"#);
    let (_folder, file) = written("transforms.json", text);
    read(&file)
}

fn lens(of: &NamedCamera) -> Option<&Lens> {
    of.camera.lens.as_deref()
}

/// The notices where the cameras are drawn as pinholes, which have no lens then.
pub(super) fn as_pinholes(read: CameraFile) -> Vec<String> {
    let pinholes = read.into_pinholes().unwrap();
    assert!(pinholes.cameras.iter().all(|named| named.camera.lens.is_none()));
    pinholes.notices
}

/// Places of (0.6, -0.4, 1) by an independent program in NumPy, which agrees with COLMAP and gsplat.
#[test]
fn every_model_of_colmap_is_read_with_its_lens() {
    for (camera, known) in [
        ("SIMPLE_RADIAL 900 1010 740 -0.12", [1516.304, 402.464]),
        ("OPENCV 900 905 1010 740 -0.25 0.05 0.002 -0.001", [1485.1208, 422.12056]),
        ("FULL_OPENCV 900 905 1010 740 0.4 -0.05 0.002 -0.001 0.01 0.6 0.02 0.001", [1498.156363, 413.381905]),
        ("OPENCV_FISHEYE 900 905 1010 740 -0.02 0.004 -0.001 0.0001", [1474.450189, 428.646355]),
        (
            "THIN_PRISM_FISHEYE 900 905 1010 740 -0.02 0.004 0.001 -0.002 -0.001 0.0001 0.001 -0.001",
            [1472.801849, 429.515862],
        ),
        (
            "RAD_TAN_THIN_PRISM_FISHEYE 900 905 1010 740 \
             -0.02 0.01 -0.004 0.001 -0.0002 0.00001 0.002 -0.001 0.001 0.0001 -0.001 0.0001",
            [1477.137132, 426.867496],
        ),
        ("FOV 900 905 1010 740 0.9", [1516.293337, 400.595948]),
        ("DIVISION 900 905 1010 740 -0.15", [1513.396602, 402.537833]),
        ("SIMPLE_DIVISION 900 1010 740 -0.15", [1513.396602, 404.402503]),
        ("EUCM 900 905 1010 740 0.6 1.1", [1478.637501, 425.839305]),
    ] {
        let read = model(camera);
        let (found, _) = read.cameras[0].camera.projected(AHEAD).unwrap();
        let tolerance = if camera.starts_with("SIMPLE") { 2e-3 } else { 1e-5 };
        assert!(found.distance(known.into()) < tolerance, "{camera}: {found}");
        let name = camera.split(' ').next().unwrap();
        assert_eq!(lens(&read.cameras[0]).unwrap().model(), name);
        assert_eq!(read.notices, Vec::<String>::new(), "a reader does not know how its cameras are drawn");
        let through = format!("1 of 1 cameras have lenses ({name}), which are drawn along the rays of their pixels");
        assert!(read.lens_notices()[0].starts_with(&through));
        assert!(as_pinholes(read)[0].starts_with(&format!("1 of 1 cameras have lenses that distort ({name})")));
    }
    for pinhole in ["PINHOLE 900 905 1010 740", "EUCM 900 905 1010 740 0 1", "DIVISION 900 905 1010 740 0"] {
        let read = model(pinhole);
        assert_eq!((lens(&read.cameras[0]), read.lens_notices().len()), (None, 0), "{pinhole}");
        assert_eq!(as_pinholes(read), Vec::<String>::new(), "{pinhole}");
    }
}

#[test]
fn binary_models_have_the_lenses_of_text_models() {
    let [binary, text] = ["sparse/1", "text"].map(|name| read(fixture(name)).cameras);
    let lenses = |of: &[NamedCamera]| of.iter().map(|named| lens(named).cloned()).collect::<Vec<_>>();
    assert_eq!(lenses(&binary), lenses(&text));
    assert_eq!(lenses(&text).iter().flatten().count(), 8);
}

/// The slope of the corner (0, 0) is (-1, -0.75), those of the others are less or equal.
#[test]
fn notices_count_what_lenses_do_not_see() {
    // The fold at the slope sqrt(1 / 0.9) = 1.054, where the radius is 0.7027 focal lengths.
    let folded = model("SIMPLE_RADIAL 1000 1000 750 -0.3");
    let distorted = "1 of 1 cameras have lenses that distort (SIMPLE_RADIAL), and are drawn as pinholes";
    // All corners have the slope 1.25.
    let through = folded.lens_notices();
    let notices = as_pinholes(folded);
    let [told, fold] = &notices[..] else { panic!("{notices:?}") };
    assert_eq!(&through[1..], [fold.as_str()], "it is said of pictures of the lens, too");
    assert_eq!(*told, format!("{distorted}, with 4 corners that the lenses do not see"));
    let angle = (1.0 / 0.9_f64).sqrt().atan().to_degrees();
    let (start, percent) = fold.split_once(": ").unwrap();
    assert_eq!(start, format!("the lens of 1 camera folds at {angle:.1} degrees"));
    // The circle of this radius, in a picture of 2000 by 1500 pixels.
    let radius = 1000.0 * (1.0 / 0.9_f64).sqrt() * 2.0 / 3.0;
    let blind = 100.0 * (1.0 - PI * radius * radius / (2000.0 * 1500.0));
    let percent: f64 = percent.strip_suffix(" % of their pixels see nothing").unwrap().parse().unwrap();
    assert!((percent - blind).abs() < 0.5, "{percent} of {blind}");

    let mild = model("SIMPLE_RADIAL 1000 1000 750 -0.05");
    let off = 0.05 * 1.25_f64.powi(3) * 1000.0;
    assert_eq!(mild.lens_notices().len(), 1, "the lens sees all of its picture");
    assert_eq!(as_pinholes(mild), [format!("{distorted}, with corners up to {off:.1} px off")]);

    // 180 degrees at pi focal lengths from the centre: an equidistant lens ends, but does not fold.
    let whole = as_pinholes(model("SIMPLE_FISHEYE 300 1000 750"));
    assert_eq!(whole.len(), 2);
    assert!(whole[1].starts_with("the lens of 1 camera ends at 180.0 degrees: "), "{whole:?}");
}

#[test]
fn members_of_transforms_json_make_the_lens_that_they_mean() {
    for (members, name, numbers) in [
        (r#""k1": -0.1, "p2": 0.01,"#, "PERSPECTIVE", &[-0.1, 0.0, 0.0, 0.0, 0.0, 0.01][..]),
        (r#""k1": -0.1, "k4": 0.02,"#, "PERSPECTIVE", &[-0.1, 0.0, 0.0, 0.02, 0.0, 0.0]),
        (
            r#""k1": -0.1, "k4": 0.02, "k6": 0.01, "s3": 0.03,"#,
            "OPENCV_THIN_PRISM",
            &[-0.1, 0.0, 0.0, 0.02, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.03, 0.0],
        ),
        (
            r#""camera_model": "FULL_OPENCV", "k1": -0.1, "k4": 0.02, "p1": 0.01,"#,
            "FULL_OPENCV",
            &[-0.1, 0.0, 0.01, 0.0, 0.0, 0.02, 0.0, 0.0],
        ),
        (r#""is_fisheye": true, "k1": -0.1, "k4": 0.02,"#, "OPENCV_FISHEYE", &[-0.1, 0.0, 0.0, 0.02]),
        (r#""camera_model": "OPENCV_FISHEYE", "k3": -0.1,"#, "OPENCV_FISHEYE", &[0.0, 0.0, -0.1, 0.0]),
        (
            r#""camera_model": "OPENCV_FISHEYE", "k3": -0.1, "p1": 0.01,"#,
            "THIN_PRISM_FISHEYE",
            &[0.0, 0.0, 0.01, 0.0, -0.1, 0.0, 0.0, 0.0],
        ),
    ] {
        let read = transforms(members);
        let lens = read.cameras[1].camera.lens.as_ref().unwrap();
        let expected = Lens::named(name, numbers).unwrap().unwrap();
        assert_eq!((lens.plane(AHEAD), lens.field()), (expected.plane(AHEAD), expected.field()), "{members}");
        assert!(std::sync::Arc::ptr_eq(lens, read.cameras[0].camera.lens.as_ref().unwrap()), "frames share the lens");
        let meaning =
            read.notices.iter().any(|n| n == "k4 is the coefficient of r^8, as in nerfstudio, no denominator");
        assert_eq!(meaning, name == "PERSPECTIVE" && numbers[3] != 0.0, "{members}: {:?}", read.notices);
    }
    assert_eq!(transforms(r#""k1": 0, "s1": 0, "camera_model": "OPENCV","#).cameras[0].camera.lens, None);
}

/// COLMAP states the sphere by its width and height, a transforms.json by the model alone.
#[test]
fn a_sphere_is_read_and_is_no_pinhole() {
    let colmap = model("EQUIRECTANGULAR 2000 1500");
    for read in [colmap, transforms(r#""camera_model": "EQUIRECTANGULAR","#), transforms(r#""equirectangular": true,"#)]
    {
        let camera = &read.cameras[0].camera;
        assert!(camera.lens.as_ref().unwrap().is_sphere());
        let right = camera.position + camera.rotation.transpose() * DVec3::X;
        let (at, depth) = camera.projected(right).unwrap();
        assert!(at.distance(glam::DVec2::new(1000.0 + 2000.0 * FRAC_PI_2 / (2.0 * PI), 750.0)) < 1e-9, "{at}");
        assert!((depth - 1.0).abs() < 1e-12);
        let problem = format!("{:#}", read.into_pinholes().unwrap_err());
        assert!(problem.ends_with(": no pinhole sees what its model EQUIRECTANGULAR does"), "{problem}");
    }
}
