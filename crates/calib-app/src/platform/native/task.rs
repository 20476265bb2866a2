//! Background work on threads.

use std::fs::File;
use std::io::{BufReader, Cursor};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use calib_editor::images::png;
use calib_editor::{Edge, Source, decode, edges, refined};
use calib_image::{
    AutomaticCalibration, Comparison, EdgeImage, ImageEdges, PairRegistration, PlacementSearch, SitePlacement,
};
use calib_plan::{DrawingKind, Part, Picture, View};
use calib_site::{Recovered, Site, SiteCamera};
use calib_video::{Credentials, Snapshot, SnapshotErrorKind, SnapshotOptions, Video, VideoError};
use egui::Context;
use image::RgbImage;

use crate::choice::Chosen;
use crate::drawing::DecodedImage;
use crate::platform::native::files;
use crate::platform::{
    FrameRequest, Lost, PlacementRequest, Progress, Recovery, SnapshotFile, SnapshotRequest, Stills,
    VideoContent, VideoFrames,
};

/// Task in the background and its result. A task that is dropped before its start is not started.
#[derive(Debug)]
pub struct Task<T> {
    result: std::sync::mpsc::Receiver<T>,
    /// Counter that shows the thread whether the task was dropped.
    wanted: Arc<()>,
}

/// Limits running work to the number of processors, so that a folder of images does not fill the memory.
mod gate {
    use std::sync::{Condvar, Mutex, PoisonError};

    static RUNNING: Mutex<usize> = Mutex::new(0);
    static DONE: Condvar = Condvar::new();

    /// Slot of a running task, released when it is dropped, also after a panic.
    pub(super) struct Slot;

    /// Waits until fewer tasks are running than processors exist, and takes a slot.
    pub(super) fn enter() -> Slot {
        let most = std::thread::available_parallelism().map_or(2, std::num::NonZero::get);
        let running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = DONE.wait_while(running, |running| *running >= most);
        *waited.unwrap_or_else(PoisonError::into_inner) += 1;
        Slot
    }

    impl Drop for Slot {
        fn drop(&mut self) {
            *RUNNING.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
            DONE.notify_one();
        }
    }
}

impl<T: Send + 'static> Task<T> {
    /// Starts a task when a slot is free; requests a frame when the task has ended.
    #[must_use]
    pub fn spawn(ctx: &Context, work: impl FnOnce() -> T + Send + 'static) -> Self {
        Self::start(ctx, || Some(gate::enter()), work)
    }

    /// Starts a task at once, without waiting for a slot; requests a frame when the task has ended.
    #[must_use]
    pub fn spawn_apart(ctx: &Context, work: impl FnOnce() -> T + Send + 'static) -> Self {
        Self::start(ctx, || None, work)
    }

    fn start(
        ctx: &Context,
        enter: fn() -> Option<gate::Slot>,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Self {
        let (sender, result) = std::sync::mpsc::channel();
        let ctx = ctx.clone();
        let wanted = Arc::new(());
        let is_wanted = Arc::downgrade(&wanted);
        std::thread::spawn(move || {
            let _place = enter();
            if is_wanted.strong_count() == 0 {
                return;
            }
            let done = work();
            // An error means that the task was dropped.
            if sender.send(done).is_ok() {
                ctx.request_repaint();
            }
        });
        Self { result, wanted }
    }

    /// Returns the result, only once. `None` while the task is running, and after a panic.
    #[must_use]
    pub fn poll(&self) -> Option<T> {
        self.outcome()?.ok()
    }

    /// Returns the result, only once, or [`Lost`] after a panic. `None` while the task is running.
    #[must_use]
    pub fn outcome(&self) -> Option<Result<T, Lost>> {
        debug_assert!(Arc::strong_count(&self.wanted) == 1, "a task is waited for once");
        match self.result.try_recv() {
            Ok(result) => Some(Ok(result)),
            Err(std::sync::mpsc::TryRecvError::Empty) => None,
            Err(std::sync::mpsc::TryRecvError::Disconnected) => Some(Err(Lost)),
        }
    }
}

impl<T> Task<T> {
    /// Creates a task that has ended with this result.
    #[must_use]
    pub fn done(result: T) -> Self {
        let (sender, receiver) = std::sync::mpsc::channel();
        // The receiver exists, so that sending cannot fail.
        let _ = sender.send(result);
        Self { result: receiver, wanted: Arc::new(()) }
    }
}

