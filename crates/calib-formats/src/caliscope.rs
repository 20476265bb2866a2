//! Camera arrays in TOML, as caliscope, anipose and `FreeMoCap` write them. Only the lenses are read. The
//! poses are relative to a calibration board and have an unknown unit, so they are not read.
//!
//! Pixels count from the centre of the first pixel, as in OpenCV.

use crate::file::FormatError;
use crate::given::{Imported, ImportedCamera, intrinsics_from_matrix, site_with_notes};
use crate::input::Input;
use crate::lens_keys::{distortion, fisheye_flag, refuse_unknown_distortion};
use crate::tree::{Node, Syntax};

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::Toml.parse(file)?;
        let root = Node::root(file, &tree);
        // Newer files have one table with all cameras.
        let cameras = root.get("cameras").filter(|cameras| cameras.get("matrix").is_none());
        for (key, camera) in cameras.as_ref().unwrap_or(&root).entries() {
            let Some(k) = camera.get("matrix") else { continue };
            let intrinsics = intrinsics_from_matrix(&k.matrix()?, k.place())?.with_corner_origin();
            let id = camera.get("name").and_then(|name| name.text().ok()).unwrap_or(key);
            let mut lens = ImportedCamera::new(id, camera.place(), intrinsics).with_path(&file.name);
            refuse_unknown_distortion(&camera, &["distortions", "distortion"])?;
            lens.size = Some(camera.require(&["size"])?.sides()?);
            if let Some(terms) = camera.first_of(&["distortions", "distortion"]) {
                lens.distortion = distortion(&terms, fisheye_flag(&camera)? == Some(true))?;
            }
            given.push(lens);
        }
        rest.extend(root.unread_keys());
    }
    site_with_notes(given, rest, files, &files[0].name)
}
