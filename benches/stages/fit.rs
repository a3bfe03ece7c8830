//! The stages that fit merged nodes.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use criterion::Criterion;
use smalto::gpu::Device;
use smalto::lod::{FitOptions, Nodes, simplify};
use smalto::procedural::cactus;
use smalto::render::DeviceFitter;
use smalto::scene::along_curve;

use crate::{Row, time};

/// All dispatches of each stage for one group of `nodes` nodes, which become half as many in four rounds of the fit of
/// shapes. Nothing on a device that cannot fit nodes.
pub fn run(criterion: &mut Criterion, device: &Device, nodes: usize, rows: &mut Vec<Row>) -> Result<()> {
    let fitter = match DeviceFitter::new(device) {
        Ok(fitter) => fitter,
        Err(error) => {
            eprintln!("no rows of the fit: {error:#}");
            return Ok(());
        }
    };
    let scene = cactus(64 * nodes)?.gaussians;
    let near = along_curve(scene.means());
    let children = Nodes::of(&scene, near[..nodes].iter().map(|index| *index as usize));
    let times = || -> Result<BTreeMap<&str, f64>> {
        fitter.take_times_ms();
        simplify(&children, nodes / 2, 0.0, FitOptions { shape_rounds: 4, fitter: Some(&fitter) });
        fitter.take_failure().map_or(Ok(()), Err)?;
        Ok(fitter.take_times_ms())
    };
    let names: Vec<&str> = times()?.into_keys().collect();
    for name in names {
        let once = || times()?.get(name).copied().context("the stage was not timed");
        time(criterion, ("fit", format!("{name}, {nodes} nodes"), None), &once, rows)?;
    }
    Ok(())
}
