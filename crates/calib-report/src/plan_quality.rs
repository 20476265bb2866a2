//! Uncertainties on the plan: position ellipses of cameras, and errors of links and marks in each camera.

use calib_core::FloorPoint;

use calib_draw::{
    ElementStatus, Geometry, Item, Look, Meaning, PlanLayer, PlanView, Rgb, Scene as _, on_plan,
};
use calib_site::Site;

use crate::style;
use crate::svg::{Anchor, Stroke, Svg};

/// Magnification of the errors of links and marks on the plan. Rejected observations are not magnified.
const ERROR_MAGNIFICATION: f64 = 10.0;
/// Semi-axis of a position ellipse before its magnification, in standard deviations.
const ELLIPSE_SIGMAS: f64 = 2.0;
/// Number of corners of the ellipse in the legend.
const ELLIPSE_CORNERS: usize = 48;
/// Map from floor metres to pixels of the plan.
type OnPlan<'a> = &'a dyn Fn(FloorPoint) -> [f64; 2];
/// Rectangle as left, top, right and bottom, in pixels of the plan.
type Rectangle = [f64; 4];

/// Uncertainties of a site, ready to draw on its plan.
pub(crate) struct PlanQuality {
    /// Solved links and marks with their errors in each camera.
    sightings: Vec<Item<FloorPoint>>,
    /// Magnified position ellipses of the cameras.
    pub(crate) ellipses: Vec<Item<FloorPoint>>,
    /// Magnification of the position ellipses; 1 if they are drawn at the scale of the plan.
    magnified: f64,
}

impl PlanQuality {
    /// Computes the uncertainties; `scale` is the scale of the drawing, as in [`Svg::scale`].
    pub(crate) fn new(site: &Site, scale: f64, to_plan: OnPlan<'_>) -> Self {
        let view = PlanView::new(site).placed_only();
        let ellipses = |times: f64| on_plan(&view, &[PlanLayer::PositionEllipses(times * ELLIPSE_SIGMAS)]);
        // The largest ellipse must be visible around the dot of its camera. All ellipses have the same
        // magnification, so that they can be compared.
        let least = 16.0 * scale;
        let is_seen =
            |times: &f64| ellipses(*times).iter().any(|item| ellipse_extent_px(site, item, to_plan) > least);
        let magnified = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0].into_iter().find(is_seen).unwrap_or(100.0);
        let sightings = on_plan(&view, &[PlanLayer::Observations]);
        Self { sightings, ellipses: ellipses(magnified), magnified }
    }

    /// Draws links and marks with their errors in every camera, and their names if there is space. `taken`
    /// contains the occupied rectangles; new ones are added.
    pub(crate) fn draw_elements(
        &self,
        svg: &mut Svg,
        to_plan: OnPlan<'_>,
        size: [f64; 2],
        taken: &mut Vec<Rectangle>,
    ) {
        for item in &self.sightings {
            if let Geometry::Polyline(points) = &item.geometry {
                let points: Vec<[f64; 2]> = points.iter().map(|&point| to_plan(point)).collect();
                taken.extend(draw_sighting(svg, item.meaning, &points));
            }
        }
        let places: Vec<(&str, Rgb, [f64; 2])> = self
            .sightings
            .iter()
            .filter_map(|item| match &item.geometry {
                Geometry::Label(at, id) => {
                    Some((id.as_str(), Look::on_light(item.meaning).colour, to_plan(*at)))
                }
                _ => None,
            })
            .collect();
        // Hundreds of large dots would hide the plan.
        let radius = if places.len() > 300 { 1.5 } else { 2.5 };
        let half = 1.5 * radius * svg.scale;
        taken.extend(places.iter().map(|(.., [x, y])| [x - half, y - half, x + half, y + half]));
        for (id, colour, at) in places {
            svg.dot(at, radius, colour);
            if let Some(corner) = free_position(svg, at, id, size, taken) {
                svg.ink(corner, id, colour, Anchor::Start);
            }
        }
    }

    /// Returns the entries of the legend: symbol and text of every kind of symbol in use.
    pub(crate) fn legend(&self) -> Vec<(Sample, String)> {
        let mut rows = Vec::new();
        if !self.ellipses.is_empty() {
            let times = match self.magnified {
                1.0 => String::new(),
                times => format!(", magnified {times} times"),
            };
            rows.push((
                Sample::Ellipse,
                format!("uncertainty of a camera position, {ELLIPSE_SIGMAS} standard deviations{times}"),
            ));
        }
        let is_shown = |is_aside: bool| {
            let is_of = |meaning| matches!(meaning, Meaning::Solved(of) if of.is_rejected == is_aside);
            let points = self.sightings.iter().filter(|item| matches!(item.geometry, Geometry::Point(_)));
            points.into_iter().any(|item| is_of(item.meaning))
        };
        if is_shown(false) {
            rows.push((
                Sample::Arrow,
                format!("link or mark, with its error in each camera, magnified {ERROR_MAGNIFICATION} times"),
            ));
        }
        if is_shown(true) {
            rows.push((Sample::Rejected, "rejected, not magnified".into()));
        }
        rows
    }
}

