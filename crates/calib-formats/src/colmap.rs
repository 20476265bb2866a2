//! COLMAP's model: `cameras.txt`, `images.txt`, `points3D.txt`. Binary files are converted to this text.
//!
//! Poses are world to camera, with the w of quaternions first. Pixels count from the corner of the image, as
//! in this library.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;

use calib_core::{BrownConrady, Distortion};

use crate::colmap_binary;
use crate::export::{Export, MAX_NEGLIGIBLE_ERROR_PX, Scene, round_up};
use crate::file::File;
use crate::file::{FormatError, Problem, quoted, stem};
use crate::fisheye::{MAX_ANGLE, MAX_FIT_ERROR_PX, fit_error_text, fit_lens};
use crate::fisheye::{from_quaternion, quaternion};
use crate::given::{Imported, ImportedCamera, site_from_cameras};
use crate::input::Input;
use crate::lens_keys::distortion_of_terms;
use crate::tree::{digits, joined};
use crate::view::{Terms, View};

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let mut cameras = String::from("# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n");
    let mut images =
        String::from("# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of 2D points\n");
    for (index, view) in scene.views.iter().enumerate() {
        let number = index + 1;
        let [fx, fy] = view.focal();
        let [cx, cy] = view.centre();
        let terms = export.terms(view, scene.lenses);
        if matches!(terms, Terms::Rational([.., s1, s2, s3, s4]) if [s1, s2, s3, s4] != [0.0; 4]) {
            export.add_loss(view, "s1 to s4 of its distortion: FULL_OPENCV has no thin-prism terms");
        }
        let (model, more) = model(terms);
        let params = [vec![fx, fy, cx, cy], more].concat();
        let [width, height] = view.size;
        let _ = writeln!(cameras, "{number} {model} {width} {height} {}", joined(&params, " "));
        if !view.has_pose {
            continue;
        }
        let pose = [&quaternion(&view.camera.rotation())[..], &view.camera.translation()].concat();
        let _ = writeln!(images, "{number} {} {number} {}\n", joined(&pose, " "), name(view));
    }
    export.push("cameras.txt", cameras);
    if !scene.views.iter().any(|view| view.has_pose) {
        return;
    }
    export.push("images.txt", images);
    export.push("points3D.txt", "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n");
}

/// Returns a name for the image of a view: its file name, with the extension of the camera's image or `png`.
fn name(view: &View) -> String {
    let extension = view.image.as_deref().and_then(|image| image.rsplit_once('.')).map_or("png", |(_, e)| e);
    let plain = extension.len() < 5 && extension.chars().all(|c| c.is_ascii_alphanumeric());
    format!("{}.{}", view.file, if plain { extension } else { "png" })
}

fn model(terms: Terms) -> (&'static str, Vec<f64>) {
    match terms {
        Terms::None => ("PINHOLE", Vec::new()),
        Terms::Rational([terms @ .., _, _, _, _]) => ("FULL_OPENCV", terms.to_vec()),
        Terms::Fisheye(k) => ("OPENCV_FISHEYE", k.to_vec()),
        Terms::BrownConrady(b) | Terms::Fitted(b, _) if b.k3 == 0.0 => {
            ("OPENCV", vec![b.k1, b.k2, b.p1, b.p2])
        }
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => {
            ("FULL_OPENCV", vec![b.k1, b.k2, b.p1, b.p2, b.k3, 0.0, 0.0, 0.0])
        }
    }
}

/// Words of a line of a file, with the number of the line, counted from 1.
struct Line<'a> {
    file: &'a File,
    number: usize,
    words: Vec<&'a str>,
}

impl Line<'_> {
    fn place(&self) -> String {
        format!("{} line {}", self.file.name, self.number)
    }

    fn number(&self, word: usize) -> Result<f64, FormatError> {
        let text = self.words.get(word).copied().unwrap_or_default();
        let value = text.parse::<f64>().ok().filter(|value| value.abs() <= 1e12);
        value.ok_or_else(|| {
            FormatError::expected(self.place(), quoted(text), format!("a number in field {}", word + 1))
        })
    }

    fn numbers<const N: usize>(&self, first: usize) -> Result<[f64; N], FormatError> {
        let mut numbers = [0.0; N];
        for (i, number) in numbers.iter_mut().enumerate() {
            *number = self.number(first + i)?;
        }
        Ok(numbers)
    }
}

