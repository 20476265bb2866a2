//! Plain objects and typed arrays of JavaScript.
//!
//! What calls are told, as plain objects of JavaScript.

use calib_core::floor::{PixelOrigin, Stream, StreamFit};
use calib_site::{Method, Options};
use js_sys::{Array, Float64Array, Object, Reflect};
use wasm_bindgen::prelude::*;

/// A plain object.
pub(crate) fn object<T: JsCast>(fields: &[(&str, JsValue)]) -> T {
    let object = Object::new();
    set(&object, fields.iter().cloned());
    object.unchecked_into()
}

pub(crate) fn set<'a>(object: &JsValue, fields: impl Iterator<Item = (&'a str, JsValue)>) {
    for (key, value) in fields {
        // Setting a field of a new object cannot fail.
        let _ = Reflect::set(object, &key.into(), &value);
    }
}

/// A typed array.
pub(crate) fn doubles(values: &[f64]) -> JsValue {
    Float64Array::from(values).into()
}

/// A tuple of numbers.
pub(crate) fn tuple(values: &[f64]) -> JsValue {
    values.iter().copied().map(JsValue::from).collect::<Array>().into()
}

/// A list of so many numbers.
pub(crate) fn numbers<const N: usize>(value: &JsValue) -> Option<[f64; N]> {
    let list = Array::is_array(value).then(|| Array::from(value))?;
    list.iter().map(|one| one.as_f64()).collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// The fields of an object that are set, by name.
pub(crate) fn fields(of: &JsValue) -> impl Iterator<Item = (String, JsValue)> {
    let object: Object = of.clone().unchecked_into();
    Object::keys(&object).to_vec().into_iter().filter_map(move |key| {
        let value = Reflect::get(&object, &key).unwrap_or(JsValue::UNDEFINED);
        (!value.is_undefined()).then(|| (key.as_string().unwrap_or_default(), value))
    })
}

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Which pixels calls speak of. */
export interface StreamOptions {
    /** "corner" (the centre of the first pixel is (0.5, 0.5)), or "centre" (it is (0, 0)). */
    origin?: "corner" | "centre";
    /** Width and height of the stream, where they are not the still's. */
    streamSize?: [number, number];
    /** How the image was brought to that size, where its proportion is another. */
    fit?: "stretch" | "letterbox";
    /** Left, top, width and height of what the stream shows, in pixels of the still. */
    crop?: [number, number, number, number];
}

/** Which pixels calls speak of, and when. */
export interface CameraOptions extends StreamOptions {
    /** RFC 3339; needed where a camera that was moved has several periods. */
    at?: string;
}

/** How a site is calibrated. */
export interface CalibrateOptions {
    /** "ml" (maximum likelihood, if nothing is said) or "paper". */
    method?: "ml" | "paper";
    /** Improve all cameras together; true if nothing is said. */
    refine?: boolean;
    /** Let a weak prior about the focal enter where the lines do not tell it; true if nothing is said. */
    prior?: boolean;
    /** Ids of the cameras to solve; all if nothing is said. */
    cameras?: string[];
}
"#;

#[wasm_bindgen]
extern "C" {
    /// Which pixels the calls of a camera speak of.
    #[wasm_bindgen(typescript_type = "StreamOptions")]
    #[derive(Debug)]
    pub type StreamOptions;

    /// Which pixels the calls of a camera speak of, and when.
    #[wasm_bindgen(typescript_type = "CameraOptions")]
    #[derive(Debug)]
    pub type CameraOptions;

    /// The same, or a time alone.
    #[wasm_bindgen(typescript_type = "string | CameraOptions")]
    #[derive(Debug)]
    pub type TimeOrOptions;

    /// How a site is calibrated.
    #[wasm_bindgen(typescript_type = "CalibrateOptions")]
    #[derive(Debug)]
    pub type CalibrateOptions;
}

pub(crate) fn refused(field: &str, expected: &str) -> JsError {
    JsError::new(&format!("{field}: expected {expected}"))
}

/// A period, and a stream.
#[derive(Debug, Default)]
pub(crate) struct Which {
    pub(crate) at: Option<String>,
    pub(crate) stream: Stream,
}

impl StreamOptions {
    /// The stream that they speak of, over the one before.
    pub(crate) fn read(&self, stream: Stream) -> Result<Stream, JsError> {
        let mut which = Which { at: None, stream };
        for (name, value) in fields(self) {
            which.set_stream(&name, &value, "origin, streamSize, fit or crop")?;
        }
        Ok(which.stream)
    }
}

impl CameraOptions {
    pub(crate) fn read(&self) -> Result<Which, JsError> {
        let mut which = Which::default();
        for (name, value) in fields(self) {
            match name.as_str() {
                "at" => which.at = Some(time(&value)?),
                _ => which.set_stream(&name, &value, "at, origin, streamSize, fit or crop")?,
            }
        }
        Ok(which)
    }
}

impl TimeOrOptions {
    pub(crate) fn read(&self) -> Result<Which, JsError> {
        match self.as_string() {
            Some(at) => Ok(Which { at: Some(at), ..Which::default() }),
            None if self.is_object() => self.unchecked_ref::<CameraOptions>().read(),
            None => Err(refused("at", "a time such as 2026-05-01T08:00:00Z, or options")),
        }
    }
}

fn time(value: &JsValue) -> Result<String, JsError> {
    value.as_string().ok_or_else(|| refused("at", "a time such as 2026-05-01T08:00:00Z"))
}

impl Which {
    fn set_stream(&mut self, field: &str, value: &JsValue, known: &str) -> Result<(), JsError> {
        let name = value.as_string();
        match field {
            "origin" => {
                let origin = name.as_deref().and_then(PixelOrigin::of_name);
                self.stream.origin = origin.ok_or_else(|| refused(field, "\"corner\" or \"centre\""))?;
            }
            "fit" => {
                let fit = name.as_deref().and_then(StreamFit::of_name);
                self.stream.fit = Some(fit.ok_or_else(|| refused(field, "\"stretch\" or \"letterbox\""))?);
            }
            "streamSize" => {
                let size = numbers(value).and_then(sides);
                let expected = || refused(field, "[width, height] in whole pixels");
                self.stream.size = Some(size.ok_or_else(expected)?);
            }
            "crop" => {
                let expected = || refused(field, "[left, top, width, height]");
                self.stream.crop = Some(numbers(value).ok_or_else(expected)?);
            }
            _ => return Err(refused(field, known)),
        }
        Ok(())
    }
}

fn sides(size: [f64; 2]) -> Option<[u32; 2]> {
    let whole = size.map(|side| side as u32);
    (whole.map(f64::from) == size && !whole.contains(&0)).then_some(whole)
}

impl CalibrateOptions {
    pub(crate) fn read(&self) -> Result<Options, JsError> {
        let mut options = Options::default();
        for (name, value) in fields(self) {
            let flag = || value.as_bool().ok_or_else(|| refused(&name, "true or false"));
            match name.as_str() {
                "method" => {
                    options.method = match value.as_string().as_deref() {
                        Some("ml") => Method::MaximumLikelihood,
                        Some("paper") => Method::Paper,
                        _ => return Err(refused(&name, "\"ml\" or \"paper\"")),
                    }
                }
                "refine" => options.refine = flag()?,
                "prior" => options.prior = flag()?,
                "cameras" => options.cameras = Some(ids(&value)?),
                _ => return Err(refused(&name, "method, refine, prior or cameras")),
            }
        }
        Ok(options)
    }
}

fn ids(value: &JsValue) -> Result<Vec<String>, JsError> {
    let list = Array::is_array(value).then(|| Array::from(value).iter().map(|one| one.as_string()).collect());
    list.flatten().ok_or_else(|| refused("cameras", "a list of ids"))
}
