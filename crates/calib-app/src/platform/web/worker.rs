//! Requests to the page's workers, and their answers.

use calib_editor::{Edge, Source, edges};
use calib_image::{AutomaticCalibration, Comparison, ImageEdges, PlacementSearch, SitePlacement};
use calib_plan::{DrawingFacts, View};
use calib_site::{Recovered, Site, SiteCamera};
use image::RgbImage;
use js_sys::{Array, Float64Array, Uint8Array};
use wasm_bindgen_futures::JsFuture;

use crate::platform::web::{Web, page};
use crate::platform::{PlacementRequest, Platform as _, Progress, Recovery, Stills};

/// Name of the worker for refinements; it is separate so that it can be stopped.
pub(crate) const REFINE: &str = "refine";
/// Name of the worker for automatic calibration. With an image it measures edges, otherwise it calibrates
/// from measured edges.
pub(crate) const PROPOSE: &str = "propose";

/// Name of the work that reads a DXF drawing.
pub(crate) const DRAWING: &str = "drawing";
/// Name of the worker that places cameras; the `name` of a request contains a [`PlacementStep`] as JSON.
pub(crate) const PLACE: &str = "place";
/// Name of the worker for comparisons; the bytes of a request contain both images.
pub(crate) const COMPARE: &str = "compare";
/// Name of the worker for recoveries; the bytes of a request contain both images.
pub(crate) const RECOVER: &str = "recover";

/// Step of the search for placements.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub(crate) enum PlacementStep {
    /// Prepares the images of the cameras and of the plan, whose RGB bytes are sent one after the other; returns the
    /// pairs.
    Prepare {
        /// Site with its solutions.
        site: Site,
        /// Indices of the cameras.
        cameras: Vec<usize>,
        /// Widths and heights of the images, in pixels.
        sizes: Vec<(u32, u32)>,
        /// Whether the last image is the plan.
        has_plan: bool,
    },
    /// Registers the images of a pair of cameras that `Prepare` returned.
    Register([usize; 2]),
    /// Returns the placements.
    Place,
}

/// Sends a request to a worker; returns its answer.
async fn request(kind: &str, name: &str, width: u32, bytes: &[u8]) -> Result<Array, String> {
    let answer = JsFuture::from(page::work(kind, name, width, &Uint8Array::from(bytes))).await;
    answer.map(|answer| Array::from(&answer)).map_err(|error| crate::platform::web::said(&error))
}

/// Decodes an image file in a worker.
pub(crate) async fn pixels(bytes: &[u8]) -> Result<RgbImage, String> {
    image_from_answer(&request("decode", "", 0, bytes).await?)
}

/// Creates an image from an answer, which contains the RGB bytes and the width of the image.
fn image_from_answer(answer: &Array) -> Result<RgbImage, String> {
    let bytes = Uint8Array::new(&answer.get(0)).to_vec();
    let width = answer.get(1).as_f64().unwrap_or_default() as u32;
    let height = bytes.len() as u32 / (3 * width.max(1));
    RgbImage::from_raw(width, height, bytes).ok_or_else(|| "the image has an unexpected size".into())
}

/// Returns an image of the demonstration that was shipped with the page. A page that was saved as a single
/// file contains no image and returns `None`.
async fn shipped_image(name: &str) -> Option<Vec<u8>> {
    let answer = JsFuture::from(page::picture(name)).await.ok()?;
    answer.is_object().then(|| Uint8Array::new(&answer).to_vec())
}

/// Decodes an image in a worker; an image of the demonstration is fetched or rendered.
pub(crate) async fn decode(source: Source) -> Result<RgbImage, String> {
    let Some(made) = source.name_to_render().map(str::to_owned) else {
        return pixels(&source.read(Web::read_within)?).await;
    };
    if let Some(bytes) = shipped_image(&made).await {
        let image = pixels(&bytes).await?;
        source.store_rendered(bytes.into());
        return Ok(image);
    }
    let answer = request("render", &made, 0, &[]).await?;
    source.store_rendered(Uint8Array::new(&answer.get(2)).to_vec().into());
    image_from_answer(&answer)
}

/// Reads a DXF drawing in a worker; returns its properties and an SVG document.
pub(crate) async fn drawing(bytes: &[u8], view: &View) -> Result<(DrawingFacts, Vec<u8>), String> {
    let view = page::write(view)?;
    let answer = request(DRAWING, &view, 0, bytes).await?;
    let facts = page::read(&Uint8Array::new(&answer.get(0)).to_vec())?;
    Ok((facts, Uint8Array::new(&answer.get(1)).to_vec()))
}

