//! Evaluation of the residuals of lengths and uprights, on the floor and on other planes.

use crate::optimize::{NuisanceJacobian, Number, NumberOver};
use crate::single::annotation::Known;
use crate::single::constraints::{LengthConstraint, Source};
use crate::single::likelihood::{PlaneState, Problem, State};
use crate::single::plane_frame::DistanceKind;
use crate::single::residual::{LOG_HEIGHT, Parameters};
use crate::single::size_residual::{CameraTerms, floor_length, upright_log_determinant, upright_residuals};

impl<E: Number> Problem<'_, E> {
    /// Passes the residual of every length to `sink`: [`floor_length`] minus the log length of its group,
    /// divided by its standard deviation.
    #[inline]
    pub(super) fn each_length<N: NumberOver<E>>(
        &self,
        state: &State,
        at: &CameraTerms<N>,
        planes: &[PlaneState],
        sink: &mut impl FnMut(N, NuisanceJacobian, Option<Source>),
    ) -> Option<()> {
        for length in self.lengths() {
            let Some(plane) = length.plane else {
                let (residual, nuisance) = self.length(state, at, &state.parameters, length)?;
                sink(residual, nuisance, Some(length.source));
                continue;
            };
            let (frame, nuisances) = planes[plane].without_tilt()?;
            let at = CameraTerms::<N>::new(&frame.parameters, frame.tilt);
            let (residual, nuisance) = self.length(state, &at, &frame.parameters, length)?;
            let (mut gradient, jacobian) =
                frame.propagated(&residual.gradient(), DistanceKind::OnPlane, &nuisances);
            // The length of the group is in units of the camera's height above the floor.
            nuisance.entries().iter().for_each(|(_, by_length)| gradient[LOG_HEIGHT] += by_length);
            sink(residual.with_gradient(gradient), nuisance.with_all(&jacobian), Some(length.source));
        }
        Some(())
    }

    /// Returns the residual of one length on the floor of a camera with these parameters, and its derivative
    /// with respect to the log length of its group.
    #[inline]
    fn length<N: NumberOver<E>>(
        &self,
        state: &State,
        at: &CameraTerms<N>,
        parameters: &Parameters,
        length: &LengthConstraint<E>,
    ) -> Option<(N, NuisanceJacobian)> {
        let scale = self.sigma_of(length.source).recip();
        let (log_length, noise) = floor_length(at, length.chart.as_ref(), &length.ends)?;
        let noise = with_spread(noise, length.spread * scale);
        let index = self.nuisances().length(length.group);
        if let Some(Known { value, sigma: None, .. }) = self.constraints.length_groups[length.group] {
            let residual = (log_length - in_heights::<N>(value, parameters)) / noise * scale;
            return Some((residual, NuisanceJacobian::NONE));
        }
        let mut expected = N::constant(state.nuisance[index]);
        if length.plane.is_some() {
            expected =
                expected + state.parameters[LOG_HEIGHT] - N::parameter(parameters[LOG_HEIGHT], LOG_HEIGHT);
        }
        let residual = (log_length - expected) / noise * scale;
        Some((residual, NuisanceJacobian::new(index, -scale / noise.value())))
    }

    /// Passes the two residuals of every upright to `sink`, in standard deviations.
    #[inline]
    pub(super) fn each_upright<N: NumberOver<E>>(
        &self,
        at: &CameraTerms<N>,
        planes: &[PlaneState],
        sink: &mut impl FnMut(N, NuisanceJacobian, Option<Source>),
    ) -> Option<()> {
        let has_tilt = self.constraints.tilt_sigma().is_some();
        let tilt = self.nuisances().tilt();
        for upright in self.uprights() {
            let sigma = self.sigma_of(upright.source);
            let Some(plane) = upright.plane else {
                for residual in upright_residuals(at, upright, sigma)? {
                    let [.., right, ahead] = residual.gradient();
                    let by_tilt = NuisanceJacobian::new(tilt, right).with_derivative(tilt + 1, ahead);
                    let by_tilt = if has_tilt { by_tilt } else { NuisanceJacobian::NONE };
                    sink(residual, by_tilt, Some(upright.source));
                }
                continue;
            };
            let PlaneState { frame, nuisances } = &planes[plane];
            let frame = frame.as_ref()?;
            let at = CameraTerms::<N>::new(&frame.along_verticals, frame.tilt);
            for residual in upright_residuals(&at, upright, sigma)? {
                let (gradient, jacobian) =
                    frame.propagated(&residual.gradient(), DistanceKind::Upright, nuisances);
                sink(residual.with_gradient(gradient), jacobian, Some(upright.source));
            }
        }
        Some(())
    }

    /// Sums the log determinant of the covariance of the predicted head over all uprights on the floor. `None` if
    /// a head has no prediction.
    pub(super) fn log_spread_of_uprights<N: NumberOver<E>>(&self, at: &CameraTerms<N>) -> Option<f64> {
        let on_floor = self.uprights().filter(|upright| upright.plane.is_none());
        let each = on_floor.map(|upright| {
            Some(upright_log_determinant(at, upright, self.sigma_of(upright.source))?.value())
        });
        each.sum()
    }

    /// Passes `log (length / known) / relative sigma` of every group with a prior on its length to `sink`.
    pub(super) fn each_length_prior<N: NumberOver<E>>(
        &self,
        state: &State,
        sink: &mut impl FnMut(N, NuisanceJacobian, Option<Source>),
    ) {
        for (group, value, relative) in self.approximate_lengths() {
            let index = self.nuisances().length(group);
            let residual = N::constant(state.nuisance[index]) - in_heights::<N>(value, &state.parameters);
            sink(residual * relative.recip(), NuisanceJacobian::new(index, relative.recip()), None);
        }
    }

    /// Returns the groups of lengths that have a prior and a segment: index of the group, length in metres,
    /// and relative standard deviation.
    pub(super) fn approximate_lengths(&self) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        let groups = self.constraints.length_groups.iter().enumerate();
        let known = groups.filter_map(|(group, length)| Some((group, (*length)?)));
        let with_sigma =
            known.filter_map(|(group, known)| Some((group, known.value, known.sigma? / known.value)));
        let mut is_drawn = vec![false; self.constraints.length_groups.len()];
        self.lengths().for_each(|length| is_drawn[length.group] = true);
        with_sigma.filter(move |&(group, ..)| is_drawn[group])
    }
}

/// Returns the log of a length, given in metres, in units of the camera height.
#[inline]
fn in_heights<N: Number>(metres: f64, parameters: &Parameters) -> N {
    N::constant(metres.ln()) - N::parameter(parameters[LOG_HEIGHT], LOG_HEIGHT)
}

/// Returns the standard deviation of a log length: the root of the sum of the squared noise and the squared spread of
/// the true log lengths.
#[inline]
fn with_spread<N: Number>(noise: N, spread: f64) -> N {
    if spread > 0.0 { (noise * noise + spread * spread).sqrt() } else { noise }
}
