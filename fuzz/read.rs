//! The fuzz target of all readers. `SMALTO_READER` selects the reader; README.md in this folder shows how to run it.

#![no_main]

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use flate2::{Compression, write::GzEncoder};
use libfuzzer_sys::fuzz_target;
use smalto::camera::{self, Timeline};
use smalto::formats::Reading;
use smalto::pagefile;
use smalto::scene::Watch;
use tempfile::TempDir;

/// The reader of a fuzzed file.
#[derive(Clone, Copy)]
enum Reads {
    Scene,
    Cameras,
    /// Reads the folder of the file, which holds several files.
    CameraFolder,
    Timeline,
}

/// A reader with the file that is fuzzed.
struct Subject {
    name: &'static str,
    reads: Reads,
    /// Name of the file. Its extension selects the format where the content does not.
    file: &'static str,
    /// Folder of fixtures whose undamaged files are copied next to it; none if empty.
    beside: &'static str,
    /// The fuzzed bytes are compressed to a valid gzip file. Otherwise its checksum would reject every change.
    is_gzip: bool,
}

const fn subject(name: &'static str, reads: Reads, file: &'static str, beside: &'static str) -> Subject {
    Subject { name, reads, file, beside, is_gzip: false }
}

const SUBJECTS: [Subject; 19] = [
    subject("ply", Reads::Scene, "a.ply", ""),
    subject("spz", Reads::Scene, "a.spz", ""),
    Subject { is_gzip: true, ..subject("spz-gzip", Reads::Scene, "a.spz", "") },
    subject("splat", Reads::Scene, "a.splat", ""),
    subject("ksplat", Reads::Scene, "a.ksplat", ""),
    subject("rad", Reads::Scene, "a.rad", ""),
    subject("sog", Reads::Scene, "a.sog", ""),
    subject("sog-meta", Reads::Scene, "meta.json", "plush.v1"),
    subject("sog-levels", Reads::Scene, "lod-meta.json", "lod"),
    subject("glb", Reads::Scene, "a.glb", ""),
    subject("gltf", Reads::Scene, "a.gltf", ""),
    subject("pages", Reads::Scene, "a.smalto", ""),
    subject("cameras-json", Reads::Cameras, "cameras.json", ""),
    subject("transforms-json", Reads::Cameras, "transforms.json", ""),
    subject("timeline", Reads::Timeline, "path.json", ""),
    subject("colmap-cameras-bin", Reads::CameraFolder, "cameras.bin", "colmap/sparse/0"),
    subject("colmap-images-bin", Reads::CameraFolder, "images.bin", "colmap/sparse/0"),
    subject("colmap-cameras-txt", Reads::CameraFolder, "cameras.txt", "colmap/text"),
    subject("colmap-images-txt", Reads::CameraFolder, "images.txt", "colmap/text"),
];

/// The subject of this run, and the folder that its file lies in.
struct Run {
    subject: &'static Subject,
    folder: TempDir,
}

static RUN: LazyLock<Run> = LazyLock::new(|| {
    // One thread only: a panic on another thread would not be a panic of the target.
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global().expect("there is no pool yet");
    let name = std::env::var("SMALTO_READER").unwrap_or_default();
    let subject = SUBJECTS.iter().find(|subject| subject.name == name).unwrap_or_else(|| {
        let names = SUBJECTS.map(|subject| subject.name);
        panic!("SMALTO_READER is not one of {}", names.join(", "))
    });
    let folder = tempfile::tempdir().expect("there is a folder for temporary files");
    if !subject.beside.is_empty() {
        copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures").join(subject.beside), folder.path());
    }
    Run { subject, folder }
});

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("folders can be made");
    for entry in fs::read_dir(from).expect("fixtures are in place") {
        let path = entry.expect("fixtures can be listed").path();
        let target = to.join(path.file_name().expect("an entry has a name"));
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).expect("fixtures can be copied");
        }
    }
}

impl Run {
    fn write(&self, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join(self.subject.file);
        let mut file = fs::File::create(&path).expect("the file can be made");
        if self.subject.is_gzip {
            let mut gzip = GzEncoder::new(file, Compression::none());
            gzip.write_all(bytes).and_then(|()| gzip.finish()).expect("the file can be written");
        } else {
            file.write_all(bytes).expect("the file can be written");
        }
        path
    }
}

fuzz_target!(|bytes: &[u8]| {
    let path = RUN.write(bytes);
    let problem = match RUN.subject.reads {
        Reads::Scene => {
            let watch = Watch::NONE;
            let levels = Reading::default().read_levels(&path, &watch).err();
            pagefile::read(&Reading::default(), &path, &watch).err().or(levels)
        }
        Reads::Cameras => camera::read(&path).err(),
        Reads::CameraFolder => camera::read(RUN.folder.path()).err(),
        Reads::Timeline => Timeline::read(&path).err(),
    };
    if let Some(problem) = problem {
        let sentence = problem.to_string();
        assert!(!sentence.contains('\n') && sentence.len() < 1000, "{sentence}");
    }
});
