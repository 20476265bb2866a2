//! Checks of links, marks, distances, planes, lenses, solutions, walls, areas and measurements.

use std::collections::HashSet;

use calib_core::camera::{Coefficient, ImageCircle};
use calib_core::floor::DensityLevel;

use crate::bounds::{At, Bounds, Checked, MAX_ITEMS, count, id, known, name, optional, pixels};
use crate::check_geographic::check_geographic;
use crate::document::Site;
use crate::document::{Link, LinkKind, Mark};
use crate::english::counted;
use crate::geographic::SurveyedPosition;
use crate::scene::{PlaneEntry, PlaneNumber};
use crate::site_error::quoted;
use crate::solution::{CovarianceEntry, DistortionEntry, Solution, Stage};
use crate::survey_entries::{Measurement, MeasurementKind};

/// Largest number of planes of one site; every mapped pixel is tested against each plane.
const MAX_PLANES: usize = 1000;

/// Checks the planes of a site.
pub(crate) fn check_planes(at: &At, planes: &[PlaneEntry]) -> Checked {
    count(at, planes.len(), MAX_PLANES)?;
    let mut ids = HashSet::new();
    for (i, plane) in planes.iter().enumerate() {
        let at = at.index(i);
        check_plane(&at, plane)?;
        if !ids.insert(plane.id.as_str()) {
            return at.key("id").expected(quoted(&plane.id), "an id that no other plane has");
        }
    }
    Ok(())
}

/// Checks one plane: names, numbers, region and solution.
fn check_plane(at: &At, plane: &PlaneEntry) -> Checked {
    id(&at.key("id"), Some(&plane.id))?;
    name(&at.key("name"), plane.name.as_ref())?;
    check_plane_number(&at.key("height_m"), plane.height_m, Bounds::COORDINATE)?;
    if let Some(tilt) = plane.tilt {
        let at = at.key("tilt");
        check_plane_number(&at.key("toward_deg"), tilt.toward_deg, Bounds::DEGREES)?;
        check_plane_number(&at.key("fall_deg"), tilt.fall_deg, Bounds::SCENE_DEGREES)?;
    }
    let region = at.key("region");
    count(&region, plane.region.len(), MAX_ITEMS)?;
    if !plane.region.is_empty() && plane.region.len() < 3 {
        return region.expected(counted(plane.region.len(), "corner", "corners"), "at least 3, or no region");
    }
    for (i, &corner) in plane.region.iter().enumerate() {
        Bounds::COORDINATE.check_all(&region.index(i), &<[f64; 2]>::from(corner))?;
    }
    plane.solution.map_or(Ok(()), |solution| {
        let at = at.key("solution");
        Bounds::COORDINATE.check(&at.key("height_m"), solution.height_m)?;
        Bounds::COORDINATE.check_all(&at.key("slope"), &solution.slope)?;
        Bounds::COORDINATE.check_all(&at.key("covariance"), &solution.covariance)
    })
}

/// Checks the value and the standard deviation of a plane's height or angle.
fn check_plane_number(at: &At, number: Option<PlaneNumber>, bounds: Bounds) -> Checked {
    match number {
        None => Ok(()),
        Some(PlaneNumber::Exact(value)) => bounds.check(at, value),
        Some(PlaneNumber::Known(value)) => known(at, Some(&value), bounds),
    }
}

/// Checks that a reference names a plane of the site.
pub(crate) fn check_plane_id(at: &At, plane: Option<&String>, site: &Site) -> Checked {
    let Some(plane) = plane else { return Ok(()) };
    match site.plane(plane) {
        Some(_) => Ok(()),
        None => at.expected(
            quoted(plane),
            "the id of one of this site's \"planes\", or no \"plane\" for the floor",
        ),
    }
}

