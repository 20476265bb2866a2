//! Calibration of WILDTRACK: `intrinsic_zero/intr_*.xml` and `extrinsic/extr_*.xml`.
//!
//! Images are undistorted. Poses are world to camera: rotations as Rodrigues vectors, translations in
//! centimetres. Pixels count from the centre of the first pixel, as in `OpenCV`: our principal point minus
//! 0.5.

use crate::export::{Export, Scene};
use crate::file::File;
use crate::file::{FormatError, Problem};
use crate::fisheye::{from_rodrigues, rodrigues};
use crate::given::{
    Imported, ImportedCamera, Pose, intrinsics_from_matrix, note_unlikely_poses, site_with_notes,
};
use crate::input::Input;
use crate::lens_keys::{distortion, refuse_unknown_distortion};
use crate::opencv::matrix_xml;
use crate::tree::{Node, Syntax, joined};

/// Number of centimetres in a metre.
const CM_PER_M: f64 = 100.0;

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    for view in &scene.views {
        export.report_distortion(view);
        let k = view.intrinsics(view.centre_from_pixel_centre()).concat();
        let [width, height] = view.size;
        let open = "<?xml version=\"1.0\"?>\n<opencv_storage>\n";
        let lens = [
            format!("<image_width>{width}</image_width>\n<image_height>{height}</image_height>\n"),
            matrix_xml("camera_matrix", [3, 3], &k),
            matrix_xml("distortion_coefficients", [5, 1], &[0.0; 5]),
        ];
        let name = |folder: &str, kind: &str| format!("{folder}/{kind}_{}.xml", view.file);
        export.push(name("intrinsic_zero", "intr"), format!("{open}{}</opencv_storage>\n", lens.concat()));
        let rvec = joined(&rodrigues(&view.camera.rotation()), " ");
        let tvec = joined(&view.camera.translation().map(|t| t * CM_PER_M), " ");
        let pose = format!("{open}<rvec>{rvec}</rvec>\n<tvec>{tvec}</tvec>\n</opencv_storage>\n");
        export.push(name("extrinsic", "extr"), pose);
    }
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    // The dataset contains the raw cameras and the cameras of its undistorted images. The cameras of the
    // undistorted images are preferred.
    let is_zero = |file: &File| file.name.contains("intrinsic_zero/");
    let has_zero = files.iter().any(is_zero);
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter().filter(|file| is_zero(file) || !has_zero) {
        let Some(id) = file.stem().strip_prefix("intr_") else { continue };
        let tree = Syntax::Xml.parse(file)?;
        let root = Node::root(file, &tree);
        let k = root.require(&["camera_matrix"])?;
        let intrinsics = intrinsics_from_matrix(&k.matrix()?, k.place())?.with_corner_origin();
        let mut camera = ImportedCamera::new(id, k.place(), intrinsics);
        refuse_unknown_distortion(&root, &["distortion_coefficients"])?;
        if let (Some(width), Some(height)) = (root.get("image_width"), root.get("image_height")) {
            camera.size = Some([width.side()?, height.side()?]);
        }
        if let Some(node) = root.get("distortion_coefficients") {
            camera.distortion = distortion(&node, false)?;
        }
        camera.pose = Some(pose(files, id, &mut rest)?);
        given.push(camera);
        rest.extend(root.unread_keys());
    }
    let mut imported = site_with_notes(given, rest, files, "a folder with intr_*.xml and extr_*.xml")?;
    if files.unit_m().is_none() {
        imported.notes.push("translations are read as centimetres; use --unit m for metres".into());
    }
    note_unlikely_poses(&mut imported);
    Ok(imported)
}

fn pose(files: &[File], id: &str, rest: &mut Vec<String>) -> Result<Pose, FormatError> {
    let wanted = format!("extr_{id}.xml");
    let file = files.iter().find(|file| file.base() == wanted).ok_or_else(|| {
        FormatError::new(&wanted, Problem::MissingFile { companion: format!("intr_{id}.xml") })
    })?;
    let tree = Syntax::Xml.parse(file)?;
    let root = Node::root(file, &tree);
    let r = root.require(&["rvec"])?;
    let rotation = from_rodrigues(r.exactly()?).ok_or_else(|| r.unexpected("a rotation"))?;
    let translation = root.require(&["tvec"])?.exactly::<3>()?.map(|t| t / CM_PER_M);
    rest.extend(root.unread_keys());
    Ok((rotation, translation))
}
