//! Named points with known coordinates, from GPX, KML, `GeoJSON` and tables (CSV). They become ground points of a
//! site, which the operator clicks in the images later. Also the export of cameras as GPX and KML.
//!
//! Coordinates are WGS84. A table can also contain east and north in the grid of the site, or x and y of the site.
//! Altitudes of GPX and KML files are heights above sea level and are not used: points are on the floor unless a
//! table states their height above it.

use std::collections::HashSet;
use std::fmt::Write as _;

use calib_core::WorldPoint;
use calib_site::{GroundPoint, Site};
use roxmltree::Node;
use serde_json::Value;

use crate::export::{Export, Scene};
use crate::file::{File, FormatError, quoted};
use crate::geojson::to_wgs84;
use crate::given::Imported;
use crate::input::Input;
use crate::tree::{Syntax, escaped, xml};

/// Largest number of points of an import.
const MAX_POINTS: usize = 10_000;
/// Standard deviation of a position of a phone or hand-held receiver, in metres.
const PHONE_SIGMA_M: f64 = 4.0;
/// Standard deviation of a position that was marked on an aerial image, in metres.
const MAP_SIGMA_M: f64 = 0.5;

/// Reads the waypoints of a GPX file.
pub(crate) fn read_gpx(files: &Input) -> Result<Imported, FormatError> {
    let mut points = Points::default();
    for file in files.iter() {
        let document = xml(file)?;
        let waypoints = document.descendants().filter(|node| has_name(node, "wpt"));
        for (index, node) in waypoints.enumerate() {
            let place = format!("{}: waypoint {}", file.name, index + 1);
            let degrees = |name: &str| {
                let text = node.attribute(name).unwrap_or_default();
                number(text).ok_or_else(|| {
                    FormatError::expected(&place, format!("{name} {}", quoted(text)), "a number of degrees")
                })
            };
            let (lat, lon) = (degrees("lat")?, degrees("lon")?);
            let point = GroundPoint { lat_deg: Some(lat), lon_deg: Some(lon), ..GroundPoint::default() };
            points.add(child_text(&node, "name"), child_text(&node, "desc"), point, &place)?;
        }
    }
    points.finish(files, "GPX file with waypoints (wpt)", Some(PHONE_SIGMA_M))
}

/// Reads the points of a KML file: placemarks with a point.
pub(crate) fn read_kml(files: &Input) -> Result<Imported, FormatError> {
    let mut points = Points::default();
    for file in files.iter() {
        let document = xml(file)?;
        let placemarks = document.descendants().filter(|node| has_name(node, "Placemark"));
        for (index, node) in placemarks.enumerate() {
            let Some(at) = node.descendants().find(|node| has_name(node, "Point")) else { continue };
            let place = format!("{}: placemark {}", file.name, index + 1);
            let text = child_text(&at, "coordinates").unwrap_or_default();
            let mut numbers = text.split(',').map(number);
            let (Some(Some(lon)), Some(Some(lat))) = (numbers.next(), numbers.next()) else {
                return Err(FormatError::expected(&place, quoted(&text), "longitude,latitude in degrees"));
            };
            let point = GroundPoint { lat_deg: Some(lat), lon_deg: Some(lon), ..GroundPoint::default() };
            points.add(child_text(&node, "name"), child_text(&node, "description"), point, &place)?;
        }
    }
    points.finish(files, "KML file with placemarks of points", Some(MAP_SIGMA_M))
}

