//! What a camera maps: arrays of pixels and points.

use calib_core::Covariance;

use calib_core::floor::BoxForm;

use crate::camera::CalibCamera;
use crate::raw;
use crate::raw::{CalibResult, Fault, apart, bytes, guarded, handle, places, values};

/// Pixels to points of the plane `height_m` metres above the floor.
///
/// All arrays have `count` values: pixels `u`, `v`; metres `x`, `y`, NaN where the pixel shows no point; and
/// `status`, a `CALIB_STATUS`. Arrays that are written to overlap no other.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `count` values can be read of `u`, `v`, and written of `x`, `y`
/// and `status`, and nobody else writes to them meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_to_floor(
    camera: *const CalibCamera,
    height_m: f64,
    count: usize,
    u: *const f64,
    v: *const f64,
    x: *mut f64,
    y: *mut f64,
    status: *mut u8,
) -> CalibResult {
    guarded(|| {
        let written = [bytes(x, count), bytes(y, count), bytes(status, count)];
        apart(&written, &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let pixels = unsafe { [values(u, count)?, values(v, count)?] };
        // SAFETY: the caller says that they can be written, and they are apart.
        let (floor, status) = unsafe { ([places(x, count)?, places(y, count)?], places(status, count)?) };
        view.to_floor(finite(height_m)?, pixels, floor, status);
        Ok(())
    })
}

fn finite(value: f64) -> Result<f64, Fault> {
    if value.is_finite() { Ok(value) } else { Err(CalibResult::Refused.into()) }
}

/// Boxes of a detector to the points of the plane on which their contents stand: the middle of the lower edge.
///
/// `form` is a `CALIB_BOX`; `boxes` has four values for each of `count` boxes. The others are as for
/// `calib_camera_to_floor`.
///
/// # Safety
/// As for `calib_camera_to_floor`; four times `count` values can be read of `boxes`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_boxes_to_floor(
    camera: *const CalibCamera,
    height_m: f64,
    form: u32,
    count: usize,
    boxes: *const f64,
    x: *mut f64,
    y: *mut f64,
    status: *mut u8,
) -> CalibResult {
    guarded(|| {
        let form = box_form(form)?;
        let numbers = count.checked_mul(4).ok_or(CalibResult::Refused)?;
        let written = [bytes(x, count), bytes(y, count), bytes(status, count)];
        apart(&written, &[bytes(boxes, numbers)])?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let boxes = unsafe { values(boxes, numbers)? };
        // SAFETY: the caller says that they can be written, and they are apart.
        let (floor, status) = unsafe { ([places(x, count)?, places(y, count)?], places(status, count)?) };
        view.boxes_to_floor(finite(height_m)?, (form, boxes.as_chunks().0), floor, status);
        Ok(())
    })
}

fn box_form(form: u32) -> Result<BoxForm, Fault> {
    match form {
        raw::CALIB_BOX_CORNER_SIZE => Ok(BoxForm::CornerSize),
        raw::CALIB_BOX_CORNERS => Ok(BoxForm::Corners),
        raw::CALIB_BOX_CENTRE_SIZE => Ok(BoxForm::CentreSize),
        _ => Err(CalibResult::Refused.into()),
    }
}

/// How uncertain the points are that pixels show, for a standard deviation of `sigma_px` pixels of the stream.
///
/// `pixel` and `calibration` get four values for each of `count` pixels: the covariances xx, xy, yx, yy in square
/// metres. The pixel's part is independent from detection to detection; the calibration's is common to all of a
/// camera, so that a filter must not average it away. NaN where there is no point, and in `calibration` where
/// nothing is known of its errors, or nothing gives its scale (`calib_camera_scale_known`).
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `count` values can be read of `u`, `v`, and four times as many
/// written of `pixel` and `calibration`, and nobody else writes to them meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_floor_covariance(
    camera: *const CalibCamera,
    height_m: f64,
    sigma_px: f64,
    count: usize,
    u: *const f64,
    v: *const f64,
    pixel: *mut f64,
    calibration: *mut f64,
) -> CalibResult {
    guarded(|| {
        let numbers = count.checked_mul(4).ok_or(CalibResult::Refused)?;
        let read = [bytes(u, count), bytes(v, count)];
        apart(&[bytes(pixel, numbers), bytes(calibration, numbers)], &read)?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let pixels = unsafe { [values(u, count)?, values(v, count)?] };
        // SAFETY: the caller says that they can be written, and they are apart.
        let (pixel, calibration) = unsafe { (places(pixel, numbers)?, places(calibration, numbers)?) };
        let parts = [pixel, calibration].map(|part| part.as_chunks_mut().0);
        view.covariances(finite(height_m)?, pixels, not_negative(sigma_px)?, parts);
        Ok(())
    })
}

