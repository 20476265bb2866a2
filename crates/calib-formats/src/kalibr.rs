//! Kalibr's `camchain.yaml` with the lenses of the cameras. Each pose is relative to the previous camera. A world
//! frame is missing, so the poses are exported but not imported.
//!
//! Pixels count from the centre of the first pixel, as in OpenCV. Kalibr names cameras `cam0`, `cam1` and so
//! on, and its lenses `pinhole-radtan`, `pinhole-equi`, `omni-radtan`, `ds-none` and `eucm-none`. The focal lengths of
//! `omni` and `ds` are `1 + xi` times the focal length at the centre of the image.

use std::fmt::Write as _;

use calib_core::Distortion;

use calib_core::camera::Unified;

use crate::export::{Export, Scene};
use crate::file::{FormatError, quoted};
use crate::fisheye::rotate;
use crate::given::{Imported, ImportedCamera, site_with_notes};
use crate::input::Input;
use crate::lens_keys::{distortion, refuse_unknown_distortion, sphere_gain};
use crate::tree::{Node, Syntax, joined, quote};
use crate::view::{Terms, View};

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut text = String::new();
    let are_placed = scene.views.iter().all(|view| view.is_placed);
    for (index, view) in scene.views.iter().enumerate() {
        let lens = kalibr_lens(view, scene, export);
        let [width, height] = view.size;
        let _ = write!(
            text,
            "cam{index}:\n  camera_model: {}\n  intrinsics: [{}]\n  distortion_model: {}\n  distortion_coeffs: [{}]\n  \
             resolution: [{width}, {height}]\n  rostopic: {}\n  cam_overlaps: []\n",
            lens.camera,
            joined(&lens.intrinsics, ", "),
            lens.distortion,
            joined(&lens.terms, ", "),
            quote(&format!("/{}/image_raw", view.file)),
        );
        if let Some(before) = index.checked_sub(1).filter(|_| are_placed) {
            text += "  T_cn_cnm1:\n";
            for row in camera_from_camera(view, &scene.views[before]) {
                let _ = writeln!(text, "  - [{}]", joined(&row, ", "));
            }
        }
        export.notes.push(format!("camera {:?} is named cam{index} in the file", view.id));
    }
    export.push(format!("camchain.{}", scene.extension), text);
}

/// Lens in Kalibr's terms: camera model, intrinsics in pixels, distortion model and its coefficients.
struct KalibrLens {
    camera: &'static str,
    intrinsics: Vec<f64>,
    distortion: &'static str,
    terms: Vec<f64>,
}

fn kalibr_lens(view: &View, scene: &Scene, export: &mut Export) -> KalibrLens {
    let ([fx, fy], [cx, cy]) = (view.focal(), view.centre_from_pixel_centre());
    let sphere = |camera: &'static str, terms: &[f64], xi: f64| {
        let intrinsics = [terms, &[(1.0 + xi) * fx, (1.0 + xi) * fy, cx, cy]].concat();
        KalibrLens { camera, intrinsics, distortion: "none", terms: Vec::new() }
    };
    match view.distortion() {
        Some(Distortion::Unified(Unified { xi, radial, tangential })) => {
            let terms = [radial, tangential].concat();
            let plain = sphere("omni", &[xi], xi);
            let is_plain = terms == [0.0; 4];
            return if is_plain { plain } else { KalibrLens { distortion: "radtan", terms, ..plain } };
        }
        Some(Distortion::Eucm { alpha, beta }) => return sphere("eucm", &[alpha, beta], 0.0),
        Some(Distortion::DoubleSphere { xi, alpha }) => return sphere("ds", &[xi, alpha], xi),
        _ => {}
    }
    let (distortion, terms) = match export.terms(view, scene.lenses) {
        Terms::Fisheye(k) => ("equidistant", k.to_vec()),
        Terms::None | Terms::Rational(_) => ("radtan", vec![0.0; 4]),
        Terms::BrownConrady(brown) | Terms::Fitted(brown, _) => {
            if brown.k3 != 0.0 {
                export.add_loss(view, "k3 of its distortion: radtan has only k1, k2, p1 and p2");
            }
            ("radtan", vec![brown.k1, brown.k2, brown.p1, brown.p2])
        }
    };
    KalibrLens { camera: "pinhole", intrinsics: vec![fx, fy, cx, cy], distortion, terms }
}

