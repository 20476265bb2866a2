//! OpenCV's `FileStorage`, as JSON, YAML or XML, with one file for each camera.
//!
//! `rvec` and `tvec` are world to camera, in metres. Pixels count from the centre of the first pixel: our
//! principal point minus 0.5.

use std::collections::BTreeMap;

use calib_core::camera::Rational;
use calib_core::{BrownConrady, Distortion};
use serde_json::{Map, Value, json};

use crate::export::{Export, Scene};
use crate::file::{File, FormatError, Problem, quoted};
use crate::fisheye::{from_rodrigues, rodrigues};
use crate::given::{Imported, ImportedCamera, intrinsics_from_matrix, site_with_notes};
use crate::input::Input;
use crate::tree::{Node, Syntax, digits, escaped, joined, pretty, quote};
use crate::view::{Terms, View};

/// Numbers of distortion coefficients that `OpenCV` allows.
const COEFFICIENT_COUNTS: [usize; 5] = [4, 5, 8, 12, 14];

enum Entry {
    Whole(u32),
    Text(String),
    Matrix([usize; 2], Vec<f64>),
}

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    for view in &scene.views {
        let terms = export.terms(view, scene.lenses);
        let entries = entries(view, terms);
        let text = match scene.extension {
            "json" => as_json(&entries),
            "xml" => as_xml(&entries),
            _ => as_yaml(&entries),
        };
        export.push(format!("{}.{}", view.file, scene.extension), text);
    }
}

fn entries(view: &View, terms: Terms) -> Vec<(&'static str, Entry)> {
    let k = view.intrinsics(view.centre_from_pixel_centre());
    let (model, terms) = match terms {
        Terms::Fisheye(k) => ("fisheye", k.to_vec()),
        Terms::Rational(terms) => ("rational", written_terms(&terms)),
        Terms::None => ("brown-conrady", vec![0.0; 5]),
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => ("brown-conrady", vec![b.k1, b.k2, b.p1, b.p2, b.k3]),
    };
    let [width, height] = view.size;
    let column = |v: [f64; 3]| Entry::Matrix([3, 1], v.to_vec());
    vec![
        ("camera_name", Entry::Text(view.id.clone())),
        ("image_width", Entry::Whole(width)),
        ("image_height", Entry::Whole(height)),
        ("camera_matrix", Entry::Matrix([3, 3], k.concat())),
        ("distortion_model", Entry::Text(model.into())),
        ("distortion_coefficients", Entry::Matrix([1, terms.len()], terms)),
        ("rvec", column(rodrigues(&view.camera.rotation()))),
        ("tvec", column(view.camera.translation())),
    ]
}

fn as_json(entries: &[(&str, Entry)]) -> String {
    let mut object = Map::new();
    for (key, entry) in entries {
        let value = match entry {
            Entry::Whole(number) => json!(number),
            Entry::Text(text) => json!(text),
            Entry::Matrix([rows, cols], data) => {
                json!({"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data})
            }
        };
        object.insert((*key).to_owned(), value);
    }
    pretty(&Value::Object(object))
}

fn as_yaml(entries: &[(&str, Entry)]) -> String {
    let mut text = String::from("%YAML:1.0\n---\n");
    for (key, entry) in entries {
        text += &match entry {
            Entry::Whole(number) => format!("{key}: {number}\n"),
            Entry::Text(value) => format!("{key}: {}\n", quote(value)),
            Entry::Matrix([rows, cols], data) => format!(
                "{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {} ]\n",
                joined(data, ", ")
            ),
        };
    }
    text
}

pub(crate) fn matrix_xml(key: &str, [rows, cols]: [usize; 2], data: &[f64]) -> String {
    let cells: Vec<String> = data.iter().map(|&value| digits(value)).collect();
    format!(
        "<{key} type_id=\"opencv-matrix\">\n  <rows>{rows}</rows>\n  <cols>{cols}</cols>\n  <dt>d</dt>\n  <data>\n    {}</data></{key}>\n",
        cells.join(" ")
    )
}

fn as_xml(entries: &[(&str, Entry)]) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n<opencv_storage>\n");
    for (key, entry) in entries {
        text += &match entry {
            Entry::Whole(number) => format!("<{key}>{number}</{key}>\n"),
            Entry::Text(value) => format!("<{key}>\"{}\"</{key}>\n", escaped(value)),
            Entry::Matrix(shape, data) => matrix_xml(key, *shape, data),
        };
    }
    text + "</opencv_storage>\n"
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::detect(file)?.parse(file)?;
        let root = Node::root(file, &tree);
        given.extend(cameras(file, &root)?);
        rest.extend(root.unread_keys());
    }
    let mut imported = site_with_notes(given, rest, files, &files[0].name)?;
    if files.unit_m().is_none() && imported.site.cameras.iter().any(|camera| camera.solution.is_some()) {
        imported.notes.push(
            "poses are read as metres with z up; rvec and tvec of a chessboard refer to the board instead"
                .into(),
        );
    }
    Ok(imported)
}

