//! Borders of the density levels: the lines of equal pixel density of targets at one height, in the image.
//!
//! The lines are traced on a grid of pixels (marching squares). If only one of two neighbours reaches the limit of the
//! level, bisection finds the crossing between them. The crossings of a cell are joined. A pixel that shows no floor
//! has the density 0.
//!
//! Errors of the calibration move a border. With the density `D(X, p)` at the floor point X for the camera parameters
//! p, the border `D = constant` moves along the gradient of D by `-dD / |grad D|` for a change `dD` at fixed X (implicit
//! function theorem). To first order, its standard deviation is therefore `sigma_D / |grad D|`.

use super::pixel_density::{DensityLevel, LevelLimits};
use crate::camera::{Camera, Pixel, WorldPoint};

/// Number of cells of the grid across and down the image. In an image of 1920 x 1080 pixels, a cell is 30
/// pixels wide.
const CELLS: [usize; 2] = [64, 36];

/// Number of bisections. They reduce the width of a cell to a hundredth of a pixel.
const BISECTIONS: usize = 12;

/// Border of a density level in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct DensityBorder {
    /// Level that is reached on one side of the border.
    pub level: DensityLevel,
    /// Segments of the border, in raw pixels.
    pub segments: Vec<[Pixel; 2]>,
}

impl Camera {
    /// Returns the borders of the density levels of vertical targets whose lower end is `target_height` metres above
    /// the floor, in an image of this width and height in pixels. Levels without a border are left out.
    #[must_use]
    pub fn density_borders(
        &self,
        [width, height]: [f64; 2],
        target_height: f64,
        limits: &LevelLimits,
    ) -> Vec<DensityBorder> {
        let density = |pixel: Pixel| {
            let point = self.pixel_to_floor(pixel, target_height);
            point.and_then(|point| self.pixel_density(point.at_height(target_height))).unwrap_or(0.0)
        };
        let corner = |column: usize, row: usize| Pixel {
            u: width * column as f64 / CELLS[0] as f64,
            v: height * row as f64 / CELLS[1] as f64,
        };
        let columns = CELLS[0] + 1;
        let densities: Vec<f64> =
            (0..columns * (CELLS[1] + 1)).map(|i| density(corner(i % columns, i / columns))).collect();
        let border = |level: DensityLevel| {
            let limit = limits.of(level);
            let mut segments = Vec::new();
            for cell in 0..CELLS[0] * CELLS[1] {
                let (column, row) = (cell % CELLS[0], cell / CELLS[0]);
                // Corners around the cell.
                let around = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| (column + i, row + j));
                let is_reached = around.map(|(i, j)| densities[j * columns + i] >= limit);
                let crossings: Vec<Pixel> = (0..4)
                    .filter(|&side| is_reached[side] != is_reached[(side + 1) % 4])
                    .map(|side| {
                        let [from, to] = [side, (side + 1) % 4].map(|k| corner(around[k].0, around[k].1));
                        crossing([from, to], is_reached[side], |pixel| density(pixel) >= limit)
                    })
                    .collect();
                segments.extend(crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
            }
            DensityBorder { level, segments }
        };
        DensityLevel::ALL.into_iter().map(border).filter(|border| !border.segments.is_empty()).collect()
    }

    /// Returns the standard deviation of a density border: the line of equal pixel density through a point. It is in
    /// metres across the line. Returns `None` if the lens cannot show the surroundings of the point, or if the density
    /// is the same everywhere around it. Also returns `None` if the uncertainty of the camera is unknown.
    #[must_use]
    pub fn density_border_sigma(&self, point: WorldPoint) -> Option<f64> {
        /// Step of the central differences, as a share of the distance from the camera to the point.
        const SHARE: f64 = 1e-4;
        let step = SHARE * self.position.distance(point);
        let slope = |dx: f64, dy: f64| {
            let at = |sign: f64| {
                self.pixel_density(WorldPoint { x: point.x + sign * dx, y: point.y + sign * dy, ..point })
            };
            Some((at(1.0)? - at(-1.0)?) / (2.0 * step))
        };
        let gradient = slope(step, 0.0)?.hypot(slope(0.0, step)?);
        let sigma = self.pixel_density_sigma(point)?;
        (gradient > 0.0).then_some(sigma / gradient)
    }
}

