//! What is open of a fisheye besides its coefficients: its focal and, where nobody gave it, its principal point, fitted
//! with them to straight edges.
//!
//! Edges that pass beside the camera tell the focal, and the priors on the coefficients where none does; lines of stage
//! 1 tell more in the joint fit. The principal point has a belief.

use crate::camera::Lens;
use crate::optimize::least_squares_unless;
use crate::single::lens_problem::LensProblem;

impl LensProblem<'_> {
    /// The same problem with the focal open, and the principal point unless it is held, from the focal at which the
    /// edges can be straightest.
    pub(super) fn opened(mut self, centre_is_held: bool) -> Self {
        /// Focals of fisheyes from 60 to 250 degrees, in units of half the diagonal of the image.
        const STARTS: [f64; 5] = [0.4, 0.52, 0.68, 0.9, 1.2];
        const FIRST_STEPS: usize = 8;
        self.open = vec![Lens::OWN_FOCAL];
        if !centre_is_held {
            self.open.extend([Lens::CENTRE, Lens::CENTRE + 1]);
        }
        let [w, h] = self.size;
        let half_diagonal = 0.5 * w.hypot(h);
        let log_focal = self.fitted.len();
        let absolute = |values: &[f64], unit: f64| -> Vec<f64> {
            let mut values = values.to_vec();
            values[log_focal] += unit.ln();
            values
        };
        let mut best: Option<(f64, f64)> = None;
        let mut reached: Vec<Vec<f64>> = Vec::new();
        for start in STARTS {
            self.unit = start * half_diagonal;
            let is_known = |values: &Vec<f64>, _| {
                let here = absolute(values, self.unit);
                reached.iter().any(|other| self.is_one(other, &here))
            };
            let values = vec![0.0; self.indices().len()];
            let Some(found) = least_squares_unless(&self, values, FIRST_STEPS, is_known) else { continue };
            reached.push(absolute(&found.state, self.unit));
            if best.is_none_or(|(cost, _)| found.cost < cost) {
                best = Some((found.cost, self.lens(&found.state).focal));
            }
        }
        self.unit = best.map_or(half_diagonal, |(_, focal)| focal);
        self
    }
}