/// Names of the intrinsic matrix, in lower case without separators.
const MATRIX_NAMES: [&str; 10] = [
    "cameramatrix",
    "k",
    "m",
    "intrinsicmatrix",
    "mtx",
    "intrinsics",
    "intrinsic",
    "cameraintrinsics",
    "cammatrix",
    "kmatrix",
];

/// Part of a lens that a key names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Matrix,
    Distortion,
}

/// Returns the part of a lens that a key names, and which camera of the file it belongs to: `1` or `left` in
/// stereo files, otherwise an empty text.
///
/// Keys are compared without case and separators, because programs write them in many ways.
fn part_of_lens(key: &str) -> Option<(Part, String)> {
    let plain: String = key.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_lowercase();
    let sides = ["left", "right"].into_iter().filter_map(|side| {
        let core = plain.strip_prefix(side).or_else(|| plain.strip_suffix(side))?;
        Some((core.to_owned(), side.to_owned()))
    });
    let core = plain.trim_end_matches(|c: char| c.is_ascii_digit());
    let numbered = (core.to_owned(), plain[core.len()..].to_owned());
    sides.chain([numbered]).find_map(|(core, camera)| {
        if MATRIX_NAMES.contains(&core.as_str()) {
            return Some((Part::Matrix, camera));
        }
        let is_model = ["model", "type", "name", "count"].iter().any(|word| core.contains(word));
        let is_distortion = core == "d" || core.contains("dist") && !core.contains("undist") && !is_model;
        is_distortion.then_some((Part::Distortion, camera))
    })
}

/// Reads all cameras of a file: one, several with numbered keys, or several below one key each.
fn cameras(file: &File, root: &Node) -> Result<Vec<ImportedCamera>, FormatError> {
    let mut lenses: BTreeMap<String, [Option<Node>; 2]> = BTreeMap::new();
    for (key, node) in root.entries() {
        let Some((part, camera)) = part_of_lens(key).filter(|_| node.is_list_or_matrix()) else { continue };
        lenses.entry(camera).or_default()[part as usize].get_or_insert(node);
    }
    if !lenses.values().any(|[matrix, _]| matrix.is_some()) {
        let below = root.entries().into_iter().filter(|(_, node)| {
            node.entries()
                .iter()
                .any(|(key, _)| part_of_lens(key).is_some_and(|(part, _)| part == Part::Matrix))
        });
        let below: Result<Vec<_>, _> = below.map(|(key, node)| camera(&node, key, &node)).collect();
        let below = below?;
        if !below.is_empty() {
            return Ok(below);
        }
    }
    if let [(only, _)] = &lenses.iter().collect::<Vec<_>>()[..]
        && only.is_empty()
    {
        return Ok(vec![camera(root, file.stem(), root)?]);
    }
    if lenses.is_empty() {
        return Err(root
            .require(&["camera_matrix"])
            .map_or_else(|error| error, |node| node.unexpected("a matrix")));
    }
    let stereo = lenses.into_iter().map(|(id, [matrix, terms])| {
        let matrix = matrix.ok_or_else(|| {
            FormatError::new(
                &file.name,
                Problem::MissingKey(vec![format!("the camera matrix of camera {}", quoted(&id))]),
            )
        })?;
        lens(if id.is_empty() { file.stem() } else { &id }, root, &matrix, terms.as_ref())
    });
    stereo.collect()
}

