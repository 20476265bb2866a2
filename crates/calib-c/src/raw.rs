//! Checks of arguments from C (null, alignment, length, overlap), and the conversion of panics to error
//! codes.
//!
//! Also the constants of the interface, and their texts.

use std::ffi::{CStr, c_char};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

use calib_core::Status;

/// Result of a call.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CalibResult {
    /// Success.
    Ok = 0,
    /// A required pointer is null.
    Null = 1,
    /// A pointer is not aligned for its type.
    Misaligned = 2,
    /// An output array overlaps another array.
    Overlap = 3,
    /// A buffer is too small. The required size is returned, and the buffer is unchanged.
    Short = 4,
    /// A text is not valid UTF-8.
    NotText = 5,
    /// A value is invalid, or the requested property does not exist. The error message, if the call has one, contains
    /// the reason.
    Refused = 6,
    /// Internal error of this library: please report it.
    Panicked = 7,
}

/// Failure of a call: the result, and a more detailed message if available.
pub(crate) struct CallError {
    result: CalibResult,
    message: Option<String>,
}

impl CallError {
    pub(crate) fn refused(what: impl std::fmt::Display) -> Self {
        Self { result: CalibResult::Refused, message: Some(what.to_string()) }
    }
}

impl From<CalibResult> for CallError {
    fn from(result: CalibResult) -> Self {
        Self { result, message: None }
    }
}

/// Runs a call and converts its failure or panic to a result.
pub(crate) fn catch_panic(work: impl FnOnce() -> Result<(), CallError>) -> CalibResult {
    // Unwind safe: callers only hold handles, and handles are immutable.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => CalibResult::Ok,
        Ok(Err(fault)) => fault.result,
        Err(_) => CalibResult::Panicked,
    }
}

/// Runs a call as [`catch_panic`] does, and writes the message of a failure; an empty text on success.
///
/// # Safety
/// `error` is null, or `size` bytes can be written there.
pub(crate) unsafe fn report_error(
    error: *mut c_char,
    size: usize,
    work: impl FnOnce() -> Result<(), CallError>,
) -> CalibResult {
    let mut words = String::new();
    let result = catch_panic(|| {
        work().map_err(|fault| {
            words = fault.message.unwrap_or_default();
            CallError::from(fault.result)
        })
    });
    if words.is_empty() {
        words = text_of(result).to_string_lossy().into_owned();
    }
    if !error.is_null() && size > 0 {
        let most = (0..=words.len().min(size - 1)).rev().find(|&at| words.is_char_boundary(at));
        // SAFETY: not null, and the caller guarantees that `size` bytes can be written.
        unsafe { fill(error, &words.as_bytes()[..most.unwrap_or(0)]) };
    }
    result
}

/// Writes a text with its terminating zero.
///
/// # Safety
/// `text.len() + 1` bytes can be written to `to`.
unsafe fn fill(to: *mut c_char, text: &[u8]) {
    // SAFETY: guaranteed by the caller; a text of this library cannot overlap the caller's buffer.
    unsafe {
        std::ptr::copy_nonoverlapping(text.as_ptr().cast::<c_char>(), to, text.len());
        to.add(text.len()).write(0);
    }
}

