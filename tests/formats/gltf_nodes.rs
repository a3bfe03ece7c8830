//! glTF: transforms of nodes, instances, sparse values, and what a file holds beside Gaussians.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};
use smalto::camera::Camera;
use smalto::formats;
use smalto::options::Options;
use smalto::reference::render;
use smalto::rules::Background;
use smalto::scene::harmonics::basis;
use smalto::scene::{Gaussians, Scene};
use std::fs;

use crate::common::compare;
use crate::common::table::fixture;

/// The fixture `plush.glb` as text with changes of its description, and with more bytes after its buffer.
fn changed(change: impl FnOnce(&mut Value), more: &[u8]) -> Result<Scene, String> {
    let glb = fs::read(fixture("plush.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let buffer = [&glb[28 + length..], more].concat();
    document["buffers"][0] = json!({
        "byteLength": buffer.len(),
        "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(buffer)),
    });
    change(&mut document);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    fs::write(&path, document.to_string()).unwrap();
    formats::read(&path).map_err(|error| format!("{error:#}"))
}

/// Adds an accessor of the bytes after the fixture's buffer. Returns its index.
fn add_accessor(document: &mut Value, skip: usize, shape: &str, component: u32, count: usize) -> usize {
    let end = document["bufferViews"].as_array().unwrap().iter();
    let end = end.map(|v| v["byteOffset"].as_u64().unwrap() + v["byteLength"].as_u64().unwrap()).max().unwrap();
    let start = if skip == 0 { PLUSH_BYTES } else { end as usize };
    let numbers = ["SCALAR", "", "VEC3", "VEC4"].iter().position(|s| *s == shape).unwrap() + 1;
    let bytes = numbers * count * if component == 5126 { 4 } else { 2 };
    let views = document["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": bytes}));
    let view = views.len() - 1;
    let accessors = document["accessors"].as_array_mut().unwrap();
    accessors.push(json!({"bufferView": view, "componentType": component, "count": count, "type": shape}));
    accessors.len() - 1
}

const PLUSH_BYTES: usize = 14640;

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn plain() -> Gaussians {
    formats::read(fixture("plush.glb")).unwrap().gaussians
}

fn covariance(scene: &Gaussians, i: usize) -> DMat3 {
    let [w, x, y, z] = scene.rotations()[i].map(f64::from);
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())
        * DMat3::from_diagonal(scene.scales()[i].map(f64::from).into());
    axes * axes.transpose()
}

fn colour(scene: &Gaussians, i: usize, direction: DVec3) -> DVec3 {
    let basis = basis(direction.to_array());
    scene.sh(i).iter().zip(basis).map(|(k, value)| value * DVec3::from(k.map(f64::from))).sum()
}

/// glTF's axes are right, up, back; those of smalto right, down, forward.
const AXES: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

/// Compares a scene with another one under a map in the axes of glTF, in f64: means, covariances A S A^T and, for a map
/// that is `turn` and a scale, colours from directions.
fn assert_mapped(found: &Gaussians, before: &Gaussians, linear: DMat3, shift: DVec3, turn: Option<DMat3>) {
    let (linear, shift, turn) = (AXES * linear * AXES, AXES * shift, turn.map(|turn| AXES * turn * AXES));
    assert_eq!(found.len(), before.len());
    for i in 0..found.len() {
        let [mean, other] = [found, before].map(|scene| DVec3::from(scene.means()[i].map(f64::from)));
        assert!((mean - (linear * other + shift)).abs().max_element() < 1e-6, "mean {i}");
        let expected = linear * covariance(before, i) * linear.transpose();
        let size = expected.to_cols_array().into_iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let error = (covariance(found, i) - expected).to_cols_array().into_iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(error < 2e-6 * size, "covariance {i}: {error} of {size}");
        for direction in [DVec3::X, DVec3::new(0.3, -0.8, 0.5).normalize(), DVec3::new(-1.0, 0.1, 2.0).normalize()] {
            let Some(turn) = turn else { continue };
            let expected = colour(before, i, turn.transpose() * direction);
            assert!((colour(found, i, direction) - expected).abs().max_element() < 2e-6, "colour {i}");
        }
    }
}

