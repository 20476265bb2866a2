//! Measured coverage on the floor plan: the visible floor coloured by its pixel density, a legend with the area
//! of each level, and the density under the pointer.

use calib_core::floor::{DensityLevel, FloorGrid};
use calib_core::{Camera, FloorPoint};
use calib_editor::Session;
use calib_report::{level_colour, level_text, levels};
use calib_site::{CoverageOptions, LevelRectangle, Site, SiteCamera};
use egui::{Align2, Color32, ComboBox, Frame, Mesh, Painter, Pos2, Rect, RichText, Shape, Stroke, Ui, Vec2};

use crate::canvas::Mapping;
use crate::paint::{Pen, line, tag};
use crate::state::App;
use crate::theme::{self, colour, on_image};

/// Height of a target above the floor, with its name.
type Target = (&'static str, f64);

/// Targets to choose from, with usual heights in metres.
const TARGETS: [Target; 3] = [("the floor", 0.0), ("number plates", 0.6), ("faces", 1.6)];

/// Opacity of the colours over the plan.
const OPACITY: f32 = 0.66;

/// Coverage that is shown, kept until its inputs change.
#[derive(Debug)]
pub struct ShownCoverage {
    /// Height of the targets above the floor, in metres.
    pub(crate) height: f64,
    inputs: Option<Inputs>,
    result: Result<Computed, String>,
}

impl Default for ShownCoverage {
    fn default() -> Self {
        Self { height: 0.0, inputs: None, result: Ok(Computed::default()) }
    }
}

/// Everything that determines a coverage.
#[derive(Clone, Debug, PartialEq)]
struct Inputs {
    /// Pose and EFOV of every camera.
    cameras: Vec<(Camera, Vec<FloorPoint>)>,
    /// Generation of the site, which contains its walls, areas and ids.
    generation: u64,
    height: f64,
}

/// Coverage of a site, without references to it.
#[derive(Debug)]
struct Computed {
    rectangles: Vec<LevelRectangle>,
    grid: FloorGrid,
    density: Vec<f64>,
    best: Vec<Option<usize>>,
    seen_by: Vec<usize>,
    /// Ids of the cameras of `best`.
    cameras: Vec<String>,
    /// Visible floor of each level, in square metres.
    areas: Vec<(Option<DensityLevel>, f64)>,
    /// Ids of cameras that are left out, because they have no position relative to the others.
    left_out: Vec<String>,
    /// Ids of cameras whose scale is assumed.
    assumed: Vec<String>,
    /// Areas of interest, and whether each reaches its level.
    results: Vec<(String, bool)>,
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
            areas: Vec::new(),
            left_out: Vec::new(),
            assumed: Vec::new(),
            results: Vec::new(),
        }
    }
}

impl Inputs {
    fn new(session: &Session, height: f64) -> Self {
        let camera = |index: usize| {
            let (pose, solution) = (session.solved.pose(index)?, session.solved.solution(index)?);
            (!session.site.is_superseded(index)).then(|| (*pose, solution.efov_m.clone()))
        };
        Self {
            cameras: (0..session.site.cameras.len()).filter_map(camera).collect(),
            generation: session.revision.generation,
            height,
        }
    }
}

