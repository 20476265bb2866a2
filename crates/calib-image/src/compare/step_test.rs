//! Test for a camera at another position: near and far edges then do not fit one rotation.
//!
//! Let `x` be a rotation and `t` a step (translation) of the camera. They shift the image of a floor point at
//! depth `z` by `a' x + b' t / z`, with the derivatives `a` and `b`. The depth of the floor is known from the
//! calibration. Rotation and step are estimated together from all edges, as if each edge were on the floor or
//! far away. Other edges are outliers, like moving objects. If the image of the floor moved farther than the
//! search range for edges, corners provide a first estimate of the step.

use calib_core::Camera;

use calib_core::camera::RotationZoom;

use crate::{EdgeOffset, FitParameters, RotationFit, STEP_SIZE, TONE_SIZE};
use nalgebra::{DMatrix, DVector};

use crate::compare::alignment::Alignment;
use crate::compare::coarse::{AXES, CornerMatch, coverage};
use crate::compare::edge_sample::EdgeSample;
use crate::compare::feature::Luma;
use crate::compare::motion::{Motion, MovedCamera};
use crate::xor_shift::XorShift;

/// Alignment of two images by a rotation, a zoom and a step.
pub(crate) struct StepAlignment(Alignment);

impl StepAlignment {
    /// Aligns the images from two start values: the rotation of `turned` alone, and a step estimated from
    /// `corners`. Failed alignments are omitted, for example without visible floor.
    pub(crate) fn candidates<'a>(
        camera: &Camera,
        luma: &Luma,
        places: &[EdgeSample],
        corners: impl FnOnce() -> &'a [CornerMatch],
        turned: &Alignment,
    ) -> Vec<Self> {
        /// Fraction of the visible samples found again above which the image shift is assumed to be within the
        /// search range. No start value is then estimated from the corners.
        const SUFFICIENT_FRACTION: f64 = 0.9;
        let far = if turned.found_fraction() > SUFFICIENT_FRACTION {
            None
        } else {
            coarse_step(camera, corners(), turned.motion)
        };
        let from = |motion: Motion| {
            Alignment::new(camera, luma, places, motion, FitParameters::RotationToneAndStep, &[5, 3, 2, 2])
        };
        [Some(turned.motion), far].into_iter().flatten().filter_map(from).map(Self).collect()
    }

    /// Whether the translation of the camera is significant, and explains at least as many edge
    /// samples as the rotation `turned` alone. `chance` is the fraction of samples matched by
    /// chance.
    pub(crate) fn is_significant(
        &self,
        camera: &Camera,
        places: &[EdgeSample],
        turned: &Alignment,
        chance: f64,
    ) -> bool {
        /// Smallest z-score of a significant step. It is larger than for a rotation, because errors of the
        /// lens model affect near and far edges in the same way.
        const MIN_Z_SCORE: f64 = 5.0;
        /// Smallest effect of the step on the image, relative to the rotation alone, RMS in pixels.
        const MIN_EFFECT_PX: f64 = 0.5;
        let is_better = self.0.coverage(places) >= turned.coverage(places);
        is_better
            && self.is_found(turned, chance)
            && self.z_score() > MIN_Z_SCORE
            && self.effect(camera, places, turned) > MIN_EFFECT_PX
    }

    /// Whether chance does not explain the inliers: there are far more inliers than samples found by chance, or
    /// significantly more than with the rotation `turned` alone. Chance finds as many samples with a step as with a
    /// rotation. `chance` is the fraction of samples found by chance.
    fn is_found(&self, turned: &Alignment, chance: f64) -> bool {
        /// Smallest ratio of the number of inliers to the number of samples found by chance.
        const MIN_CHANCE_RATIO: f64 = 4.0;
        /// Smallest significant difference of the two inlier counts, in standard deviations of the difference
        /// of Poisson counts.
        const MIN_DIFFERENCE_SIGMAS: f64 = 4.0;
        let by_chance = chance * self.0.found.iter().flatten().count() as f64;
        let [with, without] = [&self.0, turned].map(|found| found.inliers() as f64);
        with > MIN_CHANCE_RATIO * by_chance
            || with - without > MIN_DIFFERENCE_SIGMAS * (2.0 * by_chance).sqrt()
    }

    /// Returns the significance of the step, as a z-score.
    fn z_score(&self) -> f64 {
        let from = RotationZoom::SIZE + TONE_SIZE;
        let mut whole = self.0.fit.clone();
        whole.estimate.rows_mut(from, STEP_SIZE).copy_from_slice(&self.0.motion.step);
        whole.z_score(from, from + STEP_SIZE)
    }

    /// Returns the distance between the predicted positions of the samples with the step and with the rotation
    /// `turned` alone, RMS in pixels.
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

