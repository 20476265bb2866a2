//! Maximum of a function by pattern search.

/// Limits of a pattern search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PatternSearch {
    /// Number of rounds. Each round halves the steps.
    pub(crate) rounds: usize,
    /// Largest number of sweeps over the parameters in a round.
    pub(crate) sweeps: usize,
    /// Whether each successful sweep is repeated as one move (Hooke and Jeeves, *"Direct search" solution of numerical
    /// and statistical problems*, 1961).
    pub(crate) repeats_moves: bool,
}

impl PatternSearch {
    /// Maximises `score` from `start`. Varies one parameter at a time by its step. Returns the maximum and its parameters.
    pub(crate) fn maximise<const N: usize>(
        self,
        score: impl Fn([f64; N]) -> f64,
        start: [f64; N],
        mut steps: [f64; N],
    ) -> (f64, [f64; N]) {
        let mut best = start;
        let mut highest = score(best);
        for _ in 0..self.rounds {
            for _ in 0..self.sweeps {
                let (before, old) = (highest, best);
                for (index, step) in steps.into_iter().enumerate() {
                    for step in [step, -step] {
                        let mut next = best;
                        next[index] += step;
                        let value = score(next);
                        if value > highest {
                            (best, highest) = (next, value);
                            break;
                        }
                    }
                }
                if highest <= before {
                    break;
                }
                if self.repeats_moves {
                    let next = std::array::from_fn(|i| 2.0 * best[i] - old[i]);
                    let value = score(next);
                    if value > highest {
                        (best, highest) = (next, value);
                    }
                }
            }
            steps = steps.map(|step| 0.5 * step);
        }
        (highest, best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maximum_of_a_narrow_ridge_is_found() {
        // The parameters are correlated: the ridge is along (1, 1).
        let score = |[x, y]: [f64; 2]| -(x - y).powi(2) - 0.05 * (x + y - 3.0).powi(2);
        let search = PatternSearch { rounds: 8, sweeps: 30, repeats_moves: true };
        let (highest, [x, y]) = search.maximise(score, [0.0, 0.0], [0.4, 0.4]);
        assert!((x - 1.5).abs() < 0.02 && (y - 1.5).abs() < 0.02 && highest > -1e-3, "{x} {y}");
    }
}
