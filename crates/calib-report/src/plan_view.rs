//! Site from above: every camera with its EFOV on the floor plan.

use calib_core::{FloorPoint, PlanPixel, PlanScale};
use calib_draw::{
    Geometry, Item, Look, Meaning, PlanLayer, PlanView, Rgb, cone_corners, grid_step,
    on_plan as items_on_plan,
};
use calib_site::{Site, SiteCamera, SiteCoverage, Units};

use crate::coverage_layer;
use crate::overlay::MAX_GRID_CELLS;
use crate::plan_quality::{PlanQuality, Sample};
use crate::style;
use crate::svg::{Anchor, Stroke, Svg, TAG_LETTER};

/// Length of the longest side of the background of a site without a plan image, in pixels.
const MAX_SIDE_PX: f64 = 1600.0;
/// Colour of an empty background, as red, green and blue.
pub const BACKGROUND: [u8; 3] = [247, 248, 249];
/// Opacity of the plan image, 0 to 1. The image is faded so that the overlay is clearly visible.
pub const PLAN_OPACITY: f64 = 0.55;

/// Background of the view from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanBackground {
    /// Width and height in pixels, including the legend below the plan.
    pub size: [u32; 2],
    /// Whether the plan image is in the upper left corner; otherwise the background is empty.
    pub has_image: bool,
}

/// Draws a site from above. `picture` is the width and height of the plan image in pixels, if available.
/// Returns the background and the overlay.
#[must_use]
pub fn plan_view(site: &Site, picture: Option<[u32; 2]>) -> (PlanBackground, Svg) {
    draw(site, picture, None)
}

/// Draws the coverage of a site from above. Argument `picture` and result are as in [`plan_view`].
#[must_use]
pub fn coverage_view(
    site: &Site,
    picture: Option<[u32; 2]>,
    coverage: &SiteCoverage<'_>,
) -> (PlanBackground, Svg) {
    draw(site, picture, Some(coverage))
}

fn draw(
    site: &Site,
    picture: Option<[u32; 2]>,
    coverage: Option<&SiteCoverage<'_>>,
) -> (PlanBackground, Svg) {
    let (sides, scale) = match (&site.plan, picture) {
        (Some(plan), Some(sides)) => (sides, plan.scale()),
        (plan, _) => {
            let x_axis = plan.as_ref().map(|plan| plan.x_axis_deg.to_radians()).unwrap_or_default();
            blank_background(site, x_axis, coverage.is_some())
        }
    };
    let size = sides.map(f64::from);
    let draw_scale = style::scale(size);
    let on_plan = |point: FloorPoint| <[f64; 2]>::from(scale.plan_from_floor(point));
    let quality = PlanQuality::new(site, draw_scale, &on_plan);
    let rows = coverage.map_or_else(|| quality.legend(), |_| coverage_layer::legend(site));
    let legend = Legend::new(rows, size, draw_scale);
    let [width, height] = sides;
    let ground = PlanBackground {
        size: [width, height + legend.height.ceil() as u32],
        has_image: site.plan.is_some() && picture.is_some(),
    };
    let mut svg = Svg::new(ground.size.map(f64::from), draw_scale);
    let view = PlanView::new(site);
    // The only camera of a coverage is drawn even if it is not placed.
    let is_alone = coverage.is_some_and(|coverage| coverage.cameras.len() == 1);
    let view = if is_alone { view } else { view.placed_only() };
    if site.plan.as_ref().is_none_or(|plan| plan.image.is_none()) {
        draw_items(&mut svg, &items_on_plan(&view, &[grid(&scale, size, site.units)]), 0.0, &on_plan);
    }
    let cameras = items_on_plan(&view, &[PlanLayer::Cameras]);
    let room = camera_spacing(&cameras, &on_plan) / svg.scale;
    let figures: Vec<Figure> =
        cameras.iter().filter_map(|item| Figure::new(&svg, site, item, room, size, &on_plan)).collect();
    if let Some(coverage) = coverage {
        coverage_layer::draw_floor(&mut svg, coverage, &on_plan);
        draw_items(&mut svg, &items_on_plan(&view, &[PlanLayer::Efovs]), 0.0, &on_plan);
        coverage_layer::draw_survey(&mut svg, site, &on_plan);
    } else {
        // Overlapping EFOVs must not add up to an opaque area.
        let cover = (2.5 / site.cameras.len().max(1) as f64).clamp(0.05, 0.25);
        draw_items(&mut svg, &items_on_plan(&view, &[PlanLayer::Planes]), 0.0, &on_plan);
        draw_items(&mut svg, &items_on_plan(&view, &[PlanLayer::Efovs]), cover, &on_plan);
        draw_items(&mut svg, &quality.ellipses, 0.35, &on_plan);
        draw_items(&mut svg, &items_on_plan(&view, &[PlanLayer::Marks]), 0.0, &on_plan);
        let mut taken: Vec<[f64; 4]> =
            figures.iter().flat_map(|figure| figure.occupied_rectangles(&svg)).collect();
        taken.push([0.0, size[1] - 56.0 * svg.scale, 0.25 * size[0], size[1]]);
        quality.draw_elements(&mut svg, &on_plan, size, &mut taken);
    }
    figures.iter().for_each(|figure| figure.draw(&mut svg));
    draw_north(&mut svg, site, &scale, size);
    draw_scale_bar(&mut svg, &scale, size, site.units);
    legend.draw(&mut svg, size);
    (ground, svg)
}

