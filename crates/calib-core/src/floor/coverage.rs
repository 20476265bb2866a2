//! Coverage: which floor points a group of cameras sees, and with which pixel density.
//!
//! A camera sees a target at a floor point and a height if three conditions hold: the floor point is in the
//! camera's EFOV, the point at the height is in the image, and no wall crosses the line of sight to it.

use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::floor::extent::Extent;
use crate::floor::pixel_density::DensityCamera;

/// Vertical wall that blocks the line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// One end on the floor.
    pub from: FloorPoint,
    /// The other end on the floor.
    pub to: FloorPoint,
    /// Height of the upper edge above the floor, in metres. The wall begins at the floor.
    pub height: f64,
}

impl Wall {
    /// Distance from the camera, in metres, within which a wall does not block: the camera is mounted on it,
    /// and the calibrated position can be on either side.
    const MOUNT: f64 = 0.1;

    /// Whether the wall crosses the line of sight from `eye` to `target`. A target that touches the wall is
    /// visible.
    #[must_use]
    pub fn blocks(&self, eye: WorldPoint, target: WorldPoint) -> bool {
        let sight = [target.x - eye.x, target.y - eye.y];
        let along = [self.to.x - self.from.x, self.to.y - self.from.y];
        let start = [self.from.x - eye.x, self.from.y - eye.y];
        let determinant = sight[0] * along[1] - sight[1] * along[0];
        // Shares of the line of sight and of the wall at their crossing, as seen from above. They are not
        // finite for parallel lines, which do not block.
        let of_sight = (start[0] * along[1] - start[1] * along[0]) / determinant;
        let of_wall = (start[0] * sight[1] - start[1] * sight[0]) / determinant;
        /// Share of the line of sight at its end that counts as touching the wall.
        const TOUCHING: f64 = 1e-9;
        let distance = of_sight * sight[0].hypot(sight[1]);
        let is_between = of_sight < 1.0 - TOUCHING && distance > Self::MOUNT;
        is_between && (0.0..=1.0).contains(&of_wall) && eye.z + of_sight * (target.z - eye.z) < self.height
    }
}

/// Grid of floor points, in rows along x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorGrid {
    /// First point of the first row.
    pub origin: FloorPoint,
    /// Distance between neighbours, in metres.
    pub step: f64,
    /// Number of points in a row.
    pub columns: usize,
    /// Number of rows. They follow each other along y.
    pub rows: usize,
}

impl FloorGrid {
    /// Returns the number of points.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Whether the grid has no points.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the point with this index. Indices count along the rows.
    #[must_use]
    pub fn point(&self, index: usize) -> FloorPoint {
        let (row, column) = (index / self.columns, index % self.columns);
        FloorPoint { x: self.x(column), y: self.y(row) }
    }

    fn x(&self, column: usize) -> f64 {
        self.origin.x + column as f64 * self.step
    }

    fn y(&self, row: usize) -> f64 {
        self.origin.y + row as f64 * self.step
    }

    /// Returns the columns of the points of a row that are inside a polygon (even-odd rule), as ranges.
    fn columns_inside(&self, polygon: &[FloorPoint], row: usize) -> Vec<std::ops::Range<usize>> {
        let y = self.y(row);
        let edges = polygon.iter().zip(polygon.iter().cycle().skip(1));
        let mut crossings: Vec<f64> = edges
            .filter(|(a, b)| (a.y > y) != (b.y > y))
            .map(|(a, b)| a.x + (y - a.y) * (b.x - a.x) / (b.y - a.y))
            .collect();
        crossings.sort_by(f64::total_cmp);
        let column = |x: f64| {
            // A point on the crossing is to its right. Casts saturate at 0.
            (((x - self.origin.x) / self.step).ceil() as usize).min(self.columns)
        };
        crossings.chunks_exact(2).map(|pair| column(pair[0])..column(pair[1])).collect()
    }
}

/// Camera whose coverage is computed.
#[derive(Clone, Copy, Debug)]
pub struct CoverageCamera<'a> {
    /// Calibrated camera.
    pub camera: &'a Camera,
    /// Image and EFOV of the camera.
    pub extent: Extent<'a>,
}

/// Farthest floor point at which a camera reaches a pixel density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Distance from the foot of the camera to the point, in metres.
    pub distance: f64,
    /// Standard deviation of the distance, in metres, from the errors of the calibration. `None` if an error is
    /// unknown, or if the end of the visible floor limits the distance and not the density.
    pub sigma: Option<f64>,
    /// Whether the pixel density limits the distance. Otherwise the camera sees no floor farther away.
    pub is_limited_by_density: bool,
}

