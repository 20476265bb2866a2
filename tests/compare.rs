//! Comparison of two images of one camera: the reported camera change against the true one.
//!
//! Images are rotated and zoomed by known amounts. Then they get other light, noise, JPEG compression,
//! shadows, and parts of other images as occlusions. The constants of the method were chosen on one half of
//! the images ([`CHOSEN`]); the assertions use the other half. `cargo xtask accuracy --compare` prints the
//! table.

use std::collections::BTreeMap;
use std::path::Path;

use calib_core::{BrownConrady, Camera, Covariance, Distortion, Lens, Pixel, WorldPoint};

use calib_core::camera::{RotationZoom, angles_from_rotation, pixel_to_camera_ray};

use calib_image::{CameraChange, Comparison};
use calib_site::{Method, Site};
use calib_tests::{Scratch, shared};
use image::{Rgb, RgbImage};
use nalgebra::{Matrix4, Vector4};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Cameras whose images were used to choose the constants.
const CHOSEN: [&str; 3] = ["G505", "C1", "shop-1"];
/// Width of the images, in pixels.
const WIDTH: u32 = 960;

/// Images of one camera that did not move between them.
struct Stills {
    id: String,
    camera: Camera,
    moments: Vec<RgbImage>,
    /// Larger images, from which the images are reduced. Rotated images are reduced from them, too, so that
    /// both are equally sharp.
    larger: Vec<RgbImage>,
}

impl Stills {
    /// Creates the images of a camera whose parameters belong to the larger images.
    fn new(id: &str, camera: Camera, larger: Vec<RgbImage>, width: u32) -> Self {
        let factor = f64::from(width) / f64::from(larger[0].width());
        let moments = larger.iter().map(|picture| reduced(picture, width)).collect();
        Self { id: id.into(), camera: scaled(&camera, factor), moments, larger }
    }

    /// Renders the image of the camera after a rotation and zoom. Pixels outside the old image come from
    /// `other`.
    fn turned(&self, moment: usize, turn: &RotationZoom, other: &RgbImage) -> RgbImage {
        let (still, larger) = (&self.moments[moment], &self.larger[moment]);
        let factor = f64::from(larger.width()) / f64::from(still.width());
        let new = turn.apply_to(&self.camera);
        let back = RotationZoom::between(&new, &self.camera).for_camera(&new);
        let colour = |at: Pixel| {
            let Pixel { u, v } = back.map_pixel(at)?;
            sample(larger, Pixel::new(factor * u, factor * v))
        };
        supersampled([still.width(), still.height()], colour, |x, y| {
            *other.get_pixel(x % other.width(), y % other.height())
        })
    }
}

/// Returns the camera for an image scaled by `factor`.
fn scaled(camera: &Camera, factor: f64) -> Camera {
    let Pixel { u, v } = camera.lens.principal_point;
    let lens = Lens {
        principal_point: Pixel::new(u * factor, v * factor),
        focal: camera.lens.focal * factor,
        ..camera.lens
    };
    Camera { focal: camera.focal * factor, lens, ..*camera }
}

/// Returns the image reduced to `width`.
fn reduced(picture: &RgbImage, width: u32) -> RgbImage {
    let factor = f64::from(picture.width()) / f64::from(width);
    let height = (f64::from(picture.height()) / factor).round() as u32;
    let nearest = |x: u32, y: u32| {
        let [u, v] = [x, y].map(|at| (factor * (f64::from(at) + 0.5)) as u32);
        *picture.get_pixel(u.min(picture.width() - 1), v.min(picture.height() - 1))
    };
    supersampled([width, height], |at| sample(picture, Pixel::new(factor * at.u, factor * at.v)), nearest)
}

/// Renders an image; each pixel is the mean of 3 x 3 samples. Samples without a colour come from `elsewhere`.
fn supersampled(
    [w, h]: [u32; 2],
    colour: impl Fn(Pixel) -> Option<[f64; 3]>,
    elsewhere: impl Fn(u32, u32) -> Rgb<u8>,
) -> RgbImage {
    const ACROSS: u32 = 3;
    let aside = |i: u32| (f64::from(i) + 0.5) / f64::from(ACROSS);
    RgbImage::from_fn(w, h, |x, y| {
        let mut sum = [0.0; 3];
        for (s, t) in (0..ACROSS).flat_map(|i| (0..ACROSS).map(move |j| (aside(i), aside(j)))) {
            let colour = colour(Pixel::new(f64::from(x) + s, f64::from(y) + t));
            let colour = colour.unwrap_or_else(|| elsewhere(x, y).0.map(f64::from));
            (0..3).for_each(|k| sum[k] += colour[k] / f64::from(ACROSS * ACROSS));
        }
        Rgb(sum.map(|value| value.round().clamp(0.0, 255.0) as u8))
    })
}

fn open(path: &Path) -> RgbImage {
    image::open(path).unwrap().into_rgb8()
}

