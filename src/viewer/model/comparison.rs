//! The comparison of the picture with a second one: what the second picture is, and how the two are shown.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use super::loaded_scene::{DrawnScene, LoadedScene, are_same, draw_same};
use super::snapshot::{Area, PairDifference};
use crate::camera::Camera;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::render::Compare;
use crate::rules::{Background, Rules};

/// The target of the comparison.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum CompareTarget {
    #[default]
    Nothing,
    /// The scenes chosen for the second picture, drawn with these options; `None` for the options of the first picture.
    Options(Option<Options>),
    /// The float64 reference, drawn for one view.
    Reference,
    /// A photograph or another picture file.
    Picture,
}

/// The way two pictures are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CompareMode {
    /// Side by side, at a line that can be dragged.
    Split,
    /// One after the other.
    Flicker,
    /// Their difference, amplified.
    Difference,
}

/// The settings and the state of a comparison.
pub struct Comparison {
    pub target: CompareTarget,
    pub mode: CompareMode,
    /// The fraction of the width that is left of the split, 0 to 1.
    pub split: f32,
    /// The factor by which differences are amplified.
    pub gain: f32,
    /// The key that shows the second picture is held.
    pub is_flicked: bool,
    /// Automatic flickers per second; 0 for none.
    pub flicker_hz: f32,
    /// A picture that the GPU did not draw: the reference or a file.
    pub picture: Option<SecondPicture>,
    /// Index of the camera whose photograph was requested last; `None` if it was another picture.
    pub requested_camera: Option<usize>,
    /// A picture in the place of `picture` is being drawn or read.
    pub is_loading: bool,
    /// Number of the last request for `picture`; results of earlier requests are dropped.
    pub last_request: u64,
    /// Number of requests whose result has not come, also those whose result will be dropped.
    pub requests_under_way: usize,
    /// `picture` must be resampled to the size of the window.
    pub is_stale: bool,
    /// `picture` in the size of the window.
    pub fitted: Option<Arc<Pixels>>,
    /// What `picture` covers of the window; `None` if it covers all.
    pub covered: Option<Area>,
    /// The last measured difference of the two pictures.
    pub pair_difference: Option<PairDifference>,
    /// A job measures the difference.
    pub is_measuring: bool,
    /// The area of the pictures to compare; `None` for the whole pictures.
    pub area: Option<Area>,
}

/// A picture that the GPU did not draw.
pub struct SecondPicture {
    pub name: String,
    pub pixels: Arc<Pixels>,
    pub of: PictureOf,
}

/// What a picture that the GPU did not draw shows.
#[derive(Clone)]
pub enum PictureOf {
    /// The reference, of this content.
    Content(Box<PictureContent>),
    /// A photograph, of the view of the camera with this index.
    Camera(usize),
    /// This file, of which no more is known.
    File(PathBuf),
}

/// The content of a picture: everything it depends on except number formats and knobs that trade accuracy.
#[derive(Clone)]
pub struct PictureContent {
    pub view: Camera,
    pub scenes: Vec<DrawnScene>,
    pub rules: Rules,
    pub background: Background,
}

impl PictureContent {
    /// Names the first difference from another content; `None` if they are equal.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        let Self { view, scenes, rules, background } = self;
        match () {
            () if !are_same(scenes, &other.scenes) => Some("other scenes or places"),
            () if !draw_same(scenes, &other.scenes) => Some("another edit"),
            () if *view != other.view => Some("another view"),
            () if *rules != other.rules => Some("other rules"),
            () if background.colour() != other.background.colour() => Some("another background"),
            () => None,
        }
    }

    /// Frees a scene that was closed. The content then differs from every later one.
    pub fn forget(&mut self, closed: &LoadedScene) {
        if self.scenes.iter().any(|drawn| drawn.scene.is_same(closed)) {
            self.scenes.clear();
        }
    }
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            target: CompareTarget::Nothing,
            mode: CompareMode::Split,
            split: 0.5,
            gain: 10.0,
            is_flicked: false,
            flicker_hz: 0.0,
            picture: None,
            requested_camera: None,
            is_loading: false,
            last_request: 0,
            requests_under_way: 0,
            is_stale: false,
            fitted: None,
            covered: None,
            pair_difference: None,
            is_measuring: false,
            area: None,
        }
    }
}

