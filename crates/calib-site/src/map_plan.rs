//! Georeferenced plan: an image whose position on the map is known, such as an orthophoto.
//!
//! The position is an affine map from plan pixels to grid coordinates or degrees. A plan of the site has square
//! pixels of one size in metres on the ground. The map from pixels to the tangent plane is therefore approximated
//! by a similarity, and an image that it does not fit is refused.

use std::fmt;

use calib_core::PlanPixel;
use calib_core::floor::{Geographic, TangentPlane};

use crate::coordinate_system::CoordinateSystem;
use crate::document::{Georeference, Plan, Site, SiteCamera};
use crate::geographic::MAX_DISTANCE_M;

/// Position of an image on the map.
#[derive(Clone, Debug)]
pub struct MapPosition {
    /// Affine map from pixels (from the corner of the image, to the right and down) to coordinates: east and
    /// north in the grid, or longitude and latitude in degrees. Each row is for one coordinate: factors of x and
    /// y, and the value at the corner.
    pub transform: [[f64; 3]; 2],
    /// Grid of the coordinates; `None` for longitude and latitude.
    pub system: Option<CoordinateSystem>,
}

/// Reason why a georeferenced image cannot be the plan of the site.
#[derive(Clone, Debug, PartialEq)]
pub enum MapPlanError {
    /// A corner of the image is outside the grid.
    OutsideGrid,
    /// The pixels are not square on the ground.
    NotSquare {
        /// Width and height of a pixel, in metres.
        pixel_m: [f64; 2],
    },
    /// The image is sheared, mirrored or too large for one scale.
    NotSimilar {
        /// Largest error of a corner, in pixels.
        error_px: f64,
    },
    /// The site has positions in metres, but their location on the map is unknown.
    NoGeoreference,
    /// The image is far from the site.
    FarFromSite {
        /// Distance of the centre of the image from world (0, 0), in metres.
        distance_m: f64,
    },
}

impl fmt::Display for MapPlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutsideGrid => f.write_str("a corner of the image is outside the grid; check the grid"),
            Self::NotSquare { pixel_m: [w, h] } => write!(
                f,
                "a pixel is {w:.3} m wide and {h:.3} m high on the ground, and a plan needs square pixels; save the \
                 image in a projected grid, such as UTM"
            ),
            Self::NotSimilar { error_px } => write!(
                f,
                "the image does not fit a plan with one scale (error {error_px:.1} px); save it in UTM or a national \
                 grid, or save a smaller part"
            ),
            Self::NoGeoreference => f.write_str(
                "the site has cameras or points with positions, but their location on the map is unknown; enter the \
                 georeference of the site, or click two points of known latitude and longitude",
            ),
            Self::FarFromSite { distance_m } => write!(
                f,
                "the image is {:.0} km from the site; check the georeference of both",
                distance_m / 1e3
            ),
        }
    }
}

impl std::error::Error for MapPlanError {}

impl MapPosition {
    /// Returns the geographic coordinates of a pixel; `None` outside the grid.
    fn geographic(&self, [x, y]: [f64; 2]) -> Option<Geographic> {
        let [a, b] = self.transform.map(|[by_x, by_y, start]| by_x * x + by_y * y + start);
        match &self.system {
            Some(system) => system.to_geographic([a, b]),
            None => (b.abs() <= 90.0 && a.abs() <= 360.0).then(|| Geographic {
                latitude: b.to_radians(),
                longitude: a.to_radians(),
                height: 0.0,
            }),
        }
    }
}

/// Similarity from the pixels of an image to world coordinates.
struct Similarity {
    /// World coordinates of the centre of the image, in metres.
    centre: [f64; 2],
    /// World step of one pixel to the right, in metres. The step of one pixel up is this step rotated by 90 degrees.
    right: [f64; 2],
}

