//! Exact edges of the scene for the simulated operator.

use calib_core::WorldPoint;

use crate::barn::{self, AISLE, KERB};
use crate::building::{CEILING, COLUMN, COLUMNS, TILE, WALLS};
use crate::shop::{self, FRIDGE, FRIDGES, GONDOLA_HALF, GONDOLA_HEIGHT, GONDOLAS, WALL_SHELF, WALL_SHELVES};
use crate::store::{LANE, RACK_HEIGHT, RACKS};

/// Straight edge between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Edge {
    pub(crate) from: WorldPoint,
    pub(crate) to: WorldPoint,
}

impl Edge {
    pub(crate) fn new(from: [f64; 3], to: [f64; 3]) -> Self {
        Self { from: from.into(), to: to.into() }
    }

    /// Returns a point of the edge: its start for `t` = 0, its end for `t` = 1.
    pub(crate) fn at(&self, t: f64) -> WorldPoint {
        let mix = |a: f64, b: f64| a + t * (b - a);
        WorldPoint {
            x: mix(self.from.x, self.to.x),
            y: mix(self.from.y, self.to.y),
            z: mix(self.from.z, self.to.z),
        }
    }

    /// Returns the length of the edge, in metres.
    pub(crate) fn length(&self) -> f64 {
        self.from.distance(self.to)
    }
}

/// Directions of the edges of the building.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    X,
    Y,
}

/// Converts a length of the building's tables, in metres, to the nearest tenth of a millimetre.
pub(crate) fn exact(value: f32) -> f64 {
    (f64::from(value) * 1e4).round() / 1e4
}

fn plumb(x: f64, y: f64, low: f64, high: f64) -> Edge {
    Edge::new([x, y, low], [x, y, high])
}

/// Returns all vertical edges of the scene.
pub(crate) fn verticals() -> Vec<Edge> {
    let mut edges = columns();
    edges.extend(openings().into_iter().flat_map(|(edges, _)| edges));
    for [from, to, y] in GONDOLAS.map(|row| row.map(exact)) {
        for (x, side) in [(from, -1.0), (from, 1.0), (to, -1.0), (to, 1.0)] {
            edges.push(plumb(x, y + side * exact(GONDOLA_HALF), 0.0, exact(GONDOLA_HEIGHT)));
        }
    }
    let bays = |[from, to]: [f32; 2]| {
        let (from, to, bay) = (exact(from), exact(to), exact(shop::BAY));
        (1..((to - from) / bay).round() as usize).map(move |i| from + bay * i as f64)
    };
    edges
        .extend(bays(WALL_SHELVES).map(|x| plumb(x + 0.02, exact(WALL_SHELF[0]), 0.1, exact(WALL_SHELF[1]))));
    edges.extend(bays(FRIDGES).map(|x| plumb(x + 0.03, exact(FRIDGE[0]), 0.25, exact(FRIDGE[1]) - 0.25)));
    for [x0, y0, x1, y1] in RACKS.map(|rack| rack.map(exact)) {
        let top = exact(RACK_HEIGHT);
        edges.extend([(x0, y0), (x0, y1), (x1, y0), (x1, y1)].map(|(x, y)| plumb(x, y, 0.0, top)));
    }
    let half = 0.5 * exact(barn::POST);
    for i in 1..6 {
        let x = exact(barn::BAY) * f64::from(i);
        for (y, side) in [(exact(AISLE[0]), -1.0), (exact(AISLE[1]), 1.0)] {
            let near = y + side * 0.04;
            edges.extend([x - half, x + half].map(|x| plumb(x, near, 0.5, 3.3)));
        }
    }
    edges
}

fn columns() -> Vec<Edge> {
    let half = exact(COLUMN);
    let corners = [(-half, -half), (half, -half), (half, half), (-half, half)];
    COLUMNS
        .iter()
        .map(|column| column.map(exact))
        .flat_map(|[x, y]| corners.map(|(dx, dy)| (x + dx, y + dy)))
        .flat_map(|(x, y)| [plumb(x, y, 0.12, 2.5), plumb(x, y, 2.75, exact(CEILING))])
        .collect()
}

/// Returns edges of every door and window, on both faces of its wall: the outer edges of its posts, and its
/// upper edge.
fn openings() -> Vec<([Edge; 2], Edge)> {
    /// Distance by which the frame of an opening projects from the faces of its wall, in metres.
    const PROJECTION: f64 = 0.02;
    let mut edges = Vec::new();
    for wall in &WALLS {
        let [x0, y0, x1, y1] = wall.foot.map(exact);
        for opening in wall.openings {
            let ([from, to], low, high) = (opening.span.map(exact), exact(opening.sill), exact(opening.head));
            let faces = if wall.is_along_x() {
                [y0 - PROJECTION, y1 + PROJECTION]
            } else {
                [x0 - PROJECTION, x1 + PROJECTION]
            };
            for face in faces {
                let at =
                    |along: f64, z: f64| if wall.is_along_x() { [along, face, z] } else { [face, along, z] };
                let post = |along: f64| Edge::new(at(along, low), at(along, high));
                edges.push(([post(from), post(to)], Edge::new(at(from, high), at(to, high))));
            }
        }
    }
    edges
}

