//! Charts of a wide lens: virtual pinhole views directed at groups of its pixels. A chart shows points to the
//! side of the camera and behind it. In a chart, straight lines in space are straight, and pixel noise has a
//! finite covariance.
//!
//! The rotation R maps the mean ray of the pixels to the optical axis. A bearing b (a homogeneous undistorted
//! pixel relative to the principal point) has the homogeneous chart point `A b` with
//! `A = diag(f, f, 1) R diag(1/f, 1/f, 1)`, where f is the focal length in pixels. A direction in space with
//! the vanishing point V has the vanishing point `A V` in the chart. The mean ray is computed with the
//! equidistant lens, so it does not depend on the distortion coefficients. During an estimation, charts are
//! computed from the initial lens and do not change, so derivatives are exact. A residual depends on the
//! choice of the chart only in second order.

use crate::camera::distortion::Matrix2;
use crate::camera::lens::{ByParameters, Lens};
use crate::camera::numerics::{angle_from_axis, hypot, sin_cos};
use crate::camera::pinhole::dot;
use crate::camera::space::Pixel;

/// Virtual pinhole view of a wide lens, centred on a group of its pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chart {
    /// Matrix from bearings to homogeneous chart points. A bearing is a homogeneous undistorted pixel
    /// relative to the principal point.
    from_bearing: [[f64; 3]; 3],
    /// Matrix from homogeneous chart points to bearings: the inverse of `from_bearing`.
    to_bearing: [[f64; 3]; 3],
    /// Focal length of the chart and of the lens, in pixels.
    focal: f64,
}

/// Minimum cosine of the angle between a ray and the optical axis of its chart. At larger angles, noisy
/// points do not determine a line.
const MIN_COSINE: f64 = 0.02;

impl Chart {
    /// Returns the chart of a wide lens that is centred on the given raw pixels. Returns `None` for other
    /// lenses, which need no chart.
    #[must_use]
    pub fn centred_on(lens: &Lens, pixels: &[Pixel]) -> Option<Self> {
        if !lens.distortion.is_wide() {
            return None;
        }
        let directions = pixels.iter().map(|&pixel| equidistant_direction(lens, pixel));
        let sum = directions.fold([0.0; 3], |sum, direction| std::array::from_fn(|i| sum[i] + direction[i]));
        let length = dot(&sum, &sum).sqrt();
        let middle = if length > 1e-9 { sum.map(|c| c / length) } else { [0.0, 0.0, 1.0] };
        Some(Self::rotated_to(middle, lens.focal))
    }

    /// Returns the chart whose optical axis is the unit vector (x, y, c) in camera axes. `focal` is in
    /// pixels.
    ///
    /// The chart has the smallest rotation that maps the vector to the optical axis of the camera:
    /// `I + [k] + [k]^2 / (1 + c)`. I is the identity, k the cross product of the vector and this axis, and
    /// `[k]` the matrix with `[k] x` equal to the cross product of k and x.
    fn rotated_to([x, y, c]: [f64; 3], focal: f64) -> Self {
        let share = (1.0 + c).max(1e-6).recip();
        let rotation =
            [[1.0 - x * x * share, -x * y * share, -x], [-x * y * share, 1.0 - y * y * share, -y], [x, y, c]];
        let scaled = |of: &dyn Fn(usize, usize) -> f64| -> [[f64; 3]; 3] {
            let scale = |i: usize| if i < 2 { focal } else { 1.0 };
            std::array::from_fn(|i| std::array::from_fn(|j| scale(i) * of(i, j) / scale(j)))
        };
        Self {
            from_bearing: scaled(&|i, j| rotation[i][j]),
            to_bearing: scaled(&|i, j| rotation[j][i]),
            focal,
        }
    }

    /// Maps a bearing, for example a vanishing point, to a homogeneous chart point.
    #[must_use]
    #[inline(always)]
    pub(crate) fn bearing_to_chart(&self, bearing: [f64; 3]) -> [f64; 3] {
        let [x, y, ahead] = &self.from_bearing;
        [dot(x, &bearing), dot(y, &bearing), dot(ahead, &bearing)]
    }

    /// Returns the matrix from homogeneous chart points to bearings, row by row.
    pub(crate) const fn bearing_from_chart(&self) -> &[[f64; 3]; 3] {
        &self.to_bearing
    }

    /// Returns the matrix from bearings to homogeneous chart points, row by row.
    pub(crate) const fn chart_from_bearing(&self) -> &[[f64; 3]; 3] {
        &self.from_bearing
    }

