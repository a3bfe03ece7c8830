//! The tables of the ladder on the terminal.

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};

use super::report::{Climb, LadderReport, Paper};

/// The stages with a column of their own.
const STAGES: [&str; 6] = ["cull", "project", "duplicate", "sort", "ranges", "blend"];

/// A row per rung: its times, the speedup of the stage that it changes, and the paper's speedup.
pub fn of(climb: &Climb) -> String {
    let mut rows = Table::new();
    rows.load_style(NOTHING)
        .set_header(["rung", "frame ms", "speedup"].iter().chain(&STAGES).chain(&["changed", "paper"]));
    for (index, column) in rows.column_iter_mut().enumerate() {
        column.set_padding((0, 2));
        column.set_cell_alignment(if index == 0 { CellAlignment::Left } else { CellAlignment::Right });
    }
    let (first, last) = (&climb.rungs[0], &climb.rungs[climb.rungs.len() - 1]);
    for rung in &climb.rungs {
        let ms = |name: &str| rung.stage_ms(name).map_or_else(String::new, |ms| format!("{ms:.3}"));
        let speedup = format!("{:.1}x", first.wall_ms.median / rung.wall_ms.median);
        let changed = climb.stage_speedup(rung).map_or_else(String::new, |x| format!("{} {x:.1}x", rung.stage));
        let paper = Paper::of(&rung.name).map_or("", |step| step.speedup).to_owned();
        let about = [rung.name.clone(), ms("frame"), speedup];
        rows.add_row(about.into_iter().chain(STAGES.map(ms)).chain([changed, paper]));
    }
    let (scene, [width, height]) = (&climb.scene, climb.size);
    let (gaussians, sh_degree) = (scene.gaussians, scene.sh_degree);
    let mut text = format!("{}  {width}x{height}  {gaussians} Gaussians, SH degree {sh_degree}\n", scene.name);
    rows.lines().for_each(|line| text += &format!("  {}\n", line.trim_end()));
    text += &format!(
        "  {:.0} visible on every rung; {:.0} instances by squares, {:.0} by ellipses; the last picture is {} the \
         first\n",
        first.visible.median,
        first.instances.median,
        last.instances.median,
        last.to_baseline_db.map_or_else(|| "equal to".to_owned(), |db| format!("{db:.1} dB from"))
    );
    let unsteady = climb.rungs.iter().filter(|rung| rung.warm_up.is_some_and(|warm_up| !warm_up.is_steady));
    let unsteady: Vec<_> = unsteady.map(|rung| rung.name.as_str()).collect();
    if !unsteady.is_empty() {
        let names = unsteady.join(", ");
        text += &format!("  warning: the frame time was not steady after the warm-up of {names}\n");
    }
    text
}

/// Device, program and protocol.
pub fn conditions(report: &LadderReport) -> String {
    let LadderReport { device, smalto, warmup, frames, path, .. } = report;
    let commit = smalto.commit.as_deref().unwrap_or("(unknown commit)");
    let cpu = device.cpu.as_ref().map_or_else(String::new, |cpu| format!("{cpu}\n"));
    format!(
        "{}, {}, copies at {:.0} GB/s\n{cpu}smalto {} {commit}; {warmup} warm-up frames or more, {frames} measured or \
         fewer, {path}\n",
        device.name, device.driver, device.copy_gb_s, smalto.version
    )
}