fn lines<'a>(files: &'a [File], stem: &str) -> Result<(&'a File, Vec<Line<'a>>), FormatError> {
    let file = files
        .iter()
        .find(|file| file.stem() == stem)
        .ok_or_else(|| FormatError::new(format!("{stem}.txt"), Problem::NotColmap))?;
    let lines = file.as_text()?.lines().enumerate().map(|(i, text)| Line {
        file,
        number: i + 1,
        // A line of points may be long, and is not read.
        words: text.split_whitespace().take(20).collect(),
    });
    let is_said = |line: &Line| !line.words.first().is_some_and(|word| word.starts_with('#'));
    Ok((file, lines.filter(is_said).collect()))
}

pub(crate) fn read(input: &Input) -> Result<Imported, FormatError> {
    // A folder may contain the model both as text and as binary. The first file determines which one is read.
    let is_binary = input[0].extension() == "bin";
    let mut files = Vec::new();
    for file in input.iter().filter(|file| (file.extension() == "bin") == is_binary) {
        files.push(colmap_binary::as_text(file)?.unwrap_or_else(|| file.clone()));
    }
    let files = &files[..];
    let (_, camera_lines) = lines(files, "cameras")?;
    let (mut cameras, mut notes) = (HashMap::new(), Vec::new());
    for line in camera_lines.iter().filter(|line| !line.words.is_empty()) {
        cameras.insert(line.words[0], lens(line, &mut notes)?);
    }
    if !files.iter().any(|file| file.stem() == "images") {
        return only_lenses(cameras, notes, input);
    }
    let (file, image_lines) = lines(files, "images")?;
    let mut given: Vec<ImportedCamera> = Vec::new();
    let (mut left, mut with_points) = (image_lines.iter(), 0);
    while let Some(line) = left.next() {
        if line.words.is_empty() {
            continue;
        }
        let id = line.words.get(8).copied().unwrap_or_default();
        let camera = cameras.get(id).ok_or_else(|| {
            FormatError::expected(line.place(), quoted(id), "the id of a line of cameras.txt")
        })?;
        let [qw, qx, qy, qz, tx, ty, tz] = line.numbers(1)?;
        let rotation = from_quaternion([qw, qx, qy, qz])
            .ok_or_else(|| FormatError::new(line.place(), Problem::NoRotation))?;
        let image = line.words.get(9..).filter(|words| !words.is_empty()).map(|words| words.join(" "));
        let name = image.clone().unwrap_or_else(|| line.words[0].to_owned());
        let stem = stem(&name).to_owned();
        let pose = Some((rotation, [tx, ty, tz]));
        given.push(ImportedCamera {
            id: stem,
            path: name,
            place: line.place(),
            image,
            pose,
            ..camera.clone()
        });
        // Skips the next line, which lists the points of the image.
        with_points += usize::from(left.next().is_some_and(|points| !points.words.is_empty()));
    }
    let mut imported = site_from_cameras(given, input, &file.name)?;
    imported.notes.extend(notes);
    if with_points > 0 {
        let images = calib_site::counted(with_points, "image", "images");
        imported.notes.push(format!("{}: not imported: the points of {images}", file.name));
    }
    let points = files.iter().filter(|file| file.stem() == "points3D");
    imported.notes.extend(points.map(|file| format!("{}: not imported", file.name)));
    if input.unit_m().is_none() && imported.site.cameras.iter().any(|camera| camera.solution.is_some()) {
        imported.notes.push("poses are read as metres with z up; a COLMAP model has arbitrary scale and axes unless it was aligned; use --unit for another unit".into());
    }
    Ok(imported)
}

/// Returns the cameras of a model without images: lenses without poses.
fn only_lenses(
    cameras: HashMap<&str, ImportedCamera>,
    notes: Vec<String>,
    input: &Input,
) -> Result<Imported, FormatError> {
    let lens = |(id, camera): (&str, ImportedCamera)| ImportedCamera { id: id.to_owned(), ..camera };
    let mut lenses: Vec<ImportedCamera> = cameras.into_iter().map(lens).collect();
    lenses.sort_by(|a, b| a.id.cmp(&b.id));
    let mut imported = site_from_cameras(lenses, input, "cameras.txt")?;
    imported.notes.push("images.txt or images.bin is missing: the cameras have lenses but no poses".into());
    imported.notes.extend(notes);
    Ok(imported)
}

