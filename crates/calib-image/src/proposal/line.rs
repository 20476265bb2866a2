//! A straight edge as evidence of a vanishing point.
//!
//! The ends of an edge have independent noise. How far they must move at least for the line through them to pass
//! through the vanishing point V is the residual r of `single/residual.rs` of the core, with weights 1: with
//! `q = p Vw - Vxy` for either end, `T = |q1|^2 + |q2|^2` and the line l through both,
//!
//! `r = sqrt(2) (l . V) / sqrt(T + sqrt((|q1|^2 - |q2|^2)^2 + 4 (q1 . q2)^2))`.
//!
//! An edge of a direction is turned from it a little, as walls are, or by much more, as what stands about in a room
//! is: `r ~ (1 - b) N(0, s^2) + b N(0, t^2)` with `s^2 = sigma^2 + (length turn)^2 / 2`, and t as s with the larger
//! turn. Of any other edge every angle is as likely: as `r = length |angle| / sqrt(2)`, its density is
//! `sqrt(2) / (pi length)`. The quotient of both is what an edge says for V.

use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2, TAU};

use calib_core::{Lens, Pixel};

use crate::line_segment::LineSegment;

use super::frame::Point;

/// How far edges of a building are turned from their direction, and those of what stands about, in radians.
const TURNS: [f64; 2] = [0.004, 0.05];
/// The share of the latter among the edges of a direction.
const LOOSE: f64 = 0.3;

/// An edge without lens distortion, relative to the principal point.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) ends: [[f64; 2]; 2],
    /// Standard deviation of either end across it, in pixels.
    pub(super) end_sigma: f64,
    pub(super) length: f64,
    /// The line through both ends, homogeneous.
    pub(super) through: [f64; 3],
    /// Standard deviations of the residual, in pixels.
    sigmas: [f64; 2],
    /// The segments that it is made of.
    pub(super) pieces: Vec<usize>,
}

/// What an edge says of a vanishing point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence {
    /// Residual in sigmas, signed.
    pub(super) residual: f64,
    /// Its derivative by the vanishing point.
    pub(super) by_point: [f64; 3],
}

/// A residual in pixels, with what its derivative needs.
struct Offset {
    pixels: f64,
    factor: f64,
    incidence: f64,
    q: [[f64; 2]; 2],
    squares: [f64; 2],
    along: f64,
    root: f64,
}

impl Line {
    /// The line of a segment under a lens; `None` outside the lens.
    pub(super) fn of_segment(segment: &LineSegment, index: usize, lens: &Lens) -> Option<Self> {
        let centre = lens.principal_point;
        let end = |pixel: Pixel| {
            let straight = lens.undistort(pixel)?;
            Some([straight.u - centre.u, straight.v - centre.v])
        };
        Self::new([end(segment.ends[0])?, end(segment.ends[1])?], segment.sigma, vec![index])
    }

    /// The line between two ends; `None` without a length.
    pub(super) fn new(ends: [[f64; 2]; 2], end_sigma: f64, pieces: Vec<usize>) -> Option<Self> {
        let [a, b] = ends;
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let through = [a[1] - b[1], b[0] - a[0], a[0] * b[1] - a[1] * b[0]];
        let sigmas = TURNS.map(|turn| end_sigma.hypot(turn * length * FRAC_1_SQRT_2));
        (length.is_finite() && length > 0.0 && end_sigma > 0.0).then_some(Self {
            ends,
            end_sigma,
            length,
            through,
            sigmas,
            pieces,
        })
    }

    /// The residual at a vanishing point; none for one between the ends, where no edge passes.
    fn offset(&self, v: Point) -> Option<Offset> {
        let q = self.ends.map(|p| [p[0] * v[2] - v[0], p[1] * v[2] - v[1]]);
        let (squares, along) = ([dot(q[0], q[0]), dot(q[1], q[1])], dot(q[0], q[1]));
        let apart = squares[0] - squares[1];
        let root = (apart * apart + 4.0 * along * along).sqrt();
        if along <= 0.0 || root <= 0.0 {
            return None;
        }
        let factor = (2.0 / (squares[0] + squares[1] + root)).sqrt();
        let incidence = self.through[0] * v[0] + self.through[1] * v[1] + self.through[2] * v[2];
        Some(Offset { pixels: factor * incidence, factor, incidence, q, squares, along, root })
    }

