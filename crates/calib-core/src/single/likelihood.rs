//! Stage 1 as a least-squares problem: the maximum-likelihood estimate of roll, pitch, focal length and
//! height. Every residual is in units of its standard deviation, so no weights are chosen.
//!
//! The core parameters are roll, pitch, log focal length and log height. The nuisance parameters are the
//! angle of every group of floor directions, the log length of every group of equal segments, and the scene's
//! own errors ([`Nuisances`]). A residual depends on the core parameters and on few nuisance parameters of
//! one block, so the normal equations have the shape of an arrow (`optimize/arrow.rs`).
//!
//! Residuals of annotations are divided by the standard deviation of an annotated coordinate, and residuals of
//! priors by the standard deviation of the prior. The sum of squares is minus twice the log likelihood, up to
//! a constant. The residuals of lines are exact, with the true line eliminated. The residuals of lengths have
//! Sampson's form `(log length - log L) / |grad log length|`. `log L` is the nuisance parameter of the group,
//! or the log of the known length in camera heights (see `size_residual.rs`).

use crate::optimize::{
    Dual, Gradient, LeastSquares, Normal, NuisanceJacobian, Number, NumberOver, Uncertainty,
};
use crate::single::constraints::{
    AnnotatedPlane, Constraints, Direction, LengthConstraint, LineConstraint, Source, UprightConstraint,
};
use crate::single::directions::Directions;
use crate::single::nuisances::{Nuisances, PlaneNuisances};
use crate::single::parameters::FixedParameters;
use crate::single::parameters::Orientation;
use crate::single::parameters::{Prior, Priors};
use crate::single::plane_frame::{DistanceKind, PlaneFrame};
use crate::single::residual::{LOG_FOCAL, LOG_HEIGHT, LineResidual, PITCH, Parameters, ROLL};
use crate::single::size_residual::{CameraTerms, floor_length};
use crate::single::vanishing_point::unrolled;

/// Fit of one camera: constraints, fixed parameters and priors.
#[derive(Clone, Debug)]
pub(crate) struct Problem<'a, E = f64> {
    pub(crate) constraints: &'a Constraints<E>,
    /// Standard deviation of an annotated coordinate, in pixels.
    pub(crate) sigma: f64,
    pub(crate) priors: Priors,
    /// Flag for every core parameter: whether it is estimated.
    pub(crate) free: [bool; 4],
    /// Constraints rejected as outliers.
    pub(crate) rejected: &'a [Source],
    /// Width of the image, in pixels; the range of possible focal lengths is relative to it.
    pub(crate) width: f64,
}

/// Value of every unknown.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State {
    pub(crate) parameters: Parameters,
    /// Nuisance parameters: angle of every floor direction (radians), log length of every group of lengths
    /// (unit: camera height), and the scene's own errors ([`Nuisances`]).
    pub(crate) nuisance: Vec<f64>,
}

impl State {
    /// Returns roll, pitch and focal length at this state.
    pub(crate) fn orientation(&self) -> Orientation {
        let [roll, pitch, log_focal, _] = self.parameters;
        Orientation { roll, pitch, focal: log_focal.exp() }
    }
}

impl<'a> Problem<'a> {
    /// Creates the problem with all constraints.
    pub(crate) fn new(
        constraints: &'a Constraints,
        fixed: FixedParameters,
        priors: Priors,
        sigma: f64,
        width: f64,
    ) -> Self {
        let height_is_observable = priors.height.is_some()
            || !constraints.uprights.is_empty()
            || constraints.lengths.iter().any(|length| constraints.length_groups[length.group].is_some());
        let free_height = height_is_observable && fixed.height.is_none();
        let free = [fixed.roll.is_none(), fixed.pitch.is_none(), fixed.focal.is_none(), free_height];
        Self { constraints, sigma, priors, free, rejected: &[], width }
    }