    /// Maps a line in the chart to the line of the corresponding bearings. Lines are homogeneous: the dot product of
    /// a line and its points is zero.
    pub(crate) fn line_to_bearings(&self, line: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|j| (0..3).map(|i| line[i] * self.from_bearing[i][j]).sum())
    }

    /// Maps a chart point, in pixels, to the undistorted pixel relative to the principal point. Returns
    /// `None` for points behind the camera.
    pub(crate) fn undistorted(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y, w] = self.to_bearing.map(|row| row[0] * u + row[1] * v + row[2]);
        (w > 0.0).then(|| [x / w, y / w])
    }

    /// Maps a chart point to the image of an equidistant lens with the same focal length, in pixels relative
    /// to the principal point. Points of different charts are comparable in this image.
    pub(crate) fn equidistant_point(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [x, y, w] = self.to_bearing.map(|row| row[0] * u + row[1] * v + row[2]);
        let across = hypot(x, y);
        if across == 0.0 {
            return [0.0; 2];
        }
        let radius = self.focal * angle_from_axis(across, self.focal * w);
        [radius * x / across, radius * y / across]
    }

    /// Whether the angle of a homogeneous chart point from the optical axis of the chart is valid; see
    /// [`MIN_COSINE`].
    fn contains(&self, [x, y, w]: [f64; 3]) -> bool {
        let (x, y) = (x / self.focal, y / self.focal);
        w > MIN_COSINE * (x * x + y * y + w * w).sqrt()
    }
}

/// Returns the unit vector, in camera axes, of the ray at a pixel. The lens is replaced by an equidistant
/// lens with the same focal length and principal point.
fn equidistant_direction(lens: &Lens, pixel: Pixel) -> [f64; 3] {
    /// Largest angle between a ray and the optical axis for real lenses, in radians.
    const MAX_ANGLE: f64 = 2.5;
    let Pixel { u: cu, v: cv } = lens.principal_point;
    let (x, y) = ((pixel.u - cu) / lens.focal, (pixel.v - cv) / lens.focal);
    let radius = hypot(x, y);
    let (sin, cos) = sin_cos(radius.min(MAX_ANGLE));
    let scale = if radius > 1e-12 { sin / radius } else { 1.0 };
    [scale * x, scale * y, cos]
}

/// Chart point of a raw pixel. For a lens without a chart, it is the undistorted pixel relative to the
/// principal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChartPoint {
    /// Coordinates in the chart, in pixels.
    pub(crate) at: [f64; 2],
    /// Derivatives `d at / d raw` with respect to the raw pixel; one row for each coordinate of `at`.
    pub(crate) jacobian: Matrix2,
}

impl Lens {
    /// Maps a raw pixel to a chart. Without a chart, undistorts it. Returns `None` outside the lens or the
    /// chart.
    pub(crate) fn pixel_to_chart(&self, pixel: Pixel, chart: Option<&Chart>) -> Option<ChartPoint> {
        let Some(chart) = chart else {
            let (undistorted, jacobian) = self.undistort_with_jacobian(pixel)?;
            let Pixel { u: cu, v: cv } = self.principal_point;
            return Some(ChartPoint { at: [undistorted.u - cu, undistorted.v - cv], jacobian });
        };
        let (bearing, by_raw) = self.bearing_with_jacobian(pixel)?;
        let [x, y, w] = chart.bearing_to_chart(bearing);
        if !chart.contains([x, y, w]) {
            return None;
        }
        let at = [x / w, y / w];
        let columns =
            [0, 1].map(|k| quotient_change(at, w, chart.bearing_to_chart(by_raw.map(|row| row[k]))));
        Some(ChartPoint { at, jacobian: [0, 1].map(|row| columns.map(|column| column[row])) })
    }

    /// Returns the derivatives of [`Self::pixel_to_chart`] and of its Jacobian with respect to every lens
    /// parameter, for a fixed chart. `point` is the chart point of `pixel`.
    pub(crate) fn pixel_to_chart_by_parameters(
        &self,
        pixel: Pixel,
        point: &ChartPoint,
        chart: Option<&Chart>,
    ) -> ByParameters {
        let Pixel { u: cu, v: cv } = self.principal_point;
        let Some(chart) = chart else {
            return self.undistort_by_parameters(pixel, [cu + point.at[0], cv + point.at[1]].into());
        };
        let mut by_parameters = ByParameters::default();
        let Some((bearing, by_raw)) = self.bearing_with_jacobian(pixel) else { return by_parameters };
        let [_, _, w] = chart.bearing_to_chart(bearing);
        let by_raw = [0, 1].map(|k| chart.bearing_to_chart(by_raw.map(|row| row[k])));
        let old = by_raw.map(|column| quotient_change(point.at, w, column));
        // Computed in place, because fisheye fits spend most of their time here.
        for (own, by) in by_parameters.iter_mut().zip(&self.bearing_by_parameters(pixel, bearing)) {
            let change = chart.bearing_to_chart(by.at);
            own.at = quotient_change(point.at, w, change);
            for k in 0..2 {
                let [x, y, ahead] = &by.jacobian;
                let moved = quotient_change(point.at, w, chart.bearing_to_chart([x[k], y[k], ahead[k]]));
                for i in 0..2 {
                    own.jacobian[i][k] = moved[i] - (own.at[i] * by_raw[k][2] + old[k][i] * change[2]) / w;
                }
            }
        }
        by_parameters
    }
}