pub(super) fn picture<T: Send + 'static>(
    ctx: &Context,
    source: Source,
    view: View,
    then: impl FnOnce(DecodedImage) -> T + Send + 'static,
) -> Task<Result<T, String>> {
    Task::spawn(ctx, move || Ok(then(decoded(&source.read(files::read_within)?, &view)?)))
}

/// Decodes an image, or rasterises a drawing.
fn decoded(bytes: &[u8], view: &View) -> Result<DecodedImage, String> {
    let Some(drawing) = calib_plan::read(bytes, view) else {
        return Ok(DecodedImage { image: decode(bytes)?, drawing: None, svg: None });
    };
    let drawing = drawing.map_err(|error| error.to_string())?;
    let facts = drawing.facts.clone();
    let svg = match &drawing.picture {
        Picture::Svg(text) => Some(text.as_bytes().into()),
        Picture::Pixels(_) => None,
    };
    let image = drawing.into_image().map_err(|error| error.to_string())?;
    Ok(DecodedImage { image, drawing: Some(facts), svg })
}

pub(super) fn draw_part(ctx: &Context, svg: Arc<[u8]>, part: Part) -> Task<Result<RgbImage, String>> {
    Task::spawn(ctx, move || calib_plan::rasterise_part(svg, &part).map_err(|error| error.to_string()))
}

/// Returns the PNG of an SVG drawing; `None` for other images.
fn png_of_svg(decoded: &DecodedImage) -> Result<Option<Vec<u8>>, String> {
    if decoded.drawing.as_ref().is_none_or(|drawing| drawing.kind != DrawingKind::Svg) {
        return Ok(None);
    }
    png(&decoded.image).map(Some)
}

pub(super) fn still<T: Send + 'static>(
    ctx: &Context,
    name: String,
    source: Source,
    then: impl FnOnce(&[u8], DecodedImage, Option<Vec<u8>>) -> T + Send + 'static,
) -> Task<Result<T, String>> {
    Task::spawn(ctx, move || {
        let bytes = source.read(files::read_within)?;
        let picture = || {
            let decoded = decoded(&bytes, &View::default())?;
            let png = png_of_svg(&decoded)?;
            Ok(then(&bytes, decoded, png))
        };
        picture().map_err(|error: String| format!("{name}: {error}"))
    })
}

/// Reads frames of a video, with the decoders of the program.
pub(super) fn frames(
    ctx: &Context,
    file: &Chosen,
    request: FrameRequest,
    progress: &Arc<Progress>,
) -> Task<Result<VideoFrames, String>> {
    let (file, progress) = (file.clone(), Arc::clone(progress));
    Task::spawn_apart(ctx, move || read_frames(file, request, &progress).map_err(|error| error.to_string()))
}

fn read_frames(file: Chosen, request: FrameRequest, progress: &Progress) -> Result<VideoFrames, VideoError> {
    let mut video = match (file.path, file.bytes) {
        (Some(path), _) => Video::open(BufReader::new(File::open(path)?))?,
        (None, bytes) => Video::open(Cursor::new(bytes.unwrap_or_default()))?,
    };
    let times = match request {
        FrameRequest::At(time) => vec![time],
        FrameRequest::Strip(count) | FrameRequest::Scene(count) => video.spread_times(count),
    };
    let mut frames = video.frames_at(&times, &mut |share| progress.report(share))?;
    // The size may change within a recording.
    let size = frames.first().map(|(_, image)| image.dimensions());
    frames.retain(|(_, image)| Some(image.dimensions()) == size);
    Ok(VideoFrames {
        duration_s: video.duration_s(),
        pixel_aspect: video.pixel_aspect(),
        content: VideoContent::new(request, frames),
    })
}

