//! Entries of the site file as the types of the geometry, and back.
//!
//! The field of view of a camera of the document: on its plane, and the floor behind that.
//!
//! The planes of a site where they are: as solving found them, or as they are known.

use calib_core::camera::{
    Camera, Coefficient, Covariance, Distortion, DistortionModel, FloorPoint, ImageCircle, Lens, Pixel,
    PlanScale, Plane, WorldPoint,
};
use calib_core::floor::{ControlPoint, MarkShape, Placement, Surface, default_efov, efov_on_floor};
use calib_core::single::{FixedParameters, PlanePrior, Prior, Priors, SceneErrors};

use crate::document::{
    ControlPointEntry, Georeference, HeldEntry, Mark, PlacementEntry, Plan, Site, SiteCamera,
};
use crate::scene::PlaneEntry;
use crate::solution::{CovarianceEntry, DistortionEntry, Method, Sigmas, Solution, Stage};

impl Site {
    /// The plane of this id.
    #[must_use]
    pub fn plane(&self, id: &str) -> Option<&PlaneEntry> {
        self.planes.iter().find(|plane| plane.id == id)
    }

    /// Where the plane of this id is; the floor without one.
    #[must_use]
    pub fn plane_or_floor(&self, id: Option<&str>) -> Plane {
        id.and_then(|id| self.plane(id)).map_or(Plane::FLOOR, |entry| entry.surface(self.usual_fall()).plane)
    }

    /// The planes in the order of the file; one without a region covers nothing of the plan.
    #[must_use]
    pub fn surfaces(&self) -> Vec<Surface> {
        self.planes.iter().map(|plane| plane.surface(self.usual_fall())).collect()
    }

    /// What pixels are mapped to besides the floor: [`Self::surfaces`], or none where no plane has a region.
    #[must_use]
    pub fn covering_surfaces(&self) -> Vec<Surface> {
        let covers = self.planes.iter().any(|plane| !plane.region.is_empty());
        if covers { self.surfaces() } else { Vec::new() }
    }

    /// What is known of every plane, in the order of the file.
    #[must_use]
    pub fn plane_priors(&self) -> Vec<PlanePrior> {
        self.planes.iter().map(|plane| plane.prior(self.usual_fall())).collect()
    }

    /// How far a level plane may be off, in radians.
    fn usual_fall(&self) -> f64 {
        self.scene.map_or_else(SceneErrors::default, |scene| scene.errors()).floor_tilt
    }
}

impl Plan {
    /// How the plan's picture lies in the base system.
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
    /// How far the scene may be from what was drawn on the image of a camera.
    #[must_use]
    pub fn scene_errors(&self, entry: &SiteCamera) -> SceneErrors {
        entry.scene.or(self.scene).map_or_else(SceneErrors::default, |scene| scene.errors())
    }

    /// Where the site lies on the earth, said by itself or by its plan.
    #[must_use]
    pub fn georeference(&self) -> Option<&Georeference> {
        self.georeference.as_ref().or_else(|| self.plan.as_ref()?.georeference.as_ref())
    }

    /// The first entry of this id, whatever its period.
    pub(crate) fn first_of(&self, id: &str) -> Option<&SiteCamera> {
        self.cameras.iter().find(|camera| camera.id == id)
    }
}

impl Mark {
    /// The mark as a shape in the base system.
    #[must_use]
    pub fn shape(&self) -> MarkShape {
        let (at, turn_deg) = match &self.solution {
            Some(solution) => (solution.at_m, solution.turn_deg.unwrap_or(self.turn_deg)),
            None => (self.at_m, self.turn_deg),
        };
        MarkShape { kind: self.kind, at, turn: turn_deg.to_radians(), size: self.size_m.clone() }
    }
}

impl PlacementEntry {
    /// The placement in metres and radians.
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
            held: HeldEntry::default(),
        }
    }
}

impl ControlPointEntry {
    /// What residuals call it: its id, or its number in the list of its camera.
    #[must_use]
    pub fn label(&self, index: usize) -> String {
        self.id.clone().unwrap_or_else(|| index.to_string())
    }