/// Reads the points of a `GeoJSON` file.
pub(crate) fn read_geojson(files: &Input) -> Result<Imported, FormatError> {
    let mut points = Points::default();
    for file in files.iter() {
        let value = Syntax::Json.parse(file)?;
        let features: Vec<&Value> = match value.get("features").and_then(Value::as_array) {
            Some(features) => features.iter().collect(),
            None => vec![&value],
        };
        let is_local = value.get("frame").and_then(Value::as_str) == Some("site");
        for (index, feature) in features.into_iter().enumerate() {
            let geometry = &feature["geometry"];
            if geometry["type"] != "Point" {
                continue;
            }
            let place = format!("{}: /features/{index}", file.name);
            let coordinates = &geometry["coordinates"];
            let (Some(x), Some(y)) = (coordinates[0].as_f64(), coordinates[1].as_f64()) else {
                let expected = "longitude and latitude in degrees";
                return Err(FormatError::expected(&place, coordinates, expected));
            };
            let text = |keys: &[&str]| {
                let found =
                    keys.iter().map(|key| &feature["properties"][key]).find(|value| !value.is_null())?;
                Some(found.as_str().map_or_else(|| found.to_string(), str::to_owned))
            };
            let point = if is_local {
                GroundPoint { world_m: Some(WorldPoint::new(x, y, 0.0)), ..GroundPoint::default() }
            } else {
                GroundPoint { lat_deg: Some(y), lon_deg: Some(x), ..GroundPoint::default() }
            };
            let name = text(&["id", "name", "title", "camera_id"]).or_else(|| {
                let id = feature.get("id")?;
                Some(id.as_str().map_or_else(|| id.to_string(), str::to_owned))
            });
            points.add(name, text(&["description", "desc"]), point, &place)?;
        }
    }
    points.finish(files, "GeoJSON file with features of type Point", Some(MAP_SIGMA_M))
}

/// Columns of a table: the name that this crate uses, and all accepted names in lower case.
const NAMES: [(&str, &[&str]); 9] = [
    ("name", &["name", "id", "point", "label", "punkt", "nr"]),
    ("lat_deg", &["lat_deg", "lat", "latitude"]),
    ("lon_deg", &["lon_deg", "lon", "lng", "long", "longitude"]),
    ("easting", &["easting", "east", "e", "crs_e", "rechtswert"]),
    ("northing", &["northing", "north", "n", "crs_n", "hochwert"]),
    ("x_m", &["x_m"]),
    ("y_m", &["y_m"]),
    ("height_m", &["height_m"]),
    ("sigma_m", &["sigma_m", "sigma", "accuracy", "accuracy_m"]),
];

/// Reads a table of points: a name, and latitude and longitude, or east and north, or x and y of the site.
pub(crate) fn read_table(files: &Input) -> Result<Imported, FormatError> {
    let mut points = Points::default();
    for file in files.iter() {
        read_rows(file, &mut points)?;
    }
    points.finish(files, "table with the columns name, lat_deg and lon_deg", None)
}

fn read_rows(file: &File, points: &mut Points) -> Result<(), FormatError> {
    let text = file.as_text()?.trim_start_matches('\u{feff}');
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let Some((_, head)) = lines.next() else { return Ok(()) };
    let separator = [';', '\t', ','].into_iter().find(|mark| head.contains(*mark)).unwrap_or(',');
    let head: Vec<String> = cells(head, separator).into_iter().map(|cell| cell.to_lowercase()).collect();
    let column = |index: usize| {
        let (_, names) = NAMES[index];
        head.iter().position(|cell| names.contains(&cell.as_str()))
    };
    let [name, lat, lon, east, north, x, y, height, sigma] = std::array::from_fn(column);
    let pairs = [(lat, lon), (east, north), (x, y)];
    if !pairs.iter().any(|(a, b)| a.is_some() && b.is_some()) {
        let expected = "the columns lat_deg and lon_deg, or easting and northing, or x_m and y_m";
        return Err(FormatError::expected(
            format!("{}: line 1", file.name),
            quoted(&head.join(",")),
            expected,
        ));
    }
    for (index, line) in lines {
        let place = format!("{}: line {}", file.name, index + 1);
        let cells = cells(line, separator);
        let cell = |column: Option<usize>| {
            column.and_then(|column| cells.get(column)).map(String::as_str).filter(|cell| !cell.is_empty())
        };
        let value = |column: Option<usize>| -> Result<Option<f64>, FormatError> {
            let Some(text) = cell(column) else { return Ok(None) };
            let read = if separator == ',' { number(text) } else { number(&text.replace(',', ".")) };
            read.map(Some).ok_or_else(|| FormatError::expected(&place, quoted(text), "a number"))
        };
        let pair = |(a, b): (Option<usize>, Option<usize>)| -> Result<Option<[f64; 2]>, FormatError> {
            Ok(value(a)?.zip(value(b)?).map(<[f64; 2]>::from))
        };
        let [degrees, grid, site] = [pair(pairs[0])?, pair(pairs[1])?, pair(pairs[2])?];
        let height_m = value(height)?;
        let mut point = GroundPoint { sigma_m: value(sigma)?, ..GroundPoint::default() };
        if let Some([lat, lon]) = degrees {
            (point.lat_deg, point.lon_deg, point.height_m) = (Some(lat), Some(lon), height_m);
        } else if let Some(grid) = grid {
            (point.crs_m, point.height_m) = (Some(grid), height_m);
        } else if let Some([x, y]) = site {
            point.world_m = Some(WorldPoint::new(x, y, height_m.unwrap_or(0.0)));
        } else {
            return Err(FormatError::expected(&place, "no coordinates", "two numbers"));
        }
        points.add(cell(name).map(str::to_owned), None, point, &place)?;
    }
    Ok(())
}

