//! View modes: values shown in place of colours, and the scales of false colours.

use super::plan::{Drawn, Side};
use crate::camera::Camera;
use crate::render::{Attribute, Inspection, Look, Quantity, Scale, Work};

/// A view mode, as the command line and the panel list it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewMode {
    pub name: &'static str,
    /// The name in the window.
    pub title: &'static str,
    /// The meaning of the numbers; empty without numbers.
    pub unit: &'static str,
    pub look: Look,
    pub numbers: Numbers,
}

/// The numbers in a pixel of a view mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Numbers {
    /// A colour, no number.
    None,
    /// Counts, on a logarithmic scale.
    Counts,
    /// Means over the splats of a pixel: world units, logarithms to base 2, or fractions. Holds the default ends of the
    /// scale, low and high.
    Mean([f32; 2]),
    Coverage,
    Transmittance,
}

/// All view modes.
pub const VIEW_MODES: [ViewMode; 18] = [
    ViewMode {
        name: "colour",
        title: "Colour",
        unit: "colour values from 0 to 1",
        look: Look::Colour,
        numbers: Numbers::None,
    },
    ViewMode {
        name: "tile-load",
        title: "Tile load",
        unit: "splats listed for the tile",
        look: Look::Work(Work::TileLoad),
        numbers: Numbers::Counts,
    },
    ViewMode {
        name: "evaluations",
        title: "Evaluations",
        unit: "splats evaluated",
        look: Look::Work(Work::Evaluations),
        numbers: Numbers::Counts,
    },
    ViewMode {
        name: "contributions",
        title: "Contributions",
        unit: "splats blended",
        look: Look::Work(Work::Contributions),
        numbers: Numbers::Counts,
    },
    ViewMode {
        name: "transmittance-left",
        title: "Transmittance left",
        unit: "fraction of light from behind",
        look: Look::Colour,
        numbers: Numbers::Transmittance,
    },
    ViewMode {
        name: "alpha",
        title: "Alpha",
        unit: "coverage, 0 to 1",
        look: Look::Colour,
        numbers: Numbers::Coverage,
    },
    ViewMode {
        name: "depth",
        title: "Depth",
        unit: "world units along the view",
        look: Look::Attribute(Attribute::Depth),
        numbers: Numbers::Mean([0.0, 10.0]),
    },
    ViewMode {
        name: "normals",
        title: "Normals",
        unit: "",
        look: Look::Attribute(Attribute::Normal),
        numbers: Numbers::None,
    },
    ViewMode {
        name: "splat-centres",
        title: "Splat centres",
        unit: "",
        look: Look::Work(Work::Centres),
        numbers: Numbers::None,
    },
    ViewMode {
        name: "ellipse-outlines",
        title: "Ellipse outlines",
        unit: "",
        look: Look::Work(Work::Outlines),
        numbers: Numbers::None,
    },
    ViewMode {
        name: "opacity",
        title: "Opacity",
        unit: "0 to 1",
        look: Look::Attribute(Attribute::Opacity),
        numbers: Numbers::Mean([0.0, 1.0]),
    },
    ViewMode {
        name: "size-log2",
        title: "Size",
        unit: "log2 of world units",
        look: Look::Attribute(Attribute::Size),
        numbers: Numbers::Mean([-12.0, 0.0]),
    },
    ViewMode {
        name: "anisotropy-log2",
        title: "Anisotropy",
        unit: "log2 of the longest to the shortest axis",
        look: Look::Attribute(Attribute::Anisotropy),
        numbers: Numbers::Mean([0.0, 8.0]),
    },
    ViewMode {
        name: "base-colour",
        title: "Base colour",
        unit: "",
        look: Look::Attribute(Attribute::BaseColour),
        numbers: Numbers::None,
    },
    ViewMode {
        name: "identity",
        title: "Identity",
        unit: "",
        look: Look::Attribute(Attribute::Identity),
        numbers: Numbers::None,
    },
    ViewMode {
        name: "level",
        title: "Level",
        unit: "halvings of the scene",
        look: Look::Attribute(Attribute::Level),
        numbers: Numbers::Mean([0.0, 12.0]),
    },
    ViewMode {
        name: "predicted-error-log2",
        title: "Predicted error",
        unit: "log2 of steps of 1/255",
        look: Look::Attribute(Attribute::PredictedError),
        numbers: Numbers::Mean([-4.0, 6.0]),
    },
    ViewMode {
        name: "missing-levels",
        title: "Missing levels",
        unit: "halvings coarser than asked for",
        look: Look::Attribute(Attribute::Lag),
        numbers: Numbers::Mean([0.0, 6.0]),
    },
];

