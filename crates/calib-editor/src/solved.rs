//! Results of the site. They are recomputed when their inputs change, and never edited.

use std::sync::Arc;

use calib_core::{
    Camera, Code, Failure, FailureCode, Finding, FloorPoint, MarkKind, Pixel, Placement, Plane, Residual,
    ResidualOf, Surface,
};

use calib_site::{
    ElementSolution, FailureEntry, Georeference, LensCache, Mark, MarkObservation, Names, Plan, PlaneEntry,
    Report, Scale, SceneEntry, Site, SiteCamera, Solution, Stage, Warning,
};
use web_time::Instant;

use crate::joint::{Joint, has_same_inputs, has_same_planes, without_results};

/// Inputs of the results of cameras that share a lens, and the lenses that were fitted to these cameras.
#[derive(Clone, Debug)]
struct LensFamily {
    cameras: Vec<SiteCamera>,
    plan: Option<Plan>,
    scene: Option<SceneEntry>,
    planes: Vec<PlaneEntry>,
    /// Grid and known georeference of the site.
    map: (Option<String>, Option<Georeference>),
    /// Marks whose points may determine one of the cameras.
    marks: Vec<Mark>,
    /// For each camera: whether the site has coordinates independent of it, from a plan, a georeference, a fixed mark
    /// or another camera.
    measured: Vec<bool>,
    lenses: LensCache,
}

impl LensFamily {
    fn new(site: &Site, family: &[usize]) -> Self {
        let cameras = family.iter().map(|&index| without_results(&site.cameras[index])).collect();
        let (plan, planes) = (site.plan.clone(), site.planes.clone());
        let measured = measured(site, family).collect();
        let marks = marks(site, family).cloned().collect();
        let map = site.map_inputs();
        Self { cameras, plan, map, scene: site.scene, planes, marks, measured, lenses: LensCache::default() }
    }

    /// Whether the inputs are unchanged in `site` for the cameras with these indices.
    fn is_current(&self, site: &Site, family: &[usize]) -> bool {
        self.cameras.len() == family.len()
            && self
                .cameras
                .iter()
                .zip(family)
                .all(|(known, &index)| has_same_inputs(known, &site.cameras[index]))
            && self.plan == site.plan
            && self.map == site.map_inputs()
            && self.scene == site.scene
            && has_same_planes(&self.planes, &site.planes)
            && self.marks.iter().map(shape_inputs).eq(marks(site, family).map(shape_inputs))
            && self.measured.iter().copied().eq(measured(site, family))
    }
}

/// Returns the marks with annotated points in these cameras.
fn marks<'a>(site: &'a Site, family: &'a [usize]) -> impl Iterator<Item = &'a Mark> {
    let is_own = |id: &String| family.iter().any(|&index| site.cameras[index].id == *id);
    site.marks.iter().filter(move |mark| !mark.off && mark.seen.iter().any(|seen| is_own(&seen.camera)))
}

/// Returns the inputs of a mark that affect the separate solution of a camera: kind, height of the foot in metres,
/// dimensions in metres, and observations. The position on the floor has no effect.
fn shape_inputs(mark: &Mark) -> (MarkKind, f64, &[f64], &[MarkObservation]) {
    (mark.kind, mark.at_m.z, &mark.size_m, &mark.seen)
}

/// Returns, for each camera of `family`, whether the site has coordinates that do not depend on it: a
/// plan, a georeference, a fixed mark, or another camera with a position.
fn measured<'a>(site: &'a Site, family: &'a [usize]) -> impl Iterator<Item = bool> + 'a {
    family.iter().map(|&index| site.has_reference_coordinates(&site.cameras[index]))
}

/// Result of one camera in a report, with the index of the camera.
type CameraResult = (usize, Result<Solution, FailureEntry>);

