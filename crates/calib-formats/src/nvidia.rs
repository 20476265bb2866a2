//! NVIDIA's files: `camInfo/<id>.yml` for the DeepStream tracker, `calibration.json` for Metropolis, and
//! `map.png` with `transforms.yml` for the view from above in Metropolis.
//!
//! Poses are world to camera, with `OpenCV`'s camera axes. Pixels count from the corner of the image:
//! NVIDIA's detectors have boxes from 0 to the width, and its simulated cameras have their principal point at
//! half the width.

use calib_core::{FloorPoint, Pixel, WorldPoint};
use serde_json::{Value, json};

use crate::export::{Export, Scene};
use crate::file::File;
use crate::file::{FormatError, Problem, quoted};
use crate::given::{
    Imported, ImportedCamera, checked_site, control_point, decompose_projection, intrinsics_from_matrix,
    note_unlikely_poses, site_with_notes,
};
use crate::input::Input;
use crate::tree::{Node, Syntax, digits, pretty};
use crate::view::View;

/// Key of the projection matrix of a camera in `camInfo`.
const KEY: &str = "projectionMatrix_3x4_w2p";
/// Key of the projection matrix in older versions, whose pixels count from the centre of the image.
const OLD_KEY: &str = "projectionMatrix_3x4";
/// Scale of the map of a site without a plan image, in pixels per metre.
const MAP_PX_PER_METRE: f64 = 50.0;

/// Transform from the floor to the map: `pixel = (s (x + tx), height - s (y + ty))`. x and y are in metres, and
/// `height` is the height of the map in pixels. `s` is the scale in pixels per metre, and `t` is (tx, ty) in
/// metres.
#[derive(Clone, Copy, Debug)]
struct Map {
    s: f64,
    t: [f64; 2],
}

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let (map, height) = map(scene, export);
    for view in &scene.views {
        export.report_distortion(view);
        export.push(format!("camInfo/{}.yml", view.file), cam_info(view));
    }
    let sensors: Vec<Value> = scene.views.iter().map(|view| sensor(scene, view, map)).collect();
    let document =
        json!({"version": "1.0", "osmURL": "", "calibrationType": "cartesian", "sensors": sensors});
    export.push("calibration.json", pretty(&document));
    if let (Some(height), Some(plan)) = (height, &scene.options.plan) {
        export.push("transforms.yml", transforms(map, height));
        export.files.push(File { name: "map.png".into(), bytes: plan.png.clone() });
    }
}

/// Returns the map of the site. Returns its height in pixels only if the plan has an image that is parallel
/// to the world axes.
fn map(scene: &Scene, export: &mut Export) -> (Map, Option<f64>) {
    if let (Some(plan), Some(picture)) = (&scene.site.plan, &scene.options.plan) {
        if plan.x_axis_deg == 0.0 {
            let height = f64::from(picture.size[1]);
            let m = plan.metres_per_px;
            let t = [plan.origin_px.x * m, (height - plan.origin_px.y) * m];
            return (Map { s: 1.0 / m, t }, Some(height));
        }
        export.notes.push(
            "map.png and transforms.yml are not written: the plan is not aligned with the world axes".into(),
        );
    } else {
        export.notes.push("map.png and transforms.yml are not written: the site has no plan image".into());
    }
    // Coordinates on the map must not be negative.
    let points =
        || scene.views.iter().flat_map(|v| v.efov_m.iter().copied().chain([v.camera.position.on_floor()]));
    let least = |of: fn(&FloorPoint) -> f64| points().map(|p| of(&p)).fold(f64::INFINITY, f64::min);
    (Map { s: MAP_PX_PER_METRE, t: [-least(|p| p.x).floor(), -least(|p| p.y).floor()] }, None)
}

fn cam_info(view: &View) -> String {
    let rows: String = view
        .projection(view.centre())
        .concat()
        .iter()
        .map(|&value| format!("- {}\n", digits(value)))
        .collect();
    // Size of a person, in metres.
    format!(
        "projectionMatrix_3x4_w2p:\n{rows}\nmodelInfo:\n  - classID: 0\n    height: 1.7\n    radius: 0.3\n"
    )
}

fn transforms(map: Map, height: f64) -> String {
    let Map { s, t: [tx, ty] } = map;
    let [s_, minus] = [s, -s].map(digits);
    let [x, y] = [s * tx, height - s * ty].map(digits);
    let rows = format!("  - [{s_}, 0.0, {x}]\n  - [0.0, {minus}, {y}]\n  - [0.0, 0.0, 1.0]\n");
    format!("T_ov2px:\n{rows}T_gt2px:\n{rows}")
}

