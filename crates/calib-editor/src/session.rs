//! Open site with its operations: end gestures, undo, select, solve.
//!
//! A slow solve runs at most once per frame, so that the display stays responsive.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use calib_core::outcome::SuggestedAnnotation;
use calib_core::{Camera, FloorPoint, MarkKind, Pixel, PlanPixel, Plane, WorldPoint};
use calib_site::{
    Georeference, GeoreferenceSolution, MeasurementKind, Method, Names, PlacementEntry, Site, SiteCamera,
    Solution, Warning,
};

use crate::history::History;
use crate::hit::Part;
use crate::images::Images;
use crate::joint::{Joint, has_same_inputs, remove_results};
use crate::proposed;
use crate::proposed::PendingCalibration;
use crate::refine::rounded;
use crate::slots::CameraSlots;
use crate::solved::{Solved, keep_polygon};

/// Default of the largest duration of a joint solve that runs after every gesture, in milliseconds.
const MAX_LIVE_JOINT_SOLVE_MS: f64 = 80.0;

/// Settings of the tools.
#[derive(Clone, Debug)]
pub struct ToolSettings {
    /// Index of the selected plane, whose region the region tool draws; `None` if no plane is selected.
    pub plane: Option<usize>,
    /// Kind of mark that the mark tool creates.
    pub mark_kind: MarkKind,
    /// Whether the next line begins a new annotation.
    pub fresh_group: bool,
    /// Two measured points of the plan whose distance the operator has not entered yet.
    pub measured: Option<[PlanPixel; 2]>,
    /// Floor point about which the corners of a polygon rotate, in metres; `None` for the centre of the
    /// polygon.
    pub pivot: Option<[f64; 2]>,
    /// Whether dragging on the plan snaps to round numbers.
    pub snap: bool,
    /// Quantity that the tool *Measure* measures, and the height of its points.
    pub ruler: RulerSettings,
    /// Id of the ground point that the next click with the control point tool marks in an image.
    pub ground_point: Option<String>,
}

/// Quantity that the tool *Measure* measures in the images, and the height of its points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RulerSettings {
    /// Quantity.
    pub kind: MeasurementKind,
    /// Height of the points above the floor, in metres.
    pub height: f64,
}

/// Lines that the operator has not decided about: suggestions and automatic calibrations.
#[derive(Clone, Debug)]
pub struct PendingLines {
    /// Suggestions that the operator dismissed, each with the id of its camera.
    pub(crate) dismissed: Vec<(String, SuggestedAnnotation)>,
    /// Undecided automatic calibrations, at most one per camera.
    pub(crate) proposed: Arc<Vec<PendingCalibration>>,
    /// Indices of the selected group and line in the automatic calibration of the selected camera.
    pub(crate) picked_line: Option<(usize, usize)>,
}

/// Counter of finished gestures, by which autosave detects changes.
#[derive(Clone, Debug)]
pub struct Revision {
    /// Number of finished gestures that changed the site.
    pub generation: u64,
    /// Value of `generation` when the site was saved last.
    pub saved: u64,
}

/// State of solving during editing.
#[derive(Clone, Debug)]
pub struct LiveSolve {
    /// Poses at the last finished gesture. They are the reference for keeping the field-of-view polygons in place on
    /// the plan when the orientation of a camera changes.
    pub(crate) settled: Vec<Option<Camera>>,
    /// Cameras at the last finished gesture: the inputs of the poses in `settled`.
    pub(crate) settled_cameras: Vec<Arc<SiteCamera>>,
    /// Number of slow solves that may still run in this frame; `None` (unlimited) if no frame was begun.
    pub(crate) solves_left: Option<u32>,
    /// Whether the last gesture was not solved yet, because a slow solve had already run in the frame.
    pub(crate) is_solve_postponed: bool,
    /// Whether the joint result was current at the last finished gesture.
    pub(crate) was_joint_current: bool,
    /// Duration of the last joint solve during editing, in milliseconds.
    pub(crate) last_joint_solve_ms: f64,
    /// Largest accepted duration of a joint solve during editing, in milliseconds.
    pub max_joint_solve_ms: f64,
    /// Poses of all cameras before the last joint solve, for comparison.
    pub before_refine: Option<Vec<Option<Camera>>>,
}

