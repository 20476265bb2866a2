//! Measurements in the images of a site: lengths, heights, areas and speeds, with standard deviations.

use std::fmt;

use calib_core::camera::{Camera, Covariance, Pixel};
use calib_core::floor::{CameraView, Measured, Ruler, RulerPoint, Status};
use jiff::Timestamp;

use crate::document::{Site, SiteCamera};
use crate::frame::Frame;
use crate::survey_entries::{Measurement, MeasurementKind, MeasurementPoint};
use crate::view::CameraViewError;

/// Error of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub enum MeasurementError {
    /// The measurement has too few points for its kind.
    TooFewPoints {
        /// Smallest number of points for this kind of measurement.
        least: usize,
        /// Number of points of the measurement.
        found: usize,
    },
    /// The camera of a point cannot be used.
    Camera {
        /// Id of the camera.
        camera: String,
        /// Reason why the camera cannot be used.
        why: CameraViewError,
    },
    /// Two cameras do not have a common coordinate system.
    NotComparable {
        /// Ids of the cameras.
        cameras: [String; 2],
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
    /// A point is on a plane other than the floor.
    OnPlane {
        /// Id of the camera.
        camera: String,
        /// Pixel of the point.
        pixel: Pixel,
        /// Id of the plane.
        plane: String,
    },
    /// A speed has neither a duration nor times of its first and last point, or the last time is not the later one.
    NoDuration,
    /// The second point of a height is not above the first.
    NotAbove,
    /// A point is too close to the horizon or to the border of the lens.
    AtBorder,
}

impl fmt::Display for MeasurementError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFewPoints { least, found } => {
                write!(f, "too few points: found {found}, expected at least {least}")
            }
            Self::Camera { camera, why } => write!(f, "camera \"{camera}\": {why}"),
            Self::NotComparable { cameras: [a, b] } => write!(
                f,
                "the cameras \"{a}\" and \"{b}\" have no common coordinate system: place both on the plan, or link them"
            ),
            Self::Point { camera, pixel: Pixel { u, v }, status } => {
                write!(f, "camera \"{camera}\": the pixel {u:.0}, {v:.0} {}", reason(*status))
            }
            Self::OnPlane { camera, pixel: Pixel { u, v }, plane } => write!(
                f,
                "camera \"{camera}\": the pixel {u:.0}, {v:.0} shows the plane \"{plane}\"; a point on a plane \
                 other than the floor cannot be measured"
            ),
            Self::NoDuration => f.write_str("a speed needs the time between the first and the last point"),
            Self::NotAbove => f.write_str("the second point is not vertically above the first"),
            Self::AtBorder => f.write_str("a point is too close to the horizon or to the border of the lens"),
        }
    }
}

impl std::error::Error for MeasurementError {}

/// Explains why a pixel cannot be measured.
const fn reason(status: Status) -> &'static str {
    match status {
        Status::AboveHorizon => {
            "shows no point at this height: it is above the horizon, or the height is above the camera"
        }
        Status::OutsideEfov => {
            "shows a point outside the camera's field of view (EFOV); draw a larger EFOV to measure there"
        }
        Status::OutsideImage => "is outside the image",
        Status::OutsideLens => "is beyond the view of the lens",
        _ => "cannot be measured",
    }
}

