//! Coverage of the site: visible floor, pixel densities, and the areas that miss their level.

use calib_core::camera::{Camera, FloorPoint};
use calib_core::floor::{
    AreaCoverage, Coverage, CoverageCamera, DensityLevel, Extent, FloorGrid, Reach, Wall,
};

use crate::document::{Site, SiteCamera};
use crate::solution::Stage;
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
}

/// Coverage of a site.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteCoverage<'a> {
    /// Cameras, in the order of the indices in `coverage`.
    pub cameras: Vec<&'a SiteCamera>,
    /// Cameras without a place in the site, which are left out.
    pub unplaced: Vec<&'a SiteCamera>,
    /// Grid of floor points around all EFOVs and areas.
    pub grid: FloorGrid,
    /// Coverage of the grid.
    pub coverage: Coverage,
    /// Coverage of every area, in the order of the file.
    pub areas: Vec<AreaResult<'a>>,
    /// For every camera of `cameras`, the farthest point that reaches each level of [`DensityLevel::ALL`].
    pub reaches: Vec<[Option<Reach>; DensityLevel::ALL.len()]>,
}

/// Rectangle of the grid in which the best camera reaches the same level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelRectangle {
    /// Level; `None` below all levels.
    pub level: Option<DensityLevel>,
    /// Smallest x and y, in metres.
    pub low: FloorPoint,
    /// Largest x and y, in metres.
    pub high: FloorPoint,
}

impl SiteCoverage<'_> {
    /// Returns the visible floor as rectangles of equal level. Every grid point stands for the square around
    /// it.
    #[must_use]
    pub fn rectangles(&self) -> Vec<LevelRectangle> {
        let half = 0.5 * self.grid.step;
        let mut done: Vec<LevelRectangle> = Vec::new();
        // Rectangles that end in the previous row, and can be continued.
        let mut open: Vec<(std::ops::Range<usize>, LevelRectangle)> = Vec::new();
        for row in 0..self.grid.rows {
            let mut next = Vec::new();
            for (columns, level) in self.runs(row) {
                let at = |column: usize| self.grid.point(row * self.grid.columns + column);
                let (first, last) = (at(columns.start), at(columns.end - 1));
                let high = FloorPoint { x: last.x + half, y: last.y + half };
                let above = open.iter().position(|(other, own)| *other == columns && own.level == level);
                let low = match above {
                    Some(index) => open.swap_remove(index).1.low,
                    None => FloorPoint { x: first.x - half, y: first.y - half },
                };
                next.push((columns, LevelRectangle { level, low, high }));
            }
            done.extend(std::mem::replace(&mut open, next).into_iter().map(|(_, rectangle)| rectangle));
        }
        done.extend(open.into_iter().map(|(_, rectangle)| rectangle));
        done
    }

    /// Returns the runs of visible points of equal level in a row.
    fn runs(&self, row: usize) -> Vec<(std::ops::Range<usize>, Option<DensityLevel>)> {
        let mut runs: Vec<(std::ops::Range<usize>, Option<DensityLevel>)> = Vec::new();
        for column in 0..self.grid.columns {
            let at = row * self.grid.columns + column;
            if self.coverage.seen_by[at] == 0 {
                continue;
            }
            let level = DensityLevel::reached_by(self.coverage.density[at]);
            match runs.last_mut() {
                Some((range, last)) if range.end == column && *last == level => range.end += 1,
                _ => runs.push((column..column + 1, level)),
            }
        }
        runs
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
    /// Coverage of the area; `None` if its polygon has no area.
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoverageError {
    /// No camera of the site is calibrated.
    NoCamera,
    /// The grid has more points than the limit.
    TooManyPoints {
        /// Number of points.
        points: usize,
        /// Largest number of points.
        most: usize,
    },
}

impl std::fmt::Display for CoverageError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoCamera => f.write_str("no camera of the site is calibrated: solve the site first"),
            Self::TooManyPoints { points, most } => {
                write!(f, "the grid has {points} points, at most {most} are possible: use a larger step")
            }
        }
    }
}

impl std::error::Error for CoverageError {}

