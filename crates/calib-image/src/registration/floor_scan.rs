//! Floor scan of an image: how far the visible floor reaches, by direction.
//!
//! The floor is the surface of the most frequent colour in the rectified image. From the floor point below the
//! camera, a ray runs over the floor in each direction until the colour changes: at the foot of a wall, a shelf or
//! a person. The result resembles the scan of a horizontal range finder, and a floor plan predicts it.

use calib_core::Pixel;
use nalgebra::{Matrix3, Vector3};

use crate::edges::line_segments;
use crate::registration::lab_image::LabImage;
use crate::registration::local_view::{LocalView, View};

/// Largest distance of a floor point from its camera, in heights of the camera.
const MAX_DISTANCE: f64 = 4.0;
/// Smallest downward component of a unit direction that meets the floor.
const MIN_FALL: f64 = 0.02;
/// Number of bins of a direction modulo 90 degrees.
const DIRECTION_BINS: usize = 90;

/// Ray over the visible floor, in the local frame of a camera. Distances are in heights of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FloorRay {
    /// Direction, counter-clockwise from the direction ahead of the camera, in radians.
    pub(crate) heading: f64,
    /// Distance of the first floor point in the image.
    pub(crate) start: f64,
    /// Distance of the last floor point.
    pub(crate) end: f64,
    /// Whether an obstacle ends the ray. Otherwise it ends at the border of the image or at the largest distance.
    pub(crate) is_blocked: bool,
}

/// Visible floor of one image.
#[derive(Clone, Debug, Default)]
pub(crate) struct FloorScan {
    /// Rays, ordered by heading.
    pub(crate) rays: Vec<FloorRay>,
    /// Most frequent direction of edges on the floor modulo 90 degrees, counter-clockwise from the direction ahead of
    /// the camera, in radians. `None` if no direction is frequent.
    pub(crate) edge_direction: Option<f64>,
}

impl FloorScan {
    /// Measures the visible floor. `image` is the small image of the view.
    pub(crate) fn new(view: &View, local: &LocalView, image: &LabImage) -> Self {
        /// Standard deviation of the blur, in pixels of the small image. It removes joints between tiles.
        const BLUR_PX: f32 = 2.0;
        /// Angle between two rays, in degrees.
        const RAY_STEP_DEG: f64 = 1.5;
        let colours = image.blurred(BLUR_PX);
        let Some(floor) = FloorColour::new(&floor_samples(local, image, &colours)) else {
            return Self::default();
        };
        let count = (360.0 / RAY_STEP_DEG) as usize;
        let heading = |index: usize| (index as f64 * RAY_STEP_DEG - 180.0).to_radians();
        let is_floor = |index: usize| image.is_visible[index] && floor.contains(colours[index]);
        let rays = (0..count).filter_map(|index| ray(local, image, &is_floor, heading(index))).collect();
        Self { rays, edge_direction: edge_direction(view, local) }
    }
}

/// Returns colours of the pixels whose floor points are within the largest distance. Each sample represents an equal
/// area of the floor; far areas have fewer samples.
fn floor_samples(local: &LocalView, image: &LabImage, colours: &[[f32; 3]]) -> Vec<[f32; 3]> {
    /// Number of samples.
    const SAMPLES: f64 = 3000.0;
    /// Distance above which the weight of a pixel is constant, in heights of the camera. Far areas are often not floor.
    const MAX_WEIGHTED: f64 = 2.5;
    let weight = |index: usize| {
        if !image.is_visible[index] {
            return 0.0;
        }
        // The floor area of a pixel is proportional to the third power of the distance.
        floor_point(local, image, index).map_or(0.0, |[x, y]| x.hypot(y).min(MAX_WEIGHTED).powi(3))
    };
    let weights: Vec<f64> = (0..colours.len()).map(weight).collect();
    let step = weights.iter().sum::<f64>() / SAMPLES;
    let mut samples = Vec::new();
    let mut sum = 0.0;
    for (weight, colour) in weights.iter().zip(colours) {
        sum += weight;
        while step > 0.0 && sum >= step {
            sum -= step;
            samples.push(*colour);
        }
    }
    samples
}

/// Returns the floor point of a pixel of the small image, if it is not farther away than the largest distance.
fn floor_point(local: &LocalView, image: &LabImage, index: usize) -> Option<[f64; 2]> {
    let [x, y] = [index % image.size[0], index / image.size[0]].map(|i| (i as f64 + 0.5) / image.scale);
    floor_of(local, Pixel::new(x, y)).filter(|[x, y]| x.hypot(*y) < MAX_DISTANCE)
}

