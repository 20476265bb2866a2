//! Reader of the site file: size limits before parsing, then checks of values and references. An error has a
//! JSON pointer.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};

use serde_json::value::RawValue;

use crate::bounds::{At, Bounds, Checked, count, id, known, name, optional, pixels, pointer_of};
use crate::bounds::{MAX_CAMERAS, MAX_ITEMS};
use crate::check_entries::check_elements;
use crate::check_entries::{check_circle, check_distortion, check_solution};
use crate::check_entries::{check_plane_id, check_planes, check_survey};
use crate::check_geographic::{check_coordinate_system, check_geographic, check_ground_points};
use crate::data_sheet::{Nominal, sensor_diagonal_mm};
use crate::document::{ControlPointEntry, Georeference, LensEntry, Plan, Site, SiteCamera};
use crate::geographic::SurveyedPosition;
use crate::period::check_periods;
use crate::principal_point::PrincipalPointEntry;
use crate::scene::SceneEntry;
use crate::site_error::{
    ErrorSubject, NamedAnnotation, SiteError, SiteErrorKind, kind_from_json_error, quoted,
};
use calib_core::single::{Annotation, FieldUse, USUAL_SIZES};

/// Largest length of a site file, in bytes, including `data:` images.
pub const MAX_BYTES: usize = 1 << 30;
/// Largest number of values in a site file. The limit prevents a file of empty lists from filling the memory.
pub const MAX_VALUES: usize = 4_000_000;
/// Largest number of segments and polylines of one camera. It is far above practical use, and such a camera
/// is solved within minutes even if half of its lines are wrong.
const MAX_LINES_PER_CAMERA: usize = 20_000;
/// Largest number of segments and polylines of all cameras together, to bound the solving time of the site.
const MAX_LINES_PER_SITE: usize = 100_000;
/// Largest width or height of an image, in pixels.
pub const MAX_SIDE: u32 = 65_536;

impl Site {
    /// Reads and checks a site file.
    ///
    /// # Errors
    /// The first error in the file, with its JSON pointer.
    pub fn from_json(text: &str) -> Result<Self, SiteError> {
        Self::from_json_with_drawing(text, |_| None)
    }

    /// Reads and checks a site file whose plan may be a drawing that states its scale. If the file has no scale,
    /// `metres_per_px` is called. It returns the size of a plan pixel in metres, or `None` if it is unknown.
    ///
    /// # Errors
    /// The first error in the file, with its JSON pointer.
    pub fn from_json_with_drawing(
        text: &str,
        metres_per_px: impl FnOnce(&Plan) -> Option<f64>,
    ) -> Result<Self, SiteError> {
        if text.len() > MAX_BYTES {
            let fault = SiteErrorKind::TooLong { bytes: text.len(), most: MAX_BYTES };
            return Err(SiteError::for_document(fault));
        }
        let values = count_values(text);
        if values > MAX_VALUES {
            return Err(SiteError::for_document(SiteErrorKind::TooManyValues { values, most: MAX_VALUES }));
        }
        let mut reader = serde_json::Deserializer::from_str(text);
        let mut site: Self = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
            let pointer = pointer_of(error.path());
            let fault = kind_from_json_error(&error.into_inner());
            with_subject(text, SiteError { pointer, kind: fault, subject: None })
        })?;
        reader.end().map_err(|error| SiteError::for_document(kind_from_json_error(&error)))?;
        if let Some(plan) = site.plan.as_mut().filter(|plan| plan.metres_per_px.is_nan()) {
            plan.metres_per_px = metres_per_px(plan).unwrap_or(f64::NAN);
        }
        match site.check() {
            Ok(()) => {
                site.place_surveyed_marks();
                Ok(site)
            }
            Err(error) => {
                // The text is parsed again for the names, so the memory of the site is released first.
                drop(site);
                Err(with_subject(text, error))
            }
        }
    }

    /// Checks all values and references.
    ///
    /// # Errors
    /// The first error, with its JSON pointer.
    pub fn check(&self) -> Checked {
        let root = At::root();
        if self.version != 1 {
            return root.key("version").expected(self.version, "1, the only supported version");
        }
        name(&root.key("name"), self.name.as_ref())?;
        if let Some(plan) = &self.plan {
            check_plan(&root.key("plan"), plan)?;
        }
        if let Some(georeference) = &self.georeference {
            check_georeference(&root.key("georeference"), georeference)?;
        }
        check_scene(&root.key("scene"), self.scene.as_ref())?;
        check_planes(&root.key("planes"), &self.planes)?;
        let cameras = root.key("cameras");
        count(&cameras, self.cameras.len(), MAX_CAMERAS)?;
        check_coordinate_system(&root, self)?;
        for (i, camera) in self.cameras.iter().enumerate() {
            check_camera(&cameras.index(i), camera, self)?;
        }
        check_site_lines(&cameras, &self.cameras)?;
        check_periods(&cameras, &self.cameras)?;
        check_elements(&root, self)?;
        check_survey(&root, self)?;
        check_ground_points(&root, self)
    }
}

