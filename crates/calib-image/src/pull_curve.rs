//! Pulls a line that was drawn by its ends onto the curved edge that a fisheye makes of a straight one.

use calib_core::{Lens, Pixel};

use calib_core::floor::drawn_line;
use image::RgbImage;

use crate::pull::{ONE_EDGE, SAMPLES, SHARE, brightness, pull, strongest};

/// The line pulled onto the edge that runs along it: under a fisheye along the curve of the straight line of space through
/// its ends, under other lenses along the line itself; `None` where there is none.
///
/// Straight lines of space near one of them, whose plane has the normal n, the middle m and `s = n x m`, pass it at the
/// angle `A cos a + B sin a`, with a counted along it from its middle: so far are the places of an edge from the curve, and A
/// and B are found from those that agree, in pixels.
#[must_use]
pub fn pull_drawn(image: &RgbImage, lens: &Lens, line: [Pixel; 2]) -> Option<[Pixel; 2]> {
    if !lens.distortion.is_wide() {
        return pull(image, line);
    }
    let curve = Curve::of(lens, line)?;
    let count = (curve.length as usize).clamp(8, SAMPLES);
    let samples: Vec<Sample> = (0..=count).filter_map(|i| curve.sample(i as f64 / count as f64)).collect();
    let slope = |sample: &Sample, t: f64| {
        let at = |t: f64| {
            brightness(image, sample.at.u + t * sample.across[0], sample.at.v + t * sample.across[1])
        };
        Some(0.5 * (at(t + 1.0)? - at(t - 1.0)?))
    };
    let steepest =
        |sample: &Sample, sign: Option<f64>| strongest(&|_: f64, t: f64| slope(sample, t), 0.0, sign);
    // Which way the edge goes: from dark to bright, or from bright to dark.
    let total: f64 = samples.iter().filter_map(|sample| steepest(sample, None)).map(|(_, slope)| slope).sum();
    let places: Vec<[f64; 3]> = samples
        .iter()
        .filter_map(|sample| {
            let (t, _) = steepest(sample, Some(total.signum()))?;
            let (sin, cos) = sample.angle.sin_cos();
            Some([sample.scale * cos, sample.scale * sin, t])
        })
        .collect();
    let by = robust(&places, (SHARE * count as f64) as usize)?;
    Some([curve.moved(line[0], by)?, curve.moved(line[1], by)?])
}

/// The curve of the straight line of space through two pixels.
struct Curve<'a> {
    lens: &'a Lens,
    middle: [f64; 3],
    /// A quarter of a turn along the curve from its middle.
    side: [f64; 3],
    normal: [f64; 3],
    /// From the middle to each end, in radians.
    half: f64,
    /// Of its image, in pixels.
    length: f64,
}

/// A place of the curve.
struct Sample {
    at: Pixel,
    /// The unit vector across it, towards the normal.
    across: [f64; 2],
    /// From the middle, in radians.
    angle: f64,
    /// Pixels across it for a radian.
    scale: f64,
}

impl<'a> Curve<'a> {
    fn of(lens: &'a Lens, line: [Pixel; 2]) -> Option<Self> {
        /// Radians: rays as close tell no plane; rays as far as opposite ones neither.
        const CLOSE: f64 = 1e-3;
        let [a, b] = [ray(lens, line[0])?, ray(lens, line[1])?];
        let normal = unit(cross(a, b)).filter(|_| length(cross(a, b)) > CLOSE)?;
        let middle = unit(std::array::from_fn(|i| a[i] + b[i]))?;
        let drawn = drawn_line(lens, &line);
        let length: f64 = drawn.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let half = 0.5 * dot(a, b).clamp(-1.0, 1.0).acos();
        let is_long = (4.0..1e5).contains(&length);
        is_long.then(|| Self { lens, middle, side: cross(normal, middle), normal, half, length })
    }

    /// A share of the way from the first end to the second.
    fn sample(&self, share: f64) -> Option<Sample> {
        /// Radians that a ray is moved to find which way its pixel goes.
        const STEP: f64 = 1e-5;
        let angle = (2.0 * share - 1.0) * self.half;
        let (sin, cos) = angle.sin_cos();
        let on: [f64; 3] = std::array::from_fn(|i| cos * self.middle[i] + sin * self.side[i]);
        let at = shown(self.lens, on)?;
        // Where a lens squeezes one way and not the other, across the curve is not where the normal leads.
        let along = |by: f64| {
            let (sin, cos) = (angle + by).sin_cos();
            shown(self.lens, std::array::from_fn(|i| cos * self.middle[i] + sin * self.side[i]))
        };
        let (before, after) = (along(-STEP)?, along(STEP)?);
        let far = before.distance(after);
        let towards = shown(self.lens, std::array::from_fn(|i| on[i] + STEP * self.normal[i]))?;
        let by = [(towards.u - at.u) / STEP, (towards.v - at.v) / STEP];
        let right = [-(after.v - before.v) / far, (after.u - before.u) / far];
        let scale = by[0] * right[0] + by[1] * right[1];
        let across = right.map(|part| part * scale.signum());
        let is_known = far > 0.0 && scale.abs() > 1.0;
        is_known.then_some(Sample { at, across, angle, scale: scale.abs() })
    }

