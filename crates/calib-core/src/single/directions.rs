//! Vanishing points of the annotated directions at a state, including the scene's errors, with the nuisance
//! parameters that they depend on.

use crate::optimize::NuisanceJacobian;
use crate::single::constraints::{Constraints, Direction, LineConstraint};
use crate::single::nuisances::Nuisances;
use crate::single::residual::{Angles, Parameters, VanishingPoint};
use crate::single::scene_errors::Deviation;

/// Vanishing points of all directions at a state.
pub(crate) struct Directions<'a, E> {
    constraints: &'a Constraints<E>,
    nuisances: Nuisances,
    /// Vanishing point of the verticals.
    nadir: VanishingPoint,
    /// Vanishing points of the direction of every group, and of the direction at right angles to it. Empty if every
    /// floor line has a deviation from its group.
    groups: Vec<[VanishingPoint; 2]>,
    /// Vanishing point of every deviating direction.
    deviations: Vec<VanishingPoint>,
    /// Whether the tilt of the floor is estimated.
    has_tilt: bool,
}

impl<'a, E> Directions<'a, E> {
    /// Computes the vanishing points; `on_plane` returns the parameters of the camera relative to a plane.
    ///
    /// `None` if the camera is not above a plane that has an annotated line.
    pub(crate) fn new<'b>(
        constraints: &'a Constraints<E>,
        parameters: &Parameters,
        nuisance: &[f64],
        on_plane: impl Fn(usize) -> Option<&'b Parameters>,
    ) -> Option<Self> {
        let nuisances = Nuisances::new(constraints);
        let tilt = [0, 1].map(|axis| nuisance[nuisances.tilt() + axis]);
        let angles = Angles::new(parameters);
        let turned = |group: usize, orthogonal: bool| {
            nuisance[group] + if orthogonal { std::f64::consts::FRAC_PI_2 } else { 0.0 }
        };
        let exact =
            |group: usize| [false, true].map(|orthogonal| angles.floor(turned(group, orthogonal), 0.0));
        let deviating = |(index, deviation): (usize, &Deviation)| {
            let at = nuisances.deviation(index);
            let angle = turned(deviation.group, deviation.orthogonal) + nuisance[at];
            let Some(plane) = deviation.plane else { return Some(angles.floor(angle, nuisance[at + 1])) };
            Some(Angles::new(on_plane(plane)?).floor(angle, nuisance[at + 1]))
        };
        let is_exact =
            |line: &LineConstraint<E>| line.deviation.is_none() && line.direction != Direction::Vertical;
        let has_exact = constraints.lines.iter().any(is_exact);
        Some(Self {
            constraints,
            nuisances,
            nadir: angles.nadir(tilt),
            groups: if has_exact { (0..constraints.groups).map(exact).collect() } else { Vec::new() },
            deviations: constraints.deviations.iter().enumerate().map(deviating).collect::<Option<_>>()?,
            has_tilt: constraints.tilt_sigma().is_some(),
        })
    }

    /// Returns the vanishing point of a line.
    #[inline]
    pub(crate) fn vanishing_point(&self, line: &LineConstraint<E>) -> &VanishingPoint {
        match (line.direction, line.deviation) {
            (Direction::Vertical, _) => &self.nadir,
            (Direction::Floor { .. }, Some(deviation)) => &self.deviations[deviation],
            (Direction::Floor { group, orthogonal }, None) => &self.groups[group][usize::from(orthogonal)],
        }
    }

    /// Returns the plane of a line; `None` for the floor.
    #[inline]
    pub(crate) fn plane_of(&self, line: &LineConstraint<E>) -> Option<usize> {
        self.constraints.deviations[line.deviation?].plane
    }

    /// Converts the derivatives of a line's residual from the two parameters of its vanishing point to the
    /// nuisance parameters.
    #[inline]
    pub(crate) fn by_nuisances(
        &self,
        line: &LineConstraint<E>,
        [first, second]: [f64; 2],
    ) -> NuisanceJacobian {
        let Direction::Floor { group, .. } = line.direction else {
            let tilt = self.nuisances.tilt();
            let by_tilt = NuisanceJacobian::new(tilt, first).with_derivative(tilt + 1, second);
            return if self.has_tilt { by_tilt } else { NuisanceJacobian::NONE };
        };
        let by_group = NuisanceJacobian::new(group, first);
        let Some(index) = line.deviation else { return by_group };
        let (at, deviation) = (self.nuisances.deviation(index), &self.constraints.deviations[index]);
        let with_azimuth =
            if deviation.azimuth > 0.0 { by_group.with_derivative(at, first) } else { by_group };
        if deviation.level > 0.0 { with_azimuth.with_derivative(at + 1, second) } else { with_azimuth }
    }
}
