//! Frames of the window that several devices share.

use smalto::gpu::Validation;
use smalto::options::Options;
use smalto::render::SelectionMode;
use smalto::rules::Rules;
use smalto::viewer::{Change, CompareTarget, Offscreen, Property, Selection, Setup, Tab, view_mode};

use super::frames::{open, rendered, setup, shown};
use crate::common::{Gpu, open as open_device};

/// Draws the next frames in bands, if they can be, whatever their time is; returns the number of bands.
fn bands(offscreen: &mut Offscreen) -> usize {
    let first = offscreen.session.pair.first.as_mut().unwrap();
    first.sharing.iter_mut().for_each(|sharing| sharing.devices.always_draw_bands());
    offscreen.viewer().pictures.are_stale = true;
    offscreen.settle().unwrap();
    let first = offscreen.session.pair.first.as_ref().unwrap();
    first.sharing.as_ref().map_or(0, |sharing| sharing.devices.last_bands().len())
}

/// The pictures are those of one device for all options. Edited and inspected ones, and those of a lower scale, are
/// drawn by the first device; another device that is lost costs a message.
#[test]
fn a_window_with_several_devices_shows_the_bits_of_one() {
    let gpu = Gpu::own();
    let other = open_device(Validation::Required);
    let mut offscreen = open(&gpu, Setup { other_devices: vec![other.clone()], ..setup(&["cactus:3000"]) });
    let near = offscreen.viewer().options.rules.near;
    for preset in [Options::BALANCED, Options::EXACT, Options::PREVIEW] {
        let options = Options { rules: Rules { near, ..preset.rules }, ..preset };
        offscreen.viewer().options = options;
        offscreen.settle().unwrap();
        assert_eq!(bands(&mut offscreen), if options.scale == 1.0 { 2 } else { 0 });
        assert!(shown(&mut offscreen) == rendered(&gpu, &mut offscreen, &options));
    }
    let options = Options { rules: Rules { near, ..Options::BALANCED.rules }, ..Options::BALANCED };
    offscreen.viewer().options = options;
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 2);
    let picture = shown(&mut offscreen);
    // A look, and back.
    let mut alone = open(&gpu, setup(&["cactus:3000"]));
    for look in ["evaluations", "alpha", "transmittance-left"] {
        // Also at once, where the last picture was in bands.
        for offscreen in [&mut offscreen, &mut alone] {
            offscreen.viewer().options = options;
            offscreen.viewer().inspector.settings.mode = view_mode(look).unwrap();
            offscreen.settle().unwrap();
        }
        assert!(shown(&mut offscreen) == shown(&mut alone), "{look}");
        assert_eq!(bands(&mut offscreen), 0, "{look}");
        assert!(shown(&mut offscreen) == shown(&mut alone) && shown(&mut offscreen) != picture, "{look}");
        offscreen.viewer().inspector.settings.mode = 0;
        offscreen.settle().unwrap();
        assert_eq!(bands(&mut offscreen), 2);
    }
    offscreen.viewer().inspector.settings.mode = 0;
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 2);
    assert!(shown(&mut offscreen) == picture);
    // Nothing waits for the other device when it is lost.
    offscreen.session.pair.first.as_mut().unwrap().sharing.as_mut().unwrap().devices.lose(0);
    assert_eq!(bands(&mut offscreen), 0);
    let messages = &mut offscreen.viewer().messages;
    let said = messages.shown().iter().find(|message| message.text.contains("draws no bands any more"));
    let said = said.expect("the loss is said").text.clone();
    // The message is over the picture.
    messages.retract(&said);
    assert_eq!(bands(&mut offscreen), 0);
    assert!(shown(&mut offscreen) == picture);
    // Later builds do without it.
    offscreen.viewer().options = Options { rules: Rules { near, ..Options::EXACT.rules }, ..Options::EXACT };
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 0);
    assert!(offscreen.viewer().setup.other_devices.is_empty());
    assert_eq!(other.validation_messages(), Vec::<String>::new());
}

/// Only the first device has the marks of edits.
#[test]
fn marked_gaussians_are_drawn_by_the_first_device() {
    let gpu = Gpu::own();
    let other = open_device(Validation::Required);
    let mut offscreen = open(&gpu, Setup { other_devices: vec![other.clone()], ..setup(&["cactus:3000"]) });
    assert_eq!(bands(&mut offscreen), 2);
    let picture = shown(&mut offscreen);
    offscreen.viewer().select(&Selection::Values(Property::Opacity, 0.0..=0.5), SelectionMode::Replace);
    offscreen.settle().unwrap();
    offscreen.viewer().change(Change::Hide);
    offscreen.settle().unwrap();
    // Messages are over the picture.
    let texts = Vec::from_iter(offscreen.viewer().messages.shown().iter().map(|message| message.text.clone()));
    texts.iter().for_each(|text| offscreen.viewer().messages.retract(text));
    assert_eq!(bands(&mut offscreen), 0);
    let edited = offscreen.session.pair.first.as_ref().unwrap().plan.edited().unwrap();
    let (camera, options) = (offscreen.viewer().view.camera(), offscreen.viewer().options);
    let expected = gpu.render(&edited, &camera, &options);
    let now = shown(&mut offscreen);
    assert!(now != picture && now.to_rgb8() == expected.to_rgb8(), "some Gaussians are hidden");
    assert_eq!(other.validation_messages(), Vec::<String>::new());
}

/// The values that the panel tells are not those of 8 bits, and a compared picture is drawn by the first device.
#[test]
fn values_and_comparisons_have_colours_that_are_not_rounded() {
    let gpu = Gpu::own();
    let other = open_device(Validation::Required);
    let setup = Setup { other_devices: vec![other.clone()], hides_panels: false, ..setup(&["cactus:3000"]) };
    let mut offscreen = Offscreen::new(setup, &gpu.0, [700, 240]).unwrap();
    offscreen.viewer().panels.recent.tab = Tab::Inside;
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 2);
    let viewer = offscreen.viewer();
    let (camera, options) = (viewer.view.camera(), viewer.options);
    let snapshot = viewer.inspector.snapshot.as_ref().expect("the picture is at rest").first.clone();
    let gaussians = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    assert!(*snapshot == gpu.render(&gaussians, &camera, &options));
    let exact = Options { rules: options.rules, ..Options::EXACT };
    offscreen.viewer().comparison.target = CompareTarget::Options(Some(exact));
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 0);
    offscreen.viewer().comparison.target = CompareTarget::Nothing;
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 2);
    assert_eq!(other.validation_messages(), Vec::<String>::new());
}
