//! PLY of the dialects of trainers and tools: what changes the picture is drawn, or named in a note.

use std::fs;
use std::path::Path;

use smalto::formats;
use smalto::scene::{LoadReport, Scene};

/// The properties of the original, without normals and harmonics.
const PLAIN: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
    "rot_3",
];

/// A Gaussian in the order of [`PLAIN`].
const ROW: [f32; 14] = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.5, -1.0, -2.0, -3.0, 1.0, 0.0, 0.0, 0.0];

fn parse(bytes: &[u8]) -> Result<Scene, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    fs::write(&path, bytes).unwrap();
    formats::read(&path).map_err(|error| error.to_string())
}

/// A PLY of little-endian floats. Lines of the header before and after the vertices are given as they are.
fn ply(before: &str, names: &[&str], rows: &[&[f32]], after: &str) -> Vec<u8> {
    let mut header = format!("ply\nformat binary_little_endian 1.0\n{before}element vertex {}\n", rows.len());
    names.iter().for_each(|name| header += &format!("property float {name}\n"));
    header += &format!("{after}end_header\n");
    let values = rows.iter().copied().flatten().flat_map(|value| value.to_le_bytes());
    header.into_bytes().into_iter().chain(values).collect()
}

/// A scene of one Gaussian with more properties, all 0.5.
fn with(more: &[&str]) -> Result<Scene, String> {
    let row = [&ROW[..], &vec![0.5; more.len()]].concat();
    parse(&ply("", &[&PLAIN[..], more].concat(), &[&row], ""))
}

fn notices(more: &[&str]) -> Vec<String> {
    with(more).unwrap().notices
}

