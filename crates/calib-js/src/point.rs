//! Points as plain objects of JavaScript, and what they are called there.

use calib_core::Status;
use js_sys::{Object, Reflect};
use wasm_bindgen::prelude::*;

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** A point of the floor. */
export interface FloorPoint {
    /** Metres. */
    x: number;
    /** Metres. */
    y: number;
    /** Standard deviation in the worst direction, in metres, of pixel and calibration together. */
    sigma: number | undefined;
    /** "ok", or where the pixel lies: its point is less sure than the calibration says. */
    status: "ok" | "outside-efov" | "outside-image";
    /** Height above the floor in metres, of a site whose planes have regions. */
    z?: number;
    /** The id of the plane that the point is on; absent on the floor. */
    plane?: string;
}

/** A point of an image, in pixels from its corner. */
export interface Pixel {
    u: number;
    v: number;
}
"#;

#[wasm_bindgen]
extern "C" {
    /// A point of the floor.
    #[wasm_bindgen(typescript_type = "FloorPoint")]
    #[derive(Debug)]
    pub type FloorPoint;

    /// A point of an image.
    #[wasm_bindgen(typescript_type = "Pixel")]
    #[derive(Debug)]
    pub type Pixel;
}

impl FloorPoint {
    pub(crate) fn new([x, y]: [f64; 2], sigma: Option<f64>, status: Status) -> Self {
        let sigma = sigma.map_or(JsValue::UNDEFINED, JsValue::from);
        object(&[("x", x.into()), ("y", y.into()), ("sigma", sigma), ("status", status.name().into())])
    }
}

impl FloorPoint {
    /// With its height, and with the plane that it is on besides the floor.
    pub(crate) fn on_plane(self, z: f64, plane: Option<&str>) -> Self {
        let fields = [("z", z.into())].into_iter().chain(plane.map(|id| ("plane", id.into())));
        set(&self, fields);
        self
    }
}

impl Pixel {
    pub(crate) fn new(pixel: calib_core::Pixel) -> Self {
        object(&[("u", pixel.u.into()), ("v", pixel.v.into())])
    }
}

/// A plain object.
pub(crate) fn object<T: JsCast>(fields: &[(&str, JsValue)]) -> T {
    let object = Object::new();
    set(&object, fields.iter().cloned());
    object.unchecked_into()
}

fn set<'a>(object: &JsValue, fields: impl Iterator<Item = (&'a str, JsValue)>) {
    for (key, value) in fields {
        // Setting a field of a new object cannot fail.
        let _ = Reflect::set(object, &key.into(), &value);
    }
}
