//! Validity periods of camera entries, and lookup of an entry by id and time.

use std::collections::HashMap;
use std::fmt;

use jiff::Timestamp;

use crate::bounds::{At, Checked};
use crate::document::{Site, SiteCamera};
use crate::site_error::{SiteError, quoted};

/// Checks the validity periods of all cameras. An id may repeat if its periods do not overlap.
pub(crate) fn check_periods(at: &At, cameras: &[SiteCamera]) -> Checked {
    let mut periods: HashMap<&str, Vec<(Timestamp, Timestamp)>> = HashMap::new();
    for (i, camera) in cameras.iter().enumerate() {
        let at = at.index(i);
        let from = instant(&at.key("valid_from"), camera.valid_from.as_ref(), Timestamp::MIN)?;
        let to = instant(&at.key("valid_to"), camera.valid_to.as_ref(), Timestamp::MAX)?;
        if from >= to {
            let expected = "a time after \"valid_from\"";
            return at.key("valid_to").expected("an end that is not after the start", expected);
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

/// Parses a time (RFC 3339); returns `absent` if it is not set.
fn instant(at: &At, text: Option<&String>, absent: Timestamp) -> Result<Timestamp, SiteError> {
    let Some(text) = text else { return Ok(absent) };
    match text.parse() {
        Ok(instant) => Ok(instant),
        Err(_) => at.expected(quoted(text), "a time such as 2026-05-01T08:00:00Z").map(|()| absent),
    }
}

/// Error of a camera lookup by id and time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraLookupError {
    /// No camera has this id.
    Unknown,
    /// Several periods have this id, and no time was given.
    SeveralPeriods,
    /// No period of this id is valid at this time.
    NotValidThen,
    /// The given text is not a time.
    NotATime,
}

impl fmt::Display for CameraLookupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "the site has no camera with this id",
            Self::SeveralPeriods => "several periods have this id: specify a time",
            Self::NotValidThen => "no calibration of this camera is valid at this time",
            Self::NotATime => "expected a time such as 2026-05-01T08:00:00Z",
        })
    }
}

impl std::error::Error for CameraLookupError {}

impl Site {
    /// Returns the camera with this id. Returns `None` if no entry or several periods have this id. For
    /// several periods, use [`Self::camera_at`] with a time.
    #[must_use]
    pub fn camera(&self, id: &str) -> Option<&SiteCamera> {
        self.camera_at(id, None).ok()
    }

    /// Returns the entry with this id that is valid at a time (RFC 3339). Without a time, the id must have a
    /// single period.
    ///
    /// # Errors
    /// If no entry matches, or the id is ambiguous without a time.
    pub fn camera_at(&self, id: &str, time: Option<&str>) -> Result<&SiteCamera, CameraLookupError> {
        let of_id: Vec<&SiteCamera> = self.cameras.iter().filter(|camera| camera.id == id).collect();
        let Some(time) = time else {
            return match of_id[..] {
                [] => Err(CameraLookupError::Unknown),
                [only] => Ok(only),
                _ => Err(CameraLookupError::SeveralPeriods),
            };
        };
        let last =
            if of_id.is_empty() { CameraLookupError::Unknown } else { CameraLookupError::NotValidThen };
        for camera in of_id {
            if camera.is_valid_at(time).map_err(|_| CameraLookupError::NotATime)? {
                return Ok(camera);
            }
        }
        Err(last)
    }
}

impl Site {
    /// Returns the longest camera id that a file name starts with, if no letter or digit follows: `door` for
    /// `door_20260501_0830`.
    #[must_use]
    pub fn camera_id_from_name(&self, name: &str) -> Option<&str> {
        let is_named = |id: &&str| {
            let rest = name.strip_prefix(*id);
            rest.is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
        };
        let ids = self.cameras.iter().map(|camera| camera.id.as_str()).filter(|id| !id.is_empty());
        ids.filter(is_named).max_by_key(|id| id.len())
    }

    /// Returns the index of the entry with this id that is valid at a time. If the time is unknown, the entry without
    /// an end is used. If the id has only one entry, this entry is returned for any time.
    #[must_use]
    pub fn entry_index_at(&self, id: &str, time: Option<&str>) -> Option<usize> {
        let of_id: Vec<usize> = (0..self.cameras.len()).filter(|&i| self.cameras[i].id == id).collect();
        let holds = |&index: &usize| match time {
            Some(time) => self.cameras[index].is_valid_at(time).unwrap_or_default(),
            None => self.cameras[index].valid_to.is_none(),
        };
        match of_id[..] {
            [only] => Some(only),
            _ => of_id.into_iter().find(holds),
        }
    }