/// Returns level edges of the shop along an axis: tile joints, and a lower edge of the skirting.
pub(crate) fn shop_floor(axis: Axis) -> Vec<Edge> {
    let (width, depth) = (24.0, 14.4);
    let tile = exact(TILE);
    let across = if axis == Axis::X { depth } else { width };
    let count = (across / tile).round() as i32;
    let mut edges: Vec<Edge> = (1..count)
        .map(|k| f64::from(k) * tile)
        .map(|at| match axis {
            Axis::X => Edge::new([0.02, at, 0.0], [width - 0.02, at, 0.0]),
            Axis::Y => Edge::new([at, 0.02, 0.0], [at, depth - 0.02, 0.0]),
        })
        .collect();
    match axis {
        Axis::X => edges.push(Edge::new([4.8, depth - 0.02, 0.0], [width, depth - 0.02, 0.0])),
        Axis::Y => edges.push(Edge::new([width - 0.02, 7.2, 0.0], [width - 0.02, depth, 0.0])),
    }
    edges
}

/// Returns level edges of the store along an axis: the marked lane, saw cuts, walls, beams of the racks.
pub(crate) fn store_floor(axis: Axis) -> Vec<Edge> {
    /// Half the width of the lines of the marked lane, in metres.
    const HALF_LINE: f64 = 0.04;
    let [x0, y0, x1, y1] = LANE.map(exact);
    let [rack, side] = RACKS.map(|rack| rack.map(exact));
    match axis {
        Axis::X => {
            let mut edges: Vec<Edge> = [y0 - HALF_LINE, y0 + HALF_LINE, y1 - HALF_LINE, y1 + HALF_LINE]
                .map(|y| Edge::new([x0 + HALF_LINE, y, 0.002], [x1, y, 0.002]))
                .into();
            edges.extend(
                [0.9, 1.9].map(|z| Edge::new([rack[0], rack[3] + 0.005, z], [rack[2], rack[3] + 0.005, z])),
            );
            edges
        }
        Axis::Y => {
            let mut edges: Vec<Edge> = [x0 - HALF_LINE, x0 + HALF_LINE]
                .map(|x| Edge::new([x, y0 + HALF_LINE, 0.002], [x, y1 - HALF_LINE, 0.002]))
                .into();
            edges.push(Edge::new([28.0, 1.3, 0.0], [28.0, 8.3, 0.0]));
            edges.push(Edge::new([30.0, 0.1, 0.0], [30.0, 2.4, 0.0]));
            edges.extend(
                [0.9, 1.9].map(|z| Edge::new([side[0] - 0.005, side[1], z], [side[0] - 0.005, side[3], z])),
            );
            edges
        }
    }
}

/// Returns level edges of the barn along an axis: kerbs, gutters, walls, saw cuts, the gate.
pub(crate) fn barn_floor(axis: Axis) -> Vec<Edge> {
    let [y0, y1] = AISLE.map(exact);
    match axis {
        Axis::X => {
            let [width, top] = KERB.map(exact);
            [(y0, -1.0, -12.2), (y1, 1.0, -0.34)]
                .into_iter()
                .flat_map(|(y, side, wall)| {
                    [
                        (y, top),
                        (y + side * width, top),
                        (y - side * 0.22, 0.003),
                        (y - side * 0.35, 0.003),
                        (wall - side * 0.1, 0.9),
                    ]
                })
                .map(|(y, z)| Edge::new([0.5, y, z], [29.5, y, z]))
                .collect()
        }
        Axis::Y => (1..12)
            .map(|k| 2.5 * f64::from(k))
            .map(|x| Edge::new([x, y0 + 0.36, 0.0], [x, y1 - 0.36, 0.0]))
            .chain([Edge::new([29.98, -7.9, 3.3], [29.98, -4.6, 3.3])])
            .collect(),
    }
}

/// Returns all long straight edges of any direction, for polylines that constrain distortion.
pub(crate) fn straight() -> Vec<Edge> {
    let mut edges = verticals();
    for axis in [Axis::X, Axis::Y] {
        edges.extend(shop_floor(axis));
        edges.extend(barn_floor(axis));
    }
    edges.extend(openings().into_iter().map(|(_, head)| head));
    let (width, depth) = (24.0, 14.4);
    for z in [3.55, 4.1] {
        edges.push(Edge::new([0.02, 0.015, z], [width - 0.02, 0.015, z]));
        edges.push(Edge::new([0.015, 0.02, z], [0.015, depth, z]));
        edges.push(Edge::new([width - 0.015, 0.02, z], [width - 0.015, depth, z]));
    }
    let top = exact(WALL_SHELF[1]) + 0.12;
    edges.push(Edge::new(
        [exact(WALL_SHELVES[0]), exact(WALL_SHELF[0]), top],
        [exact(WALL_SHELVES[1]), exact(WALL_SHELF[0]), top],
    ));
    edges.push(Edge::new([0.0, -0.34, 3.7], [30.0, -0.34, 3.7]));
    for (y, side) in [(exact(AISLE[0]), -1.0), (exact(AISLE[1]), 1.0)] {
        edges.extend((1..6).map(|i| {
            let x = exact(barn::BAY) * f64::from(i) - 0.08;
            let wall = if side < 0.0 { -12.2 } else { -0.34 };
            Edge::new([x, y + side * 0.24, 3.3], [x, wall, 3.3])
        }));
    }
    edges.extend((1..6).map(|i| {
        let x = exact(barn::BAY) * f64::from(i) - 0.08;
        Edge::new([x, -8.5, 3.42], [x, -4.0, 3.42])
    }));
    edges
}