/// Site that is being edited, with its history, results and selection.
#[derive(Clone, Debug)]
pub struct Session {
    /// Site in its current state, including the unfinished gesture.
    pub site: Site,
    /// Undo and redo history.
    pub history: History,
    /// Results of the site.
    pub solved: Solved,
    /// Images of the site.
    pub images: Images,
    /// File of the site, if it has one.
    pub path: Option<PathBuf>,
    /// Index of the selected camera.
    pub camera: usize,
    /// Selected parts of the selected camera's image.
    pub selection: BTreeSet<Part>,
    /// Last event, as a sentence for the status line.
    pub note: Option<String>,
    /// Settings of the tools.
    pub tool: ToolSettings,
    /// Lines that the operator has not decided about: suggestions and automatic calibrations.
    pub pending: PendingLines,
    /// Counter of finished gestures, by which autosave detects changes.
    pub revision: Revision,
    /// State of solving during editing.
    pub live: LiveSolve,
    /// Number of undo steps right after the last image was added; `None` if no image was added. A different current
    /// number shows that the site was changed since.
    pub(crate) added_at: Option<usize>,
    /// Numbers that determine the letters and colours of the cameras.
    slots: CameraSlots,
}

impl Session {
    /// Returns the standard deviation of the direction of north, in degrees; `None` if the georeference is
    /// entered, or defined by geographic points.
    #[must_use]
    pub fn north_sigma_deg(&self) -> Option<f64> {
        Some(self.estimated_georeference()?.sigma.azimuth_deg).filter(|sigma| *sigma > 0.0)
    }

    /// Returns the covariance that the errors of the georeference cause in the geographic position of a floor
    /// point. It is along world x and y, in square metres; zero if the georeference is exact.
    #[must_use]
    pub fn georeference_covariance(&self, at: FloorPoint) -> [[f64; 2]; 2] {
        self.estimated_georeference().map_or([[0.0; 2]; 2], |found| found.world_covariance_at(at))
    }

    fn estimated_georeference(&self) -> Option<GeoreferenceSolution> {
        let solved = || self.solved.joint_report()?.site.georeference.clone();
        self.site.estimated_georeference().or_else(solved)
    }

    /// Returns the georeference of the site: entered, from its points, or from the last joint solve.
    #[must_use]
    pub fn georeference(&self) -> Option<Georeference> {
        let solved =
            || self.solved.joint_report()?.site.georeference.as_ref().map(GeoreferenceSolution::as_entered);
        self.site.georeference().or_else(solved)
    }

    /// Creates a session for a site with its images; `path` is the file of the site, if it has one.
    #[must_use]
    pub fn new(mut site: Site, images: Images, path: Option<PathBuf>) -> Self {
        let joint = Joint::report_in_file(&site);
        remove_results(&mut site);
        let history = History::new(&site);
        let mut session = Self {
            site,
            history,
            solved: Solved::default(),
            images,
            path,
            camera: 0,
            selection: BTreeSet::new(),
            note: None,
            tool: ToolSettings {
                plane: None,
                mark_kind: MarkKind::Box,
                fresh_group: false,
                measured: None,
                pivot: None,
                snap: false,
                ruler: RulerSettings::default(),
                ground_point: None,
            },
            pending: PendingLines { dismissed: Vec::new(), proposed: Arc::default(), picked_line: None },
            revision: Revision { generation: 0, saved: 0 },
            added_at: None,
            slots: CameraSlots::default(),
            live: LiveSolve {
                settled: Vec::new(),
                settled_cameras: Vec::new(),
                solves_left: None,
                is_solve_postponed: false,
                was_joint_current: false,
                last_joint_solve_ms: 0.0,
                max_joint_solve_ms: MAX_LIVE_JOINT_SOLVE_MS,
                before_refine: None,
            },
        };
        if let Some(report) = joint {
            session.solved.add_joint(Joint::new(&session.site, report));
        }
        session.slots.update(&session.site.cameras);
        session.solve();
        session.store_reference();
        session
    }

    /// Returns the selected camera.
    #[must_use]
    pub fn entry(&self) -> Option<&SiteCamera> {
        self.site.cameras.get(self.camera)
    }

