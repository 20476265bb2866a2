//! Height of a person from the calibration of a camera, and its derivatives with respect to a movement of the
//! camera.
//!
//! The ray of the foot meets the floor at `P`. The head is above `P`, at the height at which its ray passes
//! closest to the vertical through `P`, seen from above. A rotation of the camera about the vertical changes
//! no height. Heights therefore determine three of the four parameters of a [`PanTiltZoom`].
//!
//! Normal equations collect the evidence of heights for one camera in one window of time. Each detection of a
//! person is a row. The features of a row are the factors of the coefficients that can change:
//!
//! - season (the constant 1; its coefficient is the mean log height, which changes with the season);
//! - tilt, roll and zoom (the negative derivative of the log height with respect to a movement, because the
//!   calibration stays fixed);
//! - padding, the margin in pixels that a detector adds around people (the inverse of the height of a person
//!   in the image).

use calib_core::camera::{Camera, PanTiltZoom, Pixel};
use nalgebra::{DMatrix, DVector};

use crate::normal_equations::NormalEquations;

/// Detection of a person in an image, in pixels of the calibrated image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Time, in nanoseconds since 1970.
    pub at: i64,
    /// Index of the camera.
    pub camera: usize,
    /// Centre of the lower edge of the bounding box, in pixels.
    pub foot: Pixel,
    /// Centre of the upper edge of the bounding box, in pixels; `None` if only the foot is known.
    pub head: Option<Pixel>,
    /// Width of the bounding box, in pixels; 0 if only the foot is known.
    pub width: f64,
    /// Identifier from a tracker, if any. It is unique for a person as long as the person is in view.
    pub person: Option<u64>,
}

impl Sighting {
    /// Returns the height of the bounding box, in pixels; a typical value if only the foot is known.
    pub(crate) fn box_height(&self) -> f64 {
        /// Height of the box of a person at a medium distance, in pixels.
        const TYPICAL_BOX_HEIGHT_PX: f64 = 150.0;
        self.head.map_or(TYPICAL_BOX_HEIGHT_PX, |head| (self.foot.v - head.v).max(1.0))
    }

    /// Returns the standard deviation of the foot, in pixels. It grows with the height of the box.
    pub(crate) fn foot_sigma(&self) -> f64 {
        /// Increase of the standard deviation per pixel of box height.
        const SIGMA_PER_BOX_HEIGHT: f64 = 0.03;
        /// Standard deviation of the foot of an infinitely small box, in pixels.
        const MIN_SIGMA_PX: f64 = 1.5;
        MIN_SIGMA_PX + SIGMA_PER_BOX_HEIGHT * self.box_height()
    }

    /// Whether the box touches the border of an image of this size and may not contain the whole person.
    pub(crate) fn is_cut(&self, [w, h]: [f64; 2]) -> bool {
        /// Distance from the image border within which a box counts as cut, in pixels.
        const BORDER_MARGIN_PX: f64 = 2.0;
        let Some(head) = self.head else { return false };
        let half = 0.5 * self.width;
        let (left, right) = (head.u.min(self.foot.u) - half, head.u.max(self.foot.u) + half);
        left < BORDER_MARGIN_PX
            || right > w - BORDER_MARGIN_PX
            || head.v < BORDER_MARGIN_PX
            || self.foot.v > h - BORDER_MARGIN_PX
    }
}

/// Indices of the rotation and zoom parameters that change measured heights of people: tilt, roll and zoom.
pub(crate) const HEIGHT_PARAMS: [usize; 3] = [PanTiltZoom::TILT, PanTiltZoom::ROLL, PanTiltZoom::ZOOM];
/// Number of columns of image cells; derivatives are constant in a cell.
const COLUMNS: usize = 32;
/// Number of rows of image cells.
const ROWS: usize = 24;
/// Height of the person for whom derivatives are computed, in metres.
const REFERENCE_HEIGHT_M: f64 = 1.7;

/// Measurement of the heights of people in the images of one camera.
#[derive(Clone, Debug)]
pub(crate) struct Stature {
    camera: Camera,
    /// Rotation matrix of the camera, with rows right, down and forward in world coordinates.
    axes: [[f64; 3]; 3],
    /// Width and height of the image, in pixels.
    size: [f64; 2],
    /// Reference person with the foot at the centre of every cell; `None` as in [`compute_reference_person`].
    cells: Vec<Option<ReferencePerson>>,
}

/// Person of reference height in a cell of the image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReferencePerson {
    /// Derivatives of the log height with respect to the parameters of [`HEIGHT_PARAMS`].
    pub(crate) slopes: [f64; 3],
    /// Height of the reference person in the image, in pixels. It replaces the height of the detected box,
    /// which depends on the height of the detected person.
    pub(crate) tall: f64,
}

