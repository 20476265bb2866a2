//! Platform in the browser: files, background tasks, file dialogs, and functions of the web page.

pub(crate) mod page;
mod task;
mod worker;

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use calib_editor::{AllowedFiles, Edge, FileResult, Source};
use calib_image::{AutomaticCalibration, Comparison, ImageEdges, SitePlacement};
use calib_plan::{DrawingKind, Part, View};
use calib_site::{Recovered, Site, SiteCamera};
use egui::Context;
use image::RgbImage;
use js_sys::{Reflect, Uint8Array};
use wasm_bindgen::{JsCast as _, JsValue, prelude::Closure};
use wasm_bindgen_futures::JsFuture;

use crate::choice::{Chosen, Purpose};
use crate::drawing::DecodedImage;
use crate::platform::{
    Answer, FrameRequest, PlacementRequest, Platform, Progress, Recovery, SnapshotFile, SnapshotRequest,
    Stills, VideoContent, VideoFrames,
};

pub use task::Task;

pub(crate) use worker::{COMPARE, DRAWING, PLACE, PROPOSE, PlacementStep, RECOVER, REFINE};

/// Browser platform.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Web;

impl Platform for Web {
    const KEEPS_CTRL_N: bool = true;
    const HAS_FOLDERS: bool = false;
    const HAS_ADDRESSES: bool = false;
    const HAS_OTHER_DECODERS: bool = true;
    // Headings use the regular font, which keeps the page small.
    const MEDIUM_FONT: &'static [u8] = include_bytes!("../../../assets/IBMPlexSans-Regular.ttf");
    const NOTICES: &'static str = include_str!("../../../assets/THIRD-PARTY-PAGE.txt");
    // The database of the browser needs no locks.
    type Claim = ();

    fn wants_stillness() -> bool {
        page::PAGE.with(page::Page::still)
    }

    /// Returns an error: the browser cannot read paths, and files must be dropped on the page.
    fn read(path: &Path) -> FileResult<Vec<u8>> {
        Err(format!("{}: the browser cannot open this path; drop the image on the page", path.display()))
    }

    fn read_within(path: &Path, _: &AllowedFiles) -> FileResult<Vec<u8>> {
        Self::read(path)
    }

    fn real(_: &Path) -> Option<PathBuf> {
        None
    }

    /// Offers the file as a download.
    fn write(path: &Path, bytes: &[u8]) -> FileResult<()> {
        download(path, bytes);
        Ok(())
    }

    /// Returns an error: the browser has no files. Sites are stored in its database.
    fn write_quickly(path: &Path, _: &[u8]) -> FileResult<()> {
        Err(format!("{}: the browser cannot write files", path.display()))
    }

    // The database of the browser dates its entries.
    fn now() -> Option<u64> {
        None
    }

    fn is_read_only(_: &Path) -> bool {
        false
    }

    fn data_dir() -> Option<PathBuf> {
        None
    }

    fn files_in(_: &Path) -> Option<Vec<PathBuf>> {
        None
    }

    fn head(_: &Path, _: usize) -> Vec<u8> {
        Vec::new()
    }

    fn claim(_: &Path) -> Option<Self::Claim> {
        Some(())
    }

    fn forget(_: &Path, _: &Path) {}

    fn ask(purpose: Purpose) -> Answer {
        Box::pin(page::ask(purpose))
    }

    fn dropped(ctx: &Context, files: Vec<egui::DroppedFileHandle>) -> Task<Vec<Chosen>> {
        Task::wait(ctx, async move {
            let mut chosen = Vec::new();
            for file in files {
                let name = file.path().to_string_lossy().into_owned();
                // A folder has no bytes; the caller reports it.
                let bytes = file.bytes_async().await.ok();
                chosen.push(Chosen { name, path: None, bytes });
            }
            chosen
        })
    }

