//! The results of a joint solve: they stay until what they follow from differs, and say when it does.

use calib_core::{Camera, Plane};

use calib_site::{
    ElementSolution, Link, Mark, PlaneEntry, PlaneSolution, Report, Site, SiteCamera, SiteSolution, Solution,
    Stage,
};

/// The camera as drawn and entered; a given result is entered.
pub(crate) fn unsolved(camera: &SiteCamera) -> SiteCamera {
    let given = camera.solution.as_ref().filter(|s| s.method.is_entered()).cloned();
    SiteCamera { solution: given, error: None, ..camera.clone() }
}

/// The site as drawn and entered: results are found again, what was entered as a result stays.
pub(crate) fn forget_results(site: &mut Site) {
    for camera in &mut site.cameras {
        camera.solution.take_if(|solution| !solution.method.is_entered());
        camera.error = None;
    }
    site.solution = None;
    // A mark that was moved by a solve stays where that put it: here it is dragged on from there.
    site.links.iter_mut().for_each(|link| link.solution = None);
    site.marks.iter_mut().for_each(|mark| mark.solution = None);
    site.planes.iter_mut().for_each(|plane| plane.solution = None);
}

/// Whether a result of one follows from the other just as well.
pub(crate) fn same_input(known: &SiteCamera, camera: &SiteCamera) -> bool {
    // Field by field, so that no camera is cloned to be compared.
    known.id == camera.id
        && known.size_px == camera.size_px
        && known.lens == camera.lens
        && known.height_m == camera.height_m
        && known.sigma_px == camera.sigma_px
        && known.scene == camera.scene
        && known.annotations == camera.annotations
        && known.efov_px == camera.efov_px
        && known.efov_plane == camera.efov_plane
        && known.placement == camera.placement
        && known.control_points == camera.control_points
}

/// The results of a joint solve, with what they follow from.
#[derive(Clone, Debug)]
pub(crate) struct Joint {
    site: Site,
    report: Report,
    /// In the order of its own site; none of a camera that took no part.
    poses: Vec<Option<Camera>>,
    /// A file brought it along, and not what was found out about the site as a whole: it was out of date.
    was_out_of_date: bool,
}

impl Joint {
    /// The results of this site.
    pub(crate) fn new(site: &Site, report: Report) -> Self {
        let mut poses = vec![None; site.cameras.len()];
        for (index, result) in &report.cameras {
            let refined = result.as_ref().ok().filter(|solution| solution.stage == Stage::Refined);
            if let Some(pose) = poses.get_mut(*index) {
                *pose = refined.and_then(Solution::camera);
            }
        }
        let was_out_of_date = report.site == SiteSolution::default();
        Self { site: site.clone(), report, poses, was_out_of_date }
    }

    /// The results that a file brings along, if its cameras were solved together.
    pub(crate) fn of_file(site: &Site) -> Option<Report> {
        let is_refined = |camera: &SiteCamera| {
            camera.solution.as_ref().is_some_and(|solution| solution.stage == Stage::Refined)
        };
        // A camera that is held counts as refined by itself: only what was found of things in common tells.
        let has_shared = site.solution.is_some()
            || site.links.iter().any(|link| link.solution.is_some())
            || site.marks.iter().any(|mark| mark.solution.is_some());
        (has_shared && site.cameras.iter().any(is_refined)).then(|| report_of(site))
    }

    pub(crate) const fn report(&self) -> &Report {
        &self.report
    }

    pub(crate) fn pose(&self, place: usize) -> Option<&Camera> {
        self.poses.get(place)?.as_ref()
    }

    pub(crate) fn solution(&self, place: usize) -> Option<&Solution> {
        let (_, result) = self.report.cameras.iter().find(|(camera, _)| *camera == place)?;
        result.as_ref().ok()
    }

    /// For every camera of a site its place here, where it took part and what is entered of it is the same.
    pub(crate) fn places(&self, site: &Site) -> Vec<Option<usize>> {
        site.cameras.iter().map(|camera| self.place_of(site, camera)).collect()
    }

