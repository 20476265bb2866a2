//! Where another view must show what one view shows of a link.

use calib_core::{Camera, Pixel, Plane, Ray, WorldPoint};

use calib_site::{Link, LinkKind, LinkSeen};

/// What another view is to look for.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Of a point the ray above the floor; of a post the post; of a line its floor line, prolonged.
    pub path: Vec<WorldPoint>,
    /// Where on it the thing itself is taken to be.
    pub at: Option<WorldPoint>,
    /// What the operator is to do there.
    pub invites: &'static str,
}

impl Trace {
    /// Of a link on a plane that `camera` shows as `seen`; `None` where its pixels lie above the horizon.
    #[must_use]
    pub fn of(camera: &Camera, link: &Link, plane: &Plane, seen: &LinkSeen) -> Option<Self> {
        match link.kind {
            LinkKind::Point => {
                let (pixel, height) = (seen.px?, link.height_m.unwrap_or(0.0));
                let at = camera.pixel_to_plane(pixel, &plane.raised(height));
                Some(Self {
                    path: ray(camera, pixel, plane, height)?,
                    at,
                    invites: "is on this line, click it",
                })
            }
            LinkKind::Post => {
                let foot = camera.pixel_to_plane(seen.foot?, plane)?;
                let known = link.length_m.map(|length| length.value);
                let length = known.or_else(|| post_length(camera, foot, seen.head?)).unwrap_or(USUAL_LENGTH);
                let path = vec![foot, WorldPoint { z: foot.z + length, ..foot }];
                let invites = "stands here, drag from its foot to its head";
                Some(Self { at: path.first().copied(), path, invites })
            }
            LinkKind::Line => {
                /// Metres by which a line is prolonged: what another view sees of it may lie far off.
                const BEYOND: f64 = 20.0;
                let segment = seen.segment.as_ref()?;
                let [a, b] =
                    [segment.first()?, segment.last()?].map(|&end| camera.pixel_to_plane(end, plane));
                let (a, b) = (a?, b?);
                let apart = a.distance(b);
                if apart < 1e-6 {
                    return None;
                }
                let on = |a: f64, b: f64, s: f64| a + s * (b - a);
                let along = |s: f64| WorldPoint::new(on(a.x, b.x, s), on(a.y, b.y, s), on(a.z, b.z, s));
                let beyond = BEYOND / apart;
                let path = [-beyond, 1.0 + beyond].map(along).to_vec();
                let at = Some(along(0.5));
                Some(Self { path, at, invites: "lies along this line, drag along it" })
            }
        }
    }
}

/// Metres that a post is taken to be high where nothing tells.
const USUAL_LENGTH: f64 = 2.0;

/// What `camera` shows at `pixel`, from the plane up.
fn ray(camera: &Camera, pixel: Pixel, plane: &Plane, height: f64) -> Option<Vec<WorldPoint>> {
    /// Metres above their plane to which things of a site reach.
    const REACH: f64 = 6.0;
    let low = camera.pixel_to_plane(pixel, &plane.raised(height.min(0.0)))?;
    let drop = camera.position.z - plane.height_at(camera.position.on_floor());
    let high = camera.pixel_to_plane(pixel, &plane.raised((0.9 * drop).clamp(0.1, REACH)))?;
    Some(vec![low, high])
}

/// How high above its foot the ray of a head passes nearest to the vertical there.
#[must_use]
pub fn post_length(camera: &Camera, foot: WorldPoint, head: Pixel) -> Option<f64> {
    let Ray { origin, direction: [x, y, z] } = camera.pixel_to_ray(head)?;
    let square = x * x + y * y;
    let share = ((foot.x - origin.x) * x + (foot.y - origin.y) * y) / square;
    Some(origin.z + share * z - foot.z).filter(|length| length.is_finite() && *length > 0.0)
}

#[cfg(test)]
mod tests {
    use calib_core::FloorPoint;

    use super::*;

    /// Two cameras of the demonstration, as they truly hang.
    fn cameras() -> [Camera; 2] {
        let truth = calib_demo::demo_site().truth;
        [truth[0].1, truth[1].1]
    }

