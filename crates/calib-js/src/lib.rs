//! A calibrated site in JavaScript, for dashboards that show tracks on a plan: pixels to the floor and
//! back, and the solve. Everything happens in the page; nothing is sent anywhere.
//!
//! Units and axes are those of the site file: pixels from the corner of the image, metres with z up.

mod point;
mod options;
mod camera;

pub use camera::{Camera, status_names};

use calib_core::{Extent, Options, SiteCamera, Status, Stream, SurfacePoint, SurfaceProjector, WorldPoint};
use js_sys::Float64Array;
use wasm_bindgen::prelude::*;

use crate::options::CameraOptions;
use crate::point::{FloorPoint, Pixel};

/// A site whose solutions are used.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Site(calib_core::Site);

#[wasm_bindgen]
impl Site {
    /// Reads a site file, as text.
    ///
    /// # Errors
    /// Throws an `Error` that says what is wrong with it, and where.
    #[wasm_bindgen(constructor)]
    pub fn new(#[wasm_bindgen(js_name = siteJson)] site_json: &str) -> Result<Self, JsError> {
        Ok(Self(calib_core::Site::from_json(site_json)?))
    }

    /// The ids of the calibrated cameras.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn cameras(&self) -> Vec<String> {
        let solved = self.0.cameras.iter().filter(|camera| camera.camera().is_some());
        solved.map(|camera| camera.id.clone()).collect()
    }

    /// A calibrated camera, for whole columns of pixels of one of its streams.
    ///
    /// # Errors
    /// Throws when the site has no calibrated camera of this id, when it has several periods and `at` does not say
    /// which, and when the stream does not go with the size of the still.
    pub fn camera(&self, id: &str, options: Option<CameraOptions>) -> Result<Camera, JsError> {
        let (at, stream) = options.map_or_else(|| Ok((None, Stream::default())), |options| options.read())?;
        let view = self.0.view(id, at.as_deref(), stream);
        view.map(Camera).map_err(|why| JsError::new(&format!("camera {id:?}: {why}")))
    }

    /// The point of the floor that a pixel shows, with its standard deviation; `undefined` above the horizon.
    ///
    /// Of a site whose `planes` have regions it is the point of the floor or of a plane that the pixel shows first,
    /// with `z`, and with `plane` where it is not on the floor; `undefined` on the wall of a pit, too.
    ///
    /// `sigmaPx` is the standard deviation of the pixel, 1 if it is not given.
    ///
    /// # Errors
    /// Throws when the site has no calibrated camera of this id, and when it has several periods and `at` (RFC 3339)
    /// does not say which.
    #[wasm_bindgen(js_name = pixelToFloor)]
    pub fn pixel_to_floor(
        &self,
        camera: &str,
        u: f64,
        v: f64,
        #[wasm_bindgen(js_name = sigmaPx)] sigma_px: Option<f64>,
        at: Option<String>,
    ) -> Result<Option<FloorPoint>, JsError> {
        let (entry, camera) = self.calibrated(camera, at.as_deref())?;
        let (efov, surfaces) = (self.0.efov_on_floor(entry), self.0.covering_surfaces());
        let extent = Extent { size: entry.size(), efov: &efov };
        let (mut point, mut status) = ([None], [Status::Ok]);
        let projector = SurfaceProjector::new(&camera, 0.0, &surfaces);
        projector.pixels_to_surfaces(&extent, [&[u], &[v]], &mut point, &mut status);
        let [Some(SurfacePoint { surface, at })] = point else { return Ok(None) };
        let pixel = calib_core::Pixel::new(u, v);
        let covariance = projector.covariance(pixel, sigma_px.unwrap_or(1.0), surface);
        let sigma = covariance.and_then(|covariance| covariance.worst_sigma());
        let found = FloorPoint::new([at.x, at.y], sigma, status[0]);
        let plane = surface.and_then(|index| self.0.planes.get(index)).map(|plane| plane.id.as_str());
        Ok(Some(if surfaces.is_empty() { found } else { found.on_plane(at.z, plane) }))
    }

    /// Many at once: u, v, u, v and so on give x, y, x, y and so on; `NaN` where a pixel shows no floor, and no
    /// plane whose region the site file has.
    ///
    /// # Errors
    /// Throws when the site has no calibrated camera of this id, and when it has several periods and `at` (RFC 3339)
    /// does not say which.
    #[wasm_bindgen(js_name = pixelsToFloor)]
    pub fn pixels_to_floor(
        &self,
        camera: &str,
        pixels: &[f64],
        at: Option<String>,
    ) -> Result<Float64Array, JsError> {
        let (entry, camera) = self.calibrated(camera, at.as_deref())?;
        let (pairs, []) = pixels.as_chunks::<2>() else {
            return Err(JsError::new("an odd number of coordinates: u, v, u, v and so on are expected"));
        };
        let [u, v] = [0, 1].map(|axis| pairs.iter().map(|pair| pair[axis]).collect::<Vec<f64>>());
        let surfaces = self.0.covering_surfaces();
        let (mut points, mut status) = (vec![None; u.len()], vec![Status::Ok; u.len()]);
        let extent = Extent { size: entry.size(), efov: &[] };
        SurfaceProjector::new(&camera, 0.0, &surfaces).pixels_to_surfaces(
            &extent,
            [&u, &v],
            &mut points,
            &mut status,
        );
        let of = |point: &Option<SurfacePoint>| point.map_or([f64::NAN; 2], |point| [point.at.x, point.at.y]);
        let floor: Vec<f64> = points.iter().flat_map(of).collect();
        Ok(Float64Array::from(&floor[..]))
    }

    /// The pixel that shows a point of the floor, or `z` metres above it; `undefined` when the camera cannot.
    ///
    /// # Errors
    /// Throws when the site has no calibrated camera of this id, and when it has several periods and `at` (RFC 3339)
    /// does not say which.
    #[wasm_bindgen(js_name = floorToPixel)]
    pub fn floor_to_pixel(
        &self,
        camera: &str,
        x: f64,
        y: f64,
        z: Option<f64>,
        at: Option<String>,
    ) -> Result<Option<Pixel>, JsError> {
        let (_, camera) = self.calibrated(camera, at.as_deref())?;
        Ok(camera.world_to_pixel(WorldPoint::new(x, y, z.unwrap_or(0.0))).map(Pixel::new))
    }

    /// An id may repeat with periods that do not overlap: only a time says which one is meant.
    fn calibrated(&self, id: &str, at: Option<&str>) -> Result<(&SiteCamera, calib_core::Camera), JsError> {
        let entry = self.0.camera_at(id, at);
        let entry = entry.map_err(|why| JsError::new(&format!("camera {id:?}: {why}")))?;
        let camera = entry
            .camera()
            .ok_or_else(|| JsError::new(&format!("camera {id:?} is not calibrated: solve the site first")))?;
        Ok((entry, camera))
    }
}

/// Calibrates a site file, and returns it with the solutions written into it.
///
/// A camera that cannot be solved has an `error` in place of a `solution`.
///
/// # Errors
/// Throws an `Error` that says what is wrong with the file, and where.
#[wasm_bindgen]
pub fn solve(#[wasm_bindgen(js_name = siteJson)] site_json: &str) -> Result<String, JsError> {
    let site = calib_core::Site::from_json(site_json)?;
    Ok(site.calibrate(&Options::default()).write_into(&site).to_json())
}
