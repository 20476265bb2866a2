//! A camera that turned, as a new entry of the site: what was drawn on its old still stands on the new one, the old
//! calibration ends where the new one begins.
//!
//! Links and marks are of the first entry of an id, and from then on of the new still. So the solution of the old period
//! is kept as it was found: solved again it would lack them.
//!
//! What is carried is evidence, drawn again; the place and the height are beliefs of the old solve. Angles and focal are
//! not: the same lines tell them, and would tell them twice.

use serde::{Deserialize, Serialize};

use crate::document::{ControlPointEntry, LensEntry, PlacementEntry, Site, SiteCamera};
use crate::document::{Link, LinkSeen, Mark};
use crate::solution::{DistortionEntry, Method, Solution, Stage};
use calib_core::camera::Turn;
use calib_core::camera::{Camera, Covariance, Pixel};
use calib_core::floor::STAGE_1_HEIGHT;
use calib_core::single::{Annotation, Known, Shape, line_name};

/// What leads from the old still to the new one.
pub trait Carrier {
    /// A line on the same edge, or all of it where the whole is wanted; `None` where the new still does not show it.
    fn line(&self, points: &[Pixel], whole: bool) -> Option<Vec<Pixel>>;
    /// A point that looks the same; `None` where the new still shows something else.
    fn point(&self, old: Pixel) -> Option<Pixel>;
    /// A corner of a polygon, whatever is there now; `None` outside the lens.
    fn corner(&self, old: Pixel) -> Option<Pixel>;
}

/// The new entry's still, and from when on it holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NewStill {
    /// As the site file names it.
    pub image: String,
    /// RFC 3339.
    pub since: String,
}

/// A site with a new period of a camera that is still to be solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recovered {
    /// The new entry stands where the old one stood; the old one is the last of the site.
    pub site: Site,
    /// Names of what was drawn and is not on the new still.
    pub left_out: Vec<String>,
    /// How much was carried.
    pub carried: usize,
}

impl Site {
    /// The site with a camera that turned as two periods: what it showed before, and what it shows now.
    ///
    /// `None` for a camera that is not solved.
    #[must_use]
    pub fn recovered(
        &self,
        index: usize,
        turn: &Turn,
        by: &dyn Carrier,
        still: &NewStill,
    ) -> Option<Recovered> {
        let old = self.cameras.get(index)?;
        let camera = old.camera()?;
        let mut work = Work { by, left_out: Vec::new(), carried: 0 };
        let mut site = self.clone();
        // Those of a period that ended before are its own no more.
        if self.has_shared(index) {
            site.links.iter_mut().enumerate().for_each(|(i, link)| work.link(link, i, &old.id));
            site.marks.iter_mut().enumerate().for_each(|(i, mark)| work.mark(mark, i, &old.id));
        }
        let new = work.camera(old, &camera, turn, still);
        site.cameras.push(ended(old, &still.since));
        site.cameras[index] = new;
        Some(Recovered { site, left_out: work.left_out, carried: work.carried })
    }
}

/// A period that ends at a time, with its solution kept.
fn ended(old: &SiteCamera, since: &str) -> SiteCamera {
    let solution = old.solution.clone().map(|solution| {
        let method = if solution.method.is_entered() { solution.method } else { Method::Kept };
        Solution { method, ..solution }
    });
    SiteCamera { valid_to: Some(since.to_owned()), solution, ..old.clone() }
}

/// What is carried and what is not, while it is.
struct Work<'a> {
    by: &'a dyn Carrier,
    left_out: Vec<String>,
    carried: usize,
}

