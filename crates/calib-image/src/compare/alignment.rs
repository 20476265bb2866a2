//! Two stills laid on each other: passes from far to near, and how much of the old one is found again.

use calib_core::Camera;

use calib_core::camera::Turn;

use crate::{EdgeOffset, Estimated, TurnFit};

use crate::compare::luma::Luma;
use crate::compare::motion::Motion;
use crate::compare::place::Place;
use crate::compare::search::Search;

/// Of what agrees the edge is within so many pixels of where it is told.
const AGREES: f64 = 1.0;

/// Two stills laid on each other.
pub(crate) struct Alignment {
    pub(crate) motion: Motion,
    /// What the edges say of the motion that is still to be made, about nothing.
    pub(crate) fit: TurnFit,
    /// Of every place whether the new still shows it, and whether its edge is where it is told.
    pub(crate) found: Vec<Option<bool>>,
}

impl Alignment {
    /// The alignment nearest to a motion, looked for within so many pixels, pass by pass.
    pub(crate) fn new(
        camera: &Camera,
        luma: &Luma,
        places: &[Place],
        mut motion: Motion,
        of: Estimated,
        reaches: &[usize],
    ) -> Option<Self> {
        let mut last = None;
        for &reach in reaches {
            let search = Search::new(camera, luma, &motion);
            let offsets: Vec<Option<EdgeOffset>> =
                places.iter().map(|place| search.offset(place, reach)).collect();
            let told: Vec<EdgeOffset> = offsets.iter().flatten().copied().collect();
            let fit = TurnFit::new(&told, of)?;
            motion = motion.then(&fit);
            last = Some((search, offsets, fit));
        }
        let (search, offsets, fit) = last?;
        let mut told = offsets.iter().flatten().zip(&fit.weights);
        let found = offsets.iter().zip(places).map(|(offset, place)| {
            let agrees = offset.is_some()
                && told.next().is_some_and(|(row, &weight)| weight > 0.0 && is_near(row, &fit));
            search.shows(place).then_some(agrees)
        });
        let found = found.collect();
        Some(Self { motion, found, fit })
    }

    /// The share of places that are found again, of those that the new still shows.
    pub(crate) fn share(&self) -> f64 {
        let shown = self.found.iter().flatten().count();
        self.agreeing() as f64 / shown.max(1) as f64
    }

    /// How many places are found again.
    pub(crate) fn agreeing(&self) -> usize {
        self.found.iter().flatten().filter(|agrees| **agrees).count()
    }

    /// How many parts of the image have places that are found again, each counted up to a few.
    pub(crate) fn voices(&self, places: &[Place]) -> usize {
        const VOICE: usize = 6;
        let mut parts = std::collections::BTreeMap::new();
        for (place, _) in places.iter().zip(&self.found).filter(|(_, found)| **found == Some(true)) {
            *parts.entry(place.block).or_insert(0) += 1;
        }
        parts.into_values().map(|count: usize| count.min(VOICE)).sum()
    }
}

fn is_near(row: &EdgeOffset, fit: &TurnFit) -> bool {
    (row.offset - row.told(&fit.estimate)).abs() < AGREES
}

/// The share of places that look found where nothing can be: what chance finds, the mean of a few turns aside.
pub(crate) fn by_chance(camera: &Camera, luma: &Luma, places: &[Place], turn: &Turn) -> f64 {
    const ASIDE: [[f64; 2]; 4] = [[37.0, 23.0], [-41.0, 29.0], [31.0, -37.0], [-29.0, -31.0]];
    let of = |aside: [f64; 2]| {
        let [u, v] = aside.map(|pixels| pixels / camera.focal);
        let search = Search::new(camera, luma, &turn.then(&Turn::of([v, u, 0.0, 0.0])).into());
        let shown: Vec<&Place> = places.iter().filter(|place| search.shows(place)).collect();
        let near = |place: &&&Place| search.offset(place, 3).is_some_and(|row| row.offset.abs() < AGREES);
        shown.iter().filter(near).count() as f64 / shown.len().max(1) as f64
    };
    ASIDE.into_iter().map(of).sum::<f64>() / ASIDE.len() as f64
}
