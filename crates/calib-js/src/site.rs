//! Site with its cameras, findings and calibration.

use calib_core::{CameraView, FloorPoint as Point, Pixel as At, PlanScale, Status};

use calib_core::floor::{SurfacePoint, TangentPlane};

use calib_site::Plan;
use js_sys::Float64Array;
use wasm_bindgen::prelude::*;

use crate::camera::Camera;
use crate::mapping::finite;
use crate::object::doubles;
use crate::object::{CalibrateOptions, CameraOptions, PeriodAndStream, TimeOrOptions, option_error};
use crate::point::{Finding, FloorPoint, Pixel};

/// Site document: cameras with their annotations and solutions.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Site(calib_site::Site);

#[wasm_bindgen]
impl Site {
    /// Parses the text of a site file.
    ///
    /// # Errors
    /// Throws for an invalid file; the message names the position and the cause.
    #[wasm_bindgen(constructor)]
    pub fn new(#[wasm_bindgen(js_name = siteJson)] site_json: &str) -> Result<Self, JsError> {
        Ok(Self(calib_site::Site::from_json(site_json)?))
    }

    /// Ids of the calibrated cameras, in the order of the file. An id with several periods appears once.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn cameras(&self) -> Vec<String> {
        self.0.calibrated().into_iter().map(str::to_owned).collect()
    }

    /// Findings about the calibration: of the cameras, then of the site.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        self.0.findings().map(|entry| Finding::new(&entry)).collect()
    }

    /// Returns a calibrated camera for the pixels of one of its streams.
    ///
    /// # Errors
    /// Throws if the site has no calibrated camera with this id, if `at` is missing for an id with several
    /// periods, or if the stream does not match the size of the calibrated image.
    pub fn camera(&self, id: &str, options: Option<CameraOptions>) -> Result<Camera, JsError> {
        let which = options.map_or_else(|| Ok(PeriodAndStream::default()), |options| options.read())?;
        Ok(Camera::new(id, self.view(id, &which)?))
    }

    /// Calibrates the site from its annotations and entered values, and returns a new site with the
    /// solutions.
    ///
    /// A camera that cannot be solved does not stop the others from being solved. The reason is in
    /// `findings`.
    ///
    /// # Errors
    /// Throws for unknown options, and for ids that are not in the site.
    pub fn calibrate(&self, options: Option<CalibrateOptions>) -> Result<Self, JsError> {
        let options = options.map_or_else(|| Ok(calib_site::Options::default()), |options| options.read())?;
        for id in options.cameras.iter().flatten() {
            if self.0.cameras.iter().all(|entry| entry.id != *id) {
                return Err(JsError::new(&format!("camera {id:?}: the site has no camera with this id")));
            }
        }
        Ok(Self(self.0.calibrate(&options).write_into(&self.0)))
    }

    /// Returns the document as JSON text, as in a site file.
    #[wasm_bindgen(js_name = toJson)]
    #[must_use]
    pub fn to_json(&self) -> String {
        self.0.to_json()
    }

    /// Converts floor points to pixels of the plan from its upper left corner, y down: x, y, x, y and so on.
    ///
    /// # Errors
    /// Throws if the site has no plan, and for an odd number of coordinates.
    #[wasm_bindgen(js_name = floorToPlan)]
    pub fn floor_to_plan(&self, points: &[f64]) -> Result<Float64Array, JsError> {
        let plan = self.plan()?;
        map_pairs(points, |[x, y]| plan.plan_from_floor(Point { x, y }).into())
    }

    /// Width of a plan pixel, in metres; `undefined` without a plan.
    #[wasm_bindgen(getter, js_name = planMetresPerPx)]
    #[must_use]
    pub fn plan_metres_per_px(&self) -> Option<f64> {
        self.0.plan.as_ref().map(|plan| plan.metres_per_px)
    }

    /// Converts pixels of the plan to floor points: x, y, x, y and so on.
    ///
    /// # Errors
    /// Throws if the site has no plan, and for an odd number of coordinates.
    #[wasm_bindgen(js_name = planToFloor)]
    pub fn plan_to_floor(&self, pixels: &[f64]) -> Result<Float64Array, JsError> {
        let plan = self.plan()?;
        map_pairs(pixels, |pixel| plan.floor_from_plan(pixel.into()).into())
    }

    /// Converts floor points (x, y, x, y and so on, in metres) to latitude and longitude in degrees (WGS84).
    ///
    /// # Errors
    /// Throws if the site has no georeference, and for an odd number of coordinates.
    #[wasm_bindgen(js_name = floorToGeographic)]
    pub fn floor_to_geographic(&self, points: &[f64]) -> Result<Float64Array, JsError> {
        let plane = self.tangent_plane()?;
        map_pairs(points, |[x, y]| {
            let at = plane.to_geographic(Point { x, y }.at_height(0.0));
            [at.latitude.to_degrees(), at.longitude.to_degrees()]
        })
    }

    /// Converts latitudes and longitudes (in degrees, one pair after the other) to floor points, in metres.
    ///
    /// # Errors
    /// Throws if the site has no georeference, and for an odd number of coordinates.
    #[wasm_bindgen(js_name = geographicToFloor)]
    pub fn geographic_to_floor(&self, degrees: &[f64]) -> Result<Float64Array, JsError> {
        let plane = self.tangent_plane()?;
        map_pairs(degrees, |degrees| plane.floor_of_degrees(degrees).into())
    }

    /// Returns the floor point of a pixel with its standard deviation; `undefined` above the horizon.
    ///
    /// If `planes` of the site have regions, the result is the nearest point on the floor or on a plane along
    /// the viewing ray. It has the height `z`, and `plane` if it is not on the floor. It is also `undefined`
    /// on the wall of a pit.
    ///
    /// `sigmaPx` is the standard deviation of the pixel (default 1). The last argument is a time (RFC 3339),
    /// or options with a time and a kind of pixels.
    ///
    /// # Errors
    /// Throws as `camera` does.
    #[wasm_bindgen(js_name = pixelToFloor)]
    pub fn pixel_to_floor(
        &self,
        camera: &str,
        u: f64,
        v: f64,
        #[wasm_bindgen(js_name = sigmaPx)] sigma_px: Option<f64>,
        at: Option<TimeOrOptions>,
    ) -> Result<Option<FloorPoint>, JsError> {
        let (view, sigma) = (self.view_at(camera, at)?, finite("sigmaPx", sigma_px.unwrap_or(1.0))?);
        let (mut point, mut status) = ([None], [Status::Ok]);
        view.to_surfaces_with_status(0.0, [&[u], &[v]], &mut point, &mut status);
        let [Some(SurfacePoint { surface, at })] = point else { return Ok(None) };
        let covariance = view.covariance(At { u, v }, sigma, surface);
        let found = FloorPoint::new([at.x, at.y], covariance.and_then(|both| both.worst_sigma()), status[0]);
        let plane = surface.and_then(|index| self.0.planes.get(index)).map(|plane| plane.id.as_str());
        Ok(Some(if view.surfaces().is_empty() { found } else { found.on_plane(at.z, plane) }))
    }

    /// Maps many pixels at once: u, v, u, v and so on become x, y, x, y and so on. Results are `NaN` for
    /// pixels without a point on the floor or on a plane.
    ///
    /// # Errors
    /// Throws as `camera` does, and for an odd number of coordinates.
    #[wasm_bindgen(js_name = pixelsToFloor)]
    pub fn pixels_to_floor(
        &self,
        camera: &str,
        pixels: &[f64],
        at: Option<TimeOrOptions>,
    ) -> Result<Float64Array, JsError> {
        let view = self.view_at(camera, at)?;
        let pairs = coordinate_pairs(pixels)?;
        let [u, v] = [0, 1].map(|axis| pairs.iter().map(|pair| pair[axis]).collect::<Vec<f64>>());
        let (mut x, mut y) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        view.to_floor_points(0.0, [&u, &v], [&mut x, &mut y]);
        let floor: Vec<f64> = x.into_iter().zip(y).flat_map(<[f64; 2]>::from).collect();
        Ok(doubles(&floor).unchecked_into())
    }

    /// Returns the pixel of a floor point, or of a point `z` metres above it; `undefined` if the camera
    /// cannot show it.
    ///
    /// # Errors
    /// Throws as `camera` does.
    #[wasm_bindgen(js_name = floorToPixel)]
    pub fn floor_to_pixel(
        &self,
        camera: &str,
        x: f64,
        y: f64,
        z: Option<f64>,
        at: Option<TimeOrOptions>,
    ) -> Result<Option<Pixel>, JsError> {
        let (mut u, mut v, mut status) = ([0.0], [0.0], [0]);
        let view = self.view_at(camera, at)?;
        view.to_pixels([&[x], &[y], &[z.unwrap_or(0.0)]], [&mut u, &mut v], &mut status);
        Ok(u[0].is_finite().then(|| Pixel::new([u[0], v[0]])))
    }
}

