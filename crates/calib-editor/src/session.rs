//! The open site with its verbs: begin and end gestures, undo, select, solve.
//!
//! How often is solved: once in a frame where it takes long, so that there is always a frame.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use calib_core::outcome::Drawing;
use calib_core::{Camera, MarkKind, Pixel, PlanPixel, Plane, WorldPoint};
use calib_site::{Method, Names, PlacementEntry, Site, SiteCamera, Solution, Warning};

use crate::history::History;
use crate::hit::Part;
use crate::images::Images;
use crate::joint::{Joint, forget_results, same_input};
use crate::proposed;
use crate::proposed::Proposed;
use crate::refine::rounded;
use crate::solved::{Solved, keep_polygon};
use crate::units::Units;

/// What takes no longer is not waited for, in milliseconds.
const BLINK: f64 = 80.0;

/// A site that is being worked on.
#[derive(Clone, Debug)]
pub struct Session {
    /// As drawn so far, the gesture under way included.
    pub site: Site,
    /// What undo and redo know.
    pub history: History,
    /// What follows from the site.
    pub solved: Solved,
    /// The images of the site.
    pub images: Images,
    /// The file of the site, if it has one.
    pub path: Option<PathBuf>,
    /// The camera in hand.
    pub camera: usize,
    /// What is selected on its image.
    pub selection: BTreeSet<Part>,
    /// The plane in hand: the tool of regions draws where it holds.
    pub plane: Option<usize>,
    /// Which mark the mark tool makes.
    pub mark_kind: MarkKind,
    /// The next line begins a group of its own.
    pub fresh_group: bool,
    /// Two points of the plan whose distance waits for a length.
    pub measured: Option<[PlanPixel; 2]>,
    /// About which point of the floor a polygon turns, if the operator pinned one, in metres.
    pub pivot: Option<[f64; 2]>,
    /// What was suggested for which camera and is not to be suggested again, by its id.
    pub(crate) dismissed: Vec<(String, Drawing)>,
    /// What stills propose and is not decided, at most once a camera.
    pub(crate) proposed: Arc<Vec<Proposed>>,
    /// The group and line that are chosen of what is proposed for the camera in hand.
    pub(crate) picked: Option<(usize, usize)>,
    /// What lengths are shown in.
    pub units: Units,
    /// What is dragged on the plan snaps to round numbers.
    pub snap: bool,
    /// What happened last, in a sentence, for the status line.
    pub note: Option<String>,
    /// Counts finished gestures, so that autosave sees a new one.
    pub generation: u64,
    /// The generation that was saved.
    pub saved: u64,
    /// Poses at the last finished gesture: where polygons lie that are to stay.
    settled: Vec<Option<Camera>>,
    /// What those poses follow from.
    pub(crate) settled_cameras: Vec<Arc<SiteCamera>>,
    /// How many solves that take long are left in this frame; as many as are wanted where there are no frames.
    pub(crate) solves_left: Option<u32>,
    /// A gesture ended and was not solved.
    pub(crate) is_put_off: bool,
    /// The joint result held at the last finished gesture.
    pub(crate) was_joint_current: bool,
    /// How long the last joint solve took that was done on the way, in milliseconds.
    pub(crate) joint_took: f64,
    /// How long one may take for the next to be done on the way, in milliseconds.
    pub joint_may_take: f64,
    /// Poses before the last joint solve.
    pub before_refine: Option<Vec<Option<Camera>>>,
}

impl Session {
    /// A session on this site.
    #[must_use]
    pub fn new(mut site: Site, images: Images, path: Option<PathBuf>) -> Self {
        let joint = Joint::of_file(&site);
        forget_results(&mut site);
        let history = History::new(&site);
        let mut session = Self {
            site,
            history,
            solved: Solved::default(),
            images,
            path,
            camera: 0,
            selection: BTreeSet::new(),
            plane: None,
            mark_kind: MarkKind::Box,
            fresh_group: false,
            measured: None,
            pivot: None,
            dismissed: Vec::new(),
            proposed: Arc::default(),
            picked: None,
            units: Units::default(),
            snap: false,
            note: None,
            generation: 0,
            saved: 0,
            settled: Vec::new(),
            settled_cameras: Vec::new(),
            solves_left: None,
            is_put_off: false,
            was_joint_current: false,
            joint_took: 0.0,
            joint_may_take: BLINK,
            before_refine: None,
        };
        if let Some(report) = joint {
            session.solved.keep_joint(Joint::new(&session.site, report));
        }
        session.solve();
        session.settle();
        session
    }

    /// The camera in hand.
    #[must_use]
    pub fn entry(&self) -> Option<&SiteCamera> {
        self.site.cameras.get(self.camera)
    }