/// Reads the camera whose keys are directly below `node`. Values that are common to the file are in `common`.
fn camera(node: &Node, id: &str, common: &Node) -> Result<ImportedCamera, FormatError> {
    let find = |wanted: Part| {
        let is_wanted = |(key, value): &(&str, Node)| {
            part_of_lens(key).is_some_and(|(part, _)| part == wanted) && value.is_list_or_matrix()
        };
        node.entries().into_iter().find(is_wanted).map(|(_, value)| value)
    };
    let matrix = match find(Part::Matrix) {
        Some(matrix) => matrix,
        None => node.require(&["camera_matrix"])?,
    };
    let name = node.first_of(&["camera_name", "name"]).and_then(|name| name.text().ok());
    let mut given = lens(name.unwrap_or(id), common, &matrix, find(Part::Distortion).as_ref())?;
    if let (Some(r), Some(t)) =
        (node.first_of(&["rvec", "R", "rotation"]), node.first_of(&["tvec", "T", "t"]))
    {
        let rotation = if r.numbers()?.len() == 9 { Some(r.matrix()?) } else { from_rodrigues(r.exactly()?) };
        given.pose = Some((rotation.ok_or_else(|| r.unexpected("a rotation"))?, t.exactly()?));
    }
    Ok(given)
}

/// Reads a lens from its matrix and its distortion coefficients. `around` contains size and model.
fn lens(id: &str, around: &Node, matrix: &Node, terms: Option<&Node>) -> Result<ImportedCamera, FormatError> {
    let [fx, fy, cx, cy] = intrinsics_from_matrix(&matrix.matrix()?, matrix.place())?;
    let mut given = ImportedCamera::new(id, matrix.place(), [fx, fy, cx + 0.5, cy + 0.5]);
    given.size = size(around)?;
    if let Some(terms) = terms {
        let model = around.first_of(&["distortion_model", "model"]).and_then(|node| node.text().ok());
        let flag = around.first_of(&["fisheye", "is_fisheye"]).is_some_and(|node| node.is_true());
        given.distortion = distortion(terms, flag || model.is_some_and(is_fisheye))?;
    }
    Ok(given)
}

fn size(root: &Node) -> Result<Option<[u32; 2]>, FormatError> {
    let keys = (
        root.first_of(&["image_width", "width", "imageWidth"]),
        root.first_of(&["image_height", "height", "imageHeight"]),
    );
    if let (Some(width), Some(height)) = keys {
        return Ok(Some([width.side()?, height.side()?]));
    }
    let Some(both) = root.first_of(&["image_size", "imageSize", "resolution", "size"]) else {
        return Ok(None);
    };
    let items = both.items()?;
    let [width, height] = &items[..] else { return Err(both.unexpected("width and height")) };
    Ok(Some([width.side()?, height.side()?]))
}

pub(crate) fn is_fisheye(model: &str) -> bool {
    let model = model.to_lowercase();
    ["fisheye", "equidistant", "kannala"].iter().any(|known| model.contains(known))
}

/// Reads a distortion vector of `OpenCV`: k1, k2, p1, p2, k3, the rational terms k4 to k6, and the thin-prism
/// terms s1 to s4. Tilt terms must be 0.
pub(crate) fn distortion(node: &Node, fisheye: bool) -> Result<Distortion, FormatError> {
    let terms = node.numbers()?;
    if terms.iter().all(|&term| term == 0.0) && !fisheye {
        return Ok(Distortion::None);
    }
    if fisheye {
        let Ok(k) = terms.try_into() else {
            return Err(node.unexpected("the four coefficients of a fisheye lens"));
        };
        return Ok(Distortion::KannalaBrandt { k });
    }
    if !COEFFICIENT_COUNTS.contains(&terms.len()) {
        return Err(node.unexpected(&format!("4, 5, 8, 12 or 14 coefficients instead of {}", terms.len())));
    }
    if terms.iter().skip(12).any(|&term| term != 0.0) {
        return Err(node.unexpected(
            "no tilt: a tilted sensor is not supported; calibrate the camera without CALIB_TILTED_MODEL",
        ));
    }
    let mut all = [0.0; 12];
    all.iter_mut().zip(&terms).for_each(|(term, value)| *term = *value);
    Ok(distortion_of_terms(all))
}

/// Returns rational terms in the order of `OpenCV`, without the thin-prism terms if they are 0.
pub(crate) fn written_terms(terms: &[f64; 12]) -> Vec<f64> {
    let [rational @ .., _, _, _, _] = terms;
    if terms[8..] == [0.0; 4] { rational.to_vec() } else { terms.to_vec() }
}

/// Returns the distortion of `OpenCV`'s terms k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4.
pub(crate) fn distortion_of_terms([k1, k2, p1, p2, k3, k4, k5, k6, prism @ ..]: [f64; 12]) -> Distortion {
    if [k4, k5, k6] == [0.0; 3] && prism == [0.0; 4] {
        return Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 });
    }
    Distortion::Rational(Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2], prism })
}
