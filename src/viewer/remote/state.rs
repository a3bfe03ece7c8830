//! What a client shows of a viewer.

use std::sync::LazyLock;

use glam::DVec3;

use super::drive::{ACTS, HELD};
use super::messages::{
    ActionEntry, CompareBy, ComparisonEntry, ExplanationEntry, KnobEntry, KnobKind, LabelEntry, LookEntry,
    MeasureEntry, MessageEntry, Rest, SceneEntry, ServerMessage, SplatEntry, State, Welcome,
};
use crate::gpu::Device;
use crate::options::{KNOBS, Kind, Options};
use crate::pixels::has_ffmpeg;
use crate::render::false_colour;
#[cfg(feature = "serve")]
use crate::render::{Inspection, Quantity};
use crate::viewer::actions::Program;
use crate::viewer::frame::Session;
use crate::viewer::model::{
    ACTIONS, Bindings, CompareMode, CompareTarget, ExplainedPixel, Measure, Numbers, VIEW_MODES, Viewer, line_pieces,
    preset_name,
};

/// Splats of an explained pixel that are listed.
const MAX_SPLATS: usize = 100;

/// Number of false colours that are listed.
const COLOURS: usize = 32;

/// Films can be written: it takes a process to know.
static HAS_FILMS: LazyLock<bool> = LazyLock::new(has_ffmpeg);

/// What does not change while a connection lasts.
pub fn welcome(device: &Device, bindings: &Bindings, has_folder: bool) -> ServerMessage {
    let owned = |names: Vec<&str>| names.into_iter().map(str::to_owned).collect::<Vec<_>>();
    let knobs = KNOBS.iter().map(|knob| KnobEntry {
        name: knob.name.to_owned(),
        help: knob.help.to_owned(),
        is_of_levels: knob.is_of_levels(),
        kind: match knob.kind {
            Kind::Number { .. } => KnobKind::Number,
            Kind::Count(_) => KnobKind::Count,
            Kind::Name(names) => KnobKind::Name { names: owned(names()) },
            Kind::Flag => KnobKind::Flag,
        },
    });
    let looks = VIEW_MODES.iter().map(|mode| LookEntry {
        name: mode.name.to_owned(),
        title: mode.title.to_owned(),
        unit: mode.unit.to_owned(),
        has_scale: matches!(mode.numbers, Numbers::Counts | Numbers::Mean(_)),
    });
    let actions = ACTIONS.iter().filter(|(action, ..)| ACTS.contains(action) || HELD.contains(action));
    let actions = actions.map(|(action, name, _, help)| ActionEntry {
        name: (*name).to_owned(),
        key: bindings.text(*action),
        help: (*help).to_owned(),
        is_held: HELD.contains(action),
    });
    let colour = |i: usize| {
        let [red, green, blue] = false_colour(i as f64 / (COLOURS - 1) as f64);
        format!("#{red:02x}{green:02x}{blue:02x}")
    };
    ServerMessage::Welcome(Box::new(Welcome {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        device: device.capabilities().name.clone(),
        has_folder,
        has_films: *HAS_FILMS,
        presets: owned(Options::PRESETS.iter().map(|(name, _)| *name).collect()),
        knobs: knobs.collect(),
        looks: looks.collect(),
        actions: actions.collect(),
        colours: (0..COLOURS).map(colour).collect(),
    }))
}

/// What a client shows beside the picture.
pub fn state(session: &mut Session) -> State {
    let is_at_rest = session.is_at_rest() && !session.viewer.is_moving();
    let (title, residency) = (session.title(), session.residency());
    let levels = session.level_psnr();
    session.viewer.timing.frame_times.summarize();
    let messages = session.viewer.messages.shown().iter();
    let messages = messages.map(|message| MessageEntry { is_error: message.is_error, text: message.text.clone() });
    let messages = messages.collect();
    let (viewer, pair) = (&session.viewer, &session.pair);
    let digest = viewer.timing.frame_times.digest();
    let gpu_ms = digest.map(|digest| digest.whole.median);
    let stages = digest.iter().flat_map(|digest| &digest.stages);
    let stages = stages.map(|(name, times)| ((*name).to_owned(), times.median)).collect();
    let settings = &viewer.inspector.settings;
    let scenes = viewer.scenes.layers.iter().map(|layer| SceneEntry {
        name: layer.name.clone(),
        summary: layer.summary.clone(),
        is_shown: layer.is_shown[0],
        placement: layer.placement,
        progress: layer.progress,
    });
    let rest = || {
        let view = serde_json::from_str(&crate::camera::to_json(&viewer.view.camera())).ok()?;
        let (command, left_out) = viewer.command_line(Program::Render);
        Some(Rest { view, command, left_out })
    };
    State {
        title,
        scenes: scenes.collect(),
        camera: viewer.view.camera_index,
        cameras: viewer.cameras.list.len(),
        preset: preset_name(|preset| viewer.preset(preset) == viewer.options).map(str::to_owned),
        knobs: KNOBS.iter().map(|knob| (knob.get)(&viewer.options).to_string()).collect(),
        choosing: viewer.measuring.choosing(),
        chosen: viewer.measuring.budget.chosen.clone(),
        has_photographs: viewer.cameras.have_photographs(),
        look: settings.view_mode().name.to_owned(),
        range: settings.ranges[settings.mode],
        comparison: comparison(session),
        explanation: viewer.inspector.explanation.as_ref().map(|explained| explanation(session, explained)),
        measures_next: viewer.ruler.kind,
        measures: measures(viewer, is_at_rest),
        unit: viewer.measures.unit.clone(),
        time: viewer.film.now,
        is_playing: viewer.film.is_playing,
        writing: viewer.export.progress,
        path: pair.first.as_ref().map(|first| first.path.to_string()),
        visible: pair.first.as_ref().map_or(0, |first| first.frame.totals.visible),
        gpu_ms,
        stages,
        clocks: viewer.timing.clocks,
        has_levels: viewer.scenes.have_levels(),
        levels,
        missing_pages: residency.map_or(0, |pages| pages.missing),
        messages,
        nothing: viewer.why_nothing_is_seen(pair),
        rest: is_at_rest.then(rest).flatten(),
    }
}

