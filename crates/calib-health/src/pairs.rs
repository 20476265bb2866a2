//! One person seen by two cameras at one moment: where the cameras put them, and what movements of either would do to
//! that.
//!
//! Of cameras a and b with `p` the places of the floor, `J` their derivatives by a movement, and movements `m` that the
//! calibrations do not know of, `pa - pb = -Ja ma + Jb mb + e`, with `e` of the covariance of both feet.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, Vector2};

use crate::moments::{Foot, Moments};
use crate::normal_equations::NormalEquations;
use calib_core::camera::Camera;
use calib_core::camera::Movement;

/// Unknowns of a pair: the movements of both cameras.
pub(crate) const UNKNOWNS: usize = 2 * Movement::SIZE;
/// Two views of one person differ so far, in metres, beside the noise of the boxes: each shows another side.
const BODY: f64 = 0.08;
/// Walking speed, in m/s, of what is not seen at the very same time.
const SPEED: f64 = 1.2;

/// A foot on the floor.
struct OnFloor {
    at: i64,
    point: Vector2<f64>,
    covariance: Matrix2<f64>,
    slopes: SMatrix<f64, 2, { Movement::SIZE }>,
}

impl OnFloor {
    fn of(camera: &Camera, foot: &Foot) -> Option<Self> {
        let point = camera.pixel_to_floor(foot.pixel, 0.0)?;
        let slopes = camera.floor_slopes(foot.pixel)?;
        let by_pixel = Matrix2::from(slopes.by_pixel);
        let covariance = by_pixel * by_pixel.transpose() * (foot.sigma * foot.sigma);
        let slopes = SMatrix::from(Movement::slopes(camera, &slopes));
        Some(Self { at: foot.at, point: Vector2::new(point.x, point.y), covariance, slopes })
    }
}

/// The covariance of the distance between two sightings of one person.
fn spread(a: &OnFloor, b: &OnFloor) -> Matrix2<f64> {
    let moved = SPEED * (a.at - b.at) as f64 / 1e9;
    a.covariance + b.covariance + Matrix2::identity() * (BODY * BODY + moved * moved)
}

/// Pairs of sightings that are of one person: each the nearest of the other, and no third nearly as near.
fn matches(a: &[OnFloor], b: &[OnFloor]) -> Vec<[usize; 2]> {
    /// People nearer to each other than this, in metres, may be one person; so may those within so many sigmas.
    const GATE: f64 = 1.0;
    const SIGMAS: f64 = 4.0;
    /// The next one must be so many times as far.
    const CLEAR: f64 = 1.6;
    let distance = |i: usize, j: usize| (a[i].point - b[j].point).norm();
    let mut found = Vec::new();
    for i in 0..a.len() {
        let nearest = (0..b.len()).min_by(|&j, &k| distance(i, j).total_cmp(&distance(i, k)));
        let Some(j) = nearest else { continue };
        let near = distance(i, j);
        let reach = GATE + SIGMAS * spread(&a[i], &b[j]).symmetric_eigenvalues().max().max(0.0).sqrt();
        let others = (0..b.len()).filter(|&k| k != j).map(|k| distance(i, k));
        let rivals = (0..a.len()).filter(|&k| k != i).map(|k| distance(k, j));
        let is_clear = others.chain(rivals).all(|other| other > CLEAR * near);
        if near < reach && is_clear {
            found.push([i, j]);
        }
    }
    found
}

/// What one match tells of the movements of both cameras.
fn evidence(a: &OnFloor, b: &OnFloor) -> Option<NormalEquations> {
    /// Sigmas beyond which a match counts less (Huber 1964): some are of two people, or of a foot that is hidden.
    const HUBER: f64 = 2.5;
    let inverse = spread(a, b).try_inverse()?;
    let difference = a.point - b.point;
    let distance = (difference.transpose() * inverse * difference).x.max(0.0).sqrt();
    let weighted = inverse * (HUBER / distance.max(HUBER));
    let mut by = SMatrix::<f64, 2, UNKNOWNS>::zeros();
    by.fixed_columns_mut::<{ Movement::SIZE }>(0).copy_from(&-a.slopes);
    by.fixed_columns_mut::<{ Movement::SIZE }>(Movement::SIZE).copy_from(&b.slopes);
    let information = by.transpose() * weighted * by;
    let score = by.transpose() * weighted * difference;
    Some(NormalEquations {
        information: DMatrix::from_column_slice(UNKNOWNS, UNKNOWNS, information.as_slice()),
        score: DVector::from_column_slice(score.as_slice()),
    })
}

/// What the moments of a window tell of every pair of cameras, and by how many matches.
pub(crate) fn of_window(
    cameras: &[Camera],
    moments: &Moments,
) -> BTreeMap<[usize; 2], (NormalEquations, u64)> {
    let mut pairs = BTreeMap::new();
    for moment in moments.iter() {
        let mut seen: BTreeMap<usize, Vec<OnFloor>> = BTreeMap::new();
        for foot in moment {
            let on_floor = cameras.get(foot.camera).and_then(|camera| OnFloor::of(camera, foot));
            seen.entry(foot.camera).or_default().extend(on_floor);
        }
        for (&a, of_a) in &seen {
            for (&b, of_b) in seen.range(a + 1..) {
                for [i, j] in matches(of_a, of_b) {
                    let Some(one) = evidence(&of_a[i], &of_b[j]) else { continue };
                    let (sum, count) =
                        pairs.entry([a, b]).or_insert_with(|| (NormalEquations::nothing(UNKNOWNS), 0));
                    sum.add(&one);
                    *count += 1;
                }
            }
        }
    }
    pairs
}
