//! Newer stills of cameras, and what became of the cameras by them.
//!
//! They stand beside the site, not in it nor in its history: the still of a camera that was recovered is the newer one, and
//! undone it is the old one again, which the newer one was compared with.

use std::collections::BTreeSet;
use std::path::Path;

use calib_core::Camera;

use calib_image::{Became, Comparison};
use calib_input::time_in_name;
use calib_site::{Recovered, Site, SiteCamera};

use crate::images::camera_name;
use crate::session::Session;

/// A newer still of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Newer {
    /// The id of the camera, and every other that it was given since: a new id may be undone.
    pub ids: BTreeSet<String>,
    /// The period of the entry that it was compared with: its `valid_from` and `valid_to`.
    pub period: [Option<String>; 2],
    /// The still that it was compared with, as the site calls it.
    pub old: Option<String>,
    /// As the site would call it.
    pub image: String,
    /// What the operator calls it.
    pub title: String,
    /// Since when the camera stands as it shows (RFC 3339): when it was taken, or what the operator said; empty where
    /// neither is known.
    pub since: String,
    /// The camera that it was compared with.
    pub pose: Camera,
    /// What became of it.
    pub comparison: Comparison,
}

impl Newer {
    /// Whether it tells of this entry: of its period and its still.
    #[must_use]
    pub fn is_of(&self, entry: &SiteCamera) -> bool {
        let is_period = self.period.each_ref().map(Option::as_ref)
            == [entry.valid_from.as_ref(), entry.valid_to.as_ref()];
        self.ids.contains(&entry.id) && self.old == entry.image && entry.image.is_some() && is_period
    }

    /// Whether another one tells of the same entry.
    #[must_use]
    pub fn is_beside(&self, other: &Self) -> bool {
        (&self.old, &self.period) == (&other.old, &other.period) && !self.ids.is_disjoint(&other.ids)
    }

    /// Whether it was taken before another one; where a time is not known, it was not.
    #[must_use]
    pub fn is_before(&self, other: &Self) -> bool {
        let [own, other] = [&self.since, &other.since].map(|time| nanoseconds(time.trim()));
        own.zip(other).is_some_and(|(own, other)| own < other)
    }

    /// Whether the camera turned or zoomed in its place: then it may be recovered.
    #[must_use]
    pub fn has_moved(&self) -> bool {
        self.comparison.became == Became::Moved
    }
}

/// Since when the calibration of a camera holds, in seconds since 1970: as it says, or since its still was taken by its name.
#[must_use]
pub fn held_since(session: &Session, camera: usize) -> Option<u64> {
    let entry = session.site.cameras.get(camera)?;
    let of_still = || {
        let name = session.images.shown_name(entry.image.as_deref()?);
        time_in_name(&camera_name(Path::new(&name)))
    };
    let valid_from = entry.valid_from.clone().or_else(of_still)?;
    u64::try_from(nanoseconds(&valid_from)? / 1_000_000_000).ok()
}

/// A time (RFC 3339) in nanoseconds since 1970.
fn nanoseconds(time: &str) -> Option<i64> {
    let entry = SiteCamera { valid_from: Some(time.to_owned()), ..SiteCamera::new("", [1, 1]) };
    entry.period_ns().ok().map(|[from, _]| from)
}

/// What is done with newer stills.
#[derive(Clone, Debug)]
pub enum OnNewer {
    /// A still was compared; it takes the place of an older one of its camera.
    Compared(Box<Newer>),
    /// Since when that of the camera in hand holds.
    Since(String),
    /// That of the camera in hand is put aside.
    Dismiss,
    /// The camera of this id was recovered of a site as it was then.
    Recovered(String, Box<(Site, Recovered)>),
}
