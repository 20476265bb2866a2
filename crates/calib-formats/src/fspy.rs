//! fSpy's project file: signature, version, sizes, the state as JSON, the image. Also the camera parameters
//! alone, as fSpy exports them in JSON.
//!
//! Poses are camera to world, with camera axes right, up, back. The principal point is relative to the centre
//! of the image, with y up. Its unit is half the longer side of the image.

use crate::file::File;
use crate::file::{FormatError, Problem};
use crate::given::{Imported, ImportedCamera, site_with_notes};
use crate::input::Input;
use crate::tree::{Node, Syntax};

/// First bytes of a project file.
const MAGIC: &[u8] = b"fspy";
/// Length of the header before the state, in bytes.
const HEADER_BYTES: usize = 16;

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let mut rest = Vec::new();
    let given: Result<Vec<ImportedCamera>, FormatError> =
        files.iter().map(|file| camera(file, files.size(), &mut rest)).collect();
    let mut imported = site_with_notes(given?, rest, files, &files[0].name)?;
    if files.unit_m().is_none() {
        imported
            .notes
            .push("fSpy's units and axes are kept; place the camera to convert them to metres".into());
    }
    Ok(imported)
}

fn camera(
    file: &File,
    stated: Option<[u32; 2]>,
    rest: &mut Vec<String>,
) -> Result<ImportedCamera, FormatError> {
    let is_json = file.bytes.trim_ascii_start().starts_with(b"{");
    let state = if is_json { file.clone() } else { state(file)? };
    let tree = Syntax::Json.parse(&state)?;
    let root = Node::root(&state, &tree);
    let camera = match root.get("cameraParameters") {
        None if is_json => root.clone(),
        None => return Err(FormatError::new(&file.name, Problem::NoCameraInProject)),
        Some(camera) => camera,
    };
    let in_file = [camera.require(&["imageWidth"])?.side()?, camera.require(&["imageHeight"])?.side()?];
    // The other numbers are relative to the size.
    let [width, height] = stated.unwrap_or(in_file);
    let [w, h] = [width, height].map(f64::from);
    let field = camera.require(&["horizontalFieldOfView"])?;
    let angle = field.number()?;
    if !(0.001..3.1).contains(&angle) {
        return Err(field.unexpected("radians between 0.001 and 3.1"));
    }
    let focal = 0.5 * w / (0.5 * angle).tan();
    let centre = camera.require(&["principalPoint"])?;
    let half = 0.5 * w.max(h);
    let cx = 0.5 * w + half * centre.require(&["x"])?.number()?;
    let cy = 0.5 * h - half * centre.require(&["y"])?.number()?;
    let rows = camera.require(&["cameraTransform"])?.require(&["rows"])?;
    let m: [f64; 16] = rows.exactly()?;
    let column = |j: usize, sign: f64| [sign * m[j], sign * m[4 + j], sign * m[8 + j]];
    let rotation = [column(0, 1.0), column(1, -1.0), column(2, -1.0)];
    let position = column(3, 1.0);
    let t = rotation.map(|row| -(row[0] * position[0] + row[1] * position[1] + row[2] * position[2]));
    let mut given =
        ImportedCamera::new(file.stem(), camera.place(), [focal, focal, cx, cy]).with_path(&file.name);
    given.size = Some([width, height]);
    given.pose = Some((rotation, t));
    rest.extend(root.unread_keys());
    rest.extend((!is_json).then(|| format!("{}: not imported: the image", file.name)));
    Ok(given)
}

/// Returns the JSON state inside a project file as a separate file.
fn state(file: &File) -> Result<File, FormatError> {
    let wrong = |problem: Problem| FormatError::new(&file.name, problem);
    let head = file.bytes.get(..HEADER_BYTES).ok_or_else(|| wrong(Problem::NotFspy { is_short: true }))?;
    if !head.starts_with(MAGIC) {
        return Err(wrong(Problem::NotFspy { is_short: false }));
    }
    let number =
        |at: usize| head[at..at + 4].iter().rev().fold(0_usize, |n, &byte| n << 8 | usize::from(byte));
    if number(4) != 1 {
        return Err(FormatError::expected(&file.name, format!("version {}", number(4)), 1));
    }
    let end = HEADER_BYTES.saturating_add(number(8));
    let state = file.bytes.get(HEADER_BYTES..end).ok_or_else(|| wrong(Problem::CutOff))?;
    Ok(File { name: file.name.clone(), bytes: state.to_vec() })
}
