use super::*;
use crate::camera::{FloorPoint, Plane};
use crate::optimize::{LevenbergMarquardt, Summary, Termination, least_squares};
use crate::single::PlanePrior;
use crate::single::annotation::Known;
use crate::single::constraints::Endpoint;
use crate::single::residual::Angles;
use crate::single::scene_errors::{Deviation, SceneErrors};
use proptest::prelude::*;

fn any_end() -> impl Strategy<Value = Endpoint> {
    ([-900.0..900.0_f64, 50.0..500.0_f64], 0.6..1.5_f64, -0.2..0.2_f64, 0.6..1.5_f64).prop_map(
        |(point, a, b, d)| Endpoint { point, covariance: [a * a + b * b, b * (a + d), d * d + b * b] },
    )
}

/// Returns a plane with a slope of about three degrees.
fn ramp() -> PlanePrior {
    let plane = Plane { height: 0.3, slope: [0.05, 0.0], anchor: FloorPoint::default() };
    PlanePrior { id: "ramp".into(), plane, along: [1.0, 0.0], sigma: [0.1, 0.02, 0.01] }
}

fn source(segment: usize) -> Source {
    Source { annotation: 0, segment }
}

/// Returns a length of a group; every second length of the first group is on a plane.
fn length((index, (ends, group)): (usize, ([Endpoint; 2], usize))) -> LengthConstraint {
    let plane = (group == 0 && index % 2 == 0).then_some(0);
    let is_mark = plane.is_none();
    LengthConstraint { chart: None, ends, group, spread: 0.01, is_mark, plane, source: source(100 + index) }
}

/// Returns random constraints: the Jacobian must also be correct for large residuals.
fn any_constraints() -> impl Strategy<Value = Constraints> {
    let lines = proptest::collection::vec(([any_end(), any_end()], 0..3_usize, any::<bool>()), 3..12);
    let lengths = proptest::collection::vec(([any_end(), any_end()], 0..3_usize), 0..6);
    let uprights = proptest::collection::vec((any_end(), any_end(), 1.0..2.0_f64), 0..3);
    (lines, lengths, uprights).prop_map(|(lines, lengths, uprights)| {
        let direction = |group: usize, orthogonal| match group {
            0 => Direction::Vertical,
            _ => Direction::Floor { group: group - 1, orthogonal },
        };
        Constraints {
            lines: lines
                .into_iter()
                .enumerate()
                .map(|(i, (ends, group, orthogonal))| LineConstraint {
                    chart: None,
                    ends,
                    direction: direction(group, orthogonal),
                    // Lines at right angles to the first group and lines along the second group deviate.
                    deviation: match group {
                        1 if orthogonal => Some(0),
                        2 if !orthogonal => Some(1),
                        _ => None,
                    },
                    source: source(i),
                })
                .collect(),
            groups: 2,
            lengths: lengths.into_iter().enumerate().map(length).collect(),
            length_groups: vec![None, Some(Known::fixed(2.0)), Some(Known::prior(3.0, 0.1))],
            uprights: uprights
                .into_iter()
                .enumerate()
                .map(|(i, (foot, head, height))| {
                    let height = Known::prior(height, 0.05);
                    let plane = (i == 1).then_some(0);
                    UprightConstraint { chart: None, foot, head, height, plane, source: source(200 + i) }
                })
                .collect(),
            deviations: vec![
                Deviation { group: 0, orthogonal: true, azimuth: 0.01, level: 0.005, plane: None },
                Deviation { group: 1, orthogonal: false, azimuth: 0.0, level: 0.005, plane: Some(0) },
            ],
            planes: vec![AnnotatedPlane { index: 0, prior: ramp() }],
            scene: SceneErrors { floor_tilt: 0.02, crossfall: 0.03, ..SceneErrors::EXACT },
            repeats: crate::single::Repeats::NONE,
            sigma_px: Vec::new(),
            invalid: Vec::new(),
        }
    })
}

/// Returns a camera above the heads of all uprights; a head beside the camera is not in the image.
fn any_core() -> impl Strategy<Value = Parameters> {
    (-0.3..0.3_f64, 0.3..1.4_f64, 600.0..2500.0_f64, 2.5..6.0_f64)
        .prop_map(|(r, p, f, z)| [r, p, f.ln(), z.ln()])
}

