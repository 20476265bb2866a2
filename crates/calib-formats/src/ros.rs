//! ROS `camera_info`: the lens, with one file for each camera. The pose belongs in TF and is not written.
//! The import also reads messages as ROS 1 and 2 print them, with one or more in a file, and `ost.txt` of the camera
//! calibrator.
//!
//! Pixels count from the centre of the first pixel, as in OpenCV.

use crate::export::{Export, Scene};
use crate::file::{File, FormatError, Problem, quoted};
use crate::given::{Imported, ImportedCamera, intrinsics_from_matrix, site_with_notes};
use crate::input::Input;
use crate::lens_keys::{distortion, is_fisheye, refuse_unknown_distortion};
use crate::opencv::written_terms;
use crate::tree::{Node, Syntax, joined, quote};
use crate::view::{Terms, View};

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    for view in &scene.views {
        let terms = export.terms(view, scene.lenses);
        export.push(format!("{}.{}", view.file, scene.extension), camera_info(view, terms));
    }
}

fn camera_info(view: &View, terms: Terms) -> String {
    let k = view.intrinsics(view.centre_from_pixel_centre());
    let (model, terms) = match terms {
        Terms::Fisheye(k) => ("equidistant", k.to_vec()),
        Terms::Rational(terms) => ("rational_polynomial", written_terms(&terms)),
        Terms::None => ("plumb_bob", vec![0.0; 5]),
        Terms::BrownConrady(b) | Terms::Fitted(b, _) => ("plumb_bob", vec![b.k1, b.k2, b.p1, b.p2, b.k3]),
    };
    let p = k.map(|[a, b, c]| [a, b, c, 0.0]).concat();
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let matrix = |key: &str, rows: usize, data: &[f64]| {
        let cols = data.len() / rows;
        format!("{key}:\n  rows: {rows}\n  cols: {cols}\n  data: [{}]\n", joined(data, ", "))
    };
    let [width, height] = view.size;
    [
        format!("image_width: {width}\nimage_height: {height}\ncamera_name: {}\n", quote(&view.id)),
        matrix("camera_matrix", 3, &k.concat()),
        format!("distortion_model: {model}\n"),
        matrix("distortion_coefficients", 1, &terms),
        matrix("rectification_matrix", 3, &unit),
        matrix("projection_matrix", 3, &p),
    ]
    .concat()
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut rest) = (Vec::new(), Vec::new());
    for file in files.iter() {
        if let Some(ost) = Ost::new(file)? {
            given.push(ost.camera()?);
            continue;
        }
        let mut messages: Vec<ImportedCamera> = Vec::new();
        let mut repetitions = 0;
        for tree in Syntax::detect(file)?.parse_all(file)? {
            let root = Node::root(file, &tree);
            let camera = camera(file, &root)?;
            rest.extend(root.unread_keys().filter(|note| !rest.contains(note)));
            match messages.iter().find(|earlier| earlier.id == camera.id) {
                Some(earlier) if is_repetition(earlier, &camera) => repetitions += 1,
                Some(_) => return Err(contradiction(file, &camera.id)),
                None => messages.push(camera),
            }
            if messages.len() > calib_site::MAX_CAMERAS {
                break;
            }
        }
        if repetitions > 0 {
            let count = calib_site::counted(repetitions, "repeated message", "repeated messages");
            rest.push(format!("{}: not imported: {count}", file.name));
        }
        given.extend(messages);
    }
    site_with_notes(given, rest, files, &files[0].name)
}

/// Reads the lens of a camera from a message or from a calibration file.
fn camera(file: &File, root: &Node) -> Result<ImportedCamera, FormatError> {
    let k = root.require(&["camera_matrix", "K", "k"])?;
    let intrinsics = intrinsics_from_matrix(&k.matrix()?, k.place())?.with_corner_origin();
    let frame = || root.get("header").and_then(|header| header.get("frame_id"));
    let name = root.get("camera_name").or_else(frame).and_then(|node| node.text().ok());
    let id = name.filter(|name| !name.is_empty()).unwrap_or(file.stem());
    let mut camera = ImportedCamera::new(id, k.place(), intrinsics).with_path(&file.name);
    let side = |keys: [&str; 2]| root.require(&keys)?.side();
    camera.size = Some([side(["image_width", "width"])?, side(["image_height", "height"])?]);
    refuse_unknown_distortion(root, &["distortion_coefficients", "distortion_model"])?;
    if let Some(terms) = root.first_of(&["distortion_coefficients", "D", "d"]) {
        let model = root.get("distortion_model").map(|node| node.text()).transpose()?.unwrap_or_default();
        camera.distortion = distortion(&terms, is_fisheye(model))?;
    }
    Ok(camera)
}

