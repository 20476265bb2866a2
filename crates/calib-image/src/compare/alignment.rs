//! Two stills laid on each other: passes from far to near, and how much of the old one is found again.
//!
//! An edge of the old still looked for in the new one, across itself, to a fraction of a pixel.

use calib_core::Camera;
use calib_core::camera::Turn;

use crate::compare::feature::Luma;
use crate::compare::motion::{Motion, Moved};
use crate::compare::place::{Frame, HALF, LENGTH, Likeness, Place, likeness};
use crate::{EdgeOffset, Estimated, TurnFit};

/// What looks the same correlates by so much.
const ALIKE: f64 = 0.8;
/// Another edge nearer in likeness than this might be meant.
const OTHER: f64 = 0.06;
/// Pixels across an edge that share their noise: those of one smoothing.
const SHARED: f64 = 2.5;

/// The new still of a camera that moved so.
pub(crate) struct Search<'a> {
    luma: &'a Luma,
    moved: Moved,
}

impl<'a> Search<'a> {
    pub(crate) fn new(camera: &Camera, luma: &'a Luma, motion: &Motion) -> Self {
        Self { luma, moved: motion.at(camera) }
    }

    /// Whether the new still shows a place, so far from its border that the edge can be told.
    pub(crate) fn shows(&self, place: &Place) -> bool {
        const MARGIN: f64 = 2.0 * LENGTH as f64;
        let within = |at: f64, side: usize| at > MARGIN && at < side as f64 - MARGIN;
        let shown = self.moved.shown(&place.sights[0]);
        shown.is_some_and(|at| within(at.u, self.luma.width) && within(at.v, self.luma.height))
    }

    /// How far the edge is from where it is told, if it is within so many pixels.
    pub(crate) fn offset(&self, place: &Place, reach: usize) -> Option<EdgeOffset> {
        let frame = self.frame(place)?;
        let longer: Vec<f64> = (0..LENGTH + 2 * reach)
            .map(|i| frame.brightness(self.luma, i as f64 - (HALF + reach) as f64))
            .collect::<Option<_>>()?;
        let best = best(&place.profile, &longer, reach)?;
        let (start, found) = vertex(&place.profile, &longer, best as f64);
        let noise = (1.0 - found.correlation.powi(2)) * found.square / (LENGTH - 3) as f64;
        let slopes: f64 = (0..LENGTH)
            .map(|i| {
                0.25 * (longer[(best + i + 1).min(longer.len() - 1)] - longer[(best + i).saturating_sub(1)])
                    .powi(2)
            })
            .sum();
        let scale = frame.across[0].hypot(frame.across[1]);
        let normal = frame.across.map(|c| c / scale);
        let across = |slope: [f64; 2]| slope[0] * normal[0] + slope[1] * normal[1];
        let by = self.moved.slopes(&place.sights[0])?;
        Some(EdgeOffset {
            offset: scale * (start - reach as f64),
            across: normal,
            sigma: scale * (SHARED * noise / slopes.max(f64::MIN_POSITIVE)).sqrt(),
            turn: by.turn.map(across),
            tone: place.tone,
            step: by.step.map(across),
            block: place.block,
            edge: Some(place.edge),
        })
    }

    /// Where the edge is told to run.
    fn frame(&self, place: &Place) -> Option<Frame> {
        let [at, along, across] = place.sights.each_ref().map(|sight| self.moved.shown(sight));
        let (at, along, across) = (at?, along?, across?);
        let along = [along.u - at.u, along.v - at.v];
        let length = along[0].hypot(along[1]);
        let normal = [-along[1] / length, along[0] / length];
        let scale = (across.u - at.u) * normal[0] + (across.v - at.v) * normal[1];
        (scale > 0.1 && length > 0.1).then(|| Frame { at, along, across: normal.map(|c| scale * c) })
    }
}

/// Where a profile is in a longer one, to a pixel; `None` where nothing is alike, or two are.
fn best(profile: &[f64; LENGTH], longer: &[f64], reach: usize) -> Option<usize> {
    let values: Vec<f64> =
        (0..=2 * reach).map(|start| likeness(profile, longer, start as f64).correlation).collect();
    let best = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b]))?;
    let is_peak =
        |i: usize| i > 0 && i + 1 < values.len() && values[i] >= values[i - 1] && values[i] >= values[i + 1];
    let is_other = |i: usize| i.abs_diff(best) > 1 && is_peak(i) && values[i] > values[best] - OTHER;
    let is_told = is_peak(best) && values[best] > ALIKE && !(0..values.len()).any(is_other);
    is_told.then_some(best)
}

/// The top of a likeness between pixels, by two parabolas, the second narrower.
fn vertex(profile: &[f64; LENGTH], longer: &[f64], mut at: f64) -> (f64, Likeness) {
    for half in [0.5, 0.25] {
        let [before, here, after] =
            [-half, 0.0, half].map(|step| likeness(profile, longer, at + step).correlation);
        let bend = before - 2.0 * here + after;
        if bend < -1e-12 {
            at += (0.5 * half * (before - after) / bend).clamp(-half, half);
        }
    }
    (at, likeness(profile, longer, at))
}

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