/// Result of one camera, with the inputs from which it was computed.
#[derive(Clone, Debug)]
struct Entry {
    id: String,
    /// Start of the calibration period: an id may occur in several periods.
    from: Option<String>,
    family: Arc<LensFamily>,
    result: Result<Solution, FailureEntry>,
    findings: Vec<Finding>,
    pose: Option<Camera>,
}

impl Entry {
    /// Whether the result belongs to this camera entry: same id and same start of the calibration period.
    fn is_of(&self, camera: &SiteCamera) -> bool {
        self.id == camera.id && self.from == camera.valid_from
    }
}

/// Results of all cameras, in the order of the site.
#[derive(Clone, Debug, Default)]
pub struct Solved {
    entries: Vec<Entry>,
    /// Joint results, each with its serial number.
    joint: Vec<(u64, Joint)>,
    /// Serial number of the joint result on which the site is based, even if edits have made the result out of date.
    /// `None` without a joint result.
    lineage: Option<u64>,
    /// Joint result that applies to the site, even if it is out of date.
    active_joint: Option<ActiveJoint>,
    /// Duration of the last solve, in milliseconds.
    pub milliseconds: f64,
    /// Whether solving is paused.
    pub paused: bool,
}

/// Largest number of joint results that are stored for undo.
const MAX_JOINT_RESULTS: usize = 64;

/// Reference to a stored joint result that applies to a site.
#[derive(Clone, Debug, PartialEq, Eq)]
struct ActiveJoint {
    /// Index of the joint result in `Solved::joint`.
    joint: usize,
    /// Index of every camera of the site in the joint result; `None` if the camera is not in it or its inputs
    /// have changed since.
    camera_indices: Vec<Option<usize>>,
    /// Whether no input of the result has changed.
    is_current: bool,
}

impl Solved {
    /// Solves the cameras whose inputs changed. Returns whether any camera was solved.
    pub fn update(&mut self, site: &Site) -> bool {
        self.active_joint = self.find_joint(site);
        if self.paused {
            self.realign(site);
            return false;
        }
        let start = Instant::now();
        let families = site.lens_families();
        let is_known = |family: &Vec<usize>| {
            family
                .iter()
                .all(|&index| self.entries.get(index).is_some_and(|e| e.family.is_current(site, family)))
        };
        let open: Vec<&Vec<usize>> = families.iter().filter(|family| !is_known(family)).collect();
        if open.is_empty() && self.entries.len() == site.cameras.len() {
            return false;
        }
        let mut solved: Vec<(usize, Entry)> =
            open.into_iter().flat_map(|family| self.solve(site, family)).collect();
        self.entries.truncate(site.cameras.len());
        // The results are sorted by index, so that appending new entries keeps the order of the site.
        solved.sort_by_key(|(index, _)| *index);
        for (index, entry) in solved {
            match self.entries.get_mut(index) {
                Some(known) => *known = entry,
                None => self.entries.push(entry),
            }
        }
        self.milliseconds = start.elapsed().as_secs_f64() * 1e3;
        true
    }

    /// Assigns the results to their cameras again when cameras are added or removed while solving is paused.
    fn realign(&mut self, site: &Site) {
        let is_aligned = self.entries.len() == site.cameras.len()
            && self.entries.iter().zip(&site.cameras).all(|(entry, camera)| entry.is_of(camera));
        if is_aligned {
            return;
        }
        // Inputs without cameras never match a camera, so the new entries are solved when solving is resumed.
        let nothing = Arc::new(LensFamily::new(site, &[]));
        let waits = |camera: &SiteCamera| Entry {
            id: camera.id.clone(),
            from: camera.valid_from.clone(),
            family: Arc::clone(&nothing),
            result: Err(FailureEntry {
                code: FailureCode::NoSolution,
                message: "Solving is paused.".into(),
                advice: "Resume solving to calibrate this camera.".into(),
            }),
            findings: Vec::new(),
            pose: None,
        };
        let known = |camera: &SiteCamera| self.entries.iter().find(|entry| entry.is_of(camera));
        self.entries = site
            .cameras
            .iter()
            .map(|camera| known(camera).cloned().unwrap_or_else(|| waits(camera)))
            .collect();
    }

