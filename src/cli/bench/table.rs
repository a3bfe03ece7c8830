//! The tables of `smalto bench` on the terminal.

use anyhow::Result;

use crate::cli::levels::decibels;
use crate::cli::table::{say_table, table};
use crate::cli::{certified, say};
use crate::measure::bench::{
    Change, Clocks, DetailReport, DeviceReport, Protocol, Run, SplitDevice, SplitReport, Statistics, VersionReport,
    WarmUp,
};
use crate::render::Path;

/// Prints a run. `checked`: the picture was compared with the reference.
pub(super) fn print_run(run: &Run, checked: bool) -> Result<()> {
    let (subject, frame, counts) = (&run.subject, &run.frame, &run.counts);
    let scene = &subject.scene;
    let (gaussians, sh_degree) = (scene.gaussians, scene.sh_degree);
    say!("{}  {gaussians} Gaussians, SH degree {sh_degree}, {} path", subject.title(), run.drawn_by)?;
    if let Some(notice) = &run.notice {
        say!("  note: {notice}")?;
    }
    let header: Vec<_> = ["ms"].into_iter().chain(Statistics::COLUMNS).chain(["of copy bandwidth"]).collect();
    let mut times = table(&header);
    let mut row = |name: &str, s: Statistics, note: String| {
        let numbers = s.columns().map(|v| format!("{v:.3}"));
        times.add_row(std::iter::once(name.to_owned()).chain(numbers).chain([note]));
    };
    row("frame, GPU", frame.gpu_ms, String::new());
    row("frame, wall", frame.wall_ms, String::new());
    for stage in &run.stages {
        let percent = format!("{:.0} %", stage.bandwidth_fraction * 100.0);
        let note = if stage.least_bytes > 0 { percent } else { String::new() };
        row(&format!("  {}", stage.name), stage.ms, note);
    }
    say_table(&times)?;
    let (fps, cost_us) = (1e3 / frame.pipelined_ms, frame.timestamps_cost_ms * 1e3);
    say!(
        "  pipelined {:.3} ms per frame, {fps:.0} frames per second; stage timestamps cost {cost_us:.0} us; \
         {} frames of each kind",
        frame.pipelined_ms,
        run.frames
    )?;
    if let Some(together) = &run.together {
        let speeds = together.iter().map(|device| device.frames_per_second);
        let each: Vec<_> = speeds.clone().map(|speed| format!("{speed:.0}")).collect();
        let all: f64 = speeds.sum();
        say!("  together {all:.0} frames per second on {} devices: {}", each.len(), each.join(", "))?;
    }
    run.split.as_ref().map_or(Ok(()), print_split)?;
    print_warm_up(run.warm_up)?;
    // Bins are the unit of the fast paths; everything else is counted by the path that lists splats in tiles.
    let counted_by = match (counts.entries, run.drawn_by) {
        (None, _) => "",
        (Some(_), Path::FastRays) => "counted by the rays path: ",
        (Some(_), _) => "counted by the portable path: ",
    };
    counts.entries.map_or(Ok(()), |entries| say!("  {:.0} entries in bins (median)", entries.median))?;
    say!(
        "  {counted_by}{:.0} visible, {:.0} instances in {:.0} of {} tiles, longest list {:.0} (medians)",
        counts.visible.median,
        counts.instances.median,
        counts.listed_tiles.median,
        counts.tiles,
        counts.longest_list.median
    )?;
    say!(
        "  {counted_by}per pixel {:.0} listed, {:.0} evaluated, {:.0} with idle lanes; {:.0} % of the pixels stop \
         early",
        counts.listed_per_pixel.median,
        counts.evaluations_per_pixel.median,
        counts.lanes_per_pixel.median,
        counts.early_exit_rate.median * 100.0
    )?;
    if let Some(DetailReport { nodes, pages, measured_psnr, standard_error, measurement_ms, .. }) = &run.detail {
        let error = standard_error.map(|error| error.median);
        let measured = |db: Statistics| {
            format!(", {} to all Gaussians, {:.1} in the worst view", decibels(db.median, error), db.min)
        };
        say!(
            "  about {:.0} nodes in {:.0} pages of the levels{}{} (medians)",
            nodes.median,
            pages.median,
            measured_psnr.map_or_else(String::new, measured),
            measurement_ms.map_or_else(String::new, |ms| format!(", measured in {:.1} ms", ms.median))
        )?;
    }
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

/// Prints the frames that several devices drew in bands.
fn print_split(split: &SplitReport) -> Result<()> {
    let SplitReport { latency_ms, latency_alone_ms, slowest_gpu_ms, gpu_alone_ms, slowest_over_mean, devices } = split;
    let row = |name: &str, together: Statistics, alone: Statistics| {
        let faster = alone.median / together.median;
        say!("    {name:<9} {:8.3} ms, alone {:8.3} ms: {faster:.2} times", together.median, alone.median)
    };
    say!("  in bands on {} devices (medians)", devices.len())?;
    row("latency", *latency_ms, *latency_alone_ms)?;
    row("GPU", *slowest_gpu_ms, *gpu_alone_ms)?;
    say!("    the slowest band takes {:.2} times the mean", slowest_over_mean.median)?;
    for SplitDevice { device, rows, gpu_ms, wait_ms, transfer_ms, stages } in devices {
        let [rows, gpu, wait, transfer] = [rows, gpu_ms, wait_ms, transfer_ms].map(|statistics| statistics.median);
        say!("    {device}: {rows:.0} rows, GPU {gpu:.3} ms, wait {wait:.3} ms, transfer {transfer:.3} ms")?;
        let stages: Vec<_> = stages.iter().map(|stage| format!("{} {:.3}", stage.name, stage.ms)).collect();
        say!("      {}", stages.join(", "))?;
    }
    Ok(())
}

fn print_warm_up(warm_up: Option<WarmUp>) -> Result<()> {
    match warm_up {
        None => Ok(()),
        Some(WarmUp { frames, seconds, is_steady: true }) => {
            say!("  steady after {frames} warm-up frames, {seconds:.1} s")
        }
        Some(WarmUp { frames, seconds, is_steady: false }) => {
            say!("  warning: the frame time is not steady after {frames} warm-up frames, {seconds:.1} s")
        }
    }
}

/// Prints device, program and protocol.
pub(super) fn print_machine(
    device: &DeviceReport,
    smalto: &VersionReport,
    protocol: Protocol,
    path: &str,
) -> Result<()> {
    say!("{}, {}, copies at {:.0} GB/s", device.name, device.driver, device.copy_gb_s)?;
    let commit = smalto.commit.as_deref().unwrap_or("(unknown commit)");
    if let Some(cpu) = &device.cpu {
        say!("{cpu}")?;
    }
    let Protocol { warmup, frames } = protocol;
    say!("smalto {} {commit}; {warmup} warm-up frames or more, {frames} measured or fewer, {path}", smalto.version)
}

/// Prints the times of each run before and now.
pub(super) fn print_changes(changes: &[Change]) -> Result<()> {
    for change in changes {
        say!("{} compared with the baseline", change.title)?;
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
