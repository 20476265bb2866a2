//! Test for a moved camera: near and far edges then do not fit one rotation.
//!
//! A rotation `x` and a step `t` of the camera shift a floor point at depth `z` by `a' x + b' t / z`. The
//! depth of the floor is known from the calibration. Both are estimated together from all edges, as if each
//! were on the floor or far away. Other edges are outliers, like moving objects. If the floor moved farther
//! than the search range for edges, corners provide a first estimate of the step.

use calib_core::Camera;

use calib_core::camera::RotationZoom;

use crate::{EdgeOffset, FitParameters, RotationFit, STEP_SIZE, TONE_SIZE};
use nalgebra::{DMatrix, DVector};

use crate::compare::alignment::Alignment;
use crate::compare::coarse::{AXES, CornerMatch, XorShift, coverage};
use crate::compare::feature::Luma;
use crate::compare::motion::{Motion, MovedCamera};
use crate::compare::place::EdgeSample;

/// Two images aligned by a rotation and a step.
pub(crate) struct StepAlignment(Alignment);

impl StepAlignment {
    /// Aligns the images from two start values: the rotation alone, and a step estimated from corners. Failed
    /// alignments are omitted, for example without visible floor.
    pub(crate) fn candidates<'a>(
        camera: &Camera,
        luma: &Luma,
        places: &[EdgeSample],
        corners: impl FnOnce() -> &'a [CornerMatch],
        turned: &Alignment,
    ) -> Vec<Self> {
        /// Fraction of samples found again above which no edge is outside the search range.
        const ALL: f64 = 0.9;
        let far =
            if turned.found_fraction() > ALL { None } else { coarse_step(camera, corners(), turned.motion) };
        let from = |motion: Motion| {
            Alignment::new(camera, luma, places, motion, FitParameters::RotationToneAndStep, &[5, 3, 2, 2])
        };
        [Some(turned.motion), far].into_iter().flatten().filter_map(from).map(Self).collect()
    }

    /// Whether the step is significant, and at least as many samples are found with it as without. `chance`
    /// is the fraction of samples found by chance.
    pub(crate) fn is_significant(
        &self,
        camera: &Camera,
        places: &[EdgeSample],
        turned: &Alignment,
        chance: f64,
    ) -> bool {
        /// Smallest z-score of a significant step. It is larger than for a rotation, because errors of the
        /// lens model affect near and far edges in the same way.
        const CLEAR: f64 = 5.0;
        /// Smallest effect of the step on the image, relative to the rotation alone, RMS in pixels.
        const LEAST: f64 = 0.5;
        let is_better = self.0.coverage(places) >= turned.coverage(places);
        is_better
            && self.is_found(turned, chance)
            && self.z_score() > CLEAR
            && self.effect(camera, places, turned) > LEAST
    }

    /// Whether most inliers are not found by chance, or are significantly more than with the rotation alone.
    /// Chance finds as many samples with a step as with a rotation.
    fn is_found(&self, turned: &Alignment, chance: f64) -> bool {
        const TIMES: f64 = 4.0;
        /// Smallest significant difference of the two inlier counts, in standard deviations of the difference
        /// of Poisson counts.
        const CLEAR: f64 = 4.0;
        let by_chance = chance * self.0.found.iter().flatten().count() as f64;
        let [with, without] = [&self.0, turned].map(|found| found.inliers() as f64);
        with > TIMES * by_chance || with - without > CLEAR * (2.0 * by_chance).sqrt()
    }

    fn z_score(&self) -> f64 {
        let from = RotationZoom::SIZE + TONE_SIZE;
        let mut whole = self.0.fit.clone();
        whole.estimate.rows_mut(from, STEP_SIZE).copy_from_slice(&self.0.motion.step);
        whole.z_score(from, from + STEP_SIZE)
    }

    /// Returns the distance of the floor from its position under the rotation alone, RMS in pixels.
    fn effect(&self, camera: &Camera, places: &[EdgeSample], turned: &Alignment) -> f64 {
        let [with, without] = [self.0.motion, turned.motion].map(|motion| motion.at(camera));
        let apart = |place: &EdgeSample| {
            let sight = &place.sights[0];
            Some(with.project(sight)?.distance(without.project(sight)?).powi(2))
        };
        let squares: Vec<f64> = places.iter().filter_map(apart).collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

/// Estimates the step with the highest inlier count, starting from a rotation; `None` if too few corners
/// agree.
fn coarse_step(camera: &Camera, seen: &[CornerMatch], turned: Motion) -> Option<Motion> {
    /// Number of pairs to try.
    const PAIRS: usize = 2000;
    /// Smallest count of agreeing corners; fewer agree by chance.
    const LEAST: usize = 8;
    let here = turned.at(camera);
    let rows: Vec<Option<[EdgeOffset; 2]>> = seen.iter().map(|seen| rows(&here, seen)).collect();
    let mut chance = XorShift(0x2545_f491_4f6c_dd1d);
    let mut best: Option<(Motion, usize)> = None;
    for _ in 0..PAIRS {
        let [a, b] = [0, 1].map(|_| chance.below(seen.len().max(1)));
        let (Some(a), Some(b)) = (rows.get(a)?, rows.get(b)?) else { continue };
        let Some(step) = step_from_pair([a, b]) else { continue };
        let motion = Motion { step: std::array::from_fn(|k| turned.step[k] + step[k]), ..turned };
        let count = inlier_coverage(&motion.at(camera), seen);
        if best.is_none_or(|(_, most)| count > most) {
            best = Some((motion, count));
        }
    }
    let (motion, _) = best.filter(|(_, voices)| *voices >= LEAST)?;
    Some(refined(camera, seen, motion))
}

fn inlier_coverage(moved: &MovedCamera, seen: &[CornerMatch]) -> usize {
    coverage(seen.iter().filter(|seen| agrees(moved, seen)))
}

fn agrees(moved: &MovedCamera, seen: &CornerMatch) -> bool {
    moved.project(&seen.sight).is_some_and(|shown| shown.distance(seen.at) < seen.max_distance)
}

/// Computes the step from two corners, by least squares.
fn step_from_pair(pair: [&[EdgeOffset; 2]; 2]) -> Option<[f64; STEP_SIZE]> {
    let rows: Vec<&EdgeOffset> = pair.into_iter().flatten().collect();
    let slopes = DMatrix::from_fn(rows.len(), STEP_SIZE, |i, k| rows[i].by_step[k]);
    let offsets = DVector::from_fn(rows.len(), |i, _| rows[i].offset);
    let step = (slopes.transpose() * &slopes).cholesky()?.solve(&(slopes.transpose() * offsets));
    Some([step[0], step[1], step[2]])
}

/// Refines rotation and step with all inliers.
fn refined(camera: &Camera, seen: &[CornerMatch], mut motion: Motion) -> Motion {
    for _ in 0..6 {
        let moved = motion.at(camera);
        let agreeing = seen.iter().filter(|seen| agrees(&moved, seen));
        let rows: Vec<EdgeOffset> = agreeing.filter_map(|seen| rows(&moved, seen)).flatten().collect();
        let Some(fit) = RotationFit::new(&rows, FitParameters::RotationToneAndStep) else { return motion };
        motion = motion.then(&fit);
    }
    motion
}

/// Converts the two coordinates of a corner to two edge offsets.
fn rows(moved: &MovedCamera, seen: &CornerMatch) -> Option<[EdgeOffset; 2]> {
    let (at, slopes) = (moved.project(&seen.sight)?, moved.derivatives(&seen.sight)?);
    let off = [seen.at.u - at.u, seen.at.v - at.v];
    Some([0, 1].map(|axis| EdgeOffset {
        offset: off[axis],
        across: AXES[axis],
        sigma: 0.2 * seen.max_distance,
        by_rotation: slopes.turn.map(|slope| slope[axis]),
        by_tone: [0.0; TONE_SIZE],
        by_step: slopes.step.map(|slope| slope[axis]),
        block: seen.part,
        edge: None,
    }))
}
