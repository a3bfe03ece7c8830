//! The clock rates of a device.

use nvml_wrapper::Nvml;
use nvml_wrapper::enum_wrappers::device::Clock;

use super::machine::Clocks;
use crate::gpu::Device;

/// Reads the clocks of an NVIDIA device through the driver's management library (NVML). Other devices report none.
pub struct ClockProbe {
    nvml: Option<Nvml>,
    uuid: String,
}

impl ClockProbe {
    pub fn new(device: &Device) -> Self {
        Self { nvml: Nvml::init().ok(), uuid: format!("GPU-{}", device.capabilities().uuid) }
    }

    /// The present clocks; `None` if the driver does not report them.
    pub fn now(&self) -> Option<Clocks> {
        let device = self.nvml.as_ref()?.device_by_uuid(self.uuid.as_str()).ok()?;
        let mhz = |clock| device.clock_info(clock).ok();
        Some(Clocks { shader_mhz: mhz(Clock::SM)?, memory_mhz: mhz(Clock::Memory)? })
    }
}
