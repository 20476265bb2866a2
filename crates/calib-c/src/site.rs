//! Handle of a site.

use std::ffi::c_char;

use calib_site::{Options, Site};

use crate::raw::{
    CalibResult, CallError, boxed, catch_panic, free, handle, input_array, report_error, write_text,
    write_value,
};

/// Site with its cameras. Any number of threads may use it at once.
#[derive(Debug)]
pub struct CalibSite(pub(crate) Site);

/// Parses a site document of `length` bytes of JSON text.
///
/// `*site` receives a handle, to be freed by `calib_site_free`. On failure a message is written to `error`,
/// cut to `error_size` bytes. `error` may be null.
///
/// # Safety
/// `length` bytes of `json` can be read. `*site` and `error_size` bytes of `error` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_parse(
    json: *const c_char,
    length: usize,
    site: *mut *mut CalibSite,
    error: *mut c_char,
    error_size: usize,
) -> CalibResult {
    let work = || {
        // SAFETY: the caller guarantees that the bytes can be read.
        let bytes = unsafe { input_array(json.cast::<u8>(), length)? };
        let text = std::str::from_utf8(bytes).map_err(|_| CalibResult::NotText)?;
        let read = Site::from_json(text).map_err(CallError::refused)?;
        // SAFETY: the caller guarantees that it can be written.
        unsafe { write_handle(site, CalibSite(read)) }
    };
    // SAFETY: the caller guarantees that the bytes can be written.
    unsafe { report_error(error, error_size, work) }
}

/// Writes the handle of a new object; fails if the pointer is null.
///
/// # Safety
/// `to` is null, or can be written.
pub(crate) unsafe fn write_handle<T>(to: *mut *mut T, value: T) -> Result<(), CallError> {
    let made = boxed(value);
    // SAFETY: the caller guarantees that it can be written.
    unsafe { write_value(to, made) }.inspect_err(|_| {
        // SAFETY: it was created above, and has no other owner.
        unsafe { free(made) };
    })
}

/// Calibrates a site from its annotations and entered values.
///
/// `*solved` receives a new handle of the site with its solutions, to be freed by `calib_site_free`. A camera that
/// cannot be solved does not prevent the others from being solved; its entry contains the reason.
///
/// # Safety
/// `site` is a handle that is not freed during the call, and `*solved` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_calibrate(
    site: *const CalibSite,
    solved: *mut *mut CalibSite,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibSite(site) = unsafe { handle(site)? };
        let found = site.calibrate(&Options::default()).write_into(site);
        // SAFETY: the caller guarantees that it can be written.
        unsafe { write_handle(solved, CalibSite(found)) }
    })
}

/// Writes a site as zero-terminated JSON text into `buffer`, and the required size in bytes into `*needed`.
///
/// `size` is the size of `buffer`. `needed` may be null. Call with a size of 0 to get the required size.
///
/// # Safety
/// `site` is a handle that is not freed during the call. `size` bytes of `buffer` and `*needed` can be
/// written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_json(
    site: *const CalibSite,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibSite(site) = unsafe { handle(site)? };
        // SAFETY: the caller guarantees that they can be written.
        unsafe { write_text(&site.to_json(), buffer, size, needed) }
    })
}

/// Writes the number of camera entries, calibrated or not, into `*count`.
///
/// # Safety
/// `site` is a handle that is not freed during the call, and `*count` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_camera_count(site: *const CalibSite, count: *mut usize) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibSite(site) = unsafe { handle(site)? };
        // SAFETY: the caller guarantees that it can be written.
        unsafe { write_value(count, site.cameras.len()) }
    })
}

/// Writes the id of the camera entry `index`. Buffer and size work as in `calib_site_json`.
///
/// # Safety
/// `site` is a handle that is not freed during the call. `size` bytes of `buffer` and `*needed` can be
/// written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_camera_id(
    site: *const CalibSite,
    index: usize,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> CalibResult {
    catch_panic(|| {
        // SAFETY: the caller guarantees a valid handle.
        let CalibSite(site) = unsafe { handle(site)? };
        let entry = site.cameras.get(index).ok_or(CalibResult::Refused)?;
        // SAFETY: the caller guarantees that they can be written.
        unsafe { write_text(&entry.id, buffer, size, needed) }
    })
}

/// Frees a site. Null is allowed.
///
/// # Safety
/// `site` is null, or a handle that is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_free(site: *mut CalibSite) {
    // SAFETY: guaranteed by the caller.
    unsafe { free(site) };
}
