//! The nuisance parameters of one camera: where each is in a state, which block of the normal equations it is
//! in, and its prior.

use crate::optimize::NuisanceLayout;
use crate::single::constraints::{Constraints, Direction, Line};

/// Where the nuisance parameters of constraints are in a state: the angles of the groups, the log lengths of
/// the groups of lengths, azimuth and elevation of every deviation, and the two tilts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nuisances {
    groups: usize,
    lengths: usize,
    deviations: usize,
}

impl Nuisances {
    pub(crate) fn of<E>(constraints: &Constraints<E>) -> Self {
        let Constraints { groups, length_groups, deviations, .. } = constraints;
        Self { groups: *groups, lengths: length_groups.len(), deviations: deviations.len() }
    }

    /// The log length of a group of lengths.
    pub(crate) fn length(&self, group: usize) -> usize {
        self.groups + group
    }

    /// The azimuth of a deviation; its elevation is the next.
    pub(crate) fn deviation(&self, deviation: usize) -> usize {
        self.groups + self.lengths + 2 * deviation
    }

    /// The lean of the verticals to the right; that away from the camera is the next.
    pub(crate) fn tilt(&self) -> usize {
        self.deviation(self.deviations)
    }

    pub(crate) fn count(&self) -> usize {
        self.tilt() + 2
    }

    /// The blocks of parameters that have residuals in common: a group with its deviations, a length, the tilt.
    pub(crate) fn layout<E>(&self, constraints: &Constraints<E>) -> NuisanceLayout {
        let mut sizes = vec![1; self.groups + self.lengths];
        let mut places: Vec<(usize, usize)> = (0..sizes.len()).map(|block| (block, 0)).collect();
        for deviation in &constraints.deviations {
            let size = &mut sizes[deviation.group];
            places.extend([(deviation.group, *size), (deviation.group, *size + 1)]);
            *size += 2;
        }
        places.extend([(sizes.len(), 0), (sizes.len(), 1)]);
        sizes.push(2);
        NuisanceLayout { places, sizes }
    }
}

impl<E> Constraints<E> {
    /// Calls `sink` with the index of every nuisance parameter that has a prior, and its sigma.
    pub(crate) fn each_scene_prior(&self, mut sink: impl FnMut(usize, f64)) {
        let nuisances = Nuisances::of(self);
        let deviations = self.deviations.iter().enumerate().flat_map(|(index, deviation)| {
            let at = nuisances.deviation(index);
            [(at, deviation.azimuth), (at + 1, deviation.level)]
        });
        deviations.filter(|&(_, sigma)| sigma > 0.0).for_each(|(index, sigma)| sink(index, sigma));
        if let Some(sigma) = self.tilt_sigma() {
            sink(nuisances.tilt(), sigma);
            sink(nuisances.tilt() + 1, sigma);
        }
    }

    /// Whether the length of a group is known to the millimetre.
    pub(crate) fn has_exact_length(&self, group: usize) -> bool {
        self.length_groups[group].is_some_and(|known| known.sigma.is_none())
    }

    /// The standard deviation of the tilt; none where no vertical shows it, or none is allowed.
    pub(crate) fn tilt_sigma(&self) -> Option<f64> {
        let is_vertical = |line: &Line<E>| line.direction == Direction::Vertical;
        let has_verticals = || !self.uprights.is_empty() || self.lines.iter().any(is_vertical);
        Some(self.scene.floor_tilt).filter(|&sigma| sigma > 0.0 && has_verticals())
    }
}