#[test]
fn mirrored_and_stretched_nodes_map_covariances_and_turn_harmonics() {
    let before = plain();
    let turn = DQuat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize();
    let rotation = DMat3::from_quat(turn);
    let scales = [[-1.0, 1.0, 1.0], [-2.0, -2.0, -2.0], [1.0, 1.0, 0.25], [3.0, 0.5, -1.5], [1.0, 0.0, 1.0]];
    for scale in scales.map(DVec3::from) {
        let nodes = json!([
            {"scale": scale.to_array(), "translation": [1.0, 2.0, -0.5], "children": [1]},
            {"mesh": 0, "rotation": turn.to_array()},
        ]);
        let scene = changed(|document| document["nodes"] = nodes, &[]).unwrap();
        let diagonal = DMat3::from_diagonal(scale);
        let is_similar = scale.abs().max_element() == scale.abs().min_element();
        // The polar part of D R is sign(D) R.
        let polar = DMat3::from_diagonal(scale.signum()) * rotation;
        let shift = DVec3::new(1.0, 2.0, -0.5);
        assert_mapped(&scene.gaussians, &before, diagonal * rotation, shift, (scale.y != 0.0).then_some(polar));
        let notice = "nodes scale the axes of 61 Gaussians differently";
        assert_eq!(scene.notices.iter().any(|said| said.starts_with(notice)), !is_similar, "{:?}", scene.notices);
    }
    // As a matrix of four columns.
    let matrix = [0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let scene = changed(|document| document["nodes"] = json!([{"mesh": 0, "matrix": matrix}]), &[]).unwrap();
    let exchange = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z);
    assert_mapped(&scene.gaussians, &before, 2.0 * exchange, DVec3::ZERO, Some(exchange));
    assert!(scene.notices.is_empty());
}

/// Made outside of smalto: by numpy from A S A^T.
#[test]
fn pictures_of_nodes_are_those_of_the_gaussians_that_they_make() {
    let camera = Camera::looking_at([2.5, -1.5, -3.0].into(), [0.3; 3].into(), [320, 180], 1.0);
    let picture = |name: &str| {
        let scene = formats::read(fixture(name)).unwrap();
        assert!(scene.notices.is_empty(), "{:?}", scene.notices);
        render(&scene.gaussians, &camera, &Options::EXACT.rules, Background::BLACK)
    };
    let pairs = [
        ("node.mirrored.glb", "node.mirrored.ply"),
        ("node.stretched.glb", "node.stretched.ply"),
        ("node.instances.glb", "node.instances.expected.glb"),
    ];
    for (name, expected) in pairs {
        let found = compare(&picture(name).to_pixels(), &picture(expected));
        assert!(found.psnr > 90.0, "{name}: {found:?}");
    }
}

