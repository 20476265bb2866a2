//! Steps of places that hold to each other and to little else: along the similarities by which each turns and scales what is
//! around it, and not along their tangents.
//!
//! Let a step scale some cameras by `1 + s` and turn them by theta. Heights and yaws take that as it is, and with a floor
//! point as a complex number p, one place should move against another by `((1 + s) e^(i theta) - 1) (p' - p)`. The step d,
//! which is linear, moves it by `a (p' - p)`, `a = s + i theta`. What is between is of the second order, but it turns places
//! against yaws, which thousands of observations tell, while s and theta of a hall are what a single camera tells: without
//! it steps along such a hall stay short. A hall bends, too: one end of it turns by more than the other. So of every place,
//! with the places that see something in common with it,
//!
//! `a = sum conj(p' - p) (d' - d) / sum |p' - p|^2`, `h = (1 + s) e^(i theta) - 1 - a`,
//!
//! and the corrections e are those that come nearest to `e' - e = (h + h') / 2 (p' - p)` for every two of them: the sum of
//! squares of what is left has the Laplacian of their graph as its normal equations. That is the scheme of Sorkine and Alexa
//! (2007, "As-Rigid-As-Possible Surface Modeling"), with similarities, once a step.

use nalgebra::Complex;

use crate::camera::sin_cos;
use crate::optimize::{CholeskyFactor, SparseStructure};

/// Places, which of them are free to be corrected, and which see something in common.
#[derive(Clone, Debug)]
pub(crate) struct LocalSimilarities {
    pairs: Vec<[usize; 2]>,
    /// Number of every place among those that are free.
    free_index: Vec<Option<usize>>,
    /// Of the Laplacian of the free ones.
    factor: CholeskyFactor,
}

/// A place and its step.
pub(crate) type Move = (Complex<f64>, Complex<f64>);

/// What is missing of a step to a similarity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Correction {
    /// Of the place.
    pub(crate) shift: Complex<f64>,
    /// h: what is around it is corrected by that times its distance from there, besides.
    pub(crate) similarity: Complex<f64>,
}

impl LocalSimilarities {
    /// `None` where nothing is free or nothing is seen in common.
    pub(crate) fn new(is_free: &[bool], pairs: Vec<[usize; 2]>) -> Option<Self> {
        /// Added to the diagonal: of places of which none is held the mean stays.
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
        pairs.iter().flatten().filter_map(|&place| free_index[place]).for_each(|free| add([free, free], 1.0));
        let factor = sparse.factor(values)?;
        Some(Self { pairs, free_index, factor })
    }

    /// Of all places.
    pub(crate) fn corrections(&self, moves: &[Move]) -> Vec<Correction> {
        let apart = |[from, to]: [usize; 2]| (moves[to].0 - moves[from].0, moves[to].1 - moves[from].1);
        let mut sums = vec![(Complex::default(), 0.0); moves.len()];
        for &pair in &self.pairs {
            let (apart, moved) = apart(pair);
            for place in pair {
                sums[place].0 += apart.conj() * moved;
                sums[place].1 += apart.norm_sqr();
            }
        }
        let of_sums = |&(with, square): &(Complex<f64>, f64)| beyond_tangent(with / square);
        let similarities: Vec<Complex<f64>> = sums.iter().map(of_sums).collect();
        let mut right = [vec![0.0; self.factor.unknowns()], vec![0.0; self.factor.unknowns()]];
        for &[from, to] in &self.pairs {
            let between = 0.5 * (similarities[from] + similarities[to]) * apart([from, to]).0;
            for (place, between) in [(from, -between), (to, between)] {
                if let Some(free) = self.free_index[place] {
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
            let corrections = LocalSimilarities::new(&is_free, pairs).unwrap().corrections(&moves);
            let to = |view: usize| moves[view].0 + moves[view].1 + corrections[view].shift;
            if is_held {
                prop_assert_eq!(to(0), places[0]);
            }
            for view in 1..count {
                // Where none is held they are where they are against each other.
                let exact = (1.0 + scale) * Complex::from_polar(1.0, turn) * (places[view] - places[0]);
                prop_assert!((to(view) - to(0) - exact).norm() < 1e-5, "{:?}", to(view) - to(0) - exact);
                let beside = Complex::new(1.0, 2.0);
                let step = Complex::new(scale, turn) * beside + corrections[view].similarity * beside;
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
        let corrections =
            LocalSimilarities::new(&[true, true], vec![[0, 1]]).unwrap().corrections(&[one, other]);
        assert!(corrections.iter().all(|of| of.shift.norm() + of.similarity.norm() == 0.0));
        assert!(LocalSimilarities::new(&[true, true], Vec::new()).is_none());
        assert!(LocalSimilarities::new(&[false, false], vec![[0, 1]]).is_none());
    }
}
