//! `--dump`: writes the buffers of a frame as NumPy files.

use std::path::Path;

use anyhow::Result;
use npyz::WriterBuilder;

use crate::files::{make_folder, write_whole};
use crate::gpu::{Capture, Scalar};

/// Writes each capture as `NN-stage.buffer.npy` with one row per element. NN counts in the order of the frame.
pub(super) fn write(folder: &Path, captures: &[Capture]) -> Result<()> {
    make_folder(folder)?;
    for (number, capture) in captures.iter().enumerate() {
        let name = format!("{number:02}-{}.{}.npy", capture.scope(), capture.buffer()).replace(' ', "-");
        let bytes = capture.bytes();
        let (scalar, columns) = capture.element();
        let shape = [(bytes.len() / scalar.bytes() / columns) as u64, columns as u64];
        write_whole(&folder.join(name), |file| {
            match scalar {
                Scalar::F32 => array::<f32>(file, &shape, bytes),
                Scalar::I32 => array::<i32>(file, &shape, bytes),
                Scalar::U32 => array::<u32>(file, &shape, bytes),
                Scalar::U64 => array::<u64>(file, &shape, bytes),
            }
            .map_err(anyhow::Error::from)
        })?;
    }
    Ok(())
}

fn array<T: npyz::AutoSerialize + bytemuck::Pod>(
    file: &mut dyn std::io::Write,
    shape: &[u64],
    bytes: &[u8],
) -> std::io::Result<()> {
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(file).begin_nd()?;
    writer.extend(bytemuck::cast_slice::<u8, T>(bytes).iter().copied())?;
    writer.finish()
}