/// Returns the size in pixels and the scale of the background of a site without a plan image. It contains all
/// results, and the areas if `with_areas` is set, with a margin of 1 m.
fn blank_background(site: &Site, x_axis: f64, with_areas: bool) -> ([u32; 2], PlanScale) {
    let unit = PlanScale { metres_per_px: 1.0, origin: PlanPixel::default(), x_axis };
    let solutions = || site.cameras.iter().filter_map(|camera| camera.solution.as_ref());
    let areas = site.areas.iter().filter(|_| with_areas);
    let elements = site.links.iter().filter_map(|link| link.solution.as_ref());
    let elements = elements.chain(site.marks.iter().filter_map(|mark| mark.solution.as_ref()));
    let points: Vec<PlanPixel> = solutions()
        .flat_map(|solution| solution.efov_m.iter().copied().chain(solution.position_m.map(|p| p.on_floor())))
        .chain(elements.map(|element| element.at_m.on_floor()))
        .chain(site.planes.iter().flat_map(|plane| plane.region.iter().copied()))
        .chain(areas.flat_map(|area| area.polygon_m.iter().copied()))
        .map(|point| unit.plan_from_floor(point))
        .filter(|point| point.is_finite())
        .collect();
    let range = |value: fn(&PlanPixel) -> f64| {
        let low = points.iter().map(value).fold(f64::INFINITY, f64::min);
        let high = points.iter().map(value).fold(f64::NEG_INFINITY, f64::max);
        if low <= high { (low - 1.0, high + 1.0) } else { (-5.0, 5.0) }
    };
    let ((left, right), (top, bottom)) = (range(|p| p.x), range(|p| p.y));
    let metres_per_px = (right - left).max(bottom - top) / MAX_SIDE_PX;
    let side = |length: f64| (length / metres_per_px).clamp(64.0, MAX_SIDE_PX) as u32;
    let origin = PlanPixel { x: -left / metres_per_px, y: -top / metres_per_px };
    ([side(right - left), side(bottom - top)], PlanScale { metres_per_px, origin, x_axis })
}

/// Returns the grid over the whole plan.
fn grid(scale: &PlanScale, [w, h]: [f64; 2], units: Units) -> PlanLayer {
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|p| scale.floor_from_plan(p.into()));
    PlanLayer::Grid(corners, grid_step(&corners, units, MAX_GRID_CELLS))
}

