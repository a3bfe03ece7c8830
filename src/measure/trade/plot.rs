//! Plot of the trade: PSNR to the reference over the GPU time of a frame.

use std::path::Path;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::report::{LevelsReport, Point, Report, psnr_db};
use crate::measure::bench::plot::{self, FONT, Lines, Panel, TEXT, broken, colour};
use crate::measure::metrics::Difference;

/// PSNR of pictures in 8 bits: every value one step off, truncated, rounded.
const GUIDES_DB: [(f64, &str); 3] =
    [(48.1, "1 step of 8 bits"), (52.9, "8 bits, truncated"), (58.9, "8 bits, rounded")];

/// Height of a panel in pixels.
const HEIGHT: u32 = 640;

/// Writes the plot: single knobs as grey points, the search as a line, the presets with names; below, the levels of
/// detail as lines.
pub fn plot(report: &Report, presets: &[&str], path: &Path) -> Result<()> {
    let has_points = !report.points.is_empty();
    let panels = u32::from(has_points) + u32::from(report.levels.is_some());
    plot::write(path, (1000, HEIGHT * panels), |panel| {
        let (upper, lower) = panel.split_vertically(if has_points { HEIGHT } else { 0 });
        if has_points {
            draw(report, presets, &upper)?;
        }
        report.levels.as_ref().map_or(Ok(()), |levels| draw_levels(report, levels, &lower))
    })
}

/// PSNR over time of each preset with fewer and fewer nodes. Pictures that are equal have no place.
fn draw_levels(report: &Report, levels: &LevelsReport, panel: &Panel) -> Result<()> {
    let LevelsReport { samples, points, .. } = levels;
    let mut presets: Vec<&str> = points.iter().map(|point| point.preset.as_str()).collect();
    presets.dedup();
    let supersampled = format!("to {samples} samples");
    type To = fn(&super::LevelPoint) -> &Difference;
    let ends: [(&str, To); 2] = [("to exact", |p| &p.from_exact), (&supersampled, |p| &p.from_supersampled)];
    let line = |(preset, (name, to)): (&str, (&str, To))| {
        let of_preset = points.iter().filter(|point| point.preset == preset);
        let places = of_preset.filter_map(|point| Some((point.gpu_ms, to(point).psnr_db?)));
        (format!("{preset}, {name}"), places.collect())
    };
    let all = presets.iter().flat_map(|preset| ends.map(|end| (*preset, end)));
    let [width, height] = report.size;
    let lines = Lines {
        title: format!("Levels of detail: {} at {width}x{height}, {}", report.scene.name, report.device.name),
        x: "GPU time of a frame, ms (median)".to_owned(),
        y: "PSNR of the worst view, dB".to_owned(),
        lines: all.map(line).collect(),
        is_logarithmic: false,
        is_scattered: false,
    };
    lines.draw(panel)
}

fn draw(report: &Report, presets: &[&str], panel: &Panel) -> Result<()> {
    let all = || report.points.iter().chain(&report.search);
    let ms = |pick: fn(f64, f64) -> f64, from: f64| all().map(|point| point.gpu_ms).fold(from, pick);
    let (low, high) = (ms(f64::min, f64::INFINITY), ms(f64::max, 0.0));
    let db = |point: &Point| psnr_db(&point.from_oracle).min(120.0);
    let [width, height] = report.size;
    let title = format!("{} at {width}x{height}, {}", report.scene.name, report.device.name);
    let mut chart = ChartBuilder::on(panel)
        .caption(title, (FONT, TEXT + 4))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(60)
        .build_cartesian_2d(low * 0.95..high * 1.08, 25.0..125.0)
        .map_err(broken)?;
    chart
        .configure_mesh()
        .x_desc("GPU time of a frame, ms (median)")
        .y_desc("PSNR of the worst view to the float64 reference, dB")
        .label_style((FONT, TEXT))
        .max_light_lines(0)
        .draw()
        .map_err(broken)?;
    for (level, name) in GUIDES_DB {
        let ends = [(low * 0.95, level), (high * 1.08, level)];
        chart.draw_series(LineSeries::new(ends, BLACK.mix(0.3))).map_err(broken)?;
        let style = (FONT, TEXT - 3).into_text_style(panel).pos(Pos::new(HPos::Right, VPos::Bottom));
        chart.draw_series([Text::new(name, (high * 1.075, level + 0.3), style)]).map_err(broken)?;
    }
    let search = report.points.first().into_iter().chain(&report.search).map(|point| (point.gpu_ms, db(point)));
    chart.draw_series(LineSeries::new(search, colour(1).stroke_width(2))).map_err(broken)?;
    for point in all() {
        let is_preset = presets.contains(&point.name.as_str());
        let shade = if is_preset { colour(0) } else { RGBColor(120, 120, 120) };
        let place = (point.gpu_ms, db(point));
        chart.draw_series([Circle::new(place, if is_preset { 6 } else { 3 }, shade.filled())]).map_err(broken)?;
        let size = if is_preset { TEXT } else { TEXT - 4 };
        let style = (FONT, size).into_text_style(panel).pos(Pos::new(HPos::Left, VPos::Bottom)).color(&shade);
        chart.draw_series([EmptyElement::at(place) + Text::new(point.name.clone(), (6, -3), style)]).map_err(broken)?;
    }
    Ok(())
}
