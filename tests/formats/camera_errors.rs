//! Camera files that are wrong: one clear sentence for every fault.

use std::collections::HashMap;
use std::fs;

use crate::common::Random;
use smalto::camera::{self, Timeline};

use super::cameras::{FRAME, expected, fixture, read, refused, transforms, written};

#[test]
fn errors_of_transforms_json_name_the_fault() {
    let right = format!(r#"{{"w": 80, "h": 40, "fl_x": 100, "frames": [{FRAME}]}}"#);
    for (from, to, expected) in [
        ("\"frames\"", "\"fames\"", "nor a transforms.json: it has no array `frames`"),
        ("{\"w\"", "{w", "is not JSON: "),
        ("[[1, 0, 0, 0]", "[[1, 0, 0]", "frame 0: its transform_matrix is not 3 or 4 rows of 4 numbers"),
        ("[[1, 0, 0, 0]", "[[2, 0, 0, 0]", "frame 0: its rotation is not a rotation matrix"),
        ("[[1, 0, 0, 0]", "[[-1, 0, 0, 0]", "not a rotation matrix"),
        ("[[1, 0, 0, 0]", "[[1, 0, 0, 1e31]", "its position is not within 1e30"),
        ("[0, 0, 0, 1]", "[0, 0, 1, 1]", "the last row of its transform_matrix is not 0, 0, 0, 1"),
        ("transform_matrix", "matrix", "it has no transform_matrix"),
        ("80", "80.5", "its size 80.5x40.0 is not of whole numbers from 1 to 65536"),
        ("80", "65537", "its size 65537.0x40.0"),
        ("80", "\"80\"", "frame 0: its w is not a number"),
        ("\"w\": 80,", "", "frame 0: it has no size (w and h), and its photograph"),
        ("\"fl_x\": 100", "\"fl_x\": -100", "its focal lengths -100.0 and -100.0 are not over 0"),
        ("\"fl_x\": 100", "\"camera_angle_x\": 4", "are not over 0"),
        ("\"fl_x\": 100,", "", "it has no focal length: neither fl_x nor camera_angle_x"),
        ("\"w\"", "\"latlong\": true, \"w\"", "frame 0: its camera model latlong is not supported"),
        ("\"w\"", "\"camera_model\": \"ORTHOPHOTO\", \"w\"", "its camera model ORTHOPHOTO is not supported, only"),
        ("\"w\"", "\"orthographic\": true, \"w\"", "its camera model orthographic is not supported"),
        ("\"w\"", "\"k1\": -1e6, \"w\"", "frame 0: its coefficients k1 -1000000.0 fold at the centre of the picture"),
        ("\"w\"", "\"k1\": 1e300, \"w\"", "frame 0: its parameter k1 1e300 is not within 1e9"),
        ("\"w\"", "\"train_filenames\": 7, \"w\"", "train_filenames is not an array of names"),
        (FRAME, "7", "frame 0 is not an object"),
        (FRAME, "", "holds no camera"),
    ] {
        let (_folder, file) = written("transforms.json", right.replacen(from, to, 1));
        let problem = refused(&file);
        assert!(problem.contains(expected), "{problem}");
    }
    let (_folder, file) = written("transforms.json", right.replace(", [0, 0, 0, 1]", ""));
    assert_eq!(read(&file).cameras.len(), 1, "three rows are enough");
}

#[test]
fn errors_of_colmap_files_name_the_fault() {
    let [cameras, images] =
        ["cameras", "images"].map(|name| fs::read(fixture("sparse/1").join(name).with_extension("bin")).unwrap());
    let changed = |bytes: &[u8], at: usize, to: &[u8]| [&bytes[..at], to, &bytes[at + to.len()..]].concat();
    let first = images[72..].iter().position(|b| *b == 0).unwrap() + 73;
    let huge = u64::MAX.to_le_bytes();
    for (name, bytes, expected) in [
        (
            "cameras",
            changed(&cameras, 0, &huge),
            "cameras.bin: the file claims 18446744073709551615 cameras, its 840 bytes left hold 21 at most",
        ),
        ("cameras", changed(&cameras, 0, &[11]), "cameras.bin: 48 bytes follow the last one that the file counts"),
        (
            "cameras",
            changed(&cameras, 0, &[13]),
            "cameras.bin: the file ends at byte 848, inside a camera at bytes 848 to 852",
        ),
        ("cameras", changed(&cameras, 12, &[18]), "its camera model 18 is not one of COLMAP's, 0 to 17"),
        ("cameras", changed(&cameras, 16, &[0; 8]), "its size 0x240 is not from 1 to 65536 pixels"),
        ("cameras", changed(&cameras, 32, &f64::NAN.to_le_bytes()), "its parameters are not all numbers"),
        ("cameras", changed(&cameras, 8, &[200]), "there is no camera "),
        ("images", changed(&images, 0, &huge), "images.bin: the file claims 18446744073709551615 images"),
        ("images", changed(&images, first, &huge), "image 0: the file claims 18446744073709551615 points"),
        ("images", changed(&images, 12, &[0; 32]), "its quaternion 0.0 0.0 0.0 0.0 is no rotation"),
        ("images", changed(&images, 44, &1e31_f64.to_le_bytes()), "its position is not within 1e30 of the origin"),
        ("images", changed(&images[..first - 3], 0, &[1]), "inside a name from byte 72 on"),
        (
            "images",
            [&images[..72], &[b'a'; 9000]].concat(),
            "image 0: the name at byte 72 has no end within 4096 bytes",
        ),
        ("images", images[..8].to_vec(), "the file claims 12 images, its 0 bytes left hold 0 at most"),
        ("images", vec![0; 8], "holds no camera"),
        ("images", vec![], "the file ends at byte 0, inside the number of images at bytes 0 to 8"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("cameras.bin"), &cameras).unwrap();
        fs::write(folder.path().join("images.bin"), &images).unwrap();
        fs::write(folder.path().join(name).with_extension("bin"), bytes).unwrap();
        let problem = refused(folder.path());
        assert!(problem.contains(expected), "{problem}");
    }
    let [cameras, images] =
        ["cameras.txt", "images.txt"].map(|name| fs::read_to_string(fixture("text").join(name)).unwrap());
    let without_points: String =
        images.lines().filter(|line| line.contains(".jpg")).flat_map(|line| [line, "\n"]).collect();
    for (name, text, expected) in [
        ("cameras", cameras.replace("FOV", "VOF"), "cameras.txt: line 4: its camera model VOF is not one of COLMAP's"),
        ("cameras", cameras.replace("0.90000000000000002", ""), "line 4: FOV has 5 parameters, it has 4"),
        ("cameras", cameras.replace("0.90000000000000002", "4"), "line 4: its omega 4.0 is not over 0 and under pi"),
        (
            "cameras",
            cameras.replace("FOV 320 240 300 301 159 122 0.90000000000000002", "EQUIRECTANGULAR 320 160 320"),
            "line 4: EQUIRECTANGULAR has 2 parameters, it has 1",
        ),
        ("cameras", cameras.replace("23 FOV 320", "23 FOV wide"), "line 4: 'wide' is not a width"),
        ("cameras", cameras.replace("30 SIMPLE_FISHEYE", "23 SIMPLE_FISHEYE"), "line 5: camera 23 is there twice"),
        ("images", images.replace("left/012.jpg", ""), "images.txt: line 5: it has no name"),
        ("images", images.replace("100 left/012.jpg", "99 left/012.jpg"), "left/012.jpg: there is no camera 99"),
        ("images", images.replace("-0.91011582566925375", "nan"), "its quaternion NaN"),
        ("images", without_points, "images.txt: line 2: expected the points of an image (x y id each)"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        fs::copy(fixture("text/cameras.txt"), folder.path().join("cameras.txt")).unwrap();
        fs::copy(fixture("text/images.txt"), folder.path().join("images.txt")).unwrap();
        fs::write(folder.path().join(name).with_extension("txt"), text).unwrap();
        let problem = refused(folder.path());
        assert!(problem.contains(expected), "{problem}");
    }
}

#[test]
fn colmap_lists_shorter_than_their_count_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(fixture("text/cameras.txt"), folder.path().join("cameras.txt")).unwrap();
    let images = fs::read_to_string(fixture("text/images.txt")).unwrap();
    assert_eq!(read(fixture("text")).notices.iter().filter(|notice| notice.contains("says")).count(), 0);
    let cut: String = images.lines().take(4 + 2 * 7).flat_map(|line| [line, "\n"]).collect();
    fs::write(folder.path().join("images.txt"), cut).unwrap();
    let cut = read(folder.path());
    assert_eq!(cut.cameras.len(), 7);
    let notice = "images.txt states 12 photographs but holds 7";
    assert!(cut.notices.iter().any(|n| n == notice), "{:?}", cut.notices);
}

#[test]
fn files_that_are_no_camera_files_are_refused() {
    for (content, expected) in [
        ("", "the file is empty"),
        ("[]", "holds no camera"),
        ("ply\n", "is not a camera file that smalto reads: expected cameras.json, transforms.json"),
        ("   ", "is not a camera file"),
    ] {
        let (_folder, file) = written("cameras.json", content);
        assert!(refused(&file).contains(expected), "{content}");
    }
    assert_eq!(refused("no/such.json"), "cannot be opened: there is no such file");
    assert_eq!(refused("no/images.bin"), "cameras.bin: cannot be opened: there is no such file");
    assert_eq!(refused("src"), "is a folder with neither cameras.json, transforms.json nor a sparse model of COLMAP");
    #[cfg(unix)]
    assert_eq!(refused("/dev/zero"), "is not a file");
}

/// Bytes changed at random: a file is read or refused in one sentence, never a panic or an endless read.
#[test]
fn camera_files_with_random_damage_never_panic() {
    let expected = expected();
    let cameras: Vec<_> = expected.iter().map(|e| &e.named).collect();
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("cameras.json");
    camera::write(&json, &expected.iter().map(|e| e.named.clone()).collect::<Vec<_>>()).unwrap();
    let mut files = HashMap::from([("cameras.json", fs::read(&json).unwrap())]);
    files.insert(
        "transforms.json",
        transforms(&cameras, "\"train_filenames\": [\"left/001.jpg\"], \"k1\": 0.1,").into_bytes(),
    );
    for name in ["cameras.txt", "images.txt"] {
        files.insert(name, fs::read(fixture("text").join(name)).unwrap());
    }
    for name in ["cameras.bin", "images.bin"] {
        files.insert(name, fs::read(fixture("sparse/1").join(name)).unwrap());
    }
    let mut random = Random(7);
    for (name, whole) in &files {
        let folder = tempfile::tempdir().unwrap();
        let partner =
            [("cameras.", "images."), ("images.", "cameras.")].into_iter().find(|(of, _)| name.starts_with(of));
        let partner = partner.map(|(of, other)| name.replace(of, other));
        if let Some((partner, content)) = partner.and_then(|p| files.get_key_value(p.as_str())) {
            fs::write(folder.path().join(partner), content).unwrap();
        }
        let file = folder.path().join(name);
        let (mut read, mut refused) = (0, 0);
        for _ in 0..400 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random.below(4) {
                // Headers more often than data.
                let end = if random.below(2) == 0 { 100.min(bytes.len()) } else { bytes.len() };
                bytes[random.below(end as u32) as usize] = random.bits() as u8;
            }
            if random.below(4) == 0 {
                bytes.truncate(random.below(bytes.len() as u32) as usize);
            }
            fs::write(&file, &bytes).unwrap();
            _ = Timeline::read(&file);
            match camera::read(&file) {
                Ok(_) => read += 1,
                Err(problem) => {
                    let sentence = format!("{problem:#}");
                    let is_one = !sentence.contains('\n') && !sentence.starts_with(char::is_uppercase);
                    assert!(is_one && sentence.len() < 400, "{name}: {sentence}");
                    refused += 1;
                }
            }
        }
        assert!(refused > 50, "{name}: {read} read, {refused} refused");
    }
}