fn read(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Returns the images of the street, the bus shelter and the rendered shop. Images of missing shared data are
/// left out.
fn stills(width: u32) -> Vec<Stills> {
    let mut all = Vec::new();
    if let Some(path) = shared("real/town/town.json") {
        let data = read(&path);
        for id in ["C1", "C2", "C3"] {
            let camera = Camera {
                position: WorldPoint::new(0.0, 0.0, 2.5),
                yaw: 0.0,
                pitch: data[id]["pitch_deg"].as_f64().unwrap().to_radians(),
                roll: 0.0,
                focal: 900.0,
                lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
                covariance: Covariance::EXACT,
            };
            let moments = ["0000", "0004", "0009"];
            let pictures = moments.map(|name| open(&path.with_file_name(id).join(format!("{name}.jpg"))));
            all.push(Stills::new(id, camera, pictures.to_vec(), width));
        }
    }
    if let Some(path) = shared("real/meva/meva.json") {
        let data = read(&path);
        for id in ["G341", "G505", "G506"] {
            let truth = &data["cameras"][id]["truth"];
            let number = |key: &str| truth[key].as_f64().unwrap();
            let rotation: [[f64; 3]; 3] =
                serde_json::from_value(truth["R_camera_from_world"].clone()).unwrap();
            let (roll, pitch, yaw) = angles_from_rotation(&rotation);
            let brown = BrownConrady { k1: number("k1"), k2: number("k2"), ..BrownConrady::default() };
            let lens = Lens {
                principal_point: serde_json::from_value(truth["principal_point"].clone()).unwrap(),
                focal: number("focal_px"),
                distortion: Distortion::BrownConrady(brown),
                image_circle: None,
                pixel_aspect: 1.0,
            };
            let position = WorldPoint::new(0.0, 0.0, 3.5);
            let covariance = Covariance::EXACT;
            let camera = Camera { position, yaw, pitch, roll, focal: number("focal_px"), lens, covariance };
            let picture = open(&path.with_file_name("frames").join(format!("{id}.png")));
            all.push(Stills::new(id, camera, vec![picture], width));
        }
    }
    let demo = calib_demo::demo_site();
    for (entry, (id, camera)) in demo.site.cameras.iter().zip(&demo.truth).take(2) {
        all.push(rendered(id, camera, entry.size_px, width));
    }
    all
}

/// Renders an image of the demonstration at twice `width`, but not larger than the size of its camera.
fn rendered(id: &str, camera: &Camera, size: [u32; 2], width: u32) -> Stills {
    let [w, h] = [2 * width, 2 * width * size[1] / size[0]];
    let [w, h] = [w.min(size[0]), h.min(size[1])];
    let larger = scaled(camera, f64::from(w) / f64::from(size[0]));
    Stills::new(id, larger, vec![calib_demo::render(&larger, [w, h])], width)
}

/// Returns the bicubic colour at a position, or `None` outside the image.
fn sample(image: &RgbImage, at: Pixel) -> Option<[f64; 3]> {
    let (x, y) = (at.u - 0.5, at.v - 0.5);
    let inside =
        x >= 1.0 && y >= 1.0 && x < f64::from(image.width()) - 2.0 && y < f64::from(image.height()) - 2.0;
    if !inside {
        return None;
    }
    let (x0, y0) = (x as u32, y as u32);
    let weights = |t: f64| {
        let (t2, t3) = (t * t, t * t * t);
        [-t3 + 2.0 * t2 - t, 3.0 * t3 - 5.0 * t2 + 2.0, -3.0 * t3 + 4.0 * t2 + t, t3 - t2].map(|w| 0.5 * w)
    };
    let (across, down) = (weights(x - f64::from(x0)), weights(y - f64::from(y0)));
    let mut sum = [0.0; 3];
    for (j, by_row) in down.iter().enumerate() {
        for (i, by_column) in across.iter().enumerate() {
            let pixel = image.get_pixel(x0 + i as u32 - 1, y0 + j as u32 - 1);
            for k in 0..3 {
                sum[k] += by_row * by_column * f64::from(pixel.0[k]);
            }
        }
    }
    Some(sum)
}

/// Differences between two images that are not a camera change.
#[derive(Debug)]
struct Day {
    gamma: f64,
    gain: f64,
    noise: f64,
    quality: u8,
    shadows: usize,
    /// Fraction of the image covered by occlusions.
    covered: f64,
}

impl Day {
    fn any(random: &mut ChaCha8Rng, most_covered: f64) -> Self {
        Self {
            gamma: random.random_range(0.6..1.6),
            gain: random.random_range(0.7..1.3),
            noise: random.random_range(0.0..6.0),
            quality: random.random_range(30..=95),
            shadows: random.random_range(0..4),
            covered: random.random_range(0.0..1.0_f64) * most_covered,
        }
    }

    fn shown(&self, mut image: RgbImage, other: &RgbImage, random: &mut ChaCha8Rng) -> RgbImage {
        for _ in 0..self.shadows {
            shadow(&mut image, random);
        }
        paste(&mut image, other, self.covered, random);
        for value in image.iter_mut() {
            let light = self.gain * (f64::from(*value) / 255.0).powf(self.gamma);
            let noise = self.noise * (0..3).map(|_| random.random_range(-1.0..1.0_f64)).sum::<f64>();
            *value = (255.0 * light + noise).round().clamp(0.0, 255.0) as u8;
        }
        let mut bytes = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, self.quality);
        image.write_with_encoder(encoder).unwrap();
        image::load_from_memory(&bytes).unwrap().into_rgb8()
    }
}

/// Darkens a stripe across the image.
fn shadow(image: &mut RgbImage, random: &mut ChaCha8Rng) {
    let [w, h] = [image.width(), image.height()].map(f64::from);
    let (angle, at) =
        (random.random_range(0.0..3.1_f64), [random.random_range(0.0..w), random.random_range(0.0..h)]);
    let (wide, dark, soft) =
        (random.random_range(0.05..0.3) * w, random.random_range(0.4..0.8), random.random_range(1.0..8.0));
    for (x, y, pixel) in image.enumerate_pixels_mut() {
        let across = (f64::from(x) - at[0]) * angle.sin() - (f64::from(y) - at[1]) * angle.cos();
        let inside = 1.0 / (1.0 + ((across.abs() - wide) / soft).exp());
        let light = 1.0 - (1.0 - dark) * inside;
        pixel.0.iter_mut().for_each(|value| *value = (f64::from(*value) * light) as u8);
    }
}

/// Covers a fraction of the image with ellipses of another image.
fn paste(image: &mut RgbImage, other: &RgbImage, share: f64, random: &mut ChaCha8Rng) {
    let [w, h] = [image.width(), image.height()];
    let mut covered = vec![false; (w * h) as usize];
    let mut count = 0;
    while (count as f64) < share * f64::from(w * h) {
        let (u, v) = (random.random_range(0.0..f64::from(w)), random.random_range(0.0..f64::from(h)));
        let tall = random.random_range(0.05..0.25) * f64::from(h);
        let wide = tall * random.random_range(0.3..1.2);
        let (dx, dy) = (random.random_range(0..other.width()), random.random_range(0..other.height()));
        let [x0, x1] = [(u - wide).max(0.0) as u32, ((u + wide) as u32).min(w - 1)];
        let [y0, y1] = [(v - tall).max(0.0) as u32, ((v + tall) as u32).min(h - 1)];
        for (y, x) in (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (y, x))) {
            let inside = ((f64::from(x) - u) / wide).powi(2) + ((f64::from(y) - v) / tall).powi(2) < 1.0;
            if inside {
                image.put_pixel(x, y, *other.get_pixel((x + dx) % other.width(), (y + dy) % other.height()));
                let is_covered = &mut covered[(y * w + x) as usize];
                count += usize::from(!*is_covered);
                *is_covered = true;
            }
        }
    }
}

