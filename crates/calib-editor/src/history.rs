//! Undo and redo: named snapshots of the site, one per gesture.

use std::sync::Arc;

use calib_site::{Site, SiteCamera};

use crate::proposed::PendingCalibration;

/// Snapshot of a site. Unchanged cameras are shared between snapshots.
#[derive(Clone, Debug)]
struct Snapshot {
    cameras: Vec<Arc<SiteCamera>>,
    /// Site without its cameras.
    rest: Arc<Site>,
}

impl Snapshot {
    fn new(site: &Site, before: Option<&Self>) -> Self {
        let shared = |camera: &SiteCamera| {
            let known = before.and_then(|before| before.cameras.iter().find(|known| ***known == *camera));
            known.map_or_else(|| Arc::new(camera.clone()), Arc::clone)
        };
        let cameras = site.cameras.iter().map(shared).collect();
        let rest = without_cameras(site);
        let rest = match before {
            Some(before) if *before.rest == rest => Arc::clone(&before.rest),
            _ => Arc::new(rest),
        };
        Self { cameras, rest }
    }

    fn site(&self) -> Site {
        let mut site = Site::clone(&self.rest);
        site.cameras = self.cameras.iter().map(|camera| SiteCamera::clone(camera)).collect();
        site
    }

    fn matches(&self, site: &Site) -> bool {
        self.cameras.len() == site.cameras.len()
            && self.cameras.iter().zip(&site.cameras).all(|(known, camera)| **known == *camera)
            && is_same_rest(&self.rest, site)
    }
}

/// Restores all fields of a site except the cameras.
fn restore_rest(site: &mut Site, known: &Site) {
    let Site {
        cameras: _,
        format,
        version,
        name,
        units,
        plan,
        links,
        marks,
        distances,
        georeference,
        crs,
        scene,
        planes,
        walls,
        areas,
        level_px_per_m,
        measurements,
        ground_points,
        solution,
    } = known;
    (site.format, site.version) = (*format, *version);
    restore_value(&mut site.name, name);
    site.units = *units;
    restore_value(&mut site.plan, plan);
    restore_value(&mut site.links, links);
    restore_value(&mut site.marks, marks);
    restore_value(&mut site.distances, distances);
    restore_value(&mut site.georeference, georeference);
    restore_value(&mut site.crs, crs);
    restore_value(&mut site.scene, scene);
    restore_value(&mut site.planes, planes);
    restore_value(&mut site.walls, walls);
    restore_value(&mut site.areas, areas);
    site.level_px_per_m = *level_px_per_m;
    restore_value(&mut site.measurements, measurements);
    restore_value(&mut site.ground_points, ground_points);
    restore_value(&mut site.solution, solution);
}

/// Copies a value if it differs, to avoid copies of equal values.
fn restore_value<T: Clone + PartialEq>(value: &mut T, known: &T) {
    if value != known {
        value.clone_from(known);
    }
}

/// Whether two sites are equal except for their cameras.
fn is_same_rest(a: &Site, b: &Site) -> bool {
    a.format == b.format
        && a.version == b.version
        && a.name == b.name
        && a.units == b.units
        && a.plan == b.plan
        && a.links == b.links
        && a.marks == b.marks
        && a.distances == b.distances
        && a.georeference == b.georeference
        && a.crs == b.crs
        && a.scene == b.scene
        && a.planes == b.planes
        && a.walls == b.walls
        && a.areas == b.areas
        && a.level_px_per_m == b.level_px_per_m
        && a.measurements == b.measurements
        && a.ground_points == b.ground_points
        && a.solution == b.solution
}

/// Returns a copy of the site without its cameras.
fn without_cameras(site: &Site) -> Site {
    Site {
        cameras: Vec::new(),
        format: site.format,
        version: site.version,
        name: site.name.clone(),
        units: site.units,
        plan: site.plan.clone(),
        links: site.links.clone(),
        marks: site.marks.clone(),
        distances: site.distances.clone(),
        georeference: site.georeference.clone(),
        crs: site.crs.clone(),
        scene: site.scene,
        planes: site.planes.clone(),
        walls: site.walls.clone(),
        areas: site.areas.clone(),
        level_px_per_m: site.level_px_per_m,
        measurements: site.measurements.clone(),
        ground_points: site.ground_points.clone(),
        solution: site.solution.clone(),
    }
}

