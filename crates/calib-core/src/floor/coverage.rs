//! Coverage: the floor points that a group of cameras sees, and their pixel densities.
//!
//! A camera sees a target at a floor point and a height if three conditions hold: the floor point is in the
//! camera's EFOV, the point at the height is in the image, and no wall crosses the line of sight to it.

use std::f64::consts::TAU;
use std::ops::Range;

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
    /// Whether the wall crosses the line of sight from `eye` to `target`. A target that touches the wall is
    /// visible.
    #[must_use]
    pub fn blocks(&self, eye: WorldPoint, target: WorldPoint) -> bool {
        /// Last share of the line of sight. A target counts as touching a wall that crosses the line there.
        const TOUCHING_SHARE: f64 = 1e-9;
        let sight = [target.x - eye.x, target.y - eye.y];
        let along = [self.to.x - self.from.x, self.to.y - self.from.y];
        let start = [self.from.x - eye.x, self.from.y - eye.y];
        let determinant = sight[0] * along[1] - sight[1] * along[0];
        // Shares of the line of sight and of the wall at their crossing, as seen from above. They are not
        // finite for parallel lines, which do not block.
        let of_sight = (start[0] * along[1] - start[1] * along[0]) / determinant;
        let of_wall = (start[0] * sight[1] - start[1] * sight[0]) / determinant;
        (0.0..1.0 - TOUCHING_SHARE).contains(&of_sight)
            && (0.0..=1.0).contains(&of_wall)
            && eye.z + of_sight * (target.z - eye.z) < self.height
    }

    /// Whether a camera can be mounted on the wall: it is within 10 cm of the wall, seen from above. The
    /// calibrated position can then be on either side, so the wall does not block this camera.
    #[must_use]
    pub fn carries(&self, camera: FloorPoint) -> bool {
        /// Largest distance of a mounted camera from the wall, in metres.
        const MAX_MOUNT_DISTANCE: f64 = 0.1;
        let along = [self.to.x - self.from.x, self.to.y - self.from.y];
        let start = [camera.x - self.from.x, camera.y - self.from.y];
        let square = along[0] * along[0] + along[1] * along[1];
        let share = if square > 0.0 { (start[0] * along[0] + start[1] * along[1]) / square } else { 0.0 };
        let share = share.clamp(0.0, 1.0);
        let off = [start[0] - share * along[0], start[1] - share * along[1]];
        off[0].hypot(off[1]) <= MAX_MOUNT_DISTANCE
    }
}

/// Walls around a camera, grouped by their direction from the camera. Walls that can carry it are left out.
struct WallsAround {
    eye: WorldPoint,
    /// Walls of each sector of the circle around the camera.
    sectors: Vec<Vec<Wall>>,
}

impl WallsAround {
    /// Number of sectors of the circle around the camera.
    const SECTORS: usize = 512;

    fn new(eye: WorldPoint, walls: &[Wall], efov: &[FloorPoint]) -> Self {
        let bounds = Bounds::new(efov.iter().copied().chain([eye.on_floor()]));
        let mut sectors = vec![Vec::new(); Self::SECTORS];
        let is_near = |wall: &&Wall| {
            !wall.carries(eye.on_floor()) && bounds.meets(&Bounds::new([wall.from, wall.to].into_iter()))
        };
        for wall in walls.iter().filter(is_near) {
            let [from, to] = [wall.from, wall.to].map(|end| Self::angle(eye, end));
            // A wall spans less than half of the circle around the camera.
            let turn = (to - from + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
            let (first, last) = if turn >= 0.0 { (from, from + turn) } else { (from + turn, from) };
            let sector = |angle: f64| (angle / TAU * Self::SECTORS as f64).floor() as i64;
            // The neighbours are included, so that rounding at a border loses no wall.
            for index in sector(first) - 1..=sector(last) + 1 {
                sectors[index.rem_euclid(Self::SECTORS as i64) as usize].push(*wall);
            }
        }
        Self { eye, sectors }
    }

    fn angle(eye: WorldPoint, point: FloorPoint) -> f64 {
        (point.y - eye.y).atan2(point.x - eye.x).rem_euclid(TAU)
    }

    /// Whether a wall crosses the line of sight to the target.
    fn hide(&self, target: WorldPoint) -> bool {
        let angle = Self::angle(self.eye, target.on_floor());
        let sector = ((angle / TAU * Self::SECTORS as f64) as usize).min(Self::SECTORS - 1);
        self.sectors[sector].iter().any(|wall| wall.blocks(self.eye, target))
    }
}

/// Grid of floor points, in rows along x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorGrid {
    /// First point of the first row.
    pub origin: FloorPoint,
    /// Distance between neighbouring points, in metres.
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

