//! Keys and distortion of a lens in `OpenCV`'s terms. Programs write them in many ways.

use calib_core::camera::{Coefficient, Rational};
use calib_core::{BrownConrady, Distortion};

use crate::file::{FormatError, quoted};
use crate::tree::Node;

/// Names of the intrinsic matrix, in lower case without separators.
const MATRIX_NAMES: [&str; 10] = [
    "cameramatrix",
    "k",
    "m",
    "intrinsicmatrix",
    "mtx",
    "intrinsics",
    "intrinsic",
    "cameraintrinsics",
    "cammatrix",
    "kmatrix",
];
/// Beginnings of words that contain `dist`, but do not mean distortion, such as "distance".
const OTHER_WORDS: [&str; 4] = ["distan", "distrib", "distric", "distin"];
/// Words that may precede the name of a coefficient, the longer ones first.
const WORDS: [&str; 12] = [
    "distortion",
    "distort",
    "dist",
    "coefficients",
    "coefficient",
    "coeffs",
    "coeff",
    "coefs",
    "coef",
    "tangential",
    "radial",
    "lens",
];
/// Names of the coefficients in the order of `OpenCV`.
const COEFFICIENTS: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
/// Numbers of distortion coefficients that `OpenCV` allows.
const COEFFICIENT_COUNTS: [usize; 5] = [4, 5, 8, 12, 14];
/// Expected forms of a distortion, for error messages.
const EXPECTED: &str = "a list of coefficients, numbers named k1 to k6, p1 and p2, or none";

/// Part of a lens that a key names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Matrix,
    Distortion,
}

/// Returns a key in lower case without separators.
fn plain(key: &str) -> String {
    key.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_lowercase()
}

/// Whether a key without separators names the lens model or a count instead of coefficients.
fn is_model(plain: &str) -> bool {
    ["model", "type", "name", "count"].iter().any(|word| plain.contains(word))
}

/// Returns the part of a lens that a key names, and the camera that has this part. The camera is a number, `left` or
/// `right` in files with several cameras, otherwise an empty text.
///
/// Keys are compared without case and separators.
pub(crate) fn part_of_lens(key: &str) -> Option<(Part, String)> {
    let plain = plain(key);
    let sides = ["left", "right"].into_iter().filter_map(|side| {
        let core = plain.strip_prefix(side).or_else(|| plain.strip_suffix(side))?;
        Some((core.to_owned(), side.to_owned()))
    });
    let core = plain.trim_end_matches(|c: char| c.is_ascii_digit());
    let numbered = (core.to_owned(), plain[core.len()..].to_owned());
    sides.chain([numbered]).find_map(|(core, camera)| {
        if MATRIX_NAMES.contains(&core.as_str()) {
            return Some((Part::Matrix, camera));
        }
        let is_other = core.contains("undist") || OTHER_WORDS.iter().any(|word| core.contains(word));
        let is_distortion = core == "d" || core.contains("dist") && !is_other && !is_model(&core);
        is_distortion.then_some((Part::Distortion, camera))
    })
}

/// Whether a key begins like a key of the distortion.
fn begins_like_distortion(key: &str) -> bool {
    let plain = plain(key);
    plain.starts_with("dist") && !OTHER_WORDS.iter().any(|word| plain.starts_with(word))
}

/// Returns the coefficient that a key names, such as `dist_k1`, as its index in the order of `OpenCV`.
fn coefficient(key: &str) -> Option<usize> {
    let plain = plain(key);
    let mut core = &plain[..];
    while let Some(rest) = WORDS.iter().find_map(|word| core.strip_prefix(word)) {
        core = rest;
    }
    COEFFICIENTS.iter().position(|name| *name == core)
}

/// Fails if a distortion key that has a value is not in `known`. Keys of the distortion model, and other words such as
/// `distance`, are ignored.
pub(crate) fn refuse_unknown_distortion(node: &Node, known: &[&str]) -> Result<(), FormatError> {
    let unknown = node.entries().into_iter().find(|(key, value)| {
        begins_like_distortion(key) && !known.contains(key) && !is_model(&plain(key)) && !value.is_none()
    });
    unknown.map_or(Ok(()), |(key, value)| {
        let known = if known.is_empty() { "k1, k2, k3, k4, p1, p2".into() } else { known.join(", ") };
        Err(value.unexpected(&format!("one of these keys instead of {}: {known}", quoted(key))))
    })
}

/// Returns whether a flag such as `fisheye_model` declares a fisheye; `None` without a flag. Its value is a flag
/// or the name of a model.
pub(crate) fn fisheye_flag(node: &Node) -> Result<Option<bool>, FormatError> {
    let mut found = None;
    for (key, value) in node.entries() {
        if !plain(key).contains("fisheye") || value.is_list_or_matrix() || value.is_null() {
            continue;
        }
        let is_named = value.text().is_ok_and(is_fisheye);
        let flag = is_named || value.flag()?;
        if found.is_some_and(|earlier| earlier != flag) {
            return Err(value.unexpected("the same value as the other fisheye flag"));
        }
        found = Some(flag);
    }
    Ok(found)
}

/// Whether a flag or the name of the lens model declares a fisheye.
pub(crate) fn declares_fisheye(node: &Node) -> Result<bool, FormatError> {
    let names = node.entries().into_iter().filter(|(key, _)| {
        let plain = plain(key);
        let is_lens = ["distortion", "dist", "camera", "lens", "projection", "calibration", ""]
            .iter()
            .any(|word| plain == format!("{word}model") || plain == format!("{word}type"));
        is_lens || plain == "modeltype"
    });
    let is_named = names.filter_map(|(_, value)| value.text().ok()).any(is_fisheye);
    Ok(is_named | fisheye_flag(node)?.unwrap_or(false))
}

