//! A calibrated camera as a handle, and the stream that its pixels are of.

use std::ffi::c_char;

use calib_core::CameraView;

use calib_core::floor::{PixelOrigin, Stream, StreamFit};

use crate::raw;
use crate::raw::{CalibResult, Fault, free, handle, report_error, text};
use crate::site::{CalibSite, give_handle};

/// A calibrated camera. Any number of threads may use it at once.
#[derive(Debug)]
pub struct CalibCamera {
    id: String,
    pub(crate) view: CameraView,
}

/// The stream that pixels are of; all zeros are the still that was calibrated.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CalibStream {
    /// `CALIB_ORIGIN_CORNER` or `CALIB_ORIGIN_CENTRE`.
    pub origin: u32,
    /// `CALIB_FIT_STRETCH` or `CALIB_FIT_LETTERBOX`, where the proportion is not that of the still.
    pub fit: u32,
    /// Width, in pixels; 0 and a height of 0 where it is that of what the stream shows.
    pub width: u32,
    /// Height, in pixels.
    pub height: u32,
    /// What the stream shows of the still: left, top, width and height, in pixels of the still; four zeros for
    /// all of it.
    pub crop: [f64; 4],
}

impl CalibCamera {
    pub(crate) fn id(&self) -> &str {
        &self.id
    }
}

impl CalibStream {
    fn read(&self) -> Result<Stream, Fault> {
        let origin = match self.origin {
            raw::CALIB_ORIGIN_CORNER => PixelOrigin::Corner,
            raw::CALIB_ORIGIN_CENTRE => PixelOrigin::Centre,
            other => {
                return Err(Fault::refused(format_args!("origin: found {other}, expected a CALIB_ORIGIN")));
            }
        };
        let fit = match self.fit {
            raw::CALIB_FIT_UNSAID => None,
            raw::CALIB_FIT_STRETCH => Some(StreamFit::Stretch),
            raw::CALIB_FIT_LETTERBOX => Some(StreamFit::Letterbox),
            other => return Err(Fault::refused(format_args!("fit: found {other}, expected a CALIB_FIT"))),
        };
        let size = (self.width != 0 || self.height != 0).then_some([self.width, self.height]);
        let crop = (self.crop != [0.0; 4]).then_some(self.crop);
        Ok(Stream { origin, size, fit, crop })
    }
}

/// The calibrated camera of an id.
///
/// `at` is a time such as "2026-05-01T08:00:00Z"; needed where a camera that was moved has several periods, null
/// elsewhere. `stream` says which pixels its calls speak of; null is the still, counted from its corner. `*camera`
/// becomes a handle that `calib_camera_free` frees; it does not need the site any more. What is wrong is written to
/// `error`, of `error_size` bytes, cut off where it does not fit; `error` may be null.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile; `id` and `at` end with a zero; `*stream` can be read; `*camera`
/// and `error_size` bytes of `error` can be written.
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
        // SAFETY: the caller says that it is a handle.
        let CalibSite(site) = unsafe { handle(site)? };
        // SAFETY: the caller says that it ends.
        let id = unsafe { text(id)? };
        // SAFETY: not null, and the caller says that it ends.
        let at = if at.is_null() { None } else { Some(unsafe { text(at)? }) };
        // SAFETY: not null, and the caller says that it can be read.
        let stream = if stream.is_null() { CalibStream::default() } else { *unsafe { handle(stream)? } };
        let view = site.view(id, at, stream.read()?);
        let view = view.map_err(|why| Fault::refused(format_args!("camera {id:?}: {why}")))?;
        // SAFETY: the caller says that it can be written.
        unsafe { give_handle(camera, CalibCamera { id: id.to_owned(), view }) }
    };
    // SAFETY: the caller says that so many bytes can be written.
    unsafe { report_error(error, error_size, work) }
}

/// Frees a camera; null is none.
///
/// # Safety
/// `camera` is null, or a handle that is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_camera_free(camera: *mut CalibCamera) {
    // SAFETY: the caller says so.
    unsafe { free(camera) };
}