fn sensor(scene: &Scene, view: &View, map: Map) -> Value {
    let georeference = scene.site.georeference();
    let earth = georeference.as_ref();
    let origin = json!({"lng": earth.map_or(0.0, |e| e.lon_deg), "lat": earth.map_or(0.0, |e| e.lat_deg)});
    let corners = corners(view);
    let image: Vec<Value> = corners
        .iter()
        .filter_map(|p| view.project_undistorted(p.at_height(0.0)).map(|px| json!({"x": px.u, "y": px.v})))
        .collect();
    let globe: Vec<Value> = corners.iter().map(|p| json!({"x": p.x, "y": p.y, "z": 0.0})).collect();
    let attribute = |name: &str, value: String| json!({"name": name, "value": value});
    let heading = (-view.camera.yaw.to_degrees()).rem_euclid(360.0);
    let position = view.camera.position;
    json!({
        "type": "camera", "id": view.id,
        "origin": origin, "geoLocation": origin,
        "coordinates": {"x": position.x, "y": position.y},
        "scaleFactor": map.s,
        "translationToGlobalCoordinates": {"x": map.t[0], "y": map.t[1]},
        "attributes": [
            attribute("fps", "30".into()),
            attribute("depth", String::new()),
            attribute("fieldOfView", String::new()),
            attribute("direction", digits(heading)),
            attribute("source", "vst".into()),
            attribute("frameWidth", view.size[0].to_string()),
            attribute("frameHeight", view.size[1].to_string()),
            attribute("fieldOfViewPolygon", polygon(&view.efov_m)),
        ],
        "place": [{"name": "building", "value": scene.site.name.as_deref().unwrap_or("site")}],
        "imageCoordinates": image, "globalCoordinates": globe,
        "intrinsicMatrix": view.intrinsics(view.centre()),
        "extrinsicMatrix": view.extrinsics(),
        "cameraMatrix": view.projection(view.centre()),
        "homography": view.floor_from_pixel(),
        "tripwires": [], "rois": [],
    })
}

/// Formats a closed polygon as WKT.
fn polygon(corners: &[FloorPoint]) -> String {
    if corners.is_empty() {
        return "POLYGON EMPTY".into();
    }
    let point = |p: &FloorPoint| format!("{} {}", digits(p.x), digits(p.y));
    let ring: Vec<String> = corners.iter().chain(corners.first()).map(point).collect();
    format!("POLYGON(({}))", ring.join(", "))
}

/// Returns floor points that the camera shows: up to eight corners of the EFOV. If the EFOV has fewer than four
/// corners, the points halfway between each corner and the mean of the corners are added.
fn corners(view: &View) -> Vec<FloorPoint> {
    /// Maximum number of corners of the EFOV that are used.
    const MAX_CORNERS: usize = 8;
    let all = &view.efov_m;
    let count = all.len().max(1) as f64;
    let sum = all.iter().fold([0.0; 2], |s, p| [s[0] + p.x, s[1] + p.y]);
    let middle = FloorPoint::new(sum[0] / count, sum[1] / count);
    let some = all.iter().step_by(all.len().div_ceil(MAX_CORNERS).max(1)).copied();
    let between = all.iter().map(|p| FloorPoint::new(0.5 * (p.x + middle.x), 0.5 * (p.y + middle.y)));
    let more = if all.len() < 4 { between.collect() } else { Vec::new() };
    some.chain(more).filter(|p| view.project_undistorted(p.at_height(0.0)).is_some()).collect()
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    if let Some(file) = files.iter().find(|file| file.extension() == "json") {
        let mut imported = calibration(file, files)?;
        imported.notes.extend(unread_notes(files, |other| other.name != file.name));
        return Ok(imported);
    }
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter().filter(|file| file.base() != "transforms.yml") {
        let tree = Syntax::Yaml.parse(file)?;
        let root = Node::root(file, &tree);
        let camera = match root.get(OLD_KEY).filter(|_| root.get(KEY).is_none()) {
            Some(node) => centred(file.stem(), &node, files, &mut rest)?,
            None => projected(file.stem(), &root.require(&[KEY])?)?,
        };
        given.push(camera.with_path(&file.name));
        rest.extend(root.unread_keys());
    }
    rest.extend(unread_notes(files, |file| file.base() == "transforms.yml"));
    let mut imported = site_with_notes(given, rest, files, &files[0].name)?;
    note_unlikely_poses(&mut imported);
    Ok(imported)
}

/// Returns a note for each file that the import does not read.
fn unread_notes<'a>(
    files: &'a [File],
    is_unread: impl Fn(&File) -> bool + 'a,
) -> impl Iterator<Item = String> + 'a {
    files.iter().filter(move |file| is_unread(file)).map(|file| format!("{}: not imported", file.name))
}

fn rows(values: [f64; 12]) -> [[f64; 4]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| values[4 * i + j]))
}

fn projected(id: &str, node: &Node) -> Result<ImportedCamera, FormatError> {
    let (k, pose) = decompose_projection(&rows(node.exactly()?), node.place())?;
    Ok(ImportedCamera { pose: Some(pose), ..ImportedCamera::new(id, node.place(), k) })
}

