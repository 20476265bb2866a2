//! What the plan shows of how well a site is known: where each camera may stand, and how far cameras
//! put links and marks from where they are.

use calib_core::FloorPoint;

use calib_draw::{Geometry, Item, Look, Meaning, PlanLayer, PlanView, Rgb, Scene as _, Sighted, on_plan};
use calib_site::Site;

use crate::style;
use crate::svg::{Anchor, Stroke, Svg};

/// How many times its size an error of a link is drawn.
const ERRORS: f64 = 10.0;
/// How many standard deviations an ellipse spans.
const SIGMAS: f64 = 2.0;
/// Corners of the ellipse of the legend.
const CORNERS: usize = 48;
/// From the floor to the pixels of the plan.
type OnPlan<'a> = &'a dyn Fn(FloorPoint) -> [f64; 2];
/// A rectangle: left, top, right, bottom.
type Rectangle = [f64; 4];

/// What is drawn of the quality of a site, ready to be laid on its plan.
pub(crate) struct PlanQuality {
    sightings: Vec<Item<FloorPoint>>,
    pub(crate) ellipses: Vec<Item<FloorPoint>>,
    /// How many times their size the ellipses are.
    magnified: f64,
}

impl PlanQuality {
    /// `scale` is that of the drawing, as in [`Svg::scale`].
    pub(crate) fn new(site: &Site, scale: f64, to_plan: OnPlan<'_>) -> Self {
        let view = PlanView::new(site).of_placed();
        let ellipses = |times: f64| on_plan(&view, &[PlanLayer::PositionEllipses(times * SIGMAS)]);
        // The largest must show beside the dot of its camera; the others are drawn alike, to be compared.
        let least = 16.0 * scale;
        let is_seen = |times: &f64| ellipses(*times).iter().any(|item| reach(site, item, to_plan) > least);
        let magnified = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0].into_iter().find(is_seen).unwrap_or(100.0);
        let sightings = on_plan(&view, &[PlanLayer::Sightings]);
        Self { sightings, ellipses: ellipses(magnified), magnified }
    }

    /// Links and marks with what every camera is off, and their names where `taken` leaves room.
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
        // Hundreds of dots must not hide what they stand on.
        let radius = if places.len() > 300 { 1.5 } else { 2.5 };
        let half = 1.5 * radius * svg.scale;
        taken.extend(places.iter().map(|(.., [x, y])| [x - half, y - half, x + half, y + half]));
        for (id, colour, at) in places {
            svg.dot(at, radius, colour);
            if let Some(corner) = room(svg, at, id, size, taken) {
                svg.ink(corner, id, colour, Anchor::Start);
            }
        }
    }

    /// What the legend says: one entry for everything drawn.
    pub(crate) fn legend(&self) -> Vec<(Sample, String)> {
        let mut rows = Vec::new();
        if !self.ellipses.is_empty() {
            let times = match self.magnified {
                1.0 => String::new(),
                times => format!(", drawn {times} times its size"),
            };
            rows.push((Sample::Ellipse, format!("where a camera stands, {SIGMAS} sigma{times}")));
        }
        let is_shown = |is_aside: bool| {
            let is_of = |meaning| matches!(meaning, Meaning::Solved(of) if of.is_aside == is_aside);
            let points = self.sightings.iter().filter(|item| matches!(item.geometry, Geometry::Point(_)));
            points.into_iter().any(|item| is_of(item.meaning))
        };
        if is_shown(false) {
            rows.push((
                Sample::Arrow,
                format!(
                    "link or mark, with its error from where a camera puts it, drawn {ERRORS} times its size"
                ),
            ));
        }
        if is_shown(true) {
            rows.push((Sample::Aside, "set aside, in its true size".into()));
        }
        rows
    }
}

/// What an entry of the legend shows beside its text.
#[derive(Clone, Copy)]
pub(crate) enum Sample {
    Ellipse,
    Arrow,
    Aside,
}

