//! Plots as SVG, of `bench` and `trade`: stacked bars of stages, lines, and accuracy over time.

use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::bench::{self, Run};
use super::metrics::Difference;
use super::trade::{self, LevelPoint, LevelsReport, Point};
use crate::files::write_whole;

const FONT: &str = "sans-serif";
const TEXT: i32 = 14; // px
const NAMES: u32 = 300; // px, width of the column of bar names
// px, top of the key and distance of its lines
const KEY_TOP: i32 = 50;
const KEY_STEP: i32 = 20;

/// Colours that are distinct for all kinds of colour vision (Okabe and Ito 2008); later ones repeat them, lighter.
const PALETTE: [(u8, u8, u8); 8] = [
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (213, 94, 0),
    (240, 228, 66),
    (110, 110, 110),
];

/// PSNR of pictures in 8 bits: every value one step off, truncated, rounded.
const GUIDES_DB: [(f64, &str); 3] =
    [(48.1, "1 step of 8 bits"), (52.9, "8 bits, truncated"), (58.9, "8 bits, rounded")];

/// Height of a panel of the trade in pixels.
const HEIGHT: u32 = 640;

/// The area that a plot is drawn into.
pub type Panel<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Horizontal bars of stacked parts; the parts have a common unit.
pub struct Bars {
    pub title: String,
    pub unit: String,
    pub bars: Vec<Bar>,
}

/// A bar and its parts (name, length). Parts with the same name have the same colour.
pub struct Bar {
    pub name: String,
    pub parts: Vec<(String, f64)>,
}

impl Bar {
    fn length(&self) -> f64 {
        self.parts.iter().map(|part| part.1).sum()
    }
}

/// Lines through points.
pub struct Lines {
    pub title: String,
    pub x: String,
    pub y: String,
    /// Name and points of each line.
    pub lines: Vec<(String, Vec<(f64, f64)>)>,
    /// Both axes are logarithmic.
    pub is_logarithmic: bool,
    /// Lines of more than two points are points alone.
    pub is_scattered: bool,
}

/// Writes an SVG of this size in pixels atomically; `draw` draws it.
pub fn write(path: &Path, size: (u32, u32), draw: impl FnOnce(&Panel) -> Result<()>) -> Result<()> {
    let mut text = String::new();
    {
        let panel = SVGBackend::with_string(&mut text, size).into_drawing_area();
        panel.fill(&WHITE).map_err(broken)?;
        draw(&panel)?;
        panel.present().map_err(broken)?;
    }
    write_whole(path, |file| Ok(std::io::Write::write_all(file, text.as_bytes())?))
}

fn colour(index: usize) -> RGBColor {
    let (r, g, b) = PALETTE[index % PALETTE.len()];
    let lighten = |v: u8| if index < PALETTE.len() { v } else { 128 + v / 2 };
    RGBColor(lighten(r), lighten(g), lighten(b))
}

fn broken<E: std::error::Error + Send + Sync>(error: DrawingAreaErrorKind<E>) -> anyhow::Error {
    anyhow!("cannot draw the plot: {error}")
}

impl Bars {
    pub fn draw(&self, panel: &Panel) -> Result<()> {
        let longest = self.bars.iter().map(Bar::length).fold(0.0, f64::max);
        let count = self.bars.len() as f64;
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in self.bars.iter().flat_map(|bar| &bar.parts) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        let mut chart = ChartBuilder::on(panel)
            .caption(&self.title, (FONT, TEXT + 4))
            .margin(10)
            .margin_left(NAMES)
            .margin_right(150)
            .x_label_area_size(40)
            .build_cartesian_2d(0.0..longest.max(1e-6) * 1.02, 0.0..count)
            .map_err(broken)?;
        let mesh = &mut chart.configure_mesh();
        mesh.disable_y_mesh()
            .max_light_lines(0)
            .y_labels(0)
            .x_desc(&self.unit)
            .label_style((FONT, TEXT))
            .draw()
            .map_err(broken)?;
        for (index, name) in names.iter().enumerate() {
            let piece = |(row, bar): (usize, &Bar)| {
                let before: f64 = bar.parts.iter().take_while(|p| p.0 != *name).map(|p| p.1).sum();
                let length = bar.parts.iter().find(|p| p.0 == *name)?.1;
                let y = count - row as f64;
                Some(Rectangle::new([(before, y - 0.2), (before + length, y - 0.8)], colour(index).filled()))
            };
            chart.draw_series(self.bars.iter().enumerate().filter_map(piece)).map_err(broken)?;
            let place = (panel.dim_in_pixel().0 as i32 - 140, KEY_TOP + KEY_STEP * index as i32);
            let key = Rectangle::new([place, (place.0 + 12, place.1 + 12)], colour(index).filled());
            panel.draw(&key).map_err(broken)?;
            panel.draw(&Text::new(*name, (place.0 + 18, place.1), (FONT, TEXT))).map_err(broken)?;
        }
        for (row, bar) in self.bars.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(0.0, count - row as f64 - 0.5));
            let (left, top) = panel.get_base_pixel();
            let style = (FONT, TEXT).into_text_style(panel).pos(Pos::new(HPos::Right, VPos::Center));
            panel.draw(&Text::new(bar.name.as_str(), (x - left - 8, y - top), style)).map_err(broken)?;
        }
        Ok(())
    }
}