/// Adds the camera and the annotation to an error, with the names that the operator gave them.
fn with_subject(text: &str, error: SiteError) -> SiteError {
    let about = error_subject(text, &error.pointer);
    SiteError { subject: about, ..error }
}

/// Returns the camera and the annotation that contain the value at a JSON pointer.
fn error_subject(text: &str, pointer: &str) -> Option<Box<ErrorSubject>> {
    let mut parts = pointer.split('/').skip(1);
    let (Some("cameras"), Some(index)) = (parts.next(), parts.next()) else { return None };
    let camera = item(field(text, "cameras")?, index)?;
    let annotation = parts.next().filter(|&list| list == "annotations").and(parts.next()).map(|place| {
        let entry = field(camera, "annotations").and_then(|list| item(list, place)).unwrap_or_default();
        NamedAnnotation {
            kind: text_of(entry, "kind").unwrap_or_default(),
            name: text_of(entry, "name").or_else(|| text_of(entry, "id")),
            index: place.to_owned(),
        }
    });
    Some(Box::new(ErrorSubject { camera: text_of(camera, "id")?, annotation }))
}

/// Returns the unparsed value of a field of a JSON object. The values of the document are not built in memory.
fn field<'a>(object: &'a str, key: &str) -> Option<&'a str> {
    let fields: HashMap<Cow<'_, str>, &RawValue> = serde_json::from_str(object).ok()?;
    fields.get(key).map(|value| value.get())
}

/// Returns the unparsed item of a JSON list.
fn item<'a>(list: &'a str, index: &str) -> Option<&'a str> {
    let items: Vec<&RawValue> = serde_json::from_str(list).ok()?;
    items.get(index.parse::<usize>().ok()?).map(|value| value.get())
}

/// Returns a text field of a JSON object.
fn text_of(object: &str, key: &str) -> Option<String> {
    serde_json::from_str(field(object, key)?).ok()
}

/// Estimates the number of values in a JSON text: one for every bracket and comma outside strings.
fn count_values(text: &str) -> usize {
    let (mut values, mut in_string, mut escaped) = (0, false, false);
    for byte in text.bytes() {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if in_string => escaped = true,
            b'"' => in_string = !in_string,
            b'[' | b'{' | b',' if !in_string => values += 1,
            _ => {}
        }
    }
    values
}

/// Checks the values of a floor plan: page, layers, scale, origin, direction of the x axis, and georeference.
fn check_plan(at: &At, plan: &Plan) -> Checked {
    /// Largest number of shown layers.
    const MAX_LAYERS: usize = 10_000;
    if plan.metres_per_px.is_nan() {
        return at.key("metres_per_px").expected(
            "nothing",
            "the size of a plan pixel in metres; only `calib` and the desktop app read it from a drawing",
        );
    }
    if plan.page == Some(0) {
        return at.key("page").expected(0, "a page number of 1 or more");
    }
    count(&at.key("layers"), plan.layers.iter().flatten().count(), MAX_LAYERS)?;
    Bounds::POSITIVE.check(&at.key("metres_per_px"), plan.metres_per_px)?;
    Bounds::COORDINATE.check_all(&at.key("origin_px"), &<[f64; 2]>::from(plan.origin_px))?;
    Bounds::DEGREES.check(&at.key("x_axis_deg"), plan.x_axis_deg)?;
    plan.georeference.as_ref().map_or(Ok(()), |g| check_georeference(&at.key("georeference"), g))
}

