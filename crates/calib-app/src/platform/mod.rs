//! Differences between desktop and browser behind one trait: files, choosers, background work, storage. Only
//! this folder distinguishes the two.

#[cfg(not(target_arch = "wasm32"))]
mod native;
#[cfg(target_arch = "wasm32")]
pub(crate) mod web;

use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use calib_editor::{AllowedFiles, Edge, FileResult, Source};
use calib_image::{AutomaticCalibration, Comparison, EmptyScene, ImageEdges, SitePlacement, shrunk};
use calib_plan::{Part, View};
use calib_site::{NewImage, Recovered, Site, SiteCamera};
use egui::Context;
use image::RgbImage;

use crate::choice::{Chosen, Purpose};
use crate::drawing::DecodedImage;

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use native::Native as Here;
#[cfg(not(target_arch = "wasm32"))]
pub use native::Task;
#[cfg(target_arch = "wasm32")]
pub use web::Task;
#[cfg(target_arch = "wasm32")]
pub(crate) use web::Web as Here;

/// Error of background work that ended without a result because of a panic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost;

/// Old and new image of a camera.
pub(crate) type Stills = [Arc<RgbImage>; 2];

/// Input for the recovery of a camera that moved, from its newer image.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Recovery {
    /// Site with its solutions.
    pub(crate) site: Site,
    /// Index of the camera to recover.
    pub(crate) index: usize,
    /// Comparison of the camera's two images.
    pub(crate) comparison: Comparison,
    /// Newer image of the camera.
    pub(crate) still: NewImage,
}

impl Recovery {
    /// Recovers the camera from its old and its new image.
    pub(crate) fn done(&self, [old, new]: [&RgbImage; 2]) -> Result<Recovered, String> {
        let found = calib_image::recover(&self.site, self.index, &self.comparison, [old, new], &self.still);
        found.map_err(|refusal| refusal.to_string())
    }
}

/// Input of the search for the placements of cameras.
#[derive(Debug)]
pub(crate) struct PlacementRequest {
    /// Site with its solutions.
    pub(crate) site: Site,
    /// Indices of the cameras.
    pub(crate) cameras: Vec<usize>,
    /// Image of each camera; it may be smaller than the calibrated size.
    pub(crate) images: Vec<RgbImage>,
    /// Image of the plan, in its full size.
    pub(crate) plan: Option<Arc<RgbImage>>,
}

/// Address of a camera, with the credentials and the option for reading an image from it.
#[cfg_attr(target_arch = "wasm32", expect(dead_code, reason = "browsers do not read these addresses"))]
pub(crate) struct SnapshotRequest {
    pub(crate) address: String,
    /// Name of the user; empty for a request without name and password.
    pub(crate) user: String,
    pub(crate) password: String,
    /// Whether any HTTPS certificate is accepted, without verification.
    pub(crate) accepts_any_certificate: bool,
}

/// Image file from the address of a camera.
#[derive(Debug)]
pub(crate) struct SnapshotFile {
    /// Ending of the file name: jpg or png.
    pub(crate) ending: &'static str,
    pub(crate) bytes: Vec<u8>,
    /// Pixel aspect from the metadata of the video; 1 for images.
    pub(crate) pixel_aspect: f64,
}

/// Frames to read from a video.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FrameRequest {
    /// This number of small frames, evenly spaced over the video. Their longer side has [`Self::SMALL_SIDE`] pixels.
    Strip(usize),
    /// Frame that is shown at this time, in seconds.
    At(f64),
    /// Scene without moving objects, computed from this number of frames.
    Scene(usize),
}

impl FrameRequest {
    /// Longer side of a small frame, in pixels.
    pub(crate) const SMALL_SIDE: u32 = 240;
}

/// Frames of a video.
#[derive(Debug)]
pub(crate) struct VideoFrames {
    pub(crate) duration_s: f64,
    /// Pixel aspect of the frames, in the sense of `lens.pixel_aspect`.
    pub(crate) pixel_aspect: f64,
    pub(crate) content: VideoContent,
}

