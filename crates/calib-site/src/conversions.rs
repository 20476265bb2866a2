//! Conversions between entries of the site file and geometric types: planes, plan, lens, camera, priors, and
//! field of view.

use std::collections::BTreeMap;

use calib_core::camera::{
    Camera, Coefficient, Covariance, Distortion, DistortionModel, FloorPoint, ImageCircle, Lens, Pixel,
    PlanScale, Plane, WorldPoint,
};
use calib_core::floor::{
    ControlPoint, ControlPointNoise, MarkKind, MarkShape, Placement, Surface, default_efov, efov_on_floor,
};
use calib_core::single::{
    FixedParameters, Known, PlanePrior, PrincipalPointPrior, Prior, Priors, SceneErrors,
};

use crate::document::{ControlPointEntry, FixedEntry, GroundPoint, LensEntry, Link, Mark, PlacementEntry};
use crate::document::{Plan, Site, SiteCamera};
use crate::geographic::SurveyedPosition;
use crate::principal_point::PrincipalPointEntry;
use crate::scene::PlaneEntry;
use crate::solution::{CovarianceEntry, DistortionEntry, Method, Sigmas, Solution, Stage};
use crate::survey_entries::WallEntry;

impl Site {
    /// Returns the plane with this id.
    #[must_use]
    pub fn plane(&self, id: &str) -> Option<&PlaneEntry> {
        self.planes.iter().find(|plane| plane.id == id)
    }

    /// Returns the geometry of the plane with this id; the floor if `id` is `None` or unknown.
    #[must_use]
    pub fn plane_or_floor(&self, id: Option<&str>) -> Plane {
        id.and_then(|id| self.plane(id))
            .map_or(Plane::FLOOR, |entry| entry.surface(self.floor_tilt_sigma()).plane)
    }

    /// Returns the surfaces of all planes in the order of the file. A plane without a region covers nothing.
    #[must_use]
    pub fn surfaces(&self) -> Vec<Surface> {
        self.planes.iter().map(|plane| plane.surface(self.floor_tilt_sigma())).collect()
    }

    /// Returns the surfaces that pixels are mapped to in addition to the floor: [`Self::surfaces`], or an
    /// empty list if no plane has a region.
    #[must_use]
    pub fn covering_surfaces(&self) -> Vec<Surface> {
        let covers = self.planes.iter().any(|plane| !plane.region.is_empty());
        if covers { self.surfaces() } else { Vec::new() }
    }

    /// Returns the priors of all planes in the order of the file.
    #[must_use]
    pub fn plane_priors(&self) -> Vec<PlanePrior> {
        self.planes.iter().map(|plane| plane.prior(self.floor_tilt_sigma())).collect()
    }

    /// Returns the standard deviation of the tilt of a level plane, in radians.
    fn floor_tilt_sigma(&self) -> f64 {
        self.scene.map_or_else(SceneErrors::default, |scene| scene.errors()).floor_tilt
    }
}

impl Plan {
    /// Returns the mapping between plan pixels and world coordinates.
    #[must_use]
    pub fn scale(&self) -> PlanScale {
        PlanScale {
            metres_per_px: self.metres_per_px,
            origin: self.origin_px,
            x_axis: self.x_axis_deg.to_radians(),
        }
    }
}

impl Site {
    /// Adds a ground point, or replaces the point with the same id. The clicks on a replaced point get the
    /// coordinates of the new point.
    pub fn set_ground_point(&mut self, point: GroundPoint) {
        let Some(known) = self.ground_points.iter_mut().find(|known| known.id == point.id) else {
            self.ground_points.push(point);
            return;
        };
        let old = std::mem::replace(known, point.clone());
        let clicks = self.cameras.iter_mut().flat_map(|camera| &mut camera.control_points);
        for click in clicks.filter(|click| click.id.as_ref() == Some(&point.id)) {
            // An operator's control point can have the same id by chance.
            let is_click = ControlPointEntry::at_ground_point(&old, click.px).has_coordinates_of(click);
            if is_click {
                let ControlPointEntry { off, keep, px, sigma_px, .. } = *click;
                *click = ControlPointEntry {
                    off,
                    keep,
                    sigma_px,
                    ..ControlPointEntry::at_ground_point(&point, px)
                };
            }
        }
    }

