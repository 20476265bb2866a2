//! What C hands over, checked as far as it can be: null, alignment, length, overlap, and panics that must not
//! leave Rust.
//!
//! Constants that C names, and the words for them.

use std::ffi::{CStr, c_char};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

use calib_core::Status;

/// How a call ended.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CalibResult {
    /// All is done.
    Ok = 0,
    /// A pointer is null that must not be.
    Null = 1,
    /// A pointer is not aligned for what it points to.
    Misaligned = 2,
    /// An array that is written to overlaps another one.
    Overlap = 3,
    /// A buffer is too short: what is needed is told, and nothing is written.
    Short = 4,
    /// A text is not UTF-8.
    NotText = 5,
    /// A value cannot be used: the error says which, and what is expected.
    Refused = 6,
    /// A mistake in this library: please report it.
    Panicked = 7,
}

/// Why a call cannot do what it is asked, with words where there are more than the result says.
pub(crate) struct Fault {
    result: CalibResult,
    what: Option<String>,
}

impl Fault {
    pub(crate) fn refused(what: impl std::fmt::Display) -> Self {
        Self { result: CalibResult::Refused, what: Some(what.to_string()) }
    }
}

impl From<CalibResult> for Fault {
    fn from(result: CalibResult) -> Self {
        Self { result, what: None }
    }
}

/// Runs what may fail or panic.
pub(crate) fn guarded(work: impl FnOnce() -> Result<(), Fault>) -> CalibResult {
    // Whoever calls has no value of ours in his hands but handles that are never changed.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => CalibResult::Ok,
        Ok(Err(fault)) => fault.result,
        Err(_) => CalibResult::Panicked,
    }
}

/// As [`guarded`], and writes what is wrong into a buffer for words.
///
/// # Safety
/// `error` is null, or `size` bytes can be written there.
pub(crate) unsafe fn report_error(
    error: *mut c_char,
    size: usize,
    work: impl FnOnce() -> Result<(), Fault>,
) -> CalibResult {
    let mut words = String::new();
    let result = guarded(|| {
        work().map_err(|fault| {
            words = fault.what.unwrap_or_default();
            Fault::from(fault.result)
        })
    });
    if words.is_empty() {
        words = text_of(result).to_string_lossy().into_owned();
    }
    if !error.is_null() && size > 0 {
        let most = (0..=words.len().min(size - 1)).rev().find(|&at| words.is_char_boundary(at));
        // SAFETY: not null, and the caller says that `size` bytes can be written.
        unsafe { fill(error, &words.as_bytes()[..most.unwrap_or(0)]) };
    }
    result
}

/// Writes a text with its final zero.
///
/// # Safety
/// One byte more than `text` has can be written to `to`.
unsafe fn fill(to: *mut c_char, text: &[u8]) {
    // SAFETY: the caller says so; a text of ours cannot overlap a buffer of his.
    unsafe {
        std::ptr::copy_nonoverlapping(text.as_ptr().cast::<c_char>(), to, text.len());
        to.add(text.len()).write(0);
    }
}

