//! SOG as smalto writes it: what independent software reads from it, and how near that is to what was written.

use std::fs;
use std::io::Cursor;

use crate::common::table::{self, SAME, Table, Tolerance, fixture, parse, read};
use smalto::formats;
use smalto::formats::SceneFile;
use smalto::procedural::cactus;
use smalto::scene::{Builder, Gaussians, Raw};

fn written(gaussians: &Gaussians) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    SceneFile::Sog.write(gaussians, false, &mut out).unwrap();
    out.into_inner()
}

/// The fixture is what smalto wrote when splat-transform read it, and what it writes today.
#[test]
fn splat_transform_reads_what_is_written() {
    let plush = read(&fixture("plush.ply")).gaussians;
    assert!(written(&plush) == fs::read(fixture("smalto.sog")).unwrap(), "other bytes than splat-transform has read");
    let theirs = Table::read(&fixture("smalto.sog.csv"));
    table::agrees("smalto.sog", &read(&fixture("smalto.sog")).gaussians, &theirs, &SAME);
    // 61 Gaussians share 32 palette entries.
    table::agrees("plush.ply", &plush, &theirs, &Tolerance { value: 0.035, rotation: 5e-5 });
}

/// Every Gaussian of a scene with needles, floaters and view-dependent colour, within the steps of the format.
#[test]
fn written_sog_is_near_the_source() {
    let scene = cactus(5000).unwrap().gaussians;
    let back = parse(".sog", &written(&scene)).unwrap().gaussians;
    assert_eq!((back.len(), back.sh_degree()), (scene.len(), 3));
    let compressed = |v: f32| f64::from(v).abs().ln_1p().copysign(v.into());
    let range = |axis: usize| {
        let all = || scene.means().iter().map(|m| compressed(m[axis]));
        all().fold(f64::MIN, f64::max) - all().fold(f64::MAX, f64::min)
    };
    let ranges = [0, 1, 2].map(range);
    let mut squares = [0.0; 3];
    for i in 0..scene.len() {
        for (axis, range) in ranges.iter().enumerate() {
            let (before, after) = (scene.means()[i][axis], back.means()[i][axis]);
            table::close("mean", compressed(after) as f32, compressed(before), range / 65535.0 * 0.51 + 1e-6);
            squares[0] += f64::from(scene.scales()[i][axis] / back.scales()[i][axis]).ln().powi(2);
        }
        table::close("opacity", back.opacities()[i], scene.opacities()[i].into(), 0.51 / 255.0);
        let dot: f64 = scene.rotations()[i].iter().zip(back.rotations()[i]).map(|(a, b)| f64::from(a * b)).sum();
        // Half a step of sqrt(2) / 255 in three components, and what that does to the fourth when all are equal.
        assert!(dot.abs() > 1.0 - 5e-5, "{i}: {dot}");
        for (k, (before, after)) in scene.sh(i).iter().zip(back.sh(i)).enumerate() {
            let square: f32 = before.iter().zip(after).map(|(a, b)| (a - b).powi(2)).sum();
            squares[if k == 0 { 1 } else { 2 }] += f64::from(square);
        }
    }
    let each = |sum: f64, values: usize| (sum / (values * scene.len()) as f64).sqrt();
    let rms = [each(squares[0], 3), each(squares[1], 3), each(squares[2], 45)];
    assert!(rms[0] < 0.02 && rms[1] < 0.01 && rms[2] < 0.02, "scales, colours, coefficients: {rms:?}");
}

/// Codebooks and palette hold all values that a SOG has.
#[test]
fn rewriting_a_sog_changes_nothing() {
    let first = read(&fixture("plush.sog")).gaussians;
    let again = parse(".sog", &written(&first)).unwrap().gaussians;
    assert_eq!(again.scales(), first.scales());
    assert_eq!(again.opacities(), first.opacities());
    for i in 0..first.len() {
        assert_eq!(again.sh(i), first.sh(i));
        for axis in 0..3 {
            table::close("mean", again.means()[i][axis], first.means()[i][axis].into(), 3e-6);
        }
    }
}

#[test]
fn sog_bytes_do_not_depend_on_the_number_of_threads() {
    let scene = cactus(4000).unwrap().gaussians;
    let on =
        |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| written(&scene));
    assert!(on(1) == on(5));
}

#[test]
fn a_folder_holds_the_same_files() {
    let scene = read(&fixture("plush.sh1.ply")).gaussians;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/scene");
    formats::write_sog_folder(&scene, true, &path, |_| Ok(())).unwrap();
    assert_eq!(fs::read_dir(&path).unwrap().count(), 8);
    let back = read(&path);
    assert!(back.is_antialiased);
    assert_eq!(back.gaussians, parse(".sog", &written(&scene)).unwrap().gaussians);
}

/// A texture of another SOG that is large enough for this one.
#[test]
fn textures_of_several_scenes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [few, many] = ["few", "many"].map(|name| folder.path().join(name));
    formats::write_sog_folder(&read(&fixture("plush.sh1.ply")).gaussians, false, &few, |_| Ok(())).unwrap();
    let cactus = cactus(3000).unwrap().gaussians;
    formats::write_sog_folder(&cactus, false, &many, |_| Ok(())).unwrap();
    for name in ["means_l", "means_u", "scales", "quats", "sh0", "shN_labels"].map(|stem| format!("{stem}.webp")) {
        let own = fs::read(few.join(&name)).unwrap();
        fs::copy(many.join(&name), few.join(&name)).unwrap();
        let error = formats::read(&few).map(drop).unwrap_err().to_string();
        assert!(error.contains("they are not of one scene"), "{error}");
        fs::write(few.join(&name), own).unwrap();
    }
    assert_eq!(read(&few).gaussians.len(), 61);
}

#[test]
fn sog_holds_flat_distant_and_single_gaussians() {
    let raw = |mean: f64, log_scale: f64| Raw {
        mean: [mean, 0.0, -mean],
        log_scale: [log_scale, -3.0, f64::NEG_INFINITY],
        rotation: [0.5, -0.5, 0.5, -0.5],
        opacity_logit: f64::INFINITY,
    };
    let raws = [raw(1e30, 60.0), raw(0.0, -3.0), raw(-1e-3, -300.0)];
    for count in 0..=raws.len() {
        let mut builder = Builder::new(1, count).unwrap();
        builder.extend(count, |i, _| raws[i]);
        let bytes = written(&builder.finish().0);
        if count == 0 {
            continue;
        }
        let back = parse(".sog", &bytes).unwrap().gaussians;
        assert_eq!(back.len(), count);
        assert!(back.scales()[0][2] < 1e-37 && (back.scales()[0][0].ln() - 60.0).abs() < 1e-5);
        assert!((back.means()[0][0] / 1e30 - 1.0).abs() < 1e-5);
        assert_eq!(back.opacities(), vec![1.0; count]);
    }
}
