//! What a camera says of itself.
//!
//! The plan of a site: points of the floor as pixels of its picture, and back.

use std::ffi::{CStr, c_char};

use calib_core::{Camera, CameraView, Covariance, Distortion, DistortionModel, FloorPoint, Pixel, PlanScale};
use calib_site::{Plan, Site};

use crate::camera::CalibCamera;
use crate::raw::{CalibResult, Fault, apart, bytes, give, give_text, guarded, handle, places, values};
use crate::site::CalibSite;

/// Writes the metres that a pixel of the plan is wide; `CALIB_RESULT_REFUSED` where the site has no plan.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile, and `*metres` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_plan_metres_per_px(
    site: *const CalibSite,
    metres: *mut f64,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibSite(site) = unsafe { handle(site)? };
        let plan = site.plan.as_ref().ok_or(CalibResult::Refused)?;
        // SAFETY: the caller says that it can be written.
        unsafe { give(metres, plan.metres_per_px) }
    })
}

/// Points of the floor, in metres, to pixels of the plan from its upper left corner, y down.
///
/// All arrays have `count` values. Arrays that are written to overlap no other. `CALIB_RESULT_REFUSED` where the site has
/// no plan.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile; `count` values can be read of `x`, `y`, and written of `px`, `py`, and
/// nobody else writes to them meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_floor_to_plan(
    site: *const CalibSite,
    count: usize,
    x: *const f64,
    y: *const f64,
    px: *mut f64,
    py: *mut f64,
) -> CalibResult {
    guarded(|| {
        let map = |plan: &PlanScale, [x, y]: [f64; 2]| plan.plan_from_floor(FloorPoint { x, y }).into();
        // SAFETY: the caller says so.
        unsafe { each(site, count, [x, y], [px, py], map) }
    })
}

/// Pixels of the plan to points of the floor, in metres: the way back of `calib_site_floor_to_plan`.
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
    guarded(|| {
        let map = |plan: &PlanScale, pixel: [f64; 2]| plan.floor_from_plan(pixel.into()).into();
        // SAFETY: the caller says so.
        unsafe { each(site, count, [px, py], [x, y], map) }
    })
}

fn scale(site: &Site) -> Result<PlanScale, Fault> {
    Ok(site.plan.as_ref().map(Plan::scale).ok_or(CalibResult::Refused)?)
}

/// Maps pairs of numbers one by one.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile; `count` values can be read of `from` and written of `to`.
unsafe fn each(
    site: *const CalibSite,
    count: usize,
    from: [*const f64; 2],
    to: [*mut f64; 2],
    map: impl Fn(&PlanScale, [f64; 2]) -> [f64; 2],
) -> Result<(), Fault> {
    apart(&to.map(|to| bytes(to, count)), &from.map(|from| bytes(from, count)))?;
    // SAFETY: the caller says that it is a handle.
    let CalibSite(site) = unsafe { handle(site)? };
    // SAFETY: the caller says that they can be read.
    let (a, b) = unsafe { (values(from[0], count)?, values(from[1], count)?) };
    // SAFETY: the caller says that they can be written, and they are apart.
    let (to_a, to_b) = unsafe { (places(to[0], count)?, places(to[1], count)?) };
    let plan = scale(site)?;
    for ((&a, &b), (to_a, to_b)) in a.iter().zip(b).zip(to_a.iter_mut().zip(to_b)) {
        [*to_a, *to_b] = map(&plan, [a, b]);
    }
    Ok(())
}

/// Writes so many numbers, if there is a place for them.
///
/// # Safety
/// `to` is null, or `N` numbers can be written there.
unsafe fn give_numbers<const N: usize>(to: *mut f64, numbers: [f64; N]) -> Result<(), Fault> {
    // SAFETY: the caller says that they can be written.
    unsafe { places(to, N)? }.copy_from_slice(&numbers);
    Ok(())
}

/// The camera as its stream shows it; a stretched stream has no one focal.
fn shown(view: &CameraView) -> Result<Camera, Fault> {
    view.camera_in_stream().ok_or_else(|| CalibResult::Refused.into())
}

/// Writes the id of a camera as `calib_site_json` writes its text.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `size` bytes of `buffer` and `*needed` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_id(
    camera: *const CalibCamera,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let camera = unsafe { handle(camera)? };
        // SAFETY: the caller says that they can be written.
        unsafe { give_text(camera.id(), buffer, size, needed) }
    })
}

/// Width and height of the still that was calibrated, in pixels.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `*width` and `*height` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_size(
    camera: *const CalibCamera,
    width: *mut u32,
    height: *mut u32,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let [still_width, still_height] = view.size();
        // SAFETY: the caller says that they can be written.
        unsafe {
            give(width, still_width as u32)?;
            give(height, still_height as u32)
        }
    })
}

