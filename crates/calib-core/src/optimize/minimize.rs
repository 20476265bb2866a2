//! Minimisers: the only module that knows `argmin`.

use argmin::core::{
    CostFunction, Error, Executor, IterState, KV, Problem, Solver, State as _, TerminationReason,
    TerminationStatus,
};
use argmin::solver::neldermead::NelderMead;
use nalgebra::Vector2;

/// What stands in for the cost of impossible geometry: argmin turns infinities into NaN.
const IMPOSSIBLE: f64 = 1e30;

/// A point of two unknowns, with the three operations a simplex needs.
#[derive(Clone, Copy, Debug)]
struct Vertex(Vector2<f64>);

impl argmin_math::ArgminAdd<Self, Self> for Vertex {
    fn add(&self, other: &Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl argmin_math::ArgminSub<Self, Self> for Vertex {
    fn sub(&self, other: &Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl argmin_math::ArgminMul<f64, Self> for Vertex {
    fn mul(&self, factor: &f64) -> Self {
        Self(self.0 * *factor)
    }
}

struct Cost<F>(F);

impl<F: Fn([f64; 2]) -> f64> CostFunction for Cost<F> {
    type Param = Vertex;
    type Output = f64;
    fn cost(&self, vertex: &Vertex) -> Result<f64, Error> {
        let cost = (self.0)([vertex.0.x, vertex.0.y]);
        Ok(if cost.is_finite() { cost.min(IMPOSSIBLE) } else { IMPOSSIBLE })
    }
}

/// The lowest point found by Nelder-Mead from a simplex at `start` with edges `size`, and its cost.
///
/// A `size` of 0 holds that unknown. `None` when every vertex of the simplex is impossible.
pub(crate) fn nelder_mead(
    cost: impl Fn([f64; 2]) -> f64,
    start: [f64; 2],
    size: [f64; 2],
) -> Option<([f64; 2], f64)> {
    /// Standard deviation of the costs in the simplex at which it has converged. The paper's
    /// criterion is first order in some angles: 1e-13 of it is 1e-13 rad.
    const TOLERANCE: f64 = 1e-13;
    /// Nelder-Mead may stall on a ridge: restarting with a fresh simplex gets it going.
    const RESTARTS: usize = 4;
    const ROUNDS: u64 = 400;

    let mut best = (start, cost(start));
    for restart in 0..RESTARTS {
        let shrink = 0.1_f64.powi(i32::try_from(restart).unwrap_or(0));
        let corner = Vector2::from(best.0);
        let mut simplex = vec![Vertex(corner)];
        for axis in (0..2).filter(|&axis| size[axis] != 0.0) {
            let mut moved = corner;
            moved[axis] += size[axis] * shrink;
            simplex.push(Vertex(moved));
        }
        let solver = NelderMead::new(simplex).with_sd_tolerance(TOLERANCE).ok()?;
        let run = Executor::new(Cost(&cost), solver).configure(|state| state.max_iters(ROUNDS)).run().ok()?;
        let lowest = run.state.best_param?;
        let improved = best.1 - run.state.best_cost;
        if run.state.best_cost < best.1 || !best.1.is_finite() {
            best = ([lowest.0.x, lowest.0.y], run.state.best_cost);
        }
        if improved.abs() < TOLERANCE {
            break;
        }
    }
    (best.1 < IMPOSSIBLE).then_some(best)
}

/// A sum of squares with normal equations of whatever structure.
pub(crate) trait LeastSquares {
    /// A value for every unknown.
    type State: Clone;
    /// The problem made linear around a state.
    type Normal;

    /// Cost (sum of squares) and normal equations; `None` where the model is impossible.
    fn linearize(&self, state: &Self::State) -> Option<(f64, Self::Normal)>;

    /// The state after a step with `damping` times the diagonal added, the gain that the linear
    /// model promises for it, and the largest change of an unknown; `None` when it has no solution.
    fn step(
        &self,
        state: &Self::State,
        normal: &Self::Normal,
        damping: f64,
    ) -> Option<(Self::State, f64, f64)>;
}

/// How a Levenberg-Marquardt run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Termination {
    /// The cost does not fall any more: its relative change or the step is rounding.
    Converged,
    /// The rounds ran out.
    OutOfRounds,
    /// No damping gives a lower cost: rounding near the minimum, or a start where nothing moves.
    Stuck,
}

/// Levenberg-Marquardt with the diagonal as metric (Marquardt 1963) and the damping of Nielsen (1999).
#[derive(Clone, Debug)]
pub(crate) struct LevenbergMarquardt<P: LeastSquares> {
    pub(crate) state: P::State,
    pub(crate) cost: f64,
    normal: P::Normal,
    damping: f64,
    growth: f64,
}

impl<P: LeastSquares> LevenbergMarquardt<P> {
    /// `None` when the start is impossible.
    pub(crate) fn new(problem: &P, start: P::State) -> Option<Self> {
        let (cost, normal) = problem.linearize(&start)?;
        // Starts are near: a small share of the diagonal lets the first step be almost Newton's.
        Some(Self { state: start, cost, normal, damping: 1e-4, growth: 2.0 })
    }

    /// One accepted step, or the ending.
    pub(crate) fn advance(&mut self, problem: &P) -> Option<Termination> {
        /// Relative to the cost; squared residuals of exact scenes go down to rounding.
        const TOLERANCE: f64 = 1e-13;
        /// Radians, log units: far below what any pixel tells.
        const STEP: f64 = 1e-11;
        const MOST_DAMPING: f64 = 1e12;
        while self.damping < MOST_DAMPING {
            let stepped = problem.step(&self.state, &self.normal, self.damping);
            let tried = stepped.and_then(|(next, promised, size)| {
                if size < STEP {
                    return Some(Err(Termination::Converged));
                }
                let (cost, normal) = problem.linearize(&next)?;
                (cost < self.cost).then_some(Ok((next, promised, cost, normal)))
            });
            match tried {
                Some(Err(ending)) => return Some(ending),
                Some(Ok((next, promised, cost, normal))) => {
                    let gain = (self.cost - cost) / promised.max(f64::MIN_POSITIVE);
                    let done = self.cost - cost <= TOLERANCE * self.cost;
                    self.damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).max(0.1);
                    (self.state, self.cost, self.normal, self.growth) = (next, cost, normal, 2.0);
                    return done.then_some(Termination::Converged);
                }
                None => {
                    self.damping *= self.growth;
                    self.growth *= 2.0;
                }
            }
        }
        Some(Termination::Stuck)
    }
}

/// Where a run ended.
pub(crate) struct Summary<P: LeastSquares> {
    /// The lowest state.
    pub(crate) state: P::State,
    pub(crate) cost: f64,
    /// The problem made linear there.
    pub(crate) normal: P::Normal,
    #[cfg_attr(not(test), expect(dead_code, reason = "whether it converged is what tests ask"))]
    pub(crate) ending: Termination,
}

/// The lowest state reached from `start`; `None` when the start is impossible.
///
/// The step is driven without argmin's executor, which costs more than a whole solve of one camera.
pub(crate) fn least_squares<P: LeastSquares>(
    problem: &P,
    start: P::State,
    rounds: usize,
) -> Option<Summary<P>> {
    let mut solver = LevenbergMarquardt::new(problem, start)?;
    let ending = (0..rounds).find_map(|_| solver.advance(problem)).unwrap_or(Termination::OutOfRounds);
    let LevenbergMarquardt { state, cost, normal, .. } = solver;
    Some(Summary { state, cost, normal, ending })
}

/// Runs inside argmin's executor, one accepted step an iteration.
impl<P> Solver<P, IterState<P::State, (), (), (), (), f64>> for LevenbergMarquardt<P>
where
    P: LeastSquares,
{
    fn name(&self) -> &str {
        "Levenberg-Marquardt"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<P>,
        state: IterState<P::State, (), (), (), (), f64>,
    ) -> Result<(IterState<P::State, (), (), (), (), f64>, Option<KV>), Error> {
        let ending = problem.problem.as_ref().and_then(|problem| self.advance(problem));
        let state = state.param(self.state.clone()).cost(self.cost);
        Ok(match ending {
            Some(Termination::Converged) => (state.terminate_with(TerminationReason::SolverConverged), None),
            Some(_) => (state.terminate_with(TerminationReason::SolverExit("no lower cost".into())), None),
            None => (state, None),
        })
    }

    fn terminate(&mut self, state: &IterState<P::State, (), (), (), (), f64>) -> TerminationStatus {
        state.get_termination_status().clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_valley_of_rosenbrock_is_walked_to_its_end() {
        let rosenbrock = |[x, y]: [f64; 2]| (1.0 - x).powi(2) + 100.0 * (y - x * x).powi(2);
        let (lowest, _) = nelder_mead(rosenbrock, [-1.2, 1.0], [0.1, 0.1]).unwrap();
        assert!((lowest[0] - 1.0).abs() + (lowest[1] - 1.0).abs() < 1e-6, "{lowest:?}");
    }

    #[test]
    fn a_held_unknown_stays() {
        let (lowest, _) = nelder_mead(|[x, y]| x * x + (y - 3.0).powi(2), [1.0, 1.0], [0.0, 0.1]).unwrap();
        assert_eq!(lowest[0], 1.0);
        assert!((lowest[1] - 3.0).abs() < 1e-6, "{lowest:?}");
    }

    #[test]
    fn a_cost_that_is_impossible_everywhere_has_no_minimum() {
        assert!(nelder_mead(|_| f64::NAN, [0.0, 0.0], [1.0, 1.0]).is_none());
    }
}