/// Estimates the step with the highest inlier count, starting from the rotation of `turned`. Returns `None`
/// if there are too few inliers.
fn coarse_step(camera: &Camera, seen: &[CornerMatch], turned: Motion) -> Option<Motion> {
    /// Number of pairs of corners whose steps are tested.
    const PAIR_COUNT: usize = 2000;
    /// Smallest inlier count of a step; fewer inliers occur by chance.
    const MIN_COVERAGE: usize = 8;
    let here = turned.at(camera);
    let rows: Vec<Option<[EdgeOffset; 2]>> = seen.iter().map(|seen| corner_offsets(&here, seen)).collect();
    let mut chance = XorShift(0x2545_f491_4f6c_dd1d);
    let mut best: Option<(Motion, usize)> = None;
    for _ in 0..PAIR_COUNT {
        let [a, b] = [0, 1].map(|_| chance.below(seen.len().max(1)));
        let (Some(a), Some(b)) = (rows.get(a)?, rows.get(b)?) else { continue };
        let Some(step) = step_from_pair([a, b]) else { continue };
        let motion = Motion { step: std::array::from_fn(|k| turned.step[k] + step[k]), ..turned };
        let count = inlier_coverage(&motion.at(camera), seen);
        if best.is_none_or(|(_, most)| count > most) {
            best = Some((motion, count));
        }
    }
    let (motion, _) = best.filter(|(_, voices)| *voices >= MIN_COVERAGE)?;
    Some(refine_motion(camera, seen, motion))
}

/// Counts the inliers of a moved camera, limited to a few for each part of the image.
fn inlier_coverage(moved: &MovedCamera, seen: &[CornerMatch]) -> usize {
    coverage(seen.iter().filter(|seen| is_inlier(moved, seen)))
}

/// Whether a corner is at the position that the motion predicts.
fn is_inlier(moved: &MovedCamera, seen: &CornerMatch) -> bool {
    moved.project(&seen.sight).is_some_and(|shown| shown.distance(seen.at) < seen.max_distance)
}

/// Computes the step of the camera from the offsets of two corners by least squares, in metres.
fn step_from_pair(pair: [&[EdgeOffset; 2]; 2]) -> Option<[f64; STEP_SIZE]> {
    let rows: Vec<&EdgeOffset> = pair.into_iter().flatten().collect();
    let slopes = DMatrix::from_fn(rows.len(), STEP_SIZE, |i, k| rows[i].by_step[k]);
    let offsets = DVector::from_fn(rows.len(), |i, _| rows[i].offset);
    let step = (slopes.transpose() * &slopes).cholesky()?.solve(&(slopes.transpose() * offsets));
    Some([step[0], step[1], step[2]])
}

/// Refines rotation and step with all inliers.
fn refine_motion(camera: &Camera, seen: &[CornerMatch], mut motion: Motion) -> Motion {
    for _ in 0..6 {
        let moved = motion.at(camera);
        let agreeing = seen.iter().filter(|seen| is_inlier(&moved, seen));
        let rows: Vec<EdgeOffset> =
            agreeing.filter_map(|seen| corner_offsets(&moved, seen)).flatten().collect();
        let Some(fit) = RotationFit::new(&rows, FitParameters::RotationToneAndStep) else { return motion };
        motion = motion.then(&fit);
    }
    motion
}

/// Converts the deviations of a corner from its predicted position, along u and v, to two edge offsets.
fn corner_offsets(moved: &MovedCamera, seen: &CornerMatch) -> Option<[EdgeOffset; 2]> {
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