    /// Returns the degrees of freedom: number of residuals minus number of unknowns.
    pub(crate) fn dof(&self) -> i64 {
        let residuals = self.lines().count() + self.lengths().count() + 2 * self.uprights().count();
        let mut count = residuals as i64 - self.repeated_residuals();
        let Priors { roll, pitch, focal, height, weak_log_focal } = self.priors;
        count += [roll, pitch, focal, height, weak_log_focal].iter().flatten().count() as i64;
        self.constraints.each_scene_prior(|_, _| count += 1);
        count += if self.constraints.tilt_sigma().is_some() { 2 } else { 0 };
        count += self.approximate_lengths().count() as i64;
        let nuisances = self.used().iter().filter(|&&used| used).count();
        let unknowns = self.free.iter().filter(|&&free| free).count() + nuisances;
        count - unknowns as i64
    }

    /// Returns the number of residuals of repeated annotations, minus the unknowns of these annotations
    /// alone, rounded up.
    pub(crate) fn repeated_residuals(&self) -> i64 {
        let Constraints { repeats, groups, length_groups, .. } = self.constraints;
        let again = |source: Source| 1.0 - repeats.repeat_count(source).recip();
        let lines: f64 = self.lines().map(|line| again(line.source)).sum();
        let lengths: f64 = self.lengths().map(|length| again(length.source)).sum();
        let uprights: f64 = self.uprights().map(|upright| again(upright.source)).sum();
        let (used, nuisances) = (self.used(), self.nuisances());
        let directions: f64 = (0..*groups)
            .filter(|&group| used[group])
            .map(|group| 1.0 - repeats.share_of_direction(group))
            .sum();
        let is_unknown = |&group: &usize| length_groups[group].is_none() && used[nuisances.length(group)];
        let unknown = (0..length_groups.len()).filter(is_unknown);
        let unknown: f64 = unknown.map(|group| 1.0 - repeats.share_of_length(group)).sum();
        (lines + lengths + 2.0 * uprights - directions - unknown - 1e-9).ceil() as i64
    }

    /// Returns a flag for every nuisance parameter: whether a residual depends on it.
    pub(crate) fn used(&self) -> Vec<bool> {
        let mut used = vec![false; self.nuisances().count()];
        for line in self.lines() {
            if let Direction::Floor { group, .. } = line.direction {
                used[group] = true;
            }
        }
        for length in self.lengths().filter(|length| !self.constraints.has_exact_length(length.group)) {
            used[self.nuisances().length(length.group)] = true;
        }
        self.constraints.each_scene_prior(|index, _| used[index] = true);
        if self.constraints.tilt_sigma().is_some() {
            let tilt = self.nuisances().tilt();
            used[tilt..tilt + 2].fill(true);
        }
        used
    }