/// Returns a random rotation and zoom. The angle, in degrees, and the relative change of the focal length are
/// within the given ranges.
fn random_rotation(random: &mut ChaCha8Rng, degrees: [f64; 2], zoom: [f64; 2]) -> RotationZoom {
    let log =
        |random: &mut ChaCha8Rng, [low, high]: [f64; 2]| random.random_range(low.ln()..=high.ln()).exp();
    // Pan and tilt are more frequent than roll.
    let axis = [1.0, 1.0, 0.4].map(|most: f64| random.random_range(-most..most));
    let length = axis.iter().map(|c| c * c).sum::<f64>().sqrt();
    let angle = log(random, degrees).to_radians();
    let share = log(random, zoom);
    let zoom = if random.random_bool(0.5) { (1.0 + share).ln() } else { -(1.0 + share).ln() };
    RotationZoom { vector: axis.map(|c| c / length * angle), zoom }
}

/// One comparison and its errors.
#[derive(Debug)]
struct Trial {
    change: CameraChange,
    /// Errors divided by their standard deviations: rotation about three axes, zoom.
    errors: [f64; 4],
    /// Rotation error in degrees, and relative zoom error.
    off: [f64; 2],
    /// Largest component of the true rotation and zoom, in standard deviations.
    size: f64,
    /// Squared error divided by the Cramér-Rao bound of the matched edges, mean over the parameters.
    of_bound: f64,
}

fn trial(stills: &Stills, new: &RgbImage, truth: &RotationZoom) -> Trial {
    let found = Comparison::new(&stills.camera, &[], &stills.moments[0], new).unwrap();
    let left =
        RotationZoom::between(&found.rotation.apply_to(&stills.camera), &truth.apply_to(&stills.camera));
    let [x, y, z] = left.vector;
    let sigma = |k: usize| found.covariance[k][k].sqrt();
    let errors: [f64; 4] = std::array::from_fn(|k| [x, y, z, left.zoom][k] / sigma(k));
    let size =
        truth.vector.iter().chain([&truth.zoom]).enumerate().map(|(k, value)| (value / sigma(k)).abs());
    Trial {
        change: found.change,
        errors,
        off: [left.angle().to_degrees(), left.zoom.abs()],
        size: size.fold(0.0, f64::max),
        of_bound: of_bound(&found, [x, y, z, left.zoom]),
    }
}

/// Returns the squared error in units of the bound of the matched edges, mean over the parameters.
fn of_bound(found: &Comparison, error: [f64; 4]) -> f64 {
    let error = Vector4::from(error);
    let bound = Matrix4::from_fn(|i, j| found.bound[i][j]);
    bound.cholesky().map_or(f64::NAN, |bound| error.dot(&bound.solve(&error)) / 4.0)
}

/// One row of the table.
#[derive(Default)]
struct Row {
    trials: usize,
    right: usize,
    /// Number of trials reported as shifted.
    shifted: usize,
    refused: usize,
    /// Number of false reports: a change for an unchanged camera, or no change although the true change
    /// exceeds three standard deviations.
    wrong: usize,
    inside: [usize; 4],
    aligned: usize,
    off: Vec<[f64; 2]>,
    of_bound: Vec<f64>,
    worst: f64,
}

impl Row {
    fn add(&mut self, trial: &Trial, moved: bool) {
        self.trials += 1;
        if !trial.change.is_aligned() {
            self.refused += 1;
            return;
        }
        let is_reported = trial.change != CameraChange::Unchanged;
        self.right += usize::from(is_reported == moved);
        self.shifted += usize::from(trial.change == CameraChange::Shifted);
        self.wrong += usize::from(is_reported != moved && (!moved || trial.size > 3.0));
        self.aligned += 1;
        for (inside, error) in self.inside.iter_mut().zip(trial.errors) {
            *inside += usize::from(error.abs() < 1.96);
        }
        self.off.push(trial.off);
        self.of_bound.push(trial.of_bound);
        self.worst = trial.errors.iter().fold(self.worst, |most, error| most.max(error.abs()));
    }

    fn coverage(&self) -> f64 {
        self.inside.iter().sum::<usize>() as f64 / (4 * self.aligned).max(1) as f64
    }

    /// Returns the root mean square of the errors relative to the bound, over the best `share` of the trials.
    fn over_bound(&self, share: f64) -> f64 {
        let mut squares = self.of_bound.clone();
        squares.sort_by(f64::total_cmp);
        squares.truncate((share * squares.len() as f64).ceil() as usize);
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }

