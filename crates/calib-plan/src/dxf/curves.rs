//! Paths of single records, in the coordinates of the drawing.
//!
//! Flat records, such as arcs, have their own coordinate system (OCS). Its x and y axes follow from its normal by
//! the arbitrary axis algorithm of the DXF reference. Heights are dropped: the plan is the view from above.

use std::f64::consts::TAU;

use kurbo::{Affine, Arc, BezPath, Point, Shape as _, Vec2};

use super::pairs::{Record, integer, number};

/// Tolerance of curves as a share of their radius.
const TOLERANCE: f64 = 1e-3;
/// Smallest radius or chord of a curve, in drawing units. The tolerance of smaller ones would be zero.
const MIN_SIZE: f64 = 1e-9;
/// Number of points on a spline per control point.
const POINTS_PER_CONTROL: usize = 8;
/// Largest number of control points of a spline.
const MAX_CONTROLS: usize = 4096;

/// Returns the transform from the coordinate system of a flat record to the view from above.
pub(super) fn from_above(record: &Record<'_>) -> Affine {
    let axis = [210, 220, 230].map(|code| record.number(code));
    let [Some(x), Some(y), Some(z)] = axis else { return Affine::IDENTITY };
    let length = (x * x + y * y + z * z).sqrt();
    if length < 1e-9 {
        return Affine::IDENTITY;
    }
    let normal = [x, y, z].map(|value| value / length);
    // If the normal is near the vertical, the x axis is y cross normal; otherwise it is z cross normal.
    let is_near = normal[0].abs() < 1.0 / 64.0 && normal[1].abs() < 1.0 / 64.0;
    let right = cross(if is_near { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] }, normal);
    let size = (right[0] * right[0] + right[1] * right[1] + right[2] * right[2]).sqrt();
    let right = right.map(|value| value / size);
    let up = cross(normal, right);
    Affine::new([right[0], right[1], up[0], up[1], 0.0, 0.0])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the point with these codes.
pub(super) fn point(record: &Record<'_>, codes: [i32; 2]) -> Option<Point> {
    Some(Point::new(record.number(codes[0])?, record.number(codes[1])?))
}

/// Returns a straight line.
pub(super) fn line(record: &Record<'_>) -> Option<BezPath> {
    polygon(&[point(record, [10, 20])?, point(record, [11, 21])?], false)
}

/// Returns the edges of a face of three or four corners. The corners of a solid are in the order of a Z.
pub(super) fn face(record: &Record<'_>, is_solid: bool) -> Option<BezPath> {
    let mut corners: Vec<Point> =
        (0..4).filter_map(|index| point(record, [10 + index, 20 + index])).collect();
    if is_solid && corners.len() == 4 {
        corners.swap(2, 3);
    }
    polygon(&corners, true)
}

/// Returns a polyline through points.
pub(super) fn polygon(points: &[Point], is_closed: bool) -> Option<BezPath> {
    let (first, rest) = points.split_first().filter(|(_, rest)| !rest.is_empty())?;
    let mut path = BezPath::new();
    path.move_to(*first);
    rest.iter().for_each(|&point| path.line_to(point));
    if is_closed {
        path.close_path();
    }
    Some(path)
}

/// Returns a circle, or an arc counter-clockwise between two angles in degrees.
pub(super) fn arc(record: &Record<'_>) -> Option<BezPath> {
    let center = point(record, [10, 20])?;
    let radius = record.number(40)?.abs();
    let angles = (record.number(50), record.number(51));
    let (start, sweep) = match angles {
        (Some(start), Some(end)) if record.kind == "ARC" => {
            (start.to_radians(), counter_clockwise(start.to_radians(), end.to_radians()))
        }
        _ => (0.0, TAU),
    };
    elliptic(center, Vec2::new(radius, radius), start, sweep, 0.0)
}

/// Returns an ellipse or an elliptic arc.
pub(super) fn ellipse(record: &Record<'_>) -> Option<BezPath> {
    let center = point(record, [10, 20])?;
    let major = point(record, [11, 21])?.to_vec2();
    let minor = major.hypot() * record.number(40)?.abs().min(1.0);
    let (start, end) = (record.number(41).unwrap_or(0.0), record.number(42).unwrap_or(TAU));
    // The normal is vertical, up or down. Down mirrors the direction of the arc.
    let sign = if record.number(230).is_some_and(|z| z < 0.0) { -1.0 } else { 1.0 };
    elliptic(
        center,
        Vec2::new(major.hypot(), minor),
        sign * start,
        sign * counter_clockwise(start, end),
        major.atan2(),
    )
}