    fn picture<T: Send + 'static>(
        ctx: &Context,
        source: Source,
        view: View,
        then: impl FnOnce(DecodedImage) -> T + Send + 'static,
    ) -> Task<Result<T, String>> {
        Task::wait(ctx, async move { Ok(then(decoded(source, &view).await?.0)) })
    }

    fn draw_part(ctx: &Context, svg: Arc<[u8]>, part: Part) -> Task<Result<RgbImage, String>> {
        Task::wait(ctx, async move {
            let [x, y] = part.low;
            let [w, h] = part.size;
            let bytes = Uint8Array::from(&svg[..]);
            let png = page::draw_part(&bytes, &[x, y, w, h], part.pixels[0], part.pixels[1]);
            let png = JsFuture::from(png).await.map_err(|error| said(&error))?;
            worker::pixels(&Uint8Array::new(&png).to_vec()).await
        })
    }

    fn still<T: Send + 'static>(
        ctx: &Context,
        name: String,
        source: Source,
        then: impl FnOnce(&[u8], DecodedImage, Option<Vec<u8>>) -> T + Send + 'static,
    ) -> Task<Result<T, String>> {
        Task::wait(ctx, async move {
            let picture = async {
                let is_made = source.name_to_render().is_some();
                let bytes = if is_made { None } else { Some(source.clone().read(Self::read_within)?) };
                let (decoded, png) = decoded(source, &View::default()).await?;
                Ok(then(bytes.as_deref().unwrap_or_default(), decoded, png))
            };
            picture.await.map_err(|error: String| format!("{name}: {error}"))
        })
    }

    fn frames(
        ctx: &Context,
        file: &Chosen,
        request: FrameRequest,
        progress: &Arc<Progress>,
    ) -> Task<Result<VideoFrames, String>> {
        if let Some(bytes) = file.bytes.as_deref().filter(|_| matches!(request, FrameRequest::Strip(_))) {
            page::open_video(&Uint8Array::from(bytes));
        }
        let progress = Arc::clone(progress);
        Task::wait(ctx, async move { frames(request, progress).await })
    }

    // The app does not offer this command in the browser.
    fn snapshot(ctx: &Context, _: SnapshotRequest) -> Task<Result<SnapshotFile, String>> {
        Task::wait(ctx, async { Err("A browser cannot read the addresses of cameras.".into()) })
    }

    fn close_video() {
        page::close_video();
    }

    fn find_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Vec<Edge>> {
        let image = Arc::clone(image);
        // After an error there are no edges, and the operator annotates by hand.
        Task::wait(ctx, async move { worker::edges(&image).await.unwrap_or_default() })
    }

    fn measure_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Result<ImageEdges, String>> {
        let image = Arc::clone(image);
        Task::wait(ctx, async move { worker::measure_edges(&image).await })
    }

    fn propose(
        ctx: &Context,
        camera: SiteCamera,
        edges: ImageEdges,
    ) -> Task<Result<AutomaticCalibration, String>> {
        Task::wait(ctx, async move { worker::propose(&camera, &edges).await })
    }

    // The page stops the worker.
    fn stop_proposing() {
        worker::stop_proposing();
    }

    fn place(
        ctx: &Context,
        asked: PlacementRequest,
        progress: &Arc<Progress>,
    ) -> Task<Result<SitePlacement, String>> {
        let progress = Arc::clone(progress);
        Task::wait(ctx, async move { worker::place(asked, &progress).await })
    }

    // The page stops the worker.
    fn stop_placing() {
        worker::stop_placing();
    }

    fn compare(ctx: &Context, camera: SiteCamera, stills: Stills) -> Task<Result<Comparison, String>> {
        Task::wait(ctx, async move { worker::compare(&camera, &stills).await })
    }

    fn recover(ctx: &Context, asked: Recovery, stills: Stills) -> Task<Result<Recovered, String>> {
        Task::wait(ctx, async move { worker::recover(&asked, &stills).await })
    }

    // The page stops the worker.
    fn stop_comparing() {
        worker::stop_comparing();
    }

    fn refine(ctx: &Context, site: Site) -> Task<Result<Site, String>> {
        Task::wait(ctx, async move { worker::refine(&site).await })
    }

    // The page stops the worker.
    fn stop_refining() {
        worker::stop_refining();
    }
}

/// Offers a file as a download.
pub(crate) fn download(path: &Path, bytes: &[u8]) {
    let name = path.file_name().map_or_else(|| "site.json".into(), |name| name.to_string_lossy());
    let mime = match path.extension().and_then(|extension| extension.to_str()) {
        Some("json" | "geojson") => "application/json",
        Some("png") => "image/png",
        Some("svg") => "image/svg+xml",
        Some("html") => "text/html",
        _ => "application/octet-stream",
    };
    page::download(&name, mime, &Uint8Array::from(bytes));
}

/// Opens a file chooser for files with these endings, and reads the chosen files.
pub(crate) async fn pick(endings: &[&str], multiple: bool) -> Vec<Chosen> {
    let accept: Vec<String> = endings.iter().map(|ending| format!(".{ending}")).collect();
    let Ok(files) = JsFuture::from(page::pick(&accept.join(","), multiple)).await else { return Vec::new() };
    read_all(&js_sys::Array::from(&files)).await
}

/// Reads files that the browser passes to the page; an unreadable file has no bytes.
pub(crate) async fn read_all(files: &js_sys::Array) -> Vec<Chosen> {
    let mut chosen = Vec::new();
    for file in files.iter().filter_map(|file| file.dyn_into::<web_sys::File>().ok()) {
        let bytes = match JsFuture::from(file.array_buffer()).await {
            Ok(buffer) => Some(Uint8Array::new(&buffer).to_vec()),
            // A folder or a removed file cannot be read; the caller reports it.
            Err(_) => None,
        };
        chosen.push(Chosen { name: file.name(), path: None, bytes });
    }
    chosen
}