impl Comparison {
    /// Compares with this target. A picture that is still being drawn or read is then dropped.
    pub fn choose(&mut self, target: CompareTarget) {
        self.target = target;
        (self.is_loading, self.requested_camera) = (false, None);
        self.last_request += 1;
    }

    /// The options of the second picture; `None` if the GPU does not draw one.
    pub fn options(&self, first: &Options) -> Option<Options> {
        match &self.target {
            CompareTarget::Options(None) => Some(*first),
            CompareTarget::Options(Some(options)) => Some(with_rules_of_scene(options, first)),
            _ => None,
        }
    }

    /// The index of the camera whose photograph is the second picture.
    pub fn photograph_camera(&self) -> Option<usize> {
        match self.picture.as_ref()?.of {
            PictureOf::Camera(camera) => Some(camera),
            _ => None,
        }
    }

    /// The way to combine pictures `width` pixels wide, `seconds` after the start.
    pub fn shown(&self, width: u32, seconds: f64) -> Compare {
        let is_second_half = self.flicker_hz > 0.0 && (seconds * f64::from(self.flicker_hz)).fract() >= 0.5;
        match self.mode {
            _ if self.target == CompareTarget::Nothing => Compare::First,
            _ if self.is_flicked => Compare::Second,
            CompareMode::Split => Compare::Split(self.split * width as f32),
            CompareMode::Flicker => {
                if is_second_half {
                    Compare::Second
                } else {
                    Compare::First
                }
            }
            CompareMode::Difference => Compare::Difference(self.gain),
        }
    }

    /// The time until the automatic flicker changes pictures; [`Duration::MAX`] without automatic flicker.
    pub fn until_flicker(&self, seconds: f64) -> Duration {
        if self.target == CompareTarget::Nothing || self.mode != CompareMode::Flicker || self.flicker_hz <= 0.0 {
            return Duration::MAX;
        }
        let halves = seconds * f64::from(self.flicker_hz) * 2.0;
        Duration::from_secs_f64((1.0 - halves.fract()) / (f64::from(self.flicker_hz) * 2.0) + 1e-3)
    }
}

/// Options with the rules that depend on the scene, not on a preset: the near plane and antialiasing of `first`.
pub fn with_rules_of_scene(options: &Options, first: &Options) -> Options {
    let near = options.rules.near.min(first.rules.near);
    let rules = Rules { near, antialiased: first.rules.antialiased, ..options.rules };
    Options { rules, ..*options }
}

/// A photograph with premultiplied alpha, composited over a background.
pub fn over(pixels: &Pixels, background: Background) -> Pixels {
    let colour = background.colour();
    let pixel = |[r, g, b, a]: &[f32; 4]| {
        let [r, g, b] = [(r, 0), (g, 1), (b, 2)].map(|(value, c)| value + (1.0 - a) * colour[c]);
        [r, g, b, *a]
    };
    Pixels { size: pixels.size, rgba: pixels.rgba.iter().map(pixel).collect() }
}

/// `pixels` resampled (bilinear) to `size`: scaled to the same width and centred, with `background` above and below.
/// The field of view is horizontal, so this is the photograph as a window of `size` shows it.
pub fn fitted(pixels: &Pixels, size: [u32; 2], background: Background) -> Pixels {
    use rayon::prelude::*;
    if pixels.size == size {
        return pixels.clone();
    }
    let ratio = f64::from(pixels.size[0]) / f64::from(size[0]);
    let [width, height] = pixels.size.map(f64::from);
    let [r, g, b] = background.colour();
    let sample = |x: f64, y: f64| {
        let at = |x: f64, y: f64| pixels.at(x.clamp(0.0, width - 1.0) as u32, y.clamp(0.0, height - 1.0) as u32);
        let (low_x, low_y) = (x.floor(), y.floor());
        let (part_x, part_y) = ((x - low_x) as f32, (y - low_y) as f32);
        std::array::from_fn(|c| {
            let row = |y: f64| at(low_x, y)[c] * (1.0 - part_x) + at(low_x + 1.0, y)[c] * part_x;
            row(low_y) * (1.0 - part_y) + row(low_y + 1.0) * part_y
        })
    };
    let pixel = |i: usize| {
        let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
        let from_centre = |place: u32, side: u32| (f64::from(place) + 0.5 - f64::from(side) / 2.0) * ratio;
        let place = [from_centre(x, size[0]) + width / 2.0, from_centre(y, size[1]) + height / 2.0];
        let is_inside = place[0] >= 0.0 && place[1] >= 0.0 && place[0] < width && place[1] < height;
        if is_inside { sample(place[0] - 0.5, place[1] - 0.5) } else { [r, g, b, 0.0] }
    };
    let count = size[0] as usize * size[1] as usize;
    Pixels { size, rgba: (0..count).into_par_iter().map(pixel).collect() }
}

