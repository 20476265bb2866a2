//! Simulated operator who annotates the images of the site.
//!
//! The operator finds visible edges, selects long lines that are far apart, and annotates them with a small
//! random error (the tremor).

use calib_core::single::Known;
use calib_core::{Annotation, Camera, Distortion, Kind, Pixel, WorldPoint};
use rand_chacha::ChaCha8Rng;

use crate::building::TILE;
use crate::edge::{Axis, Edge, barn_floor, exact, shop_floor, store_floor, straight, verticals};
use crate::figure::PEOPLE;
use crate::random::normal;
use crate::world::{is_shown, visible};

/// Usual standard deviation of the tremor: the random error of an annotated coordinate, in pixels.
pub(crate) const TREMOR: f64 = 0.7;
/// Minimum distance of annotated points from the image border, in pixels.
const MARGIN: f64 = 14.0;
/// Length of the last part of a line of sight in which occlusion is ignored, in metres. The point itself may
/// be on a corner.
const SLACK: f64 = 0.02;

/// Operator who annotates the image of one camera.
#[derive(Debug)]
pub(crate) struct Operator {
    pub(crate) camera: Camera,
    pub(crate) size: [u32; 2],
    /// Standard deviation of the tremor, in pixels.
    pub(crate) tremor: f64,
    pub(crate) random: ChaCha8Rng,
}

/// Visible part of an edge in an image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    /// Visible part of the edge, in world coordinates.
    pub(crate) edge: Edge,
    /// Exact pixels of both ends, without tremor.
    pub(crate) ends: [Pixel; 2],
}

impl Run {
    /// Returns the distance between the ends in the image, in pixels.
    pub(crate) fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }

    pub(crate) fn middle(&self) -> Pixel {
        let [a, b] = self.ends;
        Pixel { u: 0.5 * (a.u + b.u), v: 0.5 * (a.v + b.v) }
    }
}

impl Operator {
    /// Whether a point of an edge is visible in the image.
    pub(crate) fn sees(&self, point: WorldPoint) -> bool {
        self.pixel(point).is_some_and(|pixel| is_shown(&self.camera, self.size, pixel, MARGIN))
            && visible(&self.camera, self.size, point, SLACK)
    }

    /// Returns the exact pixel of a world point, without tremor.
    pub(crate) fn pixel(&self, point: WorldPoint) -> Option<Pixel> {
        self.camera.world_to_pixel(point)
    }

    /// Returns the annotated pixel of a world point: its exact pixel plus the tremor.
    pub(crate) fn annotate_point(&mut self, point: WorldPoint) -> Option<Pixel> {
        let Pixel { u, v } = self.pixel(point)?;
        let mut shaken = |value: f64| {
            // Coordinates are rounded to a hundredth of a pixel.
            ((value + self.tremor * normal(&mut self.random)) * 100.0).round() / 100.0
        };
        Some(Pixel { u: shaken(u), v: shaken(v) })
    }

    /// Returns the longest uninterrupted visible part of an edge.
    pub(crate) fn run(&self, edge: &Edge) -> Option<Run> {
        /// Number of intervals of the edge at whose ends the visibility is computed.
        const STEPS: usize = 160;
        let seen: Vec<bool> = (0..=STEPS).map(|i| self.sees(edge.at(i as f64 / STEPS as f64))).collect();
        let (mut best, mut start) = ((0, 0), None);
        for i in 0..=STEPS + 1 {
            match (seen.get(i).copied().unwrap_or(false), start) {
                (true, None) => start = Some(i),
                (false, Some(from)) => {
                    best = if i - from > best.1 - best.0 { (from, i) } else { best };
                    start = None;
                }
                _ => {}
            }
        }
        let (from, to) = (best.0, best.1.checked_sub(1)?);
        let part = |i: usize| edge.at(i as f64 / STEPS as f64);
        let edge = Edge { from: part(from), to: part(to) };
        Some(Run { edge, ends: [self.pixel(edge.from)?, self.pixel(edge.to)?] })
    }

    /// Returns the visible parts of edges with a length of at least `least` pixels.
    pub(crate) fn runs(&self, edges: &[Edge], least: f64) -> Vec<Run> {
        edges.iter().filter_map(|edge| self.run(edge)).filter(|run| run.length() >= least).collect()
    }