impl Lines {
    pub fn draw(&self, panel: &Panel) -> Result<()> {
        let points = || self.lines.iter().flat_map(|(_, points)| points);
        let range = |pick: fn(&(f64, f64)) -> f64| {
            points().map(pick).fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)))
        };
        let ((x_low, x_high), (y_low, y_high)) = (range(|p| p.0), range(|p| p.1));
        let mut builder = ChartBuilder::on(panel);
        builder.caption(&self.title, (FONT, TEXT + 4)).margin(10).margin_right(20);
        builder.x_label_area_size(40).y_label_area_size(60);
        // Linear and logarithmic axes are two types, so the code is a macro.
        macro_rules! draw {
            ($x:expr, $y:expr) => {{
                let mut chart = builder.build_cartesian_2d($x, $y).map_err(broken)?;
                let mesh = &mut chart.configure_mesh();
                let mesh = mesh.x_desc(&self.x).y_desc(&self.y).label_style((FONT, TEXT)).max_light_lines(0);
                mesh.x_label_formatter(&|v| short(*v)).y_label_formatter(&|v| short(*v)).draw().map_err(broken)?;
                for (index, (name, points)) in self.lines.iter().enumerate() {
                    let style = colour(index).stroke_width(2);
                    let is_line = !self.is_scattered || points.len() <= 2;
                    let path = points.iter().copied().filter(|_| is_line);
                    let line = chart.draw_series(LineSeries::new(path, style)).map_err(broken)?;
                    let key = move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style);
                    line.label(name).legend(key);
                    let dots = points.iter().map(|p| Circle::new(*p, 3, colour(index).filled()));
                    chart.draw_series(dots).map_err(broken)?;
                }
                let labels = &mut chart.configure_series_labels();
                let labels = labels.position(SeriesLabelPosition::UpperLeft).label_font((FONT, TEXT));
                labels.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.2)).draw().map_err(broken)?;
            }};
        }
        if self.is_logarithmic {
            // The range extends upward so that the key does not cover the lines.
            let top = y_high * (y_high / y_low).powf(0.4).max(2.0);
            draw!((x_low * 0.9..x_high * 1.1).log_scale(), (y_low * 0.8..top).log_scale());
        } else {
            draw!(0.0..x_high * 1.05, 0.0..y_high * 1.4);
        }
        Ok(())
    }
}

/// Writes the stage times of every run as stacked bars: the paper's Figure 2.
pub fn stage_breakdown(report: &bench::Report, path: &Path) -> Result<()> {
    let bar = |run: &Run| {
        let parts = run.stages.iter().map(|stage| (stage.name.clone(), stage.ms.median.max(0.0)));
        Bar { name: format!("{} ({})", run.subject.title(), run.drawn_by), parts: parts.collect() }
    };
    let bars: Vec<_> = report.runs.iter().map(bar).collect();
    let key = bars.iter().map(|bar| bar.parts.len()).max().unwrap_or(0) as i32;
    let height = (150 + 34 * bars.len() as u32).max((KEY_TOP + KEY_STEP * (key + 1)) as u32);
    let title = format!("GPU time of a frame by stage: {}", report.device.name);
    write(path, (1000, height), |panel| Bars { title, unit: "GPU time, ms (median)".to_owned(), bars }.draw(panel))
}

/// Writes the plot of a trade: single knobs as grey points, the search as a line, the presets with names; below, the
/// levels of detail as lines.
pub fn trade(report: &trade::Report, presets: &[&str], path: &Path) -> Result<()> {
    let has_points = !report.points.is_empty();
    let panels = u32::from(has_points) + u32::from(report.levels.is_some());
    write(path, (1000, HEIGHT * panels), |panel| {
        let (upper, lower) = panel.split_vertically(if has_points { HEIGHT } else { 0 });
        if has_points {
            draw_points(report, presets, &upper)?;
        }
        report.levels.as_ref().map_or(Ok(()), |levels| draw_levels(report, levels, &lower))
    })
}

/// PSNR over time of each preset with fewer and fewer nodes. Pictures that are equal have no place.
fn draw_levels(report: &trade::Report, levels: &LevelsReport, panel: &Panel) -> Result<()> {
    let LevelsReport { samples, points, .. } = levels;
    let mut presets: Vec<&str> = points.iter().map(|point| point.preset.as_str()).collect();
    presets.dedup();
    let supersampled = format!("to {samples} samples");
    type To = fn(&LevelPoint) -> &Difference;
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

fn draw_points(report: &trade::Report, presets: &[&str], panel: &Panel) -> Result<()> {
    let all = || report.points.iter().chain(&report.search);
    let ms = |pick: fn(f64, f64) -> f64, from: f64| all().map(|point| point.gpu_ms).fold(from, pick);
    let (low, high) = (ms(f64::min, f64::INFINITY), ms(f64::max, 0.0));
    let db = |point: &Point| point.from_oracle.psnr_db.unwrap_or(f64::INFINITY).min(120.0);
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

/// Formats a number with a unit prefix: 1940000 as 1.94M.
fn short(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        v if v >= 1e6 => (value / 1e6, "M"),
        v if v >= 1e3 => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let digits = match scaled.abs() {
        10.0.. => 0,
        0.01.. => 2,
        _ => 5,
    };
    let text = format!("{scaled:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text}{unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_axes_are_short() {
        let cases = [
            (1_940_000.0, "1.94M"),
            (139_410.0, "139k"),
            (0.5, "0.5"),
            (20.0, "20"),
            (0.0, "0"),
            (0.05, "0.05"),
            (0.001, "0.001"),
        ];
        for (value, text) in cases {
            assert_eq!(short(value), text);
        }
    }
}
