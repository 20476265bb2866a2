//! What the page does for the app: `web/store.js` and `web/page.js` say how.
//!
//! What the page and its workers say to each other, in JSON.
//!
//! The browser's file chooser.

use std::path::PathBuf;

use calib_editor::world_endings;
use js_sys::{Array, Function, Promise, Uint8Array};
use serde::de::DeserializeOwned;
use wasm_bindgen::prelude::*;

use crate::choice::{Chosen, IMAGES, PLANS, Purpose, SITE};
use crate::platform::web::pick;

/// Reads what was said, as text: a reader of bytes would have every type in the program a second time.
pub(crate) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let text = str::from_utf8(bytes).map_err(|error| error.to_string())?;
    serde_json::from_str(text).map_err(|error| error.to_string())
}

/// A file that is saved is a download: there is nothing to ask.
pub(super) async fn ask(purpose: Purpose) -> Vec<Chosen> {
    match purpose {
        Purpose::SaveSite | Purpose::SavePlain => {
            vec![Chosen { name: "site.json".into(), path: Some("site.json".into()), bytes: None }]
        }
        // A site comes together with its images.
        Purpose::OpenSite => pick(&[SITE, IMAGES].concat(), true).await,
        Purpose::Compare => pick(SITE, false).await,
        Purpose::AddImages | Purpose::NewerStill => pick(IMAGES, true).await,
        Purpose::ReplaceStill => pick(IMAGES, false).await,
        // A plan may come with its world file.
        Purpose::LoadPlan => pick(&[PLANS, world_endings()].concat(), true).await,
        Purpose::Import => pick(&[], true).await,
        Purpose::SavePicture => {
            vec![Chosen { name: "view.png".into(), path: Some("view.png".into()), bytes: None }]
        }
        Purpose::SaveReport => {
            vec![Chosen { name: "report.html".into(), path: Some("report.html".into()), bytes: None }]
        }
        // The browser has a folder of its own for what is downloaded.
        Purpose::Export => vec![Chosen { name: String::new(), path: Some(PathBuf::new()), bytes: None }],
    }
}

#[wasm_bindgen]
extern "C" {
    /// The page's own object.
    #[wasm_bindgen(js_name = calib, thread_local_v2)]
    pub(crate) static PAGE: Page;

    /// Its type.
    pub(crate) type Page;

    /// Wishes that were made and not yet taken.
    #[wasm_bindgen(method, getter)]
    pub(crate) fn queue(this: &Page) -> Array;

    /// Whether the operator asked their system for less motion.
    #[wasm_bindgen(method, getter)]
    pub(crate) fn still(this: &Page) -> bool;

    /// Called by the page when there is a new wish.
    #[wasm_bindgen(method, setter)]
    pub(crate) fn set_wake(this: &Page, wake: &Function);

    /// Called by the page to show the app on a new canvas.
    #[wasm_bindgen(method, setter)]
    pub(crate) fn set_restart(this: &Page, restart: &Function);

    /// Whether closing the page would lose something.
    #[wasm_bindgen(method, setter)]
    pub(crate) fn set_unkept(this: &Page, unkept: bool);

    /// Says that the program stopped.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn panicked(message: &str);

    /// Says that the first frame is painted.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn shown();

    /// Says that the canvas lost its picture.
    #[wasm_bindgen(js_namespace = calib, js_name = contextLost)]
    pub(crate) fn context_lost();

    /// Says that there is a picture again.
    #[wasm_bindgen(js_namespace = calib, js_name = contextBack)]
    pub(crate) fn context_back();

    /// A canvas in place of the one there was.
    #[wasm_bindgen(js_namespace = calib, js_name = freshCanvas)]
    pub(crate) fn fresh_canvas() -> web_sys::HtmlCanvasElement;

    /// Asks for files.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn pick(accept: &str, multiple: bool) -> Promise;

    /// Has the worker do something.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn work(kind: &str, name: &str, width: u32, bytes: &Uint8Array) -> Promise;

    /// A picture of the demonstration as it comes with the page, or null.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn picture(name: &str) -> Promise;

    /// Draws an SVG as PNG on white, its longer side so many pixels.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn draw(bytes: &Uint8Array, side: u32) -> Promise;

    /// Lets go of the worker that does this kind of work.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn dismiss(kind: &str);

    /// Shows the tree of widgets to those who do not see the canvas.
    #[wasm_bindgen(js_namespace = calib)]
    pub(crate) fn mirror(tree: &str);

    /// Hands a file over as a download.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn download(name: &str, mime: &str, bytes: &Uint8Array);

    /// Every kept site.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn list() -> Promise;

    /// Keeps a site and its new images.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn keep(record: &str, images: &Array) -> Promise;

    /// A kept site and its images.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn open(id: &str) -> Promise;

    /// Forgets a kept site.
    #[wasm_bindgen(js_namespace = ["calib", "store"])]
    pub(crate) fn remove(id: &str) -> Promise;
}
