//! Levenberg-Marquardt minimiser for sums of squares. The normal equations may have any structure.
//!
//! At a state with the residuals `r` and their Jacobian `J`, the step `d` with the damping `lambda` solves
//!
//! `(J'J + lambda D) d = -J'r`, `D = diag(J'J)`.
//!
//! The step is between the Gauss-Newton step (`lambda = 0`) and a short gradient step. With the diagonal D as
//! metric, it does not depend on the units of the parameters (Marquardt 1963, "An Algorithm for Least-Squares
//! Estimation of Nonlinear Parameters"). A step is accepted if the cost `F = r'r` decreases. A sufficiently
//! small undamped step is accepted as the last one without an evaluation. The damping follows Nielsen (1999,
//! "Damping Parameter in Marquardt's Method", report IMM-REP-1999-05), with the gain ratio
//!
//! `rho = (F(x) - F(x + d)) / (L(0) - L(d))`, `L(0) - L(d) = d'(lambda D d - J'r)`
//!
//! of the true decrease of the cost to the decrease that the linear model L predicts. x is the current state.
//! An accepted step multiplies `lambda` by `max(1 - (2 rho - 1)^3, floor)`. Consecutive rejected steps
//! multiply it by 2, 4, 8, ... Nielsen's floor is 1/3. Here it is 1/100, so that the steps are soon
//! Gauss-Newton steps where the linear model is accurate. Only Gauss-Newton steps converge fast along weakly
//! constrained directions. In a large hall, the overall scale is constrained a million times less than the
//! relative poses of neighbouring cameras.

use argmin::core::{Error, IterState, KV, Problem, Solver, State as _, TerminationReason, TerminationStatus};

/// Least-squares problem: a cost that is a sum of squares of residuals.
pub(crate) trait LeastSquares {
    /// Values of all parameters.
    type State: Clone;
    /// Normal equations at a state.
    type Normal;

    /// Returns the damping of the first step. If it is below the default and the step is rejected, the
    /// default is tried next.
    fn first_damping(&self) -> f64 {
        FIRST_DAMPING
    }

    /// Returns the cost (sum of squares) and the normal equations at a state. Returns `None` if the model is
    /// not defined there.
    fn linearize(&self, state: &Self::State) -> Option<(f64, Self::Normal)>;

    /// Returns the state after a step. The diagonal of the normal equations is multiplied by `1 + damping`.
    /// Also returns the decrease of the cost that the linear model predicts, and the largest change of a
    /// parameter. Returns `None` if the equations have no unique solution.
    fn step(
        &self,
        state: &Self::State,
        normal: &Self::Normal,
        damping: f64,
    ) -> Option<(Self::State, f64, f64)>;
}

/// Reason for the end of a Levenberg-Marquardt run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Termination {
    /// The step, or the actual or predicted relative decrease of the cost, is below its tolerance.
    Converged,
    /// The maximum number of accepted steps is reached.
    MaxSteps,
    /// No step decreases the cost, up to the maximum damping. The cause is rounding errors near the minimum,
    /// or a start without a descent step.
    NoDecrease,
}

/// State of a Levenberg-Marquardt run.
#[derive(Clone, Debug)]
pub(crate) struct LevenbergMarquardt<P: LeastSquares> {
    /// Parameters after the last accepted step.
    pub(crate) state: P::State,
    /// Cost at the parameters. After a last step without evaluation, it is predicted by the linear model.
    pub(crate) cost: f64,
    /// Normal equations at the parameters. After a last step without evaluation, they are those before the
    /// step.
    pub(crate) normal: P::Normal,
    /// Damping lambda of the next step.
    damping: f64,
    /// Factor by which the next rejected step multiplies the damping. It doubles at each rejection, and is reset
    /// by an accepted step.
    growth: f64,
    /// Minimum damping after a rejection, until the first step is accepted; 0 afterwards.
    least_after_rejection: f64,
}

/// Default damping of the first step, as a fraction of the diagonal. With a small fraction, the step is close
/// to the Gauss-Newton step.
const FIRST_DAMPING: f64 = 1e-4;
/// Factor by which the damping increases at the first rejection after an accepted step.
const GROWTH: f64 = 2.0;

