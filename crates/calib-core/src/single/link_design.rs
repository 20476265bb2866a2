//! What points of the floor that another camera sees as well would tell of roll, pitch and focal: an
//! experimental design, as that of drawings.
//!
//! The other camera is thought to be like this one, as well known, and to look at the same floor from the side.
//! A point seen by both gives `F(p) - S F'(p')`, two numbers: the maps F of both cameras to their floors, and the
//! similarity S between the floors. With this camera's parameters first, those of the other and of S are
//! eliminated: `A - B D^-1 B'`.

use nalgebra::{DMatrix, Matrix2, Matrix4};

use crate::camera::{Camera, Covariance, FloorPoint, Pixel};
use crate::single::residual::{LOG_FOCAL, PITCH, ROLL};

/// Where on the image the points are, as shares of width and height from its middle.
const PLACES: [[f64; 2]; 4] = [[-0.25, 0.1], [0.25, 0.1], [-0.2, 0.35], [0.2, 0.35]];
/// Roll, pitch and log focal of this camera, those of the other, and move, turn and scale between them.
const OWN: usize = 3;
const ALL: usize = 2 * OWN + 4;

/// The information about roll, pitch, log focal and log height that four shared points add to `information`, for
/// pixels of this standard deviation; `None` where the image does not show the floor at all four.
pub(crate) fn shared_points(
    camera: &Camera,
    size: [f64; 2],
    sigma: f64,
    information: &Matrix4<f64>,
) -> Option<Matrix4<f64>> {
    let [w, h] = size;
    let pixel = |[x, y]: [f64; 2]| Pixel::new((0.5 + x) * w, (0.5 + y) * h);
    let pixels = PLACES.map(pixel);
    let points: Vec<FloorPoint> =
        pixels.iter().map(|&pixel| camera.pixel_to_floor(pixel, 0.0)).collect::<Option<_>>()?;
    let count = points.len() as f64;
    let middle = FloorPoint {
        x: points.iter().map(|at| at.x).sum::<f64>() / count,
        y: points.iter().map(|at| at.y).sum::<f64>() / count,
    };
    let known = of_angles(information);
    let mut normal = DMatrix::<f64>::zeros(ALL, ALL);
    normal.view_mut((OWN, OWN), (OWN, OWN)).copy_from(&known);
    for (&pixel, point) in pixels.iter().zip(&points) {
        let (own, noise) = jacobian(camera, pixel, sigma)?;
        let (x, y) = (point.x - middle.x, point.y - middle.y);
        // From the side: the point is where a quarter turn about the middle takes it.
        let turned = FloorPoint { x: middle.x + y, y: middle.y - x };
        let (other, noise_of_other) = jacobian(camera, camera.world_to_pixel(turned.at_height(0.0))?, sigma)?;
        let back = Matrix2::new(0.0, -1.0, 1.0, 0.0);
        let mut row = DMatrix::<f64>::zeros(2, ALL);
        row.view_mut((0, 0), (2, OWN)).copy_from(&own);
        row.view_mut((0, OWN), (2, OWN)).copy_from(&(-(back * other)));
        row.view_mut((0, 2 * OWN), (2, 4)).copy_from(&DMatrix::from_row_slice(
            2,
            4,
            &[1.0, 0.0, -y, x, 0.0, 1.0, x, y],
        ));
        let weight = (noise + back * noise_of_other * back.transpose()).try_inverse()?;
        normal += row.transpose() * weight * row;
    }
    let rest = ALL - OWN;
    let (own, cross, others) = (
        normal.view((0, 0), (OWN, OWN)),
        normal.view((0, OWN), (OWN, rest)),
        normal.view((OWN, OWN), (rest, rest)),
    );
    let added = own - cross * others.clone_owned().try_inverse()? * cross.transpose();
    let places = [ROLL, PITCH, LOG_FOCAL];
    let mut full = Matrix4::zeros();
    for (i, &a) in places.iter().enumerate() {
        for (j, &b) in places.iter().enumerate() {
            full[(a, b)] = added[(i, j)];
        }
    }
    Some(full)
}

/// The information about roll, pitch and log focal, the height eliminated.
fn of_angles(information: &Matrix4<f64>) -> DMatrix<f64> {
    let height = information[(3, 3)];
    DMatrix::from_fn(OWN, OWN, |i, j| {
        let through = if height > 0.0 { information[(i, 3)] * information[(3, j)] / height } else { 0.0 };
        // A floor under what nothing tells, so that it can be eliminated.
        information[(i, j)] - through + if i == j { 1e-6 } else { 0.0 }
    })
}

/// Derivatives of a floor point by roll, pitch and log focal, and its covariance.
fn jacobian(camera: &Camera, pixel: Pixel, sigma: f64) -> Option<(DMatrix<f64>, Matrix2<f64>)> {
    let by = camera.floor_jacobian(pixel)?;
    let columns =
        [by[Covariance::ROLL], by[Covariance::PITCH], by[Covariance::FOCAL].map(|by| by * camera.focal)];
    let [[xx, xy], [_, yy]] = camera.floor_covariance(pixel, sigma)?.pixel;
    Some((DMatrix::from_fn(2, OWN, |i, k| columns[k][i]), Matrix2::new(xx, xy, xy, yy)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Lens, WorldPoint};

    fn camera() -> Camera {
        let mut covariance = Covariance::EXACT;
        for index in [Covariance::ROLL, Covariance::PITCH, Covariance::FOCAL] {
            covariance.0[index][index] = 1e-4;
        }
        Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 0.6,
            roll: 0.02,
            focal: 1200.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance,
        }
    }

    #[test]
    fn points_tell_more_the_better_the_other_camera_is_known() {
        let told = |known: f64| {
            let information = Matrix4::from_diagonal(&nalgebra::Vector4::new(known, known, known, 0.0));
            shared_points(&camera(), [1920.0, 1080.0], 1.0, &information).unwrap()
        };
        let (little, much) = (told(10.0), told(1e5));
        for k in [ROLL, PITCH, LOG_FOCAL] {
            assert!(much[(k, k)] > little[(k, k)] && little[(k, k)] >= -1e-9, "{k}: {little} {much}");
        }
        // No more than all of what the points say.
        assert!(much[(ROLL, ROLL)] < 1e7, "{much}");
    }

    #[test]
    fn a_camera_that_sees_no_floor_shares_none() {
        let up = Camera { pitch: -0.6, ..camera() };
        assert!(shared_points(&up, [1920.0, 1080.0], 1.0, &Matrix4::identity()).is_none());
    }
}
