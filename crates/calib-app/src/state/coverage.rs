//! Coverage that the plan shows: the pixel density of the visible floor, computed when its inputs change.

use calib_core::floor::{DensityBorder, DensityLevel, FloorGrid, LevelLimits};
use calib_core::{Camera, FloorPoint, Pixel, WorldPoint};
use calib_draw::Rgb;
use calib_editor::Session;
use calib_report::{count_colour, hand_over_text, level_colour, level_text, levels};
use calib_site::{CoverageOptions, FloorRectangle, Site, SiteCamera, SiteCoverage, counted};

/// Quantity by which the floor is coloured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shading {
    /// Level, such as "recognise", of the highest pixel density that any camera has at a floor point.
    #[default]
    Level,
    /// Number of cameras that see a floor point.
    Cameras,
}

/// Coverage that is shown, kept until its inputs change.
#[derive(Debug)]
pub struct ShownCoverage {
    /// Height of the targets above the floor, in metres.
    pub(crate) height: f64,
    /// Quantity by which the floor is coloured.
    pub(crate) shading: Shading,
    /// Index of the hand-over zone under the pointer in the panel.
    pub(crate) pointed: Option<usize>,
    inputs: Option<Inputs>,
    pub(crate) result: Result<Computed, String>,
    /// Borders of the levels in the images that are shown.
    in_images: Vec<ImageBorders>,
}

/// Borders of the density levels in the image of a camera.
#[derive(Debug)]
struct ImageBorders {
    /// Index of the camera.
    camera: usize,
    /// Inputs of the borders: camera with x = y = 0 and yaw 0, image size in pixels, height of the targets in metres,
    /// and limits of the levels. Position on the floor and yaw do not affect the borders.
    inputs: (Camera, [f64; 2], f64, LevelLimits),
    borders: Vec<ShownBorder>,
}

/// Border of a density level.
#[derive(Debug)]
pub(crate) struct ShownBorder {
    pub(crate) border: DensityBorder,
    /// Raw pixel of the label, and the standard deviation of the border on the floor there, in metres (`None` if it is
    /// unknown). There is no label if the border is only the edge of the visible floor.
    pub(crate) label: Option<(Pixel, Option<f64>)>,
}

impl ShownBorder {
    /// Creates a border with its label at the pixel that is horizontally nearest to the image centre. `width` is the
    /// width of the image, in pixels; `height` is the height of the targets, in metres.
    fn new(border: DensityBorder, pose: &Camera, limits: &LevelLimits, width: f64, height: f64) -> Self {
        /// Largest relative difference of the pixel density from the limit of the level. At a larger difference, the
        /// pixel is on the edge of the visible floor.
        const MAX_DIFFERENCE: f64 = 0.01;
        let limit = limits.of(border.level);
        let target = |pixel: Pixel| {
            let point = pose.pixel_to_floor(pixel, height)?.at_height(height);
            let is_limit = (pose.pixel_density(point)? / limit - 1.0).abs() < MAX_DIFFERENCE;
            is_limit.then_some((pixel, point))
        };
        let off_centre = |pixel: Pixel| (pixel.u - 0.5 * width).abs();
        let pixels = border.segments.iter().flatten().copied().filter_map(target);
        let label = pixels.min_by(|a, b| off_centre(a.0).total_cmp(&off_centre(b.0)));
        Self { label: label.map(|(pixel, point)| (pixel, pose.density_border_sigma(point))), border }
    }
}

impl Default for ShownCoverage {
    fn default() -> Self {
        Self {
            height: 0.0,
            shading: Shading::Level,
            pointed: None,
            inputs: None,
            result: Ok(Computed::default()),
            in_images: Vec::new(),
        }
    }
}

/// Everything that determines a coverage.
#[derive(Clone, Debug, PartialEq)]
struct Inputs {
    /// Pose and EFOV of every camera.
    cameras: Vec<(Camera, Vec<FloorPoint>)>,
    /// Number of gestures that changed the site. It changes with the walls, areas and ids of the site.
    generation: u64,
    height: f64,
    shading: Shading,
}

