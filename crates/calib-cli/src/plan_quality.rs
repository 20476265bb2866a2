//! What the plan shows of how well a site is known: where each camera may stand, and how far cameras
//! put links and marks from where they are.

use calib_core::{Camera, FloorPoint, Site, position_ellipse};

use crate::agreement::{Element, elements};
use crate::style::{self, BAD_ON_LIGHT, INK};
use crate::svg::{Anchor, Stroke, Svg};

/// How many times its size an error of a link is drawn.
const ERRORS: f64 = 10.0;
/// How many standard deviations an ellipse spans.
const SIGMAS: f64 = 2.0;
/// Corners of the ellipse of the legend.
const CORNERS: usize = 48;
/// Corners of an ellipse, in plan pixels.
type Corners = Vec<[f64; 2]>;
/// A rectangle: left, top, right, bottom.
type Rectangle = [f64; 4];

/// What is drawn of the quality of a site, ready to be laid on its plan.
pub(crate) struct PlanQuality<'a> {
    elements: Vec<Element<'a>>,
    /// With the index of the camera.
    ellipses: Vec<(usize, Corners)>,
    /// How many times their size the ellipses are.
    magnified: f64,
}

impl<'a> PlanQuality<'a> {
    /// `scale` is that of the drawing, as in [`Svg::scale`].
    pub(crate) fn new(site: &'a Site, scale: f64, on_plan: &dyn Fn(FloorPoint) -> [f64; 2]) -> Self {
        let cameras = || {
            let placed = site.cameras.iter().enumerate().filter(|(_, entry)| entry.is_placed());
            placed.filter_map(|(index, entry)| Some((index, entry.camera()?)))
        };
        // The largest must show beside the dot of its camera; the others are drawn alike, to be compared.
        let least = 16.0 * scale;
        let reach = |camera: &Camera, times: f64| {
            let [x, y] = on_plan(camera.position.on_floor());
            let corners = ellipse(camera, times, on_plan).unwrap_or_default();
            corners.iter().map(|p| (p[0] - x).hypot(p[1] - y)).fold(0.0, f64::max)
        };
        let is_seen = |times: f64| cameras().any(|(_, camera)| reach(&camera, times) > least);
        let magnified =
            [1.0, 2.0, 5.0, 10.0, 20.0, 50.0].into_iter().find(|&times| is_seen(times)).unwrap_or(100.0);
        let ellipses = cameras()
            .filter_map(|(index, camera)| Some((index, ellipse(&camera, magnified, on_plan)?)))
            .collect();
        Self { elements: elements(site), ellipses, magnified }
    }

    /// Ellipses about the cameras; what lies over them hides no more than their middle.
    pub(crate) fn draw_ellipses(&self, svg: &mut Svg) {
        for (index, corners) in &self.ellipses {
            svg.fill(corners, style::camera(*index), 0.35);
            let stroke = Stroke::new(style::camera_on_light(*index), 1.25).dashed(&[4.0, 3.0]);
            svg.line(corners, true, Stroke { outlined: false, ..stroke });
        }
    }

