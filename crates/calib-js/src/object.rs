//! Plain objects and typed arrays of JavaScript.
//!
//! Also the options of calls, which are plain objects.

use calib_core::floor::{PixelOrigin, Stream, StreamFit};
use calib_site::{Method, Options};
use js_sys::{Array, Float64Array, Object, Reflect};
use wasm_bindgen::prelude::*;

/// Creates a plain object.
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

/// Creates a typed array.
pub(crate) fn doubles(values: &[f64]) -> JsValue {
    Float64Array::from(values).into()
}

/// Creates a tuple of numbers.
pub(crate) fn tuple(values: &[f64]) -> JsValue {
    values.iter().copied().map(JsValue::from).collect::<Array>().into()
}

/// Reads a list of `N` numbers; `None` for any other value.
pub(crate) fn numbers<const N: usize>(value: &JsValue) -> Option<[f64; N]> {
    let list = Array::is_array(value).then(|| Array::from(value))?;
    list.iter().map(|one| one.as_f64()).collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// Returns the fields of an object that are not `undefined`, with their names.
pub(crate) fn fields(of: &JsValue) -> impl Iterator<Item = (String, JsValue)> {
    let object: Object = of.clone().unchecked_into();
    Object::keys(&object).to_vec().into_iter().filter_map(move |key| {
        let value = Reflect::get(&object, &key).unwrap_or(JsValue::UNDEFINED);
        (!value.is_undefined()).then(|| (key.as_string().unwrap_or_default(), value))
    })
}

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Kind of pixels of a camera's methods. */
export interface StreamOptions {
    /** Pixel origin: "corner" (the centre of the first pixel is (0.5, 0.5)), or "centre" (it is (0, 0)). */
    origin?: "corner" | "centre";
    /** Width and height of the stream, in pixels, if they differ from the calibrated image. */
    streamSize?: [number, number];
    /** Fit of the image to the stream; required if the aspect ratios differ. */
    fit?: "stretch" | "letterbox";
    /** Left, top, width and height of the stream's view, in pixels of the calibrated image. */
    crop?: [number, number, number, number];
}

/** Kind of pixels of a camera's methods, and a time. */
export interface CameraOptions extends StreamOptions {
    /** Time (RFC 3339); required if the id has several periods, for example because the camera was moved. */
    at?: string;
}

/** Options of a calibration. */
export interface CalibrateOptions {
    /** "ml" (maximum likelihood, the default) or "paper". */
    method?: "ml" | "paper";
    /** Whether to refine all cameras jointly; default true. */
    refine?: boolean;
    /** Whether to use a weak prior on the focal length if the lines do not determine it; default true. */
    prior?: boolean;
    /** Ids of the cameras to solve; default all. */
    cameras?: string[];
}
"#;

#[wasm_bindgen]
extern "C" {
    /// Options that select the stream whose pixels a camera's methods use.
    #[wasm_bindgen(typescript_type = "StreamOptions")]
    #[derive(Debug)]
    pub type StreamOptions;

    /// Options that select the stream whose pixels a camera's methods use, and the time of the calibration.
    #[wasm_bindgen(typescript_type = "CameraOptions")]
    #[derive(Debug)]
    pub type CameraOptions;

    /// Time, or options with a time.
    #[wasm_bindgen(typescript_type = "string | CameraOptions")]
    #[derive(Debug)]
    pub type TimeOrOptions;

    /// Options of a calibration.
    #[wasm_bindgen(typescript_type = "CalibrateOptions")]
    #[derive(Debug)]
    pub type CalibrateOptions;
}

pub(crate) fn option_error(field: &str, expected: &str) -> JsError {
    JsError::new(&format!("{field}: expected {expected}"))
}

/// Arguments of a JavaScript call: the time that selects the calibration period, and the stream.
#[derive(Debug, Default)]
pub(crate) struct PeriodAndStream {
    pub(crate) at: Option<String>,
    pub(crate) stream: Stream,
}

impl StreamOptions {
    /// Applies the options to a stream.
    pub(crate) fn read(&self, stream: Stream) -> Result<Stream, JsError> {
        let mut which = PeriodAndStream { at: None, stream };
        for (name, value) in fields(self) {
            which.set_stream(&name, &value, "origin, streamSize, fit or crop")?;
        }
        Ok(which.stream)
    }
}

impl CameraOptions {
    pub(crate) fn read(&self) -> Result<PeriodAndStream, JsError> {
        let mut which = PeriodAndStream::default();
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
    pub(crate) fn read(&self) -> Result<PeriodAndStream, JsError> {
        match self.as_string() {
            Some(at) => Ok(PeriodAndStream { at: Some(at), ..PeriodAndStream::default() }),
            None if self.is_object() => self.unchecked_ref::<CameraOptions>().read(),
            None => Err(option_error("at", "a time such as 2026-05-01T08:00:00Z, or options")),
        }
    }
}

fn time(value: &JsValue) -> Result<String, JsError> {
    value.as_string().ok_or_else(|| option_error("at", "a time such as 2026-05-01T08:00:00Z"))
}

impl PeriodAndStream {
    fn set_stream(&mut self, field: &str, value: &JsValue, known: &str) -> Result<(), JsError> {
        let name = value.as_string();
        match field {
            "origin" => {
                let origin = name.as_deref().and_then(PixelOrigin::from_name);
                self.stream.origin = origin.ok_or_else(|| option_error(field, "\"corner\" or \"centre\""))?;
            }
            "fit" => {
                let fit = name.as_deref().and_then(StreamFit::from_name);
                self.stream.fit =
                    Some(fit.ok_or_else(|| option_error(field, "\"stretch\" or \"letterbox\""))?);
            }
            "streamSize" => {
                let size = numbers(value).and_then(sides);
                let expected = || option_error(field, "[width, height] in whole pixels");
                self.stream.size = Some(size.ok_or_else(expected)?);
            }
            "crop" => {
                let expected = || option_error(field, "[left, top, width, height]");
                self.stream.crop = Some(numbers(value).ok_or_else(expected)?);
            }
            _ => return Err(option_error(field, known)),
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
            let flag = || value.as_bool().ok_or_else(|| option_error(&name, "true or false"));
            match name.as_str() {
                "method" => {
                    options.method = match value.as_string().as_deref() {
                        Some("ml") => Method::MaximumLikelihood,
                        Some("paper") => Method::Paper,
                        _ => return Err(option_error(&name, "\"ml\" or \"paper\"")),
                    }
                }
                "refine" => options.refine = flag()?,
                "prior" => options.prior = flag()?,
                "cameras" => options.cameras = Some(ids(&value)?),
                _ => return Err(option_error(&name, "method, refine, prior or cameras")),
            }
        }
        Ok(options)
    }
}

fn ids(value: &JsValue) -> Result<Vec<String>, JsError> {
    let list = Array::is_array(value).then(|| Array::from(value).iter().map(|one| one.as_string()).collect());
    list.flatten().ok_or_else(|| option_error("cameras", "a list of ids"))
}
