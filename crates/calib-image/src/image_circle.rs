//! Detection of the image circle of a fisheye lens: the scene is inside, and the image is black outside.
//!
//! Rows and columns are scanned from the border of the image inward while they are black. The end of the
//! black run is a point on the rim, except at dark objects near the rim and at captions in the black area. Of
//! the circles through three such points, the circle with the most inliers is used. It is then fitted to its
//! inliers by least squares of their distances (Gauss-Newton).

use calib_core::{ImageCircle, Pixel};
use image::RgbImage;
use nalgebra::{Matrix3, Vector3};

/// Largest brightness of a black image corner, 0 to 255.
const MAX_BLACK_LEVEL: u8 = 48;
/// Smallest difference in brightness between the scene and the black corners, 0 to 255.
const MIN_CONTRAST: u8 = 16;
/// Brightness at the rim, as a fraction of the brightness of the scene. With a relative threshold, a blurred
/// rim has the same position next to bright and to dim scenes.
const RIM_BRIGHTNESS_FRACTION: f64 = 0.25;
/// Distance from the rim within which the brightness of the scene is measured, as a fraction of the longer
/// image side.
const SCENE_DISTANCE_FRACTION: f64 = 0.06;
/// Largest number of scanned rows, and of scanned columns; each is scanned from both ends.
const SCAN_COUNT: u32 = 400;
/// Number of consecutive bright pixels that end a black run; fewer bright pixels are noise.
const MIN_BRIGHT_RUN_PX: u32 = 3;
/// Number of triples of rim points whose circles are tested.
const TRIPLE_COUNT: usize = 500;
/// Largest distance of an inlier rim point from the circle, as a fraction of the longer image side.
const MAX_INLIER_DISTANCE: f64 = 0.005;
/// Smallest fraction of the rim points that must be inliers of the circle.
const MIN_INLIER_FRACTION: f64 = 0.55;
/// Smallest fraction of the pixels outside the circle that must be black; lens flare can brighten the rest.
const MIN_BLACK_FRACTION: f64 = 0.85;

/// Detects the image circle of a fisheye lens, in raw pixels; `None` if the image has no black corners
/// outside a circle.
#[must_use]
pub fn image_circle(image: &RgbImage) -> Option<ImageCircle> {
    let black = black_level(image)?;
    let places = rim_points(image, black);
    let size = [image.width(), image.height()].map(f64::from);
    let near = (MAX_INLIER_DISTANCE * size[0].max(size[1])).max(1.5);
    let is_on =
        |circle: &ImageCircle, at: &Pixel| (circle.centre().distance(*at) - circle.radius).abs() < near;
    let on = |circle: &ImageCircle| places.iter().filter(|at| is_on(circle, at)).count();
    let triple = |number: usize| {
        // The three indices advance by different steps, so that the triples differ.
        let [i, j, k] = [number, number * 7 + 3, number * 31 + 11].map(|of| of * 37 % places.len().max(1));
        circle_through([*places.get(i)?, *places.get(j)?, *places.get(k)?])
            .filter(|circle| is_likely(circle, size))
    };
    let mut circle = (0..TRIPLE_COUNT).filter_map(triple).max_by_key(on)?;
    for _ in 0..8 {
        let own: Vec<Pixel> = places.iter().filter(|at| is_on(&circle, at)).copied().collect();
        circle = refine_circle(circle, &own)?;
    }
    let is_agreed = on(&circle) as f64 >= MIN_INLIER_FRACTION * places.len() as f64;
    let is_round = [[false; 2], [false, true], [true, false], [true; 2]].iter().all(|&[right, below]| {
        let is_of = |at: &&Pixel| (at.u > circle.u) == right && (at.v > circle.v) == below;
        places.iter().filter(is_of).any(|at| is_on(&circle, at))
    });
    let is_likely = is_agreed && is_round && is_likely(&circle, size);
    (is_likely && is_black_outside(image, &circle, black) && is_sharp(image, &circle, black))
        .then_some(circle)
}

/// Returns the value of the brightest colour channel of a pixel, 0 to 255.
fn level(image: &RgbImage, x: u32, y: u32) -> u8 {
    image.get_pixel(x, y).0.into_iter().max().unwrap_or(0)
}

/// Returns the brightness of the black image corners, 0 to 255; `None` if the corners are not black. One of
/// the four corners may contain a caption.
fn black_level(image: &RgbImage) -> Option<u8> {
    let (w, h) = image.dimensions();
    let side = (w.min(h) / 50).max(4);
    if w.min(h) < 4 * side {
        return None;
    }
    let corner =
        |(x0, y0)| quantile(0.9, (0..side * side).map(|i| level(image, x0 + i % side, y0 + i / side)));
    let mut corners = [(0, 0), (w - side, 0), (0, h - side), (w - side, h - side)].map(corner);
    corners.sort_unstable();
    (corners[2] <= MAX_BLACK_LEVEL).then_some(corners[2])
}