fn residuals(problem: &Problem, state: &State) -> Option<Vec<(f64, Vec<f64>)>> {
    let mut rows = Vec::new();
    problem.each_residual(state, |residual: Dual, nuisance, _| {
        let mut row = residual.gradient[..4].to_vec();
        row.resize(4 + state.nuisance.len(), 0.0);
        nuisance.entries().iter().for_each(|&(index, derivative)| row[4 + index] += derivative);
        rows.push((residual.value, row));
    })?;
    Some(rows)
}

fn nudged(state: &State, index: usize, by: f64) -> State {
    let mut state = state.clone();
    match index {
        0..4 => state.parameters[index] += by,
        _ => state.nuisance[index - 4] += by,
    }
    state
}

fn priors() -> Priors {
    let prior = |value, sigma| Some(Prior { value, sigma });
    Priors {
        roll: prior(0.1, 0.02),
        pitch: prior(0.5, 0.1),
        focal: prior(1200.0, 50.0),
        height: prior(3.0, 0.2),
        weak_log_focal: prior(7.0, 0.35),
    }
}

proptest! {
    #[test]
    fn jacobian_matches_finite_differences(constraints in any_constraints(), parameters in any_core()) {
        const STEP: f64 = 1e-6;
        let problem = Problem::new(&constraints, FixedParameters::default(), priors(), 0.7, 1920.0);
        let state = problem.state_at(parameters);
        let own = problem.nuisances().deviation(0);
        let state = state.map(|mut state| {
            let errors = state.nuisance[own..].iter_mut().enumerate();
            errors.for_each(|(i, value)| *value = 0.003 * (i as f64 - 2.0));
            state
        });
        // A state must have a finite cost: the minimiser accepts no other.
        prop_assume!(state.as_ref().is_some_and(|state| problem.normal(state).is_some()));
        let Some(state) = state else { return Ok(()) };
        let rows = residuals(&problem, &state).unwrap_or_default();
        let used = problem.used();
        for index in (0..4 + state.nuisance.len()).filter(|&index| index < 4 || used[index - 4]) {
            let central = |step: f64| {
                let ahead = residuals(&problem, &nudged(&state, index, step))?;
                let behind = residuals(&problem, &nudged(&state, index, -step))?;
                let quotient = |((a, _), (b, _)): (&(f64, _), &(f64, _))| (a - b) / (2.0 * step);
                Some(ahead.iter().zip(&behind).map(quotient).collect::<Vec<f64>>())
            };
            let (Some(whole), Some(half)) = (central(STEP), central(0.5 * STEP)) else { continue };
            for (k, (residual, row)) in rows.iter().enumerate() {
                let scale = 1.0 + row[index].abs() + residual.abs();
                // At a kink, or with a head almost beside the camera, differences have not converged and are
                // skipped.
                if (whole[k] - half[k]).abs() > 1e-3 * scale {
                    continue;
                }
                // Richardson's extrapolation: rounding 1e-10 of the value, no error of second order in the
                // step.
                let numeric = (4.0 * half[k] - whole[k]) / 3.0;
                prop_assert!((numeric - row[index]).abs() < 2e-4 * scale, "residual {k} by {index}: {numeric} {}", row[index]);
            }
        }
    }

    #[test]
    fn minimiser_agrees_with_the_levenberg_marquardt_crate(
        parameters in any_core(), nudge in [-0.03..0.03_f64, -0.05..0.05_f64, -0.1..0.1_f64],
        drawn in proptest::collection::vec(([-900.0..900.0_f64, -300.0..500.0_f64], 0.1..0.4_f64, -2.0..2.0_f64), 9..16),
    ) {
        let constraints = drawn_toward(&parameters, &drawn);
        let problem = Problem::new(&constraints, FixedParameters::default(), priors(), 1.0, 1920.0);
        let start = [parameters[0] + nudge[0], parameters[1] + nudge[1], parameters[2] + nudge[2], parameters[3]];
        let Some(start) = problem.state_at(start) else { return Ok(()) };
        let Summary { cost, ending, .. } = least_squares(&problem, start.clone(), 200).unwrap();
        prop_assert!(ending != Termination::MaxSteps);
        let oracle = levenberg_marquardt::LevenbergMarquardt::new();
        let (_, report) = oracle.minimize(Oracle { problem: &problem, state: start });
        let theirs = 2.0 * report.objective_function;
        prop_assert!((theirs - cost).abs() < 1e-7 * cost + 1e-12, "{theirs} from the crate, {cost} from ours");
    }
}

