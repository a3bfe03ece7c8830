//! The choice of one or several devices.

use anyhow::Result;
use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::environment::Environment;
use super::headings::DEVICE;
use super::pipeline_cache::with_pipeline_cache;
use super::{Usage, remark, say, values};
use crate::gpu::{Capabilities, Device, DeviceChoice, DeviceKind, MemoryUse, Validation, different_kinds, survey};
use crate::threads::{self, joined};

/// The note on `--share frame` with one device.
pub(super) const SHARE_NEEDS_SEVERAL: &str =
    "note: --share frame has no effect with one device: --device 0,1 or --device all takes several";

/// The choice of a device.
#[derive(Args)]
#[command(next_help_heading = DEVICE)]
pub(super) struct DeviceArgs {
    /// Number in the list of `smalto doctor`, or part of a name
    ///
    /// By default, the fastest kind.
    #[arg(long, value_name = "DEVICE", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    #[command(flatten)]
    memory: MemoryArg,
}

/// The limit of device memory.
#[derive(Args, Clone, Copy)]
#[command(next_help_heading = DEVICE)]
pub(super) struct MemoryArg {
    /// Limit of device memory, like 4GB or 700MiB [default: what is free]
    ///
    /// For each device. What does not fit is drawn in parts, and the picture is the same. By default, the limit is what
    /// the driver says is free, less a part for other programs.
    #[arg(long, value_name = "SIZE", value_parser = values::memory)]
    memory: Option<u64>,
}

/// The choice of several devices.
#[derive(Args)]
#[command(next_help_heading = DEVICE)]
pub(super) struct DevicesArgs {
    /// Number in the list of `smalto doctor`, or part of a name; 0,1 or all
    ///
    /// Several devices are separated by commas. all: every GPU, or every software device where there is no GPU. By
    /// default, one of the fastest kind. `render` shares the pictures among them, or with --share frame each
    /// picture; `bench` measures the first, then all together. `view` and `serve` show pictures on the first, which
    /// the others help to draw where that is faster.
    #[arg(long, value_name = "DEVICES", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    #[command(flatten)]
    memory: MemoryArg,
}

impl DeviceArgs {
    /// Opens the device with what earlier runs left for it.
    pub fn open(&self) -> Result<Device> {
        Ok(with_pipeline_cache(self.open_anew()?))
    }

    /// Opens the device as if it were for the first time.
    pub fn open_anew(&self) -> Result<Device> {
        let environment = Environment::read()?;
        open(&self.choice_in(&environment), &environment, self.memory)
    }

    fn choice_in(&self, environment: &Environment) -> DeviceChoice {
        self.device.as_deref().map_or_else(|| environment.device.clone(), DeviceChoice::from)
    }
}

/// Opens a device as every command does. `name` is its number or a part of its name; `memory` is the most device memory
/// to take, in bytes. Without them, the environment and the driver decide.
///
/// # Errors
/// [`Unavailable`](crate::gpu::Unavailable) if there is no such device; if a variable of the environment is wrong.
pub fn open_device(name: Option<String>, memory: Option<u64>) -> Result<Device> {
    DeviceArgs { device: name, memory: MemoryArg { memory } }.open()
}

/// The name that stands for the processor in place of a device.
pub(super) const HOST: &str = "host";

/// Opens the named device for work that the processor does, too; without a name that of the environment, or a GPU.
/// `None` if the processor is named, or if none is named and no GPU can be opened: software devices are slower than the
/// processor without them.
pub(super) fn open_instead_of_host(name: Option<&str>) -> Result<Option<Device>> {
    if name == Some(HOST) {
        return Ok(None);
    }
    let environment = Environment::read()?;
    let choice = name.map_or_else(|| environment.device.clone(), DeviceChoice::from);
    let is_gpu = |device: &Capabilities| device.missing.is_empty() && device.kind != DeviceKind::Cpu;
    if name.is_none() && !survey().is_ok_and(|devices| devices.iter().any(is_gpu)) {
        return Ok(None);
    }
    match open(&choice, &environment, MemoryArg { memory: None }) {
        Ok(device) if name.is_none() && !is_gpu(device.capabilities()) => Ok(None),
        Err(error) if name.is_none() => {
            remark(&format!("no GPU is used: {error:#}"));
            Ok(None)
        }
        opened => Ok(Some(with_pipeline_cache(opened?))),
    }
}

/// Opens several devices, each by its number or a part of its name; without names, all that `--device all` takes.
/// `memory` is the most memory to take on each, in bytes.
///
/// # Errors
/// Those of [`open_device`].
pub fn open_devices(names: &[String], memory: Option<u64>) -> Result<Vec<Device>> {
    let choices = if names.is_empty() {
        all(&survey()?)
    } else {
        names.iter().map(|name| DeviceChoice::from(name.as_str())).collect()
    };
    open_together(&choices, &Environment::read()?, MemoryArg { memory })
}