/// Writes a text with its terminating zero into a buffer, and the required size into `*needed`.
///
/// # Safety
/// `buffer` is null, or `size` bytes can be written there; `needed` is null, or can be written.
pub(crate) unsafe fn write_text(
    text: &str,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> Result<(), CallError> {
    if !needed.is_null() {
        // SAFETY: not null, and the caller guarantees that it can be written.
        unsafe { write_value(needed, text.len() + 1)? };
    }
    if buffer.is_null() && size > 0 {
        return Err(CalibResult::Null.into());
    }
    if size <= text.len() {
        return Err(CalibResult::Short.into());
    }
    // SAFETY: the buffer has enough bytes for the text and its zero.
    unsafe { fill(buffer, text.as_bytes()) };
    Ok(())
}

fn check<T>(pointer: *const T) -> Result<(), CalibResult> {
    match (pointer.is_null(), pointer.is_aligned()) {
        (true, _) => Err(CalibResult::Null),
        (_, false) => Err(CalibResult::Misaligned),
        _ => Ok(()),
    }
}

/// Writes a value through a pointer.
///
/// # Safety
/// `to` is null, or a `T` can be written there.
pub(crate) unsafe fn write_value<T>(to: *mut T, value: T) -> Result<(), CallError> {
    check(to)?;
    // SAFETY: not null, aligned, and the caller guarantees that it can be written.
    unsafe { to.write(value) };
    Ok(())
}

/// Returns a reference to the object of a handle.
///
/// # Safety
/// `handle` is null, or was made by this library and is not freed while the reference is used.
pub(crate) unsafe fn handle<'a, T>(handle: *const T) -> Result<&'a T, CallError> {
    check(handle)?;
    // SAFETY: not null, aligned, and the caller guarantees that it is alive.
    Ok(unsafe { &*handle })
}

/// Frees a handle. Null is allowed.
///
/// # Safety
/// `handle` is null, or was made by this library and is not used any more.
pub(crate) unsafe fn free<T>(handle: *mut T) {
    if check(handle).is_ok() {
        // SAFETY: it was made by `Box::into_raw`, and the caller frees it only once.
        drop(unsafe { Box::from_raw(handle) });
    }
}

/// Returns a zero-terminated text.
///
/// # Safety
/// `text` is null, or ends with a zero that can be read.
pub(crate) unsafe fn text<'a>(text: *const c_char) -> Result<&'a str, CallError> {
    check(text)?;
    // SAFETY: not null, and the caller guarantees a terminating zero.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| CalibResult::NotText.into())
}

/// Returns an input array of `count` values.
///
/// # Safety
/// `first` is null, or `count` values can be read there, and no other thread writes to them while the slice
/// is used.
pub(crate) unsafe fn input_array<'a, T>(first: *const T, count: usize) -> Result<&'a [T], CallError> {
    if count == 0 {
        return Ok(&[]);
    }
    check(first)?;
    fits::<T>(count)?;
    // SAFETY: not null, aligned, not too long, and the caller guarantees that they can be read.
    Ok(unsafe { std::slice::from_raw_parts(first, count) })
}

/// Returns an output array of `count` values.
///
/// # Safety
/// `first` is null, or `count` values can be written there, and nobody else accesses them while the slice is
/// used.
pub(crate) unsafe fn output_array<'a, T>(first: *mut T, count: usize) -> Result<&'a mut [T], CallError> {
    if count == 0 {
        return Ok(&mut []);
    }
    check(first)?;
    fits::<T>(count)?;
    // SAFETY: not null, aligned, not too long, and the caller guarantees exclusive access.
    Ok(unsafe { std::slice::from_raw_parts_mut(first, count) })
}

fn fits<T>(count: usize) -> Result<(), CalibResult> {
    let bytes = count.checked_mul(size_of::<T>()).filter(|&bytes| isize::try_from(bytes).is_ok());
    bytes.map(drop).ok_or(CalibResult::Refused)
}

/// Returns the address range of an array.
pub(crate) fn bytes<T>(first: *const T, count: usize) -> Range<usize> {
    let start = first.addr();
    start..start.saturating_add(count.saturating_mul(size_of::<T>()))
}

/// Rejects output arrays that share bytes with another array.
pub(crate) fn check_overlap(written: &[Range<usize>], read: &[Range<usize>]) -> Result<(), CallError> {
    let shares = |a: &Range<usize>, b: &Range<usize>| a.start < b.end && b.start < a.end;
    for (i, range) in written.iter().enumerate() {
        if written[i + 1..].iter().chain(read).any(|other| shares(range, other)) {
            return Err(CalibResult::Overlap.into());
        }
    }
    Ok(())
}

/// Moves a value to the heap and returns its handle.
pub(crate) fn boxed<T>(value: T) -> *mut T {
    Box::into_raw(Box::new(value))
}

/// Pixels count from the corner of the image: the centre of the first pixel is (0.5, 0.5).
pub const CALIB_ORIGIN_CORNER: u32 = 0;
/// Pixels count from the centre of the first pixel, as in OpenCV.
pub const CALIB_ORIGIN_CENTRE: u32 = 1;
/// No fit is selected. The call fails if the stream and the image have different aspect ratios.
pub const CALIB_FIT_UNSAID: u32 = 0;
/// The width and the height of the image are scaled by different factors, so that the image fills the stream.
pub const CALIB_FIT_STRETCH: u32 = 1;
/// Width and height of the image have the same scale, with equal bars on two sides of the stream.
pub const CALIB_FIT_LETTERBOX: u32 = 2;
/// Box as upper left corner, width and height.
pub const CALIB_BOX_CORNER_SIZE: u32 = 0;
/// Box as upper left and lower right corner.
pub const CALIB_BOX_CORNERS: u32 = 1;
/// Box as centre, width and height.
pub const CALIB_BOX_CENTRE_SIZE: u32 = 2;
/// Box as centre, width and height, as fractions of the width and height of the stream (YOLO).
pub const CALIB_BOX_FRACTIONS: u32 = 3;
/// Mapped; inside the effective field of view (EFOV), or, for world points, inside the image.
pub const CALIB_STATUS_OK: u8 = 0;
/// No result: the pixel shows no point of the plane.
pub const CALIB_STATUS_ABOVE_HORIZON: u8 = 1;
/// Mapped, but outside the effective field of view.
pub const CALIB_STATUS_OUTSIDE_EFOV: u8 = 2;
/// Mapped, but outside the image.
pub const CALIB_STATUS_OUTSIDE_IMAGE: u8 = 3;
/// No result: outside the range of the lens model.
pub const CALIB_STATUS_OUTSIDE_LENS: u8 = 4;
/// No result: the point is not in front of the camera.
pub const CALIB_STATUS_BEHIND_CAMERA: u8 = 5;
/// No result: a coordinate is not finite.
pub const CALIB_STATUS_MISSING: u8 = 6;
/// No result: the camera has no calibration.
pub const CALIB_STATUS_NO_CALIBRATION: u8 = 7;
/// No result: the pixel shows the wall of a pit, between its plane and the floor.
pub const CALIB_STATUS_ON_WALL: u8 = 8;

/// Returns the version of this library as text.
#[unsafe(no_mangle)]
pub extern "C" fn calib_version() -> *const c_char {
    const VERSION: &CStr =
        match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
            Ok(version) => version,
            Err(_) => c"",
        };
    VERSION.as_ptr()
}

