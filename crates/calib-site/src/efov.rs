//! The field of view of a camera of the document: on its plane, and the floor behind that.

use crate::document::{Site, SiteCamera};
use calib_core::camera::{FloorPoint, Plane, WorldPoint};

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
