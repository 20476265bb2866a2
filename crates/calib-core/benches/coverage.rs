//! Benchmark of the coverage of 100 cameras at a million floor points, with 200 walls, and of their hand-over zones.

mod measure;

use std::hint::black_box;

use calib_core::camera::{Camera, Covariance, FloorPoint, WorldPoint};
use calib_core::floor::{Coverage, CoverageCamera, Extent, FloorGrid, Wall, default_efov};
use calib_core::{BrownConrady, Distortion, Lens, Pixel};
use measure::{median, report};

const SIZE: [f64; 2] = [1920.0, 1080.0];
/// Number of cameras along each side of the hall.
const SIDE: usize = 10;
/// Distance between cameras, in metres.
const SPACING: f64 = 10.0;

/// Returns cameras on a square grid, 4 m high, that look in different directions.
fn cameras(distortion: Distortion) -> Vec<Camera> {
    let camera = |index: usize| Camera {
        position: WorldPoint::new(
            SPACING * (index % SIDE) as f64 + 5.0,
            SPACING * (index / SIDE) as f64 + 5.0,
            4.0,
        ),
        yaw: index as f64,
        pitch: 0.5,
        roll: 0.0,
        focal: 1200.0,
        lens: Lens { focal: 1200.0, distortion, ..Lens::pinhole(Pixel::new(960.0, 540.0)) },
        covariance: errors(),
    };
    (0..SIDE * SIDE).map(camera).collect()
}

/// Returns independent errors of 5 cm, 0.3 degrees and 6 pixels.
fn errors() -> Covariance {
    let mut covariance = Covariance::EXACT;
    for (index, sigma) in [0.05, 0.05, 0.05, 0.005, 0.005, 0.005, 6.0].into_iter().enumerate() {
        covariance.0[index][index] = sigma * sigma;
    }
    covariance
}

/// Returns 200 walls of 3 m.
fn walls() -> Vec<Wall> {
    let wall = |index: usize| {
        let from = FloorPoint { x: 1.0 + 7.0 * (index % 14) as f64, y: 2.0 + 7.0 * (index / 14) as f64 };
        Wall { from, to: FloorPoint { x: from.x + 3.0, y: from.y }, height: 2.0 }
    };
    (0..200).map(wall).collect()
}

/// Returns the seconds that the coverage and the hand-over zones take.
fn measured(distortion: Distortion) -> [f64; 2] {
    let (cameras, walls) = (cameras(distortion), walls());
    let efovs: Vec<Vec<FloorPoint>> =
        cameras.iter().map(|camera| default_efov(camera, SIZE).polygon).collect();
    let of = |(camera, efov)| CoverageCamera { camera, extent: Extent { size: SIZE, efov } };
    let views: Vec<CoverageCamera<'_>> =
        cameras.iter().zip(efovs.iter().map(Vec::as_slice)).map(of).collect();
    let origin = FloorPoint { x: 0.0, y: 0.0 };
    let grid = FloorGrid { origin, step: 0.1, columns: 1000, rows: 1000 };
    let coverage = Coverage::new(&views, &walls, &grid, 0.0);
    let independent = |_: usize, _: usize| Some([[0.0; Covariance::SIZE]; Covariance::SIZE]);
    let zones = coverage.hand_overs(&views, &grid, 0.0, 100, &independent);
    assert!(zones.len() > 100 && zones.iter().all(|zone| zone.disagreement.is_ok()), "{}", zones.len());
    [
        median(3, || drop(black_box(Coverage::new(&views, &walls, &grid, 0.0)))),
        median(3, || drop(black_box(coverage.hand_overs(&views, &grid, 0.0, 100, &independent)))),
    ]
}

fn main() {
    let bent = BrownConrady { k1: -0.2, k2: 0.05, p1: 0.0, p2: 0.0, k3: 0.0 };
    let [straight, distorted] = [Distortion::None, Distortion::BrownConrady(bent)];
    report(&[
        ("coverage_100_cameras_s", &|| measured(straight)[0]),
        ("coverage_100_distorted_cameras_s", &|| measured(distorted)[0]),
        ("hand_overs_100_cameras_s", &|| measured(straight)[1]),
    ]);
}
