//! 3-D polylines to project onto images: floor grid, EFOV prism, verticals and virtual elements.

use std::borrow::Cow;

use crate::camera::{Camera, Covariance, FloorPoint, WorldPoint};

/// Connected straight segments in world coordinates.
pub type Polyline = Vec<WorldPoint>;

/// Height of the top face of the EFOV prism above the floor, in metres (the paper's result section).
pub const PRISM_HEIGHT: f64 = 2.0;

/// Shape of a virtual element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum MarkKind {
    /// Two crossed lines on the floor; size: length of an arm.
    Cross,
    /// Upright box with named points at the centres of its base and top; size: width, depth, height.
    Post,
    /// Upright box with named points at its eight corners; size: width, depth, height.
    Box,
    /// Upright cylinder; size: radius, height.
    Cylinder,
    /// Circle on the floor; size: radius.
    Circle,
    /// Human figure; size: height.
    Person,
    /// Grid of square cells on the floor; size: side of a cell, in metres, then numbers of columns
    /// and rows.
    Grid,
    /// Rectangle on the floor, such as a sports court; size: width, depth.
    Rectangle,
}

impl MarkKind {
    /// All kinds of virtual elements.
    pub const ALL: [Self; 8] = [
        Self::Cross,
        Self::Post,
        Self::Box,
        Self::Cylinder,
        Self::Circle,
        Self::Person,
        Self::Grid,
        Self::Rectangle,
    ];

    /// Returns the names of the numbers in the field `size` of a [`MarkShape`] of this kind, in order.
    #[must_use]
    pub const fn size_names(self) -> &'static [&'static str] {
        match self {
            Self::Cross => &["arm"],
            Self::Post | Self::Box => &["width", "depth", "height"],
            Self::Cylinder => &["radius", "height"],
            Self::Circle => &["radius"],
            Self::Person => &["height"],
            Self::Grid => &["cell", "columns", "rows"],
            Self::Rectangle => &["width", "depth"],
        }
    }
}

/// Sports court or other marked rectangle of a known size. The size is between the outer edges of the lines,
/// unless `source` states other edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Court {
    /// Name in menus.
    pub title: &'static str,
    /// Width and depth, in metres.
    pub size: [f64; 2],
    /// Source of the size.
    pub source: &'static str,
}

/// Known courts, in the order of menus.
pub const COURTS: [Court; 14] = {
    const fn court(title: &'static str, size: [f64; 2], source: &'static str) -> Court {
        Court { title, size, source }
    }
    [
        court("Tennis, doubles", [10.97, 23.77], "ITF Rules of Tennis: 36 ft x 78 ft"),
        court("Tennis, singles", [8.23, 23.77], "ITF Rules of Tennis: 27 ft x 78 ft"),
        court("Badminton, doubles", [6.10, 13.40], "BWF Laws of Badminton"),
        court("Badminton, singles", [5.18, 13.40], "BWF Laws of Badminton"),
        court("Basketball, FIBA", [15.0, 28.0], "FIBA Official Basketball Rules, inner edges of the lines"),
        court(
            "Basketball, NBA",
            [15.24, 28.65],
            "NBA Official Rules: 50 ft x 94 ft, inner edges of the lines",
        ),
        court("Volleyball", [9.0, 18.0], "FIVB Official Volleyball Rules"),
        court("Beach volleyball", [8.0, 16.0], "FIVB Beach Volleyball Rules"),
        court("Handball", [20.0, 40.0], "IHF Rules of the Game"),
        court("Padel", [10.0, 20.0], "FIP Rules of Padel, between the walls"),
        court("Pickleball", [6.10, 13.41], "USA Pickleball: 20 ft x 44 ft"),
        court("Football, penalty area", [40.32, 16.5], "IFAB Laws of the Game"),
        court("Football, goal area", [18.32, 5.5], "IFAB Laws of the Game"),
        court(
            "Table tennis, table",
            [1.525, 2.74],
            "ITTF Laws of Table Tennis; its plane is 0.76 m above the floor",
        ),
    ]
};

