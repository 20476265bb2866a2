//! Points and findings as plain objects of JavaScript, and what they are called there.

use calib_core::Status;

use calib_site::FindingEntry;
use wasm_bindgen::prelude::*;

use crate::object::{object, set};

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

/** A point of an image, in pixels. */
export interface Pixel {
    u: number;
    v: number;
}

/** Something that an operator should know about a calibration. */
export interface Finding {
    /** The id of the camera that it is about; absent where it is about the site. */
    camera?: string;
    /** Which finding, such as "weak"; the list is closed. */
    code: string;
    severity: "note" | "warning" | "error";
    /** What is so, in a sentence. */
    message: string;
    /** What to do, in a sentence. */
    advice: string;
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

    /// A finding.
    #[wasm_bindgen(typescript_type = "Finding")]
    #[derive(Debug)]
    pub type Finding;
}

impl FloorPoint {
    pub(crate) fn new([x, y]: [f64; 2], sigma: Option<f64>, status: Status) -> Self {
        let sigma = sigma.map_or(JsValue::UNDEFINED, JsValue::from);
        object(&[("x", x.into()), ("y", y.into()), ("sigma", sigma), ("status", status.name().into())])
    }

    /// With its height, and with the plane that it is on besides the floor.
    pub(crate) fn on_plane(self, z: f64, plane: Option<&str>) -> Self {
        let fields = [("z", z.into())].into_iter().chain(plane.map(|id| ("plane", id.into())));
        set(&self, fields);
        self
    }
}

impl Pixel {
    pub(crate) fn new([u, v]: [f64; 2]) -> Self {
        object(&[("u", u.into()), ("v", v.into())])
    }
}

impl Finding {
    pub(crate) fn new(entry: &FindingEntry<'_>) -> Self {
        let FindingEntry { camera, code, severity, message, advice } = *entry;
        let severity = severity.name();
        let finding = object::<Self>(&[("code", code.into()), ("severity", severity.into())]);
        let camera = camera.map(|id| ("camera", id.into()));
        set(&finding, camera.into_iter().chain([("message", message.into()), ("advice", advice.into())]));
        finding
    }
}
