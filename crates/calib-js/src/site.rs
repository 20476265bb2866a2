//! A site: its cameras, its findings, and its calibration.

use calib_core::{CameraView, FloorPoint as Point, Pixel as At, PlanScale, Status};

use calib_core::floor::SurfacePoint;

use calib_site::Plan;
use js_sys::Float64Array;
use wasm_bindgen::prelude::*;

use crate::camera::Camera;
use crate::mapping::finite;
use crate::object::doubles;
use crate::object::{CalibrateOptions, CameraOptions, TimeOrOptions, Which, refused};
use crate::point::{Finding, FloorPoint, Pixel};

/// A site of cameras, as its file has it: what was drawn, and what was solved.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Site(calib_site::Site);

#[wasm_bindgen]
impl Site {
    /// Reads a site file, as text.
    ///
    /// # Errors
    /// Throws an `Error` that says what is wrong with it, and where.
    #[wasm_bindgen(constructor)]
    pub fn new(#[wasm_bindgen(js_name = siteJson)] site_json: &str) -> Result<Self, JsError> {
        Ok(Self(calib_site::Site::from_json(site_json)?))
    }

    /// The ids of the calibrated cameras, in the order of the file; an id of several periods once.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn cameras(&self) -> Vec<String> {
        self.0.calibrated().into_iter().map(str::to_owned).collect()
    }

    /// What an operator should know about the calibration: of all cameras, then of the site.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        self.0.findings().map(|entry| Finding::new(&entry)).collect()
    }

    /// A calibrated camera, for whole columns of pixels of one of its streams.
    ///
    /// # Errors
    /// Throws when the site has no calibrated camera of this id, when it has several periods and `at` does not say
    /// which, and when the stream does not go with the size of the still.
    pub fn camera(&self, id: &str, options: Option<CameraOptions>) -> Result<Camera, JsError> {
        let which = options.map_or_else(|| Ok(Which::default()), |options| options.read())?;
        Ok(Camera::new(id, self.view(id, &which)?))
    }

    /// Calibrates the site from what is drawn and entered in it: a new site, with the solutions written into it.
    ///
    /// A camera that cannot be solved does not keep the others from it: `findings` says why.
    ///
    /// # Errors
    /// Throws for options that there are not, and for ids that the site has not.
    pub fn calibrate(&self, options: Option<CalibrateOptions>) -> Result<Self, JsError> {
        let options = options.map_or_else(|| Ok(calib_site::Options::default()), |options| options.read())?;
        for id in options.cameras.iter().flatten() {
            if self.0.cameras.iter().all(|entry| entry.id != *id) {
                return Err(JsError::new(&format!("camera {id:?}: the site has no camera of this id")));
            }
        }
        Ok(Self(self.0.calibrate(&options).write_into(&self.0)))
    }

    /// The document as text, as in a site file.
    #[wasm_bindgen(js_name = toJson)]
    #[must_use]
    pub fn to_json(&self) -> String {
        self.0.to_json()
    }

    /// Points of the floor to pixels of the plan from its upper left corner, y down: x, y, x, y and so on.
    ///
    /// # Errors
    /// Throws when the site has no plan, and for an odd number of coordinates.
    #[wasm_bindgen(js_name = floorToPlan)]
    pub fn floor_to_plan(&self, points: &[f64]) -> Result<Float64Array, JsError> {
        let plan = self.plan()?;
        each(points, |[x, y]| plan.plan_from_floor(Point { x, y }).into())
    }

    /// Metres that a pixel of the plan is wide; `undefined` where the site has no plan.
    #[wasm_bindgen(getter, js_name = planMetresPerPx)]
    #[must_use]
    pub fn plan_metres_per_px(&self) -> Option<f64> {
        self.0.plan.as_ref().map(|plan| plan.metres_per_px)
    }

    /// Pixels of the plan to points of the floor: x, y, x, y and so on.
    ///
    /// # Errors
    /// Throws when the site has no plan, and for an odd number of coordinates.
    #[wasm_bindgen(js_name = planToFloor)]
    pub fn plan_to_floor(&self, pixels: &[f64]) -> Result<Float64Array, JsError> {
        let plan = self.plan()?;
        each(pixels, |pixel| plan.floor_from_plan(pixel.into()).into())
    }

    /// The point of the floor that a pixel shows, with its standard deviation; `undefined` above the horizon.
    ///
    /// Of a site whose `planes` have regions it is the point of the floor or of a plane that the pixel shows first,
    /// with `z`, and with `plane` where it is not on the floor; `undefined` on the wall of a pit, too.
    ///
    /// `sigmaPx` is the standard deviation of the pixel, 1 if it is not given. The last argument is a time (RFC 3339),
    /// or says which pixels of which time.
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
        view.to_shown(0.0, [&[u], &[v]], &mut point, &mut status);
        let [Some(SurfacePoint { surface, at })] = point else { return Ok(None) };
        let covariance = view.covariance(At { u, v }, sigma, surface);
        let found = FloorPoint::new([at.x, at.y], covariance.and_then(|both| both.worst_sigma()), status[0]);
        let plane = surface.and_then(|index| self.0.planes.get(index)).map(|plane| plane.id.as_str());
        Ok(Some(if view.surfaces().is_empty() { found } else { found.on_plane(at.z, plane) }))
    }

    /// Many at once: u, v, u, v and so on give x, y, x, y and so on; `NaN` where a pixel shows no floor, and no
    /// plane whose region the site file has.
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
        let pairs = pairs(pixels)?;
        let [u, v] = [0, 1].map(|axis| pairs.iter().map(|pair| pair[axis]).collect::<Vec<f64>>());
        let (mut x, mut y) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        view.to_floor_points(0.0, [&u, &v], [&mut x, &mut y]);
        let floor: Vec<f64> = x.into_iter().zip(y).flat_map(<[f64; 2]>::from).collect();
        Ok(doubles(&floor).unchecked_into())
    }

    /// The pixel that shows a point of the floor, or `z` metres above it; `undefined` when the camera cannot.
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
    fn view(&self, id: &str, which: &Which) -> Result<CameraView, JsError> {
        let view = self.0.view(id, which.at.as_deref(), which.stream);
        view.map_err(|why| JsError::new(&format!("camera {id:?}: {why}")))
    }

    fn view_at(&self, id: &str, at: Option<TimeOrOptions>) -> Result<CameraView, JsError> {
        self.view(id, &at.map_or_else(|| Ok(Which::default()), |at| at.read())?)
    }

    fn plan(&self) -> Result<PlanScale, JsError> {
        let plan = self.0.plan.as_ref().map(Plan::scale);
        plan.ok_or_else(|| JsError::new("the site has no plan: give it \"plan\" with \"metres_per_px\""))
    }
}

fn pairs(values: &[f64]) -> Result<&[[f64; 2]], JsError> {
    match values.as_chunks() {
        (pairs, []) => Ok(pairs),
        _ => Err(refused("coordinates", "an even number of them: two for every point")),
    }
}

fn each(values: &[f64], map: impl Fn([f64; 2]) -> [f64; 2]) -> Result<Float64Array, JsError> {
    let mapped: Vec<[f64; 2]> = pairs(values)?.iter().map(|&pair| map(pair)).collect();
    Ok(doubles(mapped.as_flattened()).unchecked_into())
}
