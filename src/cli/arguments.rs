//! The command line as a whole: its parser, options that need or exclude others, and errors as one sentence.

use std::error::Error as _;
use std::ffi::{OsStr, OsString};
use std::io::Write;
use std::path::Path;

use anyhow::Result;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{ArgMatches, Command, CommandFactory, Error, FromArgMatches};

use super::renamed::in_present_spelling;
use super::{Cli, Usage, printed, remark};
use crate::options::{Group, KNOBS, Knob};

/// Options that have no effect without one of some others.
const NEEDS: [(&str, &[&str]); 9] = [
    ("fps", &["video", "path"]),
    ("target", &["eye"]),
    ("camera_up", &["eye"]),
    ("fov", &["eye"]),
    ("threshold", &["baseline"]),
    ("held_out", &["max_error", "min_psnr"]),
    ("compare_by", &["compare"]),
    ("screen", &["offscreen"]),
    ("measure_levels", &["splats", "lod-error", "lod-psnr"]),
];

/// Arguments that name files or folders to read. (The last of `convert` is written.)
const SCENES_AND_PICTURES: [&str; 5] = ["scene", "scenes", "files", "a", "b"];

/// Names of values that are numbers with a unit. Their parsers refuse what begins with a minus.
const QUANTITIES: [&str; 4] = ["WxH", "WxH,...", "SIZE", "COUNT"];

/// Options that name a file to write. Two of them must not name the same file.
const WRITTEN: [&str; 7] = ["output", "certificate", "json", "csv", "plot", "heatmap", "screen"];

/// Those of them that are never folders.
const REPORTS: [&str; 4] = ["json", "csv", "plot", "screen"];

/// The parsed arguments.
pub(super) struct Parsed {
    pub cli: Cli,
    /// A report is written to standard output, which nothing else may use.
    pub reports_to_stdout: bool,
}

/// Parses the command line. Prints the help text or the version if it asks for one, and returns `None`.
pub(super) fn parse(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Option<Parsed>> {
    let (arguments, notes) = in_present_spelling(arguments.into_iter().map(Into::into).collect());
    notes.iter().for_each(|note| remark(note));
    let parsed = command().try_get_matches_from(arguments).and_then(|all| Ok((Cli::from_arg_matches(&all)?, all)));
    let (cli, all) = match parsed {
        Ok(parsed) => parsed,
        Err(text) if !text.use_stderr() => {
            printed(text.print().and_then(|()| std::io::stdout().flush()))?;
            return Ok(None);
        }
        Err(error) => return Err(refused(error).into()),
    };
    let Some((_, matches)) = all.subcommand() else { return Ok(Some(Parsed { cli, reports_to_stdout: false })) };
    check_needs(matches)?;
    check_written(matches)?;
    let reports_to_stdout = ["json", "csv"].iter().any(|id| value(matches, id) == Some(OsStr::new("-")));
    Ok(Some(Parsed { cli, reports_to_stdout }))
}

/// The commands with all options. A number below 0 is a value, not an option.
pub(super) fn command() -> Command {
    Cli::command().mut_subcommands(|command| {
        let has_knobs = command.get_arguments().any(|arg| arg.get_id() == "stop");
        command.mut_args(|arg| {
            let is_option = !arg.is_positional() && arg.get_action().takes_values();
            let is_quantity = arg.get_value_names().is_some_and(|names| QUANTITIES.contains(&names[0].as_str()));
            let arg = match is_option {
                true if is_quantity => arg.allow_hyphen_values(true),
                true => arg.allow_negative_numbers(true),
                false => arg,
            };
            let unused = if has_knobs { knobs_without_effect(arg.get_id().as_str()) } else { Vec::new() };
            arg.conflicts_with_all(unused)
        })
    })
}

/// The knobs that have no effect together with an option.
fn knobs_without_effect(option: &str) -> Vec<&'static str> {
    let named = |is_unused: fn(&Knob) -> bool| {
        let flags = KNOBS.iter().filter(|knob| knob.group != Group::Path && is_unused(knob));
        flags.map(|knob| knob.name).collect()
    };
    match option {
        // The reference draws by rules and degree; it has no storage, no sorting by bits, no stop.
        "reference" => named(|knob| knob.group == Group::Accuracy && knob.name != "sh-degree"),
        // A budget sets them itself.
        "max_error" | "min_psnr" => named(|knob| knob.group == Group::Accuracy),
        // It sets the error itself.
        "lod-psnr" => vec!["lod-error"],
        _ => Vec::new(),
    }
}

