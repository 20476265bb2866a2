//! Kalibr's `camchain.yaml`: lenses. The poses are from camera to camera and know no world.
//!
//! Pixels count from the centre of the first one, as in OpenCV.

use crate::error::{FormatError, quoted};
use crate::file::File;
use crate::given::{Given, Imported, site_and_rest};
use crate::opencv::distortion;
use crate::tree::{Node, Syntax};

pub(crate) fn read(files: &[File]) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files {
        let tree = Syntax::Yaml.parse(file)?;
        let root = Node::root(file, &tree);
        for (name, camera) in root.entries() {
            if camera.get("intrinsics").is_some() {
                given.push(lens(name, &camera)?);
            }
        }
        rest.extend(root.left_over());
    }
    site_and_rest(given, rest, &files[0].name)
}

fn lens(name: &str, camera: &Node) -> Result<Given, FormatError> {
    let model = camera.need(&["camera_model"])?;
    if model.text()? != "pinhole" {
        return Err(model.wrong("\"pinhole\", the only camera model that has a place here"));
    }
    let [fx, fy, cx, cy] = camera.need(&["intrinsics"])?.exactly()?;
    let mut given = Given::new(name, camera.place(), [fx, fy, cx + 0.5, cy + 0.5]);
    let size = camera.need(&["resolution"])?;
    let sides = size.items()?;
    let [width, height] = &sides[..] else { return Err(size.wrong("width and height")) };
    given.size = Some([width.side()?, height.side()?]);
    let model = camera.get("distortion_model").map_or(Ok("none"), |node| node.text())?;
    given.distortion = match model {
        "none" => given.distortion,
        "radtan" | "equidistant" => {
            distortion(&camera.need(&["distortion_coeffs"])?, model == "equidistant")?
        }
        other => {
            let place = format!("{}/distortion_model", camera.place());
            return Err(FormatError::expected(place, quoted(other), "radtan, equidistant or none"));
        }
    };
    Ok(given)
}