/// Coverage of a site. It contains no references to the site and stays available while the site is edited.
#[derive(Debug)]
pub(crate) struct Computed {
    /// Coloured rectangles of the visible floor.
    pub(crate) rectangles: Vec<FloorRectangle<Rgb>>,
    grid: FloorGrid,
    density: Vec<f64>,
    best: Vec<Option<usize>>,
    seen_by: Vec<usize>,
    /// Ids of the cameras; `best` contains indices of this list.
    cameras: Vec<String>,
    pub(crate) limits: LevelLimits,
    /// Hand-over zones, the largest first.
    pub(crate) hand_overs: Vec<ShownHandOver>,
    /// Entries of the legend.
    pub(crate) legend: Vec<LegendEntry>,
    /// Ids of cameras that are left out, because they have no position relative to the others.
    pub(crate) left_out: Vec<String>,
    /// Ids of cameras whose scale is assumed.
    pub(crate) assumed: Vec<String>,
    /// Areas of interest, and whether each reaches its level.
    pub(crate) results: Vec<(String, bool)>,
}

/// Entry of the legend: colour, text, and visible floor in square metres.
pub(crate) type LegendEntry = (Rgb, String, f64);

/// Floor that two cameras see.
#[derive(Debug)]
pub(crate) struct ShownHandOver {
    /// Ids of the cameras.
    pub(crate) cameras: [String; 2],
    /// Area of the floor that both cameras see, in square metres.
    pub(crate) area: f64,
    /// Point in the middle of the zone.
    pub(crate) middle: FloorPoint,
    /// Expected disagreement, or why it is unknown.
    pub(crate) disagreement: String,
}

impl Default for Computed {
    fn default() -> Self {
        Self {
            rectangles: Vec::new(),
            grid: FloorGrid { origin: FloorPoint::default(), step: 1.0, columns: 0, rows: 0 },
            density: Vec::new(),
            best: Vec::new(),
            seen_by: Vec::new(),
            cameras: Vec::new(),
            limits: LevelLimits::default(),
            hand_overs: Vec::new(),
            legend: Vec::new(),
            left_out: Vec::new(),
            assumed: Vec::new(),
            results: Vec::new(),
        }
    }
}

impl Inputs {
    fn new(session: &Session, height: f64, shading: Shading) -> Self {
        let camera = |index: usize| {
            let (pose, solution) = (session.solved.pose(index)?, session.solved.solution(index)?);
            (!session.site.is_superseded(index)).then(|| (*pose, solution.efov_m.clone()))
        };
        Self {
            cameras: (0..session.site.cameras.len()).filter_map(camera).collect(),
            generation: session.revision.generation,
            height,
            shading,
        }
    }
}

impl Inputs {
    /// Returns the distance between the grid points, in metres. It limits the number of points, so that the display
    /// follows a dragged camera without delay. `None` if the cameras see no floor.
    fn step(&self) -> Option<f64> {
        /// Largest number of grid points.
        const MAX_POINTS: f64 = 25_000.0;
        /// Smallest step, in metres.
        const MIN_STEP: f64 = 0.05;
        let corners = || self.cameras.iter().flat_map(|(_, field)| field);
        let range = |of: fn(&FloorPoint) -> f64| {
            let values = || corners().map(of);
            values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
        };
        let area = range(|at| at.x) * range(|at| at.y);
        (area.is_finite() && area > 0.0)
            .then(|| ((area / MAX_POINTS).sqrt() / MIN_STEP).ceil().max(1.0) * MIN_STEP)
    }
}

impl Computed {
    fn new(session: &Session, inputs: &Inputs) -> Result<Self, String> {
        let mut site: Site = session.solved.write_into(&session.site);
        let superseded: Vec<bool> =
            (0..site.cameras.len()).map(|index| session.site.is_superseded(index)).collect();
        let mut index = 0;
        site.cameras.retain(|_| {
            index += 1;
            !superseded[index - 1]
        });
        let options = CoverageOptions {
            height: inputs.height,
            step: inputs.step(),
            points_per_zone: Some(25),
            level: None,
        };
        let found = site.coverage(&options).map_err(|error| error.to_string())?;
        let ids = |cameras: &[&SiteCamera]| cameras.iter().map(|camera| camera.id.clone()).collect();
        let (rectangles, legend) = coloured(&found, inputs.shading);
        let results = found.areas.iter().map(|result| {
            (result.area.name.clone().unwrap_or_else(|| result.area.id.clone()), result.is_met())
        });
        let hand_overs = found.hand_overs.iter().map(|zone| ShownHandOver {
            cameras: found.ids_of(zone).map(str::to_owned),
            area: found.area_of(zone),
            middle: zone.middle,
            disagreement: hand_over_text(&found, zone, session.site.units),
        });
        Ok(Self {
            rectangles,
            legend,
            results: results.collect(),
            left_out: ids(&found.left_out),
            assumed: ids(&found.scale_assumed),
            cameras: ids(&found.cameras),
            limits: found.limits,
            hand_overs: hand_overs.collect(),
            grid: found.grid,
            density: found.coverage.density,
            best: found.coverage.best,
            seen_by: found.coverage.seen_by,
        })
    }

