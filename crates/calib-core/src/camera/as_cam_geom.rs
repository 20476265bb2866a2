//! Conversion of a camera without distortion to the camera of [`cam_geom`].

use cam_geom::{ExtrinsicParameters, IntrinsicParametersPerspective, PerspectiveParams};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion};

use crate::camera::pinhole::Camera;

impl Camera {
    /// Converts this camera to a perspective camera of `cam_geom`, without the distortion. The result maps
    /// undistorted pixels, whose coordinates count from the upper left corner of the image.
    ///
    /// Map raw pixels to undistorted pixels with [`Camera::undistort`] first.
    #[must_use]
    pub fn to_cam_geom(&self) -> cam_geom::Camera<f64, IntrinsicParametersPerspective<f64>> {
        let centre = self.lens.principal_point;
        let params =
            PerspectiveParams { fx: self.focal, fy: self.focal, skew: 0.0, cx: centre.u, cy: centre.v };
        let matrix = Matrix3::from_row_slice(&self.rotation().concat());
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
        let position = Point3::new(self.position.x, self.position.y, self.position.z);
        cam_geom::Camera::new(
            params.into(),
            ExtrinsicParameters::from_rotation_and_camcenter(rotation, position),
        )
    }
}

#[cfg(test)]
mod tests {
    use crate::camera::any_camera;
    use crate::camera::space::WorldPoint;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn both_cameras_show_a_point_at_the_same_pixel(
            camera in any_camera(), x in -50.0..50.0_f64, y in -50.0..50.0_f64, z in -1.0..3.0_f64,
        ) {
            let point = WorldPoint { x, y, z };
            prop_assume!(camera.in_camera(point)[2] > 0.1);
            let Some(pixel) = camera.world_to_undistorted(point) else { return Ok(()) };
            let points = cam_geom::Points::new(nalgebra::RowVector3::new(x, y, z));
            let shown = camera.to_cam_geom().world_to_pixel(&points);
            let off = (shown.data[0] - pixel.u).hypot(shown.data[1] - pixel.v);
            prop_assert!(off < 1e-6 * (1.0 + pixel.u.abs() + pixel.v.abs()), "{off} px");
        }
    }
}
