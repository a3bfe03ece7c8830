//! The stages that pack a scene on the device.

use std::rc::Rc;

use anyhow::Result;
use smalto::gpu::{Commands, Device, Feature};
use smalto::options::Options;
use smalto::render::{DeviceArrays, Upload};

use crate::{Bench, random};

/// `examine` and `pack` for `count` Gaussians of degree 3 in 32-bit floats; none without 64-bit floats.
pub fn benches(device: &Device, count: usize) -> Result<Vec<Bench<'_>>> {
    if !device.capabilities().has(Feature::DoubleFloats) {
        return Ok(Vec::new());
    }
    let mut arrays = DeviceArrays::new(device, count, 3)?;
    let (parts, words) = (arrays.parts(), arrays.words().clone());
    let mut cmd = Commands::new(device)?;
    cmd.upload(&words, 0, words.len(), |memory| {
        for range in parts {
            let values = memory[range].iter_mut().zip(0..);
            values.for_each(|(word, i)| *word = (0.01 + 0.9 * random(i) as f32 / u32::MAX as f32).to_bits());
        }
    })?;
    cmd.submit()?.wait()?;
    let examination = arrays.examine(&Options::EXACT, Upload::default())??;
    let scene = arrays.pack(&examination, None, Upload::default())??;
    let (arrays, input) = (Rc::new(arrays), format!("{count} Gaussians of degree 3"));
    let bench = |stage, bytes, record| Bench { stage, input: input.clone(), bytes, record };
    let examined = arrays.clone();
    let examine = Box::new(move |cmd: &mut Commands| cmd.scope("examine", |cmd| examined.record_examine(cmd)));
    let bytes = words.bytes();
    let packed = bytes + scene.bytes_each() * count as u64;
    let pack = Box::new(move |cmd: &mut Commands| cmd.scope("pack", |cmd| arrays.record_pack(cmd, &scene)));
    Ok(vec![bench("examine", bytes, examine), bench("pack", packed, pack)])
}
