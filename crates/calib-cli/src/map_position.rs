//! Reads the position of a plan on the map. Sources are the tags of a `GeoTIFF`, a world file in the folder of the
//! image, and a ground overlay.

use std::path::{Component, Path, PathBuf};

use calib_plan::{DrawingKind, ImagePosition, KmlOverlay, MapSystem, system_of_wkt};
use calib_site::{CoordinateSystem, MAX_BYTES, MapPosition};

use crate::args::grid;
use crate::files::print_message;
use crate::stop::CommandError;

/// Largest size of a world file or of its `.prj` file, in bytes.
const MAX_TEXT_BYTES: u64 = 1 << 20;

/// Coordinate system of a position on the map whose file does not state one.
#[derive(Clone, Debug)]
pub(crate) enum MapUnits {
    /// Longitude and latitude (WGS84), in degrees.
    Degrees,
    /// Projected grid.
    Grid(Box<CoordinateSystem>),
}

/// Parses `EPSG:4326`, or the code of a projected grid.
pub(crate) fn map_units(name: &str) -> Result<MapUnits, String> {
    /// Code of WGS84 with longitude and latitude.
    const WGS84: &str = "EPSG:4326";
    if name.trim().eq_ignore_ascii_case(WGS84) {
        Ok(MapUnits::Degrees)
    } else {
        grid(name).map(|grid| MapUnits::Grid(Box::new(grid)))
    }
}

/// Image of a plan, with its position on the map if the image, a world file or a ground overlay contains one.
pub(crate) struct PlanFile {
    pub(crate) path: PathBuf,
    pub(crate) bytes: Vec<u8>,
    /// Position on the map, and the name of the file that contains it (`GeoTIFF` or world file).
    position: Option<(ImagePosition, String)>,
    /// Text of the KML file with the ground overlay. Its position is computed later, because it depends on the size
    /// of the image.
    overlay: Option<String>,
}

impl PlanFile {
    /// Reads an image, or a KML file and the image of its ground overlay, with the position on the map.
    pub(crate) fn read(file: &str) -> Result<Self, CommandError> {
        let path = Path::new(file);
        let bytes = read(path, MAX_BYTES as u64)?;
        if has_ending(path, "kmz") {
            return Err(CommandError::invalid(
                file,
                "is a KMZ archive; unzip the archive, and use the KML file inside",
            ));
        }
        if !has_ending(path, "kml") {
            let position = match ImagePosition::from_geotiff(&bytes) {
                Some(found) => Some((found, file.to_owned())),
                // World files are not read for drawings (PDF, DXF, SVG), because they do not refer to pixels of
                // the rendered image.
                None if DrawingKind::of(&bytes).is_some() => None,
                None => neighbouring_world_file(path)?,
            };
            return Ok(Self { path: path.to_owned(), bytes, position, overlay: None });
        }
        let text = String::from_utf8(bytes).map_err(|_| CommandError::invalid(file, "is not UTF-8 text"))?;
        let Some(overlay) = KmlOverlay::read(&text) else {
            let what = "contains no ground overlay with a LatLonBox; for points, use `calib import kml`";
            return Err(CommandError::invalid(file, what));
        };
        if overlay.image.contains("://") {
            let what = format!(
                "the image {} is on a server; download it to the folder of the KML file, and \
                 enter its file name in the KML file",
                overlay.image
            );
            return Err(CommandError::invalid(file, what));
        }
        // A hostile file must not name files of other folders.
        let is_inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
        if !Path::new(&overlay.image).components().all(is_inside) {
            let what = format!(
                "the image {} is outside the folder of the KML file; move it there, and correct its path in the KML file",
                overlay.image
            );
            return Err(CommandError::invalid(file, what));
        }
        let image = path.with_file_name(&overlay.image);
        let bytes = read(&image, MAX_BYTES as u64)?;
        Ok(Self { path: image, bytes, position: None, overlay: Some(text) })
    }

    /// Returns the position on the map of the plan image, which has `size` pixels after its width and height were
    /// divided by `reduction`. `crs` is used if the files contain no coordinate system.
    pub(crate) fn position(
        &self,
        (size, reduction): ([u32; 2], u32),
        crs: Option<&MapUnits>,
    ) -> Result<Option<MapPosition>, CommandError> {
        let of_overlay = || ImagePosition::from_kml(self.overlay.as_ref()?, size.map(f64::from));
        let (found, from) = match &self.position {
            Some((found, from)) => (found.reduced(reduction), from.as_str()),
            None => match of_overlay() {
                Some(found) => (found, "the ground overlay"),
                None => return Ok(None),
            },
        };
        let system = match (found.system, crs) {
            (MapSystem::Degrees, _) => None,
            (MapSystem::Projected(code), _) => {
                let name = format!("EPSG:{code}");
                Some(CoordinateSystem::new(&name).map_err(|error| {
                    CommandError::invalid(from, format!("found the grid {name}, expected {error}"))
                })?)
            }
            (MapSystem::Unknown, Some(MapUnits::Degrees)) => None,
            (MapSystem::Unknown, Some(MapUnits::Grid(grid))) => Some((**grid).clone()),
            (MapSystem::Unknown, None) => {
                print_message(format_args!(
                    "calib: {from}: states a position without a grid; add --crs EPSG:CODE to use the position \
                     (EPSG:4326 if it is in degrees)"
                ));
                return Ok(None);
            }
        };
        Ok(Some(MapPosition { transform: found.transform, system }))
    }
}

/// Reads the world file of an image and its `.prj` file, from the folder of the image.
fn neighbouring_world_file(image: &Path) -> Result<Option<(ImagePosition, String)>, CommandError> {
    let ending = image.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    // Usual extensions of world files, for example for `.jpg`: `.jgw`, `.jpgw` and `.wld`.
    let letters: Vec<char> = ending.chars().collect();
    let short = letters.first().zip(letters.last()).map(|(first, last)| format!("{first}{last}w"));
    let endings = short.into_iter().chain([format!("{ending}w"), "wld".into()]);
    let Some(path) = endings.map(|ending| image.with_extension(ending)).find(|path| path.is_file()) else {
        return Ok(None);
    };
    let text = String::from_utf8_lossy(&read(&path, MAX_TEXT_BYTES)?).into_owned();
    let prj = image.with_extension("prj");
    let system = match prj.is_file() {
        true => system_of_wkt(&String::from_utf8_lossy(&read(&prj, MAX_TEXT_BYTES)?)),
        false => MapSystem::Unknown,
    };
    let name = path.display().to_string();
    let found = ImagePosition::from_world_file(&text, system);
    found
        .map(|found| Some((found, name.clone())))
        .ok_or_else(|| CommandError::invalid(name, "expected the six numbers of a world file"))
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending))
}

fn read(path: &Path, most: u64) -> Result<Vec<u8>, CommandError> {
    calib_input::read(path, most).map_err(|error| CommandError::invalid(path.display(), error))
}
