//! How tall a person stands before a camera, by its calibration, and what a movement of the camera does to that.
//!
//! The foot's ray meets the floor at `P`; the head stands above it where the head's ray passes the vertical of `P`
//! nearest, seen from above. A turn about the vertical of the camera changes no height at all: of the four parameters
//! of a [`Movement`] three can be seen in heights.
//!
//! A person as a camera shows them.
//!
//! What heights of people tell of one camera in one window of time: normal equations, which add up.
//!
//! Features of a row are those whose coefficients can change: the season (1), tilt, roll and zoom (by how a movement
//! changes the height, the other way round: the calibration is what stayed), and the pixels that a detector draws
//! around people (the inverse of how tall people are in the image there).

use calib_core::camera::{Camera, Movement, Pixel};
use nalgebra::{DMatrix, DVector};

use crate::normal_equations::NormalEquations;

/// A person as a camera shows them, in pixels of its still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Nanoseconds since 1970.
    pub at: i64,
    /// Index of the camera.
    pub camera: usize,
    /// The middle of the lower edge of the box.
    pub foot: Pixel,
    /// The middle of its upper edge; `None` where only the foot is known.
    pub head: Option<Pixel>,
    /// Width of the box; 0 where only the foot is known.
    pub width: f64,
    /// By what a tracker calls them, where it does: one number, one person, for as long as they are in view.
    pub person: Option<u64>,
}

impl Sighting {
    /// Height of the box; without a box that of a person at a middle distance.
    pub(crate) fn tall(&self) -> f64 {
        /// Pixels.
        const USUAL: f64 = 150.0;
        self.head.map_or(USUAL, |head| (self.foot.v - head.v).max(1.0))
    }

    /// Standard deviation of the foot, in pixels: boxes are drawn the worse the larger they are.
    pub(crate) fn foot_sigma(&self) -> f64 {
        /// Share of the height of a box.
        const OF_BOX: f64 = 0.03;
        /// Pixels.
        const LEAST: f64 = 1.5;
        LEAST + OF_BOX * self.tall()
    }

    /// Whether the box ends at the border of an image of this size, and so may not hold the whole person.
    pub(crate) fn is_cut(&self, [w, h]: [f64; 2]) -> bool {
        /// Pixels.
        const MARGIN: f64 = 2.0;
        let Some(head) = self.head else { return false };
        let half = 0.5 * self.width;
        let (left, right) = (head.u.min(self.foot.u) - half, head.u.max(self.foot.u) + half);
        left < MARGIN || right > w - MARGIN || head.v < MARGIN || self.foot.v > h - MARGIN
    }
}

/// Parameters of a movement that change heights: tilt, roll and zoom.
pub(crate) const SEEN: [usize; 3] = [Movement::TILT, Movement::ROLL, Movement::ZOOM];
/// Cells of an image over which derivatives count as constant.
const COLUMNS: usize = 32;
const ROWS: usize = 24;
/// Of whom derivatives are taken, in metres.
const USUAL: f64 = 1.7;

/// Measures heights with one camera.
#[derive(Clone, Debug)]
pub(crate) struct Stature {
    camera: Camera,
    /// Rows right, down, forward.
    axes: [[f64; 3]; 3],
    size: [f64; 2],
    /// For feet in every cell; `None` where nobody stands.
    cells: Vec<Option<Cell>>,
}

/// People of usual height who stand in a part of the image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    /// Derivatives of the logarithm of the height, by the parameters of [`SEEN`].
    pub(crate) slopes: [f64; 3],
    /// How tall they are in the image, in pixels. Not the height of a box: that says how tall the person is.
    pub(crate) tall: f64,
}

impl Stature {
    pub(crate) fn new(camera: &Camera, size: [f64; 2]) -> Self {
        let bare = Self { camera: *camera, axes: camera.rotation(), size, cells: Vec::new() };
        let cell = |index: usize| {
            let share = [(index % COLUMNS) as f64 / COLUMNS as f64, (index / COLUMNS) as f64 / ROWS as f64];
            let [u, v] = [0, 1].map(|axis| size[axis] * (share[axis] + 0.5 / [COLUMNS, ROWS][axis] as f64));
            usual(camera, Pixel { u, v })
        };
        Self { cells: (0..COLUMNS * ROWS).map(cell).collect(), ..bare }
    }

