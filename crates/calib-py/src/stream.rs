//! Keywords of a call that select the stream of its pixels.

use std::borrow::Cow;

use calib_core::CameraView;

use calib_core::floor::{PixelOrigin, Stream, StreamFit};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array::{self, Pair};
use crate::error::value_error;

/// Keywords that select the kind of pixels, with their allowed values, for error messages.
pub(crate) const KEYWORDS: &str =
    "origin (\"corner\" or \"centre\"), stream_size, fit (\"stretch\" or \"letterbox\") or crop";

/// Keywords about pixels that many calls accept. Absent keywords keep the value of the camera.
#[derive(Clone, Debug, Default)]
struct PixelKeywords {
    origin: Option<String>,
    stream_size: Option<(f64, f64)>,
    fit: Option<String>,
    crop: Option<[f64; 4]>,
}

/// Returns the camera for the pixels of the stream that the keywords of a call select.
pub(crate) fn view_of<'a>(
    id: &str,
    view: &'a CameraView,
    keywords: Option<&Bound<'_, PyDict>>,
) -> PyResult<Cow<'a, CameraView>> {
    let Some(keywords) = keywords else { return Ok(Cow::Borrowed(view)) };
    PixelKeywords::read(keywords)?.of(keywords.py(), id, view)
}

impl PixelKeywords {
    fn read(keywords: &Bound<'_, PyDict>) -> PyResult<Self> {
        let mut pixels = Self::default();
        for (keyword, value) in keywords {
            let keyword: String = keyword.extract()?;
            match keyword.as_str() {
                "origin" => pixels.origin = extract_keyword(&keyword, &value, "\"corner\" or \"centre\"")?,
                "stream_size" => {
                    let size: Option<[f64; 2]> = extract_keyword(&keyword, &value, "(width, height)")?;
                    pixels.stream_size = size.map(Into::into);
                }
                "fit" => pixels.fit = extract_keyword(&keyword, &value, "\"stretch\" or \"letterbox\"")?,
                "crop" => pixels.crop = extract_keyword(&keyword, &value, "(left, top, width, height)")?,
                _ => {
                    let what = format!("unexpected keyword {keyword:?}, expected {KEYWORDS}");
                    return Err(PyTypeError::new_err(what));
                }
            }
        }
        Ok(pixels)
    }

    fn is_empty(&self) -> bool {
        self.origin.is_none() && self.stream_size.is_none() && self.fit.is_none() && self.crop.is_none()
    }

    /// Applies the keywords to a stream.
    fn apply_to(&self, py: Python<'_>, id: Option<&str>, mut stream: Stream) -> PyResult<Stream> {
        if let Some(name) = &self.origin {
            stream.origin =
                named(py, id, "origin", name, PixelOrigin::from_name, "\"corner\" or \"centre\"")?;
        }
        if let Some(name) = &self.fit {
            let fit = named(py, id, "fit", name, StreamFit::from_name, "\"stretch\" or \"letterbox\"")?;
            stream.fit = Some(fit);
        }
        if let Some((width, height)) = self.stream_size {
            stream.size = Some([side(py, id, width)?, side(py, id, height)?]);
        }
        stream.crop = self.crop.or(stream.crop);
        Ok(stream)
    }

    fn of<'a>(&self, py: Python<'_>, id: &str, view: &'a CameraView) -> PyResult<Cow<'a, CameraView>> {
        if self.is_empty() {
            return Ok(Cow::Borrowed(view));
        }
        let stream = self.apply_to(py, Some(id), *view.stream())?;
        let field = if self.crop.is_some() && self.stream_size.is_none() { "crop" } else { "stream_size" };
        view.with_stream(stream).map(Cow::Owned).map_err(|why| value_error(py, Some(id), field, why))
    }
}

/// Returns the stream that keywords describe.
pub(crate) fn stream_of(keywords: &Bound<'_, PyDict>) -> PyResult<Stream> {
    PixelKeywords::read(keywords)?.apply_to(keywords.py(), None, Stream::default())
}

/// Converts pixels of a stream to pixels of the camera's calibrated image, counted from its corner.
///
/// Args:
///     u, v: numbers or arrays, in pixels of the stream.
///     size: (width, height) of the calibrated image, in pixels.
///     origin, stream_size, fit, crop: kind of pixels, see `Camera`.
#[pyfunction]
#[pyo3(signature = (u, v, size, **stream), text_signature = "(u, v, size, *, origin=None, stream_size=None, fit=None, crop=None)")]
pub(crate) fn to_still<'py>(
    u: &Bound<'py, PyAny>,
    v: &Bound<'py, PyAny>,
    size: [f64; 2],
    stream: Option<&Bound<'py, PyDict>>,
) -> PyResult<Pair<'py>> {
    let stream = stream.map_or_else(|| Ok(Stream::default()), stream_of)?;
    let map = stream.map(size).map_err(|why| {
        let field = if stream.size.is_none() { "crop" } else { "stream_size" };
        value_error(u.py(), None, field, why)
    })?;
    array::each(u.py(), [u, v], ["u", "v"], |u, v| [map.to_image(0, u), map.to_image(1, v)])
}

/// Extracts the value of a keyword.
fn extract_keyword<'py, T: for<'a> FromPyObject<'a, 'py>>(
    keyword: &str,
    value: &Bound<'py, PyAny>,
    expected: &str,
) -> PyResult<T> {
    value.extract().or_else(|_| {
        let what = format!("found {}, expected {expected}", value.repr()?.to_string_lossy());
        Err(value_error(value.py(), None, keyword, what))
    })
}

/// Returns the value of an option from its list of names; fails for an unknown name.
pub(crate) fn named<T>(
    py: Python<'_>,
    id: Option<&str>,
    field: &str,
    name: &str,
    from_name: fn(&str) -> Option<T>,
    expected: &str,
) -> PyResult<T> {
    from_name(name)
        .ok_or_else(|| value_error(py, id, field, format_args!("found {name:?}, expected {expected}")))
}

fn side(py: Python<'_>, id: Option<&str>, side: f64) -> PyResult<u32> {
    let whole = side as u32;
    if f64::from(whole) == side && whole > 0 {
        return Ok(whole);
    }
    let what = format!("found a side of {side}, expected (width, height) in whole pixels");
    Err(value_error(py, id, "stream_size", what))
}
