//! Spherical harmonics of degree 4: the formats that hold them, and what the others leave out.

use std::fs;
use std::path::Path;

use glam::DVec3;
use serde_json::Value;
use smalto::formats::{self, SceneFile};
use smalto::scene::Gaussians;
use smalto::scene::harmonics::basis;

use crate::common::free::{build, of_degree_4};
use crate::common::program::{fails, ok, path, smalto};
use crate::common::table::fixture;

fn read(path: impl AsRef<Path>) -> Gaussians {
    formats::read(path.as_ref()).unwrap().gaussians
}

/// The colour of a Gaussian from a point, before it is clamped.
fn colour_from(gaussians: &Gaussians, index: usize, eye: DVec3) -> DVec3 {
    let towards = (DVec3::from(gaussians.means()[index].map(f64::from)) - eye).normalize();
    let parts = gaussians.sh(index).iter().zip(basis(towards.to_array()));
    parts.fold(DVec3::splat(0.5), |sum, (k, value)| sum + value * DVec3::from(k.map(f64::from)))
}

/// A file of 72 `f_rest` and the colours of its Gaussians from one point, in the basis of PlenOctrees.
#[test]
fn ply_of_72_f_rest_has_the_colours_of_its_trainer() {
    let gaussians = read(fixture("variant.degree-4.ply"));
    assert_eq!((gaussians.len(), gaussians.sh_degree()), (5, 4));
    let expected = [
        [0.8729, 0.7242, 0.7421],
        [1.0596, 0.0202, 0.0802],
        [0.085, 0.997, 0.093],
        [0.2454, 0.1801, 1.2483],
        [0.9842, 0.8928, 0.0],
    ];
    for (index, expected) in expected.into_iter().enumerate() {
        let found = colour_from(&gaussians, index, DVec3::new(2.5, -1.5, -3.0)).max(DVec3::ZERO);
        assert!(found.distance(expected.into()) < 1e-4, "{index}: {found}, not {expected:?}");
    }
}

/// A PLY file of degree 4, and what is read from it.
fn source(folder: &tempfile::TempDir) -> (String, Gaussians) {
    let (source, made) = (path(folder, "source.ply"), build(&of_degree_4(3000), 4));
    SceneFile::Ply.write(&made, false, &mut fs::File::create(&source).unwrap()).unwrap();
    let gaussians = read(&source);
    assert!(gaussians.all_sh() == made.all_sh());
    (source, gaussians)
}

