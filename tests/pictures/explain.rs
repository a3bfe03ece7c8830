//! The explanation of a pixel: its splats in order, against the f64 reference.

use crate::common::cloud::{camera, cloud};
use crate::common::free::build;
use crate::common::listed::Listed;
use crate::common::{Gpu, Random};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::render::{Attribute, Look};
use smalto::rules::Background;

use super::inspect::{Case, captured_case, cases, inspect, look, still_of};

#[test]
fn an_explanation_adds_up_to_the_pixel_in_the_order_of_the_reference() {
    check_explanations(&cases(), [true, false]);
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn an_explanation_adds_up_to_the_pixel_in_a_captured_scene() {
    check_explanations(&captured_case(), [false]);
}

fn check_explanations<const N: usize>(cases: &[Case; N], portable: [bool; N]) {
    let gpu = Gpu::new();
    for ((scene, camera), portable) in cases.iter().zip(portable) {
        let options = Options { portable, ..Options::EXACT };
        let mut still = still_of(&gpu, scene, &options);
        let background = Background::Colour([0.1, 0.2, 0.3]);
        still.render(camera, background).unwrap();
        let (pixels, exact) = (still.pixels().unwrap(), Listed::of(scene, camera));
        let (doubts, [width, height]) = (exact.blend(), camera.size_px);
        let mut random = Random(2);
        let mut compared = 0;
        for _ in 0..60 {
            let [x, y] = [random.below(width), random.below(height)];
            let explanation = still.explain([x, y]).unwrap();
            let [r, g, b, alpha] = pixels.at(x, y);
            let colour = explanation.colour(background);
            let error = [colour[0] - r, colour[1] - g, colour[2] - b, 1.0 - explanation.transmittance - alpha];
            assert!(error.iter().all(|e| e.abs() <= 1e-6), "{x} {y}: {error:?}");
            let index = (y * width + x) as usize;
            let walked = exact.walk(index);
            if doubts[index].doubt > 0.0 {
                continue;
            }
            compared += 1;
            let ids: Vec<u32> = walked.blended.iter().map(|splat| exact.gaussians[*splat as usize]).collect();
            assert_eq!(explanation.splats.iter().map(|s| s.gaussian).collect::<Vec<_>>(), ids, "{x} {y}");
            assert_eq!(explanation.is_stopped, walked.is_stopped, "{x} {y}");
            let mut rest = 1.0;
            let mut median = None;
            for (splat, id) in explanation.splats.iter().zip(&walked.blended) {
                let splat_in_f64 = &exact.splats[*id as usize];
                assert_eq!(splat.depth, splat_in_f64.depth as f32);
                assert_eq!((splat.transmittance, splat.share), (rest, splat.alpha * rest));
                rest *= 1.0 - splat.alpha;
                median = median.or((rest < 0.5).then_some(splat.depth));
            }
            match (median, explanation.depth()) {
                (None, None) => assert!(ids.is_empty()),
                (None, Some(mean)) => {
                    let depths = explanation.splats.iter().map(|s| s.depth);
                    let [nearest, farthest] = [depths.clone().reduce(f32::min), depths.reduce(f32::max)];
                    assert!(Some(mean) >= nearest && Some(mean) <= farthest);
                }
                (median, depth) => assert_eq!(depth, median),
            }
        }
        assert!(compared >= 50, "{compared} compared");
        assert!(still.explain([width, 0]).is_err());
        let depth = inspect(&mut still, camera, look(Look::Attribute(Attribute::Depth))).pixels;
        let [x, y] = [width / 2, height / 2];
        let (explained, shown) = (still.explain([x, y]).unwrap().colour(Background::BLACK), depth.at(x, y)[0]);
        assert!(shown > 0.1 && (explained[0] - shown).abs() <= 1e-6 * shown, "{explained:?} for {shown}");
    }
}

#[test]
fn explain_describes_the_last_frame_even_if_it_is_incomplete() {
    let gpu = Gpu::new();
    let scene = build(&cloud(&mut Random(5), 400, 2, 0.3), 2);
    let mut still = still_of(&gpu, &scene, &Options::EXACT);
    assert!(still.explain([0, 0]).is_err(), "nothing is rendered yet");
    let room = smalto::render::Capacity { gaussians: 400, visible: 1, spans: 1, listed: 1, cells: 1 };
    let mut short = still_of(&gpu, &scene, &Options::EXACT).with_capacity(room).unwrap();
    let away = Camera { position: DVec3::new(0.3, 0.1, -1.0), ..camera() };
    still.render(&away, Background::BLACK).unwrap();
    let expected = still.explain([40, 30]).unwrap();
    assert!(expected.splats.len() > 2);
    let started = short.start(&away, Background::BLACK).unwrap();
    assert_eq!(short.explain([40, 30]).unwrap(), expected, "it did not fit");
    short.finish(started).unwrap();
    assert_eq!(short.explain([40, 30]).unwrap(), expected);
    short.render(&camera(), Background::BLACK).unwrap();
    assert_ne!(short.explain([40, 30]).unwrap(), expected);
}
