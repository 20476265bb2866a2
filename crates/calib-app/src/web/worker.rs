//! The same program in a worker: it decodes, renders and looks for edges while the page goes on.

use image::RgbImage;
use js_sys::{Array, Float64Array, Reflect, Uint8Array};
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::JsFuture;

use super::page;
use crate::edges::{self, Edge};
use crate::files::Source;
use crate::{demo, drawing, picture, work};

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
        "decode" if drawing::is_svg(bytes) => Err(drawing::draw(bytes).err().unwrap_or_default()),
        "decode" => pixels(&picture::decode(bytes)?, &[]),
        "render" => {
            let bytes = demo::render(name)?;
            pixels(&picture::decode(&bytes)?, &bytes)
        }
        "edges" => {
            let height = bytes.len() as u32 / (3 * width.max(1));
            let image =
                RgbImage::from_raw(width, height, bytes.to_vec()).ok_or("an image of another size")?;
            Ok(Array::of1(&Float64Array::from(&*work::to_numbers(&edges::find(&image))).into()))
        }
        other => Err(format!("no work of the kind {other}")),
    }
}

fn pixels(image: &RgbImage, bytes: &[u8]) -> Result<Array, String> {
    Ok(Array::of3(&Uint8Array::from(&**image).into(), &image.width().into(), &Uint8Array::from(bytes).into()))
}

async fn ask(kind: &str, name: &str, width: u32, bytes: &[u8]) -> Result<Array, String> {
    let answer = JsFuture::from(page::work(kind, name, width, &Uint8Array::from(bytes))).await;
    let said = |error: JsValue| {
        let message = Reflect::get(&error, &"message".into()).ok().and_then(|message| message.as_string());
        message.or_else(|| error.as_string()).unwrap_or_else(|| format!("{error:?}"))
    };
    answer.map(|answer| Array::from(&answer)).map_err(said)
}

/// Decodes an image in the worker; one of the demonstration is made there.
pub(crate) async fn decode(source: Source) -> Result<RgbImage, String> {
    let made = source.made_by_name().map(str::to_owned);
    let answer = match &made {
        Some(name) => ask("render", name, 0, &[]).await?,
        None => ask("decode", "", 0, &source.clone().read()?).await?,
    };
    if made.is_some() {
        source.keep(Uint8Array::new(&answer.get(2)).to_vec().into());
    }
    let bytes = Uint8Array::new(&answer.get(0)).to_vec();
    let width = answer.get(1).as_f64().unwrap_or_default() as u32;
    let height = bytes.len() as u32 / (3 * width.max(1));
    RgbImage::from_raw(width, height, bytes).ok_or_else(|| "an image of another size".into())
}

/// Finds edges in the worker.
pub(crate) async fn edges(image: &RgbImage) -> Result<Vec<Edge>, String> {
    let answer = ask("edges", "", image.width(), image).await?;
    Ok(work::from_numbers(&Float64Array::new(&answer.get(0)).to_vec()))
}
