//! Properties of a camera, and the plan of a site.

use std::ffi::{CStr, c_char};

use calib_core::{Camera, CameraView, Covariance, Distortion, DistortionModel, FloorPoint, Pixel, PlanScale};
use calib_site::{Plan, Site};

use crate::camera::CalibCamera;
use crate::raw::{
    CalibResult, CallError, bytes, catch_panic, check_overlap, handle, input_array, output_array, write_text,
    write_value,
};
use crate::site::CalibSite;

/// Writes the width of a plan pixel, in metres. Returns `CALIB_RESULT_REFUSED` if the site has no plan.
///
/// # Safety
/// `site` is a handle that is not freed during the call, and `*metres` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_plan_metres_per_px(
    site: *const CalibSite,
    metres: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibSite(site) = unsafe { handle(site)? };
        let plan = site.plan.as_ref().ok_or(CalibResult::Refused)?;
        // SAFETY: the caller guarantees that it can be written.
        unsafe { write_value(metres, plan.metres_per_px) }
    })
}

/// Converts floor points, in metres, to pixels of the plan from its upper left corner, y down.
///
/// All arrays have `count` values. Output arrays overlap no other array. Returns `CALIB_RESULT_REFUSED` if
/// the site has no plan.
///
/// # Safety
/// `site` is a handle that is not freed during the call. `count` values of `x`, `y` can be read. `count`
/// values of `px`, `py` can be written, and no other thread accesses them during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_floor_to_plan(
    site: *const CalibSite,
    count: usize,
    x: *const f64,
    y: *const f64,
    px: *mut f64,
    py: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        let map = |plan: &PlanScale, [x, y]: [f64; 2]| plan.plan_from_floor(FloorPoint { x, y }).into();
        // SAFETY: guaranteed by the caller.
        unsafe { map_points(site, count, [x, y], [px, py], map) }
    })
}

/// Converts pixels of the plan to floor points, in metres: the inverse of `calib_site_floor_to_plan`.
///
/// # Safety
/// As for `calib_site_floor_to_plan`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_plan_to_floor(
    site: *const CalibSite,
    count: usize,
    px: *const f64,
    py: *const f64,
    x: *mut f64,
    y: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        let map = |plan: &PlanScale, pixel: [f64; 2]| plan.floor_from_plan(pixel.into()).into();
        // SAFETY: guaranteed by the caller.
        unsafe { map_points(site, count, [px, py], [x, y], map) }
    })
}

fn scale(site: &Site) -> Result<PlanScale, CallError> {
    Ok(site.plan.as_ref().map(Plan::scale).ok_or(CalibResult::Refused)?)
}

/// Applies `map` to `count` points, given and returned as two arrays of coordinates. `map` also receives the
/// scale of the plan.
///
/// # Safety
/// `site` is a handle that is not freed during the call. `count` values can be read from `from` and written
/// to `to`.
unsafe fn map_points(
    site: *const CalibSite,
    count: usize,
    from: [*const f64; 2],
    to: [*mut f64; 2],
    map: impl Fn(&PlanScale, [f64; 2]) -> [f64; 2],
) -> Result<(), CallError> {
    check_overlap(&to.map(|to| bytes(to, count)), &from.map(|from| bytes(from, count)))?;
    // SAFETY: the caller guarantees a valid handle.
    let CalibSite(site) = unsafe { handle(site)? };
    // SAFETY: the caller guarantees that they can be read.
    let (a, b) = unsafe { (input_array(from[0], count)?, input_array(from[1], count)?) };
    // SAFETY: the caller guarantees that they can be written, and they do not overlap.
    let (to_a, to_b) = unsafe { (output_array(to[0], count)?, output_array(to[1], count)?) };
    let plan = scale(site)?;
    for ((&a, &b), (to_a, to_b)) in a.iter().zip(b).zip(to_a.iter_mut().zip(to_b)) {
        [*to_a, *to_b] = map(&plan, [a, b]);
    }
    Ok(())
}

/// Writes `N` numbers; fails if the pointer is null.
///
/// # Safety
/// `to` is null, or `N` numbers can be written there.
unsafe fn write_numbers<const N: usize>(to: *mut f64, numbers: [f64; N]) -> Result<(), CallError> {
    // SAFETY: the caller guarantees that they can be written.
    unsafe { output_array(to, N)? }.copy_from_slice(&numbers);
    Ok(())
}

/// Returns the camera at the size of its stream; fails for a stretched stream, which has two focal lengths.
fn camera_in_stream(view: &CameraView) -> Result<Camera, CallError> {
    view.camera_in_stream().ok_or_else(|| CalibResult::Refused.into())
}

/// Writes the id of a camera. Buffer and size work as in `calib_site_json`.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `size` bytes of `buffer` and `*needed` can be
/// written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_id(
    camera: *const CalibCamera,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let camera = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that they can be written.
        unsafe { write_text(camera.id(), buffer, size, needed) }
    })
}

/// Writes width and height of the calibrated image, in pixels.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `*width` and `*height` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_size(
    camera: *const CalibCamera,
    width: *mut u32,
    height: *mut u32,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let [still_width, still_height] = view.size();
        // SAFETY: the caller guarantees that they can be written.
        unsafe {
            write_value(width, still_width as u32)?;
            write_value(height, still_height as u32)
        }
    })
}

/// Writes the position of the camera: x, y, z in metres.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. Three values of `position` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_position(
    camera: *const CalibCamera,
    position: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let at = view.camera().position;
        // SAFETY: the caller guarantees that they can be written.
        unsafe { write_numbers(position, [at.x, at.y, at.z]) }
    })
}

