//! Search for the part of an image near the pointer. Independent of the user interface.

use std::collections::BTreeSet;

use calib_core::{Camera, Lens, Pixel, on_image};

use calib_core::floor::annotated_line_curve;

pub use calib_image::distance_to_segment;
use calib_site::{Site, SiteCamera};

/// Part of a camera's image that can be selected, moved and deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Part {
    /// Point of a line.
    Vertex {
        /// Index of the annotation.
        annotation: usize,
        /// Index of the line in the annotation.
        segment: usize,
        /// Index of the point in the line.
        vertex: usize,
    },
    /// Line of an annotation.
    Line {
        /// Index of the annotation.
        annotation: usize,
        /// Index of the line in the annotation.
        segment: usize,
    },
    /// Corner of the field of view, by its index.
    Corner(usize),
    /// Outline of the whole field of view.
    Field,
    /// Control point, by its index.
    Control(usize),
    /// Point of an observation of a link in this camera.
    Link {
        /// Index of the link.
        link: usize,
        /// Index of the observation.
        seen: usize,
        /// Index of the point in the observation.
        point: usize,
    },
    /// Corner of a mark that is pinned to a pixel of this camera.
    Pin {
        /// Index of the mark.
        mark: usize,
        /// Index of the observation.
        seen: usize,
    },
    /// Mark, by its index, visible in any view.
    Mark(usize),
}

/// Part that was found near the pointer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Part that was found.
    pub part: Part,
    /// Index of the edge under the pointer, which is the index of its first point. It is 0 for parts other
    /// than a line or the field of view.
    pub edge: usize,
    /// Distance from the pointer, in raw pixels.
    pub distance: f64,
}

/// Returns all movable points of a camera's image, each with its part, in the order of the Tab key.
pub fn handles(site: &Site, index: usize) -> Vec<(Part, Pixel)> {
    let Some(entry) = site.cameras.get(index) else { return Vec::new() };
    let mut list = Vec::new();
    for (annotation, drawn) in entry.annotations.iter().enumerate() {
        for (segment, line) in drawn.polylines().enumerate() {
            for (vertex, pixel) in line.into_iter().enumerate() {
                list.push((Part::Vertex { annotation, segment, vertex }, pixel));
            }
        }
    }
    let corners = entry.efov_px.iter().flatten().enumerate();
    list.extend(corners.map(|(corner, &pixel)| (Part::Corner(corner), pixel)));
    list.extend(entry.control_points.iter().enumerate().map(|(i, point)| (Part::Control(i), point.px)));
    if !site.owns_links(index) {
        return list;
    }
    for (link, drawn) in site.links.iter().enumerate() {
        for (seen, sight) in drawn.seen.iter().enumerate().filter(|(_, seen)| seen.camera == entry.id) {
            let points = sight.px.iter().chain(&sight.foot).chain(&sight.head);
            let points = points.chain(sight.segment.iter().flatten());
            list.extend(points.enumerate().map(|(point, &px)| (Part::Link { link, seen, point }, px)));
        }
    }
    for (mark, drawn) in site.marks.iter().enumerate() {
        let seen = drawn.seen.iter().enumerate().filter(|(_, seen)| seen.camera == entry.id);
        list.extend(seen.map(|(seen, sight)| (Part::Pin { mark, seen }, sight.px)));
    }
    list
}

/// Returns the point of an annotated line that a drawing tool moves if a drag starts at the raw pixel `at`. `radius` is
/// the search radius of the selection tool, in pixels. Drawing tools use a smaller radius, so that lines can begin near
/// others.
#[must_use]
pub fn line_point(site: &Site, index: usize, at: Pixel, radius: f64) -> Option<Part> {
    /// Search radius of drawing tools, as a fraction of the radius of the selection tool.
    const DRAWING_FRACTION: f64 = 0.6;
    let radius = DRAWING_FRACTION * radius;
    let points = handles(site, index).into_iter().filter(|(part, _)| matches!(part, Part::Vertex { .. }));
    let near = points.map(|(part, pixel)| (part, pixel.distance(at))).filter(|(_, off)| *off <= radius);
    near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(part, _)| part)
}

