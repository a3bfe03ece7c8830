//! Reading with a watch: partial scenes, progress and cancelling.

use std::cell::{Cell, RefCell};
use std::fs;
use std::io::Write;
use std::path::PathBuf;

use smalto::formats;
use smalto::formats::Reading;
use smalto::scene::{Builder, Cancelled, Gaussians, Unreadable, Watch};

/// Gaussians in each file: four whole blocks of 65,536 and a part of one.
const COUNT: usize = 300_000;

/// The numbers of the Gaussians after which something is shown: a block, two, four.
const SHOWN: [usize; 3] = [65_536, 131_072, 262_144];

fn ply() -> Vec<u8> {
    let names =
        ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1"];
    let properties: String = names.iter().chain(&["rot_2", "rot_3"]).map(|n| format!("property float {n}\n")).collect();
    let header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {COUNT}\n{properties}end_header\n");
    let mut file = header.into_bytes();
    for i in 0..COUNT {
        let mut row = [0.5_f32; 14];
        row[0] = i as f32;
        file.extend_from_slice(bytemuck::cast_slice(&row));
    }
    file
}

fn compressed_ply() -> Vec<u8> {
    let axes = ["x", "y", "z", "scale_x", "scale_y", "scale_z"];
    let ends: String = ["min", "max"].iter().flat_map(|e| axes.map(|a| format!("property float {e}_{a}\n"))).collect();
    let packed = ["position", "rotation", "scale", "color"].map(|p| format!("property uint packed_{p}\n")).concat();
    let chunks = COUNT.div_ceil(256);
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk {chunks}\n{ends}\
         element vertex {COUNT}\n{packed}end_header\n"
    );
    let mut file = header.into_bytes();
    for i in 0..chunks {
        let (low, high) = ([i as f32, 0.0, 0.0, 0.0, 0.0, 0.0], [i as f32 + 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        file.extend_from_slice(bytemuck::cast_slice(&[low, high]));
    }
    for i in 0..COUNT as u32 {
        file.extend_from_slice(bytemuck::cast_slice(&[(i % 256) << 24, 0, 0, 0x8080_8080]));
    }
    file
}

/// Header and planes of an SPZ of this version.
fn spz(version: u32) -> (Vec<u8>, Vec<Vec<u8>>) {
    let mut header = [0x5053_474e, version, COUNT as u32].map(u32::to_le_bytes).concat();
    header.extend([0, 4, 0, if version == 4 { 5 } else { 0 }]);
    let positions = (0..COUNT as u32).flat_map(|i| [&i.to_le_bytes()[..3], &[0; 6]].concat()).collect();
    let planes = [(128, 1), (100, 3), (160, 3), (7, 4)].map(|(value, bytes)| vec![value; bytes * COUNT]);
    (header, [vec![positions], planes.to_vec()].concat())
}

fn spz_3() -> Vec<u8> {
    let (header, planes) = spz(3);
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(&[header, planes.concat()].concat()).unwrap();
    encoder.finish().unwrap()
}

fn spz_4() -> Vec<u8> {
    let (mut file, planes) = spz(4);
    file.extend([32_u32, 0, 0, 0].map(u32::to_le_bytes).concat());
    let streams = planes.iter().map(|plane| zstd::encode_all(&plane[..], 1).unwrap()).collect::<Vec<_>>();
    for (stream, plane) in streams.iter().zip(&planes) {
        file.extend([stream.len() as u64, plane.len() as u64].map(u64::to_le_bytes).concat());
    }
    [file, streams.concat()].concat()
}

/// A file of every format, in a folder that goes when dropped.
fn files() -> (tempfile::TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let contents = [("a.ply", ply()), ("a.compressed.ply", compressed_ply()), ("3.spz", spz_3()), ("4.spz", spz_4())];
    let paths = contents.map(|(name, content)| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        path
    });
    (folder, paths.to_vec())
}

fn is_beginning(part: &Gaussians, whole: &Gaussians) -> bool {
    let count = part.len();
    part.means() == &whole.means()[..count]
        && part.scales() == &whole.scales()[..count]
        && part.rotations() == &whole.rotations()[..count]
        && part.opacities() == &whole.opacities()[..count]
        && (0..count).all(|i| part.sh(i) == whole.sh(i))
}

#[test]
fn previews_are_prefixes_of_the_scene_that_double_in_size() {
    let (_folder, paths) = files();
    for path in paths {
        let expected = formats::read(&path).unwrap().gaussians;
        assert_eq!(expected.len(), COUNT, "{}", path.display());
        assert!(expected.means()[1] != expected.means()[2], "the order can be told");
        let (shown, last) = (RefCell::new(Vec::new()), Cell::new(0.0));
        let partial = |part: &Builder| {
            let part = part.so_far().unwrap();
            assert!(is_beginning(&part, &expected), "{}", path.display());
            // What is said to be done is done: reading alone is at most two fifths of it. A PLY is decoded block by
            // block while it is read.
            let most = 0.4 + 0.6 * part.len() as f64 / COUNT as f64 + 0.05;
            let is_ply = path.extension().is_some_and(|ending| ending == "ply");
            assert!(is_ply || last.get() <= most, "{}: {} after {}", path.display(), last.get(), part.len());
            shown.borrow_mut().push(part.len());
        };
        let progress = |fraction| {
            assert!((last.get()..=1.0).contains(&fraction), "{}: {fraction}", path.display());
            last.set(fraction);
        };
        let watch = Watch { progress: &progress, partial: &partial, is_cancelled: &|| false };
        assert_eq!(Reading::default().read_watched(&path, &watch).unwrap().gaussians, expected);
        assert_eq!(*shown.borrow(), SHOWN, "{}", path.display());
        assert!(last.get() > 0.99);
    }
}

#[test]
fn small_scenes_have_no_preview() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/plush.ply");
    let partial = |_: &Builder| panic!("there is too little to show");
    Reading::default().read_watched(&path, &Watch { partial: &partial, ..Watch::NONE }).unwrap();
}

/// Reading is cancelled after any number of questions, in every part of the reader.
#[test]
fn reading_ends_soon_after_it_is_cancelled() {
    let (_folder, paths) = files();
    for path in paths {
        for patience in [0, 1, 50, 198, 202] {
            let asked = Cell::new(0);
            let is_cancelled = || {
                asked.set(asked.get() + 1);
                asked.get() > patience
            };
            let watch = Watch { is_cancelled: &is_cancelled, ..Watch::NONE };
            match Reading::default().read_watched(&path, &watch) {
                Ok(_) => assert!(asked.get() <= patience, "{} with {patience}", path.display()),
                Err(error) => assert!(error.is::<Cancelled>(), "{} with {patience}: {error:#}", path.display()),
            }
            assert!(asked.get() <= patience + 4, "{} with {patience}: asked {} times", path.display(), asked.get());
        }
    }
}

#[test]
fn no_preview_follows_a_cancellation() {
    let (_folder, paths) = files();
    for path in paths {
        let shown = Cell::new(0);
        let watch =
            Watch { progress: &|_| {}, partial: &|_| shown.set(shown.get() + 1), is_cancelled: &|| shown.get() > 0 };
        assert!(Reading::default().read_watched(&path, &watch).unwrap_err().is::<Cancelled>());
        assert_eq!(shown.get(), 1);
    }
}

#[test]
fn damaged_files_are_refused_with_and_without_a_watcher() {
    let (_folder, paths) = files();
    for path in paths {
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        let watch = Watch::NONE;
        assert!(Reading::default().read_watched(&path, &watch).unwrap_err().is::<Unreadable>());
    }
}
