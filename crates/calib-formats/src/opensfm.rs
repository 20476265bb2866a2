//! Camera models of `OpenSfM`: `camera_models.json`, or the cameras of `reconstruction.json`. Only the lenses are read.
//!
//! With an image of w x h pixels, `x` in the file is the pixel `max(w, h) x + (w, h) / 2`. Pixels count from the corner.

use calib_core::{BrownConrady, Distortion};

use crate::file::FormatError;
use crate::given::{Imported, ImportedCamera, site_with_notes};
use crate::input::Input;
use crate::tree::{Node, Syntax};

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::Json.parse(file)?;
        let root = Node::root(file, &tree);
        // A reconstruction file is a list of objects with cameras, shots and points.
        let parts = if tree.is_array() { root.items()? } else { vec![root.clone()] };
        for part in &parts {
            let cameras = part.get("cameras");
            for (id, camera) in cameras.as_ref().unwrap_or(part).entries() {
                if camera.get("width").is_some() {
                    given.push(lens(id, &camera)?.with_path(&file.name));
                }
            }
        }
        rest.extend(root.unread_keys());
    }
    site_with_notes(given, rest, files, &files[0].name)
}

fn lens(id: &str, camera: &Node) -> Result<ImportedCamera, FormatError> {
    let size = [camera.require(&["width"])?.side()?, camera.require(&["height"])?.side()?];
    let or_zero = |key: &str| camera.get(key).map_or(Ok(0.0), |value| value.number());
    let model = camera.get("projection_type");
    let name = model.as_ref().map_or(Ok("perspective"), |model| model.text())?;
    let [k1, k2, k3, k4] = [or_zero("k1")?, or_zero("k2")?, or_zero("k3")?, or_zero("k4")?];
    let [p1, p2] = [or_zero("p1")?, or_zero("p2")?];
    let distortion = match name {
        "perspective" | "simple_radial" | "radial" | "brown" => {
            Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 })
        }
        "fisheye" | "fisheye_opencv" => Distortion::KannalaBrandt { k: [k1, k2, k3, k4] },
        _ => {
            let known =
                "perspective, simple_radial, radial, brown, fisheye or fisheye_opencv, the supported models";
            return Err(model.as_ref().unwrap_or(camera).unexpected(known));
        }
    };
    let fx = camera.require(&["focal_x", "focal"])?.number()?;
    let fy = camera.require(&["focal_y", "focal_x", "focal"])?.number()?;
    let [width, height] = size.map(f64::from);
    let unit = width.max(height);
    let centre = [0.5 * width + unit * or_zero("c_x")?, 0.5 * height + unit * or_zero("c_y")?];
    let k = [unit * fx, unit * fy, centre[0], centre[1]];
    let is_straight = [k1, k2, k3, p1, p2] == [0.0; 5] && matches!(distortion, Distortion::BrownConrady(_));
    let distortion = if is_straight { Distortion::None } else { distortion };
    Ok(ImportedCamera { size: Some(size), distortion, ..ImportedCamera::new(id, camera.place(), k) })
}
