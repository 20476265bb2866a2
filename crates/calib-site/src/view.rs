//! The calibrated camera that an id, a time and a stream mean.
//!
//! All that the solutions of a site say, in one list.

use std::fmt;

use calib_core::camera::{Camera, Covariance};
use calib_core::floor::{CameraView, Stream, StreamError};
use calib_core::outcome::{Code, Severity};

use crate::document::{Site, SiteCamera};
use crate::period::NoCamera;
use crate::site_solution::Scale;
use crate::solution::{FailureEntry, Solution, Stage, Warning};

/// Why there is no calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub enum NoView {
    /// The id means no entry.
    Camera(NoCamera),
    /// It is not calibrated, or could not be, and why.
    Uncalibrated(Option<FailureEntry>),
    /// Its lens is known, and nothing else.
    LensOnly,
    /// The stream does not go with its still.
    Stream(StreamError),
}

impl fmt::Display for NoView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera(why) => why.fmt(f),
            Self::Uncalibrated(None) => f.write_str("is not calibrated: solve the site first"),
            Self::Uncalibrated(Some(why)) => write!(f, "could not be calibrated: {why}"),
            Self::LensOnly => f.write_str(
                "is calibrated as far as its lens: draw lines that tell its focal and its lean, and solve the site again",
            ),
            Self::Stream(why) => why.fmt(f),
        }
    }
}

impl std::error::Error for NoView {}

impl Site {
    /// The calibrated camera of this id that holds at a time (RFC 3339), for the pixels of a stream.
    ///
    /// # Errors
    /// Why there is not one: see [`Site::camera_at`] and [`CameraView::with_stream`].
    pub fn view(&self, id: &str, time: Option<&str>, stream: Stream) -> Result<CameraView, NoView> {
        let view = self.view_of(self.camera_at(id, time).map_err(NoView::Camera)?)?;
        view.with_stream(stream).map_err(NoView::Stream)
    }

    /// Ids of the calibrated cameras, in the order of the file; an id of several periods once.
    #[must_use]
    pub fn calibrated(&self) -> Vec<&str> {
        let mut ids = Vec::new();
        for entry in self.cameras.iter().filter(|entry| entry.camera().is_some()) {
            if !ids.contains(&entry.id.as_str()) {
                ids.push(&entry.id);
            }
        }
        ids
    }

    /// Whether something gives the scale of a camera: a height, a length, a distance, control points, or its place on
    /// the plan. Of cameras that were solved together without any the file says so of all of them.
    #[must_use]
    pub fn scale_is_known(&self, entry: &SiteCamera) -> bool {
        let Some(solution) = &entry.solution else { return false };
        let is_assumed = says(solution, Code::ScaleAssumed);
        let scale = self.solution.as_ref().and_then(|solution| solution.scale);
        !(is_assumed || solution.stage == Stage::Refined && scale == Some(Scale::Unknown))
    }

    /// The camera of an entry as its points are to be used: where nothing gives its scale nothing is known of the error
    /// of its height, and where a hand placed it of those of its place, which is not the same as no error.
    #[must_use]
    pub fn camera_for_use(&self, entry: &SiteCamera) -> Option<Camera> {
        let camera = entry.camera()?;
        let is_by_hand = says(entry.solution.as_ref()?, Code::PlacedByHand);
        let mut open = if is_by_hand { entry.open_place(&camera) } else { Vec::new() };
        open.extend((!self.scale_is_known(entry)).then_some(Covariance::Z));
        Some(Camera { covariance: camera.covariance.without(&open), ..camera })
    }

    /// A camera of this site with what it covers, for the pixels of its still.
    ///
    /// # Errors
    /// When it is not calibrated.
    pub fn view_of(&self, entry: &SiteCamera) -> Result<CameraView, NoView> {
        let camera = self.camera_for_use(entry).ok_or_else(|| match (&entry.error, &entry.solution) {
            (None, Some(_)) => NoView::LensOnly,
            (error, _) => NoView::Uncalibrated(error.clone()),
        })?;
        let view = CameraView::new(&camera, entry.size(), self.efov_on_floor(entry));
        Ok(view.with_scale(self.scale_is_known(entry)).with_surfaces(self.covering_surfaces()))
    }
}