fn check_georeference(at: &At, georeference: &Georeference) -> Checked {
    Bounds::PITCH.check(&at.key("lat_deg"), georeference.lat_deg)?;
    Bounds::DEGREES.check(&at.key("lon_deg"), georeference.lon_deg)?;
    optional(&at.key("alt_m"), georeference.alt_m, Bounds::COORDINATE)?;
    Bounds::DEGREES.check(&at.key("x_axis_azimuth_deg"), georeference.x_axis_azimuth_deg)
}

/// Checks one camera entry with its annotations, control points and solution.
fn check_camera(at: &At, camera: &SiteCamera, site: &Site) -> Checked {
    id(&at.key("id"), Some(&camera.id))?;
    name(&at.key("name"), camera.name.as_ref())?;
    for (i, &side) in camera.size_px.iter().enumerate() {
        if side == 0 || side > MAX_SIDE {
            return at.key("size_px").index(i).expected(side, format!("1 to {MAX_SIDE} pixels"));
        }
    }
    check_lens(&at.key("lens"), camera, site)?;
    known(&at.key("height_m"), camera.height_m.as_ref(), Bounds::POSITIVE)?;
    optional(&at.key("sigma_px"), camera.sigma_px, Bounds::POSITIVE)?;
    check_scene(&at.key("scene"), camera.scene.as_ref())?;
    let annotations = at.key("annotations");
    count(&annotations, camera.annotations.len(), MAX_ITEMS)?;
    check_annotations(&annotations, &camera.annotations)?;
    for (i, annotation) in camera.annotations.iter().enumerate() {
        check_plane_id(&annotations.index(i).key("plane"), annotation.plane.as_ref(), site)?;
    }
    check_plane_id(&at.key("efov_plane"), camera.efov_plane.as_ref(), site)?;
    check_lines(&annotations, &camera.annotations)?;
    if let Some(corners) = &camera.efov_px {
        let efov = at.key("efov_px");
        pixels(&efov, corners, 3)?;
        // Enough for any outline. The limit bounds the time for the floor accuracy, which is computed at
        // every corner.
        count(&efov, corners.len(), 1000)?;
    }
    if let Some(placement) = &camera.placement {
        let at = at.key("placement");
        Bounds::COORDINATE.check_all(&at.key("move_m"), &<[f64; 2]>::from(placement.move_m))?;
        Bounds::DEGREES.check(&at.key("turn_deg"), placement.turn_deg)?;
        if let Some(scale) = placement.scale {
            Bounds { high: 1e6, ..Bounds::POSITIVE }.check(&at.key("scale"), scale)?;
        }
    }
    let points = at.key("control_points");
    count(&points, camera.control_points.len(), MAX_ITEMS)?;
    let mut ids = HashSet::new();
    for (i, point) in camera.control_points.iter().enumerate() {
        check_control_point(&points.index(i), point, site)?;
        if let Some(id) = point.id.as_ref().filter(|id| !ids.insert(id.as_str())) {
            let at = points.index(i);
            return at.key("id").expected(quoted(id), "an id that no other control point of this camera has");
        }
    }
    camera.solution.as_ref().map_or(Ok(()), |solution| check_solution(&at.key("solution"), solution))
}

/// Checks the values from a data sheet: fields of view, focal length in millimetres, and sensor size.
fn check_data_sheet(at: &At, lens: &LensEntry) -> Checked {
    const FIELD: Bounds = Bounds { low: 0.1, high: 179.0, ..Bounds::POSITIVE };
    let fields = [("hfov_deg", lens.hfov_deg), ("vfov_deg", lens.vfov_deg), ("dfov_deg", lens.dfov_deg)];
    for (key, field) in fields {
        known(&at.key(key), field.map(Nominal::known).as_ref(), FIELD)?;
    }
    known(&at.key("focal_mm"), lens.focal_mm.map(Nominal::known).as_ref(), Bounds::POSITIVE)?;
    if let Some(sensor) = &lens.sensor_mm {
        sensor.iter().try_for_each(|&side| Bounds::POSITIVE.check(&at.key("sensor_mm"), side))?;
    }
    match (&lens.focal_mm, lens.sensor_mm, &lens.sensor) {
        (_, _, Some(format)) if sensor_diagonal_mm(format).is_none() => {
            at.key("sensor").expected(quoted(format), "an optical format in inches, such as \"1/2.8\"")
        }
        (Some(_), None, None) => {
            at.key("focal_mm").expected("no sensor size", "\"sensor_mm\" or \"sensor\", such as \"1/2.8\"")
        }
        (_, Some(_), Some(_)) => {
            at.key("sensor").expected("both \"sensor_mm\" and \"sensor\"", "only one of them")
        }
        (None, Some(_), _) | (None, _, Some(_)) => {
            at.expected("a sensor size without \"focal_mm\"", "\"focal_mm\"")
        }
        _ => Ok(()),
    }
}

