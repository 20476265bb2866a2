//! Snapping of annotated lines to image edges, to a fraction of a pixel.
//!
//! Under a fisheye lens, a straight line is snapped to the curved image of a straight edge.

use calib_core::floor::annotated_line_curve;
use calib_core::{Lens, Pixel};
use image::RgbImage;

/// Largest number of samples along a line.
pub(crate) const MAX_SAMPLES: usize = 160;
/// Largest distance between a line and an edge for snapping, in image pixels at any zoom of the view. Edges
/// near the cursor are offered within the same distance.
pub const SNAP_RADIUS_PX: f64 = 8.0;
/// Search radius across a line, in steps of one pixel: [`SNAP_RADIUS_PX`].
const SNAP_RADIUS_STEPS: i32 = SNAP_RADIUS_PX as i32;
/// Largest distance of a sample from its edge, in pixels; a farther sample belongs to another edge.
pub(crate) const MAX_INLIER_DISTANCE_PX: f64 = 1.0;
/// Smallest fraction of the samples of a line that must be on one edge.
pub(crate) const MIN_COVERED_FRACTION: f64 = 0.5;
/// Smallest brightness gradient of an edge, in grey levels per pixel.
const MIN_GRADIENT: f64 = 4.0;

/// Interpolates the brightness at raw pixel coordinates, 0 to 255; `None` outside the image.
pub(crate) fn brightness(image: &RgbImage, u: f64, v: f64) -> Option<f64> {
    let (x, y) = (u - 0.5, v - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let is_inside =
        x0 >= 0.0 && y0 >= 0.0 && x0 + 1.0 < f64::from(image.width()) && y0 + 1.0 < f64::from(image.height());
    if !is_inside {
        return None;
    }
    let at = |dx: u32, dy: u32| {
        let [r, g, b] = image.get_pixel(x0 as u32 + dx, y0 as u32 + dy).0.map(f64::from);
        0.299 * r + 0.587 * g + 0.114 * b
    };
    let (s, t) = (x - x0, y - y0);
    Some((1.0 - t) * ((1.0 - s) * at(0, 0) + s * at(1, 0)) + t * ((1.0 - s) * at(0, 1) + s * at(1, 1)))
}

/// Edge found along a line.
pub(crate) struct FoundEdge {
    /// Ends of the line after snapping to the edge, in raw pixels.
    pub(crate) ends: [Pixel; 2],
    /// RMS distance of the samples from the edge, in pixels.
    pub(crate) rms: f64,
    /// Length of the line covered by the edge, in pixels.
    pub(crate) covered_length: f64,
    /// Samples `[s, t]` along and across the line before snapping, in pixels.
    pub(crate) samples: Vec<[f64; 2]>,
    /// Number of places at which a sample was searched.
    pub(crate) searched: usize,
}

/// Snaps a line, given by its ends in raw pixels, to the straight edge along it. Returns `None` if no edge is
/// found within [`SNAP_RADIUS_PX`].
#[must_use]
pub fn snap_line(image: &RgbImage, line: [Pixel; 2]) -> Option<[Pixel; 2]> {
    find_edge_along(image, line).map(|found| found.ends)
}

/// Finds the straight edge along a line; `None` if no edge is found within [`SNAP_RADIUS_PX`].
///
/// At samples along the line, the steepest brightness change across the line is located to a fraction of a
/// pixel. All changes must have the same sign. A straight line is fitted to the consistent samples.
pub(crate) fn find_edge_along(image: &RgbImage, [a, b]: [Pixel; 2]) -> Option<FoundEdge> {
    let length = a.distance(b);
    if !(4.0..1e5).contains(&length) {
        return None;
    }
    let (along, count) =
        ([(b.u - a.u) / length, (b.v - a.v) / length], (length as usize).clamp(8, MAX_SAMPLES));
    let across = [-along[1], along[0]];
    let slope = |s: f64, t: f64| {
        let at = |t: f64| {
            brightness(image, a.u + s * along[0] + t * across[0], a.v + s * along[1] + t * across[1])
        };
        Some(0.5 * (at(t + 1.0)? - at(t - 1.0)?))
    };
    // Sign of the edge: dark to bright, or bright to dark.
    let total: f64 = (0..count)
        .filter_map(|i| find_steepest_change(&slope, length * i as f64 / count as f64, None))
        .map(|(_, slope)| slope)
        .sum();
    let places: Vec<[f64; 2]> = (0..=count)
        .filter_map(|i| {
            let s = length * i as f64 / count as f64;
            find_steepest_change(&slope, s, Some(total.signum())).map(|(t, _)| [s, t])
        })
        .collect();
    let (offset, tilt, inliers) = robust_line(&places, (MIN_COVERED_FRACTION * count as f64) as usize)?;
    let shifted = |p: Pixel, s: f64| {
        let t = offset + tilt * s;
        Pixel::new(p.u + t * across[0], p.v + t * across[1])
    };
    let square: f64 = inliers.iter().map(|[s, t]| (t - offset - tilt * s).powi(2)).sum();
    Some(FoundEdge {
        ends: [shifted(a, 0.0), shifted(b, length)],
        rms: (square / inliers.len() as f64).sqrt(),
        covered_length: length * inliers.len() as f64 / (count + 1) as f64,
        samples: places,
        searched: count + 1,
    })
}

/// Snaps a polyline, in raw pixels, to the edge along it; `None` if no point is moved.
///
/// Two points are snapped to one straight edge. With more points, each is snapped separately, across the line
/// at this point, because distortion may curve a straight edge. Points without an edge stay in place.
#[must_use]
pub fn snap_polyline(image: &RgbImage, points: &[Pixel]) -> Option<Vec<Pixel>> {
    if let &[a, b] = points {
        return snap_line(image, [a, b]).map(Vec::from);
    }
    let mut pulled = points.to_vec();
    for (i, &point) in points.iter().enumerate() {
        let before = points[i.saturating_sub(1)];
        let after = points[(i + 1).min(points.len() - 1)];
        // Half the distance to the nearer neighbour, along the line through both neighbours.
        let reach = [before, after].map(|p| p.distance(point)).into_iter().filter(|&reach| reach > 0.0);
        let (half, apart) = (0.5 * reach.fold(f64::INFINITY, f64::min), before.distance(after));
        if !half.is_finite() || apart == 0.0 {
            continue;
        }
        let along = [(after.u - before.u) / apart * half, (after.v - before.v) / apart * half];
        let at = |share: f64| Pixel::new(point.u + share * along[0], point.v + share * along[1]);
        let ends =
            [if i == 0 { point } else { at(-1.0) }, if i + 1 == points.len() { point } else { at(1.0) }];
        let Some([a, b]) = snap_line(image, ends) else { continue };
        let middle = Pixel::new(0.5 * (a.u + b.u), 0.5 * (a.v + b.v));
        pulled[i] = if i == 0 {
            a
        } else if i + 1 == points.len() {
            b
        } else {
            middle
        };
    }
    (pulled != points).then_some(pulled)
}

/// Returns the position across a line with the steepest brightness change, in pixels, and the slope there, in
/// grey levels per pixel. With `sign`, only slopes of this sign count. `slope` returns the slope `s` pixels
/// along and `t` pixels across the line.
pub(crate) fn find_steepest_change(
    slope: &impl Fn(f64, f64) -> Option<f64>,
    s: f64,
    sign: Option<f64>,
) -> Option<(f64, f64)> {
    let size = |value: f64| sign.map_or(value.abs(), |sign| sign * value);
    let steps = (-SNAP_RADIUS_STEPS..=SNAP_RADIUS_STEPS)
        .filter_map(|t| Some((f64::from(t), slope(s, f64::from(t))?)));
    // Of equally strong edges, prefer the nearer one.
    let weight = |(t, value): (f64, f64)| size(value) * (1.0 - 0.05 * t.abs());
    let (t, peak) = steps.max_by(|&a, &b| weight(a).total_cmp(&weight(b)))?;
    if size(peak) < MIN_GRADIENT {
        return None;
    }
    let (before, after) = (size(slope(s, t - 1.0)?), size(slope(s, t + 1.0)?));
    let bend = before - 2.0 * size(peak) + after;
    let shift = if bend < -1e-9 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    Some((t + shift, peak))
}

/// Fits the line `t = offset + tilt s` with the most inliers to points `[s, t]`. Returns the offset, the tilt and the
/// inliers; `None` with fewer than `least` inliers.
///
/// A line is computed through every pair of a subset of the points. The candidate with the most inliers is fitted to
/// its inliers (Fischler and Bolles 1981, with all pairs instead of random ones). A fit to the points of two parallel
/// edges would be between the edges.
pub(crate) fn robust_line(points: &[[f64; 2]], least: usize) -> Option<(f64, f64, Vec<[f64; 2]>)> {
    /// Largest number of points whose pairs yield candidates.
    const MAX_CANDIDATE_POINTS: usize = 32;
    let step = points.len().div_ceil(MAX_CANDIDATE_POINTS).max(1);
    let few: Vec<[f64; 2]> = points.iter().copied().step_by(step).collect();
    let agree = |(offset, tilt): (f64, f64)| {
        points.iter().copied().filter(move |[s, t]| (t - offset - tilt * s).abs() <= MAX_INLIER_DISTANCE_PX)
    };
    let pairs = few.iter().enumerate().flat_map(|(i, a)| few[..i].iter().map(move |b| (a, b)));
    let proposed = pairs.filter(|(a, b)| a[0] != b[0]).map(|([s, t], [from, low])| {
        let tilt = (t - low) / (s - from);
        (low - tilt * from, tilt)
    });
    let best = proposed.max_by_key(|&line| agree(line).count())?;
    let inliers: Vec<[f64; 2]> = agree(best).collect();
    if inliers.len() < least.max(4) {
        return None;
    }
    let (offset, tilt) = fit_line(&inliers)?;
    Some((offset, tilt, inliers))
}

/// Fits the line `t = offset + tilt s` to points `[s, t]` by least squares; `None` if all `s` are equal.
fn fit_line(points: &[[f64; 2]]) -> Option<(f64, f64)> {
    let count = points.len() as f64;
    let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / count;
    let (ms, mt) = (mean(0), mean(1));
    let square: f64 = points.iter().map(|[s, _]| (s - ms).powi(2)).sum();
    let tilt = points.iter().map(|[s, t]| (s - ms) * (t - mt)).sum::<f64>() / square;
    (square > 0.0).then_some((mt - tilt * ms, tilt))
}

/// Snaps a line, given by its ends in raw pixels, to the edge along it; `None` if no edge is found. Under a
/// fisheye lens, the edge follows the image of the straight 3D line through the ends. Under other lenses, the
/// edge follows the straight line in the image.
///
/// Let `n` be the normal of the plane through the camera and the 3D line. `m` is the direction to the middle
/// of the line, and `s = n x m`. A nearby straight 3D line deviates from this line by the angle
/// `A cos a + B sin a`. Here `a` is the angle from `m` to a point of the line, and `A` and `B` are the
/// components of the deviation. `A` and `B` are fitted to the deviations of the inlier samples from the
/// curve, in pixels.
#[must_use]
pub fn snap_image_curve(image: &RgbImage, lens: &Lens, line: [Pixel; 2]) -> Option<[Pixel; 2]> {
    if !lens.distortion.is_wide() {
        return snap_line(image, line);
    }
    let curve = Curve::from_ends(lens, line)?;
    let count = (curve.length as usize).clamp(8, MAX_SAMPLES);
    let samples: Vec<Sample> = (0..=count).filter_map(|i| curve.sample(i as f64 / count as f64)).collect();
    let slope = |sample: &Sample, t: f64| {
        let at = |t: f64| {
            brightness(image, sample.at.u + t * sample.across[0], sample.at.v + t * sample.across[1])
        };
        Some(0.5 * (at(t + 1.0)? - at(t - 1.0)?))
    };
    let steepest = |sample: &Sample, sign: Option<f64>| {
        find_steepest_change(&|_: f64, t: f64| slope(sample, t), 0.0, sign)
    };
    // Sign of the edge: dark to bright, or bright to dark.
    let total: f64 = samples.iter().filter_map(|sample| steepest(sample, None)).map(|(_, slope)| slope).sum();
    let places: Vec<[f64; 3]> = samples
        .iter()
        .filter_map(|sample| {
            let (t, _) = steepest(sample, Some(total.signum()))?;
            let (sin, cos) = sample.angle.sin_cos();
            Some([sample.scale * cos, sample.scale * sin, t])
        })
        .collect();
    let by = fit_deviation(&places, (MIN_COVERED_FRACTION * count as f64) as usize)?;
    Some([curve.moved(line[0], by)?, curve.moved(line[1], by)?])
}

/// Image curve of the straight 3D line through two pixels.
struct Curve<'a> {
    lens: &'a Lens,
    /// Unit vector from the camera to the middle of the 3D line.
    middle: [f64; 3],
    /// Unit vector along the curve, 90° from `middle`.
    side: [f64; 3],
    /// Unit normal of the plane through the camera and the 3D line.
    normal: [f64; 3],
    /// Angle from the middle to each end, in radians.
    half: f64,
    /// Length of the curve in the image, in pixels.
    length: f64,
}

