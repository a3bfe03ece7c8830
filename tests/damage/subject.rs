//! The files that are damaged, one kind each: scenes, cameras, keyframes, images and reports.

use std::fs;
use std::path::{Path, PathBuf};

use crate::change::Change;
use crate::common::program::ok;
use crate::common::table::fixture;
use smalto::camera::{self, NamedCamera, Timeline};
use smalto::formats::{FORMATS, Reading};
use smalto::measure::bench;
use smalto::pagefile;
use smalto::pixels::{Alpha, Compression, FileKind, Pixels};
use smalto::scene::{Scene, Unreadable, Watch};

/// Reads a file; the error is what the commands print.
pub type Reader = fn(&Path) -> Result<(), String>;

/// A file to damage, in a folder with what it needs beside it.
pub struct Subject {
    pub name: String,
    pub change: Change,
    pub reader: Reader,
    /// The file that is damaged, and its undamaged content.
    pub damaged: PathBuf,
    pub whole: Vec<u8>,
    /// The file that is read.
    pub opened: PathBuf,
}

pub fn scene(path: &Path) -> Result<(), String> {
    read_scene(path).map(drop).map_err(|error| error.to_string())
}

/// Reads a scene file of any format.
pub fn read_scene(path: &Path) -> anyhow::Result<Scene> {
    let watch = Watch::NONE;
    pagefile::read(&Reading::default(), path, &watch)
}

/// Reads all levels.
fn levels(path: &Path) -> Result<(), String> {
    Reading::default().read_levels(path, &Watch::NONE).map(drop).map_err(|error| error.to_string())
}

fn cameras(path: &Path) -> Result<(), String> {
    camera::read(path).map(drop).map_err(|error| Unreadable::new(path, &error).to_string())
}

fn keyframes(path: &Path) -> Result<(), String> {
    Timeline::read(path).map(drop).map_err(|error| Unreadable::new(path, &error).to_string())
}

fn image(path: &Path) -> Result<(), String> {
    Pixels::read(path).map(drop).map_err(|error| Unreadable::new(path, &error).to_string())
}

fn report(path: &Path) -> Result<(), String> {
    bench::Report::read(path).map(drop).map_err(|error| Unreadable::new(path, &error).to_string())
}

/// Collects the subjects in folders below one.
struct Subjects<'f> {
    folder: &'f Path,
    all: Vec<Subject>,
}

impl Subjects<'_> {
    /// An empty folder for the next subject.
    fn next_folder(&self) -> PathBuf {
        let folder = self.folder.join(self.all.len().to_string());
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    /// A file by itself.
    fn file(&mut self, name: &str, whole: Vec<u8>, change: Change, reader: Reader) {
        let damaged = self.next_folder().join(name);
        let name = format!("{name}, {change:?}");
        self.all.push(Subject { name, change, reader, opened: damaged.clone(), damaged, whole });
    }

    /// One file of a copied folder of fixtures; `opened` is what is read.
    fn in_folder(&mut self, fixtures: &str, file: &str, opened: &str, change: Change, reader: Reader) {
        let folder = self.next_folder();
        copy(&fixture(fixtures), &folder);
        let (damaged, opened) = (folder.join(file), folder.join(opened));
        let (name, whole) = (format!("{fixtures}/{file}, {change:?}"), fs::read(&damaged).unwrap());
        self.all.push(Subject { name, change, reader, damaged, whole, opened });
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() { copy(&path, &target) } else { fs::write(target, fs::read(&path).unwrap()).unwrap() }
    }
}

/// All subjects. Their files lie below `folder`.
pub fn all(folder: &Path) -> Vec<Subject> {
    let mut subjects = Subjects { folder, all: Vec::new() };
    scenes(&mut subjects);
    others(&mut subjects);
    subjects.all
}