    /// Returns the number that determines the letter and the colour of the camera with this index. It stays when
    /// other cameras are removed.
    #[must_use]
    pub fn camera_slot(&self, index: usize) -> usize {
        self.slots.get(index)
    }

    /// Returns the selected camera for editing.
    pub fn entry_mut(&mut self) -> Option<&mut SiteCamera> {
        self.site.cameras.get_mut(self.camera)
    }

    /// Returns the undecided automatic calibration of the selected camera.
    #[must_use]
    pub fn proposed(&self) -> Option<&PendingCalibration> {
        let camera = self.entry()?;
        self.pending.proposed.iter().find(|own| own.of.matches(camera))
    }

    /// Returns the indices of the selected group and line in the automatic calibration of the selected
    /// camera; `None` if no line is selected.
    #[must_use]
    pub const fn picked_line(&self) -> Option<(usize, usize)> {
        self.pending.picked_line
    }

    /// Returns the camera with this index as the input of an automatic calibration: without annotations, with its
    /// lens fixed if known.
    #[must_use]
    pub fn without_annotations(&self, camera: usize) -> Option<SiteCamera> {
        Some(proposed::without_annotations(self.site.cameras.get(camera)?, self.solved.pose(camera)))
    }

    /// Removes the automatic calibrations of cameras that were removed or have another image now.
    fn remove_stale_calibrations(&mut self) {
        let (before, site) = (self.history.cameras(), &self.site);
        let image_of = |camera: &SiteCamera| (camera.image.clone(), camera.size_px);
        let is_stale = |own: &PendingCalibration| {
            let now = site.cameras.iter().find(|camera| own.of.matches(camera));
            let was = before.iter().find(|camera| own.of.matches(camera));
            now.is_none_or(|now| was.is_some_and(|was| image_of(now) != image_of(was)))
        };
        if self.pending.proposed.iter().any(is_stale) {
            Arc::make_mut(&mut self.pending.proposed).retain(|own| !is_stale(own));
            self.pending.picked_line = None;
        }
    }

    /// Whether links and marks may be added to a camera; otherwise sets a note with the reason. Links and
    /// marks belong to the newest calibration period of a camera.
    pub(crate) fn check_may_share(&mut self, camera: usize) -> bool {
        let may = self.site.owns_links(camera);
        if !may && let Some(entry) = self.site.cameras.get(camera) {
            let id = &entry.id;
            self.note = Some(format!(
                "The period of this calibration has ended. Add links and marks in the newest image of {id}."
            ));
        }
        may
    }

    /// Returns the solution of the selected camera.
    #[must_use]
    pub fn solution(&self) -> Option<&Solution> {
        self.solved.solution(self.camera)
    }

    /// Returns the pose and lens of the selected camera.
    #[must_use]
    pub fn pose(&self) -> Option<&Camera> {
        self.solved.pose(self.camera)
    }

    /// Solves the cameras whose inputs changed. If the roll, pitch or focal length of a camera with an unfixed
    /// placement changes, its field-of-view polygon keeps its position on the plan. Returns whether any camera was
    /// solved.
    pub fn solve(&mut self) -> bool {
        let changed = self.solved.update(&self.site);
        if changed && self.keep_polygons() {
            self.solved.update(&self.site);
        }
        changed
    }

    /// Moves the cameras whose stage 1 solution changed, so that their polygons keep their position on the
    /// plan. Returns whether any camera was moved.
    fn keep_polygons(&mut self) -> bool {
        let mut moved = false;
        for index in 0..self.site.cameras.len() {
            let (Some(before), Some(Some(settled))) =
                (self.live.settled_cameras.get(index), self.live.settled.get(index))
            else {
                continue;
            };
            let Some(camera) = self.site.cameras.get(index) else { continue };
            let Some(own) = &before.placement else { continue };
            let Some(now) = self.solved.pose(index) else { continue };
            let turned =
                [now.roll - settled.roll, now.pitch - settled.pitch, now.focal / settled.focal - 1.0];
            let is_stage_1 = camera.id == before.id
                && (camera.annotations != before.annotations || camera.lens != before.lens);
            if own.fixed || !own.held.is_empty() || !is_stage_1 || turned.iter().all(|by| by.abs() < 1e-12) {
                continue;
            }
            let corners = corners_of(camera);
            let Some(kept) = keep_polygon(settled, now, &corners) else { continue };
            let kept = rounded(kept);
            let kept = PlacementEntry {
                fixed: own.fixed,
                held: own.held,
                scale: kept.scale.filter(|_| own.scale.is_some()),
                estimated: own.estimated,
                ..kept
            };
            if camera.placement.as_ref() != Some(&kept) {
                let note =
                    format!("{} was moved so that its field of view stays in place on the plan.", camera.id);
                self.site.cameras[index].placement = Some(kept);
                self.note = Some(note);
                moved = true;
            }
        }
        moved
    }