/// Sample on a [`Curve`].
struct Sample {
    at: Pixel,
    /// Unit vector in the image across the curve, towards the normal of the plane.
    across: [f64; 2],
    /// Angle from the middle of the curve, in radians.
    angle: f64,
    /// Scale across the curve, in pixels per radian.
    scale: f64,
}

impl<'a> Curve<'a> {
    /// Creates the curve between two raw pixels; `None` if the pixels do not determine a plane.
    fn from_ends(lens: &'a Lens, line: [Pixel; 2]) -> Option<Self> {
        /// Smallest accepted sine of the angle between the two rays. Parallel and opposite rays do not
        /// determine a plane.
        const MIN_RAY_SINE: f64 = 1e-3;
        let [a, b] = [ray(lens, line[0])?, ray(lens, line[1])?];
        let normal = unit(cross(a, b)).filter(|_| length(cross(a, b)) > MIN_RAY_SINE)?;
        let middle = unit(std::array::from_fn(|i| a[i] + b[i]))?;
        let curve = annotated_line_curve(lens, &line);
        let length: f64 = curve.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let half = 0.5 * dot(a, b).clamp(-1.0, 1.0).acos();
        let is_long = (4.0..1e5).contains(&length);
        is_long.then(|| Self { lens, middle, side: cross(normal, middle), normal, half, length })
    }

