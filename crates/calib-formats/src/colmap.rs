//! COLMAP's text model: `cameras.txt`, `images.txt`, `points3D.txt`.
//!
//! World to camera, quaternions w first; pixels count from the corner, as ours.

use std::collections::HashMap;
use std::fmt::Write as _;

use calib_core::{BrownConrady, Distortion};

use crate::error::{FormatError, Problem, quoted};
use crate::export::{Export, Scene};
use crate::file::File;
use crate::given::{Given, Imported, site_of};
use crate::rotation::{from_quaternion, quaternion};
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
        let (model, more) = model(export.terms(view, scene.lenses));
        let params = [vec![fx, fy, cx, cy], more].concat();
        let [width, height] = view.size;
        let _ = writeln!(cameras, "{number} {model} {width} {height} {}", joined(&params, " "));
        let pose = [&quaternion(&view.camera.rotation())[..], &view.camera.translation()].concat();
        let _ = writeln!(images, "{number} {} {number} {}\n", joined(&pose, " "), name(view));
    }
    export.push("cameras.txt", cameras);
    export.push("images.txt", images);
    export.push("points3D.txt", "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n");
}

/// A name of one line that is the id again; the extension is that of the still.
fn name(view: &View) -> String {
    let extension = view.image.as_deref().and_then(|image| image.rsplit_once('.')).map_or("png", |(_, e)| e);
    let plain = extension.len() < 5 && extension.chars().all(|c| c.is_ascii_alphanumeric());
    format!("{}.{}", view.file, if plain { extension } else { "png" })
}

fn model(terms: Terms) -> (&'static str, Vec<f64>) {
    match terms {
        Terms::None => ("PINHOLE", Vec::new()),
        Terms::Fisheye(k) => ("OPENCV_FISHEYE", k.to_vec()),
        Terms::BrownConrady(b) | Terms::Fitted(b, _) if b.k3 == 0.0 => {
            ("OPENCV", vec![b.k1, b.k2, b.p1, b.p2])
        }
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => {
            ("FULL_OPENCV", vec![b.k1, b.k2, b.p1, b.p2, b.k3, 0.0, 0.0, 0.0])
        }
    }
}

/// A line of a file, its number from 1.
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
            FormatError::expected(self.place(), quoted(text), format!("a number as word {}", word + 1))
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

fn lines<'a>(files: &'a [File], base: &str) -> Result<(&'a File, Vec<Line<'a>>), FormatError> {
    let file = files
        .iter()
        .find(|file| file.base() == base)
        .ok_or_else(|| FormatError::new(base, Problem::NotColmap))?;
    let lines = file.as_text()?.lines().enumerate().map(|(i, text)| Line {
        file,
        number: i + 1,
        // A line of points may be long and is not read.
        words: text.split_whitespace().take(20).collect(),
    });
    let is_said = |line: &Line| !line.words.first().is_some_and(|word| word.starts_with('#'));
    Ok((file, lines.filter(is_said).collect()))
}

pub(crate) fn read(files: &[File]) -> Result<Imported, FormatError> {
    let (_, camera_lines) = lines(files, "cameras.txt")?;
    let mut cameras = HashMap::new();
    for line in camera_lines.iter().filter(|line| !line.words.is_empty()) {
        cameras.insert(line.words[0], lens(line)?);
    }
    let (file, image_lines) = lines(files, "images.txt")?;
    let mut given: Vec<Given> = Vec::new();
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
        let base = name.rsplit('/').next().unwrap_or_default();
        let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem).to_owned();
        let pose = Some((rotation, [tx, ty, tz]));
        given.push(Given { id: stem, place: line.place(), image, pose, ..camera.clone() });
        // The line of points that goes with it.
        with_points += usize::from(left.next().is_some_and(|points| !points.words.is_empty()));
    }
    let mut imported = site_of(given, &file.name)?;
    if with_points > 0 {
        let images = calib_core::counted(with_points, "image", "images");
        imported.notes.push(format!("{}: not taken: the points of {images}", file.name));
    }
    let points = files.iter().filter(|file| file.base() == "points3D.txt");
    imported.notes.extend(points.map(|file| format!("{}: not taken", file.name)));
    if imported.site.cameras.iter().any(|camera| camera.solution.is_some()) {
        imported.notes.push("poses are taken as metres with z up: a COLMAP model has a scale and axes of its own unless it was aligned".into());
    }
    Ok(imported)
}

fn lens(line: &Line) -> Result<Given, FormatError> {
    let [width, height] = line.numbers(2)?;
    let most = f64::from(calib_core::MAX_SIDE);
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
            if [k4, k5, k6] != [0.0; 3] {
                return Err(FormatError::expected(
                    line.place(),
                    "k4, k5, k6",
                    "zeros: they have no place here",
                ));
            }
            (line.numbers(4)?, brown([k1, k2, p1, p2, k3]))
        }
        "OPENCV_FISHEYE" => (line.numbers(4)?, Distortion::KannalaBrandt { k: line.numbers(8)? }),
        other => {
            let known =
                "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV or OPENCV_FISHEYE";
            return Err(FormatError::expected(line.place(), quoted(other), known));
        }
    };
    let size = Some([width as u32, height as u32]);
    Ok(Given { size, distortion, ..Given::new("", line.place(), k) })
}