    /// Replaces the plan. The cameras and the control points keep their positions in metres: control points that
    /// are given by pixels of the old plan get pixels of the new one. The georeference of the plan stays if the
    /// new plan has none.
    pub fn replace_plan(&mut self, mut plan: Plan) {
        if let Some(old) = &self.plan {
            let points = self.cameras.iter_mut().flat_map(|camera| &mut camera.control_points);
            for pixel in points.filter_map(|point| point.plan_px.as_mut()) {
                *pixel = plan.scale().plan_from_floor(old.scale().floor_from_plan(*pixel));
            }
            plan.georeference = plan.georeference.or_else(|| old.georeference.clone());
        }
        self.plan = Some(plan);
    }

    /// Adds walls to the site, except walls shorter than 0.1 m. If the site already contains a wall with the same
    /// ends, rounded to millimetres, the new wall only replaces its height, if it has one. Returns the number of
    /// added walls, and the number of walls that are too short.
    pub fn add_walls(&mut self, walls: impl IntoIterator<Item = WallEntry>) -> [usize; 2] {
        /// Length below which a line of a drawing is a detail and not a wall, in metres.
        const SHORTEST: f64 = 0.1;
        let key = |wall: &WallEntry| {
            let mut ends =
                [wall.from_m, wall.to_m].map(|end| [end.x, end.y].map(|at| (1e3 * at).round() as i64));
            ends.sort_unstable();
            ends
        };
        let mut known: BTreeMap<[[i64; 2]; 2], usize> =
            self.walls.iter().enumerate().map(|(index, wall)| (key(wall), index)).collect();
        let (before, mut short) = (self.walls.len(), 0);
        for wall in walls {
            if wall.from_m.distance(wall.to_m) < SHORTEST {
                short += 1;
            } else if let Some(index) = known.get(&key(&wall)) {
                let own = &mut self.walls[*index];
                own.height_m = wall.height_m.or(own.height_m);
            } else {
                known.insert(key(&wall), self.walls.len());
                self.walls.push(wall);
            }
        }
        [self.walls.len() - before, short]
    }

    /// Returns the expected deviations of the scene from the assumptions of the annotations, for one camera. They are
    /// entered for the camera, otherwise for the site; otherwise the defaults apply.
    #[must_use]
    pub fn scene_errors(&self, entry: &SiteCamera) -> SceneErrors {
        entry.scene.or(self.scene).map_or_else(SceneErrors::default, |scene| scene.errors())
    }

    /// Returns the prior on the principal point of a camera with this lens; `None` if the principal point is
    /// known. It is known if it is entered without a standard deviation, and in an exact scene.
    pub(crate) fn principal_point_prior(
        &self,
        entry: &SiteCamera,
        lens: &Lens,
    ) -> Option<PrincipalPointPrior> {
        if let Some(PrincipalPointEntry { value, sigma }) = entry.entered_principal_point() {
            return sigma.map(|sigma| PrincipalPointPrior { value, sigma });
        }
        let size = entry.size();
        (self.scene_errors(entry) != SceneErrors::EXACT).then(|| {
            if lens.distortion.is_wide() {
                PrincipalPointPrior::of_fisheye(size, entry.image_circle())
            } else {
                entry.principal_point_near_centre()
            }
        })
    }

    /// Returns the first entry with this id, independently of its validity period.
    pub(crate) fn first_entry(&self, id: &str) -> Option<&SiteCamera> {
        self.cameras.iter().find(|camera| camera.id == id)
    }
}

