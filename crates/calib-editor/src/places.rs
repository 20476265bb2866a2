//! Where links and marks are by what is known today: hints for whoever measures, never measurements.

use calib_core::{Pixel, WorldPoint};

use calib_site::{Link, LinkKind};

use crate::epipolar::post_length;
use crate::session::Session;

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
