//! Corrections of a step that keep local similarities exact. Points of a group that are coupled mostly to each other
//! then move along the similarity, and not along its tangent.
//!
//! Let a step scale some cameras by `1 + s` and rotate them by theta (radians). Heights and yaws follow
//! exactly. Let p and p' be two floor points as complex numbers. Their difference should change by
//! `((1 + s) e^(i theta) - 1) (p' - p)`. The linear step d changes the difference by `a (p' - p)` with
//! `a = s + i theta`.
//!
//! The discrepancy between both changes is of second order, but it rotates positions against yaws. Thousands
//! of observations determine the yaws, while s and theta of a hall may be determined by a single camera.
//! Without the correction the steps along such a hall stay short. A hall also deforms: one end rotates by
//! more than the other. Therefore every point has its own a and h, from the points that share observations
//! with it:
//!
//! `a = sum conj(p' - p) (d' - d) / sum |p' - p|^2`, `h = (1 + s) e^(i theta) - 1 - a`.
//!
//! The corrections e minimise the sum of squares of `e' - e - (h + h') / 2 (p' - p)` over all pairs. The
//! normal equations are the Laplacian of the graph of the pairs. This is the scheme of Sorkine and Alexa
//! (2007, "As-Rigid-As-Possible Surface Modeling"), with similarities, applied once per step.

use nalgebra::Complex;

use crate::camera::sin_cos;
use crate::optimize::{CholeskyFactor, SparseStructure};

/// Graph of floor points: pairs that share observations, and the points that are free to be corrected.
#[derive(Clone, Debug)]
pub(crate) struct LocalSimilarities {
    /// Pairs of points that share observations.
    pairs: Vec<[usize; 2]>,
    /// Index of every point among the free points.
    free_index: Vec<Option<usize>>,
    /// Cholesky factor of the Laplacian of the free points.
    factor: CholeskyFactor,
}

/// Position of a floor point and its linear step, in metres, as complex numbers x + i y.
pub(crate) type PointStep = (Complex<f64>, Complex<f64>);

/// Correction from a linear step to a similarity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Correction {
    /// Correction of the position of the point, in metres, as a complex number x + i y.
    pub(crate) shift: Complex<f64>,
    /// Second-order part h of the similarity at the point. A neighbour of the point is corrected additionally
    /// by h times its offset from the point.
    pub(crate) similarity: Complex<f64>,
}

impl LocalSimilarities {
    /// Builds the graph; `None` without free points or pairs.
    pub(crate) fn new(is_free: &[bool], pairs: Vec<[usize; 2]>) -> Option<Self> {
        /// Regularization added to the diagonal of the Laplacian. If no point is fixed, the matrix is invertible and
        /// the mean correction is zero.
        const REGULARIZATION: f64 = 1e-9;
        if pairs.is_empty() || !is_free.contains(&true) {
            return None;
        }
        let mut count = 0;
        let number = |&is_free: &bool| {
            count += usize::from(is_free);
            is_free.then(|| count - 1)
        };
        let free_index: Vec<Option<usize>> = is_free.iter().map(number).collect();
        let both = |&[a, b]: &[usize; 2]| Some([free_index[a]?, free_index[b]?]);
        let free_pairs: Vec<[usize; 2]> = pairs.iter().filter_map(both).collect();
        let sparse = SparseStructure::new(&vec![1; count], free_pairs.iter().copied());
        let mut values = sparse.zeros();
        let mut add = |pair: [usize; 2], value: f64| {
            sparse.entry(pair).iter().for_each(|entry| entry.add(&mut values, &[value], 1));
        };
        (0..count).for_each(|free| add([free, free], REGULARIZATION));
        free_pairs.iter().for_each(|&pair| add(pair, -1.0));
        pairs.iter().flatten().filter_map(|&point| free_index[point]).for_each(|free| add([free, free], 1.0));
        let factor = sparse.factor(values)?;
        Some(Self { pairs, free_index, factor })
    }