/// Whether two messages contain the same lens.
fn is_repetition(a: &ImportedCamera, b: &ImportedCamera) -> bool {
    let lens = |c: &ImportedCamera| (c.size, c.focal, c.centre, c.skew, c.distortion);
    lens(a) == lens(b)
}

fn contradiction(file: &File, id: &str) -> FormatError {
    let found = format!("two different messages of camera {}", quoted(id));
    FormatError::expected(&file.name, found, "one calibration for each frame_id; keep the right message")
}

/// Lens in the INI form of the camera calibrator, `ost.txt`: the numbers below every heading.
struct Ost<'a> {
    file: &'a File,
    /// Heading in brackets before the camera matrix: the name of the camera.
    name: &'a str,
    /// Headings with their numbers.
    values: Vec<(&'a str, Vec<f64>)>,
}

impl<'a> Ost<'a> {
    /// Reads the headings and numbers; `None` for a file of another form.
    fn new(file: &'a File) -> Result<Option<Self>, FormatError> {
        let text = file.as_text()?;
        if !text.lines().any(|line| line.trim() == "[image]") {
            return Ok(None);
        }
        let (mut name, mut values): (&str, Vec<(&str, Vec<f64>)>) = (file.stem(), Vec::new());
        let lines = text.lines().map(str::trim);
        for line in lines.filter(|line| !line.is_empty() && !line.starts_with('#')) {
            let numbers: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
            match (numbers, values.last_mut()) {
                (Ok(numbers), Some((_, last))) => last.extend(numbers),
                _ if line.starts_with('[') => {
                    let section = line.trim_matches(['[', ']']);
                    name = if section == "image" { name } else { section };
                }
                _ => values.push((line, Vec::new())),
            }
        }
        Ok(Some(Self { file, name, values }))
    }

    /// Returns the numbers below a heading.
    fn numbers(&self, heading: &str) -> Result<&[f64], FormatError> {
        let found = self.values.iter().find(|(name, _)| *name == heading);
        let missing = || FormatError::new(&self.file.name, Problem::MissingKey(vec![heading.to_owned()]));
        found.map(|(_, numbers)| &numbers[..]).ok_or_else(missing)
    }

    fn camera(&self) -> Result<ImportedCamera, FormatError> {
        let place = |heading: &str| format!("{}: {heading}", self.file.name);
        let expected = |heading: &str, found: &[f64], expected: &str| {
            let found = calib_site::counted(found.len(), "number", "numbers");
            FormatError::expected(place(heading), found, expected)
        };
        let side = |heading: &str| match self.numbers(heading)? {
            [side] if side.fract() == 0.0 && (1.0..=f64::from(calib_site::MAX_SIDE)).contains(side) => {
                Ok(*side as u32)
            }
            found => Err(expected(heading, found, "a whole number of pixels")),
        };
        let heading = "camera matrix";
        let matrix = match *self.numbers(heading)? {
            [a, b, c, d, e, f, g, h, i] => [[a, b, c], [d, e, f], [g, h, i]],
            ref found => return Err(expected(heading, found, "9")),
        };
        let intrinsics = intrinsics_from_matrix(&matrix, &place(heading))?.with_corner_origin();
        let mut camera =
            ImportedCamera::new(self.name, place(heading), intrinsics).with_path(&self.file.name);
        camera.size = Some([side("width")?, side("height")?]);
        let terms = serde_json::json!(self.numbers("distortion")?);
        camera.distortion = distortion(&Node::root(self.file, &terms), false)?;
        Ok(camera)
    }
}
