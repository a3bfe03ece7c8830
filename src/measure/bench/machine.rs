//! What a measurement was made with: the program, the device, its clocks.

use nvml_wrapper::Nvml;
use nvml_wrapper::enum_wrappers::device::Clock;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::gpu::Device;

/// The program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VersionReport {
    pub version: String,
    /// Of the source, `-dirty` if there were changes on top; null where the build did not know it.
    pub commit: Option<String>,
}

impl VersionReport {
    pub fn current() -> Self {
        let commit = option_env!("SMALTO_COMMIT").map(str::to_owned);
        Self { version: env!("CARGO_PKG_VERSION").to_owned(), commit }
    }
}

/// The device and its host.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeviceReport {
    pub name: String,
    pub driver: String,
    pub vulkan: String,
    /// What a plain copy moves, read and written, 1e9 bytes per second: the limit of stages bound by memory.
    pub copy_gb_s: f64,
    /// The host's processor; null where the system does not tell.
    pub cpu: Option<String>,
}

/// Clock rates in MHz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Clocks {
    pub shader_mhz: u32,
    pub memory_mhz: u32,
}

impl DeviceReport {
    pub fn of(device: &Device, copy_gb_s: f64) -> Self {
        let facts = device.facts();
        let (name, driver, vulkan) = (facts.name.clone(), facts.driver.clone(), facts.vulkan.clone());
        Self { name, driver, vulkan, copy_gb_s, cpu: cpu() }
    }
}

/// The processor's name, as Linux tells it.
fn cpu() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("model name"))?;
    Some(line.trim_start_matches([' ', '\t', ':']).to_owned())
}

/// Asks for the clocks of an NVIDIA device, through its driver's management library; knows nothing of others.
pub struct ClockProbe {
    nvml: Option<Nvml>,
    uuid: String,
}

impl ClockProbe {
    pub fn new(device: &Device) -> Self {
        Self { nvml: Nvml::init().ok(), uuid: format!("GPU-{}", device.facts().uuid) }
    }

    /// The clocks at this moment, where the driver tells.
    pub fn now(&self) -> Option<Clocks> {
        let device = self.nvml.as_ref()?.device_by_uuid(self.uuid.as_str()).ok()?;
        let mhz = |clock| device.clock_info(clock).ok();
        Some(Clocks { shader_mhz: mhz(Clock::SM)?, memory_mhz: mhz(Clock::Memory)? })
    }
}
