//! GPU time per scope, from timestamp queries.

/// The GPU time of a scope of commands.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    pub name: &'static str,
    /// 0 for an outermost scope.
    pub depth: usize,
    /// Milliseconds after the first timestamp of its command buffer.
    pub start_ms: f64,
    pub duration_ms: f64,
}

/// A scope and its two queries.
pub(super) struct Scope {
    pub name: &'static str,
    pub depth: usize,
    pub first_query: u32,
    pub last_query: u32,
}

/// Converts the ticks of all queries to times. The low `valid_bits` of a tick count are valid; a tick takes `tick_ns`
/// nanoseconds.
pub(super) fn timings(scopes: &[Scope], ticks: &[u64], valid_bits: u32, tick_ns: f32) -> Vec<Timing> {
    let mask = if valid_bits >= 64 { u64::MAX } else { (1 << valid_bits) - 1 };
    let milliseconds = |from: u32, to: u32| {
        (ticks[to as usize].wrapping_sub(ticks[from as usize]) & mask) as f64 * f64::from(tick_ns) * 1e-6
    };
    let origin = scopes.iter().map(|s| s.first_query).min().unwrap_or(0);
    let timing = |scope: &Scope| Timing {
        name: scope.name,
        depth: scope.depth,
        start_ms: milliseconds(origin, scope.first_query),
        duration_ms: milliseconds(scope.first_query, scope.last_query),
    };
    scopes.iter().map(timing).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timings_survive_a_wrapping_tick_counter() {
        let scopes = [Scope { name: "a", depth: 0, first_query: 0, last_query: 1 }];
        let ticks = [(1 << 36) - 1_000_000, 1_000_000];
        let measured = timings(&scopes, &ticks, 36, 1.0);
        assert_eq!(measured, [Timing { name: "a", depth: 0, start_ms: 0.0, duration_ms: 2.0 }]);
    }
}