pub(super) fn snapshot(ctx: &Context, request: SnapshotRequest) -> Task<Result<SnapshotFile, String>> {
    Task::spawn_apart(ctx, move || {
        let SnapshotRequest { address, user, password, accepts_any_certificate } = request;
        let credentials = (!user.is_empty()).then_some(Credentials { user, password });
        let options = SnapshotOptions { credentials, accepts_any_certificate, ..SnapshotOptions::default() };
        let Snapshot { image, jpeg, pixel_aspect } =
            calib_video::snapshot(&address, &options).map_err(|error| match error.kind {
                SnapshotErrorKind::NoCredentials => format!("{error}. Enter them."),
                _ => format!("{error}."),
            })?;
        let (ending, bytes) = match jpeg {
            Some(jpeg) => ("jpg", jpeg),
            None => ("png", png(&image)?),
        };
        Ok(SnapshotFile { ending, bytes, pixel_aspect })
    })
}

pub(super) fn find_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Vec<Edge>> {
    let image = Arc::clone(image);
    Task::spawn(ctx, move || edges::detect(&image))
}

pub(super) fn measure_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Result<ImageEdges, String>> {
    let image = Arc::clone(image);
    Task::spawn_apart(ctx, move || Ok(ImageEdges::measure(&image)))
}

pub(super) fn propose(
    ctx: &Context,
    camera: SiteCamera,
    edges: ImageEdges,
) -> Task<Result<AutomaticCalibration, String>> {
    Task::spawn_apart(ctx, move || Ok(AutomaticCalibration::new(&EdgeImage::from_camera(&camera, edges))))
}

/// Searches for the placements of cameras, with one thread per processor.
pub(super) fn place(
    ctx: &Context,
    asked: PlacementRequest,
    progress: &Arc<Progress>,
) -> Task<Result<SitePlacement, String>> {
    const PAIRED: f64 = PlacementSearch::PAIRS_SHARE;
    let progress = Arc::clone(progress);
    Task::spawn_apart(ctx, move || {
        let PlacementRequest { site, cameras, images, plan } = asked;
        let search = PlacementSearch::new(&site, &cameras, &images, plan.as_deref());
        let pairs = search.pairs();
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let found: Vec<OnceLock<PairRegistration>> = pairs.iter().map(|_| OnceLock::new()).collect();
        let work = || {
            while let index = next.fetch_add(1, Ordering::Relaxed)
                && let Some((pair, found)) = pairs.get(index).zip(found.get(index))
            {
                // No other thread has this index, so `set` cannot fail.
                let _ = found.set(search.register(*pair));
                let share = (done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / pairs.len() as f64;
                if !progress.report(PAIRED * share) {
                    return;
                }
            }
        };
        let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        std::thread::scope(|scope| (0..threads.min(pairs.len())).for_each(|_| drop(scope.spawn(work))));
        let found: Vec<PairRegistration> = found.into_iter().filter_map(OnceLock::into_inner).collect();
        let mut report = |share: f64| progress.report(PAIRED + (1.0 - PAIRED) * share);
        search.place(&site, &found, &mut report).ok_or_else(|| "the search was cancelled".into())
    })
}

pub(super) fn compare(
    ctx: &Context,
    camera: SiteCamera,
    [old, new]: Stills,
) -> Task<Result<Comparison, String>> {
    Task::spawn_apart(ctx, move || {
        Comparison::from_entry(&camera, &old, &new).map_err(|error| error.to_string())
    })
}

pub(super) fn recover(ctx: &Context, asked: Recovery, [old, new]: Stills) -> Task<Result<Recovered, String>> {
    Task::spawn_apart(ctx, move || asked.done([&old, &new]))
}

pub(super) fn refine(ctx: &Context, site: Site) -> Task<Result<Site, String>> {
    Task::spawn_apart(ctx, move || Ok(refined(site)))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn work_that_nobody_waits_for_is_not_begun() {
        static BEGUN: AtomicUsize = AtomicUsize::new(0);
        let ctx = Context::default();
        let work = || {
            BEGUN.fetch_add(1, Ordering::Relaxed);
            std::thread::sleep(Duration::from_millis(50));
        };
        let tasks: Vec<Task<()>> = (0..200).map(|_| Task::spawn(&ctx, work)).collect();
        drop(tasks);
        let last = Task::spawn(&ctx, || ());
        let patience = Instant::now();
        while last.poll().is_none() {
            assert!(patience.elapsed() < Duration::from_secs(10), "the queue does not move");
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(BEGUN.load(Ordering::Relaxed) < 100, "{BEGUN:?} of 200 were begun");
    }
}