impl<P: LeastSquares> LevenbergMarquardt<P> {
    /// Starts a run at the state `start`. Returns `None` if the model is not defined there.
    pub(crate) fn new(problem: &P, start: P::State) -> Option<Self> {
        let (cost, normal) = problem.linearize(&start)?;
        Some(Self::from_normal(problem, start, cost, normal))
    }

    /// Starts a run at a state whose cost and normal equations are already computed.
    pub(crate) fn from_normal(problem: &P, state: P::State, cost: f64, normal: P::Normal) -> Self {
        let damping = problem.first_damping();
        Self { state, cost, normal, damping, growth: GROWTH, least_after_rejection: FIRST_DAMPING }
    }

    /// Whether the next step is almost a Gauss-Newton step, with no rejection since the last accepted step.
    pub(crate) fn is_undamped(&self) -> bool {
        /// Maximum damping of a step that is almost a Gauss-Newton step. It is a tenth of the weakest
        /// constraint relative to the diagonal, which is 1e-6 (see the module documentation).
        const MAX_NEGLIGIBLE_DAMPING: f64 = 1e-7;
        self.damping <= MAX_NEGLIGIBLE_DAMPING && self.growth <= GROWTH
    }

    /// Advances the run by one accepted step. Returns the reason for the end of the run, or `None` if the run
    /// continues.
    pub(crate) fn advance(&mut self, problem: &P) -> Option<Termination> {
        /// Relative decrease of the cost, actual or predicted, at or below which the run has converged. The
        /// cost of an exact scene decreases to rounding errors.
        const COST_TOLERANCE: f64 = 1e-13;
        /// Largest change of a parameter, in radians or log units, below which the run has converged. It is
        /// far below the accuracy that pixels allow.
        const STEP_TOLERANCE: f64 = 1e-11;
        /// Damping at which the run ends without a lower cost.
        const MAX_DAMPING: f64 = 1e12;
        /// Minimum factor of the damping after an accepted step: the floor of the module documentation.
        const MIN_DAMPING_FACTOR: f64 = 1e-2;
        /// Limits of an undamped step that is accepted without evaluation: the relative decrease of the cost,
        /// and the largest change of a parameter. The remaining errors are a small fraction of the limits.
        const MAX_LAST_STEP: [f64; 2] = [1e-9, 1e-4];
        while self.damping < MAX_DAMPING {
            if let Some((next, predicted, size)) = problem.step(&self.state, &self.normal, self.damping) {
                let predicts_no_decrease = (0.0..=COST_TOLERANCE * self.cost).contains(&predicted);
                if size < STEP_TOLERANCE || predicts_no_decrease {
                    return Some(Termination::Converged);
                }
                let is_last =
                    size < MAX_LAST_STEP[1] && (0.0..=MAX_LAST_STEP[0] * self.cost).contains(&predicted);
                if is_last && self.is_undamped() {
                    (self.state, self.cost) = (next, self.cost - predicted);
                    return Some(Termination::Converged);
                }
                if let Some((cost, normal)) = problem.linearize(&next).filter(|(cost, _)| *cost < self.cost) {
                    let gain = (self.cost - cost) / predicted.max(f64::MIN_POSITIVE);
                    let done = self.cost - cost <= COST_TOLERANCE * self.cost;
                    self.damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).max(MIN_DAMPING_FACTOR);
                    (self.state, self.cost, self.normal) = (next, cost, normal);
                    (self.growth, self.least_after_rejection) = (GROWTH, 0.0);
                    return done.then_some(Termination::Converged);
                }
            }
            if self.damping < self.least_after_rejection {
                self.damping = self.least_after_rejection;
            } else {
                self.damping *= self.growth;
                self.growth *= 2.0;
            }
        }
        Some(Termination::NoDecrease)
    }

    /// Advances the run by at most `max_steps` accepted steps. Returns the reason for its end.
    pub(crate) fn run(&mut self, problem: &P, max_steps: usize) -> Termination {
        (0..max_steps).find_map(|_| self.advance(problem)).unwrap_or(Termination::MaxSteps)
    }
}

/// Result of a Levenberg-Marquardt run.
pub(crate) struct Summary<P: LeastSquares> {
    /// State with the lowest cost.
    pub(crate) state: P::State,
    /// Cost at the state. After a last step without evaluation, it is predicted by the linear model.
    pub(crate) cost: f64,
    /// Normal equations at the state. After a last step without evaluation, they are those before the step.
    pub(crate) normal: P::Normal,
    /// Reason for the end of the run.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests ask whether it converged"))]
    pub(crate) ending: Termination,
}

