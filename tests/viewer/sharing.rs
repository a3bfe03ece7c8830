//! Frames of the window that several devices share.

use smalto::gpu::Validation;
use smalto::options::Options;
use smalto::render::SelectionMode;
use smalto::rules::Rules;
use smalto::viewer::{Change, CompareTarget, Offscreen, Property, Selection, Setup, Tab};

use super::frames::{open, rendered, setup, shown};
use crate::common::{Gpu, open as open_device};

/// Draws the next frames in bands, if they can be, whatever their time is; returns the number of bands.
fn bands(offscreen: &mut Offscreen) -> usize {
    let first = offscreen.session.pair.first.as_mut().unwrap();
    let devices = &mut first.sharing.as_mut().unwrap().devices;
    devices.pay_from(0.0);
    offscreen.viewer().pictures.are_stale = true;
    offscreen.settle().unwrap();
    offscreen.session.pair.first.as_ref().unwrap().sharing.as_ref().unwrap().devices.last_bands().len()
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
    offscreen.viewer().inspector.settings.mode = 1;
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 0);
    assert!(shown(&mut offscreen) != picture);
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
    // A later build begins with all devices again, which have the scene.
    offscreen.viewer().options = Options { rules: Rules { near, ..Options::EXACT.rules }, ..Options::EXACT };
    offscreen.settle().unwrap();
    assert_eq!(bands(&mut offscreen), 2);
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
    assert_eq!(bands(&mut offscreen), 0);
    assert!(shown(&mut offscreen) != picture, "some Gaussians are hidden");
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