    /// Logarithm of the height in metres of who stands at `foot`; `None` where that is no person on the floor.
    pub(crate) fn log_height(&self, foot: Pixel, head: Pixel) -> Option<f64> {
        /// Metres: what is smaller or larger is no person, or does not stand on the floor.
        const PEOPLE: [f64; 2] = [0.3, 3.5];
        let [down, up] = [self.direction(foot)?, self.direction(head)?];
        let height = self.camera.position.z;
        let reach = -height / down[2];
        let level = up[0] * up[0] + up[1] * up[1];
        // Straight below the camera a head hides its foot.
        if reach <= 0.0 || level < 1e-3 {
            return None;
        }
        let along = reach * (down[0] * up[0] + down[1] * up[1]) / level;
        let tall = height + along * up[2];
        (along > 0.0 && tall > PEOPLE[0] && tall < PEOPLE[1]).then(|| tall.ln())
    }

    /// Who stands about there usually; `None` where nobody does.
    pub(crate) fn usual(&self, foot: Pixel) -> Option<Cell> {
        let cell = |value: f64, axis: usize, count: usize| {
            ((value / self.size[axis] * count as f64).max(0.0) as usize).min(count - 1)
        };
        self.cells[cell(foot.v, 1, ROWS) * COLUMNS + cell(foot.u, 0, COLUMNS)]
    }

    /// The ray of a pixel, of any length.
    fn direction(&self, pixel: Pixel) -> Option<[f64; 3]> {
        let [x, y, ahead] = self.camera.lens.bearing(pixel)?;
        let [a, b] = [x / self.camera.focal, y / self.camera.focal];
        let [right, down, forward] = &self.axes;
        Some(std::array::from_fn(|i| a * right[i] + b * down[i] + ahead * forward[i]))
    }
}

/// A person of usual height with the foot at a pixel; derivatives by differences. None where uprights lie rather than
/// stand in the image, as around the foot of a camera under a ceiling: foot and head are not at the ends of a box there.
fn usual(camera: &Camera, foot: Pixel) -> Option<Cell> {
    /// Radians, and of the focal.
    const STEP: f64 = 1e-4;
    let floor = camera.pixel_to_floor(foot, 0.0)?;
    let head = camera.world_to_pixel(floor.at_height(USUAL))?;
    if foot.v - head.v < 2.0 * (foot.u - head.u).abs() {
        return None;
    }
    let nudged = |parameter: usize, by: f64| {
        let mut movement = [0.0; Movement::SIZE];
        movement[parameter] = by;
        let camera = Movement::of(movement).applied(camera);
        let axes = camera.rotation();
        Stature { camera, axes, size: [1.0; 2], cells: Vec::new() }.log_height(foot, head)
    };
    let mut slopes = [0.0; 3];
    for (slope, parameter) in slopes.iter_mut().zip(SEEN) {
        *slope = (nudged(parameter, STEP)? - nudged(parameter, -STEP)?) / (2.0 * STEP);
    }
    Some(Cell { slopes, tall: foot.distance(head) })
}

/// Number of features.
pub(crate) const FEATURES: usize = 5;
/// Upper triangle of their products, row by row.
pub(crate) const PACKED: usize = FEATURES * (FEATURES + 1) / 2;
/// Index of the season.
pub(crate) const SEASON: usize = 0;
/// Index of the first of [`SEEN`](crate::stature::SEEN).
pub(crate) const MOVED: usize = 1;
/// Height in the image that has one unit of the last feature, in pixels.
const PADDED: f64 = 60.0;

/// Index in an upper triangle, for `i <= j`.
pub(crate) const fn packed(i: usize, j: usize) -> usize {
    i * FEATURES - i * (i + 1) / 2 + j
}

