//! Georeference of a site with other coordinates, such as a plan, from geographic control points in the images of
//! its solved cameras.

use std::collections::HashSet;

use calib_core::Camera;
use calib_core::floor::{GeographicPair, GeoreferenceFit, Ruler, RulerPoint};

use crate::document::{Site, SiteCamera};
use crate::frame::Frame;
use crate::geographic::SurveyedPosition;
use crate::site_solution::GeoreferenceSolution;

impl Site {
    /// Returns the georeference of a solved site, from control points whose world coordinates follow from their
    /// solved cameras; `None` with fewer than two of them.
    ///
    /// The estimate contains the errors of the annotations and of the joint calibration. It does not contain the
    /// error of a placement by hand: it is the georeference of the plan as drawn.
    pub(crate) fn georeference_of_cameras(&self) -> Option<GeoreferenceSolution> {
        let system = self.coordinate_system();
        let (mut entries, mut cameras): (Vec<&SiteCamera>, Vec<Camera>) = Default::default();
        let (mut points, mut surveyed, mut used) = (Vec::new(), Vec::new(), HashSet::new());
        for entry in self.cameras.iter().filter(|entry| self.frame(entry) == Frame::Site) {
            let Ok(view) = self.view_of(entry) else { continue };
            for point in entry.control_points.iter().filter(|point| !point.off) {
                let position = SurveyedPosition::of_control_point(point);
                let Some((at, sigma)) = position.geographic(system.as_ref()).zip(position.sigma_m) else {
                    continue;
                };
                // One survey of a point has one error, also if several cameras see the point.
                if point.id.as_ref().is_some_and(|id| !used.insert(id)) {
                    continue;
                }
                let entered = point.site_coordinates(self).map(|world| world.z);
                let height = entered.or(point.height_m).unwrap_or(0.0);
                if view.camera().pixel_to_floor(point.px, height).is_none() {
                    continue;
                }
                let sigma_px = point.sigma_px.or(entry.sigma_px).unwrap_or(1.0);
                points.push(RulerPoint { camera: entries.len(), pixel: point.px, height, sigma: sigma_px });
                surveyed.push((at, sigma));
            }
            entries.push(entry);
            cameras.push(*view.camera());
        }
        let between = |a: usize, b: usize| {
            let ids = [entries[a].id.as_str(), entries[b].id.as_str()];
            self.covariance_between(ids, [&cameras[a], &cameras[b]]).map(|covariance| *covariance)
        };
        let ruler = Ruler { cameras: &cameras, covariance_between: &between };
        let (world, covariance) = ruler.positions(&points)?;
        let pairs: Vec<GeographicPair> = world
            .into_iter()
            .zip(surveyed)
            .map(|(world, (geographic, sigma))| GeographicPair { world, geographic, sigma })
            .collect();
        GeoreferenceFit::with_world_errors(&pairs, &covariance)
            .map(|fit| GeoreferenceSolution::from_fit(&fit))
    }
}