#[test]
fn instances_are_drawn_at_their_places() {
    let before = plain();
    let (shifts, turn) = ([[1.0, 0.0, -2.0], [0.0, 3.0, 0.5]], [0.0, 0.6, 0.0, 0.8]);
    let bytes = floats(&[shifts[0].as_slice(), &shifts[1], &turn, &[0.0, 0.0, 0.0, 2.0]].concat());
    let with = |attributes: fn(usize, usize) -> Value, bytes: &[u8]| {
        changed(
            |document| {
                let shift = add_accessor(document, 0, "VEC3", 5126, 2);
                let turn = add_accessor(document, 1, "VEC4", 5126, 2);
                let instancing = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes(shift, turn)}});
                document["nodes"] = json!([{"mesh": 0, "scale": [2.0, 2.0, 2.0], "extensions": instancing}]);
                document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
                document["extensionsUsed"] = json!(["KHR_gaussian_splatting", "EXT_mesh_gpu_instancing"]);
            },
            bytes,
        )
    };
    let both: fn(usize, usize) -> Value = |shift, turn| json!({"TRANSLATION": shift, "ROTATION": turn});
    let scene = with(both, &bytes).unwrap();
    assert!(scene.notices.is_empty(), "{:?}", scene.notices);
    assert_eq!(scene.gaussians.len(), 2 * before.len());
    let half = |first: usize| {
        let indices: Vec<u32> = (first..first + before.len()).map(|i| i as u32).collect();
        scene.gaussians.selected(&indices).unwrap()
    };
    let rotation = DMat3::from_quat(DQuat::from_xyzw(0.0, 0.6, 0.0, 0.8));
    let shift = |i: usize| 2.0 * DVec3::from(shifts[i].map(f64::from));
    assert_mapped(&half(0), &before, 2.0 * rotation, shift(0), Some(rotation));
    // A quaternion of length 2 is the same rotation.
    assert_mapped(
        &half(before.len()),
        &before,
        DMat3::from_diagonal(DVec3::splat(2.0)),
        shift(1),
        Some(DMat3::IDENTITY),
    );

    let zero = floats(&[&shifts[0][..], &shifts[1], &turn, &[0.0; 4]].concat());
    let error = with(both, &zero).map(drop).unwrap_err();
    assert!(error.contains("instance 1 of a node: 0 0 0 0 is not a rotation"), "{error}");
    let error = with(|shift, _| json!({"TRANSLATION": shift, "ROTATION": 2}), &bytes).map(drop).unwrap_err();
    assert!(error.contains("have different lengths"), "{error}");
    let error = with(|_, _| json!({"_ID": 0}), &bytes).map(drop).unwrap_err();
    assert!(error.contains("has no attribute"), "{error}");
}