    /// Annotates a run with points at equal distances in the image: two, or more on long lines of a distorted
    /// image.
    pub(crate) fn annotate_run(&mut self, run: &Run) -> Vec<Pixel> {
        /// Distance between the annotated points of a line in a distorted image, in pixels.
        const STEP_PX: f64 = 140.0;
        /// Maximum number of annotated points of a line.
        const MAX: usize = 5;
        let bent = self.camera.lens.distortion != Distortion::None;
        self.polyline(run, if bent { ((run.length() / STEP_PX) as usize + 1).clamp(2, MAX) } else { 2 })
    }

    /// Annotates a run with `count` points at equal distances in the image.
    pub(crate) fn polyline(&mut self, run: &Run, count: usize) -> Vec<Pixel> {
        let points = along(&self.camera, &run.edge, count);
        points.into_iter().filter_map(|point| self.annotate_point(point)).collect()
    }
}

/// Returns `count` points of an edge at equal distances in the image.
fn along(camera: &Camera, edge: &Edge, count: usize) -> Vec<WorldPoint> {
    /// Number of intervals of the edge for measuring its length in the image.
    const SAMPLES: usize = 400;
    let steps: Vec<Pixel> =
        (0..=SAMPLES).filter_map(|i| camera.world_to_pixel(edge.at(i as f64 / SAMPLES as f64))).collect();
    let mut way = vec![0.0];
    way.extend(steps.windows(2).scan(0.0, |sum, pair| {
        *sum += pair[0].distance(pair[1]);
        Some(*sum)
    }));
    let total = way.last().copied().unwrap_or(0.0);
    (0..count)
        .map(|i| {
            let wanted = total * i as f64 / (count - 1) as f64;
            let index = way.partition_point(|&w| w < wanted - 1e-9).min(SAMPLES);
            edge.at(index as f64 / SAMPLES as f64)
        })
        .collect()
}

/// Selects up to `count` items that are spread over the image. Each selection maximises the worth of the item
/// times its distance in pixels, measured at `middle`, from the items selected before.
pub(crate) fn spread<T: Copy>(
    items: &[T],
    count: usize,
    middle: impl Fn(&T) -> Pixel,
    worth: impl Fn(&T) -> f64,
) -> Vec<T> {
    /// Distance from the selected items above which more distance adds no value, in pixels.
    const MAX_USEFUL_DISTANCE_PX: f64 = 900.0;
    let mut chosen: Vec<T> = Vec::new();
    for _ in 0..count {
        let value = |item: &T| {
            let gap = chosen
                .iter()
                .map(|c| middle(c).distance(middle(item)))
                .fold(MAX_USEFUL_DISTANCE_PX, f64::min);
            worth(item) * gap
        };
        let best = items.iter().max_by(|a, b| value(a).total_cmp(&value(b)));
        match best {
            Some(item) if value(item) > 0.0 => chosen.push(*item),
            _ => break,
        }
    }
    chosen
}

/// Annotation of a camera in addition to verticals and two groups of parallel floor lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extra {
    /// Tile edges of equal length.
    EqualLength,
    /// Known width of the marked lane.
    KnownLength,
    /// Upright person of known height, with this index in [`PEOPLE`].
    Upright(usize),
}

/// Annotations that the operator should enter on the image of one camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AnnotationPlan {
    pub(crate) floor: fn(Axis) -> Vec<Edge>,
    /// Numbers of floor lines along x and along y.
    pub(crate) lines: [usize; 2],
    pub(crate) verticals: usize,
    /// Kind of edges for the annotation of a right angle.
    pub(crate) corner: Corner,
    pub(crate) extras: &'static [Extra],
    /// Number of polylines along straight edges.
    pub(crate) polylines: usize,
}

/// Kind of edges that form a right angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Corner {
    /// Two tile joints.
    Tiles,
    /// One floor line along x and one along y.
    Lines,
}