/// Returns the quantile of brightness levels at the fraction `share`; 0 for no levels.
fn quantile(share: f64, levels: impl Iterator<Item = u8>) -> u8 {
    let mut levels: Vec<u8> = levels.collect();
    levels.sort_unstable();
    levels.get((share * levels.len() as f64) as usize).copied().unwrap_or(0)
}

/// Collects the ends of the black runs from the image border inward, in raw pixels.
fn rim_points(image: &RgbImage, black: u8) -> Vec<Pixel> {
    let (w, h) = image.dimensions();
    let ahead = (SCENE_DISTANCE_FRACTION * f64::from(w.max(h))) as u32;
    let mut places = Vec::new();
    for (is_row, lines, length) in [(true, h, w), (false, w, h)] {
        let step = lines.div_ceil(SCAN_COUNT).max(1);
        for line in (0..lines).step_by(step as usize) {
            for is_back in [false, true] {
                let level = |i: u32| {
                    let i = if is_back { length - 1 - i } else { i };
                    let (x, y) = if is_row { (i, line) } else { (line, i) };
                    level(image, x, y)
                };
                let Some(along) = end_of_black(level, length, black, ahead) else { continue };
                let along = if is_back { f64::from(length) - along } else { along };
                let across = f64::from(line) + 0.5;
                places.push(if is_row { Pixel::new(along, across) } else { Pixel::new(across, along) });
            }
        }
    }
    places
}

/// Returns the end of the black run at the start of a row or column, in pixels from the start. Returns `None`
/// if the row or column does not start black, or is completely black. `level` returns the brightness of a
/// pixel. `ahead` is the distance within which the brightness of the scene is measured, in pixels.
fn end_of_black(level: impl Fn(u32) -> u8, length: u32, black: u8, ahead: u32) -> Option<f64> {
    let end = |from: u32, bound: u8| {
        (from..length.saturating_sub(MIN_BRIGHT_RUN_PX))
            .find(|i| (*i..*i + MIN_BRIGHT_RUN_PX).all(|i| level(i) > bound))
    };
    let bound = black + MIN_CONTRAST;
    let first = end(0, bound).filter(|first| *first > 0)?;
    let bright = (first..length.min(first + ahead)).map(&level).max()?;
    let share = (RIM_BRIGHTNESS_FRACTION * f64::from(bright.saturating_sub(black))) as u8;
    let bound = bound.max(black + share);
    let end = end(first, bound)?;
    // Interpolate between the centres of two pixels.
    let [before, after] = [end - 1, end].map(|i| f64::from(level(i)));
    let share = ((f64::from(bound) - before) / (after - before)).clamp(0.0, 1.0);
    Some(f64::from(end) - 0.5 + if share.is_nan() { 0.5 } else { share })
}

/// Whether the centre and radius of a circle are plausible for a fisheye lens; the arguments are in pixels.
fn is_likely(circle: &ImageCircle, [w, h]: [f64; 2]) -> bool {
    let is_amid = (circle.u - 0.5 * w).abs() < 0.25 * w && (circle.v - 0.5 * h).abs() < 0.25 * h;
    is_amid && (0.25 * w.min(h)..0.5 * w.hypot(h)).contains(&circle.radius)
}

/// Computes the circle through three points; `None` if they are collinear.
fn circle_through([a, b, c]: [Pixel; 3]) -> Option<ImageCircle> {
    let [bu, bv, cu, cv] = [b.u - a.u, b.v - a.v, c.u - a.u, c.v - a.v];
    let twice = 2.0 * (bu * cv - bv * cu);
    let [b2, c2] = [bu * bu + bv * bv, cu * cu + cv * cv];
    let (u, v) = ((cv * b2 - bv * c2) / twice, (bu * c2 - cu * b2) / twice);
    let circle = ImageCircle { u: a.u + u, v: a.v + v, radius: u.hypot(v) };
    (circle.radius.is_finite() && circle.radius > 0.0).then_some(circle)
}

/// Performs one Gauss-Newton step towards the circle with the least squared distances from the points.
fn refine_circle(circle: ImageCircle, places: &[Pixel]) -> Option<ImageCircle> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for at in places {
        let [u, v] = [at.u - circle.u, at.v - circle.v];
        let distance = u.hypot(v);
        let by = Vector3::new(u / distance, v / distance, 1.0);
        normal += by * by.transpose();
        right += by * (distance - circle.radius);
    }
    let step = normal.cholesky()?.solve(&right);
    Some(ImageCircle { u: circle.u + step.x, v: circle.v + step.y, radius: circle.radius + step.z })
}

