//! Search lines of links: the possible positions of a link in another view, given its observation in one
//! view.

use calib_core::{Camera, Pixel, Plane, Ray, WorldPoint};

use calib_site::{Link, LinkKind, LinkObservation};

use crate::session::Session;

/// Search line of a link for another view.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchLine {
    /// World polyline of possible positions, in metres. For a point link it is the ray above the plane. For a
    /// post it is the post, and for a line the extended line.
    pub path: Vec<WorldPoint>,
    /// Most likely position of the link on the polyline, in world metres.
    pub at: Option<WorldPoint>,
    /// Instruction for the operator.
    pub instruction: &'static str,
}

impl SearchLine {
    /// Returns the search line of a link on `plane` that `camera` observes as `seen`. `None` if the observed
    /// pixels are above the horizon.
    #[must_use]
    pub fn from_link(camera: &Camera, link: &Link, plane: &Plane, seen: &LinkObservation) -> Option<Self> {
        match link.kind {
            LinkKind::Point => {
                let (pixel, height) = (seen.px?, link.height_m.unwrap_or(0.0));
                let at = camera.pixel_to_plane(pixel, &plane.raised(height));
                Some(Self {
                    path: ray(camera, pixel, plane, height)?,
                    at,
                    instruction: "is on this line: click the point",
                })
            }
            LinkKind::Post => {
                let foot = camera.pixel_to_plane(seen.foot?, plane)?;
                let known = link.length_m.map(|length| length.value);
                let length =
                    known.or_else(|| post_length(camera, foot, seen.head?)).unwrap_or(DEFAULT_POST_HEIGHT_M);
                let path = vec![foot, WorldPoint { z: foot.z + length, ..foot }];
                let invites = "is here: drag from foot to head";
                Some(Self { at: path.first().copied(), path, instruction: invites })
            }
            LinkKind::Line => {
                /// Extension of a line link at both ends, in metres. Another view may show a distant part of
                /// the line.
                const LINE_EXTENSION_M: f64 = 20.0;
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
                let beyond = LINE_EXTENSION_M / apart;
                let path = [-beyond, 1.0 + beyond].map(along).to_vec();
                let at = Some(along(0.5));
                Some(Self { path, at, instruction: "follows this line: drag along it" })
            }
        }
    }
}

impl SearchLine {
    /// Whether a camera with an image of this size, in pixels, shows a part of the line.
    fn is_visible(&self, camera: &Camera, size: [f64; 2]) -> bool {
        /// Number of points at which every piece of the line is tested.
        const POINTS: u32 = 200;
        let is_inside = |at: WorldPoint| {
            let pixel = camera.world_to_pixel(at);
            pixel.is_some_and(|p| (0.0..=size[0]).contains(&p.u) && (0.0..=size[1]).contains(&p.v))
        };
        let pieces = self.path.windows(2).filter_map(|ends| <[WorldPoint; 2]>::try_from(ends).ok());
        let mut points = pieces.flat_map(|[a, b]| {
            let on = move |a: f64, b: f64, k: u32| a + f64::from(k) / f64::from(POINTS) * (b - a);
            (0..=POINTS).map(move |k| WorldPoint::new(on(a.x, b.x, k), on(a.y, b.y, k), on(a.z, b.z, k)))
        });
        points.any(is_inside)
    }
}

/// Returns the search line of a link for other views, from its observation in one camera. `None` if this camera is
/// not placed on the floor, or if the observed pixels are above the horizon.
#[must_use]
pub fn search_line(session: &Session, link: &Link, seen: &LinkObservation) -> Option<SearchLine> {
    let index = session.site.cameras.iter().position(|entry| entry.id == seen.camera)?;
    let plane = session.solved.plane(&session.site, link.plane.as_deref());
    SearchLine::from_link(session.solved.placed_pose(index)?, link, &plane, seen)
}

/// Returns the reason why the view of a camera shows no search line of a link, as a sentence. `None` if it can show
/// one, or if the camera has observed the link.
#[must_use]
pub fn missing_search_line(session: &Session, link: &Link, camera: usize) -> Option<String> {
    let entry = session.site.cameras.get(camera)?;
    let first = link.seen.first()?;
    if !session.site.owns_links(camera) || link.seen.iter().any(|seen| seen.camera == entry.id) {
        return None;
    }
    let index_of = |id: &str| session.site.cameras.iter().position(|entry| entry.id == id);
    let reason = [Some(camera), index_of(&first.camera)].into_iter().flatten().find_map(|index| {
        let id = &session.site.cameras.get(index)?.id;
        match (session.solved.pose(index), session.solved.placed_pose(index)) {
            (_, Some(_)) => None,
            (Some(_), None) => Some(format!("{id} is not placed")),
            (None, None) => Some(format!("{id} is not calibrated")),
        }
    });
    let lines: Vec<SearchLine> =
        link.seen.iter().filter_map(|seen| search_line(session, link, seen)).collect();
    let above = || lines.is_empty().then(|| format!("the click in {} is above the horizon", first.camera));
    let outside = || {
        let pose = session.solved.placed_pose(camera)?;
        let is_visible = lines.iter().any(|line| line.is_visible(pose, entry.size()));
        (!is_visible).then(|| format!("the line is outside the image of {}", entry.id))
    };
    let reason = reason.or_else(above).or_else(outside)?;
    Some(format!("No yellow line for {}: {reason}.", link.id.as_deref().unwrap_or("the link")))
}