/// Returns the plan of the annotations for the camera with this id.
pub(crate) fn annotation_plan(id: &str) -> AnnotationPlan {
    let shop = AnnotationPlan {
        floor: shop_floor,
        lines: [4, 4],
        verticals: 6,
        corner: Corner::Tiles,
        extras: &[],
        polylines: 0,
    };
    match id {
        "shop-1" => AnnotationPlan { extras: &[Extra::EqualLength, Extra::Upright(0)], ..shop },
        "shop-2" => AnnotationPlan { lines: [4, 3], verticals: 5, polylines: 8, ..shop },
        "shop-3" => AnnotationPlan { lines: [3, 4], extras: &[Extra::EqualLength], ..shop },
        "checkouts" => AnnotationPlan { polylines: 8, ..shop },
        "store" => AnnotationPlan {
            floor: store_floor,
            lines: [4, 3],
            verticals: 5,
            corner: Corner::Lines,
            extras: &[Extra::KnownLength],
            ..shop
        },
        _ => AnnotationPlan {
            floor: barn_floor,
            lines: [4, 3],
            verticals: 6,
            corner: Corner::Lines,
            polylines: 7,
            ..shop
        },
    }
}

impl AnnotationPlan {
    /// Creates the annotations on the image of `hand`, in the order in which a person would enter them.
    pub(crate) fn annotate(&self, hand: &mut Operator) -> Vec<Annotation> {
        let mut annotations = Vec::new();
        if self.polylines > 0 && hand.camera.lens.distortion != Distortion::None {
            annotations.extend(annotate_polylines(hand, self.polylines));
        }
        annotations.push(annotate_segments(hand, Kind::Vertical, &verticals(), self.verticals, 60.0));
        let [x, y] = self.lines;
        let along = annotate_segments(hand, Kind::Parallel, &(self.floor)(Axis::X), x, 90.0);
        let across = annotate_segments(hand, Kind::Parallel, &(self.floor)(Axis::Y), y, 90.0);
        annotations.push(Annotation { id: Some("along".into()), ..along });
        let tie = Some("along".into());
        annotations.push(Annotation { id: Some("across".into()), at_right_angles_to: tie, ..across });
        annotations.extend(annotate_right_angle(hand, self));
        for extra in self.extras {
            annotations.extend(match extra {
                Extra::EqualLength => annotate_equal_length(hand),
                Extra::KnownLength => annotate_known_length(hand),
                Extra::Upright(index) => annotate_upright(hand, *index),
            });
        }
        annotations
    }
}

/// Annotates up to `count` of the edges whose visible part is at least `least` pixels long.
fn annotate_segments(
    hand: &mut Operator,
    kind: Kind,
    edges: &[Edge],
    count: usize,
    least: f64,
) -> Annotation {
    /// Length of a line above which more length adds no value, in pixels.
    const MAX_USEFUL_LENGTH_PX: f64 = 500.0;
    let runs = hand.runs(edges, least);
    let chosen = spread(&runs, count, Run::middle, |run| run.length().min(MAX_USEFUL_LENGTH_PX));
    Annotation::from_segments(kind, chosen.iter().map(|run| hand.annotate_run(run)).collect())
}

/// Annotates polylines along long straight edges, preferably near the image border.
fn annotate_polylines(hand: &mut Operator, count: usize) -> Vec<Annotation> {
    /// Distance between the points of a polyline, in pixels.
    const POLYLINE_SPACING_PX: f64 = 110.0;
    let centre = hand.camera.lens.principal_point;
    let half = centre.u.hypot(centre.v);
    let runs = hand.runs(&straight(), 420.0);
    let is_wide = hand.camera.lens.distortion.is_wide();
    let worth = |run: &Run| {
        let out = 0.15 + run.middle().distance(centre) / half;
        // A line through the centre of a fisheye image is straight for every lens, so it does not constrain
        // the distortion.
        run.length().min(1400.0) * if is_wide { chord_deviation(hand, run) * out } else { out }
    };
    let chosen = spread(&runs, count, Run::middle, worth);
    chosen
        .iter()
        .map(|run| {
            let count = ((run.length() / POLYLINE_SPACING_PX) as usize).clamp(6, 10);
            Annotation { points: Some(hand.polyline(run, count)), ..Annotation::new(Kind::Straight) }
        })
        .collect()
}

/// Returns the largest distance between the image of a run and its chord, in pixels.
fn chord_deviation(hand: &Operator, run: &Run) -> f64 {
    let [a, b] = run.ends;
    let off = |p: Pixel| ((b.u - a.u) * (p.v - a.v) - (b.v - a.v) * (p.u - a.u)).abs() / a.distance(b);
    let inner = (1..8).filter_map(|i| hand.pixel(run.edge.at(f64::from(i) / 8.0)));
    inner.map(off).fold(0.0, f64::max)
}

