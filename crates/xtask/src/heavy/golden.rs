//! `cargo xtask golden`: reference results of the core for points of twenty cameras. Tests compare the results of
//! every language binding with them bit by bit.
//!
//! - `site.json` contains the cameras.
//! - `cameras.txt` has one line per camera: id, origin, fit, width and height of the stream, left, top, width
//!   and height of the crop, and height of the plane. Enumerations use the numbers of `calib.h`; 0 means not
//!   set.
//! - `points.f64` contains the result columns one after the other, camera by camera, as little-endian
//!   doubles.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::Context as _;
use calib_core::floor::{PixelOrigin, Stream, StreamFit, StreamMap};
use calib_core::{
    BrownConrady, Camera, Covariance, Distortion, Extent, FloorProjector, Lens, Pixel, PointProjector,
    Status, WorldPoint,
};
use calib_site::{CovarianceEntry, Method, Site, SiteCamera, Solution, Stage};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Number of cameras.
const CAMERAS: usize = 20;
/// Number of points per camera.
const POINTS: usize = 5000;
/// Number of columns of `points.f64`: u, v of the pixel; x, y, status of the floor point; its two covariances
/// of 4 values each (pixel noise, calibration); u, v, status of the reprojected point; the viewing ray of 3
/// values; u, v of the undistorted pixel.
const COLUMNS: usize = 21;
/// Standard deviation of a pixel coordinate, in pixels of the stream.
const SIGMA_PX: f64 = 1.5;
const IMAGE_SIZE: [u32; 2] = [1920, 1080];

/// Computes the golden values and writes `site.json`, `cameras.txt` and `points.f64` into the folder `out`.
pub(crate) fn run(out: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let mut random = ChaCha8Rng::seed_from_u64(20);
    let entries: Vec<SiteCamera> = (0..CAMERAS).map(|index| entry(index, &mut random)).collect();
    let (mut lines, mut bytes) = (String::new(), Vec::new());
    for (index, entry) in entries.iter().enumerate() {
        let (stream, height) = (stream(index), [0.0, 0.0, 0.35, -0.2][index % 4]);
        let (origin, fit) = (stream.origin as u32, stream.fit.map_or(0, |fit| fit as u32 + 1));
        let [width, height_px] = stream.size.unwrap_or_default();
        let [left, top, w, h] = stream.crop.unwrap_or_default();
        writeln!(lines, "{} {origin} {fit} {width} {height_px} {left} {top} {w} {h} {height}", entry.id)?;
        for column in columns(entry, &stream, height, &mut random)? {
            bytes.extend(column.into_iter().flat_map(f64::to_le_bytes));
        }
    }
    fs::write(out.join("site.json"), Site { cameras: entries, ..Site::new() }.to_json())?;
    fs::write(out.join("cameras.txt"), lines)?;
    fs::write(out.join("points.f64"), bytes)?;
    println!("{}: {} points", out.display(), CAMERAS * POINTS);
    Ok(())
}

fn stream(index: usize) -> Stream {
    let origin = if index % 2 == 1 { PixelOrigin::Centre } else { PixelOrigin::Corner };
    let still = Stream { origin, ..Stream::default() };
    match index % 5 {
        0 => still,
        1 => Stream { size: Some([1280, 720]), ..still },
        2 => Stream { size: Some([640, 640]), fit: Some(StreamFit::Letterbox), ..still },
        3 => Stream { size: Some([416, 416]), fit: Some(StreamFit::Stretch), ..still },
        _ => Stream { size: Some([800, 450]), crop: Some([160.0, 90.0, 1600.0, 900.0]), ..still },
    }
}