fn sigmoid(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

#[test]
fn a_filter_that_is_not_fused_widens_and_fades() {
    let scene = with(&["filter_3D"]).unwrap();
    assert_eq!(scene.notices.len(), 1, "{:?}", scene.notices);
    assert!(scene.notices[0].contains("filter_3D"));
    let before = [-1.0_f64, -2.0, -3.0].map(f64::exp);
    let after = before.map(|s| (s * s + 0.25).sqrt());
    let opacity = sigmoid(0.5) * before.iter().product::<f64>() / after.iter().product::<f64>();
    assert_eq!(scene.gaussians.scales(), [after.map(|s| s as f32)]);
    assert!((f64::from(scene.gaussians.opacities()[0]) / opacity - 1.0).abs() < 1e-7);

    // A filter of 0 changes no bit, and a surfel stays flat.
    let none = parse(&ply("", &[&PLAIN[..], &["filter_3D"]].concat(), &[&[&ROW[..], &[0.0]].concat()], "")).unwrap();
    assert!(none.gaussians == with(&[]).unwrap().gaussians);
    let (names, row): (Vec<_>, Vec<_>) = PLAIN.iter().zip(ROW).filter(|(name, _)| **name != "scale_2").unzip();
    let names = [&names[..], &["filter_3D"]].concat();
    let flat = parse(&ply("", &names, &[&[&row[..], &[0.5]].concat()], "")).unwrap().gaussians;
    assert_eq!(flat.scales(), [[after[0] as f32, after[1] as f32, 0.0]]);
    let opacity = sigmoid(0.5) * before[0] * before[1] / after[0] / after[1];
    assert!((f64::from(flat.opacities()[0]) / opacity - 1.0).abs() < 1e-7);
}

#[test]
fn properties_that_change_the_picture_are_named_and_harmless_ones_are_not() {
    assert_eq!(notices(&["nx", "ny", "nz", "red", "obj_dc_0", "obj_dc_15", "confidence"]), Vec::<String>::new());
    let motion = notices(&["trbf_center", "trbf_scale", "motion_0", "motion_1", "motion_8"]);
    assert_eq!(motion.len(), 1);
    assert!(motion[0].contains("trbf_center, trbf_scale and motion_0 to motion_8"), "{motion:?}");
    assert!(motion[0].contains("Spacetime"), "{motion:?}");
    for (name, word) in [
        ("scale_3", "4D"),
        ("binding_0", "GaussianAvatars"),
        ("f_asg_3", "highlights"),
        ("base_color_0", "relighting"),
        ("state", "SuperSplat"),
        ("negative", "negative"),
    ] {
        let said = notices(&[name]);
        assert!(said.len() == 1 && said[0].contains(name) && said[0].contains(word), "{said:?}");
    }
    let unknown = notices(&["wobble_0", "wobble_1", "sparkle"]);
    assert_eq!(unknown, ["the properties wobble_0 to wobble_1 and sparkle are unknown and not used"]);
}

#[test]
fn elements_with_something_unknown_are_named() {
    let row = [&ROW[..], &[7.0, 8.0]].concat();
    let bytes = ply("", &PLAIN, &[&row], "element blobs 2\nproperty float a\nelement face 0\nproperty float b\n");
    assert_eq!(parse(&bytes).unwrap().notices, ["it has the unknown element blobs, not used"]);
}

#[test]
fn gaussians_without_a_needed_property_are_refused_by_its_name() {
    let without = |left_out: &[&str], more: &[&str]| {
        let names: Vec<&str> = PLAIN.iter().filter(|name| !left_out.contains(name)).copied().collect();
        let names = [&names[..], more].concat();
        parse(&ply("", &names, &[&vec![0.5; names.len()]], "")).map(|scene| scene.notices)
    };
    let scaffold = without(&["f_dc_0", "f_dc_1", "f_dc_2"], &["f_offset_0", "f_anchor_feat_0"]).unwrap_err();
    assert!(scaffold.contains("property f_dc_0 of element vertex is missing"), "{scaffold}");
    assert!(scaffold.contains("Scaffold-GS"), "{scaffold}");
    let beta = without(&["f_dc_0", "f_dc_1", "f_dc_2"], &["sh0_0", "sb_params_0", "beta"]).unwrap_err();
    assert!(beta.contains("f_dc_0") && beta.contains("Beta"), "{beta}");
    let still = without(&["rot_2"], &[]).unwrap_err();
    assert!(still.contains("property rot_2") && still.contains("it has f_dc_0"), "{still}");
    let opacity = &PLAIN[3..].iter().filter(|name| **name != "opacity").copied().collect::<Vec<_>>();
    assert!(without(opacity, &[]).unwrap_err().contains("it has opacity"));
    // Nothing hints at Gaussians.
    let points = without(&PLAIN[3..], &["intensity", "level"]).unwrap();
    assert!(points.len() == 1 && points[0].contains("balls"), "{points:?}");
}

#[test]
fn other_elements_are_named_if_there_are_no_vertices() {
    // As reduced-3dgs writes a quantized scene.
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex_0 1\nproperty uchar x\n\
                  element codebook_centers 1\nproperty float opacity\nend_header\n.....";
    let error = parse(header.as_bytes()).unwrap_err();
    assert!(error.contains("no element vertex, only vertex_0, codebook_centers"), "{error}");
}

#[test]
fn elements_that_hold_nothing_are_skipped() {
    let plain = with(&[]).unwrap().gaussians;
    for (before, after) in [("", "element sh 1\n"), ("element empty 5\n", ""), ("element vertex 4\n", "")] {
        assert!(parse(&ply(before, &PLAIN, &[&ROW], after)).unwrap().gaussians == plain, "{before}{after}");
    }
    let packed =
        fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/plush.sh0.compressed.ply")).unwrap();
    let at = packed.windows(10).position(|w| w == b"end_header").unwrap();
    let whole = parse(&packed).unwrap();
    for element in ["element sh 61\n", "element sh 0\nproperty uchar f_rest_0\n"] {
        let found = parse(&[&packed[..at], element.as_bytes(), &packed[at..]].concat()).unwrap();
        assert!(found.gaussians == whole.gaussians, "{element}");
    }
}

#[test]
fn cloud_compare_prefixes_are_removed() {
    let plain = with(&[]).unwrap().gaussians;
    for prefix in ["scalar_", "scal_", "scalar_scal_"] {
        let names: Vec<String> = PLAIN
            .iter()
            .enumerate()
            .map(|(i, name)| if i < 3 { (*name).into() } else { format!("{prefix}{name}") })
            .collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let scene = parse(&ply("", &names, &[&ROW], "")).unwrap();
        assert!(scene.gaussians == plain && scene.notices.is_empty(), "{prefix}: {:?}", scene.notices);
    }
}

/// Opacities in bytes are fractions, in binary and in text; so are colours.
#[test]
fn integer_types_say_that_values_are_fractions() {
    let header = |encoding: &str| {
        let floats = ["x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
        let mut text = format!("ply\nformat {encoding} 1.0\nelement vertex 1\n");
        floats.iter().for_each(|name| text += &format!("property float {name}\n"));
        ["opacity", "red", "green", "blue"].iter().for_each(|name| text += &format!("property uchar {name}\n"));
        text + "end_header\n"
    };
    let floats = [1.0_f32, 2.0, 3.0, -1.0, -1.0, -1.0, 1.0, 0.0, 0.0, 0.0];
    let binary: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).chain([51, 255, 0, 102]).collect();
    let text = "1 2 3 -1 -1 -1 1 0 0 0 51 255 0 102\n";
    for bytes in [
        [header("binary_little_endian").as_bytes(), &binary].concat(),
        [header("ascii").as_bytes(), text.as_bytes()].concat(),
    ] {
        let scene = parse(&bytes).unwrap().gaussians;
        assert_eq!(scene.opacities(), [0.2]);
        let colour = scene.sh(0)[0].map(|c| 0.5 + 0.282_094_79 * c);
        assert!(colour.iter().zip([1.0, 0.0, 0.4]).all(|(a, b)| (a - b).abs() < 1e-6), "{colour:?}");
    }
    let points = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar diffuse_red\nproperty uchar diffuse_green\nproperty uchar diffuse_blue\nend_header\n\
                  0 0 0 255 0 102\n1 0 0 255 0 102\n";
    let colour = parse(points.as_bytes()).unwrap().gaussians.sh(0)[0].map(|c| 0.5 + 0.282_094_79 * c);
    assert!(colour.iter().zip([1.0, 0.0, 0.4]).all(|(a, b)| (a - b).abs() < 1e-6), "{colour:?}");
}

/// A scene of 200 Gaussians with these opacities and scales.
fn many(opacity: impl Fn(u16) -> f32, scale: impl Fn(u16) -> f32) -> Scene {
    let rows: Vec<Vec<f32>> = (0..200)
        .map(|i| {
            let mut row = ROW.to_vec();
            row[6] = opacity(i);
            row[7..10].fill(scale(i));
            row
        })
        .collect();
    let rows: Vec<&[f32]> = rows.iter().map(Vec::as_slice).collect();
    parse(&ply("", &PLAIN, &rows, "")).unwrap()
}

#[test]
fn values_that_look_activated_are_doubted_and_read_alike() {
    let spread = |i: u16| f32::from(i) / 200.0;
    let trained = |i: u16| f32::from(i) / 20.0 - 5.0;
    let doubted = |scene: &Scene| scene.notices.concat();
    let fractions = many(spread, trained);
    assert!(doubted(&fractions).contains("opacities") && !doubted(&fractions).contains("scales"));
    assert!((fractions.gaussians.opacities()[100] - 0.622_459_3).abs() < 1e-6, "a logit as any other");
    let linear = many(trained, |i| spread(i) + 0.001);
    assert!(doubted(&linear).contains("scales") && !doubted(&linear).contains("opacities"));
    assert!(many(trained, trained).notices.is_empty());
    // One value decides nothing, in either direction.
    let one_else = many(|i| if i == 7 { -3.0 } else { spread(i) }, trained);
    assert!(doubted(&one_else).contains("opacities"));
    let one_nan = many(|i| if i == 7 { f32::NAN } else { spread(i) }, trained);
    assert_eq!(one_nan.report, LoadReport { read: 200, not_finite: 1, ..LoadReport::default() });
    assert!(doubted(&one_nan).contains("opacities"));
}

#[test]
fn comments_of_trainers_are_applied_or_named() {
    let of = |comment: &str| parse(&ply(&format!("comment {comment}\n"), &PLAIN, &[&ROW], "")).unwrap().notices;
    // nerfstudio and Brush.
    assert!(of("Vertical Axis: z")[0].contains("axis is z"));
    assert!(of("Vertical axis: 0 -1 0.5")[0].contains("0 -1 0.5"));
    assert!(of("background_color=1,1,1")[0].contains("background 1,1,1"));
    assert!(of("SplatRenderMode: fancy")[0].contains("fancy"));
    for harmless in ["SplatRenderMode: mip", "Vertical axis: y", "SH degree: 3", "background_color=0,0,0"] {
        assert_eq!(of(harmless), Vec::<String>::new(), "{harmless}");
    }
}