/// Symbol of a legend entry.
#[derive(Clone, Copy)]
pub(crate) enum Sample {
    Ellipse,
    Arrow,
    Rejected,
    /// Filled square with this colour and opacity.
    Fill(Rgb, f64),
    /// Line with this stroke.
    Line(Stroke<'static>),
}

impl Sample {
    /// Draws the symbol; the point is its centre, in pixels.
    pub(crate) fn draw(self, svg: &mut Svg, [x, y]: [f64; 2]) {
        let half = 11.0 * svg.scale;
        match self {
            Self::Ellipse => {
                let corners: Vec<[f64; 2]> = (0..ELLIPSE_CORNERS)
                    .map(|i| {
                        let (sin, cos) =
                            (std::f64::consts::TAU * i as f64 / ELLIPSE_CORNERS as f64).sin_cos();
                        [x + half * cos, y + 0.55 * half * sin]
                    })
                    .collect();
                let meaning = Meaning::PositionEllipse(0);
                svg.fill(&corners, Look::of(meaning).colour, 0.35);
                svg.line(&corners, true, Stroke::of(Look::on_light(meaning)));
            }
            Self::Arrow | Self::Rejected => {
                let of = |camera| ElementStatus {
                    camera,
                    is_rejected: matches!(self, Self::Rejected),
                    is_off: false,
                };
                let ends = [[x - half, y], [x + half, y]];
                draw_error(svg, Meaning::Observed(of(Some(0))), ends);
                svg.dot(ends[1], 2.5, Look::on_light(Meaning::Solved(of(None))).colour);
            }
            Self::Fill(colour, opacity) => {
                let corners = [[-1.0, -0.55], [1.0, -0.55], [1.0, 0.55], [-1.0, 0.55]];
                svg.fill(&corners.map(|[right, down]| [x + half * right, y + half * down]), colour, opacity);
            }
            Self::Line(stroke) => svg.line(&[[x - half, y], [x + half, y]], false, stroke),
        }
    }
}

/// Returns the largest distance of a position ellipse from its camera, in pixels of the plan.
fn ellipse_extent_px(site: &Site, item: &Item<FloorPoint>, to_plan: OnPlan<'_>) -> f64 {
    let (Meaning::PositionEllipse(camera), Geometry::Polygon(corners)) = (item.meaning, &item.geometry)
    else {
        return 0.0;
    };
    let Some(pose) = site.pose(camera) else { return 0.0 };
    let [x, y] = to_plan(pose.position.on_floor());
    let corners = corners.iter().map(|&corner| to_plan(corner));
    corners.map(|p| (p[0] - x).hypot(p[1] - y)).fold(0.0, f64::max)
}

/// Draws the line of a link, or the error of a link or mark in one camera. Returns the rectangles that the
/// error covers.
fn draw_sighting(svg: &mut Svg, meaning: Meaning, points: &[[f64; 2]]) -> Vec<Rectangle> {
    match (meaning, points) {
        (Meaning::Observed(of), &[observed, at]) => {
            // A rejected observation is large enough without magnification.
            let times = if of.is_rejected { 1.0 } else { ERROR_MAGNIFICATION };
            let tail = [0, 1].map(|k| at[k] + times * (observed[k] - at[k]));
            draw_error(svg, meaning, [tail, at]);
            covered_rectangles(svg, tail, at)
        }
        _ => {
            svg.line(points, false, Stroke::of(Look::on_light(meaning)));
            Vec::new()
        }
    }
}

/// Draws an error as an arrow to the solved position. Rejected observations have no arrow head.
fn draw_error(svg: &mut Svg, meaning: Meaning, [tail, tip]: [[f64; 2]; 2]) {
    let stroke = Stroke::of(Look::on_light(meaning));
    svg.line(&[tail, tip], false, stroke);
    if !matches!(meaning, Meaning::Observed(of) if of.is_rejected) {
        draw_arrow_head(svg, tail, tip, stroke.colour);
    }
}

/// Returns small rectangles that together cover a line, for the placement of labels.
fn covered_rectangles(svg: &Svg, from: [f64; 2], to: [f64; 2]) -> Vec<Rectangle> {
    /// Largest number of rectangles; a line that needs more extends beyond the plan.
    const MAX_PIECES: f64 = 100.0;
    let step = 6.0 * svg.scale;
    let count = ((to[0] - from[0]).hypot(to[1] - from[1]) / step).min(MAX_PIECES) as usize;
    let half = 0.5 * step;
    (1..=count)
        .map(|i| {
            let t = i as f64 / count as f64;
            let [x, y] = [0, 1].map(|k| to[k] + t * (from[k] - to[k]));
            [x - half, y - half, x + half, y + half]
        })
        .collect()
}

/// Draws the head of an arrow; short arrows have none.
fn draw_arrow_head(svg: &mut Svg, tail: [f64; 2], tip: [f64; 2], colour: Rgb) {
    let (dx, dy) = (tip[0] - tail[0], tip[1] - tail[1]);
    let length = dx.hypot(dy);
    let head = 6.0 * svg.scale;
    // The head ends before the dot that covers the tip of the arrow.
    let before = 3.5 * svg.scale;
    if length < head + before {
        return;
    }
    let (x, y) = (dx / length, dy / length);
    let at = |back: f64, aside: f64| [tip[0] - back * x - aside * y, tip[1] - back * y + aside * x];
    svg.fill(&[at(before, 0.0), at(before + head, 0.4 * head), at(before + head, -0.4 * head)], colour, 1.0);
}

/// Finds a free position for a label near a point and reserves its rectangle in `taken`. Returns the left end
/// of the baseline; `None` if there is no space.
fn free_position(
    svg: &Svg,
    [x, y]: [f64; 2],
    text: &str,
    [w, h]: [f64; 2],
    taken: &mut Vec<Rectangle>,
) -> Option<[f64; 2]> {
    let (tall, wide) = (style::TEXT * svg.scale, svg.text_width(text));
    // Positions close to the point are tried first, then positions farther away that avoid arrows around the
    // point.
    let corners = [5.0, 16.0].into_iter().flat_map(|gap| {
        let gap = gap * svg.scale;
        [
            [x + gap, y + 0.35 * tall],
            [x - gap - wide, y + 0.35 * tall],
            [x - 0.5 * wide, y - gap],
            [x - 0.5 * wide, y + gap + 0.8 * tall],
        ]
    });
    for [left, base] in corners {
        let own = [left, base - 0.8 * tall, left + wide, base + 0.2 * tall];
        let inside = own[0] > 0.0 && own[1] > 0.0 && own[2] < w && own[3] < h;
        let free = |other: &Rectangle| {
            own[2] < other[0] || other[2] < own[0] || own[3] < other[1] || other[3] < own[1]
        };
        if inside && taken.iter().all(free) {
            taken.push(own);
            return Some([left, base]);
        }
    }
    None
}
