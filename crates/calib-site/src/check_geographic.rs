//! Checks of geographic coordinates: the coordinate system of the site, and the surveyed positions of control
//! points, links and marks.

use std::collections::HashSet;

use calib_core::floor::{Geographic, TangentPlane};

use crate::bounds::{At, Bounds, Checked, MAX_ITEMS, count, id, name, optional};
use crate::coordinate_system::CoordinateSystem;
use crate::document::Site;
use crate::geographic::{MAX_DISTANCE_M, SurveyedPosition};
use crate::site_error::quoted;

/// Largest number of control points, links and marks with geographic coordinates. The
/// georeference is computed again for each of them.
const MAX_GEOGRAPHIC_POINTS: usize = 500;

/// Checks the coordinate system of the site, and the number of its geographic points.
pub(crate) fn check_coordinate_system(root: &At, site: &Site) -> Checked {
    if let Some(name) = &site.crs
        && let Err(error) = CoordinateSystem::new(name)
    {
        return root.key("crs").expected(quoted(name), error);
    }
    let count = site.surveyed_count();
    if count > MAX_GEOGRAPHIC_POINTS {
        let found = format!("{count} control points, links and marks with geographic coordinates");
        return root.key("cameras").expected(found, format!("at most {MAX_GEOGRAPHIC_POINTS}"));
    }
    Ok(())
}

/// Checks that ground points have unique ids, and complete coordinates: `world_m`, latitude and longitude, or
/// `crs_m`.
pub(crate) fn check_ground_points(root: &At, site: &Site) -> Checked {
    let list = root.key("ground_points");
    count(&list, site.ground_points.len(), MAX_ITEMS)?;
    let mut ids = HashSet::new();
    for (i, point) in site.ground_points.iter().enumerate() {
        let at = list.index(i);
        id(&at.key("id"), Some(&point.id))?;
        name(&at.key("name"), point.name.as_ref())?;
        if !ids.insert(point.id.as_str()) {
            return at.key("id").expected(quoted(&point.id), "an id that no other ground point has");
        }
        optional(&at.key("height_m"), point.height_m, Bounds::COORDINATE)?;
        optional(&at.key("alt_m"), point.alt_m, Bounds::COORDINATE)?;
        optional(&at.key("sigma_m"), point.sigma_m, Bounds::POSITIVE)?;
        let position = SurveyedPosition::of_ground_point(point);
        match point.world_m {
            Some(world) => Bounds::COORDINATE.check_all(&at.key("world_m"), &<[f64; 3]>::from(world))?,
            None if position.is_entered() => {}
            None => {
                let expected = "\"world_m\", or \"lat_deg\" and \"lon_deg\", or \"crs_m\"";
                return at.expected("no coordinates", expected);
            }
        }
        if point.world_m.is_some() && point.height_m.is_some() {
            let expected = "no \"height_m\" together with \"world_m\", which includes the height";
            return at.key("height_m").expected("\"height_m\"", expected);
        }
        check_geographic(&at, &position, point.world_m.is_some(), site)?;
    }
    Ok(())
}