    /// Returns the same problem with other constraints.
    pub(crate) fn with_constraints<'b, E>(&self, constraints: &'b Constraints<E>) -> Problem<'b, E>
    where
        'a: 'b,
    {
        let Self { sigma, priors, free, rejected, width, .. } = *self;
        Problem { constraints, sigma, priors, free, rejected, width }
    }

    /// Returns the state with these core parameters, and the nuisance parameters in closed form: the mean
    /// direction and the mean log length of every group.
    ///
    /// Returns `None` if a length is above the horizon, or if the camera is not above the plane of a length.
    pub(crate) fn state_at(&self, parameters: Parameters) -> Option<State> {
        let mut nuisance = vec![0.0; self.nuisances().count()];
        let mut sums = vec![[0.0; 2]; self.constraints.groups];
        let ((sr, cr), (sp, cp), f) =
            (parameters[ROLL].sin_cos(), parameters[PITCH].sin_cos(), parameters[LOG_FOCAL].exp());
        for line in self.lines() {
            let Direction::Floor { group, orthogonal } = line.direction else { continue };
            let [a, b, c] = unrolled(line, [sr, cr]);
            // Direction in which the viewing plane of the segment intersects the floor. An axis has no sign,
            // so the doubled angle of the direction is averaged.
            let (x, y) = (cp * c - sp * f * b, -f * a);
            let square = x * x + y * y;
            if square > 0.0 {
                let weight = a.hypot(b) / square * if orthogonal { -1.0 } else { 1.0 };
                sums[group][0] += weight * (x * x - y * y);
                sums[group][1] += weight * 2.0 * x * y;
            }
        }
        // The scene's own errors start at zero.
        for (angle, [cos, sin]) in nuisance.iter_mut().zip(&sums) {
            *angle = 0.5 * sin.atan2(*cos);
        }
        let mut totals = vec![(0.0, 0.0); self.constraints.length_groups.len()];
        let at = CameraTerms::<f64>::new(&parameters, [0.0; 2]);
        let planes = self.constraints.plane_frames(&parameters, &nuisance);
        for length in self.lengths() {
            let log_length = match length.plane.map(|plane| &planes[plane]) {
                None => floor_length(&at, length.chart.as_ref(), &length.ends)?.0,
                Some(plane) => {
                    let plane = plane.as_ref()?;
                    let at = CameraTerms::<f64>::new(&plane.parameters, plane.tilt);
                    floor_length(&at, length.chart.as_ref(), &length.ends)?.0
                        - plane.log_ratio(parameters[LOG_HEIGHT])
                }
            };
            totals[length.group].0 += log_length;
            totals[length.group].1 += 1.0;
        }
        for (value, (sum, count)) in nuisance[self.constraints.groups..].iter_mut().zip(totals) {
            *value = if count > 0.0 { sum / count } else { 0.0 };
        }
        Some(State { parameters, nuisance })
    }

    /// Returns the residual of every constraint in pixels; for an upright, the norm of both coordinates.
    pub(crate) fn residuals_in_pixels(&self, state: &State) -> Option<Vec<(Source, f64)>> {
        let mut residuals: Vec<(Source, f64)> = Vec::new();
        self.each_residual(state, |residual: f64, _, source| {
            let Some(source) = source else { return };
            let residual = residual * self.sigma_of(source);
            match residuals.last_mut() {
                Some((last, pixels)) if *last == source => *pixels = pixels.hypot(residual),
                _ => residuals.push((source, residual)),
            }
        })?;
        for (source, pixels) in &mut residuals {
            *pixels *= self.constraints.repeats.repeat_count(*source).sqrt();
        }
        Some(residuals)
    }

    /// Returns the normal equations at a state; `None` if the geometry is impossible.
    pub(crate) fn normal(&self, state: &State) -> Option<Normal> {
        let mut normal = Normal::new(self.nuisances().layout(self.constraints));
        self.each_residual(state, |residual: Dual, nuisance, _| {
            normal.add(residual.value, &residual.gradient, &nuisance);
        })?;
        normal.cost.is_finite().then_some(normal)
    }

    /// Returns the sum of the squared residuals, in standard deviations; `None` if the geometry is
    /// impossible.
    pub(crate) fn cost(&self, state: &State) -> Option<f64> {
        let mut cost = 0.0;
        self.each_residual(state, |residual: f64, _, _| cost += residual * residual)?;
        cost.is_finite().then_some(cost)
    }

    /// Returns the covariance of the core parameters at a state, with the nuisance parameters marginalised.
    pub(crate) fn uncertainty(&self, state: &State) -> Option<Uncertainty> {
        Some(Uncertainty::new(&self.normal(state)?.information(self.free), self.free))
    }
}

/// Camera relative to a plane, and the nuisance parameters of the annotations on that plane.
pub(super) struct PlaneState {
    /// Camera relative to the plane; `None` if the camera is not above it.
    pub(super) frame: Option<PlaneFrame>,
    pub(super) nuisances: PlaneNuisances,
}

