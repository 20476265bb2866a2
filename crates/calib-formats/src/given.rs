//! Camera as read from a file, and its checked conversion to an entry of a site.

use calib_core::camera::angles_from_rotation;
use calib_core::single::Known;
use calib_core::{Camera, Covariance, Distortion, Lens, Pixel, WorldPoint};
use calib_site::{
    ControlPointEntry, DistortionEntry, LensEntry, Method, PixelAspectEntry, PrincipalPointEntry, Site,
    SiteCamera, Solution, Stage,
};

use crate::export::round_up;
use crate::file::{FormatError, Problem, quoted};
use crate::fisheye::{Rotation, is_rotation, rotate, transpose};
use crate::ids::{Named, distinct};
use crate::input::Input;

/// Result of an import.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Site with the imported cameras, points or plan. A camera whose file contains a pose has a solution.
    pub site: Site,
    /// Notes for the operator: values that were changed or ignored.
    pub notes: Vec<String>,
}

/// Pose, world to camera: rotation, and translation in metres.
pub(crate) type Pose = (Rotation, [f64; 3]);

/// Camera as read from a file.
#[derive(Clone, Debug)]
pub(crate) struct ImportedCamera {
    pub(crate) id: String,
    /// Position of the camera in the file, for messages.
    pub(crate) place: String,
    /// Path that makes the id distinct if other cameras have the same id. Empty if unknown.
    pub(crate) path: String,
    pub(crate) image: Option<String>,
    /// Width and height of the image, in pixels; absent: twice the principal point.
    pub(crate) size: Option<[u32; 2]>,
    /// Focal length in x and y, in pixels.
    pub(crate) focal: [f64; 2],
    /// Principal point, in pixels from the corner of the image.
    pub(crate) centre: [f64; 2],
    /// Skew of the intrinsic matrix, which is dropped.
    pub(crate) skew: f64,
    pub(crate) distortion: Distortion,
    /// Pose, world to camera (right, down, forward), in metres.
    pub(crate) pose: Option<Pose>,
}

/// Elements of an intrinsic matrix, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Intrinsics {
    /// Focal lengths and principal point: fx, fy, cx, cy.
    pub(crate) k: [f64; 4],
    pub(crate) skew: f64,
}

impl Intrinsics {
    /// Converts the principal point: from the centre of the first pixel to the corner of the image as origin.
    pub(crate) fn with_corner_origin(self) -> Self {
        let [fx, fy, cx, cy] = self.k;
        Self { k: [fx, fy, cx + 0.5, cy + 0.5], ..self }
    }
}

impl From<[f64; 4]> for Intrinsics {
    fn from(k: [f64; 4]) -> Self {
        Self { k, skew: 0.0 }
    }
}

impl ImportedCamera {
    /// Creates a camera without distortion and pose. `place` is its position in the file; `k` is
    /// `[fx, fy, cx, cy]`, in pixels, or the elements of an intrinsic matrix.
    pub(crate) fn new(id: &str, place: impl Into<String>, k: impl Into<Intrinsics>) -> Self {
        let Intrinsics { k: [fx, fy, cx, cy], skew } = k.into();
        Self {
            id: id.to_owned(),
            place: place.into(),
            path: String::new(),
            image: None,
            size: None,
            focal: [fx, fy],
            centre: [cx, cy],
            skew,
            distortion: Distortion::None,
            pose: None,
        }
    }

    /// Returns the camera with a path that makes its id distinct.
    pub(crate) fn with_path(self, path: &str) -> Self {
        Self { path: path.to_owned(), ..self }
    }

    /// Returns the camera with the image size that the caller stated, and its pose in metres of a right-handed world.
    pub(crate) fn stated_by(self, input: &Input) -> Self {
        Self { size: input.size().or(self.size), pose: self.pose.map(|pose| input.pose(pose)), ..self }
    }

    /// Creates an error at the camera's position in the file.
    fn wrong(&self, problem: Problem) -> FormatError {
        FormatError::new(self.place.trim_end_matches([' ', ':']), problem)
    }

    /// Returns the focal length in x and the pixel aspect. Fails for values that no camera has.
    fn focal_and_aspect(&self, notes: &mut Vec<String>) -> Result<[f64; 2], FormatError> {
        /// Difference of the pixel aspect from 1: below this range, pixels count as square; above it, a note reports
        /// the aspect.
        const SQUARE: std::ops::RangeInclusive<f64> = 1e-9..=0.02;
        let [fx, fy] = self.focal;
        let aspect = fy / fx;
        if !(fx > 1e-6 && fx < 1e9 && (0.1..=10.0).contains(&aspect)) {
            return Err(self.wrong(Problem::NoFocal([fx, fy])));
        }
        let off = (aspect - 1.0).abs();
        if off > *SQUARE.end() {
            let id = quoted(&self.id);
            notes.push(format!(
                "camera {id}: focal lengths {fx} in x and {fy} in y mean a pixel aspect of {aspect:.4}; if the pixels \
                 of this camera are square, the calibration is poor"
            ));
        }
        Ok([fx, if off < *SQUARE.start() { 1.0 } else { aspect }])
    }