    /// Returns the ranges of columns in a row whose points are inside a polygon (even-odd rule).
    fn columns_inside(&self, polygon: &[FloorPoint], row: usize) -> Vec<Range<usize>> {
        let y = self.y(row);
        let edges = polygon.iter().zip(polygon.iter().cycle().skip(1));
        let mut crossings: Vec<f64> = edges
            .filter(|(a, b)| (a.y > y) != (b.y > y))
            .map(|(a, b)| a.x + (y - a.y) * (b.x - a.x) / (b.y - a.y))
            .collect();
        crossings.sort_by(f64::total_cmp);
        let column = |x: f64| {
            // A point on a crossing counts as right of it. Casts of negative values give 0.
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
    /// Standard deviation of the distance, in metres, from the uncertainty of the calibration. `None` if the
    /// uncertainty is unknown, or if the border of the view or a wall limits the distance in this direction.
    pub sigma: Option<f64>,
    /// Whether the density limits the distance: the camera also sees farther floor, but with a lower density.
    /// Otherwise the visible floor ends before the density falls to the limit.
    pub is_limited_by_density: bool,
}

impl CoverageCamera<'_> {
    /// Returns, for each pixel density (pixels per metre), the farthest visible point that reaches it, for
    /// targets at `height` metres. A density that no point reaches gives `None`.
    ///
    /// The farthest points of a grid give the directions; bisection gives the border of the density. If the
    /// errors of the calibration change the density there by `s`, and the density falls by `g` per metre of
    /// distance, then the standard deviation of the border is `s / g`.
    #[must_use]
    pub fn reaches<const N: usize>(
        &self,
        walls: &[Wall],
        height: f64,
        densities: [f64; N],
    ) -> [Option<Reach>; N] {
        /// Number of grid points along each side of the EFOV.
        const SIDE_POINTS: usize = 150;
        /// Smallest distance of a grid point whose direction is searched, as a share of the distance of the farthest
        /// grid point that reaches the density.
        const MIN_SHARE: f64 = 0.98;
        /// Largest number of directions that are searched.
        const MAX_CANDIDATES: usize = 60;
        let Bounds { low, high } = Bounds::new(self.extent.efov.iter().copied());
        let size = [high[0] - low[0], high[1] - low[1]];
        let step = size[0].max(size[1]) / SIDE_POINTS as f64;
        if !(step.is_finite() && step > 0.0) {
            return [None; N];
        }
        let count = size.map(|length| (length / step) as usize + 1);
        let origin = FloorPoint { x: low[0], y: low[1] };
        let grid = FloorGrid { origin, step, columns: count[0], rows: count[1] };
        let around = WallsAround::new(self.camera.position, walls, self.extent.efov);
        let foot = self.camera.position.on_floor();
        let mut visible: Vec<(f64, f64, FloorPoint)> = Vec::new();
        self.each_visible(&around, &grid, height, |at, density| {
            let point = grid.point(at);
            visible.push((point.distance(foot), density, point));
        });
        visible.sort_by(|a, b| b.0.total_cmp(&a.0));
        densities.map(|density| {
            let index = visible.iter().position(|(_, own, _)| *own >= density)?;
            let farthest = visible[index].0;
            let is_limited_by_density = index > 0;
            // Several directions are searched: in some, the EFOV ends before the density falls to the limit.
            let candidates = visible[index..]
                .iter()
                .take_while(|(distance, ..)| *distance >= MIN_SHARE * farthest)
                .filter(|(_, own, _)| is_limited_by_density && *own >= density)
                .take(MAX_CANDIDATES);
            let borders = candidates.filter_map(|&(distance, _, point)| {
                Border { camera: self, around: &around, point, height, density }.refine(distance, step)
            });
            let border = borders.max_by(|a, b| a.0.total_cmp(&b.0));
            let (distance, sigma) = border.unwrap_or((farthest, None));
            Some(Reach { distance, sigma, is_limited_by_density })
        })
    }

    /// Calls `each` with the index and the pixel density of every visible point of a grid.
    fn each_visible(
        &self,
        around: &WallsAround,
        grid: &FloorGrid,
        height: f64,
        mut each: impl FnMut(usize, f64),
    ) {
        let densities = DensityCamera::new(self.camera);
        for row in 0..grid.rows {
            for column in grid.columns_inside(self.extent.efov, row).into_iter().flatten() {
                let target = WorldPoint::new(grid.x(column), grid.y(row), height);
                let Some((pixel, density)) = densities.at(target) else { continue };
                if self.extent.shows(pixel) && !around.hide(target) {
                    each(row * grid.columns + column, density);
                }
            }
        }
    }

    /// Whether the camera sees a target: it is in the EFOV and in the image, and no wall hides it.
    fn sees(&self, around: &WallsAround, target: WorldPoint) -> bool {
        self.extent.contains(target.on_floor())
            && self.camera.world_to_pixel(target).is_some_and(|pixel| self.extent.shows(pixel))
            && !around.hide(target)
    }
}

/// Search for the border of a pixel density: the distance from the camera, in the direction of a floor point, at
/// which the density falls below a limit.
struct Border<'a> {
    camera: &'a CoverageCamera<'a>,
    around: &'a WallsAround,
    /// Floor point that reaches the density.
    point: FloorPoint,
    /// Height of the targets, in metres.
    height: f64,
    /// Density, in pixels per metre.
    density: f64,
}