impl CoverageCamera<'_> {
    /// Returns the farthest point with the pixel density `density` (pixels per metre) for targets at `height`
    /// metres, in the direction of the farthest such point of the grid. Returns `None` if no point of the grid
    /// has this density.
    ///
    /// The border of the density is found by bisection. If its error moves the density by `s` and the density
    /// falls by `g` per metre of distance, then the standard deviation of the border is `s / g`.
    #[must_use]
    pub fn reach(&self, walls: &[Wall], grid: &FloorGrid, [height, density]: [f64; 2]) -> Option<Reach> {
        /// Number of bisection steps.
        const HALVINGS: usize = 40;
        /// Step of the derivative along the distance, in metres.
        const STEP: f64 = 1e-3;
        let alone = Coverage::new(std::slice::from_ref(self), walls, grid, height);
        let foot = self.camera.position.on_floor();
        let seen = (0..grid.len()).filter(|&at| alone.best[at].is_some() && alone.density[at] >= density);
        let farthest =
            seen.map(|at| grid.point(at)).max_by(|a, b| a.distance(foot).total_cmp(&b.distance(foot)))?;
        let least = farthest.distance(foot);
        let at = |distance: f64| {
            let share = if least > 0.0 { distance / least } else { 0.0 };
            let along = |foot: f64, end: f64| foot + share * (end - foot);
            WorldPoint::new(along(foot.x, farthest.x), along(foot.y, farthest.y), height)
        };
        let of = |distance: f64| self.camera.pixel_density(at(distance)).unwrap_or(0.0);
        let (mut low, mut high) = (least, least + 2.0 * grid.step);
        if of(high) >= density || !self.shows(at(high)) {
            return Some(Reach { distance: least, sigma: None, is_limited_by_density: false });
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if of(middle) >= density { low = middle } else { high = middle }
        }
        let slope = (of(low + STEP) - of(low - STEP)) / (2.0 * STEP);
        let sigma = self.camera.pixel_density_sigma(at(low)).map(|sigma| sigma / slope.abs());
        Some(Reach { distance: low, sigma: sigma.filter(|s| s.is_finite()), is_limited_by_density: true })
    }

    /// Whether a target is in the EFOV and in the image.
    fn shows(&self, target: WorldPoint) -> bool {
        self.extent.contains(target.on_floor())
            && self.camera.world_to_pixel(target).is_some_and(|pixel| self.extent.shows(pixel))
    }
}

/// Coverage of the points of a grid. The lists have one entry for each point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Pixel density of the best camera, in pixels per metre; 0 for a blind spot.
    pub density: Vec<f64>,
    /// Index of the camera with the largest pixel density.
    pub best: Vec<Option<usize>>,
    /// Number of cameras that see the target.
    pub seen_by: Vec<usize>,
}

impl Coverage {
    /// Computes the coverage of targets at `height` metres above the points of a grid.
    #[must_use]
    pub fn new(cameras: &[CoverageCamera<'_>], walls: &[Wall], grid: &FloorGrid, height: f64) -> Self {
        let mut coverage = Self {
            density: vec![0.0; grid.len()],
            best: vec![None; grid.len()],
            seen_by: vec![0; grid.len()],
        };
        for (index, camera) in cameras.iter().enumerate() {
            coverage.add(index, camera, walls, grid, height);
        }
        coverage
    }

    fn add(
        &mut self,
        index: usize,
        CoverageCamera { camera, extent }: &CoverageCamera<'_>,
        walls: &[Wall],
        grid: &FloorGrid,
        height: f64,
    ) {
        let bounds = Bounds::new(extent.efov.iter().copied().chain([camera.position.on_floor()]));
        let walls: Vec<Wall> = walls
            .iter()
            .filter(|wall| bounds.meets(&Bounds::new([wall.from, wall.to].into_iter())))
            .copied()
            .collect();
        let densities = DensityCamera::new(camera);
        for row in 0..grid.rows {
            for column in grid.columns_inside(extent.efov, row).into_iter().flatten() {
                let target = WorldPoint::new(grid.x(column), grid.y(row), height);
                let Some((pixel, density)) = densities.at(target) else { continue };
                if !extent.shows(pixel) || walls.iter().any(|wall| wall.blocks(camera.position, target)) {
                    continue;
                }
                let at = row * grid.columns + column;
                self.seen_by[at] += 1;
                if self.best[at].is_none() || density > self.density[at] {
                    (self.density[at], self.best[at]) = (density, Some(index));
                }
            }
        }
    }
}

/// Coverage of an area of the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaCoverage {
    /// Share of the area that reaches the required pixel density, from 0 to 1.
    pub share: f64,
    /// Share of the area that no camera sees, from 0 to 1.
    pub blind_share: f64,
    /// Smallest pixel density of the visible part, in pixels per metre; `None` if no part is visible.
    pub worst_density: Option<f64>,
}