/// Returns a description of a `CalibResult`, or "unknown result" for any other value.
#[unsafe(no_mangle)]
pub extern "C" fn calib_result_text(result: i32) -> *const c_char {
    const ALL: [CalibResult; 8] = [
        CalibResult::Ok,
        CalibResult::Null,
        CalibResult::Misaligned,
        CalibResult::Overlap,
        CalibResult::Short,
        CalibResult::NotText,
        CalibResult::Refused,
        CalibResult::Panicked,
    ];
    let known = ALL.into_iter().find(|&known| known as i32 == result);
    known.map_or(c"unknown result", text_of).as_ptr()
}

pub(crate) const fn text_of(result: CalibResult) -> &'static CStr {
    match result {
        CalibResult::Ok => c"",
        CalibResult::Null => c"a required pointer is null",
        CalibResult::Misaligned => c"a pointer is not aligned for its type",
        CalibResult::Overlap => c"an output array overlaps another array",
        CalibResult::Short => c"a buffer is too small",
        CalibResult::NotText => c"a text is not valid UTF-8",
        CalibResult::Refused => c"a value is invalid",
        CalibResult::Panicked => c"internal error of calib: please report it",
    }
}

/// Returns the name of a `CALIB_STATUS`, such as "above-horizon", or null for any other value.
#[unsafe(no_mangle)]
pub extern "C" fn calib_status_name(status: u8) -> *const c_char {
    const NAMES: [&CStr; Status::ALL.len()] = [
        c"ok",
        c"above-horizon",
        c"outside-efov",
        c"outside-image",
        c"outside-lens",
        c"behind-camera",
        c"missing",
        c"no-calibration",
        c"on-wall",
    ];
    NAMES.get(usize::from(status)).map_or(std::ptr::null(), |name| name.as_ptr())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statuses_match_the_core() {
        let numbers = [
            CALIB_STATUS_OK,
            CALIB_STATUS_ABOVE_HORIZON,
            CALIB_STATUS_OUTSIDE_EFOV,
            CALIB_STATUS_OUTSIDE_IMAGE,
            CALIB_STATUS_OUTSIDE_LENS,
            CALIB_STATUS_BEHIND_CAMERA,
            CALIB_STATUS_MISSING,
            CALIB_STATUS_NO_CALIBRATION,
            CALIB_STATUS_ON_WALL,
        ];
        for (status, number) in Status::ALL.into_iter().zip(numbers) {
            // SAFETY: names of this library end with a zero.
            let name = unsafe { CStr::from_ptr(calib_status_name(number)) };
            assert_eq!((status as u8, name.to_str()), (number, Ok(status.name())));
        }
        assert!(calib_status_name(9).is_null());
    }
}