impl Sample {
    /// Draws the sample about a point.
    pub(crate) fn draw(self, svg: &mut Svg, [x, y]: [f64; 2]) {
        let half = 11.0 * svg.scale;
        match self {
            Self::Ellipse => {
                let corners: Vec<[f64; 2]> = (0..CORNERS)
                    .map(|i| {
                        let (sin, cos) = (std::f64::consts::TAU * i as f64 / CORNERS as f64).sin_cos();
                        [x + half * cos, y + 0.55 * half * sin]
                    })
                    .collect();
                let meaning = Meaning::PositionEllipse(0);
                svg.fill(&corners, Look::of(meaning).colour, 0.35);
                svg.line(&corners, true, Stroke::of(Look::on_light(meaning)));
            }
            Self::Arrow | Self::Aside => {
                let of = |camera| Sighted { camera, is_aside: matches!(self, Self::Aside), is_off: false };
                let ends = [[x - half, y], [x + half, y]];
                draw_error(svg, Meaning::Seen(of(Some(0))), ends);
                svg.dot(ends[1], 2.5, Look::on_light(Meaning::Solved(of(None))).colour);
            }
        }
    }
}

/// How far from its camera an ellipse reaches, in plan pixels.
fn reach(site: &Site, item: &Item<FloorPoint>, to_plan: OnPlan<'_>) -> f64 {
    let (Meaning::PositionEllipse(camera), Geometry::Polygon(corners)) = (item.meaning, &item.geometry)
    else {
        return 0.0;
    };
    let Some(pose) = site.pose(camera) else { return 0.0 };
    let [x, y] = to_plan(pose.position.on_floor());
    let corners = corners.iter().map(|&corner| to_plan(corner));
    corners.map(|p| (p[0] - x).hypot(p[1] - y)).fold(0.0, f64::max)
}

/// Draws the line that a link is, or how far a camera is off; gives the rectangles that an error takes.
fn draw_sighting(svg: &mut Svg, meaning: Meaning, points: &[[f64; 2]]) -> Vec<Rectangle> {
    match (meaning, points) {
        (Meaning::Seen(of), &[put, at]) => {
            // A gross error needs no magnifying.
            let times = if of.is_aside { 1.0 } else { ERRORS };
            let tail = [0, 1].map(|k| at[k] + times * (put[k] - at[k]));
            draw_error(svg, meaning, [tail, at]);
            pieces(svg, tail, at)
        }
        _ => {
            svg.line(points, false, Stroke::of(Look::on_light(meaning)));
            Vec::new()
        }
    }
}

/// An arrow to where a thing is; what was set aside is no more than a line.
fn draw_error(svg: &mut Svg, meaning: Meaning, [tail, tip]: [[f64; 2]; 2]) {
    let stroke = Stroke::of(Look::on_light(meaning));
    svg.line(&[tail, tip], false, stroke);
    if !matches!(meaning, Meaning::Seen(of) if of.is_aside) {
        arrow_head(svg, tail, tip, stroke.colour);
    }
}

/// The rectangles that a line takes, piece by piece.
fn pieces(svg: &Svg, from: [f64; 2], to: [f64; 2]) -> Vec<Rectangle> {
    /// A line longer than this runs off the plan.
    const MOST: f64 = 100.0;
    let step = 6.0 * svg.scale;
    let count = ((to[0] - from[0]).hypot(to[1] - from[1]) / step).min(MOST) as usize;
    let half = 0.5 * step;
    (1..=count)
        .map(|i| {
            let t = i as f64 / count as f64;
            let [x, y] = [0, 1].map(|k| to[k] + t * (from[k] - to[k]));
            [x - half, y - half, x + half, y + half]
        })
        .collect()
}

/// The head at the end of a line; a short line has none.
fn arrow_head(svg: &mut Svg, tail: [f64; 2], tip: [f64; 2], colour: Rgb) {
    let (dx, dy) = (tip[0] - tail[0], tip[1] - tail[1]);
    let length = dx.hypot(dy);
    let head = 6.0 * svg.scale;
    // The dot of the element covers the tip: the head stands before it.
    let before = 3.5 * svg.scale;
    if length < head + before {
        return;
    }
    let (x, y) = (dx / length, dy / length);
    let at = |back: f64, aside: f64| [tip[0] - back * x - aside * y, tip[1] - back * y + aside * x];
    svg.fill(&[at(before, 0.0), at(before + head, 0.4 * head), at(before + head, -0.4 * head)], colour, 1.0);
}

/// Where a text beside a point covers nothing that is there, if there is such a place; it is taken then.
fn room(
    svg: &Svg,
    [x, y]: [f64; 2],
    text: &str,
    [w, h]: [f64; 2],
    taken: &mut Vec<Rectangle>,
) -> Option<[f64; 2]> {
    let (tall, wide) = (style::TEXT * svg.scale, svg.text_width(text));
    // Near the point, or a little farther where arrows stand about it.
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
