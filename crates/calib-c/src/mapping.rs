//! Functions that map arrays of pixels and points by a camera.

use calib_core::Covariance;

use calib_core::floor::BoxForm;

use crate::camera::CalibCamera;
use crate::raw;
use crate::raw::{
    CalibResult, CallError, bytes, catch_panic, check_overlap, handle, input_array, output_array,
};

/// Maps pixels to points of the plane `height_m` metres above the floor.
///
/// All arrays have `count` values: pixels `u`, `v`; metres `x`, `y`, NaN without a point; and `status`, a
/// `CALIB_STATUS`. Output arrays overlap no other array.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `count` values of `u`, `v` can be read. `count`
/// values of `x`, `y` and `status` can be written, and no other thread accesses them during the call.
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
    catch_panic(|| {
        let written = [bytes(x, count), bytes(y, count), bytes(status, count)];
        check_overlap(&written, &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let pixels = unsafe { [input_array(u, count)?, input_array(v, count)?] };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let (floor, status) =
            unsafe { ([output_array(x, count)?, output_array(y, count)?], output_array(status, count)?) };
        view.to_floor(finite(height_m)?, pixels, floor, status);
        Ok(())
    })
}

fn finite(value: f64) -> Result<f64, CallError> {
    if value.is_finite() { Ok(value) } else { Err(CalibResult::Refused.into()) }
}

/// Maps boxes of a detector to points of the plane `height_m` metres above the floor. The foot point of a box is the
/// middle of its lower edge.
///
/// `form` is a `CALIB_BOX`, and `boxes` contains four values for each of `count` boxes. Other arguments are
/// as for `calib_camera_to_floor`.
///
/// # Safety
/// As for `calib_camera_to_floor`. Four times `count` values of `boxes` can be read.
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
    catch_panic(|| {
        let form = box_form(form)?;
        let numbers = count.checked_mul(4).ok_or(CalibResult::Refused)?;
        let written = [bytes(x, count), bytes(y, count), bytes(status, count)];
        check_overlap(&written, &[bytes(boxes, numbers)])?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let boxes = unsafe { input_array(boxes, numbers)? };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let (floor, status) =
            unsafe { ([output_array(x, count)?, output_array(y, count)?], output_array(status, count)?) };
        view.boxes_to_floor(finite(height_m)?, (form, boxes.as_chunks().0), floor, status);
        Ok(())
    })
}

fn box_form(form: u32) -> Result<BoxForm, CallError> {
    match form {
        raw::CALIB_BOX_CORNER_SIZE => Ok(BoxForm::CornerSize),
        raw::CALIB_BOX_CORNERS => Ok(BoxForm::Corners),
        raw::CALIB_BOX_CENTRE_SIZE => Ok(BoxForm::CentreSize),
        raw::CALIB_BOX_FRACTIONS => Ok(BoxForm::Fractions),
        _ => Err(CalibResult::Refused.into()),
    }
}

/// Computes the covariance of the points that pixels show on the plane `height_m` metres above the floor. The
/// standard deviation of a pixel coordinate is `sigma_px` pixels of the stream.
///
/// `pixel` and `calibration` receive four values for each of `count` pixels: xx, xy, yx, yy in square metres.
/// The pixel part is independent between detections. The calibration part is common to all detections of a camera, so
/// a filter must not average it away. Both are NaN without a point. `calibration` is also NaN if the errors of the
/// calibration or its scale (`calib_camera_scale_known`) are unknown.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `count` values of `u`, `v` can be read. Four times
/// `count` values of `pixel` and `calibration` can be written, and no other thread accesses them during the
/// call.
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
    catch_panic(|| {
        let numbers = count.checked_mul(4).ok_or(CalibResult::Refused)?;
        let read = [bytes(u, count), bytes(v, count)];
        check_overlap(&[bytes(pixel, numbers), bytes(calibration, numbers)], &read)?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let pixels = unsafe { [input_array(u, count)?, input_array(v, count)?] };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let (pixel, calibration) =
            unsafe { (output_array(pixel, numbers)?, output_array(calibration, numbers)?) };
        let parts = [pixel, calibration].map(|part| part.as_chunks_mut().0);
        view.covariances(finite(height_m)?, pixels, not_negative(sigma_px)?, parts);
        Ok(())
    })
}

