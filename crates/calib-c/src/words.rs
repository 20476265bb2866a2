//! Constants that C names, and the words for them.

use std::ffi::{CStr, c_char};

use calib_core::Status;

use crate::raw::CalibResult;

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
