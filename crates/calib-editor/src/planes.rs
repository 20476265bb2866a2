//! Edits of planes other than the floor, and of the annotations on them. Independent of the user interface.
//!
//! The file also estimates positions and lengths of links, marks and lines. The estimates are hints for the
//! operator and are never used as measurements.

use std::collections::BTreeSet;

use calib_core::single::ConstraintKind;
use calib_core::{Annotation, FloorPoint, Pixel, WorldPoint};
use calib_site::{Link, LinkKind, PlaneEntry, Site};

use crate::edit::lines_of;
use crate::epipolar::post_length;
use crate::hit::Part;
use crate::session::Session;

/// Action on planes. Each change of the site is one undo step.
#[derive(Clone, Debug)]
pub enum PlaneAction {
    /// Selects the plane with this index, or none. The region tool draws the region of the selected plane.
    Choose(Option<usize>),
    /// Adds a plane without known values, and selects the plane.
    Add,
    /// Deletes the plane with this index; its annotations return to the floor.
    Delete(usize),
    /// Changes the id of the plane with this index, and all references to it.
    Rename(usize, String),
    /// Changes the known values of a plane.
    Set {
        /// Index of the plane.
        index: usize,
        /// Changed entry of the plane.
        plane: Box<PlaneEntry>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Sets the region of the plane with this index to the field of view of the selected camera.
    SetRegionFromField(usize),
    /// Assigns the selected parts to the plane with this id, or to the floor if it is `None`.
    Assign(Option<String>),
}

/// Adds a plane without known values and returns its index.
pub fn add_plane(site: &mut Site) -> usize {
    let is_free = |id: &String| site.planes.iter().all(|plane| plane.id != *id);
    let id = (1..).map(|number| format!("plane {number}")).find(is_free).unwrap_or_default();
    site.planes.push(PlaneEntry::new(id));
    site.planes.len() - 1
}

/// Changes the id of a plane and all references to it. Returns false if the id is empty or in use.
pub fn rename_plane(site: &mut Site, index: usize, id: &str) -> bool {
    let is_taken = site.planes.iter().enumerate().any(|(other, plane)| other != index && plane.id == id);
    let Some(plane) = site.planes.get_mut(index).filter(|_| !is_taken && !id.is_empty()) else {
        return false;
    };
    let old = std::mem::replace(&mut plane.id, id.to_owned());
    for own in plane_references(site).filter(|own| own.as_ref() == Some(&old)) {
        *own = Some(id.to_owned());
    }
    true
}

/// Deletes the plane with this index; its annotations return to the floor.
pub fn delete_plane(site: &mut Site, index: usize) {
    if index < site.planes.len() {
        let PlaneEntry { id, .. } = site.planes.remove(index);
        plane_references(site).filter(|own| own.as_ref() == Some(&id)).for_each(|own| *own = None);
    }
}

/// Returns mutable references to all plane ids in cameras, annotations and links.
fn plane_references(site: &mut Site) -> impl Iterator<Item = &mut Option<String>> {
    let cameras = site.cameras.iter_mut().flat_map(|camera| {
        let drawn = camera.annotations.iter_mut().map(|annotation| &mut annotation.plane);
        drawn.chain(std::iter::once(&mut camera.efov_plane))
    });
    cameras.chain(site.links.iter_mut().map(|link| &mut link.plane))
}

/// Sets the region of a plane (a floor polygon in metres), and discards the solution of the plane.
pub fn set_region(plane: &mut PlaneEntry, region: Vec<FloorPoint>) {
    (plane.region, plane.solution) = (region, None);
}

/// Whether an annotation can be assigned to a plane other than the floor.
#[must_use]
pub fn supports_plane(annotation: &Annotation) -> bool {
    let row = annotation.kind.row();
    row.is_level() || row.constraint == ConstraintKind::Upright
}

/// Returns the ids of the planes of all parts that can be on a plane; `None` is the floor. Empty if no part
/// can be on a plane.
#[must_use]
pub fn planes_of_parts(site: &Site, camera: usize, parts: &BTreeSet<Part>) -> BTreeSet<Option<String>> {
    let entry = site.cameras.get(camera);
    let drawn = lines_of(parts).into_iter().filter_map(|(annotation, _)| entry?.annotations.get(annotation));
    let drawn =
        drawn.filter(|annotation| supports_plane(annotation)).map(|annotation| annotation.plane.clone());
    let links = links_of(parts).into_iter().filter_map(|link| Some(site.links.get(link)?.plane.clone()));
    let field = entry.filter(|_| has_field(parts)).map(|entry| entry.efov_plane.clone());
    drawn.chain(links).chain(field).collect()
}

/// Assigns the parts that can be on a plane to the plane with this id, or to the floor if `plane` is `None`.
pub fn assign_plane(site: &mut Site, camera: usize, parts: &BTreeSet<Part>, plane: Option<&String>) {
    for link in links_of(parts) {
        if let Some(link) = site.links.get_mut(link) {
            link.plane = plane.cloned();
        }
    }
    let Some(entry) = site.cameras.get_mut(camera) else { return };
    for (annotation, _) in lines_of(parts) {
        if let Some(annotation) = entry.annotations.get_mut(annotation).filter(|drawn| supports_plane(drawn))
        {
            annotation.plane = plane.cloned();
        }
    }
    if has_field(parts) {
        entry.efov_plane = plane.cloned();
    }
}

/// Returns the indices of the links among these parts.
fn links_of(parts: &BTreeSet<Part>) -> BTreeSet<usize> {
    let link = |part: &Part| if let Part::Link { link, .. } = *part { Some(link) } else { None };
    parts.iter().filter_map(link).collect()
}

/// Whether the field of view or one of its corners is among these parts.
fn has_field(parts: &BTreeSet<Part>) -> bool {
    parts.iter().any(|part| matches!(part, Part::Field | Part::Corner(_)))
}

/// Returns the world position of the link or mark with this id, in metres. The position of a link is the joint
/// estimate, otherwise the mean of the positions according to the placed cameras that show it.
#[must_use]
pub fn estimated_position(session: &Session, id: &str) -> Option<WorldPoint> {
    let is_own = |own: &Option<String>| own.as_deref() == Some(id);
    if let Some(mark) = session.site.marks.iter().find(|mark| is_own(&mark.id)) {
        return Some(mark.at_m);
    }
    let index = session.site.links.iter().position(|link| is_own(&link.id))?;
    if let Some(found) = session.solved.joint_link(&session.site, index) {
        return Some(found.at_m);
    }
    let link = &session.site.links[index];
    let plane = session.solved.plane(&session.site, link.plane.as_deref());
    let raised = plane.raised(link.height_m.unwrap_or(0.0));
    let seen = link.seen.iter().filter_map(|seen| {
        let camera = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
        session.solved.placed_pose(camera)?.pixel_to_plane(seen.px.or(seen.foot)?, &raised)
    });
    let places: Vec<_> = seen.collect();
    let count = places.len() as f64;
    let mean = |of: fn(&WorldPoint) -> f64| places.iter().map(of).sum::<f64>() / count;
    (!places.is_empty()).then(|| WorldPoint::new(mean(|at| at.x), mean(|at| at.y), mean(|at| at.z)))
}

/// Returns the estimated distance between two links or marks with these ids, in metres.
#[must_use]
pub fn estimated_distance(session: &Session, [a, b]: &[String; 2]) -> Option<f64> {
    Some(estimated_position(session, a)?.distance(estimated_position(session, b)?))
}

/// Returns the estimated height of a post link above its foot, in metres, from a view that shows it.
#[must_use]
pub fn estimated_post_height(session: &Session, link: &Link) -> Option<f64> {
    let plane = session.solved.plane(&session.site, link.plane.as_deref());
    link.seen.iter().filter(|_| link.kind == LinkKind::Post).find_map(|seen| {
        let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
        let camera = session.solved.pose(index)?;
        post_length(camera, camera.pixel_to_plane(seen.foot?, &plane)?, seen.head?)
    })
}

/// Returns the estimated length of a floor line that is annotated in the selected camera, in metres.
#[must_use]
pub fn estimated_line_length(session: &Session, line: &[Pixel]) -> Option<f64> {
    let on_floor = |pixel: &Pixel| session.pose()?.pixel_to_floor(*pixel, 0.0);
    Some(on_floor(line.first()?)?.distance(on_floor(line.last()?)?))
}

#[cfg(test)]
mod tests {
    use calib_core::{Kind, Pixel};
    use calib_site::{Link, LinkKind, LinkObservation, SiteCamera};

