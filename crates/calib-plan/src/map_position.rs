//! Position of an image on the map, from the tags of a `GeoTIFF`, from a world file with its coordinate system, or
//! from a ground overlay (KML).
//!
//! Sources: OGC 19-008r4, "OGC `GeoTIFF` Standard", 2019; "World Files for Raster Datasets", ESRI; OGC 12-007r2,
//! "OGC KML 2.3", 2015.

/// Coordinate system of a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapSystem {
    /// Projected grid with this EPSG code.
    Projected(u16),
    /// Longitude and latitude, in degrees.
    Degrees,
    /// Coordinate system that the file does not contain.
    Unknown,
}

/// Position of an image on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImagePosition {
    /// Affine map from pixels (from the corner of the image, to the right and down) to coordinates: east and
    /// north, or longitude and latitude. Each row is for one coordinate: factors of x and y, and the value at the
    /// corner.
    pub transform: [[f64; 3]; 2],
    /// Coordinate system.
    pub system: MapSystem,
}

impl ImagePosition {
    /// Creates a position from a transform that maps pixel indices to the coordinates of the pixel centres. The
    /// result is measured from the corner of the image.
    fn from_centres(mut transform: [[f64; 3]; 2], system: MapSystem) -> Self {
        for [a, b, start] in &mut transform {
            *start -= 0.5 * (*a + *b);
        }
        Self { transform, system }
    }

    /// Returns the position of a copy of the image whose width and height are divided by `by`. The app reduces
    /// large images in this way.
    #[must_use]
    pub fn reduced(mut self, by: u32) -> Self {
        for row in &mut self.transform {
            row[0] *= f64::from(by);
            row[1] *= f64::from(by);
        }
        self
    }

    /// Reads a world file: six numbers A, D, B, E, C, F for `east = A i + B j + C` and `north = D i + E j + F` of
    /// pixel indices i and j. Returns `None` for other texts.
    #[must_use]
    pub fn from_world_file(text: &str, system: MapSystem) -> Option<Self> {
        let numbers = text.split_whitespace().map(|word| word.parse::<f64>().ok().filter(|n| n.is_finite()));
        let numbers: Vec<f64> = numbers.take(7).collect::<Option<_>>()?;
        let [a, d, b, e, c, f] = numbers.try_into().ok()?;
        Some(Self::from_centres([[a, b, c], [d, e, f]], system))
    }

    /// Reads the tags of a `GeoTIFF`; `None` for a file without a position.
    #[cfg(feature = "raster")]
    #[must_use]
    pub fn from_geotiff(bytes: &[u8]) -> Option<Self> {
        use tiff::decoder::Decoder;
        use tiff::tags::Tag;
        /// Maximum number of values in a tag.
        const MAX_VALUES: usize = 4096;
        if !bytes.starts_with(b"II") && !bytes.starts_with(b"MM") {
            return None;
        }
        let mut decoder = Decoder::new(std::io::Cursor::new(bytes)).ok()?;
        let mut numbers = |tag: u16| {
            let values = decoder.find_tag(Tag::Unknown(tag)).ok()??.into_f64_vec().ok()?;
            (values.len() <= MAX_VALUES && values.iter().all(|value| value.is_finite())).then_some(values)
        };
        let [scale, tie, matrix] = [numbers(33_550), numbers(33_922), numbers(34_264)];
        let mut words = |tag: u16| decoder.find_tag(Tag::Unknown(tag)).ok()??.into_u16_vec().ok();
        let keys = words(34_735)?;
        let transform = match (matrix, scale, tie) {
            (Some(m), ..) if m.len() >= 8 => [[m[0], m[1], m[3]], [m[4], m[5], m[7]]],
            (_, Some(scale), Some(tie)) if scale.len() >= 2 && tie.len() >= 6 => {
                let ([width, height], [i, j, east, north]) =
                    ([scale[0], scale[1]], [tie[0], tie[1], tie[3], tie[4]]);
                [[width, 0.0, east - width * i], [0.0, -height, north + height * j]]
            }
            _ => return None,
        };
        let key = |id: u16| {
            let entry = keys.get(4..)?.chunks_exact(4).find(|entry| entry[0] == id && entry[1] == 0)?;
            Some(entry[3])
        };
        let system = match (key(1024), key(3072)) {
            // User-defined systems have the code 32767.
            (Some(1), Some(code)) if code != 32_767 => MapSystem::Projected(code),
            (Some(2), _) => MapSystem::Degrees,
            _ => MapSystem::Unknown,
        };
        // With the raster type `PixelIsPoint`, the coordinates refer to pixel centres.
        Some(if key(1025) == Some(2) {
            Self::from_centres(transform, system)
        } else {
            Self { transform, system }
        })
    }