/// Undo step: a gesture with the state of the site after it.
#[derive(Clone, Debug)]
struct Step {
    /// Name of the gesture, as shown after "Undo", for example "move V2".
    name: String,
    after: Snapshot,
    /// Undecided automatic calibrations after the gesture.
    proposed: Arc<Vec<PendingCalibration>>,
    /// Serial number of the joint result on which the site is based after the gesture, even if edits have made the
    /// result out of date. `None` without a joint result.
    joint: Option<u64>,
}

/// Undo history: all states of the site since it was opened.
#[derive(Clone, Debug)]
pub struct History {
    first: Snapshot,
    /// Serial number of the joint result in the opened file, if any.
    first_joint: Option<u64>,
    /// Empty list of automatic calibrations, for the state before the first step.
    no_calibrations: Arc<Vec<PendingCalibration>>,
    steps: Vec<Step>,
    /// Number of steps that are in effect; later steps were undone.
    done: usize,
}

impl History {
    /// Creates a history whose first state is this site.
    #[must_use]
    pub fn new(site: &Site) -> Self {
        Self {
            first: Snapshot::new(site, None),
            first_joint: None,
            no_calibrations: Arc::default(),
            steps: Vec::new(),
            done: 0,
        }
    }

    /// Returns the state after the last finished gesture.
    fn now(&self) -> &Snapshot {
        self.done.checked_sub(1).and_then(|last| self.steps.get(last)).map_or(&self.first, |step| &step.after)
    }

    /// Returns the site after the last finished gesture.
    #[must_use]
    pub fn site(&self) -> Site {
        self.now().site()
    }

    /// Restores the site to its state after the last finished gesture. Cameras and lists that did not change
    /// are not copied.
    pub fn restore_last(&self, site: &mut Site) {
        let now = self.now();
        site.cameras.truncate(now.cameras.len());
        for (camera, known) in site.cameras.iter_mut().zip(&now.cameras) {
            if *camera != **known {
                camera.clone_from(known);
            }
        }
        let missing = now.cameras.iter().skip(site.cameras.len());
        site.cameras.extend(missing.map(|known| SiteCamera::clone(known)));
        restore_rest(site, &now.rest);
    }

    /// Returns the camera with this index as it was after the last finished gesture.
    #[must_use]
    pub fn camera(&self, index: usize) -> Option<&SiteCamera> {
        self.now().cameras.get(index).map(Arc::as_ref)
    }

    /// Whether the site is in its state after the last finished gesture.
    #[must_use]
    pub fn is_unchanged(&self, site: &Site) -> bool {
        self.now().matches(site)
    }

    /// Stores the site as the state after a gesture, and discards undone steps. Returns false if the gesture
    /// changed nothing.
    pub fn commit(
        &mut self,
        name: impl Into<String>,
        site: &Site,
        proposed: &Arc<Vec<PendingCalibration>>,
    ) -> bool {
        if self.is_unchanged(site) && self.proposed() == proposed {
            return false;
        }
        let after = Snapshot::new(site, Some(self.now()));
        self.steps.truncate(self.done);
        self.steps.push(Step { name: name.into(), after, proposed: Arc::clone(proposed), joint: None });
        self.done += 1;
        true
    }

    /// Joins the last step with the step before it. `name` returns the name of the joined step. Its argument is the
    /// number of cameras that the two steps added together.
    pub(crate) fn join_last(&mut self, name: impl FnOnce(usize) -> String) {
        let Some(before) = self.done.checked_sub(2) else { return };
        let earlier = before.checked_sub(1).map_or(&self.first, |index| &self.steps[index].after);
        let added = self.now().cameras.len().saturating_sub(earlier.cameras.len());
        self.steps.remove(before);
        self.done -= 1;
        self.steps[before].name = name(added);
    }

    /// Returns the undecided automatic calibrations after the last finished gesture.
    #[must_use]
    pub fn proposed(&self) -> &Arc<Vec<PendingCalibration>> {
        let last = self.done.checked_sub(1).and_then(|last| self.steps.get(last));
        last.map_or(&self.no_calibrations, |step| &step.proposed)
    }

    /// Returns the cameras as they were after the last finished gesture.
    #[must_use]
    pub(crate) fn cameras(&self) -> &[Arc<SiteCamera>] {
        &self.now().cameras
    }

    /// Stores the site as the state after the last gesture, so that a consequence of the gesture belongs to
    /// its undo step.
    pub(crate) fn amend(&mut self, site: &Site) {
        if self.is_unchanged(site) {
            return;
        }
        let after = Snapshot::new(site, Some(self.now()));
        if let Some(step) = self.done.checked_sub(1).and_then(|last| self.steps.get_mut(last)) {
            step.after = after;
        }
    }

