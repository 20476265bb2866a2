//! The turn that most parts of a still agree on, by corners that look the same: to a few pixels.
//!
//! Two corners tell a turn and a zoom: the angle between their rays is known, and makes of the new focal `f`, with the
//! corners `p` and `q` about the principal point, an equation of the second degree in `f^2`:
//!
//! ```text
//! (p q + f^2)^2 = cos^2 (p p + f^2)(q q + f^2)
//! ```
//!
//! (Brown, Hartley, Nister 2007). Of many pairs the one is taken that most others agree with (Fischler and Bolles 1981),
//! counted by parts of the image: a pallet full of corners has one voice.

use calib_core::{Camera, Pixel, UndistortedPixel};

use calib_core::camera::{Turn, Turned};

use crate::{EdgeOffset, Estimated, STEP, TONE, TurnFit};

use crate::compare::feature::Luma;
use crate::compare::feature::{LEAN, Match, features, matches};
use crate::compare::motion::Sight;

/// What the coordinates of a point are counted along.
pub(crate) const AXES: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];
/// Focals farther from the old one than by this factor are not looked for.
const ZOOM: f64 = 2.2;
/// How far a corner may be from where it is told, in pixels of the image it was found in.
const NEAR: f64 = 3.5;
/// Pairs that are tried.
const PAIRS: usize = 4000;
/// Columns and rows of the parts of the image that have a voice.
const PARTS: [usize; 2] = [12, 8];
/// What one part counts for, at most.
const VOICE: usize = 3;

/// A match as rays and pixels.
pub(crate) struct Seen {
    pub(crate) sight: Sight,
    /// Where the new still shows it.
    pub(crate) at: Pixel,
    new: UndistortedPixel,
    /// How far it may be from where it is told, in pixels.
    pub(crate) near: f64,
    pub(crate) part: usize,
}

/// The corners of a still that another one shows, the surest first.
pub(crate) fn corners(camera: &Camera, old: &Luma, new: &Luma) -> Vec<Seen> {
    let found = matches(&features(old, &[0.0]), &features(new, &[-LEAN, 0.0, LEAN]));
    let seen = |found: &Match| -> Option<Seen> {
        let [c, r] = [found.old.u / old.width as f64, found.old.v / old.height as f64];
        let [columns, rows] = PARTS;
        let part = (r * rows as f64) as usize * columns + (c * columns as f64) as usize;
        let (sight, new) = (Sight::new(camera, found.old)?, camera.undistort(found.new)?);
        Some(Seen { sight, at: found.new, new, near: NEAR * found.size, part })
    };
    found.iter().filter_map(seen).collect()
}

/// The turn that corners tell; `None` where too few look the same.
pub(crate) fn coarse(camera: &Camera, seen: &[Seen]) -> Option<Turn> {
    /// Fewer agree by chance.
    const LEAST: usize = 8;
    let (turn, voices) = most_agreed(camera, seen)?;
    (voices >= LEAST).then(|| refined(camera, seen, turn))
}

/// The turn of the pair that most agree with, and with how many voices.
fn most_agreed(camera: &Camera, seen: &[Seen]) -> Option<(Turn, usize)> {
    /// The surest matches are asked first.
    const FIRST: usize = 20;
    let mut chance = Chance(0x9e37_79b9_7f4a_7c15);
    let mut best: Option<(Turn, usize)> = None;
    for round in 0..PAIRS {
        let among = (FIRST + round * seen.len() / (PAIRS / 2)).min(seen.len());
        if among < 2 {
            return None;
        }
        let (a, b) = (chance.below(among), chance.below(among));
        for turn in of_pair(camera, &seen[a], &seen[b]) {
            let voices = voices(&turn.at(camera), seen);
            if best.is_none_or(|(_, most)| voices > most) {
                best = Some((turn, voices));
            }
        }
    }
    best
}

fn voices(turned: &Turned, seen: &[Seen]) -> usize {
    voices_of(seen.iter().filter(|seen| agrees(turned, seen)))
}

/// How many parts of the image these corners are in, each counted up to a few.
pub(crate) fn voices_of<'a>(seen: impl Iterator<Item = &'a Seen>) -> usize {
    let mut parts = [0; PARTS[0] * PARTS[1] + PARTS[0]];
    for seen in seen {
        parts[seen.part] += 1;
    }
    parts.iter().map(|&count: &usize| count.min(VOICE)).sum()
}

