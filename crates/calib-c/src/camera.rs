//! Handle of a calibrated camera, and the stream that its pixels refer to.

use std::ffi::c_char;

use calib_core::CameraView;

use calib_core::floor::{PixelOrigin, Stream, StreamFit};

use crate::raw;
use crate::raw::{CalibResult, CallError, free, handle, report_error, text};
use crate::site::{CalibSite, write_handle};

/// Calibrated camera. Any number of threads may use it at once.
#[derive(Debug)]
pub struct CalibCamera {
    id: String,
    pub(crate) view: CameraView,
}

/// Stream that pixels refer to. All zeros select the calibrated image.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CalibStream {
    /// Pixel origin: `CALIB_ORIGIN_CORNER` or `CALIB_ORIGIN_CENTRE`.
    pub origin: u32,
    /// Fit of the image to the stream: `CALIB_FIT_UNSAID`, `CALIB_FIT_STRETCH` or `CALIB_FIT_LETTERBOX`. If the
    /// stream and the image have different aspect ratios, `CALIB_FIT_STRETCH` or `CALIB_FIT_LETTERBOX` is required.
    pub fit: u32,
    /// Width, in pixels. If width and height are 0, the stream has the size of the image or its crop.
    pub width: u32,
    /// Height, in pixels.
    pub height: u32,
    /// Part of the image that the stream shows: left, top, width and height, in pixels of the calibrated
    /// image. Four zeros select the whole image.
    pub crop: [f64; 4],
}

impl CalibCamera {
    pub(crate) fn id(&self) -> &str {
        &self.id
    }
}

impl CalibStream {
    fn read(&self) -> Result<Stream, CallError> {
        let origin = match self.origin {
            raw::CALIB_ORIGIN_CORNER => PixelOrigin::Corner,
            raw::CALIB_ORIGIN_CENTRE => PixelOrigin::Centre,
            other => {
                return Err(CallError::refused(format_args!(
                    "origin: found {other}, expected a CALIB_ORIGIN"
                )));
            }
        };
        let fit = match self.fit {
            raw::CALIB_FIT_UNSAID => None,
            raw::CALIB_FIT_STRETCH => Some(StreamFit::Stretch),
            raw::CALIB_FIT_LETTERBOX => Some(StreamFit::Letterbox),
            other => {
                return Err(CallError::refused(format_args!("fit: found {other}, expected a CALIB_FIT")));
            }
        };
        let size = (self.width != 0 || self.height != 0).then_some([self.width, self.height]);
        let crop = (self.crop != [0.0; 4]).then_some(self.crop);
        Ok(Stream { origin, size, fit, crop })
    }
}

/// Creates a handle of a calibrated camera.
///
/// `at` is a time such as "2026-05-01T08:00:00Z". It is required if the id has several periods, and may be null
/// otherwise. All calls with this camera use pixels of `stream`. Null selects the calibrated image, with pixels
/// counted from its corner.
///
/// `*camera` receives a handle, to be freed by `calib_camera_free`. The handle stays valid after the site is freed.
/// On failure a message is written to `error`, cut to `error_size` bytes. `error` may be null.
///
/// # Safety
/// `site` is a handle that is not freed during the call. `id` and `at` end with a zero. `*stream` can be
/// read. `*camera` and `error_size` bytes of `error` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_camera(
    site: *const CalibSite,
    id: *const c_char,
    at: *const c_char,
    stream: *const CalibStream,
    camera: *mut *mut CalibCamera,
    error: *mut c_char,
    error_size: usize,
) -> CalibResult {
    let work = || {
        // SAFETY: the caller guarantees a valid handle.
        let CalibSite(site) = unsafe { handle(site)? };
        // SAFETY: the caller guarantees a terminating zero.
        let id = unsafe { text(id)? };
        // SAFETY: not null, and the caller guarantees a terminating zero.
        let at = if at.is_null() { None } else { Some(unsafe { text(at)? }) };
        // SAFETY: not null, and the caller guarantees that it can be read.
        let stream = if stream.is_null() { CalibStream::default() } else { *unsafe { handle(stream)? } };
        let view = site.view(id, at, stream.read()?);
        let view = view.map_err(|why| CallError::refused(format_args!("camera {id:?}: {why}")))?;
        // SAFETY: the caller guarantees that it can be written.
        unsafe { write_handle(camera, CalibCamera { id: id.to_owned(), view }) }
    };
    // SAFETY: the caller guarantees that the bytes can be written.
    unsafe { report_error(error, error_size, work) }
}

/// Frees a camera. Null is allowed.
///
/// # Safety
/// `camera` is null, or a handle that is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_free(camera: *mut CalibCamera) {
    // SAFETY: guaranteed by the caller.
    unsafe { free(camera) };
}
