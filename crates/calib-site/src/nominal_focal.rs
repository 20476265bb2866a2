//! Focal length from the data sheet of a camera: fields of view, or millimetres with the size of the sensor.
//!
//! A focal length `f_mm` on a sensor of the width `s_mm` is `f = f_mm w / s_mm` pixels, for an image of width w that
//! shows the whole sensor. A field of view belongs to the distorted image. The focal length solves `atan(a / f) +
//! atan(b / f) = field`, where a and b are the undistorted distances of both ends from the principal point.

use calib_core::camera::{Camera, Lens, Pixel};
use calib_core::outcome::Finding;
use calib_core::single::Known;

use crate::data_sheet::{DataSheet, NOMINAL_SIGMA_REL, Nominal, sensor_diagonal_mm};
use crate::document::{LensEntry, SiteCamera};

/// Relative standard deviation of a sensor size that is derived from the optical format, which is a rounded name.
const FORMAT_SIGMA_REL: f64 = 0.03;

impl SiteCamera {
    /// Returns the focal length in pixels from the data sheet of the camera, for the distortion and principal point
    /// of `lens`; `None` if no usable value is entered. Several values are averaged with their inverse variances as
    /// weights; a fixed value is used alone.
    #[must_use]
    pub fn data_sheet_focal(&self, lens: &Lens) -> Option<Known> {
        let entry = self.lens.as_ref()?;
        let size = self.size();
        let fields = [
            (entry.hfov_deg, [true, false]),
            (entry.vfov_deg, [false, true]),
            (entry.dfov_deg, [true, true]),
        ];
        let by_field = fields.into_iter().filter_map(|(field, axes)| {
            let field = field?;
            focal_from_field(lens, size, axes, field)
        });
        let all: Vec<Known> = by_field.chain(focal_from_millimetres(entry, size)).collect();
        if let Some(fixed) = all.iter().find(|known| known.fixed) {
            return Some(*fixed);
        }
        let weight = |known: &Known| known.sigma.map_or(0.0, |sigma| sigma.powi(-2));
        let weights: f64 = all.iter().map(weight).sum();
        let mean = all.iter().map(|known| weight(known) * known.value).sum::<f64>() / weights;
        (weights > 0.0).then(|| Known::prior(mean, weights.powf(-0.5)))
    }
}

/// Returns the focal length, in pixels, for a field of view from the data sheet, in degrees. `axes` flags the image
/// axes along which the field is measured: u, v, or both for the diagonal. Returns `None` for a wide lens, or if an
/// end of the field is outside the lens model.
fn focal_from_field(
    lens: &Lens,
    [width, height]: [f64; 2],
    axes: [bool; 2],
    field: Nominal,
) -> Option<Known> {
    if lens.distortion.is_wide() {
        return None;
    }
    let Pixel { u, v } = lens.principal_point;
    let [low, high] = [[0.0, 0.0], [width, height]]
        .map(|[x, y]| Pixel::new(if axes[0] { x } else { u }, if axes[1] { y } else { v }));
    let distance = |pixel: Pixel| Some((lens.undistort(pixel)?.u - u).hypot(lens.undistort(pixel)?.v - v));
    let ends = [distance(low)?, distance(high)?];
    let focal = |degrees: f64| {
        let shown = |focal: f64| ends.iter().map(|end| (end / focal).atan()).sum::<f64>();
        let (mut low, mut high) = (1e-3 * width, 1e4 * width);
        for _ in 0..80 {
            let middle = (low * high).sqrt();
            if shown(middle) > degrees.to_radians() { low = middle } else { high = middle }
        }
        (low * high).sqrt()
    };
    match field {
        // The usual tolerance applies to the focal length, not to the angle.
        Nominal::Number(degrees) => {
            let value = focal(degrees);
            Some(Known::prior(value, NOMINAL_SIGMA_REL * value))
        }
        Nominal::Known(Known { value, fixed, sigma }) => {
            let step = 0.01;
            let per_degree = (focal(value + step) - focal(value - step)) / (2.0 * step);
            Some(Known { value: focal(value), fixed, sigma: sigma.map(|sigma| sigma * per_degree.abs()) })
        }
    }
}

/// Returns the focal length in pixels from millimetres and the size of the sensor; `None` if one of them is unknown.
fn focal_from_millimetres(entry: &LensEntry, [width, height]: [f64; 2]) -> Option<Known> {
    let Known { value, fixed, sigma } = entry.focal_mm?.known();
    let (sensor_width, sensor_sigma) = match (entry.sensor_mm, &entry.sensor) {
        (Some([sensor_width, _]), _) => (sensor_width, 0.0),
        (None, Some(format)) => (sensor_diagonal_mm(format)? * width / width.hypot(height), FORMAT_SIGMA_REL),
        (None, None) => return None,
    };
    let focal = value * width / sensor_width;
    let sigma = sigma.map(|sigma| focal * (sigma / value).hypot(sensor_sigma));
    // The size of a sensor is not exact, even if the focal length is.
    match sigma {
        None if sensor_sigma > 0.0 => Some(Known::prior(focal, focal * sensor_sigma)),
        _ => Some(Known { value: focal, fixed, sigma }),
    }
}

/// Contradiction between the data sheet and the lines of a camera.
#[derive(Clone, Debug)]
pub(crate) struct DataSheetConflict {
    /// Focal length from the data sheet, in pixels.
    pub(crate) entered: Known,
    /// Camera that the lines determine without the data sheet.
    pub(crate) of_lines: Camera,
    /// Standard deviation of the focal length of `of_lines`, in pixels.
    pub(crate) sigma: f64,
}

