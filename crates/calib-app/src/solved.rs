//! The results of the site: recomputed where what they follow from differs, never edited.

use calib_core::{
    Camera, FailureCode, FailureEntry, Finding, LensCache, Names, Options, Pixel, Placement, Plan, Report,
    Site, SiteCamera, Solution, Stage, Warning,
};
use web_time::Instant;

/// What one camera's own result follows from.
#[derive(Clone, Debug, PartialEq)]
struct Input {
    camera: SiteCamera,
    /// The camera whose lens it shares.
    like: Option<SiteCamera>,
    plan: Option<Plan>,
}

impl Input {
    fn of(site: &Site, camera: &SiteCamera) -> Self {
        let like = camera.lens.as_ref().and_then(|lens| lens.like.as_deref());
        let like = like.and_then(|id| site.camera(id)).map(unsolved);
        Self { camera: unsolved(camera), like, plan: site.plan.clone() }
    }

    fn is(&self, site: &Site, camera: &SiteCamera) -> bool {
        same_input(&self.camera, camera)
            && self.plan == site.plan
            && match (&self.like, camera.lens.as_ref().and_then(|lens| lens.like.as_deref())) {
                (None, None) => true,
                (Some(known), Some(id)) => site.camera(id).is_some_and(|like| same_input(known, like)),
                _ => false,
            }
    }

    /// The result, and the lenses that need not be fitted again where the edges stay.
    fn solve(&self, before: &LensCache) -> (Result<Solution, FailureEntry>, Vec<Finding>, LensCache) {
        let cameras = std::iter::once(self.camera.clone()).chain(self.like.clone()).collect();
        let site = Site { cameras, plan: self.plan.clone(), ..Site::new() };
        let options =
            Options { refine: false, cameras: Some(vec![self.camera.id.clone()]), ..Options::default() };
        let lenses = site.lenses(before);
        let report = site.calibrate_with_lenses(&lenses, &options);
        let first = report.cameras.into_iter().find(|(index, _)| *index == 0).map(|(_, result)| result);
        let result = first.unwrap_or_else(|| {
            Err(FailureEntry {
                code: FailureCode::NoSolution,
                message: "The camera was not solved.".into(),
                advice: String::new(),
            })
        });
        let findings = report.findings.into_iter().next().and_then(Result::ok).unwrap_or_default();
        (result, findings, lenses)
    }
}

/// The camera as drawn and entered; a given result is entered.
fn unsolved(camera: &SiteCamera) -> SiteCamera {
    let given = camera.solution.as_ref().filter(|s| s.method == calib_core::Method::Given).cloned();
    SiteCamera { solution: given, error: None, ..camera.clone() }
}

fn same_input(known: &SiteCamera, camera: &SiteCamera) -> bool {
    // Field by field, so that no camera is cloned to be compared.
    known.id == camera.id
        && known.size_px == camera.size_px
        && known.lens == camera.lens
        && known.height_m == camera.height_m
        && known.sigma_px == camera.sigma_px
        && known.annotations == camera.annotations
        && known.efov_px == camera.efov_px
        && known.placement == camera.placement
        && known.control_points == camera.control_points
}

/// One camera's result.
#[derive(Clone, Debug)]
struct Entry {
    input: Input,
    result: Result<Solution, FailureEntry>,
    findings: Vec<Finding>,
    pose: Option<Camera>,
    lenses: LensCache,
}

/// The results of a joint solve, for as long as the site is what it was then.
#[derive(Clone, Debug)]
struct Joint {
    site: Site,
    report: Report,
    poses: Vec<Option<Camera>>,
}

/// Every camera's result, in the order of the site.
#[derive(Clone, Debug, Default)]
pub struct Solved {
    entries: Vec<Entry>,
    joint: Vec<Joint>,
    /// Which of the joint results is the site's.
    current: Option<usize>,
    /// How long the last solve took, in milliseconds.
    pub milliseconds: f64,
    /// Solving waits.
    pub paused: bool,
}

/// How many joint results are kept, so that undo finds them again.
const MOST_JOINT: usize = 16;