#[test]
fn nodes_are_hidden_shared_and_refused() {
    let nodes = |nodes: Value| {
        changed(
            |document| {
                document["nodes"] = nodes;
                document["scenes"][0]["nodes"] = json!([0]);
            },
            &[],
        )
    };
    let error = |value: Value| nodes(value).map(drop).unwrap_err();
    let zero = error(json!([{"mesh": 0, "rotation": [0, 0, 0, 0]}]));
    assert!(zero.contains("node 0: 0 0 0 0 is not a rotation"), "{zero}");
    assert!(error(json!([{"children": [1, 1]}, {"mesh": 0}])).contains("node 1 has two parents"));
    assert!(error(json!([{"mesh": 0, "children": [0]}])).contains("or is its own"));
    let matrix = [1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    assert!(error(json!([{"mesh": 0, "matrix": matrix}])).contains("last row of its matrix"));
    // A scale of zero and an invisible node hide everything below.
    let hidden = json!({"KHR_node_visibility": {"visible": false}});
    let children = json!([
        {"children": [1, 2, 3]}, {"mesh": 0, "scale": [0, 0, 0]}, {"extensions": hidden, "children": [4]}, {"mesh": 0},
        {"mesh": 0},
    ]);
    assert_eq!(nodes(children).unwrap().gaussians, plain());
    assert!(error(json!([{"mesh": 0, "scale": [0, 0, 0]}])).contains("shows no mesh"));
    // Several primitives in each of several nodes.
    let scene = changed(
        |document| {
            let primitive = document["meshes"][0]["primitives"][0].clone();
            document["meshes"][0]["primitives"] = json!([primitive, primitive, primitive]);
            document["nodes"] = json!([{"mesh": 0, "children": [1]}, {"mesh": 0}]);
        },
        &[],
    );
    assert_eq!(scene.unwrap().gaussians.len(), 6 * 61);
}

#[test]
fn what_is_not_drawn_is_named_in_a_sentence_each() {
    let scene = changed(
        |document| {
            document["extensionsUsed"] = json!(["KHR_gaussian_splatting", "KHR_materials_unlit", "MPEG_splats"]);
            let primitives = document["meshes"][0]["primitives"].as_array_mut().unwrap();
            primitives.push(json!({"mode": 4, "attributes": {"POSITION": 0}}));
        },
        &[],
    );
    let scene = scene.unwrap();
    assert_eq!(scene.gaussians, plain());
    let expected = [
        "what it stores in MPEG_splats is not read",
        "its scene has 1 primitives without Gaussians (like triangles), which are not drawn",
    ];
    assert_eq!(scene.notices, expected);
}

#[test]
fn counts_of_all_nodes_are_added_up_before_the_first_is_decoded() {
    let started = std::time::Instant::now();
    // 61 Gaussians x 1,000,000 instances x 1000 nodes: 14 TB. The instances are all at one place.
    let error = changed(
        |document| {
            let shift = add_accessor(document, 0, "VEC3", 5126, 1_000_000);
            let instancing = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": shift}}});
            let node = json!({"mesh": 0, "extensions": instancing});
            document["nodes"] = vec![node; 1000].into();
            document["scenes"][0]["nodes"] = (0..1000).collect::<Vec<_>>().into();
        },
        &vec![0; 12_000_000],
    );
    let error = error.map(drop).unwrap_err();
    assert!(error.contains("cannot allocate") && error.contains("free memory"), "{error}");
    assert!(started.elapsed().as_secs() < 30, "{:?}", started.elapsed());
}

/// A few wrong scales must not change the meaning of all others.
#[test]
fn most_scales_decide_whether_they_are_logarithms() {
    let scales = |map: fn(usize, f32) -> f32| {
        let found: Vec<f32> = plain().scales().as_flattened().to_vec();
        let bytes: Vec<f32> = found.iter().enumerate().map(|(i, s)| map(i, *s)).collect();
        let scene = changed(
            |document| {
                let scale = add_accessor(document, 0, "VEC3", 5126, 61);
                let attributes = &mut document["meshes"][0]["primitives"][0]["attributes"];
                attributes["KHR_gaussian_splatting:SCALE"] = scale.into();
            },
            &floats(&bytes),
        );
        scene.unwrap()
    };
    let one_is_wrong = scales(|i, s| if i == 4 { -s } else { s });
    assert_eq!(one_is_wrong.format, "glTF");
    assert_eq!((one_is_wrong.report.negative_scale, one_is_wrong.report.dropped()), (1, 1));
    let others: Vec<u32> = (0..61).filter(|i| *i != 1).collect();
    assert_eq!(one_is_wrong.gaussians, plain().selected(&others).unwrap());

    let logarithms = scales(|i, s| if i == 4 { 0.5 } else { s.ln() });
    assert_eq!(logarithms.format, "glTF, scales as logarithms");
    assert!(logarithms.notices[0].contains("so all are read as logarithms"), "{:?}", logarithms.notices);
    for (i, (found, expected)) in logarithms.gaussians.scales().iter().zip(plain().scales()).enumerate() {
        for axis in 0..3 {
            let expected = if 3 * i + axis == 4 { 0.5_f32.exp() } else { expected[axis] };
            assert!((found[axis] / expected - 1.0).abs() < 2e-6, "{i}: {found:?}");
        }
    }
}

#[test]
fn sparse_accessors_replace_values() {
    let with = |indices: [u16; 2]| {
        let bytes = [floats(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), indices.map(u16::to_le_bytes).concat()].concat();
        changed(
            |document| {
                add_accessor(document, 0, "VEC3", 5126, 2);
                add_accessor(document, 1, "SCALAR", 5123, 2);
                let views = document["bufferViews"].as_array().unwrap().len();
                document["accessors"][0]["sparse"] = json!({
                    "count": 2,
                    "indices": {"bufferView": views - 1, "componentType": 5123},
                    "values": {"bufferView": views - 2},
                });
            },
            &bytes,
        )
    };
    let (found, before) = (with([3, 60]).unwrap().gaussians, plain());
    for i in 0..61 {
        let expected = match i {
            3 => [1.0, -2.0, -3.0],
            60 => [4.0, -5.0, -6.0],
            _ => before.means()[i],
        };
        assert_eq!(found.means()[i], expected, "{i}");
    }
    for (indices, expected) in [([60, 3], "not ascending"), ([3, 3], "not ascending"), ([3, 61], "but there are 61")] {
        let error = with(indices).map(drop).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}