fn lens(line: &Line, notes: &mut Vec<String>) -> Result<ImportedCamera, FormatError> {
    let [width, height] = line.numbers(2)?;
    let most = f64::from(calib_site::MAX_SIDE);
    if [width, height].iter().any(|side| side.fract() != 0.0 || !(1.0..=most).contains(side)) {
        let found = format!("{} x {}", digits(width), digits(height));
        return Err(FormatError::expected(line.place(), found, "a size in whole pixels"));
    }
    let brown = |[k1, k2, p1, p2, k3]: [f64; 5]| match [k1, k2, p1, p2, k3] {
        [0.0, 0.0, 0.0, 0.0, 0.0] => Distortion::None,
        _ => Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }),
    };
    let one_focal = || line.numbers(4).map(|[f, cx, cy]| [f, f, cx, cy]);
    let (k, distortion) = match line.words.get(1).copied().unwrap_or_default() {
        "SIMPLE_PINHOLE" => (one_focal()?, Distortion::None),
        "PINHOLE" => (line.numbers(4)?, Distortion::None),
        "SIMPLE_RADIAL" => (one_focal()?, brown([line.number(7)?, 0.0, 0.0, 0.0, 0.0])),
        "RADIAL" => (one_focal()?, brown([line.number(7)?, line.number(8)?, 0.0, 0.0, 0.0])),
        "OPENCV" => {
            let [k1, k2, p1, p2] = line.numbers(8)?;
            (line.numbers(4)?, brown([k1, k2, p1, p2, 0.0]))
        }
        "FULL_OPENCV" => {
            let [k1, k2, p1, p2, k3, k4, k5, k6] = line.numbers(8)?;
            let terms = [k1, k2, p1, p2, k3, k4, k5, k6, 0.0, 0.0, 0.0, 0.0];
            let is_plain = terms.iter().all(|&term| term == 0.0);
            (line.numbers(4)?, if is_plain { Distortion::None } else { distortion_of_terms(terms) })
        }
        "OPENCV_FISHEYE" => (line.numbers(4)?, kannala_brandt(line.numbers(8)?)),
        "SIMPLE_RADIAL_FISHEYE" => (one_focal()?, kannala_brandt([line.number(7)?, 0.0, 0.0, 0.0])),
        "RADIAL_FISHEYE" => (one_focal()?, kannala_brandt([line.number(7)?, line.number(8)?, 0.0, 0.0])),
        "FOV" => field_of_view(line, notes)?,
        "THIN_PRISM_FISHEYE" => {
            let [k1, k2, p1, p2, k3, k4, sx1, sy1] = line.numbers(8)?;
            let prism = Prism { p: [p1, p2], s: [sx1, 0.0, sy1, 0.0] };
            symmetric(line, [k1, k2, k3, k4, 0.0, 0.0], &prism, notes)?
        }
        "RAD_TAN_THIN_PRISM_FISHEYE" => {
            let prism = Prism { p: line.numbers(14)?, s: line.numbers(16)? };
            symmetric(line, line.numbers(8)?, &prism, notes)?
        }
        other => {
            let known = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, \
                         FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, THIN_PRISM_FISHEYE or RAD_TAN_THIN_PRISM_FISHEYE";
            return Err(FormatError::expected(line.place(), quoted(other), known));
        }
    };
    let size = Some([width as u32, height as u32]);
    Ok(ImportedCamera { size, distortion, ..ImportedCamera::new("", line.place(), k) })
}

const fn kannala_brandt(k: [f64; 4]) -> Distortion {
    Distortion::KannalaBrandt { k }
}

/// Distortion terms of a fisheye lens that are not symmetric about its axis.
struct Prism {
    /// Tangential terms p1, p2.
    p: [f64; 2],
    /// Thin-prism terms: coefficients of r^2 and r^4 in x, then in y, where r is the radius divided by the
    /// focal length.
    s: [f64; 4],
}

impl Prism {
    /// Returns an upper bound of the displacement at a radius. Both are divided by the focal length.
    fn max_displacement(&self, radius: f64) -> f64 {
        let (square, [px, py], [x2, x4, y2, y4]) = (radius * radius, self.p, self.s.map(f64::abs));
        let prism = (x2 + x4 * square).hypot(y2 + y4 * square);
        square * (3.0 * px.hypot(py) + prism)
    }
}

