//! Edits of a site, independent of the user interface: add, move, insert, delete and duplicate annotations.
//!
//! The file also creates the names that the app shows for selected parts.

use std::collections::BTreeSet;

use calib_core::single::{Known, Shape};
use calib_core::{Annotation, Kind, Pixel};
use calib_site::{Site, SiteCamera};

use crate::hit::Part;
use crate::session::Session;

/// Placeholder height of an upright that is switched off until the operator enters its height: mean and standard
/// deviation, in metres.
const UNKNOWN_UPRIGHT_HEIGHT_M: Known = Known::prior(1.75, 0.07);

/// Whether an annotation is an upright that is not used until the operator enters its height.
#[must_use]
pub fn waits_for_height(annotation: &Annotation) -> bool {
    annotation.kind == Kind::Upright
        && annotation.off
        && annotation.like.is_none()
        && annotation.height_m == Some(UNKNOWN_UPRIGHT_HEIGHT_M)
}

/// Returns the raw pixel of a point for editing; `None` for parts that are not a single point.
pub fn pixel_mut(site: &mut Site, camera: usize, part: Part) -> Option<&mut Pixel> {
    let entry = site.cameras.get_mut(camera)?;
    match part {
        Part::Vertex { annotation, segment, vertex } => {
            vertex_mut(entry.annotations.get_mut(annotation)?, segment, vertex)
        }
        Part::Corner(corner) => entry.efov_px.as_mut()?.get_mut(corner),
        Part::Control(point) => Some(&mut entry.control_points.get_mut(point)?.px),
        Part::Link { link, seen, point } => {
            let seen = site.links.get_mut(link)?.seen.get_mut(seen)?;
            let points = seen.px.iter_mut().chain(&mut seen.foot).chain(&mut seen.head);
            points.chain(seen.segment.iter_mut().flatten()).nth(point)
        }
        Part::Pin { mark, seen } => Some(&mut site.marks.get_mut(mark)?.seen.get_mut(seen)?.px),
        Part::Line { .. } | Part::Field | Part::Mark(_) => None,
    }
}

/// Returns a point of an annotation for editing.
fn vertex_mut(annotation: &mut Annotation, segment: usize, vertex: usize) -> Option<&mut Pixel> {
    match annotation.kind.row().shape {
        Shape::Segments => annotation.segments.as_mut()?.get_mut(segment)?.get_mut(vertex),
        Shape::Polyline => annotation.points.as_mut()?.get_mut(vertex),
        Shape::FootAndHead if vertex == 0 => annotation.foot.as_mut(),
        Shape::FootAndHead => annotation.head.as_mut(),
    }
}

/// Returns the line of an annotation into which points can be inserted.
fn line_mut(annotation: &mut Annotation, segment: usize) -> Option<&mut Vec<Pixel>> {
    match annotation.kind.row().shape {
        Shape::Segments => annotation.segments.as_mut()?.get_mut(segment),
        Shape::Polyline => annotation.points.as_mut(),
        Shape::FootAndHead => None,
    }
}

/// Returns the points that move when these parts are moved, without duplicates.
#[must_use]
pub fn points_of(site: &Site, camera: usize, parts: &BTreeSet<Part>) -> BTreeSet<Part> {
    let mut points = BTreeSet::new();
    let Some(entry) = site.cameras.get(camera) else { return points };
    for &part in parts {
        match part {
            Part::Line { annotation, segment } => {
                let drawn = entry.annotations.get(annotation);
                let line = drawn.and_then(|drawn| drawn.polylines().nth(segment)).unwrap_or_default();
                points.extend((0..line.len()).map(|vertex| Part::Vertex { annotation, segment, vertex }));
            }
            Part::Field => {
                points.extend((0..entry.efov_px.as_ref().map_or(0, Vec::len)).map(Part::Corner));
            }
            Part::Mark(_) => {}
            point => {
                points.insert(point);
            }
        }
    }
    points
}

/// Returns the lines that contain these parts, without duplicates, as pairs of the indices of annotation and
/// segment.
#[must_use]
pub fn lines_of(parts: &BTreeSet<Part>) -> BTreeSet<(usize, usize)> {
    let line = |part: &Part| match *part {
        Part::Line { annotation, segment } | Part::Vertex { annotation, segment, .. } => {
            Some((annotation, segment))
        }
        _ => None,
    };
    parts.iter().filter_map(line).collect()
}