/// Returns the name of an entry in residuals: its id, otherwise its index in the list.
fn label(id: Option<&String>, index: usize) -> String {
    id.cloned().unwrap_or_else(|| index.to_string())
}

impl Mark {
    /// Returns the shape of the mark in world coordinates: as estimated, otherwise as entered.
    #[must_use]
    pub fn shape(&self) -> MarkShape {
        let (at, turn_deg) = match &self.solution {
            Some(solution) => (solution.at_m, solution.turn_deg.unwrap_or(self.turn_deg)),
            None => (self.at_m, self.turn_deg),
        };
        self.shape_at(at, turn_deg)
    }

    /// Creates a mark without observations at a world position. The sizes are in metres; their number and order
    /// depend on the kind.
    #[must_use]
    pub const fn new(kind: MarkKind, at_m: WorldPoint, size_m: Vec<f64>) -> Self {
        Self {
            id: None,
            name: None,
            off: false,
            keep: false,
            kind,
            at_m,
            lat_deg: None,
            lon_deg: None,
            crs_m: None,
            alt_m: None,
            sigma_m: None,
            turn_deg: 0.0,
            size_m,
            fixed: false,
            seen: Vec::new(),
            solution: None,
        }
    }

    /// Whether the position of the mark follows from map coordinates.
    #[must_use]
    pub const fn has_map_coordinates(&self) -> bool {
        SurveyedPosition::of_mark(self).is_entered()
    }

    /// Removes the map coordinates of the mark. The mark keeps its position in the site.
    pub const fn remove_map_coordinates(&mut self) {
        (self.lat_deg, self.lon_deg, self.crs_m) = (None, None, None);
        (self.alt_m, self.sigma_m) = (None, None);
    }

    /// Returns the shape of the mark at a position, with a rotation in degrees.
    #[must_use]
    pub fn shape_at(&self, at: WorldPoint, turn_deg: f64) -> MarkShape {
        MarkShape { kind: self.kind, at, turn: turn_deg.to_radians(), size: self.size_m.clone() }
    }

    /// Returns the name of the mark in residuals: its id, otherwise its index in the list.
    #[must_use]
    pub fn label(&self, index: usize) -> String {
        label(self.id.as_ref(), index)
    }
}

impl Link {
    /// Returns the name of the link in residuals: its id, otherwise its index in the list.
    #[must_use]
    pub fn label(&self, index: usize) -> String {
        label(self.id.as_ref(), index)
    }
}

impl PlacementEntry {
    /// Returns the placement in metres and radians.
    #[must_use]
    pub fn placement(&self) -> Placement {
        Placement { by: self.move_m, turn: self.turn_deg.to_radians(), scale: self.scale.unwrap_or(1.0) }
    }
}

impl From<Placement> for PlacementEntry {
    fn from(placement: Placement) -> Self {
        Self {
            move_m: placement.by,
            turn_deg: placement.turn.to_degrees(),
            scale: Some(placement.scale),
            fixed: false,
            held: FixedEntry::default(),
            estimated: false,
        }
    }
}

impl ControlPointEntry {
    /// Creates a control point at a raw pixel, without coordinates.
    #[must_use]
    pub const fn new(px: Pixel) -> Self {
        Self {
            id: None,
            name: None,
            off: false,
            keep: false,
            px,
            world_m: None,
            plan_px: None,
            height_m: None,
            lat_deg: None,
            lon_deg: None,
            crs_m: None,
            alt_m: None,
            sigma_px: None,
            sigma_m: None,
        }
    }

    /// Whether another control point has the same known coordinates.
    fn has_coordinates_of(&self, other: &Self) -> bool {
        (self.world_m, self.plan_px, self.height_m) == (other.world_m, other.plan_px, other.height_m)
            && (self.lat_deg, self.lon_deg, self.crs_m, self.alt_m)
                == (other.lat_deg, other.lon_deg, other.crs_m, other.alt_m)
    }

