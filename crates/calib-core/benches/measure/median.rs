//! How much processor time work takes: what other programs do meanwhile does not count.

use cpu_time::ProcessTime;

/// Median seconds of `work` over some runs, after one to warm up.
pub(crate) fn median(runs: usize, mut work: impl FnMut()) -> f64 {
    work();
    let mut took: Vec<f64> = (0..runs)
        .map(|_| {
            let start = ProcessTime::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .collect();
    took.sort_by(f64::total_cmp);
    took[took.len() / 2]
}