impl Similarity {
    /// Fits the similarity to the world coordinates of the corners: upper left, upper right, lower left, lower
    /// right. `size` is the width and height of the image, in pixels.
    fn new([width, height]: [f64; 2], corners: [[f64; 2]; 4]) -> Result<Self, MapPlanError> {
        /// Largest error of a corner, in pixels. Larger errors are visible when edges are traced.
        const MAX_ERROR_PX: f64 = 1.0;
        /// Largest relative difference of the width and height of a pixel.
        const MAX_STRETCH: f64 = 0.01;
        let [upper_left, upper_right, lower_left, lower_right] = corners;
        let centre = [0, 1].map(|k| 0.25 * corners.iter().map(|corner| corner[k]).sum::<f64>());
        // Mean step of a pixel to the right, and of a pixel up.
        let step = |from: [[f64; 2]; 2], to: [[f64; 2]; 2], count: f64| {
            [0, 1].map(|k| 0.5 * (to[0][k] - from[0][k] + to[1][k] - from[1][k]) / count)
        };
        let right = step([upper_left, lower_left], [upper_right, lower_right], width);
        let up = step([lower_left, lower_right], [upper_left, upper_right], height);
        let pixel_m = [right[0].hypot(right[1]), up[0].hypot(up[1])];
        if (pixel_m[0] / pixel_m[1] - 1.0).abs() > MAX_STRETCH {
            return Err(MapPlanError::NotSquare { pixel_m });
        }
        let nearest = [0.5 * (right[0] + up[1]), 0.5 * (right[1] - up[0])];
        let found = Self { centre, right: nearest };
        let pixels = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        let off = pixels.iter().zip(corners).map(|([x, y], exact)| {
            let [found_x, found_y] = found.world([x - 0.5 * width, 0.5 * height - y]);
            (found_x - exact[0]).hypot(found_y - exact[1])
        });
        let error_px = off.fold(0.0, f64::max) / found.metres_per_px();
        // A degenerate image has an error that is not a number.
        if error_px <= MAX_ERROR_PX { Ok(found) } else { Err(MapPlanError::NotSimilar { error_px }) }
    }

    /// Returns the world coordinates of a point, in pixels to the right of and above the centre.
    fn world(&self, [dx, dy]: [f64; 2]) -> [f64; 2] {
        let [a, b] = self.right;
        [self.centre[0] + a * dx - b * dy, self.centre[1] + b * dx + a * dy]
    }

    /// Returns world (0, 0), in pixels to the right of and above the centre: the inverse of [`Self::world`].
    fn world_origin(&self) -> [f64; 2] {
        let ([a, b], [x, y]) = (self.right, self.centre);
        let square = a * a + b * b;
        [-(a * x + b * y) / square, (b * x - a * y) / square]
    }

    fn metres_per_px(&self) -> f64 {
        self.right[0].hypot(self.right[1])
    }
}

impl Site {
    /// Creates a plan from an image of known position, with scale, origin, rotation and georeference. World
    /// coordinates do not change if the site has a georeference. In a site without positions, world (0, 0) becomes
    /// the lower left corner of the image, and +x points to its right.
    ///
    /// # Errors
    /// If a corner of the image is outside the grid, or if the image does not fit a plan with square pixels of one
    /// size. Also if the image is far from the site, or if the site has positions without a georeference.
    pub fn plan_on_map(
        &self,
        image: Option<String>,
        size: [u32; 2],
        position: &MapPosition,
    ) -> Result<Plan, MapPlanError> {
        let [width, height] = size.map(f64::from);
        let at = |pixel: [f64; 2]| position.geographic(pixel).ok_or(MapPlanError::OutsideGrid);
        let georeference = match self.georeference() {
            Some(known) => known,
            None if self.has_positions() => return Err(MapPlanError::NoGeoreference),
            None => Georeference::of_image(at([0.0, height])?, at([width, height])?),
        };
        let plane = georeference.tangent_plane();
        let floor = georeference.alt_m.unwrap_or(0.0);
        let world = |pixel: [f64; 2]| -> Result<[f64; 2], MapPlanError> {
            let point = plane.to_world(Geographic { height: floor, ..at(pixel)? });
            Ok([point.x, point.y])
        };
        let corners =
            [world([0.0, 0.0])?, world([width, 0.0])?, world([0.0, height])?, world([width, height])?];
        let similarity = Similarity::new([width, height], corners)?;
        let distance_m = similarity.centre[0].hypot(similarity.centre[1]);
        if distance_m > MAX_DISTANCE_M {
            return Err(MapPlanError::FarFromSite { distance_m });
        }
        let [dx, dy] = similarity.world_origin();
        Ok(Plan {
            image,
            page: None,
            layers: None,
            metres_per_px: similarity.metres_per_px(),
            origin_px: PlanPixel::new(0.5 * width + dx, 0.5 * height - dy),
            x_axis_deg: -similarity.right[1].atan2(similarity.right[0]).to_degrees(),
            georeference: self.entered_georeference().is_none().then_some(georeference),
        })
    }
}

impl Site {
    /// Whether cameras, control points or marks have positions in metres.
    fn has_positions(&self) -> bool {
        let has_position = |camera: &SiteCamera| {
            camera.placement.is_some() || camera.control_points.iter().any(|point| point.world_m.is_some())
        };
        self.cameras.iter().any(has_position) || self.marks.iter().any(|mark| mark.fixed)
    }
}