    /// Returns the sample at a fraction of the angle from the first end to the second; `None` outside the
    /// lens.
    fn sample(&self, share: f64) -> Option<Sample> {
        /// Step of the finite differences, in radians.
        const STEP: f64 = 1e-5;
        let angle = (2.0 * share - 1.0) * self.half;
        let (sin, cos) = angle.sin_cos();
        let on: [f64; 3] = std::array::from_fn(|i| cos * self.middle[i] + sin * self.side[i]);
        let at = project(self.lens, on)?;
        // If the lens scales differently in two directions, the image of the normal is not perpendicular to
        // the curve.
        let along = |by: f64| {
            let (sin, cos) = (angle + by).sin_cos();
            project(self.lens, std::array::from_fn(|i| cos * self.middle[i] + sin * self.side[i]))
        };
        let (before, after) = (along(-STEP)?, along(STEP)?);
        let far = before.distance(after);
        let towards = project(self.lens, std::array::from_fn(|i| on[i] + STEP * self.normal[i]))?;
        let by = [(towards.u - at.u) / STEP, (towards.v - at.v) / STEP];
        let right = [-(after.v - before.v) / far, (after.u - before.u) / far];
        let scale = by[0] * right[0] + by[1] * right[1];
        let across = right.map(|part| part * scale.signum());
        let is_known = far > 0.0 && scale.abs() > 1.0;
        is_known.then_some(Sample { at, across, angle, scale: scale.abs() })
    }

