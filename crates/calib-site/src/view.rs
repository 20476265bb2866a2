//! Calibrated cameras by id, time and stream, and the list of all stored findings.

use std::fmt;

use calib_core::camera::{Camera, Covariance};
use calib_core::floor::{CameraView, Stream, StreamError};
use calib_core::outcome::{Code, Severity};

use crate::document::{ControlPointEntry, Georeference, Site, SiteCamera};
use crate::geographic::SurveyedPosition;
use crate::period::CameraLookupError;
use crate::site_solution::Scale;
use crate::solution::{FailureEntry, Solution, Stage, Warning};

/// Error of a lookup of a calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraViewError {
    /// Failed lookup of the camera by id and time.
    Camera(CameraLookupError),
    /// Camera without a calibration, with the reason if solving failed.
    Uncalibrated(Option<FailureEntry>),
    /// Camera with a calibrated lens, but without a calibrated pose.
    LensOnly,
    /// Stream that does not match the image of the calibration.
    Stream(StreamError),
}

impl fmt::Display for CameraViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera(why) => why.fmt(f),
            Self::Uncalibrated(None) => f.write_str("not calibrated; solve the site first"),
            Self::Uncalibrated(Some(why)) => write!(f, "calibration failed: {why}"),
            Self::LensOnly => f.write_str(
                "only the lens is calibrated; draw lines that determine the focal length and orientation, then \
                 solve the site again",
            ),
            Self::Stream(why) => why.fmt(f),
        }
    }
}

impl std::error::Error for CameraViewError {}

impl Site {
    /// Returns the calibrated camera with this id at a time (RFC 3339), for the pixels of a stream.
    ///
    /// # Errors
    /// If the camera is missing, not calibrated, or does not match the stream: see [`Site::camera_at`] and
    /// [`CameraView::with_stream`].
    pub fn view(&self, id: &str, time: Option<&str>, stream: Stream) -> Result<CameraView, CameraViewError> {
        let view = self.view_of(self.camera_at(id, time).map_err(CameraViewError::Camera)?)?;
        view.with_stream(stream).map_err(CameraViewError::Stream)
    }

    /// Returns the ids of the calibrated cameras in the order of the file, each id once.
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

    /// Whether the scale of a camera is known: from a height, length, distance, control points, or its
    /// placement on the plan. For jointly solved cameras, the scale of the whole site must be known.
    #[must_use]
    pub fn scale_is_known(&self, entry: &SiteCamera) -> bool {
        let Some(solution) = &entry.solution else { return false };
        let is_assumed = has_warning(solution, Code::ScaleAssumed);
        let scale = self.solution.as_ref().and_then(|solution| solution.scale);
        !(is_assumed || solution.stage == Stage::Refined && scale == Some(Scale::Unknown))
    }

    /// Returns the calibrated camera of an entry, for mapping points to the floor. If its scale is unknown,
    /// the variance of its height is unknown. If it was placed by hand, the variance of its position is
    /// unknown. An unknown variance is not the same as zero.
    #[must_use]
    pub fn camera_for_use(&self, entry: &SiteCamera) -> Option<Camera> {
        let camera = entry.camera()?;
        let is_by_hand = has_warning(entry.solution.as_ref()?, Code::PlacedByHand);
        let mut open = if is_by_hand { entry.unknown_pose_parameters(&camera) } else { Vec::new() };
        open.extend((!self.scale_is_known(entry)).then_some(Covariance::Z));
        Some(Camera { covariance: camera.covariance.with_unknown(&open), ..camera })
    }

    /// Returns the view of an entry of this site: its calibrated camera with its field of view, for the
    /// pixels of its image.
    ///
    /// # Errors
    /// If the camera is not calibrated.
    pub fn view_of(&self, entry: &SiteCamera) -> Result<CameraView, CameraViewError> {
        let camera = self.camera_for_use(entry).ok_or_else(|| match (&entry.error, &entry.solution) {
            (None, Some(_)) => CameraViewError::LensOnly,
            (error, _) => CameraViewError::Uncalibrated(error.clone()),
        })?;
        let view = CameraView::new(&camera, entry.size(), self.efov_on_floor(entry));
        Ok(view.with_scale(self.scale_is_known(entry)).with_surfaces(self.covering_surfaces()))
    }
}

impl Site {
    /// Returns the distance on the floor between the click of a control point and its coordinates, in metres.
    /// `camera` is the placed camera of the point, and `georeference` the position of the site on the map.
    /// `None` if the coordinates are not known in the site, or the click shows no floor.
    #[must_use]
    pub fn control_point_distance(
        &self,
        camera: &Camera,
        georeference: Option<&Georeference>,
        point: &ControlPointEntry,
    ) -> Option<f64> {
        let position = SurveyedPosition::of_control_point(point);
        let world = point.site_coordinates(self).or_else(|| self.world_on_map(&position, georeference?))?;
        Some(camera.pixel_to_floor(point.px, world.z)?.distance(world.on_floor()))
    }
}

/// Whether a solution has a warning with this code.
fn has_warning(solution: &Solution, code: Code) -> bool {
    solution.warnings.iter().any(|warning| warning.code == code)
}

/// Stored finding about a camera or the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FindingEntry<'a> {
    /// Id of the camera; `None` for a finding about the site.
    pub camera: Option<&'a str>,
    /// Code of the finding, as in files: the text of a [`Code`] or of a
    /// [`FailureCode`](calib_core::outcome::FailureCode).
    pub code: &'static str,
    /// Severity of the finding; a camera without a result is an error.
    pub severity: Severity,
    /// Description of the finding, as a sentence.
    pub message: &'a str,
    /// Advice for the operator, as a sentence.
    pub advice: &'a str,
}

impl Site {
    /// Returns all stored findings: first the findings about cameras, in the order of the file, then the
    /// findings about the site.
    pub fn findings(&self) -> impl Iterator<Item = FindingEntry<'_>> {
        let of_cameras = self.cameras.iter().flat_map(|entry| {
            let warnings = entry.solution.iter().flat_map(|solution| &solution.warnings);
            let failures = entry.error.iter().map(|failure| entry_from_failure(&entry.id, failure));
            warnings.map(|warning| entry_from_warning(Some(&entry.id), warning)).chain(failures)
        });
        let of_site = self.solution.iter().flat_map(|solution| &solution.warnings);
        of_cameras.chain(of_site.map(|warning| entry_from_warning(None, warning)))
    }
}

fn entry_from_warning<'a>(
    camera: Option<&'a str>,
    Warning { code, message, advice }: &'a Warning,
) -> FindingEntry<'a> {
    FindingEntry { camera, code: code.as_str(), severity: code.severity(), message, advice }
}

fn entry_from_failure<'a>(
    camera: &'a str,
    FailureEntry { code, message, advice }: &'a FailureEntry,
) -> FindingEntry<'a> {
    FindingEntry { camera: Some(camera), code: code.as_str(), severity: Severity::Error, message, advice }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Solves a camera whose orientation is determined by three verticals and two floor directions. `height` is
    /// additional JSON of the camera, for its height.
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
    fn assumed_height_has_an_unknown_uncertainty() {
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
        assert!((assumed / pixel - 1.0).abs() < 1e-3, "the pixel part must match a height of 3 m");
        assert_eq!(covariance.sigma(Covariance::Z), None);
        assert!(covariance.sigma(Covariance::PITCH).is_some(), "known uncertainties must not change");
    }
}