/// Moves parts of an image by a displacement (du, dv) in raw pixels.
pub fn shift(site: &mut Site, camera: usize, parts: &BTreeSet<Part>, [du, dv]: [f64; 2]) {
    for part in points_of(site, camera, parts) {
        if let Some(pixel) = pixel_mut(site, camera, part) {
            *pixel = Pixel::new(pixel.u + du, pixel.v + dv);
        }
    }
}

/// Adds a line of this kind and returns it. The line joins the last annotation of its kind if the kind allows
/// this and `fresh` is false.
pub fn add_line(entry: &mut SiteCamera, kind: Kind, line: Vec<Pixel>, fresh: bool) -> Part {
    let row = kind.row();
    let last = entry.annotations.iter().rposition(|annotation| annotation.kind == kind);
    match row.shape {
        Shape::Segments => {
            // A right angle consists of two lines; a third line begins the next annotation.
            let is_open = |annotation: &Annotation| {
                let count = annotation.segments.as_ref().map_or(0, Vec::len);
                !fresh && (kind != Kind::Perpendicular || count < row.min_segments)
            };
            let index = last.filter(|&index| is_open(&entry.annotations[index])).unwrap_or_else(|| {
                // The annotation is switched off until the operator enters a length, because an unknown
                // length constrains nothing.
                let (length_m, off) = (row.has_length.then_some(1.0), row.has_length);
                let empty = Annotation::from_segments(kind, Vec::new());
                entry.annotations.push(Annotation { length_m, off, ..empty });
                entry.annotations.len() - 1
            });
            let segments = entry.annotations[index].segments.get_or_insert_default();
            segments.push(line);
            Part::Line { annotation: index, segment: segments.len() - 1 }
        }
        Shape::Polyline => {
            entry.annotations.push(Annotation { points: Some(line), ..Annotation::new(kind) });
            Part::Line { annotation: entry.annotations.len() - 1, segment: 0 }
        }
        Shape::FootAndHead => {
            let (foot, head) = (line.first().copied(), line.last().copied());
            let drawn = Annotation { foot, head, ..Annotation::new(kind) };
            // The next upright has the size of the last one in use. The first one is switched off until the operator
            // enters its size.
            let is_used = |other: &&Annotation| other.kind == kind && !other.off;
            let drawn = match entry.annotations.iter().rfind(is_used) {
                Some(last) => Annotation { height_m: last.height_m, like: last.like.clone(), ..drawn },
                None => Annotation { height_m: Some(UNKNOWN_UPRIGHT_HEIGHT_M), off: true, ..drawn },
            };
            entry.annotations.push(drawn);
            Part::Line { annotation: entry.annotations.len() - 1, segment: 0 }
        }
    }
}

/// Inserts a point after point `edge` of a line or of the field of view. Returns the new point; `None` for
/// other parts.
pub fn insert(site: &mut Site, camera: usize, part: Part, edge: usize, at: Pixel) -> Option<Part> {
    let entry = site.cameras.get_mut(camera)?;
    match part {
        Part::Line { annotation, segment } => {
            let line = line_mut(entry.annotations.get_mut(annotation)?, segment)?;
            (edge < line.len()).then(|| line.insert(edge + 1, at))?;
            Some(Part::Vertex { annotation, segment, vertex: edge + 1 })
        }
        Part::Field => {
            let corners = entry.efov_px.as_mut()?;
            (edge < corners.len()).then(|| corners.insert(edge + 1, at))?;
            Some(Part::Corner(edge + 1))
        }
        _ => None,
    }
}

/// Deletes parts. Lines with too few points and annotations without lines are removed too.
pub fn delete(site: &mut Site, camera: usize, parts: &BTreeSet<Part>) {
    // All points of an observation of a link are deleted together. Items are deleted in descending order, so
    // that lower indices stay valid. Pins are deleted before the marks that contain them.
    let sightings: BTreeSet<(usize, usize)> = parts
        .iter()
        .filter_map(|part| if let Part::Link { link, seen, .. } = *part { Some((link, seen)) } else { None })
        .collect();
    for (link, seen) in sightings.into_iter().rev() {
        delete_observation(site, link, seen);
    }
    for &part in parts.iter().rev() {
        if let Part::Pin { mark, seen } = part
            && let Some(mark) = site.marks.get_mut(mark)
            && seen < mark.seen.len()
        {
            mark.seen.remove(seen);
        }
    }
    for &part in parts.iter().rev() {
        match part {
            Part::Link { .. } | Part::Pin { .. } => {}
            Part::Mark(mark) => delete_mark(site, mark),
            _ => {
                if let Some(entry) = site.cameras.get_mut(camera) {
                    delete_part(entry, part);
                }
            }
        }
    }
    if let Some(entry) = site.cameras.get_mut(camera) {
        remove_incomplete(entry);
    }
    site.links.retain(|link| !link.seen.is_empty());
    remove_dangling_distances(site);
}