    /// A pixel of the curve moved across it onto the one that passes by these angles.
    fn moved(&self, pixel: Pixel, [cosine, sine]: [f64; 2]) -> Option<Pixel> {
        let at = ray(self.lens, pixel)?;
        let by = cosine * dot(at, self.middle) + sine * dot(at, self.side);
        shown(self.lens, std::array::from_fn(|i| at[i] + by * self.normal[i]))
    }
}

/// A and B of `t = a A + b B` for most of the places `[a, b, t]`; `None` if fewer than `least` are of one edge.
///
/// Every pair of a few places proposes them, and those that most agree with are fitted to these alone (Fischler and Bolles
/// 1981, without chance).
fn robust(places: &[[f64; 3]], least: usize) -> Option<[f64; 2]> {
    const PROPOSERS: usize = 32;
    let step = places.len().div_ceil(PROPOSERS).max(1);
    let few: Vec<[f64; 3]> = places.iter().copied().step_by(step).collect();
    let agree = |[cosine, sine]: [f64; 2]| {
        places.iter().filter(move |[a, b, t]| (t - a * cosine - b * sine).abs() <= ONE_EDGE)
    };
    let pairs = few.iter().enumerate().flat_map(|(i, p)| few[..i].iter().map(move |q| (p, q)));
    let proposed = pairs.filter_map(|(p, q)| solved([p[0], p[1], q[0], q[1]], [p[2], q[2]]));
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
    solved(normal, right)
}

/// The solution of two equations, row by row; `None` where they are one.
fn solved([a, b, c, d]: [f64; 4], [s, t]: [f64; 2]) -> Option<[f64; 2]> {
    let determinant = a * d - b * c;
    let is_clear = determinant.abs() > 1e-12 * (a.abs() + b.abs()) * (c.abs() + d.abs());
    is_clear.then(|| [(d * s - b * t) / determinant, (a * t - c * s) / determinant])
}

fn ray(lens: &Lens, pixel: Pixel) -> Option<[f64; 3]> {
    let [x, y, w] = lens.bearing(pixel)?;
    unit([x / lens.focal, y / lens.focal, w])
}

fn shown(lens: &Lens, [x, y, w]: [f64; 3]) -> Option<Pixel> {
    lens.shown([lens.focal * x, lens.focal * y, w])
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

fn unit(of: [f64; 3]) -> Option<[f64; 3]> {
    let length = length(of);
    (length > 1e-9).then(|| of.map(|part| part / length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::Distortion;
    use image::Rgb;

    fn fisheye() -> Lens {
        let distortion = Distortion::KannalaBrandt { k: [0.01, -0.003, 0.0, 0.0] };
        Lens { principal_point: Pixel::new(200.0, 190.0), focal: 115.0, distortion, image_circle: None }
    }

    /// Dark on one side of a plane through the eye, bright on the other, as a pixel blurs it.
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
    fn a_line_drawn_beside_a_curved_edge_is_pulled_onto_it() {
        let lens = fisheye();
        for normal in [[0.2, 1.0, 0.5], [1.0, 0.3, -0.7], [0.1, 0.9, 1.2]] {
            let still = picture(normal);
            let [n, edge] = [normal, cross(normal, [0.0, 0.0, 1.0])].map(|of| unit(of).unwrap());
            let out = cross(edge, n);
            // A third of a turn of it, and more than 90 degrees off the axis where it leads there.
            let ends = [-1.1_f64, 1.0].map(|angle| {
                let at: [f64; 3] = std::array::from_fn(|i| angle.cos() * out[i] + angle.sin() * edge[i]);
                let forward = if out[2] < 0.0 { at.map(|part| -part) } else { at };
                shown(&lens, forward).unwrap()
            });
            let off = |p: Pixel| dot(n, ray(&lens, p).unwrap()).abs() * lens.focal;
            let drawn =
                [Pixel::new(ends[0].u + 2.0, ends[0].v - 2.5), Pixel::new(ends[1].u - 2.0, ends[1].v + 2.0)];
            let pulled = pull_drawn(&still, &lens, drawn).unwrap();
            for end in pulled {
                assert!(off(end) < 0.2, "{} px off the edge of {normal:?}", off(end));
            }
            let chord = pull(&still, drawn);
            assert!(chord.is_none_or(|ends| ends.iter().any(|&end| off(end) > 0.5)), "the edge is bent");
        }
    }

    #[test]
    fn without_an_edge_or_a_line_nothing_is_pulled() {
        let (flat, lens) = (RgbImage::from_pixel(400, 380, Rgb([90; 3])), fisheye());
        let at = Pixel::new(120.0, 120.0);
        assert_eq!(pull_drawn(&flat, &lens, [at, Pixel::new(220.0, 300.0)]), None);
        assert_eq!(pull_drawn(&flat, &lens, [at, at]), None);
        assert_eq!(pull_drawn(&flat, &lens, [at, Pixel::new(-4000.0, 300.0)]), None);
    }
}