/// Checks links, marks, and the distances between them.
pub(crate) fn check_elements(root: &At, site: &Site) -> Checked {
    let cameras: HashSet<&str> = site.cameras.iter().map(|camera| camera.id.as_str()).collect();
    count(&root.key("links"), site.links.len(), MAX_ITEMS)?;
    for (i, link) in site.links.iter().enumerate() {
        check_link(&root.key("links").index(i), link, &cameras, site)?;
        check_plane_id(&root.key("links").index(i).key("plane"), link.plane.as_ref(), site)?;
    }
    count(&root.key("marks"), site.marks.len(), MAX_ITEMS)?;
    for (i, mark) in site.marks.iter().enumerate() {
        check_mark(&root.key("marks").index(i), mark, &cameras, site)?;
    }
    // Distances refer to links and marks by id, so these ids must be unique together.
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
            return at.key("between").expected("the same id twice", "two different links or marks");
        }
        known(&at.key("length_m"), Some(&distance.length_m), Bounds::POSITIVE)?;
    }
    Ok(())
}

/// Checks walls, areas and measurements.
pub(crate) fn check_survey(root: &At, site: &Site) -> Checked {
    /// Largest number of walls. Every line of sight is tested against the walls around its camera.
    const MAX_WALLS: usize = 5_000;
    /// Largest number of areas.
    const MAX_AREAS: usize = 1000;
    let walls = root.key("walls");
    count(&walls, site.walls.len(), MAX_WALLS)?;
    for (i, wall) in site.walls.iter().enumerate() {
        let at = walls.index(i);
        Bounds::COORDINATE.check_all(&at.key("from_m"), &<[f64; 2]>::from(wall.from_m))?;
        Bounds::COORDINATE.check_all(&at.key("to_m"), &<[f64; 2]>::from(wall.to_m))?;
        optional(&at.key("height_m"), wall.height_m, Bounds::POSITIVE)?;
    }
    let areas = root.key("areas");
    count(&areas, site.areas.len(), MAX_AREAS)?;
    let mut ids = HashSet::new();
    for (i, area) in site.areas.iter().enumerate() {
        let at = areas.index(i);
        id(&at.key("id"), Some(&area.id))?;
        name(&at.key("name"), area.name.as_ref())?;
        if !ids.insert(area.id.as_str()) {
            return at.key("id").expected(quoted(&area.id), "an id that no other area has");
        }
        let polygon = at.key("polygon_m");
        if area.polygon_m.len() < 3 {
            return polygon.expected(counted(area.polygon_m.len(), "corner", "corners"), "at least 3");
        }
        count(&polygon, area.polygon_m.len(), 1000)?;
        for (k, &corner) in area.polygon_m.iter().enumerate() {
            Bounds::COORDINATE.check_all(&polygon.index(k), &<[f64; 2]>::from(corner))?;
        }
    }
    check_levels(&root.key("level_px_per_m"), site)?;
    let cameras: HashSet<&str> = site.cameras.iter().map(|camera| camera.id.as_str()).collect();
    let measurements = root.key("measurements");
    count(&measurements, site.measurements.len(), MAX_ITEMS)?;
    site.measurements
        .iter()
        .enumerate()
        .try_for_each(|(i, measurement)| check_measurement(&measurements.index(i), measurement, &cameras))
}

/// Checks that the limits of the density levels are positive and increase from level to level.
fn check_levels(at: &At, site: &Site) -> Checked {
    let Some(entry) = &site.level_px_per_m else { return Ok(()) };
    for (level, entered) in DensityLevel::ALL.into_iter().zip(entry.entered()) {
        optional(&at.key(level.name()), entered, Bounds::POSITIVE)?;
    }
    let limits = entry.limits();
    for pair in DensityLevel::ALL.windows(2) {
        let [lower, upper] = [limits.of(pair[0]), limits.of(pair[1])];
        if lower >= upper {
            return at.key(pair[1].name()).expected(
                format!("{upper} px/m"),
                format!("more than {lower} px/m, the limit of \"{}\"", pair[0].name()),
            );
        }
    }
    Ok(())
}