/// Draws lines with their appearance on a light plan. Fills areas with the colour of their meaning; `cover`
/// is the opacity, 0 to 1.
fn draw_items(
    svg: &mut Svg,
    items: &[Item<FloorPoint>],
    cover: f64,
    on_plan: &dyn Fn(FloorPoint) -> [f64; 2],
) {
    for item in items {
        let stroke = Stroke::of(Look::on_light(item.meaning));
        let path = |points: &[FloorPoint]| points.iter().map(|&point| on_plan(point)).collect::<Vec<_>>();
        match &item.geometry {
            Geometry::Polyline(points) => svg.line(&path(points), false, stroke),
            Geometry::Polygon(points) => {
                let points = path(points);
                svg.fill(&points, Look::of(item.meaning).colour, cover);
                svg.line(&points, true, stroke);
            }
            Geometry::Label(at, text) if matches!(item.meaning, Meaning::Plane(_)) => {
                svg.ink(on_plan(*at), text, Rgb::INK, Anchor::Middle);
            }
            _ => {}
        }
    }
}

/// Returns the median over all cameras of the distance to the nearest other camera, in pixels of the plan.
fn camera_spacing(cameras: &[Item<FloorPoint>], on_plan: &dyn Fn(FloorPoint) -> [f64; 2]) -> f64 {
    let feet: Vec<[f64; 2]> = cameras
        .iter()
        .filter_map(|item| match item.geometry {
            Geometry::Cone { foot, .. } => Some(on_plan(foot)),
            _ => None,
        })
        .collect();
    let nearest = |i: usize| {
        let [x, y] = feet[i];
        let others = feet.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, p)| (p[0] - x).hypot(p[1] - y)).fold(f64::INFINITY, f64::min)
    };
    let mut all: Vec<f64> = (0..feet.len()).map(nearest).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Camera on the plan: a tag with its name, and a cone of its horizontal field of view. The cone has the same
/// screen size at any scale of the plan.
struct Figure {
    index: usize,
    foot: [f64; 2],
    cone: Vec<[f64; 2]>,
    /// Upper left corner of the tag, in pixels.
    corner: [f64; 2],
    text: String,
}

impl Figure {
    fn new(
        svg: &Svg,
        site: &Site,
        item: &Item<FloorPoint>,
        room: f64,
        [w, h]: [f64; 2],
        on_plan: &dyn Fn(FloorPoint) -> [f64; 2],
    ) -> Option<Self> {
        // Cameras close to each other have small cones and only their id.
        let is_close = room < 90.0;
        let Item { meaning: Meaning::Camera(index), geometry: Geometry::Cone { foot, ahead, half_angle } } =
            *item
        else {
            return None;
        };
        let entry = site.cameras.get(index)?;
        let ([x, y], ahead) = (on_plan(foot), on_plan(ahead));
        let length = svg.scale * if is_close { (0.4 * room).clamp(9.0, 34.0) } else { 34.0 };
        let cone = cone_corners([x, y], ahead, half_angle, length);
        let text = Self::name(entry, is_close, site.units);
        let size = style::TEXT * svg.scale;
        let width = svg.text_width(&text) + size;
        let shift = if ahead[1] > y { -2.4 * size } else { 0.8 * size };
        let inside = |value: f64, most: f64| value.clamp(4.0, (most - 4.0).max(4.0));
        let corner = [inside(x - 0.5 * width, w - width), inside(y + shift, h - 1.6 * size)];
        Some(Self { index, foot: [x, y], cone, corner, text })
    }

    fn name(entry: &SiteCamera, is_close: bool, units: Units) -> String {
        let height = entry.solution.as_ref().and_then(|solution| solution.position_m).map(|at| at.z);
        match height.filter(|_| !is_close) {
            Some(height) => {
                let name = entry.name.as_deref().unwrap_or(&entry.id);
                format!("{name}  {}", units.length(height, 2))
            }
            None => entry.id.clone(),
        }
    }

    /// Returns the rectangles of the tag and of the cone: left, top, right and bottom in pixels.
    fn occupied_rectangles(&self, svg: &Svg) -> [[f64; 4]; 2] {
        let size = style::TEXT * svg.scale;
        let [left, top] = self.corner;
        let range = |k: usize| {
            let values = self.cone.iter().map(|point| point[k]);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        };
        let ((x0, x1), (y0, y1)) = (range(0), range(1));
        [[left, top, left + svg.text_width(&self.text) + size, top + 1.6 * size], [x0, y0, x1, y1]]
    }