impl Site {
    fn view(&self, id: &str, which: &PeriodAndStream) -> Result<CameraView, JsError> {
        let view = self.0.view(id, which.at.as_deref(), which.stream);
        view.map_err(|why| JsError::new(&format!("camera {id:?}: {why}")))
    }

    fn view_at(&self, id: &str, at: Option<TimeOrOptions>) -> Result<CameraView, JsError> {
        self.view(id, &at.map_or_else(|| Ok(PeriodAndStream::default()), |at| at.read())?)
    }

    fn plan(&self) -> Result<PlanScale, JsError> {
        let plan = self.0.plan.as_ref().map(Plan::scale);
        plan.ok_or_else(|| JsError::new("the site has no plan; add \"plan\" with \"metres_per_px\""))
    }

    fn tangent_plane(&self) -> Result<TangentPlane, JsError> {
        self.0.tangent_plane().ok_or_else(|| {
            JsError::new(
                "the site has no georeference; add \"georeference\", or two control points with \"lat_deg\" and \
                 \"lon_deg\"",
            )
        })
    }
}

/// Splits a list of coordinates into pairs; fails for an odd number of coordinates.
fn coordinate_pairs(values: &[f64]) -> Result<&[[f64; 2]], JsError> {
    match values.as_chunks() {
        (pairs, []) => Ok(pairs),
        _ => Err(option_error("coordinates", "an even number, two for each point")),
    }
}

/// Applies `map` to each pair of a list of coordinates.
fn map_pairs(values: &[f64], map: impl Fn([f64; 2]) -> [f64; 2]) -> Result<Float64Array, JsError> {
    let mapped: Vec<[f64; 2]> = coordinate_pairs(values)?.iter().map(|&pair| map(pair)).collect();
    Ok(doubles(mapped.as_flattened()).unchecked_into())
}
