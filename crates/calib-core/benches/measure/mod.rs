//! What the benchmarks share: medians of one thread, one JSON object on stdout.

use std::io::Write as _;
use std::time::Instant;

/// Median seconds of `work` over some runs, after one to warm up.
pub(crate) fn median(runs: usize, mut work: impl FnMut()) -> f64 {
    work();
    let mut took: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .collect();
    took.sort_by(f64::total_cmp);
    took[took.len() / 2]
}

/// Prints `{"key": value, ...}` of the benchmarks whose key contains the first argument that is no flag.
pub(crate) fn report(benches: &[(&str, &dyn Fn() -> f64)]) {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let chosen = benches.iter().filter(|(key, _)| key.contains(&filter));
    let measured: Vec<String> = chosen.map(|(key, bench)| format!("\"{key}\": {}", bench())).collect();
    writeln!(std::io::stdout(), "{{{}}}", measured.join(", ")).expect("stdout takes the result");
}
