//! Nuisance parameters of one camera: their positions in a state, their blocks in the normal equations, and
//! their priors.

use crate::optimize::NuisanceLayout;
use crate::single::constraints::{AnnotatedPlane, Constraints, Direction, LineConstraint};

/// Layout of the nuisance parameters in a state.
///
/// The order is: angles of the groups of directions, log lengths of the groups of lengths, azimuth and
/// elevation of every deviation. The two tilts follow. Every annotated plane adds its two slopes, and its
/// height under the camera relative to the expected height.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nuisances {
    /// Number of groups of floor directions.
    groups: usize,
    /// Number of groups of lengths.
    lengths: usize,
    /// Number of deviating directions.
    deviations: usize,
    /// Number of annotated planes.
    planes: usize,
}

/// Indices of the nuisance parameters that an annotation on a plane depends on; `None` for parameters that
/// are not estimated.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlaneNuisances {
    /// Index of the first of the two tilts of the floor.
    pub(crate) tilt: Option<usize>,
    /// Index of the first of the two slopes of the plane.
    pub(crate) slope: Option<usize>,
    /// Index of the height of the plane under the camera.
    pub(crate) foot: Option<usize>,
}

impl Nuisances {
    pub(crate) fn new<E>(constraints: &Constraints<E>) -> Self {
        let Constraints { groups, length_groups, deviations, planes, .. } = constraints;
        let (lengths, deviations, planes) = (length_groups.len(), deviations.len(), planes.len());
        Self { groups: *groups, lengths, deviations, planes }
    }

    /// Returns the index of the log length of a group of lengths.
    pub(crate) fn length(&self, group: usize) -> usize {
        self.groups + group
    }

    /// Returns the index of the azimuth of a deviation; its elevation has the next index.
    pub(crate) fn deviation(&self, deviation: usize) -> usize {
        self.groups + self.lengths + 2 * deviation
    }

    /// Returns the index of the lean of the verticals to the right; the lean away from the camera has the
    /// next index.
    pub(crate) fn tilt(&self) -> usize {
        self.deviation(self.deviations)
    }

    /// Returns the index of the slope of a plane to the right.
    ///
    /// The next index is that of the slope away from the camera. The third is that of the height under the
    /// camera, relative to the expected height of the plane.
    pub(crate) fn plane(&self, plane: usize) -> usize {
        self.tilt() + 2 + 3 * plane
    }

    /// Returns the number of nuisance parameters.
    pub(crate) fn count(&self) -> usize {
        self.plane(self.planes)
    }

    /// Returns the blocks of parameters that share residuals: a group with its deviations, a length, and the
    /// tilt with all planes and their annotations.
    pub(crate) fn layout<E>(&self, constraints: &Constraints<E>) -> NuisanceLayout {
        let common = self.groups + self.lengths;
        let mut block_of: Vec<usize> = (0..common).collect();
        let on_planes = constraints.deviations.iter().filter(|deviation| deviation.plane.is_some());
        on_planes.for_each(|deviation| block_of[deviation.group] = common);
        let on_planes = constraints.lengths.iter().filter(|length| length.plane.is_some());
        on_planes.for_each(|length| block_of[self.length(length.group)] = common);
        for deviation in &constraints.deviations {
            block_of.extend([block_of[deviation.group]; 2]);
        }
        block_of.resize(self.count(), common);
        let mut sizes = vec![0; common + 1];
        let place = |&block: &usize| {
            sizes[block] += 1;
            (block, sizes[block] - 1)
        };
        let places = block_of.iter().map(place).collect();
        NuisanceLayout { positions: places, sizes }
    }
}

impl<E> Constraints<E> {
    /// Calls `sink` with the index and the standard deviation of every nuisance parameter that has its own
    /// prior. The two tilts have a joint prior (`crossfall.rs`).
    pub(crate) fn each_scene_prior(&self, mut sink: impl FnMut(usize, f64)) {
        let nuisances = Nuisances::new(self);
        let deviations = self.deviations.iter().enumerate().flat_map(|(index, deviation)| {
            let at = nuisances.deviation(index);
            [(at, deviation.azimuth), (at + 1, deviation.level)]
        });
        deviations.filter(|&(_, sigma)| sigma > 0.0).for_each(|(index, sigma)| sink(index, sigma));
        let planes = self.planes.iter().enumerate().flat_map(|(plane, drawn)| {
            let at = nuisances.plane(plane);
            let (slope, foot) = (drawn.slope_sigma(), drawn.foot_sigma());
            [(at, slope), (at + 1, slope), (at + 2, foot)]
        });
        planes.filter(|&(_, sigma)| sigma > 0.0).for_each(|(index, sigma)| sink(index, sigma));
    }

    /// Whether the length of a group is known exactly.
    pub(crate) fn has_exact_length(&self, group: usize) -> bool {
        self.length_groups[group].is_some_and(|known| known.sigma.is_none())
    }

    /// Returns the standard deviation of the tilt; `None` without verticals, or if the scene has no tilt.
    pub(crate) fn tilt_sigma(&self) -> Option<f64> {
        let is_vertical = |line: &LineConstraint<E>| line.direction == Direction::Vertical;
        let has_verticals = || !self.uprights.is_empty() || self.lines.iter().any(is_vertical);
        Some(self.scene.floor_tilt).filter(|&sigma| sigma > 0.0 && has_verticals())
    }

    /// Returns the nuisance parameters of an annotation on a plane.
    pub(crate) fn nuisances_on(&self, plane: usize) -> PlaneNuisances {
        let (nuisances, drawn) = (Nuisances::new(self), &self.planes[plane]);
        let at = nuisances.plane(plane);
        PlaneNuisances {
            tilt: self.tilt_sigma().map(|_| nuisances.tilt()),
            slope: (drawn.slope_sigma() > 0.0).then_some(at),
            foot: (drawn.foot_sigma() > 0.0).then_some(at + 2),
        }
    }
}

impl AnnotatedPlane {
    /// Returns the standard deviation of the prior on each slope of the plane, in rise per metre. It includes the
    /// expected slope of the plane, whose direction relative to the camera is unknown.
    fn slope_sigma(&self) -> f64 {
        self.prior.slope_in_any_direction()
    }

    /// Returns the standard deviation of the height of the plane under the camera, in metres.
    fn foot_sigma(&self) -> f64 {
        self.prior.height_sigma_under_camera()
    }
}
