//! Coverage of the site: visible floor, pixel densities, the results of the areas, and hand-over zones.

use calib_core::camera::{Camera, FloorPoint};
use calib_core::floor::{
    AreaCoverage, Coverage, CoverageCamera, DensityLevel, Extent, FloorGrid, HandOver, LevelLimits, Reach,
    Requirement, UnknownDisagreement, Wall,
};

use crate::document::{Site, SiteCamera};
use crate::survey_entries::{Area, WallEntry};

/// Options of a coverage computation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CoverageOptions {
    /// Height of the targets above the floor, in metres.
    pub height: f64,
    /// Distance between grid points, in metres; chosen from the size of the site if absent.
    pub step: Option<f64>,
    /// Level that replaces the levels of all areas.
    pub level: Option<DensityLevel>,
    /// Number of points at which the disagreement of a hand-over zone is computed; 100 if absent.
    pub points_per_zone: Option<usize>,
}

/// Coverage of a site.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteCoverage<'a> {
    /// Cameras, in the order of the indices in `coverage`.
    pub cameras: Vec<&'a SiteCamera>,
    /// Calibrated cameras that are left out, because they have no position relative to the others.
    pub left_out: Vec<&'a SiteCamera>,
    /// Cameras of `cameras` whose scale is assumed. All their distances and densities can be wrong by a common
    /// factor.
    pub scale_assumed: Vec<&'a SiteCamera>,
    /// Height of the targets above the floor, in metres.
    pub height: f64,
    /// Grid of floor points around all EFOVs.
    pub grid: FloorGrid,
    /// Coverage of the grid.
    pub coverage: Coverage,
    /// Coverage of every area, in the order of the file.
    pub areas: Vec<AreaResult<'a>>,
    /// Zones of the floor that two cameras see, the largest first. Their cameras are indices into `cameras`.
    pub hand_overs: Vec<HandOver>,
    /// Smallest pixel density of each level, in pixels per metre.
    pub limits: LevelLimits,
    /// Views of `cameras`.
    views: Vec<FloorView<'a>>,
    walls: Vec<Wall>,
}

/// Rectangle of visible floor with one value, such as the level that the best camera reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorRectangle<T> {
    /// Value of all grid points in the rectangle.
    pub value: T,
    /// Smallest x and y, in metres.
    pub low: FloorPoint,
    /// Largest x and y, in metres.
    pub high: FloorPoint,
}

impl<T: Copy> FloorRectangle<T> {
    /// Returns the corners, counter-clockwise seen from above.
    #[must_use]
    pub const fn corners(&self) -> [FloorPoint; 4] {
        let Self { low, high, .. } = *self;
        [low, FloorPoint { x: high.x, y: low.y }, high, FloorPoint { x: low.x, y: high.y }]
    }
}