    /// Returns `None`, because this build does not support TIFF images (feature `raster`).
    #[cfg(not(feature = "raster"))]
    #[must_use]
    pub const fn from_geotiff(_: &[u8]) -> Option<Self> {
        None
    }

    /// Returns the position of the ground overlay of a KML file for an image of this width and height, in pixels.
    /// Returns `None` for a file without a ground overlay.
    #[must_use]
    pub fn from_kml(text: &str, [width, height]: [f64; 2]) -> Option<Self> {
        let overlay = KmlOverlay::read(text)?;
        let [north, south, east, west] = overlay.edges;
        let (cx, cy) = (0.5 * (east + west), 0.5 * (north + south));
        let shrink = cy.to_radians().cos();
        // Size of a pixel in degrees of latitude, scaled so that east and north have equal length, then rotated
        // counter-clockwise about the centre.
        let (sin, cos) = overlay.rotation_deg.to_radians().sin_cos();
        let (dx, dy) = ((east - west) / width * shrink, (north - south) / height);
        let lon = [cos * dx / shrink, sin * dy / shrink];
        let lat = [sin * dx, -cos * dy];
        let start = |[by_x, by_y]: [f64; 2], centre: f64| centre - 0.5 * (by_x * width + by_y * height);
        let transform = [[lon[0], lon[1], start(lon, cx)], [lat[0], lat[1], start(lat, cy)]];
        Some(Self { transform, system: MapSystem::Degrees })
    }
}

/// Ground overlay of a KML file.
#[derive(Clone, Debug, PartialEq)]
pub struct KmlOverlay {
    /// Path of the image, relative to the KML file.
    pub image: String,
    /// North, south, east and west edge, in degrees.
    pub edges: [f64; 4],
    /// Rotation, counter-clockwise, in degrees.
    pub rotation_deg: f64,
}

impl KmlOverlay {
    /// Reads the first ground overlay of a KML file; `None` without one.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let overlay = element(text, "GroundOverlay")?;
        let bounds = element(overlay, "LatLonBox")?;
        let number = |name: &str| element(bounds, name)?.trim().parse::<f64>().ok().filter(|n| n.is_finite());
        let edges = [number("north")?, number("south")?, number("east")?, number("west")?];
        let is_usable = edges[0] > edges[1] && edges[2] > edges[3] && edges[0] <= 90.0 && edges[1] >= -90.0;
        let image = element(element(overlay, "Icon")?, "href")?.trim();
        is_usable.then(|| Self {
            image: image.to_owned(),
            edges,
            rotation_deg: number("rotation").unwrap_or(0.0),
        })
    }
}

/// Returns the text between the first start tag of an element and its end tag. Ground overlays have no nested
/// elements of the same name.
fn element<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let start = text.find(&format!("<{name}>")).or_else(|| text.find(&format!("<{name} ")))?;
    let inner = &text[start + text[start..].find('>')? + 1..];
    inner.find(&format!("</{name}>")).map(|end| &inner[..end])
}

