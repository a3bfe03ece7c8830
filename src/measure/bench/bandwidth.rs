//! The bandwidth of device memory, measured by a plain copy on the same device in the same run.

use anyhow::{Context, Result, ensure};

use super::statistics::Statistics;
use crate::gpu::{Buffer, Commands, Device, DispatchSize, Stage};
use crate::render::shaders::bench::{CopyWords, CopyWordsBindings, CopyWordsPush};

const COPIES: usize = 9;
const BYTES: u64 = 512 << 20;

/// Bandwidth of a copy in device memory: bytes read plus bytes written, in 1e9 bytes per second. The median of nine
/// copies of half a gibibyte, or less if the device's buffers or memory are smaller.
///
/// # Errors
/// If the device has no timestamps or not enough memory.
pub fn copy_gb_s(device: &Device) -> Result<f64> {
    let limits = &device.capabilities().limits;
    ensure!(limits.timestamp_bits > 0, "{} has no timestamps, which measurements need", device.capabilities().name);
    let len = (BYTES.min(limits.storage_range).min(device.capabilities().memory_bytes / 16) / 16) as usize;
    let buffer = |name| Buffer::<[u32; 4]>::new(device, name, len);
    let (from, to) = (buffer("copy source")?, buffer("copy target")?);
    let stage = Stage::<CopyWords>::new(device, &())?;
    // A driver may serve reads of memory that was never written without accessing it.
    let mut cmd = Commands::new(device)?;
    cmd.fill(&from, 0x5a5a_5a5a);
    cmd.submit()?.wait()?;
    let copy = || {
        let mut cmd = Commands::new(device)?;
        cmd.scope("copy", |cmd| {
            let bindings = CopyWordsBindings { from: &from, to: &to };
            cmd.dispatch(
                &stage,
                bindings,
                CopyWordsPush { elements: len as u32 },
                DispatchSize::Invocations(len as u64),
            );
        });
        let results = cmd.submit()?.wait()?;
        let timing = results.timings().first().context("the copy was not timed")?;
        Ok(timing.duration_ms)
    };
    let times = (0..COPIES).map(|_| copy()).collect::<Result<Vec<_>>>()?;
    Ok(2.0 * 16.0 * len as f64 / (Statistics::of(times).median * 1e6))
}