impl Georeference {
    /// Returns the georeference with world (0, 0) at `corner` and +x toward `toward`, which are corners of an image.
    fn of_image(corner: Geographic, toward: Geographic) -> Self {
        let to_right = TangentPlane::new(corner, std::f64::consts::FRAC_PI_2).to_world(toward);
        Self {
            lat_deg: corner.latitude.to_degrees(),
            lon_deg: corner.longitude.to_degrees(),
            x_axis_azimuth_deg: to_right.x.atan2(to_right.y).to_degrees().rem_euclid(360.0),
            alt_m: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn utm() -> CoordinateSystem {
        CoordinateSystem::new("EPSG:25832").unwrap()
    }

    /// Returns the position of an image in UTM with a pixel size in metres, rotated by an angle in radians.
    fn image(pixel: f64, turn: f64) -> MapPosition {
        let (sin, cos) = turn.sin_cos();
        let transform = [[pixel * cos, pixel * sin, 691_000.0], [pixel * sin, -pixel * cos, 5_335_000.0]];
        MapPosition { transform, system: Some(utm()) }
    }

    proptest! {
        #[test]
        fn every_pixel_of_the_plan_is_at_its_place_on_the_map(
            pixel in 0.02..0.5_f64, turn in -3.1..3.1_f64, x in 0.0..2000.0_f64, y in 0.0..1000.0_f64, is_placed in any::<bool>(),
        ) {
            let position = image(pixel, turn);
            let georeference =
                Georeference { lat_deg: 48.14, lon_deg: 11.57, x_axis_azimuth_deg: 31.0, alt_m: None };
            let site = Site { georeference: is_placed.then_some(georeference), ..Site::new() };
            let plan = site.plan_on_map(None, [2000, 1000], &position).unwrap();
            prop_assert_eq!(plan.georeference.is_none(), is_placed);
            let floor = plan.scale().floor_from_plan(PlanPixel::new(x, y));
            let site = Site { plan: Some(plan), ..site };
            let found = site.tangent_plane().unwrap().to_geographic(floor.at_height(0.0));
            let [east, north] = utm().from_geographic(found).unwrap();
            let expected = position.transform.map(|[a, b, c]| a * x + b * y + c);
            let error = (east - expected[0]).hypot(north - expected[1]);
            prop_assert!(error < 0.2 * pixel + 2e-3, "{error} m, {pixel} m a pixel");
        }
    }

    #[test]
    fn a_plan_on_the_map_keeps_geographic_points() {
        let document = r#"{"format": "calib-site", "version": 1, "cameras": [{"id": "a", "size_px": [100, 100],
            "control_points": [{"px": [1, 2], "lat_deg": 48.1408, "lon_deg": 11.5677, "sigma_m": 1},
            {"px": [5, 2], "lat_deg": 48.1409, "lon_deg": 11.5679, "sigma_m": 1}]}]}"#;
        let mut site = Site::from_json(document).unwrap();
        let before = site.cameras[0].control_points[1].control_point(&site).unwrap();
        let plan = site.plan_on_map(None, [2000, 1000], &image(0.1, 0.2)).unwrap();
        site.replace_plan(plan);
        let after = site.cameras[0].control_points[1].control_point(&site).unwrap();
        assert!(before.world.distance(after.world) < 1e-6, "{before:?} {after:?}");
        site.cameras[0].control_points.clear();
        site.plan = None;
        site.cameras[0].placement = Some(serde_json::from_str("{}").unwrap());
        assert!(matches!(
            site.plan_on_map(None, [2000, 1000], &image(0.1, 0.2)),
            Err(MapPlanError::NoGeoreference)
        ));
    }

    #[test]
    fn images_that_are_no_plans_are_refused() {
        let refused = |transform, system| {
            let position = MapPosition { transform, system };
            Site::new().plan_on_map(None, [1000, 1000], &position).unwrap_err()
        };
        let degrees = [[1e-6, 0.0, 11.5], [0.0, -1e-6, 48.1]];
        assert!(matches!(refused(degrees, None), MapPlanError::NotSquare { .. }));
        let mirrored = [[0.1, 0.0, 691_000.0], [0.0, 0.1, 5_335_000.0]];
        assert!(matches!(refused(mirrored, Some(utm())), MapPlanError::NotSimilar { .. }));
        let exchanged = [[0.1, 0.0, 1e12], [0.0, -0.1, 1e12]];
        assert!(matches!(
            refused(exchanged, Some(utm())),
            MapPlanError::OutsideGrid | MapPlanError::NotSquare { .. }
        ));
    }
}
