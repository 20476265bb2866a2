//! Recovery of a rotated camera. The camera is solved again from annotations transferred to the new image. An
//! unreliable result is refused.

use std::fmt;

use calib_core::{Camera, Covariance};

use calib_site::{NewImage, Options, Recovered, Site, SiteCamera};
use image::RgbImage;

use crate::compare::comparison::{CameraChange, Comparison};
use crate::compare::transfer::AnnotationTransfer;

/// Smallest fraction of the annotations that must be transferred for a calibration.
const MIN_TRANSFERRED_FRACTION: f64 = 0.5;
/// Largest difference between the solution and the measured rotation, in combined standard deviations.
const MAX_DEVIATION_SIGMAS: f64 = 4.0;

/// Reason why a camera is not recovered.
#[derive(Clone, Debug, PartialEq)]
pub enum RecoveryError {
    /// Camera without a solution.
    NotCalibrated,
    /// Change other than a rotation, a zoom or a window; only these preserve the position.
    NotRotated(CameraChange),
    /// Camera without annotations.
    NoAnnotations,
    /// New image outside the validity period of the calibration; contains the time of the image.
    OutsidePeriod(String),
    /// Too few annotations found in the new image: `.0` of `.1` lines and points.
    TooFewFound(usize, usize),
    /// Transferred annotations without a solution; contains the reason.
    Unsolved(String),
    /// Solution that contradicts the measured rotation; contains the distance in standard deviations.
    Contradiction(f64),
}

impl fmt::Display for RecoveryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotCalibrated => f.write_str("the camera is not calibrated; calibrate it first"),
            Self::NotRotated(CameraChange::Shifted) => {
                write!(f, "{}; annotate the new image", CameraChange::Shifted)
            }
            Self::NotRotated(became) => write!(f, "{became}; take another image, or annotate the new one"),
            Self::NoAnnotations => {
                f.write_str("the old image has no annotations to transfer; annotate the new image")
            }
            Self::OutsidePeriod(time) => {
                write!(f, "its calibration is not valid at {time}; check valid_from and valid_to")
            }
            Self::TooFewFound(carried, all) => {
                write!(f, "only {carried} of {all} lines and points were found; annotate the new image")
            }
            Self::Unsolved(why) => write!(f, "the transferred lines do not determine the camera: {why}"),
            Self::Contradiction(sigmas) => write!(
                f,
                "the solution contradicts the measured rotation (by {sigmas:.1} standard deviations); annotate the new image"
            ),
        }
    }
}

impl std::error::Error for RecoveryError {}

/// Returns the site with a new validity period of the camera `index`, solved from annotations transferred
/// from the old image. The old period ends at the start of the new one.
///
/// # Errors
/// Returns an error if the camera cannot be recovered, or the result would be unreliable.
pub fn recover(
    site: &Site,
    index: usize,
    comparison: &Comparison,
    [old, new]: [&RgbImage; 2],
    new_image: &NewImage,
) -> Result<Recovered, RecoveryError> {
    let entry = site.cameras.get(index).ok_or(RecoveryError::NotCalibrated)?;
    let camera = entry.camera().ok_or(RecoveryError::NotCalibrated)?;
    check_conditions(entry, comparison.change, &new_image.since)?;
    if let Some(window) = comparison.window {
        let carried = site.windowed(index, &window.map, window.size, new_image);
        let carried = carried.ok_or(RecoveryError::NotCalibrated)?;
        return Ok(Recovered { site: solve_window(&carried.site, index)?, ..carried });
    }
    let carry = AnnotationTransfer::new(&camera, comparison.rotation, old, new);
    let carried =
        site.recovered(index, &comparison.rotation, &carry, new_image).ok_or(RecoveryError::NotCalibrated)?;
    let all = carried.carried + carried.left_out.len();
    if (carried.carried as f64) < MIN_TRANSFERRED_FRACTION * all as f64 {
        return Err(RecoveryError::TooFewFound(carried.carried, all));
    }
    let predicted = comparison.rotation.apply_to(&camera);
    Ok(Recovered { site: solve_camera(&carried.site, index, &camera, &predicted)?, ..carried })
}

/// Checks the conditions for a recovery before the transfer of annotations. `since` is the time of the new
/// image.
fn check_conditions(entry: &SiteCamera, change: CameraChange, since: &str) -> Result<(), RecoveryError> {
    if !matches!(change, CameraChange::Moved | CameraChange::Windowed) {
        return Err(RecoveryError::NotRotated(change));
    }
    if entry.annotations.is_empty() {
        return Err(RecoveryError::NoAnnotations);
    }
    let is_divided = entry.is_divided_at(since).unwrap_or_default();
    if is_divided { Ok(()) } else { Err(RecoveryError::OutsidePeriod(since.to_owned())) }
}

/// Solves the camera with this index, whose image shows a window of the old image. The other cameras of the site
/// stay unchanged.
fn solve_window(site: &Site, index: usize) -> Result<Site, RecoveryError> {
    let site = solved_alone(site, index);
    let entry = &site.cameras[index];
    let why = || entry.error.as_ref().map(|error| error.message.clone()).unwrap_or_default();
    if entry.camera().is_none() { Err(RecoveryError::Unsolved(why())) } else { Ok(site) }
}

/// Returns the site with a new solution of the camera with this index.
fn solved_alone(site: &Site, index: usize) -> Site {
    let id = site.cameras[index].id.clone();
    let mut report = site.calibrate(&Options { cameras: Some(vec![id]), ..Options::default() });
    report.cameras.retain(|(of, _)| *of == index);
    report.write_into(site)
}

/// Solves the camera with this index and compares the solution with the predicted camera. The other cameras
/// of the site stay unchanged.
fn solve_camera(site: &Site, index: usize, old: &Camera, predicted: &Camera) -> Result<Site, RecoveryError> {
    let site = solved_alone(site, index);
    let entry = &site.cameras[index];
    let why = || entry.error.as_ref().map(|error| error.message.clone()).unwrap_or_default();
    let found = entry.camera().ok_or_else(|| RecoveryError::Unsolved(why()))?;
    match deviation(old, predicted, &found) {
        sigmas if sigmas < MAX_DEVIATION_SIGMAS => Ok(site),
        sigmas => Err(RecoveryError::Contradiction(sigmas)),
    }
}

/// Returns the largest difference between the new solution `found` and the prediction from the measured
/// rotation, in combined standard deviations. Pitch, roll and focal length are compared. The prediction has
/// the standard deviations of the old solution.
fn deviation(old: &Camera, predicted: &Camera, found: &Camera) -> f64 {
    use Covariance as Of;
    let off = [
        (Of::PITCH, predicted.pitch - found.pitch, 1.0),
        (Of::ROLL, predicted.roll - found.roll, 1.0),
        (Of::FOCAL, predicted.focal - found.focal, predicted.focal / old.focal),
    ];
    let sigmas = off.map(|(index, off, scale)| {
        let before = scale * old.covariance.sigma(index).unwrap_or_default();
        let sigma = found.covariance.sigma(index).unwrap_or_default().hypot(before);
        if sigma > 0.0 { off.abs() / sigma } else { 0.0 }
    });
    sigmas.into_iter().fold(0.0, f64::max)
}