    /// Returns the results of cameras that share a lens, each with the index of the camera. Known results are
    /// reused.
    fn solve(&self, site: &Site, family: &[usize]) -> Vec<(usize, Entry)> {
        let known = |index: &usize| {
            let same =
                |entry: &&Entry| entry.is_of(&site.cameras[*index]) && entry.family.is_current(site, family);
            self.entries.iter().find(same).map(|entry| (*index, entry.clone()))
        };
        // Cameras that were moved in the list or restored by undo already have results.
        if let Some(known) = family.iter().map(known).collect() {
            return known;
        }
        let same = |entry: &&Entry| family.iter().any(|&index| site.cameras[index].id == entry.id);
        let before = self.entries.iter().find(same).map(|entry| entry.family.lenses.clone());
        let input = LensFamily::new(site, family);
        let (report, lenses) = site.calibrate_family(family, &before.unwrap_or_default());
        let shared = Arc::new(LensFamily { lenses, ..input });
        let entry =
            |(&index, ((_, result), found)): (&usize, (CameraResult, Result<Vec<Finding>, Failure>))| {
                let findings = found.unwrap_or_default();
                let pose = result.as_ref().ok().and_then(Solution::camera);
                let SiteCamera { id, valid_from: from, .. } = site.cameras[index].clone();
                let family = Arc::clone(&shared);
                (index, Entry { id, from, family, result, findings, pose })
            };
        family.iter().zip(report.cameras.into_iter().zip(report.findings)).map(entry).collect()
    }

    /// Returns the joint result that is current for a site. Otherwise returns the joint result from which the
    /// site is derived, if it still applies to any camera.
    fn find_joint(&self, site: &Site) -> Option<ActiveJoint> {
        let newest = || self.joint.iter().enumerate().rev();
        let current =
            newest().find(|(_, (_, joint))| joint.is_current_for(site)).map(|(index, _)| (index, true));
        // A site that undo restored to its state before the joint solve is not derived from this result.
        let is_own = |number: u64, joint: &Joint| self.lineage == Some(number) && joint.applies_to_any(site);
        let last =
            || newest().find(|(_, (number, joint))| is_own(*number, joint)).map(|(index, _)| (index, false));
        let (joint, is_current) = current.or_else(last)?;
        Some(ActiveJoint { joint, camera_indices: self.joint[joint].1.camera_indices(site), is_current })
    }

    /// Stores the results of a joint solve, and marks them as those on which the site is based.
    pub(crate) fn add_joint(&mut self, joint: Joint) {
        if self.joint.len() >= MAX_JOINT_RESULTS {
            self.joint.remove(0);
        }
        let number = self.joint.last().map_or(0, |(last, _)| last + 1);
        self.joint.push((number, joint));
        self.lineage = Some(number);
    }

    /// Returns the serial number of the joint result that applies to the site, current or out of date.
    pub(crate) fn joint_number(&self) -> Option<u64> {
        self.active_joint.as_ref().and_then(|shown| Some(self.joint.get(shown.joint)?.0))
    }

    /// Sets the serial number of the joint result from which the site is derived.
    pub(crate) const fn set_lineage(&mut self, number: Option<u64>) {
        self.lineage = number;
    }

    /// Returns the joint result that applies to the site, even if it is out of date.
    fn joint(&self) -> Option<&Joint> {
        self.joint.get(self.active_joint.as_ref()?.joint).map(|(_, joint)| joint)
    }

    /// Returns the joint result and the index of a camera in it. `None` if the inputs of the camera have
    /// changed since.
    fn joint_of_camera(&self, index: usize) -> Option<(&Joint, usize)> {
        let place = *self.active_joint.as_ref()?.camera_indices.get(index)?;
        Some((self.joint()?, place?))
    }