impl Border<'_> {
    /// Returns the target of a camera at `distance` metres from its foot, in the direction of the point.
    fn target(&self, camera: &Camera, distance: f64) -> WorldPoint {
        let foot = self.camera.camera.position.on_floor();
        let share = distance / self.point.distance(foot);
        let [x, y] = [share * (self.point.x - foot.x), share * (self.point.y - foot.y)];
        WorldPoint::new(camera.position.x + x, camera.position.y + y, self.height)
    }

    /// Returns the distance from the foot of the camera to the border, and its standard deviation, in metres. The
    /// standard deviation is `None` if the uncertainty of the camera is unknown. `least` is the distance from the
    /// foot to the floor point, and `step` the distance between grid points.
    ///
    /// Returns `None` if the density is still reached two steps farther. Also returns `None` if the EFOV, the image
    /// or a wall ends the view before the density falls to the limit.
    fn refine(&self, least: f64, step: f64) -> Option<(f64, Option<f64>)> {
        /// Number of bisection steps.
        const HALVINGS: usize = 40;
        /// Step of the derivative along the distance, in metres.
        const STEP: f64 = 1e-3;
        let camera = self.camera.camera;
        let of = |camera: &Camera, distance: f64| camera.pixel_density(self.target(camera, distance));
        let reaches = |distance: f64| {
            self.camera.sees(self.around, self.target(camera, distance))
                && of(camera, distance).is_some_and(|density| density >= self.density)
        };
        let (mut low, mut high) = (least, least + 2.0 * step);
        if least <= STEP || !reaches(low) || reaches(high) {
            return None;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if reaches(middle) { low = middle } else { high = middle }
        }
        if !of(camera, high).is_some_and(|density| density < self.density) {
            return None;
        }
        let slope = (of(camera, low + STEP)? - of(camera, low - STEP)?) / (2.0 * STEP);
        let variance = camera.variance_of(|camera| of(camera, low));
        let sigma = variance.map(|variance| variance.sqrt() / slope.abs()).filter(|sigma| sigma.is_finite());
        Some((low, sigma))
    }
}

/// Coverage of the points of a grid. The lists have one entry for each point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Pixel density of the best camera, in pixels per metre; 0 for a blind spot.
    pub density: Vec<f64>,
    /// Index of the camera with the largest pixel density.
    pub best: Vec<Option<usize>>,
    /// Number of cameras that see the target at each point.
    pub seen_by: Vec<usize>,
    /// For every camera, the runs of points that it sees, each within a row, in ascending order.
    pub visible: Vec<Vec<Range<usize>>>,
}