    /// The point with its place in the base system; `None` for a plan pixel without a plan.
    #[must_use]
    pub fn control_point(&self, plan: Option<&Plan>) -> Option<ControlPoint> {
        let on_plan = || -> Option<WorldPoint> {
            let floor = plan?.scale().floor_from_plan(self.plan_px?);
            Some(floor.at_height(self.height_m.unwrap_or(0.0)))
        };
        Some(ControlPoint { pixel: self.px, world: self.world_m.or_else(on_plan)? })
    }
}

impl DistortionEntry {
    /// An entry of this model without coefficients.
    #[must_use]
    pub const fn new(model: DistortionModel) -> Self {
        Self {
            model,
            k1: None,
            k2: None,
            k3: None,
            k4: None,
            p1: None,
            p2: None,
            lambda: None,
            xi: None,
            alpha: None,
            focal_px: None,
            fit: None,
        }
    }

    /// The coefficients, if they are given: those left out are 0.
    #[must_use]
    pub fn distortion(&self) -> Option<Distortion> {
        let given = Coefficient::ALL.iter().any(|&which| self.coefficient(which).is_some());
        given.then(|| {
            let row = self.model.row();
            let mut values = [0.0; Distortion::MOST];
            for (value, &which) in values.iter_mut().zip(row.coefficients) {
                *value = self.coefficient(which).unwrap_or(0.0);
            }
            row.zero.with_coefficients(values)
        })
    }

    /// The entry of a lens as a camera of this focal has it; `None` without distortion.
    ///
    /// Coefficients are expressed for `focal`, or keep a focal of their own where the model cannot.
    #[must_use]
    pub fn of(lens: &Lens, focal: f64) -> Option<Self> {
        let (distortion, focal_px) = match lens.distortion.rescaled(focal / lens.focal) {
            Some(distortion) => (distortion, None),
            None => (lens.distortion, Some(lens.focal)),
        };
        let mut entry = Self { focal_px, ..Self::new(distortion.model()?) };
        for (&which, value) in distortion.names().iter().zip(distortion.coefficients()) {
            *entry.coefficient_mut(which) = Some(value);
        }
        Some(entry)
    }
}

impl SiteCamera {
    /// The principal point: the one given, or the middle of the image circle, or that of the image.
    #[must_use]
    pub fn principal_point(&self) -> Pixel {
        let [width, height] = self.size();
        let given = self.lens.as_ref().and_then(|lens| lens.principal_point_px);
        let of_circle = || self.image_circle().map(ImageCircle::centre);
        given.or_else(of_circle).unwrap_or(Pixel { u: 0.5 * width, v: 0.5 * height })
    }

    /// The disc in which its image shows the scene, if that is said.
    #[must_use]
    pub fn image_circle(&self) -> Option<ImageCircle> {
        self.lens.as_ref()?.image_circle_px
    }

    /// The lens as far as it is given: with fixed coefficients, or without distortion.
    #[must_use]
    pub fn lens(&self) -> Lens {
        let pinhole = Lens::pinhole(self.principal_point());
        let given = || {
            let entry = self.lens.as_ref()?;
            let coefficients = entry.distortion.as_ref()?;
            let focal = coefficients.focal_px.or(entry.focal_px.map(|focal| focal.value))?;
            Some(Lens { focal, distortion: coefficients.distortion()?, ..pinhole })
        };
        given().unwrap_or(pinhole)
    }

    /// The lens to draw under while nothing is solved: as [`Self::lens`]; for a fisheye that is to be fitted, the one
    /// with coefficients of zero that shows 180 degrees across its image circle, or else the shorter side of the image,
    /// unless its focal is given.
    #[must_use]
    pub fn likely_lens(&self) -> Lens {
        let lens = self.lens();
        let entry = self.lens.as_ref();
        let sought =
            entry.and_then(|entry| entry.distortion.as_ref()).map(|distortion| distortion.model.row());
        let Some(row) = sought.filter(|row| row.is_wide && !lens.distortion.is_wide()) else { return lens };
        let [width, height] = self.size();
        let known = entry.and_then(|entry| entry.focal_px).map(|focal| focal.value);
        let across = self.image_circle().map_or(width.min(height), |circle| 2.0 * circle.radius);
        let focal = known.unwrap_or(across / std::f64::consts::PI);
        Lens { focal, distortion: row.zero, image_circle: self.image_circle(), ..lens }
    }