/// Returns the part at a raw pixel. Selected points have priority, then points, then marks, then lines.
/// `radius` is in raw pixels.
#[must_use]
pub fn pick(
    site: &Site,
    index: usize,
    pose: Option<&Camera>,
    at: Pixel,
    radius: f64,
    selected: &BTreeSet<Part>,
) -> Option<Hit> {
    let handles = handles(site, index);
    let near = handles.iter().map(|&(part, pixel)| Hit { part, edge: 0, distance: pixel.distance(at) });
    let near: Vec<Hit> = near.filter(|hit| hit.distance <= radius).collect();
    let closest = |wanted: &dyn Fn(&Hit) -> bool| {
        near.iter().copied().filter(wanted).min_by(|a, b| a.distance.total_cmp(&b.distance))
    };
    let entry = site.cameras.get(index)?;
    closest(&|hit| selected.contains(&hit.part))
        .or_else(|| closest(&|_| true))
        .or_else(|| mark_at(site, pose?, at, radius))
        .or_else(|| line_at(entry, &shown_lens(entry, pose), at, 0.75 * radius))
}

/// Returns the lens with which the lines of a camera are displayed: the solved lens, otherwise the most
/// likely one.
#[must_use]
pub fn shown_lens(entry: &SiteCamera, pose: Option<&Camera>) -> Lens {
    pose.map_or_else(|| entry.likely_lens(), |pose| pose.lens)
}

/// Returns the lens with which the lines of the camera with this index are displayed, as [`shown_lens`] does.
#[must_use]
pub fn lens_of(site: &Site, camera: usize, pose: Option<&Camera>) -> Option<Lens> {
    site.cameras.get(camera).map(|entry| shown_lens(entry, pose))
}

/// Returns the line or the field of view nearest to a raw pixel; `None` if none is within `radius` pixels.
fn line_at(entry: &SiteCamera, lens: &Lens, at: Pixel, radius: f64) -> Option<Hit> {
    let mut hits = Vec::new();
    for (annotation, drawn) in entry.annotations.iter().enumerate() {
        for (segment, line) in drawn.polylines().enumerate() {
            hits.extend(nearest_drawn(lens, &line, at).map(|(edge, distance)| Hit {
                part: Part::Line { annotation, segment },
                edge,
                distance,
            }));
        }
    }
    if let Some(corners) = &entry.efov_px {
        let closed: Vec<Pixel> = corners.iter().chain(corners.first()).copied().collect();
        hits.extend(nearest(&closed, at).map(|(edge, distance)| Hit { part: Part::Field, edge, distance }));
    }
    hits.retain(|hit| hit.distance <= radius);
    hits.into_iter().min_by(|a, b| a.distance.total_cmp(&b.distance))
}

/// Returns the mark whose outline or foot is nearest to a raw pixel; `None` if none is within `radius`
/// pixels.
#[must_use]
pub fn mark_at(site: &Site, pose: &Camera, at: Pixel, radius: f64) -> Option<Hit> {
    let used = site.marks.iter().enumerate().filter(|(_, mark)| !mark.off);
    let hits = used.filter_map(|(mark, drawn)| {
        let shape = drawn.shape();
        let lines = shape.polylines();
        let pieces = lines.iter().flat_map(|line| on_image(pose, line));
        let distance = pieces.filter_map(|piece| nearest(&piece, at)).map(|(_, d)| d).min_by(f64::total_cmp);
        let foot = pose.world_to_pixel(shape.at).map(|foot| foot.distance(at));
        let distance = distance.into_iter().chain(foot).min_by(f64::total_cmp)?;
        Some(Hit { part: Part::Mark(mark), edge: 0, distance })
    });
    hits.filter(|hit| hit.distance <= radius).min_by(|a, b| a.distance.total_cmp(&b.distance))
}