/// Checks the surveyed position of a control point, ground point, link or mark. `has_site_coordinates` is
/// whether the entry also has site coordinates.
pub(crate) fn check_geographic(
    at: &At,
    position: &SurveyedPosition,
    has_site_coordinates: bool,
    site: &Site,
) -> Checked {
    if !position.is_entered() {
        return match position.alt_m {
            Some(_) => {
                let expected = "\"alt_m\" together with \"lat_deg\" and \"lon_deg\", or with \"crs_m\"";
                at.key("alt_m").expected("\"alt_m\" alone", expected)
            }
            None => Ok(()),
        };
    }
    check_position(at, position, site)?;
    optional(&at.key("alt_m"), position.alt_m, Bounds::COORDINATE)?;
    optional(&at.key("sigma_m"), position.sigma_m, Bounds::POSITIVE)?;
    if position.sigma_m.is_none() {
        let expected = "the accuracy of the position in metres, for example 4 for a phone, 0.5 for an aerial image, \
                        0.02 for RTK";
        return at.key("sigma_m").expected("no \"sigma_m\"", expected);
    }
    if position.alt_m.is_some() {
        if position.height_m.is_some() {
            return at.expected("both \"alt_m\" and \"height_m\"", "only one of them");
        }
        let is_floor_known = site.known_georeference().is_some_and(|found| found.alt_m.is_some());
        if !has_site_coordinates && !is_floor_known {
            let expected = "\"height_m\" above the floor, or \"alt_m\" of the floor in the georeference";
            return at.key("alt_m").expected("\"alt_m\", but the altitude of the floor is unknown", expected);
        }
    }
    let system = site.coordinate_system();
    position.geographic(system.as_ref()).map_or(Ok(()), |point| check_distance(at, point, site))
}

/// Checks that the coordinates of a surveyed position are complete.
fn check_position(at: &At, position: &SurveyedPosition, site: &Site) -> Checked {
    if let Some(grid) = position.crs_m {
        let at = at.key("crs_m");
        Bounds::COORDINATE.check_all(&at, &grid)?;
        if position.lat_deg.is_some() || position.lon_deg.is_some() {
            let expected = "either \"crs_m\", or \"lat_deg\" and \"lon_deg\"";
            return at.expected("\"crs_m\" together with \"lat_deg\" or \"lon_deg\"", expected);
        }
        let system = site.coordinate_system();
        if system.is_none() {
            let expected = "the grid of the site, such as \"crs\": \"EPSG:25832\"";
            return at.expected("\"crs_m\" in a site without \"crs\"", expected);
        }
        if position.geographic(system.as_ref()).is_none() {
            let expected = "easting and northing of a point within the grid; check whether they are \
                            swapped";
            return at.expected(format!("{}, {}", grid[0], grid[1]), expected);
        }
        return Ok(());
    }
    let (Some(lat_deg), Some(lon_deg)) = (position.lat_deg, position.lon_deg) else {
        return at.expected("only one of \"lat_deg\" and \"lon_deg\"", "both of them");
    };
    Bounds::PITCH.check(&at.key("lat_deg"), lat_deg)?;
    Bounds::DEGREES.check(&at.key("lon_deg"), lon_deg)
}

/// Checks that a geographic point is at most [`MAX_DISTANCE_M`] from the site. If swapped coordinates or a wrong
/// sign explains the distance, the error names this cause.
fn check_distance(at: &At, point: Geographic, site: &Site) -> Checked {
    let Some(reference) = site.geographic_reference() else { return Ok(()) };
    let plane = TangentPlane::new(reference, 0.0);
    let distance = |latitude: f64, longitude: f64| {
        let world = plane.to_world(Geographic { latitude, longitude, ..reference });
        world.x.hypot(world.y).hypot(world.z)
    };
    let Geographic { latitude: lat, longitude: lon, .. } = point;
    let own = distance(lat, lon);
    if own <= MAX_DISTANCE_M {
        return Ok(());
    }
    let others = [
        (
            distance(lon, lat),
            "a point near the site; latitude and longitude seem to be swapped in this point, \
             the first point or the georeference",
        ),
        (
            distance(lat, -lon),
            "a point near the site; the longitude seems to have the wrong sign in this point, \
             the first point or the georeference",
        ),
        (
            distance(-lat, lon),
            "a point near the site; the latitude seems to have the wrong sign in this point, \
             the first point or the georeference",
        ),
    ];
    let cause = others.iter().find(|(other, _)| *other <= MAX_DISTANCE_M).map(|(_, cause)| *cause);
    let found = format!("a point {:.0} km from the site", own / 1e3);
    at.expected(found, cause.unwrap_or("a point within 50 km of the first point, or of the georeference"))
}