    fn place_of(&self, site: &Site, camera: &SiteCamera) -> Option<usize> {
        let place = self.site.cameras.iter().position(|known| known.is_same_period(camera))?;
        let took_part = self.poses.get(place)?.is_some();
        let is_same = self.site.scene == site.scene
            && same_planes(&self.site.planes, &site.planes)
            && same_input(&self.site.cameras[place], camera);
        (took_part && is_same).then_some(place)
    }

    /// Whether any camera of a site still has its result here.
    pub(crate) fn is_of_any(&self, site: &Site) -> bool {
        site.cameras.iter().any(|camera| self.place_of(site, camera).is_some())
    }

    /// Whether all that the results follow from is the same in a site: the cameras that took part, the owners
    /// of their lenses, the plan's scale, and whatever ties cameras together.
    pub(crate) fn holds_for(&self, site: &Site) -> bool {
        !self.was_out_of_date
            && self.took_part().all(|known| self.has_same(site, known))
            && self.site.plan.as_ref().map(calib_site::Plan::scale)
                == site.plan.as_ref().map(calib_site::Plan::scale)
            && self.site.scene == site.scene
            && same_planes(&self.site.planes, &site.planes)
            && ties(&self.site) == ties(site)
    }

    /// Whether a camera of this id took part.
    pub(crate) fn had(&self, id: &str) -> bool {
        self.took_part().any(|camera| camera.id == id)
    }

    fn took_part(&self) -> impl Iterator<Item = &SiteCamera> {
        self.site.cameras.iter().zip(&self.poses).filter(|(_, pose)| pose.is_some()).map(|(camera, _)| camera)
    }

    /// Whether a camera that took part, and all with which it shares a lens, are the same in a site.
    fn has_same(&self, site: &Site, known: &SiteCamera) -> bool {
        let owner = lens_owner(known);
        let family =
            |site: &'_ Site| site.cameras.iter().filter(|camera| lens_owner(camera) == owner).count();
        let is_same = |own: &&SiteCamera| {
            site.cameras.iter().any(|now| own.is_same_period(now) && same_input(own, now))
        };
        let sharing = self.site.cameras.iter().filter(|camera| lens_owner(camera) == owner);
        sharing.filter(is_same).count() == family(&self.site) && family(&self.site) == family(site)
    }

    /// Puts what was found of planes into them, while what is known of planes is what it was then.
    pub(crate) fn put_planes(&self, planes: &mut [PlaneEntry]) {
        let same = same_planes(&self.site.planes, planes);
        for (index, plane) in planes.iter_mut().enumerate() {
            plane.solution = self.report.planes.get(index).copied().flatten().filter(|_| same);
        }
    }

    /// Where a plane was found, while what is known of planes is what it was then.
    pub(crate) fn plane(&self, site: &Site, id: &str) -> Option<Plane> {
        let index = site.planes.iter().position(|plane| plane.id == id)?;
        let found = self.report.planes.get(index).copied().flatten();
        let PlaneSolution { height_m, slope, .. } =
            found.filter(|_| same_planes(&self.site.planes, &site.planes))?;
        Some(Plane { height: height_m, slope, anchor: site.planes[index].anchor() })
    }

    /// What was found out about a link that is what it was then.
    pub(crate) fn link(&self, site: &Site, link: usize) -> Option<&ElementSolution> {
        let now = site.links.get(link)?;
        let place = self.site.links.iter().position(|known| same_link(known, now))?;
        self.report.links.get(place)?.as_ref()
    }

    fn mark(&self, now: &Mark) -> Option<&ElementSolution> {
        let place = self.site.marks.iter().position(|known| same_mark(known, now))?;
        self.report.marks.get(place)?.as_ref()
    }

    /// Writes what was found out about links and marks; about the site as a whole while it holds.
    pub(crate) fn write_shared(&self, site: &mut Site, is_current: bool) {
        for index in 0..site.links.len() {
            site.links[index].solution = self.link(site, index).cloned();
        }
        for mark in &mut site.marks {
            mark.solution = self.mark(mark).cloned();
        }
        self.put_planes(&mut site.planes);
        site.solution = Some(self.report.site.clone()).filter(|whole| is_current && !whole.is_empty());
    }
}