/// Checks the window of a lens. With a window, the size of the calibrated image is unknown, so values from a
/// data sheet are refused. `like` is refused, too.
fn check_window(at: &At, window: [f64; 4], lens: &LensEntry) -> Checked {
    Bounds::COORDINATE.check_all(at, &window)?;
    window[2..].iter().try_for_each(|&side| Bounds { low: 1.0, ..Bounds::POSITIVE }.check(at, side))?;
    let has_field = lens.hfov_deg.is_some() || lens.vfov_deg.is_some() || lens.dfov_deg.is_some();
    if has_field || lens.focal_mm.is_some() {
        return at
            .expected("a window together with a data sheet value", "\"focal_px\" instead of this value");
    }
    if lens.like.is_some() {
        return at.expected("a window together with \"like\"", "the lens values of the calibrated image");
    }
    Ok(())
}

/// Checks the entered lens values and the reference `like` to another camera.
fn check_lens(at: &At, camera: &SiteCamera, site: &Site) -> Checked {
    let Some(lens) = &camera.lens else { return Ok(()) };
    known(&at.key("focal_px"), lens.focal_px.as_ref(), Bounds { low: 1.0, ..Bounds::POSITIVE })?;
    check_data_sheet(at, lens)?;
    known(&at.key("roll_deg"), lens.roll_deg.as_ref(), Bounds::DEGREES)?;
    known(&at.key("pitch_deg"), lens.pitch_deg.as_ref(), Bounds::PITCH)?;
    if let Some(PrincipalPointEntry { value, sigma }) = lens.principal_point_px {
        let at = at.key("principal_point_px");
        Bounds::COORDINATE.check_all(&at, &<[f64; 2]>::from(value))?;
        sigma.map_or(Ok(()), |sigma| Bounds::POSITIVE.check(&at.key("sigma"), sigma))?;
    }
    if let Some(aspect) = lens.pixel_aspect {
        let at = at.key("pixel_aspect");
        Bounds::PIXEL_ASPECT.check(&at, aspect.start(camera.size_px))?;
        let sigma = aspect.prior(camera.size_px).map(|prior| prior.sigma);
        sigma.map_or(Ok(()), |sigma| Bounds::POSITIVE.check(&at.key("sigma"), sigma))?;
    }
    if let Some(window) = lens.window_px {
        check_window(&at.key("window_px"), window, lens)?;
    }
    if let Some(circle) = lens.image_circle_px {
        check_circle(&at.key("image_circle_px"), circle)?;
    }
    if let Some(distortion) = &lens.distortion {
        check_distortion(&at.key("distortion"), distortion, lens.focal_px.map(|focal| focal.value))?;
    }
    let Some(like) = &lens.like else { return Ok(()) };
    let at = at.key("like");
    match site.cameras.iter().find(|other| &other.id == like) {
        None => at.expected(quoted(like), "the id of a camera of this site"),
        Some(other) if other.id == camera.id => at.expected("the camera itself", "another camera"),
        Some(other) if other.lens.as_ref().is_some_and(|lens| lens.like.is_some()) => at.expected(
            format!("{}, which itself uses the lens of another camera", quoted(like)),
            "the camera that owns the lens",
        ),
        Some(_) => Ok(()),
    }
}

fn check_annotations(at: &At, annotations: &[Annotation]) -> Checked {
    let mut ids = HashSet::new();
    for (i, annotation) in annotations.iter().enumerate() {
        let at = at.index(i);
        check_annotation(&at, annotation)?;
        if let Some(id) = annotation.id.as_ref().filter(|id| !ids.insert(id.as_str())) {
            return at.key("id").expected(quoted(id), "an id that no other annotation of this camera has");
        }
    }
    check_right_angle_references(at, annotations)
}