    /// The parameters that are fixed, with their values.
    #[must_use]
    pub fn fixed_parameters(&self) -> FixedParameters {
        let fixed = |known: Option<calib_core::single::Known>| {
            known.filter(|known| known.fixed).map(|known| known.value)
        };
        let Some(lens) = &self.lens else {
            return FixedParameters { height: fixed(self.height_m), ..FixedParameters::default() };
        };
        FixedParameters {
            roll: fixed(lens.roll_deg).map(f64::to_radians),
            pitch: fixed(lens.pitch_deg).map(f64::to_radians),
            focal: fixed(lens.focal_px),
            height: fixed(self.height_m),
        }
    }

    /// Priors on orientation, focal and height.
    #[must_use]
    pub fn priors(&self) -> Priors {
        let prior = |known: Option<calib_core::single::Known>| {
            known.and_then(|known| Some(Prior { value: known.value, sigma: known.sigma? }))
        };
        let radians = |known: Option<calib_core::single::Known>| {
            prior(known).map(|p| Prior { value: p.value.to_radians(), sigma: p.sigma.to_radians() })
        };
        let lens = self.lens.as_ref();
        Priors {
            roll: radians(lens.and_then(|lens| lens.roll_deg)),
            pitch: radians(lens.and_then(|lens| lens.pitch_deg)),
            focal: prior(lens.and_then(|lens| lens.focal_px)),
            height: prior(self.height_m),
            weak_log_focal: None,
        }
    }

    /// Whether its solution stands: typed or imported, and nothing is drawn that could change it; or kept.
    #[must_use]
    pub fn is_given(&self) -> bool {
        self.solution.as_ref().is_some_and(|solution| match solution.method {
            Method::Kept => true,
            Method::Given => self.annotations.is_empty(),
            Method::MaximumLikelihood | Method::Paper => false,
        })
    }

    /// Whether it was solved and placed in the site.
    #[must_use]
    pub fn is_placed(&self) -> bool {
        self.solution.as_ref().is_some_and(|solution| solution.stage >= Stage::Placed)
    }

    /// The calibrated camera, if it was solved beyond its lens.
    #[must_use]
    pub fn camera(&self) -> Option<Camera> {
        self.solution.as_ref()?.camera()
    }

    /// Corners of the EFOV on the floor, in metres: as solved, or what the polygon drawn covers, or the
    /// default one. Empty without a calibration.
    #[must_use]
    pub fn floor_polygon(&self) -> Vec<FloorPoint> {
        let Some(camera) = self.camera() else { return Vec::new() };
        // A solution from elsewhere may come without its polygon on the floor.
        match (&self.solution, &self.efov_px) {
            (Some(solution), _) if !solution.efov_m.is_empty() => solution.efov_m.clone(),
            (_, Some(corners)) => efov_on_floor(&camera, corners).polygon,
            _ => default_efov(&camera, self.size()).polygon,
        }
    }
}

impl Solution {
    /// The pose and the lens of a camera, and nothing of how well they are known.
    #[must_use]
    pub fn of(camera: &Camera, method: Method, stage: Stage) -> Self {
        Self {
            position_m: Some(camera.position),
            yaw_deg: Some(camera.yaw.to_degrees()),
            pitch_deg: Some(camera.pitch.to_degrees()),
            roll_deg: Some(camera.roll.to_degrees()),
            distortion: DistortionEntry::of(&camera.lens, camera.focal),
            ..Self::new(method, stage, camera.focal, camera.lens.principal_point)
        }
    }

    /// The calibrated camera; `None` when only the lens is known.
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

    /// Writes the covariance of a camera and its sigmas; neither where nothing is known of its errors.
    pub(crate) fn set_uncertainty(&mut self, camera: &Camera, floor_length_rel: Option<f64>) {
        self.sigma = camera.covariance.is_known().then(|| Sigmas::of(camera, floor_length_rel));
        self.covariance = CovarianceEntry::of(camera);
    }

