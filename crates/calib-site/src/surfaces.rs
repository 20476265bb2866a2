//! The planes of a site where they are: as solving found them, or as they are known.

use crate::document::Site;
use crate::planes::PlaneEntry;
use calib_core::camera::Plane;
use calib_core::floor::Surface;
use calib_core::single::{PlanePrior, SceneErrors};

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
