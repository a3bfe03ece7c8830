//! Linked files of scenes: regular files inside the folder of the scene, read up to the length that the scene records.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::common::program::{fails, ok};
use crate::common::table::{fixture, parse_at, read};
use smalto::camera;

/// A glTF file with its buffer beside it, in a folder of its own.
struct Text {
    folder: tempfile::TempDir,
    document: Value,
    buffer: Vec<u8>,
}

impl Text {
    fn new() -> Self {
        let glb = fs::read(fixture("plush.glb")).unwrap();
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let document = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        Self { folder: tempfile::tempdir().unwrap(), document, buffer: glb[28 + length..].to_vec() }
    }

    /// Writes the document with a value changed; returns its path.
    fn with(&self, changes: &[(&str, Value)]) -> PathBuf {
        let mut document = self.document.clone();
        for (pointer, value) in changes {
            let (parent, name) = pointer.rsplit_once('/').unwrap();
            document.pointer_mut(parent).unwrap()[name] = value.clone();
        }
        let path = self.folder.path().join("a.gltf");
        fs::write(&path, document.to_string()).unwrap();
        path
    }
}

fn fifo(path: &Path) {
    _ = fs::remove_file(path);
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

#[test]
fn gltf_uris_are_decoded_and_stay_in_the_folder() {
    let text = Text::new();
    let expected = read(&fixture("plush.glb")).gaussians;
    fs::create_dir(text.folder.path().join("bin")).unwrap();
    for name in ["s.bin", "é ü+%.bin", "bin/s.bin"] {
        fs::write(text.folder.path().join(name), &text.buffer).unwrap();
    }
    let uris = ["s.bin", "./s.bin", "bin/../s.bin", "bin/s.bin", "%C3%A9%20%c3%bc+%25.bin", "%73.bin", "bin%2Fs.bin"];
    for uri in uris {
        assert!(parse_at(&text.with(&[("/buffers/0/uri", uri.into())])).unwrap().gaussians == expected, "{uri}");
    }
    let outside = ["../s.bin", "%2e%2e/s.bin", "/s.bin", "%2Fetc/passwd", "bin/../../s.bin", "http://a/s.bin", "", "."];
    for uri in outside {
        let problem = parse_at(&text.with(&[("/buffers/0/uri", uri.into())])).unwrap_err();
        assert!(problem.contains("is not the name of a file in the folder of the scene"), "{uri}: {problem}");
    }
    for (uri, expected) in [("none.bin", "there is no such file"), ("bin", "is not a file"), ("%ff.bin", "not UTF-8")] {
        let problem = parse_at(&text.with(&[("/buffers/0/uri", uri.into())])).unwrap_err();
        assert!(problem.contains(expected) && !problem.contains("os error"), "{uri}: {problem}");
    }
}

#[test]
fn what_gltf_requires_is_there_or_refused() {
    let text = Text::new();
    fs::write(text.folder.path().join("s.bin"), &text.buffer).unwrap();
    let beside = ("/buffers/0/uri", json!("s.bin"));
    let with = |pointer, value| parse_at(&text.with(&[beside.clone(), (pointer, value)]));
    let accepted = [
        ("/extensionsRequired", json!(["KHR_gaussian_splatting", "KHR_mesh_quantization"])),
        ("/meshes/0/primitives/0/mode", json!(0)),
        ("/buffers/0/byteLength", json!(text.buffer.len())),
    ];
    for (pointer, value) in accepted {
        with(pointer, value).unwrap();
    }
    let refused = [
        (
            "/extensionsRequired",
            json!(["EXT_meshopt_compression"]),
            "requires the glTF extension EXT_meshopt_compression",
        ),
        ("/scene", json!(99), "shows glTF scene 99, but has 1"),
        ("/meshes/0/primitives/0/mode", json!(4), "has mode 4, not 0 (points)"),
        ("/buffers/0/byteLength", json!(text.buffer.len() + 1), "buffer 0: s.bin: its byteLength takes"),
        ("/buffers/0/byteLength", json!(1_000_000_000_000_000_000_u64), "buffer 0: s.bin: its byteLength takes"),
        ("/buffers/0/byteLength", json!(-1), "invalid value: integer `-1`"),
        ("/buffers/0/byteLength", json!(100), "outside of its buffer of 100 bytes"),
    ];
    for (pointer, value, expected) in refused {
        let problem = with(pointer, value).unwrap_err();
        assert!(problem.contains(expected), "{pointer}: {problem}");
    }
    // Of a longer file only the stated bytes are read.
    let file = fs::File::options().write(true).open(text.folder.path().join("s.bin")).unwrap();
    file.set_len(1 << 40).unwrap();
    with("/scene", json!(0)).unwrap();
}

/// Opening a FIFO waits for its other end, and a device may never end: both are refused at once.
#[test]
fn fifos_and_devices_that_a_scene_names_are_refused_at_once() {
    let text = Text::new();
    let buffer = text.folder.path().join("s.bin");
    let gltf = text.with(&[("/buffers/0/uri", "s.bin".into())]);
    let refused = |path: &Path| {
        let problem = parse_at(path).map(drop).unwrap_err();
        assert!(problem.contains("is not a file"), "{}: {problem}", path.display());
    };
    fifo(&buffer);
    refused(&gltf);
    fs::remove_file(&buffer).unwrap();
    std::os::unix::fs::symlink("/dev/zero", &buffer).unwrap();
    refused(&gltf);

    let sog = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(fixture("plush.v1")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), sog.path().join(entry.file_name())).unwrap();
    }
    for name in ["means_l.webp", "shN_centroids.webp"] {
        let kept = fs::read(sog.path().join(name)).unwrap();
        fifo(&sog.path().join(name));
        refused(&sog.path().join("meta.json"));
        fs::remove_file(sog.path().join(name)).unwrap();
        fs::write(sog.path().join(name), kept).unwrap();
    }
    read(&sog.path().join("meta.json"));

    let levels = tempfile::tempdir().unwrap();
    let tree = json!({"filenames": ["a.sog"], "tree": {"lods": {"0": {"file": 0, "count": 1}}}});
    fs::write(levels.path().join("lod-meta.json"), tree.to_string()).unwrap();
    fifo(&levels.path().join("a.sog"));
    refused(&levels.path().join("lod-meta.json"));

    let model = tempfile::tempdir().unwrap();
    let iteration = model.path().join("point_cloud/iteration_7");
    fs::create_dir_all(&iteration).unwrap();
    fifo(&iteration.join("point_cloud.ply"));
    assert!(fails(4, &["info", &model.path().display().to_string()]).contains("is not a file"));

    for (folder, file) in [("colmap/sparse/0", "cameras.bin"), ("colmap/text", "images.txt")] {
        let cameras = tempfile::tempdir().unwrap();
        for entry in fs::read_dir(fixture(folder)).unwrap() {
            let entry = entry.unwrap();
            fs::copy(entry.path(), cameras.path().join(entry.file_name())).unwrap();
        }
        let path = cameras.path().join(file);
        fifo(&path);
        let problem = format!("{:#}", camera::read(&path).unwrap_err());
        assert!(problem.contains("is not a file"), "{problem}");
    }
}

/// A model folder of the original, its `point_cloud`, and an iteration are the scene of that iteration.
#[test]
fn folders_of_a_model_name_its_scene() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("garden.v2");
    for (iteration, name) in [("7000", "plush.sh0.ply"), ("30000", "plush.ply")] {
        let target = model.join("point_cloud").join(format!("iteration_{iteration}"));
        fs::create_dir_all(&target).unwrap();
        fs::copy(fixture(name), target.join("point_cloud.ply")).unwrap();
    }
    for (path, degree) in [("", 3), ("point_cloud", 3), ("point_cloud/iteration_7000", 0)] {
        let text = ok(&["info", &model.join(path).display().to_string()]);
        assert!(text.contains(&format!("SH degree {degree}")), "{path}: {text}");
    }
}
