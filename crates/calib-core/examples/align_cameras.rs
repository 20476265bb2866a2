//! Alignment of two cameras without a floor plan: each is fitted from its annotated lines, then both are
//! adjusted with shared landmarks. The scene is synthetic, so the correct result is known.
//!
//! ```text
//! cargo run --release -p calib-core --example align_cameras
//! ```

use calib_core::{
    Annotation, BundleAdjustment, BundleCamera, Camera, Constraints, Covariance, Fit, FitOptions,
    InitialPose, Kind, Landmark, LandmarkModel, Lens, Observation, Pixel, SceneErrors, WorldPoint,
};

const SIZE: [f64; 2] = [1920.0, 1080.0];

fn camera(x: f64, y: f64, yaw: f64) -> Camera {
    let lens = Lens::pinhole(Pixel::new(960.0, 540.0));
    let position = WorldPoint::new(x, y, 4.0);
    Camera { position, yaw, pitch: 0.6, roll: 0.02, focal: 1200.0, lens, covariance: Covariance::EXACT }
}

/// Returns the visible edges of four pillars and of the tiles between them, as annotations.
fn annotations(camera: &Camera) -> Vec<Annotation> {
    let line =
        |ends: [[f64; 3]; 2]| ends.iter().filter_map(|&end| camera.world_to_pixel(end.into())).collect();
    let corners = [[-1.5, 5.0], [1.5, 5.0], [-1.5, 8.0], [1.5, 8.0]];
    let pillars = corners.map(|[x, y]| line([[x, y, 0.0], [x, y, 1.5]]));
    let along = [-1.5, 0.0, 1.5].map(|x| line([[x, 5.0, 0.0], [x, 8.0, 0.0]]));
    let across = [5.0, 6.5, 8.0].map(|y| line([[-1.5, y, 0.0], [1.5, y, 0.0]]));
    let annotation = |kind, lines: &[Vec<Pixel>]| Annotation::from_segments(kind, lines.to_vec());
    vec![
        annotation(Kind::Vertical, &pillars),
        annotation(Kind::Parallel, &along),
        annotation(Kind::Parallel, &across),
    ]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let truth = [camera(0.0, 0.0, 0.0), camera(2.0, 0.5, 0.2)];
    let options = FitOptions { sigma: Some(1.0), ..FitOptions::new(truth[0].lens, SIZE) };
    let lines = truth.each_ref().map(annotations);
    let constraints =
        lines.each_ref().map(|lines| Constraints::new(lines, &options.lens, SceneErrors::EXACT));
    let fits = [Fit::new(&constraints[0], &options)?, Fit::new(&constraints[1], &options)?];
    let member = |i: usize| BundleCamera::from_fit(&fits[i], &constraints[i], &lines[i], &options);

    // The first camera is the origin of the base system; its height of 4 m determines the scale.
    let first = BundleCamera { camera: truth[0], initial_pose: InitialPose::Fixed, ..member(0) };
    let landmarks = [[0.5, 5.2], [-0.5, 7.0], [1.2, 6.0], [0.0, 7.9]].map(|[x, y]| {
        let views = truth.iter().enumerate();
        let observations = views.filter_map(|(view, camera)| {
            Some(Observation::new(view, camera.world_to_pixel(WorldPoint::new(x, y, 0.0))?))
        });
        Landmark::new(LandmarkModel::Point { height: 0.0 }, observations.collect())
    });
    let adjustment = BundleAdjustment {
        cameras: vec![first, member(1)],
        landmarks: landmarks.to_vec(),
        ..BundleAdjustment::default()
    };
    let summary = adjustment.solve()?;
    let second = summary.cameras[1].as_ref().ok_or("the second camera is not connected")?.camera;
    let WorldPoint { x, y, z } = second.position;
    let sigma = |index| second.covariance.sigma(index).unwrap_or(f64::NAN);
    println!("second camera at ({x:.3}, {y:.3}, {z:.3}) m, yaw {:.2}°", second.yaw.to_degrees());
    println!(
        "± {:.3}, {:.3}, {:.3} m, {:.2}°",
        sigma(0),
        sigma(1),
        sigma(2),
        sigma(Covariance::YAW).to_degrees()
    );
    Ok(())
}
