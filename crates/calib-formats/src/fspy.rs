//! fSpy's project file: signature, version, sizes, the state as JSON, the image. Also the camera parameters
//! alone, as fSpy exports them in JSON.
//!
//! Poses are camera to world, with camera axes right, up, back. The principal point is relative to the centre
//! of the image, with y up. Its unit is half the longer side of the image.
//!
//! A project without a camera still contains the lines of its vanishing points, which become annotations. Their
//! points are relative to the size of the image, from its upper left corner.

use calib_core::{Annotation, Kind, Pixel};
use calib_site::SiteCamera;
use serde_json::Value;

use crate::file::File;
use crate::file::{FormatError, Problem};
use crate::given::{Imported, ImportedCamera, checked_site, site_with_notes};
use crate::input::Input;
use crate::tree::{Node, Syntax};

/// First bytes of a project file.
const MAGIC: &[u8] = b"fspy";
/// Length of the header before the state, in bytes.
const HEADER_BYTES: usize = 16;

/// State of a project, or exported camera parameters.
struct Project {
    /// File with the JSON text alone.
    state: File,
    tree: Value,
    /// Image inside the project file; empty for exported parameters.
    image: Vec<u8>,
    /// Whether the file is a project, not exported parameters.
    is_project: bool,
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut unsolved, mut notes) = (Vec::new(), Vec::new(), Vec::new());
    for file in files.iter() {
        let project = Project::read(file)?;
        let root = Node::root(&project.state, &project.tree);
        match root.get("cameraParameters") {
            Some(camera) => given.push(solved(&camera, file, files.size())?.with_path(&file.name)),
            None if !project.is_project => {
                given.push(solved(&root, file, files.size())?.with_path(&file.name));
            }
            None => unsolved.push(lines(&root, &project, files.size(), &mut notes)?),
        }
        notes.extend(root.unread_keys());
        notes.extend(project.is_project.then(|| format!("{}: not imported: the image", file.name)));
    }
    if given.is_empty() {
        return checked_site(unsolved, notes, &files[0].name);
    }
    let imported = site_with_notes(given, notes, files, &files[0].name)?;
    let cameras = [imported.site.cameras, unsolved].concat();
    let mut imported = checked_site(cameras, imported.notes, &files[0].name)?;
    if files.unit_m().is_none() {
        imported
            .notes
            .push("fSpy's units and axes are kept; place the camera to convert them to metres".into());
    }
    Ok(imported)
}

/// Reads a camera from the parameters that fSpy calculated.
fn solved(camera: &Node, file: &File, stated: Option<[u32; 2]>) -> Result<ImportedCamera, FormatError> {
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
    let mut given = ImportedCamera::new(file.stem(), camera.place(), [focal, focal, cx, cy]);
    given.size = Some([width, height]);
    given.pose = Some((rotation, t));
    Ok(given)
}

