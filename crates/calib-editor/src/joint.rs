//! Results of a joint solve, with the inputs from which they were computed. A result is valid until one of
//! its inputs changes.

use calib_core::{Camera, Plane};

use calib_site::{
    ElementSolution, Link, Mark, PlaneEntry, PlaneSolution, Report, Site, SiteCamera, SiteSolution, Solution,
    Stage,
};

/// Returns the camera without results. A result that the operator entered is kept.
pub(crate) fn without_results(camera: &SiteCamera) -> SiteCamera {
    let given = camera.solution.as_ref().filter(|s| s.method.is_entered()).cloned();
    SiteCamera { solution: given, error: None, ..camera.clone() }
}

/// Removes the results of a site. Results that the operator entered are kept.
pub(crate) fn remove_results(site: &mut Site) {
    for camera in &mut site.cameras {
        camera.solution.take_if(|solution| !solution.method.is_entered());
        camera.error = None;
    }
    site.solution = None;
    // A mark that a solve moved keeps its new position, where the operator continues to edit it.
    site.links.iter_mut().for_each(|link| link.solution = None);
    site.marks.iter_mut().for_each(|mark| mark.solution = None);
    site.planes.iter_mut().for_each(|plane| plane.solution = None);
}

/// Whether two camera entries have equal inputs, so that the result of one is valid for the other.
pub(crate) fn has_same_inputs(known: &SiteCamera, camera: &SiteCamera) -> bool {
    // The fields are compared one by one, to avoid cloning a camera.
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

/// Results of a joint solve, with their inputs.
#[derive(Clone, Debug)]
pub(crate) struct Joint {
    site: Site,
    report: Report,
    /// Pose of each camera of `site`; `None` for a camera that was not solved jointly.
    poses: Vec<Option<Camera>>,
    /// Whether the results were read from a file in which they were out of date. Such a file has no results
    /// about the whole site.
    was_out_of_date: bool,
}

impl Joint {
    /// Creates the joint results from a site and the report of its joint solve.
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

    /// Returns the results that a site file contains, if its cameras were solved jointly.
    pub(crate) fn report_in_file(site: &Site) -> Option<Report> {
        let is_refined = |camera: &SiteCamera| {
            camera.solution.as_ref().is_some_and(|solution| solution.stage == Stage::Refined)
        };
        // A fixed camera has the stage `Refined` even without a joint solve. Only results of links, marks or
        // the whole site prove a joint solve.
        let has_shared = site.solution.is_some()
            || site.links.iter().any(|link| link.solution.is_some())
            || site.marks.iter().any(|mark| mark.solution.is_some());
        (has_shared && site.cameras.iter().any(is_refined)).then(|| stored_report(site))
    }

    /// Returns the report of the joint solve.
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

    /// Returns, for every camera of a site, its index in the solved site. `None` for a camera that was not
    /// solved jointly or whose inputs have changed.
    pub(crate) fn camera_indices(&self, site: &Site) -> Vec<Option<usize>> {
        site.cameras.iter().map(|camera| self.camera_index(site, camera)).collect()
    }

    /// Returns the index of a camera in the solved site if it was solved jointly and its inputs have not
    /// changed.
    fn camera_index(&self, site: &Site, camera: &SiteCamera) -> Option<usize> {
        let place = self.site.cameras.iter().position(|known| known.is_same_period(camera))?;
        let took_part = self.poses.get(place)?.is_some();
        let is_same = self.site.scene == site.scene
            && has_same_planes(&self.site.planes, &site.planes)
            && has_same_inputs(&self.site.cameras[place], camera);
        (took_part && is_same).then_some(place)
    }

    /// Whether the joint result is still valid for any camera of a site.
    pub(crate) fn applies_to_any(&self, site: &Site) -> bool {
        site.cameras.iter().any(|camera| self.camera_index(site, camera).is_some())
    }

    /// Whether no input of the joint result has changed in a site. The inputs are the solved cameras, the
    /// cameras that share their lenses, the scene, the planes, the scale of the plan, the map grid and the
    /// georeference. They also include all links, marks and distances that connect cameras.
    pub(crate) fn is_current_for(&self, site: &Site) -> bool {
        !self.was_out_of_date
            && self.solved_cameras().all(|known| self.has_same_family(site, known))
            && self.site.plan.as_ref().map(calib_site::Plan::scale)
                == site.plan.as_ref().map(calib_site::Plan::scale)
            && self.site.map_inputs() == site.map_inputs()
            && self.site.scene == site.scene
            && has_same_planes(&self.site.planes, &site.planes)
            && connections(&self.site) == connections(site)
    }

    /// Whether a camera with this id was solved jointly.
    pub(crate) fn includes_camera(&self, id: &str) -> bool {
        self.solved_cameras().any(|camera| camera.id == id)
    }

    /// Returns the cameras that were solved jointly, as they were at the solve.
    fn solved_cameras(&self) -> impl Iterator<Item = &SiteCamera> {
        self.site.cameras.iter().zip(&self.poses).filter(|(_, pose)| pose.is_some()).map(|(camera, _)| camera)
    }

    /// Whether the inputs of a camera, and of all cameras that share its lens, are unchanged in a site.
    fn has_same_family(&self, site: &Site, known: &SiteCamera) -> bool {
        let owner = lens_owner(known);
        let family =
            |site: &'_ Site| site.cameras.iter().filter(|camera| lens_owner(camera) == owner).count();
        let is_same = |own: &&SiteCamera| {
            site.cameras.iter().any(|now| own.is_same_period(now) && has_same_inputs(own, now))
        };
        let sharing = self.site.cameras.iter().filter(|camera| lens_owner(camera) == owner);
        sharing.filter(is_same).count() == family(&self.site) && family(&self.site) == family(site)
    }

    /// Copies the plane solutions into `planes` if the inputs of all planes have not changed since the solve.
    pub(crate) fn write_planes(&self, planes: &mut [PlaneEntry]) {
        let same = has_same_planes(&self.site.planes, planes);
        for (index, plane) in planes.iter_mut().enumerate() {
            plane.solution = self.report.planes.get(index).copied().flatten().filter(|_| same);
        }
    }

    /// Returns the solution of the plane with this id if the inputs of all planes have not changed since the
    /// solve.
    pub(crate) fn plane(&self, site: &Site, id: &str) -> Option<Plane> {
        let index = site.planes.iter().position(|plane| plane.id == id)?;
        let found = self.report.planes.get(index).copied().flatten();
        let PlaneSolution { height_m, slope, .. } =
            found.filter(|_| has_same_planes(&self.site.planes, &site.planes))?;
        Some(Plane { height: height_m, slope, anchor: site.planes[index].anchor() })
    }

    /// Returns the solution of the link with this index if the link has not changed since the solve.
    pub(crate) fn link(&self, site: &Site, link: usize) -> Option<&ElementSolution> {
        let now = site.links.get(link)?;
        let place = self.site.links.iter().position(|known| has_same_link_inputs(known, now))?;
        self.report.links.get(place)?.as_ref()
    }

    /// Returns the solution of a mark if the mark has not changed since the solve.
    fn mark(&self, now: &Mark) -> Option<&ElementSolution> {
        let place = self.site.marks.iter().position(|known| has_same_mark_inputs(known, now))?;
        self.report.marks.get(place)?.as_ref()
    }

    /// Writes the solutions of unchanged links and marks into a site. Results about the whole site are
    /// written if they are current.
    pub(crate) fn write_shared(&self, site: &mut Site, is_current: bool) {
        for index in 0..site.links.len() {
            site.links[index].solution = self.link(site, index).cloned();
        }
        for mark in &mut site.marks {
            mark.solution = self.mark(mark).cloned();
        }
        self.write_planes(&mut site.planes);
        site.solution = Some(self.report.site.clone()).filter(|whole| is_current && !whole.is_empty());
    }
}

/// Returns the id of the camera whose lens a camera uses: another camera, or the camera itself.
fn lens_owner(camera: &SiteCamera) -> &str {
    camera.lens.as_ref().and_then(|lens| lens.like.as_deref()).unwrap_or(&camera.id)
}

/// Whether two links have equal inputs.
fn has_same_link_inputs(a: &Link, b: &Link) -> bool {
    let Link {
        id,
        name: _,
        off,
        keep,
        kind,
        height_m,
        plane,
        length_m,
        lat_deg,
        lon_deg,
        crs_m,
        alt_m,
        sigma_m,
        seen,
        solution: _,
    } = a;
    *id == b.id
        && (*lat_deg, *lon_deg, *crs_m, *alt_m, *sigma_m)
            == (b.lat_deg, b.lon_deg, b.crs_m, b.alt_m, b.sigma_m)
        && (*off, *keep, *kind, *height_m) == (b.off, b.keep, b.kind, b.height_m)
        && (*length_m, plane) == (b.length_m, &b.plane)
        && *seen == b.seen
}

/// Whether two lists of planes have equal inputs.
pub(crate) fn has_same_planes(known: &[PlaneEntry], now: &[PlaneEntry]) -> bool {
    let is_same = |(a, b): (&PlaneEntry, &PlaneEntry)| {
        let PlaneEntry { id, name: _, height_m, tilt, region, solution: _ } = a;
        (id, region) == (&b.id, &b.region) && (*height_m, *tilt) == (b.height_m, b.tilt)
    };
    known.len() == now.len() && known.iter().zip(now).all(is_same)
}

/// Whether two marks have equal inputs.
fn has_same_mark_inputs(a: &Mark, b: &Mark) -> bool {
    let Mark {
        id,
        name: _,
        off,
        keep,
        kind,
        at_m,
        lat_deg,
        lon_deg,
        crs_m,
        alt_m,
        sigma_m,
        turn_deg,
        size_m,
        fixed,
        seen,
        solution: _,
    } = a;
    *id == b.id
        && (*lat_deg, *lon_deg, *crs_m) == (b.lat_deg, b.lon_deg, b.crs_m)
        && (*alt_m, *sigma_m) == (b.alt_m, b.sigma_m)
        && (*off, *keep, *kind, *fixed) == (b.off, b.keep, b.kind, b.fixed)
        && *at_m == b.at_m
        && (*turn_deg, size_m, seen) == (b.turn_deg, &b.size_m, &b.seen)
}

/// Links, marks and distances that connect cameras. A link in one view counts only if a distance to it is measured or
/// if it has map coordinates. A mark without pins counts only if a distance to it is measured.
#[derive(Debug)]
struct Connections<'a> {
    links: Vec<&'a Link>,
    marks: Vec<&'a Mark>,
    distances: Vec<&'a calib_site::Distance>,
}

