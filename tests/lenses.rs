//! Distortion from polylines: a real lens photographed with chessboards, and synthetic edges.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_core::{
    BrownConrady, Distortion, Edge, Fitted, Lens, LensFit, LensOptions, Pixel, Source, UndistortedPixel,
};
use calib_demo::random::normal;
use calib_tests::shared;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

fn edge(points: Vec<Pixel>, annotation: usize) -> Edge {
    Edge { points, source: Source { annotation, segment: 0 } }
}

#[test]
fn synthetic_edges_give_the_lens_back() {
    let mut random = ChaCha8Rng::seed_from_u64(41);
    let size = [1920.0, 1080.0];
    let half_diagonal = 0.5 * f64::hypot(size[0], size[1]);
    let mut errors = Vec::new();
    for scene in 0..30 {
        // Corner displacement from 7 to 570 px.
        let displacement = 7.0 * (570.0_f64 / 7.0).powf(f64::from(scene) / 29.0);
        // In units of half the diagonal the corner at 1 shows what a pinhole shows at r; k2 keeps the map growing.
        let r = 1.0 + displacement / half_diagonal;
        let bend = if scene % 2 == 0 { 0.15 * (r - 1.0) / 0.5 } else { 0.15 * ((r - 1.3) / 0.2).max(0.0) };
        let brown = BrownConrady {
            k1: (1.0 / r - 1.0 - bend) / r.powi(2),
            k2: bend / r.powi(4),
            ..BrownConrady::default()
        };
        let distortion = Distortion::BrownConrady(brown);
        let lens = Lens { principal_point: Pixel::new(960.0, 540.0), focal: half_diagonal, distortion };
        let count = random.random_range(4..10);
        let mut edges = Vec::new();
        while edges.len() < count {
            let mut raw = || Pixel::new(random.random_range(0.0..size[0]), random.random_range(0.0..size[1]));
            let (Some(a), Some(b)) = (lens.undistort(raw()), lens.undistort(raw())) else { continue };
            if a.distance(b) < 700.0 {
                continue;
            }
            let points: Vec<Pixel> = (0..9)
                .filter_map(|i| {
                    let t = f64::from(i) / 8.0;
                    let p = lens
                        .distort(UndistortedPixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) })?;
                    Some(Pixel { u: p.u + 0.3 * normal(&mut random), v: p.v + 0.3 * normal(&mut random) })
                })
                .collect();
            edges.push(edge(points, edges.len()));
        }
        let options = LensOptions {
            principal_point: lens.principal_point,
            size,
            fitted: None,
            focal: None,
            sigma: 0.3,
        };
        let fit = LensFit::new(&edges, &options).unwrap();
        let error = map_distance(&fit.lens, &lens, size);
        println!(
            "{scene}: displacement {displacement:.0} px, {count} edges, {:?}, map error {error:.2} px, predicted {:?}, straight {:?}",
            fit.fitted, fit.map_error, fit.straightness
        );
        errors.push((error, fit.map_error[2]));
    }
    let mut sorted: Vec<f64> = errors.iter().map(|(error, _)| *error).collect();
    sorted.sort_by(f64::total_cmp);
    println!("median {:.2}, 90th percentile {:.2}, worst {:.2}", sorted[15], sorted[27], sorted[29]);
    assert!(sorted[15] <= 0.9 && sorted[27] <= 3.5, "{sorted:?}");
    assert!(errors.iter().all(|(error, predicted)| *error <= 10.0 || *predicted > 10.0), "{errors:?}");
}

/// Root mean square distance over the image between two maps, once a similarity makes them as near
/// as they can be: a scale and a turn of the undistorted plane are not distortion.
fn map_distance(a: &Lens, b: &Lens, [w, h]: [f64; 2]) -> f64 {
    let grid = (0..20 * 12)
        .map(|k| Pixel::new(w * (f64::from(k % 20) + 0.5) / 20.0, h * (f64::from(k / 20) + 0.5) / 12.0));
    let pairs: Vec<_> = grid.filter_map(|p| Some((a.undistort(p)?, b.undistort(p)?))).collect();
    assert!(pairs.len() > 200, "{} of 240 points are inside both lenses", pairs.len());
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&(UndistortedPixel, UndistortedPixel)) -> f64| {
        pairs.iter().map(value).sum::<f64>() / count
    };
    let (au, av, bu, bv) = (mean(&|p| p.0.u), mean(&|p| p.0.v), mean(&|p| p.1.u), mean(&|p| p.1.v));
    let (mut dot, mut cross, mut square) = (0.0, 0.0, 0.0);
    for (p, q) in &pairs {
        let (x, y, s, t) = (p.u - au, p.v - av, q.u - bu, q.v - bv);
        dot += x * s + y * t;
        cross += x * t - y * s;
        square += x * x + y * y;
    }
    let (c, s) = (dot / square, cross / square);
    let off = pairs.iter().map(|(p, q)| {
        let (x, y) = (p.u - au, p.v - av);
        (c * x - s * y - (q.u - bu)).powi(2) + (s * x + c * y - (q.v - bv)).powi(2)
    });
    (off.sum::<f64>() / count).sqrt()
}

#[test]
fn a_real_lens_is_straightened_as_well_as_by_a_calibration() {
    let Some(file) = shared("real/chessboard/left.json") else { return };
    let data: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let edges: Vec<Edge> =
        polylines(&data).into_iter().enumerate().map(|(i, points)| edge(points, i)).collect();
    assert!(edges.len() > 100);
    let size = [640.0, 480.0];
    let reference = |key: &str| {
        let entry = &data["reference"][key];
        let k: Vec<f64> = serde_json::from_value(entry["dist_opencv_k1_k2_p1_p2_k3"].clone()).unwrap();
        let brown = BrownConrady { k1: k[0], k2: k[1], p1: k[2], p2: k[3], k3: k[4] };
        let principal_point: Pixel = serde_json::from_value(entry["principal_point"].clone()).unwrap();
        Lens {
            principal_point,
            focal: entry["focal_px"][0].as_f64().unwrap(),
            distortion: Distortion::BrownConrady(brown),
        }
    };
    let reference = reference("k1k2");
    let k1_k2 = Fitted::BrownConrady([true, true, false, false, false]);
    for (fitted, most) in [(None, 0.10), (Some(k1_k2), 0.095), (Some(Fitted::Division), 0.10)] {
        let options =
            LensOptions { principal_point: reference.principal_point, size, fitted, focal: None, sigma: 0.1 };
        let fit = LensFit::new(&edges, &options).unwrap();
        // The reference's figure is the mean over the polylines.
        let mean = fit.residuals.iter().map(|(_, px)| px).sum::<f64>() / fit.residuals.len() as f64;
        let apart = map_distance(&fit.lens, &reference, size);
        println!("{:?}: straightness {mean:.4} px, {apart:.3} px rms from the reference map", fit.fitted);
        assert!(mean <= most, "{mean}");
        // Another family of lenses differs in the corners, which no board has reached.
        assert!(apart <= if fit.fitted == Some(Fitted::Division) { 0.6 } else { 0.5 }, "{apart} px");
    }
}

fn polylines(data: &Value) -> Vec<Vec<Pixel>> {
    let mut found = Vec::new();
    for board in data["boards"].as_array().unwrap() {
        for line in board["polylines"].as_array().unwrap() {
            found.push(serde_json::from_value(line.clone()).unwrap());
        }
    }
    found
}
