//! The tables of `smalto bench` on the terminal.

use anyhow::Result;

use crate::measure::bench::{Change, Clocks, DeviceReport, Protocol, Run, Statistics, VersionReport};
use crate::cli::table::{say_table, table};
use crate::cli::{certified, say, size_text};
use crate::measure::ladder::{Climb, Paper};

/// `checked`: whether the picture was compared with the reference.
pub(super) fn print_run(run: &Run, checked: bool) -> Result<()> {
    let (subject, frame, counts) = (&run.subject, &run.frame, &run.counts);
    let scene = &subject.scene;
    say!("{}  {} Gaussians, SH degree {}", subject.title(), scene.gaussians, scene.sh_degree)?;
    let header: Vec<_> = ["ms"].into_iter().chain(Statistics::COLUMNS).chain(["of a copy's speed"]).collect();
    let mut times = table(&header);
    let mut row = |name: &str, s: Statistics, note: String| {
        let numbers = s.columns().map(|v| format!("{v:.3}"));
        times.add_row(std::iter::once(name.to_owned()).chain(numbers).chain([note]));
    };
    row("frame, GPU", frame.gpu_ms, String::new());
    row("frame, waited for", frame.wall_ms, String::new());
    for stage in &run.stages {
        let percent = format!("{:.0} %", stage.bandwidth_fraction * 100.0);
        let note = if stage.least_bytes > 0 { percent } else { String::new() };
        row(&format!("  {}", stage.name), stage.ms, note);
    }
    say_table(&times)?;
    let (fps, cost_us) = (1e3 / frame.pipelined_ms, frame.timestamps_cost_ms * 1e3);
    say!(
        "  pipelined {:.3} ms a frame, {fps:.0} frames a second; stage timestamps cost {cost_us:.0} us",
        frame.pipelined_ms
    )?;
    say!(
        "  {:.0} visible, {:.0} instances in {:.0} of {} tiles, longest list {:.0} (medians)",
        counts.visible.median,
        counts.instances.median,
        counts.listed_tiles.median,
        counts.tiles,
        counts.longest_list.median
    )?;
    say!(
        "  per pixel {:.0} listed, {:.0} evaluated, {:.0} with idle lanes; {:.0} % of the pixels end early",
        counts.listed_per_pixel.median,
        counts.evaluations_per_pixel.median,
        counts.lanes_per_pixel.median,
        counts.early_exit_rate.median * 100.0
    )?;
    let bytes: u64 = run.memory.iter().map(|a| a.bytes).sum();
    let clocks = |c: Clocks| format!("; {} MHz, memory {} MHz", c.shader_mhz, c.memory_mhz);
    let clocks = run.clocks.map_or_else(String::new, clocks);
    let (megabytes, picture) = (bytes as f64 / 1e6, &run.image_hash[..16]);
    say!("  {megabytes:.0} MB in {} buffers; picture {picture}{clocks}", run.memory.len())?;
    if let Some(bound) = run.certified_error {
        say!("  {}", certified(bound))?;
    }
    match run.psnr_db {
        Some(psnr_db) => say!("  {psnr_db:.1} dB to the float64 reference"),
        None if checked => say!("  equal to the float64 reference"),
        None => Ok(()),
    }
}

pub(super) fn print_machine(
    device: &DeviceReport,
    smalto: &VersionReport,
    protocol: Protocol,
    path: &str,
) -> Result<()> {
    say!("{}, {}, copies at {:.0} GB/s", device.name, device.driver, device.copy_gb_s)?;
    let commit = smalto.commit.as_deref().unwrap_or("of unknown commit");
    if let Some(cpu) = &device.cpu {
        say!("{cpu}")?;
    }
    say!("smalto {} {commit}; {} + {} frames, {path}", smalto.version, protocol.warmup, protocol.frames)
}

/// A row a rung: what it changes, beside what the paper says of it.
pub(super) fn print_climb(climb: &Climb) -> Result<()> {
    let scene = &climb.scene;
    say!("{}  {}  {} Gaussians, SH degree {}", scene.name, size_text(climb.size), scene.gaussians, scene.sh_degree)?;
    let header =
        ["rung", "frame ms", "times", "cull", "project", "duplicate", "sort", "ranges", "blend", "its stage", "paper"];
    let mut rows = table(&header);
    let first_ms = climb.rungs.first().map_or(f64::NAN, |rung| rung.wall_ms.median);
    for rung in &climb.rungs {
        let ms = |name: &str| rung.stage_ms(name).map_or_else(String::new, |ms| format!("{ms:.3}"));
        let faster = climb.stage_speedup(rung).map_or_else(String::new, |x| format!("{} {x:.1}x", rung.stage));
        let paper = Paper::of(&rung.name).map_or("", |step| step.speedup);
        let (frame, times) = (format!("{:.3}", rung.wall_ms.median), format!("{:.1}x", first_ms / rung.wall_ms.median));
        let stages = ["cull", "project", "duplicate", "sort", "ranges", "blend"].map(ms);
        let about = [rung.name.clone(), frame, times];
        rows.add_row(about.into_iter().chain(stages).chain([faster, paper.to_owned()]));
    }
    say_table(&rows)?;
    let (first, last) = (&climb.rungs[0], &climb.rungs[climb.rungs.len() - 1]);
    let instances = [first, last].map(|rung| rung.instances.median);
    say!(
        "  {:.0} visible on every rung; {:.0} instances by squares, {:.0} by ellipses; the last picture is {} the first",
        first.visible.median,
        instances[0],
        instances[1],
        last.to_baseline_db.map_or_else(|| "equal to".to_owned(), |db| format!("{db:.1} dB from"))
    )
}

pub(super) fn print_changes(changes: &[Change]) -> Result<()> {
    for change in changes {
        say!("{} against the baseline", change.title)?;
        let mut times = table(&["median ms", "before", "now", "change"]);
        let mut row = |name: &str, [before, now]: [f64; 2]| {
            let percent = format!("{:+.1} %", (now / before - 1.0) * 100.0);
            times.add_row([name.to_owned(), format!("{before:.3}"), format!("{now:.3}"), percent]);
        };
        row("frame, GPU", change.frame_ms);
        change.stages.iter().for_each(|(name, ms)| row(&format!("  {name}"), *ms));
        say_table(&times)?;
    }
    Ok(())
}