impl Inputs {
    /// Returns the distance of the grid points, in metres: the layer follows a dragged camera without delay.
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
        let options =
            CoverageOptions { height: inputs.height, step: inputs.step(), ..CoverageOptions::default() };
        let found = site.coverage(&options).map_err(|error| error.to_string())?;
        let ids = |cameras: &[&SiteCamera]| cameras.iter().map(|camera| camera.id.clone()).collect();
        let reached = |at: usize| DensityLevel::reached_by(found.coverage.density[at]);
        let areas = levels().map(|level| (level, found.visible_area(|at| reached(at) == level))).collect();
        let results = found.areas.iter().map(|result| {
            (result.area.name.clone().unwrap_or_else(|| result.area.id.clone()), result.is_met())
        });
        Ok(Self {
            rectangles: found.rectangles(),
            areas,
            results: results.collect(),
            left_out: ids(&found.left_out),
            assumed: ids(&found.scale_assumed),
            cameras: ids(&found.cameras),
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

impl ShownCoverage {
    /// Computes the coverage again if its inputs have changed.
    fn update(&mut self, session: &Session) {
        let inputs = Inputs::new(session, self.height);
        if self.inputs.as_ref() != Some(&inputs) {
            self.result = Computed::new(session, &inputs);
            self.inputs = Some(inputs);
        }
    }

    /// Describes the coverage at a floor point, such as "142 px/m (recognise) by shop-1, seen by 2".
    pub(crate) fn at(&self, at: [f64; 2]) -> Option<String> {
        let found = self.result.as_ref().ok()?;
        let index = found.nearest(at)?;
        let Some(best) = found.best[index] else { return Some("not visible".into()) };
        let density = found.density[index];
        let level = DensityLevel::reached_by(density).map_or("below all levels", DensityLevel::name);
        let camera = found.cameras.get(best).map_or("", String::as_str);
        let more = match found.seen_by[index] {
            1 => String::new(),
            count => format!(", seen by {count}"),
        };
        Some(format!("{density:.0} px/m ({level}) by {camera}{more}"))
    }
}

/// Computes the coverage of the open site again if its inputs have changed.
pub(crate) fn update_coverage(app: &mut App) {
    let mut shown = std::mem::take(&mut app.coverage);
    shown.update(app.editor.session());
    app.coverage = shown;
}

impl ShownCoverage {
    /// Paints the levels, the walls and the areas of interest.
    pub(crate) fn paint(&self, site: &Site, painter: &Painter, mapping: &Mapping) {
        let Ok(found) = &self.result else { return };
        let mut mesh = Mesh::default();
        for rectangle in &found.rectangles {
            let base = mesh.vertices.len() as u32;
            let fill = colour(level_colour(rectangle.level)).gamma_multiply(OPACITY);
            for corner in rectangle.corners() {
                mesh.colored_vertex(mapping.screen(corner.into()), fill);
            }
            mesh.add_triangle(base, base + 1, base + 2);
            mesh.add_triangle(base, base + 2, base + 3);
        }
        painter.add(Shape::mesh(mesh));
        paint_survey(site, found, painter, mapping);
    }
}

/// Paints walls, and the outlines and results of the areas of interest.
fn paint_survey(site: &Site, found: &Computed, painter: &Painter, mapping: &Mapping) {
    for wall in &site.walls {
        let ends = [wall.from_m, wall.to_m].map(|end| mapping.screen(end.into()));
        line(painter, &ends, Pen::new(Color32::BLACK, 4.0));
    }
    for (area, (name, is_met)) in site.areas.iter().zip(&found.results) {
        let corners: Vec<Pos2> = area
            .polygon_m
            .iter()
            .chain(area.polygon_m.first())
            .map(|&corner| mapping.screen(corner.into()))
            .collect();
        let pen = if *is_met { on_image::WHITE } else { on_image::BAD };
        line(painter, &corners, Pen::new(pen, 2.0));
        let count = area.polygon_m.len().max(1) as f32;
        let middle = corners.iter().take(area.polygon_m.len()).fold(Vec2::ZERO, |sum, at| sum + at.to_vec2());
        let decision = if *is_met { "met" } else { "missed" };
        let text = format!("{name}: {decision}");
        tag(painter, (middle / count).to_pos2(), Align2::CENTER_CENTER, &text, on_image::WHITE);
    }
}

/// Shows the legend in a corner of the plan, with the height of the targets to choose. Returns its rectangle;
/// `None` if the plan is too small.
pub(crate) fn legend_ui(app: &mut App, ui: &mut Ui, rect: Rect) -> Option<Rect> {
    /// Smallest plan with a legend, and the width of the legend.
    const MIN_SIZE: Vec2 = Vec2::new(320.0, 300.0);
    const WIDTH: f32 = 214.0;
    if rect.width() < MIN_SIZE.x || rect.height() < MIN_SIZE.y {
        return None;
    }
    let palette = theme::palette(ui.ctx());
    let corner = rect.left_top() + Vec2::new(12.0, 12.0);
    let place = Rect::from_min_size(corner, Vec2::new(WIDTH, rect.height() - 24.0));
    let shown = ui.scope_builder(egui::UiBuilder::new().max_rect(place), |ui| {
        let frame = Frame::new().fill(palette.panel).corner_radius(4.0).inner_margin(8.0);
        frame.show(ui, |ui| {
            ui.set_width(WIDTH - 16.0);
            ui.spacing_mut().item_spacing.y = 3.0;
            target_ui(app, ui);
            let units = app.editor.session().site.units;
            let found = match &app.coverage.result {
                Ok(found) => found,
                Err(why) => {
                    ui.label(RichText::new(format!("No coverage: {why}.")).small().color(palette.warn));
                    return;
                }
            };
            for (level, area) in &found.areas {
                ui.horizontal(|ui| {
                    let (sample, _) = ui.allocate_exact_size(Vec2::splat(10.0), egui::Sense::hover());
                    let stroke = Stroke::new(0.5, palette.text3);
                    let fill = colour(level_colour(*level));
                    ui.painter().rect(sample, 1.0, fill, stroke, egui::StrokeKind::Inside);
                    ui.label(RichText::new(level_text(*level)).small());
                    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                        let size = area / units.metres().powi(2);
                        let text = format!("{size:.0} {}\u{b2}", units.symbol());
                        ui.label(RichText::new(text).small().color(palette.text2));
                    });
                });
            }
            for (ids, why) in
                [(&found.left_out, "not included, because not placed"), (&found.assumed, "assumed scale")]
            {
                if !ids.is_empty() {
                    let text = format!("{}: {why}", ids.join(", "));
                    ui.label(RichText::new(text).small().color(palette.warn));
                }
            }
        });
    });
    Some(shown.response.rect)
}

/// Shows the choice of the targets.
fn target_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let units = app.editor.session().site.units;
    let now = app.coverage.height;
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Pixel density for").small().color(palette.text2));
        let named = |(name, _): &Target| (*name).to_owned();
        let chosen = TARGETS.iter().find(|(_, height)| *height == now).map_or_else(String::new, named);
        ComboBox::from_id_salt("coverage targets")
            .selected_text(RichText::new(chosen).small())
            .width(90.0)
            .show_ui(ui, |ui| {
                for (name, height) in TARGETS {
                    let text = format!("{name}, {}", units.length(height, 1));
                    ui.selectable_value(&mut app.coverage.height, height, text);
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text("Height of the targets above the floor. The levels follow EN 62676-4");
    });
}