/// The report of a conversion, and what it printed on stderr.
fn convert(command: &[&str]) -> (Value, String) {
    let output = smalto(&[command, &["--json", "-"]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{command:?}: {said}");
    (serde_json::from_slice(&output.stdout).unwrap(), said)
}

fn largest(report: &Value, attribute: &str) -> f64 {
    let rows = report["loss"].as_array().unwrap();
    let mut found = rows.iter().filter(|row| row["attribute"] == attribute);
    let row = found.next().unwrap_or_else(|| panic!("no {attribute}"));
    assert!(found.next().is_none(), "{attribute} is once in the report");
    row["largest"].as_f64().unwrap()
}

#[test]
fn degree_4_is_written_without_loss() {
    let folder = tempfile::tempdir().unwrap();
    let (source, gaussians) = source(&folder);
    let [ply, pages, levels, back] = ["a.ply", "a.smalto", "levels.smalto", "back.ply"].map(|name| path(&folder, name));
    let (report, said) = convert(&["convert", &source, &ply]);
    assert_eq!((largest(&report, "SH degree 4"), said.contains("warning")), (0.0, false), "{said}");
    assert!(read(&ply) == gaussians);
    convert(&["convert", &source, &pages]);
    convert(&["lod", &source, "-o", &levels]);
    for file in [&pages, &levels] {
        convert(&["convert", file, &back]);
        assert!(read(&back) == gaussians, "{file}");
        assert!(ok(&["info", file]).contains("SH degree 4"));
    }
    // Readers that do not know degree 4 refuse these versions.
    let version = |file: &str| fs::read(file).unwrap()[8];
    assert_eq!([version(&pages), version(&levels)], [3, 4]);
    for (name, degree) in [("plush.ply", 3), ("plush.sh0.ply", 0)] {
        convert(&["convert", fixture(name).to_str().unwrap(), &pages]);
        assert_eq!(version(&pages), 1, "degree {degree} keeps its version");
    }
}

/// Four bits for each coefficient above degree 1, in the axes right, up, back.
#[test]
fn spz_4_holds_degree_4_in_its_steps() {
    let folder = tempfile::tempdir().unwrap();
    let (source, gaussians) = source(&folder);
    let [file, again] = ["a.spz", "again.spz"].map(|name| path(&folder, name));
    let (report, said) = convert(&["convert", &source, &file]);
    assert!(!said.contains("warning"), "{said}");
    assert!(largest(&report, "SH degree 4") <= 8.0 / 128.0 + 0.5 / 128.0 + 1e-6);
    let (report, _) = convert(&["convert", &file, &again]);
    assert_eq!(largest(&report, "SH degree 4"), 0.0, "steps stay where they are");
    // What the bytes mean: 24 coefficients, colour fastest, seen in the axes of the file.
    let bytes = fs::read(&file).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((bytes[12], bytes[15]), (4, 6));
    let sizes: Vec<usize> = (0..6).map(|plane| word(word(16) + 16 * plane)).collect();
    let start = word(16) + 6 * 16 + sizes[..5].iter().sum::<usize>();
    let plane = zstd::decode_all(&bytes[start..start + sizes[5]]).unwrap();
    assert_eq!(plane.len(), 72 * gaussians.len());
    let direction = DVec3::new(0.4, -0.7, 0.2).normalize();
    let (before, here) = (basis(direction.to_array()), basis([direction.x, -direction.y, -direction.z]));
    for (i, row) in plane.chunks_exact(72).enumerate() {
        for channel in 0..3 {
            for l in 1..=4 {
                let band = l * l..(l + 1) * (l + 1);
                let stored = |k: usize| (f64::from(row[3 * (k - 1) + channel]) - 128.0) / 128.0;
                let found: f64 = band.clone().map(|k| here[k] * stored(k)).sum();
                let expected: f64 = band.map(|k| before[k] * f64::from(gaussians.sh(i)[k][channel])).sum();
                // Half a step each; the squares of a degree's basis functions sum to (2 l + 1) / 4 pi.
                let most = (8.5 / 128.0) * (2 * l + 1) as f64 / (4.0 * std::f64::consts::PI).sqrt();
                assert!((found - expected).abs() < most, "{i}, degree {l}: {found}, not {expected}");
            }
        }
    }
}

#[test]
fn formats_of_three_degrees_leave_out_the_fourth_and_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let (source, gaussians) = source(&folder);
    let most = gaussians
        .all_sh()
        .chunks_exact(25)
        .flat_map(|sh| sh[16..].as_flattened())
        .fold(0.0, |m: f32, v| m.max(v.abs()));
    let spz_3: &[&str] = &["--spz-version", "3"];
    for (name, more, degree) in [
        ("a.glb", &[][..], 3),
        ("a.sog", &[], 3),
        ("sog/meta.json", &[], 3),
        ("a.compressed.ply", &[], 3),
        ("a.spz", spz_3, 3),
        ("a.splat", &[], 0),
    ] {
        let file = path(&folder, name);
        let (report, said) = convert(&[&["convert", &source, &file], more].concat());
        let warning = format!("the format holds spherical harmonics up to degree {degree} only");
        assert!(said.contains(&warning), "{name}: {said}");
        assert_eq!(report["sh_degree"], degree, "{name}");
        assert_eq!(largest(&report, "SH degree 4") as f32, most, "{name}");
        assert!(largest(&report, "SH degree 1") > if degree == 0 { 0.1 } else { -1.0 }, "{name}");
        assert_eq!(read(&file).sh_degree(), degree, "{name}");
    }
    let (report, said) = convert(&["lod", &source, "-o", &path(&folder, "streamed/lod-meta.json")]);
    assert!(said.contains("up to degree 3 only"), "{said}");
    assert_eq!((&report["sh_degree"], largest(&report, "SH degree 4") as f32), (&3.into(), most));
    // The caller may leave it out, too.
    let lower = path(&folder, "lower.ply");
    convert(&["convert", &source, &lower, "--sh-degree", "3"]);
    assert!(read(&lower) == gaussians.of_degree(3));
}

#[test]
fn files_of_other_formats_with_degree_4_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [packed, text] = ["packed.ply", "a.gltf"].map(|name| path(&folder, name));
    let whole = fs::read(fixture("plush.compressed.ply")).unwrap();
    let end = whole.windows(11).position(|part| part == b"end_header\n").unwrap();
    let more: String = (45..72).map(|i| format!("property uchar f_rest_{i}\n")).collect();
    fs::write(&packed, [&whole[..end], more.as_bytes(), &whole[end..]].concat()).unwrap();
    let error = fails(4, &["info", &packed]);
    assert!(error.contains("element sh has 72 f_rest properties, expected 9, 24 or 45"), "{error}");
    let glb = fs::read(fixture("plush.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    fs::write(folder.path().join("a.bin"), &glb[28 + length..]).unwrap();
    document["buffers"][0]["uri"] = "a.bin".into();
    let attributes = &mut document["meshes"][0]["primitives"][0]["attributes"];
    attributes["KHR_gaussian_splatting:SH_DEGREE_4_COEF_0"] =
        attributes["KHR_gaussian_splatting:SH_DEGREE_3_COEF_0"].clone();
    fs::write(&text, document.to_string()).unwrap();
    let error = fails(4, &["info", &text]);
    assert!(error.contains("SH degree 4 is not supported, only 0 to 3"), "{error}");
}