impl PartialEq for Connections<'_> {
    fn eq(&self, other: &Self) -> bool {
        let same = |a: &calib_site::Distance, b: &calib_site::Distance| {
            a.between == b.between && a.length_m == b.length_m && a.keep == b.keep
        };
        self.links.len() == other.links.len()
            && self.marks.len() == other.marks.len()
            && self.distances.len() == other.distances.len()
            && self.links.iter().zip(&other.links).all(|(a, b)| has_same_link_inputs(a, b))
            && self.marks.iter().zip(&other.marks).all(|(a, b)| has_same_mark_inputs(a, b))
            && self.distances.iter().zip(&other.distances).all(|(a, b)| same(a, b))
    }
}

/// Returns the links, marks and distances of a site that connect cameras.
fn connections(site: &Site) -> Connections<'_> {
    let distances: Vec<_> = site.distances.iter().filter(|distance| !distance.off).collect();
    let is_measured =
        |id: &Option<String>| id.as_ref().is_some_and(|id| distances.iter().any(|d| d.between.contains(id)));
    let is_surveyed = |link: &Link| link.lat_deg.is_some() || link.crs_m.is_some();
    let is_tie =
        |link: &&Link| !link.off && (link.seen.len() > 1 || is_measured(&link.id) || is_surveyed(link));
    let is_pinned = |mark: &&Mark| !mark.off && (!mark.seen.is_empty() || is_measured(&mark.id));
    let links = site.links.iter().filter(is_tie).collect();
    let marks = site.marks.iter().filter(is_pinned).collect();
    Connections { links, marks, distances }
}

/// Returns the results in a site as a report.
pub(crate) fn stored_report(site: &Site) -> Report {
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
        // A site file contains findings only as text, in its warnings.
        findings: Vec::new(),
        site_findings: Vec::new(),
    }
}
