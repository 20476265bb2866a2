//! How far two views put one link from each other, and how far they may by their own uncertainty.

use calib_core::{Camera, FloorPoint, Plane};

use calib_core::floor::FloorLine;

use calib_site::{Link, LinkKind, LinkSeen};

use crate::session::Session;

/// The distance between where two views put a link, of those that contradict each other most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Apart {
    /// In metres.
    pub metres: f64,
    /// Its standard deviation, in metres, as if the two cameras had nothing in common; `None` where nothing is
    /// known of the errors of one of them.
    pub sigma: Option<f64>,
}

impl Apart {
    /// Whether chance does not explain it.
    #[must_use]
    pub fn is_far(self) -> bool {
        self.clear() > 3.0
    }

    /// The distance over its standard deviation; 0 where nothing is known of that.
    fn clear(self) -> f64 {
        self.sigma.map_or(0.0, |sigma| self.metres / sigma)
    }
}

/// How far the views of a point are apart on the floor; none of what fewer than two placed cameras show.
#[must_use]
pub fn apart(session: &Session, link: &Link) -> Option<Apart> {
    if link.kind != LinkKind::Point {
        return None;
    }
    let plane = plane_of(session, link);
    let places: Vec<_> = link.seen.iter().filter_map(|seen| place(session, seen, &plane)).collect();
    let pairs = places.iter().enumerate().flat_map(|(i, a)| places[..i].iter().map(move |b| (a, b)));
    let far =
        pairs.map(|(a, b)| Apart { metres: a.0.distance(b.0), sigma: a.1.zip(b.1).map(|(a, b)| a.hypot(b)) });
    far.max_by(|a, b| a.clear().total_cmp(&b.clear()).then(a.metres.total_cmp(&b.metres)))
}

/// The plane on which a point of a link is.
fn plane_of(session: &Session, link: &Link) -> Plane {
    let plane = session.solved.plane(&session.site, link.plane.as_deref());
    plane.raised(link.height_m.unwrap_or(0.0))
}

/// Where a view puts a point, and how uncertain it is there.
fn place(session: &Session, seen: &LinkSeen, plane: &Plane) -> Option<(FloorPoint, Option<f64>)> {
    let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
    let (camera, px) = (session.solved.placed(index)?, seen.px?);
    let drawn = seen.sigma_px.or(session.site.cameras[index].sigma_px).unwrap_or(1.0);
    let sigma = camera.floor_covariance(px, drawn).and_then(|covariance| covariance.worst_sigma());
    Some((camera.pixel_to_plane(px, plane)?.on_floor(), sigma))
}

/// How far the points that two cameras show are apart on the floor, root mean square, and how far they may be.
pub(crate) fn pair(session: &Session, pair: [usize; 2]) -> Option<Apart> {
    if !pair.iter().all(|&camera| session.site.has_shared(camera)) {
        return None;
    }
    let both = |link: &Link| {
        let plane = plane_of(session, link);
        let [a, b] = pair.map(|camera| {
            let id = &session.site.cameras.get(camera)?.id;
            place(session, link.seen.iter().find(|seen| seen.camera == *id)?, &plane)
        });
        let ((a, sigma_a), (b, sigma_b)) = (a?, b?);
        Some((a.distance(b), sigma_a.zip(sigma_b).map(|(a, b)| a.hypot(b))))
    };
    let points = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Point);
    let all: Vec<(f64, Option<f64>)> = points.filter_map(both).collect();
    let rms = |values: &mut dyn Iterator<Item = f64>| {
        (values.map(|value| value * value).sum::<f64>() / all.len() as f64).sqrt()
    };
    let sigmas: Option<Vec<f64>> = all.iter().map(|(_, sigma)| *sigma).collect();
    let sigma = sigmas.map(|sigmas| rms(&mut sigmas.into_iter()));
    (!all.is_empty()).then(|| Apart { metres: rms(&mut all.iter().map(|(metres, _)| *metres)), sigma })
}