    /// The camera in hand, to be changed.
    pub fn entry_mut(&mut self) -> Option<&mut SiteCamera> {
        self.site.cameras.get_mut(self.camera)
    }

    /// What the still of the camera in hand proposes and is not decided.
    #[must_use]
    pub fn proposed(&self) -> Option<&Proposed> {
        let camera = self.entry()?;
        self.proposed.iter().find(|own| own.of.is_of(camera))
    }

    /// The group and line that are chosen of it.
    #[must_use]
    pub const fn picked(&self) -> Option<(usize, usize)> {
        self.picked
    }

    /// The camera in hand as a proposal begins: nothing drawn, and its lens given where it is known by now.
    #[must_use]
    pub fn undrawn(&self) -> Option<SiteCamera> {
        Some(proposed::undrawn(self.entry()?, self.pose()))
    }

    /// What was proposed for a camera that is gone, or for another still, is gone too.
    fn forget_stale(&mut self) {
        let (before, site) = (self.history.cameras(), &self.site);
        let still = |camera: &SiteCamera| (camera.image.clone(), camera.size_px);
        let is_stale = |own: &Proposed| {
            let now = site.cameras.iter().find(|camera| own.of.is_of(camera));
            let was = before.iter().find(|camera| own.of.is_of(camera));
            now.is_none_or(|now| was.is_some_and(|was| still(now) != still(was)))
        };
        if self.proposed.iter().any(is_stale) {
            Arc::make_mut(&mut self.proposed).retain(|own| !is_stale(own));
            self.picked = None;
        }
    }

    /// Whether a camera may show links and marks; says why where it may not: those of an id are drawn on the still of its
    /// newest period.
    pub(crate) fn may_share(&mut self, camera: usize) -> bool {
        let may = self.site.has_shared(camera);
        if !may && let Some(entry) = self.site.cameras.get(camera) {
            let id = &entry.id;
            self.note = Some(format!(
                "This calibration of {id} has ended: links and pins are drawn on the newest still of {id}."
            ));
        }
        may
    }

    /// The result of the camera in hand.
    #[must_use]
    pub fn solution(&self) -> Option<&Solution> {
        self.solved.solution(self.camera)
    }

    /// The pose of the camera in hand.
    #[must_use]
    pub fn pose(&self) -> Option<&Camera> {
        self.solved.pose(self.camera)
    }

    /// Solves what differs; a placed polygon stays where it lies when stage 1 changes under it.
    pub fn solve(&mut self) -> bool {
        let changed = self.solved.update(&self.site);
        if changed && self.keep_polygons() {
            self.solved.update(&self.site);
        }
        changed
    }