/// Deletes an observation of a link.
fn delete_observation(site: &mut Site, link: usize, seen: usize) {
    if let Some(link) = site.links.get_mut(link)
        && seen < link.seen.len()
    {
        link.seen.remove(seen);
    }
}

/// Deletes a mark.
fn delete_mark(site: &mut Site, mark: usize) {
    if mark < site.marks.len() {
        site.marks.remove(mark);
    }
}

/// Removes the distances whose links or marks no longer exist.
pub(crate) fn remove_dangling_distances(site: &mut Site) {
    let ids: BTreeSet<String> = site
        .links
        .iter()
        .filter_map(|link| link.id.clone())
        .chain(site.marks.iter().filter_map(|mark| mark.id.clone()))
        .collect();
    site.distances.retain(|distance| distance.between.iter().all(|id| ids.contains(id)));
}

/// Deletes a part of a camera entry: a part of an annotation or of the field of view, or a control point.
/// Incomplete annotations stay until `remove_incomplete` removes them.
fn delete_part(entry: &mut SiteCamera, part: Part) {
    match part {
        Part::Vertex { annotation, segment, vertex } => {
            let Some(drawn) = entry.annotations.get_mut(annotation) else { return };
            match line_mut(drawn, segment) {
                Some(line) if vertex < line.len() => {
                    line.remove(vertex);
                }
                Some(_) => {}
                None => (drawn.foot, drawn.head) = (None, None),
            }
        }
        Part::Line { annotation, segment } => {
            let Some(drawn) = entry.annotations.get_mut(annotation) else { return };
            match line_mut(drawn, segment) {
                // The line is cleared here and removed in `remove_incomplete`, so that the other indices stay
                // valid.
                Some(line) => line.clear(),
                None => (drawn.foot, drawn.head) = (None, None),
            }
        }
        Part::Corner(corner) => {
            if let Some(corners) = entry.efov_px.as_mut().filter(|corners| corner < corners.len()) {
                corners.remove(corner);
            }
        }
        Part::Field => entry.efov_px = None,
        Part::Control(point) if point < entry.control_points.len() => {
            entry.control_points.remove(point);
        }
        _ => {}
    }
}

/// Removes incomplete annotations, and references to annotations that no longer exist.
fn remove_incomplete(entry: &mut SiteCamera) {
    for annotation in &mut entry.annotations {
        if let Some(segments) = &mut annotation.segments {
            segments.retain(|line| line.len() >= 2);
        }
    }
    entry.annotations.retain(|annotation| match annotation.kind.row().shape {
        Shape::Segments => annotation.segments.as_ref().is_some_and(|segments| !segments.is_empty()),
        Shape::Polyline => annotation.points.as_ref().is_some_and(|points| points.len() >= 3),
        Shape::FootAndHead => annotation.foot.is_some() && annotation.head.is_some(),
    });
    let ids: BTreeSet<String> = entry.annotations.iter().filter_map(|a| a.id.clone()).collect();
    for annotation in &mut entry.annotations {
        annotation.at_right_angles_to.take_if(|id| !ids.contains(id));
    }
    if entry.efov_px.as_ref().is_some_and(|corners| corners.len() < 3) {
        entry.efov_px = None;
    }
}