impl Stature {
    pub(crate) fn new(camera: &Camera, size: [f64; 2]) -> Self {
        let bare = Self { camera: *camera, axes: camera.rotation(), size, cells: Vec::new() };
        let cell = |index: usize| {
            let share = [(index % COLUMNS) as f64 / COLUMNS as f64, (index / COLUMNS) as f64 / ROWS as f64];
            let [u, v] = [0, 1].map(|axis| size[axis] * (share[axis] + 0.5 / [COLUMNS, ROWS][axis] as f64));
            compute_reference_person(camera, Pixel { u, v })
        };
        Self { cells: (0..COLUMNS * ROWS).map(cell).collect(), ..bare }
    }

    /// Returns the natural logarithm of the height, in metres, of a person with these foot and head pixels.
    /// Returns `None` if the detection is not a person on the floor.
    pub(crate) fn log_height(&self, foot: Pixel, head: Pixel) -> Option<f64> {
        /// Range of plausible heights, in metres. Outside it the detection is not a person, or not on the
        /// floor.
        const HEIGHT_RANGE_M: [f64; 2] = [0.3, 3.5];
        let [down, up] = [self.direction(foot)?, self.direction(head)?];
        let height = self.camera.position.z;
        let reach = -height / down[2];
        let level = up[0] * up[0] + up[1] * up[1];
        // Directly below the camera a head hides its foot.
        if reach <= 0.0 || level < 1e-3 {
            return None;
        }
        let along = reach * (down[0] * up[0] + down[1] * up[1]) / level;
        let tall = height + along * up[2];
        (along > 0.0 && tall > HEIGHT_RANGE_M[0] && tall < HEIGHT_RANGE_M[1]).then(|| tall.ln())
    }

    /// Returns the reference person near `foot`; `None` where a person cannot be on the floor, or would not be
    /// upright in the image.
    pub(crate) fn reference_person(&self, foot: Pixel) -> Option<ReferencePerson> {
        let cell = |value: f64, axis: usize, count: usize| {
            ((value / self.size[axis] * count as f64).max(0.0) as usize).min(count - 1)
        };
        self.cells[cell(foot.v, 1, ROWS) * COLUMNS + cell(foot.u, 0, COLUMNS)]
    }

    /// Returns the direction of the ray of a pixel in world coordinates, not normalised; `None` outside the
    /// lens.
    fn direction(&self, pixel: Pixel) -> Option<[f64; 3]> {
        let [x, y, ahead] = self.camera.lens.bearing(pixel)?;
        let [a, b] = [x / self.camera.focal, y / self.camera.focal];
        let [right, down, forward] = &self.axes;
        Some(std::array::from_fn(|i| a * right[i] + b * down[i] + ahead * forward[i]))
    }
}

/// Returns the reference person with the foot at a pixel, with numerical derivatives. Returns `None` if the person is
/// not visible. Also returns `None` where verticals of the scene are inclined by more than about 27 degrees in the
/// image. Directly below a ceiling camera, for example, foot and head are not at the lower and upper ends of a box.
fn compute_reference_person(camera: &Camera, foot: Pixel) -> Option<ReferencePerson> {
    /// Step of the numerical derivatives, in radians, or as a fraction of the focal length.
    const STEP: f64 = 1e-4;
    let floor = camera.pixel_to_floor(foot, 0.0)?;
    let head = camera.world_to_pixel(floor.at_height(REFERENCE_HEIGHT_M))?;
    if foot.v - head.v < 2.0 * (foot.u - head.u).abs() {
        return None;
    }
    let nudged = |parameter: usize, by: f64| {
        let mut movement = [0.0; PanTiltZoom::SIZE];
        movement[parameter] = by;
        let camera = PanTiltZoom::from_parameters(movement).apply_to(camera);
        let axes = camera.rotation();
        Stature { camera, axes, size: [1.0; 2], cells: Vec::new() }.log_height(foot, head)
    };
    let mut slopes = [0.0; 3];
    for (slope, parameter) in slopes.iter_mut().zip(HEIGHT_PARAMS) {
        *slope = (nudged(parameter, STEP)? - nudged(parameter, -STEP)?) / (2.0 * STEP);
    }
    Some(ReferencePerson { slopes, tall: foot.distance(head) })
}

/// Number of features of a row: season, tilt, roll, zoom and padding.
pub(crate) const FEATURES: usize = 5;
/// Number of entries in the upper triangle of the products of features, row by row.
pub(crate) const PACKED: usize = FEATURES * (FEATURES + 1) / 2;
/// Index of the season among the features.
pub(crate) const SEASON: usize = 0;
/// Index of the first parameter of [`HEIGHT_PARAMS`] among the features.
pub(crate) const MOVEMENT: usize = 1;
/// Height of a person in the image at which the padding feature is 1, in pixels.
const PADDING_SCALE_PX: f64 = 60.0;

