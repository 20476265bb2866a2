//! Where a browser keeps sites between visits, behind a trait: the app asks, and hears of it in a later frame.

use std::fmt::Debug;
use std::path::PathBuf;

use calib_editor::Images;
use calib_site::Site;

use crate::autosave::Found;

/// A site that is kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Entry {
    /// By which it is asked for.
    pub id: String,
    /// What the operator calls it.
    pub name: String,
    /// How many cameras it has.
    pub cameras: usize,
    /// How large it is with its images, in bytes.
    pub bytes: u64,
    /// When it was kept last, in words.
    pub when: String,
    /// The last finished gesture.
    pub last: String,
    /// Its first still, small, as a `data:` URI.
    pub thumbnail: Option<String>,
}

/// What is to be kept after a finished gesture.
#[derive(Debug)]
pub struct Work<'a> {
    /// The site.
    pub site: &'a Site,
    /// Its images.
    pub images: &'a Images,
    /// The file it was opened from or saved to.
    pub path: Option<PathBuf>,
    /// The gesture.
    pub last: &'a str,
    /// Its first still, small, as a `data:` URI, once it was decoded.
    pub thumbnail: Option<&'a str>,
}

/// What a shelf tells.
#[derive(Debug)]
pub enum News {
    /// The site that was asked for.
    Opened(Box<Found>),
    /// What went wrong, and what to do.
    Trouble(String),
    /// Something that went right in a way one should know of.
    Note(String),
    /// What is open is to be kept once more, whole.
    Again,
}

/// A place that keeps sites.
pub trait Shelf: Debug {
    /// What is kept, newest first.
    fn entries(&self) -> Vec<Entry>;
    /// Keeps the site that is open.
    fn keep(&mut self, work: Work<'_>);
    /// From now on another site is open: it is kept beside the others.
    fn begin(&mut self);
    /// Asks for a site.
    fn open(&mut self, id: &str);
    /// Forgets a site.
    fn remove(&mut self, id: &str);
    /// What happened since the last frame.
    fn news(&mut self) -> Option<News>;
    /// Whether something that was to be kept is not kept yet.
    fn is_behind(&self) -> bool;
}