    /// Returns the index of the grid point nearest to a floor point.
    fn nearest(&self, [x, y]: [f64; 2]) -> Option<usize> {
        let FloorGrid { origin, step, columns, rows } = self.grid;
        let [column, row] = [(x - origin.x) / step, (y - origin.y) / step].map(f64::round);
        let is_inside = (0.0..columns as f64).contains(&column) && (0.0..rows as f64).contains(&row);
        is_inside.then(|| row as usize * columns + column as usize)
    }
}

/// Returns the coloured rectangles of the visible floor, and the entries of the legend.
fn coloured(found: &SiteCoverage<'_>, shading: Shading) -> (Vec<FloorRectangle<Rgb>>, Vec<LegendEntry>) {
    let coverage = &found.coverage;
    match shading {
        Shading::Level => {
            let reached = |at: usize| found.limits.reached_by(coverage.density[at]);
            let entry = |level| {
                let text = level_text(level, &found.limits);
                (level_colour(level), text, found.visible_area(|at| reached(at) == level))
            };
            let legend = levels().map(entry).collect();
            (found.rectangles_of(|at| level_colour(reached(at))), legend)
        }
        Shading::Cameras => {
            let most = DensityLevel::ALL.len();
            let seen = |at: usize| coverage.seen_by[at].min(most);
            let entry = |count: usize| {
                let or_more = if count == most { " or more" } else { "" };
                let text = format!("{}{or_more}", counted(count, "camera", "cameras"));
                (count_colour(count), text, found.visible_area(|at| seen(at) == count))
            };
            let legend = (1..=most).map(entry).collect();
            (found.rectangles_of(|at| count_colour(seen(at))), legend)
        }
    }
}

impl ShownCoverage {
    /// Computes the coverage again if its inputs have changed.
    pub(crate) fn update(&mut self, session: &Session) {
        let inputs = Inputs::new(session, self.height, self.shading);
        if self.inputs.as_ref() != Some(&inputs) {
            self.result = Computed::new(session, &inputs);
            self.inputs = Some(inputs);
        }
    }

    /// Returns the borders of the levels in the image of a camera. They are computed again only if the inputs in
    /// [`ImageBorders`] have changed.
    pub(crate) fn borders(
        &mut self,
        camera: usize,
        pose: &Camera,
        size: [f64; 2],
        limits: LevelLimits,
    ) -> &[ShownBorder] {
        // Moving or turning a camera on the plan changes neither its borders nor their standard deviations.
        let below = WorldPoint { x: 0.0, y: 0.0, ..pose.position };
        let inputs = (Camera { position: below, yaw: 0.0, ..*pose }, size, self.height, limits);
        let known = self.in_images.iter().position(|known| known.camera == camera);
        let index = known.unwrap_or_else(|| {
            self.in_images.push(ImageBorders { camera, inputs, borders: Vec::new() });
            self.in_images.len() - 1
        });
        let known_inputs = known.map(|index| self.in_images[index].inputs);
        if known_inputs != Some(inputs) {
            let borders = pose.density_borders(size, self.height, &limits).into_iter();
            let shown = borders.map(|border| ShownBorder::new(border, pose, &limits, size[0], self.height));
            self.in_images[index] = ImageBorders { camera, inputs, borders: shown.collect() };
        }
        &self.in_images[index].borders
    }

    /// Describes the coverage at a floor point, such as "142 px/m (recognise) from shop-1, seen by 2 cameras".
    pub(crate) fn at(&self, at: [f64; 2]) -> Option<String> {
        let found = self.result.as_ref().ok()?;
        let index = found.nearest(at)?;
        let Some(best) = found.best[index] else { return Some("not visible".into()) };
        let density = found.density[index];
        let level = found.limits.reached_by(density).map_or("below all levels", DensityLevel::name);
        let camera = found.cameras.get(best).map_or("", String::as_str);
        let more = match found.seen_by[index] {
            1 => String::new(),
            count => format!(", seen by {count} cameras"),
        };
        Some(format!("{density:.0} px/m ({level}) from {camera}{more}"))
    }
}