    /// Creates the control point of a click on a ground point.
    #[must_use]
    pub fn at_ground_point(point: &GroundPoint, px: Pixel) -> Self {
        let GroundPoint { id, name, world_m, height_m, lat_deg, lon_deg, crs_m, alt_m, sigma_m } =
            point.clone();
        let id = Some(id);
        Self { id, name, world_m, height_m, lat_deg, lon_deg, crs_m, alt_m, sigma_m, ..Self::new(px) }
    }

    /// Returns the name of the control point in residuals: its id, otherwise its index in the list of the
    /// camera.
    #[must_use]
    pub fn label(&self, index: usize) -> String {
        label(self.id.as_ref(), index)
    }

    /// Returns the control point with its world coordinates; `None` for a plan pixel without a plan, or for
    /// geographic coordinates without a georeference.
    #[must_use]
    pub fn control_point(&self, site: &Site) -> Option<ControlPoint> {
        let world = self
            .site_coordinates(site)
            .or_else(|| site.world_of_survey(&SurveyedPosition::of_control_point(self)))?;
        Some(ControlPoint { pixel: self.px, world })
    }

    /// Returns the standard deviation of the world coordinates, in metres; 0 if they are exact. If the entry has both
    /// site and geographic coordinates, the site coordinates are exact, and `sigma_m` belongs to the geographic
    /// coordinates.
    pub(crate) fn position_sigma(&self) -> f64 {
        let has_both = (self.lat_deg.is_some() || self.crs_m.is_some())
            && (self.world_m.is_some() || self.plan_px.is_some());
        self.sigma_m.filter(|_| !has_both).unwrap_or(0.0)
    }

    /// Returns the standard deviations of the pixel and of the world coordinates. `sigma_px` is used for an entry
    /// without `sigma_px`, in pixels. Without `world_m` and `alt_m`, the height above the floor is exact.
    pub(crate) fn noise(&self, sigma_px: f64) -> ControlPointNoise {
        let sigma = self.position_sigma();
        let is_level = self.world_m.is_none() && self.alt_m.is_none();
        let world = [sigma, sigma, if is_level { 0.0 } else { sigma }];
        ControlPointNoise { pixel: self.sigma_px.unwrap_or(sigma_px), world }
    }

    /// Returns the world coordinates from `world_m` or from `plan_px`.
    pub(crate) fn site_coordinates(&self, site: &Site) -> Option<WorldPoint> {
        let on_plan = || -> Option<WorldPoint> {
            let floor = site.plan.as_ref()?.scale().floor_from_plan(self.plan_px?);
            Some(floor.at_height(self.height_m.unwrap_or(0.0)))
        };
        self.world_m.or_else(on_plan)
    }
}

impl DistortionEntry {
    /// Creates an entry of this model without coefficients.
    #[must_use]
    pub const fn new(model: DistortionModel) -> Self {
        Self {
            model,
            k1: None,
            k2: None,
            k3: None,
            k4: None,
            k5: None,
            k6: None,
            p1: None,
            p2: None,
            s1: None,
            s2: None,
            s3: None,
            s4: None,
            lambda: None,
            xi: None,
            alpha: None,
            beta: None,
            focal_px: None,
            fit: None,
        }
    }

    /// Returns the distortion if coefficients are entered. Absent coefficients are 0, and 1 for beta.
    #[must_use]
    pub fn distortion(&self) -> Option<Distortion> {
        let given = Coefficient::ALL.iter().any(|&which| self.coefficient(which).is_some());
        given.then(|| {
            let row = self.model.row();
            let mut values = row.zero.coefficients();
            for (value, &which) in values.iter_mut().zip(row.coefficients) {
                *value = self.coefficient(which).unwrap_or(*value);
            }
            row.zero.with_coefficients(values)
        })
    }