    /// The covariance in the file, or that of its sigmas alone; without either nothing is known.
    fn known_covariance(&self) -> Covariance {
        let distortion = self.lens().distortion;
        let from_sigmas = || self.sigma.as_ref().map(CovarianceEntry::diagonal);
        let entry = self.covariance.clone().or_else(from_sigmas);
        entry.map_or(Covariance::UNKNOWN, |entry| entry.covariance(self.focal_px, &distortion))
    }

    /// Principal point and distortion.
    #[must_use]
    pub fn lens(&self) -> Lens {
        let (focal, image_circle) = (self.focal_px, self.image_circle_px);
        let pinhole = Lens { focal, image_circle, ..Lens::pinhole(self.principal_point_px) };
        let Some(entry) = &self.distortion else { return pinhole };
        let focal = entry.focal_px.unwrap_or(self.focal_px);
        Lens { focal, distortion: entry.distortion().unwrap_or_default(), ..pinhole }
    }
}

impl Site {
    /// The plane that the field of view of a camera lies on; one that nobody drew lies on the floor.
    #[must_use]
    pub fn efov_plane(&self, entry: &SiteCamera) -> Plane {
        let id = entry.efov_plane.as_deref().filter(|_| entry.efov_px.is_some());
        self.plane_or_floor(id)
    }

    /// Corners of the EFOV of a camera on the plane that it lies on, in metres; empty without a calibration.
    #[must_use]
    pub fn efov_outline(&self, entry: &SiteCamera) -> Vec<WorldPoint> {
        let (plane, corners) = (self.efov_plane(entry), entry.floor_polygon());
        if is_on_plane(entry) {
            return corners.into_iter().map(|at| at.at_height(plane.height_at(at))).collect();
        }
        through(entry, corners.into_iter().map(|at| at.at_height(0.0)), &plane)
    }

    /// The floor that the EFOV of a camera covers, or would if nothing stood on it: what [`Extent`] judges by.
    ///
    /// As [`SiteCamera::floor_polygon`] where the EFOV lies on the floor.
    ///
    /// [`Extent`]: calib_core::Extent
    #[must_use]
    pub fn efov_on_floor(&self, entry: &SiteCamera) -> Vec<FloorPoint> {
        if self.efov_plane(entry) == Plane::FLOOR || !is_on_plane(entry) {
            return entry.floor_polygon();
        }
        let on_floor = through(entry, self.efov_outline(entry).into_iter(), &Plane::FLOOR);
        on_floor.into_iter().map(WorldPoint::on_floor).collect()
    }
}

/// Whether its corners on the plan are those on its plane; what was not solved is known on the floor alone.
fn is_on_plane(entry: &SiteCamera) -> bool {
    entry.solution.as_ref().is_some_and(|solution| !solution.efov_m.is_empty())
}

/// Where the rays from a camera through these points meet a plane.
fn through(entry: &SiteCamera, points: impl Iterator<Item = WorldPoint>, plane: &Plane) -> Vec<WorldPoint> {
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
    fn a_field_on_a_plane_covers_the_floor_behind_it() {
        let site = site(r#", "efov_plane": "deck", "efov_px": [[0, 900], [900, 900], [500, 700]]"#);
        let entry = &site.cameras[0];
        assert_eq!(site.efov_outline(entry)[0], WorldPoint::new(0.0, 5.0, 1.5));
        // 3 m above the deck and 4.5 m above the floor: half as far again from the foot at (1, 2).
        let floor = site.efov_on_floor(entry);
        assert!(floor[0].distance(FloorPoint { x: -0.5, y: 6.5 }) < 1e-12, "{floor:?}");
        let camera = entry.camera().unwrap();
        let shown = |at| camera.world_to_pixel(at).unwrap();
        assert!(shown(floor[2].at_height(0.0)).distance(shown(WorldPoint::new(1.0, 9.0, 1.5))) < 1e-9);
    }

    #[test]
    fn a_field_on_the_floor_is_as_it_was() {
        let site = site("");
        assert_eq!(site.efov_on_floor(&site.cameras[0]), site.cameras[0].floor_polygon());
        assert!(site.efov_outline(&site.cameras[0]).iter().all(|at| at.z == 0.0));
    }
}
