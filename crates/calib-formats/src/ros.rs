//! ROS `camera_info`: the lens, with one file for each camera. The pose belongs in TF and is not written.
//!
//! Pixels count from the centre of the first pixel, as in OpenCV.

use crate::export::{Export, Scene};
use crate::file::File;
use crate::file::FormatError;
use crate::given::{Imported, ImportedCamera, intrinsics_from_matrix, site_with_notes};
use crate::opencv::{distortion, is_fisheye};
use crate::tree::{Node, Syntax, joined, quote};
use crate::view::{Terms, View};

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    for view in &scene.views {
        let terms = export.terms(view, scene.lenses);
        export.push(format!("{}.{}", view.file, scene.extension), camera_info(view, terms));
    }
}

fn camera_info(view: &View, terms: Terms) -> String {
    let k = view.intrinsics(view.centre_from_pixel_centre());
    let (model, terms) = match terms {
        Terms::Fisheye(k) => ("equidistant", k.to_vec()),
        Terms::None => ("plumb_bob", vec![0.0; 5]),
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => ("plumb_bob", vec![b.k1, b.k2, b.p1, b.p2, b.k3]),
    };
    let p = k.map(|[a, b, c]| [a, b, c, 0.0]).concat();
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let matrix = |key: &str, rows: usize, data: &[f64]| {
        let cols = data.len() / rows;
        format!("{key}:\n  rows: {rows}\n  cols: {cols}\n  data: [{}]\n", joined(data, ", "))
    };
    let [width, height] = view.size;
    [
        format!("image_width: {width}\nimage_height: {height}\ncamera_name: {}\n", quote(&view.id)),
        matrix("camera_matrix", 3, &k.concat()),
        format!("distortion_model: {model}\n"),
        matrix("distortion_coefficients", 1, &terms),
        matrix("rectification_matrix", 3, &unit),
        matrix("projection_matrix", 3, &p),
    ]
    .concat()
}

pub(crate) fn read(files: &[File]) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files {
        let tree = Syntax::detect(file.as_text()?).parse(file)?;
        let root = Node::root(file, &tree);
        let k = root.require(&["camera_matrix"])?;
        let [fx, fy, cx, cy] = intrinsics_from_matrix(&k.matrix()?, k.place())?;
        let id = root.get("camera_name").and_then(|node| node.text().ok()).unwrap_or(file.stem());
        let mut camera = ImportedCamera::new(id, k.place(), [fx, fy, cx + 0.5, cy + 0.5]);
        camera.size =
            Some([root.require(&["image_width"])?.side()?, root.require(&["image_height"])?.side()?]);
        if let Some(terms) = root.get("distortion_coefficients") {
            let model = root.get("distortion_model").map(|node| node.text()).transpose()?.unwrap_or_default();
            camera.distortion = distortion(&terms, is_fisheye(model))?;
        }
        given.push(camera);
        rest.extend(root.unread_keys());
    }
    site_with_notes(given, rest, &files[0].name)
}
