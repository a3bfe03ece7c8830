//! The command line that draws the picture of the window.

use std::path::Path;

use crate::camera::LensChoice;
use crate::formats::Reading;
use crate::options::{Group, KNOBS, Knob, Options};
use crate::rules::Background;
use crate::viewer::model::{
    CompareMode, CompareTarget, Comparison, Edit, Event, Layer, LayerSource, PictureOf, Placement, Request, Viewer,
    WindowRequest, preset_name,
};

/// A command that can draw the picture of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    Render,
    Bench,
    View,
}

impl Program {
    pub const ALL: [(Self, &str); 3] = [(Self::Render, "render"), (Self::Bench, "bench"), (Self::View, "view")];
}

impl Viewer {
    /// The command line for the scenes, the view and the options. The second value lists settings without an option.
    pub fn command_line(&self, program: Program) -> (String, Vec<String>) {
        let mut left_out = Vec::new();
        let (_, name) = Program::ALL.iter().find(|(known, _)| *known == program).expect("every program is listed");
        let mut words = vec!["smalto".to_owned(), (*name).to_owned()];
        let shown: Vec<&Layer> = self.scenes.shown().collect();
        let most = if program == Program::View { shown.len() } else { 1 };
        words.extend(shown.iter().take(most).map(|layer| layer.source.argument()));
        if shown.len() > most {
            left_out.push(format!("all scenes but the first of {}", shown.len()));
        }
        let readings: Vec<_> = shown.iter().take(most).map(|layer| layer.reading).collect();
        if readings.iter().all(|reading| *reading == self.setup.reading) {
            words.extend(self.setup.reading_options.iter().cloned());
        } else if readings.iter().any(|reading| *reading != Reading::default()) {
            left_out.push("the axes of scenes".to_owned());
        }
        match shown.first().and_then(|layer| layer.places.as_ref()) {
            Some((file, _)) => words.extend(["--place".to_owned(), file.display().to_string()]),
            None if shown.iter().any(|layer| layer.places.is_some()) => left_out.push("lists of places".to_owned()),
            None => {}
        }
        if shown.iter().any(|layer| layer.placement != Placement::default()) {
            left_out.push("the placement of scenes".to_owned());
        }
        let is_part = shown.iter().any(|layer| layer.part.is_some());
        if is_part || shown.iter().filter_map(|layer| layer.edit.as_deref()).any(Edit::leaves_out) {
            left_out.push("what is hidden or deleted".to_owned());
        }
        if shown.iter().any(|layer| !layer.appearance.is_default()) {
            left_out.push("the colours and opacities that were changed".to_owned());
        }
        words.extend(self.option_words());
        words.extend(self.camera_words(program, &mut left_out));
        if program == Program::View {
            words.extend(self.view_words(&mut left_out));
        }
        let [width, height] = if program == Program::View { self.view.window_size } else { self.view.size };
        words.extend(["--size".to_owned(), format!("{width}x{height}")]);
        match self.view.background {
            Background::Colour([r, g, b]) if [r, g, b] != [0.0; 3] && program != Program::Bench => {
                words.extend(["--background".to_owned(), format!("{r},{g},{b}")]);
            }
            Background::Colour(colour) if colour != [0.0; 3] => left_out.push("the background".to_owned()),
            _ => {}
        }
        if program == Program::Render {
            words.extend(["-o".to_owned(), "view.png".to_owned()]);
        }
        let line = shlex::try_join(words.iter().map(String::as_str)).unwrap_or_else(|_| words.join(" "));
        (line, left_out)
    }

    /// The preset nearest to the options, and the knobs that differ from it.
    fn option_words(&self) -> Vec<String> {
        // Antialiasing and the near plane depend on the scene unless they are given, so they are always given.
        let is_explicit = |name: &str| ["near", "antialiased"].contains(&name);
        let has_levels = self.scenes.have_levels();
        let is_optional =
            |knob: &&Knob| knob.group != Group::Path && !is_explicit(knob.name) && (has_levels || !knob.is_of_levels());
        let differing = |preset: &Options| {
            let differs = |knob: &&Knob| (knob.get)(preset) != (knob.get)(&self.options);
            KNOBS.iter().filter(is_optional).filter(differs).collect::<Vec<_>>()
        };
        let (preset, knobs) = Options::PRESETS
            .iter()
            .filter(|(_, preset)| preset.portable == self.options.portable)
            .map(|(name, preset)| (*name, differing(preset)))
            .min_by_key(|(_, knobs)| knobs.len())
            .expect("there are presets of both paths");
        let mut words = vec!["--preset".to_owned(), preset.to_owned()];
        for knob in KNOBS.iter().filter(|knob| is_explicit(knob.name)).chain(knobs) {
            words.extend([format!("--{}", knob.name), (knob.get)(&self.options).to_string()]);
        }
        words
    }