/// Detects the straight edges of an image in a worker.
pub(crate) async fn edges(image: &RgbImage) -> Result<Vec<Edge>, String> {
    let answer = request("edges", "", image.width(), image).await?;
    Ok(edges::from_numbers(&Float64Array::new(&answer.get(0)).to_vec()))
}

/// Refines all cameras of a site jointly in a worker.
pub(crate) async fn refine(site: &Site) -> Result<Site, String> {
    let answer = request(REFINE, "", 0, site.to_json().as_bytes()).await?;
    let text =
        String::from_utf8(Uint8Array::new(&answer.get(0)).to_vec()).map_err(|error| error.to_string())?;
    Site::from_json(&text).map_err(|error| error.to_string())
}

/// Measures the straight edges of an image with subpixel accuracy in a worker.
pub(crate) async fn measure_edges(image: &RgbImage) -> Result<ImageEdges, String> {
    parsed(&request(PROPOSE, "", image.width(), image).await?)
}

/// Calibrates a camera from measured edges, in the worker that measured them.
pub(crate) async fn propose(camera: &SiteCamera, edges: &ImageEdges) -> Result<AutomaticCalibration, String> {
    let asked = page::write(&(camera, edges))?;
    parsed(&request(PROPOSE, "", 0, asked.as_bytes()).await?)
}

/// Stops the running automatic calibration.
pub(crate) fn stop_proposing() {
    page::dismiss(PROPOSE);
}

/// Searches for the placements of cameras in a worker, which keeps the prepared images between the requests.
pub(crate) async fn place(asked: PlacementRequest, progress: &Progress) -> Result<SitePlacement, String> {
    const PAIRED: f64 = PlacementSearch::PAIRS_SHARE;
    let PlacementRequest { site, cameras, images, plan } = asked;
    let has_plan = plan.is_some();
    let sent: Vec<&RgbImage> = images.iter().chain(plan.as_deref()).collect();
    let sizes = sent.iter().map(|image| image.dimensions()).collect();
    let bytes = sent.iter().map(|image| image.as_raw().as_slice()).collect::<Vec<_>>().concat();
    let send = async |step: &PlacementStep, bytes: &[u8]| request(PLACE, &page::write(step)?, 0, bytes).await;
    let pairs: Vec<[usize; 2]> =
        parsed(&send(&PlacementStep::Prepare { site, cameras, sizes, has_plan }, &bytes).await?)?;
    let count = pairs.len();
    for (index, pair) in pairs.into_iter().enumerate() {
        send(&PlacementStep::Register(pair), &[]).await?;
        progress.report(PAIRED * (index + 1) as f64 / count as f64);
    }
    parsed(&send(&PlacementStep::Place, &[]).await?)
}

/// Stops the running search for placements.
pub(crate) fn stop_placing() {
    page::dismiss(PLACE);
}

/// Compares two images of a solved camera in a worker.
pub(crate) async fn compare(camera: &SiteCamera, stills: &Stills) -> Result<Comparison, String> {
    parsed(&request_with_images(COMPARE, camera, stills).await?)
}

/// Recovers a camera that moved between two images in a worker.
pub(crate) async fn recover(asked: &Recovery, stills: &Stills) -> Result<Recovered, String> {
    parsed(&request_with_images(RECOVER, asked, stills).await?)
}

/// Sends a request with two images of equal size to a worker.
async fn request_with_images(
    kind: &str,
    asked: &impl serde::Serialize,
    [old, new]: &Stills,
) -> Result<Array, String> {
    let bytes = [old.as_raw().as_slice(), new.as_raw().as_slice()].concat();
    request(kind, &page::write(asked)?, old.width(), &bytes).await
}

/// Stops the running comparison and recovery.
pub(crate) fn stop_comparing() {
    page::dismiss(COMPARE);
    page::dismiss(RECOVER);
}

/// Parses the JSON text of an answer.
fn parsed<T: serde::de::DeserializeOwned>(answer: &Array) -> Result<T, String> {
    let text = Uint8Array::new(&answer.get(0)).to_vec();
    page::read(&text)
}

/// Stops the running refinement.
pub(crate) fn stop_refining() {
    page::dismiss(REFINE);
}
