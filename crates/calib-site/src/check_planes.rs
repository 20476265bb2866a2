//! Checks of planes besides the floor, and of what lies on them.

use std::collections::HashSet;

use crate::bounded_list::MAX_ITEMS;
use crate::bounds::{At, Bounds, Checked, count, id, known, name};
use crate::document::Site;
use crate::planes::{PlaneEntry, PlaneNumber};
use crate::site_error::quoted;

/// Planes of one site; every pixel that is mapped is held against each.
const MAX_PLANES: usize = 1000;

/// The planes by themselves.
pub(crate) fn check_planes(at: &At, planes: &[PlaneEntry]) -> Checked {
    count(at, planes.len(), MAX_PLANES)?;
    let mut ids = HashSet::new();
    for (i, plane) in planes.iter().enumerate() {
        let at = at.index(i);
        check_plane(&at, plane)?;
        if !ids.insert(plane.id.as_str()) {
            return at.key("id").expected(quoted(&plane.id), "an id that no other plane has");
        }
    }
    Ok(())
}

fn check_plane(at: &At, plane: &PlaneEntry) -> Checked {
    id(&at.key("id"), Some(&plane.id))?;
    name(&at.key("name"), plane.name.as_ref())?;
    number(&at.key("height_m"), plane.height_m, Bounds::COORDINATE)?;
    if let Some(tilt) = plane.tilt {
        let at = at.key("tilt");
        number(&at.key("toward_deg"), tilt.toward_deg, Bounds::DEGREES)?;
        number(&at.key("fall_deg"), tilt.fall_deg, Bounds::SCENE_DEGREES)?;
    }
    let region = at.key("region");
    count(&region, plane.region.len(), MAX_ITEMS)?;
    if !plane.region.is_empty() && plane.region.len() < 3 {
        return region.expected(format!("{} corners", plane.region.len()), "at least 3, or no region");
    }
    for (i, &corner) in plane.region.iter().enumerate() {
        Bounds::COORDINATE.check_all(&region.index(i), &<[f64; 2]>::from(corner))?;
    }
    plane.solution.map_or(Ok(()), |solution| {
        let at = at.key("solution");
        Bounds::COORDINATE.check(&at.key("height_m"), solution.height_m)?;
        Bounds::COORDINATE.check_all(&at.key("slope"), &solution.slope)?;
        Bounds::COORDINATE.check_all(&at.key("covariance"), &solution.covariance)
    })
}

fn number(at: &At, number: Option<PlaneNumber>, bounds: Bounds) -> Checked {
    match number {
        None => Ok(()),
        Some(PlaneNumber::Exact(value)) => bounds.check(at, value),
        Some(PlaneNumber::Known(value)) => known(at, Some(&value), bounds),
    }
}

/// What lies on a plane names one of the site.
pub(crate) fn plane_of(at: &At, plane: Option<&String>, site: &Site) -> Checked {
    let Some(plane) = plane else { return Ok(()) };
    match site.plane(plane) {
        Some(_) => Ok(()),
        None => {
            at.expected(quoted(plane), "the id of one of this site's \"planes\", or no plane for the floor")
        }
    }
}