    /// Whether a later period of the same camera exists, so that the entry is no longer current.
    #[must_use]
    pub fn is_superseded(&self, index: usize) -> bool {
        let Some(entry) = self.cameras.get(index).filter(|entry| entry.valid_to.is_some()) else {
            return false;
        };
        let begins = |other: &SiteCamera| {
            let (own, other) = entry.period_ns().ok().zip(other.period_ns().ok())?;
            Some(other[0] >= own[1])
        };
        self.cameras.iter().any(|other| other.id == entry.id && begins(other) == Some(true))
    }

    /// Whether this entry is the first one with its id. The links and marks of an id belong to its first entry.
    #[must_use]
    pub fn owns_links(&self, index: usize) -> bool {
        let id = self.cameras.get(index).map(|camera| &camera.id);
        id.is_some() && self.cameras.iter().position(|camera| Some(&camera.id) == id) == Some(index)
    }
}

impl SiteCamera {
    /// Whether two entries are the same period of the same camera.
    #[must_use]
    pub fn is_same_period(&self, other: &Self) -> bool {
        self.id == other.id && self.valid_from == other.valid_from
    }

    /// Whether this calibration is valid at a time (RFC 3339).
    ///
    /// # Errors
    /// If the text is not a time.
    pub fn is_valid_at(&self, time: &str) -> Result<bool, SiteError> {
        let at = At::root();
        let when = instant(&at, Some(&time.to_owned()), Timestamp::MIN)?;
        let from = instant(&at, self.valid_from.as_ref(), Timestamp::MIN)?;
        let to = instant(&at, self.valid_to.as_ref(), Timestamp::MAX)?;
        Ok(from <= when && when < to)
    }

    /// Whether a time (RFC 3339) is inside the validity period and not at its start, so that it splits the
    /// period in two.
    ///
    /// # Errors
    /// If the text is not a time.
    pub fn is_divided_at(&self, time: &str) -> Result<bool, SiteError> {
        let at = At::root();
        let when = instant(&at, Some(&time.to_owned()), Timestamp::MIN)?;
        let from = instant(&at, self.valid_from.as_ref(), Timestamp::MIN)?;
        Ok(from < when && self.is_valid_at(time)?)
    }

    /// Returns the validity period in nanoseconds since 1970 (UTC): start inclusive, end exclusive.
    ///
    /// An open end, or a time more than 292 years from 1970, is the smallest or largest `i64`.
    ///
    /// # Errors
    /// If `valid_from` or `valid_to` is not a time.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn id_with_several_periods_needs_a_time() {
        let period = |from: Option<&str>, to: Option<&str>| SiteCamera {
            valid_from: from.map(str::to_owned),
            valid_to: to.map(str::to_owned),
            ..SiteCamera::new("door", [640, 480])
        };
        let bump = "2026-06-01T00:00:00Z";
        let mut site = Site { cameras: vec![period(None, Some(bump))], ..Site::new() };
        assert_eq!(site.camera("door"), Some(&site.cameras[0]));
        assert_eq!(
            site.camera_at("door", Some("2026-07-01T00:00:00Z")),
            Err(CameraLookupError::NotValidThen)
        );
        assert!(!site.is_superseded(0), "no newer period exists");
        site.cameras.push(period(Some(bump), None));
        assert_eq!((site.camera("door"), site.camera("roof")), (None, None));
        assert_eq!(site.camera_at("door", None), Err(CameraLookupError::SeveralPeriods));
        assert_eq!(site.camera_at("door", Some("2026-05-31T23:00:00Z")), Ok(&site.cameras[0]));
        assert_eq!(site.camera_at("door", Some(bump)), Ok(&site.cameras[1]));
        assert_eq!(site.camera_at("door", Some("noon")), Err(CameraLookupError::NotATime));
        assert_eq!(site.camera_at("roof", Some(bump)), Err(CameraLookupError::Unknown));
        assert_eq!(site.camera_id_from_name("door_20260701"), Some("door"));
        assert_eq!(site.camera_id_from_name("doors"), None);
        let entry = |time: &str| site.entry_index_at("door", Some(time));
        assert_eq!((entry("2026-05-31T23:00:00Z"), entry(bump)), (Some(0), Some(1)));
        assert_eq!(site.entry_index_at("door", None), Some(1), "the period without an end");
        assert_eq!([0, 1, 2].map(|index| site.owns_links(index)), [true, false, false]);
        assert_eq!([0, 1, 2].map(|index| site.is_superseded(index)), [true, false, false]);
        assert_eq!(site.cameras[1].is_divided_at(bump), Ok(false), "the period begins at this time");
        assert_eq!(site.cameras[1].is_divided_at("2026-07-01T00:00:00Z"), Ok(true));
    }
}