/// Detects the coordinate system of a `.prj` file (well-known text), from its EPSG code or from the name of a UTM
/// zone.
#[must_use]
pub fn system_of_wkt(text: &str) -> MapSystem {
    let text = text.trim();
    let is_projected = text.starts_with("PROJCS") || text.starts_with("PROJCRS");
    if text.starts_with("GEOGCS") || text.starts_with("GEOGCRS") {
        return MapSystem::Degrees;
    }
    if !is_projected {
        return MapSystem::Unknown;
    }
    // The EPSG code of the projected system is the last one in the text; earlier codes belong to its parts.
    let code = text.rfind("\"EPSG\",").and_then(|at| {
        let rest = text[at + 7..].trim_start().trim_start_matches('"');
        let is_last =
            rest.trim_start_matches(|c: char| c.is_ascii_digit()).chars().all(|c| "\"] \r\n\t".contains(c));
        let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
        digits.parse().ok().filter(|_| is_last)
    });
    code.or_else(|| utm_code(text)).map_or(MapSystem::Unknown, MapSystem::Projected)
}

/// Converts an ESRI name of a UTM zone, such as `WGS_1984_UTM_Zone_32N`, to its EPSG code; `None` for other names.
fn utm_code(text: &str) -> Option<u16> {
    let name = text.split('"').nth(1)?.to_uppercase().replace(' ', "_");
    let (datum, zone) = name.split_once("_UTM_ZONE_")?;
    let is_south = zone.ends_with('S');
    let zone: u16 = zone.trim_end_matches(['N', 'S']).parse().ok().filter(|zone| (1..=60).contains(zone))?;
    match (datum, is_south) {
        ("WGS_1984" | "WGS_84", false) => Some(32_600 + zone),
        ("WGS_1984" | "WGS_84", true) => Some(32_700 + zone),
        ("ETRS_1989" | "ETRS89", false) => (28..=38).contains(&zone).then_some(25_800 + zone),
        ("NAD_1983" | "NAD83", false) => (1..=23).contains(&zone).then_some(26_900 + zone),
        _ => None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test that fails may panic")]
mod tests {
    use super::*;

    #[test]
    fn world_files_give_the_centres_of_pixels() {
        let text = "0.5\n0.0\n0.0\n-0.5\n691000.25\n5334999.75\n";
        let found = ImagePosition::from_world_file(text, MapSystem::Unknown).unwrap();
        assert_eq!(found.transform, [[0.5, 0.0, 691_000.0], [0.0, -0.5, 5_335_000.0]]);
        assert_eq!(ImagePosition::from_world_file("1 2 3", MapSystem::Unknown), None);
        assert_eq!(ImagePosition::from_world_file("1 2 3 4 5 6 7", MapSystem::Unknown), None);
    }

    /// Returns a `GeoTIFF` of four pixels with these tags.
    #[cfg(feature = "raster")]
    fn geotiff(keys: &[u16], scale: Option<[f64; 3]>, tie: &[f64], matrix: &[f64]) -> Vec<u8> {
        use tiff::encoder::{TiffEncoder, colortype::Gray8};
        use tiff::tags::Tag;
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        let mut image = encoder.new_image::<Gray8>(2, 2).unwrap();
        let tags = image.encoder();
        for (tag, values) in
            [(33_550, scale.as_ref().map_or(&[][..], |scale| scale)), (33_922, tie), (34_264, matrix)]
        {
            if !values.is_empty() {
                tags.write_tag(Tag::Unknown(tag), values).unwrap();
            }
        }
        if !keys.is_empty() {
            tags.write_tag(Tag::Unknown(34_735), keys).unwrap();
        }
        image.write_data(&[0, 80, 160, 240]).unwrap();
        bytes.into_inner()
    }

    #[cfg(feature = "raster")]
    #[test]
    fn geotiffs_have_grids_and_pixel_centres_or_corners() {
        let projected = |raster: u16| [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, raster, 3072, 0, 1, 25832];
        let (scale, tie) = (Some([0.2, 0.2, 0.0]), [0.0, 0.0, 0.0, 691_000.0, 5_335_000.0, 0.0]);
        let of_area = ImagePosition::from_geotiff(&geotiff(&projected(1), scale, &tie, &[])).unwrap();
        assert_eq!(of_area.transform, [[0.2, 0.0, 691_000.0], [0.0, -0.2, 5_335_000.0]]);
        assert_eq!(of_area.system, MapSystem::Projected(25832));
        let of_point = ImagePosition::from_geotiff(&geotiff(&projected(2), scale, &tie, &[])).unwrap();
        assert!((of_point.transform[0][2] - 690_999.9).abs() < 1e-6);
        assert!((of_point.transform[1][2] - 5_335_000.1).abs() < 1e-6);
        let turned = [0.0, 0.3, 0.0, 7.0, 0.3, 0.0, 0.0, 8.0];
        let matrix = [&turned[..], &[0.0; 8]].concat();
        let geographic = [1, 1, 0, 1, 1024, 0, 1, 2];
        let found = ImagePosition::from_geotiff(&geotiff(&geographic, None, &[], &matrix)).unwrap();
        assert_eq!((found.transform, found.system), ([[0.0, 0.3, 7.0], [0.3, 0.0, 8.0]], MapSystem::Degrees));
        assert_eq!(ImagePosition::from_geotiff(&geotiff(&[], scale, &tie, &[])), None, "an ordinary TIFF");
        assert_eq!(ImagePosition::from_geotiff(&geotiff(&geographic, None, &[], &[])), None);
        // Damaged files must not panic.
        let whole = geotiff(&projected(1), scale, &tie, &[]);
        for end in 0..whole.len() {
            let _ = ImagePosition::from_geotiff(&whole[..end]);
        }
    }

    #[test]
    fn coordinate_systems_are_read_from_well_known_text() {
        let inner =
            r#"PROJCS["x",GEOGCS["y",AUTHORITY["EPSG","4258"]],UNIT["metre",1],AUTHORITY["EPSG","25832"]]"#;
        assert_eq!(system_of_wkt(inner), MapSystem::Projected(25832));
        let second = r#"PROJCRS["x",BASEGEOGCRS["y",ID["EPSG",4326]],ID["EPSG",32633]]"#;
        assert_eq!(system_of_wkt(second), MapSystem::Projected(32633));
        let esri = r#"PROJCS["ETRS_1989_UTM_Zone_32N",GEOGCS["GCS_ETRS_1989"],UNIT["Meter",1.0]]"#;
        assert_eq!(system_of_wkt(esri), MapSystem::Projected(25832));
        // The only code belongs to the datum.
        let other = r#"PROJCS["Local grid",GEOGCS["y",AUTHORITY["EPSG","4258"]],UNIT["metre",1]]"#;
        assert_eq!(system_of_wkt(other), MapSystem::Unknown);
        assert_eq!(system_of_wkt(r#"GEOGCS["WGS 84"]"#), MapSystem::Degrees);
        assert_eq!(system_of_wkt("?"), MapSystem::Unknown);
    }

    #[test]
    fn a_turned_overlay_keeps_its_centre() {
        let text = "<kml><GroundOverlay><Icon><href>yard.png</href></Icon><LatLonBox><north>48.002</north>\
                    <south>48.000</south><east>11.003</east><west>11.0</west><rotation>90</rotation></LatLonBox>\
                    </GroundOverlay></kml>";
        assert_eq!(KmlOverlay::read(text).unwrap().image, "yard.png");
        let found = ImagePosition::from_kml(text, [300.0, 200.0]).unwrap();
        let at = |x: f64, y: f64| found.transform.map(|[a, b, c]| a * x + b * y + c);
        let [lon, lat] = at(150.0, 100.0);
        assert!((lon - 11.0015).abs() < 1e-12 && (lat - 48.001).abs() < 1e-12);
        // Turned counter-clockwise by 90 degrees, the right edge is in the north.
        let [lon, lat] = at(300.0, 100.0);
        let half = 0.0015 * 48.001_f64.to_radians().cos();
        assert!((lon - 11.0015).abs() < 1e-9 && (lat - 48.001 - half).abs() < 1e-9, "{lon} {lat}");
        assert_eq!(KmlOverlay::read("<kml><GroundOverlay></kml>"), None);
    }
}