    fn draw(&self, svg: &mut Svg) {
        svg.fill(&self.cone, Rgb::camera(self.index), 0.85);
        svg.line(&self.cone, true, Stroke::of(Look::on_light(Meaning::Camera(self.index))));
        svg.dot(self.foot, 4.5, Rgb::WHITE);
        svg.tag(self.corner, &self.text, Rgb::camera(self.index));
    }
}

/// Legend below the plan, so that it hides nothing.
struct Legend {
    /// Entries of the legend: position in pixels, symbol and text.
    rows: Vec<([f64; 2], Sample, String)>,
    /// Height of the legend, in pixels; 0 without entries.
    height: f64,
}

impl Legend {
    fn new(rows: Vec<(Sample, String)>, [w, h]: [f64; 2], scale: f64) -> Self {
        let (margin, tall, sample) = (24.0 * scale, 24.0 * scale, 34.0 * scale);
        let (mut x, mut y, mut placed) = (margin, h + 0.75 * tall, Vec::new());
        for (kind, text) in rows {
            let wide = sample + style::TEXT * scale * TAG_LETTER * text.chars().count() as f64;
            if x > margin && x + wide > w - margin {
                (x, y) = (margin, y + tall);
            }
            placed.push(([x, y], kind, text));
            x += wide + margin;
        }
        let height = if placed.is_empty() { 0.0 } else { y + 0.75 * tall - h };
        Self { rows: placed, height }
    }

    fn draw(self, svg: &mut Svg, [w, h]: [f64; 2]) {
        if self.height > 0.0 {
            svg.line(&[[0.0, h], [w, h]], false, Stroke::new(Rgb::INK, 1.0).faint(0.25));
        }
        for ([x, y], sample, text) in self.rows {
            sample.draw(svg, [x + 12.0 * svg.scale, y]);
            svg.ink(
                [x + 34.0 * svg.scale, y + 0.35 * style::TEXT * svg.scale],
                &text,
                Rgb::INK,
                Anchor::Start,
            );
        }
    }
}

/// Draws an arrow to the north if the site is georeferenced, otherwise an arrow along world +y.
fn draw_north(svg: &mut Svg, site: &Site, scale: &PlanScale, [w, _]: [f64; 2]) {
    let (turn, name) = match site.georeference() {
        // Angle of north, counter-clockwise from +x, which equals the azimuth of +x.
        Some(georeference) => (georeference.x_axis_azimuth_deg.to_radians(), "N"),
        None => (std::f64::consts::FRAC_PI_2, "y"),
    };
    let angle = turn + scale.x_axis;
    let reach = 26.0 * svg.scale;
    let centre = [w - 44.0 * svg.scale, 48.0 * svg.scale];
    let at = |along: f64, across: f64| {
        let (sin, cos) = angle.sin_cos();
        [centre[0] + reach * (along * cos - across * sin), centre[1] - reach * (along * sin + across * cos)]
    };
    svg.fill(&[at(1.0, 0.0), at(-0.7, 0.5), at(-0.35, 0.0), at(-0.7, -0.5)], Rgb::INK, 0.9);
    let [x, y] = at(1.5, 0.0);
    svg.ink([x, y + 0.35 * style::TEXT * svg.scale], name, Rgb::INK, Anchor::Middle);
}

/// Draws a scale bar of a round length in these units, with its label.
fn draw_scale_bar(svg: &mut Svg, scale: &PlanScale, [w, h]: [f64; 2], units: Units) {
    let length = units.round_length_below(0.22 * w * scale.metres_per_px);
    let (x, y, tick) = (24.0 * svg.scale, h - 24.0 * svg.scale, 6.0 * svg.scale);
    let end = x + length / scale.metres_per_px;
    let bar = [[x, y - tick], [x, y], [end, y], [end, y - tick]];
    svg.line(&bar, false, Stroke { outlined: false, ..Stroke::new(Rgb::WHITE, 5.0) });
    svg.line(&bar, false, Stroke { outlined: false, ..Stroke::new(Rgb::INK, 2.0) });
    let at = [0.5 * (x + end), y - 8.0 * svg.scale];
    svg.ink(at, &units.trimmed_length(length), Rgb::INK, Anchor::Middle);
}
