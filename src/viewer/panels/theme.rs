//! Colours of the panels: text that is read on both themes, and one colour for each stage of a frame.

use egui::{Color32, Context, FontDefinitions, Theme};

/// The grey of hints: at least 4.5 times as light as its ground, or as dark (contrast of WCAG 2.2).
const HINTS: [(Theme, u8); 2] = [(Theme::Dark, 136), (Theme::Light, 106)];

/// The colour of marks, of strokes and of the current time over the picture, and that of camera paths.
pub(super) const MARK: Color32 = Color32::from_rgb(255, 200, 60);
pub(super) const PATH: Color32 = Color32::from_rgb(120, 200, 255);

/// Makes hints as legible as WCAG asks for, and adds the font of icons.
pub(crate) fn set(context: &Context) {
    let mut fonts = FontDefinitions::default();
    egui_phosphor::add_to_fonts(&mut fonts, egui_phosphor::Variant::Regular);
    context.set_fonts(fonts);
    for (theme, grey) in HINTS {
        context.style_mut_of(theme, |style| style.visuals.weak_text_color = Some(Color32::from_gray(grey)));
    }
}

/// The colours of stages; others are grey. Stages of one colour belong to different paths. All have three times the
/// contrast to both themes.
const STAGES: [(&[&str], [u8; 3]); 12] = [
    (&["cull"], [147, 95, 100]),
    (&["project"], [0, 143, 240]),
    (&["list", "duplicate"], [0, 163, 0]),
    (&["offsets", "ranges"], [18, 121, 121]),
    (&["sort", "sort tiles"], [179, 0, 255]),
    (&["sort depths"], [79, 103, 198]),
    (&["scan", "other devices"], [255, 0, 128]),
    (&["merge", "join"], [232, 92, 134]),
    (&["masks", "inspect", "shade attribute"], [137, 150, 22]),
    (&["blend"], [223, 71, 33]),
    (&["display"], [167, 126, 195]),
    (&["panels"], [110, 130, 150]),
];

/// The colour of a stage.
pub(super) fn stage_colour(stage: &str) -> Color32 {
    let known = STAGES.iter().find(|(names, _)| names.contains(&stage));
    known.map_or(Color32::GRAY, |(_, [r, g, b])| Color32::from_rgb(*r, *g, *b))
}

#[cfg(test)]
mod tests {
    use egui::Visuals;

    use super::*;

    /// The relative luminance of WCAG 2.2.
    fn luminance(colour: Color32) -> f64 {
        let linear = |value: u8| {
            let value = f64::from(value) / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        let [r, g, b] = [colour.r(), colour.g(), colour.b()].map(linear);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }

    fn contrast(a: Color32, b: Color32) -> f64 {
        let [a, b] = [luminance(a), luminance(b)];
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn hints_and_stages_are_told_from_their_ground() {
        let context = Context::default();
        set(&context);
        for theme in [Theme::Dark, Theme::Light] {
            let visuals = context.style_of(theme).visuals.clone();
            for ground in [visuals.panel_fill, visuals.window_fill, visuals.extreme_bg_color] {
                let hint = contrast(visuals.weak_text_color(), ground);
                assert!(hint >= 4.5, "{theme:?}: hints have {hint:.2}");
                for (names, _) in STAGES {
                    let stage = contrast(stage_colour(names[0]), ground);
                    assert!(stage >= 3.0, "{theme:?}: {names:?} has {stage:.2}");
                }
            }
            let usual = match theme {
                Theme::Dark => Visuals::dark(),
                Theme::Light => Visuals::light(),
            };
            let hint = usual.panel_fill.blend(usual.weak_text_color());
            assert!(contrast(hint, usual.panel_fill) < 4.5, "without this hints are too faint");
        }
    }

    #[test]
    fn stages_have_colours_of_their_own() {
        for (i, (a, [ar, ag, ab])) in STAGES.iter().enumerate() {
            for (b, [br, bg, bb]) in &STAGES[..i] {
                let apart = ar.abs_diff(*br).max(ag.abs_diff(*bg)).max(ab.abs_diff(*bb));
                assert!(apart >= 40, "{a:?} and {b:?}");
            }
        }
    }
}
