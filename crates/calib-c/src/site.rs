//! A site as a handle.

use std::ffi::c_char;

use calib_site::{Options, Site};

use crate::raw::{CalibResult, Fault, boxed, free, give, give_text, guarded, handle, report_error, values};

/// A site of cameras. Any number of threads may use it at once.
#[derive(Debug)]
pub struct CalibSite(pub(crate) Site);

/// Reads a site document, of `length` bytes of JSON text.
///
/// `*site` becomes a handle that `calib_site_free` frees. What is wrong is written to `error`, of `error_size`
/// bytes, cut off where it does not fit; `error` may be null.
///
/// # Safety
/// `length` bytes can be read from `json`, `*site` can be written, and `error_size` bytes of `error`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_parse(
    json: *const c_char,
    length: usize,
    site: *mut *mut CalibSite,
    error: *mut c_char,
    error_size: usize,
) -> CalibResult {
    let work = || {
        // SAFETY: the caller says that so many bytes can be read.
        let bytes = unsafe { values(json.cast::<u8>(), length)? };
        let text = std::str::from_utf8(bytes).map_err(|_| CalibResult::NotText)?;
        let read = Site::from_json(text).map_err(Fault::refused)?;
        // SAFETY: the caller says that it can be written.
        unsafe { give_handle(site, CalibSite(read)) }
    };
    // SAFETY: the caller says that so many bytes can be written.
    unsafe { report_error(error, error_size, work) }
}

/// Writes a handle, if there is a place for it.
///
/// # Safety
/// `to` is null, or can be written.
pub(crate) unsafe fn give_handle<T>(to: *mut *mut T, value: T) -> Result<(), Fault> {
    let made = boxed(value);
    // SAFETY: the caller says that it can be written.
    unsafe { give(to, made) }.inspect_err(|_| {
        // SAFETY: it was made here, and nobody has it.
        unsafe { free(made) };
    })
}

/// Calibrates a site from what is drawn and entered in it.
///
/// `*solved` becomes a new handle, of the site with the solutions written into it. A camera that cannot be solved
/// does not keep the others from it: its entry says why.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile, and `*solved` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_calibrate(
    site: *const CalibSite,
    solved: *mut *mut CalibSite,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibSite(site) = unsafe { handle(site)? };
        let found = site.calibrate(&Options::default()).write_into(site);
        // SAFETY: the caller says that it can be written.
        unsafe { give_handle(solved, CalibSite(found)) }
    })
}

/// Writes a site as JSON text with a final zero into `buffer`, of `size` bytes, and how many bytes that takes into
/// `*needed`, which may be null. With a buffer of no bytes, that alone.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile; `size` bytes of `buffer` and `*needed` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_json(
    site: *const CalibSite,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibSite(site) = unsafe { handle(site)? };
        // SAFETY: the caller says that they can be written.
        unsafe { give_text(&site.to_json(), buffer, size, needed) }
    })
}

/// Writes how many camera entries a site has, calibrated or not, into `*count`.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile, and `*count` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_camera_count(site: *const CalibSite, count: *mut usize) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibSite(site) = unsafe { handle(site)? };
        // SAFETY: the caller says that it can be written.
        unsafe { give(count, site.cameras.len()) }
    })
}

/// Writes the id of the camera entry `index` as `calib_site_json` writes its text.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile; `size` bytes of `buffer` and `*needed` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_camera_id(
    site: *const CalibSite,
    index: usize,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibSite(site) = unsafe { handle(site)? };
        let entry = site.cameras.get(index).ok_or(CalibResult::Refused)?;
        // SAFETY: the caller says that they can be written.
        unsafe { give_text(&entry.id, buffer, size, needed) }
    })
}

/// Frees a site; null is none.
///
/// # Safety
/// `site` is null, or a handle that is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_free(site: *mut CalibSite) {
    // SAFETY: the caller says so.
    unsafe { free(site) };
}