/// Reads the lines of a project without a camera as annotations.
fn lines(
    root: &Node,
    project: &Project,
    stated: Option<[u32; 2]>,
    notes: &mut Vec<String>,
) -> Result<SiteCamera, FormatError> {
    let name = &project.state.name;
    let from_image = || {
        imagesize::blob_size(&project.image)
            .ok()
            .map(|size| [size.width, size.height].map(|side| side as u32))
    };
    let groups = vanishing_points(root);
    if groups.is_empty() {
        return Err(FormatError::new(name, Problem::NoCameraInProject));
    }
    let Some(size) = stated.or_else(from_image) else {
        let expected = "an image in the project; add its size (calib import --size 1920x1080)";
        return Err(FormatError::expected(name, "lines without an image", expected));
    };
    let mut drawn: Vec<(char, Vec<Vec<Pixel>>)> = Vec::new();
    for (axis, group) in &groups {
        drawn.push((*axis, segments(&group.require(&["lineSegments"])?, size)?));
    }
    // In the mode for rectangles, the second direction joins the ends of the lines of the first.
    let quad = root.get("calibrationSettings2VP").and_then(|node| node.get("quadModeEnabled"));
    let is_quad = quad.is_some_and(|node| node.flag() == Ok(true));
    if let (true, [(_, first), (_, second), ..]) = (is_quad, &mut drawn[..])
        && let [a, b] = &first[..]
    {
        *second = a.iter().zip(b).map(|(&a, &b)| vec![a, b]).collect();
    }
    let mut camera = SiteCamera::new(project.state.stem(), size);
    for (axis, segments) in drawn {
        let kind = if axis == 'z' { Kind::Vertical } else { Kind::Parallel };
        let mut annotation = Annotation::from_segments(kind, segments);
        if kind == Kind::Parallel {
            let id = axis.to_string();
            let others = camera.annotations.iter().filter_map(|other| other.id.as_ref());
            // Both vanishing points of a project may have the same axis.
            let is_same = others.clone().any(|other| *other == id);
            annotation.at_right_angles_to = others.clone().next().filter(|_| !is_same).cloned();
            annotation.id = Some(if is_same { format!("{id}-2") } else { id });
        }
        camera.annotations.push(annotation);
    }
    notes.push(format!("{name}: fSpy has calculated no camera; its lines are imported as annotations"));
    Ok(camera)
}

/// Returns the vanishing points that a project uses, each with the letter of its axis.
fn vanishing_points<'a>(root: &Node<'a>) -> Vec<(char, Node<'a>)> {
    let of = |part: &str, key: &str| root.get(part).and_then(|node| node.get(key));
    let text = |part: &str, key: &str| of(part, key).and_then(|node| node.text().ok().map(str::to_owned));
    let base = "calibrationSettingsBase";
    let axis = |key: &str, usual: char| text(base, key).and_then(|axis| axis.chars().next()).unwrap_or(usual);
    let mut groups =
        vec![(axis("firstVanishingPointAxis", 'x'), of("controlPointsStateBase", "firstVanishingPoint"))];
    if text("globalSettings", "calibrationMode").is_none_or(|mode| mode != "OneVanishingPoint") {
        groups.push((
            axis("secondVanishingPointAxis", 'y'),
            of("controlPointsState2VP", "secondVanishingPoint"),
        ));
        if text("calibrationSettings2VP", "principalPointMode")
            .is_some_and(|mode| mode.starts_with("FromThird"))
        {
            let third =
                ['x', 'y', 'z'].into_iter().find(|axis| groups.iter().all(|(other, _)| other != axis));
            groups.push((third.unwrap_or('z'), of("controlPointsState2VP", "thirdVanishingPoint")));
        }
    }
    groups.into_iter().filter_map(|(axis, node)| Some((axis, node?))).collect()
}

/// Reads the segments of a vanishing point, in pixels.
fn segments(node: &Node, size: [u32; 2]) -> Result<Vec<Vec<Pixel>>, FormatError> {
    let [w, h] = size.map(f64::from);
    let point = |node: &Node| {
        Ok(Pixel::new(w * node.require(&["x"])?.number()?, h * node.require(&["y"])?.number()?))
    };
    let segment = |node: &Node| node.items()?.iter().map(point).collect();
    node.items()?.iter().map(segment).collect()
}

impl Project {
    fn read(file: &File) -> Result<Self, FormatError> {
        let is_json = file.bytes.trim_ascii_start().starts_with(b"{");
        let (state, image) = if is_json { (file.clone(), Vec::new()) } else { parts(file)? };
        let tree = Syntax::Json.parse(&state)?;
        Ok(Self { state, tree, image, is_project: !is_json })
    }
}

/// Returns the JSON state inside a project file as a separate file, and the bytes of its image.
fn parts(file: &File) -> Result<(File, Vec<u8>), FormatError> {
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
    let image = file.bytes.get(end..).unwrap_or_default();
    Ok((File { name: file.name.clone(), bytes: state.to_vec() }, image.to_vec()))
}