impl Site {
    /// Computes a measurement with its standard deviation, in metres, square metres, or metres per second.
    /// The standard deviation contains the errors of the pixels and of the calibration, with the correlation
    /// of jointly solved cameras. It is `None` if the result depends on a camera parameter of unknown uncertainty.
    ///
    /// # Errors
    /// If points or times are missing, or a camera is not calibrated. Also if a point is not on the visible floor, or
    /// if two cameras have no common coordinate system.
    pub fn measure(&self, measurement: &Measurement) -> Result<Measured, MeasurementError> {
        let Measurement { kind, points, .. } = measurement;
        let least = kind.min_points();
        if points.len() < least {
            return Err(MeasurementError::TooFewPoints { least, found: points.len() });
        }
        let (views, points_of_ruler) = self.ruler_points(*kind, points)?;
        let (entries, calibrated): (Vec<&SiteCamera>, Vec<Camera>) =
            views.iter().map(|(entry, view)| (*entry, *view.camera())).unzip();
        let between = |a: usize, b: usize| {
            if entries[a].id == entries[b].id {
                // Two periods of one camera are calibrated separately, so their errors are independent.
                return Some([[0.0; Covariance::SIZE]; Covariance::SIZE]);
            }
            let ids = [entries[a].id.as_str(), entries[b].id.as_str()];
            self.covariance_between(ids, [&calibrated[a], &calibrated[b]]).map(|covariance| *covariance)
        };
        let ruler = Ruler { cameras: &calibrated, covariance_between: &between };
        let found = match kind {
            MeasurementKind::Length | MeasurementKind::Speed => ruler.length(&points_of_ruler),
            MeasurementKind::Area => ruler.area(&points_of_ruler),
            MeasurementKind::Height => ruler.height(&points_of_ruler[0], &points_of_ruler[1]),
        };
        let missing = if *kind == MeasurementKind::Height {
            MeasurementError::NotAbove
        } else {
            MeasurementError::AtBorder
        };
        let found = found.ok_or(missing)?;
        if *kind != MeasurementKind::Speed {
            return Ok(found);
        }
        let seconds =
            measurement.duration_s.or_else(|| duration(points)).ok_or(MeasurementError::NoDuration)?;
        Ok(Measured { value: found.value / seconds, sigma: found.sigma.map(|sigma| sigma / seconds) })
    }

    /// Converts the points, and refuses points that cannot be measured. Also returns the cameras of the points,
    /// each once.
    fn ruler_points(&self, kind: MeasurementKind, points: &[MeasurementPoint]) -> Converted<'_> {
        let mut views: Vec<(&SiteCamera, CameraView)> = Vec::new();
        let mut converted = Vec::new();
        for (index, point) in points.iter().enumerate() {
            let error = |why| MeasurementError::Camera { camera: point.camera.clone(), why };
            let entry = self
                .camera_at(&point.camera, point.at.as_deref())
                .map_err(|why| error(CameraViewError::Camera(why)))?;
            let known = views.iter().position(|(other, _)| std::ptr::eq(*other, entry));
            let camera = known.unwrap_or(views.len());
            if known.is_none() {
                views.push((entry, self.view_of(entry).map_err(error)?));
            }
            self.check_comparable(views[0].0, entry)?;
            let is_head = kind == MeasurementKind::Height && index > 0;
            self.check_point(&views[camera].1, point, is_head)?;
            converted.push(RulerPoint {
                camera,
                pixel: point.px,
                height: point.height_m.unwrap_or(0.0),
                sigma: point.sigma_px.or(entry.sigma_px).unwrap_or(1.0),
            });
        }
        Ok((views, converted))
    }

    /// Returns an error if two different cameras have no common coordinate system.
    fn check_comparable(&self, first: &SiteCamera, other: &SiteCamera) -> Result<(), MeasurementError> {
        let frames = [first, other].map(|entry| self.frame(entry));
        if std::ptr::eq(first, other) || frames[0] == frames[1] && frames[0] != Frame::Own {
            return Ok(());
        }
        Err(MeasurementError::NotComparable { cameras: [first, other].map(|entry| entry.id.clone()) })
    }

    /// Refuses a point outside the image, the lens or the EFOV, and a point on a plane other than the floor. The
    /// head of a height need not be on the floor.
    fn check_point(
        &self,
        view: &CameraView,
        point: &MeasurementPoint,
        is_head: bool,
    ) -> Result<(), MeasurementError> {
        let (id, pixel, height) = (&point.camera, point.px, point.height_m.unwrap_or(0.0));
        let refused = |status| Err(MeasurementError::Point { camera: id.clone(), pixel, status });
        let (camera, extent) = (view.camera(), view.extent());
        if !extent.shows(pixel) {
            return refused(Status::OutsideImage);
        }
        if camera.pixel_to_ray(pixel).is_none() {
            return refused(Status::OutsideLens);
        }
        if is_head {
            return Ok(());
        }
        if camera.pixel_to_floor(pixel, height).is_none() {
            return refused(Status::AboveHorizon);
        }
        let surface = camera.pixel_to_surface(pixel, height, view.surfaces()).and_then(|point| point.surface);
        if let Some(plane) = surface.and_then(|index| self.planes.get(index)) {
            return Err(MeasurementError::OnPlane { camera: id.clone(), pixel, plane: plane.id.clone() });
        }
        // The EFOV is a region of the floor, so the floor point of the pixel is tested, also for a point above the
        // floor.
        match camera.pixel_to_floor(pixel, 0.0) {
            Some(floor) if !extent.contains(floor) => refused(Status::OutsideEfov),
            _ => Ok(()),
        }
    }
}

