//! The stages that fit merged nodes.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use criterion::Criterion;
use smalto::gpu::{Device, Feature};
use smalto::lod::{FitOptions, Node, Nodes, simplify};
use smalto::procedural::cactus;
use smalto::render::DeviceFitter;
use smalto::scene::along_curve;

use crate::{Row, time};

/// All dispatches of each stage for one group of `nodes` nodes, which become half as many in four rounds of the fit of
/// shapes. Nothing on a device without 64-bit floats.
pub fn run(criterion: &mut Criterion, device: &Device, nodes: usize, rows: &mut Vec<Row>) -> Result<()> {
    if !device.capabilities().has(Feature::DoubleFloats) {
        return Ok(());
    }
    let scene = cactus(64 * nodes)?.gaussians;
    let near = along_curve(scene.means());
    let children = Nodes::of(&scene, near[..nodes].iter().map(|index| *index as usize));
    let fitter = DeviceFitter::new(device)?;
    let times = || -> Result<BTreeMap<&str, f64>> {
        fitter.take_times();
        simplify(&children, nodes / 2, 0.0, FitOptions { shape_rounds: 4, fitter: Some(&fitter) });
        fitter.take_failure().map_or(Ok(()), Err)?;
        Ok(fitter.take_times())
    };
    // Each stage reads the parents at least.
    let bytes = (nodes / 2 * size_of::<Node>()) as u64;
    let names: Vec<&str> = times()?.into_keys().collect();
    for name in names {
        let once = || times()?.get(name).copied().context("the stage was not timed");
        time(criterion, ("fit", format!("{name}, {nodes} nodes"), bytes), &once, rows)?;
    }
    Ok(())
}
