//! Alignment of two images: iterated from a wide to a narrow search range, with the fraction of the old edges
//! found again.
//!
//! Every edge of the old image is searched in the new image, in the direction across the edge, to a fraction
//! of a pixel.

use calib_core::Camera;
use calib_core::camera::RotationZoom;

use crate::compare::edge_sample::{EdgeSample, Frame, HALF, LENGTH, ProfileMatch, match_profiles};
use crate::compare::feature::Luma;
use crate::compare::motion::{Motion, MovedCamera};
use crate::{EdgeOffset, FitParameters, RotationFit};

/// Smallest correlation of two profiles of the same edge.
const MIN_CORRELATION: f64 = 0.8;
/// Smallest difference in correlation between the best and the second position; below it the match is
/// ambiguous.
const MIN_CORRELATION_GAP: f64 = 0.06;
/// Correlation length of the noise across an edge, in pixels. The smoothing of the images causes the correlation.
const NOISE_LENGTH_PX: f64 = 2.5;

/// Search for edge samples in the new image, after an assumed motion of the camera.
pub(crate) struct Search<'a> {
    /// New image.
    luma: &'a Luma,
    /// Camera after the assumed motion.
    moved: MovedCamera,
}

impl<'a> Search<'a> {
    pub(crate) fn new(camera: &Camera, luma: &'a Luma, motion: &Motion) -> Self {
        Self { luma, moved: motion.at(camera) }
    }

    /// Whether a sample is visible in the new image, far enough from its border to locate the edge.
    pub(crate) fn is_visible(&self, place: &EdgeSample) -> bool {
        /// Smallest distance of a visible sample from the image border, in pixels.
        const MARGIN_PX: f64 = 2.0 * LENGTH as f64;
        let within = |at: f64, side: usize| at > MARGIN_PX && at < side as f64 - MARGIN_PX;
        let shown = self.moved.project(&place.sights[0]);
        shown.is_some_and(|at| within(at.u, self.luma.width) && within(at.v, self.luma.height))
    }

    /// Measures the offset of the edge from its predicted position; `None` if the edge is not found within
    /// `reach` pixels.
    pub(crate) fn offset(&self, place: &EdgeSample, reach: usize) -> Option<EdgeOffset> {
        let frame = self.frame(place)?;
        let longer: Vec<f64> = (0..LENGTH + 2 * reach)
            .map(|i| frame.brightness(self.luma, i as f64 - (HALF + reach) as f64))
            .collect::<Option<_>>()?;
        let best = locate_profile(&place.profile, &longer, reach)?;
        let (start, found) = refine_position(&place.profile, &longer, best as f64);
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
        let by = self.moved.derivatives(&place.sights[0])?;
        Some(EdgeOffset {
            offset: scale * (start - reach as f64),
            across: normal,
            sigma: scale * (NOISE_LENGTH_PX * noise / slopes.max(f64::MIN_POSITIVE)).sqrt(),
            by_rotation: by.turn.map(across),
            by_tone: place.tone,
            by_step: by.step.map(across),
            block: place.block,
            edge: Some(place.edge),
        })
    }

    /// Returns the predicted position and direction of the edge in the new image; `None` outside the lens, or if one
    /// pixel of the old image becomes less than a tenth of a pixel.
    fn frame(&self, place: &EdgeSample) -> Option<Frame> {
        let [at, along, across] = place.sights.each_ref().map(|sight| self.moved.project(sight));
        let (at, along, across) = (at?, along?, across?);
        let along = [along.u - at.u, along.v - at.v];
        let length = along[0].hypot(along[1]);
        let normal = [-along[1] / length, along[0] / length];
        let scale = (across.u - at.u) * normal[0] + (across.v - at.v) * normal[1];
        (scale > 0.1 && length > 0.1).then(|| Frame { at, along, across: normal.map(|c| scale * c) })
    }
}

/// Locates a profile in a longer profile, to a pixel. Returns `None` if no position, or more than one
/// position, is similar enough.
fn locate_profile(profile: &[f64; LENGTH], longer: &[f64], reach: usize) -> Option<usize> {
    let values: Vec<f64> =
        (0..=2 * reach).map(|start| match_profiles(profile, longer, start as f64).correlation).collect();
    let best = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b]))?;
    let is_peak =
        |i: usize| i > 0 && i + 1 < values.len() && values[i] >= values[i - 1] && values[i] >= values[i + 1];
    let is_other =
        |i: usize| i.abs_diff(best) > 1 && is_peak(i) && values[i] > values[best] - MIN_CORRELATION_GAP;
    let is_unique = is_peak(best) && values[best] > MIN_CORRELATION && !(0..values.len()).any(is_other);
    is_unique.then_some(best)
}

/// Refines the position `at` of the largest correlation to a fraction of a pixel, with two parabolas, the
/// second narrower.
fn refine_position(profile: &[f64; LENGTH], longer: &[f64], mut at: f64) -> (f64, ProfileMatch) {
    for half in [0.5, 0.25] {
        let [before, here, after] =
            [-half, 0.0, half].map(|step| match_profiles(profile, longer, at + step).correlation);
        let bend = before - 2.0 * here + after;
        if bend < -1e-12 {
            at += (0.5 * half * (before - after) / bend).clamp(-half, half);
        }
    }
    (at, match_profiles(profile, longer, at))
}