/// Returns the smallest and the largest possible speed if the times are whole seconds: the duration can then be wrong
/// by almost one second. The largest speed is `None` for a duration of one second. Returns `None` if the times are
/// finer, if the duration was entered, or for another kind of measurement.
#[must_use]
pub fn speed_limits(measurement: &Measurement, speed: f64) -> Option<(f64, Option<f64>)> {
    let seconds = duration(&measurement.points).filter(|_| measurement.duration_s.is_none())?;
    let is_whole = |point: &MeasurementPoint| {
        let time = point.at.as_ref()?.parse::<Timestamp>().ok()?;
        Some(time.subsec_nanosecond() == 0)
    };
    let ends = [measurement.points.first()?, measurement.points.last()?];
    if measurement.kind != MeasurementKind::Speed || ends.into_iter().any(|end| is_whole(end) != Some(true)) {
        return None;
    }
    let path = speed * seconds;
    Some((path / (seconds + 1.0), (seconds > 1.0).then(|| path / (seconds - 1.0))))
}

/// Cameras of a measurement, each once, and its points.
type Converted<'a> = Result<(Vec<(&'a SiteCamera, CameraView)>, Vec<RulerPoint>), MeasurementError>;

/// Returns the time from the first to the last point, in seconds; `None` if it is unknown or not positive.
fn duration(points: &[MeasurementPoint]) -> Option<f64> {
    let time = |point: &MeasurementPoint| point.at.as_ref()?.parse::<Timestamp>().ok();
    let seconds = time(points.last()?)?.duration_since(time(points.first()?)?).as_secs_f64();
    (seconds > 0.0).then_some(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speed(times: [&str; 2]) -> Measurement {
        let point = |time: &str| MeasurementPoint {
            at: Some(time.into()),
            ..MeasurementPoint::new("gate".into(), Pixel::new(1.0, 2.0))
        };
        Measurement::new(MeasurementKind::Speed, times.map(point).to_vec())
    }

    #[test]
    fn whole_seconds_limit_a_speed() {
        let of = |from, to| speed_limits(&speed([from, to]), 5.0);
        let four = of("2026-05-01T08:00:00Z", "2026-05-01T08:00:04Z").unwrap();
        assert_eq!(four, (4.0, Some(20.0 / 3.0)));
        assert_eq!(of("2026-05-01T08:00:00Z", "2026-05-01T08:00:01Z"), Some((2.5, None)));
        assert_eq!(of("2026-05-01T08:00:00.25Z", "2026-05-01T08:00:04Z"), None);
        let entered =
            Measurement { duration_s: Some(3.9), ..speed(["2026-05-01T08:00:00Z", "2026-05-01T08:00:04Z"]) };
        assert_eq!(speed_limits(&entered, 5.0), None);
    }
}