/// Checks one measurement: its number of points, and every point.
fn check_measurement(at: &At, measurement: &Measurement, cameras: &HashSet<&str>) -> Checked {
    id(&at.key("id"), measurement.id.as_ref())?;
    name(&at.key("name"), measurement.name.as_ref())?;
    let list = at.key("points");
    let (found, least) = (measurement.points.len(), measurement.kind.min_points());
    if found < least {
        let kind = measurement.kind.name();
        let found = counted(found, "point", "points");
        return list.expected(found, format!("at least {least} for kind \"{kind}\""));
    }
    if measurement.kind == MeasurementKind::Height && found > 2 {
        return list.expected(format!("{found} points"), "2 for kind \"height\": the foot and the head");
    }
    optional(&at.key("duration_s"), measurement.duration_s, Bounds::POSITIVE)?;
    if measurement.duration_s.is_some() && measurement.kind != MeasurementKind::Speed {
        return at
            .key("duration_s")
            .expected("a duration", "no duration, except in a measurement of kind \"speed\"");
    }
    count(&list, found, 1000)?;
    for (i, point) in measurement.points.iter().enumerate() {
        let at = list.index(i);
        if !cameras.contains(point.camera.as_str()) {
            return at.key("camera").expected(quoted(&point.camera), "the id of a camera of this site");
        }
        Bounds::COORDINATE.check_all(&at.key("px"), &<[f64; 2]>::from(point.px))?;
        optional(&at.key("height_m"), point.height_m, Bounds::COORDINATE)?;
        optional(&at.key("sigma_px"), point.sigma_px, Bounds::POSITIVE)?;
        if let Some(time) = &point.at
            && time.parse::<jiff::Timestamp>().is_err()
        {
            return at.key("at").expected(quoted(time), "a time such as 2026-05-01T08:00:00Z");
        }
    }
    Ok(())
}

/// Checks one link: names, numbers, and observations of its kind by cameras of the site.
fn check_link(at: &At, link: &Link, cameras: &HashSet<&str>, site: &Site) -> Checked {
    id(&at.key("id"), link.id.as_ref())?;
    name(&at.key("name"), link.name.as_ref())?;
    optional(&at.key("height_m"), link.height_m, Bounds::COORDINATE)?;
    known(&at.key("length_m"), link.length_m.as_ref(), Bounds::POSITIVE)?;
    let kind = link.kind;
    for (key, is_there, of, word) in [
        ("height_m", link.height_m.is_some(), LinkKind::Point, "point"),
        ("length_m", link.length_m.is_some(), LinkKind::Post, "post"),
    ] {
        if is_there && kind != of {
            return at
                .key(key)
                .expected(format!("{key:?}"), format!("no {key:?}, except in a link of kind {word:?}"));
        }
    }
    let position = SurveyedPosition::of_link(link);
    if position.is_entered() && kind != LinkKind::Point {
        return at.expected(
            "geographic coordinates",
            "no geographic coordinates, except in a link of kind \"point\"",
        );
    }
    if position.is_entered() && link.plane.is_some() {
        return at.key("plane").expected("\"plane\"", "no \"plane\" together with geographic coordinates");
    }
    check_geographic(at, &position, false, site)?;
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
                return at.expected(found, "px for a point, foot and head for a post, segment for a line");
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

/// Checks one mark: names, numbers, dimensions and observations of its named points.
fn check_mark(at: &At, mark: &Mark, cameras: &HashSet<&str>, site: &Site) -> Checked {
    id(&at.key("id"), mark.id.as_ref())?;
    name(&at.key("name"), mark.name.as_ref())?;
    let position = SurveyedPosition::of_mark(mark);
    check_geographic(at, &position, false, site)?;
    if mark.at_m.x.is_nan() && !position.is_entered() {
        return at.expected("no position", "\"at_m\", or \"lat_deg\" and \"lon_deg\", or \"crs_m\"");
    }
    if position.is_entered() {
        if site.known_georeference().is_none() {
            let expected = "a \"georeference\", because the position of a mark must be known before the cameras are solved";
            return at.expected("map coordinates, but no georeference", expected);
        }
    } else {
        Bounds::COORDINATE.check_all(&at.key("at_m"), &<[f64; 3]>::from(mark.at_m))?;
    }
    Bounds::DEGREES.check(&at.key("turn_deg"), mark.turn_deg)?;
    let names = mark.kind.size_names();
    let size = at.key("size_m");
    if mark.size_m.len() != names.len() {
        let [found, expected] =
            [mark.size_m.len(), names.len()].map(|count| counted(count, "number", "numbers"));
        return size.expected(found, format!("{expected}: {}", names.join(", ")));
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
            return at
                .key("point")
                .expected(quoted(&seen.point), "the name of a point that this kind of mark has");
        }
        Bounds::COORDINATE.check_all(&at.key("px"), &<[f64; 2]>::from(seen.px))?;
    }
    Ok(())
}

