//! The commands, one file each.

mod bench;
mod budget;
mod cameras;
mod compare;
mod convert;
mod doctor;
mod dump;
mod environment;
mod info;
mod knobs;
mod progress;
mod render;
mod scenes;
mod table;
mod trade;
mod view;

use std::ffi::OsString;
use std::fmt;
use std::io::Write;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, Parser, Subcommand};

use crate::camera::MAX_SIDE;
use environment::Environment;
use crate::gpu::{Device, DeviceChoice, Unavailable, Validation};
use crate::host_memory::OutOfMemory;
use crate::scene::Unreadable;
use crate::measure::trade::Unmeetable;
use budget::BudgetArgs;
use cameras::{FilmArgs, SplitArg, named_or_found};
use knobs::Knobs;
use scenes::{ReadingArgs, SceneArg};

/// Renders 3D Gaussian splatting scenes with Vulkan compute.
#[derive(Parser)]
#[command(
    name = "smalto",
    version,
    arg_required_else_help = true,
    after_help = "\
Exit codes: 0 done, 1 failure, 2 usage, 3 no usable Vulkan device,
            4 unreadable scene, camera, image or report file, 5 out of memory, 6 over a threshold.
Environment: SMALTO_DEVICE chooses the device like --device; SMALTO_VALIDATION=1 turns the validation layer on."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(render::Args),
    View(view::Args),
    Info(info::Args),
    Convert(convert::Args),
    Bench(bench::Args),
    Compare(compare::Args),
    Trade(trade::Args),
    Doctor(doctor::Args),
}

/// Which device to run on.
#[derive(Args)]
struct DeviceArgs {
    /// Vulkan device, by the number that `smalto doctor` lists or a part of its name [default: the fastest kind]
    #[arg(long, value_name = "INDEX|NAME")]
    device: Option<String>,
}

impl DeviceArgs {
    fn open(&self) -> Result<Device> {
        let (choice, validation) = self.choice();
        Device::open(&choice, validation)
    }

    /// Which device, and how it is watched.
    fn choice(&self) -> (DeviceChoice, Validation) {
        let environment = Environment::read();
        let choice = self.device.as_deref().map_or(environment.device, DeviceChoice::from);
        let default = if cfg!(debug_assertions) { Validation::IfInstalled } else { Validation::Off };
        (choice, environment.validation.unwrap_or(default))
    }
}

/// Like `println!`, but returns what goes wrong. A reader that left early is no failure.
macro_rules! say {
    ($($line:tt)*) => { $crate::cli::print_line(format_args!($($line)*)) };
}
use say;

fn print_line(line: fmt::Arguments) -> Result<()> {
    match writeln!(std::io::stdout(), "{line}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to standard output")
        }
        _ => Ok(()),
    }
}

/// Prints a line to stderr, if there is one to print to.
fn remark(line: &str) {
    _ = writeln!(std::io::stderr(), "smalto: {line}");
}

/// What the user asked for makes no sense here.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Usage(String);

/// What was measured is worse than the user allows: slower, or too different.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct OverThreshold(String);

/// Runs the command that the process was given, and says what went wrong.
pub fn run() -> ExitCode {
    run_from(std::env::args_os())
}

/// The same with these arguments, the first of which is the program's name.
pub fn run_from(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> ExitCode {
    let outcome = match Cli::parse_from(arguments).command {
        Command::Render(args) => render::run(&args),
        Command::View(args) => view::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Trade(args) => trade::run(&args),
        Command::Doctor(args) => doctor::run(&args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            remark(&format!("{error:#}"));
            ExitCode::from(exit_code(&error))
        }
    }
}

fn exit_code(error: &anyhow::Error) -> u8 {
    if error.is::<Usage>() {
        2
    } else if error.is::<Unavailable>() {
        3
    } else if error.is::<Unreadable>() {
        4
    } else if error.is::<OutOfMemory>() {
        5
    } else if error.is::<OverThreshold>() || error.is::<Unmeetable>() {
        6
    } else {
        1
    }
}

/// What a largest bound of certificates means.
fn certified(bound: f32) -> String {
    format!("certified: no value is farther than {bound:.4} from where nothing is left out (as stored, in this order)")
}

fn size_text([width, height]: [u32; 2]) -> String {
    format!("{width}x{height}")
}

/// Fails if the device complained.
fn complain(device: &Device) -> Result<()> {
    let complaints = device.validation_messages();
    ensure!(complaints.is_empty(), "validation: {}", complaints.join("\n"));
    Ok(())
}

/// `WIDTHxHEIGHT` in pixels.
fn parse_size(text: &str) -> Result<[u32; 2]> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match sides {
        Some(size @ [1..=MAX_SIDE, 1..=MAX_SIDE]) => Ok(size),
        _ => bail!("expected WIDTHxHEIGHT in pixels, like 1280x720"),
    }
}