/// Virtual element with a known shape, in world coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkShape {
    /// Kind of the element.
    pub kind: MarkKind,
    /// World position of the foot or centre of the element, or of the first corner of a grid, in metres.
    pub at: WorldPoint,
    /// Rotation about the vertical, counter-clockwise seen from above, in radians.
    pub turn: f64,
    /// Lengths in metres, and numbers of columns and rows, in the order of [`MarkKind::size_names`].
    pub size: Vec<f64>,
}

/// Number of sides of the polygon that approximates a circle.
const CIRCLE_SIDES: usize = 48;

impl MarkShape {
    /// Returns one number of the size; 1 if the number is missing.
    fn size(&self, index: usize) -> f64 {
        self.size.get(index).copied().unwrap_or(1.0)
    }

    /// Converts a point from the axes of the element to the world.
    fn place(&self, [x, y, z]: [f64; 3]) -> WorldPoint {
        let (sin, cos) = self.turn.sin_cos();
        WorldPoint { x: self.at.x + cos * x - sin * y, y: self.at.y + sin * x + cos * y, z: self.at.z + z }
    }

    /// Iterates over the names of the points of the element. The points of a grid are all crossings of its
    /// lines, named "column,row".
    pub fn point_names(&self) -> impl Iterator<Item = Cow<'static, str>> {
        let names: &[&str] = match self.kind {
            MarkKind::Cross => &["centre", "x", "-x", "y", "-y"],
            MarkKind::Post => &["base", "top"],
            MarkKind::Box => &["b0", "b1", "b2", "b3", "t0", "t1", "t2", "t3"],
            MarkKind::Cylinder => &["centre", "top"],
            MarkKind::Circle => &["centre"],
            MarkKind::Person => &["foot", "head"],
            MarkKind::Grid => &[],
            MarkKind::Rectangle => &["c0", "c1", "c2", "c3"],
        };
        let cells = (self.kind == MarkKind::Grid).then(|| clamped_cell_counts(self.size(1), self.size(2)));
        let crossings = cells.into_iter().flat_map(|[columns, rows]| {
            (0..=rows).flat_map(move |j| (0..=columns).map(move |i| Cow::from(format!("{i},{j}"))))
        });
        names.iter().copied().map(Cow::from).chain(crossings)
    }

    /// Returns a named point of the element, as in the field `seen` of the site file.
    ///
    /// Returns `None` if this kind has no point with that name.
    #[must_use]
    pub fn point(&self, name: &str) -> Option<WorldPoint> {
        let corner = |top: bool, index: usize| {
            let (w, d) = (0.5 * self.size(0), 0.5 * self.size(1));
            let (x, y) = [(-w, -d), (w, -d), (w, d), (-w, d)][index];
            [x, y, if top { self.size(2) } else { 0.0 }]
        };
        let local = match (self.kind, name) {
            (MarkKind::Cross | MarkKind::Cylinder | MarkKind::Circle, "centre")
            | (MarkKind::Post, "base")
            | (MarkKind::Person, "foot") => [0.0; 3],
            (MarkKind::Cross, "x") => [self.size(0), 0.0, 0.0],
            (MarkKind::Cross, "-x") => [-self.size(0), 0.0, 0.0],
            (MarkKind::Cross, "y") => [0.0, self.size(0), 0.0],
            (MarkKind::Cross, "-y") => [0.0, -self.size(0), 0.0],
            (MarkKind::Post, "top") => [0.0, 0.0, self.size(2)],
            (MarkKind::Cylinder, "top") => [0.0, 0.0, self.size(1)],
            (MarkKind::Person, "head") => [0.0, 0.0, self.size(0)],
            (MarkKind::Box, "b0") | (MarkKind::Rectangle, "c0") => corner(false, 0),
            (MarkKind::Box, "b1") | (MarkKind::Rectangle, "c1") => corner(false, 1),
            (MarkKind::Box, "b2") | (MarkKind::Rectangle, "c2") => corner(false, 2),
            (MarkKind::Box, "b3") | (MarkKind::Rectangle, "c3") => corner(false, 3),
            (MarkKind::Box, "t0") => corner(true, 0),
            (MarkKind::Box, "t1") => corner(true, 1),
            (MarkKind::Box, "t2") => corner(true, 2),
            (MarkKind::Box, "t3") => corner(true, 3),
            (MarkKind::Grid, _) => {
                let (i, j) = name.split_once(',')?;
                let (i, j): (u32, u32) = (i.trim().parse().ok()?, j.trim().parse().ok()?);
                if f64::from(i) > self.size(1) || f64::from(j) > self.size(2) {
                    return None;
                }
                [f64::from(i) * self.size(0), f64::from(j) * self.size(0), 0.0]
            }
            _ => return None,
        };
        Some(self.place(local))
    }

    /// Returns the lines of the element, in world coordinates.
    #[must_use]
    pub fn polylines(&self) -> Vec<Polyline> {
        let a = self.size(0);
        let local: Vec<Vec<[f64; 3]>> = match self.kind {
            MarkKind::Cross => {
                vec![vec![[-a, 0.0, 0.0], [a, 0.0, 0.0]], vec![[0.0, -a, 0.0], [0.0, a, 0.0]]]
            }
            MarkKind::Post | MarkKind::Box => box_edges(0.5 * a, 0.5 * self.size(1), self.size(2)),
            MarkKind::Cylinder => cylinder_edges(a, self.size(1)),
            MarkKind::Circle => vec![circle(a, 0.0)],
            MarkKind::Person => person(a),
            MarkKind::Grid => grid_lines(a, self.size(1), self.size(2)),
            MarkKind::Rectangle => vec![rectangle(0.5 * a, 0.5 * self.size(1), 0.0)],
        };
        local.into_iter().map(|line| line.into_iter().map(|point| self.place(point)).collect()).collect()
    }
}