    /// Densities of a residual, of an edge of the building and of what stands about.
    fn densities(&self, pixels: f64) -> [f64; 2] {
        let shares = [1.0 - LOOSE, LOOSE];
        std::array::from_fn(|k| {
            let sigma = self.sigmas[k];
            shares[k] * (-0.5 * (pixels / sigma).powi(2)).exp() / (TAU.sqrt() * sigma)
        })
    }

    /// How much likelier the edge is if it leads there than if it leads anywhere.
    pub(super) fn odds(&self, v: Point) -> f64 {
        /// So many of the larger sigmas off, the odds are nothing.
        const FAR: f64 = 6.0;
        let Some(offset) = self.offset(v).filter(|offset| offset.pixels.abs() < FAR * self.sigmas[1]) else {
            return 0.0;
        };
        let [tight, loose] = self.densities(offset.pixels);
        (tight + loose) * PI * self.length / SQRT_2
    }

    /// The residual at a vanishing point, weighted as the mixture of both sigmas weighs it.
    pub(super) fn evidence(&self, v: Point) -> Option<Evidence> {
        let offset = self.offset(v)?;
        let [tight, loose] = self.densities(offset.pixels);
        let [s, t] = self.sigmas.map(|sigma| sigma.powi(-2));
        let precision = (tight * s + loose * t) / (tight + loose).max(f64::MIN_POSITIVE);
        let by_point = self.by_point(&offset).map(|by| precision.sqrt() * by);
        Some(Evidence { residual: precision.sqrt() * offset.pixels, by_point })
    }

    fn by_point(&self, offset: &Offset) -> [f64; 3] {
        let Offset { factor, incidence, q, squares: [a, b], along, root, .. } = *offset;
        std::array::from_fn(|k| {
            let by = self.ends.map(|p| [[-1.0, 0.0], [0.0, -1.0], p][k]);
            let (by_a, by_b) = (2.0 * dot(q[0], by[0]), 2.0 * dot(q[1], by[1]));
            let by_along = dot(q[0], by[1]) + dot(q[1], by[0]);
            let by_root = ((a - b) * (by_a - by_b) + 4.0 * along * by_along) / root;
            let share = 0.5 * incidence / (a + b + root);
            factor * (self.through[k] - share * (by_a + by_b + by_root))
        })
    }
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_derivative_is_that_of_differences() {
        const STEP: f64 = 1e-5;
        let line = Line::new([[120.0, -40.0], [180.0, 90.0]], 0.5, vec![0]).unwrap();
        for v in [[300.0, 400.0, 1.0], [30.0, 70.0, 0.01], [-500.0, 20.0, 0.3]] {
            let exact = line.by_point(&line.offset(v).unwrap());
            for k in 0..3 {
                let at = |by: f64| {
                    let mut moved = v;
                    moved[k] += by;
                    line.offset(moved).unwrap().pixels
                };
                let numeric = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                assert!(
                    (numeric - exact[k]).abs() < 1e-5 * (1.0 + exact[k].abs()),
                    "{v:?} {k}: {numeric} {exact:?}"
                );
            }
        }
    }

    #[test]
    fn an_edge_speaks_for_where_it_leads_and_never_for_a_point_on_it() {
        let line = Line::new([[0.0, 0.0], [100.0, 0.0]], 0.5, vec![0]).unwrap();
        assert!(line.odds([400.0, 0.0, 1.0]) > 20.0, "{}", line.odds([400.0, 0.0, 1.0]));
        assert!(line.odds([400.0, 300.0, 1.0]) < 0.1);
        assert_eq!(line.odds([50.0, 0.0, 1.0]), 0.0);
    }
}
