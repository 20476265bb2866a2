//! Where a painter's site and its results are kept: in a file, or in solves that go on.

use calib_core::{Camera, Plane};
use calib_site::{Site, Solution, Stage};

/// A site and what is known of its cameras.
pub trait Scene: std::fmt::Debug {
    /// The site as it is drawn.
    fn site(&self) -> &Site;

    /// The pose and lens of a camera, if they are known.
    fn pose(&self, camera: usize) -> Option<Camera>;

    /// What was solved of a camera.
    fn solution(&self, camera: usize) -> Option<&Solution>;

    /// What was solved of a camera that stands where it belongs in the site.
    fn placed(&self, camera: usize) -> Option<&Solution> {
        self.solution(camera).filter(|solution| solution.stage >= Stage::Placed)
    }

    /// Where the plane of this id is; the floor without one.
    fn plane(&self, id: Option<&str>) -> Plane {
        self.site().plane_or_floor(id)
    }

    /// Index of the camera of this id.
    fn index(&self, id: &str) -> Option<usize> {
        self.site().cameras.iter().position(|camera| camera.id == id)
    }
}

/// A site with its results, as a file has it.
impl Scene for Site {
    fn site(&self) -> &Site {
        self
    }

    fn pose(&self, camera: usize) -> Option<Camera> {
        self.cameras.get(camera)?.camera()
    }

    fn solution(&self, camera: usize) -> Option<&Solution> {
        self.cameras.get(camera)?.solution.as_ref()
    }
}