impl Work<'_> {
    fn camera(&mut self, old: &SiteCamera, camera: &Camera, turn: &Turn, still: &NewStill) -> SiteCamera {
        let annotations = self.annotations(&old.annotations);
        let mut control_points = old.control_points.clone();
        let mut index = 0..;
        control_points.retain_mut(|point: &mut ControlPointEntry| {
            let name = point.label(index.next().unwrap_or_default());
            self.moves(&mut point.px, || format!("control point {name}"))
        });
        let straight =
            |annotations: &[Annotation]| annotations.iter().filter(|a| a.is_straight_edge()).count();
        let refits = straight(&annotations) > 0 && straight(&annotations) == straight(&old.annotations);
        SiteCamera {
            image: Some(still.image.clone()),
            lens: lens(old, camera, turn, refits),
            height_m: height(old, camera),
            annotations,
            efov_px: self.polygon(old.efov_px.as_deref()),
            placement: placement(old, &turn.applied(camera)),
            control_points,
            valid_from: Some(still.since.clone()),
            solution: None,
            error: None,
            ..old.clone()
        }
    }

    fn annotations(&mut self, old: &[Annotation]) -> Vec<Annotation> {
        let carried = old.iter().enumerate().filter_map(|(index, annotation)| {
            let mut segment = 0;
            let mut line = |points: &[Pixel], whole: bool| {
                segment += 1;
                self.counted(self.by.line(points, whole), || line_name(old, index, segment - 1))
            };
            match annotation.kind.row().shape {
                Shape::Segments => segments(annotation, &mut line),
                Shape::Polyline => {
                    let points = line(annotation.points.as_deref()?, false)?;
                    Some(Annotation { points: Some(points), ..annotation.clone() })
                }
                Shape::FootAndHead => {
                    let ends = line(&[annotation.foot?, annotation.head?], true)?;
                    Some(Annotation { foot: Some(ends[0]), head: Some(ends[1]), ..annotation.clone() })
                }
            }
        });
        carried.collect()
    }

    /// A link as the camera shows it now; one that it does not show is left to the others.
    fn mark(&mut self, mark: &mut Mark, index: usize, camera: &str) {
        let name = mark.id.clone().unwrap_or_else(|| index.to_string());
        mark.seen.retain_mut(|seen| {
            seen.camera != camera || self.moves(&mut seen.px, || format!("mark {name} {}", seen.point))
        });
    }

    fn link(&mut self, link: &mut Link, index: usize, camera: &str) {
        let name = link.id.clone().unwrap_or_else(|| index.to_string());
        link.seen.retain_mut(|seen| {
            if seen.camera != camera {
                return true;
            }
            let moved = self.seen(seen);
            let moved = self.counted(moved, || format!("link {name}"));
            moved.map(|moved| *seen = moved).is_some()
        });
    }

    fn seen(&self, seen: &LinkSeen) -> Option<LinkSeen> {
        let point = |at: Option<Pixel>| at.map_or(Some(None), |at| self.by.point(at).map(Some));
        let segment = match &seen.segment {
            Some(segment) => Some(self.by.line(segment, false)?),
            None => None,
        };
        Some(LinkSeen {
            camera: seen.camera.clone(),
            px: point(seen.px)?,
            foot: point(seen.foot)?,
            head: point(seen.head)?,
            segment,
            sigma_px: seen.sigma_px,
        })
    }

    /// Puts a pixel where it is now; whether it is there.
    fn moves(&mut self, pixel: &mut Pixel, name: impl FnOnce() -> String) -> bool {
        let moved = self.by.point(*pixel);
        self.counted(moved, name).map(|moved| *pixel = moved).is_some()
    }

    fn polygon(&self, old: Option<&[Pixel]>) -> Option<Vec<Pixel>> {
        let corners: Option<Vec<Pixel>> = old?.iter().map(|&corner| self.by.corner(corner)).collect();
        corners.filter(|corners| corners.len() > 2)
    }

    fn counted<T>(&mut self, carried: Option<T>, name: impl FnOnce() -> String) -> Option<T> {
        match &carried {
            Some(_) => self.carried += 1,
            None => self.left_out.push(name()),
        }
        carried
    }
}

/// Carries a line, or all of it where the whole is wanted.
type CarryLine<'a> = dyn FnMut(&[Pixel], bool) -> Option<Vec<Pixel>> + 'a;

/// An annotation with the segments that are there; `None` where it says nothing without those that are not.
fn segments(annotation: &Annotation, line: &mut CarryLine<'_>) -> Option<Annotation> {
    let row = annotation.kind.row();
    // A part of a length is not the length.
    let is_length = row.constraint == calib_core::single::ConstraintKind::Length;
    let carried: Vec<Option<Vec<Pixel>>> =
        annotation.segments.iter().flatten().map(|points| line(points, is_length)).collect();
    let is_of_first = row.constraint == calib_core::single::ConstraintKind::RightAngle;
    let stands = !is_of_first || carried.first().is_some_and(Option::is_some);
    let carried: Vec<Vec<Pixel>> = carried.into_iter().flatten().collect();
    // One that others refer to stays, empty.
    let is_named = annotation.id.is_some() && !is_of_first;
    (stands && (!carried.is_empty() || is_named))
        .then(|| Annotation { segments: Some(carried), ..annotation.clone() })
}

