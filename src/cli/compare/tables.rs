//! The tables of a comparison: one of colours, one of numbers such as depths.

use anyhow::Result;

use super::Compared;
use crate::cli::table::{say_table, table};
use crate::measure::metrics::{AlphaDifference, Difference, NumberDifference, Report};

/// Prints one row per pair and, for folders, the worst value of each column.
pub(super) fn print(compared: &[Compared], report: &Report, is_folder: bool) -> Result<()> {
    let has_alpha = report.worst_alpha.is_some();
    let mut header = vec![
        "",
        "max error",
        "PSNR dB",
        "SSIM",
        "FLIP",
        "> 1/255",
        "> 4/255",
        "> 16/255",
        "8-bit changed",
        "step",
        "not finite",
    ];
    if has_alpha {
        header.push("alpha error");
    }
    let mut rows = table(&header);
    for Compared { title, pair } in compared {
        if let Some(difference) = &pair.difference {
            rows.add_row(of_colours(title, difference, has_alpha, pair.alpha));
        }
    }
    if let Some(worst) = &report.worst {
        if is_folder {
            rows.add_row(of_colours("worst", worst, has_alpha, report.worst_alpha));
        }
        say_table(&rows)?;
    }
    let Some(worst) = &report.worst_numbers else { return Ok(()) };
    let mut rows = table(&[
        "",
        "max error",
        "mean error",
        "max relative",
        "mean relative",
        "> 0.1 %",
        "> 1 %",
        "> 10 %",
        "only in one",
    ]);
    for Compared { title, pair } in compared {
        if let Some(numbers) = &pair.numbers {
            rows.add_row(of_numbers(title, numbers));
        }
    }
    if is_folder {
        rows.add_row(of_numbers("worst", worst));
    }
    say_table(&rows)
}

fn of_colours(title: &str, difference: &Difference, has_alpha: bool, alpha: Option<AlphaDifference>) -> Vec<String> {
    let Difference { max_error, psnr_db, ssim, flip, over, changed8, largest_step, non_finite, .. } = difference;
    let mut row = vec![
        title.to_owned(),
        error(f64::from(*max_error)),
        psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.2}")),
        ssim.map_or_else(|| "-".to_owned(), |ssim| format!("{ssim:.6}")),
        format!("{flip:.6}"),
        percent(over.steps_1),
        percent(over.steps_4),
        percent(over.steps_16),
        percent(*changed8),
        largest_step.to_string(),
        non_finite.to_string(),
    ];
    if has_alpha {
        row.push(alpha.map_or_else(|| "-".to_owned(), |alpha| error(alpha.max_error)));
    }
    row
}

fn of_numbers(title: &str, numbers: &NumberDifference) -> Vec<String> {
    let NumberDifference { max_error, mean_error, max_relative, mean_relative, over, unmatched } = numbers;
    vec![
        title.to_owned(),
        error(*max_error),
        error(*mean_error),
        percent(*max_relative),
        percent(*mean_relative),
        percent(over.permille_1),
        percent(over.percent_1),
        percent(over.percent_10),
        unmatched.to_string(),
    ]
}

fn error(error: f64) -> String {
    if error < 1e4 { format!("{error:.6}") } else { format!("{error:.1e}") }
}

fn percent(fraction: f64) -> String {
    format!("{:.3} %", fraction * 100.0)
}