/// Copies the lines that contain these parts into new annotations, displaced by `by` in raw pixels. Returns
/// the copies, which the caller selects.
pub fn duplicate(entry: &mut SiteCamera, parts: &BTreeSet<Part>, by: [f64; 2]) -> BTreeSet<Part> {
    let lines = lines_of(parts);
    let mut copies = BTreeSet::new();
    let mut groups: Vec<(usize, usize)> = Vec::new();
    for (annotation, segment) in lines {
        let Some(drawn) = entry.annotations.get(annotation).cloned() else { continue };
        let Some(line) = drawn.polylines().nth(segment) else { continue };
        let line: Vec<Pixel> = line.iter().map(|p| Pixel::new(p.u + by[0], p.v + by[1])).collect();
        let known = groups.iter().find(|(from, _)| *from == annotation).map(|&(_, to)| to);
        if let Some(to) = known {
            let segments = entry.annotations[to].segments.get_or_insert_default();
            segments.push(line);
            copies.insert(Part::Line { annotation: to, segment: segments.len() - 1 });
            continue;
        }
        let part = add_line(entry, drawn.kind, line, true);
        if let Part::Line { annotation: to, .. } = part
            && let Some(copy) = entry.annotations.get_mut(to)
        {
            (copy.length_m, copy.height_m, copy.like) = (drawn.length_m, drawn.height_m, drawn.like.clone());
            copy.off = drawn.off;
            (copy.sigma_px, copy.exact) = (drawn.sigma_px, drawn.exact);
            (copy.angle_sigma_deg, copy.length_sigma_rel) = (drawn.angle_sigma_deg, drawn.length_sigma_rel);
            if drawn.kind.row().shape == Shape::Segments {
                groups.push((annotation, to));
            }
        }
        copies.insert(part);
    }
    copies
}

/// Scales the points of an annotation to an image of another size. `ratio` is the new size divided by the old
/// one, in u and v.
pub(crate) fn scale(annotation: &mut Annotation, ratio: [f64; 2]) {
    let segments = annotation.segments.iter_mut().flatten().flatten();
    let points = annotation.points.iter_mut().flatten();
    for pixel in segments.chain(points).chain(&mut annotation.foot).chain(&mut annotation.head) {
        (pixel.u, pixel.v) = (pixel.u * ratio[0], pixel.v * ratio[1]);
    }
}

/// Removes the observations of a camera from links and marks, and measurements in its images. Links without
/// observations are removed.
pub(crate) fn remove_observations(site: &mut Site, id: &str) {
    for link in &mut site.links {
        link.seen.retain(|seen| seen.camera != id);
    }
    site.links.retain(|link| !link.seen.is_empty());
    for mark in &mut site.marks {
        mark.seen.retain(|seen| seen.camera != id);
    }
    site.measurements.retain(|measurement| measurement.points.iter().all(|point| point.camera != id));
}

/// Scales all pixel coordinates of a camera to an image of another size. `ratio` is the new size divided by
/// the old one, in u and v.
pub(crate) fn scale_camera(site: &mut Site, index: usize, ratio: [f64; 2]) {
    let has_shared = site.owns_links(index);
    let Some(entry) = site.cameras.get_mut(index) else { return };
    let id = entry.id.clone();
    for annotation in &mut entry.annotations {
        scale(annotation, ratio);
    }
    entry.control_points.iter_mut().filter_map(|point| point.sigma_px.as_mut()).for_each(|s| *s *= ratio[0]);
    let points = entry.efov_px.iter_mut().flatten();
    let points = points.chain(entry.control_points.iter_mut().map(|point| &mut point.px));
    let pins = site.marks.iter_mut().flat_map(|mark| &mut mark.seen);
    let pins = pins.filter(|seen| has_shared && seen.camera == id).map(|seen| &mut seen.px);
    let sightings = site.links.iter_mut().flat_map(|link| &mut link.seen);
    let sightings = sightings.filter(|seen| has_shared && seen.camera == id);
    let sightings = sightings.flat_map(|seen| {
        seen.sigma_px.iter_mut().for_each(|sigma| *sigma *= ratio[0]);
        let ends = seen.px.iter_mut().chain(&mut seen.foot).chain(&mut seen.head);
        ends.chain(seen.segment.iter_mut().flatten())
    });
    let measured = site.measurements.iter_mut().flat_map(|measurement| &mut measurement.points);
    let measured = measured.filter(|point| has_shared && point.camera == id).map(|point| &mut point.px);
    for pixel in points.chain(pins).chain(sightings).chain(measured) {
        (pixel.u, pixel.v) = (pixel.u * ratio[0], pixel.v * ratio[1]);
    }
}

/// Returns an id that no link or mark of the site has. It consists of the letter and a number.
#[must_use]
pub fn free_id(site: &Site, letter: char) -> String {
    let is_free = |id: &String| {
        let mut ids = site.links.iter().map(|link| &link.id).chain(site.marks.iter().map(|mark| &mark.id));
        !ids.any(|other| other.as_ref() == Some(id))
    };
    (1..).map(|number| format!("{letter}{number}")).find(is_free).unwrap_or_default()
}

