//! Recovery of a camera that was rotated or zoomed. The camera gets a new entry with the annotations
//! transferred to the new image. The validity of the old calibration ends where the new one begins.
//!
//! Links and marks refer to the first entry of an id, so from now on they belong to the new image. The
//! solution of the old period is therefore kept: a new solution of the old period would lack these links and
//! marks.
//!
//! The annotations are transferred as new evidence. The height of the old solution becomes a prior, and its position
//! and rotated yaw become the placement. The old pitch, roll and focal length are not used, because the same lines
//! determine them and would be counted twice.
//!
//! An image that shows a window of the old one (digital zoom or crop) keeps all annotations, also those outside the
//! window. They are the same evidence, so the new solution is the old one.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::document::{ControlPointEntry, LensEntry, PlacementEntry, Site, SiteCamera};
use crate::document::{Link, LinkObservation, Mark};
use crate::lens_window::WindowMap;
use crate::pixel_aspect::PixelAspectEntry;
use crate::principal_point::PrincipalPointEntry;
use crate::solution::{DistortionEntry, Method, Solution, Stage};
use calib_core::camera::RotationZoom;
use calib_core::camera::{Camera, Covariance, Pixel};
use calib_core::floor::STAGE_1_HEIGHT;
use calib_core::single::{Annotation, Known, Prior, Shape, line_name};

/// Transfer of image points from the old image to the new one.
pub trait ImageTransfer {
    /// Transfers a line along its edge; `None` if the new image does not show it. With `whole`, only a
    /// complete line is accepted.
    fn line(&self, points: &[Pixel], whole: bool) -> Option<Vec<Pixel>>;
    /// Transfers a point with the same appearance; `None` if the new image shows something else there.
    fn point(&self, old: Pixel) -> Option<Pixel>;
    /// Transfers a corner of a polygon, independently of the content of the new image; `None` outside the
    /// lens.
    fn corner(&self, old: Pixel) -> Option<Pixel>;
}

/// Image of the new entry, and the start of its validity.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NewImage {
    /// Path or URI of the image, as in the site file.
    pub image: String,
    /// Start of validity (RFC 3339).
    pub since: String,
}

/// Site with a new, unsolved validity period of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recovered {
    /// Site with the new entry at the index of the old one. The old entry is moved to the end.
    pub site: Site,
    /// Names of the lines, control points, and observations of links and marks that could not be transferred.
    pub left_out: Vec<String>,
    /// Number of transferred lines, control points, and observations of links and marks.
    pub carried: usize,
}

impl Site {
    /// Splits the entry of a rotated or zoomed camera into two periods: before and after the change. `turn`
    /// is the change, `by` transfers the annotations, and `still` is the new image.
    ///
    /// Returns `None` for a camera that is not solved.
    #[must_use]
    pub fn recovered(
        &self,
        index: usize,
        turn: &RotationZoom,
        by: &dyn ImageTransfer,
        still: &NewImage,
    ) -> Option<Recovered> {
        let old = self.cameras.get(index)?;
        let camera = old.camera()?;
        let mut work = Transfer { by, left_out: Vec::new(), carried: 0 };
        let mut site = self.clone();
        // Links and marks belong to the newest period only.
        if self.owns_links(index) {
            site.links.iter_mut().enumerate().for_each(|(i, link)| work.transfer_link(link, i, &old.id));
            site.marks.iter_mut().enumerate().for_each(|(i, mark)| work.transfer_mark(mark, i, &old.id));
        }
        let new = work.transfer_camera(old, &camera, turn, still);
        site.cameras.push(end_period(old, &still.since));
        site.cameras[index] = new;
        Some(Recovered { site, left_out: work.left_out, carried: work.carried })
    }
}

