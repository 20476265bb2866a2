//! Worker of the page: decodes, renders, detects edges, calibrates, compares and refines.

use calib_editor::edges;
use calib_image::{AutomaticCalibration, Comparison, EdgeImage, LineSegment, line_segments};
use calib_site::{Site, SiteCamera};
use image::RgbImage;
use js_sys::{Array, Float64Array, Reflect, Uint8Array};
use wasm_bindgen::prelude::*;

use crate::platform::Recovery;
use crate::platform::web::{COMPARE, PROPOSE, RECOVER, REFINE, page};
use crate::storage::demo;

/// Waits for work.
pub(super) fn start() {
    let act = Closure::<dyn Fn(String, String, u32, Uint8Array) -> Result<Array, JsValue>>::new(
        |kind: String, name: String, width: u32, bytes: Uint8Array| {
            act(&kind, &name, width, &bytes.to_vec()).map_err(|error| JsValue::from(&error))
        },
    );
    // If this fails, the page gets an error when it sends work.
    let _ = Reflect::set(&js_sys::global(), &"calibWork".into(), act.as_ref());
    act.forget();
}

/// Does one piece of work and returns arrays of numbers.
fn act(kind: &str, name: &str, width: u32, bytes: &[u8]) -> Result<Array, String> {
    match kind {
        "decode" => numbers(&calib_editor::decode(bytes)?, &[]),
        "render" => {
            let bytes = demo::render(name)?;
            numbers(&calib_editor::decode(&bytes)?, &bytes)
        }
        "edges" => {
            let image = of_bytes(width, bytes)?;
            Ok(Array::of1(&Float64Array::from(&*edges::to_numbers(&edges::detect(&image))).into()))
        }
        PROPOSE if width > 0 => written(&line_segments(&of_bytes(width, bytes)?)),
        PROPOSE => {
            let (camera, edges): (SiteCamera, Vec<LineSegment>) = page::read(bytes)?;
            written(&AutomaticCalibration::new(&EdgeImage::from_camera(&camera, edges)))
        }
        COMPARE => {
            let camera: SiteCamera = serde_json::from_str(name).map_err(|error| error.to_string())?;
            let [old, new] = two_of_bytes(width, bytes)?;
            written(&Comparison::from_entry(&camera, &old, &new).map_err(|error| error.to_string())?)
        }
        RECOVER => {
            let asked: Recovery = serde_json::from_str(name).map_err(|error| error.to_string())?;
            let [old, new] = two_of_bytes(width, bytes)?;
            written(&asked.done([&old, &new])?)
        }
        REFINE => {
            let site = std::str::from_utf8(bytes).map_err(|error| error.to_string())?;
            let site = Site::from_json(site).map_err(|error| error.to_string())?;
            Ok(Array::of1(&Uint8Array::from(calib_editor::refined(site).to_json().as_bytes()).into()))
        }
        other => Err(format!("no work of the kind {other}")),
    }
}

fn of_bytes(width: u32, bytes: &[u8]) -> Result<RgbImage, String> {
    let height = bytes.len() as u32 / (3 * width.max(1));
    RgbImage::from_raw(width, height, bytes.to_vec()).ok_or_else(|| "an image of another size".into())
}

/// Splits the bytes into two images of one size.
fn two_of_bytes(width: u32, bytes: &[u8]) -> Result<[RgbImage; 2], String> {
    let (old, new) = bytes.split_at(bytes.len() / 2);
    Ok([of_bytes(width, old)?, of_bytes(width, new)?])
}

fn written(answer: &impl serde::Serialize) -> Result<Array, String> {
    let text = serde_json::to_vec(answer).map_err(|error| error.to_string())?;
    Ok(Array::of1(&Uint8Array::from(&*text).into()))
}

fn numbers(image: &RgbImage, bytes: &[u8]) -> Result<Array, String> {
    Ok(Array::of3(&Uint8Array::from(&**image).into(), &image.width().into(), &Uint8Array::from(bytes).into()))
}
