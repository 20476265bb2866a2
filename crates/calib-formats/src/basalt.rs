//! Calibrations of Basalt, in JSON. Only the lenses are read: the poses are relative to the IMU.
//!
//! Pixels count from the centre of the first pixel, as in OpenCV.

use calib_core::Distortion;

use crate::file::FormatError;
use crate::given::{Imported, ImportedCamera, site_with_notes};
use crate::input::Input;
use crate::lens_keys::{distortion_of_terms, sphere_gain};
use crate::tree::{Node, Syntax};

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::Json.parse(file)?;
        let root = Node::root(file, &tree);
        let calibration = root.require(&["value0", "intrinsics"])?;
        let calibration = if root.get("value0").is_some() { calibration } else { root.clone() };
        let sizes = calibration.get("resolution").map_or(Ok(Vec::new()), |sizes| sizes.items())?;
        for (index, camera) in calibration.require(&["intrinsics"])?.items()?.iter().enumerate() {
            let mut lens = lens(&format!("cam{index}"), camera)?.with_path(&file.name);
            lens.size = sizes.get(index).map(Node::sides).transpose()?;
            given.push(lens);
        }
        rest.extend(root.unread_keys());
    }
    site_with_notes(given, rest, files, &files[0].name)
}

fn lens(id: &str, camera: &Node) -> Result<ImportedCamera, FormatError> {
    let (model, values) = (camera.require(&["camera_type"])?, camera.require(&["intrinsics"])?);
    let number = |key: &str| values.require(&[key])?.number();
    let numbers = |keys: &[&str]| keys.iter().map(|key| number(key)).collect::<Result<Vec<f64>, _>>();
    let (gain, distortion) = match model.text()? {
        "pinhole" => (1.0, Distortion::None),
        "kb4" => {
            let k = numbers(&["k1", "k2", "k3", "k4"])?;
            (1.0, Distortion::KannalaBrandt { k: [k[0], k[1], k[2], k[3]] })
        }
        "pinhole-radtan8" => {
            let mut terms = [0.0; 12];
            let read = numbers(&["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"])?;
            terms.iter_mut().zip(read).for_each(|(term, value)| *term = value);
            (1.0, distortion_of_terms(terms))
        }
        "ds" => {
            let (xi, alpha) = (number("xi")?, number("alpha")?);
            (sphere_gain(xi, &values)?, Distortion::DoubleSphere { xi, alpha })
        }
        "eucm" => (1.0, Distortion::Eucm { alpha: number("alpha")?, beta: number("beta")? }),
        "ucm" => {
            // The unified model with xi = alpha / (1 - alpha) and gamma = f / (1 - alpha): gamma / (1 + xi) is f.
            let alpha = number("alpha")?;
            if !(0.0..1.0).contains(&alpha) {
                return Err(values.unexpected("alpha from 0 to below 1"));
            }
            (1.0, Distortion::unified(alpha / (1.0 - alpha)))
        }
        _ => {
            let known = "pinhole, pinhole-radtan8, kb4, ds, eucm or ucm, the supported camera types";
            return Err(model.unexpected(known));
        }
    };
    let [fx, fy, cx, cy] = [number("fx")?, number("fy")?, number("cx")?, number("cy")?];
    let k = [fx / gain, fy / gain, cx + 0.5, cy + 0.5];
    Ok(ImportedCamera { distortion, ..ImportedCamera::new(id, values.place(), k) })
}