    fn text(&self, name: &str) -> String {
        let quantile = |of: usize, share: f64| {
            let mut values: Vec<f64> = self.off.iter().map(|off| off[of]).collect();
            values.sort_by(f64::total_cmp);
            values.get((share * values.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(f64::NAN)
        };
        format!(
            "| {name} | {} | {} | {} | {} | {} | {:.4} / {:.4} | {:.3} / {:.3} | {:.1} % ({}) | {:.1} | {:.2} / {:.2} |",
            self.trials,
            self.right,
            self.shifted,
            self.wrong,
            self.refused,
            quantile(0, 0.5),
            quantile(0, 0.9),
            100.0 * quantile(1, 0.5),
            100.0 * quantile(1, 0.9),
            100.0 * self.coverage(),
            self.inside
                .map(|count| format!("{:.0}", 100.0 * count as f64 / self.aligned.max(1) as f64))
                .join(", "),
            self.worst,
            self.over_bound(1.0),
            self.over_bound(0.9),
        )
    }
}

const HEAD: &str = "| camera | trials | correct | shifted | wrong | refused | rotation error deg, median / 90th | zoom error %, median / 90th | coverage of 95 % (axes, zoom) | worst error in sigmas | rmse over the bound, all / best 90 % |\n|---|---|---|---|---|---|---|---|---|---|---|";

/// Ranges of simulated changes: name, angle in degrees, relative change of the focal length.
const SIZES: [(&str, [f64; 2], [f64; 2]); 4] = [
    ("0.02 to 0.2 deg", [0.02, 0.2], [1e-6, 1e-3]),
    ("0.2 to 2 deg", [0.2, 2.0], [5e-3, 0.03]),
    ("2 to 8 deg", [2.0, 8.0], [0.01, 0.15]),
    ("8 to 20 deg", [8.0, 20.0], [0.05, 0.5]),
];

/// Runs `trials` comparisons per camera for every range of changes and for no change. Returns one row per
/// range.
fn measured(
    all: &[Stills],
    is_selected: &dyn Fn(&str) -> bool,
    trials: usize,
    covered: f64,
) -> BTreeMap<String, Row> {
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    let verbose = std::env::var_os("CALIB_COMPARE_VERBOSE").is_some();
    for (index, stills) in all.iter().enumerate().filter(|(_, stills)| is_selected(&stills.id)) {
        let mut random = ChaCha8Rng::seed_from_u64(index as u64);
        let other = &all[(index + 3) % all.len()].moments[0];
        let cover = &all[(index + 1) % all.len()].moments[0];
        // One camera change of each range, and no change.
        let sizes = SIZES.map(|(name, degrees, zoom)| (name, Some((degrees, zoom))));
        for (size, (name, moved)) in sizes.into_iter().chain([("unchanged", None)]).enumerate() {
            for number in 0..trials {
                let truth = moved.map(|(degrees, zoom)| random_rotation(&mut random, degrees, zoom));
                let moment = number % stills.moments.len();
                let still = match &truth {
                    Some(truth) => stills.turned(moment, truth, other),
                    None => stills.moments[moment].clone(),
                };
                let day = Day::any(&mut random, covered);
                let new = day.shown(still, cover, &mut random);
                let trial = trial(stills, &new, &truth.unwrap_or_default());
                if verbose {
                    println!("{} {name} {number}: {truth:.3?}, {trial:.4?}, {day:.2?}", stills.id);
                }
                rows.entry(format!("{size} {name}")).or_default().add(&trial, moved.is_some());
            }
        }
    }
    rows
}

/// Returns the number in an environment variable, or `default`.
fn number_from_env(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

#[test]
#[ignore = "takes minutes: `cargo xtask accuracy --compare`"]
fn table_of_rotations_and_zooms() {
    let all = stills(number_from_env("CALIB_COMPARE_WIDTH", WIDTH as usize) as u32);
    let trials = number_from_env("CALIB_COMPARE_TRIALS", 20);
    let chosen = std::env::var_os("CALIB_COMPARE_CHOSEN").is_some();
    println!("{HEAD}");
    for covered in [0.0, 0.6] {
        let rows = measured(&all, &|id| CHOSEN.contains(&id) == chosen, trials, covered);
        for (name, row) in &rows {
            println!("{}", row.text(&format!("{}, up to {:.0} % covered", &name[2..], 100.0 * covered)));
        }
    }
}

/// Prints the errors for different disturbances. A disturbance that moves neighbouring edge points together causes
/// errors beyond the bound.
#[test]
#[ignore = "takes minutes: `cargo xtask accuracy --compare`"]
fn table_of_correlated_disturbances() {
    let all = stills(number_from_env("CALIB_COMPARE_WIDTH", WIDTH as usize) as u32);
    let same = Day { gamma: 1.0, gain: 1.0, noise: 0.0, quality: 100, shadows: 0, covered: 0.0 };
    let days = [
        ("nothing", Day { ..same }),
        ("noise", Day { noise: 4.0, ..same }),
        ("JPEG of 90", Day { quality: 90, ..same }),
        ("JPEG of 50", Day { quality: 50, ..same }),
        ("gamma", Day { gamma: 1.4, ..same }),
        ("shadows", Day { shadows: 3, ..same }),
        ("noise, JPEG of 50", Day { noise: 4.0, quality: 50, ..same }),
    ];
    println!("{HEAD}");
    for ((name, day), moves) in days.iter().flat_map(|day| [(day, false), (day, true)]) {
        let mut row = Row::default();
        for (index, stills) in all.iter().enumerate().filter(|(_, stills)| !is_held_back(&stills.id)) {
            let mut random = ChaCha8Rng::seed_from_u64(4000 + index as u64);
            let other = &all[(index + 3) % all.len()].moments[0];
            for _ in 0..number_from_env("CALIB_COMPARE_TRIALS", 20) {
                let truth = moves.then(|| random_rotation(&mut random, [0.2, 2.0], [5e-3, 0.03]));
                let still =
                    truth.map_or_else(|| stills.moments[0].clone(), |truth| stills.turned(0, &truth, other));
                let new = day.shown(still, other, &mut random);
                row.add(&trial(stills, &new, &truth.unwrap_or_default()), moves);
            }
        }
        println!("{}", row.text(&format!("{name}, {}", if moves { "turned" } else { "still" })));
    }
    for (name, day) in &days {
        for (how, row) in ["resampled", "rendered"].into_iter().zip(rotated_shop(&all, day)) {
            println!("{}", row.text(&format!("{name}, one shop turned, {how}")));
        }
    }
}

/// Compares the shop with two images of it after a rotation: resampled from the old image, as for the street images,
/// and rendered.
fn rotated_shop(all: &[Stills], day: &Day) -> [Row; 2] {
    let shop = all.iter().find(|stills| stills.id == "shop-1").unwrap();
    let (other, larger) = (&all[0].moments[0], &shop.larger[0]);
    let (width, size) = (shop.moments[0].width(), [larger.width(), larger.height()]);
    let mut random = ChaCha8Rng::seed_from_u64(4100);
    let mut rows = [Row::default(), Row::default()];
    for _ in 0..number_from_env("CALIB_COMPARE_TRIALS", 20) {
        let truth = random_rotation(&mut random, [0.2, 2.0], [5e-3, 0.03]);
        let new = scaled(&truth.apply_to(&shop.camera), f64::from(size[0]) / f64::from(width));
        let stills = [shop.turned(0, &truth, other), reduced(&calib_demo::render(&new, size), width)];
        for (row, still) in rows.iter_mut().zip(stills) {
            row.add(&trial(shop, &day.shown(still, other, &mut random), &truth), true);
        }
    }
    rows
}

/// Counts the reports for unchanged cameras: other people, other light, up to 60 % covered.
#[test]
#[ignore = "takes an hour: `cargo xtask accuracy --compare`"]
fn table_of_unchanged_cameras() {
    let all = stills(number_from_env("CALIB_COMPARE_WIDTH", WIDTH as usize) as u32);
    let trials = number_from_env("CALIB_COMPARE_STILL", 2000);
    println!("| camera | trials | unchanged | moved | shifted | refused |\n|---|---|---|---|---|---|");
    let mut together: BTreeMap<&str, usize> = BTreeMap::new();
    let held_back: Vec<usize> = (0..all.len()).filter(|&index| is_held_back(&all[index].id)).collect();
    for (place, &index) in held_back.iter().enumerate() {
        let (stills, mut counts) = (&all[index], BTreeMap::new());
        let mut random = ChaCha8Rng::seed_from_u64(1000 + index as u64);
        let cover = &all[(index + 1) % all.len()].moments[0];
        // The trials are distributed evenly over the cameras.
        let own = trials / held_back.len() + usize::from(place < trials % held_back.len());
        for number in 0..own {
            let still = stills.moments[number % stills.moments.len()].clone();
            let day = Day::any(&mut random, 0.6);
            let new = day.shown(still, cover, &mut random);
            let found = compare(stills, &new);
            if found.change != CameraChange::Unchanged {
                print_if_verbose(&format!("{} {number}: {day:?}", stills.id), &found);
            }
            *counts.entry(change_name(found.change)).or_default() += 1;
        }
        println!("{}", counts_row(&stills.id, &counts));
        counts.into_iter().for_each(|(name, count)| *together.entry(name).or_default() += count);
    }
    println!("{}", counts_row("all", &together));
}

/// Returns the name of the report; all refusals share one name.
fn change_name(change: CameraChange) -> &'static str {
    match change {
        CameraChange::Unchanged => "unchanged",
        CameraChange::Moved => "moved",
        CameraChange::Shifted => "shifted",
        _ => "refused",
    }
}

fn counts_row(name: &str, counts: &BTreeMap<&'static str, usize>) -> String {
    let of = |name: &str| counts.get(name).copied().unwrap_or_default();
    let [unchanged, moved, shifted, refused] = ["unchanged", "moved", "shifted", "refused"].map(of);
    let all = unchanged + moved + shifted + refused;
    format!("| {name} | {all} | {unchanged} | {moved} | {shifted} | {refused} |")
}

/// Scene of known depth: a floor, walls around the camera at different distances, and two pillars.
struct Room {
    /// Position of the camera.
    centre: WorldPoint,
    /// Walls: direction as a unit vector on the floor, distance, and half width, in metres.
    walls: Vec<([f64; 2], f64, f64)>,
}

impl Room {
    /// Builds the scene around a camera: distant straight ahead, near at the sides, with two pillars in
    /// front.
    fn about(camera: &Camera) -> Self {
        let ahead = ahead(camera);
        // Angle to the left of the viewing direction in radians, distance in metres, half width in metres.
        let walls = [
            (0.1, 22.0, 100.0),
            (1.5, 9.0, 100.0),
            (-1.4, 7.0, 100.0),
            (3.1, 9.0, 100.0),
            (0.25, 11.0, 0.7),
            (-0.3, 14.0, 1.5),
        ];
        let walls = walls.map(|(left, far, half): (f64, f64, f64)| {
            ([(ahead + left).cos(), (ahead + left).sin()], far, half)
        });
        Self { centre: camera.position, walls: walls.to_vec() }
    }

    /// Returns the first intersection of a pixel's ray with the scene.
    fn met(&self, camera: &Camera, pixel: Pixel) -> Option<WorldPoint> {
        let WorldPoint { x, y, z } = camera.position;
        let [dx, dy, dz] = ray(camera, pixel)?;
        let floor = (dz < -1e-9).then(|| -z / dz);
        let of_wall = |&([nx, ny], far, half): &([f64; 2], f64, f64)| {
            let [px, py] = [x - self.centre.x, y - self.centre.y];
            let at = (far - px * nx - py * ny) / (dx * nx + dy * ny);
            let along = (px + at * dx) * -ny + (py + at * dy) * nx;
            (at > 0.0 && along.abs() < half).then_some(at)
        };
        let first = self.walls.iter().filter_map(of_wall).chain(floor).fold(f64::INFINITY, f64::min);
        first.is_finite().then(|| WorldPoint::new(x + first * dx, y + first * dy, z + first * dz))
    }

    /// Renders the image of the camera `new` from the image `still` of `camera`. Points hidden from `camera`
    /// come from `other`.
    fn still(&self, still: &RgbImage, camera: &Camera, new: &Camera, other: &RgbImage) -> RgbImage {
        /// Depth difference above which a point counts as hidden, in metres.
        const BEFORE: f64 = 0.05;
        let seen = |at: Pixel| {
            let point = self.met(new, at)?;
            let old = camera.world_to_pixel(point)?;
            let is_open = self.met(camera, old)?.distance(point) < BEFORE;
            if is_open { sample(still, old) } else { None }
        };
        RgbImage::from_fn(still.width(), still.height(), |x, y| {
            let colour = seen(Pixel::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let elsewhere = || other.get_pixel(x % other.width(), y % other.height()).0.map(f64::from);
            Rgb(colour.unwrap_or_else(elsewhere).map(|value| value.round().clamp(0.0, 255.0) as u8))
        })
    }
}

/// Returns the direction of a pixel's ray in the world.
fn ray(camera: &Camera, pixel: Pixel) -> Option<[f64; 3]> {
    let (seen, rows) = (pixel_to_camera_ray(camera, pixel)?, camera.rotation());
    Some(std::array::from_fn(|axis| (0..3).map(|row| rows[row][axis] * seen[row]).sum()))
}

/// Returns the azimuth of the viewing direction on the floor, in radians.
fn ahead(camera: &Camera) -> f64 {
    let [x, y, _] = camera.rotation()[2];
    y.atan2(x)
}

/// Moves a camera horizontally by `metres`, at most `aside` radians from its viewing direction, and rotates
/// it a little.
fn stepped_aside(camera: &Camera, metres: f64, aside: f64, random: &mut ChaCha8Rng) -> Camera {
    let direction = ahead(camera) + random.random_range(-aside..aside);
    let WorldPoint { x, y, z } = camera.position;
    let position = WorldPoint::new(x + metres * direction.cos(), y + metres * direction.sin(), z);
    let turn = random_rotation(random, [0.2, 2.0], [1e-4, 1e-3]);
    turn.apply_to(&Camera { position, ..*camera })
}

/// Distances of simulated sideways steps, in metres.
const STEPS: [f64; 3] = [0.1, 0.3, 1.0];

/// Counts the reports for sideways steps within the rendered demonstration, where objects occlude each other.
fn rendered_steps(chosen: bool, trials: usize) -> BTreeMap<String, BTreeMap<&'static str, usize>> {
    let mut rows: BTreeMap<String, BTreeMap<&'static str, usize>> = BTreeMap::new();
    let demo = calib_demo::demo_site();
    for (index, (id, camera)) in
        demo.truth.iter().enumerate().filter(|(_, (id, _))| is_held_back(id) != chosen)
    {
        let mut random = ChaCha8Rng::seed_from_u64(3000 + index as u64);
        let stills = rendered(id, camera, demo.site.cameras[index].size_px, WIDTH);
        let size = [stills.moments[0].width(), stills.moments[0].height()];
        for (metres, _) in STEPS.iter().flat_map(|metres| (0..trials).map(move |number| (metres, number))) {
            // Cameras are mounted in corners: do not step back through the wall.
            let camera = stepped_aside(&stills.camera, *metres, 0.8, &mut random);
            let still = calib_demo::render(&camera, size);
            let cover = &stills.moments[0];
            let new = Day { covered: 0.2, ..Day::any(&mut random, 0.0) }.shown(still, cover, &mut random);
            let found = compare(&stills, &new);
            print_if_verbose(&format!("{id} stepped by {metres:.1} m"), &found);
            *rows
                .entry(format!("1 rendered, stepped aside by {metres:.1} m"))
                .or_default()
                .entry(change_name(found.change))
                .or_default() += 1;
        }
    }
    rows
}

/// Prints the comparison if `CALIB_COMPARE_VERBOSE` is set.
fn print_if_verbose(what: &str, found: &Comparison) {
    if std::env::var_os("CALIB_COMPARE_VERBOSE").is_some() {
        let Comparison {
            change,
            z_score: clear,
            shift,
            visible_samples: places,
            found_fraction: found,
            chance_fraction: by_chance,
            rotation: turn,
            ..
        } = found;
        println!(
            "{what}: {change:?}, {turn:.4?}, z-score {clear:.1}, shift {shift:.2} px, {places} samples, {found:.2} found, {by_chance:.2} by chance"
        );
    }
}

/// Counts the reports for changes that are not rotations, on the selected half of the images.
fn other_changes(
    all: &[Stills],
    chosen: bool,
    trials: usize,
) -> BTreeMap<String, BTreeMap<&'static str, usize>> {
    let mut rows = rendered_steps(chosen, trials);
    for (index, stills) in all.iter().enumerate().filter(|(_, stills)| is_held_back(&stills.id) != chosen) {
        let mut random = ChaCha8Rng::seed_from_u64(2000 + index as u64);
        let [cover, other] = [1, 3].map(|by| &all[(index + by) % all.len()].moments[0]);
        let [w, h] = [stills.moments[0].width(), stills.moments[0].height()];
        let other = &image::imageops::resize(other, w, h, image::imageops::FilterType::Triangle);
        for number in 0..trials {
            let still = &stills.moments[number % stills.moments.len()];
            let mut shows = |name: String, new: RgbImage, covered: f64, random: &mut ChaCha8Rng| {
                let day = Day { covered, ..Day::any(random, 0.0) };
                let new = day.shown(new, cover, random);
                let found = compare(stills, &new);
                print_if_verbose(&format!("{} {name}", stills.id), &found);
                *rows.entry(name).or_default().entry(change_name(found.change)).or_default() += 1;
            };
            for metres in STEPS {
                let camera = stepped_aside(&stills.camera, metres, std::f64::consts::PI, &mut random);
                let new = Room::about(&stills.camera).still(still, &stills.camera, &camera, other);
                shows(format!("1 stepped aside by {metres:.1} m"), new, 0.2, &mut random);
            }
            shows("2 another camera".into(), other.clone(), 0.2, &mut random);
            for covered in [0.8, 0.9, 0.97] {
                let name = format!("3 still, {:.0} % covered", 100.0 * covered);
                shows(name, still.clone(), covered, &mut random);
            }
        }
    }
    rows
}

#[test]
#[ignore = "takes minutes: `cargo xtask accuracy --compare`"]
fn table_of_changes_other_than_rotations() {
    let all = stills(number_from_env("CALIB_COMPARE_WIDTH", WIDTH as usize) as u32);
    println!("| change | trials | unchanged | moved | shifted | refused |\n|---|---|---|---|---|---|");
    let chosen = std::env::var_os("CALIB_COMPARE_CHOSEN").is_some();
    for (name, counts) in other_changes(&all, chosen, number_from_env("CALIB_COMPARE_TRIALS", 20)) {
        println!("{}", counts_row(&name[2..], &counts));
    }
}

/// Whether the images of this camera were not used to choose the constants.
fn is_held_back(id: &str) -> bool {
    !CHOSEN.contains(&id)
}

#[test]
fn rotations_and_zooms_are_within_their_sigmas_and_unchanged_cameras_are_unchanged() {
    let all = stills(640);
    let rows = measured(&all, &is_held_back, 1, 0.4);
    let mut together = Row::default();
    println!("{HEAD}");
    for (name, row) in &rows {
        println!("{}", row.text(&name[2..]));
        together.trials += row.trials;
        together.refused += row.refused;
        together.wrong += row.wrong;
        together.shifted += row.shifted;
        together.aligned += row.aligned;
        (0..4).for_each(|k| together.inside[k] += row.inside[k]);
    }
    assert_eq!(together.wrong, 0, "moved and unchanged cameras are distinguished");
    assert_eq!(together.shifted, 0, "rotated and shifted cameras are distinguished");
    assert!(together.refused * 10 <= together.trials, "{} of {} refused", together.refused, together.trials);
    assert!(together.coverage() > 0.8, "{:.2} inside 95 %", together.coverage());
}

/// Returns a camera of the demonstration with a small image.
fn shop() -> Stills {
    let demo = calib_demo::demo_site();
    let (id, camera) = &demo.truth[2];
    rendered(id, camera, demo.site.cameras[2].size_px, 960)
}

fn compare(of: &Stills, new: &RgbImage) -> Comparison {
    Comparison::new(&of.camera, &[], &of.moments[0], new).unwrap()
}

#[test]
fn other_changes_are_not_reported_as_rotations() {
    let shop = shop();
    let (old, camera) = (&shop.moments[0], shop.camera);
    let size = [old.width(), old.height()];
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut night = |x, y| old.get_pixel(x, y).0.map(|value| value / 100 + random.random_range(0..5_u8));
    let dark = RgbImage::from_fn(size[0], size[1], |x, y| Rgb(night(x, y)));
    assert_eq!(compare(&shop, &dark).change, CameraChange::TooDark);
    let fog = image::imageops::blur(old, 25.0);
    assert_eq!(compare(&shop, &fog).change, CameraChange::Blind);
    let barn = calib_demo::demo_site().truth[4].1;
    let other = rendered("barn", &barn, [1920, 1080], size[0]).moments.remove(0);
    assert_eq!(compare(&shop, &other).change, CameraChange::DifferentView);
    for metres in STEPS {
        let WorldPoint { x, y, z } = camera.position;
        let position = WorldPoint::new(x - 0.83 * metres, y + 0.55 * metres, z);
        let beside = Camera { position, yaw: camera.yaw + 0.02, ..camera };
        let new = calib_demo::render(&beside, size);
        assert_eq!(compare(&shop, &new).change, CameraChange::Shifted, "{metres} m aside");
    }
    let turned = RotationZoom { vector: [0.01, 0.02, -0.005], zoom: 0.01 }.apply_to(&camera);
    assert_eq!(compare(&shop, &calib_demo::render(&turned, size)).change, CameraChange::Moved);
    let flat = RgbImage::from_pixel(size[0], size[1], Rgb([90; 3]));
    let nothing = Comparison::new(&camera, &[], &flat, old).unwrap();
    assert_eq!(nothing.change, CameraChange::TooFewEdges);
}

/// Periodic texture: a fence covers more than half of the image, and its posts match their neighbours.
#[test]
fn periodic_textures_do_not_mislead() {
    const APART: f64 = 24.0;
    let Stills { camera, larger, .. } = shop();
    let mut picture = larger[0].clone();
    let fenced = 7 * picture.height() / 10;
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        if y < fenced {
            let post = 0.5 + 0.4 * (f64::from(x) * std::f64::consts::TAU / APART).sin().signum();
            *pixel = Rgb([(255.0 * post) as u8; 3]);
        }
    }
    let larger_camera = scaled(&camera, f64::from(picture.width()) / 960.0);
    let fence = Stills::new("fence", larger_camera, vec![picture], 960);
    for posts in [0.8, 1.1, 2.0] {
        let shift = posts * 0.5 * APART;
        let truth = RotationZoom { vector: [0.0, shift / fence.camera.focal, 0.0], zoom: 0.0 };
        let new = fence.turned(0, &truth, &RgbImage::from_pixel(960, 540, Rgb([90; 3])));
        let found = compare(&fence, &new);
        print_if_verbose(&format!("{posts} posts"), &found);
        let left =
            RotationZoom::between(&found.rotation.apply_to(&fence.camera), &truth.apply_to(&fence.camera));
        let off = left.angle() * fence.camera.focal;
        assert!(
            !found.change.is_aligned() || off < 0.5,
            "{posts} posts: {off:.2} px off, {:?}",
            found.change
        );
    }
}