/// Returns the number of segments and polylines of these annotations.
fn line_count(annotations: &[Annotation]) -> usize {
    annotations.iter().map(|annotation| annotation.segments.as_ref().map_or(1, Vec::len)).sum()
}

/// Checks the number of lines of all cameras together.
fn check_site_lines(at: &At, cameras: &[SiteCamera]) -> Checked {
    let found: usize = cameras.iter().map(|camera| line_count(&camera.annotations)).sum();
    if found <= MAX_LINES_PER_SITE {
        return Ok(());
    }
    at.expected(
        format!("{found} segments and polylines in all cameras together"),
        format!("at most {MAX_LINES_PER_SITE} in one site; a few dozen are enough for a camera"),
    )
}

/// Checks the number of lines of one camera.
fn check_lines(at: &At, annotations: &[Annotation]) -> Checked {
    let found = line_count(annotations);
    if found <= MAX_LINES_PER_CAMERA {
        return Ok(());
    }
    at.expected(
        format!("{found} segments and polylines"),
        format!("at most {MAX_LINES_PER_CAMERA} in one camera; a few dozen are enough"),
    )
}

/// Checks the fields of one annotation against its kind, and their values.
fn check_annotation(at: &At, annotation: &Annotation) -> Checked {
    id(&at.key("id"), annotation.id.as_ref())?;
    name(&at.key("name"), annotation.name.as_ref())?;
    let row = annotation.kind.row();
    for (key, is_there, belongs) in annotation.fields() {
        if is_there && belongs == FieldUse::Never {
            let expected = format!("only fields of annotations of kind {:?}", row.name);
            return at.key(key).expected(format!("{key:?}"), expected);
        }
        if !is_there && belongs == FieldUse::Always {
            return at.expected(format!("{} without {key:?}", row.name), format!("{key:?}"));
        }
    }
    for (i, segment) in annotation.segments.iter().flatten().enumerate() {
        pixels(&at.key("segments").index(i), segment, 2)?;
    }
    if let Some(points) = &annotation.points {
        pixels(&at.key("points"), points, 3)?;
    }
    for (key, pixel) in [("foot", annotation.foot), ("head", annotation.head)] {
        if let Some(pixel) = pixel {
            Bounds::COORDINATE.check_all(&at.key(key), &<[f64; 2]>::from(pixel))?;
        }
    }
    optional(&at.key("length_m"), annotation.length_m, Bounds::POSITIVE)?;
    check_like(&at.key("like"), annotation)?;
    optional(&at.key("sigma_px"), annotation.sigma_px, Bounds::POSITIVE)?;
    optional(&at.key("angle_sigma_deg"), annotation.angle_sigma_deg, Bounds::SCENE_DEGREES)?;
    optional(&at.key("length_sigma_rel"), annotation.length_sigma_rel, Bounds::SHARE)?;
    known(&at.key("height_m"), annotation.height_m.as_ref(), Bounds::POSITIVE)
}

/// Checks that `like` names an entry of the table of usual sizes, and that the entry fits the constraint of this
/// annotation, for example a length.
fn check_like(at: &At, annotation: &Annotation) -> Checked {
    let Some(like) = &annotation.like else { return Ok(()) };
    let constraint = annotation.kind.row().constraint;
    let names = || -> Vec<&str> {
        USUAL_SIZES.iter().filter(|usual| usual.constraint == constraint).map(|usual| usual.id).collect()
    };
    match annotation.usual_size().filter(|usual| usual.constraint == constraint) {
        Some(_) => Ok(()),
        None => at.expected(quoted(like), format!("one of {}", names().join(", "))),
    }
}

