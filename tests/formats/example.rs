//! The example of the library draws scenes in memory, in pages and with levels of detail, through one door.

use std::path::Path;

use smalto::gpu::DeviceChoice;
use smalto::measure::metrics::psnr;
use smalto::pixels::Pixels;

use crate::common::program::{ok, path};

#[allow(dead_code, reason = "`main` reads the command line")]
#[path = "../../examples/render.rs"]
mod render;

#[test]
fn the_example_of_the_library_draws_files_of_any_format() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, sog, pages, levels] = ["a.ply", "sog/meta.json", "a.smalto", "levels.smalto"].map(|n| path(&folder, n));
    [&ply, &sog, &pages].iter().for_each(|file| drop(ok(&["convert", "cactus:20000", file])));
    ok(&["lod", "cactus:20000", "-o", &levels]);
    let device = std::env::var("SMALTO_DEVICE").map_or(DeviceChoice::Best, |name| name.as_str().into());
    let picture = folder.path().join("a.png");
    let draw = |scene: &Path| {
        let frame = render::render(scene, &picture, &device).unwrap();
        assert!(frame.totals.visible > 10_000, "{}: {} are visible", scene.display(), frame.totals.visible);
        Pixels::read(&picture).unwrap()
    };
    let expected = draw(ply.as_ref());
    assert!(expected.largest() > 0.3, "the picture is not black");
    // A SOG rounds its values.
    for (scene, least) in [(Path::new(&sog).parent().unwrap(), 30.0), (pages.as_ref(), 50.0), (levels.as_ref(), 50.0)] {
        let found = psnr(&draw(scene), &expected);
        assert!(found > least, "{}: {found} dB", scene.display());
    }
}