impl Solved {
    /// Solves what differs from what was solved before. Whether anything did.
    pub fn update(&mut self, site: &Site) -> bool {
        if self.paused {
            self.realign(site);
            return false;
        }
        self.current = self.joint.iter().rposition(|joint| is_same_site(&joint.site, site));
        let before = self.entries.len();
        self.entries.truncate(site.cameras.len());
        let mut changed = before != self.entries.len();
        let start = Instant::now();
        for (index, camera) in site.cameras.iter().enumerate() {
            if self.entries.get(index).is_some_and(|entry| entry.input.is(site, camera)) {
                continue;
            }
            let entry = self.solve(site, camera);
            match self.entries.get_mut(index) {
                Some(known) => *known = entry,
                None => self.entries.push(entry),
            }
            changed = true;
        }
        if changed {
            self.milliseconds = start.elapsed().as_secs_f64() * 1e3;
        }
        changed
    }

    /// While nothing is solved, results stay with their cameras, whichever were added or removed.
    fn realign(&mut self, site: &Site) {
        let is_aligned = self.entries.len() == site.cameras.len()
            && self
                .entries
                .iter()
                .zip(&site.cameras)
                .all(|(entry, camera)| entry.input.camera.id == camera.id);
        if is_aligned {
            return;
        }
        let waits = |camera: &SiteCamera| Entry {
            input: Input::of(site, &SiteCamera::new(camera.id.clone(), camera.size_px)),
            result: Err(FailureEntry {
                code: FailureCode::NoSolution,
                message: "Solving is paused.".into(),
                advice: "Resume it to have this camera solved.".into(),
            }),
            findings: Vec::new(),
            pose: None,
            lenses: LensCache::default(),
        };
        let known =
            |camera: &SiteCamera| self.entries.iter().find(|entry| entry.input.camera.id == camera.id);
        self.entries = site
            .cameras
            .iter()
            .map(|camera| known(camera).cloned().unwrap_or_else(|| waits(camera)))
            .collect();
        self.current = None;
    }

    fn solve(&self, site: &Site, camera: &SiteCamera) -> Entry {
        let input = Input::of(site, camera);
        // Cameras that moved in the list, or came back by undo, are known already.
        if let Some(known) = self.entries.iter().find(|entry| entry.input == input) {
            return known.clone();
        }
        let same = |entry: &&Entry| entry.input.camera.id == camera.id;
        let before = self.entries.iter().find(same).map(|entry| &entry.lenses);
        let (result, findings, lenses) = input.solve(before.unwrap_or(&LensCache::default()));
        let pose = result.as_ref().ok().and_then(Solution::camera);
        Entry { input, result, findings, pose, lenses }
    }

    /// Keeps the results of a joint solve as those of this site.
    pub fn keep_joint(&mut self, site: &Site, report: Report) {
        let mut poses = vec![None; site.cameras.len()];
        for (index, result) in &report.cameras {
            if let Some(pose) = poses.get_mut(*index) {
                *pose = result.as_ref().ok().and_then(Solution::camera);
            }
        }
        if self.joint.len() >= MOST_JOINT {
            self.joint.remove(0);
        }
        self.joint.push(Joint { site: site.clone(), report, poses });
        self.current = Some(self.joint.len() - 1);
    }

    fn joint(&self) -> Option<&Joint> {
        self.joint.get(self.current?)
    }

    /// What a joint solve found out about the site as it is now.
    #[must_use]
    pub fn joint_report(&self) -> Option<&Report> {
        self.joint().map(|joint| &joint.report)
    }

    /// The lenses that were fitted for a camera.
    #[must_use]
    pub fn lenses(&self, index: usize) -> LensCache {
        self.entries.get(index).map(|entry| entry.lenses.clone()).unwrap_or_default()
    }

    /// A camera's result.
    #[must_use]
    pub fn result(&self, index: usize) -> Option<Result<&Solution, &FailureEntry>> {
        if let Some(joint) = self.joint()
            && let Some((_, result)) = joint.report.cameras.iter().find(|(camera, _)| *camera == index)
        {
            return Some(result.as_ref());
        }
        self.entries.get(index).map(|entry| entry.result.as_ref())
    }

    /// A camera's solution.
    #[must_use]
    pub fn solution(&self, index: usize) -> Option<&Solution> {
        self.result(index)?.ok()
    }

