//! From when to when a camera entry holds.

use std::collections::HashMap;

use jiff::Timestamp;

use crate::site::bounds::{At, Checked};
use crate::site::document::SiteCamera;
use crate::site::site_error::{SiteError, quoted};

/// An id may repeat when the periods of validity do not overlap.
pub(crate) fn check_periods(at: &At, cameras: &[SiteCamera]) -> Checked {
    let mut periods: HashMap<&str, Vec<(Timestamp, Timestamp)>> = HashMap::new();
    for (i, camera) in cameras.iter().enumerate() {
        let at = at.index(i);
        let from = instant(&at.key("valid_from"), camera.valid_from.as_ref(), Timestamp::MIN)?;
        let to = instant(&at.key("valid_to"), camera.valid_to.as_ref(), Timestamp::MAX)?;
        if from >= to {
            return at.key("valid_to").expected("a period that ends before it begins", "a later time");
        }
        let others = periods.entry(&camera.id).or_default();
        if others.iter().any(|&(start, end)| from < end && start < to) {
            let expected = "an id that no other camera has at the same time";
            return at.key("id").expected(quoted(&camera.id), expected);
        }
        others.push((from, to));
    }
    Ok(())
}

fn instant(at: &At, text: Option<&String>, absent: Timestamp) -> Result<Timestamp, SiteError> {
    let Some(text) = text else { return Ok(absent) };
    match text.parse() {
        Ok(instant) => Ok(instant),
        Err(_) => at.expected(quoted(text), "a time such as 2026-05-01T08:00:00Z").map(|()| absent),
    }
}

impl SiteCamera {
    /// Whether this calibration holds at a time (RFC 3339).
    ///
    /// # Errors
    /// When the text is not a time.
    pub fn is_valid_at(&self, time: &str) -> Result<bool, SiteError> {
        let at = At::root();
        let when = instant(&at, Some(&time.to_owned()), Timestamp::MIN)?;
        let from = instant(&at, self.valid_from.as_ref(), Timestamp::MIN)?;
        let to = instant(&at, self.valid_to.as_ref(), Timestamp::MAX)?;
        Ok(from <= when && when < to)
    }

    /// When this calibration holds: from the first to before the second, in nanoseconds since 1970 (UTC).
    ///
    /// What is open, or more than 292 years from 1970, is the least or the largest number.
    ///
    /// # Errors
    /// When `valid_from` or `valid_to` is not a time.
    pub fn period_ns(&self) -> Result<[i64; 2], SiteError> {
        let at = At::root();
        let nanoseconds = |time: Timestamp| {
            let open = if time < Timestamp::UNIX_EPOCH { i64::MIN } else { i64::MAX };
            i64::try_from(time.as_nanosecond()).unwrap_or(open)
        };
        let from = instant(&at.key("valid_from"), self.valid_from.as_ref(), Timestamp::MIN)?;
        let to = instant(&at.key("valid_to"), self.valid_to.as_ref(), Timestamp::MAX)?;
        Ok([from, to].map(nanoseconds))
    }
}