/// Writes a text with its final zero into a buffer, and how many bytes that needs.
///
/// # Safety
/// `buffer` is null, or `size` bytes can be written there; `needed` is null, or can be written.
pub(crate) unsafe fn give_text(
    text: &str,
    buffer: *mut c_char,
    size: usize,
    needed: *mut usize,
) -> Result<(), Fault> {
    if !needed.is_null() {
        // SAFETY: checked, and the caller says that it can be written.
        unsafe { give(needed, text.len() + 1)? };
    }
    if buffer.is_null() && size > 0 {
        return Err(CalibResult::Null.into());
    }
    if size <= text.len() {
        return Err(CalibResult::Short.into());
    }
    // SAFETY: the buffer has room for the text and its zero.
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

/// Writes a value to where a pointer leads.
///
/// # Safety
/// `to` is null, or a `T` can be written there.
pub(crate) unsafe fn give<T>(to: *mut T, value: T) -> Result<(), Fault> {
    check(to)?;
    // SAFETY: neither null nor misaligned, and the caller says that it can be written.
    unsafe { to.write(value) };
    Ok(())
}

/// What a handle is of.
///
/// # Safety
/// `handle` is null, or was made by this library and is not freed while the reference is used.
pub(crate) unsafe fn handle<'a, T>(handle: *const T) -> Result<&'a T, Fault> {
    check(handle)?;
    // SAFETY: neither null nor misaligned, and the caller says that it is alive.
    Ok(unsafe { &*handle })
}

/// Frees a handle; null is none.
///
/// # Safety
/// `handle` is null, or was made by this library and is not used any more.
pub(crate) unsafe fn free<T>(handle: *mut T) {
    if check(handle).is_ok() {
        // SAFETY: it was made by `Box::into_raw`, and nobody else frees it.
        drop(unsafe { Box::from_raw(handle) });
    }
}

/// A text that ends with a zero.
///
/// # Safety
/// `text` is null, or ends with a zero that can be read.
pub(crate) unsafe fn text<'a>(text: *const c_char) -> Result<&'a str, Fault> {
    check(text)?;
    // SAFETY: not null, and the caller says that it ends.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| CalibResult::NotText.into())
}

/// So many values, to be read.
///
/// # Safety
/// `first` is null, or `count` values can be read there, and nobody writes to them meanwhile.
pub(crate) unsafe fn values<'a, T>(first: *const T, count: usize) -> Result<&'a [T], Fault> {
    if count == 0 {
        return Ok(&[]);
    }
    check(first)?;
    fits::<T>(count)?;
    // SAFETY: neither null nor misaligned nor too long, and the caller says that they can be read.
    Ok(unsafe { std::slice::from_raw_parts(first, count) })
}

/// So many values, to be written.
///
/// # Safety
/// `first` is null, or `count` values can be written there, and nobody else reads or writes them meanwhile.
pub(crate) unsafe fn places<'a, T>(first: *mut T, count: usize) -> Result<&'a mut [T], Fault> {
    if count == 0 {
        return Ok(&mut []);
    }
    check(first)?;
    fits::<T>(count)?;
    // SAFETY: neither null nor misaligned nor too long, and the caller says that they are his alone.
    Ok(unsafe { std::slice::from_raw_parts_mut(first, count) })
}

fn fits<T>(count: usize) -> Result<(), CalibResult> {
    let bytes = count.checked_mul(size_of::<T>()).filter(|&bytes| isize::try_from(bytes).is_ok());
    bytes.map(drop).ok_or(CalibResult::Refused)
}

/// The bytes of an array, by their addresses.
pub(crate) fn bytes<T>(first: *const T, count: usize) -> Range<usize> {
    let start = first.addr();
    start..start.saturating_add(count.saturating_mul(size_of::<T>()))
}

/// Refuses arrays of which one that is written to shares bytes with another.
pub(crate) fn apart(written: &[Range<usize>], read: &[Range<usize>]) -> Result<(), Fault> {
    let shares = |a: &Range<usize>, b: &Range<usize>| a.start < b.end && b.start < a.end;
    for (i, range) in written.iter().enumerate() {
        if written[i + 1..].iter().chain(read).any(|other| shares(range, other)) {
            return Err(CalibResult::Overlap.into());
        }
    }
    Ok(())
}

/// Moves a value to where C holds it.
pub(crate) fn boxed<T>(value: T) -> *mut T {
    Box::into_raw(Box::new(value))
}

/// Pixels count from the corner of the image: the centre of the first one is (0.5, 0.5).
pub const CALIB_ORIGIN_CORNER: u32 = 0;
/// Pixels count from the centre of the first one, as OpenCV's do.
pub const CALIB_ORIGIN_CENTRE: u32 = 1;
/// Nobody said how the image was brought to the size of the stream: refused where that matters.
pub const CALIB_FIT_UNSAID: u32 = 0;
/// Each side by itself.
pub const CALIB_FIT_STRETCH: u32 = 1;
/// Both sides alike, with equal bars on two sides.
pub const CALIB_FIT_LETTERBOX: u32 = 2;
/// A box is its upper left corner, width and height.
pub const CALIB_BOX_CORNER_SIZE: u32 = 0;
/// A box is its upper left and lower right corner.
pub const CALIB_BOX_CORNERS: u32 = 1;
/// A box is its centre, width and height.
pub const CALIB_BOX_CENTRE_SIZE: u32 = 2;
/// Mapped, inside the EFOV or the image.
pub const CALIB_STATUS_OK: u8 = 0;
/// The pixel shows nothing of the plane: there is no point.
pub const CALIB_STATUS_ABOVE_HORIZON: u8 = 1;
/// Mapped, but outside the effective field of view.
pub const CALIB_STATUS_OUTSIDE_EFOV: u8 = 2;
/// Mapped, but outside the image.
pub const CALIB_STATUS_OUTSIDE_IMAGE: u8 = 3;
/// The lens shows nothing there: there is no point, or no pixel.
pub const CALIB_STATUS_OUTSIDE_LENS: u8 = 4;
/// The point is not in front of the camera: there is no pixel.
pub const CALIB_STATUS_BEHIND_CAMERA: u8 = 5;
/// There was nothing to map: a coordinate is not finite.
pub const CALIB_STATUS_MISSING: u8 = 6;
/// No calibration holds for it.
pub const CALIB_STATUS_NO_CALIBRATION: u8 = 7;
/// The pixel shows the wall of a pit, between its plane and the floor: there is no point.
pub const CALIB_STATUS_ON_WALL: u8 = 8;

/// The version of this library, as text.
#[unsafe(no_mangle)]
pub extern "C" fn calib_version() -> *const c_char {
    const VERSION: &CStr =
        match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
            Ok(version) => version,
            Err(_) => c"",
        };
    VERSION.as_ptr()
}

/// What a result is, in words; of a number that is none, that.
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
    known.map_or(c"no result of this library", text_of).as_ptr()
}

pub(crate) const fn text_of(result: CalibResult) -> &'static CStr {
    match result {
        CalibResult::Ok => c"",
        CalibResult::Null => c"a pointer is null that must not be",
        CalibResult::Misaligned => c"a pointer is not aligned for what it points to",
        CalibResult::Overlap => c"an array that is written to overlaps another one",
        CalibResult::Short => c"a buffer is too short",
        CalibResult::NotText => c"a text is not UTF-8",
        CalibResult::Refused => c"a value cannot be used",
        CalibResult::Panicked => c"a mistake in this library: please report it",
    }
}

/// The name of a status as it stands in tables, such as "above-horizon"; null for a number that is none.
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
    fn statuses_have_the_numbers_and_the_names_of_the_core() {
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
            // SAFETY: a name of this library ends with a zero.
            let name = unsafe { CStr::from_ptr(calib_status_name(number)) };
            assert_eq!((status as u8, name.to_str()), (number, Ok(status.name())));
        }
        assert!(calib_status_name(9).is_null());
    }
}