/// Writes yaw, pitch and roll, in degrees. Yaw counts counter-clockwise seen from above, and 0 looks along y.
/// A positive pitch looks down. A positive roll is clockwise, seen from behind the camera.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. Three values of `degrees` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_angles(camera: *const CalibCamera, degrees: *mut f64) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let Camera { yaw, pitch, roll, .. } = view.camera();
        // SAFETY: the caller guarantees that they can be written.
        unsafe { write_numbers(degrees, [yaw, pitch, roll].map(|angle| angle.to_degrees())) }
    })
}

/// Writes 1 into `*known` if a height, a length, a distance, control points or a placement on the plan
/// determine the scale. Otherwise writes 0: the camera is assumed to be 3 m high, its metres have an unknown
/// common factor, and the calibration's part of every covariance is NaN.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `*known` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_scale_known(camera: *const CalibCamera, known: *mut u8) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that it can be written.
        unsafe { write_value(known, u8::from(view.scale_is_known())) }
    })
}

/// Writes the focal length, in pixels of the stream. Returns `CALIB_RESULT_REFUSED` for a stretched stream,
/// which has two focal lengths.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `*focal_px` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_focal(camera: *const CalibCamera, focal_px: *mut f64) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller guarantees that it can be written.
        unsafe { write_value(focal_px, camera_in_stream(view)?.focal) }
    })
}

/// Writes the camera matrix K, nine values row by row: camera coordinates to undistorted pixels of the
/// stream. It is OpenCV's matrix if the stream has `CALIB_ORIGIN_CENTRE` and square pixels. Returns
/// `CALIB_RESULT_REFUSED` for a stretched stream.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. Nine values of `matrix` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_matrix(camera: *const CalibCamera, matrix: *mut f64) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let camera = camera_in_stream(view)?;
        let (focal, Pixel { u, v }) = (camera.focal, camera.lens.principal_point);
        // SAFETY: the caller guarantees that they can be written.
        unsafe { write_numbers(matrix, [focal, 0.0, u, 0.0, focal, v, 0.0, 0.0, 1.0]) }
    })
}

/// Largest number of distortion coefficients of a model.
pub const CALIB_COEFFICIENTS: usize = 12;

const _: () = assert!(
    CALIB_COEFFICIENTS == Distortion::MAX_COEFFICIENTS,
    "CALIB_COEFFICIENTS must equal the number of coefficients of the core"
);

/// Writes the distortion: the name of its model, `CALIB_COEFFICIENTS` coefficients, and the focal length of
/// the coefficients, in pixels of the stream.
///
/// `*model` is a static string, or null without distortion. Coefficients are in the order of the model,
/// followed by zeros. "brown-conrady" has k1, k2, k3, p1, p2 (OpenCV's order is k1, k2, p1, p2, k3),
/// "division" lambda, "kannala-brandt" k1 to k4, "unified" xi, k1, k2, p1, p2, "double-sphere" xi and alpha,
/// "eucm" alpha and beta, and "rational" k1 to k6, p1, p2, s1 to s4. Returns `CALIB_RESULT_REFUSED` for a
/// stretched stream.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `*model`, `CALIB_COEFFICIENTS` values of
/// `coefficients` and `*focal_px` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_distortion(
    camera: *const CalibCamera,
    model: *mut *const c_char,
    coefficients: *mut f64,
    focal_px: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let lens = camera_in_stream(view)?.lens;
        let name = lens.distortion.model().map_or(std::ptr::null(), |model| name_of(model).as_ptr());
        // SAFETY: the caller guarantees that they can be written.
        unsafe {
            write_value(model, name)?;
            write_numbers::<CALIB_COEFFICIENTS>(coefficients, lens.distortion.coefficients())?;
            write_value(focal_px, lens.focal)
        }
    })
}

const fn name_of(model: DistortionModel) -> &'static CStr {
    match model {
        DistortionModel::BrownConrady => c"brown-conrady",
        DistortionModel::Division => c"division",
        DistortionModel::KannalaBrandt => c"kannala-brandt",
        DistortionModel::Unified => c"unified",
        DistortionModel::DoubleSphere => c"double-sphere",
        DistortionModel::Rational => c"rational",
        DistortionModel::Eucm => c"eucm",
    }
}

/// Number of parameters of a camera: x, y, z, yaw, pitch, roll, focal length, five distortion coefficients, the
/// principal point (two) and the pixel aspect.
pub const CALIB_UNKNOWNS: usize = 15;

const _: () = assert!(
    CALIB_UNKNOWNS == Covariance::SIZE,
    "CALIB_UNKNOWNS must equal the size of the core's covariance"
);

/// Writes the covariance of the camera's parameters, a square matrix with `CALIB_UNKNOWNS` rows.
///
/// The parameters are x, y, z (metres), yaw, pitch, roll (radians), and focal length (pixels of the calibrated
/// image). Five distortion coefficients follow in the order of their model, then the principal point u, v (pixels of
/// the calibrated image) and the pixel aspect. For a fisheye the fifth distortion parameter is the logarithm of the
/// lens's focal length. Rows of fixed parameters are 0. A variance is infinite if it is unknown, for example of z
/// without a known scale.
///
/// # Safety
/// `camera` is a handle that is not freed during the call. `CALIB_UNKNOWNS` squared values of `covariance`
/// can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_covariance(
    camera: *const CalibCamera,
    covariance: *mut f64,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let rows = &view.camera().covariance.0;
        // SAFETY: the caller guarantees that they can be written.
        unsafe { output_array(covariance, Covariance::SIZE * Covariance::SIZE)? }
            .copy_from_slice(rows.as_flattened());
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn model_names_equal_those_of_the_core() {
        for row in calib_core::camera::MODELS {
            assert_eq!(name_of(row.model).to_str(), Ok(row.name));
        }
    }
}
