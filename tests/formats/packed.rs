//! Scenes inside of gzip streams and without theirs, other archives, SPZ in all axes, and settings of training beside a
//! scene.

use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use glam::{DMat3, DQuat, DVec3};
use smalto::formats;
use smalto::formats::Loss;
use smalto::scene::{Gaussians, Scene, Transform};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    fs::read(fixture(name)).unwrap()
}

fn parse(name: &str, bytes: &[u8]) -> Result<Scene, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    formats::read(&path).map_err(|error| error.to_string())
}

fn gzip(content: &[u8]) -> Vec<u8> {
    let mut stream = GzEncoder::new(Vec::new(), Compression::default());
    stream.write_all(content).unwrap();
    stream.finish().unwrap()
}

#[test]
fn scenes_are_read_from_gzip_streams() {
    for name in ["plush.ply", "plush.compressed.ply", "plush.glb", "plush.v4.spz", "plush.sog", "plush.splat"] {
        let (packed, plain) = (gzip(&bytes(name)), formats::read(fixture(name)).unwrap());
        let found = parse(&format!("{name}.gz"), &packed).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(found.gaussians == plain.gaussians && found.format == plain.format, "{name}");
    }
    // Several streams one after another, as parallel compressors write them.
    let whole = bytes("plush.ply");
    let (begin, end) = whole.split_at(5000);
    let parts = [gzip(begin), gzip(end)].concat();
    assert!(parse("a", &parts).unwrap().gaussians == formats::read(fixture("plush.ply")).unwrap().gaussians);
}

#[test]
fn gzip_streams_have_bounds() {
    let header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nend_header\n";
    let bomb = gzip(&[&header[..], &vec![0; 10_000_000]].concat());
    let error = parse("a.ply.gz", &bomb).unwrap_err();
    assert!(error.contains("64 times its size"), "{error}");
    let cut = gzip(&bytes("plush.ply"));
    let error = parse("a.ply.gz", &cut[..cut.len() / 2]).unwrap_err();
    assert!(error.contains("gzip stream cannot be unpacked"), "{error}");
}

#[test]
fn archives_are_named() {
    let mut tar = vec![0; 512];
    tar[257..262].copy_from_slice(b"ustar");
    for (content, what) in [
        (&b"7z\xbc\xaf\x27\x1c\0\x04"[..], "a 7z archive: unpack it first"),
        (b"\x28\xb5\x2f\xfd1234", "a zstd stream: unpack it first"),
        (b"\xfd7zXZ\0\0\x04", "an xz stream: unpack it first"),
        (b"BZh91AY&", "a bzip2 stream: unpack it first"),
        (b"Rar!\x1a\x07\x01\0", "a RAR archive: unpack it first"),
        (&tar, "a tar archive: unpack it first"),
        (&gzip(&tar), "in a gzip stream: not a scene, but a tar archive: unpack it first"),
        (&gzip(b"hello, world"), "in a gzip stream: not a scene that smalto reads"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"<!DOCTYPE html>", "HTML"),
        (b"PXR-USDC", "a USD file"),
    ] {
        let error = parse("a.ply", content).unwrap_err();
        assert!(error.contains(what), "{what}: {error}");
    }
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("scene/a.ply", zip::write::SimpleFileOptions::default()).unwrap();
    zip.write_all(b"ply\n").unwrap();
    let error = parse("a.zip", &zip.finish().unwrap().into_inner()).unwrap_err();
    assert!(error.contains("no meta.json, but scene/a.ply: unpack it first"), "{error}");
}

#[test]
fn spz_is_read_without_its_gzip() {
    for name in ["plush.v3.spz", "written.v3.spz", "plush.sh0.spz"] {
        let packed = bytes(name);
        if packed.starts_with(b"NGSP") {
            continue;
        }
        let mut plain = Vec::new();
        GzDecoder::new(&packed[..]).read_to_end(&mut plain).unwrap();
        let [expected, found] = [&packed, &plain].map(|bytes| parse("a.spz", bytes).unwrap());
        assert!(found.gaussians == expected.gaussians && found.format == expected.format, "{name}");
        let error = parse("a.spz", &plain[..plain.len() - 1]).unwrap_err();
        assert!(error.contains("end after"), "{error}");
    }
}

/// An SPZ 4 with an extension record.
fn with_extension(kind: u32, payload: u32) -> Vec<u8> {
    let mut spz = bytes("plush.v4.spz");
    let at = u32::from_le_bytes(spz[16..20].try_into().unwrap()) as usize;
    spz[14] |= 2;
    spz[16..20].copy_from_slice(&(at as u32 + 12).to_le_bytes());
    let record = [kind, 4, payload].map(u32::to_le_bytes).concat();
    spz.splice(at..at, record);
    spz
}

