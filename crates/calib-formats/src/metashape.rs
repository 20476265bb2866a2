//! Camera calibrations of Agisoft Metashape, in XML: one calibration, or the sensors of a camera export. Only the lenses
//! are read.
//!
//! The principal point is relative to the image centre. The tangential terms p1 and p2 are OpenCV's p2 and p1.

use calib_core::{BrownConrady, Distortion};

use crate::file::{File, FormatError, Problem, quoted};
use crate::given::{Imported, ImportedCamera, Intrinsics, site_with_notes};
use crate::input::Input;
use crate::tree::xml;

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let mut given = Vec::new();
    for file in files.iter() {
        let document = xml(file)?;
        let all = document.descendants().filter(|node| node.has_tag_name("calibration"));
        // A sensor also contains the values before the adjustment.
        let is_initial = |node: &roxmltree::Node| node.attribute("class") == Some("initial");
        let lenses: Vec<_> = all.filter(|node| !is_initial(node)).collect();
        if lenses.is_empty() {
            return Err(FormatError::new(&file.name, Problem::MissingKey(vec!["calibration".into()])));
        }
        for calibration in lenses {
            given.push(lens(file, calibration)?.with_path(&file.name));
        }
    }
    site_with_notes(given, Vec::new(), files, &files[0].name)
}

fn lens(file: &File, calibration: roxmltree::Node) -> Result<ImportedCamera, FormatError> {
    let of = |tag: &str| calibration.children().find(|node| node.has_tag_name(tag));
    let wrong = |tag: &str, found: &str, expected: &str| {
        FormatError::expected(format!("{}: calibration/{tag}", file.name), quoted(found), expected)
    };
    let number = |tag: &str| -> Result<Option<f64>, FormatError> {
        let Some(text) = of(tag).and_then(|node| node.text()) else { return Ok(None) };
        let value = text.trim().parse().ok().filter(|value: &f64| value.abs() <= 1e12);
        value.map(Some).ok_or_else(|| wrong(tag, text, "a number between -1e12 and 1e12"))
    };
    let or_zero = |tag: &str| number(tag).map(Option::unwrap_or_default);
    let required = |tag: &str| {
        let missing =
            || FormatError::new(&file.name, Problem::MissingKey(vec![format!("calibration/{tag}")]));
        number(tag)?.ok_or_else(missing)
    };
    let side = |tag: &str| {
        let value = required(tag)?;
        let is_side = value.fract() == 0.0 && (1.0..=f64::from(calib_site::MAX_SIDE)).contains(&value);
        if is_side {
            Ok(value as u32)
        } else {
            Err(wrong(tag, &value.to_string(), "a whole number of pixels"))
        }
    };
    let size = [side("width")?, side("height")?];
    let f = required("f")?;
    let [width, height] = size.map(f64::from);
    let k = [f + or_zero("b1")?, f, 0.5 * width + or_zero("cx")?, 0.5 * height + or_zero("cy")?];
    let [k1, k2, k3, k4] = [or_zero("k1")?, or_zero("k2")?, or_zero("k3")?, or_zero("k4")?];
    let (p1, p2) = (or_zero("p2")?, or_zero("p1")?);
    for tag in ["p3", "p4"] {
        if or_zero(tag)? != 0.0 {
            return Err(wrong(tag, &or_zero(tag)?.to_string(), "0; adjust the camera without this term"));
        }
    }
    let projection = of("projection").and_then(|node| node.text()).unwrap_or("frame").trim();
    let distortion = match projection {
        "frame" if k4 != 0.0 => {
            return Err(wrong("k4", &k4.to_string(), "0; adjust the camera without this term"));
        }
        "frame" if [k1, k2, k3, p1, p2] == [0.0; 5] => Distortion::None,
        "frame" => Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }),
        "fisheye" | "equidistant_fisheye" if [p1, p2] == [0.0; 2] => {
            Distortion::KannalaBrandt { k: [k1, k2, k3, k4] }
        }
        _ => return Err(wrong("projection", projection, "frame, or fisheye without p1 and p2")),
    };
    let label = calibration.parent().and_then(|sensor| sensor.attribute("label"));
    let intrinsics = Intrinsics { k, skew: or_zero("b2")? };
    let place = format!("{}: calibration", file.name);
    let id = label.filter(|label| !label.trim().is_empty()).unwrap_or(file.stem());
    Ok(ImportedCamera { size: Some(size), distortion, ..ImportedCamera::new(id, place, intrinsics) })
}
