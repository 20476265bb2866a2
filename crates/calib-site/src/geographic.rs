//! Geographic coordinates: the georeference of a site, entered or from its control points, and the world
//! coordinates of points with latitude and longitude.
//!
//! Without an entered georeference, there are two cases:
//!
//! - Control points with both site and geographic coordinates determine the georeference.
//! - If all control points are geographic, they define the coordinate system of the site: world (0, 0) is the
//!   first point, +x is east and +y is north. The floor is at its altitude.

use calib_core::WorldPoint;
use calib_core::floor::{Geographic, GeographicPair, GeoreferenceFit, TangentPlane};

use crate::document::{ControlPointEntry, Georeference, Site};
use crate::site_solution::{GeoreferenceSigmas, GeoreferenceSolution};

/// Azimuth of east, in degrees.
const EAST_DEG: f64 = 90.0;

impl Georeference {
    /// Returns the map from the site to geographic coordinates.
    #[must_use]
    pub fn tangent_plane(&self) -> TangentPlane {
        TangentPlane::new(self.origin(), self.x_axis_azimuth_deg.to_radians())
    }

    /// Returns the geographic coordinates of world (0, 0).
    fn origin(&self) -> Geographic {
        Geographic {
            latitude: self.lat_deg.to_radians(),
            longitude: self.lon_deg.to_radians(),
            height: self.alt_m.unwrap_or(0.0),
        }
    }
}

impl ControlPointEntry {
    /// Returns the entered geographic coordinates, with height 0 if no altitude is entered.
    pub(crate) fn geographic(&self) -> Option<Geographic> {
        Some(Geographic {
            latitude: self.lat_deg?.to_radians(),
            longitude: self.lon_deg?.to_radians(),
            height: self.alt_m.unwrap_or(0.0),
        })
    }

    /// Returns the world coordinates of a point with latitude and longitude.
    ///
    /// The floor is flat: without an altitude, the height of the point is `height_m` above it.
    pub(crate) fn world_of_geographic(&self, site: &Site) -> Option<WorldPoint> {
        let at = self.geographic()?;
        let georeference = site.georeference()?;
        let floor = georeference.alt_m.unwrap_or(0.0);
        let world = georeference.tangent_plane().to_world(match self.alt_m {
            Some(_) => at,
            None => Geographic { height: floor + self.height_m.unwrap_or(0.0), ..at },
        });
        let z = if self.alt_m.is_some() { world.z } else { self.height_m.unwrap_or(0.0) };
        Some(WorldPoint { z, ..world })
    }
}

impl Site {
    /// Returns the georeference of the site: entered for the site or its plan, otherwise from its control
    /// points.
    #[must_use]
    pub fn georeference(&self) -> Option<Georeference> {
        self.entered_georeference().cloned().or_else(|| {
            let GeoreferenceSolution { lat_deg, lon_deg, x_axis_azimuth_deg, alt_m, .. } =
                self.georeference_of_points()?;
            Some(Georeference { lat_deg, lon_deg, x_axis_azimuth_deg, alt_m })
        })
    }

    /// Returns the map from the site to geographic coordinates; `None` without a georeference.
    #[must_use]
    pub fn tangent_plane(&self) -> Option<TangentPlane> {
        self.georeference().as_ref().map(Georeference::tangent_plane)
    }

    /// Returns the georeference of the site or of its plan, as entered.
    pub(crate) fn entered_georeference(&self) -> Option<&Georeference> {
        self.georeference.as_ref().or_else(|| self.plan.as_ref()?.georeference.as_ref())
    }

    /// Returns the control points with geographic coordinates. Points that are switched off count, so that
    /// switching a point off does not move the coordinate system.
    pub(crate) fn geographic_points(&self) -> impl Iterator<Item = (&ControlPointEntry, Geographic)> {
        let points = self.cameras.iter().flat_map(|camera| &camera.control_points);
        points.filter_map(|point| Some((point, point.geographic()?)))
    }

    /// Returns the georeference that follows from the control points; `None` if it is entered, or undetermined.
    pub(crate) fn georeference_of_points(&self) -> Option<GeoreferenceSolution> {
        if self.entered_georeference().is_some() {
            return None;
        }
        let (first, at) = self.geographic_points().next()?;
        let pair = |(point, geographic): (&ControlPointEntry, Geographic)| {
            let world = point.site_coordinates(self)?.on_floor();
            Some(GeographicPair { world, geographic, sigma: point.sigma_m? })
        };
        let used: Vec<GeographicPair> =
            self.geographic_points().filter(|(point, _)| !point.off).filter_map(pair).collect();
        let pairs = if used.len() > 1 { used } else { self.geographic_points().filter_map(pair).collect() };
        if !pairs.is_empty() {
            let GeoreferenceFit { origin, x_axis_azimuth, sigmas: [east_m, north_m, azimuth] } =
                GeoreferenceFit::new(&pairs)?;
            return Some(GeoreferenceSolution {
                lat_deg: origin.latitude.to_degrees(),
                lon_deg: origin.longitude.to_degrees(),
                x_axis_azimuth_deg: x_axis_azimuth.to_degrees().rem_euclid(360.0),
                alt_m: None,
                sigma: GeoreferenceSigmas { east_m, north_m, azimuth_deg: azimuth.to_degrees() },
            });
        }
        (!self.has_site_coordinates()).then(|| GeoreferenceSolution {
            lat_deg: at.latitude.to_degrees(),
            lon_deg: at.longitude.to_degrees(),
            x_axis_azimuth_deg: EAST_DEG,
            alt_m: first.alt_m,
            sigma: GeoreferenceSigmas { east_m: 0.0, north_m: 0.0, azimuth_deg: 0.0 },
        })
    }

    /// Whether something else than geographic points defines the coordinate system of the site: a plan, other
    /// control points, a fixed placement, or a fixed mark.
    pub(crate) fn has_site_coordinates(&self) -> bool {
        let has_coordinates = |point: &ControlPointEntry| point.world_m.is_some() || point.plan_px.is_some();
        self.plan.is_some()
            || self.marks.iter().any(|mark| mark.fixed && !mark.off)
            || self.cameras.iter().any(|camera| {
                camera.placement.as_ref().is_some_and(|placement| placement.fixed)
                    || camera.control_points.iter().any(has_coordinates)
            })
    }

    /// Returns the place near which all geographic points must be: the entered georeference, otherwise the
    /// first point.
    pub(crate) fn geographic_reference(&self) -> Option<Geographic> {
        match self.entered_georeference() {
            Some(georeference) => Some(georeference.origin()),
            None => self.geographic_points().next().map(|(_, at)| at),
        }
    }
}