/// Reads the projection matrix of older versions of `DeepStream`, whose pixels count from the centre of the image.
fn centred(
    id: &str,
    node: &Node,
    input: &Input,
    notes: &mut Vec<String>,
) -> Result<ImportedCamera, FormatError> {
    let Some([width, height]) = input.size() else {
        return Err(FormatError::new(node.place(), Problem::NoSizeOfCentred));
    };
    let [a, b, c] = rows(node.exactly()?);
    // A pixel (u, v) from the centre is (u + W/2, v + H/2) from the corner.
    let shifted = |row: [f64; 4], side: u32| std::array::from_fn(|j| row[j] + 0.5 * f64::from(side) * c[j]);
    let (k, pose) = decompose_projection(&[shifted(a, width), shifted(b, height), c], node.place())?;
    notes.push(format!(
        "{OLD_KEY} of {}: pixels are read relative to the centre of the image ({width} x {height} px)",
        quoted(id)
    ));
    let camera = ImportedCamera::new(id, node.place(), k);
    Ok(ImportedCamera { size: Some([width, height]), pose: Some(pose), ..camera })
}

fn calibration(file: &File, input: &Input) -> Result<Imported, FormatError> {
    let tree = Syntax::Json.parse(file)?;
    let root = Node::root(file, &tree);
    let (mut notes, mut cameras) = (Vec::new(), Vec::new());
    let sensors = root.require(&["sensors"])?.items()?;
    if sensors.len() > calib_site::MAX_CAMERAS {
        return Err(root.unexpected(&format!("at most {} sensors", calib_site::MAX_CAMERAS)));
    }
    for sensor in sensors {
        if sensor.get("type").is_some_and(|kind| kind.text().is_ok_and(|kind| kind != "camera")) {
            continue;
        }
        let id = sensor.require(&["id"])?.text()?;
        let mut given =
            if let (Some(k), Some(e)) = (sensor.get("intrinsicMatrix"), sensor.get("extrinsicMatrix")) {
                let [a, b, c] = rows(e.exactly()?);
                let rotation = [a, b, c].map(|row| [row[0], row[1], row[2]]);
                let lens = intrinsics_from_matrix(&k.matrix()?, k.place())?;
                ImportedCamera {
                    pose: Some((rotation, [a[3], b[3], c[3]])),
                    ..ImportedCamera::new(id, sensor.place(), lens)
                }
            } else {
                projected(id, &sensor.require(&["cameraMatrix"])?)?
            };
        given.size = frame_size(&sensor)?;
        let mut entry = given.stated_by(input).into_entry(&mut notes)?;
        for (px, world) in pairs(&sensor)? {
            entry.control_points.push(control_point(px, input.point(world)));
        }
        cameras.push(entry);
    }
    notes.extend(root.unread_keys());
    checked_site(cameras, notes, &file.name)
}

fn frame_size(sensor: &Node) -> Result<Option<[u32; 2]>, FormatError> {
    let Some(attributes) = sensor.get("attributes") else { return Ok(None) };
    let mut size = [None; 2];
    for attribute in attributes.items()? {
        let (Some(name), Some(value)) = (attribute.get("name"), attribute.get("value")) else { continue };
        let index = match name.text()? {
            "frameWidth" => 0,
            "frameHeight" => 1,
            _ => continue,
        };
        // The schema requires text; some programs write a number.
        size[index] = match value.text() {
            Ok("") => None,
            Ok(text) => {
                let most = calib_site::MAX_SIDE;
                let side = text.parse().ok().filter(|side| (1..=most).contains(side));
                Some(side.ok_or_else(|| value.unexpected("a whole number of pixels"))?)
            }
            Err(_) => Some(value.side()?),
        };
    }
    Ok(size[0].zip(size[1]).map(|(width, height)| [width, height]))
}

/// Returns the pixels of a sensor with the world points that they show.
fn pairs(sensor: &Node) -> Result<Vec<(Pixel, WorldPoint)>, FormatError> {
    let (Some(image), Some(globe)) = (sensor.get("imageCoordinates"), sensor.get("globalCoordinates")) else {
        return Ok(Vec::new());
    };
    let (image, globe) = (image.items()?, globe.items()?);
    if image.len() != globe.len() {
        let problem = Problem::Unpaired { pixels: image.len(), points: globe.len() };
        return Err(FormatError::new(sensor.place(), problem));
    }
    let of = |node: &Node, key: &str| node.require(&[key])?.number();
    let pair = |(pixel, point): (&Node, &Node)| {
        let z = point.get("z").map_or(Ok(0.0), |z| z.number())?;
        let world = WorldPoint::new(of(point, "x")?, of(point, "y")?, z);
        Ok((Pixel::new(of(pixel, "x")?, of(pixel, "y")?), world))
    };
    image.iter().zip(&globe).map(pair).collect()
}