/// How far the lines of the floor that a camera shows pass from where the others put them, as they stand now: root mean
/// square of the distances of its ends from them in its image, in pixels, and how many lines that are. None where it
/// shares none with a camera that stands somewhere.
#[must_use]
pub fn lines_off(session: &Session, camera: usize) -> Option<(f64, usize)> {
    if !session.site.has_shared(camera) {
        return None;
    }
    let lines = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Line);
    let all: Vec<Vec<f64>> =
        lines.map(|link| line_off(session, link, camera)).filter(|off| !off.is_empty()).collect();
    let count = all.iter().flatten().count() as f64;
    let square: f64 = all.iter().flatten().map(|px| px * px).sum();
    (count > 0.0).then(|| ((square / count).sqrt(), all.len()))
}

/// The distances of the points that a camera shows of a line from where every other camera puts it, in pixels.
fn line_off(session: &Session, link: &Link, camera: usize) -> Vec<f64> {
    let plane = plane_of(session, link);
    let id = &session.site.cameras[camera].id;
    let Some(own) = session.solved.placed(camera) else { return Vec::new() };
    let put = |seen: &LinkSeen| {
        let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
        let other = session.solved.placed(index)?;
        let points = seen.segment.as_ref()?;
        let [a, b] = [points.first()?, points.last()?].map(|&px| other.pixel_to_plane(px, &plane));
        FloorLine::between(a?.on_floor(), b?.on_floor())
    };
    let lines: Vec<FloorLine> = link.seen.iter().filter(|seen| seen.camera != *id).filter_map(put).collect();
    let drawn =
        link.seen.iter().filter(|seen| seen.camera == *id).flat_map(|seen| seen.segment.iter().flatten());
    drawn
        .flat_map(|&px| {
            lines.iter().filter_map(move |line| Some(line.nearest(own, px, &plane)?.1.distance(px)))
        })
        .collect()
}

/// How far two cameras of these poses put the points that both show from each other on the floor: root mean
/// square, in metres.
#[must_use]
pub fn pair_apart(session: &Session, poses: &[Option<Camera>], pair: [usize; 2]) -> Option<f64> {
    if !pair.iter().all(|&camera| session.site.has_shared(camera)) {
        return None;
    }
    let put = |link: &Link, camera: usize| {
        let id = &session.site.cameras.get(camera)?.id;
        let seen = link.seen.iter().find(|seen| seen.camera == *id)?;
        let put = poses.get(camera)?.as_ref()?.pixel_to_plane(seen.px?, &plane_of(session, link))?;
        Some(put.on_floor())
    };
    let points = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Point);
    let squares: Vec<f64> =
        points.filter_map(|link| Some(put(link, pair[0])?.distance(put(link, pair[1])?).powi(2))).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Of the links of which a camera shows a part: how many are farther apart than chance explains, and of how many.
#[must_use]
pub fn far_links(session: &Session, camera: usize) -> (usize, usize) {
    if !session.site.has_shared(camera) {
        return (0, 0);
    }
    let id = &session.site.cameras[camera].id;
    let own = |link: &&Link| !link.off && link.seen.iter().any(|seen| seen.camera == *id);
    let known = session.site.links.iter().filter(own).filter_map(|link| apart(session, link));
    known.fold((0, 0), |(far, all), apart| (far + usize::from(apart.is_far()), all + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Images;

    #[test]
    fn a_link_put_on_another_thing_is_apart_and_the_others_are_not() {
        let mut site = calib_demo::demo_site().site;
        let is_point = |link: &&mut Link| link.kind == LinkKind::Point && link.seen.len() > 1;
        let link = site.links.iter_mut().find(is_point).unwrap();
        let (id, camera) = (link.id.clone(), link.seen[0].camera.clone());
        let before = Session::new(calib_demo::demo_site().site, Images::default(), None);
        let index = before.site.cameras.iter().position(|known| known.id == camera).unwrap();
        let (far, all) = far_links(&before, index);
        assert!(all > 0 && far < all, "{far} of {all}");
        link.seen[0].px.as_mut().unwrap().u += 300.0;
        let after = Session::new(site, Images::default(), None);
        let moved = after.site.links.iter().find(|link| link.id == id).unwrap();
        assert!(apart(&after, moved).unwrap().is_far());
        assert!(far_links(&after, index).0 > far);
    }
}
