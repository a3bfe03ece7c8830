//! The commands of the program, one file each.
//!
//! # Commands
//!
//! - `render` - `smalto render`: pictures of a scene, drawn to files
//! - `view`, `no_view` - `smalto view`: the window; and its error in a program without the viewer
//! - `serve`, `no_serve` - `smalto serve`: the viewer in browsers; and its error in a program without it
//! - `info` - `smalto info`: the description of a scene
//! - `convert` - `smalto convert` and `smalto lod`: scenes written to other files, and levels of detail
//! - `prune` - `smalto prune`: a scene without the Gaussians that contribute least
//! - `bench` - `smalto bench`: the speed of frames and their stages
//! - `trade` - `smalto trade`: the cost of accuracy
//! - `compare` - `smalto compare`: the differences of pictures
//! - `doctor` - `smalto doctor`: the Vulkan devices, and a test of one
//! - `completions` - `smalto completions` and `smalto man`
//! - `schemas` - `smalto schemas` (hidden): the JSON schemas of all reports
//!
//! # Arguments that commands share
//!
//! - `arguments` - the parser, options that need or exclude others, errors as one sentence
//! - `scenes` - the scene argument, and how scene files are read
//! - `drawable` - a scene that commands draw, with its name and its entry in reports
//! - `cameras` - the cameras: of a file, a split of it, or along a path
//! - `devices` - the choice of one or several devices
//! - `values` - parsers of the values of options
//! - `headings` - the groups of options in help texts
//! - `renamed` - former spellings of options
//! - `knobs` - the knobs of `options` as flags
//! - `budget` - error budgets, for which the options are chosen automatically
//! - `environment` - environment variables
//! - `pairs` - a test: each pair of options has an effect together or is refused
//!
//! # Output and state
//!
//! - `sink` - the destination of a report: a file or standard output
//! - `table` - tables on the terminal
//! - `progress` - the progress of long work
//! - `dump` - `--dump`: the buffers of a frame as NumPy files
//! - `interrupt` - signals that end the program
//! - `driver_cache` - the folder in which drivers cache shaders
//! - `pipeline_cache` - the file of compiled pipelines and passed self-tests

mod arguments;
mod bench;
mod budget;
mod cameras;
mod compare;
mod completions;
mod convert;
mod devices;
mod doctor;
mod drawable;
mod driver_cache;
mod dump;
pub mod environment;
mod headings;
mod info;
mod interrupt;
mod knobs;
mod levels;
#[cfg(test)]
mod pairs;
mod pipeline_cache;
mod progress;
mod prune;
mod renamed;
mod render;
mod scenes;
mod schemas;
#[cfg_attr(not(feature = "serve"), path = "no_serve.rs")]
mod serve;
mod sink;
mod table;
mod trade;
mod values;
#[cfg_attr(not(feature = "viewer"), path = "no_view.rs")]
mod view;

use std::ffi::OsString;
use std::fmt;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail, ensure};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Parser, Subcommand};

use crate::files::describe;
use crate::gpu::{Device, TooLarge, Unavailable};
use crate::host_memory::{OutOfMemory, share_arena_under_a_limit};
use crate::measure::trade::Unmeetable;
use crate::render::{NoLevels, UndrawableLens};
use crate::scene::Unreadable;
use crate::threads;
pub use devices::{open_device, open_devices};
use environment::Environment;
pub use scenes::reading;

/// Renders 3D Gaussian splatting scenes with Vulkan compute.
#[derive(Parser)]
#[command(
    name = "smalto",
    version,
    arg_required_else_help = true,
    after_help = "\
Exit codes: 0 success, 1 failure, 2 wrong usage, 3 no usable Vulkan device or no display for `view`, 4 unreadable \
scene, camera, image or report file, 5 out of memory, 6 over a threshold, or files that `render --verify` finds wrong.

Environment: SMALTO_DEVICE chooses the device like --device; SMALTO_VALIDATION turns the validation layer on (1) or \
off (0); SMALTO_FAULT simulates a fault in `view`, or with device@N the loss of the device after N frames of `serve`, \
or of one device after N views of `render`, or with page@N or slow@MS unreadable pages and slow reads; \
SMALTO_SHADERS=DIR compiles the shaders in DIR at run time (feature `reload`).

TMPDIR is the folder for scenes that come from a pipe, which are copied there, and for outputs to pipes and devices.

Cache: `smalto` in the user's folder of caches (on Linux ~/.cache or XDG_CACHE_HOME) holds compiled pipelines; it may \
be deleted at any time."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(Box<render::Args>),
    View(Box<view::Args>),
    Serve(Box<serve::Args>),
    Info(info::Args),
    Convert(convert::Args),
    Lod(convert::lod::Args),
    Prune(prune::Args),
    Bench(Box<bench::Args>),
    Compare(compare::Args),
    Trade(trade::Args),
    Doctor(doctor::Args),
    Completions(completions::CompletionsArgs),
    Man(completions::ManArgs),
    #[command(hide = true)]
    Schemas(schemas::Args),
}

impl Command {
    fn opens_devices(&self) -> bool {
        use Command::*;
        matches!(self, Render(_) | View(_) | Serve(_) | Prune(_) | Bench(_) | Trade(_) | Doctor(_))
    }
}

/// A report is written to standard output, so nothing else is printed there.
static REPORTS_TO_STDOUT: AtomicBool = AtomicBool::new(false);