    /// The camera of the file that the view is at, or else the view as eye, target and up direction.
    fn camera_words(&self, program: Program, left_out: &mut Vec<String>) -> Vec<String> {
        let file = self.cameras.file.as_ref().map(|file| ["--cameras".to_owned(), file.display().to_string()]);
        if let (Some(index), Some(file)) = (self.view.camera_index, &file) {
            let camera = file.iter().cloned().chain(["--camera".to_owned(), index.to_string()]);
            return camera.chain(self.lens_words()).collect();
        }
        // The window has the cameras of the file beside the view.
        let file = file.filter(|_| program == Program::View);
        let view = self.view.camera();
        let centre = view.centre_px - glam::DVec2::from(view.size_px.map(|side| f64::from(side) / 2.0));
        if !view.is_sphere() && (centre.abs().max_element() > 1e-6 || view.focal_px.x != view.focal_px.y) {
            left_out.push("the principal point or the shape of the pixels".to_owned());
        }
        let point = |v: glam::DVec3| format!("{},{},{}", v.x, v.y, v.z);
        // At the distance of the pivot, so that the digits of the target determine the direction.
        let target = view.position + view.forward() * view.position.distance(self.view.navigator.pivot()).max(1e-6);
        let up = -view.rotation.row(1);
        let fov = self.view.navigator.field_of_view();
        let lens = view.lens.iter().flat_map(|lens| ["--lens".to_owned(), lens.text()]);
        file.into_iter()
            .flatten()
            .chain(["--eye".to_owned(), point(view.position), "--target".to_owned(), point(target)])
            .chain(["--camera-up".to_owned(), point(up), "--fov".to_owned(), fov.to_string()])
            .chain(lens)
            .collect()
    }

    /// The lenses of all cameras.
    fn lens_words(&self) -> Vec<String> {
        match &self.setup.lenses {
            LensChoice::Own => Vec::new(),
            LensChoice::All(lens) => {
                let text = lens.as_ref().map_or("PINHOLE".to_owned(), |lens| lens.text());
                vec!["--lens".to_owned(), text]
            }
            LensChoice::Undistorted => vec!["--undistort".to_owned()],
        }
    }

    /// Options of `smalto view` for photographs, view mode, comparison and panels.
    fn view_words(&self, left_out: &mut Vec<String>) -> Vec<String> {
        let mut words = Vec::new();
        let mut add = |flag: &str, value: &str| words.extend([flag.to_owned(), value.to_owned()]);
        if let Some(photographs) = &self.cameras.photographs {
            add("--photographs", &photographs.folder.display().to_string());
        }
        if self.inspector.settings.mode != 0 {
            add("--look", self.inspector.settings.view_mode().name);
        }
        if let Some(rate) = &self.timing.rate {
            add("--target-fps", &rate.fps.to_string());
        }
        let Comparison { target, mode, split, gain, flicker_hz, picture, .. } = &self.comparison;
        let with = match target {
            CompareTarget::Nothing | CompareTarget::Options(None) => None,
            CompareTarget::Options(Some(options)) => preset_name(|preset| preset == options).map(str::to_owned),
            CompareTarget::Reference => Some("reference".to_owned()),
            CompareTarget::Picture => picture
                .as_ref()
                .and_then(|picture| match &picture.of {
                    PictureOf::File(file) => Some(file.clone()),
                    PictureOf::Camera(camera) => self.cameras.photograph_of(*camera),
                    PictureOf::Content(_) => None,
                })
                .map(|file| absolute(&file)),
        };
        match with {
            Some(with) => {
                add("--compare", &with);
                let (name, setting, is_usual) = match mode {
                    CompareMode::Split => ("split", "the place of the split", *split == 0.5),
                    CompareMode::Flicker => ("flicker", "the rate of the flicker", *flicker_hz == 0.0),
                    CompareMode::Difference => ("difference", "the amplification", *gain == 10.0),
                };
                add("--compare-by", name);
                if !is_usual {
                    left_out.push(setting.to_owned());
                }
            }
            None if *target != CompareTarget::Nothing => left_out.push("the comparison".to_owned()),
            None => {}
        }
        if self.panels.are_hidden {
            words.push("--no-panels".to_owned());
        }
        words
    }

    /// Copies the command line, and reports the settings that it leaves out.
    pub fn copy_command(&mut self, program: Program) {
        if self.scenes.layers.is_empty() {
            return self.messages.note("there is no scene that a command could draw");
        }
        let (line, left_out) = self.command_line(program);
        self.events.emit(&Event::CopiedCommand { command: line.clone() });
        self.requests.push(Request::Window(WindowRequest::Copy(line)));
        let not = if left_out.is_empty() { String::new() } else { format!(", without {}", left_out.join(" and ")) };
        self.messages.note(format!("the command line is copied{not}"));
    }
}

/// The absolute path as text.
fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

impl LayerSource {
    /// The scene as an argument of a command.
    pub fn argument(&self) -> String {
        match self {
            Self::File(path) => absolute(path),
            Self::Procedural(procedural) => procedural.argument(),
        }
    }
}