impl AreaCoverage {
    /// Computes the coverage of a polygon, for targets at `height` metres. The shares are those of a grid of
    /// points, whose distance is at most `step` metres. `required` is the required pixel density, in pixels
    /// per metre. Returns `None` if the polygon has no area.
    #[must_use]
    pub fn new(
        cameras: &[CoverageCamera<'_>],
        walls: &[Wall],
        polygon: &[FloorPoint],
        [height, required, step]: [f64; 3],
    ) -> Option<Self> {
        /// Smallest number of points of the bounding box. The error of a share is then about 0.2 %.
        const MIN_POINTS: f64 = 40_000.0;
        /// Largest number of points of the bounding box, which limits the time for a large area.
        const MAX_POINTS: f64 = 1_000_000.0;
        let Bounds { low, high } = Bounds::new(polygon.iter().copied());
        let size = [high[0] - low[0], high[1] - low[1]];
        let area = size[0] * size[1];
        if !(area.is_finite() && area > 0.0) {
            return None;
        }
        let step = step.min((area / MIN_POINTS).sqrt()).max((area / MAX_POINTS).sqrt());
        let count = size.map(|length| (length / step).ceil().clamp(1.0, MAX_POINTS) as usize);
        // The points are the centres of cells.
        let origin = FloorPoint { x: low[0] + 0.5 * step, y: low[1] + 0.5 * step };
        let grid = FloorGrid { origin, step, columns: count[0], rows: count[1] };
        let coverage = Coverage::new(cameras, walls, &grid, height);
        let mut inside = 0_usize;
        let (mut reached, mut blind, mut worst) = (0_usize, 0_usize, None);
        for row in 0..grid.rows {
            for column in grid.columns_inside(polygon, row).into_iter().flatten() {
                let at = row * grid.columns + column;
                let density = coverage.density[at];
                inside += 1;
                if coverage.seen_by[at] == 0 {
                    blind += 1;
                    continue;
                }
                reached += usize::from(density >= required);
                worst = Some(worst.map_or(density, |worst: f64| worst.min(density)));
            }
        }
        let share = |count: usize| count as f64 / inside as f64;
        (inside > 0).then(|| Self { share: share(reached), blind_share: share(blind), worst_density: worst })
    }
}

/// Bounding box of floor points.
struct Bounds {
    low: [f64; 2],
    high: [f64; 2],
}

impl Bounds {
    fn new(points: impl Iterator<Item = FloorPoint>) -> Self {
        let start = Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        points.fold(start, |Self { low, high }, FloorPoint { x, y }| Self {
            low: [low[0].min(x), low[1].min(y)],
            high: [high[0].max(x), high[1].max(y)],
        })
    }

    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.low[axis] <= other.high[axis] && other.low[axis] <= self.high[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use crate::floor::default_efov;
    use proptest::prelude::*;

    const SIZE: [f64; 2] = [1920.0, 1080.0];

    proptest! {
        #[test]
        fn coverage_agrees_with_the_definition_point_by_point(
            cameras in proptest::collection::vec(any_camera(), 1..4),
            walls in proptest::collection::vec(
                ([-20.0..20.0_f64, -20.0..20.0_f64], [-20.0..20.0_f64, -20.0..20.0_f64], 0.2..4.0_f64), 0..4,
            ),
            height in 0.0..1.8_f64,
        ) {
            let walls: Vec<Wall> = walls
                .into_iter()
                .map(|(from, to, height)| Wall { from: from.into(), to: to.into(), height })
                .collect();
            let efovs: Vec<_> = cameras.iter().map(|camera| default_efov(camera, SIZE).polygon).collect();
            let of = |(camera, efov)| CoverageCamera { camera, extent: Extent { size: SIZE, efov } };
            let all: Vec<_> = cameras.iter().zip(efovs.iter().map(Vec::as_slice)).map(of).collect();
            let grid = FloorGrid { origin: FloorPoint { x: -21.3, y: -20.9 }, step: 0.71, columns: 60, rows: 61 };
            let coverage = Coverage::new(&all, &walls, &grid, height);
            for at in 0..grid.len() {
                let foot = grid.point(at);
                let target = foot.at_height(height);
                let sees = |CoverageCamera { camera, extent }: &CoverageCamera<'_>| {
                    let blocked = walls.iter().any(|wall| wall.blocks(camera.position, target));
                    let density = camera.pixel_density(target)?;
                    (extent.contains(foot) && extent.shows(camera.world_to_pixel(target)?) && !blocked)
                        .then_some(density)
                };
                let seen: Vec<f64> = all.iter().filter_map(sees).collect();
                prop_assert_eq!(coverage.seen_by[at], seen.len(), "{:?}", foot);
                prop_assert_eq!(coverage.density[at], seen.iter().copied().fold(0.0, f64::max));
            }
        }
    }