#[test]
fn image_of_another_size_is_refused_with_advice() {
    let (still, camera) = (RgbImage::new(64, 48), calib_demo::demo_site().truth[0].1);
    let error = Comparison::new(&camera, &[], &still, &RgbImage::new(48, 64)).unwrap_err();
    assert!(error.to_string().contains("48 x 64") && error.to_string().contains("take an image"), "{error}");
}

#[test]
#[ignore = "renders all of the demonstration twice: `cargo xtask accuracy --compare`"]
fn table_of_the_demonstration_a_month_later() {
    let scratch = Scratch::new();
    scratch.calib(&["demo", "--moved", "d"]).expect_code(0);
    let args = ["compare", "d/solved.json", "--still", "d/later", "--format", "json"];
    let run = scratch.calib(&args).expect_code(4);
    assert!(run.stderr.contains("shop-1, store"), "{}", run.stderr);
    let cameras = run.json()["cameras"].clone();
    for camera in cameras.as_array().unwrap() {
        println!("{camera}");
        let moved = calib_demo::changed_cameras().into_iter().find(|(id, _)| camera["camera"] == *id);
        let Some((_, turn)) = moved else {
            assert_eq!(camera["verdict"], "unchanged", "{camera}");
            continue;
        };
        assert_eq!(camera["verdict"], "moved", "{camera}");
        let number = |key: &str| camera[key].as_f64().unwrap();
        let off = number("turned_deg") - turn.angle().to_degrees();
        assert!(off.abs() < 3.5 * number("turned_sigma_deg") + 1e-3, "{camera}");
        let off = number("zoom") - turn.zoom.exp();
        assert!(off.abs() < 3.5 * number("zoom_sigma"), "{camera}");
        assert!(number("turned_sigma_deg") < 0.03 && number("zoom_sigma") < 1e-3, "{camera}");
        assert_eq!(camera["since"], "2026-06-01T09:00:00Z");
    }
    recovered(&scratch, &["shop-1", "store"]);
}

