//! Simplex method of Nelder and Mead (1965) in two parameters, for cost functions without derivatives.

use argmin::core::{CostFunction, Error, Executor};
use argmin::solver::neldermead::NelderMead;
use nalgebra::Vector2;

/// Cost that replaces infinite and NaN costs, from which argmin would compute NaN. Larger finite costs are
/// limited to it.
const UNDEFINED_COST: f64 = 1e30;

/// Vertex of the simplex: a point in two dimensions, with the three operations of the simplex method.
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

/// Cost function, in the interface of argmin.
struct Cost<F>(F);

impl<F: Fn([f64; 2]) -> f64> CostFunction for Cost<F> {
    type Param = Vertex;
    type Output = f64;
    fn cost(&self, vertex: &Vertex) -> Result<f64, Error> {
        let cost = (self.0)([vertex.0.x, vertex.0.y]);
        Ok(if cost.is_finite() { cost.min(UNDEFINED_COST) } else { UNDEFINED_COST })
    }
}

/// Minimises a cost function. Returns the point with the lowest cost, and this cost. The first simplex has a
/// vertex at `start` and an edge of length `size` along each parameter.
///
/// A parameter of `size` 0 does not change. Returns `None` if the cost of all vertices is infinite or NaN.
pub(crate) fn nelder_mead(
    cost: impl Fn([f64; 2]) -> f64,
    start: [f64; 2],
    size: [f64; 2],
) -> Option<([f64; 2], f64)> {
    /// Largest standard deviation of the costs at the vertices of a converged simplex. The paper's criterion
    /// is first order in some angles: a difference of 1e-13 corresponds to 1e-13 rad.
    const TOLERANCE: f64 = 1e-13;
    /// Maximum number of runs. The simplex may collapse before it reaches a minimum. Each further run
    /// therefore starts at the best point, with a tenth of the previous size.
    const MAX_RUNS: usize = 4;
    /// Maximum number of iterations of one run.
    const MAX_ITERATIONS: u64 = 400;

    let mut best = (start, cost(start));
    for restart in 0..MAX_RUNS {
        let shrink = 0.1_f64.powi(i32::try_from(restart).unwrap_or(0));
        let corner = Vector2::from(best.0);
        let mut simplex = vec![Vertex(corner)];
        for axis in (0..2).filter(|&axis| size[axis] != 0.0) {
            let mut moved = corner;
            moved[axis] += size[axis] * shrink;
            simplex.push(Vertex(moved));
        }
        let solver = NelderMead::new(simplex).with_sd_tolerance(TOLERANCE).ok()?;
        let run = Executor::new(Cost(&cost), solver)
            .configure(|state| state.max_iters(MAX_ITERATIONS))
            .run()
            .ok()?;
        let lowest = run.state.best_param?;
        let improved = best.1 - run.state.best_cost;
        if run.state.best_cost < best.1 || !best.1.is_finite() {
            best = ([lowest.0.x, lowest.0.y], run.state.best_cost);
        }
        if improved.abs() < TOLERANCE {
            break;
        }
    }
    (best.1 < UNDEFINED_COST).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rosenbrock_minimum_is_found() {
        let rosenbrock = |[x, y]: [f64; 2]| (1.0 - x).powi(2) + 100.0 * (y - x * x).powi(2);
        let (lowest, _) = nelder_mead(rosenbrock, [-1.2, 1.0], [0.1, 0.1]).unwrap();
        assert!((lowest[0] - 1.0).abs() + (lowest[1] - 1.0).abs() < 1e-6, "{lowest:?}");
    }

    #[test]
    fn parameter_of_size_zero_does_not_move() {
        let (lowest, _) = nelder_mead(|[x, y]| x * x + (y - 3.0).powi(2), [1.0, 1.0], [0.0, 0.1]).unwrap();
        assert_eq!(lowest[0], 1.0);
        assert!((lowest[1] - 3.0).abs() < 1e-6, "{lowest:?}");
    }

    #[test]
    fn undefined_cost_has_no_minimum() {
        assert!(nelder_mead(|_| f64::NAN, [0.0, 0.0], [1.0, 1.0]).is_none());
    }
}
