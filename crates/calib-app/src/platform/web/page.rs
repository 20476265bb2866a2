//! Interface of the page (`web/store.js`, `web/page.js`), its messages as JSON, and the browser's file
//! chooser.

use std::path::PathBuf;

use calib_editor::world_endings;
use js_sys::{Array, Function, Promise, Uint8Array};
use serde::Serialize;
use serde::de::DeserializeOwned;
use wasm_bindgen::prelude::*;

use crate::choice::{Chosen, Purpose, SITE, images, images_and_videos, plans};
use crate::platform::web::pick as pick_files;

/// Parses a JSON message. The bytes are converted to text first, because a second parser would double the
/// generated code.
pub(crate) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let text = str::from_utf8(bytes).map_err(|error| error.to_string())?;
    serde_json::from_str(text).map_err(|error| error.to_string())
}

/// Writes a JSON message with indentation, as site files are written: a second format would double the
/// generated code.
pub(crate) fn write(message: &impl Serialize) -> Result<String, String> {
    serde_json::to_string_pretty(message).map_err(|error| error.to_string())
}

/// File name endings of images that the browser decodes.
const BROWSER_IMAGES: [&str; 4] = ["webp", "avif", "bmp", "gif"];

/// Opens a file chooser. A saved file is a download, so saving shows no chooser.
pub(super) async fn ask(purpose: Purpose) -> Vec<Chosen> {
    match purpose {
        Purpose::SaveSite | Purpose::SavePlain => {
            vec![Chosen { name: "site.json".into(), path: Some("site.json".into()), bytes: None }]
        }
        // A site is chosen together with its images and its plan.
        Purpose::Open => pick_files(&[], true).await,
        Purpose::Compare => pick_files(SITE, false).await,
        Purpose::AddImages => pick_files(&[&images_and_videos()[..], &BROWSER_IMAGES].concat(), true).await,
        Purpose::NewerStill => pick_files(&[&images()[..], &BROWSER_IMAGES].concat(), true).await,
        Purpose::ReplaceStill => pick_files(&[&images()[..], &BROWSER_IMAGES].concat(), false).await,
        // A plan is chosen together with its world file.
        Purpose::LoadPlan => {
            pick_files(&[&plans()[..], &BROWSER_IMAGES, world_endings()].concat(), true).await
        }
        Purpose::Import => pick_files(&[], true).await,
        Purpose::SavePicture => {
            vec![Chosen { name: "view.png".into(), path: Some("view.png".into()), bytes: None }]
        }
        Purpose::SaveReport => {
            vec![Chosen { name: "report.html".into(), path: Some("report.html".into()), bytes: None }]
        }
        // The browser has its own download folder.
        Purpose::Export => vec![Chosen { name: String::new(), path: Some(PathBuf::new()), bytes: None }],
    }
}

#[wasm_bindgen]
extern "C" {
    /// JavaScript object `calib` of the page.
    #[wasm_bindgen(js_name = calib, thread_local_v2)]
    pub(crate) static PAGE: Page;

    /// Type of the JavaScript object `calib` of the page.
    pub(crate) type Page;

    /// Returns the queue of requests that are not handled yet.
    #[wasm_bindgen(method, getter)]
    pub(crate) fn queue(this: &Page) -> Array;

    /// Whether the operator asked the system for reduced motion.
    #[wasm_bindgen(method, getter)]
    pub(crate) fn still(this: &Page) -> bool;

    /// Sets the function that the page calls after a new request.
    #[wasm_bindgen(method, setter)]
    pub(crate) fn set_wake(this: &Page, wake: &Function);

    /// Sets the function that the page calls to show the app on a new canvas.
    #[wasm_bindgen(method, setter)]
    pub(crate) fn set_restart(this: &Page, restart: &Function);

    /// Sets whether closing the page would lose work; the browser then asks the operator.
    #[wasm_bindgen(method, setter)]
    pub(crate) fn set_unkept(this: &Page, unkept: bool);

    /// Reports a panic of the program with its message.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn panicked(message: &str);

    /// Reports that the first complete frame is painted.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn shown();

    /// Reports that the canvas lost its graphics context.
    #[wasm_bindgen(js_namespace = calib, js_name = contextLost)]
    pub(crate) fn context_lost();

    /// Reports that the graphics context is back.
    #[wasm_bindgen(js_namespace = calib, js_name = contextBack)]
    pub(crate) fn context_back();

    /// Replaces the canvas of the page by a new canvas, and returns it.
    #[wasm_bindgen(js_namespace = calib, js_name = freshCanvas)]
    pub(crate) fn fresh_canvas() -> web_sys::HtmlCanvasElement;

    /// Opens a file chooser; the promise resolves to the chosen files.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn pick(accept: &str, multiple: bool) -> Promise;

    /// Runs work of this kind in a worker; the promise resolves to the answer.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn work(kind: &str, name: &str, width: u32, bytes: &Uint8Array) -> Promise;

    /// Fetches an image of the demonstration that was shipped with the page; the promise resolves to its
    /// bytes or null.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn picture(name: &str) -> Promise;

    /// Rasterises an SVG on white; the promise resolves to a PNG. `side` is its longer side, in pixels.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn draw(bytes: &Uint8Array, side: u32) -> Promise;

    /// Draws a part of an SVG document, whose unit is one pixel; the promise resolves to a PNG of this size. `part`
    /// is x, y, width and height.
    #[wasm_bindgen(js_namespace = calib, js_name = drawPart)]
    pub(crate) fn draw_part(bytes: &Uint8Array, part: &[f64], width: u32, height: u32) -> Promise;

    /// Converts an image in a format that only the browser reads; the promise resolves to a PNG.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn convert(bytes: &Uint8Array) -> Promise;

    /// Opens a video with the decoder of the browser; first closes a video that is still open.
    #[wasm_bindgen(js_namespace = calib, js_name = openVideo)]
    pub(crate) fn open_video(bytes: &Uint8Array);

    /// Releases the open video.
    #[wasm_bindgen(js_namespace = calib, js_name = closeVideo)]
    pub(crate) fn close_video();

    /// Reads frames of the open video: the frame at `time`, in seconds. If `time` is negative, reads `count` evenly
    /// spaced frames instead, or fewer if the memory is too small. The longer side of a frame is at most `side`
    /// pixels, unless `side` is 0. For every frame, `each` gets the share of the work done, and the time, width,
    /// height and RGBA pixels of the frame. It returns whether to continue. The promise resolves to the duration in
    /// seconds.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn frames(time: f64, count: u32, side: u32, each: &Function) -> Promise;

    /// Stops the worker that does this kind of work.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn dismiss(kind: &str);

    /// Sends the widget tree to screen readers.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn mirror(tree: &str);

    /// Offers a file as a download.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn download(name: &str, mime: &str, bytes: &Uint8Array);

    /// Lists the sites in the database of the browser.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn list() -> Promise;

    /// Stores a site and its new images; the promise resolves to the number of writes of the record.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn keep(record: &str, images: &Array) -> Promise;

    /// Reads a stored site and its images.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn open(id: &str) -> Promise;

    /// Removes a site from the database of the browser.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn remove(id: &str) -> Promise;
}