    /// A floor point that both show.
    fn shared([a, b]: &[Camera; 2]) -> FloorPoint {
        let is_seen = |camera: &Camera, at: FloorPoint| {
            camera
                .world_to_pixel(at.at_height(0.0))
                .is_some_and(|p| (0.0..1920.0).contains(&p.u) && (0.0..1080.0).contains(&p.v))
        };
        let grid = (0..400).map(|i| FloorPoint::new(f64::from(i % 20), f64::from(i / 20)));
        grid.into_iter().find(|&at| is_seen(a, at) && is_seen(b, at)).unwrap()
    }

    #[test]
    fn the_other_view_shows_the_thing_on_its_trace() {
        let cameras = cameras();
        let at = shared(&cameras);
        let px = |height: f64| cameras[0].world_to_pixel(at.at_height(height)).unwrap();
        let link = |kind| Link::new(Some("L1".into()), kind, Vec::new());

        let seen = LinkSeen { px: Some(px(0.0)), ..LinkSeen::new("a") };
        let trace = Trace::of(&cameras[0], &link(LinkKind::Point), &Plane::FLOOR, &seen).unwrap();
        assert!(trace.at.unwrap().distance(at.at_height(0.0)) < 1e-6);

        let seen = LinkSeen { foot: Some(px(0.0)), head: Some(px(1.3)), ..LinkSeen::new("a") };
        let trace = Trace::of(&cameras[0], &link(LinkKind::Post), &Plane::FLOOR, &seen).unwrap();
        assert!(trace.path[1].distance(at.at_height(1.3)) < 1e-6, "the head is at {:?}", trace.path[1]);

        let tall = cameras[0].position.z + 0.7;
        let seen = LinkSeen { foot: Some(px(0.0)), head: Some(px(tall)), ..LinkSeen::new("a") };
        let trace = Trace::of(&cameras[0], &link(LinkKind::Post), &Plane::FLOOR, &seen).unwrap();
        assert!(trace.path[1].distance(at.at_height(tall)) < 1e-6, "a post above the camera");

        let end = FloorPoint::new(at.x + 0.5, at.y + 0.2);
        let segment = [at, end].map(|p| cameras[0].world_to_pixel(p.at_height(0.0)).unwrap());
        let seen = LinkSeen { segment: Some(segment.to_vec()), ..LinkSeen::new("a") };
        let trace = Trace::of(&cameras[0], &link(LinkKind::Line), &Plane::FLOOR, &seen).unwrap();
        let cross = |p: WorldPoint| (p.x - at.x) * (end.y - at.y) - (p.y - at.y) * (end.x - at.x);
        assert!(trace.path.iter().all(|&p| cross(p).abs() < 1e-6), "the trace is the line itself");
    }

    #[test]
    fn a_post_on_a_ramp_stands_on_it() {
        let cameras = cameras();
        let (foot, plane) = (shared(&cameras), Plane { slope: [0.05, -0.02], ..Plane::level(0.4) });
        let at = |height: f64| foot.at_height(plane.height_at(foot) + height);
        let px = |height: f64| cameras[0].world_to_pixel(at(height));
        let seen = LinkSeen { foot: px(0.0), head: px(1.3), ..LinkSeen::new("a") };
        let post = Link::new(None, LinkKind::Post, Vec::new());
        let trace = Trace::of(&cameras[0], &post, &plane, &seen).unwrap();
        assert!(
            trace.path[0].distance(at(0.0)) < 1e-6 && trace.path[1].distance(at(1.3)) < 1e-6,
            "{trace:?}"
        );
        let lifted = Link { height_m: Some(0.8), ..Link::new(None, LinkKind::Point, Vec::new()) };
        let trace = Trace::of(&cameras[0], &lifted, &plane, &LinkSeen { px: px(0.8), ..seen }).unwrap();
        assert!(trace.at.unwrap().distance(at(0.8)) < 1e-6);
    }

    #[test]
    fn what_lies_above_the_horizon_has_no_trace() {
        let [camera, _] = cameras();
        let sky = Pixel::new(960.0, -1e5);
        let seen = LinkSeen { px: Some(sky), foot: Some(sky), ..LinkSeen::new("a") };
        for kind in [LinkKind::Point, LinkKind::Post, LinkKind::Line] {
            assert_eq!(Trace::of(&camera, &Link::new(None, kind, Vec::new()), &Plane::FLOOR, &seen), None);
        }
    }
}