/// Largest number of corners of an EFOV polygon on the floor: eight for each annotated corner, plus the
/// corners from clipping.
const MAX_EFOV_CORNERS: usize = 10_000;

/// Checks that an image circle has a positive radius and finite values.
pub(crate) fn check_circle(at: &At, circle: ImageCircle) -> Checked {
    Bounds::COORDINATE.check_all(at, &<[f64; 3]>::from(circle))?;
    if circle.radius > 0.0 {
        return Ok(());
    }
    at.expected(
        format!("a radius of {}", circle.radius),
        "u and v of the centre and a radius above 0, in pixels",
    )
}

/// Checks the values of a stored solution, so that it can be written and read again.
pub(crate) fn check_solution(at: &At, solution: &Solution) -> Checked {
    Bounds { low: 1e-6, ..Bounds::POSITIVE }.check(&at.key("focal_px"), solution.focal_px)?;
    let point = <[f64; 2]>::from(solution.principal_point_px);
    Bounds::COORDINATE.check_all(&at.key("principal_point_px"), &point)?;
    Bounds::PIXEL_ASPECT.check(&at.key("pixel_aspect"), solution.pixel_aspect)?;
    if let Some(circle) = solution.image_circle_px {
        check_circle(&at.key("image_circle_px"), circle)?;
    }
    let pose = [
        ("position_m", solution.position_m.is_some()),
        ("yaw_deg", solution.yaw_deg.is_some()),
        ("pitch_deg", solution.pitch_deg.is_some()),
        ("roll_deg", solution.roll_deg.is_some()),
    ];
    for (key, is_there) in pose {
        if !is_there && solution.stage != Stage::Lens {
            return at.expected(
                format!("no {key:?}"),
                "a complete pose, which every stage except \"lens\" requires",
            );
        }
    }
    if let Some(position) = solution.position_m {
        Bounds::COORDINATE.check_all(&at.key("position_m"), &<[f64; 3]>::from(position))?;
    }
    let angles = [solution.yaw_deg, solution.pitch_deg, solution.roll_deg];
    for (key, angle) in ["yaw_deg", "pitch_deg", "roll_deg"].into_iter().zip(angles) {
        optional(&at.key(key), angle, Bounds::DEGREES)?;
    }
    if let Some(distortion) = &solution.distortion {
        check_distortion(&at.key("distortion"), distortion, Some(solution.focal_px))?;
    }
    let efov = at.key("efov_m");
    count(&efov, solution.efov_m.len(), MAX_EFOV_CORNERS)?;
    for (i, &point) in solution.efov_m.iter().enumerate() {
        Bounds::COORDINATE.check_all(&efov.index(i), &<[f64; 2]>::from(point))?;
    }
    solution.covariance.as_ref().map_or(Ok(()), |c| check_covariance(&at.key("covariance"), c))
}

/// Checks the size, the values and the diagonal of a stored covariance.
fn check_covariance(at: &At, covariance: &CovarianceEntry) -> Checked {
    let n = covariance.of.len();
    count(&at.key("of"), n, 100)?;
    let expected = n * (n + 1) / 2;
    if covariance.upper.len() != expected {
        let [found, expected] =
            [covariance.upper.len(), expected].map(|count| counted(count, "number", "numbers"));
        return at
            .key("upper")
            .expected(found, format!("{expected}: the upper triangle of a {n} by {n} matrix"));
    }
    let broken = covariance.upper.iter().position(|value| !value.is_finite());
    if let Some(i) = broken {
        return at.key("upper").index(i).expected(covariance.upper[i], "a number");
    }
    // In the upper triangle, stored row by row, the diagonal is the first value of each row.
    let mut first = 0;
    for row in 0..n {
        if covariance.upper[first] < 0.0 {
            return at.key("upper").index(first).expected(covariance.upper[first], "a variance of 0 or more");
        }
        first += n - row;
    }
    Ok(())
}

