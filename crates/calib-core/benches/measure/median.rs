//! Measurement of processor time, which excludes other programs.

use cpu_time::ProcessTime;

/// Returns the median time of `work` over several runs, in seconds, after one run to warm up.
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