    /// Moves a pixel of the curve across the curve, to the nearby line with the deviation `[A, B]`, in
    /// radians.
    fn moved(&self, pixel: Pixel, [cosine, sine]: [f64; 2]) -> Option<Pixel> {
        let at = ray(self.lens, pixel)?;
        let by = cosine * dot(at, self.middle) + sine * dot(at, self.side);
        project(self.lens, std::array::from_fn(|i| at[i] + by * self.normal[i]))
    }
}

/// Fits `A` and `B` of `t = a A + b B` to samples `[a, b, t]`; `None` with fewer than `least` inliers. `t` is
/// the deviation across the curve, in pixels.
///
/// Every pair of a subset of the samples determines a candidate. The candidate with the most inliers is
/// fitted to its inliers (Fischler and Bolles 1981, with all pairs instead of random ones).
fn fit_deviation(places: &[[f64; 3]], least: usize) -> Option<[f64; 2]> {
    /// Largest number of points whose pairs yield candidates.
    const MAX_CANDIDATE_POINTS: usize = 32;
    let step = places.len().div_ceil(MAX_CANDIDATE_POINTS).max(1);
    let few: Vec<[f64; 3]> = places.iter().copied().step_by(step).collect();
    let agree = |[cosine, sine]: [f64; 2]| {
        places.iter().filter(move |[a, b, t]| (t - a * cosine - b * sine).abs() <= MAX_INLIER_DISTANCE_PX)
    };
    let pairs = few.iter().enumerate().flat_map(|(i, p)| few[..i].iter().map(move |q| (p, q)));
    let proposed = pairs.filter_map(|(p, q)| solve_2x2([p[0], p[1], q[0], q[1]], [p[2], q[2]]));
    let best = proposed.max_by_key(|&by| agree(by).count())?;
    if agree(best).count() < least.max(4) {
        return None;
    }
    let mut normal = [0.0; 4];
    let mut right = [0.0; 2];
    for [a, b, t] in agree(best) {
        normal = [normal[0] + a * a, normal[1] + a * b, normal[2] + a * b, normal[3] + b * b];
        right = [right[0] + a * t, right[1] + b * t];
    }
    solve_2x2(normal, right)
}