/// Returns a closed circle about the vertical axis at height `z`, in axes of the element, in metres.
fn circle(radius: f64, z: f64) -> Vec<[f64; 3]> {
    (0..=CIRCLE_SIDES)
        .map(|i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / CIRCLE_SIDES as f64).sin_cos();
            [radius * cos, radius * sin, z]
        })
        .collect()
}

/// Returns a closed rectangle with the half sides `x` and `y` at height `z`, in axes of the element, in metres.
fn rectangle(x: f64, y: f64, z: f64) -> Vec<[f64; 3]> {
    [[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]].map(|[x, y]| [x, y, z]).to_vec()
}

/// Returns the edges of a box with the half sides `x` and `y`, in axes of the element, in metres.
fn box_edges(x: f64, y: f64, height: f64) -> Vec<Vec<[f64; 3]>> {
    let base = rectangle(x, y, 0.0);
    let mut edges = vec![base.clone(), rectangle(x, y, height)];
    edges.extend(base[..4].iter().map(|&[x, y, _]| vec![[x, y, 0.0], [x, y, height]]));
    edges
}

/// Returns both circles and four vertical lines of a cylinder, in axes of the element, in metres.
fn cylinder_edges(radius: f64, height: f64) -> Vec<Vec<[f64; 3]>> {
    let mut edges = vec![circle(radius, 0.0), circle(radius, height)];
    edges.extend(
        [[radius, 0.0], [0.0, radius], [-radius, 0.0], [0.0, -radius]]
            .map(|[x, y]| vec![[x, y, 0.0], [x, y, height]]),
    );
    edges
}

/// Returns the outline of a figure of `height` metres with the proportions of an adult, seen from the front,
/// with a circle around its foot.
fn person(height: f64) -> Vec<Vec<[f64; 3]>> {
    let h = height;
    let outline = [
        (0.0, 0.0),
        (0.10, 0.0),
        (0.09, 0.47),
        (0.13, 0.48),
        (0.15, 0.80),
        (0.05, 0.83),
        (0.06, 0.87),
        (0.075, 0.93),
        (0.05, 0.985),
        (0.0, 1.0),
    ];
    let side = |sign: f64| outline.map(|(x, z)| [sign * x * h, 0.0, z * h]).to_vec();
    vec![side(1.0), side(-1.0), circle(0.16 * h, 0.0)]
}

/// Returns the numbers of columns and rows of a grid, at most 1000 each, so that a malicious file cannot
/// exhaust memory.
fn clamped_cell_counts(columns: f64, rows: f64) -> [usize; 2] {
    [columns, rows].map(|count| count.clamp(0.0, 1000.0) as usize)
}