/// Images from a video.
#[derive(Debug)]
pub(crate) enum VideoContent {
    /// Frames with the times at which they appear, in seconds, ascending.
    Frames(Vec<(f64, RgbImage)>),
    /// Scene without moving objects.
    Scene(EmptyScene),
}

impl VideoContent {
    /// Converts the frames of a request. All frames have one size.
    pub(crate) fn new(request: FrameRequest, frames: Vec<(f64, RgbImage)>) -> Self {
        match request {
            FrameRequest::At(_) => Self::Frames(frames),
            FrameRequest::Strip(_) => {
                let small = |(time, image)| (time, shrunk(&image, FrameRequest::SMALL_SIDE).unwrap_or(image));
                Self::Frames(frames.into_iter().map(small).collect())
            }
            FrameRequest::Scene(_) => {
                let images: Vec<RgbImage> = frames.into_iter().map(|(_, image)| image).collect();
                Self::Scene(EmptyScene::new(&images))
            }
        }
    }
}

/// Progress of background work, and its cancellation.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    /// Share of the work done, in thousandths.
    thousandths: AtomicU32,
    is_cancelled: AtomicBool,
}

impl Progress {
    /// Returns the share of the work done, 0 to 1.
    pub(crate) fn share(&self) -> f32 {
        self.thousandths.load(Ordering::Relaxed) as f32 / 1000.0
    }

    /// Sets the share of the work done, 0 to 1. Returns whether to continue.
    pub(crate) fn report(&self, share: f64) -> bool {
        self.thousandths.store((1000.0 * share) as u32, Ordering::Relaxed);
        !self.is_cancelled.load(Ordering::Relaxed)
    }

    /// Cancels the work.
    pub(crate) fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }
}

/// Future with the files that the operator chooses; empty if the chooser is cancelled.
pub(crate) type Answer = Pin<Box<dyn Future<Output = Vec<Chosen>>>>;

/// System on which the app runs; [`Here`] is the system of this build.
pub(crate) trait Platform {
    /// Whether the system reserves Ctrl+N, so that the app's shortcut needs Alt in addition.
    const KEEPS_CTRL_N: bool;
    /// Whether files are saved to folders, next to their images; otherwise files are downloads.
    const HAS_FOLDERS: bool;
    /// Whether images can be read from the addresses of cameras. Browsers refuse this.
    const HAS_ADDRESSES: bool;
    /// Whether the system may decode images in formats that our decoder does not read.
    const HAS_OTHER_DECODERS: bool;
    /// Font of headings.
    const MEDIUM_FONT: &'static [u8];
    /// Licence notices of the crates in the program.
    const NOTICES: &'static str;
    /// Lock of an autosave folder; dropping the lock releases the folder.
    type Claim: std::fmt::Debug;

    /// Whether the operator asked the system for reduced motion.
    fn wants_stillness() -> bool;

    /// Reads a file, up to the largest size of a site or an image.
    ///
    /// # Errors
    /// When the file is missing or too large.
    fn read(path: &Path) -> FileResult<Vec<u8>>;

    /// Reads a file as [`Self::read`] does, if `reach` allows its path after all links are resolved.
    ///
    /// # Errors
    /// When the path is not allowed, and as `read`.
    fn read_within(path: &Path, reach: &AllowedFiles) -> FileResult<Vec<u8>>;

    /// Resolves all links of a path; `None` if the file is missing.
    fn real(path: &Path) -> Option<PathBuf>;

    /// Writes a file atomically, and waits until it is on disk.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    fn write(path: &Path, bytes: &[u8]) -> FileResult<()>;

    /// Writes a file atomically, without waiting for the disk. The file survives a crash of the program, but
    /// not of the machine.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    fn write_quickly(path: &Path, bytes: &[u8]) -> FileResult<()>;

    /// Returns the time in seconds since 1970; `None` in the browser, whose storage dates its entries.
    fn now() -> Option<u64>;

    /// Whether a file exists and is read-only.
    fn is_read_only(path: &Path) -> bool;