#[test]
fn command_finds_a_zoom_and_recovers_the_camera() {
    let scratch = Scratch::new();
    std::fs::create_dir_all(scratch.path("d/later")).unwrap();
    let demo = calib_demo::demo_site();
    let index = demo.site.cameras.iter().position(|camera| camera.id == "store").unwrap();
    let (entry, truth) = (demo.site.cameras[index].clone(), demo.truth[index].1);
    let turn = calib_demo::changed_cameras()[1].1;
    calib_demo::render(&truth, entry.size_px).save(scratch.path("d/store.png")).unwrap();
    let later = calib_demo::render_later(&turn.apply_to(&truth), entry.size_px);
    later.save(scratch.path("d/later/store_20260601_0900.png")).unwrap();
    let site = Site { cameras: vec![entry], ..Site::new() };
    scratch.write("d/site.json", site.to_json());
    scratch.calib(&["solve", "d/site.json", "-o", "d/solved.json"]).expect_code(0);
    let args = ["compare", "d/solved.json", "--camera", "store", "--format", "json", "--still"];
    let same = scratch.calib(&[&args[..], &["d/store.png"]].concat()).expect_code(0).json();
    assert_eq!(same["verdict"], "unchanged");
    let moved = scratch.calib(&[&args[..], &["d/later"]].concat()).expect_code(4).json();
    assert_eq!(moved["verdict"], "moved");
    let off = moved["zoom"].as_f64().unwrap() - 1.03;
    assert!(off.abs() < 3.5 * moved["zoom_sigma"].as_f64().unwrap() + 1e-5, "{moved}");
    scratch.calib(&["compare", "d/solved.json", "--still", "nowhere.png"]).expect_code(3);
    recovered(&scratch, &["store"]);
}