impl SiteCoverage<'_> {
    /// Returns the visible floor as rectangles of the level that the best camera reaches; `None` below all levels.
    #[must_use]
    pub fn rectangles(&self) -> Vec<FloorRectangle<Option<DensityLevel>>> {
        self.rectangles_of(|at| self.limits.reached_by(self.coverage.density[at]))
    }

    /// Returns the visible floor as rectangles in which the grid points have equal values. `value` returns the value
    /// of a grid point. Every grid point represents the square around it.
    #[must_use]
    pub fn rectangles_of<T: Copy + PartialEq>(&self, value: impl Fn(usize) -> T) -> Vec<FloorRectangle<T>> {
        let half = 0.5 * self.grid.step;
        let mut done: Vec<FloorRectangle<T>> = Vec::new();
        // Rectangles that end in the previous row, and can be continued.
        let mut open: Vec<(std::ops::Range<usize>, FloorRectangle<T>)> = Vec::new();
        for row in 0..self.grid.rows {
            let mut next = Vec::new();
            for (columns, value) in self.runs(row, &value) {
                let at = |column: usize| self.grid.point(row * self.grid.columns + column);
                let (first, last) = (at(columns.start), at(columns.end - 1));
                let high = FloorPoint { x: last.x + half, y: last.y + half };
                let above = open.iter().position(|(other, own)| *other == columns && own.value == value);
                let low = match above {
                    Some(index) => open.swap_remove(index).1.low,
                    None => FloorPoint { x: first.x - half, y: first.y - half },
                };
                next.push((columns, FloorRectangle { value, low, high }));
            }
            done.extend(std::mem::replace(&mut open, next).into_iter().map(|(_, rectangle)| rectangle));
        }
        done.extend(open.into_iter().map(|(_, rectangle)| rectangle));
        done
    }

    /// Returns the runs of visible points of equal value in a row.
    fn runs<T: Copy + PartialEq>(
        &self,
        row: usize,
        value: &impl Fn(usize) -> T,
    ) -> Vec<(std::ops::Range<usize>, T)> {
        let mut runs: Vec<(std::ops::Range<usize>, T)> = Vec::new();
        for column in 0..self.grid.columns {
            let at = row * self.grid.columns + column;
            if self.coverage.seen_by[at] == 0 {
                continue;
            }
            let value = value(at);
            match runs.last_mut() {
                Some((range, last)) if range.end == column && *last == value => range.end += 1,
                _ => runs.push((column..column + 1, value)),
            }
        }
        runs
    }

    /// Returns, for every camera of `cameras`, the farthest point that reaches each level of [`DensityLevel::ALL`].
    #[must_use]
    pub fn reaches(&self) -> Vec<[Option<Reach>; DensityLevel::ALL.len()]> {
        let of = |view: &FloorView<'_>| view.for_coverage().reaches(&self.walls, self.height, self.limits.0);
        self.views.iter().map(of).collect()
    }

    /// Returns the ids of the cameras of a hand-over zone.
    #[must_use]
    pub fn ids_of(&self, zone: &HandOver) -> [&str; 2] {
        zone.cameras.map(|index| self.cameras[index].id.as_str())
    }

    /// Returns the area of a hand-over zone, in square metres.
    #[must_use]
    pub fn area_of(&self, zone: &HandOver) -> f64 {
        zone.points as f64 * self.grid.step * self.grid.step
    }

    fn scale_is_known(&self, index: usize) -> bool {
        self.scale_assumed.iter().all(|entry| entry.id != self.cameras[index].id)
    }

    /// Explains why the disagreement of a hand-over zone is unknown.
    #[must_use]
    pub fn unknown_text(&self, why: UnknownDisagreement) -> String {
        let id = |index: usize| &self.cameras[index].id;
        match why {
            UnknownDisagreement::PlacedByHand(index) => {
                format!("unknown, because \"{}\" is placed by hand", id(index))
            }
            UnknownDisagreement::Camera(index) if !self.scale_is_known(index) => {
                format!("unknown, because the scale of \"{}\" is assumed: enter a length", id(index))
            }
            UnknownDisagreement::Camera(index) => {
                format!("unknown, because \"{}\" has no standard deviations", id(index))
            }
            UnknownDisagreement::Correlation => {
                "unknown, because the solution does not contain the correlation between the cameras".into()
            }
        }
    }

    /// Returns the visible floor area on which `holds` is true for the index of the grid point, in square
    /// metres.
    #[must_use]
    pub fn visible_area(&self, holds: impl Fn(usize) -> bool) -> f64 {
        let seen = (0..self.grid.len()).filter(|&at| self.coverage.seen_by[at] > 0 && holds(at)).count();
        seen as f64 * self.grid.step * self.grid.step
    }
}

/// Coverage of one area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaResult<'a> {
    /// Entry of the area.
    pub area: &'a Area,
    /// Required level; `None` if the area only needs to be visible.
    pub level: Option<DensityLevel>,
    /// Coverage of the area; `None` if its polygon has no area or is too narrow.
    pub coverage: Option<AreaCoverage>,
}

impl AreaResult<'_> {
    /// Whether the whole area reaches its level.
    #[must_use]
    pub fn is_met(&self) -> bool {
        self.coverage.is_some_and(|coverage| coverage.share >= 1.0)
    }
}

/// Error of a coverage computation.
#[derive(Clone, Debug, PartialEq)]
pub enum CoverageError {
    /// No camera of the site is calibrated and shows the floor.
    NoCamera,
    /// Several periods of a camera are valid.
    SeveralPeriods {
        /// Id of the camera.
        camera: String,
    },
    /// The step is not a positive number.
    Step,
    /// The grid has more points than the limit.
    TooManyPoints {
        /// Number of grid points.
        points: f64,
        /// Largest accepted number of grid points.
        most: usize,
    },
}

impl std::fmt::Display for CoverageError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoCamera => {
                f.write_str("no calibrated camera shows the floor: calibrate a camera that shows it")
            }
            Self::SeveralPeriods { camera } => {
                write!(f, "camera \"{camera}\" has several periods: choose a time")
            }
            Self::Step => f.write_str("the step must be a number of metres above 0"),
            Self::TooManyPoints { points, most } => {
                write!(f, "the grid has {points:.0} points, more than the limit of {most}: use a larger step")
            }
        }
    }
}

impl std::error::Error for CoverageError {}

impl Site {
    /// Returns the smallest pixel density of each level.
    #[must_use]
    pub fn level_limits(&self) -> LevelLimits {
        self.level_px_per_m.map_or_else(LevelLimits::default, |entry| entry.limits())
    }

