//! Camera parameters of MATLAB's Computer Vision Toolbox as JSON: `jsonencode(toStruct(params))`, or the properties of
//! `cameraIntrinsics`. Only the lenses are read.
//!
//! Pixels count from 1 at the centre of the first pixel: our coordinates plus 0.5. `IntrinsicMatrix` is transposed,
//! `K` is not.

use calib_core::{BrownConrady, Distortion};

use crate::file::FormatError;
use crate::fisheye::transpose;
use crate::given::{Imported, ImportedCamera, Intrinsics, intrinsics_from_matrix, site_with_notes};
use crate::input::Input;
use crate::tree::{Node, Syntax};

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::Json.parse(file)?;
        let root = Node::root(file, &tree);
        // Stereo parameters contain two cameras.
        let cameras: Vec<(&str, Node)> = root
            .entries()
            .into_iter()
            .filter(|(_, node)| node.is_object() && intrinsics(node).is_ok_and(|found| found.is_some()))
            .filter(|(key, _)| *key != "Intrinsics")
            .collect();
        if cameras.is_empty() {
            let camera = root.get("Intrinsics").filter(Node::is_object).unwrap_or(root.clone());
            given.push(lens(file.stem(), &camera)?.with_path(&file.name));
        }
        for (id, camera) in cameras {
            given.push(lens(id, &camera)?.with_path(&file.name));
        }
        rest.extend(root.unread_keys());
    }
    site_with_notes(given, rest, files, &files[0].name)
}

/// Reads the intrinsic matrix in any of its forms; `None` without one.
fn intrinsics(node: &Node) -> Result<Option<Intrinsics>, FormatError> {
    if let Some(k) = node.get("IntrinsicMatrix") {
        return intrinsics_from_matrix(&transpose(&k.matrix()?), k.place()).map(Some);
    }
    if let Some(k) = node.get("K") {
        return intrinsics_from_matrix(&k.matrix()?, k.place()).map(Some);
    }
    let Some(focal) = node.get("FocalLength") else { return Ok(None) };
    let ([fx, fy], [cx, cy]) = (focal.exactly()?, node.require(&["PrincipalPoint"])?.exactly()?);
    let skew = node.get("Skew").map_or(Ok(0.0), |skew| skew.number())?;
    Ok(Some(Intrinsics { k: [fx, fy, cx, cy], skew }))
}

fn lens(id: &str, camera: &Node) -> Result<ImportedCamera, FormatError> {
    let Some(Intrinsics { k: [fx, fy, cx, cy], skew }) = intrinsics(camera)? else {
        return Err(camera
            .require(&["IntrinsicMatrix", "K", "FocalLength"])
            .map_or_else(|error| error, |node| node.unexpected("the intrinsic matrix")));
    };
    let mut lens =
        ImportedCamera::new(id, camera.place(), Intrinsics { k: [fx, fy, cx - 0.5, cy - 0.5], skew });
    // `ImageSize` contains the height before the width.
    if let Some(size) = camera.get("ImageSize") {
        let sides = size.items()?;
        let [height, width] = &sides[..] else { return Err(size.unexpected("height and width")) };
        lens.size = Some([width.side()?, height.side()?]);
    }
    let terms = |key: &str| camera.get(key).map_or(Ok(Vec::new()), |node| node.numbers());
    let (radial, tangential) = (terms("RadialDistortion")?, terms("TangentialDistortion")?);
    let at = |terms: &[f64], index: usize| terms.get(index).copied().unwrap_or_default();
    let [k1, k2, k3] = [0, 1, 2].map(|index| at(&radial, index));
    let [p1, p2] = [0, 1].map(|index| at(&tangential, index));
    if [k1, k2, k3, p1, p2] != [0.0; 5] {
        lens.distortion = Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 });
    }
    Ok(lens)
}
