//! Worker of the page: decodes, renders, detects edges, calibrates, compares and refines.

use std::cell::RefCell;

use calib_editor::edges;
use calib_image::{
    AutomaticCalibration, Comparison, EdgeImage, ImageEdges, PairRegistration, PlacementSearch,
};
use calib_plan::{Drawing, Picture, View};
use calib_site::{Site, SiteCamera};
use image::RgbImage;
use js_sys::{Array, Float64Array, Reflect, Uint8Array};
use wasm_bindgen::prelude::*;

use crate::platform::Recovery;
use crate::platform::web::{COMPARE, DRAWING, PLACE, PROPOSE, PlacementStep, RECOVER, REFINE, page};
use crate::storage::demo;

/// Registers the function through which the page sends work to this worker.
pub(super) fn start() {
    let act = Closure::<dyn Fn(String, String, u32, Uint8Array) -> Result<Array, JsValue>>::new(
        |kind: String, name: String, width: u32, bytes: Uint8Array| {
            run_job(&kind, &name, width, &bytes.to_vec()).map_err(|error| JsValue::from(&error))
        },
    );
    // If the registration fails, the page gets an error when it sends work.
    let _ = Reflect::set(&js_sys::global(), &"calibWork".into(), act.as_ref());
    act.forget();
}

/// Does the work of this kind; returns arrays of bytes or numbers. The meaning of `name`, `width` and `bytes`
/// depends on the kind.
fn run_job(kind: &str, name: &str, width: u32, bytes: &[u8]) -> Result<Array, String> {
    match kind {
        "decode" => image_answer(&calib_editor::decode(bytes)?, &[]),
        "render" => {
            let bytes = demo::render(name)?;
            image_answer(&calib_editor::decode(&bytes)?, &bytes)
        }
        "edges" => {
            let image = image_from_bytes(width, bytes)?;
            Ok(Array::of1(&Float64Array::from(&*edges::to_numbers(&edges::detect(&image))).into()))
        }
        PROPOSE if width > 0 => json_answer(&ImageEdges::measure(&image_from_bytes(width, bytes)?)),
        PROPOSE => {
            let (camera, edges): (SiteCamera, ImageEdges) = page::read(bytes)?;
            json_answer(&AutomaticCalibration::new(&EdgeImage::from_camera(&camera, edges)))
        }
        PLACE => place(page::read(name.as_bytes())?, bytes),
        COMPARE => {
            let camera: SiteCamera = serde_json::from_str(name).map_err(|error| error.to_string())?;
            let [old, new] = two_images_from_bytes(width, bytes)?;
            json_answer(&Comparison::from_entry(&camera, &old, &new).map_err(|error| error.to_string())?)
        }
        RECOVER => {
            let asked: Recovery = serde_json::from_str(name).map_err(|error| error.to_string())?;
            let [old, new] = two_images_from_bytes(width, bytes)?;
            json_answer(&asked.done([&old, &new])?)
        }
        REFINE => {
            let site = std::str::from_utf8(bytes).map_err(|error| error.to_string())?;
            let site = Site::from_json(site).map_err(|error| error.to_string())?;
            Ok(Array::of1(&Uint8Array::from(calib_editor::refined(site).to_json().as_bytes()).into()))
        }
        DRAWING => {
            let view: View = page::read(name.as_bytes())?;
            let drawing = calib_plan::read(bytes, &view).ok_or("the file is not a drawing")?;
            let Drawing { picture, facts, .. } = drawing.map_err(|error| error.to_string())?;
            let Picture::Svg(svg) = picture else { return Err("the drawing has no lines".into()) };
            let facts = page::write(&facts)?;
            Ok(Array::of2(
                &Uint8Array::from(facts.as_bytes()).into(),
                &Uint8Array::from(svg.as_bytes()).into(),
            ))
        }
        other => Err(format!("unknown task {other}")),
    }
}

thread_local! {
    /// Search for placements that is running: the site, the prepared images, and the registered pairs.
    static SEARCH: RefCell<Option<(Site, PlacementSearch, Vec<PairRegistration>)>> =
        const { RefCell::new(None) };
}

/// Carries out a step of the search for placements.
fn place(step: PlacementStep, bytes: &[u8]) -> Result<Array, String> {
    SEARCH.with_borrow_mut(|search| match (step, search.as_mut()) {
        (PlacementStep::Prepare { site, cameras, sizes, has_plan }, _) => {
            let mut rest = bytes;
            let mut images = Vec::new();
            for (width, height) in sizes {
                let split = rest.split_at_checked(3 * width as usize * height as usize);
                let (image, others) = split.ok_or("an image has an unexpected size")?;
                images.push(image_from_bytes(width, image)?);
                rest = others;
            }
            let plan = if has_plan { images.pop() } else { None };
            let prepared = PlacementSearch::new(&site, &cameras, &images, plan.as_ref());
            let pairs = prepared.pairs();
            *search = Some((site, prepared, Vec::new()));
            json_answer(&pairs)
        }
        (PlacementStep::Register(pair), Some((_, search, pairs))) => {
            pairs.push(search.register(pair));
            json_answer(&pairs.len())
        }
        (PlacementStep::Place, Some((site, search, pairs))) => {
            json_answer(&search.place(site, pairs, &mut |_| true).ok_or("the search was cancelled")?)
        }
        (_, None) => Err("no images were sent".into()),
    })
}

/// Creates an image of this width from its RGB bytes.
fn image_from_bytes(width: u32, bytes: &[u8]) -> Result<RgbImage, String> {
    let height = bytes.len() as u32 / (3 * width.max(1));
    RgbImage::from_raw(width, height, bytes.to_vec()).ok_or_else(|| "the image has an unexpected size".into())
}

/// Splits the bytes into two RGB images of equal size.
fn two_images_from_bytes(width: u32, bytes: &[u8]) -> Result<[RgbImage; 2], String> {
    let (old, new) = bytes.split_at(bytes.len() / 2);
    Ok([image_from_bytes(width, old)?, image_from_bytes(width, new)?])
}

/// Returns an answer as the bytes of its JSON text.
fn json_answer(answer: &impl serde::Serialize) -> Result<Array, String> {
    Ok(Array::of1(&Uint8Array::from(page::write(answer)?.as_bytes()).into()))
}

/// Returns an answer with the RGB bytes of an image, its width, and `bytes`: the file of a rendered image, otherwise
/// empty.
fn image_answer(image: &RgbImage, bytes: &[u8]) -> Result<Array, String> {
    Ok(Array::of3(&Uint8Array::from(&**image).into(), &image.width().into(), &Uint8Array::from(bytes).into()))
}