/// Assumed height of a post whose height is unknown, in metres.
const DEFAULT_POST_HEIGHT_M: f64 = 2.0;

/// Returns the ray of `pixel` above a plane, as its lowest and highest point. `height` is the height of the link
/// above the plane, in metres. If it is negative, the ray starts at this height instead of at the plane.
fn ray(camera: &Camera, pixel: Pixel, plane: &Plane, height: f64) -> Option<Vec<WorldPoint>> {
    /// Largest assumed height of objects above their plane, in metres.
    const MAX_OBJECT_HEIGHT_M: f64 = 6.0;
    let low = camera.pixel_to_plane(pixel, &plane.raised(height.min(0.0)))?;
    let drop = camera.position.z - plane.height_at(camera.position.on_floor());
    let high = camera.pixel_to_plane(pixel, &plane.raised((0.9 * drop).clamp(0.1, MAX_OBJECT_HEIGHT_M)))?;
    Some(vec![low, high])
}

/// Returns the height of a post above its foot, in metres. At this height, the ray of the pixel `head` passes
/// closest to the vertical through the foot. `None` if the height is not positive.
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

    /// Returns two cameras of the demonstration site with their true poses.
    fn cameras() -> [Camera; 2] {
        let truth = calib_demo::demo_site().truth;
        [truth[0].1, truth[1].1]
    }

    /// Returns a floor point that both cameras show.
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
    fn other_view_shows_the_link_on_its_search_line() {
        let cameras = cameras();
        let at = shared(&cameras);
        let px = |height: f64| cameras[0].world_to_pixel(at.at_height(height)).unwrap();
        let link = |kind| Link::new(Some("L1".into()), kind, Vec::new());

        let seen = LinkObservation { px: Some(px(0.0)), ..LinkObservation::new("a") };
        let trace = SearchLine::from_link(&cameras[0], &link(LinkKind::Point), &Plane::FLOOR, &seen).unwrap();
        assert!(trace.at.unwrap().distance(at.at_height(0.0)) < 1e-6);
        assert!(trace.is_visible(&cameras[1], [1920.0, 1080.0]));
        let away = Camera { position: WorldPoint::new(500.0, 500.0, 3.0), ..cameras[1] };
        assert!(!trace.is_visible(&away, [1920.0, 1080.0]));

        let seen = LinkObservation { foot: Some(px(0.0)), head: Some(px(1.3)), ..LinkObservation::new("a") };
        let trace = SearchLine::from_link(&cameras[0], &link(LinkKind::Post), &Plane::FLOOR, &seen).unwrap();
        assert!(trace.path[1].distance(at.at_height(1.3)) < 1e-6, "the head is at {:?}", trace.path[1]);

        let tall = cameras[0].position.z + 0.7;
        let seen = LinkObservation { foot: Some(px(0.0)), head: Some(px(tall)), ..LinkObservation::new("a") };
        let trace = SearchLine::from_link(&cameras[0], &link(LinkKind::Post), &Plane::FLOOR, &seen).unwrap();
        assert!(trace.path[1].distance(at.at_height(tall)) < 1e-6, "a post above the camera");

        let end = FloorPoint::new(at.x + 0.5, at.y + 0.2);
        let segment = [at, end].map(|p| cameras[0].world_to_pixel(p.at_height(0.0)).unwrap());
        let seen = LinkObservation { segment: Some(segment.to_vec()), ..LinkObservation::new("a") };
        let trace = SearchLine::from_link(&cameras[0], &link(LinkKind::Line), &Plane::FLOOR, &seen).unwrap();
        let cross = |p: WorldPoint| (p.x - at.x) * (end.y - at.y) - (p.y - at.y) * (end.x - at.x);
        assert!(trace.path.iter().all(|&p| cross(p).abs() < 1e-6), "the search line is the line itself");
    }

    #[test]
    fn search_line_of_a_post_on_a_ramp_starts_on_the_ramp() {
        let cameras = cameras();
        let (foot, plane) = (shared(&cameras), Plane { slope: [0.05, -0.02], ..Plane::level(0.4) });
        let at = |height: f64| foot.at_height(plane.height_at(foot) + height);
        let px = |height: f64| cameras[0].world_to_pixel(at(height));
        let seen = LinkObservation { foot: px(0.0), head: px(1.3), ..LinkObservation::new("a") };
        let post = Link::new(None, LinkKind::Post, Vec::new());
        let trace = SearchLine::from_link(&cameras[0], &post, &plane, &seen).unwrap();
        assert!(
            trace.path[0].distance(at(0.0)) < 1e-6 && trace.path[1].distance(at(1.3)) < 1e-6,
            "{trace:?}"
        );
        let lifted = Link { height_m: Some(0.8), ..Link::new(None, LinkKind::Point, Vec::new()) };
        let trace =
            SearchLine::from_link(&cameras[0], &lifted, &plane, &LinkObservation { px: px(0.8), ..seen })
                .unwrap();
        assert!(trace.at.unwrap().distance(at(0.8)) < 1e-6);
    }

    #[test]
    fn pixels_above_the_horizon_have_no_search_line() {
        let [camera, _] = cameras();
        let sky = Pixel::new(960.0, -1e5);
        let seen = LinkObservation { px: Some(sky), foot: Some(sky), ..LinkObservation::new("a") };
        for kind in [LinkKind::Point, LinkKind::Post, LinkKind::Line] {
            assert_eq!(
                SearchLine::from_link(&camera, &Link::new(None, kind, Vec::new()), &Plane::FLOOR, &seen),
                None
            );
        }
    }
}
