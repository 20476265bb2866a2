//! Bounds of values and lists, and JSON pointers to invalid values.
//!
//! Lists stop being read when they exceed their limit, so that a hostile file cannot fill the memory.

use std::fmt;
use std::marker::PhantomData;

use calib_core::single::Known;
use serde::de::{Deserialize, Deserializer, Error as _, SeqAccess, Visitor};

use crate::site_error::{SiteError, SiteErrorKind};

/// Largest number of annotations, control points, links, marks or points in one list.
pub const MAX_ITEMS: usize = 100_000;
/// Largest number of cameras in a site.
pub const MAX_CAMERAS: usize = 10_000;

/// Reads a list of at most [`MAX_ITEMS`] items.
pub(crate) fn items<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Vec<T>, D::Error> {
    from.deserialize_seq(Bounded { most: MAX_ITEMS, of: PhantomData })
}

/// Reads a list of at most [`MAX_CAMERAS`] cameras.
pub(crate) fn cameras<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Vec<T>, D::Error> {
    from.deserialize_seq(Bounded { most: MAX_CAMERAS, of: PhantomData })
}

/// Visitor that reads a list of at most `most` items.
struct Bounded<T> {
    most: usize,
    of: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for Bounded<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of at most {} items", self.most)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = list.next_element()? {
            if items.len() == self.most {
                let most = self.most;
                return Err(A::Error::custom(format!(
                    "found more than {most} items, expected at most {most}"
                )));
            }
            items.push(item);
        }
        Ok(items)
    }
}

/// Largest length of an id or name, in bytes.
const MAX_NAME_BYTES: usize = 256;
/// Largest magnitude of a coordinate, in its unit (metres or pixels). At this limit, the spacing of doubles is 1.2e-7
/// of this unit.
const MAX_COORDINATE: f64 = 1e9;

/// Result of a check: the first error, if any.
pub(crate) type Checked = Result<(), SiteError>;

/// Formats a path of the JSON reader as a JSON pointer (RFC 6901).
pub(crate) fn pointer_of(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    path.iter().fold(String::new(), |pointer, segment| match segment {
        Segment::Seq { index } => format!("{pointer}/{index}"),
        Segment::Map { key } => format!("{pointer}/{}", escape(key)),
        Segment::Enum { .. } | Segment::Unknown => pointer,
    })
}

/// Escapes a key for a JSON pointer (RFC 6901).
pub(crate) fn escape(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}

/// Position in the document during a check: a chain of keys. The chain is formatted as a JSON pointer only
/// for an error.
#[derive(Clone, Copy)]
pub(crate) struct At<'a> {
    parent: Option<&'a Self>,
    step: Step<'a>,
}

/// Last step of a position in the document.
#[derive(Clone, Copy)]
pub(crate) enum Step<'a> {
    Root,
    Key(&'a str),
    Index(usize),
}

impl<'a> At<'a> {
    pub(crate) const fn root() -> Self {
        Self { parent: None, step: Step::Root }
    }

    pub(crate) const fn key(&'a self, key: &'a str) -> Self {
        Self { parent: Some(self), step: Step::Key(key) }
    }

    pub(crate) const fn index(&'a self, index: usize) -> Self {
        Self { parent: Some(self), step: Step::Index(index) }
    }

    pub(crate) fn pointer(&self) -> String {
        let parent = self.parent.map(At::pointer).unwrap_or_default();
        match self.step {
            Step::Root => parent,
            Step::Key(key) => format!("{parent}/{}", escape(key)),
            Step::Index(index) => format!("{parent}/{index}"),
        }
    }

    /// Returns an error at this position, with the found value and a description of the allowed values.
    pub(crate) fn expected(&self, found: impl fmt::Display, expected: impl fmt::Display) -> Checked {
        let fault = SiteErrorKind::Unexpected { found: found.to_string(), expected: expected.to_string() };
        Err(SiteError { pointer: self.pointer(), kind: fault, subject: None })
    }
}

/// Range of allowed values of a number.
#[derive(Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) low: f64,
    pub(crate) high: f64,
    /// Description of the range for error messages.
    pub(crate) what: &'static str,
}

