//! Recovery of a rotated camera: solved again from annotations transferred to the new image, or refused if
//! unreliable.

use std::fmt;

use calib_core::{Camera, Covariance};

use calib_site::{NewImage, Options, Recovered, Site, SiteCamera};
use image::RgbImage;

use crate::compare::carry::Carry;
use crate::compare::comparison::{Became, Comparison};

/// Smallest fraction of the annotations that must be transferred for a calibration.
const LEAST: f64 = 0.5;
/// Largest distance between the solution and the measured rotation, in standard deviations of the solution.
const APART: f64 = 4.0;

/// Reason why a camera is not recovered.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// Camera without a solution.
    NotCalibrated,
    /// Change other than a rotation; only a rotation preserves the position.
    NoTurn(Became),
    /// Camera without annotations.
    NothingDrawn,
    /// New image dated outside the validity period of the calibration.
    OtherPeriod(String),
    /// Only `.0` of `.1` lines and points found in the new image.
    TooLittle(usize, usize),
    /// Transferred annotations without a solution; contains the reason.
    Unsolved(String),
    /// Solution that contradicts the measured rotation, with the distance in standard deviations.
    Apart(f64),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotCalibrated => f.write_str("it is not calibrated: solve it first"),
            Self::NoTurn(Became::Shifted) => {
                write!(f, "{}; its old place is no longer its place; draw on the new still", Became::Shifted)
            }
            Self::NoTurn(became) => write!(f, "{became}; take another still, or draw on this one"),
            Self::NothingDrawn => {
                f.write_str("nothing is drawn on it that could be carried; draw on the new still")
            }
            Self::OtherPeriod(time) => {
                write!(f, "its calibration does not hold at {time}: see its valid_from and valid_to")
            }
            Self::TooLittle(carried, all) => write!(
                f,
                "of {all} lines and points that were drawn the new still shows {carried}; draw on it"
            ),
            Self::Unsolved(why) => write!(f, "the lines that were carried do not solve it: {why}"),
            Self::Apart(sigmas) => write!(
                f,
                "solved from its carried lines it is {sigmas:.1} sigmas from where the edges of the image turned it; \
                 draw on the new still"
            ),
        }
    }
}

impl std::error::Error for Refusal {}

/// Returns the site with a new validity period of the camera `index`, solved from annotations transferred
/// from the old image. The old period ends at the start of the new one.
///
/// # Errors
/// If the result would be unreliable.
pub fn recovered(
    site: &Site,
    index: usize,
    comparison: &Comparison,
    [old, new]: [&RgbImage; 2],
    still: &NewImage,
) -> Result<Recovered, Refusal> {
    let entry = site.cameras.get(index).ok_or(Refusal::NotCalibrated)?;
    let camera = entry.camera().ok_or(Refusal::NotCalibrated)?;
    check(entry, comparison.became, &still.since)?;
    let carry = Carry::new(&camera, comparison.turn, old, new);
    let carried = site.recovered(index, &comparison.turn, &carry, still).ok_or(Refusal::NotCalibrated)?;
    let all = carried.carried + carried.left_out.len();
    if (carried.carried as f64) < LEAST * all as f64 {
        return Err(Refusal::TooLittle(carried.carried, all));
    }
    let told = comparison.turn.applied(&camera);
    Ok(Recovered { site: solved(&carried.site, index, &camera, &told)?, ..carried })
}

/// Checks the conditions for a recovery before anything is transferred.
fn check(entry: &SiteCamera, became: Became, since: &str) -> Result<(), Refusal> {
    if became != Became::Moved {
        return Err(Refusal::NoTurn(became));
    }
    if entry.annotations.is_empty() {
        return Err(Refusal::NothingDrawn);
    }
    let is_divided = entry.is_divided_at(since).unwrap_or_default();
    if is_divided { Ok(()) } else { Err(Refusal::OtherPeriod(since.to_owned())) }
}

/// Solves the new entry and leaves the other cameras unchanged.
fn solved(site: &Site, index: usize, old: &Camera, told: &Camera) -> Result<Site, Refusal> {
    let id = site.cameras[index].id.clone();
    let mut report = site.calibrate(&Options { cameras: Some(vec![id]), ..Options::default() });
    report.cameras.retain(|(of, _)| *of == index);
    let site = report.write_into(site);
    let entry = &site.cameras[index];
    let why = || entry.error.as_ref().map(|error| error.message.clone()).unwrap_or_default();
    let found = entry.camera().ok_or_else(|| Refusal::Unsolved(why()))?;
    match apart(old, told, &found) {
        sigmas if sigmas < APART => Ok(site),
        sigmas => Err(Refusal::Apart(sigmas)),
    }
}

/// Returns the largest distance between the new solution and the pose predicted by the measured rotation, in
/// combined standard deviations. The prediction has the standard deviations of the old solution.
fn apart(old: &Camera, told: &Camera, found: &Camera) -> f64 {
    use Covariance as Of;
    let off = [
        (Of::PITCH, told.pitch - found.pitch, 1.0),
        (Of::ROLL, told.roll - found.roll, 1.0),
        (Of::FOCAL, told.focal - found.focal, told.focal / old.focal),
    ];
    let sigmas = off.map(|(index, off, scale)| {
        let before = scale * old.covariance.sigma(index).unwrap_or_default();
        let sigma = found.covariance.sigma(index).unwrap_or_default().hypot(before);
        if sigma > 0.0 { off.abs() / sigma } else { 0.0 }
    });
    sigmas.into_iter().fold(0.0, f64::max)
}
