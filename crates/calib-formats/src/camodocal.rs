//! Lenses of camodocal, in OpenCV's YAML, one camera in each file.
//!
//! Pixels count from the centre of the first pixel, as in OpenCV.

use calib_core::Distortion;
use calib_core::camera::Unified;

use crate::file::FormatError;
use crate::given::{Imported, ImportedCamera, site_with_notes};
use crate::input::Input;
use crate::lens_keys::{distortion_of_terms, sphere_gain};
use crate::tree::{Node, Syntax};

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        let tree = Syntax::Yaml.parse(file)?;
        let root = Node::root(file, &tree);
        let name = root.get("camera_name").and_then(|name| name.text().ok()).filter(|name| !name.is_empty());
        let mut lens = lens(name.unwrap_or(file.stem()), &root)?.with_path(&file.name);
        lens.size = Some([root.require(&["image_width"])?.side()?, root.require(&["image_height"])?.side()?]);
        given.push(lens);
        rest.extend(root.unread_keys());
    }
    site_with_notes(given, rest, files, &files[0].name)
}

fn lens(id: &str, root: &Node) -> Result<ImportedCamera, FormatError> {
    let model = root.require(&["model_type"])?;
    let values = root.require(&["projection_parameters"])?;
    let terms = root.get("distortion_parameters");
    let term = |key: &str| {
        let value = terms.as_ref().and_then(|terms| terms.get(key));
        value.map_or(Ok(0.0), |value| value.number())
    };
    let number = |key: &str| values.require(&[key])?.number();
    let four = |keys: [&str; 4]| -> Result<[f64; 4], FormatError> {
        Ok([number(keys[0])?, number(keys[1])?, number(keys[2])?, number(keys[3])?])
    };
    let ([fx, fy, cx, cy], distortion) = match model.text()?.to_uppercase().as_str() {
        "PINHOLE" | "PINHOLE_FULL" => {
            let mut all = [0.0; 12];
            for (value, key) in all.iter_mut().zip(["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]) {
                *value = term(key)?;
            }
            let distortion = if all == [0.0; 12] { Distortion::None } else { distortion_of_terms(all) };
            (four(["fx", "fy", "cx", "cy"])?, distortion)
        }
        "KANNALA_BRANDT" => {
            let k = four(["k2", "k3", "k4", "k5"])?;
            (four(["mu", "mv", "u0", "v0"])?, Distortion::KannalaBrandt { k })
        }
        "MEI" => {
            let xi = root.require(&["mirror_parameters"])?.require(&["xi"])?;
            let value = xi.number()?;
            let [gx, gy, u0, v0] = four(["gamma1", "gamma2", "u0", "v0"])?;
            let (radial, tangential) = ([term("k1")?, term("k2")?], [term("p1")?, term("p2")?]);
            let gain = sphere_gain(value, &xi)?;
            ([gx / gain, gy / gain, u0, v0], Distortion::Unified(Unified { xi: value, radial, tangential }))
        }
        "SCARAMUZZA" => return Err(model.unexpected("another model; import SCARAMUZZA as ocamcalib")),
        _ => {
            return Err(
                model.unexpected("PINHOLE, PINHOLE_FULL, KANNALA_BRANDT or MEI, the supported models")
            );
        }
    };
    let k = [fx, fy, cx + 0.5, cy + 0.5];
    Ok(ImportedCamera { distortion, ..ImportedCamera::new(id, values.place(), k) })
}