/// Reads the coefficients that are separate numbers, such as `dist_k1`. `levels` are the node of the camera and the
/// node of the file, which may be the same. Fails for any other distortion key with a value; keys of lists, of the
/// model and of counts are ignored.
pub(crate) fn named_distortion(levels: [&Node; 2], fisheye: bool) -> Result<Distortion, FormatError> {
    let [node, root] = levels;
    let common = if std::ptr::eq(node, root) { Vec::new() } else { root.entries() };
    let mut terms = [None; 8];
    for (key, value) in node.entries().into_iter().chain(common) {
        if let Some(index) = coefficient(key).filter(|_| value.is_number()) {
            if terms[index].replace(value.number()?).is_some() {
                return Err(value.unexpected("one value of this coefficient"));
            }
            continue;
        }
        // Lists belong to other cameras of the file, and models and counts are no coefficients.
        let is_known = part_of_lens(key).is_some_and(|(part, _)| part == Part::Distortion);
        let names_distortion = is_known || begins_like_distortion(key) && !is_model(&plain(key));
        if !names_distortion || value.is_list_or_matrix() {
            continue;
        }
        let is_zero = is_known && value.number().is_ok_and(|number| number == 0.0);
        if !is_zero && !value.is_none() {
            return Err(value.unexpected(EXPECTED));
        }
        value.mark_read();
    }
    let [k1, k2, p1, p2, k3, k4, k5, k6] = terms.map(Option::unwrap_or_default);
    let wrong = |found: &str, expected: &str| {
        FormatError::expected(node.place().trim_end_matches([' ', ':']), found, expected)
    };
    if fisheye {
        if terms == [None; 8] {
            return Err(wrong("a fisheye lens without coefficients", "its coefficients k1 to k4"));
        }
        if [p1, p2, k5, k6] != [0.0; 4] {
            return Err(wrong("a fisheye lens with p1, p2, k5 or k6", "only the coefficients k1 to k4"));
        }
        return Ok(Distortion::KannalaBrandt { k: [k1, k2, k3, k4] });
    }
    if k4 != 0.0 && terms[6..] == [None; 2] {
        return Err(wrong("k4 without k5 and k6", "all three, or \"fisheye\": true for a fisheye lens"));
    }
    let all = [k1, k2, p1, p2, k3, k4, k5, k6, 0.0, 0.0, 0.0, 0.0];
    Ok(if all == [0.0; 12] { Distortion::None } else { distortion_of_terms(all) })
}

/// Reads an object whose keys are all coefficients, such as `{"k1": -0.3, "k2": 0.1}`.
fn distortion_of_object(node: &Node, fisheye: bool) -> Result<Distortion, FormatError> {
    let unknown =
        node.entries().into_iter().find(|(key, value)| coefficient(key).is_none() || !value.is_number());
    match unknown {
        Some((_, value)) => Err(value.unexpected("only numbers named k1 to k6, p1 and p2")),
        None => named_distortion([node, node], fisheye),
    }
}

pub(crate) fn is_fisheye(model: &str) -> bool {
    let model = model.to_lowercase();
    ["fisheye", "equidistant", "kannala"].iter().any(|known| model.contains(known))
}

/// Reads a distortion: the four coefficients of a fisheye lens, an object of named coefficients, or a vector of
/// `OpenCV`. The vector contains k1, k2, p1, p2, k3, the rational terms k4 to k6, and the thin-prism terms s1 to s4.
/// Tilt terms must be 0.
pub(crate) fn distortion(node: &Node, fisheye: bool) -> Result<Distortion, FormatError> {
    if node.is_none() && !fisheye {
        node.mark_read();
        return Ok(Distortion::None);
    }
    if node.is_object() && node.get("data").is_none() {
        return distortion_of_object(node, fisheye);
    }
    let terms = node.numbers()?;
    if terms.iter().all(|&term| term == 0.0) && !fisheye {
        return Ok(Distortion::None);
    }
    if fisheye {
        let Ok(k) = terms.try_into() else {
            return Err(node.unexpected("the four coefficients of a fisheye lens"));
        };
        return Ok(Distortion::KannalaBrandt { k });
    }
    if !COEFFICIENT_COUNTS.contains(&terms.len()) {
        return Err(node.unexpected(&format!("4, 5, 8, 12 or 14 coefficients instead of {}", terms.len())));
    }
    if terms.iter().skip(12).any(|&term| term != 0.0) {
        return Err(node.unexpected(
            "no tilt: a tilted sensor is not supported; calibrate the camera without CALIB_TILTED_MODEL",
        ));
    }
    let mut all = [0.0; 12];
    all.iter_mut().zip(&terms).for_each(|(term, value)| *term = *value);
    Ok(distortion_of_terms(all))
}

/// Returns the distortion of `OpenCV`'s terms k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4.
pub(crate) fn distortion_of_terms([k1, k2, p1, p2, k3, k4, k5, k6, prism @ ..]: [f64; 12]) -> Distortion {
    if [k4, k5, k6] == [0.0; 3] && prism == [0.0; 4] {
        return Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 });
    }
    Distortion::Rational(Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2], prism })
}

/// Returns `1 + xi`. For the unified and the double sphere model, other programs multiply the focal length at the
/// centre of the image by this factor. Fails at `node` if xi is too small.
pub(crate) fn sphere_gain(xi: f64, node: &Node) -> Result<f64, FormatError> {
    let [least, _] = Coefficient::Xi.bounds();
    if xi < least { Err(node.unexpected("xi above -1")) } else { Ok(1.0 + xi) }
}
