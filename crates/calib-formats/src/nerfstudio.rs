//! nerfstudio's `transforms.json`.
//!
//! Poses are camera to world, with camera axes right, up, back. Pixels count from the corner of the image, as
//! in this library: nerfstudio's rays pass through the index of a pixel plus a half.

use calib_core::{BrownConrady, Distortion};
use serde_json::{Value, json};

use crate::export::{Export, Scene};
use crate::file::{FormatError, Problem, stem};
use crate::fisheye::rotate;
use crate::given::{Imported, ImportedCamera, Pose, site_with_notes};
use crate::input::Input;
use crate::lens_keys::{fisheye_flag, refuse_unknown_distortion};
use crate::tree::{Node, Syntax, pretty};
use crate::view::{Terms, View};

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut frames = Vec::new();
    for view in &scene.views {
        let terms = export.terms(view, scene.lenses);
        frames.push(frame(view, terms));
        if view.image.is_none() {
            export
                .notes
                .push(format!("camera {:?} has no image file; file_path is {}.png", view.id, view.file));
        }
    }
    export.push("transforms.json", pretty(&json!({ "frames": frames })));
}

fn frame(view: &View, terms: Terms) -> Value {
    let ([fx, fy], [cx, cy], [w, h]) = (view.focal(), view.centre(), view.size);
    let path = view.image.clone().unwrap_or_else(|| format!("{}.png", view.file));
    let mut frame = json!({
        "file_path": path, "w": w, "h": h, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
        "camera_model": "OPENCV",
        "transform_matrix": world_from_camera(view),
    });
    let named: Vec<(&str, f64)> = match terms {
        Terms::None | Terms::Rational(_) => Vec::new(),
        Terms::Fisheye(k) => {
            frame["camera_model"] = json!("OPENCV_FISHEYE");
            ["k1", "k2", "k3", "k4"].into_iter().zip(k).collect()
        }
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => {
            vec![("k1", b.k1), ("k2", b.k2), ("k3", b.k3), ("p1", b.p1), ("p2", b.p2)]
        }
    };
    for (key, value) in named {
        frame[key] = json!(value);
    }
    frame
}

/// Returns the 4 x 4 camera-to-world pose. Its columns are the camera axes right, up and back, and the
/// position.
pub(crate) fn world_from_camera(view: &View) -> [[f64; 4]; 4] {
    let [right, down, forward] = view.camera.rotation();
    let centre = <[f64; 3]>::from(view.camera.position);
    let row = |i: usize| [right[i], -down[i], -forward[i], centre[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::Json.parse(file)?;
        let root = Node::root(file, &tree);
        for frame in root.require(&["frames"])?.items()? {
            let camera = camera(&root, &frame, files.size())?;
            let path = file.path_beside(camera.image.as_deref().unwrap_or_default());
            given.push(camera.with_path(&path));
        }
        rest.extend(root.unread_keys());
    }
    let mut imported = site_with_notes(given, rest, files, &files[0].name)?;
    if files.unit_m().is_none() {
        imported.notes.push(
            "poses are read as metres with z up, which is true only for an aligned nerfstudio data set; use --unit \
             for another unit"
                .into(),
        );
    }
    Ok(imported)
}

/// Reads a frame; its missing keys are taken from the top level of the file. `stated` is the size of the image
/// from the caller.
fn camera(root: &Node, frame: &Node, stated: Option<[u32; 2]>) -> Result<ImportedCamera, FormatError> {
    let of = |key: &str| frame.get(key).or_else(|| root.get(key));
    let number = |key: &str| of(key).map(|node| node.number()).transpose();
    let side = |key: &str| of(key).map(|node| node.side()).transpose();
    let size = stated.or(side("w")?.zip(side("h")?).map(|(w, h)| [w, h]));
    let fx = match (number("fl_x")?, number("camera_angle_x")?, size) {
        (Some(focal), _, _) => focal,
        (None, Some(angle), Some([width, _])) => 0.5 * f64::from(width) / (0.5 * angle).tan(),
        (None, Some(_), None) => {
            return Err(FormatError::new(
                frame.place().trim_end_matches([' ', ':']),
                Problem::AngleWithoutSize,
            ));
        }
        _ => {
            return Err(frame
                .require(&["fl_x"])
                .map_or_else(|error| error, |node| node.unexpected("a focal length")));
        }
    };
    let centre = size.map(|size| size.map(|side| 0.5 * f64::from(side)));
    let or_middle = |key: &str, axis: usize| match (number(key)?, centre) {
        (Some(at), _) => Ok(at),
        (None, Some(centre)) => Ok(centre[axis]),
        (None, None) => frame.require(&[key])?.number(),
    };
    let k = [fx, number("fl_y")?.unwrap_or(fx), or_middle("cx", 0)?, or_middle("cy", 1)?];
    let path = frame.require(&["file_path"])?.text()?;
    let given = ImportedCamera::new(stem(path), frame.place(), k);
    let (pose, distortion) = (pose(&frame.require(&["transform_matrix"])?)?, lens(root, frame)?);
    Ok(ImportedCamera { image: Some(path.to_owned()), size, distortion, pose: Some(pose), ..given })
}

fn lens(root: &Node, frame: &Node) -> Result<Distortion, FormatError> {
    let of = |key: &str| frame.get(key).or_else(|| root.get(key));
    let term = |key: &str| of(key).map_or(Ok(0.0), |node| node.number());
    let [k1, k2, k3, k4] = [term("k1")?, term("k2")?, term("k3")?, term("k4")?];
    let [p1, p2] = [term("p1")?, term("p2")?];
    let model = of("camera_model");
    let name = model.as_ref().map_or(Ok("OPENCV"), |node| node.text())?;
    for level in [root, frame] {
        refuse_unknown_distortion(level, &[])?;
    }
    let flag = fisheye_flag(frame)?.or(fisheye_flag(root)?).unwrap_or(false);
    let is_fisheye = name == "OPENCV_FISHEYE" || flag;
    let radial = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"];
    match model {
        _ if is_fisheye && [p1, p2] == [0.0; 2] => Ok(Distortion::KannalaBrandt { k: [k1, k2, k3, k4] }),
        _ if is_fisheye => {
            Err(frame.unexpected("a fisheye with k1 to k4; p1 and p2 are not supported with it"))
        }
        Some(node) if !radial.contains(&name) => {
            Err(node.unexpected("OPENCV or OPENCV_FISHEYE, the supported camera models"))
        }
        _ if k4 != 0.0 => Err(frame.unexpected("only k1, k2, k3, p1, p2; k4 is not supported")),
        _ if [k1, k2, k3, p1, p2] == [0.0; 5] => Ok(Distortion::None),
        _ => Ok(Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 })),
    }
}

/// Converts a camera-to-world matrix, whose camera looks along -z, to a world-to-camera pose.
fn pose(matrix: &Node) -> Result<Pose, FormatError> {
    let numbers = matrix.numbers()?;
    let (12 | 16) = numbers.len() else {
        return Err(matrix.unexpected("three or four rows of four numbers"));
    };
    let column = |sign: f64, j: usize| [0, 1, 2].map(|i| sign * numbers[4 * i + j]);
    let rotation = [column(1.0, 0), column(-1.0, 1), column(-1.0, 2)];
    Ok((rotation, rotate(&rotation, column(-1.0, 3))))
}
