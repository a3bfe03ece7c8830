//! Signals that end the program: unfinished files are removed first.

use crate::host_memory::OutOfMemory;

/// From now on, Ctrl-C, SIGTERM and SIGHUP remove unfinished files before they end the program, as by default: with
/// status 130, 143 and 129 in a shell. A write beyond the file size limit of the shell becomes an error.
///
/// # Errors
/// If the system refuses the thread that waits for them.
#[cfg(unix)]
pub(super) fn clean_up_on_signals() -> Result<(), OutOfMemory> {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::emulate_default_handler;

    // Without a handler, the signal would end the program.
    _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
    let ignored = ignored_signals();
    let handled = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
    // Without handlers, later runs remove the files.
    let Ok(mut signals) = Signals::new(handled) else { return Ok(()) };
    // A signal that nobody waits for would be lost.
    crate::threads::spawn(move || {
        for signal in signals.forever() {
            let _files = crate::files::remove_unfinished();
            _ = emulate_default_handler(signal);
        }
    })
    .map(drop)
}

#[cfg(not(unix))]
pub(super) fn clean_up_on_signals() -> Result<(), OutOfMemory> {
    Ok(())
}

/// The signals that whoever started the program has it ignore, as nohup does with SIGHUP: bit N-1 is signal N. Only
/// Linux tells without unsafe code.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}
