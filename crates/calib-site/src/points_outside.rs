//! Check that the annotations of a camera are inside its image.
//!
//! Ends of lines and corners of a field of view may extend slightly beyond the border. A finding is reported
//! only if a point is farther outside than [`MAX_BORDER_EXCESS`]. All points outside are then counted. The
//! annotations belong to another image
//!
//! - if more than half of the points are outside, or
//! - if all points would be inside with u and v exchanged, and at least two points and one in eight are
//!   outside. For points spread over a 16:9 image, exchanging u and v moves 7 of 16 outside.
//!
//! Exchanged width and height have the same effect as exchanged u and v.
//!
//! The file also contains the index of links and marks by camera.

use std::collections::BTreeMap;

use calib_core::camera::Pixel;
use calib_core::outcome::{Finding, Subject};

use crate::document::{Site, SiteCamera};

/// Links and marks by the id of the cameras that observe them.
#[derive(Debug)]
pub(crate) struct SharedObservations<'a>(BTreeMap<&'a str, CameraObservations>);

/// Indices of the links and marks that cameras with one id observe. Links and marks that are switched off are
/// not included.
#[derive(Clone, Debug, Default)]
struct CameraObservations {
    /// Index of the first entry with this id, independently of its validity period.
    first: Option<usize>,
    links: Vec<usize>,
    marks: Vec<usize>,
}

impl<'a> SharedObservations<'a> {
    /// Builds the index for some cameras of a site.
    pub(crate) fn new(site: &Site, cameras: &[&'a SiteCamera]) -> Self {
        // The map has only the requested ids: while an operator annotates, it is built for a single camera.
        let mut of: BTreeMap<&str, CameraObservations> =
            cameras.iter().map(|camera| (camera.id.as_str(), CameraObservations::default())).collect();
        for (index, camera) in site.cameras.iter().enumerate() {
            if let Some(own) = of.get_mut(camera.id.as_str()) {
                own.first.get_or_insert(index);
            }
        }
        for (index, link) in site.links.iter().enumerate().filter(|(_, link)| !link.off) {
            for seen in &link.seen {
                of.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push_once(&mut own.links, index));
            }
        }
        for (index, mark) in site.marks.iter().enumerate().filter(|(_, mark)| !mark.off) {
            for seen in &mark.seen {
                of.get_mut(seen.camera.as_str()).into_iter().for_each(|own| push_once(&mut own.marks, index));
            }
        }
        Self(of)
    }

    /// Returns the first entry with this id in the site, independently of its validity period.
    pub(crate) fn first<'b>(&self, site: &'b Site, id: &str) -> Option<&'b SiteCamera> {
        self.0.get(id)?.first.map(|index| &site.cameras[index])
    }

    /// Returns the indices of the links that cameras with this id observe.
    pub(crate) fn links(&self, id: &str) -> &[usize] {
        self.0.get(id).map_or(&[], |own| &own.links)
    }

    /// Returns the indices of the marks that cameras with this id observe.
    pub(crate) fn marks(&self, id: &str) -> &[usize] {
        self.0.get(id).map_or(&[], |own| &own.marks)
    }
}

/// Appends an index to a list, unless it is already the last item.
fn push_once(to: &mut Vec<usize>, index: usize) {
    if to.last() != Some(&index) {
        to.push(index);
    }
}

/// Largest accepted distance beyond the border, relative to the longer side of the image.
const MAX_BORDER_EXCESS: f64 = 0.05;

impl Site {
    /// Reports points of a camera's annotations, control points, field of view, links and marks that are
    /// outside its image. Items that are switched off are ignored.
    #[must_use]
    pub fn points_outside(&self, entry: &SiteCamera) -> Option<Finding> {
        self.shared_points_outside(entry, &SharedObservations::new(self, &[entry]))
    }