/// Creates a camera above the floor. The lens model varies with `index`, and most cameras have a covariance.
fn entry(index: usize, random: &mut ChaCha8Rng) -> SiteCamera {
    let mut about = |middle: f64, spread: f64| middle + random.random_range(-spread..spread);
    let focal = about(1300.0, 250.0);
    let distortion = match index % 6 {
        0 => Distortion::None,
        1 => Distortion::Division { lambda: about(-0.1, 0.08) },
        2 => Distortion::BrownConrady(BrownConrady {
            k1: about(-0.25, 0.1),
            k2: 0.08,
            p1: 0.001,
            p2: -0.0007,
            k3: -0.01,
        }),
        4 => Distortion::unified(1.1),
        5 => Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 },
        _ => calib_core::DistortionModel::KannalaBrandt
            .row()
            .zero
            .with_fitted_coefficients([0.02, -0.006, 0.002, -0.0004, 0.0]),
    };
    let mut camera = Camera {
        position: WorldPoint::new(about(0.0, 20.0), about(0.0, 20.0), about(4.5, 1.5)),
        yaw: about(0.0, 3.1),
        pitch: about(0.55, 0.25),
        roll: about(0.0, 0.06),
        focal,
        lens: Lens {
            principal_point: Pixel::new(about(960.0, 20.0), about(540.0, 20.0)),
            focal,
            distortion,
            image_circle: None,
            pixel_aspect: 1.0,
        },
        covariance: Covariance::EXACT,
    };
    for (which, sigma) in [(Covariance::Z, 0.03), (Covariance::PITCH, 0.004), (Covariance::FOCAL, 12.0)] {
        camera.covariance.0[which][which] = sigma * sigma;
    }
    // Some cameras have no covariance.
    let covariance = if index % 7 == 6 { None } else { CovarianceEntry::from_camera(&camera) };
    let solution = Solution { covariance, ..Solution::from_camera(&camera, Method::Given, Stage::Placed) };
    SiteCamera { solution: Some(solution), ..SiteCamera::new(format!("camera-{index}"), IMAGE_SIZE) }
}

fn columns(
    entry: &SiteCamera,
    stream: &Stream,
    height: f64,
    random: &mut ChaCha8Rng,
) -> anyhow::Result<[Vec<f64>; COLUMNS]> {
    let camera = entry.camera().context("the camera has no solution")?;
    let (map, efov) = (stream.map(entry.size())?, entry.floor_polygon());
    let extent = Extent { size: entry.size(), efov: &efov };
    let projector = FloorProjector::new(&camera, height);
    let shown = stream.crop.map(|[_, _, w, h]| [w as u32, h as u32]).unwrap_or(IMAGE_SIZE);
    let size = stream.size.unwrap_or(shown).map(f64::from);
    let mut rows = Vec::with_capacity(POINTS);
    for index in 0..POINTS {
        let mut pixel = size.map(|side| side * random.random_range(-0.1..1.1));
        // A few coordinates are NaN or infinite, as in the output of some detectors.
        if index % 500 == 7 {
            pixel[index % 2] = if index % 3 == 0 { f64::NAN } else { f64::INFINITY };
        }
        rows.push(row(&projector, &extent, &map, pixel));
    }
    Ok(std::array::from_fn(|column| rows.iter().map(|row| row[column]).collect()))
}

/// Computes the values of all columns for one pixel of the stream.
fn row(projector: &FloorProjector, extent: &Extent<'_>, map: &StreamMap, [u, v]: [f64; 2]) -> [f64; COLUMNS] {
    let (camera, height) = (projector.camera(), projector.height());
    let still = Pixel::new(map.to_image(0, u), map.to_image(1, v));
    let (mut x, mut y, mut status) = ([0.0], [0.0], [Status::Ok]);
    projector.pixels_to_floor_within(extent, [&[still.u], &[still.v]], [&mut x, &mut y], &mut status);
    let mut covariance = [[[0.0]; 3]; 2];
    let to = covariance.each_mut().map(|part| part.each_mut().map(|column| &mut column[..]));
    projector.floor_covariances([&[still.u], &[still.v]], SIGMA_PX * map.max_pixel_size(), to);
    let [noise, calibration] = covariance.map(|[[xx], [xy], [yy]]| [xx, xy, xy, yy]);
    let in_stream = |[u, v]: [f64; 2]| [map.to_stream(0, u), map.to_stream(1, v)];
    let (mut back_u, mut back_v) = ([0.0], [0.0]);
    let points = PointProjector::new(camera);
    points.points_to_pixels([&x, &y, &[height]], [&mut back_u, &mut back_v]);
    let (_, back_status) = extent.to_pixel(camera, WorldPoint::new(x[0], y[0], height));
    let back = in_stream([back_u[0], back_v[0]]);
    let ray = camera.pixel_to_ray(still).map_or([f64::NAN; 3], |ray| ray.direction);
    let (mut straight_u, mut straight_v) = ([0.0], [0.0]);
    projector.undistort_pixels(&[still.u], &[still.v], &mut straight_u, &mut straight_v);
    let straight = in_stream([straight_u[0], straight_v[0]]);
    let parts: [&[f64]; 7] = [
        &[u, v, x[0], y[0], f64::from(status[0] as u8)],
        &noise,
        &calibration,
        &back,
        &[f64::from(back_status as u8)],
        &ray,
        &straight,
    ];
    let mut row = [0.0; COLUMNS];
    row.iter_mut().zip(parts.concat()).for_each(|(to, value)| *to = value);
    row
}
