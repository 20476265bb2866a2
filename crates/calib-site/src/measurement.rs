//! Measurements in the images of a site: lengths, heights, areas and speeds, with standard deviations.

use std::fmt;

use calib_core::camera::{Camera, Pixel};
use calib_core::floor::{Measured, Ruler, RulerPoint, Status};
use jiff::Timestamp;

use crate::document::{Site, SiteCamera};
use crate::survey_entries::{Measurement, MeasurementKind, MeasurementPoint};
use crate::view::CameraViewError;

/// Error of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub enum MeasurementError {
    /// The kind needs more points.
    TooFewPoints {
        /// Number of points that the kind needs.
        least: usize,
        /// Number of points.
        found: usize,
    },
    /// The camera of a point cannot be used.
    Camera {
        /// Id of the camera.
        camera: String,
        /// Reason.
        why: CameraViewError,
    },
    /// The cameras do not have a common coordinate system.
    NotPlaced {
        /// Id of a camera without a place.
        camera: String,
    },
    /// A point cannot be measured.
    Point {
        /// Id of the camera.
        camera: String,
        /// Pixel of the point.
        pixel: Pixel,
        /// Status of the pixel.
        status: Status,
    },
    /// A speed needs the times of its first and last point, the last one later.
    NoDuration,
    /// The quantity does not exist: a height from straight above.
    Undefined,
}

impl fmt::Display for MeasurementError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFewPoints { least, found } => {
                write!(f, "found {found} points, expected at least {least}")
            }
            Self::Camera { camera, why } => write!(f, "camera \"{camera}\": {why}"),
            Self::NotPlaced { camera } => write!(
                f,
                "camera \"{camera}\" has no place in the site: place it on the plan or link it to another camera"
            ),
            Self::Point { camera, pixel: Pixel { u, v }, status } => {
                write!(f, "camera \"{camera}\": the pixel {u:.0}, {v:.0} {}", reason(*status))
            }
            Self::NoDuration => {
                f.write_str("a speed needs the times of the first and the last point, the last one later")
            }
            Self::Undefined => {
                f.write_str("the camera is vertically above the point and cannot show its height")
            }
        }
    }
}

impl std::error::Error for MeasurementError {}

/// Explains why a pixel cannot be measured.
const fn reason(status: Status) -> &'static str {
    match status {
        Status::AboveHorizon => "is above the horizon and shows no floor",
        Status::OutsideEfov => {
            "shows a point outside the camera's field of view (EFOV); draw a larger EFOV to measure there"
        }
        Status::OutsideImage => "is outside the image",
        Status::OutsideLens => "is outside the lens",
        _ => "cannot be measured",
    }
}

impl Site {
    /// Computes a measurement with its standard deviation, in metres, square metres, or metres per second.
    /// The standard deviation contains the errors of the pixels and of the calibration, with the correlation
    /// of jointly solved cameras. It is `None` if an error of a camera is unknown and matters.
    ///
    /// # Errors
    /// If a camera is not calibrated, a point is not on the visible floor, or a time is missing.
    pub fn measure(&self, measurement: &Measurement) -> Result<Measured, MeasurementError> {
        let Measurement { kind, points, .. } = measurement;
        let least = kind.min_points();
        if points.len() < least {
            return Err(MeasurementError::TooFewPoints { least, found: points.len() });
        }
        let cameras = self.cameras_of(points)?;
        let (entries, calibrated): (Vec<&SiteCamera>, Vec<Camera>) = cameras.into_iter().unzip();
        let points_of_ruler = self.ruler_points(*kind, points, &entries, &calibrated)?;
        let between = |a: usize, b: usize| {
            let ids = [entries[a].id.as_str(), entries[b].id.as_str()];
            self.covariance_between(ids, [&calibrated[a], &calibrated[b]]).map(|covariance| *covariance)
        };
        let ruler = Ruler { cameras: &calibrated, covariance_between: &between };
        let found = match kind {
            MeasurementKind::Length | MeasurementKind::Speed => ruler.length(&points_of_ruler),
            MeasurementKind::Area => ruler.area(&points_of_ruler),
            MeasurementKind::Height => ruler.height(&points_of_ruler[0], &points_of_ruler[1]),
        };
        let found = found.ok_or(MeasurementError::Undefined)?;
        if *kind != MeasurementKind::Speed {
            return Ok(found);
        }
        let seconds = duration(points).ok_or(MeasurementError::NoDuration)?;
        Ok(Measured { value: found.value / seconds, sigma: found.sigma.map(|sigma| sigma / seconds) })
    }

