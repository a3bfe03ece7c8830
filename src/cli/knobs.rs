//! The knobs as flags. Names, values and help texts come from the table in `options`.

use clap::builder::{PossibleValuesParser, TypedValueParser, ValueParser};
use clap::{Arg, ArgMatches, Command};

use super::Usage;
use super::headings::{ACCURACY, LEVELS};
use crate::options::{Group, KNOBS, Kind, Knob, Options, Value};

/// The knobs that override a preset, with their values.
#[derive(Clone, Debug, Default)]
pub(super) struct Knobs(Vec<(&'static Knob, Value)>);

/// The knobs that are flags. The portable path is chosen by a preset, or by a flag of `render` without a value.
fn flags() -> impl Iterator<Item = &'static Knob> {
    KNOBS.iter().filter(|knob| knob.group != Group::Path)
}

impl clap::Args for Knobs {
    fn augment_args(command: Command) -> Command {
        command.args(flags().map(flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl clap::FromArgMatches for Knobs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self::given(flags(), matches))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The knobs that are rules of contributions, which are those to pictures of projections.
#[derive(Clone, Debug, Default)]
pub(super) struct RuleKnobs(pub Knobs);

fn rules() -> impl Iterator<Item = &'static Knob> {
    flags().filter(|knob| knob.group == Group::Rules && knob.name != "response")
}

impl clap::Args for RuleKnobs {
    fn augment_args(command: Command) -> Command {
        command.args(rules().map(flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl clap::FromArgMatches for RuleKnobs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self(Knobs::given(rules(), matches)))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Knobs that the short help leaves out.
const RARE: [&str; 10] = [
    "response",
    "order",
    "extent",
    "alpha-min",
    "key-bits",
    "sh-storage",
    "shape-storage",
    "lod-error",
    "lod-fade",
    "lod-occlusion",
];

fn flag(knob: &'static Knob) -> Arg {
    let parse = move |text: &str| knob.parse(text);
    let values: ValueParser = match knob.kind {
        Kind::Name(names) => PossibleValuesParser::new(names()).try_map(move |name| parse(&name)).into(),
        Kind::Flag => PossibleValuesParser::new(["true", "false"]).try_map(move |flag| parse(&flag)).into(),
        Kind::Number { .. } | Kind::Count(_) => ValueParser::new(parse),
    };
    let short = knob.help.split_once("\n\n").map_or(knob.help, |(first, _)| first);
    Arg::new(knob.name)
        .long(knob.name)
        .value_name(knob.value_name)
        .help(short)
        .long_help(knob.help)
        .help_heading(if knob.is_of_levels() { LEVELS } else { ACCURACY })
        .hide_short_help(RARE.contains(&knob.name))
        .hide_possible_values(matches!(knob.kind, Kind::Flag))
        .value_parser(values)
}

impl Knobs {
    fn given(knobs: impl Iterator<Item = &'static Knob>, matches: &ArgMatches) -> Self {
        Self(knobs.filter_map(|knob| Some((knob, *matches.get_one(knob.name)?))).collect())
    }

    /// `preset` with what these arguments change, for a scene that was trained with or without antialiasing and needs a
    /// near plane at most `nearest` away.
    pub fn options(&self, preset: &Options, antialiased: bool, nearest: f32) -> Options {
        let mut options = *preset;
        options.rules.near = options.rules.near.min(nearest);
        options.rules.antialiased = antialiased;
        for (knob, value) in &self.0 {
            (knob.set)(&mut options, *value);
        }
        options
    }

    /// True if the knob of this name is given.
    #[cfg(feature = "viewer")]
    pub fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(knob, _)| knob.name == name)
    }

    /// True if a knob that trades accuracy for speed is given.
    pub fn trades(&self) -> bool {
        self.0.iter().any(|(knob, _)| knob.group == Group::Accuracy)
    }

    /// True if scenes with levels of detail may be drawn simplified.
    pub fn wants_levels(&self) -> bool {
        self.options(&Options::EXACT, false, f32::INFINITY).wants_levels()
    }

    /// Fails if the GPU cannot draw by these rules.
    pub fn check_gpu(&self) -> Result<(), Usage> {
        match self.options(&Options::EXACT, false, f32::INFINITY).undrawable() {
            Some(_) => Err(Usage("--order per-pixel needs --reference".to_owned())),
            None => Ok(()),
        }
    }
}

/// The names of the presets.
pub(super) fn preset_names() -> PossibleValuesParser {
    PossibleValuesParser::new(Options::PRESETS.map(|(name, _)| name))
}