impl Coverage {
    /// Computes the coverage of targets at `height` metres above the points of a grid.
    #[must_use]
    pub fn new(cameras: &[CoverageCamera<'_>], walls: &[Wall], grid: &FloorGrid, height: f64) -> Self {
        let mut coverage = Self {
            density: vec![0.0; grid.len()],
            best: vec![None; grid.len()],
            seen_by: vec![0; grid.len()],
            visible: vec![Vec::new(); cameras.len()],
        };
        for (index, camera) in cameras.iter().enumerate() {
            coverage.add(index, camera, walls, grid, height);
        }
        coverage
    }

    fn add(
        &mut self,
        index: usize,
        camera: &CoverageCamera<'_>,
        walls: &[Wall],
        grid: &FloorGrid,
        height: f64,
    ) {
        let around = WallsAround::new(camera.camera.position, walls, camera.extent.efov);
        camera.each_visible(&around, grid, height, |at, density| {
            self.seen_by[at] += 1;
            match self.visible[index].last_mut() {
                Some(run) if run.end == at && at % grid.columns != 0 => run.end += 1,
                _ => self.visible[index].push(at..at + 1),
            }
            if self.best[at].is_none() || density > self.density[at] {
                (self.density[at], self.best[at]) = (density, Some(index));
            }
        });
    }
}

/// Requirement on the targets of an area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Requirement {
    /// Height of the targets above the floor, in metres.
    pub height: f64,
    /// Smallest pixel density, in pixels per metre; 0 if targets only need to be visible.
    pub density: f64,
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
    /// Computes the coverage of a polygon, from the centres of about 10,000 cells. Returns `None` if the polygon
    /// has no area.
    #[must_use]
    pub fn new(
        cameras: &[CoverageCamera<'_>],
        walls: &[Wall],
        polygon: &[FloorPoint],
        required: Requirement,
    ) -> Option<Self> {
        /// Number of cells of the bounding box. The error of a share is then below 0.5 %.
        const CELLS: f64 = 10_000.0;
        /// Largest number of cells along a side, for long and narrow areas.
        const MAX_SIDE_CELLS: f64 = 2_000.0;
        let Bounds { low, high } = Bounds::new(polygon.iter().copied());
        let size = [high[0] - low[0], high[1] - low[1]];
        let area = size[0] * size[1];
        if !(area.is_finite() && area > 0.0) {
            return None;
        }
        let step = (area / CELLS).sqrt().max(size[0].max(size[1]) / MAX_SIDE_CELLS);
        let count = size.map(|length| (length / step).ceil().max(1.0) as usize);
        // The points are the centres of cells.
        let origin = FloorPoint { x: low[0] + 0.5 * step, y: low[1] + 0.5 * step };
        let grid = FloorGrid { origin, step, columns: count[0], rows: count[1] };
        let coverage = Coverage::new(cameras, walls, &grid, required.height);
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
                reached += usize::from(density >= required.density);
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
                    let foot_of_camera = camera.position.on_floor();
                    let blocked = walls
                        .iter()
                        .any(|wall| !wall.carries(foot_of_camera) && wall.blocks(camera.position, target));
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
        assert!(!at(3.0, 9.0, 0.0), "the line of sight does not cross the wall");
        assert!(wall.carries(FloorPoint { x: 0.5, y: 5.09 }) && !wall.carries(FloorPoint { x: 1.5, y: 5.0 }));
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
        // A narrow strip along the optical axis, so that all borders are in one direction.
        let efov = [[0.9, 7.0], [1.1, 7.0], [1.1, 17.0], [0.9, 17.0]].map(FloorPoint::from);
        let of = CoverageCamera { camera: &camera, extent: Extent { size: SIZE, efov: &efov } };
        let densities = [1.0, 100.0, 1e6];
        let [all, reach, none] = of.reaches(&[], 0.0, densities);
        let reach = reach.unwrap();
        assert!(reach.is_limited_by_density && reach.distance > 5.0, "{reach:?}");
        // A focal length that is longer by one standard deviation moves the border by one standard deviation.
        let longer = Camera { focal: 1010.0, ..camera };
        let [_, farther, _] = CoverageCamera { camera: &longer, ..of }.reaches(&[], 0.0, densities);
        let moved = farther.unwrap().distance - reach.distance;
        assert!((moved - reach.sigma.unwrap()).abs() < 0.1 * moved, "{moved} {reach:?}");
        assert_eq!(none, None);
        assert!(all.is_some_and(|all| !all.is_limited_by_density && all.sigma.is_none()));
        // A wall across the view, higher than the camera, hides the border.
        let [left, right] = [-20.0, 20.0].map(|x| FloorPoint { x, y: 2.0 + 0.8 * reach.distance });
        let wall = Wall { from: left, to: right, height: 9.0 };
        let [_, nearer, _] = of.reaches(&[wall], 0.0, densities);
        let nearer = nearer.unwrap();
        assert!(nearer.distance < 0.81 * reach.distance && nearer.sigma.is_none(), "{nearer:?}");
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
        let visible = Requirement { height: 0.0, density: 0.0 };
        let found = AreaCoverage::new(&of, &[], &area, visible).unwrap();
        assert!((found.blind_share - 0.5).abs() < 0.005, "{found:?}");
        assert!((found.share - 0.5).abs() < 0.005);
        let wall =
            Wall { from: FloorPoint { x: 2.0, y: -9.0 }, to: FloorPoint { x: 2.0, y: 9.0 }, height: 1.0 };
        // Behind the wall the floor is hidden as far as x = 2 * 4 / 3.
        let found = AreaCoverage::new(&of, &[wall], &area, visible).unwrap();
        assert!((found.blind_share - 0.5 - 2.0 / 3.0 / 8.0).abs() < 0.005, "{found:?}");
        assert_eq!(AreaCoverage::new(&of, &[], &area[..2], visible), None);
    }
}