/// Returns the angle counter-clockwise from `start` to `end`, in (0, 2π].
fn counter_clockwise(start: f64, end: f64) -> f64 {
    let sweep = (end - start).rem_euclid(TAU);
    if sweep < 1e-9 { TAU } else { sweep }
}

fn elliptic(center: Point, radii: Vec2, start: f64, sweep: f64, rotation: f64) -> Option<BezPath> {
    let size = radii.x.max(radii.y);
    if size < MIN_SIZE {
        return None;
    }
    let arc = Arc::new(center, radii, start, sweep, rotation);
    let mut path = arc.to_path(TOLERANCE * size);
    if (sweep.abs() - TAU).abs() < 1e-9 {
        path.close_path();
    }
    Some(path)
}

/// Vertex of a polyline. The bulge is the tangent of a quarter of the angle of the arc to the next vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    pub(super) at: Point,
    pub(super) bulge: f64,
}

/// Returns the vertices of a lightweight polyline (LWPOLYLINE).
pub(super) fn vertices(record: &Record<'_>) -> Vec<Vertex> {
    let mut vertices: Vec<Vertex> = Vec::new();
    for pair in record.pairs {
        let Some(value) = number(&pair.value) else { continue };
        match (pair.code, vertices.last_mut()) {
            (10, _) => vertices.push(Vertex { at: Point::new(value, 0.0), bulge: 0.0 }),
            (20, Some(vertex)) => vertex.at.y = value,
            (42, Some(vertex)) => vertex.bulge = value,
            _ => {}
        }
    }
    vertices
}

/// Returns the path through vertices.
pub(super) fn through(vertices: &[Vertex], is_closed: bool) -> Option<BezPath> {
    let first = vertices.first().filter(|_| vertices.len() > 1)?;
    let mut path = BezPath::new();
    path.move_to(first.at);
    let next = vertices.iter().skip(1).chain(is_closed.then_some(first));
    for (from, to) in vertices.iter().zip(next) {
        add_bulge(&mut path, *from, to.at);
    }
    if is_closed {
        path.close_path();
    }
    Some(path)
}

/// Adds the line or arc from a vertex to a point.
fn add_bulge(path: &mut BezPath, from: Vertex, to: Point) {
    let chord = to - from.at;
    let bulge = from.bulge;
    if bulge.abs() < 1e-6 || chord.hypot() < MIN_SIZE {
        path.line_to(to);
        return;
    }
    // The centre is on the bisector of the chord.
    let offset = (1.0 - bulge * bulge) / (4.0 * bulge);
    let center = from.at.midpoint(to) + Vec2::new(-chord.y, chord.x) * offset;
    let radius = (from.at - center).hypot();
    let start = (from.at - center).atan2();
    let arc = Arc::new(center, Vec2::new(radius, radius), start, 4.0 * bulge.atan(), 0.0);
    arc.to_cubic_beziers(TOLERANCE * radius, |a, b, c| path.curve_to(a, b, c));
}

/// Returns a polyline through points on a rational B-spline (algorithm of de Boor). If the control points and
/// knots do not match, or are too many, returns a polyline through the fit points.
pub(super) fn spline(record: &Record<'_>) -> Option<BezPath> {
    let degree = usize::try_from(record.integer(71)?).ok().filter(|degree| (1..=11).contains(degree))?;
    let (knots, weights) = (record.numbers(40), record.numbers(41));
    let controls: Vec<[f64; 3]> = record
        .numbers(10)
        .into_iter()
        .zip(record.numbers(20))
        .enumerate()
        .map(|(index, (x, y))| {
            let weight = weights.get(index).copied().unwrap_or(1.0);
            [x * weight, y * weight, weight]
        })
        .collect();
    if controls.len() <= degree || controls.len() > MAX_CONTROLS || knots.len() != controls.len() + degree + 1
    {
        let fit: Vec<Point> =
            record.numbers(11).into_iter().zip(record.numbers(21)).map(Point::from).collect();
        return polygon(&fit, record.integer(70).unwrap_or(0) & 1 != 0);
    }
    let (low, high) = (knots[degree], knots[controls.len()]);
    let count = POINTS_PER_CONTROL * controls.len();
    let points: Vec<Point> = (0..=count)
        .map(|index| low + (high - low) * index as f64 / count as f64)
        .filter_map(|at| de_boor(&controls, &knots, degree, at))
        .collect();
    polygon(&points, false)
}