/// The id of the camera whose lens a camera has.
fn lens_owner(camera: &SiteCamera) -> &str {
    camera.lens.as_ref().and_then(|lens| lens.like.as_deref()).unwrap_or(&camera.id)
}

fn same_link(a: &Link, b: &Link) -> bool {
    let Link { id, name: _, off, keep, kind, height_m, plane, length_m, seen, solution: _ } = a;
    *id == b.id
        && (*off, *keep, *kind, *height_m) == (b.off, b.keep, b.kind, b.height_m)
        && (*length_m, plane) == (b.length_m, &b.plane)
        && *seen == b.seen
}

/// Whether what is known of planes is the same.
pub(crate) fn same_planes(known: &[PlaneEntry], now: &[PlaneEntry]) -> bool {
    let is_same = |(a, b): (&PlaneEntry, &PlaneEntry)| {
        let PlaneEntry { id, name: _, height_m, tilt, region, solution: _ } = a;
        (id, region) == (&b.id, &b.region) && (*height_m, *tilt) == (b.height_m, b.tilt)
    };
    known.len() == now.len() && known.iter().zip(now).all(is_same)
}

fn same_mark(a: &Mark, b: &Mark) -> bool {
    let Mark { id, name: _, off, keep, kind, at_m, turn_deg, size_m, fixed, seen, solution: _ } = a;
    *id == b.id
        && (*off, *keep, *kind, *fixed) == (b.off, b.keep, b.kind, b.fixed)
        && *at_m == b.at_m
        && (*turn_deg, size_m, seen) == (b.turn_deg, &b.size_m, &b.seen)
}

/// What ties cameras together. What one camera alone shows, and a mark that is not tied to any pixel, tie nothing
/// unless a distance is measured to it.
#[derive(Debug)]
struct Ties<'a> {
    links: Vec<&'a Link>,
    marks: Vec<&'a Mark>,
    distances: Vec<&'a calib_site::Distance>,
}

impl PartialEq for Ties<'_> {
    fn eq(&self, other: &Self) -> bool {
        let same = |a: &calib_site::Distance, b: &calib_site::Distance| {
            a.between == b.between && a.length_m == b.length_m && a.keep == b.keep
        };
        self.links.len() == other.links.len()
            && self.marks.len() == other.marks.len()
            && self.distances.len() == other.distances.len()
            && self.links.iter().zip(&other.links).all(|(a, b)| same_link(a, b))
            && self.marks.iter().zip(&other.marks).all(|(a, b)| same_mark(a, b))
            && self.distances.iter().zip(&other.distances).all(|(a, b)| same(a, b))
    }
}

fn ties(site: &Site) -> Ties<'_> {
    let distances: Vec<_> = site.distances.iter().filter(|distance| !distance.off).collect();
    let is_measured =
        |id: &Option<String>| id.as_ref().is_some_and(|id| distances.iter().any(|d| d.between.contains(id)));
    let is_tie = |link: &&Link| !link.off && (link.seen.len() > 1 || is_measured(&link.id));
    let is_pinned = |mark: &&Mark| !mark.off && (!mark.seen.is_empty() || is_measured(&mark.id));
    let links = site.links.iter().filter(is_tie).collect();
    let marks = site.marks.iter().filter(is_pinned).collect();
    Ties { links, marks, distances }
}

/// The results that are written into a site.
pub(crate) fn report_of(site: &Site) -> Report {
    let result = |camera: &SiteCamera| match (&camera.solution, &camera.error) {
        (Some(solution), _) => Some(Ok(solution.clone())),
        (None, error) => error.clone().map(Err),
    };
    let cameras = site.cameras.iter().enumerate();
    Report {
        cameras: cameras.filter_map(|(index, camera)| Some((index, result(camera)?))).collect(),
        links: site.links.iter().map(|link| link.solution.clone()).collect(),
        marks: site.marks.iter().map(|mark| mark.solution.clone()).collect(),
        planes: site.planes.iter().map(|plane| plane.solution).collect(),
        site: site.solution.clone().unwrap_or_default(),
        // A file has words alone.
        findings: Vec::new(),
        site_findings: Vec::new(),
    }
}