    /// Stores the current cameras and poses as the reference for the next gesture.
    pub(crate) fn store_reference(&mut self) {
        self.live.settled_cameras = self.history.cameras().to_vec();
        self.live.was_joint_current = self.solved.is_joint_current();
        let number = self.solved.joint_number();
        self.solved.set_lineage(number);
        self.history.set_joint(number);
        self.live.settled =
            (0..self.site.cameras.len()).map(|index| self.solved.pose(index).copied()).collect();
    }

    /// Returns the message of a warning with the names of annotations as in the app. The app shows "V1"; a
    /// file contains "Vertical (annotation 0)".
    #[must_use]
    pub fn warning_text(&self, camera: usize, warning: &Warning) -> String {
        match self.solved.finding(&self.site, camera, warning) {
            Some(finding) => self.site.describe_finding(Some(camera), finding, Names::OnScreen).message,
            None => warning.message.clone(),
        }
    }

    /// Returns the poses of all cameras at the last finished gesture.
    #[must_use]
    pub fn settled(&self) -> &[Option<Camera>] {
        &self.live.settled
    }

    /// Discards the stored solution ([`Method::Kept`]) of an ended calibration period if the inputs of the camera
    /// have changed.
    fn discard_changed_solutions(&mut self) {
        let before = self.history.cameras();
        for camera in &mut self.site.cameras {
            let is_kept = camera.solution.as_ref().is_some_and(|found| found.method == Method::Kept);
            let same_period = |was: &&Arc<SiteCamera>| was.id == camera.id && was.valid_to == camera.valid_to;
            let was = before.iter().find(same_period);
            if is_kept && was.is_some_and(|was| !has_same_inputs(was, camera)) {
                camera.solution = None;
            }
        }
    }

    /// Ends a gesture: solves the site and stores an undo step with this name. A gesture that makes the site
    /// invalid is reverted.
    pub fn commit(&mut self, name: impl Into<String>) {
        self.discard_changed_solutions();
        if let Err(error) = self.site.check() {
            self.revert();
            self.note = Some(format!("Change reverted: {}.", error.message()));
        }
        // A change of the georeference moves marks with map coordinates.
        self.site.place_surveyed_marks();
        let is_solved = self.solve_in_frame();
        if is_solved {
            self.refine_if_fast();
        }
        self.remove_stale_calibrations();
        self.slots.update(&self.site.cameras);
        let is_other = !self.history.is_unchanged(&self.site);
        self.history.commit(name, &self.site, &self.pending.proposed);
        if is_other {
            self.revision.generation += 1;
            self.live.before_refine = None;
        }
        self.live.is_solve_postponed = !is_solved;
        if is_solved {
            self.store_reference();
        }
    }

    /// Restores the site to the start of the current gesture.
    pub fn revert(&mut self) {
        self.history.restore_last(&mut self.site);
    }

    /// Undoes the last gesture.
    pub fn undo(&mut self) {
        if let Some((site, name)) = self.history.undo() {
            self.restore(site, format!("Undone: {name}"));
        }
    }

    /// Redoes the gesture that was undone last.
    pub fn redo(&mut self) {
        if let Some((site, name)) = self.history.redo() {
            self.restore(site, format!("Redone: {name}"));
        }
    }

