//! The conditions of a measurement: the program, the device, its clocks.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::gpu::Device;

/// The version of the program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VersionReport {
    pub version: String,
    /// Commit of the source, with `-dirty` if there were uncommitted changes; null if the build was given none.
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
    /// Bandwidth of a plain copy, bytes read plus bytes written, in 1e9 bytes per second: the limit of stages that are
    /// bound by memory.
    pub copy_gb_s: f64,
    /// The host's processor; null if the system does not report it.
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
        let facts = device.capabilities();
        let (name, driver, vulkan) = (facts.name.clone(), facts.driver.clone(), facts.vulkan.clone());
        Self { name, driver, vulkan, copy_gb_s, cpu: cpu() }
    }
}

/// The processor's name from Linux's /proc/cpuinfo.
fn cpu() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("model name"))?;
    Some(line.trim_start_matches([' ', '\t', ':']).to_owned())
}