/// Like `println!`, but returns errors, and prints nothing if a report is written to standard output. A closed pipe is
/// not an error.
macro_rules! say {
    ($($line:tt)*) => { $crate::cli::print_line(format_args!($($line)*)) };
}
use say;

fn print_line(line: fmt::Arguments) -> Result<()> {
    if REPORTS_TO_STDOUT.load(Ordering::Relaxed) {
        return Ok(());
    }
    printed(writeln!(std::io::stdout(), "{}", escaped(&line.to_string())))
}

/// The outcome of a write of text to standard output. A closed pipe is not an error: its reader has what it wants.
fn printed(outcome: std::io::Result<()>) -> Result<()> {
    match outcome {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            bail!("cannot write to standard output: {}", describe(&error))
        }
        _ => Ok(()),
    }
}

/// Prints a line to stderr. Errors are ignored: there is nowhere to report them.
fn remark(line: &str) {
    _ = writeln!(std::io::stderr(), "smalto: {}", escaped(line));
}

/// A line for a terminal. Control characters, which names of files may have, are escaped.
fn escaped(line: &str) -> String {
    let escape = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    line.chars().map(escape).collect()
}

/// The command line asks for something that is impossible or contradictory.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Usage(String);

/// A measurement is worse than the user allows: too slow, or too different.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct OverThreshold(String);

/// Runs the command in the arguments of the process, which may start itself again. Prints errors to stderr.
pub fn run() -> ExitCode {
    run_with(std::env::args_os(), driver_cache::suit_environment)
}

/// Like [`run`], with the given arguments and in this process. The first argument is the name of the program.
pub fn run_as_program(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> ExitCode {
    run_with(arguments, || {})
}

/// `before_drivers` is called before a command that opens devices begins.
fn run_with(
    arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
    before_drivers: impl FnOnce(),
) -> ExitCode {
    // Before the first thread, which would have an arena.
    share_arena_under_a_limit();
    let started = interrupt::clean_up_on_signals().map_err(anyhow::Error::from);
    let outcome = started.and_then(|()| arguments::parse(arguments)).and_then(|parsed| {
        let Some(parsed) = parsed else { return Ok(()) };
        if parsed.cli.command.opens_devices() {
            before_drivers();
        }
        if let Some(fault) = Environment::read()?.read_fault {
            crate::pagefile::simulate(fault);
        }
        REPORTS_TO_STDOUT.store(parsed.reports_to_stdout, Ordering::Relaxed);
        threads::start_pool()?;
        match parsed.cli.command {
            Command::Render(args) => render::run(&args),
            Command::View(args) => view::run(&args),
            Command::Serve(args) => serve::run(&args),
            Command::Info(args) => info::run(&args),
            Command::Convert(args) => convert::run(&args),
            Command::Lod(args) => convert::lod::run(&args),
            Command::Prune(args) => prune::run(&args),
            Command::Bench(args) => bench::run(&args),
            Command::Compare(args) => compare::run(&args),
            Command::Trade(args) => trade::run(&args),
            Command::Doctor(args) => doctor::run(&args),
            Command::Completions(args) => completions::completions(&args),
            Command::Man(args) => completions::man(&args),
            Command::Schemas(args) => schemas::run(&args),
        }
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            remark(&format!("{error:#}"));
            ExitCode::from(exit_code(&error))
        }
    }
}

fn exit_code(error: &anyhow::Error) -> u8 {
    if error.is::<Usage>() || error.is::<NoLevels>() || error.is::<UndrawableLens>() || error.is::<TooLarge>() {
        2
    } else if error.is::<Unavailable>() {
        3
    } else if error.is::<Unreadable>() {
        4
    } else if error.is::<OutOfMemory>() {
        5
    } else if error.is::<OverThreshold>() || error.is::<Unmeetable>() || error.is::<render::Incomplete>() {
        6
    } else {
        1
    }
}

/// The meaning of the largest bound in a certificate, as a sentence.
fn certified(bound: f32) -> String {
    format!("certified: leaving nothing out changes no value by more than {bound:.4} (scene as stored, same order)")
}

/// Fails if a plot is asked for and this build has none.
fn check_plots(file: Option<&Path>) -> Result<(), Usage> {
    if file.is_some() && !cfg!(feature = "plots") {
        return Err(Usage("--plot: this build has no plots: build smalto with the feature `plots`".to_owned()));
    }
    Ok(())
}

fn size_text([width, height]: [u32; 2]) -> String {
    format!("{width}x{height}")
}

/// Fails if the validation layer of the device reported anything.
fn complain(device: &Device) -> Result<()> {
    let messages = device.validation_messages();
    messages.iter().flat_map(|message| message.lines()).for_each(remark);
    ensure!(messages.is_empty(), "validation: {} messages, above", messages.len());
    Ok(())
}

/// A parser for values with a name and a help text. `--help` lists them.
fn one_of<T: Clone + Send + Sync + 'static>(
    values: impl IntoIterator<Item = (&'static str, &'static str, T)>,
) -> impl TypedValueParser<Value = T> {
    let values: Vec<_> = values.into_iter().collect();
    let listed = values.iter().map(|(name, help, _)| PossibleValue::new(*name).help(*help));
    PossibleValuesParser::new(listed.collect::<Vec<_>>()).try_map(move |name| {
        let found = values.iter().find(|(known, _, _)| *known == name);
        found.map(|(_, _, value)| value.clone()).with_context(|| format!("{name} is not one of the values"))
    })
}

/// Parses N finite numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N]> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.with_context(|| format!("'{text}' is not {N} number{}", if N == 1 { "" } else { "s with commas between" }))
}