fn agrees(turned: &Turned, seen: &Seen) -> bool {
    turned.shown_undistorted(seen.sight.ray).is_some_and(|shown| shown.distance(seen.new) < seen.near)
}

/// The turns that lead two rays to their new pixels.
fn of_pair(camera: &Camera, a: &Seen, b: &Seen) -> Vec<Turn> {
    let centre = camera.lens.principal_point;
    let [p, q] = [a.new, b.new].map(|pixel| [pixel.u - centre.u, pixel.v - centre.v]);
    let flat = |p: [f64; 2], q: [f64; 2]| p[0] * q[0] + p[1] * q[1];
    let (pq, pp, qq) = (flat(p, q), flat(p, p), flat(q, q));
    let [r, s] = [a.sight.ray, b.sight.ray].map(unit);
    let square = dot(r, s).powi(2);
    let (two, one, none) = (1.0 - square, 2.0 * pq - square * (pp + qq), pq * pq - square * pp * qq);
    let inner = one * one - 4.0 * two * none;
    // Nearer than a degree to each other they tell no focal.
    if two < 3e-4 || inner < 0.0 {
        return Vec::new();
    }
    let focals = [-1.0, 1.0].map(|sign| (sign * inner.sqrt() - one) / (2.0 * two));
    let focals = focals.into_iter().filter(|&square| square > 0.0).map(f64::sqrt);
    let is_near = |focal: &f64| (ZOOM.recip()..ZOOM).contains(&(focal / camera.focal));
    let turn = |focal: f64| {
        let [x, y] = [p, q].map(|p| unit([p[0], p[1], focal]));
        Some(Turn::of_rotation(&leading([r, s], [x, y])?, (focal / camera.focal).ln()))
    };
    focals.filter(is_near).filter_map(turn).collect()
}

/// The rotation that leads two directions to two others with the same angle between them, as near as may be.
fn leading(from: [[f64; 3]; 2], to: [[f64; 3]; 2]) -> Option<[[f64; 3]; 3]> {
    let frame = |[a, b]: [[f64; 3]; 2]| {
        let (sum, difference) = (sum(a, b), sum(a, b.map(|c| -c)));
        let frame = [unit(sum), unit(difference), unit(cross(sum, difference))];
        frame.iter().flatten().all(|c| c.is_finite()).then_some(frame)
    };
    let (from, to) = (frame(from)?, frame(to)?);
    Some(std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| to[k][i] * from[k][j]).sum())))
}

/// The turn that all who agree tell together.
fn refined(camera: &Camera, seen: &[Seen], mut turn: Turn) -> Turn {
    for _ in 0..4 {
        let turned = turn.at(camera);
        let rows =
            seen.iter().filter(|seen| agrees(&turned, seen)).flat_map(|seen| rows(camera, &turn, seen));
        let rows: Vec<EdgeOffset> = rows.flatten().collect();
        let Some(fit) = TurnFit::new(&rows, Estimated::Turn) else { return turn };
        turn = turn.then(&fit.turn());
    }
    turn
}

/// Both coordinates of a match as offsets of two edges.
fn rows(camera: &Camera, turn: &Turn, seen: &Seen) -> [Option<EdgeOffset>; 2] {
    const ASIDE: f64 = 1e-5;
    let shown = |turn: &Turn| turn.at(camera).shown_undistorted(seen.sight.ray);
    let Some(here) = shown(turn) else { return [None; 2] };
    let mut by = [[0.0; Turn::SIZE]; 2];
    for k in 0..Turn::SIZE {
        let mut step = [0.0; Turn::SIZE];
        step[k] = ASIDE;
        let Some(there) = shown(&turn.then(&Turn::of(step))) else { return [None; 2] };
        by[0][k] = (there.u - here.u) / ASIDE;
        by[1][k] = (there.v - here.v) / ASIDE;
    }
    let off = [seen.new.u - here.u, seen.new.v - here.v];
    let row = |axis: usize| EdgeOffset {
        offset: off[axis],
        across: AXES[axis],
        sigma: 0.2 * seen.near,
        turn: by[axis],
        tone: [0.0; TONE],
        step: [0.0; STEP],
        block: seen.part,
        edge: None,
    };
    [0, 1].map(|axis| Some(row(axis)))
}

/// Numbers that look like chance and are the same on every machine (Marsaglia 2003).
pub(crate) struct Chance(pub(crate) u64);

impl Chance {
    pub(crate) fn below(&mut self, count: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % count as u64) as usize
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|c| c / length)
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
