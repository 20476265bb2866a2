//! What the page does for the app: `web/store.js` and `web/page.js` say how.

use js_sys::{Array, Function, Promise, Uint8Array};
use wasm_bindgen::prelude::*;

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
