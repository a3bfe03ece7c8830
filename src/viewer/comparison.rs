//! What the picture is held against, and how the two are shown.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::jobs::{News, Side};
use super::state::Viewer;
use crate::camera::Camera;
use crate::options::Options;
use crate::rules::{Background, Rules};
use crate::pixels::Pixels;
use crate::render::Compare;

/// What the second picture is.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum With {
    #[default]
    Nothing,
    /// The scenes that are chosen for it, by these options; none for those of the first.
    Options(Option<Options>),
    /// The float64 reference, of the view for which it was drawn.
    Reference,
    /// A photograph or a picture.
    Picture,
}

/// How two pictures are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Way {
    /// Side by side, at a line that can be dragged.
    Split,
    /// One after the other.
    Flicker,
    /// What is between them, amplified.
    Difference,
}

/// A comparison as one sets it.
pub struct Comparison {
    pub with: With,
    pub way: Way,
    /// The part of the width that is left of the split.
    pub split: f32,
    /// On differences.
    pub gain: f32,
    /// The split is in the hand.
    pub is_held: bool,
    /// The second picture is shown while this is held.
    pub is_flicked: bool,
    /// Flickers by itself, this often a second.
    pub flicker_hz: f32,
    /// What a picture from elsewhere is called, and its pixels.
    pub picture: Option<(String, Arc<Pixels>)>,
    /// The view for which it was drawn, if it is of the reference.
    pub drawn_for: Option<Camera>,
    pub is_drawing: bool,
    /// The picture has to be brought to the window's size.
    pub is_stale: bool,
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            with: With::Nothing,
            way: Way::Split,
            split: 0.5,
            gain: 10.0,
            is_held: false,
            is_flicked: false,
            flicker_hz: 0.0,
            picture: None,
            drawn_for: None,
            is_drawing: false,
            is_stale: false,
        }
    }
}

impl Comparison {
    /// What the second side draws by, if it draws.
    pub fn options(&self, first: &Options) -> Option<Options> {
        match &self.with {
            With::Options(None) => Some(*first),
            With::Options(Some(options)) => {
                // What a preset does not say: how near, and how the scene was trained.
                let near = options.rules.near.min(first.rules.near);
                let rules = Rules { near, antialiased: first.rules.antialiased, ..options.rules };
                Some(Options { rules, ..*options })
            }
            _ => None,
        }
    }

    /// What is shown of two pictures `width` pixels wide, `seconds` after the start.
    pub fn shown(&self, width: u32, seconds: f64) -> Compare {
        let is_second_half = self.flicker_hz > 0.0 && (seconds * f64::from(self.flicker_hz)).fract() >= 0.5;
        match self.way {
            _ if self.with == With::Nothing => Compare::First,
            _ if self.is_flicked => Compare::Second,
            Way::Split => Compare::Split(self.split * width as f32),
            Way::Flicker => {
                if is_second_half {
                    Compare::Second
                } else {
                    Compare::First
                }
            }
            Way::Difference => Compare::Difference(self.gain),
        }
    }

    /// The time until the other picture is to be shown.
    pub fn until_flicker(&self, seconds: f64) -> Duration {
        if self.with == With::Nothing || self.way != Way::Flicker || self.flicker_hz <= 0.0 {
            return Duration::MAX;
        }
        let halves = seconds * f64::from(self.flicker_hz) * 2.0;
        Duration::from_secs_f64((1.0 - halves.fract()) / (f64::from(self.flicker_hz) * 2.0) + 1e-3)
    }
}

impl Viewer {
    /// Whether the reference was drawn for another view than this one, and is no use here.
    pub fn shows_another_view(&self) -> bool {
        let comparison = &self.comparison;
        comparison.with == With::Reference && comparison.drawn_for.as_ref() != Some(&self.view())
    }

    /// Reads a photograph or another picture, to compare with.
    pub fn compare_with_picture(&mut self, path: &Path) {
        let path = path.to_owned();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.comparison.is_drawing = true;
        self.comparison.drawn_for = None;
        self.jobs.start(move |_| Pixels::read(&path), move |pixels| News::Picture(name, pixels));
    }

    /// Draws the view by the reference, to compare with.
    pub fn compare_with_reference(&mut self) {
        let (view, rules) = (self.view(), self.options.untraded().rules);
        let Ok(Some(plan)) = self.plan(Side::First) else { return };
        let background = self.background;
        self.comparison.is_drawing = true;
        self.comparison.drawn_for = Some(view.clone());
        self.jobs.start(
            move |_| {
                let scene = plan.joined()?;
                Ok(crate::reference::render(&scene, &view, &rules, background).to_pixels())
            },
            |pixels| News::Picture("float64 reference".to_owned(), pixels),
        );
    }
}

/// A picture as a window of `size` shows it when it looks through the camera that took it: as wide as the window, its
/// middle in the middle, black beyond it.
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
        let from_middle = |place: u32, side: u32| (f64::from(place) + 0.5 - f64::from(side) / 2.0) * ratio;
        let place = [from_middle(x, size[0]) + width / 2.0, from_middle(y, size[1]) + height / 2.0];
        let is_inside = place[0] >= 0.0 && place[1] >= 0.0 && place[0] < width && place[1] < height;
        if is_inside { sample(place[0] - 0.5, place[1] - 0.5) } else { [r, g, b, 0.0] }
    };
    let count = size[0] as usize * size[1] as usize;
    Pixels { size, rgba: (0..count).into_par_iter().map(pixel).collect() }
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
        // Twice as wide as the window, and higher: cut above and below.
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
    fn a_comparison_with_nothing_shows_the_picture() {
        let mut comparison = Comparison { is_flicked: true, ..Comparison::default() };
        assert_eq!(comparison.shown(100, 0.0), Compare::First);
        comparison.with = With::Reference;
        assert_eq!(comparison.shown(100, 0.0), Compare::Second);
        comparison.is_flicked = false;
        assert_eq!(comparison.shown(100, 0.0), Compare::Split(50.0));
        comparison.way = Way::Flicker;
        assert_eq!(comparison.shown(100, 0.3), Compare::First);
        comparison.flicker_hz = 2.0;
        assert_eq!(comparison.shown(100, 0.3), Compare::Second);
    }
}