    /// What was found that a warning of a camera tells; `None` of a warning that a file brought along.
    #[must_use]
    pub fn finding(&self, site: &Site, index: usize, warning: &Warning) -> Option<&Finding> {
        // The results of a joint solve come as a document, which has the words alone.
        let told = |finding: &&Finding| {
            finding.code() == warning.code && site.in_english(Some(index), finding, Names::InFile) == *warning
        };
        self.entries.get(index)?.findings.iter().find(told)
    }

    /// A camera's pose and lens.
    #[must_use]
    pub fn pose(&self, index: usize) -> Option<&Camera> {
        match self.joint() {
            Some(joint) => joint.poses.get(index)?.as_ref(),
            None => self.entries.get(index)?.pose.as_ref(),
        }
    }

    /// The pose of a camera that stands where it belongs.
    #[must_use]
    pub fn placed(&self, index: usize) -> Option<&Camera> {
        let stage = self.solution(index)?.stage;
        self.pose(index).filter(|_| stage >= Stage::Placed)
    }

    /// The site with its results, as it is saved.
    #[must_use]
    pub fn write_into(&self, site: &Site) -> Site {
        if let Some(report) = self.joint_report() {
            return report.write_into(site);
        }
        let mut solved = site.clone();
        for (index, camera) in solved.cameras.iter_mut().enumerate() {
            (camera.solution, camera.error) = match self.result(index) {
                Some(Ok(solution)) => (Some(solution.clone()), None),
                Some(Err(failure)) => (None, Some(failure.clone())),
                None => (camera.solution.take(), camera.error.take()),
            };
        }
        solved
    }
}

fn is_same_site(known: &Site, site: &Site) -> bool {
    known.cameras.len() == site.cameras.len()
        && known.cameras.iter().zip(&site.cameras).all(|(a, b)| same_input(a, b))
        && known.plan == site.plan
        && known.links == site.links
        && known.marks == site.marks
        && known.distances == site.distances
}

/// A corner where `after` shows it unplaced, and where `before` shows it.
type Pair = ([f64; 2], [f64; 2]);

/// The placement with which the polygon of `after` lies nearest to where that of `before` lies.
///
/// Least squares of a similarity, as complex numbers `b = move + scale e^(i turn) a` over the corners.
#[must_use]
pub fn keep_polygon(before: &Camera, after: &Camera, corners: &[Pixel]) -> Option<Placement> {
    /// Beyond so many camera heights a corner weighs more than it knows.
    const REACH: f64 = 30.0;
    let unplaced = Placement::NONE.apply(after);
    let pairs: Vec<Pair> = corners
        .iter()
        .filter_map(|&pixel| {
            let (a, b) = (unplaced.pixel_to_floor(pixel, 0.0)?, before.pixel_to_floor(pixel, 0.0)?);
            (a.x.hypot(a.y) < REACH * calib_core::STAGE_1_HEIGHT).then(|| (a.into(), b.into()))
        })
        .collect();
    if pairs.len() < 2 {
        return None;
    }
    let count = pairs.len() as f64;
    let mean = |of: fn(&Pair) -> f64| pairs.iter().map(of).sum::<f64>() / count;
    let (ax, ay) = (mean(|p| p.0[0]), mean(|p| p.0[1]));
    let (bx, by) = (mean(|p| p.1[0]), mean(|p| p.1[1]));
    let (mut re, mut im, mut square) = (0.0, 0.0, 0.0);
    for (a, b) in &pairs {
        let (a, b) = ([a[0] - ax, a[1] - ay], [b[0] - bx, b[1] - by]);
        re += a[0] * b[0] + a[1] * b[1];
        im += a[0] * b[1] - a[1] * b[0];
        square += a[0] * a[0] + a[1] * a[1];
    }
    let (c, s) = (re / square, im / square);
    let scale = c.hypot(s);
    let by = calib_core::FloorPoint::new(bx - (c * ax - s * ay), by - (s * ax + c * ay));
    (scale.is_finite() && scale > 1e-6 && by.is_finite()).then(|| Placement { by, turn: s.atan2(c), scale })
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::{Covariance, Lens, WorldPoint};

    #[test]
    fn a_polygon_whose_camera_did_not_change_keeps_its_placement() {
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
        let own = Placement::of(&camera);
        assert!(kept.by.distance(own.by) < 1e-9 && (kept.turn - own.turn).abs() < 1e-9);
        assert!((kept.scale - own.scale).abs() < 1e-9);
    }
}