impl Site {
    /// Computes which floor points the cameras see and with which pixel density.
    ///
    /// A camera sees a target if its foot is in the camera's EFOV, the point at the height is in the image,
    /// and no wall is between them. The grid lines are at multiples of the step.
    ///
    /// # Errors
    /// If no camera is calibrated, or the grid has too many points.
    pub fn coverage(&self, options: &CoverageOptions) -> Result<SiteCoverage<'_>, CoverageError> {
        let views: Vec<FloorView<'_>> =
            self.cameras.iter().filter_map(|entry| FloorView::new(self, entry)).collect();
        // The frame of a camera without a place is its own, unless it is the only one.
        let is_used = |view: &FloorView<'_>| view.is_placed || views.len() == 1;
        let used: Vec<CoverageCamera<'_>> =
            views.iter().filter(|v| is_used(v)).map(FloorView::for_coverage).collect();
        let walls: Vec<Wall> = self.walls.iter().map(Wall::from).collect();
        let grid = self.grid(&used, options.step)?;
        let area = |area: &'_ Area| {
            let level = options.level.or(area.level);
            let required = level.map_or(0.0, DensityLevel::pixels_per_metre);
            AreaCoverage::new(&used, &walls, &area.polygon_m, [options.height, required, grid.step])
        };
        let reach = |camera: &CoverageCamera<'_>| {
            DensityLevel::ALL
                .map(|level| camera.reach(&walls, &grid, [options.height, level.pixels_per_metre()]))
        };
        let areas = self
            .areas
            .iter()
            .map(|entry| AreaResult {
                area: entry,
                level: options.level.or(entry.level),
                coverage: area(entry),
            })
            .collect();
        Ok(SiteCoverage {
            cameras: views.iter().filter(|view| is_used(view)).map(|view| view.entry).collect(),
            unplaced: views.iter().filter(|view| !is_used(view)).map(|view| view.entry).collect(),
            coverage: Coverage::new(&used, &walls, &grid, options.height),
            reaches: used.iter().map(reach).collect(),
            grid,
            areas,
        })
    }

    /// Returns a grid around all EFOVs and areas.
    fn grid(&self, cameras: &[CoverageCamera<'_>], step: Option<f64>) -> Result<FloorGrid, CoverageError> {
        /// Largest number of points.
        const MOST: usize = 4_000_000;
        /// Number of points that a grid has at most if its step is not given.
        const USUAL_MOST: f64 = 100_000.0;
        let efovs = cameras.iter().flat_map(|camera| camera.extent.efov);
        let corners = self.areas.iter().flat_map(|area| &area.polygon_m);
        let [mut low, mut high] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for &FloorPoint { x, y } in efovs.chain(corners) {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        let size = [high[0] - low[0], high[1] - low[1]];
        if cameras.is_empty() || !size.iter().all(|length| length.is_finite()) {
            return Err(CoverageError::NoCamera);
        }
        let step = step.unwrap_or_else(|| round_step((size[0] * size[1] / USUAL_MOST).sqrt()));
        let first = low.map(|value| (value / step).floor());
        let count = [0, 1].map(|axis| ((high[axis] / step).ceil() - first[axis]) as usize + 1);
        let points = count[0].saturating_mul(count[1]);
        if points > MOST {
            return Err(CoverageError::TooManyPoints { points, most: MOST });
        }
        let origin = FloorPoint { x: first[0] * step, y: first[1] * step };
        Ok(FloorGrid { origin, step, columns: count[0], rows: count[1] })
    }
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
struct FloorView<'a> {
    entry: &'a SiteCamera,
    camera: Camera,
    efov: Vec<FloorPoint>,
    is_placed: bool,
}

impl<'a> FloorView<'a> {
    fn new(site: &Site, entry: &'a SiteCamera) -> Option<Self> {
        let camera = site.camera_for_use(entry)?;
        let is_placed = entry.solution.as_ref()?.stage > Stage::Partial;
        Some(Self { entry, camera, efov: site.efov_on_floor(entry), is_placed })
    }

    fn for_coverage(&self) -> CoverageCamera<'_> {
        CoverageCamera { camera: &self.camera, extent: Extent { size: self.entry.size(), efov: &self.efov } }
    }
}