/// Returns the change of the point `at = (x, y) / w` for the change `(dx, dy, dw)` of its homogeneous
/// coordinates.
#[inline(always)]
fn quotient_change(at: [f64; 2], w: f64, [dx, dy, dw]: [f64; 3]) -> [f64; 2] {
    [(dx - at[0] * dw) / w, (dy - at[1] * dw) / w]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::distortion::Distortion;
    use proptest::prelude::*;

    fn fisheye(k: [f64; 4]) -> Lens {
        Lens {
            principal_point: Pixel::new(1000.0, 990.0),
            focal: 600.0,
            distortion: Distortion::KannalaBrandt { k },
            image_circle: None,
            pixel_aspect: 1.0,
        }
    }

    proptest! {
        #[test]
        fn chart_derivatives_agree_with_finite_differences(
            k in [-0.03..0.03_f64, -0.005..0.005_f64], at in [100.0..1900.0_f64, 100.0..1900.0_f64],
            off in [-400.0..400.0_f64, -400.0..400.0_f64], aspect in 0.8..1.25_f64,
        ) {
            /// Steps of the finite differences with respect to the lens parameters. Their order is k1 to k4, log focal
            /// length, principal point u and v (pixels), pixel aspect.
            const STEPS: [f64; Lens::PARAMETERS] = [1e-7, 1e-8, 1e-8, 1e-9, 1e-5, 1e-3, 1e-3, 1e-6];
            let lens = Lens { pixel_aspect: aspect, ..fisheye([k[0], k[1], 0.0, 0.0]) };
            let pixel = Pixel::from(at);
            let chart = Chart::centred_on(&lens, &[pixel, Pixel::new(at[0] + off[0], at[1] + off[1])]);
            let here = lens.pixel_to_chart(pixel, chart.as_ref());
            prop_assume!(here.is_some_and(|here| here.at[0].hypot(here.at[1]) < 3.0 * lens.focal));
            let Some(here) = here else { return Ok(()) };
            // Finite differences are inaccurate near the fold of the lens, and if the last coefficients
            // dominate.
            prop_assume!(here.jacobian.iter().flatten().all(|slope| slope.abs() < 10.0));
            prop_assume!((at[0] - 1000.0).hypot((at[1] - 990.0) / aspect) < 1.9 * lens.focal);
            let near = |a: f64, b: f64, size: f64| (a - b).abs() < 1e-4 * (1.0 + size);
            for axis in 0..2 {
                let moved = |by: f64| {
                    let to = if axis == 0 { [at[0] + by, at[1]] } else { [at[0], at[1] + by] };
                    lens.pixel_to_chart(to.into(), chart.as_ref())
                };
                let (Some(ahead), Some(behind)) = (moved(1e-3), moved(-1e-3)) else { continue };
                for row in 0..2 {
                    let numeric = (ahead.at[row] - behind.at[row]) / 2e-3;
                    prop_assert!(near(numeric, here.jacobian[row][axis], numeric.abs()), "{numeric} {here:?}");
                }
            }
            let by = lens.pixel_to_chart_by_parameters(pixel, &here, chart.as_ref());
            for index in 0..Lens::PARAMETERS {
                let step = STEPS[index];
                let moved = |by: f64| lens.nudged(index, by).pixel_to_chart(pixel, chart.as_ref());
                let (Some(ahead), Some(behind)) = (moved(step), moved(-step)) else { continue };
                for row in 0..2 {
                    let numeric = (ahead.at[row] - behind.at[row]) / (2.0 * step);
                    prop_assert!(near(numeric, by[index].at[row], numeric.abs()), "{index}: {numeric} {:?}", by[index]);
                    for column in 0..2 {
                        let numeric = (ahead.jacobian[row][column] - behind.jacobian[row][column]) / (2.0 * step);
                        prop_assert!(near(numeric, by[index].jacobian[row][column], numeric.abs()), "{numeric} {:?}", by[index]);
                    }
                }
            }
        }

        #[test]
        fn chart_and_bearing_maps_are_inverse(at in [0.0..2000.0_f64, 0.0..2000.0_f64], v in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64]) {
            let lens = fisheye([0.0; 4]);
            let chart = Chart::centred_on(&lens, &[at.into()]).unwrap();
            let carried = chart.bearing_to_chart([600.0 * v[0], 600.0 * v[1], v[2]]);
            let back = chart.bearing_from_chart().map(|row| dot(&row, &carried));
            prop_assert!((back[0] / 600.0 - v[0]).abs() + (back[1] / 600.0 - v[1]).abs() + (back[2] - v[2]).abs() < 1e-12);
            let middle = lens.pixel_to_chart(at.into(), Some(&chart)).unwrap().at;
            prop_assert!(middle[0].hypot(middle[1]) < 1e-9, "the middle is the axis");
            let flat = chart.equidistant_point(middle);
            prop_assert!((flat[0] + 1000.0 - at[0]).hypot(flat[1] + 990.0 - at[1]) < 1e-6);
        }
    }
}