/// Checks the standard deviations of the scene errors.
fn check_scene(at: &At, scene: Option<&SceneEntry>) -> Checked {
    let Some(SceneEntry::Sigmas(sigmas)) = scene else { return Ok(()) };
    optional(&at.key("floor_tilt_sigma_deg"), sigmas.floor_tilt_sigma_deg, Bounds::SCENE_DEGREES)?;
    let crossfall = at.key("crossfall_sigma_deg");
    optional(&crossfall, sigmas.crossfall_sigma_deg, Bounds::SCENE_DEGREES)?;
    let falls = sigmas.crossfall_sigma_deg.is_some_and(|sigma| sigma > 0.0);
    if falls && sigmas.floor_tilt_sigma_deg == Some(0.0) {
        return crossfall.expected(
            sigmas.crossfall_sigma_deg.unwrap_or_default(),
            "0, because floor_tilt_sigma_deg is 0: a level floor has no crossfall",
        );
    }
    optional(&at.key("angle_sigma_deg"), sigmas.angle_sigma_deg, Bounds::SCENE_DEGREES)?;
    optional(&at.key("length_sigma_rel"), sigmas.length_sigma_rel, Bounds::SHARE)
}

/// Checks that references by `at_right_angles_to` lead to parallel annotations and do not form a cycle.
fn check_right_angle_references(at: &At, annotations: &[Annotation]) -> Checked {
    let by_id: HashMap<&str, usize> = annotations
        .iter()
        .enumerate()
        .filter(|(_, a)| a.can_be_tied())
        .filter_map(|(i, a)| Some((a.id.as_deref()?, i)))
        .collect();
    let tie = |i: usize| annotations[i].at_right_angles_to.as_deref();
    // State of each annotation: unvisited, on the current chain, or known to end without a cycle.
    let (mut on_chain, mut ends) = (vec![false; annotations.len()], vec![false; annotations.len()]);
    for start in 0..annotations.len() {
        let mut chain = Vec::new();
        let mut here = start;
        while !ends[here] {
            on_chain[here] = true;
            chain.push(here);
            let Some(id) = tie(here) else { break };
            let index = at.index(here);
            let field = index.key("at_right_angles_to");
            match by_id.get(id) {
                None => return field.expected(quoted(id), "the id of a parallel annotation of this camera"),
                Some(&next) if on_chain[next] => {
                    return field.expected("references that form a cycle", "references without a cycle");
                }
                Some(&next) => here = next,
            }
        }
        for link in chain {
            on_chain[link] = false;
            ends[link] = true;
        }
    }
    Ok(())
}

/// Checks the values of a control point, and that it has coordinates, but not both `world_m` and `plan_px`.
fn check_control_point(at: &At, point: &ControlPointEntry, site: &Site) -> Checked {
    id(&at.key("id"), point.id.as_ref())?;
    name(&at.key("name"), point.name.as_ref())?;
    Bounds::COORDINATE.check_all(&at.key("px"), &<[f64; 2]>::from(point.px))?;
    if let Some(world) = point.world_m {
        Bounds::COORDINATE.check_all(&at.key("world_m"), &<[f64; 3]>::from(world))?;
        if point.height_m.is_some() {
            let expected = "no \"height_m\" together with \"world_m\", which includes the height";
            return at.key("height_m").expected("\"height_m\"", expected);
        }
    }
    if let Some(plan) = point.plan_px {
        let at = at.key("plan_px");
        Bounds::COORDINATE.check_all(&at, &<[f64; 2]>::from(plan))?;
        if site.plan.is_none() {
            return at.expected("\"plan_px\" in a site without a plan", "\"world_m\", or a plan");
        }
    }
    if point.world_m.is_some() && point.plan_px.is_some() {
        return at.expected("both \"world_m\" and \"plan_px\"", "only one of them");
    }
    optional(&at.key("height_m"), point.height_m, Bounds::COORDINATE)?;
    optional(&at.key("sigma_px"), point.sigma_px, Bounds::POSITIVE)?;
    optional(&at.key("sigma_m"), point.sigma_m, Bounds::POSITIVE)?;
    let has_site_coordinates = point.world_m.is_some() || point.plan_px.is_some();
    let position = SurveyedPosition::of_control_point(point);
    if !has_site_coordinates && !position.is_entered() && position.alt_m.is_none() {
        let expected = "\"world_m\", or \"plan_px\" with \"height_m\", or \"lat_deg\" and \"lon_deg\", or \
                        \"crs_m\"";
        return at.expected("no coordinates", expected);
    }
    check_geographic(at, &position, has_site_coordinates, site)
}
