//! The columns of standard deviations: the pixel's part, and the calibration's, which is common to all detections
//! of a camera and must not be averaged away.

use calib_core::{FloorCovariance, Pixel};

use crate::calibrations::Calibration;

/// Standard deviations and correlation of x and y.
const NAMES: [&str; 6] =
    ["sigma_x_m", "sigma_y_m", "rho", "calibration_sigma_x_m", "calibration_sigma_y_m", "calibration_rho"];

/// As many columns; NaN where there is no point, or nobody knows.
pub(crate) struct Sigmas([Vec<f64>; NAMES.len()]);

impl Sigmas {
    pub(crate) fn unknown(rows: usize) -> Self {
        Self(std::array::from_fn(|_| vec![f64::NAN; rows]))
    }

    /// Of the points that pixels of the still show, each known to so many pixels of the stream; `covariance` is
    /// that of the point of a row, for a pixel known to so many pixels of the still.
    pub(crate) fn of(
        calibration: &Calibration,
        [u, v]: [&[f64]; 2],
        sigma: f64,
        covariance: impl Fn(usize, Pixel, f64) -> Option<FloorCovariance>,
    ) -> Self {
        let sigma = sigma * calibration.stream.still_pixels();
        let mut sigmas = Self::unknown(u.len());
        for (row, (&u, &v)) in u.iter().zip(v).enumerate() {
            let Some(found) = covariance(row, Pixel { u, v }, sigma) else { continue };
            let known = found.calibration.map(ellipse);
            let parts = ellipse(found.pixel).into_iter().chain(known.unwrap_or([f64::NAN; 3]));
            put(&mut sigmas.0, row, parts);
        }
        sigmas
    }

    pub(crate) fn put(&mut self, rows: &[usize], some: &Self) {
        for (all, some) in self.0.iter_mut().zip(&some.0) {
            rows.iter().zip(some).for_each(|(&row, &value)| all[row] = value);
        }
    }

    pub(crate) fn columns(self) -> impl Iterator<Item = (&'static str, Vec<f64>)> {
        NAMES.into_iter().zip(self.0)
    }
}

fn put(columns: &mut [Vec<f64>], row: usize, values: impl Iterator<Item = f64>) {
    columns.iter_mut().zip(values).for_each(|(column, value)| column[row] = value);
}

/// Standard deviations and correlation; no correlation of what is certain.
fn ellipse([[xx, xy], [_, yy]]: [[f64; 2]; 2]) -> [f64; 3] {
    let [x, y] = [xx, yy].map(|variance| variance.max(0.0).sqrt());
    [x, y, if x > 0.0 && y > 0.0 { (xy / (x * y)).clamp(-1.0, 1.0) } else { 0.0 }]
}
