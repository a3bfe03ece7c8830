//! A frame that may stop on its way for the CPU, and the time of each of its stages on both sides.

use std::time::Instant;

use anyhow::Result;

use crate::gpu::{Buffer, Commands, Device, Element, Results};

/// The time of a stage in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageTime {
    pub name: &'static str,
    /// On the GPU, copies to and from the host included.
    pub gpu_ms: f64,
    /// On the CPU.
    pub host_ms: f64,
}

/// Commands under way, and what those before them took.
pub struct Steps {
    device: Device,
    pub cmd: Commands,
    times: Vec<StageTime>,
}

impl Steps {
    pub fn new(device: &Device) -> Result<Self> {
        Ok(Self { device: device.clone(), cmd: Commands::new(device)?, times: Vec::new() })
    }

    /// Runs what was recorded, and begins anew.
    pub fn flush(&mut self) -> Result<Results> {
        let commands = std::mem::replace(&mut self.cmd, Commands::new(&self.device)?);
        let results = commands.submit()?.wait()?;
        for timing in results.timings() {
            self.time(timing.name).gpu_ms += timing.duration_ms;
        }
        Ok(results)
    }

    /// Runs what was recorded, and reads the first element of a buffer behind it.
    pub fn flush_and_read<T: Element>(&mut self, buffer: &Buffer<T>) -> Result<T> {
        let readback = self.cmd.read(buffer)?;
        let results = self.flush()?;
        Ok(results.view(&readback)[0])
    }

    /// Runs part of stage `name` on the CPU.
    pub fn on_host<R>(&mut self, name: &'static str, run: impl FnOnce() -> R) -> R {
        let started = Instant::now();
        let result = run();
        self.time(name).host_ms += started.elapsed().as_secs_f64() * 1e3;
        result
    }

    /// The stages in the order they were begun.
    pub fn into_times(self) -> Vec<StageTime> {
        self.times
    }

    fn time(&mut self, name: &'static str) -> &mut StageTime {
        let index = self.times.iter().position(|time| time.name == name).unwrap_or_else(|| {
            self.times.push(StageTime { name, gpu_ms: 0.0, host_ms: 0.0 });
            self.times.len() - 1
        });
        &mut self.times[index]
    }
}