impl Site {
    /// Splits the entry of a camera whose new image shows a window of the old image. `size` is the width and height
    /// of the new image, and `map` maps pixels of the old image to the new one.
    ///
    /// Returns `None` for a camera that is not solved.
    #[must_use]
    pub fn windowed(
        &self,
        index: usize,
        map: &WindowMap,
        size: [u32; 2],
        still: &NewImage,
    ) -> Option<Recovered> {
        let old = self.cameras.get(index)?;
        let camera = old.camera()?;
        let mut recovered = self.recovered(index, &RotationZoom::default(), map, still)?;
        let site = &mut recovered.site;
        // The standard deviation of a click is 1 pixel if none is entered.
        let usual = if old.sigma_px.is_none() { Some(1.0) } else { None };
        let scale = |sigma: &mut Option<f64>| *sigma = sigma.or(usual).map(|sigma| map.scale[0] * sigma);
        if self.owns_links(index) {
            let seen = site.links.iter_mut().flat_map(|link| &mut link.seen);
            seen.filter(|seen| seen.camera == old.id).for_each(|seen| scale(&mut seen.sigma_px));
        }
        let new = &mut site.cameras[index];
        new.annotations.iter_mut().for_each(|drawn| scale(&mut drawn.sigma_px));
        new.control_points.iter_mut().for_each(|point| scale(&mut point.sigma_px));
        new.sigma_px = old.sigma_px.map(|sigma| map.scale[0] * sigma);
        new.size_px = size;
        new.lens = self.lens_of_window(old, &camera, map, size);
        new.height_m = old.height_m;
        let is_visible = |at: &Pixel| {
            (0.0..=f64::from(size[0])).contains(&at.u) && (0.0..=f64::from(size[1])).contains(&at.v)
        };
        new.efov_px = new.efov_px.take().filter(|corners| corners.iter().all(is_visible));
        Some(recovered)
    }

    /// Returns the lens entry of a camera whose new image shows a window. All values except the window belong
    /// to the calibrated image.
    fn lens_of_window(
        &self,
        old: &SiteCamera,
        camera: &Camera,
        map: &WindowMap,
        size: [u32; 2],
    ) -> Option<LensEntry> {
        let entry = old.lens.clone().unwrap_or_default();
        let before = entry.window_px.map(|window| WindowMap::new(window, old.size_px));
        let window = before.map_or(*map, |before| map.after(&before)).window(size);
        if before.is_some() {
            return Some(LensEntry { window_px: Some(window), ..entry });
        }
        // The centre of the calibrated image does not follow from the window.
        let centre = || {
            let prior = self.principal_point_prior(old, &camera.lens);
            let known = PrincipalPointEntry::known(old.principal_point());
            prior.map_or(known, |prior| PrincipalPointEntry { value: prior.value, sigma: Some(prior.sigma) })
        };
        let is_shared = entry.like.is_some();
        let held = || DistortionEntry::from_lens(&camera.lens, camera.focal);
        let shared_focal =
            || Known { value: camera.focal, fixed: false, sigma: camera.covariance.sigma(Covariance::FOCAL) };
        let focal_px = entry.focal_px.or_else(|| old.data_sheet_focal(&camera.lens));
        Some(LensEntry {
            focal_px: if is_shared { focal_px.or_else(|| Some(shared_focal())) } else { focal_px },
            roll_deg: entry.roll_deg,
            pitch_deg: entry.pitch_deg,
            principal_point_px: entry.principal_point_px.or_else(|| Some(centre())),
            pixel_aspect: entry.pixel_aspect,
            image_circle_px: entry.image_circle_px,
            distortion: if is_shared { held() } else { entry.distortion },
            window_px: Some(window),
            ..LensEntry::default()
        })
    }
}

/// Maps all pixels, also those outside the window.
impl ImageTransfer for WindowMap {
    fn line(&self, points: &[Pixel], _: bool) -> Option<Vec<Pixel>> {
        Some(points.iter().map(|&point| self.pixel(point)).collect())
    }

    fn point(&self, old: Pixel) -> Option<Pixel> {
        Some(self.pixel(old))
    }

    fn corner(&self, old: Pixel) -> Option<Pixel> {
        Some(self.pixel(old))
    }
}

/// Ends the period of an entry at `since` and keeps its solution, so that solving does not recompute it.
fn end_period(old: &SiteCamera, since: &str) -> SiteCamera {
    let solution = old.solution.clone().map(|solution| {
        let method = if solution.method.is_entered() { solution.method } else { Method::Kept };
        Solution { method, ..solution }
    });
    SiteCamera { valid_to: Some(since.to_owned()), solution, ..old.clone() }
}

/// Running transfer of one camera: the number of transferred items, and the names of the missing ones.
struct Transfer<'a> {
    by: &'a dyn ImageTransfer,
    left_out: Vec<String>,
    carried: usize,
}