    /// Creates the entry of a lens for a camera with this focal length, in pixels; `None` without distortion.
    ///
    /// Coefficients are rescaled to `focal`. If the model cannot be rescaled, the entry contains the lens's own focal
    /// length.
    #[must_use]
    pub fn from_lens(lens: &Lens, focal: f64) -> Option<Self> {
        let (distortion, focal_px) = match lens.distortion.rescaled(focal / lens.focal) {
            Some(distortion) => (distortion, None),
            None => (lens.distortion, Some(lens.focal)),
        };
        let model = distortion.model()?;
        // Few lenses have thin-prism terms, or distortion in addition to the unified model. Zeros of these are not
        // stored.
        let is_rare = |which| match which {
            Coefficient::S1 | Coefficient::S2 | Coefficient::S3 | Coefficient::S4 => true,
            Coefficient::Xi => false,
            _ => model == DistortionModel::Unified,
        };
        let all = distortion.names().iter().zip(distortion.coefficients());
        let mut entry = Self { focal_px, ..Self::new(model) };
        for (&which, value) in all.filter(|&(&which, value)| value != 0.0 || !is_rare(which)) {
            *entry.coefficient_mut(which) = Some(value);
        }
        Some(entry)
    }
}

impl SiteCamera {
    /// Returns the principal point: as entered, otherwise the centre of the image circle, otherwise the
    /// centre of the image.
    #[must_use]
    pub fn principal_point(&self) -> Pixel {
        let given = self.entered_principal_point().map(|entry| entry.value);
        let of_circle = || self.image_circle().map(ImageCircle::centre);
        given.or_else(of_circle).unwrap_or_else(|| self.principal_point_near_centre().value)
    }

    /// Returns the entered principal point.
    #[must_use]
    pub fn entered_principal_point(&self) -> Option<PrincipalPointEntry> {
        self.lens_of_image()?.principal_point_px
    }

    /// Returns the entered lens values in pixels of this image: focal length, data sheet, principal point and pixel
    /// aspect.
    #[must_use]
    pub fn known_lens(&self) -> LensEntry {
        let lens = self.lens_of_image().map_or_else(LensEntry::default, std::borrow::Cow::into_owned);
        LensEntry {
            roll_deg: None,
            pitch_deg: None,
            window_px: None,
            image_circle_px: None,
            distortion: None,
            like: None,
            ..lens
        }
    }

    /// Returns the entered focal length, in pixels, otherwise the focal length from the data sheet, computed for the
    /// lens `under`.
    #[must_use]
    pub fn known_focal(&self, under: &Lens) -> Option<Known> {
        let entered = self.lens_of_image().and_then(|lens| lens.focal_px);
        entered.or_else(|| self.data_sheet_focal(under))
    }

    /// Returns the image circle, if entered.
    #[must_use]
    pub fn image_circle(&self) -> Option<ImageCircle> {
        self.lens_of_image()?.image_circle_px
    }

    /// Returns the entered pixel aspect, or the value from which its estimate starts; 1 if none is entered.
    #[must_use]
    pub fn pixel_aspect(&self) -> f64 {
        let entry = self.lens_of_image().and_then(|lens| lens.pixel_aspect);
        entry.map_or(1.0, |entry| entry.start(self.size_px))
    }

    /// Returns the prior on the pixel aspect; `None` if the pixel aspect is known, or if the solution is not
    /// recomputed ([`Self::is_given`]).
    pub(crate) fn pixel_aspect_prior(&self) -> Option<Prior> {
        (!self.is_given()).then_some(())?;
        self.lens_of_image()?.pixel_aspect?.prior(self.size_px)
    }

    /// Returns the lens with the entered distortion coefficients. The lens has no distortion if no coefficients or no
    /// focal length are entered.
    #[must_use]
    pub fn lens(&self) -> Lens {
        let pinhole = Lens { pixel_aspect: self.pixel_aspect(), ..Lens::pinhole(self.principal_point()) };
        let given = || {
            let entry = self.lens_of_image()?;
            let coefficients = entry.distortion.as_ref()?;
            let focal = coefficients.focal_px.or(entry.focal_px.map(|focal| focal.value))?;
            Some(Lens { focal, distortion: coefficients.distortion()?, ..pinhole })
        };
        given().unwrap_or(pinhole)
    }

