//! Example: maps detected feet to metres on the floor, as whole columns, with status and standard deviation.
//!
//! ```text
//! cargo run --release -p calib-site --example project_detections -- calib-demo/solved.json shop-1
//! ```

use calib_core::{Extent, FloorProjector, Pixel, Status};

use calib_site::Site;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, id] = arguments.as_slice() else { return Err("usage: project_detections SITE CAMERA".into()) };
    let site = Site::from_json(&std::fs::read_to_string(path)?)?;
    let entry = site.camera(id).ok_or("no such camera")?;
    let camera = entry.camera().ok_or("the camera is not calibrated")?;

    // Middle of the lower edge of every box. A column of pixels replaces a detector here.
    let [width, height] = entry.size();
    let v: Vec<f64> = (0..10).map(|i| height * (0.05 + 0.1 * f64::from(i))).collect();
    let u = vec![0.5 * width; v.len()];

    let efov = entry.floor_polygon();
    let extent = Extent { size: entry.size(), efov: &efov };
    let (mut x, mut y, mut status) = (vec![0.0; u.len()], vec![0.0; u.len()], vec![Status::Ok; u.len()]);
    FloorProjector::new(&camera, 0.0).pixels_to_floor_within(
        &extent,
        [&u, &v],
        [&mut x, &mut y],
        &mut status,
    );
    for i in 0..u.len() {
        // The pixel part is independent between detections; the calibration part is not.
        let covariance = camera.floor_covariance(Pixel::new(u[i], v[i]), 2.0);
        let sigma = covariance.and_then(|covariance| covariance.worst_sigma()).unwrap_or(f64::NAN);
        println!(
            "({:6.1}, {:6.1}) px  {:14}  {:7.2} {:7.2} m  ± {sigma:.2} m",
            u[i],
            v[i],
            status[i].name(),
            x[i],
            y[i]
        );
    }
    Ok(())
}