    fn size(&self, notes: &mut Vec<String>) -> Result<[u32; 2], FormatError> {
        if let Some(size) = self.size {
            return Ok(size);
        }
        let most = f64::from(calib_site::MAX_SIDE);
        let size = self.centre.map(|c| (2.0 * c).round());
        if !size.iter().all(|&side| (1.0..=most).contains(&side)) {
            return Err(self.wrong(Problem::NoSize));
        }
        let [w, h] = size.map(|side| side as u32);
        let id = quoted(&self.id);
        notes.push(format!(
            "camera {id}: the file has no image size; {w} x {h} is assumed from the principal point (to set another \
             size: calib import --size)"
        ));
        Ok([w, h])
    }

    /// Reports the skew that is dropped. A skew s moves a pixel in x by s / fy times the distance of the pixel from the
    /// principal point in y.
    fn report_skew(&self, [_, height]: [u32; 2], notes: &mut Vec<String>) {
        /// Largest error that is not reported, in pixels.
        const NEGLIGIBLE_PX: f64 = 1e-4;
        let [_, cy] = self.centre;
        let error = (self.skew / self.focal[1]).abs() * cy.abs().max((f64::from(height) - cy).abs());
        if error > NEGLIGIBLE_PX {
            let (id, skew, error) = (quoted(&self.id), self.skew, round_up(error, 3));
            notes.push(format!(
                "camera {id}: the skew {skew} of its matrix is not imported, with an error of at most {error:.3} px before \
                 distortion"
            ));
        }
    }

    /// Fails if the camera matrix belongs to an image of another resolution than `size`.
    fn check_resolution(&self, size: [u32; 2]) -> Result<(), FormatError> {
        /// Ratio of twice the principal point to the image size above which they belong to two resolutions. Real
        /// principal points are nearer to the centre of the image.
        const MIN_RATIO: f64 = 1.3;
        let suggested = self.centre.map(|c| 2.0 * c);
        let ratios = [0, 1].map(|k| suggested[k] / f64::from(size[k]));
        let is_larger = ratios.iter().all(|&ratio| ratio > MIN_RATIO);
        let is_smaller = ratios.iter().all(|&ratio| ratio > 0.0 && ratio < MIN_RATIO.recip());
        if is_larger || is_smaller {
            return Err(self.wrong(Problem::TwoResolutions { stated: size, suggested }));
        }
        Ok(())
    }

    /// Converts the camera to an entry of a site.
    pub(crate) fn into_entry(self, notes: &mut Vec<String>) -> Result<SiteCamera, FormatError> {
        let ([focal, pixel_aspect], size) = (self.focal_and_aspect(notes)?, self.size(notes)?);
        self.check_resolution(size)?;
        self.report_skew(size, notes);
        let principal_point = Pixel::from(self.centre);
        let lens =
            Lens { principal_point, focal, pixel_aspect, distortion: self.distortion, image_circle: None };
        let mut entry = SiteCamera { image: self.image.clone(), ..SiteCamera::new(self.id.clone(), size) };
        entry.lens = Some(LensEntry {
            focal_px: Some(Known::fixed(focal)),
            pixel_aspect: (pixel_aspect != 1.0).then_some(PixelAspectEntry::Known(pixel_aspect)),
            principal_point_px: Some(PrincipalPointEntry::known(principal_point)),
            distortion: DistortionEntry::from_lens(&lens, focal),
            ..LensEntry::default()
        });
        let Some((rotation, t)) = self.pose else { return Ok(entry) };
        if !is_rotation(&rotation) {
            return Err(self.wrong(Problem::InvalidRotation));
        }
        let centre = rotate(&transpose(&rotation), t).map(|c| -c);
        let (roll, pitch, yaw) = angles_from_rotation(&rotation);
        let position = WorldPoint::from(centre);
        let camera = Camera { position, yaw, pitch, roll, focal, lens, covariance: Covariance::EXACT };
        entry.solution = Some(Solution::from_camera(&camera, Method::Given, Stage::Placed));
        Ok(entry)
    }
}

/// Returns a control point: a pixel that shows a known world point.
pub(crate) fn control_point(px: Pixel, world: WorldPoint) -> ControlPointEntry {
    ControlPointEntry { world_m: Some(world), ..ControlPointEntry::new(px) }
}

/// Creates a site with these camera entries and checks it. `place` is the name of the file in error messages.
pub(crate) fn checked_site(
    cameras: Vec<SiteCamera>,
    notes: Vec<String>,
    place: &str,
) -> Result<Imported, FormatError> {
    if cameras.is_empty() {
        return Err(FormatError::new(place, Problem::NoCamera));
    }
    let site = Site { cameras, ..Site::new() };
    site.check().map_err(|error| FormatError::new(place, Problem::InvalidSite(Box::new(error))))?;
    Ok(Imported { site, notes })
}

/// Creates a site with these imported cameras and checks it. `rest` describes the parts of the files that
/// were not read, and is added to the notes.
pub(crate) fn site_with_notes(
    given: Vec<ImportedCamera>,
    rest: Vec<String>,
    input: &Input,
    place: &str,
) -> Result<Imported, FormatError> {
    let mut imported = site_from_cameras(given, input, place)?;
    imported.notes.extend(rest);
    Ok(imported)
}

