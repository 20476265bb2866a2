//! Common part of the benchmarks: single-threaded medians, and one JSON object on stdout.

mod median;

use std::io::Write as _;

pub(crate) use median::median;

/// Prints `{"key": value, ...}` for the benchmarks whose key contains the first argument that is not a flag.
pub(crate) fn report(benches: &[(&str, &dyn Fn() -> f64)]) {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let chosen = benches.iter().filter(|(key, _)| key.contains(&filter));
    let measured: Vec<String> = chosen.map(|(key, bench)| format!("\"{key}\": {}", bench())).collect();
    writeln!(std::io::stdout(), "{{{}}}", measured.join(", ")).expect("stdout takes the result");
}
