//! Charts of a wide lens: what a pinhole turned toward some of its pixels would show. There a segment beside or behind
//! the camera is a segment, its noise has a covariance, and lines of space are straight, as everywhere ahead of it.
//!
//! With the rotation R that takes the middle of the pixels to the axis, a bearing b has the chart point of `A b`,
//! `A = diag(f, f, 1) R diag(1/f, 1/f, 1)`; a direction in space that vanishes at V does so at `A V` of the chart. The
//! middle is that of the equidistant lens: it does not depend on the coefficients of the distortion. While a lens is
//! estimated charts stay those of the lens from which the estimate starts, so that derivatives are exact: what a residual
//! says does not depend on the chart but by its own square.

use crate::camera::distortion::Matrix2;
use crate::camera::lens::{ByParameters, Lens};
use crate::camera::numerics::{angle_from_axis, hypot, sin_cos};
use crate::camera::pinhole::dot;
use crate::camera::space::Pixel;

/// A turned view of a wide lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chart {
    /// Chart points, homogeneous, from bearings.
    from_bearing: [[f64; 3]; 3],
    /// And back.
    to_bearing: [[f64; 3]; 3],
    focal: f64,
}

/// Cosine of the largest angle from the middle: beyond it a line of noisy points is none.
const OUTERMOST: f64 = 0.02;

impl Chart {
    /// The chart in the middle of some pixels; `None` of a lens that is not wide, and needs none.
    #[must_use]
    pub fn toward(lens: &Lens, pixels: &[Pixel]) -> Option<Self> {
        if !lens.distortion.is_wide() {
            return None;
        }
        let directions = pixels.iter().map(|&pixel| equidistant(lens, pixel));
        let sum = directions.fold([0.0; 3], |sum, direction| std::array::from_fn(|i| sum[i] + direction[i]));
        let length = dot(&sum, &sum).sqrt();
        let middle = if length > 1e-9 { sum.map(|c| c / length) } else { [0.0, 0.0, 1.0] };
        Some(Self::about(middle, lens.focal))
    }

    /// The least rotation that takes a unit vector to the axis: `I + [k] + [k]^2 / (1 + c)`, k its cross product with
    /// the axis.
    fn about([x, y, c]: [f64; 3], focal: f64) -> Self {
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

    /// A homogeneous vector of bearings, as of a vanishing point, in the chart.
    #[must_use]
    #[inline(always)]
    pub(crate) fn carried(&self, bearing: [f64; 3]) -> [f64; 3] {
        let [x, y, ahead] = &self.from_bearing;
        [dot(x, &bearing), dot(y, &bearing), dot(ahead, &bearing)]
    }

    /// The rows of the map from the chart to bearings.
    pub(crate) const fn rows_back(&self) -> &[[f64; 3]; 3] {
        &self.to_bearing
    }

    /// The rows of the map from bearings to the chart.
    pub(crate) const fn rows_forth(&self) -> &[[f64; 3]; 3] {
        &self.from_bearing
    }

    /// A homogeneous line of the chart as one of bearings.
    pub(crate) fn line_of_bearings(&self, line: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|j| (0..3).map(|i| line[i] * self.from_bearing[i][j]).sum())
    }

    /// The undistorted pixel of a chart point, relative to the principal point, where there is one.
    pub(crate) fn ahead(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y, w] = self.to_bearing.map(|row| row[0] * u + row[1] * v + row[2]);
        (w > 0.0).then(|| [x / w, y / w])
    }

    /// A chart point in the equidistant image of the lens: places of different charts beside one another.
    pub(crate) fn flat(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [x, y, w] = self.to_bearing.map(|row| row[0] * u + row[1] * v + row[2]);
        let across = hypot(x, y);
        if across == 0.0 {
            return [0.0; 2];
        }
        let radius = self.focal * angle_from_axis(across, self.focal * w);
        [radius * x / across, radius * y / across]
    }

    /// Whether a vector of chart coordinates lies within the chart.
    fn holds(&self, [x, y, w]: [f64; 3]) -> bool {
        let (x, y) = (x / self.focal, y / self.focal);
        w > OUTERMOST * (x * x + y * y + w * w).sqrt()
    }
}

/// The direction that an equidistant lens would show at a pixel.
fn equidistant(lens: &Lens, pixel: Pixel) -> [f64; 3] {
    // As far round as any lens is believed to look.
    const WIDEST: f64 = 2.5;
    let Pixel { u: cu, v: cv } = lens.principal_point;
    let (x, y) = ((pixel.u - cu) / lens.focal, (pixel.v - cv) / lens.focal);
    let radius = hypot(x, y);
    let (sin, cos) = sin_cos(radius.min(WIDEST));
    let scale = if radius > 1e-12 { sin / radius } else { 1.0 };
    [scale * x, scale * y, cos]
}

/// A pixel in a chart, or without one undistorted and relative to the principal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChartPoint {
    pub(crate) at: [f64; 2],
    /// `d at / d raw`, rows u and v.
    pub(crate) jacobian: Matrix2,
}

