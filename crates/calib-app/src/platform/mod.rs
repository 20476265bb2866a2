//! What a desktop and a browser do differently, behind one trait: files and choosers, work off the frame's path,
//! what is kept. No other folder asks on which of the two it runs.

#[cfg(not(target_arch = "wasm32"))]
mod native;
#[cfg(target_arch = "wasm32")]
pub(crate) mod web;

use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;

use calib_editor::{Edge, FileResult, Reach, Source};
use calib_image::{Comparison, LineSegment, Proposal};
use calib_site::{NewStill, Recovered, Site, SiteCamera};
use egui::Context;
use image::RgbImage;

use crate::choice::{Chosen, Purpose};

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use native::Native as Here;
#[cfg(not(target_arch = "wasm32"))]
pub use native::Task;
#[cfg(target_arch = "wasm32")]
pub use web::Task;
#[cfg(target_arch = "wasm32")]
pub(crate) use web::Web as Here;

/// Work that ended without a result, by a fault of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost;

/// Two stills of a camera, the old one first.
pub(crate) type Stills = [Arc<RgbImage>; 2];

/// A camera that is to be recovered.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Recovery {
    /// The site with its solutions.
    pub(crate) site: Site,
    /// The index of the camera.
    pub(crate) index: usize,
    /// What became of it.
    pub(crate) comparison: Comparison,
    /// Its newer still.
    pub(crate) still: NewStill,
}

impl Recovery {
    /// Recovers it.
    pub(crate) fn done(&self, [old, new]: [&RgbImage; 2]) -> Result<Recovered, String> {
        let found = calib_image::recovered(&self.site, self.index, &self.comparison, [old, new], &self.still);
        found.map_err(|refusal| refusal.to_string())
    }
}

/// The files that a chooser is closed with, some time later.
pub(crate) type Answer = Pin<Box<dyn Future<Output = Vec<Chosen>>>>;

/// A kind of system that the app runs on; [`Here`] is the one it was built for.
pub(crate) trait Platform {
    /// Ctrl+N is the system's, so that ours needs Alt.
    const KEEPS_CTRL_N: bool;
    /// What is saved lies in a folder, with its images beside it; else it is a download.
    const HAS_FOLDERS: bool;
    /// The face of headings.
    const MEDIUM_FONT: &'static [u8];
    /// A folder that one window has for itself, for as long as this lives.
    type Claim: std::fmt::Debug;

    /// Whether the operator asked their system for less motion.
    fn wants_stillness() -> bool;

    /// Reads a file of any size a site or image may have.
    ///
    /// # Errors
    /// When it is not there, or larger than that.
    fn read(path: &Path) -> FileResult<Vec<u8>>;

    /// Reads a file as [`Self::read`] does, if it is within reach once every link is followed.
    ///
    /// # Errors
    /// When it is not, and as that.
    fn read_within(path: &Path, reach: &Reach) -> FileResult<Vec<u8>>;

    /// Where a path leads once every link is followed; none where there is no file.
    fn real(path: &Path) -> Option<PathBuf>;

    /// Writes a file whole or not at all, and waits until the disk has it.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    fn write(path: &Path, bytes: &[u8]) -> FileResult<()>;

    /// Writes a file whole or not at all. It survives the end of this program, not that of the machine.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    fn write_quickly(path: &Path, bytes: &[u8]) -> FileResult<()>;

    /// Seconds since 1970; none where nothing is dated.
    fn now() -> Option<u64>;

    /// Whether a file is there and may not be written to.
    fn is_read_only(path: &Path) -> bool;

    /// Where autosaves and the demonstration's images live.
    fn data_dir() -> Option<PathBuf>;

    /// The images in a folder, by name.
    fn images_in(folder: &Path) -> Vec<PathBuf>;

    /// Claims a folder; `None` when another window has it.
    fn claim(folder: &Path) -> Option<Self::Claim>;

    /// Forgets the file of an autosave, and its images.
    fn forget(folder: &Path, file: &Path);

    /// Asks for files, or for where to put them.
    fn ask(purpose: Purpose) -> Answer;

    /// What was dropped, as if it had been chosen.
    fn dropped(ctx: &Context, files: Vec<egui::DroppedFileHandle>) -> Task<Vec<Chosen>>;

    /// Decodes an image; `then` makes of it what is wanted.
    fn picture<T: Send + 'static>(
        ctx: &Context,
        source: Source,
        then: impl FnOnce(RgbImage) -> T + Send + 'static,
    ) -> Task<Result<T, String>>;

    /// Reads the picture of a file of this name for its bytes and its pixels; a drawing becomes the picture that stands for it.
    fn still<T: Send + 'static>(
        ctx: &Context,
        name: String,
        source: Source,
        then: impl FnOnce(&[u8], &RgbImage, Option<Vec<u8>>) -> T + Send + 'static,
    ) -> Task<Result<T, String>>;

    /// Finds the straight edges of an image.
    fn find_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Vec<Edge>>;

    /// Finds the straight edges of an image to a fraction of a pixel, each with its noise.
    fn measure_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Result<Vec<LineSegment>, String>>;

    /// What edges propose for a camera, whose lens is known as far as it is entered.
    fn propose(ctx: &Context, camera: SiteCamera, edges: Vec<LineSegment>) -> Task<Result<Proposal, String>>;

    /// Nobody waits for edges that are measured, or for what they propose, any more.
    fn stop_proposing();

    /// What became of a camera, that is solved, between two stills.
    fn compare(ctx: &Context, camera: SiteCamera, stills: Stills) -> Task<Result<Comparison, String>>;

    /// A camera that moved between two stills, solved from what was drawn on the first; why not, where it is refused.
    fn recover(ctx: &Context, asked: Recovery, stills: Stills) -> Task<Result<Recovered, String>>;

    /// Nobody waits for what became of a camera any more.
    fn stop_comparing();

    /// Improves all cameras of a site together; it waits for no other work.
    fn refine(ctx: &Context, site: Site) -> Task<Result<Site, String>>;

    /// Nobody waits for the refined site any more.
    fn stop_refining();
}
