//! The plots of the ladder.

use std::path::Path;

use anyhow::Result;
use smalto::measure::plot::{self, Bar, Bars, Lines, Panel};

use super::report::{Climb, LadderReport, RungReport};

/// Plots the paper's Figures 2 to 6: time by stage, frame time, speedup, and the gain from batches.
pub fn plot(report: &LadderReport, path: &Path) -> Result<()> {
    plot::write(path, (1500, 1150), |panel| {
        let (upper, lower) = panel.split_vertically(560);
        let (left, right) = upper.split_horizontally(900);
        breakdown(report, &left)?;
        over_counts(report, &right, "Frame time", "wall time of a frame, ms", &|_, rung| Some(rung.wall_ms.median))?;
        let (left, right) = lower.split_horizontally(750);
        over_counts(report, &left, "Speedup over the baseline", "times faster", &|climb, rung| {
            Some(climb.rungs.first()?.wall_ms.median / rung.wall_ms.median)
        })?;
        batches(report, &right)
    })
}

/// The climbs of scenes with the same name as the first up to the colon (levels of detail of one object), by size.
fn series(report: &LadderReport) -> Vec<&Climb> {
    let stem = |climb: &Climb| climb.scene.name.split(':').next().unwrap_or_default().to_owned();
    let first = report.climbs.first().map(stem).unwrap_or_default();
    let mut climbs: Vec<_> = report.climbs.iter().filter(|climb| stem(climb) == first).collect();
    climbs.sort_by_key(|climb| climb.scene.gaussians);
    climbs
}

fn breakdown(report: &LadderReport, panel: &Panel) -> Result<()> {
    let Some(climb) = series(report).pop() else { return Ok(()) };
    // The baseline is left out: its bar is many times as long as the others. It is in the other plots.
    let bars = climb.rungs.iter().skip(1).map(|rung| {
        let parts = rung.stages.iter().map(|stage| (stage.name.clone(), stage.ms.median));
        Bar { name: rung.name.clone(), parts: parts.collect() }
    });
    let title = format!("Time of a frame by stage, {} Gaussians, {}", climb.scene.gaussians, report.device.name);
    Bars { title, unit: "ms (median), CPU and GPU".to_owned(), bars: bars.collect() }.draw(panel)
}

/// Draws a value over the number of Gaussians, with a line for each of the main rungs.
fn over_counts(
    report: &LadderReport,
    panel: &Panel,
    title: &str,
    y: &str,
    value: &dyn Fn(&Climb, &RungReport) -> Option<f64>,
) -> Result<()> {
    let climbs = series(report);
    let names =
        ["baseline", "+1 GPU duplication", "+2 GPU ranges", "+4 GPU compaction", "+7 digits needed", "+9 pixel blocks"];
    let line = |name: &&str| {
        let point = |climb: &&Climb| Some((climb.scene.gaussians as f64, value(climb, climb.rung(name)?)?));
        ((*name).to_owned(), climbs.iter().filter_map(point).collect())
    };
    let (x, y) = ("Gaussians".to_owned(), y.to_owned());
    let lines = names.iter().map(line).collect();
    Lines { title: title.to_owned(), x, y, lines, is_logarithmic: true, is_scattered: false }.draw(panel)
}

/// Draws the speedup of blend by batches over the number of Gaussians, with a line for each batch size.
fn batches(report: &LadderReport, panel: &Panel) -> Result<()> {
    let climbs = series(report);
    let line = |batch: u32| {
        let point = |climb: &&Climb| {
            let unstaged = climb.rung("+2 GPU ranges")?.stage_ms("blend")?;
            let staged = climb.rung(&format!("+3 batches of {batch}"))?.stage_ms("blend")?;
            Some((climb.scene.gaussians as f64, unstaged / staged))
        };
        (format!("batches of {batch}"), climbs.iter().filter_map(point).collect())
    };
    let lines = [32, 64, 128, 256].map(line).into();
    let title = "Blend: gain from batches in workgroup memory".to_owned();
    let (x, y) = ("Gaussians".to_owned(), "times faster than from memory".to_owned());
    Lines { title, x, y, lines, is_logarithmic: false, is_scattered: false }.draw(panel)
}
