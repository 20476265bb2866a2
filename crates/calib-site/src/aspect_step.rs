//! Estimate of an unknown pixel aspect for which no prior is entered.
//!
//! Under a wrong aspect, correct lines contradict each other and would be rejected. Therefore the aspect is
//! estimated from all lines, from several start values. Few lines can agree with two aspects, which then belong to
//! very different focal lengths. The usual focal length of installed cameras decides, and the other solution is
//! reported.

use std::borrow::Cow;

use calib_core::camera::Camera;
use calib_core::floor::view_angle;
use calib_core::outcome::{Failure, Finding, OtherMinimum};
use calib_core::single::{MIN_CHI2_DIFFERENCE, Prior, weak_prior};

use crate::document::{Site, SiteCamera};
use crate::options::Options;
use crate::pixel_aspect::PixelAspectEntry;
use crate::single_step::{SharedInputs, SingleFit};
use crate::solution::Alternative;

/// Pixel aspects from which the estimate starts, in equal ratios. Recorders use 0.45 to 2.
const START_ASPECTS: [f64; 11] = [0.40, 0.48, 0.58, 0.69, 0.83, 1.0, 1.2, 1.44, 1.73, 2.07, 2.49];
/// Standard deviation of the prior on the pixel aspect around each start value, relative to this value.
const START_SIGMA_REL: f64 = 0.5;

/// Solution from one start value.
struct Candidate {
    camera: Camera,
    chi2: f64,
    /// Chi-square of the annotations, plus the squared deviation of the log focal length from its usual value, in
    /// standard deviations.
    score: f64,
    single: SingleFit,
}

impl Site {
    /// Returns the fit of a camera whose pixel aspect is fitted without a prior. The estimate starts at the aspect
    /// under which all annotations agree best. Returns the fit of any other camera unchanged.
    pub(crate) fn with_best_aspect(
        &self,
        entry: &SiteCamera,
        fit: Result<SingleFit, Failure>,
        options: &Options,
        others: SharedInputs,
    ) -> Result<SingleFit, Failure> {
        /// Smallest difference of the logs of two pixel aspects that are different solutions.
        const MIN_LOG_RATIO: f64 = 0.05;
        let entered = entry.lens_of_image().and_then(|lens| lens.pixel_aspect);
        if entered != Some(PixelAspectEntry::Fit) || entry.is_given() {
            return fit;
        }
        let from = |start: &f64| self.with_start_aspect(entry, *start, options, others);
        let mut found: Vec<Candidate> = START_ASPECTS.iter().filter_map(from).collect();
        found.sort_by(|a, b| a.score.total_cmp(&b.score));
        let mut rest = found.into_iter();
        let Some(best) = rest.next() else { return fit };
        let is_other = |other: &Candidate| {
            let ratio = other.camera.lens.pixel_aspect / best.camera.lens.pixel_aspect;
            ratio.ln().abs() > MIN_LOG_RATIO && other.score - best.score < MIN_CHI2_DIFFERENCE
        };
        let other = rest.find(is_other);
        let mut single = best.single;
        if let Some(Candidate { camera: other, chi2, .. }) = other {
            let Camera { focal, pitch, roll, .. } = other;
            let others = vec![OtherMinimum { focal, pitch, roll }];
            single.result.findings.push(Finding::TwoSolutions { others, is_turned: false, next: None });
            single.result.solution.alternatives.push(Alternative {
                focal_px: focal,
                hfov_deg: view_angle(&other.lens, focal, entry.size()).to_degrees(),
                pitch_deg: pitch.to_degrees(),
                roll_deg: roll.to_degrees(),
                chi2,
            });
        }
        Ok(single)
    }

    /// Fits a camera with a pixel aspect near a start value; `None` if this fails.
    fn with_start_aspect(
        &self,
        entry: &SiteCamera,
        start: f64,
        options: &Options,
        others: SharedInputs,
    ) -> Option<Candidate> {
        let mut entry = entry.clone();
        let aspect = Prior { value: start, sigma: START_SIGMA_REL * start };
        entry.lens = entry.lens_of_image().map(Cow::into_owned);
        entry.lens.get_or_insert_default().pixel_aspect = Some(PixelAspectEntry::Prior(aspect));
        let (single, estimate) = self.fit_all_lines(&entry, options, others)?;
        let (camera, chi2) = match estimate {
            Some(estimate) => (estimate.camera, estimate.chi2),
            // Points alone determine the camera, with the pixel aspect of the start.
            None => (single.result.solution.camera()?, single.result.solution.chi2?),
        };
        let usual = weak_prior(entry.size()[0]);
        let score = chi2 + ((camera.focal.ln() - usual.value) / usual.sigma).powi(2);
        Some(Candidate { camera, chi2, score, single })
    }
}