/// x, y and z of the camera, three values, in metres.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; three values of `position` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_position(
    camera: *const CalibCamera,
    position: *mut f64,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let at = view.camera().position;
        // SAFETY: the caller says that they can be written.
        unsafe { give_numbers(position, [at.x, at.y, at.z]) }
    })
}

/// Yaw, pitch and roll, three values, in degrees: yaw counter-clockwise about the vertical, seen from above, 0 along y;
/// pitch positive looking down; roll positive where the camera is turned clockwise, seen from behind.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; three values of `degrees` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_angles(camera: *const CalibCamera, degrees: *mut f64) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let Camera { yaw, pitch, roll, .. } = view.camera();
        // SAFETY: the caller says that they can be written.
        unsafe { give_numbers(degrees, [yaw, pitch, roll].map(|angle| angle.to_degrees())) }
    })
}

/// Writes 1 into `*known` where something gives the scale of a camera: a height, a length, a distance, control points, or a
/// place on the plan; 0 where nothing does: it is taken to be 3 m high, its metres are right in their proportions alone,
/// and the calibration's part of every covariance is NaN.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `*known` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_scale_known(camera: *const CalibCamera, known: *mut u8) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that it can be written.
        unsafe { give(known, u8::from(view.scale_is_known())) }
    })
}

/// The focal in pixels of the stream, one value; `CALIB_RESULT_REFUSED` where the stream is stretched and has no one focal.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `*focal_px` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_focal(camera: *const CalibCamera, focal_px: *mut f64) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        // SAFETY: the caller says that it can be written.
        unsafe { give(focal_px, shown(view)?.focal) }
    })
}

/// K, nine values row by row: points of the camera's axes to undistorted pixels of the stream, as OpenCV takes it where
/// the stream has `CALIB_ORIGIN_CENTRE`; `CALIB_RESULT_REFUSED` where the stream is stretched.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; nine values of `matrix` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_matrix(camera: *const CalibCamera, matrix: *mut f64) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let camera = shown(view)?;
        let (focal, Pixel { u, v }) = (camera.focal, camera.lens.principal_point);
        // SAFETY: the caller says that they can be written.
        unsafe { give_numbers(matrix, [focal, 0.0, u, 0.0, focal, v, 0.0, 0.0, 1.0]) }
    })
}

/// The distortion: the name of its model into `*model`, null where there is none, which nobody frees; five coefficients in
/// the order of the model, zeros after its last; and the focal that they are for, in pixels of the stream.
///
/// "brown-conrady" has k1, k2, k3, p1, p2 (OpenCV's order is k1, k2, p1, p2, k3), "division" lambda, "kannala-brandt" k1 to k4,
/// "unified" xi, and "double-sphere" xi and alpha. `CALIB_RESULT_REFUSED` where the stream is stretched.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `*model`, five values of `coefficients` and `*focal_px` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_distortion(
    camera: *const CalibCamera,
    model: *mut *const c_char,
    coefficients: *mut f64,
    focal_px: *mut f64,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let lens = shown(view)?.lens;
        let name = lens.distortion.model().map_or(std::ptr::null(), |model| name_of(model).as_ptr());
        // SAFETY: the caller says that they can be written.
        unsafe {
            give(model, name)?;
            give_numbers::<{ Distortion::MOST }>(coefficients, lens.distortion.coefficients())?;
            give(focal_px, lens.focal)
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
    }
}

/// Number of unknowns of a camera: x, y, z, yaw, pitch, roll, focal, five coefficients of the distortion and the principal
/// point.
pub const CALIB_UNKNOWNS: usize = 14;

const _: () = assert!(CALIB_UNKNOWNS == Covariance::SIZE, "the header says how many there are");

/// Covariance of the unknowns, `CALIB_UNKNOWNS` rows of as many values: x, y, z (metres), yaw, pitch, roll (radians), focal
/// (pixels of the still), five coefficients of the distortion, of a fisheye the log of its own focal in place of the
/// fifth, and the principal point, u and v (pixels of the still); zeros for what was not estimated, infinite variances where nothing is
/// known of the errors, as of z where nothing gives the scale.
///
/// # Safety
/// `camera` is a handle that is not freed meanwhile; `CALIB_UNKNOWNS` squared values of `covariance` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_covariance(
    camera: *const CalibCamera,
    covariance: *mut f64,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibCamera { view, .. } = unsafe { handle(camera)? };
        let rows = &view.camera().covariance.0;
        // SAFETY: the caller says that they can be written.
        unsafe { places(covariance, Covariance::SIZE * Covariance::SIZE)? }
            .copy_from_slice(rows.as_flattened());
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_have_the_names_of_the_core() {
        for row in calib_core::camera::MODELS {
            assert_eq!(name_of(row.model).to_str(), Ok(row.name));
        }
    }
}