/// Creates a site with these imported cameras and checks it.
pub(crate) fn site_from_cameras(
    mut given: Vec<ImportedCamera>,
    input: &Input,
    place: &str,
) -> Result<Imported, FormatError> {
    if given.len() > calib_site::MAX_CAMERAS {
        let found = format!("{} cameras", given.len());
        return Err(FormatError::expected(place, found, format!("at most {}", calib_site::MAX_CAMERAS)));
    }
    let named: Vec<Named> = given.iter().map(|camera| Named { id: &camera.id, path: &camera.path }).collect();
    if let Some(ids) = distinct(&named) {
        given.iter_mut().zip(ids).for_each(|(camera, id)| camera.id = id);
    }
    let mut notes = Vec::new();
    let cameras: Result<Vec<SiteCamera>, FormatError> =
        given.into_iter().map(|camera| camera.stated_by(input).into_entry(&mut notes)).collect();
    checked_site(cameras?, notes, place)
}

/// Returns the elements of an intrinsic matrix `K`. Fails if the matrix has another form, or if its skew is not small.
pub(crate) fn intrinsics_from_matrix(k: &[[f64; 3]; 3], place: &str) -> Result<Intrinsics, FormatError> {
    let [[fx, skew, cx], [zero, fy, cy], last] = *k;
    let is_upright = zero.abs() < 1e-9 && last[0].abs() < 1e-9 && last[1].abs() < 1e-9;
    let place = place.trim_end_matches([' ', ':']);
    if !is_upright || (last[2] - 1.0).abs() > 1e-9 {
        return Err(FormatError::new(place, Problem::InvalidIntrinsics));
    }
    if skew.abs() > 1e-3 * fx.abs() {
        return Err(FormatError::expected(place, format!("a skew of {skew}"), "a skew near 0"));
    }
    Ok(Intrinsics { k: [fx, fy, cx, cy], skew })
}

/// Decomposes a projection matrix `K [R | t]` of either sign into the elements of `K` and the pose. `K` is the
/// intrinsic matrix. The rows of `K R` are orthogonalised from the last to the first.
pub(crate) fn decompose_projection(
    p: &[[f64; 4]; 3],
    place: &str,
) -> Result<(Intrinsics, Pose), FormatError> {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let less = |a: [f64; 3], s: f64, b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| a[i] - s * b[i]) };
    let [a, b, c] = p.map(|row| [row[0], row[1], row[2]]);
    let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
    let length = dot(c, c).sqrt().copysign(dot(a, cross));
    let unit = |v: [f64; 3], s: f64| v.map(|x| x / s);
    let (a, b, r3) = (unit(a, length), unit(b, length), unit(c, length));
    let (cx, cy) = (dot(a, r3), dot(b, r3));
    let b = less(b, cy, r3);
    let fy = dot(b, b).sqrt();
    let r2 = unit(b, fy);
    let skew = dot(a, r2);
    let a = less(less(a, cx, r3), skew, r2);
    let fx = dot(a, a).sqrt();
    let r1 = unit(a, fx);
    let k = intrinsics_from_matrix(&[[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], place)?;
    let [u, v, w] = p.map(|row| row[3] / length);
    let y = (v - cy * w) / fy;
    let t = [(u - cx * w - skew * y) / fx, y, w];
    if ![fx, fy, cx, cy].iter().chain(&t).all(|value| value.is_finite()) {
        return Err(FormatError::new(place.trim_end_matches([' ', ':']), Problem::InvalidProjection));
    }
    Ok((k, ([r1, r2, r3], t)))
}

/// Adds a note for every camera with an unlikely pose.
pub(crate) fn note_unlikely_poses(imported: &mut Imported) {
    let cameras = imported.site.cameras.iter();
    let doubts = cameras.filter_map(|entry| unlikely_pose(&entry.id, &entry.camera()?));
    imported.notes.extend(doubts);
}

/// Describes an unlikely pose of an imported camera: close to the floor, far above it, below it, or upside down.
fn unlikely_pose(id: &str, camera: &Camera) -> Option<String> {
    /// Heights of a camera that are likely, in metres.
    const LIKELY_HEIGHTS_M: std::ops::RangeInclusive<f64> = 0.3..=60.0;
    let (height, id) = (camera.position.z, quoted(id));
    if camera.roll.cos() < 0.0 || height < 0.0 {
        return Some(format!(
            "camera {id} is upside down or below the floor: the world of the file may be left-handed, as in \
             MultiviewX; use --left-handed to mirror it"
        ));
    }
    let other = if height < *LIKELY_HEIGHTS_M.start() { "m" } else { "cm" };
    (!LIKELY_HEIGHTS_M.contains(&height)).then(|| {
        let height =
            if other == "m" { format!("{:.1} cm", 100.0 * height) } else { format!("{height:.0} m") };
        format!("camera {id} is {height} above the floor: if the file is in {other}, add --unit {other}")
    })
}