/// Returns the floor point of a raw pixel, in the local frame.
fn floor_of(local: &LocalView, pixel: Pixel) -> Option<[f64; 2]> {
    let [x, y, z] = local.direction(pixel)?;
    (z < -MIN_FALL).then(|| [x / -z, y / -z])
}

/// Normal distribution of the colour of the floor, in Lab with reduced lightness.
struct FloorColour {
    mean: Vector3<f32>,
    inverse: Matrix3<f32>,
}

impl FloorColour {
    /// Finds the most frequent colour. Returns `None` without samples.
    fn new(samples: &[[f32; 3]]) -> Option<Self> {
        /// Every n-th sample is tried as the centre.
        const TRIED: usize = 20;
        /// Radius around a tried centre in which samples are counted, in units of Lab with reduced lightness.
        const SEARCH_RADIUS: f32 = 6.0;
        /// Radius of the samples that determine mean and covariance, in the same units.
        const RADIUS: f32 = 8.0;
        /// Number of rounds of the mean shift.
        const ROUNDS: usize = 5;
        /// Variances that are added to the covariance: shadows change the lightness, and lamps the hue.
        const ADDED_VARIANCES: [f32; 3] = [32.0, 2.0, 2.0];
        let vector = |colour: &[f32; 3]| Vector3::from(*colour);
        let near = |centre: Vector3<f32>, radius: f32| {
            samples.iter().map(vector).filter(move |colour| (colour - centre).norm() < radius)
        };
        let tried = samples.iter().step_by(TRIED).map(vector);
        let mut mean = tried.max_by_key(|&centre| near(centre, SEARCH_RADIUS).count())?;
        for _ in 0..ROUNDS {
            let count = near(mean, RADIUS).count();
            mean = near(mean, RADIUS).sum::<Vector3<f32>>() / count.max(1) as f32;
        }
        let mut covariance = Matrix3::from_diagonal(&Vector3::from(ADDED_VARIANCES));
        let count = near(mean, RADIUS).count().max(1) as f32;
        near(mean, RADIUS)
            .for_each(|colour| covariance += (colour - mean) * (colour - mean).transpose() / count);
        Some(Self { mean, inverse: covariance.try_inverse()? })
    }

    /// Whether a colour is within three standard deviations.
    fn contains(&self, colour: [f32; 3]) -> bool {
        let from_mean = Vector3::from(colour) - self.mean;
        (from_mean.transpose() * self.inverse * from_mean).x < 9.0
    }
}

/// Follows the floor from the camera in one direction. Returns `None` if the image shows no floor there.
fn ray(
    local: &LocalView,
    image: &LabImage,
    is_floor: &dyn Fn(usize) -> bool,
    heading: f64,
) -> Option<FloorRay> {
    /// Distance between two points of a ray, in heights of the camera.
    const STEP: f64 = 0.02;
    /// Number of consecutive points whose share of floor decides whether a ray goes on. Thin lines on the floor do not
    /// end a ray.
    const WINDOW: usize = 8;
    /// Smallest share of floor in the first window.
    const MIN_FIRST_SHARE: f64 = 0.85;
    /// Smallest share of floor in the later windows.
    const MIN_SHARE: f64 = 0.2;
    let (sin, cos) = heading.sin_cos();
    let distance = |index: usize| 0.1 + index as f64 * STEP;
    let pixel = |index: usize| {
        let at = distance(index);
        let pixel = local.project([-sin * at, cos * at, 0.0])?;
        let [x, y] = [pixel.u, pixel.v].map(|at| (at * image.scale) as usize);
        (x < image.size[0] && y < image.size[1]).then_some(y * image.size[0] + x)
    };
    let count = ((MAX_DISTANCE - distance(0)) / STEP) as usize;
    let first = (0..count).find(|&index| pixel(index).is_some())?;
    let points: Vec<bool> = (first..count).map_while(pixel).map(is_floor).collect();
    let share = |at: usize| {
        points[at..at + WINDOW].iter().filter(|is_floor| **is_floor).count() as f64 / WINDOW as f64
    };
    let windows = 0..(points.len() + 1).saturating_sub(WINDOW);
    let start = windows.clone().find(|&at| share(at) > MIN_FIRST_SHARE)?;
    let end = windows.clone().skip(start).find(|&at| share(at) <= MIN_SHARE);
    let last = match end {
        Some(end) => (start..end).rev().find(|&at| points[at]).unwrap_or(start) + 1,
        None => points.len() - 1,
    };
    Some(FloorRay {
        heading,
        start: distance(first + start),
        end: distance(first + last),
        is_blocked: end.is_some(),
    })
}