impl PlaneState {
    /// Returns the camera and the nuisance parameters for lengths in the plane, which do not depend on the tilt of
    /// the verticals. `None` if the camera is not above the plane.
    pub(super) fn without_tilt(&self) -> Option<(&PlaneFrame, PlaneNuisances)> {
        Some((self.frame.as_ref()?, PlaneNuisances { tilt: None, ..self.nuisances }))
    }
}

impl<E> Constraints<E> {
    /// Returns the camera with these parameters relative to every plane; `None` for a plane that the camera
    /// is not above.
    pub(crate) fn plane_frames(&self, parameters: &Parameters, nuisance: &[f64]) -> Vec<Option<PlaneFrame>> {
        let nuisances = Nuisances::new(self);
        let tilt = [0, 1].map(|axis| nuisance[nuisances.tilt() + axis]);
        let frame = |(plane, drawn): (usize, &AnnotatedPlane)| {
            let [right, ahead, foot] = std::array::from_fn(|k| nuisance[nuisances.plane(plane) + k]);
            PlaneFrame::new(parameters, tilt, [right, ahead], drawn.prior.plane.height + foot)
        };
        self.planes.iter().enumerate().map(frame).collect()
    }
}

impl<'a, E: Number> Problem<'a, E> {
    /// Returns the camera relative to every annotated plane, with the nuisance parameters of its annotations.
    fn plane_states(&self, state: &State) -> Vec<PlaneState> {
        let frames = self.constraints.plane_frames(&state.parameters, &state.nuisance);
        let with_nuisances =
            |(plane, frame)| PlaneState { frame, nuisances: self.constraints.nuisances_on(plane) };
        frames.into_iter().enumerate().map(with_nuisances).collect()
    }

    /// Returns the standard deviation of the coordinates of an annotation, in pixels.
    #[inline]
    pub(crate) fn sigma_of(&self, source: Source) -> f64 {
        self.constraints.sigma_px.get(source.annotation).copied().flatten().unwrap_or(self.sigma)
    }

    /// Returns the layout of the nuisance parameters.
    pub(crate) fn nuisances(&self) -> Nuisances {
        Nuisances::new(self.constraints)
    }

    /// Whether the constraint of this source is not rejected.
    fn is_used(&self, source: Source) -> bool {
        self.rejected.is_empty() || !self.rejected.contains(&source)
    }

    /// Iterates over the lines that are not rejected.
    pub(crate) fn lines(&self) -> impl Iterator<Item = &'a LineConstraint<E>> + '_ {
        self.constraints.lines.iter().filter(|line| self.is_used(line.source))
    }

