//! Conversions of points, poses and covariances to [`nalgebra`].

use nalgebra::{Isometry3, Matrix2, Matrix3x4, Point2, Point3, Rotation3, Translation3, UnitQuaternion};

use crate::camera::floor_covariance::FloorCovariance;
use crate::camera::pinhole::Camera;
use crate::camera::space::{FloorPoint, Pixel, PlanPixel, UndistortedPixel, WorldPoint};

/// Implements the conversions of point types to and from points of `nalgebra`.
macro_rules! points {
    ($($name:ident = $point:ident, $array:ty;)+) => {$(
        impl From<$name> for $point<f64> {
            fn from(point: $name) -> Self {
                Self::from(<$array>::from(point))
            }
        }
        impl From<$point<f64>> for $name {
            fn from(point: $point<f64>) -> Self {
                <$array>::from(point).into()
            }
        }
    )+};
}

points! {
    Pixel = Point2, [f64; 2];
    UndistortedPixel = Point2, [f64; 2];
    FloorPoint = Point2, [f64; 2];
    PlanPixel = Point2, [f64; 2];
    WorldPoint = Point3, [f64; 3];
}

impl Camera {
    /// Returns the pose of the camera: the map from world points to camera axes (right, down, forward), in
    /// metres.
    #[must_use]
    pub fn camera_from_world_isometry(&self) -> Isometry3<f64> {
        let rows = self.rotation().concat();
        let matrix = nalgebra::Matrix3::from_row_slice(&rows);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
        Isometry3::from_parts(Translation3::from(self.translation()), rotation)
    }

    /// Returns the 3 x 4 matrix from homogeneous world points, in metres, to homogeneous undistorted pixels;
    /// see [`Camera::projection_matrix`].
    #[must_use]
    pub fn projection(&self) -> Matrix3x4<f64> {
        Matrix3x4::from_row_slice(&self.projection_matrix().concat())
    }
}

impl FloorCovariance {
    /// Returns the part of the covariance from pixel noise and the part from the calibration, both in square metres.
    /// The second part is `None` if the uncertainty of the camera is unknown.
    #[must_use]
    pub fn matrices(&self) -> (Matrix2<f64>, Option<Matrix2<f64>>) {
        let matrix = |rows: &[[f64; 2]; 2]| Matrix2::from_row_slice(&rows.concat());
        (matrix(&self.pixel), self.calibration.as_ref().map(matrix))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pose_and_matrix_agree_with_the_camera(
            camera in any_camera(), x in -50.0..50.0_f64, y in -50.0..50.0_f64, z in -1.0..3.0_f64,
        ) {
            let point = WorldPoint { x, y, z };
            let there = camera.camera_from_world_isometry() * Point3::from(point);
            let off = (there - Point3::from(camera.in_camera(point))).norm();
            prop_assert!(off < 1e-9, "{off} m");
            if let Some(pixel) = camera.world_to_undistorted(point).filter(|_| there.z > 0.1) {
                let shown = camera.projection() * Point3::from(point).to_homogeneous();
                let shown = Point2::new(shown.x / shown.z, shown.y / shown.z);
                prop_assert!((shown - Point2::from(pixel)).norm() < 1e-6 * (1.0 + shown.coords.norm()));
            }
        }
    }
}
