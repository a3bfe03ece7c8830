//! Plot of the trade: PSNR to the reference over the GPU time of a frame.

use std::path::Path;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::report::{Point, Report, psnr_db};
use crate::measure::bench::plot::{self, FONT, Panel, TEXT, broken, colour};

/// PSNR of pictures in 8 bits: every value one step off, truncated, rounded.
const GUIDES_DB: [(f64, &str); 3] =
    [(48.1, "1 step of 8 bits"), (52.9, "8 bits, truncated"), (58.9, "8 bits, rounded")];

/// Writes the plot: single knobs as grey points, the search as a line, the presets with names.
pub fn plot(report: &Report, presets: &[&str], path: &Path) -> Result<()> {
    plot::write(path, (1000, 640), |panel| draw(report, presets, panel))
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