    /// Returns the lens for displaying a camera before it is solved. It is [`Self::lens`], except for a
    /// fisheye that will be fitted. The fisheye gets coefficients of zero and its entered focal length.
    /// Without one, the focal length is such that 180 degrees span the image circle, or the shorter side of
    /// the image.
    #[must_use]
    pub fn likely_lens(&self) -> Lens {
        let lens = self.lens();
        let entry = self.lens_of_image();
        let entry = entry.as_deref();
        let sought =
            entry.and_then(|entry| entry.distortion.as_ref()).map(|distortion| distortion.model.row());
        let Some(row) = sought.filter(|row| row.is_wide && !lens.distortion.is_wide()) else { return lens };
        let [width, height] = self.size();
        let known = entry.and_then(|entry| entry.focal_px).map(|focal| focal.value);
        let across = self.image_circle().map_or(width.min(height), |circle| 2.0 * circle.radius);
        let focal = known.unwrap_or(across / std::f64::consts::PI);
        Lens { focal, distortion: row.zero, image_circle: self.image_circle(), ..lens }
    }

    /// Returns the values of the fixed parameters, in radians, pixels and metres. A focal length from the data sheet
    /// is computed for the lens `under`.
    #[must_use]
    pub fn fixed_parameters(&self, under: &Lens) -> FixedParameters {
        let fixed = |known: Option<Known>| known.filter(|known| known.fixed).map(|known| known.value);
        let Some(lens) = self.lens_of_image() else {
            return FixedParameters { height: fixed(self.height_m), ..FixedParameters::default() };
        };
        FixedParameters {
            roll: fixed(lens.roll_deg).map(f64::to_radians),
            pitch: fixed(lens.pitch_deg).map(f64::to_radians),
            focal: fixed(lens.focal_px).or_else(|| fixed(self.data_sheet_focal(under))),
            height: fixed(self.height_m),
        }
    }

    /// Returns the priors on orientation, focal length and height, in radians, pixels and metres. A focal length from
    /// the data sheet is computed for the lens `under`.
    #[must_use]
    pub fn priors(&self, under: &Lens) -> Priors {
        let prior = |known: Option<Known>| {
            known.and_then(|known| Some(Prior { value: known.value, sigma: known.sigma? }))
        };
        let radians = |known: Option<Known>| {
            prior(known).map(|p| Prior { value: p.value.to_radians(), sigma: p.sigma.to_radians() })
        };
        let lens = self.lens_of_image();
        let lens = lens.as_deref();
        Priors {
            roll: radians(lens.and_then(|lens| lens.roll_deg)),
            pitch: radians(lens.and_then(|lens| lens.pitch_deg)),
            focal: prior(lens.and_then(|lens| lens.focal_px)).or_else(|| prior(self.data_sheet_focal(under))),
            height: prior(self.height_m),
            weak_log_focal: None,
        }
    }

    /// Whether the solution is not recomputed: it is kept, or it was entered or imported and the camera has
    /// no annotations.
    #[must_use]
    pub fn is_given(&self) -> bool {
        self.solution.as_ref().is_some_and(|solution| match solution.method {
            Method::Kept => true,
            Method::Given => self.annotations.is_empty(),
            Method::MaximumLikelihood | Method::Paper => false,
        })
    }

    /// Whether the camera is solved and placed in the site.
    #[must_use]
    pub fn is_placed(&self) -> bool {
        self.solution.as_ref().is_some_and(|solution| solution.stage >= Stage::Placed)
    }

    /// Returns the calibrated camera; `None` if the camera is not solved, or only its lens is calibrated.
    #[must_use]
    pub fn camera(&self) -> Option<Camera> {
        self.solution.as_ref()?.camera()
    }