/// Computes the covariance of the points of boxes on the plane `height_m` metres above the floor. The standard
/// deviation of each coordinate of the foot point is `sigma_px` pixels of the stream.
///
/// `form` and `boxes` are as for `calib_camera_boxes_to_floor`, other arguments as for
/// `calib_camera_floor_covariance`.
///
/// # Safety
/// As for `calib_camera_floor_covariance`. Four times `count` values of `boxes` can be read.
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
    catch_panic(|| {
        let form = box_form(form)?;
        let numbers = count.checked_mul(4).ok_or(CalibResult::Refused)?;
        check_overlap(&[bytes(pixel, numbers), bytes(calibration, numbers)], &[bytes(boxes, numbers)])?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let boxes = unsafe { input_array(boxes, numbers)? };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let (pixel, calibration) =
            unsafe { (output_array(pixel, numbers)?, output_array(calibration, numbers)?) };
        let parts = [pixel, calibration].map(|part| part.as_chunks_mut().0);
        let boxes = (form, boxes.as_chunks().0);
        view.boxes_covariances(finite(height_m)?, boxes, not_negative(sigma_px)?, parts);
        Ok(())
    })
}

fn not_negative(value: f64) -> Result<f64, CallError> {
    if value.is_finite() && value >= 0.0 { Ok(value) } else { Err(CalibResult::Refused.into()) }
}

/// Computes the Jacobian of floor points with respect to the parameters of the camera.
///
/// A Schmidt-Kalman filter uses it to include the errors of the calibration, whose covariance is
/// `calib_camera_covariance`. `jacobian` receives twice `CALIB_UNKNOWNS` values for each of `count` pixels:
/// the row of x, then the row of y, in metres per unit of the parameter. They are NaN without a floor point.
///
/// # Safety
/// As for `calib_camera_to_floor`. Twice `CALIB_UNKNOWNS` times `count` values of `jacobian` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_floor_jacobian(
    camera: *const CalibCamera,
    count: usize,
    u: *const f64,
    v: *const f64,
    jacobian: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        let numbers = count.checked_mul(2 * Covariance::SIZE).ok_or(CalibResult::Refused)?;
        check_overlap(&[bytes(jacobian, numbers)], &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let pixels = unsafe { [input_array(u, count)?, input_array(v, count)?] };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let jacobian = unsafe { output_array(jacobian, numbers)? };
        let rows = jacobian.as_chunks_mut::<{ Covariance::SIZE }>().0.as_chunks_mut::<2>().0;
        view.floor_jacobians(pixels, rows);
        Ok(())
    })
}

/// Projects world points, in metres, to pixels.
///
/// All arrays have `count` values. `u` and `v` are NaN if the camera cannot show the point. `status`, a
/// `CALIB_STATUS`, contains the reason.
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
    catch_panic(|| {
        let read = [bytes(x, count), bytes(y, count), bytes(z, count)];
        check_overlap(&[bytes(u, count), bytes(v, count), bytes(status, count)], &read)?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let points = unsafe { [input_array(x, count)?, input_array(y, count)?, input_array(z, count)?] };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let (pixels, status) =
            unsafe { ([output_array(u, count)?, output_array(v, count)?], output_array(status, count)?) };
        view.to_pixels(points, pixels, status);
        Ok(())
    })
}

/// Computes the viewing rays of pixels. `directions` receives three values for each of `count` pixels: a unit
/// vector in the axes of the site, NaN outside the lens.
///
/// # Safety
/// As for `calib_camera_to_floor`. Three times `count` values of `directions` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_rays(
    camera: *const CalibCamera,
    count: usize,
    u: *const f64,
    v: *const f64,
    directions: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        let numbers = count.checked_mul(3).ok_or(CalibResult::Refused)?;
        check_overlap(&[bytes(directions, numbers)], &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let pixels = unsafe { [input_array(u, count)?, input_array(v, count)?] };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let directions = unsafe { output_array(directions, numbers)? };
        view.rays(pixels, directions.as_chunks_mut().0);
        Ok(())
    })
}

/// Undistorts pixels: writes their position in a camera with the same focal length and no distortion, NaN
/// outside the lens.
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
    catch_panic(|| {
        check_overlap(&[bytes(to_u, count), bytes(to_v, count)], &[bytes(u, count), bytes(v, count)])?;
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be read.
        let pixels = unsafe { [input_array(u, count)?, input_array(v, count)?] };
        // SAFETY: the caller guarantees that they can be written, and they do not overlap.
        let straight = unsafe { [output_array(to_u, count)?, output_array(to_v, count)?] };
        view.undistort(pixels, straight);
        Ok(())
    })
}