/// Returns the index of the entry in row `i` and column `j` of a packed upper triangle, for `i <= j`.
pub(crate) const fn packed(i: usize, j: usize) -> usize {
    i * FEATURES - i * (i + 1) / 2 + j
}

/// Returns the features of a row from the reference person at the foot.
pub(crate) fn features(
    ReferencePerson { slopes: [tilt, roll, zoom], tall }: ReferencePerson,
) -> [f64; FEATURES] {
    [1.0, -tilt, -roll, -zoom, PADDING_SCALE_PX / tall]
}

/// Normal equations of the coefficients of season, tilt, roll, zoom and padding (see the module
/// documentation), summed over tracks.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Heights {
    /// Upper triangle of the information matrix, row by row.
    pub(crate) information: [f64; PACKED],
    /// Right-hand side of the normal equations.
    pub(crate) score: [f64; FEATURES],
    /// Sum of the outer products of the track scores, upper triangle row by row. The scores are relative to
    /// the median height of all people. The sum estimates the true variance of the score, independently of
    /// the claimed information (White 1982).
    pub(crate) squares: [f64; PACKED],
    /// Number of tracks.
    pub(crate) tracks: u64,
}

impl Heights {
    pub(crate) fn add(&mut self, other: &Self) {
        self.information.iter_mut().zip(&other.information).for_each(|(a, b)| *a += b);
        self.score.iter_mut().zip(&other.score).for_each(|(a, b)| *a += b);
        self.squares.iter_mut().zip(&other.squares).for_each(|(a, b)| *a += b);
        self.tracks += other.tracks;
    }

    /// Creates the normal equations of one track; `middle` is the median log height at the camera.
    pub(crate) fn of_track(information: [f64; PACKED], score: [f64; FEATURES], middle: f64) -> Self {
        // The first feature is 1. Its column is therefore the derivative of the score with respect to the
        // median.
        let about: [f64; FEATURES] = std::array::from_fn(|i| score[i] - middle * information[packed(0, i)]);
        let mut squares = [0.0; PACKED];
        for i in 0..FEATURES {
            (i..FEATURES).for_each(|j| squares[packed(i, j)] = about[i] * about[j]);
        }
        Self { information, score, squares, tracks: 1 }
    }

    /// Returns the normal equations with the full information matrix.
    pub(crate) fn equations(&self) -> NormalEquations {
        NormalEquations {
            information: symmetric_matrix(&self.information),
            score: DVector::from_row_slice(&self.score),
        }
    }

    /// Returns the estimate of the true variance of the score.
    pub(crate) fn variance(&self) -> DMatrix<f64> {
        symmetric_matrix(&self.squares)
    }
}

/// Returns the symmetric matrix with this packed upper triangle.
fn symmetric_matrix(upper: &[f64; PACKED]) -> DMatrix<f64> {
    DMatrix::from_fn(FEATURES, FEATURES, |i, j| upper[packed(i.min(j), i.max(j))])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::tests::any_camera;

    proptest! {
        #[test]
        fn height_of_a_projected_person_is_recovered(camera in any_camera(), u in 0.0..1920.0_f64, v in 300.0..1080.0_f64) {
            let Some(floor) = camera.pixel_to_floor(Pixel { u, v }, 0.0) else { return Ok(()) };
            let range = floor.distance(camera.position.on_floor());
            prop_assume!(range < 40.0 && range > 1.0 && camera.position.z > 2.5);
            let Some(head) = camera.world_to_pixel(floor.at_height(1.63)) else { return Ok(()) };
            let found = Stature::new(&camera, [1920.0, 1080.0]).log_height(Pixel { u, v }, head);
            prop_assert!(found.is_some_and(|y| (y - 1.63_f64.ln()).abs() < 1e-6), "{found:?}");
        }
    }

    #[test]
    fn downward_tilt_reduces_heights_and_pan_does_not() {
        let camera = crate::tests::camera();
        let size = [1920.0, 1080.0];
        let by = Stature::new(&camera, size).reference_person(Pixel::new(960.0, 500.0)).unwrap().slopes;
        // A calibrated pitch that is too large makes rays too steep: the foot is too near and the head too
        // low.
        assert!(by[0] < -0.5 && by[1].abs() < 0.2, "{by:?}");
        let panned = PanTiltZoom { pan: 0.3, ..PanTiltZoom::default() }.apply_to(&camera);
        let of = |camera: &Camera| {
            Stature::new(camera, size).log_height(Pixel::new(900.0, 700.0), Pixel::new(905.0, 400.0)).unwrap()
        };
        assert!((of(&panned) - of(&camera)).abs() < 1e-12);
    }

    #[test]
    fn upper_triangle_is_packed_row_by_row() {
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