    /// Returns the corrections of all points; `moves` contains each point with its linear step.
    pub(crate) fn corrections(&self, moves: &[PointStep]) -> Vec<Correction> {
        let apart = |[from, to]: [usize; 2]| (moves[to].0 - moves[from].0, moves[to].1 - moves[from].1);
        let mut sums = vec![(Complex::default(), 0.0); moves.len()];
        for &pair in &self.pairs {
            let (apart, moved) = apart(pair);
            for point in pair {
                sums[point].0 += apart.conj() * moved;
                sums[point].1 += apart.norm_sqr();
            }
        }
        let of_sums = |&(with, square): &(Complex<f64>, f64)| second_order_part(with / square);
        let similarities: Vec<Complex<f64>> = sums.iter().map(of_sums).collect();
        let mut right = [vec![0.0; self.factor.unknowns()], vec![0.0; self.factor.unknowns()]];
        for &[from, to] in &self.pairs {
            let between = 0.5 * (similarities[from] + similarities[to]) * apart([from, to]).0;
            for (point, between) in [(from, -between), (to, between)] {
                if let Some(free) = self.free_index[point] {
                    right[0][free] += between.re;
                    right[1][free] += between.im;
                }
            }
        }
        let [re, im] = right.map(|right| self.factor.solve(&right));
        let shift =
            |free: &Option<usize>| free.map_or(Complex::default(), |free| Complex::new(re[free], im[free]));
        let shifts = self.free_index.iter().map(shift);
        shifts.zip(similarities).map(|(shift, similarity)| Correction { shift, similarity }).collect()
    }
}

/// Returns the second-order part h of the similarity with tangent a; 0 if rotation and scale are not small.
fn second_order_part(tangent: Complex<f64>) -> Complex<f64> {
    let Complex { re: s, im: theta } = tangent;
    let is_small = tangent.norm_sqr() < 1.0;
    if !is_small {
        return Complex::default();
    }
    let [(sin, _), (half, _)] = [theta, 0.5 * theta].map(sin_cos);
    Complex::new(-2.0 * (1.0 + s) * half * half, (1.0 + s) * sin - theta)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn corrected_tangent_step_follows_the_similarity(
            places in proptest::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64), 3..20),
            scale in -0.4..0.4_f64, turn in -0.8..0.8_f64, others in proptest::collection::vec((0..20_usize, 0..20_usize), 0..20),
            is_fixed in proptest::bool::ANY,
        ) {
            let count = places.len();
            let places: Vec<Complex<f64>> = places.iter().map(|&(x, y)| Complex::new(x, y)).collect();
            let chain = (1..count).map(|view| [view - 1, view]);
            let others = others.iter().map(|(a, b)| [a % count, b % count]).filter(|[a, b]| a < b);
            let pairs: Vec<[usize; 2]> = chain.chain(others).collect();
            prop_assume!(pairs.iter().all(|&[a, b]| (places[a] - places[b]).norm() > 0.1));
            let is_free: Vec<bool> = (0..count).map(|view| view > 0 || !is_fixed).collect();
            let moves: Vec<_> =
                places.iter().map(|&from| (from, Complex::new(scale, turn) * (from - places[0]))).collect();
            let corrections = LocalSimilarities::new(&is_free, pairs).unwrap().corrections(&moves);
            let to = |view: usize| moves[view].0 + moves[view].1 + corrections[view].shift;
            if is_fixed {
                prop_assert_eq!(to(0), places[0]);
            }
            for view in 1..count {
                // If no point is fixed, only relative positions are determined.
                let exact = (1.0 + scale) * Complex::from_polar(1.0, turn) * (places[view] - places[0]);
                prop_assert!((to(view) - to(0) - exact).norm() < 1e-5, "{:?}", to(view) - to(0) - exact);
                let offset = Complex::new(1.0, 2.0);
                let step = Complex::new(scale, turn) * offset + corrections[view].similarity * offset;
                let exact = ((1.0 + scale) * Complex::from_polar(1.0, turn) - 1.0) * offset;
                prop_assert!((step - exact).norm() < 1e-9);
            }
        }

        #[test]
        fn correction_is_of_second_order(
            size in -17.0..-0.5_f64, scale in -1.0..1.0_f64, turn in -1.0..1.0_f64,
        ) {
            let tangent = 10.0_f64.powf(size) * Complex::new(scale, turn);
            let size = tangent.norm();
            prop_assert!(second_order_part(tangent).norm() <= 1.01 * size * size + 1e-15 * size);
        }
    }

    #[test]
    fn coincident_or_isolated_points_are_not_corrected() {
        let one = (Complex::new(3.0, 4.0), Complex::new(0.1, 0.2));
        let other = (one.0, Complex::new(0.3, 0.2));
        let corrections =
            LocalSimilarities::new(&[true, true], vec![[0, 1]]).unwrap().corrections(&[one, other]);
        assert!(corrections.iter().all(|of| of.shift.norm() + of.similarity.norm() == 0.0));
        assert!(LocalSimilarities::new(&[true, true], Vec::new()).is_none());
        assert!(LocalSimilarities::new(&[false, false], vec![[0, 1]]).is_none());
    }
}