    /// Links and marks with what every camera is off, and their names where `taken` leaves room.
    pub(crate) fn draw_elements(
        &self,
        svg: &mut Svg,
        on_plan: &dyn Fn(FloorPoint) -> [f64; 2],
        size: [f64; 2],
        taken: &mut Vec<Rectangle>,
    ) {
        for element in self.elements.iter().filter(|element| !element.is_off) {
            draw_line(svg, element, on_plan);
            for (view, seen) in element.views.iter().flat_map(|v| v.sightings.iter().map(move |s| (v, s))) {
                let Some(put) = seen.put else { continue };
                let (at, put) = (on_plan(seen.at), on_plan(put));
                if element.is_aside {
                    // A gross error needs no magnifying.
                    aside(svg, put, at);
                    taken.extend(pieces(svg, put, at));
                } else {
                    let tail = [0, 1].map(|k| at[k] + ERRORS * (put[k] - at[k]));
                    arrow(svg, tail, at, style::camera_on_light(view.index));
                    taken.extend(pieces(svg, tail, at));
                }
            }
        }
        let places: Vec<(&Element, [f64; 2])> = self
            .elements
            .iter()
            .filter(|element| !element.is_off && !element.views.is_empty())
            .map(|element| (element, on_plan(element.found.at_m.on_floor())))
            .collect();
        // Hundreds of dots must not hide what they stand on.
        let radius = if places.len() > 300 { 1.5 } else { 2.5 };
        let half = 1.5 * radius * svg.scale;
        taken.extend(places.iter().map(|(_, [x, y])| [x - half, y - half, x + half, y + half]));
        for (element, at) in places {
            let colour = if element.is_aside { BAD_ON_LIGHT } else { INK };
            svg.dot(at, radius, colour);
            if let Some(corner) = room(svg, at, &element.id, size, taken) {
                svg.ink(corner, &element.id, colour, Anchor::Start);
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
        let shown = || self.elements.iter().filter(|element| !element.is_off && !element.views.is_empty());
        if shown().any(Element::is_used) {
            rows.push((
                Sample::Arrow,
                format!(
                    "link or mark, with its error from where a camera puts it, drawn {ERRORS} times its size"
                ),
            ));
        }
        if shown().any(|element| element.is_aside) {
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
                let corners: Corners = (0..CORNERS)
                    .map(|i| {
                        let (sin, cos) = (std::f64::consts::TAU * i as f64 / CORNERS as f64).sin_cos();
                        [x + half * cos, y + 0.55 * half * sin]
                    })
                    .collect();
                svg.fill(&corners, style::camera(0), 0.35);
                let stroke = Stroke::new(style::camera_on_light(0), 1.25).dashed(&[4.0, 3.0]);
                svg.line(&corners, true, Stroke { outlined: false, ..stroke });
            }
            Self::Arrow => {
                arrow(svg, [x - half, y], [x + half, y], style::camera_on_light(0));
                svg.dot([x + half, y], 2.5, INK);
            }
            Self::Aside => {
                aside(svg, [x - half, y], [x + half, y]);
                svg.dot([x + half, y], 2.5, BAD_ON_LIGHT);
            }
        }
    }
}

/// Where a camera stands, `SIGMAS` standard deviations about it, in plan pixels; `None` where its
/// position was not estimated.
fn ellipse(camera: &Camera, times: f64, on_plan: &dyn Fn(FloorPoint) -> [f64; 2]) -> Option<Corners> {
    Some(position_ellipse(camera, times * SIGMAS)?.into_iter().map(on_plan).collect())
}

/// The piece of a line of the floor that the cameras show.
fn draw_line(svg: &mut Svg, element: &Element, on_plan: &dyn Fn(FloorPoint) -> [f64; 2]) {
    let Some(turn) = element.found.turn_deg.filter(|_| element.is_long) else { return };
    let (sin, cos) = turn.to_radians().sin_cos();
    let mut points: Vec<FloorPoint> =
        element.views.iter().flat_map(|view| view.sightings.iter().map(|seen| seen.at)).collect();
    points.sort_by(|a, b| (a.x * cos + a.y * sin).total_cmp(&(b.x * cos + b.y * sin)));
    let points: Vec<[f64; 2]> = points.into_iter().map(on_plan).collect();
    let colour = if element.is_aside { BAD_ON_LIGHT } else { INK };
    svg.line(&points, false, Stroke { outlined: false, ..Stroke::new(colour, 1.25) });
}

fn aside(svg: &mut Svg, from: [f64; 2], to: [f64; 2]) {
    let stroke = Stroke::new(BAD_ON_LIGHT, 1.25).dashed(&[4.0, 3.0]);
    svg.line(&[from, to], false, Stroke { outlined: false, ..stroke });
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

/// A line with a head at its end; a short one is the line alone.
fn arrow(svg: &mut Svg, tail: [f64; 2], tip: [f64; 2], colour: &str) {
    let (dx, dy) = (tip[0] - tail[0], tip[1] - tail[1]);
    let length = dx.hypot(dy);
    svg.line(&[tail, tip], false, Stroke { outlined: false, ..Stroke::new(colour, 1.5) });
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