/// Returns the most frequent direction of edges on the floor.
fn edge_direction(view: &View, local: &LocalView) -> Option<f64> {
    /// Smallest length of an edge, as a fraction of the image width.
    const MIN_LENGTH: f64 = 0.02;
    /// Cosine of the angle between an edge and its direction from the camera, above which the edge is ignored. Vertical
    /// edges of objects point away from the camera.
    const MAX_RADIAL: f64 = 0.97;
    let scale = f64::from(view.size_px[0]) / f64::from(view.image.width().max(1));
    let min_length = MIN_LENGTH * f64::from(view.image.width());
    let on_floor = |pixel: Pixel| {
        floor_of(local, Pixel::new(scale * pixel.u, scale * pixel.v))
            .filter(|[x, y]| x.hypot(*y) < MAX_DISTANCE)
    };
    let segments = line_segments(view.image);
    let directions = segments.iter().filter(|segment| segment.length() > min_length).filter_map(|segment| {
        let [a, b] = [on_floor(segment.ends[0])?, on_floor(segment.ends[1])?];
        let along = [b[0] - a[0], b[1] - a[1]];
        let length = along[0].hypot(along[1]);
        let middle = [a[0] + b[0], a[1] + b[1]];
        let radial = (along[0] * middle[0] + along[1] * middle[1]) / (length * middle[0].hypot(middle[1]));
        // The local y axis points ahead.
        (radial.abs() < MAX_RADIAL).then(|| ((-along[0]).atan2(along[1]), length.min(1.0)))
    });
    dominant_direction(directions)
}

/// Returns the most frequent of weighted directions (radians) modulo 90 degrees, from 0 to pi / 2. Returns `None` if no
/// direction is frequent.
pub(crate) fn dominant_direction(directions: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    /// Half the width of the peak, in bins.
    const REACH: usize = 3;
    /// Smallest share of the weight in the peak. Uniform directions have a share of 0.08.
    const MIN_SHARE: f64 = 0.2;
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut bins = [(0.0, 0.0); DIRECTION_BINS];
    let mut total = 0.0;
    for (direction, weight) in directions.filter(|(direction, weight)| direction.is_finite() && *weight > 0.0)
    {
        let place = direction.rem_euclid(quarter) / quarter * DIRECTION_BINS as f64;
        let bin = (place as usize).min(DIRECTION_BINS - 1);
        bins[bin] = (bins[bin].0 + weight, bins[bin].1 + weight * (place - bin as f64));
        total += weight;
    }
    // Sum of the weights around a bin, and sum of their weighted distances from its start, in bins.
    let peak = |centre: usize| {
        let around =
            (0..=2 * REACH).map(|i| (i, bins[(centre + DIRECTION_BINS + i - REACH) % DIRECTION_BINS]));
        around.fold((0.0, 0.0), |(sum, moment), (i, (weight, offset))| {
            (sum + weight, moment + weight * (i as f64 - REACH as f64) + offset)
        })
    };
    let (centre, (weight, moment)) =
        (0..DIRECTION_BINS).map(|bin| (bin, peak(bin))).max_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    let place = centre as f64 + moment / weight;
    (weight > MIN_SHARE * total).then(|| (place / DIRECTION_BINS as f64 * quarter).rem_euclid(quarter))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dominant_direction_wraps_at_a_quarter_turn() {
        let directions = [0.01, -0.01, 1.58, 3.15, 0.7, 1.1, 0.4].map(|direction| (direction, 1.0));
        let found = dominant_direction(directions.into_iter()).unwrap();
        let off = (found + 0.8).rem_euclid(std::f64::consts::FRAC_PI_2) - 0.8;
        assert!(off.abs() < 0.01, "{off}");
        assert_eq!(dominant_direction((0..900).map(|i| (f64::from(i) * 0.01, 1.0))), None);
        assert_eq!(dominant_direction(std::iter::empty()), None);
    }
}