impl DataSheetConflict {
    /// Returns the finding that reports both focal lengths.
    pub(crate) fn finding(&self) -> Finding {
        Finding::DataSheetConflict {
            entered: self.entered.value,
            entered_sigma: self.entered.sigma.filter(|_| !self.entered.fixed),
            estimated: self.of_lines.focal,
            sigma: self.sigma,
        }
    }
}

impl LensEntry {
    /// Returns the values of the data sheet.
    #[must_use]
    pub fn data_sheet(&self) -> DataSheet {
        DataSheet {
            fields_deg: [self.hfov_deg, self.vfov_deg, self.dfov_deg],
            focal_mm: self.focal_mm,
            sensor_mm: self.sensor_mm,
            sensor: self.sensor.clone(),
        }
    }

    /// Replaces the values of the data sheet.
    pub fn set_data_sheet(&mut self, sheet: DataSheet) {
        [self.hfov_deg, self.vfov_deg, self.dfov_deg] = sheet.fields_deg;
        (self.focal_mm, self.sensor_mm, self.sensor) = (sheet.focal_mm, sheet.sensor_mm, sheet.sensor);
    }

    /// Returns the lens entry without a focal length and without the values of the data sheet.
    #[must_use]
    pub fn without_known_focal(&self) -> Self {
        let lens = Self { focal_px: None, ..self.clone() };
        lens.without_data_sheet().unwrap_or(lens)
    }

    /// Returns the lens entry without the values of the data sheet. Returns `None` if it has no such values, or if
    /// `focal_px` or `like` replaces them.
    pub(crate) fn without_data_sheet(&self) -> Option<Self> {
        let has_data_sheet =
            [self.hfov_deg, self.vfov_deg, self.dfov_deg, self.focal_mm].iter().any(Option::is_some);
        let is_used = has_data_sheet && self.focal_px.is_none() && self.like.is_none();
        let mut lens = self.clone();
        lens.set_data_sheet(DataSheet::default());
        is_used.then_some(lens)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::camera::{BrownConrady, Distortion};

    fn camera(entry: LensEntry) -> SiteCamera {
        SiteCamera { lens: Some(entry), ..SiteCamera::new("a", [1920, 1080]) }
    }

    fn focal(entry: LensEntry) -> Known {
        let camera = camera(entry);
        camera.data_sheet_focal(&camera.lens()).unwrap()
    }

    #[test]
    fn fields_of_view_give_the_focal_length() {
        let tangent = |degrees: f64| (0.5 * degrees.to_radians()).tan();
        let by = |entry: LensEntry| focal(entry).value;
        let none = LensEntry::default;
        let wide = by(LensEntry { hfov_deg: Some(Nominal::Number(98.0)), ..none() });
        assert!((wide - 960.0 / tangent(98.0)).abs() < 1e-6, "{wide}");
        let high = by(LensEntry { vfov_deg: Some(Nominal::Number(50.0)), ..none() });
        assert!((high - 540.0 / tangent(50.0)).abs() < 1e-6, "{high}");
        let across = by(LensEntry { dfov_deg: Some(Nominal::Number(110.0)), ..none() });
        assert!((across - 960_f64.hypot(540.0) / tangent(110.0)).abs() < 1e-6, "{across}");
    }

    #[test]
    fn field_of_view_belongs_to_the_distorted_image() {
        let barrel = Distortion::BrownConrady(BrownConrady { k1: -0.1, ..BrownConrady::default() });
        let lens = Lens { distortion: barrel, focal: 900.0, ..Lens::pinhole(Pixel::new(960.0, 540.0)) };
        let camera = camera(LensEntry { hfov_deg: Some(Nominal::Number(98.0)), ..LensEntry::default() });
        let focal = camera.data_sheet_focal(&lens).unwrap().value;
        let edge = lens.undistort(Pixel::new(1920.0, 540.0)).unwrap();
        let half = ((edge.u - 960.0) / focal).atan().to_degrees();
        assert!((half - 49.0).abs() < 1e-9, "{half}");
    }

    #[test]
    fn millimetres_need_the_sensor() {
        let mm = LensEntry { focal_mm: Some(Nominal::Number(2.8)), ..LensEntry::default() };
        assert_eq!(camera(mm.clone()).data_sheet_focal(&camera(mm.clone()).lens()), None);
        let known = focal(LensEntry { sensor_mm: Some([5.6, 3.15]), ..mm.clone() });
        assert!(
            (known.value - 960.0).abs() < 1e-9 && (known.sigma.unwrap() - 28.8).abs() < 1e-9,
            "{known:?}"
        );
        let format = focal(LensEntry { sensor: Some("1/2.8".into()), ..mm });
        assert!((format.value - 2.8 * 1920.0 / 5.6).abs() < 0.02 * format.value, "{format:?}");
        assert!(format.sigma.unwrap() > 0.04 * format.value, "{format:?}");
    }

    #[test]
    fn sensor_formats_have_their_diagonals() {
        for (format, diagonal) in
            [("1/2.8", 6.46), ("1/3", 6.0), ("1/1.8", 8.9), ("2/3\"", 11.0), ("1", 16.0)]
        {
            let found = sensor_diagonal_mm(format).unwrap();
            assert!((found / diagonal - 1.0).abs() < 0.035, "{format}: {found}");
        }
        assert_eq!(sensor_diagonal_mm("big"), None);
        assert_eq!(sensor_diagonal_mm("1/0"), None);
    }

    #[test]
    fn fixed_value_is_used_alone() {
        let entry = LensEntry {
            hfov_deg: Some(Nominal::Known(Known::fixed(90.0))),
            dfov_deg: Some(Nominal::Number(130.0)),
            ..LensEntry::default()
        };
        let known = focal(entry);
        assert!(known.fixed && (known.value - 960.0).abs() < 1e-6, "{known:?}");
    }
}