    /// Returns the serial number of the joint result that the site is derived from, after the last finished
    /// gesture.
    pub(crate) fn joint(&self) -> Option<u64> {
        let last = self.done.checked_sub(1).and_then(|last| self.steps.get(last));
        last.map_or(self.first_joint, |step| step.joint)
    }

    /// Sets the serial number of the joint result that the site is derived from, after the last finished
    /// gesture.
    pub(crate) fn set_joint(&mut self, number: Option<u64>) {
        match self.done.checked_sub(1).and_then(|last| self.steps.get_mut(last)) {
            Some(step) => step.joint = number,
            None => self.first_joint = number,
        }
    }

    /// Returns the name of the step that undo reverts.
    #[must_use]
    pub fn undo_name(&self) -> Option<&str> {
        Some(&self.steps.get(self.done.checked_sub(1)?)?.name)
    }

    /// Returns the name of the step that redo repeats.
    #[must_use]
    pub fn redo_name(&self) -> Option<&str> {
        Some(&self.steps.get(self.done)?.name)
    }

    /// Undoes the last gesture. Returns the site before this gesture, and the name of the step.
    pub fn undo(&mut self) -> Option<(Site, String)> {
        let name = self.undo_name()?.to_owned();
        self.done -= 1;
        Some((self.site(), name))
    }

    /// Repeats the gesture that was undone last. Returns the site after this gesture, and the name of the
    /// step.
    pub fn redo(&mut self) -> Option<(Site, String)> {
        let name = self.redo_name()?.to_owned();
        self.done += 1;
        Some((self.site(), name))
    }

    /// Applies a change to every state of the history, for example when the folder of the images changes.
    pub fn map(&mut self, change: impl Fn(&Site) -> Site) {
        self.first = Snapshot::new(&change(&self.first.site()), None);
        let mut before = self.first.clone();
        for step in &mut self.steps {
            step.after = Snapshot::new(&change(&step.after.site()), Some(&before));
            before = step.after.clone();
        }
    }

    /// Returns the number of gestures that can be undone.
    #[must_use]
    pub const fn depth(&self) -> usize {
        self.done
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn site(count: u32) -> Site {
        let mut site = Site::new();
        site.cameras = (0..count).map(|i| SiteCamera::new(format!("c{i}"), [100 + i, 80])).collect();
        site
    }

    #[test]
    fn undo_to_the_beginning_and_redo_to_the_end_restore_every_state() {
        let states: Vec<Site> = (0..20).map(site).collect();
        let mut history = History::new(&states[0]);
        for (i, state) in states.iter().enumerate().skip(1) {
            assert!(history.commit(format!("step {i}"), state, &Arc::default()));
        }
        for state in states.iter().rev().skip(1) {
            assert_eq!(history.undo().unwrap().0, *state);
        }
        assert!(history.undo().is_none());
        for state in &states[1..] {
            assert_eq!(history.redo().unwrap().0, *state);
        }
    }

    #[test]
    fn restoring_reverts_every_kind_of_change() {
        let (known, history) = (site(4), History::new(&site(4)));
        let gestures: [fn(&mut Site); 5] = [
            |site| site.cameras[1].sigma_px = Some(2.0),
            |site| site.cameras.push(SiteCamera::new("new", [9, 9])),
            |site| drop(site.cameras.remove(0)),
            |site| site.name = Some("hall".into()),
            |site| site.links.push(calib_site::Link::new(None, calib_site::LinkKind::Point, Vec::new())),
        ];
        for gesture in gestures {
            let mut changed = known.clone();
            gesture(&mut changed);
            history.restore_last(&mut changed);
            assert_eq!(changed, known);
        }
    }

    #[test]
    fn gesture_without_a_change_is_no_undo_step() {
        let mut history = History::new(&site(2));
        assert!(!history.commit("nothing", &site(2), &Arc::default()));
        assert_eq!(history.undo_name(), None);
    }

    #[test]
    fn unchanged_cameras_are_shared_between_snapshots() {
        let mut history = History::new(&site(3));
        let mut changed = site(3);
        changed.cameras[1].sigma_px = Some(2.0);
        history.commit("change", &changed, &Arc::default());
        assert!(Arc::ptr_eq(&history.first.cameras[0], &history.now().cameras[0]));
    }
}
