//! Whether what is drawn on a camera lies in its image.
//!
//! An end of a line or a corner of a field of view may be dragged a little beyond the border, and so may all points
//! of a drawing that keeps to it. Something is to be said once a point is farther out than [`BORDER`]; then all that
//! lie outside are counted. What is drawn is of another image
//!
//! - where more than half of it lies outside, or
//! - where u and v exchanged would put all of it inside, and at least every eighth point, two or more, lies
//!   outside. Of points all over an image with sides of 16 and 9 that were exchanged, 7 of 16 do.
//!
//! Width and height exchanged look the same as u and v exchanged.
//!
//! Which links and marks cameras show: looked up once for all of them.

use std::collections::BTreeMap;

use calib_core::camera::Pixel;
use calib_core::outcome::{Finding, Subject};

use crate::document::{Site, SiteCamera};

/// What cameras share, by the ids of the cameras that show it.
#[derive(Debug)]
pub(crate) struct SharedDrawings<'a>(BTreeMap<&'a str, OfCamera>);

/// What cameras of one id show; what is switched off does not count.
#[derive(Clone, Debug, Default)]
struct OfCamera {
    /// The first entry of this id, whatever its period.
    first: Option<usize>,
    links: Vec<usize>,
    marks: Vec<usize>,
}

impl<'a> SharedDrawings<'a> {
    /// Of these cameras of a site.
    pub(crate) fn of(site: &Site, cameras: &[&'a SiteCamera]) -> Self {
        // Few ids are found fast among few: one camera is solved by itself while an operator draws.
        let mut of: BTreeMap<&str, OfCamera> =
            cameras.iter().map(|camera| (camera.id.as_str(), OfCamera::default())).collect();
        for (index, camera) in site.cameras.iter().enumerate() {
            if let Some(own) = of.get_mut(camera.id.as_str()) {
                own.first.get_or_insert(index);
            }
        }
        for (index, link) in site.links.iter().enumerate().filter(|(_, link)| !link.off) {
            for seen in &link.seen {
                of.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push(&mut own.links, index));
            }
        }
        for (index, mark) in site.marks.iter().enumerate().filter(|(_, mark)| !mark.off) {
            for seen in &mark.seen {
                of.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push(&mut own.marks, index));
            }
        }
        Self(of)
    }

    /// The first entry of this id in the site, whatever its period.
    pub(crate) fn first<'b>(&self, site: &'b Site, id: &str) -> Option<&'b SiteCamera> {
        self.0.get(id)?.first.map(|index| &site.cameras[index])
    }

    /// Links that cameras of this id show, by their indices.
    pub(crate) fn links(&self, id: &str) -> &[usize] {
        self.0.get(id).map_or(&[], |own| &own.links)
    }

    /// Marks that cameras of this id show, by their indices.
    pub(crate) fn marks(&self, id: &str) -> &[usize] {
        self.0.get(id).map_or(&[], |own| &own.marks)
    }
}

/// Adds an index that is not the last already.
fn push(to: &mut Vec<usize>, index: usize) {
    if to.last() != Some(&index) {
        to.push(index);
    }
}

/// How far beyond the border something may be drawn, in lengths of the longer side.
const BORDER: f64 = 0.05;

impl Site {
    /// Points that are drawn on a camera, or tied to it, and lie outside its image; what is switched off does not
    /// count.
    #[must_use]
    pub fn points_outside(&self, entry: &SiteCamera) -> Option<Finding> {
        self.shared_points_outside(entry, &SharedDrawings::of(self, &[entry]))
    }

    /// The same, with what cameras share looked up already.
    pub(crate) fn shared_points_outside(
        &self,
        entry: &SiteCamera,
        shared: &SharedDrawings,
    ) -> Option<Finding> {
        let points = self.drawn_on(entry, shared);
        let [width, height] = entry.size();
        let is_far = |pixel: &Pixel| beyond(pixel, [width, height]) > BORDER * width.max(height);
        if !points.iter().any(|(_, pixel)| is_far(pixel)) {
            return None;
        }
        let is_outside = |pixel: &Pixel| beyond(pixel, [width, height]) > 0.0;
        let outside: Vec<Subject> =
            points.iter().filter(|(_, pixel)| is_outside(pixel)).map(|(subject, _)| *subject).collect();
        let (count, drawn) = (outside.len(), points.len());
        let fits_exchanged = points.iter().all(|(_, pixel)| beyond(pixel, [height, width]) <= 0.0);
        let is_other_image = 2 * count > drawn || fits_exchanged && count > 1 && 8 * count >= drawn;
        let first = outside.first().copied().unwrap_or(Subject::Efov);
        let (size, outside) = (entry.size_px, count);
        Some(Finding::PointsOutside { outside, drawn, size, fits_exchanged, is_other_image, first })
    }

    /// Every pixel that is drawn on a camera, and what it is of. Of a camera with several periods what cameras share is
    /// drawn on the first.
    fn drawn_on(&self, entry: &SiteCamera, shared: &SharedDrawings) -> Vec<(Subject, Pixel)> {
        let mut points = entry.drawn();
        if shared.first(self, &entry.id) != Some(entry) {
            return points;
        }
        for &index in shared.links(&entry.id) {
            for seen in self.links[index].seen.iter().filter(|seen| seen.camera == entry.id) {
                let ends = [seen.px, seen.foot, seen.head].into_iter().flatten();
                let all = ends.chain(seen.segment.iter().flatten().copied());
                points.extend(all.map(|pixel| (Subject::Link(index), pixel)));
            }
        }
        for &index in shared.marks(&entry.id) {
            let seen = self.marks[index].seen.iter().filter(|seen| seen.camera == entry.id);
            points.extend(seen.map(|seen| (Subject::Mark(index), seen.px)));
        }
        points
    }
}