    /// Returns the folder of autosaves and of the demonstration's images; `None` in the browser.
    fn data_dir() -> Option<PathBuf>;

    /// Returns the paths of the visible files in a folder, sorted by name; `None` if the path is not a folder.
    fn files_in(folder: &Path) -> Option<Vec<PathBuf>>;

    /// Returns at most the first `bytes` bytes of a file; empty if it cannot be read.
    fn head(path: &Path, bytes: usize) -> Vec<u8>;

    /// Locks an autosave folder; `None` if another window has locked it.
    fn claim(folder: &Path) -> Option<Self::Claim>;

    /// Deletes the autosave `file` and the images in its folder.
    fn forget(folder: &Path, file: &Path);

    /// Opens a file chooser for opening or saving, according to the purpose.
    fn ask(purpose: Purpose) -> Answer;

    /// Reads dropped files as chosen files.
    fn dropped(ctx: &Context, files: Vec<egui::DroppedFileHandle>) -> Task<Vec<Chosen>>;

    /// Decodes an image in the background and passes it to `then`. `view` selects the page or the layers of a
    /// drawing.
    fn picture<T: Send + 'static>(
        ctx: &Context,
        source: Source,
        view: View,
        then: impl FnOnce(DecodedImage) -> T + Send + 'static,
    ) -> Task<Result<T, String>>;

    /// Draws a part of an SVG document in the background.
    fn draw_part(ctx: &Context, svg: Arc<[u8]>, part: Part) -> Task<Result<RgbImage, String>>;

    /// Reads an image file in the background, and passes its bytes, its pixels and its PNG to `then`. Only an
    /// SVG drawing, or an image that only the browser can decode, has a PNG.
    fn still<T: Send + 'static>(
        ctx: &Context,
        name: String,
        source: Source,
        then: impl FnOnce(&[u8], DecodedImage, Option<Vec<u8>>) -> T + Send + 'static,
    ) -> Task<Result<T, String>>;

    /// Reads frames of a video. The first request for a video is the strip; the browser then keeps the video until
    /// [`Self::close_video`].
    fn frames(
        ctx: &Context,
        file: &Chosen,
        request: FrameRequest,
        progress: &Arc<Progress>,
    ) -> Task<Result<VideoFrames, String>>;

    /// Reads an image from the address of a camera.
    fn snapshot(ctx: &Context, request: SnapshotRequest) -> Task<Result<SnapshotFile, String>>;

    /// Releases the video that the browser keeps.
    fn close_video();

    /// Detects the straight edges of an image.
    fn find_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Vec<Edge>>;

    /// Detects the straight edges of an image with subpixel accuracy and their noise.
    fn measure_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Result<ImageEdges, String>>;

    /// Calibrates a camera automatically from its detected edges. If the camera entry contains a distortion,
    /// the lens is not estimated.
    fn propose(
        ctx: &Context,
        camera: SiteCamera,
        edges: ImageEdges,
    ) -> Task<Result<AutomaticCalibration, String>>;

    /// Cancels the running edge measurement and automatic calibration.
    fn stop_proposing();

    /// Searches for the placements of cameras, by the colours of their images.
    fn place(
        ctx: &Context,
        asked: PlacementRequest,
        progress: &Arc<Progress>,
    ) -> Task<Result<SitePlacement, String>>;

    /// Cancels the running search for placements.
    fn stop_placing();

    /// Compares two images of a solved camera.
    fn compare(ctx: &Context, camera: SiteCamera, stills: Stills) -> Task<Result<Comparison, String>>;

    /// Recovers a camera that moved between two images, from the annotations of the old image. The error is
    /// the reason of a refusal.
    fn recover(ctx: &Context, asked: Recovery, stills: Stills) -> Task<Result<Recovered, String>>;

    /// Cancels the running comparison and recovery.
    fn stop_comparing();

    /// Refines all cameras of a site jointly. The refinement starts at once, even if other work is running.
    fn refine(ctx: &Context, site: Site) -> Task<Result<Site, String>>;

    /// Cancels the running refinement.
    fn stop_refining();
}