    fn keep_polygons(&mut self) -> bool {
        let mut moved = false;
        for index in 0..self.site.cameras.len() {
            let (Some(before), Some(Some(settled))) =
                (self.settled_cameras.get(index), self.settled.get(index))
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
                ..kept
            };
            if camera.placement.as_ref() != Some(&kept) {
                self.site.cameras[index].placement = Some(kept);
                self.note = Some("The polygon stays where it lies on the plan.".into());
                moved = true;
            }
        }
        moved
    }

    /// Poses as they are now are those to come back to.
    pub(crate) fn settle(&mut self) {
        self.settled_cameras = self.history.cameras().to_vec();
        self.was_joint_current = self.solved.is_joint_current();
        let number = self.solved.joint_number();
        self.solved.descend_from(number);
        self.history.set_joint(number);
        self.settled = (0..self.site.cameras.len()).map(|index| self.solved.pose(index).copied()).collect();
    }

    /// What a warning about a camera says, with its annotations named as the screen names them: "V1", not
    /// "Vertical (annotation 0)", which tells where it is in a file.
    #[must_use]
    pub fn as_on_screen(&self, camera: usize, warning: &Warning) -> String {
        match self.solved.finding(&self.site, camera, warning) {
            Some(finding) => self.site.in_english(Some(camera), finding, Names::OnScreen).message,
            None => warning.message.clone(),
        }
    }

    /// Poses at the last finished gesture.
    #[must_use]
    pub fn settled(&self) -> &[Option<Camera>] {
        &self.settled
    }

    /// A period that has ended is solved again once something else is drawn on it.
    fn forget_kept(&mut self) {
        let before = self.history.cameras();
        for camera in &mut self.site.cameras {
            let is_kept = camera.solution.as_ref().is_some_and(|found| found.method == Method::Kept);
            let same_period = |was: &&Arc<SiteCamera>| was.id == camera.id && was.valid_to == camera.valid_to;
            let was = before.iter().find(same_period);
            if is_kept && was.is_some_and(|was| !same_input(was, camera)) {
                camera.solution = None;
            }
        }
    }

    /// Ends a gesture under this name. One that would make a site that no file can hold is put back.
    pub fn commit(&mut self, name: impl Into<String>) {
        self.forget_kept();
        if let Err(error) = self.site.check() {
            self.revert();
            self.note = Some(format!("Not possible: {}.", error.message()));
        }
        let is_solved = self.solve_in_frame();
        if is_solved {
            self.refine_on_the_way();
        }
        self.forget_stale();
        let is_other = !self.history.is_at(&self.site);
        self.history.commit(name, &self.site, &self.proposed);
        if is_other {
            self.generation += 1;
            self.before_refine = None;
        }
        self.is_put_off = !is_solved;
        if is_solved {
            self.settle();
        }
    }

    /// Puts the site back to where the gesture under way began.
    pub fn revert(&mut self) {
        self.history.put_back(&mut self.site);
    }

    /// Takes the last gesture back.
    pub fn undo(&mut self) {
        if let Some((site, name)) = self.history.undo() {
            self.restore(site, format!("Undone: {name}."));
        }
    }

    /// Does the gesture again that was taken back last.
    pub fn redo(&mut self) {
        if let Some((site, name)) = self.history.redo() {
            self.restore(site, format!("Done again: {name}."));
        }
    }

    fn restore(&mut self, site: Site, note: String) {
        self.generation += u64::from(self.site != site);
        self.site = site;
        self.proposed = Arc::clone(self.history.proposed());
        self.selection.clear();
        self.picked = None;
        self.plane = self.plane.filter(|&plane| plane < self.site.planes.len());
        self.before_refine = None;
        self.camera = self.camera.min(self.site.cameras.len().saturating_sub(1));
        self.note = Some(note);
        self.is_put_off = false;
        self.solved.descend_from(self.history.joint());
        // Before solving, so that no polygon is held to what was undone.
        self.settled.clear();
        self.solve();
        self.settle();
    }

    /// Takes a camera in hand.
    pub fn choose(&mut self, camera: usize) {
        if camera != self.camera && camera < self.site.cameras.len() {
            self.camera = camera;
            self.selection.clear();
            self.picked = None;
            self.pivot = None;
        }
    }

    /// Selects this and nothing else.
    pub fn select_only(&mut self, camera: usize, part: Part) {
        self.choose(camera);
        self.selection = BTreeSet::from([part]);
    }

    /// Whether anything differs from the file.
    #[must_use]
    pub const fn is_saved(&self) -> bool {
        self.generation == self.saved
    }

    /// The upright edges of a camera's prism: at the corners that were drawn, not where its outline bends.
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

    /// Looks for images beside another folder from now on; the history goes with it.
    pub fn rebase(&mut self, folder: &std::path::Path) {
        let images = self.images.clone();
        self.site = images.rebased(&self.site, folder);
        self.history.map(|site| images.rebased(site, folder));
        self.images.folder = Some(folder.to_path_buf());
        self.images.missing = None;
    }
}

/// The corners of the field, or the lower part of the image where none is drawn.
#[must_use]
pub fn corners_of(camera: &SiteCamera) -> Vec<Pixel> {
    let [w, h] = camera.size();
    let drawn = camera.efov_px.clone().filter(|corners| corners.len() >= 3);
    drawn.unwrap_or_else(|| {
        [[0.1, 0.98], [0.9, 0.98], [0.8, 0.7], [0.2, 0.7]].map(|[x, y]| Pixel::new(x * w, y * h)).to_vec()
    })
}

/// So many milliseconds are nothing, even many times in a frame.
const NOTHING: f64 = 2.0;

impl Session {
    /// A frame begins: from now on what takes long is solved once in every frame, whatever comes in.
    pub(crate) fn begin_frame(&mut self) {
        self.solves_left = Some(1);
    }

    /// Solves, unless that took long and was done in this frame already. Whether it was not put off.
    pub(crate) fn solve_in_frame(&mut self) -> bool {
        if self.solves_left == Some(0) && self.solved.milliseconds > NOTHING {
            return false;
        }
        if self.solve() {
            self.solves_left = self.solves_left.map(|left| left.saturating_sub(1));
        }
        true
    }

    /// Solves what was put off when a gesture ended; what follows from it becomes a part of that gesture.
    pub(crate) fn catch_up(&mut self) {
        // While the next gesture is under way, its end catches up with both.
        if !self.is_put_off || !self.history.is_at(&self.site) {
            return;
        }
        self.is_put_off = false;
        self.solve();
        self.refine_on_the_way();
        self.history.amend(&self.site);
        self.settle();
    }
}