impl DevicesArgs {
    /// Opens the devices, at most the first `most`. Says so if they are of different kinds.
    pub fn open(&self, most: usize) -> Result<Vec<Device>> {
        let environment = Environment::read()?;
        let mut choices = self.choices(&environment)?;
        choices.truncate(most);
        let devices = open_together(&choices, &environment, self.memory)?;
        different_kinds(&devices).iter().for_each(|note| remark(note));
        Ok(devices)
    }

    /// The first device and whether it is validated, from these arguments and the environment; and the others, opened.
    #[cfg(feature = "viewer")]
    pub fn first_and_others(&self) -> Result<(DeviceChoice, Validation, Vec<Device>)> {
        let environment = Environment::read()?;
        let mut choices = self.choices(&environment)?;
        let first = choices.remove(0);
        let others = open_together(&choices, &environment, self.memory)?;
        Ok((first, validation(&environment), others))
    }

    /// The limit of memory on each device in bytes, if one is set.
    #[cfg(feature = "viewer")]
    pub fn memory_limit(&self) -> Option<u64> {
        self.memory.memory
    }

    /// One choice at least.
    fn choices(&self, environment: &Environment) -> Result<Vec<DeviceChoice>> {
        Ok(match self.device.as_deref() {
            None => vec![environment.device.clone()],
            Some("all") => all(&survey()?),
            Some(named) if named.contains(',') => several(named, &survey()?)?,
            Some(named) => vec![DeviceChoice::from(named)],
        })
    }
}

/// The device that shows pictures, and those that help to draw them.
#[cfg(feature = "viewer")]
pub(super) fn first_and_others(mut devices: Vec<Device>) -> (Device, Vec<Device>) {
    (devices.remove(0), devices)
}

/// Opens devices at the same time: a driver takes a tenth of a second for each.
fn open_together(choices: &[DeviceChoice], environment: &Environment, memory: MemoryArg) -> Result<Vec<Device>> {
    let opened = threads::scope(|threads| {
        let opening = choices.iter().map(|choice| threads.spawn(move || open(choice, environment, memory)));
        let opening: Vec<_> = opening.collect::<Result<_, _>>()?;
        opening.into_iter().map(joined).collect::<Result<Vec<_>>>()
    })?;
    Ok(opened.into_iter().map(with_pipeline_cache).collect())
}

fn validation(environment: &Environment) -> Validation {
    let default = if cfg!(debug_assertions) { Validation::IfInstalled } else { Validation::Off };
    environment.validation.unwrap_or(default)
}

fn open(choice: &DeviceChoice, environment: &Environment, memory: MemoryArg) -> Result<Device> {
    let device = Device::open(choice, validation(environment))?.with_shaders(environment.shaders.as_deref())?;
    device.with_memory_limit(memory.memory)
}

/// The devices of a list. A list that is a part of a device's name, which may hold commas, means that device.
///
/// # Errors
/// If a device of the list has no name.
fn several(list: &str, devices: &[Capabilities]) -> Result<Vec<DeviceChoice>, Usage> {
    let is_name = devices.iter().any(|device| device.name.to_lowercase().contains(&list.to_lowercase()));
    let names: Vec<&str> = if is_name { vec![list] } else { list.split(',').map(str::trim).collect() };
    if names.iter().any(|name| name.is_empty()) {
        return Err(Usage(format!("--device {list}: a device between commas has no number and no name")));
    }
    Ok(names.into_iter().map(DeviceChoice::from).collect())
}

/// Every device of a machine that can be used: GPUs, or software devices where there are no GPUs.
fn all(devices: &[Capabilities]) -> Vec<DeviceChoice> {
    let usable = || devices.iter().enumerate().filter(|(_, device)| device.missing.is_empty());
    let has_gpu = usable().any(|(_, device)| device.kind != DeviceKind::Cpu);
    let wanted = usable().filter(|(_, device)| !has_gpu || device.kind != DeviceKind::Cpu);
    let found: Vec<_> = wanted.map(|(index, _)| DeviceChoice::Index(index)).collect();
    // Without any, opening the best one says why.
    if found.is_empty() { vec![DeviceChoice::Best] } else { found }
}

/// Prints the use of a device's memory.
pub(super) fn say_memory(device: &Device) -> Result<()> {
    let MemoryUse { user_limit, limit, peak, driver_used, .. } = device.memory();
    let megabytes = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    let limit = match (user_limit, limit) {
        (Some(limit), _) => format!("the limit is {}", megabytes(limit)),
        (None, Some(limit)) => format!("the limit is {}, what is free less a part for others", megabytes(limit)),
        (None, None) => "no limit is set".to_owned(),
    };
    let used = driver_used.map_or_else(String::new, |used| format!("; the driver counts {} in use", megabytes(used)));
    say!("device memory: up to {} was used; {limit}{used}", megabytes(peak))
}
