//! OpenCV's `FileStorage`, as JSON, YAML or XML, with one file for each camera.
//!
//! `rvec` and `tvec` are world to camera, in metres. Pixels count from the centre of the first pixel: our
//! principal point minus 0.5.

use calib_core::{BrownConrady, Distortion};
use serde_json::{Map, Value, json};

use crate::export::{Export, Scene};
use crate::file::File;
use crate::file::FormatError;
use crate::fisheye::{from_rodrigues, rodrigues};
use crate::given::{Imported, ImportedCamera, intrinsics_from_matrix, site_with_notes};
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

pub(crate) fn read(files: &[File]) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files {
        let tree = Syntax::detect(file.as_text()?).parse(file)?;
        let root = Node::root(file, &tree);
        given.push(camera(file, &root)?);
        rest.extend(root.unread_keys());
    }
    let mut imported = site_with_notes(given, rest, &files[0].name)?;
    if imported.site.cameras.iter().any(|camera| camera.solution.is_some()) {
        imported.notes.push(
            "poses are read as metres with z up; rvec and tvec of a chessboard refer to the board instead"
                .into(),
        );
    }
    Ok(imported)
}

fn camera(file: &File, root: &Node) -> Result<ImportedCamera, FormatError> {
    let k = root.require(&["camera_matrix", "cameraMatrix", "K", "M", "intrinsic_matrix", "mtx"])?;
    let [fx, fy, cx, cy] = intrinsics_from_matrix(&k.matrix()?, k.place())?;
    let id = root.first_of(&["camera_name", "name"]).and_then(|node| node.text().ok()).unwrap_or(file.stem());
    let mut given = ImportedCamera::new(id, k.place(), [fx, fy, cx + 0.5, cy + 0.5]);
    given.size = size(root)?;
    let terms = ["distortion_coefficients", "dist_coeffs", "distCoeffs", "dist_coeff", "D", "dist"];
    if let Some(node) = root.first_of(&terms) {
        let model = root.first_of(&["distortion_model", "model"]).and_then(|node| node.text().ok());
        given.distortion = distortion(&node, model.is_some_and(is_fisheye))?;
    }
    if let (Some(r), Some(t)) =
        (root.first_of(&["rvec", "R", "rotation"]), root.first_of(&["tvec", "T", "t"]))
    {
        let rotation = if r.numbers()?.len() == 9 { Some(r.matrix()?) } else { from_rodrigues(r.exactly()?) };
        given.pose = Some((rotation.ok_or_else(|| r.unexpected("a rotation"))?, t.exactly()?));
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

/// Reads `k1, k2, p1, p2, k3` from an `OpenCV` vector; further terms must be 0.
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
    if terms.iter().skip(5).any(|&term| term != 0.0) {
        return Err(
            node.unexpected("only k1, k2, p1, p2, k3; rational, thin-prism and tilt terms are not supported")
        );
    }
    let k3 = terms.get(4).copied().unwrap_or(0.0);
    Ok(Distortion::BrownConrady(BrownConrady { k1: terms[0], k2: terms[1], k3, p1: terms[2], p2: terms[3] }))
}
