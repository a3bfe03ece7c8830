//! A frame that may wait for the CPU between its stages, and the time of each stage on GPU and CPU.

use std::time::Instant;

use anyhow::Result;

use smalto::gpu::{Buffer, Commands, Device, Element, Results};

/// The time of a stage in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageTime {
    pub name: &'static str,
    /// Time on the GPU, copies to and from the host included.
    pub gpu_ms: f64,
    /// Time on the CPU.
    pub host_ms: f64,
}

/// Commands that are being recorded, and the times of those before them.
pub struct Steps {
    device: Device,
    pub cmd: Commands,
    times: Vec<StageTime>,
}

impl Steps {
    pub fn new(device: &Device) -> Result<Self> {
        Ok(Self { device: device.clone(), cmd: Commands::new(device)?, times: Vec::new() })
    }

    /// Runs the recorded commands, waits, and starts new ones.
    pub fn flush(&mut self) -> Result<Results> {
        let commands = std::mem::replace(&mut self.cmd, Commands::new(&self.device)?);
        let results = commands.submit()?.wait()?;
        for timing in results.timings() {
            self.time(timing.name).gpu_ms += timing.duration_ms;
        }
        Ok(results)
    }

    /// Runs the recorded commands, and reads the first element of `buffer` after them.
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

    /// The times of the stages in the order of their begin.
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
