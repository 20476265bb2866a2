//! Files that the operator opens and saves: sites, images, plans, screenshots. Also the start page and the
//! dialogs.

pub(crate) mod outside;
pub(crate) mod images;
pub(crate) mod open;
pub(crate) mod saving;
pub(crate) mod screenshot;
pub(crate) mod answers;
pub(crate) mod video;
pub(crate) mod address;
pub(crate) mod start;
