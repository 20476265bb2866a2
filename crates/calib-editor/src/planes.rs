//! Verbs on planes besides the floor, and on what lies on them. Nothing here knows a screen.
//!
//! Where links and marks are by what is known today: hints for whoever measures, never measurements.

use std::collections::BTreeSet;

use calib_core::single::ConstraintKind;
use calib_core::{Annotation, FloorPoint, Pixel, WorldPoint};
use calib_site::{Link, LinkKind, PlaneEntry, Site};

use crate::edit::lines_of;
use crate::epipolar::post_length;
use crate::hit::Part;
use crate::session::Session;

/// What is done to planes; the site changes by one gesture.
#[derive(Clone, Debug)]
pub enum Planes {
    /// Takes a plane in hand: its numbers are shown, and its region is the one that is drawn.
    Choose(Option<usize>),
    /// Adds one of which nothing is known, and takes it in hand.
    Add,
    /// Deletes one; what lies on it lies on the floor from then on.
    Delete(usize),
    /// Gives one another id, everywhere.
    Rename(usize, String),
    /// Changes what is known of one.
    Set {
        /// Its index.
        index: usize,
        /// What is known from now on.
        plane: Box<PlaneEntry>,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Its region is what the field of view of the camera in hand covers.
    TakeField(usize),
    /// What is selected lies on the plane of this id, or on the floor.
    Lay(Option<String>),
}

/// Adds a plane of which nothing is known; its index.
pub fn add_plane(site: &mut Site) -> usize {
    let is_free = |id: &String| site.planes.iter().all(|plane| plane.id != *id);
    let id = (1..).map(|number| format!("plane {number}")).find(is_free).unwrap_or_default();
    site.planes.push(PlaneEntry::new(id));
    site.planes.len() - 1
}

/// Gives a plane another id, everywhere; whether it is free.
pub fn rename_plane(site: &mut Site, index: usize, id: &str) -> bool {
    let is_taken = site.planes.iter().enumerate().any(|(other, plane)| other != index && plane.id == id);
    let Some(plane) = site.planes.get_mut(index).filter(|_| !is_taken && !id.is_empty()) else {
        return false;
    };
    let old = std::mem::replace(&mut plane.id, id.to_owned());
    for own in ties(site).filter(|own| own.as_ref() == Some(&old)) {
        *own = Some(id.to_owned());
    }
    true
}

/// Deletes a plane; what lies on it returns to the floor.
pub fn delete_plane(site: &mut Site, index: usize) {
    if index < site.planes.len() {
        let PlaneEntry { id, .. } = site.planes.remove(index);
        ties(site).filter(|own| own.as_ref() == Some(&id)).for_each(|own| *own = None);
    }
}

/// Everything that names a plane.
fn ties(site: &mut Site) -> impl Iterator<Item = &mut Option<String>> {
    let cameras = site.cameras.iter_mut().flat_map(|camera| {
        let drawn = camera.annotations.iter_mut().map(|annotation| &mut annotation.plane);
        drawn.chain(std::iter::once(&mut camera.efov_plane))
    });
    cameras.chain(site.links.iter_mut().map(|link| &mut link.plane))
}

/// Puts the corners of the region of a plane; what was solved of it no longer holds.
pub fn set_region(plane: &mut PlaneEntry, region: Vec<FloorPoint>) {
    (plane.region, plane.solution) = (region, None);
}

/// Whether lines of this annotation can lie on a plane besides the floor.
#[must_use]
pub fn can_lie(annotation: &Annotation) -> bool {
    let row = annotation.kind.row();
    row.is_level() || row.constraint == ConstraintKind::Upright
}

/// On which planes the parts lie that can lie on one; the floor is `None`. Empty where none of them can.
#[must_use]
pub fn planes_under(site: &Site, camera: usize, parts: &BTreeSet<Part>) -> BTreeSet<Option<String>> {
    let entry = site.cameras.get(camera);
    let drawn = lines_of(parts).into_iter().filter_map(|(annotation, _)| entry?.annotations.get(annotation));
    let drawn = drawn.filter(|annotation| can_lie(annotation)).map(|annotation| annotation.plane.clone());
    let links = links_of(parts).into_iter().filter_map(|link| Some(site.links.get(link)?.plane.clone()));
    let field = entry.filter(|_| has_field(parts)).map(|entry| entry.efov_plane.clone());
    drawn.chain(links).chain(field).collect()
}

/// Lays the parts that can lie on a plane on the one of this id, or on the floor.
pub fn lay(site: &mut Site, camera: usize, parts: &BTreeSet<Part>, plane: Option<&String>) {
    for link in links_of(parts) {
        if let Some(link) = site.links.get_mut(link) {
            link.plane = plane.cloned();
        }
    }
    let Some(entry) = site.cameras.get_mut(camera) else { return };
    for (annotation, _) in lines_of(parts) {
        if let Some(annotation) = entry.annotations.get_mut(annotation).filter(|drawn| can_lie(drawn)) {
            annotation.plane = plane.cloned();
        }
    }
    if has_field(parts) {
        entry.efov_plane = plane.cloned();
    }
}

fn links_of(parts: &BTreeSet<Part>) -> BTreeSet<usize> {
    let link = |part: &Part| if let Part::Link { link, .. } = *part { Some(link) } else { None };
    parts.iter().filter_map(link).collect()
}

fn has_field(parts: &BTreeSet<Part>) -> bool {
    parts.iter().any(|part| matches!(part, Part::Field | Part::Corner(_)))
}

/// Where a link or mark of this id is, by the cameras that show it.
#[must_use]
pub fn place_of(session: &Session, id: &str) -> Option<WorldPoint> {
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
        session.solved.placed(camera)?.pixel_to_plane(seen.px.or(seen.foot)?, &raised)
    });
    let places: Vec<_> = seen.collect();
    let count = places.len() as f64;
    let mean = |of: fn(&WorldPoint) -> f64| places.iter().map(of).sum::<f64>() / count;
    (!places.is_empty()).then(|| WorldPoint::new(mean(|at| at.x), mean(|at| at.y), mean(|at| at.z)))
}