    /// Returns the report of the joint solve, even if it is out of date.
    #[must_use]
    pub fn joint_report(&self) -> Option<&Report> {
        self.joint().map(Joint::report)
    }

    /// Returns the joint solution of the link with this index, if the link has not changed since.
    #[must_use]
    pub fn joint_link(&self, site: &Site, link: usize) -> Option<&ElementSolution> {
        self.joint()?.link(site, link)
    }

    /// Returns the plane with this id: as estimated jointly, otherwise as entered. Returns the floor if `id`
    /// is `None`.
    #[must_use]
    pub fn plane(&self, site: &Site, id: Option<&str>) -> Plane {
        let found = id.and_then(|id| self.joint()?.plane(site, id));
        found.unwrap_or_else(|| site.plane_or_floor(id))
    }

    /// Returns the planes with a region, to which pixels are mapped in addition to the floor. The values are
    /// those of [`Self::plane`].
    #[must_use]
    pub fn surfaces(&self, site: &Site) -> Vec<Surface> {
        let mut found = Site { planes: site.planes.clone(), scene: site.scene, ..Site::new() };
        if let Some(joint) = self.joint() {
            joint.write_planes(&mut found.planes);
        }
        found.covering_surfaces()
    }

    /// Returns the plane of a camera's field of view; the floor if the field of view is not annotated.
    #[must_use]
    pub fn efov_plane(&self, site: &Site, camera: &SiteCamera) -> Plane {
        self.plane(site, camera.efov_plane.as_deref().filter(|_| camera.efov_px.is_some()))
    }

    /// Whether the cameras were solved jointly and no input of that solution has changed.
    #[must_use]
    pub fn is_joint_current(&self) -> bool {
        self.active_joint.as_ref().is_some_and(|shown| shown.is_current)
    }

    /// Whether the cameras were solved jointly and an input of that solution has changed.
    #[must_use]
    pub fn is_joint_out_of_date(&self) -> bool {
        self.active_joint.as_ref().is_some_and(|shown| !shown.is_current)
    }

    /// Whether a camera was solved jointly with others and an input of that solution has changed.
    #[must_use]
    pub fn is_out_of_date(&self, index: usize) -> bool {
        let id = self.entries.get(index).map(|entry| entry.id.as_str());
        self.is_joint_out_of_date()
            && id.zip(self.joint()).is_some_and(|(id, joint)| joint.includes_camera(id))
    }

    /// Returns the lenses that were fitted to a camera and to the cameras that share its lens.
    #[must_use]
    pub fn lenses(&self, index: usize) -> LensCache {
        self.entries.get(index).map(|entry| entry.family.lenses.clone()).unwrap_or_default()
    }

    /// Returns the solution of a camera, or its failure. A joint solution takes precedence. `None` if the camera has no
    /// result.
    #[must_use]
    pub fn result(&self, index: usize) -> Option<Result<&Solution, &FailureEntry>> {
        if let Some((joint, place)) = self.joint_of_camera(index) {
            return Some(Ok(joint.solution(place)?));
        }
        self.entries.get(index).map(|entry| entry.result.as_ref())
    }

    /// Returns the solution of a camera.
    #[must_use]
    pub fn solution(&self, index: usize) -> Option<&Solution> {
        self.result(index)?.ok()
    }

    /// Whether the scale of a camera is known. Otherwise lengths are known as multiples of its height only.
    #[must_use]
    pub fn scale_is_known(&self, index: usize) -> bool {
        let Some(solution) = self.solution(index) else { return false };
        let is_open = |(joint, _): (&Joint, usize)| joint.report().site.scale == Some(Scale::Unknown);
        let is_of_joint =
            solution.stage == Stage::Refined && self.joint_of_camera(index).is_some_and(is_open);
        !(is_of_joint || solution.has_warning(Code::ScaleAssumed))
    }