/// Splits a line into cells. Quotes around a cell are removed; separators inside them are kept.
fn cells(line: &str, separator: char) -> Vec<String> {
    let (mut cells, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    for c in line.chars() {
        match c {
            '"' => is_quoted = !is_quoted,
            _ if c == separator && !is_quoted => cells.push(std::mem::take(&mut cell)),
            _ => cell.push(c),
        }
    }
    cells.push(cell);
    cells.into_iter().map(|cell| cell.trim().to_owned()).collect()
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

fn has_name(node: &Node, name: &str) -> bool {
    node.is_element() && node.tag_name().name() == name
}

fn child_text(node: &Node, name: &str) -> Option<String> {
    let text = node.children().find(|child| has_name(child, name))?.text()?.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

/// Points of an import, with unique ids.
#[derive(Default)]
struct Points {
    list: Vec<GroundPoint>,
    ids: HashSet<String>,
}

impl Points {
    /// Adds a point. A missing or repeated name gets a number.
    fn add(
        &mut self,
        name: Option<String>,
        about: Option<String>,
        point: GroundPoint,
        place: &str,
    ) -> Result<(), FormatError> {
        /// Largest length of an id or name, in characters. It is below the limit of the site file.
        const MAX_LENGTH: usize = 60;
        if self.list.len() == MAX_POINTS {
            let found = format!("more than {MAX_POINTS} points");
            return Err(FormatError::expected(place, found, format!("at most {MAX_POINTS}")));
        }
        let is_outside = |value: Option<f64>, most: f64| value.is_some_and(|value| value.abs() > most);
        if is_outside(point.lat_deg, 90.0) || is_outside(point.lon_deg, 180.0) {
            let found =
                format!("{}, {}", point.lat_deg.unwrap_or_default(), point.lon_deg.unwrap_or_default());
            return Err(FormatError::expected(
                place,
                found,
                "latitude -90 to 90 and longitude -180 to 180 degrees",
            ));
        }
        let lengths = point.crs_m.into_iter().flatten().chain(point.height_m).chain(point.sigma_m);
        let lengths = lengths.chain(point.world_m.map(<[f64; 3]>::from).into_iter().flatten());
        if point.sigma_m.is_some_and(|sigma| sigma <= 0.0)
            || lengths.into_iter().any(|length| length.abs() > 1e9)
        {
            let expected = "coordinates up to 1e9, and an accuracy above 0";
            return Err(FormatError::expected(place, "a number outside the usual range", expected));
        }
        let shortened = |text: String| -> Option<String> {
            let text: String = text.chars().filter(|c| !c.is_control()).take(MAX_LENGTH).collect();
            let text = text.trim().to_owned();
            (!text.is_empty()).then_some(text)
        };
        let base = name.and_then(shortened).unwrap_or_else(|| format!("P{}", self.list.len() + 1));
        let numbered = (2..).map(|number| format!("{base} {number}"));
        let id = std::iter::once(base.clone()).chain(numbered).find(|id| !self.ids.contains(id));
        let id = id.unwrap_or(base);
        self.ids.insert(id.clone());
        self.list.push(GroundPoint { id, name: about.and_then(shortened), ..point });
        Ok(())
    }

    /// Returns the site with the points. A point on the map without a standard deviation gets `sigma`, in metres;
    /// `None` means the standard deviation of a phone.
    fn finish(mut self, files: &[File], expected: &str, sigma: Option<f64>) -> Result<Imported, FormatError> {
        if self.list.is_empty() {
            let name = files.first().map_or("the file", |file| &file.name);
            return Err(FormatError::expected(name, "no points", format!("a {expected}")));
        }
        let count = self.list.len();
        let mut notes = vec![format!(
            "imported {}; click each one in the images, in the panel \"Points to click\" of the app",
            calib_site::counted(count, "point", "points")
        )];
        let needs_sigma = |point: &GroundPoint| point.sigma_m.is_none() && point.world_m.is_none();
        if self.list.iter().any(needs_sigma) {
            let sigma = sigma.unwrap_or(PHONE_SIGMA_M);
            self.list
                .iter_mut()
                .filter(|point| needs_sigma(point))
                .for_each(|point| point.sigma_m = Some(sigma));
            notes.push(format!(
                "an accuracy of {sigma} m is assumed; correct it if it differs (4 for a phone, 0.5 for an aerial \
                 image, 0.02 for RTK)"
            ));
        }
        if self.list.iter().any(|point| point.crs_m.is_some()) {
            notes.push("east and north are coordinates of the grid of the site (crs)".into());
        }
        Ok(Imported { site: Site { ground_points: self.list, ..Site::new() }, notes })
    }
}

/// Writes the positions of the cameras as waypoints.
pub(crate) fn write_gpx(scene: &Scene, export: &mut Export) {
    let Some(earth) = scene.site.georeference() else { return };
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <gpx version=\"1.1\" creator=\"calib\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n",
    );
    for view in &scene.views {
        let position = view.camera.position;
        let [lon, lat] = to_wgs84(&earth, position.on_floor());
        let _ = writeln!(
            text,
            "<wpt lat=\"{lat:.9}\" lon=\"{lon:.9}\"><name>{}</name><desc>camera, {:.2} m above the floor, azimuth \
             {:.1} degrees</desc></wpt>",
            escaped(&view.id),
            position.z,
            view.azimuth_deg(&earth)
        );
    }
    text.push_str("</gpx>\n");
    export.push("cameras.gpx", text);
}

/// Writes the cameras as placemarks, with their EFOVs as polygons.
pub(crate) fn write_kml(scene: &Scene, export: &mut Export) {
    let Some(earth) = scene.site.georeference() else { return };
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>\n\
         <Style id=\"efov\"><LineStyle><color>ffb27200</color><width>2</width></LineStyle>\
         <PolyStyle><color>40b27200</color></PolyStyle></Style>\n",
    );
    for view in &scene.views {
        let position = view.camera.position;
        let [lon, lat] = to_wgs84(&earth, position.on_floor());
        let id = escaped(&view.id);
        let azimuth = view.azimuth_deg(&earth);
        let _ = writeln!(
            text,
            "<Placemark><name>{id}</name><description>camera, azimuth {azimuth:.1} degrees</description>\
             <Point><altitudeMode>relativeToGround</altitudeMode><coordinates>{lon:.9},{lat:.9},{:.3}</coordinates>\
             </Point></Placemark>",
            position.z
        );
        if view.efov_m.len() > 2 {
            let corners = view.efov_m.iter().chain(view.efov_m.first()).map(|&corner| {
                let [lon, lat] = to_wgs84(&earth, corner);
                format!("{lon:.9},{lat:.9}")
            });
            let _ = writeln!(
                text,
                "<Placemark><name>{id}: field of view</name><styleUrl>#efov</styleUrl><Polygon><outerBoundaryIs>\
                 <LinearRing><coordinates>{}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>",
                corners.collect::<Vec<_>>().join(" ")
            );
        }
    }
    text.push_str("</Document></kml>\n");
    export.push("site.kml", text);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(format: &str, text: &str) -> Result<Imported, FormatError> {
        let file = File { name: "points".into(), bytes: text.as_bytes().to_vec() };
        crate::import(crate::format(format).unwrap(), &[file])
    }

    fn coordinates(imported: &Imported) -> Vec<(&str, Option<f64>, Option<f64>)> {
        let points = imported.site.ground_points.iter();
        points.map(|point| (point.id.as_str(), point.lat_deg, point.lon_deg)).collect()
    }

    #[test]
    fn points_of_every_format_are_equal() {
        let gpx = r#"<gpx><wpt lat="48.5" lon="11.25"><ele>519</ele><name>A</name></wpt><wpt lat="48.6" lon="11.35"/></gpx>"#;
        let kml = "<kml><Document><Folder><Placemark><name>A</name><Point><coordinates> 11.25,48.5,0 </coordinates></Point>\
                   </Placemark></Folder><Placemark><LineString/></Placemark><Placemark><Point><coordinates>11.35,48.6\
                   </coordinates></Point></Placemark></Document></kml>";
        let geojson = r#"{"type": "FeatureCollection", "features": [
            {"type": "Feature", "properties": {"name": "A"}, "geometry": {"type": "Point", "coordinates": [11.25, 48.5]}},
            {"type": "Feature", "properties": null, "geometry": {"type": "Point", "coordinates": [11.35, 48.6]}}]}"#;
        let expected = [("A", Some(48.5), Some(11.25)), ("P2", Some(48.6), Some(11.35))];
        for (name, text) in [
            ("gpx", gpx),
            ("kml", kml),
            ("geojson", geojson),
            ("points", "Name,Latitude,Longitude\nA,48.5,11.25\n,48.6,11.35\n"),
            ("points", "name;lat;lon\n\"A\";48,5;11,25\n;48,6;11,35\n"),
        ] {
            let found = read(name, text).unwrap();
            assert_eq!(coordinates(&found), expected, "{text}");
            assert!(found.site.ground_points.iter().all(|point| point.sigma_m.is_some()));
            found.site.check().unwrap();
        }
    }

    #[test]
    fn tables_have_grids_heights_and_accuracies() {
        let text = "id\teasting\tnorthing\theight_m\taccuracy\nA\t691608.25\t5334760.5\t1.5\t0.02\n";
        let found = read("points", text).unwrap();
        let point = &found.site.ground_points[0];
        assert_eq!((point.crs_m, point.height_m), (Some([691_608.25, 5_334_760.5]), Some(1.5)));
        assert_eq!(point.sigma_m, Some(0.02));
        assert!(found.site.check().is_err(), "the grid is not stated");
        let stated = Site { crs: Some("EPSG:25832".into()), ..found.site };
        stated.check().unwrap();
    }

    #[test]
    fn repeated_names_get_numbers() {
        let text = "name,lat,lon\nA,1,2\nA,1,2\nA 2,1,2\n";
        let found = read("points", text).unwrap();
        let ids: Vec<&str> = found.site.ground_points.iter().map(|point| point.id.as_str()).collect();
        assert_eq!(ids, ["A", "A 2", "A 2 2"]);
    }

    #[test]
    fn files_without_points_are_refused() {
        for (name, text) in [
            ("gpx", "<gpx/>"),
            ("gpx", r#"<gpx><wpt lat="x" lon="1"/></gpx>"#),
            ("kml", "<kml><Placemark><Point><coordinates>1</coordinates></Point></Placemark></kml>"),
            ("geojson", r#"{"type": "Feature", "geometry": {"type": "Point", "coordinates": ["a"]}}"#),
            ("points", "a,b\n1,2\n"),
            ("points", "lat,lon\n1,x\n"),
            ("points", ""),
            ("points", "lat,lon\n95,10\n"),
            ("points", "lat,lon,sigma\n5,10,0\n"),
        ] {
            assert!(read(name, text).is_err(), "{text}");
        }
    }
}