/// Returns the lines of a grid of square cells with the side `cell`, in axes of the element, in metres.
fn grid_lines(cell: f64, columns: f64, rows: f64) -> Vec<Vec<[f64; 3]>> {
    let [columns, rows] = clamped_cell_counts(columns, rows);
    let (x, y) = (cell * columns as f64, cell * rows as f64);
    let along_y = (0..=columns).map(|i| vec![[cell * i as f64, 0.0, 0.0], [cell * i as f64, y, 0.0]]);
    let along_x = (0..=rows).map(|j| vec![[0.0, cell * j as f64, 0.0], [x, cell * j as f64, 0.0]]);
    along_y.chain(along_x).collect()
}

/// Returns the EFOV as a prism: base on the floor, top face [`PRISM_HEIGHT`] above it, and the edges between
/// them.
#[must_use]
pub fn prism(base: &[FloorPoint]) -> Vec<Polyline> {
    let face = |z: f64| base.iter().chain(base.first()).map(|p| p.at_height(z)).collect::<Polyline>();
    let mut lines = vec![face(0.0), face(PRISM_HEIGHT)];
    lines.extend(base.iter().map(|p| vec![p.at_height(0.0), p.at_height(PRISM_HEIGHT)]));
    lines
}

/// Returns the lines of a grid inside a floor polygon, at every multiple of `step` metres in x and y.
#[must_use]
pub fn floor_grid(polygon: &[FloorPoint], step: f64) -> Vec<Polyline> {
    /// Limit of the number of lines in one direction. From this number on, no lines are returned, because they
    /// would not be distinguishable.
    const MAX_LINES: f64 = 400.0;
    let mut lines = Vec::new();
    for axis in 0..2 {
        let along = |p: &FloorPoint| if axis == 0 { p.x } else { p.y };
        let across = |p: &FloorPoint| if axis == 0 { p.y } else { p.x };
        let low = polygon.iter().map(along).fold(f64::INFINITY, f64::min);
        let high = polygon.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
        if !(low.is_finite() && high.is_finite() && step > 0.0 && (high - low) / step < MAX_LINES) {
            continue;
        }
        let mut index = (low / step).ceil();
        while index * step <= high {
            let here = index * step;
            for pair in crossings(polygon, here, along, across).chunks_exact(2) {
                let end = |t: f64| if axis == 0 { [here, t, 0.0] } else { [t, here, 0.0] };
                lines.push(pair.iter().map(|&t| WorldPoint::from(end(t))).collect());
            }
            index += 1.0;
        }
    }
    lines
}

/// Returns the values of `across` at which the line `along = here` crosses a polygon, ascending. `along` and
/// `across` return the coordinates x and y of a point, or y and x.
fn crossings(
    polygon: &[FloorPoint],
    here: f64,
    along: impl Fn(&FloorPoint) -> f64,
    across: impl Fn(&FloorPoint) -> f64,
) -> Vec<f64> {
    let mut found: Vec<f64> = (0..polygon.len())
        .filter_map(|i| {
            let (a, b) = (&polygon[i], &polygon[(i + 1) % polygon.len()]);
            let (s, t) = (along(a) - here, along(b) - here);
            ((s < 0.0) != (t < 0.0)).then(|| across(a) + s / (s - t) * (across(b) - across(a)))
        })
        .collect();
    found.sort_by(f64::total_cmp);
    found
}

/// Returns the ellipse of `sigmas` standard deviations about the camera position on the floor, as a polygon.
/// Returns `None` if the position was not estimated or its uncertainty is unknown.
#[must_use]
pub fn position_ellipse(camera: &Camera, sigmas: f64) -> Option<Vec<FloorPoint>> {
    let axes = [Covariance::X, Covariance::Y];
    let known = axes.map(|i| axes.map(|j| camera.covariance.0[i][j]));
    ellipse(camera.position.on_floor(), &known, sigmas)
}