impl Lens {
    /// Where a raw pixel is in a chart; `None` outside the lens and the chart.
    pub(crate) fn in_chart(&self, pixel: Pixel, chart: Option<&Chart>) -> Option<ChartPoint> {
        let Some(chart) = chart else {
            let (straight, jacobian) = self.undistort_with_jacobian(pixel)?;
            let Pixel { u: cu, v: cv } = self.principal_point;
            return Some(ChartPoint { at: [straight.u - cu, straight.v - cv], jacobian });
        };
        let (bearing, by_raw) = self.bearing_with_jacobian(pixel)?;
        let [x, y, w] = chart.carried(bearing);
        if !chart.holds([x, y, w]) {
            return None;
        }
        let at = [x / w, y / w];
        let columns = [0, 1].map(|k| quotient(at, w, chart.carried(by_raw.map(|row| row[k]))));
        Some(ChartPoint { at, jacobian: [0, 1].map(|row| columns.map(|column| column[row])) })
    }

    /// How [`Self::in_chart`] changes with every parameter at a pixel that it holds; the chart stays.
    pub(crate) fn in_chart_by_parameters(
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
        let [_, _, w] = chart.carried(bearing);
        let by_raw = [0, 1].map(|k| chart.carried(by_raw.map(|row| row[k])));
        let old = by_raw.map(|column| quotient(point.at, w, column));
        // In place: this is what fits of fisheyes wait for.
        for (own, by) in by_parameters.iter_mut().zip(&self.bearing_by_parameters(pixel, bearing)) {
            let change = chart.carried(by.at);
            own.at = quotient(point.at, w, change);
            for k in 0..2 {
                let [x, y, ahead] = &by.jacobian;
                let moved = quotient(point.at, w, chart.carried([x[k], y[k], ahead[k]]));
                for i in 0..2 {
                    own.jacobian[i][k] = moved[i] - (own.at[i] * by_raw[k][2] + old[k][i] * change[2]) / w;
                }
            }
        }
        by_parameters
    }
}

/// The change of a point `(x, y) / w` with that of its homogeneous coordinates.
#[inline(always)]
fn quotient(at: [f64; 2], w: f64, [dx, dy, dw]: [f64; 3]) -> [f64; 2] {
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
        }
    }

    proptest! {
        #[test]
        fn derivatives_in_a_chart_are_those_of_differences(
            k in [-0.03..0.03_f64, -0.005..0.005_f64], at in [100.0..1900.0_f64, 100.0..1900.0_f64],
            off in [-400.0..400.0_f64, -400.0..400.0_f64],
        ) {
            /// Of k1 to k4, which count ever more, of the log of the focal, of pixels.
            const STEPS: [f64; Lens::PARAMETERS] = [1e-7, 1e-8, 1e-8, 1e-9, 1e-5, 1e-3, 1e-3];
            let lens = fisheye([k[0], k[1], 0.0, 0.0]);
            let pixel = Pixel::from(at);
            let chart = Chart::toward(&lens, &[pixel, Pixel::new(at[0] + off[0], at[1] + off[1])]);
            let here = lens.in_chart(pixel, chart.as_ref());
            prop_assume!(here.is_some_and(|here| here.at[0].hypot(here.at[1]) < 3.0 * lens.focal));
            let Some(here) = here else { return Ok(()) };
            // Where the lens folds back on itself, and where the last coefficients are all, differences say nothing.
            prop_assume!(here.jacobian.iter().flatten().all(|slope| slope.abs() < 10.0));
            prop_assume!((at[0] - 1000.0).hypot(at[1] - 990.0) < 1.9 * lens.focal);
            let near = |a: f64, b: f64, size: f64| (a - b).abs() < 1e-4 * (1.0 + size);
            for axis in 0..2 {
                let moved = |by: f64| {
                    let to = if axis == 0 { [at[0] + by, at[1]] } else { [at[0], at[1] + by] };
                    lens.in_chart(to.into(), chart.as_ref())
                };
                let (Some(ahead), Some(behind)) = (moved(1e-3), moved(-1e-3)) else { continue };
                for row in 0..2 {
                    let numeric = (ahead.at[row] - behind.at[row]) / 2e-3;
                    prop_assert!(near(numeric, here.jacobian[row][axis], numeric.abs()), "{numeric} {here:?}");
                }
            }
            let by = lens.in_chart_by_parameters(pixel, &here, chart.as_ref());
            for index in 0..Lens::PARAMETERS {
                let step = STEPS[index];
                let moved = |by: f64| lens.nudged(index, by).in_chart(pixel, chart.as_ref());
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
        fn a_chart_and_its_bearings_are_inverse_to_each_other(at in [0.0..2000.0_f64, 0.0..2000.0_f64], v in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64]) {
            let lens = fisheye([0.0; 4]);
            let chart = Chart::toward(&lens, &[at.into()]).unwrap();
            let carried = chart.carried([600.0 * v[0], 600.0 * v[1], v[2]]);
            let back = chart.rows_back().map(|row| dot(&row, &carried));
            prop_assert!((back[0] / 600.0 - v[0]).abs() + (back[1] / 600.0 - v[1]).abs() + (back[2] - v[2]).abs() < 1e-12);
            let middle = lens.in_chart(at.into(), Some(&chart)).unwrap().at;
            prop_assert!(middle[0].hypot(middle[1]) < 1e-9, "the middle is the axis");
            let flat = chart.flat(middle);
            prop_assert!((flat[0] + 1000.0 - at[0]).hypot(flat[1] + 990.0 - at[1]) < 1e-6);
        }
    }
}
