//! Which pixels of which period a camera is asked for, as a plain object of JavaScript.

use calib_core::{PixelOrigin, Stream, StreamFit};
use js_sys::{Array, Object, Reflect};
use wasm_bindgen::prelude::*;

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Which pixels the calls of a camera speak of, and when. */
export interface CameraOptions {
    /** RFC 3339; needed where a camera that was moved has several periods. */
    at?: string;
    /** "corner" (the centre of the first pixel is (0.5, 0.5)), or "centre" (it is (0, 0)). */
    origin?: "corner" | "centre";
    /** Width and height of the stream, where they are not the still's. */
    streamSize?: [number, number];
    /** How the image was brought to that size, where its proportion is another. */
    fit?: "stretch" | "letterbox";
    /** Left, top, width and height of what the stream shows, in pixels of the still. */
    crop?: [number, number, number, number];
}
"#;

#[wasm_bindgen]
extern "C" {
    /// Which pixels the calls of a camera speak of, and when.
    #[wasm_bindgen(typescript_type = "CameraOptions")]
    #[derive(Debug)]
    pub type CameraOptions;
}

fn refused(field: &str, expected: &str) -> JsError {
    JsError::new(&format!("{field}: expected {expected}"))
}

impl CameraOptions {
    /// The time, and the stream.
    pub(crate) fn read(&self) -> Result<(Option<String>, Stream), JsError> {
        let object: &Object = self.unchecked_ref();
        let (mut at, mut stream) = (None, Stream::default());
        for key in Object::keys(object).iter() {
            let value = Reflect::get(object, &key).unwrap_or(JsValue::UNDEFINED);
            if value.is_undefined() {
                continue;
            }
            let key = key.as_string().unwrap_or_default();
            let name = value.as_string();
            match key.as_str() {
                "at" => at = Some(name.ok_or_else(|| refused("at", "a time such as 2026-05-01T08:00:00Z"))?),
                "origin" => {
                    let origin = name.as_deref().and_then(PixelOrigin::of_name);
                    stream.origin = origin.ok_or_else(|| refused("origin", "\"corner\" or \"centre\""))?;
                }
                "fit" => {
                    let fit = name.as_deref().and_then(StreamFit::of_name);
                    stream.fit = Some(fit.ok_or_else(|| refused("fit", "\"stretch\" or \"letterbox\""))?);
                }
                "streamSize" => {
                    let size = numbers(&value).and_then(sides);
                    let expected = || refused("streamSize", "[width, height] in whole pixels");
                    stream.size = Some(size.ok_or_else(expected)?);
                }
                "crop" => {
                    let expected = || refused("crop", "[left, top, width, height]");
                    stream.crop = Some(numbers(&value).ok_or_else(expected)?);
                }
                _ => return Err(refused(&key, "at, origin, streamSize, fit or crop")),
            }
        }
        Ok((at, stream))
    }
}

fn numbers<const N: usize>(value: &JsValue) -> Option<[f64; N]> {
    let list: Vec<f64> =
        Array::is_array(value).then(|| Array::from(value).iter().filter_map(|one| one.as_f64()).collect())?;
    list.try_into().ok()
}

fn sides(size: [f64; 2]) -> Option<[u32; 2]> {
    let whole = size.map(|side| side as u32);
    (whole.map(f64::from) == size && !whole.contains(&0)).then_some(whole)
}