    fn restore(&mut self, site: Site, note: String) {
        self.revision.generation += u64::from(self.site != site);
        self.site = site;
        self.slots.update(&self.site.cameras);
        self.pending.proposed = Arc::clone(self.history.proposed());
        self.selection.clear();
        self.pending.picked_line = None;
        self.tool.plane = self.tool.plane.filter(|&plane| plane < self.site.planes.len());
        self.live.before_refine = None;
        self.camera = self.camera.min(self.site.cameras.len().saturating_sub(1));
        self.note = Some(note);
        self.live.is_solve_postponed = false;
        self.solved.set_lineage(self.history.joint());
        // The reference poses are cleared before solving, so that no polygon is kept at an undone position.
        self.live.settled.clear();
        self.solve();
        self.store_reference();
    }

    /// Selects a camera.
    pub fn select_camera(&mut self, camera: usize) {
        if camera != self.camera && camera < self.site.cameras.len() {
            self.camera = camera;
            self.selection.clear();
            self.pending.picked_line = None;
            self.tool.pivot = None;
        }
    }

    /// Selects the camera with this index and only this part of its image.
    pub fn select_only(&mut self, camera: usize, part: Part) {
        self.select_camera(camera);
        self.selection = BTreeSet::from([part]);
    }

    /// Whether the site has no unsaved changes.
    #[must_use]
    pub const fn is_saved(&self) -> bool {
        self.revision.generation == self.revision.saved
    }

    /// Returns the vertical edges of the prism above a camera's field of view, as world polylines in metres. They are
    /// at the annotated corners only, not at the other points of a curved outline.
    #[must_use]
    pub fn prism_edges(&self, index: usize) -> Vec<calib_core::Polyline> {
        let drawn = self.site.cameras.get(index).and_then(|camera| camera.efov_px.as_ref());
        let (Some(drawn), Some(pose)) = (drawn, self.solved.pose(index)) else { return Vec::new() };
        let of = |camera: &SiteCamera| self.solved.efov_plane(&self.site, camera);
        let plane = self.site.cameras.get(index).map_or(Plane::FLOOR, of);
        let feet = drawn.iter().filter_map(|&corner| pose.pixel_to_plane(corner, &plane));
        feet.map(|foot| vec![foot, WorldPoint { z: foot.z + calib_core::floor::PRISM_HEIGHT, ..foot }])
            .collect()
    }

    /// Makes image paths relative to another folder, in the site and in its history.
    pub fn rebase(&mut self, folder: &std::path::Path) {
        let images = self.images.clone();
        self.site = images.rebased(&self.site, folder);
        self.history.map(|site| images.rebased(site, folder));
        self.images.folder = Some(folder.to_path_buf());
        self.images.missing = None;
    }
}

/// Returns the corners of the annotated field of view in raw pixels. If it is not annotated, returns the
/// corners of the lower part of the image.
#[must_use]
pub fn corners_of(camera: &SiteCamera) -> Vec<Pixel> {
    let [w, h] = camera.size();
    let drawn = camera.efov_px.clone().filter(|corners| corners.len() >= 3);
    drawn.unwrap_or_else(|| {
        [[0.1, 0.98], [0.9, 0.98], [0.8, 0.7], [0.2, 0.7]].map(|[x, y]| Pixel::new(x * w, y * h)).to_vec()
    })
}

/// Largest duration of a solve that may run several times in one frame, in milliseconds.
const FAST_SOLVE_MS: f64 = 2.0;

impl Session {
    /// Begins a frame of the display. A slow solve then runs at most once in this frame.
    pub(crate) fn begin_frame(&mut self) {
        self.live.solves_left = Some(1);
    }

    /// Solves the site unless a slow solve already ran in this frame. Returns false if the solve was
    /// postponed.
    pub(crate) fn solve_in_frame(&mut self) -> bool {
        if self.live.solves_left == Some(0) && self.solved.milliseconds > FAST_SOLVE_MS {
            return false;
        }
        if self.solve() {
            self.live.solves_left = self.live.solves_left.map(|left| left.saturating_sub(1));
        }
        true
    }

    /// Runs a postponed solve; its effects are added to the undo step of the last gesture.
    pub(crate) fn solve_postponed(&mut self) {
        // If another gesture is in progress, the solve at its end includes the postponed one.
        if !self.live.is_solve_postponed || !self.history.is_unchanged(&self.site) {
            return;
        }
        self.live.is_solve_postponed = false;
        self.solve();
        self.refine_if_fast();
        self.history.amend(&self.site);
        self.store_reference();
    }
}