    /// Iterates over the lengths that are not rejected.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = &'a LengthConstraint<E>> + '_ {
        self.constraints.lengths.iter().filter(|length| self.is_used(length.source))
    }

    /// Iterates over the uprights that are not rejected.
    pub(crate) fn uprights(&self) -> impl Iterator<Item = &'a UprightConstraint<E>> + '_ {
        self.constraints.uprights.iter().filter(|upright| self.is_used(upright.source))
    }

    /// Calls `sink` with every residual in standard deviations, its derivatives with respect to nuisance
    /// parameters (if derivatives are requested), and its source.
    ///
    /// Returns `None` if the geometry is impossible, for example a length above the horizon, or an unrealistic
    /// focal length.
    pub(crate) fn each_residual<N: NumberOver<E>>(
        &self,
        state: &State,
        mut sink: impl FnMut(N, NuisanceJacobian, Option<Source>),
    ) -> Option<()> {
        let parameters = &state.parameters;
        let focal = parameters[LOG_FOCAL].exp();
        if !(focal > 0.02 * self.width && focal < 500.0 * self.width) || parameters[PITCH].abs() > 3.0 {
            return None;
        }
        let planes = self.plane_states(state);
        self.each_line(state, &planes, &mut sink)?;
        let tilt = self.nuisances().tilt();
        let at = CameraTerms::<N>::new(parameters, [state.nuisance[tilt], state.nuisance[tilt + 1]]);
        self.each_length(state, &at, &planes, &mut sink)?;
        self.each_upright(&at, &planes, &mut sink)?;
        self.each_length_prior(state, &mut sink);
        self.each_prior(parameters, |residual| sink(residual, NuisanceJacobian::NONE, None));
        self.each_lean_prior(state, &at, |residual, by| sink(residual, by, None));
        self.constraints.each_scene_prior(|index, sigma| {
            let by = NuisanceJacobian::new(index, sigma.recip());
            sink(N::constant(state.nuisance[index] / sigma), by, None);
        });
        Some(())
    }

    /// Passes the residual of every vertical and floor line to `sink`: [`LineResidual`] at the vanishing
    /// point of its direction.
    #[inline]
    fn each_line<N: NumberOver<E>>(
        &self,
        state: &State,
        planes: &[PlaneState],
        sink: &mut impl FnMut(N, NuisanceJacobian, Option<Source>),
    ) -> Option<()> {
        let at = |plane: usize| planes[plane].frame.as_ref().map(|frame| &frame.parameters);
        let directions = Directions::new(self.constraints, &state.parameters, &state.nuisance, at)?;
        for line in self.lines() {
            let scale = self.sigma_of(line.source).recip();
            let vanishing = directions.vanishing_point(line).in_chart(line.chart.as_ref());
            let residual = LineResidual::new(&line.ends, vanishing.at);
            let value = N::from(residual.pixels) * scale;
            if !N::HAS_GRADIENT {
                sink(value, NuisanceJacobian::NONE, Some(line.source));
                continue;
            }
            let d_point = residual.d_point();
            let derivative = |change: &[f64; 3]| scale * crate::camera::dot(&d_point, change);
            let mut gradient: Gradient = [0.0; 6];
            gradient[ROLL] = derivative(&vanishing.d_roll);
            gradient[PITCH] = derivative(&vanishing.d_pitch);
            gradient[LOG_FOCAL] = derivative(&vanishing.d_log_focal);
            let mut nuisance =
                directions.by_nuisances(line, vanishing.d_own.map(|change| derivative(&change)));
            if let Some(plane) = directions.plane_of(line) {
                let (frame, of_plane) = planes[plane].without_tilt()?;
                let of_plane = PlaneNuisances { foot: None, ..of_plane };
                let (carried, jacobian) = frame.propagated(&gradient, DistanceKind::OnPlane, &of_plane);
                gradient = carried;
                nuisance = nuisance.with_all(&jacobian);
            }
            sink(N::new(value.value(), gradient), nuisance, Some(line.source));
        }
        Some(())
    }

    /// Passes `(value - mean) / sigma` of every prior to `sink`.
    fn each_prior<N: Number>(&self, parameters: &Parameters, mut sink: impl FnMut(N)) {
        let Priors { roll, pitch, focal, height, weak_log_focal } = self.priors;
        let mut add = |prior: Option<Prior>, value: N| {
            if let Some(Prior { value: mean, sigma }) = prior {
                sink((value - mean) * sigma.recip());
            }
        };
        let unknown = |index: usize| N::parameter(parameters[index], index);
        add(roll, unknown(ROLL));
        add(pitch, unknown(PITCH));
        add(focal, unknown(LOG_FOCAL).exp());
        add(weak_log_focal, unknown(LOG_FOCAL));
        add(height, unknown(LOG_HEIGHT).exp());
    }
}

impl LeastSquares for Problem<'_> {
    type State = State;
    type Normal = Normal;

    fn linearize(&self, state: &State) -> Option<(f64, Normal)> {
        let normal = self.normal(state)?;
        Some((normal.cost, normal))
    }

    fn step(&self, state: &State, normal: &Normal, damping: f64) -> Option<(State, f64, f64)> {
        let mut next = state.clone();
        let (gain, size) = normal.step(&mut next.parameters, &mut next.nuisance, damping, self.free)?;
        Some((next, gain, size))
    }
}

#[path = "likelihood_tests.rs"]
#[cfg(test)]
mod tests;