/// The features of a row, by where the foot is.
pub(crate) fn features(Cell { slopes: [tilt, roll, zoom], tall }: Cell) -> [f64; FEATURES] {
    [1.0, -tilt, -roll, -zoom, PADDED / tall]
}

/// Normal equations of the features.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Heights {
    /// Upper triangle, row by row.
    pub(crate) information: [f64; PACKED],
    pub(crate) score: [f64; FEATURES],
    /// Squares of the scores of tracks about the middle of all people: their true variance, whatever they claim (White
    /// 1982).
    pub(crate) squares: [f64; PACKED],
    pub(crate) tracks: u64,
}

impl Heights {
    pub(crate) fn add(&mut self, other: &Self) {
        self.information.iter_mut().zip(&other.information).for_each(|(a, b)| *a += b);
        self.score.iter_mut().zip(&other.score).for_each(|(a, b)| *a += b);
        self.squares.iter_mut().zip(&other.squares).for_each(|(a, b)| *a += b);
        self.tracks += other.tracks;
    }

    /// One track, whose people stand about a middle height.
    pub(crate) fn of_track(information: [f64; PACKED], score: [f64; FEATURES], middle: f64) -> Self {
        // The first feature is 1: its column is what the middle adds to the score.
        let about: [f64; FEATURES] = std::array::from_fn(|i| score[i] - middle * information[packed(0, i)]);
        let mut squares = [0.0; PACKED];
        for i in 0..FEATURES {
            (i..FEATURES).for_each(|j| squares[packed(i, j)] = about[i] * about[j]);
        }
        Self { information, score, squares, tracks: 1 }
    }

    pub(crate) fn equations(&self) -> NormalEquations {
        NormalEquations { information: full(&self.information), score: DVector::from_row_slice(&self.score) }
    }

    /// The true variance of the score.
    pub(crate) fn variance(&self) -> DMatrix<f64> {
        full(&self.squares)
    }
}

fn full(upper: &[f64; PACKED]) -> DMatrix<f64> {
    DMatrix::from_fn(FEATURES, FEATURES, |i, j| upper[packed(i.min(j), i.max(j))])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::tests::any_camera;

    proptest! {
        #[test]
        fn a_person_is_as_tall_as_they_stand(camera in any_camera(), u in 0.0..1920.0_f64, v in 300.0..1080.0_f64) {
            let Some(floor) = camera.pixel_to_floor(Pixel { u, v }, 0.0) else { return Ok(()) };
            let range = floor.distance(camera.position.on_floor());
            prop_assume!(range < 40.0 && range > 1.0 && camera.position.z > 2.5);
            let Some(head) = camera.world_to_pixel(floor.at_height(1.63)) else { return Ok(()) };
            let found = Stature::new(&camera, [1920.0, 1080.0]).log_height(Pixel { u, v }, head);
            prop_assert!(found.is_some_and(|y| (y - 1.63_f64.ln()).abs() < 1e-6), "{found:?}");
        }
    }

    #[test]
    fn a_camera_turned_down_makes_people_smaller_and_a_pan_does_not() {
        let camera = crate::tests::camera();
        let size = [1920.0, 1080.0];
        let by = Stature::new(&camera, size).usual(Pixel::new(960.0, 500.0)).unwrap().slopes;
        // Whoever trusts a pitch that is too large takes rays for steeper than they are: foot nearer, head lower.
        assert!(by[0] < -0.5 && by[1].abs() < 0.2, "{by:?}");
        let panned = Movement { pan: 0.3, ..Movement::default() }.applied(&camera);
        let of = |camera: &Camera| {
            Stature::new(camera, size).log_height(Pixel::new(900.0, 700.0), Pixel::new(905.0, 400.0)).unwrap()
        };
        assert!((of(&panned) - of(&camera)).abs() < 1e-12);
    }

    #[test]
    fn the_upper_triangle_is_packed_row_by_row() {
        let mut next = 0;
        for i in 0..FEATURES {
            for j in i..FEATURES {
                assert_eq!(packed(i, j), next);
                next += 1;
            }
        }
        assert_eq!(next, PACKED);
    }
}