    /// Reports points outside the image like [`Self::points_outside`], with an existing index of links and
    /// marks.
    pub(crate) fn shared_points_outside(
        &self,
        entry: &SiteCamera,
        shared: &SharedObservations,
    ) -> Option<Finding> {
        // The image of a window does not show all of the calibrated image, in which lines may have been annotated.
        if entry.lens.as_ref().is_some_and(|lens| lens.window_px.is_some()) {
            return None;
        }
        let points = self.annotated_pixels(entry, shared);
        let [width, height] = entry.size();
        let is_far =
            |pixel: &Pixel| px_beyond_border(pixel, [width, height]) > MAX_BORDER_EXCESS * width.max(height);
        if !points.iter().any(|(_, pixel)| is_far(pixel)) {
            return None;
        }
        let is_outside = |pixel: &Pixel| px_beyond_border(pixel, [width, height]) > 0.0;
        let outside: Vec<Subject> =
            points.iter().filter(|(_, pixel)| is_outside(pixel)).map(|(subject, _)| *subject).collect();
        let (count, drawn) = (outside.len(), points.len());
        let fits_exchanged = points.iter().all(|(_, pixel)| px_beyond_border(pixel, [height, width]) <= 0.0);
        let is_other_image = 2 * count > drawn || fits_exchanged && count > 1 && 8 * count >= drawn;
        let first = outside.first().copied().unwrap_or(Subject::Efov);
        let (size, outside) = (entry.size_px, count);
        Some(Finding::PointsOutside { outside, total: drawn, size, fits_exchanged, is_other_image, first })
    }

    /// Returns every annotated pixel of a camera, with its subject. For a camera with several periods, links
    /// and marks belong to the first entry.
    fn annotated_pixels(&self, entry: &SiteCamera, shared: &SharedObservations) -> Vec<(Subject, Pixel)> {
        let mut points = entry.own_pixels();
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
    /// Returns every pixel of the annotations, control points and field of view, with its subject.
    fn own_pixels(&self) -> Vec<(Subject, Pixel)> {
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

/// Returns the distance of a pixel beyond the border of an image, in pixels; zero or negative inside.
fn px_beyond_border(pixel: &Pixel, [width, height]: [f64; 2]) -> f64 {
    let past = |value: f64, side: f64| (-value).max(value - side);
    past(pixel.u, width).max(past(pixel.v, height))
}

#[cfg(test)]
mod tests {
    use calib_core::outcome::Code;
    use calib_core::single::{Annotation, Kind};

    use super::*;
    use crate::document::{Link, LinkKind, LinkObservation};

    /// Points spread over an image of 1920 x 1080 pixels.
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
        camera.annotations.push(Annotation::from_segments(Kind::Vertical, segments));
        Site { cameras: vec![camera], ..Site::new() }
    }

    fn found(site: &Site) -> Option<(Code, usize, usize)> {
        let finding = site.points_outside(&site.cameras[0])?;
        let Finding::PointsOutside { outside, total: drawn, .. } = finding else {
            unreachable!("another finding")
        };
        Some((finding.code(), outside, drawn))
    }

    #[test]
    fn exchanged_coordinates_are_reported_as_another_image() {
        assert_eq!(found(&site([1920, 1080], &POINTS)), None);
        let exchanged = POINTS.map(|[u, v]| [v, u]);
        assert_eq!(found(&site([1920, 1080], &exchanged)), Some((Code::NotThisImage, 4, 8)));
        assert_eq!(found(&site([1080, 1920], &POINTS)), Some((Code::NotThisImage, 4, 8)));
        let finding = site([1080, 1920], &POINTS);
        let finding = finding.points_outside(&finding.cameras[0]);
        assert!(matches!(finding, Some(Finding::PointsOutside { fits_exchanged: true, .. })), "{finding:?}");
    }

    #[test]
    fn points_of_a_larger_image_are_reported_as_another_image() {
        let larger = POINTS.map(|[u, v]| [3.0 * u, 3.0 * v]);
        assert_eq!(found(&site([1920, 1080], &larger)), Some((Code::NotThisImage, 7, 8)));
    }

    #[test]
    fn points_slightly_outside_are_accepted_and_points_far_outside_are_reported() {
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
    fn field_of_view_and_link_points_are_counted() {
        let mut site = site([1920, 1080], &POINTS);
        site.cameras[0].efov_px = Some(vec![Pixel::new(0.0, 0.0), Pixel::new(5000.0, 10.0)]);
        let seen = LinkObservation { px: Some(Pixel::new(0.0, 4000.0)), ..LinkObservation::new("door") };
        site.links.push(Link::new(None, LinkKind::Point, vec![seen]));
        assert_eq!(found(&site), Some((Code::PointsOutside, 2, 11)));
    }

    #[test]
    fn failure_explains_that_annotations_belong_to_another_image() {
        let report = site([1080, 1920], &POINTS).calibrate(&crate::Options::default());
        let failure = report.cameras[0].1.as_ref().unwrap_err();
        assert!(failure.message.contains("With u and v swapped"), "{}", failure.message);
        assert!(failure.advice.contains("size_px"), "{}", failure.advice);
    }
}
