//! The file in which the compiled pipelines of a device and the checks that it passed are kept for the next run.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use crate::files::{make_folder, read_whole, write_whole};
use crate::gpu::{CachedPipelines, Device};
use crate::measure::bench::VersionReport;

/// Largest file that is read or written.
const MOST_BYTES: u64 = 64 << 20;

/// Gives a device what an earlier run left in the user's folder of caches. Without a file that can be used, the device
/// begins anew; what cannot be written is forgotten.
pub fn with_pipeline_cache(device: Device) -> Device {
    let folder = dirs::cache_dir().map(|folder| folder.join("smalto"));
    // Without a place for it, nothing is collected.
    let Some(folder) = folder.filter(|folder| make_folder(folder).is_ok()) else { return device };
    let file = folder.join(name(&device));
    let earlier = read(&file).unwrap_or_default();
    device.with_pipeline_cache(earlier, move |now| _ = write(&file, now))
}

/// The name of the file: that of the driver, the device and this version of the program.
fn name(device: &Device) -> PathBuf {
    let (is_validated, device) = (device.is_validated(), device.capabilities());
    let VersionReport { version, commit } = VersionReport::current();
    let mut hasher = blake3::Hasher::new();
    // Checked pipelines are others.
    let checked = is_validated.to_string();
    for part in [&device.name, &device.driver, &version, commit.as_ref().unwrap_or(&String::new()), &checked] {
        hasher.update(part.as_bytes()).update(&[0]);
    }
    let hash = hasher.update(&device.pipeline_uuid).finalize().to_hex();
    format!("device-{}.bin", &hash[..16]).into()
}

fn read(file: &Path) -> Option<CachedPipelines> {
    let is_small = file.metadata().is_ok_and(|data| data.len() <= MOST_BYTES);
    let content = is_small.then(|| read_whole(file).ok()).flatten()?;
    CachedPipelines::of_bytes(&content)
}

fn write(file: &Path, now: &CachedPipelines) -> Result<()> {
    let is_large = now.pipelines.len() as u64 > MOST_BYTES / 2;
    let checks_alone = || CachedPipelines { pipelines: Vec::new(), passed: now.passed.clone() };
    let content = if is_large { checks_alone().to_bytes() } else { now.to_bytes() };
    ensure!(content.len() as u64 <= MOST_BYTES, "too much to remember");
    // Whole or not at all: of several runs that end at once, one is remembered.
    write_whole(file, |out| Ok(out.write_all(&content)?))
}