    /// Returns the finding from which a warning of a camera was written; `None` for a warning that was read
    /// from a file.
    #[must_use]
    pub fn finding(&self, site: &Site, index: usize, warning: &Warning) -> Option<&Finding> {
        // The results of a joint solve are stored like a site file, which contains only the text of a
        // warning.
        let matches_warning = |finding: &&Finding| {
            finding.code() == warning.code
                && site.describe_finding(Some(index), finding, Names::InFile) == *warning
        };
        self.entries.get(index)?.findings.iter().find(matches_warning)
    }

    /// Whether a wrong click of a link in a camera may stay undetected, because there is no redundant link.
    #[must_use]
    pub fn is_link_unchecked(&self, site: &Site, link: usize, camera: usize) -> bool {
        let Some(id) = site.links.get(link).map(|entry| entry.label(link)) else { return false };
        let (Some(solution), Some(pose)) = (self.solution(camera), self.pose(camera)) else { return false };
        let of_link =
            |residual: &&Residual| residual.of == ResidualOf::Link && residual.id.as_ref() == Some(&id);
        solution.residuals.iter().filter(of_link).any(|residual| residual.is_unchecked(pose.position.z))
    }

    /// Returns the pose and lens of a camera.
    #[must_use]
    pub fn pose(&self, index: usize) -> Option<&Camera> {
        match self.joint_of_camera(index) {
            Some((joint, place)) => joint.pose(place),
            None => self.entries.get(index)?.pose.as_ref(),
        }
    }

    /// Returns the pose of a camera that is placed on the floor plan or in the world.
    #[must_use]
    pub fn placed_pose(&self, index: usize) -> Option<&Camera> {
        let stage = self.solution(index)?.stage;
        self.pose(index).filter(|_| stage >= Stage::Placed)
    }

    /// Returns the site with its results, as it is saved. Results about the whole site are omitted if they
    /// are out of date, so that a reader of the file can detect this.
    #[must_use]
    pub fn write_into(&self, site: &Site) -> Site {
        let mut solved = site.clone();
        for (index, camera) in solved.cameras.iter_mut().enumerate() {
            (camera.solution, camera.error) = match self.result(index) {
                Some(Ok(solution)) => (Some(solution.clone()), None),
                Some(Err(failure)) => (None, Some(failure.clone())),
                None => (camera.solution.take(), camera.error.take()),
            };
        }
        if let Some(joint) = self.joint() {
            joint.write_shared(&mut solved, self.is_joint_current());
        }
        solved
    }

    /// Returns a state of the site with its joint results. Results of single cameras are omitted; they are
    /// solved again when the site is opened.
    #[must_use]
    pub fn write_joint_into(&self, site: &Site) -> Site {
        let mut solved = site.clone();
        let Some(shown) = self.find_joint(site) else { return solved };
        let (_, joint) = &self.joint[shown.joint];
        for (camera, place) in solved.cameras.iter_mut().zip(shown.camera_indices) {
            if let Some(solution) = place.and_then(|place| joint.solution(place)) {
                camera.solution = Some(solution.clone());
            }
        }
        joint.write_shared(&mut solved, shown.is_current);
        solved
    }
}

