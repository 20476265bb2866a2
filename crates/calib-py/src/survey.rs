//! Coverage of a site and measurements in its images.

use calib_core::Pixel;
use calib_core::floor::DensityLevel;
use calib_site::{
    CoverageError, CoverageOptions, Measurement, MeasurementError, MeasurementKind, MeasurementPoint,
    SiteCamera,
};
use numpy::{PyArray1, PyArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::array::finite;
use crate::error::{camera_error, value_error};
use crate::site::{Site, time};

#[pymethods]
impl Site {
    /// Computes the floor points that the cameras see, and their pixel densities.
    ///
    /// A camera sees a target if the foot of the target is in the camera's EFOV, its top is in the image, and no wall
    /// of the site is between camera and target.
    ///
    /// Args:
    ///     height: height of the targets above the floor, in metres.
    ///     step: distance between grid points, in metres; None chooses it from the size of the site.
    ///     level: level that all areas must reach in place of their own: "monitor", "detect", "observe",
    ///         "recognise" or "identify".
    ///     at: time (RFC 3339, or a datetime with a time zone); required if an id has several periods.
    ///
    /// Returns:
    ///     A dict. "x" (columns,) and "y" (rows,) are the coordinates of the grid, in metres. "px_per_m" (rows,
    ///     columns) is the pixel density of the best camera in pixels per metre, 0 for a blind spot. "best"
    ///     (rows, columns) is the index of this camera in the list "cameras", or -1. "seen_by" (rows, columns)
    ///     is the number of cameras. "areas" is a list of dicts with "id", "level", "met", "share",
    ///     "blind_share" and "worst_px_per_m". "left_out" lists cameras without a position relative to the others,
    ///     "scale_assumed" cameras whose distances and densities can be wrong by a common factor. "hand_overs" is a
    ///     list of dicts for the floor that two cameras see, the largest first: "cameras", "area" in square metres,
    ///     "middle" (x, y), "disagreement" and "worst_disagreement" (expected RMS distance between the positions that
    ///     the two cameras compute for one target, over the zone and at its worst point, in metres), and "unknown"
    ///     (the reason if they are None).
    #[pyo3(signature = (*, height=0.0, step=None, level=None, at=None))]
    fn coverage<'py>(
        &self,
        py: Python<'py>,
        height: f64,
        step: Option<f64>,
        level: Option<&str>,
        at: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let height = finite(py, "height", height)?;
        if let Some(step) = step.filter(|step| !(step.is_finite() && *step >= 1e-3)) {
            return Err(value_error(py, None, "step", format_args!("found {step}, expected at least 0.001")));
        }
        let level = level.map(|name| level_of(py, name)).transpose()?;
        let options = CoverageOptions { height, step, level, points_per_zone: None };
        let site = match at {
            Some(at) => self.valid_at(py, &time(at, None)?)?,
            None => self.0.clone(),
        };
        let found = py.detach(|| site.coverage(&options)).map_err(|why| match &why {
            CoverageError::SeveralPeriods { camera } => {
                camera_error(py, camera, format_args!("{why} with at="))
            }
            _ => value_error(py, None, "coverage", &why),
        })?;
        let hand_overs = PyList::empty(py);
        for zone in &found.hand_overs {
            let disagreement = zone.disagreement.ok();
            let entry = PyDict::new(py);
            entry.set_item("cameras", found.ids_of(zone).to_vec())?;
            entry.set_item("area", found.area_of(zone))?;
            entry.set_item("middle", (zone.middle.x, zone.middle.y))?;
            entry.set_item("disagreement", disagreement.map(|known| known.rms))?;
            entry.set_item("worst_disagreement", disagreement.map(|known| known.worst))?;
            entry.set_item("unknown", zone.disagreement.err().map(|why| found.unknown_text(why)))?;
            hand_overs.append(entry)?;
        }
        let grid = found.grid;
        let shape = [grid.rows, grid.columns];
        let numbers = |list: Vec<i64>| PyArray1::from_vec(py, list).reshape(shape);
        let best = |camera: &Option<usize>| camera.map_or(-1, |index| index as i64);
        let result = PyDict::new(py);
        result.set_item("x", PyArray1::from_iter(py, (0..grid.columns).map(|at| grid.point(at).x)))?;
        let first_of_row = |row: usize| grid.point(row * grid.columns).y;
        result.set_item("y", PyArray1::from_iter(py, (0..grid.rows).map(first_of_row)))?;
        result.set_item("px_per_m", PyArray1::from_vec(py, found.coverage.density).reshape(shape)?)?;
        result.set_item("best", numbers(found.coverage.best.iter().map(best).collect())?)?;
        let seen_by = found.coverage.seen_by.iter().map(|&count| count as i64).collect();
        result.set_item("seen_by", numbers(seen_by)?)?;
        let ids = |entries: &[&SiteCamera]| entries.iter().map(|entry| entry.id.clone()).collect::<Vec<_>>();
        result.set_item("cameras", ids(&found.cameras))?;
        result.set_item("left_out", ids(&found.left_out))?;
        result.set_item("scale_assumed", ids(&found.scale_assumed))?;
        let areas = PyList::empty(py);
        for area in &found.areas {
            let entry = PyDict::new(py);
            entry.set_item("id", &area.area.id)?;
            entry.set_item("level", area.level.map(DensityLevel::name))?;
            entry.set_item("met", area.is_met())?;
            entry.set_item("share", area.coverage.map(|coverage| coverage.share))?;
            entry.set_item("blind_share", area.coverage.map(|coverage| coverage.blind_share))?;
            entry.set_item("worst_px_per_m", area.coverage.and_then(|coverage| coverage.worst_density))?;
            areas.append(entry)?;
        }
        result.set_item("areas", areas)?;
        result.set_item("hand_overs", hand_overs)?;
        Ok(result)
    }

    /// Measures between pixels of the images. The standard deviation contains the errors of the pixels and of
    /// the calibration.
    ///
    /// Args:
    ///     points: list of (camera, u, v): id of the camera and raw pixel.
    ///     kind: "length" through the points, "height" of the second point above the first, "area" of the
    ///         polygon, or "speed".
    ///     height: height of the points above the floor, in metres.
    ///     sigma_px: standard deviation of each pixel coordinate, in pixels; by default the camera's `sigma_px`.
    ///     times: time of each point (RFC 3339 text, or a datetime with a time zone); required for a speed.
    ///
    /// Returns:
    ///     (value, sigma): in metres, square metres or metres per second. sigma is None if the uncertainty of a
    ///     camera is unknown.
    #[pyo3(signature = (points, kind="length", *, height=0.0, sigma_px=None, times=None))]
    fn measure(
        &self,
        py: Python<'_>,
        points: Vec<(String, f64, f64)>,
        kind: &str,
        height: f64,
        sigma_px: Option<f64>,
        times: Option<Vec<Bound<'_, PyAny>>>,
    ) -> PyResult<(f64, Option<f64>)> {
        let kind = kind_of(py, kind)?;
        let height = finite(py, "height", height)?;
        if let Some(sigma) = sigma_px.filter(|sigma| !(sigma.is_finite() && *sigma > 0.0)) {
            return Err(value_error(
                py,
                None,
                "sigma_px",
                format_args!("found {sigma}, expected pixels above 0"),
            ));
        }
        if times.as_ref().is_some_and(|times| times.len() != points.len()) {
            return Err(value_error(py, None, "times", "expected one time for each point"));
        }
        let mut entries = Vec::new();
        for (index, (camera, u, v)) in points.into_iter().enumerate() {
            let at = times.as_ref().map(|times| time(&times[index], Some(&camera))).transpose()?;
            let px = Pixel { u: finite(py, "points", u)?, v: finite(py, "points", v)? };
            entries.push(MeasurementPoint {
                height_m: Some(height),
                at,
                sigma_px,
                ..MeasurementPoint::new(camera, px)
            });
        }
        let measurement = Measurement::new(kind, entries);
        let found = py.detach(|| self.0.measure(&measurement)).map_err(|why| match &why {
            MeasurementError::Camera { camera, why } => camera_error(py, camera, why),
            MeasurementError::NotComparable { cameras: [_, camera] } => camera_error(py, camera, &why),
            MeasurementError::NoDuration => value_error(py, None, "times", &why),
            _ => value_error(py, None, "points", &why),
        })?;
        Ok((found.value, found.sigma))
    }
}

/// Returns the density level with this name; fails for an unknown name.
fn level_of(py: Python<'_>, name: &str) -> PyResult<DensityLevel> {
    DensityLevel::from_name(name).ok_or_else(|| {
        let names = DensityLevel::ALL.map(DensityLevel::name).join(", ");
        value_error(py, None, "level", format_args!("found {name:?}, expected one of {names}"))
    })
}

/// Returns the kind of measurement with this name; fails for an unknown name.
fn kind_of(py: Python<'_>, name: &str) -> PyResult<MeasurementKind> {
    MeasurementKind::from_name(name).ok_or_else(|| {
        let names = MeasurementKind::ALL.map(MeasurementKind::name).join(", ");
        value_error(py, None, "kind", format_args!("found {name:?}, expected one of {names}"))
    })
}