fn scenes(subjects: &mut Subjects) {
    let mut files: Vec<PathBuf> = fs::read_dir(fixture("")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for path in files {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let ending = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        if FORMATS.iter().any(|format| format.name == ending) {
            let whole = fs::read(&path).unwrap();
            subjects.file(&name, whole.clone(), Change::Bytes, scene);
            match (ending.as_str(), &whole[..2]) {
                ("spz", [0x1f, 0x8b]) => subjects.file(&name, whole, Change::InsideGzip, scene),
                ("sog", _) => subjects.file(&name, whole, Change::InsideZip, scene),
                ("glb", _) => subjects.file(&name, whole, Change::Json, scene),
                _ => {}
            }
        }
    }
    for storage in ["lossless", "u8"] {
        let path = subjects.folder.join("pages.smalto");
        ok(&[
            "convert",
            &fixture("plush.ply").display().to_string(),
            &path.display().to_string(),
            "--storage",
            storage,
        ]);
        let whole = fs::read(path).unwrap();
        subjects.file("a.smalto", whole.clone(), Change::Bytes, scene);
        if storage == "lossless" {
            subjects.file("b.smalto", whole, Change::InsidePages, scene);
        }
    }
    for name in ["plush-default-lod.rad", "plush-clusters-lod.rad", "plush-enc-f16lebytes-r8-s8delta.rad"] {
        subjects.in_folder("rad", name, name, Change::Bytes, scene);
    }
    subjects.in_folder("rad", "plush-default-lod.rad", "plush-default-lod.rad", Change::Bytes, levels);
    subjects.in_folder("rad", "plush-chunked-lod-0.radc", "plush-chunked-lod.rad", Change::Bytes, scene);
    let kept = subjects.folder.join("kept.smalto");
    ok(&["lod", &fixture("lod").display().to_string(), "--keep-levels", "-o", &kept.display().to_string()]);
    let whole = fs::read(kept).unwrap();
    subjects.file("c.smalto", whole.clone(), Change::Bytes, scene);
    subjects.file("d.smalto", whole, Change::InsidePages, scene);
    for texture in ["means_l.webp", "quats.webp", "shN_centroids.webp", "shN_labels.webp"] {
        subjects.in_folder("plush.v1", texture, "meta.json", Change::Bytes, scene);
    }
    subjects.in_folder("plush.v1", "meta.json", "meta.json", Change::Json, scene);
    subjects.in_folder("lod", "lod-meta.json", "", Change::Json, scene);
    subjects.in_folder("lod", "lod-meta.json", "", Change::Json, levels);
    subjects.in_folder("lod", "1_0/meta.json", "", Change::Json, scene);
    subjects.in_folder("lod", "1_0/meta.json", "", Change::Json, levels);
    subjects.in_folder("lod", "0_0/meta.json", "", Change::Json, scene);
    // A .gltf with its buffer beside it.
    let glb = fs::read(fixture("plush.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let text = String::from_utf8(glb[20..20 + length].to_vec()).unwrap();
    let text = text.replacen("\"buffers\":[{", "\"buffers\":[{\"uri\":\"a%20b.bin\",", 1);
    assert!(text.contains("a%20b.bin"));
    subjects.file("a.gltf", text.into_bytes(), Change::Json, scene);
    let beside = subjects.all.last().unwrap().damaged.with_file_name("a b.bin");
    fs::write(beside, &glb[28 + length..]).unwrap();
}

fn others(subjects: &mut Subjects) {
    let shots: Vec<_> = camera::path::orbit(glam::DVec3::ZERO, 2.0, true, [64, 48], 5)
        .into_iter()
        .enumerate()
        .map(|(i, camera)| NamedCamera::new(format!("{i}.png"), camera))
        .collect();
    let path = subjects.folder.join("cameras.json");
    camera::write(&path, &shots).unwrap();
    let list = fs::read(path).unwrap();
    for change in [Change::Json, Change::Bytes] {
        subjects.file("cameras.json", list.clone(), change, cameras);
        subjects.file("path.json", list.clone(), change, keyframes);
        subjects.file("transforms.json", TRANSFORMS.into(), change, cameras);
        subjects.file("camera_path.json", CAMERA_PATH.into(), change, keyframes);
    }
    for file in ["cameras.bin", "images.bin"] {
        subjects.in_folder("colmap/sparse/1", file, "", Change::Bytes, cameras);
    }
    for file in ["cameras.txt", "images.txt"] {
        subjects.in_folder("colmap/text", file, "", Change::Bytes, cameras);
    }
    let picture = Pixels { size: [5, 4], rgba: vec![[0.25, 0.5, 0.75, 1.0]; 20] };
    for (name, kind) in [("a.png", FileKind::Png), ("a.exr", FileKind::Exr), ("a.npy", FileKind::Npy)] {
        let path = subjects.folder.join(name);
        picture.write_as(kind, Compression::Fast, &path, Alpha::Opaque).unwrap();
        subjects.file(name, fs::read(path).unwrap(), Change::Bytes, image);
    }
    let path = subjects.folder.join("report.json");
    let path_text = path.display().to_string();
    ok(&["bench", "cactus:100", "--size", "48x40", "--frames", "3", "--warmup", "0", "--json", &path_text]);
    let report_text = fs::read(path).unwrap();
    for change in [Change::Json, Change::Bytes] {
        subjects.file("report.json", report_text.clone(), change, report);
    }
}

/// A camera path of nerfstudio.
const CAMERA_PATH: &str = r#"{"camera_type": "perspective", "render_width": 64, "render_height": 48, "seconds": 2,
    "camera_path": [{"camera_to_world": [1, 0, 0, 0, 0, -1, 0, -1.2, 0, 0, -1, -5, 0, 0, 0, 1], "fov": 40},
                    {"camera_to_world": [1, 0, 0, 1, 0, -1, 0, -1.2, 0, 0, -1, -5, 0, 0, 0, 1], "fov": 50}]}"#;

const TRANSFORMS: &str = r#"{"camera_model": "OPENCV", "fl_x": 40.0, "fl_y": 41.0, "cx": 32.0, "cy": 24.0, "w": 64,
"h": 48, "k1": 0.01, "applied_transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "frames": [
{"file_path": "images/a.png", "transform_matrix": [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]},
{"file_path": "images/b.png", "fl_x": 50.0, "transform_matrix": [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3],
[0, 0, 0, 1]]}]}"#;