/// Returns the visible part of an edge if the whole edge is visible.
fn fully_visible(hand: &Operator, edge: &Edge) -> Option<Run> {
    let run = hand.run(edge)?;
    (run.edge == *edge).then_some(run)
}

/// Returns the completely visible segments of tile joints with a length of `tiles` tiles. They start and end
/// at crossings of joints.
fn tile_segments(hand: &Operator, axis: Axis, tiles: i32) -> Vec<Run> {
    let tile = exact(TILE);
    let length = tile * f64::from(tiles);
    let [dx, dy] = if axis == Axis::X { [length, 0.0] } else { [0.0, length] };
    (2..38)
        .step_by(2)
        .flat_map(|i| (2..22).step_by(2).map(move |j| [f64::from(i) * tile, f64::from(j) * tile]))
        .map(|[x, y]| Edge::new([x, y, 0.0], [x + dx, y + dy, 0.0]))
        .filter_map(|edge| fully_visible(hand, &edge))
        .collect()
}

/// Annotates two perpendicular floor lines that are long in the image and close to each other.
fn annotate_right_angle(hand: &mut Operator, plot: &AnnotationPlan) -> Option<Annotation> {
    let (xs, ys) = match plot.corner {
        Corner::Tiles => (tile_segments(hand, Axis::X, 4), tile_segments(hand, Axis::Y, 4)),
        Corner::Lines => (hand.runs(&(plot.floor)(Axis::X), 150.0), hand.runs(&(plot.floor)(Axis::Y), 90.0)),
    };
    let pairs = xs.iter().flat_map(|a| ys.iter().map(move |b| [*a, *b]));
    let worth = |pair: &[Run; 2]| {
        pair[0].length().min(pair[1].length()) - 0.5 * pair[0].middle().distance(pair[1].middle())
    };
    let best = pairs.max_by(|p, q| worth(p).total_cmp(&worth(q)))?;
    Some(Annotation::from_segments(
        Kind::Perpendicular,
        best.iter().map(|run| hand.polyline(run, 2)).collect(),
    ))
}

/// Annotates segments of equal length: tile joints of three tiles each, near and far, along x and y.
fn annotate_equal_length(hand: &mut Operator) -> Option<Annotation> {
    let mut chosen = Vec::new();
    for axis in [Axis::X, Axis::Y] {
        let long: Vec<Run> =
            tile_segments(hand, axis, 3).into_iter().filter(|run| run.length() > 60.0).collect();
        chosen.extend(spread(&long, 3, Run::middle, |run| run.length().sqrt()));
    }
    let strokes = chosen.iter().map(|run| hand.polyline(run, 2)).collect();
    Some(Annotation {
        name: Some("Three tiles".into()),
        ..Annotation::from_segments(Kind::EqualLength, strokes)
    })
}

/// Annotates the width of the store's lane, between the outer edges of its lines.
fn annotate_known_length(hand: &mut Operator) -> Option<Annotation> {
    let [x0, y0, _, y1] = crate::store::LANE.map(exact);
    let edge = Edge::new([x0 - 0.04, y0 - 0.04, 0.002], [x0 - 0.04, y1 + 0.04, 0.002]);
    let strokes =
        vec![[edge.from, edge.to].into_iter().filter_map(|point| hand.annotate_point(point)).collect()];
    let annotation = Annotation::from_segments(Kind::KnownLength, strokes);
    Some(Annotation { name: Some("Lane".into()), length_m: Some(edge.length()), ..annotation })
}

/// Annotates an upright: the person with this index in [`PEOPLE`], with a height of 1.75 m ± 0.05 m.
fn annotate_upright(hand: &mut Operator, index: usize) -> Option<Annotation> {
    let person = PEOPLE.get(index)?;
    let [x, y] = person.at.map(exact);
    let mut touch = |z: f64| hand.annotate_point(WorldPoint { x, y, z });
    let (foot, head): (Pixel, Pixel) = (touch(0.0)?, touch(exact(person.height))?);
    let height_m = Some(Known::prior(1.75, 0.05));
    Some(Annotation { foot: Some(foot), head: Some(head), height_m, ..Annotation::new(Kind::Upright) })
}
