//! The same program in a worker: it decodes, renders, looks for edges and refines while the page goes on.

use calib_core::Site;
use calib_editor::{Edge, Source, edges};
use image::RgbImage;
use js_sys::{Array, Float64Array, Reflect, Uint8Array};
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::JsFuture;

use super::{Web, page};
use crate::demo;
use crate::platform::Platform as _;

/// What has a worker of its own, so that it can be stopped.
const REFINE: &str = "refine";

/// Waits for work; in a worker there is no page.
pub(super) fn start() {
    let act = Closure::<dyn Fn(String, String, u32, Uint8Array) -> Result<Array, JsValue>>::new(
        |kind: String, name: String, width: u32, bytes: Uint8Array| {
            act(&kind, &name, width, &bytes.to_vec()).map_err(|error| JsValue::from(&error))
        },
    );
    // The page hears of a worker without it when it asks.
    let _ = Reflect::set(&js_sys::global(), &"calibWork".into(), act.as_ref());
    act.forget();
}

/// Does one piece of work: what comes back are arrays of numbers.
fn act(kind: &str, name: &str, width: u32, bytes: &[u8]) -> Result<Array, String> {
    match kind {
        "decode" => numbers(&calib_editor::decode(bytes)?, &[]),
        "render" => {
            let bytes = demo::render(name)?;
            numbers(&calib_editor::decode(&bytes)?, &bytes)
        }
        "edges" => {
            let height = bytes.len() as u32 / (3 * width.max(1));
            let image =
                RgbImage::from_raw(width, height, bytes.to_vec()).ok_or("an image of another size")?;
            Ok(Array::of1(&Float64Array::from(&*edges::to_numbers(&edges::find(&image))).into()))
        }
        REFINE => {
            let site = std::str::from_utf8(bytes).map_err(|error| error.to_string())?;
            let site = Site::from_json(site).map_err(|error| error.to_string())?;
            Ok(Array::of1(&Uint8Array::from(calib_editor::refined(site).to_json().as_bytes()).into()))
        }
        other => Err(format!("no work of the kind {other}")),
    }
}

fn numbers(image: &RgbImage, bytes: &[u8]) -> Result<Array, String> {
    Ok(Array::of3(&Uint8Array::from(&**image).into(), &image.width().into(), &Uint8Array::from(bytes).into()))
}

async fn ask(kind: &str, name: &str, width: u32, bytes: &[u8]) -> Result<Array, String> {
    let answer = JsFuture::from(page::work(kind, name, width, &Uint8Array::from(bytes))).await;
    answer.map(|answer| Array::from(&answer)).map_err(|error| super::said(&error))
}

/// Decodes an image in the worker.
pub(crate) async fn pixels(bytes: &[u8]) -> Result<RgbImage, String> {
    image_of(&ask("decode", "", 0, bytes).await?)
}

fn image_of(answer: &Array) -> Result<RgbImage, String> {
    let bytes = Uint8Array::new(&answer.get(0)).to_vec();
    let width = answer.get(1).as_f64().unwrap_or_default() as u32;
    let height = bytes.len() as u32 / (3 * width.max(1));
    RgbImage::from_raw(width, height, bytes).ok_or_else(|| "an image of another size".into())
}

/// Decodes an image in the worker; one of the demonstration is made there.
pub(crate) async fn decode(source: Source) -> Result<RgbImage, String> {
    let Some(made) = source.made_by_name().map(str::to_owned) else {
        return pixels(&source.read(Web::read)?).await;
    };
    let answer = ask("render", &made, 0, &[]).await?;
    source.keep(Uint8Array::new(&answer.get(2)).to_vec().into());
    image_of(&answer)
}

/// Finds edges in the worker.
pub(crate) async fn edges(image: &RgbImage) -> Result<Vec<Edge>, String> {
    let answer = ask("edges", "", image.width(), image).await?;
    Ok(edges::from_numbers(&Float64Array::new(&answer.get(0)).to_vec()))
}

/// Refines a site in a worker of its own.
pub(crate) async fn refine(site: &Site) -> Result<Site, String> {
    let answer = ask(REFINE, "", 0, site.to_json().as_bytes()).await?;
    let text =
        String::from_utf8(Uint8Array::new(&answer.get(0)).to_vec()).map_err(|error| error.to_string())?;
    Site::from_json(&text).map_err(|error| error.to_string())
}

/// Lets go of the worker that refines.
pub(crate) fn stop_refining() {
    page::dismiss(REFINE);
}