/// Returns the pixel between two pixels at which the condition `holds` changes, by bisection. `at_start` is the value
/// of the condition at the first pixel.
fn crossing([mut from, mut to]: [Pixel; 2], at_start: bool, holds: impl Fn(Pixel) -> bool) -> Pixel {
    let middle = |a: Pixel, b: Pixel| Pixel { u: 0.5 * (a.u + b.u), v: 0.5 * (a.v + b.v) };
    for _ in 0..BISECTIONS {
        let between = middle(from, to);
        if holds(between) == at_start { from = between } else { to = between }
    }
    middle(from, to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Covariance, any_camera};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn density_on_a_border_is_its_limit(camera in any_camera(), height in 0.0..1.6_f64) {
            for border in camera.density_borders([1920.0, 1080.0], height, &LevelLimits::default()) {
                let limit = LevelLimits::default().of(border.level);
                for pixel in border.segments.into_iter().flatten() {
                    // The border can be the edge of the visible floor.
                    let near = |du: f64, dv: f64| {
                        let at = camera.pixel_to_floor(Pixel { u: pixel.u + du, v: pixel.v + dv }, height)?;
                        camera.pixel_density(at.at_height(height))
                    };
                    let around = [near(0.0, 0.0), near(1.0, 0.0), near(-1.0, 0.0), near(0.0, 1.0), near(0.0, -1.0)];
                    if around.iter().any(Option::is_none) {
                        continue;
                    }
                    let found = around[0].unwrap_or_default();
                    let steepest = around.iter().flatten().map(|near| (near - found).abs()).fold(0.0, f64::max);
                    prop_assert!((found - limit).abs() <= 0.1 * steepest + 1e-6 * limit, "{found} {limit}");
                }
            }
        }

        #[test]
        fn border_moves_by_its_standard_deviation(
            camera in any_camera(), u in 300.0..1600.0_f64, v in 400.0..1000.0_f64,
        ) {
            let Some(at) = camera.pixel_to_floor(Pixel { u, v }, 0.0) else { return Ok(()) };
            let distance = at.distance(camera.position.on_floor());
            prop_assume!(distance > 0.5 && distance < 40.0);
            let mut covariance = Covariance::EXACT;
            covariance.0[Covariance::PITCH][Covariance::PITCH] = 1e-4 * 1e-4;
            let camera = Camera { covariance, ..camera };
            let point = at.at_height(0.0);
            let (Some(sigma), Some(density)) =
                (camera.density_border_sigma(point), camera.pixel_density(point)) else { return Ok(()) };
            // The change is not linear where the density hardly depends on the pitch.
            prop_assume!(sigma > 1e-5);
            let moved = camera.nudged(Covariance::PITCH, 1e-4);
            // Shortest way to a point with the same density in the moved camera, by a search around the point.
            let mut nearest = f64::INFINITY;
            for step in 0..720 {
                let (sin, cos) = (f64::from(step) * std::f64::consts::PI / 360.0).sin_cos();
                let at = |by: f64| moved.pixel_density(WorldPoint { x: point.x + by * cos, y: point.y + by * sin, ..point });
                let Some((near, far)) = at(0.0).zip(at(sigma)) else { return Ok(()) };
                // The density is linear over this distance.
                let by = (density - near) / (far - near) * sigma;
                if by > 0.0 {
                    nearest = nearest.min(by);
                }
            }
            prop_assert!((nearest / sigma - 1.0).abs() < 0.05, "{nearest} {sigma}");
        }
    }
}