/// Largest distance of an inlier sample from its predicted position, in pixels.
const MAX_INLIER_OFFSET_PX: f64 = 1.0;

/// Alignment of two images: the motion of the camera, and the edge samples found again.
pub(crate) struct Alignment {
    /// Motion of the camera from the old to the new image.
    pub(crate) motion: Motion,
    /// Fit of the last iteration; its motion is close to zero after convergence.
    pub(crate) fit: RotationFit,
    /// Result of every sample: `None` outside the new image, otherwise whether its edge is at the predicted
    /// position.
    pub(crate) found: Vec<Option<bool>>,
}

impl Alignment {
    /// Aligns the new image `luma` to the samples `places` of the old image, starting from `motion`. `of` selects
    /// the fitted parameters. Each iteration searches within the next distance of `reaches`, in pixels.
    /// Returns `None` if the edges do not determine the parameters.
    pub(crate) fn new(
        camera: &Camera,
        luma: &Luma,
        places: &[EdgeSample],
        mut motion: Motion,
        of: FitParameters,
        reaches: &[usize],
    ) -> Option<Self> {
        let mut last = None;
        for &reach in reaches {
            let search = Search::new(camera, luma, &motion);
            let offsets: Vec<Option<EdgeOffset>> =
                places.iter().map(|place| search.offset(place, reach)).collect();
            let measured: Vec<EdgeOffset> = offsets.iter().flatten().copied().collect();
            let fit = RotationFit::new(&measured, of)?;
            motion = motion.then(&fit);
            last = Some((search, offsets, fit));
        }
        let (search, offsets, fit) = last?;
        let mut measured = offsets.iter().flatten().zip(&fit.weights);
        let found = offsets.iter().zip(places).map(|(offset, place)| {
            let agrees = offset.is_some()
                && measured.next().is_some_and(|(row, &weight)| weight > 0.0 && is_inlier(row, &fit));
            search.is_visible(place).then_some(agrees)
        });
        let found = found.collect();
        Some(Self { motion, found, fit })
    }

    /// Returns the fraction of the visible samples that are found again.
    pub(crate) fn found_fraction(&self) -> f64 {
        let shown = self.found.iter().flatten().count();
        self.inliers() as f64 / shown.max(1) as f64
    }

    /// Returns the number of samples found again.
    pub(crate) fn inliers(&self) -> usize {
        self.found.iter().flatten().filter(|agrees| **agrees).count()
    }

    /// Returns the number of samples found again, limited to a few for each block. The number measures the
    /// coverage of the image.
    pub(crate) fn coverage(&self, places: &[EdgeSample]) -> usize {
        /// Largest number of samples counted in one block.
        const MAX_SAMPLES_PER_BLOCK: usize = 6;
        let mut parts = std::collections::BTreeMap::new();
        for (place, _) in places.iter().zip(&self.found).filter(|(_, found)| **found == Some(true)) {
            *parts.entry(place.block).or_insert(0) += 1;
        }
        parts.into_values().map(|count: usize| count.min(MAX_SAMPLES_PER_BLOCK)).sum()
    }
}

/// Whether an edge is at the position that the fit predicts.
fn is_inlier(row: &EdgeOffset, fit: &RotationFit) -> bool {
    (row.offset - row.predicted(&fit.estimate)).abs() < MAX_INLIER_OFFSET_PX
}

/// Returns the fraction of visible samples found by chance: the mean over a few deliberately wrong rotations.
/// `turn` is the correct rotation.
pub(crate) fn chance_fraction(
    camera: &Camera,
    luma: &Luma,
    places: &[EdgeSample],
    turn: &RotationZoom,
) -> f64 {
    /// Approximate displacements of the image by the wrong rotations that are tried to measure chance matches, in
    /// pixels along u and v.
    const WRONG_DISPLACEMENTS_PX: [[f64; 2]; 4] =
        [[37.0, 23.0], [-41.0, 29.0], [31.0, -37.0], [-29.0, -31.0]];
    let of = |aside: [f64; 2]| {
        let [u, v] = aside.map(|pixels| pixels / camera.focal);
        let search = Search::new(
            camera,
            luma,
            &turn.followed_by(&RotationZoom::from_parameters([v, u, 0.0, 0.0])).into(),
        );
        let shown: Vec<&EdgeSample> = places.iter().filter(|place| search.is_visible(place)).collect();
        let near = |place: &&&EdgeSample| {
            search.offset(place, 3).is_some_and(|row| row.offset.abs() < MAX_INLIER_OFFSET_PX)
        };
        shown.iter().filter(near).count() as f64 / shown.len().max(1) as f64
    };
    WRONG_DISPLACEMENTS_PX.into_iter().map(of).sum::<f64>() / WRONG_DISPLACEMENTS_PX.len() as f64
}