/// Returns lines toward the vertical and two floor directions, with noise across them.
///
/// No line is near its vanishing point, because such lines cause local minima.
fn drawn_toward(parameters: &Parameters, drawn: &[([f64; 2], f64, f64)]) -> Constraints {
    let angles = Angles::new(parameters);
    let end = |point| Endpoint { point, covariance: [1.0, 0.0, 1.0] };
    let lines = drawn.iter().enumerate().filter_map(|(i, &(a, share, noise))| {
        let (direction, v) = match i % 3 {
            0 => (Direction::Vertical, angles.nadir([0.0; 2]).at),
            1 => (Direction::Floor { group: 0, orthogonal: false }, angles.floor(0.7, 0.0).at),
            _ => (
                Direction::Floor { group: 0, orthogonal: true },
                angles.floor(0.7 + std::f64::consts::FRAC_PI_2, 0.0).at,
            ),
        };
        let way = [v[0] - a[0] * v[2], v[1] - a[1] * v[2]];
        let length = way[0].hypot(way[1]);
        if length < 500.0 * v[2].abs() {
            return None;
        }
        let step = 700.0 * share / length;
        let b =
            [a[0] + step * way[0] - noise * way[1] / length, a[1] + step * way[1] + noise * way[0] / length];
        Some(LineConstraint {
            chart: None,
            ends: [end(a), end(b)],
            direction,
            deviation: None,
            source: source(i),
        })
    });
    Constraints { lines: lines.collect(), groups: 1, ..Constraints::default() }
}

/// Least-squares problem in the interface of the levenberg-marquardt crate.
struct Oracle<'a> {
    problem: &'a Problem<'a>,
    state: State,
}

impl levenberg_marquardt::LeastSquaresProblem<f64, nalgebra::Dyn, nalgebra::Dyn> for Oracle<'_> {
    type ParameterStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::U1>;
    type ResidualStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::U1>;
    type JacobianStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::Dyn>;

    fn set_params(&mut self, x: &nalgebra::DVector<f64>) {
        self.state.parameters.copy_from_slice(&x.as_slice()[..4]);
        self.state.nuisance.copy_from_slice(&x.as_slice()[4..]);
    }
    fn params(&self) -> nalgebra::DVector<f64> {
        nalgebra::DVector::from_iterator(
            4 + self.state.nuisance.len(),
            self.state.parameters.iter().chain(&self.state.nuisance).copied(),
        )
    }
    fn residuals(&self) -> Option<nalgebra::DVector<f64>> {
        let rows = residuals(self.problem, &self.state)?;
        Some(nalgebra::DVector::from_iterator(rows.len(), rows.iter().map(|(residual, _)| *residual)))
    }
    fn jacobian(&self) -> Option<nalgebra::DMatrix<f64>> {
        let rows = residuals(self.problem, &self.state)?;
        Some(nalgebra::DMatrix::from_fn(rows.len(), 4 + self.state.nuisance.len(), |i, j| rows[i].1[j]))
    }
}

#[test]
fn argmin_executor_finds_the_same_minimum() {
    let end = |point| Endpoint { point, covariance: [1.0, 0.0, 1.0] };
    let line = |a, b, direction, i| LineConstraint {
        chart: None,
        ends: [end(a), end(b)],
        direction,
        deviation: None,
        source: source(i),
    };
    let floor = Direction::Floor { group: 0, orthogonal: false };
    let constraints = Constraints {
        lines: vec![
            line([-500.0, -200.0], [-430.0, 200.0], Direction::Vertical, 0),
            line([480.0, -210.0], [400.0, 220.0], Direction::Vertical, 1),
            line([-300.0, 400.0], [-100.0, 0.0], floor, 2),
            line([500.0, 390.0], [120.0, 10.0], floor, 3),
        ],
        groups: 1,
        ..Constraints::default()
    };
    let problem = Problem::new(&constraints, FixedParameters::default(), priors(), 1.0, 1920.0);
    let start = problem.state_at([0.0, 0.5, 1500_f64.ln(), 3_f64.ln()]).unwrap();
    let Summary { state: direct, cost, .. } = least_squares(&problem, start.clone(), 100).unwrap();
    let solver = LevenbergMarquardt::new(&problem, start.clone()).unwrap();
    let run = argmin::core::Executor::new(problem.clone(), solver)
        .configure(|state| state.param(start).max_iters(100))
        .run()
        .unwrap();
    assert!((run.state.best_cost - cost).abs() < 1e-9 * cost);
    assert!((run.state.best_param.unwrap().parameters[PITCH] - direct.parameters[PITCH]).abs() < 1e-9);
}
