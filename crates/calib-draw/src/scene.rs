//! Access to a site and its results, whether they are stored in a file or solved while the site is edited.

use calib_core::{Camera, Plane};
use calib_site::{Site, Solution, Stage};

/// Site with the results of its cameras, as overlays need them. Cameras are numbered as in the site.
pub trait Scene: std::fmt::Debug {
    /// Returns the site.
    fn site(&self) -> &Site;

    /// Returns the pose and lens of a camera, if known.
    fn pose(&self, camera: usize) -> Option<Camera>;

    /// Returns the solution of a camera, if it is solved.
    fn solution(&self, camera: usize) -> Option<&Solution>;

    /// Returns the solution of a camera if the camera is placed in world coordinates.
    fn placed(&self, camera: usize) -> Option<&Solution> {
        self.solution(camera).filter(|solution| solution.stage >= Stage::Placed)
    }

    /// Returns the plane with this id; the floor for `None`.
    fn plane(&self, id: Option<&str>) -> Plane {
        self.site().plane_or_floor(id)
    }

    /// Returns the index of the camera with this id.
    fn index(&self, id: &str) -> Option<usize> {
        self.site().cameras.iter().position(|camera| camera.id == id)
    }
}

/// Site with the results stored in its file.
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
