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

/// The device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeviceReport {
    pub name: String,
    pub driver: String,
    pub vulkan: String,
    /// Clocks right after the last measured frame; null where the driver does not tell.
    pub clocks: Option<Clocks>,
    /// What a plain copy moves, read and written, 1e9 bytes per second: the limit of stages bound by memory.
    pub copy_gb_s: f64,
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
        Self { name, driver, vulkan, clocks: Clocks::now(&facts.uuid), copy_gb_s }
    }
}

impl Clocks {
    /// Of an NVIDIA device, from its driver's management library.
    fn now(uuid: &str) -> Option<Self> {
        let nvml = Nvml::init().ok()?;
        let device = nvml.device_by_uuid(format!("GPU-{uuid}")).ok()?;
        let (shader, memory) = (device.clock_info(Clock::SM).ok()?, device.clock_info(Clock::Memory).ok()?);
        Some(Self { shader_mhz: shader, memory_mhz: memory })
    }
}