/// Returns focal lengths, principal point and distortion of a fisheye lens. Its radius, divided by the focal length,
/// is `theta (1 + k1 theta^2 + ... + k6 theta^12)`. theta is the angle from the axis in radians; k1 to k6 are
/// `terms`. Fails if the terms of `prism` move the rim by more than [`MAX_NEGLIGIBLE_ERROR_PX`].
fn symmetric(
    line: &Line,
    terms: [f64; 6],
    prism: &Prism,
    notes: &mut Vec<String>,
) -> Result<([f64; 4], Distortion), FormatError> {
    let [fx, fy, cx, cy] = line.numbers(4)?;
    let samples = samples(line, |theta| {
        let square = theta * theta;
        theta * (1.0 + square * terms.iter().rev().fold(0.0, |sum, term| sum * square + term))
    })?;
    let focal = 0.5 * (fx + fy);
    let rim = samples.iter().map(|[_, radius]| radius / focal).fold(0.0, f64::max);
    let moved = focal * prism.max_displacement(rim);
    if moved.is_nan() || moved > MAX_NEGLIGIBLE_ERROR_PX {
        let found = format!("tangential and thin-prism terms that move the rim by up to {moved:.2} px");
        let expected = "negligible terms; calibrate the camera as OPENCV_FISHEYE instead";
        return Err(FormatError::expected(line.place(), found, expected));
    }
    let [k1, k2, k3, k4, k5, k6] = terms;
    if [k5, k6] == [0.0; 2] {
        return Ok(([fx, fy, cx, cy], kannala_brandt([k1, k2, k3, k4])));
    }
    nearest(line, &samples, "six radial terms", moved, notes)
}

/// Returns focal lengths, principal point and distortion of the nearest fisheye lens to a lens with
/// COLMAP's model `FOV`: its radius, divided by the focal length, is `atan(2 tan(theta) tan(omega / 2)) / omega`.
/// theta is the angle from the axis, and omega the parameter of the model (F. Devernay and O. Faugeras, "Straight
/// lines have to be straight", 2001). Both are in radians.
fn field_of_view(line: &Line, notes: &mut Vec<String>) -> Result<([f64; 4], Distortion), FormatError> {
    let (k, omega) = (line.numbers(4)?, line.number(8)?.abs());
    if omega < 1e-6 {
        return Ok((k, Distortion::None));
    }
    if omega >= std::f64::consts::PI {
        return Err(FormatError::expected(
            line.place(),
            format!("omega = {}", digits(omega)),
            "less than pi",
        ));
    }
    // The arctangent reaches its limit at 90 degrees from the axis.
    let radius = |theta: f64| (2.0 * theta.min(FRAC_PI_2).tan() * (0.5 * omega).tan()).atan() / omega;
    nearest(line, &samples(line, radius)?, "the model FOV", 0.0, notes)
}

/// Returns pairs of the angle from the axis, in radians, and the radius, in pixels. `radius` returns the
/// radius divided by the focal length. The pairs run from the axis to the corners, and end early if the radius stops
/// growing.
fn samples(line: &Line, radius: impl Fn(f64) -> f64) -> Result<Vec<[f64; 2]>, FormatError> {
    let ([width, height], [fx, fy, cx, cy]) = (line.numbers(2)?, line.numbers::<4>(4)?);
    let corner = cx.max(width - cx).hypot(cy.max(height - cy));
    let mut samples: Vec<[f64; 2]> = Vec::new();
    for theta in (1..=400).map(|ring| MAX_ANGLE * f64::from(ring) / 400.0) {
        let at = 0.5 * (fx + fy) * radius(theta);
        if !(at > samples.last().map_or(0.0, |[_, before]| *before) && at <= corner) {
            break;
        }
        samples.push([theta, at]);
    }
    Ok(samples)
}

/// Returns focal lengths, principal point and distortion of the nearest Kannala-Brandt lens, and adds a note about its
/// error to `notes`. `what` names the original model or its terms; `moved` is an additional error, in pixels.
fn nearest(
    line: &Line,
    samples: &[[f64; 2]],
    what: &str,
    moved: f64,
    notes: &mut Vec<String>,
) -> Result<([f64; 4], Distortion), FormatError> {
    let [fx, fy, cx, cy] = line.numbers(4)?;
    let nearest = fit_lens(samples).filter(|lens| lens.max_error_px.is_finite());
    let off = nearest.map_or(f64::INFINITY, |lens| lens.max_error_px + moved);
    let Some(lens) = nearest.filter(|_| off <= MAX_FIT_ERROR_PX) else {
        return Err(FormatError::expected(line.place(), fit_error_text(what, off), "at most 1 px"));
    };
    let off = round_up(off, 3);
    notes.push(format!(
        "{}: {what}: the nearest Kannala-Brandt lens is used, with an error of at most {off:.3} px",
        line.place()
    ));
    let ratio = lens.focal / (0.5 * (fx + fy));
    Ok(([ratio * fx, ratio * fy, cx, cy], lens.distortion))
}
