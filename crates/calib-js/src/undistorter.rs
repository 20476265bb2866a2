//! Undistortion of images.

use calib_core::CameraView;

use calib_core::floor::{Crop, StraightView};
use js_sys::Uint8Array;
use wasm_bindgen::prelude::*;

use crate::object::option_error;
use crate::object::tuple;

#[wasm_bindgen]
extern "C" {
    /// Bytes of an image, for example of a canvas.
    #[wasm_bindgen(typescript_type = "Uint8Array | Uint8ClampedArray")]
    #[derive(Debug)]
    pub type Bytes;

    /// Part of the undistorted plane that the new image shows.
    #[wasm_bindgen(typescript_type = "\"same-focal\" | \"all-valid\" | \"all-pixels\"")]
    #[derive(Debug)]
    pub type View;

    /// Two numbers.
    #[wasm_bindgen(typescript_type = "[number, number]")]
    #[derive(Debug)]
    pub type Two;
}

/// Removes the lens distortion from any number of images. `camera.undistorter` returns it.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Undistorter(StraightView);

impl Undistorter {
    pub(crate) fn of(camera: &CameraView, view: Option<&View>) -> Result<Self, JsError> {
        let name = view.map_or_else(|| Some(Crop::default().name().to_owned()), |view| view.as_string());
        let crop = name.as_deref().and_then(Crop::from_name);
        let crop =
            crop.ok_or_else(|| option_error("view", "\"same-focal\", \"all-valid\" or \"all-pixels\""))?;
        Ok(Self(camera.straight_view(crop)?))
    }
}

#[wasm_bindgen]
impl Undistorter {
    /// Width and height of the images, in pixels.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn size(&self) -> Two {
        tuple(&self.0.size.map(|side| side as f64)).unchecked_into()
    }

    /// Focal length of the undistorted image, in pixels.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn focal(&self) -> f64 {
        self.0.focal
    }

    /// Principal point u and v of the undistorted image, in pixels from its corner.
    #[wasm_bindgen(getter, js_name = principalPoint)]
    #[must_use]
    pub fn principal_point(&self) -> Two {
        tuple(&[self.0.principal_point.u, self.0.principal_point.v]).unchecked_into()
    }

    /// Removes the lens distortion from an image with the size of the stream. Its bytes are row by row, with
    /// one, three or four for each pixel (as in `ImageData.data` of a canvas). Pixels without a raw pixel are
    /// 0.
    ///
    /// # Errors
    /// Throws if the number of bytes does not match the size of the stream.
    pub fn apply(&self, image: &Bytes) -> Result<Uint8Array, JsError> {
        let image = image.unchecked_ref::<Uint8Array>().to_vec();
        let mut straight = vec![0; image.len()];
        if !self.0.remap.apply_into(&image, &mut straight) {
            let ([width, height], found) = (self.0.size, image.len());
            let expected = format!("{width} x {height} pixels of 1, 3 or 4 bytes, found {found} bytes");
            return Err(option_error("image", &expected));
        }
        Ok(Uint8Array::from(&straight[..]))
    }
}