    use super::*;
    use crate::edit::add_line;

    fn site() -> Site {
        let mut camera = SiteCamera::new("a", [640, 480]);
        let line = |u: f64| vec![Pixel::new(u, 10.0), Pixel::new(u, 90.0)];
        add_line(&mut camera, Kind::Vertical, line(10.0), false);
        add_line(&mut camera, Kind::Parallel, line(20.0), false);
        add_line(&mut camera, Kind::Upright, line(30.0), false);
        camera.efov_px = Some([[10.0, 470.0], [600.0, 470.0], [300.0, 200.0]].map(Pixel::from).to_vec());
        let seen = LinkObservation { px: Some(Pixel::new(300.0, 300.0)), ..LinkObservation::new("a") };
        let links = vec![Link::new(Some("k".into()), LinkKind::Point, vec![seen])];
        Site { cameras: vec![camera], links, ..Site::new() }
    }

    fn parts() -> BTreeSet<Part> {
        let line = |annotation| Part::Line { annotation, segment: 0 };
        [line(0), line(1), line(2), Part::Field, Part::Link { link: 0, seen: 0, point: 0 }].into()
    }

    #[test]
    fn supported_parts_are_assigned_to_a_plane_and_follow_its_name() {
        let mut site = site();
        assert_eq!(planes_of_parts(&site, 0, &parts()), [None].into());
        let index = add_plane(&mut site);
        let id = site.planes[index].id.clone();
        assign_plane(&mut site, 0, &parts(), Some(&id));
        assert_eq!(site.cameras[0].annotations[0].plane, None, "a vertical has no plane");
        assert!(rename_plane(&mut site, index, "ramp"));
        assert_eq!(planes_of_parts(&site, 0, &parts()), [Some("ramp".to_owned())].into());
        assert_eq!(
            (site.links[0].plane.as_deref(), site.cameras[0].efov_plane.as_deref()),
            (Some("ramp"), Some("ramp"))
        );
        assert!(site.check().is_ok(), "{:?}", site.check());
    }

    #[test]
    fn plane_is_not_renamed_to_a_used_name() {
        let mut site = site();
        let (a, b) = (add_plane(&mut site), add_plane(&mut site));
        let id = site.planes[a].id.clone();
        assert!(!rename_plane(&mut site, b, &id) && !rename_plane(&mut site, b, ""));
        assert!(rename_plane(&mut site, a, &id), "its own id");
    }

    #[test]
    fn parts_of_a_deleted_plane_return_to_the_floor() {
        let mut site = site();
        let before = site.clone();
        let index = add_plane(&mut site);
        let id = site.planes[index].id.clone();
        assign_plane(&mut site, 0, &parts(), Some(&id));
        delete_plane(&mut site, index);
        assert!(site == before);
    }
}