/// Returns the 4 x 4 transform from the coordinates of the previous camera to the coordinates of this one.
fn camera_from_camera(view: &View, before: &View) -> [[f64; 4]; 4] {
    let (now, then) = (view.camera.rotation(), before.camera.rotation());
    // Rows of R R'^T, with the rotations R of this camera and R' of the previous camera.
    let turn = now.map(|row| rotate(&then, row));
    let [t, back] = [view.camera.translation(), rotate(&turn, before.camera.translation())];
    let row = |i: usize| [turn[i][0], turn[i][1], turn[i][2], t[i] - back[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::Yaml.parse(file)?;
        let root = Node::root(file, &tree);
        for (name, camera) in root.entries() {
            if camera.get("intrinsics").is_some() {
                given.push(lens(name, &camera)?.with_path(&file.name));
            }
        }
        rest.extend(root.unread_keys());
    }
    site_with_notes(given, rest, files, &files[0].name)
}

fn lens(name: &str, camera: &Node) -> Result<ImportedCamera, FormatError> {
    let (model, intrinsics) = (camera.require(&["camera_model"])?, camera.require(&["intrinsics"])?);
    let (sphere, [fx, fy, cx, cy]) = match model.text()? {
        "pinhole" => (None, intrinsics.exactly()?),
        "omni" => {
            let [xi, k @ ..] = intrinsics.exactly::<5>()?;
            (Some((xi, Distortion::unified(xi))), k)
        }
        "ds" => {
            let [xi, alpha, k @ ..] = intrinsics.exactly::<6>()?;
            (Some((xi, Distortion::DoubleSphere { xi, alpha })), k)
        }
        "eucm" => {
            let [alpha, beta, k @ ..] = intrinsics.exactly::<6>()?;
            (Some((0.0, Distortion::Eucm { alpha, beta })), k)
        }
        _ => return Err(model.unexpected("pinhole, omni, ds or eucm, the supported camera models")),
    };
    let gain = sphere_gain(sphere.map_or(0.0, |(xi, _)| xi), &intrinsics)?;
    let mut given = ImportedCamera::new(name, camera.place(), [fx / gain, fy / gain, cx + 0.5, cy + 0.5]);
    given.size = Some(camera.require(&["resolution"])?.sides()?);
    let extra = extra_distortion(camera)?;
    given.distortion = match (sphere, extra) {
        (None, extra) => extra,
        (Some((_, sphere)), Distortion::None) => sphere,
        (Some((xi, Distortion::Unified(_))), Distortion::BrownConrady(brown)) if brown.k3 == 0.0 => {
            let (radial, tangential) = ([brown.k1, brown.k2], [brown.p1, brown.p2]);
            Distortion::Unified(Unified { xi, radial, tangential })
        }
        (Some(_), _) => {
            let place = format!("{}/distortion_coeffs", camera.place());
            let found = format!("distortion in addition to {}", model.text()?);
            let expected = "none, or zeros; the combination is not supported. Calibrate the camera as omni-radtan, \
                            ds-none or eucm-none";
            return Err(FormatError::expected(place, found, expected));
        }
    };
    Ok(given)
}

/// Returns the distortion that a camera has in addition to its camera model.
fn extra_distortion(camera: &Node) -> Result<Distortion, FormatError> {
    refuse_unknown_distortion(camera, &["distortion_model", "distortion_coeffs"])?;
    let model = camera.get("distortion_model").map_or(Ok("none"), |node| node.text())?;
    match model {
        "none" => {
            // Coefficients without a model are ambiguous, because radtan and equidistant both have four.
            if let Some(terms) = camera.get("distortion_coeffs")
                && terms.numbers()?.iter().any(|&term| term != 0.0)
            {
                return Err(terms.unexpected(
                    "zeros, because distortion_model is none; set distortion_model to radtan or equidistant",
                ));
            }
            Ok(Distortion::None)
        }
        "radtan" | "equidistant" => {
            distortion(&camera.require(&["distortion_coeffs"])?, model == "equidistant")
        }
        other => {
            let place = format!("{}/distortion_model", camera.place());
            Err(FormatError::expected(place, quoted(other), "radtan, equidistant or none"))
        }
    }
}