impl SiteCamera {
    /// Every pixel of its annotations, control points and field of view, and what it is of.
    fn drawn(&self) -> Vec<(Subject, Pixel)> {
        let annotations = self.annotations.iter().enumerate().filter(|(_, annotation)| !annotation.off);
        let lines = annotations.flat_map(|(index, annotation)| {
            let points = annotation.polylines().flatten();
            points.map(move |pixel| (Subject::Annotation(index), pixel))
        });
        let control_points = self.control_points.iter().enumerate().filter(|(_, point)| !point.off);
        let control_points = control_points.map(|(index, point)| (Subject::OwnControlPoint(index), point.px));
        let efov = self.efov_px.iter().flatten().map(|&pixel| (Subject::Efov, pixel));
        lines.chain(control_points).chain(efov).collect()
    }
}

/// How far a pixel is beyond the border of an image, in pixels; not above 0 inside.
fn beyond(pixel: &Pixel, [width, height]: [f64; 2]) -> f64 {
    let past = |value: f64, side: f64| (-value).max(value - side);
    past(pixel.u, width).max(past(pixel.v, height))
}

#[cfg(test)]
mod tests {
    use calib_core::outcome::Code;
    use calib_core::single::{Annotation, Kind};

    use super::*;
    use crate::document::{Link, LinkKind, LinkSeen};

    /// Points all over an image of 1920 x 1080 pixels.
    const POINTS: [[f64; 2]; 8] = [
        [120.0, 80.0],
        [1800.0, 90.0],
        [1500.0, 1000.0],
        [300.0, 950.0],
        [960.0, 500.0],
        [1400.0, 300.0],
        [700.0, 700.0],
        [1700.0, 600.0],
    ];

    fn site(size: [u32; 2], points: &[[f64; 2]]) -> Site {
        let mut camera = SiteCamera::new("door", size);
        let segments = points.chunks(2).map(|ends| ends.iter().copied().map(Pixel::from).collect()).collect();
        camera.annotations.push(Annotation::of_segments(Kind::Vertical, segments));
        Site { cameras: vec![camera], ..Site::new() }
    }

    fn found(site: &Site) -> Option<(Code, usize, usize)> {
        let finding = site.points_outside(&site.cameras[0])?;
        let Finding::PointsOutside { outside, drawn, .. } = finding else { unreachable!("another finding") };
        Some((finding.code(), outside, drawn))
    }

    #[test]
    fn coordinates_that_are_exchanged_are_of_another_image() {
        assert_eq!(found(&site([1920, 1080], &POINTS)), None);
        let exchanged = POINTS.map(|[u, v]| [v, u]);
        assert_eq!(found(&site([1920, 1080], &exchanged)), Some((Code::NotThisImage, 4, 8)));
        assert_eq!(found(&site([1080, 1920], &POINTS)), Some((Code::NotThisImage, 4, 8)));
        let finding = site([1080, 1920], &POINTS);
        let finding = finding.points_outside(&finding.cameras[0]);
        assert!(matches!(finding, Some(Finding::PointsOutside { fits_exchanged: true, .. })), "{finding:?}");
    }

    #[test]
    fn points_of_a_larger_still_are_of_another_image() {
        let larger = POINTS.map(|[u, v]| [3.0 * u, 3.0 * v]);
        assert_eq!(found(&site([1920, 1080], &larger)), Some((Code::NotThisImage, 7, 8)));
    }

    #[test]
    fn what_is_dragged_off_the_border_may_be_and_what_is_far_off_is_noted() {
        let mut points = POINTS;
        points[3] = [-90.0, 1120.0];
        points[2] = [1990.0, 1080.0];
        assert_eq!(found(&site([1920, 1080], &points)), None);
        points[3] = [-100.0, 1120.0];
        assert_eq!(found(&site([1920, 1080], &points)), Some((Code::PointsOutside, 2, 8)));
        let mut off = site([1920, 1080], &points);
        off.cameras[0].annotations[0].off = true;
        assert_eq!(found(&off), None, "switched off");
    }

    #[test]
    fn fields_of_view_and_what_cameras_share_count() {
        let mut site = site([1920, 1080], &POINTS);
        site.cameras[0].efov_px = Some(vec![Pixel::new(0.0, 0.0), Pixel::new(5000.0, 10.0)]);
        let seen = LinkSeen { px: Some(Pixel::new(0.0, 4000.0)), ..LinkSeen::new("door") };
        site.links.push(Link::new(None, LinkKind::Point, vec![seen]));
        assert_eq!(found(&site), Some((Code::PointsOutside, 2, 11)));
    }

    #[test]
    fn a_camera_without_a_result_says_that_its_drawing_is_of_another_image() {
        let report = site([1080, 1920], &POINTS).calibrate(&crate::Options::default());
        let failure = report.cameras[0].1.as_ref().unwrap_err();
        assert!(failure.message.contains("With u and v exchanged"), "{}", failure.message);
        assert!(failure.advice.contains("size_px"), "{}", failure.advice);
    }
}