/// Returns the index of the edge of a line that is closest to a raw pixel, and the distance in pixels. With a fisheye
/// lens, edges are curved by its distortion; otherwise they are straight.
#[must_use]
pub fn nearest_drawn(lens: &Lens, line: &[Pixel], at: Pixel) -> Option<(usize, f64)> {
    if !lens.distortion.is_wide() {
        return nearest(line, at);
    }
    let curve = |pair: &[Pixel]| nearest(&annotated_line_curve(lens, pair), at).map(|(_, distance)| distance);
    let edges = line.windows(2).enumerate().filter_map(|(edge, pair)| Some((edge, curve(pair)?)));
    edges.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Returns the index of the edge of a polyline that is closest to a pixel, and the distance in pixels. Edges
/// are straight.
#[must_use]
pub fn nearest(line: &[Pixel], at: Pixel) -> Option<(usize, f64)> {
    let edges = line.windows(2).map(|pair| distance_to_segment(pair[0], pair[1], at));
    edges.enumerate().min_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::{Annotation, Kind};

    fn site() -> Site {
        let mut camera = SiteCamera::new("a", [640, 480]);
        let line = vec![Pixel::new(100.0, 100.0), Pixel::new(300.0, 100.0)];
        camera.annotations.push(Annotation::from_segments(Kind::Vertical, vec![line]));
        camera.efov_px =
            Some(vec![Pixel::new(104.0, 100.0), Pixel::new(400.0, 400.0), Pixel::new(0.0, 400.0)]);
        Site { cameras: vec![camera], ..Site::new() }
    }

    #[test]
    fn handle_has_priority_over_its_line() {
        let hit = pick(&site(), 0, None, Pixel::new(298.0, 101.0), 8.0, &BTreeSet::new()).unwrap();
        assert_eq!(hit.part, Part::Vertex { annotation: 0, segment: 0, vertex: 1 });
        let hit = pick(&site(), 0, None, Pixel::new(200.0, 103.0), 8.0, &BTreeSet::new()).unwrap();
        assert_eq!(hit.part, Part::Line { annotation: 0, segment: 0 });
    }

    #[test]
    fn line_in_a_fisheye_is_hit_along_its_distorted_curve() {
        let mut site = site();
        let entry = &mut site.cameras[0];
        let k = Some(0.0);
        entry.lens = Some(calib_site::LensEntry {
            distortion: Some(calib_site::DistortionEntry {
                focal_px: Some(150.0),
                k1: k,
                k2: k,
                k3: k,
                k4: k,
                ..calib_site::DistortionEntry::new(calib_core::DistortionModel::KannalaBrandt)
            }),
            ..calib_site::LensEntry::default()
        });
        let ends = [Pixel::new(120.0, 60.0), Pixel::new(520.0, 60.0)];
        entry.annotations[0] = Annotation::from_segments(Kind::Parallel, vec![ends.to_vec()]);
        let curve = annotated_line_curve(&entry.likely_lens(), &ends);
        let middle = curve[curve.len() / 2];
        assert!(middle.v < 40.0, "distortion curves it away from the centre: {middle:?}");
        let part = |at: Pixel| pick(&site, 0, None, at, 8.0, &BTreeSet::new()).map(|hit| hit.part);
        assert_eq!(part(middle), Some(Part::Line { annotation: 0, segment: 0 }));
        assert_eq!(part(Pixel::new(320.0, 60.0)), None, "the straight chord is not hit");
    }

    #[test]
    fn selected_part_has_priority_over_a_closer_part() {
        let at = Pixel::new(101.0, 100.0);
        let selected = BTreeSet::from([Part::Corner(0)]);
        assert_eq!(pick(&site(), 0, None, at, 8.0, &selected).unwrap().part, Part::Corner(0));
    }
}