    /// Computes the floor points that the cameras see, and their pixel densities.
    ///
    /// A camera sees a target if the foot of the target is in the camera's EFOV, its top is in the image, and no wall
    /// is between camera and target. The grid lines are at multiples of the step. Cameras without a position relative
    /// to the others are left out.
    ///
    /// # Errors
    /// If no camera is calibrated, an id has several periods, the step is not positive, or the grid has too many
    /// points.
    pub fn coverage(&self, options: &CoverageOptions) -> Result<SiteCoverage<'_>, CoverageError> {
        /// Default number of points at which the disagreement of a hand-over zone is computed.
        const USUAL_ZONE_POINTS: usize = 100;
        let views: Vec<FloorView<'_>> =
            self.cameras.iter().filter_map(|entry| FloorView::new(self, entry)).collect();
        for (index, view) in views.iter().enumerate() {
            if views[..index].iter().any(|other| other.entry.id == view.entry.id) {
                return Err(CoverageError::SeveralPeriods { camera: view.entry.id.clone() });
            }
        }
        let frame = self.main_frame(views.iter().map(|view| view.entry));
        let (used, others): (Vec<_>, Vec<_>) =
            views.into_iter().partition(|view| frame == Some(self.frame(view.entry)));
        let cameras: Vec<CoverageCamera<'_>> = used.iter().map(|view| view.for_coverage()).collect();
        let walls: Vec<Wall> = self.walls.iter().map(Wall::from).collect();
        let grid = grid(&cameras, options.step)?;
        let limits = self.level_limits();
        let areas = self.areas.iter().map(|area| {
            let level = options.level.or(area.level);
            let density = level.map_or(0.0, |level| limits.of(level));
            let required = Requirement { height: options.height, density };
            AreaResult {
                area,
                level,
                coverage: AreaCoverage::new(&cameras, &walls, &area.polygon_m, required),
            }
        });
        let areas = areas.collect();
        let coverage = Coverage::new(&cameras, &walls, &grid, options.height);
        let between = |a: usize, b: usize| {
            let [a, b] = [&used[a], &used[b]];
            let ids = [a.entry.id.as_str(), b.entry.id.as_str()];
            self.covariance_between(ids, [&a.camera, &b.camera]).map(|covariance| *covariance)
        };
        let points = options.points_per_zone.unwrap_or(USUAL_ZONE_POINTS);
        let hand_overs = coverage.hand_overs(&cameras, &grid, options.height, points, &between);
        let of_used: Vec<&SiteCamera> = used.iter().map(|view| view.entry).collect();
        Ok(SiteCoverage {
            scale_assumed: of_used.iter().copied().filter(|entry| !self.scale_is_known(entry)).collect(),
            cameras: of_used,
            left_out: others.iter().map(|view| view.entry).collect(),
            height: options.height,
            coverage,
            areas,
            hand_overs,
            limits,
            grid,
            views: used,
            walls,
        })
    }
}

/// Returns a grid around all EFOVs.
fn grid(cameras: &[CoverageCamera<'_>], step: Option<f64>) -> Result<FloorGrid, CoverageError> {
    /// Largest number of grid points.
    const MAX_POINTS: usize = 4_000_000;
    /// Largest number of grid points if the step is not given.
    const MAX_USUAL_POINTS: f64 = 100_000.0;
    let [mut low, mut high] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for &FloorPoint { x, y } in cameras.iter().flat_map(|camera| camera.extent.efov) {
        low = [low[0].min(x), low[1].min(y)];
        high = [high[0].max(x), high[1].max(y)];
    }
    let size = [high[0] - low[0], high[1] - low[1]];
    if !size.iter().all(|length| length.is_finite()) {
        return Err(CoverageError::NoCamera);
    }
    let step = step.unwrap_or_else(|| round_step((size[0] * size[1] / MAX_USUAL_POINTS).sqrt()));
    if !(step.is_finite() && step > 0.0) {
        return Err(CoverageError::Step);
    }
    let first = low.map(|value| (value / step).floor());
    let count = [0, 1].map(|axis| (high[axis] / step).ceil() - first[axis] + 1.0);
    let points = count[0] * count[1];
    if points > MAX_POINTS as f64 {
        return Err(CoverageError::TooManyPoints { points, most: MAX_POINTS });
    }
    let origin = FloorPoint { x: first[0] * step, y: first[1] * step };
    Ok(FloorGrid { origin, step, columns: count[0] as usize, rows: count[1] as usize })
}

/// Rounds a step up to 1, 2 or 5 times a power of ten, at least 0.05 m.
fn round_step(least: f64) -> f64 {
    [0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
        .into_iter()
        .find(|&step| step >= least)
        .unwrap_or(least)
}

impl From<&WallEntry> for Wall {
    fn from(entry: &WallEntry) -> Self {
        Self { from: entry.from_m, to: entry.to_m, height: entry.height_m.unwrap_or(f64::INFINITY) }
    }
}

/// Calibrated camera with its EFOV on the floor.
#[derive(Clone, Debug, PartialEq)]
struct FloorView<'a> {
    entry: &'a SiteCamera,
    camera: Camera,
    efov: Vec<FloorPoint>,
}

impl<'a> FloorView<'a> {
    /// Creates the view of a camera; `None` if the camera is not calibrated or shows no floor.
    fn new(site: &Site, entry: &'a SiteCamera) -> Option<Self> {
        let camera = site.camera_for_use(entry)?;
        let efov = site.efov_on_floor(entry);
        (efov.len() >= 3).then_some(Self { entry, camera, efov })
    }

    fn for_coverage(&self) -> CoverageCamera<'_> {
        CoverageCamera { camera: &self.camera, extent: Extent { size: self.entry.size(), efov: &self.efov } }
    }
}