/// How uncertain the points are on which the contents of boxes stand, for a standard deviation of `sigma_px` pixels of
/// each coordinate of the middle of their lower edges.
///
/// `form` and `boxes` are as for `calib_camera_boxes_to_floor`, the others as for `calib_camera_floor_covariance`.
///
/// # Safety
/// As for `calib_camera_floor_covariance`; four times `count` values can be read of `boxes`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_boxes_covariance(
    camera: *const CalibCamera,
    height_m: f64,
    sigma_px: f64,
    form: u32,
    count: usize,
    boxes: *const f64,
    pixel: *mut f64,
    calibration: *mut f64,
) -> CalibResult {
    guarded(|| {
        let form = box_form(form)?;
        let numbers = count.checked_mul(4).ok_or(CalibResult::Refused)?;
        apart(&[bytes(pixel, numbers), bytes(calibration, numbers)], &[bytes(boxes, numbers)])?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let boxes = unsafe { values(boxes, numbers)? };
        // SAFETY: the caller says that they can be written, and they are apart.
        let (pixel, calibration) = unsafe { (places(pixel, numbers)?, places(calibration, numbers)?) };
        let parts = [pixel, calibration].map(|part| part.as_chunks_mut().0);
        let boxes = (form, boxes.as_chunks().0);
        view.boxes_covariances(finite(height_m)?, boxes, not_negative(sigma_px)?, parts);
        Ok(())
    })
}

fn not_negative(value: f64) -> Result<f64, Fault> {
    if value.is_finite() && value >= 0.0 { Ok(value) } else { Err(CalibResult::Refused.into()) }
}

/// Derivatives of the floor points of pixels by the unknowns of the camera, as a filter needs that considers the errors
/// of the calibration: their covariance is `calib_camera_covariance`.
///
/// `jacobian` gets twice `CALIB_UNKNOWNS` values for each of `count` pixels: those of x, then those of y, in metres per
/// unit of the unknown; NaN where there is no floor point.
///
/// # Safety
/// As for `calib_camera_to_floor`; twice `CALIB_UNKNOWNS` times `count` values can be written of `jacobian`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_floor_jacobian(
    camera: *const CalibCamera,
    count: usize,
    u: *const f64,
    v: *const f64,
    jacobian: *mut f64,
) -> CalibResult {
    guarded(|| {
        let numbers = count.checked_mul(2 * Covariance::SIZE).ok_or(CalibResult::Refused)?;
        apart(&[bytes(jacobian, numbers)], &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let pixels = unsafe { [values(u, count)?, values(v, count)?] };
        // SAFETY: the caller says that they can be written, and they are apart.
        let jacobian = unsafe { places(jacobian, numbers)? };
        let rows = jacobian.as_chunks_mut::<{ Covariance::SIZE }>().0.as_chunks_mut::<2>().0;
        view.floor_jacobians(pixels, rows);
        Ok(())
    })
}

/// Points of space, in metres, to pixels.
///
/// All arrays have `count` values; `u` and `v` are NaN where the camera cannot show the point, and `status`, a
/// `CALIB_STATUS`, says why.
///
/// # Safety
/// As for `calib_camera_to_floor`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_to_pixel(
    camera: *const CalibCamera,
    count: usize,
    x: *const f64,
    y: *const f64,
    z: *const f64,
    u: *mut f64,
    v: *mut f64,
    status: *mut u8,
) -> CalibResult {
    guarded(|| {
        let read = [bytes(x, count), bytes(y, count), bytes(z, count)];
        apart(&[bytes(u, count), bytes(v, count), bytes(status, count)], &read)?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let points = unsafe { [values(x, count)?, values(y, count)?, values(z, count)?] };
        // SAFETY: the caller says that they can be written, and they are apart.
        let (pixels, status) = unsafe { ([places(u, count)?, places(v, count)?], places(status, count)?) };
        view.to_pixels(points, pixels, status);
        Ok(())
    })
}

/// The rays that pixels show: `directions` gets three values for each of `count` pixels, a unit vector in the axes
/// of the site; NaN outside the lens.
///
/// # Safety
/// As for `calib_camera_to_floor`; three times `count` values can be written of `directions`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_rays(
    camera: *const CalibCamera,
    count: usize,
    u: *const f64,
    v: *const f64,
    directions: *mut f64,
) -> CalibResult {
    guarded(|| {
        let numbers = count.checked_mul(3).ok_or(CalibResult::Refused)?;
        apart(&[bytes(directions, numbers)], &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let pixels = unsafe { [values(u, count)?, values(v, count)?] };
        // SAFETY: the caller says that they can be written, and they are apart.
        let directions = unsafe { places(directions, numbers)? };
        view.rays(pixels, directions.as_chunks_mut().0);
        Ok(())
    })
}

/// Where a camera of the same focal without distortion would show what this one shows at pixels; NaN outside the
/// lens.
///
/// # Safety
/// As for `calib_camera_to_floor`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_undistort(
    camera: *const CalibCamera,
    count: usize,
    u: *const f64,
    v: *const f64,
    to_u: *mut f64,
    to_v: *mut f64,
) -> CalibResult {
    guarded(|| {
        apart(&[bytes(to_u, count), bytes(to_v, count)], &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be read.
        let pixels = unsafe { [values(u, count)?, values(v, count)?] };
        // SAFETY: the caller says that they can be written, and they are apart.
        let straight = unsafe { [places(to_u, count)?, places(to_v, count)?] };
        view.undistort(pixels, straight);
        Ok(())
    })
}