/// Reads frames of the open video with the decoder of the browser, which scales every frame to square pixels.
async fn frames(request: FrameRequest, progress: Arc<Progress>) -> Result<VideoFrames, String> {
    let (time, count, side) = match request {
        FrameRequest::At(time) => (time, 1, 0),
        FrameRequest::Strip(count) => (-1.0, count, FrameRequest::SMALL_SIDE),
        FrameRequest::Scene(count) => (-1.0, count, 0),
    };
    let found = Rc::new(RefCell::new(Vec::new()));
    let all = Rc::clone(&found);
    let take = Closure::<dyn FnMut(f64, f64, u32, u32, Uint8Array) -> bool>::new(
        move |share: f64, time: f64, width: u32, height: u32, pixels: Uint8Array| {
            let rgb =
                pixels.to_vec().chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
            let mut all = all.borrow_mut();
            all.extend(RgbImage::from_raw(width, height, rgb).map(|image| (time, image)));
            progress.report(share)
        },
    );
    let read = page::frames(time, count as u32, side, take.as_ref().unchecked_ref());
    let duration = JsFuture::from(read).await.map_err(|error| said(&error))?;
    // The sheet shows the end of the progress before the median is computed.
    breath().await;
    let content = VideoContent::new(request, found.take());
    Ok(VideoFrames { duration_s: duration.as_f64().unwrap_or_default(), pixel_aspect: 1.0, content })
}

/// Rasterises an SVG on white; returns a PNG. `side` is its longer side, in pixels.
async fn draw(bytes: &[u8], side: u32) -> Result<Vec<u8>, String> {
    let drawn = JsFuture::from(page::draw(&Uint8Array::from(bytes), side)).await;
    drawn.map(|png| Uint8Array::new(&png).to_vec()).map_err(|error| said(&error))
}

/// Longer side of a rasterised SVG plan, in pixels. The desktop program uses the same size.
const SVG_SIDE: u32 = 3072;

/// Decodes an image, or rasterises a drawing. The browser decodes formats that our decoder does not read, such as
/// WebP. For these formats and for SVG drawings, also returns a PNG.
async fn decoded(source: Source, view: &View) -> Result<(DecodedImage, Option<Vec<u8>>), String> {
    let bytes = match source.name_to_render() {
        Some(_) => None,
        None => Some(source.clone().read(Web::read_within)?),
    };
    if let Some((bytes, refusal)) =
        bytes.as_deref().and_then(|bytes| Some((bytes, calib_input::refusal(bytes)?)))
        && DrawingKind::of(bytes).is_none()
    {
        let png = JsFuture::from(page::convert(&Uint8Array::from(bytes))).await;
        let png = png.map_err(|_| refusal.to_string())?;
        let png = Uint8Array::new(&png).to_vec();
        let image = worker::pixels(&png).await?;
        // The PNG is stored in the site instead of the file, so that other programs can read the image.
        return Ok((DecodedImage { image, drawing: None, svg: None }, Some(png)));
    }
    let drawing = bytes.as_deref().and_then(|bytes| Some((bytes, DrawingKind::of(bytes)?)));
    match drawing {
        None => Ok((DecodedImage { image: worker::decode(source).await?, drawing: None, svg: None }, None)),
        Some((bytes, DrawingKind::Svg)) => {
            let png = draw(bytes, SVG_SIDE).await?;
            Ok((DecodedImage { image: worker::pixels(&png).await?, drawing: None, svg: None }, Some(png)))
        }
        Some((bytes, _)) => {
            let (facts, svg) = worker::drawing(bytes, view).await?;
            let png = draw(&svg, facts.size[0].max(facts.size[1])).await?;
            let image = worker::pixels(&png).await?;
            Ok((DecodedImage { image, drawing: Some(facts), svg: Some(svg.into()) }, None))
        }
    }
}

/// Returns the message of a JavaScript error.
fn said(error: &JsValue) -> String {
    let message = Reflect::get(error, &"message".into()).ok().and_then(|message| message.as_string());
    message.or_else(|| error.as_string()).unwrap_or_else(|| format!("{error:?}"))
}

/// Waits for 16 ms, so that the browser can paint a frame.
pub(crate) async fn breath() {
    let wait = js_sys::Promise::new(&mut |resolve, _| {
        if let Some(window) = web_sys::window() {
            // If the timer cannot be set, the work continues at once.
            if window.set_timeout_with_callback_and_timeout_and_arguments_0(&resolve, 16).is_err() {
                let _ = resolve.call0(&resolve);
            }
        }
    });
    // The promise is never rejected.
    let _ = JsFuture::from(wait).await;
}