    #[test]
    fn low_wall_hides_only_what_is_behind_and_below() {
        let wall =
            Wall { from: FloorPoint { x: -1.0, y: 5.0 }, to: FloorPoint { x: 1.0, y: 5.0 }, height: 2.0 };
        let eye = WorldPoint::new(0.0, 0.0, 4.0);
        let at = |x, y, z| wall.blocks(eye, WorldPoint::new(x, y, z));
        // The line of sight over the upper edge meets the floor at y = 10.
        assert!(at(0.0, 9.9, 0.0) && !at(0.0, 10.1, 0.0));
        assert!(!at(0.0, 9.9, 0.1), "the target is above the line of sight over the wall");
        assert!(!at(0.0, 5.0, 0.0) && at(0.0, 5.1, 0.0), "a target at the wall is visible");
        assert!(!at(3.0, 9.0, 0.0), "the line of sight passes beside the wall");
        let mounted = WorldPoint::new(0.0, 5.05, 1.5);
        assert!(!wall.blocks(mounted, WorldPoint::new(0.0, 1.0, 0.0)), "the camera is mounted on the wall");
    }

    #[test]
    fn reach_is_where_the_density_ends() {
        let mut covariance = crate::camera::Covariance::EXACT;
        covariance.0[6][6] = 10.0 * 10.0;
        let camera = Camera {
            position: WorldPoint::new(1.0, 2.0, 3.0),
            yaw: 0.0,
            pitch: 0.3,
            roll: 0.0,
            focal: 1000.0,
            lens: crate::camera::Lens::pinhole([960.0, 540.0].into()),
            covariance,
        };
        let efov = default_efov(&camera, SIZE).polygon;
        let of = CoverageCamera { camera: &camera, extent: Extent { size: SIZE, efov: &efov } };
        let grid = FloorGrid { origin: FloorPoint { x: -19.0, y: 0.0 }, step: 0.25, columns: 160, rows: 90 };
        let reach = of.reach(&[], &grid, [0.0, 100.0]).unwrap();
        assert!(reach.is_limited_by_density && reach.distance > 5.0, "{reach:?}");
        // The density is proportional to the focal length; a longer one moves the border by the sigma.
        let longer = Camera { focal: 1010.0, ..camera };
        let farther = CoverageCamera { camera: &longer, ..of }.reach(&[], &grid, [0.0, 100.0]).unwrap();
        let moved = farther.distance - reach.distance;
        assert!((moved - reach.sigma.unwrap()).abs() < 0.1 * moved, "{moved} {reach:?}");
        assert_eq!(of.reach(&[], &grid, [0.0, 1e6]), None);
        let all = of.reach(&[], &grid, [0.0, 1.0]).unwrap();
        assert!(!all.is_limited_by_density && all.sigma.is_none());
    }

    #[test]
    fn shares_of_an_area_match_its_geometry() {
        // The camera looks straight down from 4 m and sees 8 m x 4.5 m of the floor.
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, 4.0),
            yaw: 0.0,
            pitch: std::f64::consts::FRAC_PI_2,
            roll: 0.0,
            focal: 960.0,
            lens: crate::camera::Lens::pinhole([960.0, 540.0].into()),
            covariance: crate::camera::Covariance::EXACT,
        };
        let efov = default_efov(&camera, SIZE).polygon;
        let of = [CoverageCamera { camera: &camera, extent: Extent { size: SIZE, efov: &efov } }];
        let area = [[0.0, -1.0], [8.0, -1.0], [8.0, 1.0], [0.0, 1.0]].map(FloorPoint::from);
        let found = AreaCoverage::new(&of, &[], &area, [0.0, 0.0, 0.5]).unwrap();
        assert!((found.blind_share - 0.5).abs() < 0.005, "{found:?}");
        assert!((found.share - 0.5).abs() < 0.005);
        let wall =
            Wall { from: FloorPoint { x: 2.0, y: -9.0 }, to: FloorPoint { x: 2.0, y: 9.0 }, height: 1.0 };
        // Behind the wall the floor is hidden as far as x = 2 * 4 / 3.
        let found = AreaCoverage::new(&of, &[wall], &area, [0.0, 0.0, 0.5]).unwrap();
        assert!((found.blind_share - 0.5 - 2.0 / 3.0 / 8.0).abs() < 0.005, "{found:?}");
        assert_eq!(AreaCoverage::new(&of, &[], &area[..2], [0.0, 0.0, 0.5]), None);
    }
}