/// Checks a distortion entry. `focal` is the entered focal length of the camera, in pixels, if any.
pub(crate) fn check_distortion(at: &At, entry: &DistortionEntry, focal: Option<f64>) -> Checked {
    let mut given = false;
    let own = entry.model.row().coefficients;
    for which in Coefficient::ALL {
        let (key, Some(value)) = (which.name(), entry.coefficient(which)) else { continue };
        given = true;
        if !own.contains(&which) {
            return at.key(key).expected(format!("a coefficient {key}"), "only coefficients of this model");
        }
        let [low, high] = which.bounds();
        let what = match which {
            Coefficient::Xi => "a number above -1 and up to 1e6",
            Coefficient::Alpha => "a number between 0 and 1",
            Coefficient::Beta => "a number above 0, from 1e-6 to 1e6",
            _ => "a number between -1e6 and 1e6",
        };
        Bounds { low, high, what }.check(&at.key(key), value)?;
    }
    optional(&at.key("focal_px"), entry.focal_px, Bounds { low: 1.0, ..Bounds::POSITIVE })?;
    if let Some(fit) = &entry.fit {
        if given {
            return at.key("fit").expected("both \"fit\" and coefficients", "only one of them");
        }
        for (i, wanted) in fit.iter().enumerate() {
            if !own.contains(wanted) || fit[..i].contains(wanted) {
                let found = quoted(wanted.name());
                let expected = "coefficients of this model, each at most once";
                return at.key("fit").index(i).expected(found, expected);
            }
        }
    }
    if !given && !entry.model.row().is_fitted {
        let found = format!("{} without coefficients", entry.model.row().name);
        return at.expected(found, "coefficients, because this model is not fitted");
    }
    if given && entry.focal_px.is_none() && focal.is_none() {
        return at.expected(
            "coefficients without a focal length",
            "\"focal_px\" in the distortion or in the lens",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use calib_core::camera::{Distortion, Unified};

    use crate::Site;

    fn site(distortion: &str) -> Result<Site, String> {
        let text = format!(
            r#"{{"format": "calib-site", "version": 1, "cameras": [{{"id": "a", "size_px": [640, 480],
            "lens": {{"distortion": {distortion}}}, "annotations": []}}]}}"#
        );
        Site::from_json(&text).map_err(|error| error.to_string())
    }

    #[test]
    fn sphere_models_need_entered_coefficients() {
        let lens = |text: &str| site(text).map(|site| site.cameras[0].lens());
        let unified = lens(r#"{"model": "unified", "xi": 1.1, "focal_px": 300}"#);
        assert!(unified.is_ok_and(|lens| lens.distortion == Distortion::unified(1.1) && lens.focal == 300.0));
        let double = lens(r#"{"model": "double-sphere", "xi": -0.2, "alpha": 0.6, "focal_px": 300}"#);
        assert!(
            double.is_ok_and(|lens| lens.distortion == Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 })
        );
        let mei = lens(r#"{"model": "unified", "xi": 0.8, "k1": -0.3, "p2": 0.001, "focal_px": 300}"#);
        let right = Unified { xi: 0.8, radial: [-0.3, 0.0], tangential: [0.0, 0.001] };
        assert!(mei.is_ok_and(|lens| lens.distortion == Distortion::Unified(right)));
        let eucm = lens(r#"{"model": "eucm", "alpha": 0.6, "focal_px": 300}"#);
        assert!(eucm.is_ok_and(|lens| lens.distortion == Distortion::Eucm { alpha: 0.6, beta: 1.0 }));
        for (text, word) in [
            (r#"{"model": "eucm", "alpha": 0.6, "beta": 0, "focal_px": 300}"#, "above 0"),
            (r#"{"model": "unified", "xi": -1.0, "focal_px": 300}"#, "above -1"),
            (r#"{"model": "double-sphere", "xi": 0.0, "alpha": 1.1, "focal_px": 300}"#, "between 0 and 1"),
            (r#"{"model": "unified", "xi": 1.0, "alpha": 0.5, "focal_px": 300}"#, "of this model"),
            (r#"{"model": "unified", "fit": ["xi"]}"#, "not fitted"),
            (r#"{"model": "double-sphere"}"#, "not fitted"),
            (r#"{"model": "unified", "xi": 1.0}"#, "focal"),
        ] {
            let error = site(text).err().unwrap_or_default();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
