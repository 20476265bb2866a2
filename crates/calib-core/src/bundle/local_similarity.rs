//! Steps of cameras that hold to each other and to little else: along the similarities by which each turns and scales what
//! is around it, and not along their tangents.
//!
//! Let a step scale some cameras by `1 + s` and turn them by theta. Heights and yaws take that as it is, and with a floor
//! point as a complex number p, the place of one should move against that of another by `((1 + s) e^(i theta) - 1) (p' - p)`.
//! The step d, which is linear, moves it by `a (p' - p)`, `a = s + i theta`. What is between is of the second order, but it
//! turns places against yaws, which thousands of observations tell, while s and theta of a hall are what a single camera
//! tells: without it steps along such a hall stay short. What is told of a is told from camera to camera: a hall bends,
//! and one end of it turns by more than the other. So for every two cameras that see something in common
//!
//! `a = (d' - d) / (p' - p)`, `h = (1 + s) e^(i theta) - 1 - a`,
//!
//! and the corrections e of all places are those that come nearest to `e' - e = h (p' - p)`: the sum of squares of the
//! differences has the Laplacian of the graph of views as its normal equations.

use nalgebra::Complex;

use crate::camera::sin_cos;
use crate::optimize::{CholeskyFactor, SparseStructure};

/// Views, which of their places are free, and which see something in common.
#[derive(Clone, Debug)]
pub(crate) struct ViewLaplacian {
    pairs: Vec<[usize; 2]>,
    /// Number of every view among those that are free.
    numbers: Vec<Option<usize>>,
    /// Of the Laplacian.
    factor: CholeskyFactor,
}

/// What is missing of a step to a similarity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Missing {
    /// Of the place of a view.
    pub(crate) shift: Complex<f64>,
    /// And of what is around it, times its distance from there.
    pub(crate) slope: Complex<f64>,
}

impl ViewLaplacian {
    /// `None` where nothing is free or nothing is seen in common.
    pub(crate) fn new(is_free: &[bool], pairs: Vec<[usize; 2]>) -> Option<Self> {
        /// Added to the diagonal: cameras of which none is held have no first one.
        const HOLD: f64 = 1e-9;
        let mut count = 0;
        let number = |&is_free: &bool| {
            count += usize::from(is_free);
            is_free.then_some(count - usize::from(is_free))
        };
        let numbers: Vec<Option<usize>> = is_free.iter().map(number).collect();
        let both = |&[a, b]: &[usize; 2]| Some([numbers[a]?, numbers[b]?]);
        let free_pairs: Vec<[usize; 2]> = pairs.iter().filter_map(both).collect();
        let sparse = SparseStructure::new(&vec![1; count], free_pairs.iter().copied());
        let mut values = sparse.zeros();
        let mut add = |[a, b]: [usize; 2], value: f64| {
            sparse.entry([a, b]).iter().for_each(|entry| entry.add(&mut values, &[value], 1));
        };
        (0..count).for_each(|free| add([free, free], HOLD));
        free_pairs.iter().for_each(|&pair| add(pair, -1.0));
        pairs.iter().flatten().filter_map(|&view| numbers[view]).for_each(|free| add([free, free], 1.0));
        if pairs.is_empty() || count == 0 {
            return None;
        }
        let factor = sparse.factor(values)?;
        Some(Self { pairs, numbers, factor })
    }

    /// Of places and their steps.
    pub(crate) fn missing(&self, moves: &[(Complex<f64>, Complex<f64>)]) -> Vec<Missing> {
        let mut missing = vec![Missing::default(); moves.len()];
        let mut right = [vec![0.0; self.factor.unknowns()], vec![0.0; self.factor.unknowns()]];
        let mut degrees = vec![0.0; moves.len()];
        for &[from, to] in &self.pairs {
            let apart = moves[to].0 - moves[from].0;
            let slope = beyond_tangent((moves[to].1 - moves[from].1) / apart);
            let between = slope * apart;
            for (view, between) in [(from, -between), (to, between)] {
                missing[view].slope += slope;
                degrees[view] += 1.0;
                if let Some(free) = self.numbers[view] {
                    right[0][free] += between.re;
                    right[1][free] += between.im;
                }
            }
        }
        let [re, im] = right.map(|right| self.factor.solve(&right));
        for (view, missing) in missing.iter_mut().enumerate() {
            missing.slope /= f64::max(degrees[view], 1.0);
            missing.shift =
                self.numbers[view].map_or_else(Complex::default, |free| Complex::new(re[free], im[free]));
        }
        missing
    }
}

/// h; 0 where it is no small turn or scale.
fn beyond_tangent(tangent: Complex<f64>) -> Complex<f64> {
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
        fn steps_along_the_tangent_of_a_similarity_end_on_it(
            places in proptest::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64), 3..20),
            scale in -0.4..0.4_f64, turn in -0.8..0.8_f64, others in proptest::collection::vec((0..20_usize, 0..20_usize), 0..20),
            is_held in proptest::bool::ANY,
        ) {
            let count = places.len();
            let places: Vec<Complex<f64>> = places.iter().map(|&(x, y)| Complex::new(x, y)).collect();
            let chain = (1..count).map(|view| [view - 1, view]);
            let others = others.iter().map(|(a, b)| [a % count, b % count]).filter(|[a, b]| a < b);
            let pairs: Vec<[usize; 2]> = chain.chain(others).collect();
            prop_assume!(pairs.iter().all(|&[a, b]| (places[a] - places[b]).norm() > 0.1));
            let is_free: Vec<bool> = (0..count).map(|view| view > 0 || !is_held).collect();
            let moves: Vec<_> =
                places.iter().map(|&from| (from, Complex::new(scale, turn) * (from - places[0]))).collect();
            let missing = ViewLaplacian::new(&is_free, pairs).unwrap().missing(&moves);
            let to = |view: usize| moves[view].0 + moves[view].1 + missing[view].shift;
            for view in 1..count {
                // Where none is held they are where they are against each other.
                let exact = (1.0 + scale) * Complex::from_polar(1.0, turn) * (places[view] - places[0]);
                prop_assert!((to(view) - to(0) - exact).norm() < 1e-5, "{:?}", to(view) - to(0) - exact);
                let beside = Complex::new(1.0, 2.0);
                let step = Complex::new(scale, turn) * beside + missing[view].slope * beside;
                let exact = ((1.0 + scale) * Complex::from_polar(1.0, turn) - 1.0) * beside;
                prop_assert!((step - exact).norm() < 1e-9);
            }
        }

        #[test]
        fn of_the_first_order_it_changes_nothing(
            size in -17.0..-0.5_f64, scale in -1.0..1.0_f64, turn in -1.0..1.0_f64,
        ) {
            let tangent = 10.0_f64.powf(size) * Complex::new(scale, turn);
            let size = tangent.norm();
            prop_assert!(beyond_tangent(tangent).norm() <= 1.01 * size * size + 1e-15 * size);
        }
    }

    #[test]
    fn what_is_in_one_place_or_alone_moves_as_its_step_says() {
        let one = (Complex::new(3.0, 4.0), Complex::new(0.1, 0.2));
        let other = (one.0, Complex::new(0.3, 0.2));
        let missing = ViewLaplacian::new(&[true, true], vec![[0, 1]]).unwrap().missing(&[one, other]);
        assert!(missing.iter().all(|missing| missing.shift.norm() + missing.slope.norm() == 0.0));
        assert!(ViewLaplacian::new(&[true, true], Vec::new()).is_none());
        assert!(ViewLaplacian::new(&[false, false], vec![[0, 1]]).is_none());
    }
}