/// How far two links or marks are from each other, in metres.
#[must_use]
pub fn estimated_distance(session: &Session, [a, b]: &[String; 2]) -> Option<f64> {
    Some(place_of(session, a)?.distance(place_of(session, b)?))
}

/// How long a post looks in a view that shows it, in metres.
#[must_use]
pub fn estimated_post(session: &Session, link: &Link) -> Option<f64> {
    let plane = session.solved.plane(&session.site, link.plane.as_deref());
    link.seen.iter().filter(|_| link.kind == LinkKind::Post).find_map(|seen| {
        let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
        let camera = session.solved.pose(index)?;
        post_length(camera, camera.pixel_to_plane(seen.foot?, &plane)?, seen.head?)
    })
}

/// How long a line of the floor looks to the camera in hand, in metres.
#[must_use]
pub fn estimated_line(session: &Session, line: &[Pixel]) -> Option<f64> {
    let on_floor = |pixel: &Pixel| session.pose()?.pixel_to_floor(*pixel, 0.0);
    Some(on_floor(line.first()?)?.distance(on_floor(line.last()?)?))
}

#[cfg(test)]
mod tests {
    use calib_core::{Kind, Pixel};
    use calib_site::{Link, LinkKind, LinkSeen, SiteCamera};

    use super::*;
    use crate::edit::add_line;

    fn site() -> Site {
        let mut camera = SiteCamera::new("a", [640, 480]);
        let line = |u: f64| vec![Pixel::new(u, 10.0), Pixel::new(u, 90.0)];
        add_line(&mut camera, Kind::Vertical, line(10.0), false);
        add_line(&mut camera, Kind::Parallel, line(20.0), false);
        add_line(&mut camera, Kind::Upright, line(30.0), false);
        camera.efov_px = Some([[10.0, 470.0], [600.0, 470.0], [300.0, 200.0]].map(Pixel::from).to_vec());
        let seen = LinkSeen { px: Some(Pixel::new(300.0, 300.0)), ..LinkSeen::new("a") };
        let links = vec![Link::new(Some("k".into()), LinkKind::Point, vec![seen])];
        Site { cameras: vec![camera], links, ..Site::new() }
    }

    fn parts() -> BTreeSet<Part> {
        let line = |annotation| Part::Line { annotation, segment: 0 };
        [line(0), line(1), line(2), Part::Field, Part::Link { link: 0, seen: 0, point: 0 }].into()
    }

    #[test]
    fn what_can_lie_on_a_plane_is_laid_on_it_and_follows_its_name() {
        let mut site = site();
        assert_eq!(planes_under(&site, 0, &parts()), [None].into());
        let index = add_plane(&mut site);
        let id = site.planes[index].id.clone();
        lay(&mut site, 0, &parts(), Some(&id));
        assert_eq!(site.cameras[0].annotations[0].plane, None, "a vertical lies nowhere");
        assert!(rename_plane(&mut site, index, "ramp"));
        assert_eq!(planes_under(&site, 0, &parts()), [Some("ramp".to_owned())].into());
        assert_eq!(
            (site.links[0].plane.as_deref(), site.cameras[0].efov_plane.as_deref()),
            (Some("ramp"), Some("ramp"))
        );
        assert!(site.check().is_ok(), "{:?}", site.check());
    }

    #[test]
    fn a_name_that_is_taken_is_not_given() {
        let mut site = site();
        let (a, b) = (add_plane(&mut site), add_plane(&mut site));
        let id = site.planes[a].id.clone();
        assert!(!rename_plane(&mut site, b, &id) && !rename_plane(&mut site, b, ""));
        assert!(rename_plane(&mut site, a, &id), "its own");
    }

    #[test]
    fn what_lay_on_a_deleted_plane_lies_on_the_floor() {
        let mut site = site();
        let before = site.clone();
        let index = add_plane(&mut site);
        let id = site.planes[index].id.clone();
        lay(&mut site, 0, &parts(), Some(&id));
        delete_plane(&mut site, index);
        assert!(site == before);
    }
}