fn covariance(gaussians: &Gaussians, i: usize) -> DMat3 {
    let [w, x, y, z] = gaussians.rotations()[i].map(f64::from);
    let scales = DMat3::from_diagonal(DVec3::from(gaussians.scales()[i].map(f64::from)));
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()) * scales;
    axes * axes.transpose()
}

const COORDINATES: u32 = 0xadbe_0003;

/// The names and numbers of `CoordinateSystem` in SPZ's `splat-types.h`: directions of x, y and z.
#[test]
fn spz_is_read_in_all_axes() {
    let names = [
        "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF", "LFD", "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU",
    ];
    let read = |code: u32| parse("a.spz", &with_extension(COORDINATES, code)).unwrap().gaussians;

    let direction = |letter: char| match letter {
        'R' => DVec3::X,
        'L' => DVec3::NEG_X,
        'D' => DVec3::Y,
        'U' => DVec3::NEG_Y,
        'F' => DVec3::Z,
        _ => DVec3::NEG_Z,
    };
    for (name, code) in names.into_iter().zip(1..) {
        let axes: Vec<DVec3> = name.chars().map(direction).collect();
        let matrix = DMat3::from_cols(axes[0], axes[1], axes[2]);
        // A mirror image is a turn after x is reversed.
        let is_mirrored = matrix.determinant() < 0.0;
        let turn = matrix * DMat3::from_diagonal(DVec3::new(if is_mirrored { -1.0 } else { 1.0 }, 1.0, 1.0));
        let rotation = Transform::new(DQuat::from_mat3(&turn), DVec3::ZERO, 1.0).unwrap();
        let expected: Gaussians = read(6).flipped([is_mirrored, false, false]).transformed(&rotation).unwrap();
        let found = read(code);
        // Rotations differ by half turns about the axes of an ellipsoid, which is the same then.
        for loss in Loss::between(&expected, &found).iter().filter(|loss| loss.attribute != "rotation") {
            assert!(loss.largest < 1e-4, "{name}: {loss:?}");
        }
        for i in 0..found.len() {
            let [a, b] = [&expected, &found].map(|gaussians| covariance(gaussians, i));
            let largest = a.to_cols_array().into_iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            assert!(a.abs_diff_eq(b, 1e-5 * largest), "{name}: {a} {b}");
        }
    }
    assert!(read(0) == read(4), "unspecified axes are right, up, back");
    let error = parse("a.spz", &with_extension(COORDINATES, 17)).unwrap_err();
    assert!(error.contains("coordinate system 17 is unknown"), "{error}");
    let notices = |kind| parse("a.spz", &with_extension(kind, 0)).unwrap().notices;
    assert_eq!(notices(0xadbe_0002), Vec::<String>::new());
    let mut flagged = bytes("plush.v4.spz");
    flagged[14] |= 0x10;
    assert_eq!(parse("a.spz", &flagged).unwrap().notices, ["its flags 0x10 are unknown and not used"]);
    assert_eq!(notices(0x1234), ["its extension 0x00001234 is unknown and not used"]);
}

#[test]
fn settings_of_training_are_used_or_named() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model/point_cloud/iteration_7");
    fs::create_dir_all(&model).unwrap();
    fs::copy(fixture("plush.sh0.ply"), model.join("point_cloud.ply")).unwrap();
    let settings = folder.path().join("model/cfg_args");
    let read = |text: &[u8]| {
        fs::write(&settings, text).unwrap();
        let [whole, file] = ["model", "model/point_cloud/iteration_7/point_cloud.ply"]
            .map(|name| formats::read(formats::in_folder(&folder.path().join(name))).unwrap());
        assert_eq!(whole.notices, file.notices);
        (file.is_antialiased, file.notices)
    };
    assert_eq!(read(b"Namespace(eval=True, white_background=False)"), (false, vec![]));
    let (_, white) = read(b"Namespace(eval=True, white_background=True)");
    assert!(white.len() == 1 && white[0].contains("cfg_args") && white[0].contains("--background"), "{white:?}");
    // Mip-Splatting.
    let (is_antialiased, mip) = read(b"Namespace(kernel_size=0.1, white_background=False)");
    assert!(is_antialiased && mip[0].contains("0.1 px^2"), "{mip:?}");
    // What cannot be understood is ignored.
    assert_eq!(read(&[0xff; 100]), (false, vec![]));

    let result = folder.path().join("result");
    fs::create_dir_all(result.join("ply")).unwrap();
    fs::copy(fixture("plush.sh0.ply"), result.join("ply/point_cloud_99.ply")).unwrap();
    fs::write(result.join("cfg.yml"), "antialiased: true\nsh_degree: 3\n").unwrap();
    let scene = formats::read(result.join("ply/point_cloud_99.ply")).unwrap();
    assert!(scene.is_antialiased && scene.notices.len() == 1, "{:?}", scene.notices);
}