/// Checks the recovered cameras: errors are within 3.5 standard deviations, and old periods end where new
/// ones begin.
fn recovered(scratch: &Scratch, ids: &[&str]) {
    let args = ["compare", "d/solved.json", "--still", "d/later", "--recover", "-o", "d/new.json"];
    let run = scratch.calib(&args).expect_code(4);
    println!("{}", run.stderr);
    let text = std::fs::read_to_string(scratch.path("d/new.json")).unwrap();
    let site = Site::from_json(&text).unwrap();
    let truth = calib_demo::demo_site().truth;
    for (id, turn) in calib_demo::changed_cameras().into_iter().filter(|(id, _)| ids.contains(id)) {
        let entry = site.camera_at(id, Some("2026-07-01T00:00:00Z")).unwrap();
        let old = site.camera_at(id, Some("2026-05-01T00:00:00Z")).unwrap();
        assert_eq!(entry.valid_from.as_deref(), Some("2026-06-01T09:00:00Z"));
        assert_eq!(old.valid_to, entry.valid_from);
        assert!(entry.image.as_deref().is_some_and(|image| image.contains("later")), "{:?}", entry.image);
        let truth = turn.apply_to(&truth.iter().find(|(other, _)| other == id).unwrap().1);
        let found = entry.camera().unwrap();
        let off = [
            (Covariance::PITCH, found.pitch - truth.pitch),
            (Covariance::ROLL, found.roll - truth.roll),
            (Covariance::FOCAL, found.focal - truth.focal),
        ];
        for (index, off) in off {
            let sigma = found.covariance.sigma(index).unwrap();
            println!("{id}: {off:.5} off, sigma {sigma:.5}");
            assert!(off.abs() < 3.5 * sigma, "{id}: {off} off, sigma {sigma}");
        }
        println!("{id}: {:.3} m off", found.position.distance(truth.position));
        assert!(found.position.distance(truth.position) < 0.3);
    }
    let again = scratch.calib(&["compare", "d/new.json", "--still", "d/later"]);
    again.expect_code(0);
    recovered_into_another_folder(scratch, ids);
}

