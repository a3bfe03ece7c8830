//! The tables of `smalto trade`.

use std::collections::BTreeSet;

use anyhow::Result;

use crate::cli::table::{say_table, table};
use crate::cli::{remark, say};
use crate::measure::bench::WarmUp;
use crate::measure::metrics::Difference;
use crate::measure::trade::{BudgetReport, CertificateReport, LevelsReport, Promise, Report};

pub(super) fn print_points(report: &Report) -> Result<()> {
    let Some(exact) = report.points.first() else {
        return Ok(());
    };
    let header = ["", "path", "ms", "saved", "MB", "dB", "max error", "step", "SSIM", "FLIP", "dB to exact", "max", ""];
    let mut rows = table(&header);
    for point in report.points.iter().chain(&report.search) {
        let (oracle, full) = (&point.from_oracle, &point.from_exact);
        rows.add_row([
            point.name.clone(),
            point.drawn_by.to_string(),
            format!("{:.3}", point.gpu_ms),
            format!("{:.3}", exact.gpu_ms - point.gpu_ms),
            format!("{:.0}", (point.scene_bytes + point.work_bytes) as f64 / 1e6),
            decibels(oracle),
            format!("{:.4}", oracle.max_error),
            oracle.largest_step.to_string(),
            oracle.ssim.map_or_else(String::new, |ssim| format!("{ssim:.5}")),
            format!("{:.5}", oracle.flip),
            decibels(full),
            format!("{:.4}", full.max_error),
            if point.is_pareto { "*" } else { "" }.to_owned(),
        ]);
    }
    say_table(&rows)?;
    say!(
        "  errors of the worst view; step: largest difference in 8 bits; \
         *: no other is both faster and more accurate"
    )?;
    let all = || report.points.iter().chain(&report.search);
    let notices: BTreeSet<&str> = all().filter_map(|point| point.notice.as_deref()).collect();
    notices.iter().for_each(|notice| remark(&format!("note: {}: {notice}", report.scene.name)));
    warn_unsteady(all().map(|point| point.warm_up))
}

/// Prints the number of points that were measured before the frame time was steady.
fn warn_unsteady(warm_ups: impl Iterator<Item = Option<WarmUp>>) -> Result<()> {
    let is_steady: Vec<bool> = warm_ups.map(|warm_up| warm_up.is_none_or(|warm_up| warm_up.is_steady)).collect();
    let (points, unsteady) = (is_steady.len(), is_steady.iter().filter(|is_steady| !**is_steady).count());
    match unsteady {
        0 => Ok(()),
        _ => say!("  warning: the frame time of {unsteady} of {points} points was not steady after the warm-up"),
    }
}

pub(super) fn print_promises(promises: &[Promise]) -> Result<()> {
    let mut rows = table(&["preset", "promise", "dB", "max error", "step", "SSIM", "FLIP", "cameras", "kept"]);
    for promise in promises {
        let step = promise.max_step.map_or_else(String::new, |step| format!(", {step} steps"));
        let worst = &promise.worst;
        rows.add_row([
            promise.preset.clone(),
            format!("{} dB{step}", promise.min_psnr_db),
            decibels(worst),
            format!("{:.4}", worst.max_error),
            worst.largest_step.to_string(),
            worst.ssim.map_or_else(String::new, |ssim| format!("{ssim:.5}")),
            format!("{:.5}", worst.flip),
            promise.cameras.to_string(),
            if promise.is_kept { "yes" } else { "NO" }.to_owned(),
        ]);
    }
    say_table(&rows)
}

pub(super) fn print_certificate(report: &CertificateReport) -> Result<()> {
    let header =
        ["certificate", "pixels", "violations", "max error", "max bound", "mean error", "mean bound", "tightest"];
    let mut rows = table(&header);
    for setting in &report.settings {
        rows.add_row([
            setting.name.clone(),
            setting.pixel_tests.to_string(),
            setting.violations.to_string(),
            format!("{:.5}", setting.max_error),
            format!("{:.5}", setting.max_certificate),
            format!("{:.2e}", setting.mean_error),
            format!("{:.2e}", setting.mean_certificate),
            format!("{:.3}", setting.tightest),
        ]);
    }
    say_table(&rows)?;
    say!("  {} pixels tested, {} violations", report.pixel_tests, report.violations)
}

pub(super) fn print_budget(held: &BudgetReport) -> Result<()> {
    let BudgetReport { held_out_views, exceeded, from_oracle, from_exact, .. } = held;
    say!(
        "  on {held_out_views} other views: {exceeded} over the budget; worst {} dB and {:.4} to the reference, \
         {} dB and {:.4} to exact",
        decibels(from_oracle),
        from_oracle.max_error,
        decibels(from_exact),
        from_exact.max_error
    )
}

pub(super) fn print_levels(report: &LevelsReport) -> Result<()> {
    let samples = format!("dB to {} samples", report.samples);
    let header = ["levels", "splats", "drawn", "pages", "ms", "dB to exact", "max", "SSIM", "FLIP", ""];
    let mut rows = table(&[&header[..], &[&samples, "SSIM", "FLIP", ""]].concat());
    let mark = |is_pareto| if is_pareto { "*" } else { "" }.to_owned();
    let ssim = |from: &Difference| from.ssim.map_or_else(String::new, |ssim| format!("{ssim:.5}"));
    for point in &report.points {
        let (exact, truth) = (&point.from_exact, &point.from_supersampled);
        rows.add_row([
            point.preset.clone(),
            if point.options.splats == 0 { "all".to_owned() } else { point.options.splats.to_string() },
            format!("{:.0}", point.visible),
            point.pages.map_or_else(String::new, |pages| format!("{pages:.0}")),
            format!("{:.3}", point.gpu_ms),
            decibels(exact),
            format!("{:.4}", exact.max_error),
            ssim(exact),
            format!("{:.5}", exact.flip),
            mark(point.is_pareto),
            decibels(truth),
            ssim(truth),
            format!("{:.5}", truth.flip),
            mark(point.is_pareto_supersampled),
        ]);
    }
    say_table(&rows)?;
    let LevelsReport { views, frames, samples, .. } = report;
    say!(
        "  {views} views, {frames} frames a point; errors of the worst view, to the exact picture and to one with \
         {samples} samples a pixel; *: no other is both faster and closer"
    )?;
    warn_unsteady(report.points.iter().map(|point| point.warm_up))
}

fn decibels(difference: &Difference) -> String {
    difference.psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.1}"))
}