/// Solves the linear equations `a x + b y = s` and `c x + d y = t`; `None` if they are dependent.
fn solve_2x2([a, b, c, d]: [f64; 4], [s, t]: [f64; 2]) -> Option<[f64; 2]> {
    let determinant = a * d - b * c;
    let is_clear = determinant.abs() > 1e-12 * (a.abs() + b.abs()) * (c.abs() + d.abs());
    is_clear.then(|| [(d * s - b * t) / determinant, (a * t - c * s) / determinant])
}

/// Returns the unit vector of the ray of a raw pixel, in camera axes; `None` outside the lens.
fn ray(lens: &Lens, pixel: Pixel) -> Option<[f64; 3]> {
    let [x, y, w] = lens.bearing(pixel)?;
    unit([x / lens.focal, y / lens.focal, w])
}

/// Projects a direction in camera axes to a raw pixel; `None` outside the lens.
fn project(lens: &Lens, [x, y, w]: [f64; 3]) -> Option<Pixel> {
    lens.bearing_to_pixel([lens.focal * x, lens.focal * y, w])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(of: [f64; 3]) -> f64 {
    dot(of, of).sqrt()
}

/// Returns the unit vector in a direction; `None` for the zero vector.
fn unit(of: [f64; 3]) -> Option<[f64; 3]> {
    let length = length(of);
    (length > 1e-9).then(|| of.map(|part| part / length))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// Creates an image of a smoothed edge, dark on the left of the line `u = 80.3 + tilt v` and bright on
    /// the right.
    fn picture(tilt: f64) -> RgbImage {
        RgbImage::from_fn(200, 150, |x, y| {
            let off = f64::from(x) + 0.5 - (80.3 + tilt * (f64::from(y) + 0.5));
            let value = 60.0 + 120.0 / (1.0 + (-1.7 * off).exp());
            Rgb([value as u8; 3])
        })
    }

    #[test]
    fn a_line_near_an_edge_is_pulled_onto_it() {
        for tilt in [0.0, 0.13] {
            let drawn = [Pixel::new(83.5 + tilt * 20.0, 20.0), Pixel::new(77.5 + tilt * 130.0, 130.0)];
            let [a, b] = snap_line(&picture(tilt), drawn).unwrap();
            for p in [a, b] {
                let off = p.u - (80.3 + tilt * p.v);
                assert!(off.abs() < 0.15, "{off} px off the edge");
            }
        }
    }

    #[test]
    fn every_point_of_a_curved_edge_is_pulled_onto_it() {
        // Parabola, 9 px off its chord.
        let edge = |v: f64| 80.3 + 0.003 * (v - 75.0).powi(2);
        let picture = RgbImage::from_fn(200, 150, |x, y| {
            let off = f64::from(x) + 0.5 - edge(f64::from(y) + 0.5);
            Rgb([(60.0 + 120.0 / (1.0 + (-1.7 * off).exp())) as u8; 3])
        });
        let drawn: Vec<Pixel> =
            [22.0, 50.0, 76.0, 101.0, 127.0].map(|v| Pixel::new(edge(v) + 2.0, v)).to_vec();
        for p in snap_polyline(&picture, &drawn).unwrap() {
            let off = p.u - edge(p.v);
            assert!(off.abs() < 0.35, "{off} px off the edge at {}", p.v);
        }
    }

    #[test]
    fn between_two_parallel_edges_one_is_chosen() {
        // The upper part of the line follows one edge, the lower part another one 7 px away.
        let at = |v: f64| if v < 85.0 { 78.0 } else { 85.0 };
        let picture = RgbImage::from_fn(200, 150, |x, y| {
            let off = f64::from(x) + 0.5 - at(f64::from(y) + 0.5);
            Rgb([(60.0 + 120.0 / (1.0 + (-1.7 * off).exp())) as u8; 3])
        });
        let pulled = snap_line(&picture, [Pixel::new(81.0, 10.0), Pixel::new(81.0, 140.0)]);
        let on_one = |p: Pixel, edge: f64| (p.u - edge).abs() < 0.4;
        let [a, b] = pulled.expect("one of the edges is found");
        assert!(
            [78.0, 85.0].iter().any(|&edge| on_one(a, edge) && on_one(b, edge)),
            "{a:?} {b:?} is on neither edge"
        );
    }

    #[test]
    fn without_an_edge_nothing_is_pulled() {
        let flat = RgbImage::from_pixel(200, 150, Rgb([90; 3]));
        let line = [Pixel::new(20.0, 20.0), Pixel::new(90.0, 50.0), Pixel::new(150.0, 100.0)];
        assert_eq!(snap_polyline(&flat, &line[..2]), None);
        assert_eq!(snap_polyline(&flat, &line), None);
        assert_eq!(snap_polyline(&flat, &[line[0]; 3]), None);
    }
}

#[cfg(test)]
mod pull_curve_tests {
    use calib_core::Distortion;
    use image::Rgb;

    use super::*;

    fn fisheye() -> Lens {
        let distortion = Distortion::KannalaBrandt { k: [0.01, -0.003, 0.0, 0.0] };
        Lens {
            principal_point: Pixel::new(200.0, 190.0),
            focal: 115.0,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        }
    }

    /// Creates an image of a plane through the camera centre, dark on one side and bright on the other, with
    /// blur.
    fn picture(normal: [f64; 3]) -> RgbImage {
        let (lens, normal) = (fisheye(), unit(normal).unwrap());
        RgbImage::from_fn(400, 380, |x, y| {
            let at = Pixel::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let Some(ray) = ray(&lens, at) else { return Rgb([0; 3]) };
            let off = dot(normal, ray) * lens.focal;
            Rgb([(60.0 + 120.0 / (1.0 + (-1.7 * off).exp())) as u8; 3])
        })
    }

    #[test]
    fn a_line_near_a_curved_edge_is_pulled_onto_it() {
        let lens = fisheye();
        for normal in [[0.2, 1.0, 0.5], [1.0, 0.3, -0.7], [0.1, 0.9, 1.2]] {
            let image = picture(normal);
            let [n, edge] = [normal, cross(normal, [0.0, 0.0, 1.0])].map(|of| unit(of).unwrap());
            let out = cross(edge, n);
            // The edge covers 120°, and extends more than 90° off the axis where possible.
            let ends = [-1.1_f64, 1.0].map(|angle| {
                let at: [f64; 3] = std::array::from_fn(|i| angle.cos() * out[i] + angle.sin() * edge[i]);
                let forward = if out[2] < 0.0 { at.map(|part| -part) } else { at };
                project(&lens, forward).unwrap()
            });
            let off = |p: Pixel| dot(n, ray(&lens, p).unwrap()).abs() * lens.focal;
            let drawn =
                [Pixel::new(ends[0].u + 2.0, ends[0].v - 2.5), Pixel::new(ends[1].u - 2.0, ends[1].v + 2.0)];
            let pulled = snap_image_curve(&image, &lens, drawn).unwrap();
            for end in pulled {
                assert!(off(end) < 0.2, "{} px off the edge of {normal:?}", off(end));
            }
            let chord = snap_line(&image, drawn);
            assert!(chord.is_none_or(|ends| ends.iter().any(|&end| off(end) > 0.5)), "the edge is curved");
        }
    }

    #[test]
    fn without_an_edge_or_a_line_nothing_is_pulled() {
        let (flat, lens) = (RgbImage::from_pixel(400, 380, Rgb([90; 3])), fisheye());
        let at = Pixel::new(120.0, 120.0);
        assert_eq!(snap_image_curve(&flat, &lens, [at, Pixel::new(220.0, 300.0)]), None);
        assert_eq!(snap_image_curve(&flat, &lens, [at, at]), None);
        assert_eq!(snap_image_curve(&flat, &lens, [at, Pixel::new(-4000.0, 300.0)]), None);
    }
}
