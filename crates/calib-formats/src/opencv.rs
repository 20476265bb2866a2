//! OpenCV's `FileStorage`, as JSON, YAML or XML, with one file for each camera.
//!
//! `rvec` and `tvec` are world to camera, in metres. Pixels count from the centre of the first pixel: our
//! principal point minus 0.5.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use crate::export::{Export, Scene};
use crate::file::{File, FormatError, Problem, quoted};
use crate::fisheye::{from_rodrigues, rodrigues};
use crate::given::{Imported, ImportedCamera, Intrinsics, intrinsics_from_matrix, site_with_notes};
use crate::input::Input;
use crate::lens_keys::{Part, declares_fisheye, distortion, named_distortion, part_of_lens};
use crate::tree::{Node, Syntax, digits, escaped, joined, pretty, quote};
use crate::view::{Terms, View};

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
    let mut entries = vec![
        ("camera_name", Entry::Text(view.id.clone())),
        ("image_width", Entry::Whole(width)),
        ("image_height", Entry::Whole(height)),
        ("camera_matrix", Entry::Matrix([3, 3], k.concat())),
        ("distortion_model", Entry::Text(model.into())),
        ("distortion_coefficients", Entry::Matrix([1, terms.len()], terms)),
    ];
    if view.has_pose {
        entries.push(("rvec", column(rodrigues(&view.camera.rotation()))));
        entries.push(("tvec", column(view.camera.translation())));
    }
    entries
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
        given.extend(cameras(file, &root)?.into_iter().map(|camera| camera.with_path(&file.name)));
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

/// Reads all cameras of a file: a single camera, cameras whose keys have a number or a side (`left`, `right`), or one
/// camera below each key.
fn cameras(file: &File, root: &Node) -> Result<Vec<ImportedCamera>, FormatError> {
    let mut lenses: BTreeMap<String, [Option<Node>; 2]> = BTreeMap::new();
    for (key, node) in root.entries() {
        let Some((part, camera)) = part_of_lens(key).filter(|_| node.is_list_or_matrix()) else { continue };
        lenses.entry(camera).or_default()[part as usize].get_or_insert(node);
    }
    if !lenses.values().any(|[matrix, _]| matrix.is_some()) {
        if is_flat(root) {
            return Ok(vec![camera(root, file.stem(), root)?]);
        }
        let below = root.entries().into_iter().filter(|(_, node)| {
            let names_matrix =
                |(key, _): &(&str, Node)| part_of_lens(key).is_some_and(|(part, _)| part == Part::Matrix);
            is_flat(node) || node.entries().iter().any(names_matrix)
        });
        let below: Result<Vec<_>, _> = below.map(|(key, node)| camera(&node, key, root)).collect();
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
        let id = if id.is_empty() { file.stem() } else { &id };
        lens(id, [root, root], &matrix, terms.as_ref())
    });
    stereo.collect()
}

/// Reads the camera whose keys are directly below `node`. Values that are common to the file are in `root`.
fn camera(node: &Node, id: &str, root: &Node) -> Result<ImportedCamera, FormatError> {
    let entries = node.entries();
    let find = |wanted: Part| {
        let is_wanted = |(key, value): &&(&str, Node)| {
            part_of_lens(key).is_some_and(|(part, _)| part == wanted) && value.is_list_or_matrix()
        };
        entries.iter().find(is_wanted).map(|(_, value)| value.clone())
    };
    // An object at the top level may be another camera.
    let of_file = || {
        let is_wanted = |(key, value): &(&str, Node)| {
            part_of_lens(key).is_some_and(|(part, camera)| part == Part::Distortion && camera.is_empty())
                && value.is_list_or_matrix()
                && (!value.is_object() || value.get("data").is_some())
        };
        root.entries().into_iter().find(is_wanted).map(|(_, value)| value)
    };
    let matrix = match find(Part::Matrix) {
        Some(matrix) => matrix,
        None if is_flat(node) => node.clone(),
        None => node.require(&["camera_matrix"])?,
    };
    let name = node.first_of(&["camera_name", "name"]).and_then(|name| name.text().ok());
    let terms = find(Part::Distortion).or_else(|| node.get("coeffs")).or_else(of_file);
    let mut given = lens(name.unwrap_or(id), [node, root], &matrix, terms.as_ref())?;
    if let (Some(r), Some(t)) =
        (node.first_of(&["rvec", "R", "rotation"]), node.first_of(&["tvec", "T", "t"]))
    {
        let rotation = if r.numbers()?.len() == 9 { Some(r.matrix()?) } else { from_rodrigues(r.exactly()?) };
        given.pose = Some((rotation.ok_or_else(|| r.unexpected("a rotation"))?, t.exactly()?));
    }
    Ok(given)
}

/// Reads a lens from its matrix and its distortion coefficients. `levels` are the node of the camera and the
/// node of the file, which contain size, model and single coefficients.
fn lens(
    id: &str,
    levels: [&Node; 2],
    matrix: &Node,
    terms: Option<&Node>,
) -> Result<ImportedCamera, FormatError> {
    let intrinsics = match is_flat(matrix) {
        true => flat_intrinsics(matrix)?,
        false => intrinsics_from_matrix(&matrix.matrix()?, matrix.place())?,
    };
    let mut given = ImportedCamera::new(id, matrix.place(), intrinsics.with_corner_origin());
    let [own, root] = levels;
    given.size = size(own)?.map_or_else(|| size(root), |size| Ok(Some(size)))?;
    let fisheye = declares_fisheye(own)? | declares_fisheye(root)?;
    given.distortion = match terms {
        Some(terms) => distortion(terms, fisheye)?,
        None => named_distortion(levels, fisheye)?,
    };
    Ok(given)
}

/// Keys of the focal length in x and the principal point, if they are separate numbers.
const FLAT_KEYS: [&[&str]; 3] = [&["fx", "f", "focal"], &["cx", "ppx"], &["cy", "ppy"]];

/// Whether an object contains the intrinsic parameters as separate numbers.
fn is_flat(node: &Node) -> bool {
    FLAT_KEYS.iter().all(|keys| node.first_of(keys).is_some_and(|value| value.is_number()))
}

/// Reads intrinsic parameters that are separate numbers, such as `fx`, `fy`, `cx` and `cy`.
fn flat_intrinsics(node: &Node) -> Result<Intrinsics, FormatError> {
    let number = |keys: &[&str]| node.require(keys)?.number();
    let [fx, cx, cy] = [number(FLAT_KEYS[0])?, number(FLAT_KEYS[1])?, number(FLAT_KEYS[2])?];
    let fy = node.get("fy").map_or(Ok(fx), |fy| fy.number())?;
    let skew = node.get("skew").map_or(Ok(0.0), |skew| skew.number())?;
    Ok(Intrinsics { k: [fx, fy, cx, cy], skew })
}

fn size(root: &Node) -> Result<Option<[u32; 2]>, FormatError> {
    let keys = (
        root.first_of(&["image_width", "width", "imageWidth"]),
        root.first_of(&["image_height", "height", "imageHeight"]),
    );
    if let (Some(width), Some(height)) = keys {
        return Ok(Some([width.side()?, height.side()?]));
    }
    root.first_of(&["image_size", "imageSize", "resolution", "size"]).map(|size| size.sides()).transpose()
}

/// Returns rational terms in the order of `OpenCV`, without the thin-prism terms if they are 0.
pub(crate) fn written_terms(terms: &[f64; 12]) -> Vec<f64> {
    let [rational @ .., _, _, _, _] = terms;
    if terms[8..] == [0.0; 4] { rational.to_vec() } else { terms.to_vec() }
}