/// Returns the ellipse of `sigmas` standard deviations about a floor point with this covariance, in square
/// metres, as a polygon. Returns `None` if the covariance is zero or infinite.
#[must_use]
pub fn ellipse(about: FloorPoint, covariance: &[[f64; 2]; 2], sigmas: f64) -> Option<Vec<FloorPoint>> {
    let [[xx, xy], [_, yy]] = *covariance;
    // The lower triangular root of the covariance maps a circle to the ellipse.
    let a = xx.sqrt();
    let b = if a > 0.0 { xy / a } else { 0.0 };
    let c = (yy - b * b).max(0.0).sqrt();
    if !(a.is_finite() && c.is_finite()) || a + c == 0.0 {
        return None;
    }
    let corner = |[cos, sin, _]: [f64; 3]| {
        FloorPoint::new(about.x + sigmas * a * cos, about.y + sigmas * (b * cos + c * sin))
    };
    Some(circle(1.0, 0.0).into_iter().take(CIRCLE_SIDES).map(corner).collect())
}

/// Returns the vertical line through a floor point, up to `height` metres.
#[must_use]
pub fn vertical(at: FloorPoint, height: f64) -> Polyline {
    vec![at.at_height(0.0), at.at_height(height)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;

    #[test]
    fn every_mark_kind_has_polylines_and_named_points() {
        for kind in MarkKind::ALL {
            let size = vec![1.0, 2.0, 3.0][..kind.size_names().len()].to_vec();
            let mark = MarkShape { kind, at: WorldPoint::new(1.0, 2.0, 0.5), turn: 0.3, size };
            assert!(!mark.polylines().is_empty());
            assert!(mark.point_names().count() > 0);
            for name in mark.point_names() {
                let point = mark.point(&name).unwrap_or_else(|| panic!("{kind:?} has no {name}"));
                assert!(point.is_finite() && point.z >= 0.5);
            }
            assert_eq!(mark.point("elbow"), None);
        }
    }

    #[test]
    fn every_grid_crossing_has_a_name() {
        let at = WorldPoint::new(1.0, 2.0, 0.0);
        for [columns, rows] in [[1, 1], [4, 4], [6, 3], [2, 9]] {
            let size = vec![0.5, f64::from(columns), f64::from(rows)];
            let mark = MarkShape { kind: MarkKind::Grid, at, turn: 0.3, size };
            let points: Vec<WorldPoint> = mark.point_names().filter_map(|name| mark.point(&name)).collect();
            assert_eq!(points.len(), (columns + 1) as usize * (rows + 1) as usize);
            for end in mark.polylines().into_iter().flatten() {
                assert!(points.iter().any(|point| point.distance(end) < 1e-9), "no name for {end:?}");
            }
            assert_eq!(mark.point(&format!("{},0", columns + 1)), None);
        }
    }

    #[test]
    fn ellipse_points_are_at_the_requested_sigmas() {
        let mut camera = any_position();
        let (xx, xy, yy) = (0.04, -0.01, 0.09);
        let rows = &mut camera.covariance.0;
        (rows[0][0], rows[0][1], rows[1][0], rows[1][1]) = (xx, xy, xy, yy);
        let determinant = xx * yy - xy * xy;
        for point in position_ellipse(&camera, 2.0).unwrap() {
            let (x, y) = (point.x - camera.position.x, point.y - camera.position.y);
            let square = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant;
            assert!((square - 4.0).abs() < 1e-9, "{square}");
        }
        camera.covariance = Covariance::EXACT;
        assert_eq!(position_ellipse(&camera, 2.0), None);
    }

    fn any_position() -> Camera {
        Camera {
            position: WorldPoint::new(3.0, -2.0, 4.0),
            yaw: 0.3,
            pitch: 0.4,
            roll: 0.0,
            focal: 1000.0,
            lens: crate::camera::Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        }
    }

    #[test]
    fn the_grid_ends_at_the_polygon() {
        let square = [[0.5, 0.5], [3.5, 0.5], [3.5, 2.5], [0.5, 2.5]].map(FloorPoint::from);
        let lines = floor_grid(&square, 1.0);
        assert_eq!(lines.len(), 5, "x = 1, 2, 3 and y = 1, 2");
        assert!(lines.iter().flatten().all(|p| p.x >= 0.5 && p.x <= 3.5 && p.y >= 0.5 && p.y <= 2.5));
    }
}
