//! PLY as others write it (fixtures by plyfile), and glTF (by splat-transform): the same Gaussians from every variant.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::Random;
use smalto::formats;
use smalto::formats::Loss;
use smalto::scene::{Gaussians, LoadReport, RIGHT_UP_BACK, Scene, Transform};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

fn read(name: &str) -> Scene {
    formats::read(fixture(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn parse(name: &str, bytes: &[u8]) -> Result<Scene, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    formats::read(&path).map_err(|error| {
        let text = error.to_string();
        assert!(!text.contains('\n') && text.len() < 400, "it is one sentence: {text}");
        text
    })
}

/// The first Gaussians of the original, of this degree.
fn original(count: u32, degree: u32) -> Gaussians {
    let all = read("plush.ply").gaussians;
    all.selected(&(0..count).collect::<Vec<_>>()).unwrap().of_degree(degree)
}

#[test]
fn big_endian_text_and_doubles_hold_the_same_gaussians() {
    assert!(read("variant.big-endian.ply").gaussians == original(61, 3));
    assert!(read("variant.ascii.ply").gaussians == original(20, 0));
    assert!(read("variant.double.ply").gaussians == original(20, 3));
}

#[test]
fn ply_with_two_scales_is_read_as_flat_gaussians_and_reported() {
    let scene = read("variant.2dgs.ply");
    assert_eq!(scene.notices, ["it has two scales, and is drawn as flat Gaussians"]);
    let expected = original(20, 0);
    for i in 0..20 {
        let ([a, b, flat], [x, y, _]) = (scene.gaussians.scales()[i], expected.scales()[i]);
        assert_eq!(([a, b], flat), ([x, y], 0.0));
    }
    assert_eq!(scene.gaussians.rotations(), expected.rotations());
}

#[test]
fn point_clouds_become_balls_and_are_reported() {
    let scene = read("variant.points.ply");
    assert!(scene.notices[0].contains("point cloud"), "{:?}", scene.notices);
    // A grid of 5 x 5 x 5 points one apart: a ball reaches half way to its neighbour, whichever that is on the curve.
    assert_eq!(scene.gaussians.len(), 125);
    for i in 0..125 {
        let radius = scene.gaussians.scales()[i][0];
        assert!((0.49..0.9).contains(&radius), "{radius}");
        let blue = 0.5 + 0.28209479177387814 * f64::from(scene.gaussians.sh(i)[0][2]);
        assert!((blue - 128.0 / 255.0).abs() < 1e-6, "{blue}");
    }
}

#[test]
fn ply_comments_are_applied_or_reported() {
    let whole = fs::read(fixture("variant.2dgs.ply")).unwrap();
    let with = |comment: &str| {
        let at = whole.windows(8).position(|w| w == b"element ").unwrap();
        parse("a.ply", &[&whole[..at], format!("comment {comment}\n").as_bytes(), &whole[at..]].concat()).unwrap()
    };
    assert!(with("mip=true").is_antialiased);
    assert!(!with("mip=true\ncomment SplatRenderMode: default").is_antialiased, "the last one counts");
    let said = |comment: &str| with(comment).notices[0].clone();
    assert!(said("kernel_size=0.1").contains("0.1"));
    assert!(said("Vertical axis: z").contains("axis is z"));
    assert!(said("SplatRenderMode: 2dgs").contains("2D"));
    assert_eq!(with("kernel_size=0.3\ncomment Vertical axis: y").notices.len(), 1, "two scales alone");
}

/// splat-transform writes glTF in axes that are turned by half a turn about z from the axes of a PLY.
#[test]
fn gltf_agrees_with_splat_transform() {
    let found = read("plush.glb").gaussians;
    let half_about_z = Transform::new(glam::DQuat::from_rotation_z(std::f64::consts::PI), glam::DVec3::ZERO, 1.0);
    let turned = read("plush.ply").gaussians.transformed(&half_about_z.unwrap()).unwrap().flipped(RIGHT_UP_BACK);
    assert_eq!(found.len(), turned.len());
    for loss in Loss::between(&turned, &found) {
        let tolerance = if loss.attribute == "rotation" { 1e-4 } else { 2e-6 };
        assert!(loss.largest < tolerance, "{loss:?}");
    }
}

/// The same with its nodes moved, as text, with its buffer inside and beside it.
#[test]
fn gltf_follows_nodes_and_buffers() {
    let glb = fs::read(fixture("plush.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let (text, buffer) = (std::str::from_utf8(&glb[20..20 + length]).unwrap(), &glb[28 + length..]);
    let plain = read("plush.glb").gaussians;
    let mut document: serde_json::Value = serde_json::from_str(text).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let read = |document: &serde_json::Value| {
        let path = folder.path().join("a.gltf");
        fs::write(&path, document.to_string()).unwrap();
        formats::read(&path).map(|scene| scene.gaussians)
    };
    fs::write(folder.path().join("a b.bin"), buffer).unwrap();
    document["buffers"][0]["uri"] = "a%20b.bin".into();
    assert!(read(&document).unwrap() == plain);
    let mut inside = document.clone();
    use base64::Engine;
    let data = base64::engine::general_purpose::STANDARD.encode(buffer);
    inside["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{data}").into();
    assert!(read(&inside).unwrap() == plain);

    // Of a parent that scales and a child that moves, in y up: down is where y is less.
    let mut moved = document.clone();
    let mesh = moved["nodes"][0].clone();
    moved["nodes"] = serde_json::json!([{"scale": [2.0, 2.0, 2.0], "children": [1]}, mesh]);
    moved["nodes"][1]["translation"] = serde_json::json!([0.0, 1.0, 0.0]);
    let found = read(&moved).unwrap();
    for i in 0..plain.len() {
        let expected = plain.means()[i].map(|v| 2.0 * v);
        assert!((found.means()[i][1] - (expected[1] - 2.0)).abs() < 1e-5);
        assert!((found.means()[i][0] - expected[0]).abs() < 1e-5);
        assert!((found.scales()[i][0] - 2.0 * plain.scales()[i][0]).abs() < 1e-6);
    }
    for (pointer, value, sentence) in [
        ("/nodes/1/children", serde_json::json!([0]), "parents"),
        ("/accessors/0/count", serde_json::json!(1_000_000_000_000_000_u64), "bytes"),
        ("/accessors/2/count", serde_json::json!(7), "of another attribute"),
        ("/bufferViews/2/byteLength", serde_json::json!(u64::MAX), "outside of its buffer"),
        ("/buffers/0/uri", serde_json::json!("../a.bin"), "not the name of a file in the folder"),
        ("/buffers/0/uri", serde_json::json!("none.bin"), "there is no such file"),
        (
            "/meshes/0/primitives/0/extensions/KHR_gaussian_splatting/colorSpace",
            serde_json::json!("lin_rec709_display"),
            "lin_rec709",
        ),
    ] {
        let mut wrong = moved.clone();
        if pointer == "/nodes/1/children" {
            wrong["nodes"][1]["children"] = serde_json::json!([]);
        }
        *wrong.pointer_mut(pointer).unwrap() = value;
        let error = read(&wrong).unwrap_err().to_string();
        assert!(error.contains(sentence), "{pointer}: {error}");
    }
}

#[test]
fn gltf_opacities_a_rounding_out_of_range_are_clamped() {
    let mut glb = fs::read(fixture("plush.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let document: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let index = |value: &serde_json::Value| value.as_u64().unwrap_or(0) as usize;
    let attributes = &document["meshes"][0]["primitives"][0]["attributes"];
    let accessor = &document["accessors"][index(&attributes["KHR_gaussian_splatting:OPACITY"])];
    let view = &document["bufferViews"][index(&accessor["bufferView"])];
    assert_eq!((accessor["componentType"].as_u64(), view["byteStride"].as_u64()), (Some(5126), None));
    let start = 28 + length + index(&view["byteOffset"]) + index(&accessor["byteOffset"]);
    for (i, opacity) in [1.000_000_1_f32, 1.0005, -1e-7, 1.5].into_iter().enumerate() {
        glb[start + 4 * i..][..4].copy_from_slice(&opacity.to_le_bytes());
    }
    let scene = parse("a.glb", &glb).unwrap();
    let expected =
        LoadReport { read: 61, clamped_opacity: 2, transparent: 1, opacity_range: 1, ..LoadReport::default() };
    assert_eq!(scene.report, expected);
    assert_eq!(scene.gaussians.opacities()[..2], [1.0, 1.0]);
    let told = scene.report.to_string();
    assert!(told.contains("1 dropped for an opacity outside of 0 to 1"), "{told}");
    assert!(told.contains("2 with an opacity just above 1, drawn as 1"), "{told}");
}

#[test]
fn damaged_variants_are_refused_in_one_sentence() {
    let text = fs::read_to_string(fixture("variant.ascii.ply")).unwrap();
    let last = text.trim_end().rfind('\n').unwrap();
    let cut = |at: usize| parse("a.ply", &text.as_bytes()[..at]).unwrap_err();
    assert!(cut(last).contains("20 vertices need") || cut(last).contains("ends"), "{}", cut(last));
    assert!(cut(text.len() - 60).contains("has no"), "{}", cut(text.len() - 60));
    let letters = text.trim_end().to_owned() + "x\n";
    assert!(parse("a.ply", letters.as_bytes()).unwrap_err().contains("is not a number"));
    let more = text.trim_end().to_owned() + " 1\n";
    assert!(parse("a.ply", more.as_bytes()).unwrap_err().contains("more numbers than properties"));
    assert!(parse("a.ply", text.trim_end().as_bytes()).is_ok(), "the last line needs no end");
    let many: String = (0..5000).map(|i| format!("property float p{i}\n")).collect();
    let many = text.replacen("end_header", &format!("{many}end_header"), 1);
    assert!(parse("a.ply", many.as_bytes()).unwrap_err().contains("over 1024 properties"));
}

#[test]
fn variants_with_random_damage_never_panic() {
    let mut random = Random(7);
    for name in ["variant.ascii.ply", "variant.big-endian.ply", "variant.points.ply", "plush.glb"] {
        let whole = fs::read(fixture(name)).unwrap();
        for _ in 0..400 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random.below(4) {
                let at = random.below(bytes.len() as u32) as usize;
                bytes[at] = random.below(256) as u8;
            }
            if random.below(4) == 0 {
                bytes.truncate(random.below(bytes.len() as u32) as usize);
            }
            _ = parse(if name.ends_with("glb") { "a.glb" } else { "a.ply" }, &bytes);
        }
    }
}
