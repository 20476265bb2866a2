//! Points and findings as plain objects of JavaScript.

use calib_core::Status;

use calib_site::FindingEntry;
use wasm_bindgen::prelude::*;

use crate::object::{object, set};

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Point on the floor. */
export interface FloorPoint {
    /** x, in metres. */
    x: number;
    /** y, in metres. */
    y: number;
    /** Largest standard deviation over all directions, in metres, of pixel and calibration together; undefined if unknown. */
    sigma: number | undefined;
    /** "ok", or the region of the pixel. Outside the EFOV or the image, errors may exceed the stated uncertainty. */
    status: "ok" | "outside-efov" | "outside-image";
    /** Height above the floor, in metres; only for a site whose planes have regions. */
    z?: number;
    /** Id of the plane of the point; absent on the floor. */
    plane?: string;
}

/** Point of an image, in pixels. */
export interface Pixel {
    u: number;
    v: number;
}

/** Finding about a calibration, for the operator. */
export interface Finding {
    /** Id of the camera; absent for a finding about the site. */
    camera?: string;
    /** Code of the finding, such as "weak", from a closed list. */
    code: string;
    severity: "note" | "warning" | "error";
    /** Description, one sentence. */
    message: string;
    /** Recommended action, one sentence. */
    advice: string;
}
"#;

#[wasm_bindgen]
extern "C" {
    /// Point on the floor.
    #[wasm_bindgen(typescript_type = "FloorPoint")]
    #[derive(Debug)]
    pub type FloorPoint;

    /// Point of an image.
    #[wasm_bindgen(typescript_type = "Pixel")]
    #[derive(Debug)]
    pub type Pixel;

    /// Finding about a calibration.
    #[wasm_bindgen(typescript_type = "Finding")]
    #[derive(Debug)]
    pub type Finding;
}

impl FloorPoint {
    pub(crate) fn new([x, y]: [f64; 2], sigma: Option<f64>, status: Status) -> Self {
        let sigma = sigma.map_or(JsValue::UNDEFINED, JsValue::from);
        object(&[("x", x.into()), ("y", y.into()), ("sigma", sigma), ("status", status.name().into())])
    }

    /// Sets the height above the floor, in metres, and the id of the plane; `None` for the floor.
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