/// Whether a solution has a remark.
fn says(solution: &Solution, code: Code) -> bool {
    solution.warnings.iter().any(|warning| warning.code == code)
}

/// Something that an operator should know about a calibration, as the site has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FindingEntry<'a> {
    /// The id of the camera that it is about; `None` where it is about the site.
    pub camera: Option<&'a str>,
    /// Which finding, as in files: of [`Code`](calib_core::Code) or of [`FailureCode`](calib_core::FailureCode).
    pub code: &'static str,
    /// How bad it is; a camera without a result is an error.
    pub severity: Severity,
    /// What is so, in a sentence.
    pub message: &'a str,
    /// What to do, in a sentence.
    pub advice: &'a str,
}

impl Site {
    /// What the solutions say of the cameras, in their order, and then of the site.
    pub fn findings(&self) -> impl Iterator<Item = FindingEntry<'_>> {
        let of_cameras = self.cameras.iter().flat_map(|entry| {
            let warnings = entry.solution.iter().flat_map(|solution| &solution.warnings);
            let failures = entry.error.iter().map(|failure| of_failure(&entry.id, failure));
            warnings.map(|warning| of_warning(Some(&entry.id), warning)).chain(failures)
        });
        let of_site = self.solution.iter().flat_map(|solution| &solution.warnings);
        of_cameras.chain(of_site.map(|warning| of_warning(None, warning)))
    }
}

fn of_warning<'a>(
    camera: Option<&'a str>,
    Warning { code, message, advice }: &'a Warning,
) -> FindingEntry<'a> {
    FindingEntry { camera, code: code.as_str(), severity: code.severity(), message, advice }
}

fn of_failure<'a>(
    camera: &'a str,
    FailureEntry { code, message, advice }: &'a FailureEntry,
) -> FindingEntry<'a> {
    FindingEntry { camera: Some(camera), code: code.as_str(), severity: Severity::Error, message, advice }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera whose orientation three verticals and two directions tell; its height as said.
    fn solved(height: &str) -> Site {
        let text = format!(
            r#"{{"format": "calib-site", "version": 1, "cameras": [{{"id": "door", "size_px": [1920, 1080]{height},
            "annotations": [
                {{"kind": "vertical", "segments": [[[641.5, 465.0], [594.5, 105.3]], [[1325.2, 484.9], [1368.5, 105.5]],
                    [[1008.0, 352.3], [1008.4, 48.5]]]}},
                {{"kind": "parallel", "segments": [[[624.5, 759.5], [642.3, 421.9]], [[1325.8, 745.8], [1086.0, 411.5]],
                    [[989.1, 808.5], [869.1, 438.3]]]}}]}}]}}"#
        );
        let site = Site::from_json(&text).unwrap();
        site.calibrate(&crate::Options::default()).write_into(&site)
    }

    #[test]
    fn a_height_that_nobody_gave_has_an_error_that_nobody_knows() {
        let of = |height: &str| {
            let site = solved(height);
            let view = site.view("door", None, Stream::default()).unwrap();
            let mut parts = [[[0.0; 4]], [[0.0; 4]]];
            let [pixel, calibration] = &mut parts;
            view.covariances(0.0, [&[960.0], &[900.0]], 1.0, [pixel, calibration]);
            (view.scale_is_known(), parts.map(|part| part[0][0]), view.camera().covariance)
        };
        let (is_known, [pixel, calibration], covariance) = of(r#", "height_m": {"value": 3, "sigma": 0.05}"#);
        assert!(is_known && pixel > 0.0 && calibration > 0.0 && covariance.is_known());
        let (is_known, [assumed, calibration], covariance) = of("");
        assert!(!is_known && calibration.is_nan());
        assert!((assumed / pixel - 1.0).abs() < 1e-3, "the pixel's part is that of a height of 3 m");
        assert_eq!(covariance.sigma(Covariance::Z), None);
        assert!(covariance.sigma(Covariance::PITCH).is_some(), "what is known stays");
    }
}
