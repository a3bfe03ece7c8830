//! Choices behind `smalto trade`: Pareto points, and options that keep a budget.

use crate::common::{Gpu, ROUNDING, Random};
use glam::DVec3;
use smalto::camera::{Camera, path as paths};
use smalto::measure::bench::Protocol;
use smalto::measure::metrics::{Difference, max_error};
use smalto::measure::trade::{Budget, Choice, Grounds, Point, Study, Unmeetable, choose, mark_pareto};
use smalto::options::{Options, Storage};
use smalto::packing::{Layout, Statistics};
use smalto::pixels::Pixels;
use smalto::procedural::Procedural;
use smalto::render::{self};
use smalto::rules::{ALPHA_MIN, Background, Rules};
use smalto::scene::{Focus, Gaussians};

use super::trade::scene;

fn point(ms: f64, db: Option<f64>) -> Point {
    let grey = |value: f32| Pixels { size: [1, 1], rgba: vec![[value, value, value, 1.0]] };
    let from_oracle = Difference { psnr_db: db, ..Difference::between(&grey(0.0), &grey(0.5)) };
    Point {
        name: String::new(),
        options: Options::EXACT,
        drawn_by: render::Path::Portable,
        notice: None,
        warm_up: None,
        gpu_ms: ms,
        stages: Vec::new(),
        scene_bytes: 0,
        work_bytes: 0,
        from_exact: from_oracle.clone(),
        from_oracle,
        is_pareto: false,
    }
}

#[test]
fn pareto_points_are_beaten_in_speed_and_accuracy_by_none() {
    let marks = |places: &[(f64, Option<f64>)]| {
        let mut points: Vec<Point> = places.iter().map(|(ms, db)| point(*ms, *db)).collect();
        mark_pareto(&mut points.iter_mut().collect::<Vec<_>>());
        points.iter().map(|p| p.is_pareto).collect::<Vec<_>>()
    };
    let db = Some;
    assert_eq!(
        marks(&[(2.0, db(60.0)), (1.0, db(50.0)), (1.5, db(40.0)), (3.0, db(60.0))]),
        [true, true, false, false]
    );
    assert_eq!(marks(&[(1.0, db(50.0)), (1.0, db(60.0))]), [false, true], "as fast, but farther");
    assert_eq!(marks(&[(1.0, db(50.0)), (1.0, db(50.0))]), [true, true], "equals do not beat one another");
    assert_eq!(marks(&[(2.0, None), (1.0, db(200.0))]), [true, true], "nothing is closer than an equal picture");
    assert_eq!(marks(&[]), Vec::<bool>::new());
}

const SMALL: [u32; 2] = [64, 48];

/// Views from around the scene.
fn orbit(scene: &Gaussians, count: usize) -> Vec<Camera> {
    let focus = Focus::of(scene);
    paths::orbit(DVec3::from(focus.centre), focus.radius, true, SMALL, count)
}

/// What is chosen for this budget from some views of the scene; and whether it holds on `others`.
fn chosen(gpu: &Gpu, scene: &Gaussians, budget: Budget, others: &[Camera]) -> anyhow::Result<Choice> {
    let statistics = Statistics::of(scene);
    let views = orbit(scene, 4);
    let study = |views: &[Camera]| {
        let protocol = Protocol { warmup: 0, frames: 2 };
        let views = [views.to_vec(), views.to_vec()];
        Study::new(&gpu.0, (scene, &statistics), (Options::EXACT, Background::BLACK), views, protocol, &|_| Ok(()))
    };
    let choice = choose(&study(&views)?, budget, &|_| Ok(()))?;
    println!("{}", choice.explain());
    assert!(choice.gpu_ms <= choice.exact_gpu_ms);
    let held = choice.verify(&study(others)?)?;
    assert_eq!((held.exceeded, held.held_out_views), (0, others.len()), "{}", choice.explain());
    Ok(choice)
}

#[test]
fn options_chosen_for_a_budget_keep_it_on_other_views() {
    let gpu = Gpu::new();
    let scene = scene();
    let others = orbit(&scene, 11);
    for budget in [Budget::MaxError(0.02), Budget::MinPsnr(45.0)] {
        let choice = chosen(&gpu, &scene, budget, &others[1..]).unwrap();
        let (Grounds::Proven(error) | Grounds::Measured(error)) = choice.grounds;
        if let Budget::MaxError(allowed) = budget {
            assert!(error <= allowed);
            assert_eq!(choice.options.key_bits, 32, "no view tells what swapped splats do in another");
        }
    }
}

#[test]
fn a_tight_budget_chooses_exact_or_is_refused() {
    let gpu = Gpu::new();
    let scene = Procedural::parse("many-small:60").unwrap().unwrap().make().unwrap().gaussians;
    let others = orbit(&scene, 5);
    let choice = chosen(&gpu, &scene, Budget::MaxError(1.6e-4), &others).unwrap();
    assert_eq!(choice.options.rules, Rules::TRAINED);
    let refused = chosen(&gpu, &scene, Budget::MaxError(1e-6), &others).unwrap_err();
    assert!(refused.is::<Unmeetable>(), "{refused:#}");
    assert!(chosen(&gpu, &scene, Budget::MinPsnr(400.0), &others).unwrap_err().is::<Unmeetable>());
}

/// A search for a view in which options that are chosen by proof are farther from the exact picture than it says: the
/// stop, the degree and the storage of the harmonics together, over random views of a bright scene.
#[test]
fn proven_bounds_of_stop_degree_and_storage_hold_in_every_view() {
    let gpu = Gpu::new();
    let scene = scene();
    let statistics = Statistics::of(&scene);
    let mut random = Random(7);
    let focus = Focus::of(&scene);
    let mut closest = 0.0_f64;
    for (sh_degree, sh_storage, stop) in [
        (3, Storage::F16, 1e-3),
        (2, Storage::U8, 1.0 / 64.0),
        (1, Storage::Lossless, ALPHA_MIN),
        (0, Storage::U8, 0.03),
    ] {
        let options = Options { sh_degree, sh_storage, stop, ..Options::EXACT };
        let colours = Layout::of(&statistics, &options).colour_error(&scene);
        let bound = colours + f64::from(stop) * statistics.requirements.brightest.max(1.0);
        for _ in 0..6 {
            let from = DVec3::from_array(std::array::from_fn(|_| random.between(-1.0, 1.0))).normalize();
            let from = DVec3::from(focus.centre) + from * focus.radius * random.between(0.5, 3.0);
            let camera = Camera::looking_at(from, focus.centre.into(), SMALL, random.between(0.3, 1.2));
            let rules = Rules { near: 0.05, ..Rules::TRAINED };
            let picture = |options: Options| gpu.render(&scene, &camera, &Options { rules, ..options });
            let error = f64::from(max_error(&picture(options), &picture(Options::EXACT)));
            assert!(error <= bound + ROUNDING, "{error:e} passes {bound:e}: {options:?} from {camera:?}");
            closest = closest.max(error / bound);
        }
    }
    println!("the closest is {closest:.2} of the bound");
    assert!(closest > 0.1, "{closest}");
}