/// True if the picture at rest is the one that the copied command line writes: nothing is left out of that, no page is
/// missing, and the picture has plain colours.
#[cfg(feature = "serve")]
pub fn is_of_render(session: &Session) -> bool {
    let viewer = &session.viewer;
    let settings = &viewer.inspector.settings;
    settings.inspection() == Inspection::default()
        && settings.quantity() == Quantity::Colour
        && viewer.comparison.target == CompareTarget::Nothing
        && session.residency().is_none_or(|pages| pages.missing == 0)
        && session
            .pair
            .first
            .as_ref()
            .and_then(|first| first.sharing.as_ref())
            .is_none_or(|sharing| sharing.is_of_one_kind())
        && viewer.command_line(Program::Render).1.is_empty()
}

/// All measures, with their places in a picture at rest.
fn measures(viewer: &Viewer, is_at_rest: bool) -> Vec<MeasureEntry> {
    let view = viewer.drawn_view();
    let pixel_of = |point: DVec3| {
        let pixel = view.projected(point).map(|(pixel, _)| pixel).filter(|pixel| pixel.is_finite());
        pixel.map(|pixel| pixel.to_array())
    };
    let entry = |(i, measure): (usize, &Measure)| {
        let entry = MeasureEntry {
            kind: measure.kind,
            points: measure.points.clone(),
            reading: viewer.measures.reading(measure),
            is_open: viewer.ruler.open == Some(i),
            pixels: Vec::new(),
            lines: Vec::new(),
            labels: Vec::new(),
        };
        if !is_at_rest {
            return entry;
        }
        let lines = measure.lines().into_iter().flat_map(|line| line_pieces(&view, line));
        let lines = lines.filter(|ends| ends.iter().all(|end| end.is_finite()));
        let labels = viewer.measures.labels(measure).into_iter();
        MeasureEntry {
            pixels: measure.points().map(pixel_of).collect(),
            lines: lines.map(|ends| ends.map(<[f64; 2]>::from)).collect(),
            labels: labels.filter_map(|(at, text)| Some(LabelEntry { pixel: pixel_of(at)?, text })).collect(),
            ..entry
        }
    };
    viewer.measures.all.iter().enumerate().map(entry).collect()
}

fn comparison(session: &Session) -> Option<ComparisonEntry> {
    let (viewer, pair) = (&session.viewer, &session.pair);
    let comparison = &viewer.comparison;
    if comparison.target == CompareTarget::Nothing && !comparison.is_loading {
        return None;
    }
    // The numbers of another view are not shown.
    let now = viewer.inspector.snapshot.as_ref().map(|snapshot| snapshot.number);
    let known = comparison.pair_difference.as_ref().filter(|known| Some(known.number) == now);
    Some(ComparisonEntry {
        first: viewer.first_name(pair),
        second: viewer.second_name(pair),
        mode: match comparison.mode {
            CompareMode::Split => CompareBy::Split,
            CompareMode::Flicker => CompareBy::Flicker,
            CompareMode::Difference => CompareBy::Difference,
        },
        split: comparison.split,
        gain: comparison.gain,
        is_loading: comparison.is_loading,
        psnr: known.and_then(|known| known.difference.psnr_db),
        flip: known.map(|known| known.difference.flip),
        mismatch: viewer.mismatch(pair).map(str::to_owned),
    })
}

fn explanation(session: &Session, explained: &ExplainedPixel) -> ExplanationEntry {
    let ExplainedPixel { pixel, view, explanation, .. } = explained;
    let splats = explanation.splats.iter().take(MAX_SPLATS).map(|splat| SplatEntry {
        gaussian: splat.gaussian,
        depth: splat.depth,
        alpha: splat.alpha,
        share: splat.share,
        colour: splat.colour,
    });
    ExplanationEntry {
        pixel: *pixel,
        is_of_view: *view == session.viewer.view.camera(),
        colour: explanation.colour(session.viewer.view.background),
        depth: explanation.depth(),
        splats: explanation.splats.len(),
        first: splats.collect(),
        transmittance: explanation.transmittance,
    }
}