    /// Returns the calibrated cameras of the points, each once.
    fn cameras_of(
        &self,
        points: &[MeasurementPoint],
    ) -> Result<Vec<(&SiteCamera, Camera)>, MeasurementError> {
        let mut cameras: Vec<(&SiteCamera, Camera)> = Vec::new();
        for point in points {
            let error = |why| MeasurementError::Camera { camera: point.camera.clone(), why };
            let entry = self
                .camera_at(&point.camera, point.at.as_deref())
                .map_err(|why| error(CameraViewError::Camera(why)))?;
            if cameras.iter().any(|(other, _)| std::ptr::eq(*other, entry)) {
                continue;
            }
            cameras.push((entry, *self.view_of(entry).map_err(error)?.camera()));
        }
        let unplaced = |(entry, _): &&(&SiteCamera, Camera)| !entry.is_placed();
        match cameras.iter().find(unplaced) {
            Some((entry, _)) if cameras.len() > 1 => {
                Err(MeasurementError::NotPlaced { camera: entry.id.clone() })
            }
            _ => Ok(cameras),
        }
    }

    /// Converts the points, and refuses points that cannot be measured. The head of a height need not be on
    /// the floor.
    fn ruler_points(
        &self,
        kind: MeasurementKind,
        points: &[MeasurementPoint],
        entries: &[&SiteCamera],
        cameras: &[Camera],
    ) -> Result<Vec<RulerPoint>, MeasurementError> {
        let convert = |(index, point): (usize, &MeasurementPoint)| {
            let of = |entry: &&SiteCamera| {
                entry.id == point.camera
                    && self
                        .camera_at(&point.camera, point.at.as_deref())
                        .is_ok_and(|found| std::ptr::eq(found, *entry))
            };
            let camera = entries.iter().position(of).unwrap_or_default();
            let height = point.height_m.unwrap_or(0.0);
            let is_head = kind == MeasurementKind::Height && index > 0;
            let status = self.status_of(entries[camera], &cameras[camera], point.px, height, is_head);
            if status != Status::Ok {
                let camera = point.camera.clone();
                return Err(MeasurementError::Point { camera, pixel: point.px, status });
            }
            let sigma = point.sigma_px.or(entries[camera].sigma_px).unwrap_or(1.0);
            Ok(RulerPoint { camera, pixel: point.px, height, sigma })
        };
        points.iter().enumerate().map(convert).collect()
    }

    /// Returns the status of a pixel at a height above the floor.
    fn status_of(
        &self,
        entry: &SiteCamera,
        camera: &Camera,
        pixel: Pixel,
        height: f64,
        is_head: bool,
    ) -> Status {
        let efov = self.efov_on_floor(entry);
        let extent = calib_core::floor::Extent { size: entry.size(), efov: &efov };
        if !extent.shows(pixel) {
            return Status::OutsideImage;
        }
        if camera.pixel_to_ray(pixel).is_none() {
            return Status::OutsideLens;
        }
        if is_head {
            return Status::Ok;
        }
        match camera.pixel_to_floor(pixel, height) {
            None => Status::AboveHorizon,
            Some(at) if !extent.contains(at) => Status::OutsideEfov,
            Some(_) => Status::Ok,
        }
    }
}

/// Returns the time from the first to the last point, in seconds.
fn duration(points: &[MeasurementPoint]) -> Option<f64> {
    let time = |point: &MeasurementPoint| point.at.as_ref()?.parse::<Timestamp>().ok();
    let seconds = time(points.last()?)?.duration_since(time(points.first()?)?).as_secs_f64();
    (seconds > 0.0).then_some(seconds)
}