/// What was known of the lens and the angles, after the turn. The lens is the map of pixels that it was: where its edges
/// were drawn to fit it, they are there again, and else it is held.
fn lens(old: &SiteCamera, camera: &Camera, turn: &Turn, refits: bool) -> Option<LensEntry> {
    let movement = turn.movement(camera);
    let scaled = |known: Known| {
        let ratio = turn.zoom.exp();
        Known { value: ratio * known.value, sigma: known.sigma.map(|sigma| ratio * sigma), ..known }
    };
    let shifted = |by: f64| move |known: Known| Known { value: known.value + by.to_degrees(), ..known };
    let entry = old.lens.clone().unwrap_or_default();
    let is_sought =
        |distortion: &DistortionEntry| distortion.fit.is_some() || distortion.distortion().is_none();
    let is_fitted = refits && entry.distortion.as_ref().is_none_or(is_sought);
    // That of a fisheye came from its edges.
    let centre = (!is_fitted && camera.lens.distortion.is_wide()).then_some(camera.lens.principal_point);
    let held = || {
        let of = DistortionEntry::of(&camera.lens, camera.focal)?;
        Some(DistortionEntry { focal_px: Some(of.focal_px.unwrap_or(camera.focal)), ..of })
    };
    let lens = LensEntry {
        focal_px: entry.focal_px.map(scaled),
        roll_deg: entry.roll_deg.map(shifted(movement.roll)),
        pitch_deg: entry.pitch_deg.map(shifted(movement.tilt)),
        distortion: if is_fitted { entry.distortion } else { held() },
        // A focal that is zoomed is its own.
        like: entry.like.filter(|_| turn.zoom == 0.0),
        principal_point_px: centre.or(entry.principal_point_px),
        image_circle_px: entry.image_circle_px,
    };
    (lens != LensEntry::default()).then_some(lens)
}

/// The height as it was found, as a belief.
fn height(old: &SiteCamera, camera: &Camera) -> Option<Known> {
    let sigma = camera.covariance.sigma(Covariance::Z);
    let found = sigma.map(|sigma| Known::prior(camera.position.z, sigma));
    old.height_m.filter(|height| height.fixed).or(found).or(old.height_m)
}

/// The place where it was found, and the yaw after the turn.
fn placement(old: &SiteCamera, now: &Camera) -> Option<PlacementEntry> {
    let is_placed = old.solution.as_ref().is_some_and(|solution| solution.stage > Stage::Partial);
    let scale = Some(now.position.z / STAGE_1_HEIGHT);
    let (fixed, held) = old.placement.as_ref().map_or_else(Default::default, |own| (own.fixed, own.held));
    let place = || PlacementEntry {
        move_m: now.position.on_floor(),
        turn_deg: now.yaw.to_degrees(),
        scale,
        fixed,
        held,
    };
    if is_placed { Some(place()) } else { old.placement.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A new still that shows no point of the old one.
    struct Strange;

    impl Carrier for Strange {
        fn line(&self, _: &[Pixel], _: bool) -> Option<Vec<Pixel>> {
            None
        }

        fn point(&self, _: Pixel) -> Option<Pixel> {
            None
        }

        fn corner(&self, _: Pixel) -> Option<Pixel> {
            None
        }
    }

    #[test]
    fn what_the_newest_still_shares_stays_when_an_older_period_is_recovered() {
        let change = "2026-06-01T00:00:00Z";
        let solution = json!({
            "method": "given", "stage": "placed", "position_m": [0, 0, 3], "yaw_deg": 0, "pitch_deg": 30,
            "roll_deg": 1, "focal_px": 1200, "principal_point_px": [960, 540],
        });
        let camera = |id: &str, key: &str| json!({"id": id, "size_px": [1920, 1080], "image": key, key: change, "solution": solution});
        let seen = |id: &str| json!({"camera": id, "px": [900, 800]});
        let document = json!({
            "format": "calib-site", "version": 1,
            "cameras": [camera("a", "valid_from"), camera("b", "valid_from"), camera("a", "valid_to")],
            "links": [{"seen": [seen("a"), seen("b")]}],
        });
        let site = Site::from_json(&document.to_string()).unwrap();
        let still = NewStill { image: "later".into(), since: "2026-05-01T00:00:00Z".into() };
        let recovered = |index| site.recovered(index, &Turn::default(), &Strange, &still).unwrap();
        assert_eq!(recovered(2).site.links, site.links);
        assert!(recovered(2).left_out.is_empty());
        assert_ne!(recovered(0).site.links, site.links, "its own still shows the point no more");
    }
}