/// Returns the placement of the camera `after` for which its floor polygon is closest to the floor polygon of
/// the camera `before`. `corners` are raw pixels. `None` if the corners do not determine a placement.
#[must_use]
pub(crate) fn keep_polygon(before: &Camera, after: &Camera, corners: &[Pixel]) -> Option<Placement> {
    /// Largest distance on the floor from the camera to a corner, in camera heights. Farther corners are too
    /// uncertain and are not used.
    const MAX_CORNER_DISTANCE_HEIGHTS: f64 = 30.0;
    let unplaced = Placement::NONE.apply(after);
    let pairs: Vec<(FloorPoint, FloorPoint)> = corners
        .iter()
        .filter_map(|&pixel| {
            let (a, b) = (unplaced.pixel_to_floor(pixel, 0.0)?, before.pixel_to_floor(pixel, 0.0)?);
            (a.x.hypot(a.y) < MAX_CORNER_DISTANCE_HEIGHTS * calib_core::floor::STAGE_1_HEIGHT)
                .then_some((a, b))
        })
        .collect();
    Placement::fit(&pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::{Annotation, Covariance, Distortion, Kind, Lens, WorldPoint};
    use calib_site::{LensEntry, Options};

    /// Returns the demonstration site. Its first three cameras share one lens, which is fitted to their
    /// straight edges.
    fn site_with_shared_lens() -> Site {
        let mut site = calib_demo::demo_site().site;
        site.cameras.truncate(4);
        (site.links, site.marks, site.distances) = Default::default();
        let like = site.cameras[0].id.clone();
        site.cameras[0].lens = None;
        for index in [1, 2] {
            site.cameras[index].size_px = site.cameras[0].size_px;
            site.cameras[index].lens = Some(LensEntry { like: Some(like.clone()), ..LensEntry::default() });
        }
        for camera in &mut site.cameras[..3] {
            camera.annotations.extend(distorted_edge(0.1).into_iter().chain(distorted_edge(0.9)));
        }
        site
    }

    /// Returns a straight edge, curved by distortion. `share` is its position across the image, as a fraction
    /// of the width.
    fn distorted_edge(share: f64) -> Option<Annotation> {
        let points = (1..10).map(|i| {
            let t = f64::from(i) / 10.0 - 0.5;
            Pixel::new(1920.0 * (share + 0.04 * (0.5 - share) * (1.0 - 4.0 * t * t)), 1080.0 * (t + 0.5))
        });
        Some(Annotation { points: Some(points.collect()), ..Annotation::new(Kind::Straight) })
    }

    #[test]
    fn shared_lens_equals_the_result_of_the_whole_site() {
        let site = site_with_shared_lens();
        let whole = site.calibrate(&Options { refine: false, ..Options::default() });
        let mut solved = Solved::default();
        assert!(solved.update(&site));
        for (index, result) in &whole.cameras {
            let lens = |s: &Solution| s.camera().unwrap().lens;
            let (live, whole) = (solved.solution(*index).unwrap(), result.as_ref().unwrap());
            assert_eq!(lens(live), lens(whole), "camera {index}");
            assert_eq!(live.focal_px, whole.focal_px, "camera {index}");
        }
        let first = solved.pose(0).unwrap().lens;
        assert!(first.distortion != Distortion::None, "the edges determine distortion");
    }

    #[test]
    fn an_edge_changes_the_lens_of_all_cameras_that_share_it_and_no_other() {
        let mut site = site_with_shared_lens();
        let mut solved = Solved::default();
        solved.update(&site);
        let before: Vec<Lens> = (0..4).map(|i| solved.pose(i).unwrap().lens).collect();
        site.cameras[2].annotations.extend(distorted_edge(0.06));
        assert!(solved.update(&site));
        let differs = |i: usize| solved.pose(i).unwrap().lens.distortion != before[i].distortion;
        assert_eq!([0, 1, 2, 3].map(differs), [true, true, true, false]);
        assert!(!solved.update(&site), "no input changed");
    }

    #[test]
    fn polygon_of_an_unchanged_camera_keeps_its_placement() {
        let camera = Camera {
            position: WorldPoint::new(4.0, -2.0, 4.5),
            yaw: 0.7,
            pitch: 0.5,
            roll: 0.05,
            focal: 1000.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        };
        let corners = [[100.0, 1000.0], [1800.0, 1000.0], [1500.0, 600.0]].map(Pixel::from);
        let kept = keep_polygon(&camera, &camera, &corners).unwrap();
        let own = Placement::from_camera(&camera);
        assert!(kept.by.distance(own.by) < 1e-9 && (kept.turn - own.turn).abs() < 1e-9);
        assert!((kept.scale - own.scale).abs() < 1e-9);
    }
}