/// Whether nearly all pixels outside the circle are black.
fn is_black_outside(image: &RgbImage, circle: &ImageCircle, black: u8) -> bool {
    let step = (image.width().max(image.height()) / SCAN_COUNT).max(1) as usize;
    let of_rows = (0..image.height()).step_by(step);
    let pixels = of_rows.flat_map(|y| (0..image.width()).step_by(step).map(move |x| (x, y)));
    let is_outside = |&(x, y): &(u32, u32)| {
        circle.centre().distance(Pixel::new(f64::from(x) + 0.5, f64::from(y) + 0.5)) > 1.05 * circle.radius
    };
    let (mut all, mut dark) = (0_u32, 0_u32);
    for (x, y) in pixels.filter(is_outside) {
        all += 1;
        dark += u32::from(level(image, x, y) <= black + 2 * MIN_CONTRAST);
    }
    f64::from(dark) >= MIN_BLACK_FRACTION * f64::from(all)
}

/// Whether the rim is sharp: a gradual falloff of light in a dark scene has no rim.
fn is_sharp(image: &RgbImage, circle: &ImageCircle, black: u8) -> bool {
    /// Number of samples inside the rim, at equal angles.
    const SAMPLE_COUNT: u32 = 120;
    /// Distance of the samples from the centre, as a fraction of the radius.
    const SAMPLE_RADIUS_FRACTION: f64 = 0.94;
    let level = |i: u32| {
        let (sin, cos) = (f64::from(i) / f64::from(SAMPLE_COUNT) * std::f64::consts::TAU).sin_cos();
        let [u, v] = [
            circle.u + SAMPLE_RADIUS_FRACTION * circle.radius * cos,
            circle.v + SAMPLE_RADIUS_FRACTION * circle.radius * sin,
        ];
        let is_inside =
            (0.0..f64::from(image.width())).contains(&u) && (0.0..f64::from(image.height())).contains(&v);
        is_inside.then(|| level(image, u as u32, v as u32))
    };
    quantile(0.5, (0..SAMPLE_COUNT).filter_map(level)) > black + 2 * MIN_CONTRAST
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    /// Creates an image of a striped scene in a circle, with noise, a dark object at the rim
    /// and a caption in the black area.
    fn picture(size: [u32; 2], circle: ImageCircle, dark: bool) -> RgbImage {
        let mut state = 7_u32;
        RgbImage::from_fn(size[0], size[1], |x, y| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let grain = (state >> 24) as u8 / 32;
            let at = Pixel::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let inside = (circle.radius - circle.centre().distance(at) + 0.5).clamp(0.0, 1.0);
            let is_dark = dark && x < size[0] / 3 && y > size[1] / 2 && y < size[1] * 2 / 3;
            let scene = if is_dark { 10 } else { 90 + 80 * (x / 40 % 2) as u8 };
            let is_caption = dark && y < 24 && x < 160 && (x / 4) % 2 == 0;
            let value = if is_caption { 220 } else { (inside * f64::from(scene)) as u8 + grain };
            Rgb([value; 3])
        })
    }

    #[test]
    fn complete_and_cut_circles_are_found() {
        for (size, circle) in [
            ([720, 720], ImageCircle { u: 366.0, v: 351.0, radius: 330.0 }),
            ([960, 720], ImageCircle { u: 480.3, v: 355.0, radius: 440.0 }),
            ([1280, 720], ImageCircle { u: 640.0, v: 362.0, radius: 344.5 }),
        ] {
            for dark in [false, true] {
                let found = image_circle(&picture(size, circle, dark)).expect("the circle is found");
                let off = found.centre().distance(circle.centre());
                assert!(off < 0.6 && (found.radius - circle.radius).abs() < 0.8, "{found:?}, not {circle:?}");
            }
        }
    }

    #[test]
    fn black_borders_without_a_circle_are_not_a_fisheye() {
        let bars = |x0: u32, y0: u32| {
            RgbImage::from_fn(640, 480, |x, y| {
                let is_bar = x < x0 || x >= 640 - x0 || y < y0 || y >= 480 - y0;
                Rgb([if is_bar { 0 } else { 120 }; 3])
            })
        };
        for picture in [bars(0, 0), bars(80, 0), bars(0, 60), bars(80, 60), bars(400, 0)] {
            assert_eq!(image_circle(&picture), None);
        }
        for (width, height) in [(200.0, 90.0), (160.0, 160.0), (120.0, 120.0)] {
            let lamp = |x: f64, y: f64| {
                255.0 * (-((x - 320.0) / width).powi(2) - ((y - 240.0) / height).powi(2)).exp()
            };
            let night = RgbImage::from_fn(640, 480, |x, y| Rgb([lamp(f64::from(x), f64::from(y)) as u8; 3]));
            assert_eq!(image_circle(&night), None, "a lamp of {width} by {height}");
        }
        assert_eq!(image_circle(&RgbImage::new(3, 900)), None);
    }
}