/// Checks recovery into another folder: the old periods are unchanged, and image paths are relative to the
/// new folder.
fn recovered_into_another_folder(scratch: &Scratch, ids: &[&str]) {
    std::fs::create_dir_all(scratch.path("else")).unwrap();
    let read = |name: &str| Site::from_json(&std::fs::read_to_string(scratch.path(name)).unwrap()).unwrap();
    let args = ["compare", "d/solved.json", "--still", "d/later", "--recover", "-o", "else/new.json"];
    scratch.calib(&args).expect_code(4);
    scratch.calib(&["solve", "d/new.json", "-o", "else/again.json"]).expect_code(0);
    for name in ["else/new.json", "else/again.json"] {
        let site = read(name);
        assert_eq!(site.cameras.len(), read("d/new.json").cameras.len(), "{name}");
        for camera in site.cameras {
            let image = camera.image.unwrap();
            assert!(scratch.path("else").join(&image).is_file(), "{name}: {image}");
        }
    }
    let (before, after) = (read("d/solved.json"), read("else/again.json"));
    for id in ids {
        let old = after.camera_at(id, Some("2026-05-01T00:00:00Z")).unwrap();
        let solution = old.solution.as_ref().unwrap();
        assert_eq!(solution.method, Method::Kept);
        let was = before.camera(id).unwrap().solution.as_ref().unwrap();
        assert_eq!(
            (solution.focal_px, solution.pitch_deg, solution.position_m),
            (was.focal_px, was.pitch_deg, was.position_m)
        );
    }
}