/// The rows of a window of `size` that [`fitted`] fills from a picture of size `of`; `None` if it fills all.
pub fn covered(of: [u32; 2], size: [u32; 2]) -> Option<Area> {
    let [width, height] = size;
    let rows = f64::from(of[1]) * f64::from(width) / f64::from(of[0]);
    // The first row whose centre is at or beyond a place.
    let from = |place: f64| (place - 0.5).ceil().clamp(0.0, f64::from(height)) as u32;
    let [top, bottom] = [-0.5, 0.5].map(|half| from(0.5 * f64::from(height) + half * rows));
    ([top, bottom] != [0, height]).then_some([0, top, width, bottom])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(size: [u32; 2]) -> Pixels {
        let pixel = |i: u32| [(i % size[0]) as f32 + 0.5, (i / size[0]) as f32 + 0.5, 0.0, 1.0];
        Pixels { size, rgba: (0..size[0] * size[1]).map(pixel).collect() }
    }

    #[test]
    fn a_photograph_lies_in_the_window_as_its_camera_saw_it() {
        // Twice as wide as the window and relatively higher: cut above and below.
        let fitted = fitted(&ramp([8, 8]), [4, 2], Background::BLACK);
        assert_eq!(fitted.at(0, 0)[..2], [1.0, 3.0]);
        assert_eq!(fitted.at(3, 1)[..2], [7.0, 5.0]);
    }

    #[test]
    fn beyond_a_photograph_is_the_background() {
        let fitted = fitted(&ramp([8, 2]), [8, 6], Background::Colour([0.25; 3]));
        assert_eq!(fitted.at(3, 1), [0.25, 0.25, 0.25, 0.0]);
        assert_eq!(fitted.at(3, 2)[..2], [3.5, 0.5]);
    }

    #[test]
    fn what_a_photograph_covers_is_what_is_opaque() {
        for (of, size) in [
            ([8, 2], [8, 6]),
            ([8, 8], [4, 2]),
            ([30, 20], [45, 44]),
            ([1, 1], [31, 44]),
            ([3, 2], [700, 500]),
            ([9, 3], [9, 3]),
        ] {
            let fitted = fitted(&ramp(of), size, Background::BLACK);
            let [_, top, _, bottom] = covered(of, size).unwrap_or([0, 0, size[0], size[1]]);
            let opaque = |y: &u32| fitted.at(0, *y)[3] > 0.0;
            assert_eq!((0..size[1]).filter(opaque).collect::<Vec<_>>(), (top..bottom).collect::<Vec<_>>(), "{of:?}");
        }
    }

    #[test]
    fn a_choice_drops_the_picture_that_is_awaited() {
        let mut comparison = Comparison { is_loading: true, last_request: 7, ..Comparison::default() };
        comparison.choose(CompareTarget::Nothing);
        assert!(!comparison.is_loading && comparison.last_request != 7);
    }

    #[test]
    fn a_comparison_with_nothing_shows_the_picture() {
        let mut comparison = Comparison { is_flicked: true, ..Comparison::default() };
        assert_eq!(comparison.shown(100, 0.0), Compare::First);
        comparison.target = CompareTarget::Reference;
        assert_eq!(comparison.shown(100, 0.0), Compare::Second);
        comparison.is_flicked = false;
        assert_eq!(comparison.shown(100, 0.0), Compare::Split(50.0));
        comparison.mode = CompareMode::Flicker;
        assert_eq!(comparison.shown(100, 0.3), Compare::First);
        comparison.flicker_hz = 2.0;
        assert_eq!(comparison.shown(100, 0.3), Compare::Second);
    }
}