/// Returns the point of a rational B-spline at a parameter. Control points are in homogeneous coordinates.
fn de_boor(controls: &[[f64; 3]], knots: &[f64], degree: usize, at: f64) -> Option<Point> {
    let last = controls.len() - 1;
    let span = (degree..=last).rev().find(|&index| knots[index] <= at).unwrap_or(degree);
    let mut points: Vec<[f64; 3]> = controls[span - degree..=span].to_vec();
    for level in 1..=degree {
        for index in (level..=degree).rev() {
            let left = knots[span - degree + index];
            let width = knots[span + 1 + index - level] - left;
            let share = if width > 0.0 { (at - left) / width } else { 0.0 };
            points[index] =
                std::array::from_fn(|k| (1.0 - share) * points[index - 1][k] + share * points[index][k]);
        }
    }
    let [x, y, weight] = points[degree];
    (weight.abs() > 1e-12).then(|| Point::new(x / weight, y / weight))
}

/// Returns the outlines of a hatch: polylines, and edges of lines and arcs. Elliptic and spline edges are
/// replaced by the lines between their neighbours.
pub(super) fn hatch(record: &Record<'_>) -> Option<BezPath> {
    let mut pairs = record.pairs.iter().skip_while(|pair| pair.code != 91).skip(1).peekable();
    let mut path = BezPath::new();
    let mut polyline: Vec<Vertex> = Vec::new();
    let mut edge: [f64; 7] = [0.0; 7];
    let (mut kind, mut is_polyline) = (0, false);
    let mut outline: Vec<Vertex> = Vec::new();
    let mut finish = |outline: &mut Vec<Vertex>| {
        if let Some(ring) = through(outline, true) {
            path.extend(ring);
        }
        outline.clear();
    };
    for pair in pairs.by_ref().take_while(|pair| pair.code != 75) {
        let value = number(&pair.value).unwrap_or(0.0);
        match pair.code {
            92 => {
                outline.append(&mut polyline);
                finish(&mut outline);
                kind = 0;
                is_polyline = integer(&pair.value).unwrap_or(0) & 2 != 0;
            }
            10 if is_polyline => polyline.push(Vertex { at: Point::new(value, 0.0), bulge: 0.0 }),
            20 if is_polyline => {
                if let Some(vertex) = polyline.last_mut() {
                    vertex.at.y = value;
                }
            }
            42 if is_polyline => {
                if let Some(vertex) = polyline.last_mut() {
                    vertex.bulge = value;
                }
            }
            72 if !is_polyline => kind = integer(&pair.value).unwrap_or(0),
            10 => edge[0] = value,
            20 => edge[1] = value,
            11 => edge[2] = value,
            21 if kind == 1 => {
                outline.push(Vertex { at: Point::new(edge[0], edge[1]), bulge: 0.0 });
            }
            40 => edge[4] = value,
            50 => edge[5] = value,
            51 => edge[6] = value,
            73 if kind == 2 && !is_polyline => outline.extend(arc_vertices(&edge, value > 0.5)),
            _ => {}
        }
    }
    outline.append(&mut polyline);
    finish(&mut outline);
    (!path.elements().is_empty()).then_some(path)
}

/// Returns start and middle of an arc edge of a hatch, with the bulges of its halves. Clockwise arcs have
/// mirrored angles.
fn arc_vertices(edge: &[f64; 7], is_counter_clockwise: bool) -> [Vertex; 2] {
    let [x, y, _, _, radius, start, end] = *edge;
    let half = 0.5 * counter_clockwise(start.to_radians(), end.to_radians());
    let sign = if is_counter_clockwise { 1.0 } else { -1.0 };
    [start.to_radians(), start.to_radians() + half].map(|angle| {
        let (sin, cos) = (sign * angle).sin_cos();
        Vertex { at: Point::new(x + radius * cos, y + radius * sin), bulge: (sign * half / 4.0).tan() }
    })
}