    /// Returns the corners of the EFOV on the floor, in metres: from the solution, otherwise from the
    /// annotated polygon, otherwise the default EFOV. Empty without a calibration.
    #[must_use]
    pub fn floor_polygon(&self) -> Vec<FloorPoint> {
        let Some(camera) = self.camera() else { return Vec::new() };
        // An imported solution may lack the polygon on the floor.
        match (&self.solution, &self.efov_px) {
            (Some(solution), _) if !solution.efov_m.is_empty() => solution.efov_m.clone(),
            (_, Some(corners)) => efov_on_floor(&camera, corners).polygon,
            _ => default_efov(&camera, self.size()).polygon,
        }
    }
}

impl Solution {
    /// Creates a solution with the pose and the lens of a camera, with an unknown uncertainty.
    #[must_use]
    pub fn from_camera(camera: &Camera, method: Method, stage: Stage) -> Self {
        Self {
            position_m: Some(camera.position),
            yaw_deg: Some(camera.yaw.to_degrees()),
            pitch_deg: Some(camera.pitch.to_degrees()),
            roll_deg: Some(camera.roll.to_degrees()),
            distortion: DistortionEntry::from_lens(&camera.lens, camera.focal),
            pixel_aspect: camera.lens.pixel_aspect,
            ..Self::new(method, stage, camera.focal, camera.lens.principal_point)
        }
    }

    /// Returns the calibrated camera; `None` if only the lens is known.
    #[must_use]
    pub fn camera(&self) -> Option<Camera> {
        Some(Camera {
            position: self.position_m?,
            yaw: self.yaw_deg?.to_radians(),
            pitch: self.pitch_deg?.to_radians(),
            roll: self.roll_deg?.to_radians(),
            focal: self.focal_px,
            lens: self.lens(),
            covariance: self.known_covariance(),
        })
    }

    /// Stores the covariance and the standard deviations of a camera in the solution. Both are removed if the
    /// uncertainty is unknown.
    pub(crate) fn set_uncertainty(&mut self, camera: &Camera, floor_length_rel: Option<f64>) {
        self.sigma = camera.covariance.is_known().then(|| Sigmas::from_camera(camera, floor_length_rel));
        self.covariance = CovarianceEntry::from_camera(camera);
    }

    /// Returns the stored covariance, otherwise a diagonal covariance from the stored standard deviations,
    /// otherwise an unknown covariance.
    fn known_covariance(&self) -> Covariance {
        let distortion = self.lens().distortion;
        let from_sigmas = || self.sigma.as_ref().map(CovarianceEntry::from_sigmas);
        let entry = self.covariance.clone().or_else(from_sigmas);
        entry.map_or(Covariance::UNKNOWN, |entry| entry.covariance(self.focal_px, &distortion))
    }

    /// Returns the lens: principal point, image circle and distortion.
    #[must_use]
    pub fn lens(&self) -> Lens {
        let (focal, image_circle, pixel_aspect) = (self.focal_px, self.image_circle_px, self.pixel_aspect);
        let pinhole = Lens { focal, image_circle, pixel_aspect, ..Lens::pinhole(self.principal_point_px) };
        let Some(entry) = &self.distortion else { return pinhole };
        let focal = entry.focal_px.unwrap_or(self.focal_px);
        Lens { focal, distortion: entry.distortion().unwrap_or_default(), ..pinhole }
    }
}

impl Site {
    /// Returns the plane of a camera's field of view; the floor if no field of view is annotated.
    #[must_use]
    pub fn efov_plane(&self, entry: &SiteCamera) -> Plane {
        let id = entry.efov_plane.as_deref().filter(|_| entry.efov_px.is_some());
        self.plane_or_floor(id)
    }

