//! Orientation and focal length of one camera from annotated lines, with their standard deviations.
//!
//! ```text
//! cargo run --release -p calib-core --example fit_camera
//! ```

use calib_core::{Annotation, Constraints, Covariance, Fit, FitOptions, Kind, Lens, Pixel, SceneErrors};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let line = |[a, b]: [(f64, f64); 2]| vec![Pixel::from(<[f64; 2]>::from(a)), <[f64; 2]>::from(b).into()];
    let annotation = |kind, lines: &[[(f64, f64); 2]]| {
        Annotation::from_segments(kind, lines.iter().copied().map(line).collect())
    };
    let annotations = [
        annotation(
            Kind::Vertical,
            &[
                [(641.5, 465.0), (594.5, 105.3)],
                [(1325.2, 484.9), (1368.5, 105.5)],
                [(1008.0, 352.3), (1008.4, 48.5)],
            ],
        ),
        annotation(
            Kind::Parallel,
            &[
                [(624.5, 759.5), (642.3, 421.9)],
                [(1325.8, 745.8), (1086.0, 411.5)],
                [(989.1, 808.5), (869.1, 438.3)],
            ],
        ),
        annotation(
            Kind::Perpendicular,
            &[[(837.1, 691.7), (1076.8, 582.4)], [(1140.2, 631.0), (916.2, 517.0)]],
        ),
    ];
    let lens = Lens::pinhole(Pixel::new(960.0, 540.0));
    let fit = Fit::new(
        &Constraints::new(&annotations, &lens, SceneErrors::default()),
        &FitOptions::new(lens, [1920.0, 1080.0]),
    )?;
    let camera = fit.camera;
    let sigma = |index| camera.covariance.sigma(index).unwrap_or(f64::NAN);
    let degrees =
        |angle: f64, index| format!("{:.2} ± {:.2}°", angle.to_degrees(), sigma(index).to_degrees());
    println!("roll  {}", degrees(camera.roll, Covariance::ROLL));
    println!("pitch {}", degrees(camera.pitch, Covariance::PITCH));
    println!("focal {:.0} ± {:.0} px", camera.focal, sigma(Covariance::FOCAL));
    println!("floor ± {:.1} %", 100.0 * fit.floor_length_rel.unwrap_or(f64::NAN));
    println!("floor point of the image centre: {:?}", camera.pixel_to_floor(Pixel::new(960.0, 540.0), 0.0));
    Ok(())
}