impl Session {
    /// Returns the name of a part of the selected camera for the operator, for example "V2" or "control point 7".
    #[must_use]
    pub fn part_name(&self, part: Part) -> String {
        let Some(entry) = self.entry() else { return String::new() };
        let named = |id: Option<&String>, what: &str, index: usize| {
            id.cloned().unwrap_or_else(|| format!("{what} {}", index + 1))
        };
        match part {
            Part::Vertex { annotation, segment, .. } | Part::Line { annotation, segment } => {
                calib_core::single::line_name(&entry.annotations, annotation, segment)
            }
            Part::Corner(corner) => format!("corner {} of the field of view", corner + 1),
            Part::Field => "the field of view".into(),
            Part::Control(i) => {
                named(entry.control_points.get(i).and_then(|p| p.id.as_ref()), "control point", i)
            }
            Part::Link { link, .. } => {
                named(self.site.links.get(link).and_then(|l| l.id.as_ref()), "link", link)
            }
            Part::Pin { mark, .. } => {
                format!(
                    "pin of {}",
                    named(self.site.marks.get(mark).and_then(|m| m.id.as_ref()), "mark", mark)
                )
            }
            Part::Mark(mark) => named(self.site.marks.get(mark).and_then(|m| m.id.as_ref()), "mark", mark),
        }
    }

    /// Whether the line of a part exists; true for parts that do not belong to a line.
    pub(crate) fn has_line(&self, part: Part) -> bool {
        let (Part::Vertex { annotation, segment, .. } | Part::Line { annotation, segment }) = part else {
            return true;
        };
        let drawn = self.entry().and_then(|entry| entry.annotations.get(annotation));
        drawn.is_some_and(|drawn| drawn.segments.as_ref().is_none_or(|segments| segment < segments.len()))
    }

    /// Returns the names of the selected parts, for the name of an undo step.
    #[must_use]
    pub fn selection_name(&self) -> String {
        let names: BTreeSet<String> = self.selection.iter().map(|&part| self.part_name(part)).collect();
        match names.len() {
            0 => "nothing".into(),
            1..=3 => names.into_iter().collect::<Vec<_>>().join(", "),
            count => format!("{count} items"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(u: f64) -> Vec<Pixel> {
        vec![Pixel::new(u, 10.0), Pixel::new(u, 90.0)]
    }

    fn site() -> Site {
        let mut camera = SiteCamera::new("a", [640, 480]);
        for u in [10.0, 20.0, 30.0] {
            add_line(&mut camera, Kind::Vertical, line(u), false);
            add_line(&mut camera, Kind::Perpendicular, line(u + 100.0), false);
        }
        Site { cameras: vec![camera], ..Site::new() }
    }

    #[test]
    fn verticals_share_a_group_and_right_angles_come_in_pairs() {
        let annotations = &site().cameras[0].annotations;
        let counts: Vec<usize> = annotations.iter().map(|a| a.segments.as_ref().unwrap().len()).collect();
        assert_eq!(counts, [3, 2, 1]);
    }

    #[test]
    fn deleting_an_end_deletes_the_line_and_an_empty_annotation() {
        let mut site = site();
        let ends = (0..3).map(|segment| Part::Vertex { annotation: 0, segment, vertex: 1 });
        delete(&mut site, 0, &ends.collect());
        assert!(site.cameras[0].annotations.iter().all(|a| a.kind == Kind::Perpendicular));
    }

    #[test]
    fn several_lines_of_one_annotation_are_deleted_together() {
        let mut site = site();
        let parts = [0, 2].map(|segment| Part::Line { annotation: 0, segment });
        delete(&mut site, 0, &parts.into());
        assert_eq!(site.cameras[0].annotations[0].segments, Some(vec![line(20.0)]));
    }

    #[test]
    fn shifting_a_line_and_its_end_moves_the_end_once() {
        let mut site = site();
        let parts =
            [Part::Line { annotation: 0, segment: 0 }, Part::Vertex { annotation: 0, segment: 0, vertex: 0 }];
        shift(&mut site, 0, &parts.into(), [5.0, 0.0]);
        assert_eq!(site.cameras[0].annotations[0].segments.as_ref().unwrap()[0], line(15.0));
    }
}
