//! Checks of what cameras share: links, marks, distances.

use std::collections::HashSet;

use crate::bounded_list::MAX_ITEMS;
use crate::bounds::{At, Bounds, Checked, count, id, known, name, optional, pixels};
use crate::check_planes::plane_of;
use crate::document::Site;
use crate::elements::{Link, LinkKind, Mark};
use crate::site_error::quoted;

/// Links, marks and the distances between them.
pub(crate) fn check_elements(root: &At, site: &Site) -> Checked {
    let cameras: HashSet<&str> = site.cameras.iter().map(|camera| camera.id.as_str()).collect();
    count(&root.key("links"), site.links.len(), MAX_ITEMS)?;
    for (i, link) in site.links.iter().enumerate() {
        check_link(&root.key("links").index(i), link, &cameras)?;
        plane_of(&root.key("links").index(i).key("plane"), link.plane.as_ref(), site)?;
    }
    count(&root.key("marks"), site.marks.len(), MAX_ITEMS)?;
    for (i, mark) in site.marks.iter().enumerate() {
        check_mark(&root.key("marks").index(i), mark, &cameras)?;
    }
    // Distances name links and marks alike: their ids share one space.
    let links = site.links.iter().enumerate().map(|(i, link)| ("links", i, link.id.as_ref()));
    let marks = site.marks.iter().enumerate().map(|(i, mark)| ("marks", i, mark.id.as_ref()));
    let mut ids = HashSet::new();
    for (list, index, id) in links.chain(marks) {
        if let Some(id) = id.filter(|id| !ids.insert(id.as_str())) {
            let list = root.key(list);
            let at = list.index(index);
            return at.key("id").expected(quoted(id), "an id that no other link or mark has");
        }
    }
    let distances = root.key("distances");
    count(&distances, site.distances.len(), MAX_ITEMS)?;
    for (i, distance) in site.distances.iter().enumerate() {
        let at = distances.index(i);
        for (k, id) in distance.between.iter().enumerate() {
            if !ids.contains(id.as_str()) {
                let between = at.key("between");
                return between.index(k).expected(quoted(id), "the id of a link or a mark");
            }
        }
        if distance.between[0] == distance.between[1] {
            return at.key("between").expected("one id twice", "two different links or marks");
        }
        known(&at.key("length_m"), Some(&distance.length_m), Bounds::POSITIVE)?;
    }
    Ok(())
}

fn check_link(at: &At, link: &Link, cameras: &HashSet<&str>) -> Checked {
    id(&at.key("id"), link.id.as_ref())?;
    name(&at.key("name"), link.name.as_ref())?;
    optional(&at.key("height_m"), link.height_m, Bounds::COORDINATE)?;
    known(&at.key("length_m"), link.length_m.as_ref(), Bounds::POSITIVE)?;
    let kind = link.kind;
    for (key, is_there, of) in [
        ("height_m", link.height_m.is_some(), LinkKind::Point),
        ("length_m", link.length_m.is_some(), LinkKind::Post),
    ] {
        if is_there && kind != of {
            return at.key(key).expected(format!("{key:?}"), format!("it only in a link of kind {of:?}"));
        }
    }
    count(&at.key("seen"), link.seen.len(), MAX_ITEMS)?;
    for (i, seen) in link.seen.iter().enumerate() {
        let list = at.key("seen");
        let at = list.index(i);
        if !cameras.contains(seen.camera.as_str()) {
            return at.key("camera").expected(quoted(&seen.camera), "the id of a camera of this site");
        }
        let fields = [
            ("px", seen.px.is_some(), LinkKind::Point),
            ("foot", seen.foot.is_some(), LinkKind::Post),
            ("head", seen.head.is_some(), LinkKind::Post),
            ("segment", seen.segment.is_some(), LinkKind::Line),
        ];
        for (key, is_there, of) in fields {
            if is_there != (kind == of) {
                let found = if is_there { format!("{key:?}") } else { format!("no {key:?}") };
                return at.expected(found, "px of a point, foot and head of a post, segment of a line");
            }
        }
        for (key, pixel) in [("px", seen.px), ("foot", seen.foot), ("head", seen.head)] {
            if let Some(pixel) = pixel {
                Bounds::COORDINATE.check_all(&at.key(key), &<[f64; 2]>::from(pixel))?;
            }
        }
        if let Some(segment) = &seen.segment {
            pixels(&at.key("segment"), segment, 2)?;
        }
        optional(&at.key("sigma_px"), seen.sigma_px, Bounds::POSITIVE)?;
    }
    Ok(())
}

fn check_mark(at: &At, mark: &Mark, cameras: &HashSet<&str>) -> Checked {
    id(&at.key("id"), mark.id.as_ref())?;
    name(&at.key("name"), mark.name.as_ref())?;
    Bounds::COORDINATE.check_all(&at.key("at_m"), &<[f64; 3]>::from(mark.at_m))?;
    Bounds::DEGREES.check(&at.key("turn_deg"), mark.turn_deg)?;
    let names = mark.kind.size_names();
    let size = at.key("size_m");
    if mark.size_m.len() != names.len() {
        let expected = format!("{} of them: {}", names.len(), names.join(", "));
        return size.expected(format!("{} numbers", mark.size_m.len()), expected);
    }
    Bounds::POSITIVE.check_all(&size, &mark.size_m)?;
    for (i, value) in mark.size_m.iter().enumerate() {
        if matches!(names[i], "columns" | "rows") && (value.fract() != 0.0 || *value > 1000.0) {
            return size.index(i).expected(value, format!("a whole number of {} up to 1000", names[i]));
        }
    }
    count(&at.key("seen"), mark.seen.len(), MAX_ITEMS)?;
    let shape = mark.shape();
    for (i, seen) in mark.seen.iter().enumerate() {
        let list = at.key("seen");
        let at = list.index(i);
        if !cameras.contains(seen.camera.as_str()) {
            return at.key("camera").expected(quoted(&seen.camera), "the id of a camera of this site");
        }
        if shape.point(&seen.point).is_none() {
            return at.key("point").expected(quoted(&seen.point), "the name of a point of this kind of mark");
        }
        Bounds::COORDINATE.check_all(&at.key("px"), &<[f64; 2]>::from(seen.px))?;
    }
    Ok(())
}
