//! The copy of an image to the host.

use anyhow::Result;

use crate::gpu::{Commands, Device, Image};
use crate::host_memory::host_vec;
use crate::pixels::Pixels;

/// The pixels of `image` after everything that was submitted so far. Waits for the device.
///
/// # Errors
/// If memory runs out or the device is lost.
pub(crate) fn read_pixels(device: &Device, image: &Image) -> Result<Pixels> {
    const BAND_BYTES: u32 = 256 << 20; // of staging memory at a time
    let [width, height] = image.size();
    let band = (BAND_BYTES / 16 / width).max(1);
    let mut rgba = host_vec(width as usize * height as usize, "picture")?;
    for top in (0..height).step_by(band as usize) {
        let mut cmd = Commands::new(device)?;
        let rows = cmd.read_rows(image, top..height.min(top + band))?;
        let results = cmd.submit()?.wait()?;
        rgba.extend_from_slice(results.view(&rows));
    }
    Ok(Pixels { size: [width, height], rgba })
}