impl Transfer<'_> {
    /// Creates the entry of the camera for the new image.
    fn transfer_camera(
        &mut self,
        old: &SiteCamera,
        camera: &Camera,
        turn: &RotationZoom,
        still: &NewImage,
    ) -> SiteCamera {
        let annotations = self.transfer_annotations(&old.annotations);
        let mut control_points = old.control_points.clone();
        let mut index = 0..;
        control_points.retain_mut(|point: &mut ControlPointEntry| {
            let name = point.label(index.next().unwrap_or_default());
            self.transfer_pixel(&mut point.px, || format!("control point {name}"))
        });
        let straight =
            |annotations: &[Annotation]| annotations.iter().filter(|a| a.is_straight_edge()).count();
        let refits = straight(&annotations) > 0 && straight(&annotations) == straight(&old.annotations);
        SiteCamera {
            image: Some(still.image.clone()),
            lens: lens(old, camera, turn, refits),
            height_m: height(old, camera),
            annotations,
            efov_px: self.transfer_polygon(old.efov_px.as_deref()),
            placement: placement(old, &turn.apply_to(camera)),
            control_points,
            valid_from: Some(still.since.clone()),
            solution: None,
            error: None,
            ..old.clone()
        }
    }

    /// Transfers all annotations of an image. Annotations that the new image does not show are left out.
    fn transfer_annotations(&mut self, old: &[Annotation]) -> Vec<Annotation> {
        let carried = old.iter().enumerate().filter_map(|(index, annotation)| {
            let mut segment = 0;
            let mut line = |points: &[Pixel], whole: bool| {
                segment += 1;
                self.count_transfer(self.by.line(points, whole), || line_name(old, index, segment - 1))
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

    /// Transfers the observations of a mark. Observations that the new image does not show are removed.
    fn transfer_mark(&mut self, mark: &mut Mark, index: usize, camera: &str) {
        let name = mark.id.clone().unwrap_or_else(|| index.to_string());
        mark.seen.retain_mut(|seen| {
            seen.camera != camera
                || self.transfer_pixel(&mut seen.px, || format!("mark {name} {}", seen.point))
        });
    }

    /// Transfers the observations of a link. Observations that the new image does not show are removed.
    fn transfer_link(&mut self, link: &mut Link, index: usize, camera: &str) {
        let name = link.id.clone().unwrap_or_else(|| index.to_string());
        link.seen.retain_mut(|seen| {
            if seen.camera != camera {
                return true;
            }
            let moved = self.transfer_observation(seen);
            let moved = self.count_transfer(moved, || format!("link {name}"));
            moved.map(|moved| *seen = moved).is_some()
        });
    }

    /// Transfers all pixels of an observation; `None` if the new image does not show all pixels.
    fn transfer_observation(&self, seen: &LinkObservation) -> Option<LinkObservation> {
        let point = |at: Option<Pixel>| at.map_or(Some(None), |at| self.by.point(at).map(Some));
        let segment = match &seen.segment {
            Some(segment) => Some(self.by.line(segment, false)?),
            None => None,
        };
        Some(LinkObservation {
            camera: seen.camera.clone(),
            px: point(seen.px)?,
            foot: point(seen.foot)?,
            head: point(seen.head)?,
            segment,
            sigma_px: seen.sigma_px,
        })
    }

    /// Replaces a pixel of the old image by its position in the new image. Returns whether the new image
    /// shows the pixel.
    fn transfer_pixel(&mut self, pixel: &mut Pixel, name: impl FnOnce() -> String) -> bool {
        let moved = self.by.point(*pixel);
        self.count_transfer(moved, name).map(|moved| *pixel = moved).is_some()
    }

    /// Transfers the EFOV polygon; `None` without a polygon, or if a corner is outside the lens.
    fn transfer_polygon(&self, old: Option<&[Pixel]>) -> Option<Vec<Pixel>> {
        let corners: Option<Vec<Pixel>> = old?.iter().map(|&corner| self.by.corner(corner)).collect();
        corners.filter(|corners| corners.len() > 2)
    }

    /// Counts a transferred item, or records the name of a missing one.
    fn count_transfer<T>(&mut self, carried: Option<T>, name: impl FnOnce() -> String) -> Option<T> {
        match &carried {
            Some(_) => self.carried += 1,
            None => self.left_out.push(name()),
        }
        carried
    }
}

/// Function that transfers a line. If the flag is set, only a complete line is accepted.
type TransferLine<'a> = dyn FnMut(&[Pixel], bool) -> Option<Vec<Pixel>> + 'a;

/// Transfers the segments of an annotation. Returns `None` if no segment remains and no other annotation can refer to
/// this one. Also returns `None` for a right angle without its first segment.
fn segments(annotation: &Annotation, line: &mut TransferLine<'_>) -> Option<Annotation> {
    let row = annotation.kind.row();
    // A part of a segment does not have the known length.
    let is_length = row.constraint == calib_core::single::ConstraintKind::Length;
    let carried: Vec<Option<Vec<Pixel>>> =
        annotation.segments.iter().flatten().map(|points| line(points, is_length)).collect();
    let is_of_first = row.constraint == calib_core::single::ConstraintKind::RightAngle;
    let is_usable = !is_of_first || carried.first().is_some_and(Option::is_some);
    let carried: Vec<Vec<Pixel>> = carried.into_iter().flatten().collect();
    // An annotation with an id is kept, even without segments, because others may refer to it.
    let is_named = annotation.id.is_some() && !is_of_first;
    (is_usable && (!carried.is_empty() || is_named))
        .then(|| Annotation { segments: Some(carried), ..annotation.clone() })
}

/// Returns the known lens values after the rotation and zoom. `refits` is whether all straight edges were
/// transferred. If so, a fitted distortion is fitted again. Otherwise the old distortion is fixed, because a rotation
/// and a zoom do not change it in pixels.
fn lens(old: &SiteCamera, camera: &Camera, turn: &RotationZoom, refits: bool) -> Option<LensEntry> {
    let movement = turn.pan_tilt_zoom(camera);
    let scaled = |known: Known| {
        let ratio = turn.zoom.exp();
        Known { value: ratio * known.value, sigma: known.sigma.map(|sigma| ratio * sigma), ..known }
    };
    let shifted = |by: f64| move |known: Known| Known { value: known.value + by.to_degrees(), ..known };
    let entry = old.lens_of_image().map(Cow::into_owned).unwrap_or_default();
    let is_sought =
        |distortion: &DistortionEntry| distortion.fit.is_some() || distortion.distortion().is_none();
    let is_fitted = refits && entry.distortion.as_ref().is_none_or(is_sought);
    // The principal point of a fisheye was fitted to its edges.
    let centre = || PrincipalPointEntry {
        value: camera.lens.principal_point,
        sigma: camera.covariance.sigma(Covariance::CENTRE),
    };
    let is_estimated = camera.lens.distortion.is_wide() || centre().sigma.is_some();
    let centre = (!is_fitted && is_estimated).then(centre);
    let aspect = camera.covariance.sigma(Covariance::ASPECT);
    let aspect =
        aspect.map(|sigma| PixelAspectEntry::Prior(Prior { value: camera.lens.pixel_aspect, sigma }));
    let held = || {
        let of = DistortionEntry::from_lens(&camera.lens, camera.focal)?;
        Some(DistortionEntry { focal_px: Some(of.focal_px.unwrap_or(camera.focal)), ..of })
    };
    let lens = LensEntry {
        // A data sheet does not contain the zoom.
        focal_px: entry.focal_px.or_else(|| old.data_sheet_focal(&camera.lens)).map(scaled),
        roll_deg: entry.roll_deg.map(shifted(movement.roll)),
        pitch_deg: entry.pitch_deg.map(shifted(movement.tilt)),
        distortion: if is_fitted { entry.distortion } else { held() },
        // After a zoom, the camera has its own focal length.
        like: entry.like.filter(|_| turn.zoom == 0.0),
        principal_point_px: centre.or(entry.principal_point_px),
        pixel_aspect: aspect.or(entry.pixel_aspect),
        image_circle_px: entry.image_circle_px,
        ..LensEntry::default()
    };
    (lens != LensEntry::default()).then_some(lens)
}

/// Returns the entered height if it is fixed, otherwise a prior from the old solution. If the solution has no
/// standard deviation of the height, the entered height is returned.
fn height(old: &SiteCamera, camera: &Camera) -> Option<Known> {
    let sigma = camera.covariance.sigma(Covariance::Z);
    let found = sigma.map(|sigma| Known::prior(camera.position.z, sigma));
    old.height_m.filter(|height| height.fixed).or(found).or(old.height_m)
}

/// Returns the placement of a placed camera from its old position and its yaw after the rotation. Otherwise
/// the entered placement is kept.
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
        estimated: false,
    };
    if is_placed { Some(place()) } else { old.placement.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Transfer to an image that shows no point of the old one.
    struct EmptyTransfer;

    impl ImageTransfer for EmptyTransfer {
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
    fn recovering_an_older_period_keeps_links_of_the_newest() {
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
        let still = NewImage { image: "later".into(), since: "2026-05-01T00:00:00Z".into() };
        let recovered =
            |index| site.recovered(index, &RotationZoom::default(), &EmptyTransfer, &still).unwrap();
        assert_eq!(recovered(2).site.links, site.links);
        assert!(recovered(2).left_out.is_empty());
        assert_ne!(recovered(0).site.links, site.links, "the new image does not show the point");
    }
}