    /// Returns the corners of a camera's EFOV on its plane, in world coordinates (metres); empty without a
    /// calibration.
    #[must_use]
    pub fn efov_outline(&self, entry: &SiteCamera) -> Vec<WorldPoint> {
        let (plane, corners) = (self.efov_plane(entry), entry.floor_polygon());
        if has_solved_outline(entry) {
            return corners.into_iter().map(|at| at.at_height(plane.height_at(at))).collect();
        }
        project_onto_plane(entry, corners.into_iter().map(|at| at.at_height(0.0)), &plane)
    }

    /// Returns the EFOV of a camera as a polygon on the floor, in metres, as if no plane were in front of the
    /// floor. [`Extent`] uses this polygon.
    ///
    /// The polygon equals [`SiteCamera::floor_polygon`] for an EFOV on the floor.
    ///
    /// [`Extent`]: calib_core::floor::Extent
    #[must_use]
    pub fn efov_on_floor(&self, entry: &SiteCamera) -> Vec<FloorPoint> {
        if self.efov_plane(entry) == Plane::FLOOR || !has_solved_outline(entry) {
            return entry.floor_polygon();
        }
        let on_floor = project_onto_plane(entry, self.efov_outline(entry).into_iter(), &Plane::FLOOR);
        on_floor.into_iter().map(WorldPoint::on_floor).collect()
    }
}

/// Whether the solution contains the corners of the EFOV, which are then on the plane of the EFOV. Without a
/// solution, the corners are computed on the floor only.
fn has_solved_outline(entry: &SiteCamera) -> bool {
    entry.solution.as_ref().is_some_and(|solution| !solution.efov_m.is_empty())
}

/// Projects points along the rays from a camera onto a plane.
fn project_onto_plane(
    entry: &SiteCamera,
    points: impl Iterator<Item = WorldPoint>,
    plane: &Plane,
) -> Vec<WorldPoint> {
    let Some(camera) = entry.camera() else { return Vec::new() };
    points.filter_map(|at| camera.point_to_plane(at, plane)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn site(efov_plane: &str) -> Site {
        let text = format!(
            r#"{{"format": "calib-site", "version": 1, "planes": [{{"id": "deck", "height_m": 1.5, "region": [[-2, 4], [2, 4], [2, 9]]}}],
            "cameras": [{{"id": "a", "size_px": [1920, 1080]{efov_plane}, "solution": {{"method": "given", "stage": "placed",
            "position_m": [1, 2, 4.5], "yaw_deg": 0, "pitch_deg": 30, "roll_deg": 0, "focal_px": 1500,
            "principal_point_px": [960, 540], "efov_m": [[0, 5], [2, 5], [1, 9]]}}}}]}}"#
        );
        Site::from_json(&text).unwrap()
    }

    #[test]
    fn field_of_view_on_a_plane_covers_the_floor_behind_it() {
        let site = site(r#", "efov_plane": "deck", "efov_px": [[0, 900], [900, 900], [500, 700]]"#);
        let entry = &site.cameras[0];
        assert_eq!(site.efov_outline(entry)[0], WorldPoint::new(0.0, 5.0, 1.5));
        // The camera is 3 m above the deck and 4.5 m above the floor, so distances from its foot at (1, 2)
        // grow by one half.
        let floor = site.efov_on_floor(entry);
        assert!(floor[0].distance(FloorPoint { x: -0.5, y: 6.5 }) < 1e-12, "{floor:?}");
        let camera = entry.camera().unwrap();
        let shown = |at| camera.world_to_pixel(at).unwrap();
        assert!(shown(floor[2].at_height(0.0)).distance(shown(WorldPoint::new(1.0, 9.0, 1.5))) < 1e-9);
    }

    #[test]
    fn field_of_view_on_the_floor_is_unchanged() {
        let site = site("");
        assert_eq!(site.efov_on_floor(&site.cameras[0]), site.cameras[0].floor_polygon());
        assert!(site.efov_outline(&site.cameras[0]).iter().all(|at| at.z == 0.0));
    }
}
