//! Example: registers the cameras of a solved site from their images, and compares them with the site.
//!
//! ```text
//! cargo run --release -p calib-image --example register -- calib-demo/solved.json [SEED ...]
//! ```
//!
//! With a seed, the calibrations have errors: focal lengths of 3 %, pitches and rolls of 0.5 degrees, heights
//! of 10 %, with random signs.

use std::path::Path;
use std::time::Instant;

use calib_core::Camera;
use calib_image::{SiteColours, SiteRegistration, View, join, register_pair};
use calib_site::Site;
use image::RgbImage;
use rand::{Rng, SeedableRng};

type Failure = Box<dyn std::error::Error>;

/// Names, cameras and images of a site.
type Loaded = (Vec<String>, Vec<Camera>, Vec<RgbImage>);

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, seeds @ ..] = arguments.as_slice() else {
        return Err("usage: register SITE [SEED ...]".into());
    };
    let (names, cameras, images) = load(Path::new(path))?;
    if seeds.is_empty() {
        measure(&names, &cameras, &cameras, &images);
    }
    for seed in seeds {
        println!("seed {seed}");
        let mut chance = rand_chacha::ChaCha8Rng::seed_from_u64(seed.parse()?);
        let changed: Vec<Camera> = cameras.iter().map(|camera| perturbed(camera, &mut chance)).collect();
        measure(&names, &cameras, &changed, &images);
    }
    Ok(())
}

/// Loads the calibrated cameras of a site, and their images.
fn load(path: &Path) -> Result<Loaded, Failure> {
    let site = Site::from_json(&std::fs::read_to_string(path)?)?;
    let (mut names, mut cameras, mut images) = (Vec::new(), Vec::new(), Vec::new());
    for entry in &site.cameras {
        let (Some(camera), Some(file)) = (entry.camera(), &entry.image) else { continue };
        let file = path.parent().unwrap_or(Path::new("")).join(file);
        images.push(image::load_from_memory(&std::fs::read(file)?)?.into_rgb8());
        names.push(entry.id.clone());
        cameras.push(camera);
    }
    Ok((names, cameras, images))
}

/// Returns a camera with errors in its calibration.
fn perturbed(camera: &Camera, chance: &mut impl Rng) -> Camera {
    let mut sign = || if chance.random_bool(0.5) { 1.0 } else { -1.0 };
    let mut changed = *camera;
    let zoom = 1.0 + 0.03 * sign();
    changed.focal *= zoom;
    changed.lens.focal *= zoom;
    changed.pitch += 0.5_f64.to_radians() * sign();
    changed.roll += 0.5_f64.to_radians() * sign();
    changed.position.z *= 1.0 + 0.1 * sign();
    changed
}

/// Registers the cameras, and prints the pairs and the errors.
fn measure(names: &[String], truth: &[Camera], cameras: &[Camera], images: &[RgbImage]) {
    let views: Vec<View> = cameras
        .iter()
        .zip(images)
        .map(|(camera, image)| View {
            camera,
            size_px: image.dimensions().into(),
            image,
            is_height_known: false,
        })
        .collect();
    let start = Instant::now();
    let site = SiteColours::new(&views);
    println!("preparation: {:.2} s", start.elapsed().as_secs_f64());
    let mut pairs = Vec::new();
    for views in site.pairs() {
        let start = Instant::now();
        let pair = register_pair(&site, views);
        let [a, b] = views;
        let [turn, shift] =
            pair_errors([&truth[a], &truth[b]], cameras[b].position.z, pair.yaw, pair.baseline);
        println!(
            "{:10} {:10} score {:5.0} ratio {:.2} {:9} \
             error {turn:6.1} deg, {shift:5.2} m of {:5.2} m, {:.2} s",
            names[a],
            names[b],
            pair.score,
            pair.ratio,
            format!("{:?}", pair.decision),
            pair.baseline[0].hypot(pair.baseline[1]),
            start.elapsed().as_secs_f64()
        );
        pairs.push(pair);
    }
    let start = Instant::now();
    let Some(site) = join(&site, &pairs, &mut |_| true) else { return };
    println!("joint: {:.2} s", start.elapsed().as_secs_f64());
    for pair in &site.agreement {
        println!(
            "  {} {}: yaw {:.2} deg, baseline {:.2} m, {}",
            names[pair.views[0]],
            names[pair.views[1]],
            pair.yaw_difference.to_degrees(),
            pair.baseline_difference,
            if pair.agrees { "agrees" } else { "differs" }
        );
    }
    print_errors(names, truth, &site);
}

/// Returns the errors of a pair: yaw in degrees, baseline in metres. `height` is the given height of the
/// second camera, in metres.
fn pair_errors([a, b]: [&Camera; 2], height: f64, yaw: f64, baseline: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = b.yaw.sin_cos();
    let scale = height / b.position.z;
    let [dx, dy] = [a.position.x - b.position.x, a.position.y - b.position.y].map(|c| c * scale);
    let [x, y] = [cos * dx + sin * dy, cos * dy - sin * dx];
    let turn = (yaw - (a.yaw - b.yaw)).to_degrees();
    [turn - 360.0 * (turn / 360.0).round(), (baseline[0] - x).hypot(baseline[1] - y)]
}

/// Prints the errors of each group after the best similarity of the floor.
fn print_errors(names: &[String], truth: &[Camera], site: &SiteRegistration) {
    for group in &site.groups {
        let count = group.len() as f64;
        let pose = |view: usize| site.cameras[view].as_ref().unwrap_or(&truth[view]);
        let mean = |at: &dyn Fn(usize) -> f64| group.iter().map(|&view| at(view)).sum::<f64>() / count;
        let from = [mean(&|view| pose(view).position.x), mean(&|view| pose(view).position.y)];
        let to = [mean(&|view| truth[view].position.x), mean(&|view| truth[view].position.y)];
        let (mut real, mut imaginary, mut square) = (0.0, 0.0, 0.0);
        let centred = |view: usize| {
            let (p, q) = (pose(view).position, truth[view].position);
            ([p.x - from[0], p.y - from[1]], [q.x - to[0], q.y - to[1]])
        };
        for (p, q) in group.iter().map(|&view| centred(view)) {
            real += p[0] * q[0] + p[1] * q[1];
            imaginary += p[0] * q[1] - p[1] * q[0];
            square += p[0] * p[0] + p[1] * p[1];
        }
        let (real, imaginary) = (real / square, imaginary / square);
        let scale = real.hypot(imaginary);
        let turn = imaginary.atan2(real);
        let yaw_error = |view: usize| {
            let error = (pose(view).yaw + turn - truth[view].yaw).to_degrees();
            error - 360.0 * (error / 360.0).round()
        };
        println!("  scale {scale:.3}");
        for &view in group {
            let (p, q) = centred(view);
            let at = [real * p[0] - imaginary * p[1], imaginary * p[0] + real * p[1]];
            let height = scale * pose(view).position.z / truth[view].position.z;
            println!(
                "  {:10} position error {:.2} m, yaw error {:+.2} deg, height ratio {height:.3}",
                names[view],
                (at[0] - q[0]).hypot(at[1] - q[1]),
                yaw_error(view)
            );
        }
    }
}