impl Bounds {
    pub(crate) const COORDINATE: Self =
        Self { low: -MAX_COORDINATE, high: MAX_COORDINATE, what: "a number between -1e9 and 1e9" };
    pub(crate) const POSITIVE: Self =
        Self { low: f64::MIN_POSITIVE, high: MAX_COORDINATE, what: "a number above 0 and up to 1e9" };
    pub(crate) const DEGREES: Self =
        Self { low: -360.0, high: 360.0, what: "an angle between -360 and 360 degrees" };
    pub(crate) const PITCH: Self =
        Self { low: -90.0, high: 90.0, what: "an angle between -90 and 90 degrees" };
    pub(crate) const PIXEL_ASPECT: Self =
        Self { low: 0.1, high: 10.0, what: "a pixel aspect between 0.1 and 10" };
    pub(crate) const SCENE_DEGREES: Self =
        Self { low: 0.0, high: 45.0, what: "an angle between 0 and 45 degrees" };
    pub(crate) const SHARE: Self = Self { low: 0.0, high: 1.0, what: "a fraction between 0 and 1" };

    pub(crate) fn check(self, at: &At, value: f64) -> Checked {
        if value >= self.low && value <= self.high { Ok(()) } else { at.expected(value, self.what) }
    }

    pub(crate) fn check_all(self, at: &At, values: &[f64]) -> Checked {
        values.iter().enumerate().try_for_each(|(i, &value)| self.check(&at.index(i), value))
    }
}

/// Checks that a list has at most `most` items.
pub(crate) fn count(at: &At, found: usize, most: usize) -> Checked {
    if found <= most { Ok(()) } else { at.expected(format!("{found} items"), format!("at most {most}")) }
}

/// Checks that a name is not empty and not too long.
pub(crate) fn name(at: &At, text: Option<&String>) -> Checked {
    let Some(text) = text else { return Ok(()) };
    if text.is_empty() {
        return at.expected("an empty text", "at least one character");
    }
    if text.len() > MAX_NAME_BYTES {
        let found = format!("a text of {} bytes", text.len());
        return at.expected(found, format!("at most {MAX_NAME_BYTES} bytes"));
    }
    Ok(())
}

/// Checks an id. It must not contain control characters, because ids are used in tables, file names and
/// terminals.
pub(crate) fn id(at: &At, text: Option<&String>) -> Checked {
    name(at, text)?;
    let Some(control) = text.into_iter().flat_map(|text| text.chars()).find(|c| c.is_control()) else {
        return Ok(());
    };
    at.expected(
        format!("the control character {}", control.escape_unicode()),
        "an id without control characters",
    )
}

/// Checks a number if it is present.
pub(crate) fn optional(at: &At, value: Option<f64>, bounds: Bounds) -> Checked {
    value.map_or(Ok(()), |value| bounds.check(at, value))
}

/// Checks a known value: it must be in range, and either fixed or with a standard deviation.
pub(crate) fn known(at: &At, known: Option<&Known>, bounds: Bounds) -> Checked {
    let Some(known) = known else { return Ok(()) };
    bounds.check(&at.key("value"), known.value)?;
    optional(&at.key("sigma"), known.sigma, Bounds::POSITIVE)?;
    match (known.fixed, known.sigma) {
        (true, Some(_)) => {
            at.expected("both \"fixed\": true and \"sigma\"", "only one of them: a fixed value, or a prior")
        }
        (false, None) => at.expected(
            "a value without \"fixed\" or \"sigma\"",
            "\"fixed\": true, or a \"sigma\" for a prior",
        ),
        _ => Ok(()),
    }
}

/// Checks that a list has at least `least` pixels with coordinates in range.
pub(crate) fn pixels(at: &At, pixels: &[calib_core::camera::Pixel], least: usize) -> Checked {
    if pixels.len() < least {
        return at.expected(crate::counted(pixels.len(), "point", "points"), format!("at least {least}"));
    }
    count(at, pixels.len(), MAX_ITEMS)?;
    for (i, &pixel) in pixels.iter().enumerate() {
        Bounds::COORDINATE.check_all(&at.index(i), &<[f64; 2]>::from(pixel))?;
    }
    Ok(())
}