/// Minimises the sum of squares of `problem` from the state `start`. Returns `None` if the model is not
/// defined at the start.
///
/// This function does not use argmin's executor, whose overhead exceeds the whole solve of one camera.
pub(crate) fn least_squares<P: LeastSquares>(
    problem: &P,
    start: P::State,
    max_steps: usize,
) -> Option<Summary<P>> {
    least_squares_unless(problem, start, max_steps, |_, _| false)
}

/// Minimises a sum of squares as [`least_squares`] does. Also returns `None` as soon as the run reaches a
/// state for which `is_known`, called with the state and its cost, returns true.
pub(crate) fn least_squares_unless<P: LeastSquares>(
    problem: &P,
    start: P::State,
    max_steps: usize,
    is_known: impl Fn(&P::State, f64) -> bool,
) -> Option<Summary<P>> {
    let mut run = LevenbergMarquardt::new(problem, start)?;
    let mut ending = None;
    for _ in 0..max_steps {
        ending = run.advance(problem);
        if is_known(&run.state, run.cost) {
            return None;
        }
        if ending.is_some() {
            break;
        }
    }
    let LevenbergMarquardt { state, cost, normal, .. } = run;
    Some(Summary { state, cost, normal, ending: ending.unwrap_or(Termination::MaxSteps) })
}

/// Solver interface for argmin's executor, with one accepted step for each iteration.
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
    use proptest::prelude::*;
    use std::cell::Cell;

    /// Problem with one parameter x and two residuals: the arc tangent of x, and `share x - 1`. For x above
    /// 1.39, Gauss-Newton steps of the arc tangent diverge.
    struct ArcTangent {
        first_damping: f64,
        share: f64,
        evaluations: Cell<usize>,
    }

    impl LeastSquares for ArcTangent {
        type State = f64;
        type Normal = [f64; 2];

        fn first_damping(&self) -> f64 {
            self.first_damping
        }

        fn linearize(&self, x: &f64) -> Option<(f64, [f64; 2])> {
            self.evaluations.set(self.evaluations.get() + 1);
            let (residual, by) = (x.atan(), (1.0 + x * x).recip());
            let (other, by_other) = (self.share * x - 1.0, self.share);
            let cost = residual * residual + other * other;
            Some((cost, [by * by + by_other * by_other, by * residual + by_other * other]))
        }

        fn step(&self, x: &f64, [square, gradient]: &[f64; 2], damping: f64) -> Option<(f64, f64, f64)> {
            let step = -gradient / (square * (1.0 + damping));
            let predicted = step * (damping * square * step - gradient);
            Some((x + step, predicted, step.abs()))
        }
    }

    proptest! {
        #[test]
        fn run_converges_to_a_minimum_with_its_exact_cost(
            start in -30.0..30.0_f64, first_damping in -12.0..0.0_f64, share in 0.0..0.2_f64,
        ) {
            let first_damping = 10.0_f64.powf(first_damping);
            let problem = ArcTangent { first_damping, share, evaluations: Cell::new(0) };
            let Summary { state, cost, ending, .. } = least_squares(&problem, start, 200).unwrap();
            prop_assert_eq!(ending, Termination::Converged);
            let (exact, normal) = problem.linearize(&state).unwrap();
            prop_assert!((cost - exact).abs() <= 1e-9 * exact.max(1e-9), "{cost} {exact}");
            let (_, left, _) = problem.step(&state, &normal, 0.0).unwrap();
            prop_assert!(left <= 1e-9 * exact.max(1e-9), "{left} of {exact} at {state}");
        }
    }

    #[test]
    fn small_first_damping_costs_at_most_one_evaluation() {
        let evaluations = |first_damping: f64| {
            let problem = ArcTangent { first_damping, share: 0.0, evaluations: Cell::new(0) };
            least_squares(&problem, 5.0, 200).unwrap();
            problem.evaluations.get()
        };
        let [hardly, usually] = [1e-12, FIRST_DAMPING].map(evaluations);
        assert_eq!(hardly, usually + 1, "{hardly} {usually}");
    }
}