impl ViewMode {
    /// True if the mode applies to paged scenes with levels of detail, or else to scenes that are in memory as a whole.
    pub fn suits(&self, is_paged: bool) -> bool {
        match self.look {
            Look::Attribute(Attribute::Level | Attribute::PredictedError | Attribute::Lag) => is_paged,
            Look::Colour | Look::Attribute(_) => true,
            Look::Work(_) => !is_paged,
        }
    }
}

/// The names of all view modes, in order.
pub fn view_mode_names() -> impl Iterator<Item = &'static str> {
    VIEW_MODES.iter().map(|mode| mode.name)
}

/// The index of the view mode with this name.
pub fn view_mode(name: &str) -> Option<usize> {
    view_mode_names().position(|known| known == name)
}

/// The view mode, its scale, and other settings of the inspection.
#[derive(Clone)]
pub struct InspectionSettings {
    /// Index into [`VIEW_MODES`].
    pub mode: usize,
    /// Low and high end of the scale, by view mode.
    pub ranges: [[f32; 2]; VIEW_MODES.len()],
    /// The camera at which culling is frozen.
    pub culled_from: Option<Camera>,
    /// Index of the only Gaussian that is drawn.
    pub isolated: Option<u32>,
}

impl Default for InspectionSettings {
    fn default() -> Self {
        let range = |mode: &ViewMode| match mode.numbers {
            Numbers::Counts => [1.0, 10_000.0],
            Numbers::Mean(range) => range,
            _ => [0.0, 1.0],
        };
        Self { mode: 0, ranges: std::array::from_fn(|i| range(&VIEW_MODES[i])), culled_from: None, isolated: None }
    }
}

impl InspectionSettings {
    pub fn view_mode(&self) -> &'static ViewMode {
        &VIEW_MODES[self.mode]
    }

    /// True if both are equal except for the ends of scales.
    pub fn is_same(&self, other: &Self) -> bool {
        let Self { mode, culled_from, isolated, .. } = self;
        (*mode, culled_from, *isolated) == (other.mode, &other.culled_from, other.isolated)
    }

    /// Goes to the next view mode that suits the scenes, or to the previous one.
    pub fn step(&mut self, forward: bool, is_paged: bool) {
        let modes = VIEW_MODES.len();
        let after = |i: usize| (self.mode + if forward { i } else { modes - i }) % modes;
        self.mode = (1..=modes).map(after).find(|mode| VIEW_MODES[*mode].suits(is_paged)).unwrap_or(0);
    }

    /// Sets the range of depths for a scene of this radius, in world units.
    pub fn set_scene_radius(&mut self, radius: f64) {
        for (mode, range) in VIEW_MODES.iter().zip(&mut self.ranges) {
            if mode.look == Look::Attribute(Attribute::Depth) {
                *range = [0.0, 4.0 * radius as f32];
            }
        }
    }

    pub fn inspection(&self) -> Inspection {
        let Self { culled_from, isolated, .. } = self;
        Inspection { look: self.view_mode().look, culled_from: culled_from.clone(), isolated: *isolated }
    }

    /// The quantity that each pixel shows.
    pub fn quantity(&self) -> Quantity {
        let [low, high] = self.ranges[self.mode];
        match self.view_mode().numbers {
            Numbers::None => Quantity::Colour,
            Numbers::Counts => Quantity::Number(Scale { low: low.max(1e-3), high, is_logarithmic: true }),
            Numbers::Mean(_) => Quantity::Mean(Scale { low, high, is_logarithmic: false }),
            Numbers::Coverage => Quantity::Coverage,
            Numbers::Transmittance => Quantity::Transmittance,
        }
    }

    /// Sets the inspection of a picture; returns true if it changed. An isolated Gaussian belongs to the first picture,
    /// so the second ignores it.
    pub fn apply(&self, side: Side, drawn: &mut Drawn) -> anyhow::Result<bool> {
        let mut inspection = self.inspection();
        let exists = |index: u32| side == Side::First && (index as usize) < drawn.statistics.count;
        inspection.isolated = inspection.isolated.filter(|index| exists(*index));
        if drawn.inspection == inspection {
            return Ok(false);
        }
        drawn.renderer.set_inspection(inspection.clone())?;
        drawn.inspection = inspection;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_go_through_all_modes_that_suit_the_scenes() {
        for (is_paged, modes, left_out) in [(false, 15, "level"), (true, 13, "evaluations")] {
            for forward in [true, false] {
                let (mut settings, mut seen) = (InspectionSettings::default(), Vec::new());
                loop {
                    seen.push(settings.view_mode().name);
                    settings.step(forward, is_paged);
                    if settings.mode == 0 {
                        break;
                    }
                }
                assert!(seen.len() == modes && !seen.contains(&left_out), "{seen:?}");
            }
        }
    }
}
