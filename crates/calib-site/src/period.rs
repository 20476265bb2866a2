//! From when to when a camera entry holds, and which one is meant by an id.

use std::collections::HashMap;
use std::fmt;

use jiff::Timestamp;

use crate::bounds::{At, Checked};
use crate::document::{Site, SiteCamera};
use crate::site_error::{SiteError, quoted};

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

/// Why an id means no entry.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoCamera {
    /// No camera has it.
    Unknown,
    /// Several periods have it, and no time was said.
    SeveralPeriods,
    /// No period of it holds then.
    NoneThen,
    /// What was said is no time.
    NotATime,
}

impl fmt::Display for NoCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "the site has no camera of this id",
            Self::SeveralPeriods => "several periods have this id: say a time",
            Self::NoneThen => "no calibration of this camera holds at this time",
            Self::NotATime => "not a time such as 2026-05-01T08:00:00Z",
        })
    }
}

impl std::error::Error for NoCamera {}

impl Site {
    /// The camera of this id; `None` where there is none, and where several periods have it:
    /// [`Self::camera_at`] takes the time.
    #[must_use]
    pub fn camera(&self, id: &str) -> Option<&SiteCamera> {
        self.camera_at(id, None).ok()
    }

    /// The entry of this id that holds at a time (RFC 3339). Without a time only an id that no other period
    /// has means one.
    ///
    /// # Errors
    /// Why there is not one.
    pub fn camera_at(&self, id: &str, time: Option<&str>) -> Result<&SiteCamera, NoCamera> {
        let of_id: Vec<&SiteCamera> = self.cameras.iter().filter(|camera| camera.id == id).collect();
        let Some(time) = time else {
            return match of_id[..] {
                [] => Err(NoCamera::Unknown),
                [only] => Ok(only),
                _ => Err(NoCamera::SeveralPeriods),
            };
        };
        let last = if of_id.is_empty() { NoCamera::Unknown } else { NoCamera::NoneThen };
        for camera in of_id {
            if camera.is_valid_at(time).map_err(|_| NoCamera::NotATime)? {
                return Ok(camera);
            }
        }
        Err(last)
    }
}

impl Site {
    /// The id that the name of a still is or begins with, the longest such one: `door` of `door_20260501_0830`.
    #[must_use]
    pub fn camera_of_name(&self, name: &str) -> Option<&str> {
        let is_named = |id: &&str| {
            let rest = name.strip_prefix(*id);
            rest.is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
        };
        let ids = self.cameras.iter().map(|camera| camera.id.as_str()).filter(|id| !id.is_empty());
        ids.filter(is_named).max_by_key(|id| id.len())
    }

    /// The index of the entry of this id that holds at a time, of an unknown time that without an end; the only one of an
    /// id holds always.
    #[must_use]
    pub fn entry_at(&self, id: &str, time: Option<&str>) -> Option<usize> {
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

    /// Whether another period of its camera follows an entry: then it tells nothing of today.
    #[must_use]
    pub fn is_followed(&self, index: usize) -> bool {
        let Some(entry) = self.cameras.get(index).filter(|entry| entry.valid_to.is_some()) else {
            return false;
        };
        let begins = |other: &SiteCamera| {
            let (own, other) = entry.period_ns().ok().zip(other.period_ns().ok())?;
            Some(other[0] >= own[1])
        };
        self.cameras.iter().any(|other| other.id == entry.id && begins(other) == Some(true))
    }

    /// Whether links and marks that name the id of an entry are of this one: of several periods, the first.
    #[must_use]
    pub fn has_shared(&self, index: usize) -> bool {
        let id = self.cameras.get(index).map(|camera| &camera.id);
        id.is_some() && self.cameras.iter().position(|camera| Some(&camera.id) == id) == Some(index)
    }
}

impl SiteCamera {
    /// Whether two entries are of one period of one camera.
    #[must_use]
    pub fn is_same_period(&self, other: &Self) -> bool {
        self.id == other.id && self.valid_from == other.valid_from
    }

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

    /// Whether a time (RFC 3339) lies within the period of this calibration, with time before it and after.
    ///
    /// # Errors
    /// When the text is not a time.
    pub fn is_divided_at(&self, time: &str) -> Result<bool, SiteError> {
        let at = At::root();
        let when = instant(&at, Some(&time.to_owned()), Timestamp::MIN)?;
        let from = instant(&at, self.valid_from.as_ref(), Timestamp::MIN)?;
        Ok(from < when && self.is_valid_at(time)?)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_of_several_periods_means_one_only_with_a_time() {
        let period = |from: Option<&str>, to: Option<&str>| SiteCamera {
            valid_from: from.map(str::to_owned),
            valid_to: to.map(str::to_owned),
            ..SiteCamera::new("door", [640, 480])
        };
        let bump = "2026-06-01T00:00:00Z";
        let mut site = Site { cameras: vec![period(None, Some(bump))], ..Site::new() };
        assert_eq!(site.camera("door"), Some(&site.cameras[0]));
        assert_eq!(site.camera_at("door", Some("2026-07-01T00:00:00Z")), Err(NoCamera::NoneThen));
        assert!(!site.is_followed(0), "it has ended, and nothing is newer");
        site.cameras.push(period(Some(bump), None));
        assert_eq!((site.camera("door"), site.camera("roof")), (None, None));
        assert_eq!(site.camera_at("door", None), Err(NoCamera::SeveralPeriods));
        assert_eq!(site.camera_at("door", Some("2026-05-31T23:00:00Z")), Ok(&site.cameras[0]));
        assert_eq!(site.camera_at("door", Some(bump)), Ok(&site.cameras[1]));
        assert_eq!(site.camera_at("door", Some("noon")), Err(NoCamera::NotATime));
        assert_eq!(site.camera_at("roof", Some(bump)), Err(NoCamera::Unknown));
        assert_eq!(site.camera_of_name("door_20260701"), Some("door"));
        assert_eq!(site.camera_of_name("doors"), None);
        let entry = |time: &str| site.entry_at("door", Some(time));
        assert_eq!((entry("2026-05-31T23:00:00Z"), entry(bump)), (Some(0), Some(1)));
        assert_eq!(site.entry_at("door", None), Some(1), "that without an end");
        assert_eq!([0, 1, 2].map(|index| site.has_shared(index)), [true, false, false]);
        assert_eq!([0, 1, 2].map(|index| site.is_followed(index)), [true, false, false]);
        assert_eq!(site.cameras[1].is_divided_at(bump), Ok(false), "it begins then");
        assert_eq!(site.cameras[1].is_divided_at("2026-07-01T00:00:00Z"), Ok(true));
    }
}