fn check_needs(matches: &ArgMatches) -> Result<(), Usage> {
    let is_given = |id: &str| {
        let is_known = matches.try_contains_id(id).unwrap_or(false);
        is_known && matches.value_source(id) == Some(ValueSource::CommandLine)
    };
    let alone = NEEDS.iter().find(|(option, others)| is_given(option) && !others.iter().any(|other| is_given(other)));
    alone.map_or(Ok(()), |(option, others)| {
        let others: Vec<_> = others.iter().map(|other| long(other)).collect();
        Err(Usage(format!("{} needs {}", long(option), others.join(" or "))))
    })
}

/// Fails if two options name the same file, or a report would replace a scene or picture. A folder may hold both
/// pictures and certificates.
fn check_written(matches: &ArgMatches) -> Result<(), Usage> {
    for (i, one) in WRITTEN.iter().enumerate() {
        let Some(file) = value(matches, one) else { continue };
        let place = if file == "-" { "standard output".into() } else { file.to_string_lossy() };
        let is_same = |other: &OsStr| match [file, other].map(|name| std::path::absolute(Path::new(name))) {
            [Ok(file), Ok(other)] => file == other,
            _ => false,
        };
        let others = &WRITTEN[i + 1..];
        let twice = |other: &&&str| value(matches, other).is_some_and(is_same);
        if let Some(other) = others.iter().find(twice).filter(|other| (*one, **other) != ("output", "certificate")) {
            return Err(Usage(format!("{} and {} would both be written to {place}", long(one), long(other))));
        }
        let mut named = SCENES_AND_PICTURES.iter().filter_map(|id| matches.try_get_raw(id).ok().flatten()).flatten();
        if REPORTS.contains(one) && named.any(is_same) {
            return Err(Usage(format!("{} would replace {place}, which is another argument", long(one))));
        }
    }
    Ok(())
}

/// The value of an option with a single one; `None` if it is not given or the command does not have it.
fn value<'m>(matches: &'m ArgMatches, id: &str) -> Option<&'m OsStr> {
    matches.try_get_raw(id).ok().flatten()?.next()
}

fn long(id: &str) -> String {
    format!("--{}", id.replace('_', "-"))
}

/// Describes what is wrong in one sentence. Ends the process with the help text where nothing was asked for.
fn refused(error: Error) -> Usage {
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.exit();
    }
    Usage(sentence(&error))
}

fn sentence(error: &Error) -> String {
    let texts = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => vec![text.clone()],
        Some(ContextValue::Strings(texts)) => texts.clone(),
        _ => Vec::new(),
    };
    let first = |kind| texts(kind).into_iter().next();
    let hint = |kind| first(kind).map_or_else(String::new, |similar| format!(": did you mean {similar}?"));
    let name = |text: &String| text.split(' ').next().unwrap_or(text).trim_end_matches("...").to_owned();
    let argument = first(ContextKind::InvalidArg).unwrap_or_default();
    let others: Vec<_> = texts(ContextKind::PriorArg).iter().map(name).collect();
    match error.kind() {
        ErrorKind::InvalidValue | ErrorKind::ValueValidation => {
            let value = first(ContextKind::InvalidValue).unwrap_or_default();
            let expected = texts(ContextKind::ValidValue);
            let problem = match error.source() {
                Some(source) => source.to_string(),
                None if expected.is_empty() => "a value is expected".to_owned(),
                None => format!("expected {}", expected.join(", ")),
            };
            let given = if value.is_empty() { argument } else { format!("{} {value}", name(&argument)) };
            format!("{given}: {problem}")
        }
        ErrorKind::UnknownArgument if argument.starts_with('-') => {
            format!("there is no option {argument}{}", hint(ContextKind::SuggestedArg))
        }
        ErrorKind::UnknownArgument => format!("{argument} is one argument too many"),
        ErrorKind::InvalidSubcommand => {
            let command = first(ContextKind::InvalidSubcommand).unwrap_or_default();
            format!("there is no command {command}{}", hint(ContextKind::SuggestedSubcommand))
        }
        ErrorKind::ArgumentConflict if others.is_empty() || others[0] == name(&argument) => {
            format!("{} is given twice", name(&argument))
        }
        ErrorKind::ArgumentConflict => format!("{} cannot be combined with {}", name(&argument), others.join(", ")),
        ErrorKind::MissingRequiredArgument => {
            format!("missing: {}", texts(ContextKind::InvalidArg).join(" "))
        }
        _ => {
            let text = error.to_string();
            text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
        }
    }
}
