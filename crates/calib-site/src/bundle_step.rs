//! Bundle adjustment of a site: converts cameras and shared observations to its input, and its result to the
//! indices of the site.

use std::collections::HashMap;

use crate::document::{FixedEntry, Site, SiteCamera};
use crate::observations::{LandmarkSource, SiteObservations, UnusedEvidence};
use crate::options::Options;
use crate::points_step::{UsedPoints, unplaced};
use crate::single_step::{SharedInputs, SingleFit};
use crate::solution::Stage;
use calib_core::bundle::{
    BundleAdjustment, BundleCamera, BundleSummary, CameraEstimate, Component, CrossCovariance,
    DistanceMeasurement, FixedPose, InitialPose, Landmark, OutlierCandidate, PlaneEstimate, Reliability,
};
use calib_core::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
use calib_core::floor::STAGE_1_HEIGHT;
use calib_core::outcome::{Failure, Source};
use calib_core::single::{FixedParameters, PlanePrior, Priors};

/// Result of the bundle adjustment of a site.
#[derive(Clone, Debug, Default)]
pub(crate) struct BundleResult {
    /// Estimates of the participating cameras, by index in the site. Cameras that are not connected keep
    /// their pose of stage 1, with a better lens.
    pub(crate) cameras: Vec<Option<CameraEstimate>>,
    /// Landmarks with their source in the site, at their estimated positions. Rejected landmarks are switched
    /// off.
    pub(crate) landmarks: Vec<(LandmarkSource, Landmark)>,
    /// Reliability of the used annotations of every camera.
    pub(crate) annotation_reliabilities: Vec<Vec<(Source, Reliability)>>,
    /// Reliability of the observations of every landmark, each with the index of its camera.
    pub(crate) landmark_reliabilities: Vec<Vec<(usize, Reliability)>>,
    /// Covariance of the parameters of every landmark; `None` if it is not refined.
    pub(crate) covariances: Vec<Option<[[f64; 3]; 3]>>,
    /// Measured distances, each with its index in the site.
    pub(crate) measurements: Vec<(usize, DistanceMeasurement)>,
    /// Rejected landmarks and distances, by their indices in `landmarks` and `measurements`.
    pub(crate) rejected: Vec<OutlierCandidate>,
    pub(crate) components: Vec<Component>,
    /// Indices of the cameras with too few shared observations to be placed.
    pub(crate) unplaced: Vec<usize>,
    /// Indices of the cameras with too many shared observations to be solved jointly.
    pub(crate) too_many: Vec<usize>,
    /// Indices of the cameras without a pose from which all their shared observations are visible.
    pub(crate) unsolved: Vec<usize>,
    /// Indices of unused landmarks: their triangulated position is not visible in one of the observing
    /// cameras.
    pub(crate) unobservable: Vec<usize>,
    /// Landmarks and distances that constrain no camera.
    pub(crate) unused: UnusedEvidence,
    /// Estimate of every plane; `None` if the plane is fixed or not used.
    pub(crate) planes: Vec<Option<PlaneEstimate>>,
    /// Largest root mean square disagreement of two cameras on the floor, in metres, after the initialisation of the
    /// poses. Only pairs that share landmarks but no edge of the spanning tree count. `None` if the view graph has no
    /// loops.
    pub(crate) loop_closure: Option<f64>,
    /// Cross-covariances of jointly refined pairs of cameras.
    pub(crate) pairs: HashMap<[usize; 2], CrossCovariance>,
    /// Indices of the marks that only one camera observes and whose points determine this camera in stage 1.
    pub(crate) single_marks: Vec<usize>,
}

/// Placeholder for a camera without a result; it has no observations.
pub(crate) const ABSENT: Camera = Camera {
    position: WorldPoint { x: 0.0, y: 0.0, z: STAGE_1_HEIGHT },
    yaw: 0.0,
    pitch: 0.0,
    roll: 0.0,
    focal: 1.0,
    lens: Lens::pinhole(Pixel { u: 0.0, v: 0.0 }),
    covariance: Covariance::EXACT,
};

/// Participating camera: its entry and its result of stage 1.
struct Member<'a> {
    entry: &'a SiteCamera,
    single: &'a SingleFit,
    /// Camera with the pose of stage 1.
    own: Camera,
}

impl BundleResult {
    /// Returns all cameras at their refined poses; unconnected cameras are replaced by [`ABSENT`].
    pub(crate) fn connected_cameras(&self) -> Vec<Camera> {
        let connected = |joined: &Option<CameraEstimate>| {
            joined.as_ref().filter(|estimate| estimate.is_connected).map_or(ABSENT, |joined| joined.camera)
        };
        self.cameras.iter().map(connected).collect()
    }

    fn new(
        summary: BundleSummary,
        sources: Vec<LandmarkSource>,
        distances: Vec<usize>,
        unused: UnusedEvidence,
    ) -> Self {
        Self {
            cameras: summary.cameras,
            landmarks: sources.into_iter().zip(summary.landmarks).collect(),
            annotation_reliabilities: summary.annotation_reliabilities,
            landmark_reliabilities: summary.landmark_reliabilities,
            covariances: summary.landmark_covariances,
            measurements: distances.into_iter().zip(summary.distances).collect(),
            rejected: summary.rejected,
            components: summary.components,
            unplaced: summary.unreached,
            too_many: summary.oversized,
            unsolved: summary.unsolved,
            unobservable: summary.unobservable,
            unused,
            planes: summary.planes,
            loop_closure: summary.loop_closure,
            pairs: summary.cross_covariances,
            single_marks: Vec::new(),
        }
    }
}

impl Site {
    /// Solves the bundle adjustment of all cameras with their shared observations.
    pub(crate) fn bundle_adjust(&self, single_fits: &[Result<SingleFit, Failure>]) -> BundleResult {
        let entries: Vec<&SiteCamera> = self.cameras.iter().collect();
        let members = members(&entries, single_fits);
        let planes = self.plane_priors();
        let shared = self.site_observations(single_fits, &planes, &|camera| members[camera].is_some());
        let mut result = adjust(&entries, &members, (shared, planes), true);
        // A mark that one camera observes places no camera, but its size determines orientation and height.
        for (estimate, member) in result.cameras.iter_mut().zip(&members) {
            if let (None, Some(member)) = (&estimate, member)
                && member.has_only_points()
                && member.single.mark.is_some()
            {
                *estimate = member.refined_by_points(self);
            }
        }
        result.single_marks = self.single_marks(&members);
        result
    }

    /// Returns the indices of the marks that only one camera observes and whose points determine this camera in
    /// stage 1.
    fn single_marks(&self, members: &[Option<Member>]) -> Vec<usize> {
        let mark = |member: &Member| {
            let is_own =
                |mark: &usize| self.marks[*mark].seen.iter().all(|seen| seen.camera == member.entry.id);
            member.single.mark.filter(is_own)
        };
        members.iter().flatten().filter_map(mark).collect()
    }

    /// Refines every camera separately: its lens with its lines, or its principal point with its control points.
    /// `entries` must include the owners of shared lenses.
    pub(crate) fn refine_separately(
        &self,
        entries: &[&SiteCamera],
        single_fits: &[Result<SingleFit, Failure>],
    ) -> BundleResult {
        let mut result = refine_lenses(entries, single_fits, self.plane_priors(), true);
        let members = members(entries, single_fits);
        for (estimate, member) in result.cameras.iter_mut().zip(&members) {
            if let Some(member) = member.as_ref().filter(|member| member.has_only_points()) {
                *estimate = member.refined_by_points(self);
            }
        }
        result.single_marks = self.single_marks(&members);
        result
    }
}

/// Refines the lenses together with stage 1 by a bundle adjustment without landmarks. `entries` must include the
/// owners of shared lenses. `with_reliability` also computes the reliability of the annotations.
pub(crate) fn refine_lenses(
    entries: &[&SiteCamera],
    single_fits: &[Result<SingleFit, Failure>],
    planes: Vec<PlanePrior>,
    with_reliability: bool,
) -> BundleResult {
    let alone = (SiteObservations::default(), planes);
    adjust(entries, &members(entries, single_fits), alone, with_reliability)
}

impl Site {
    /// Fits a camera, and rejects no line before its lens is estimated from all lines. Also returns this estimate,
    /// which is `None` if points alone determine the camera. Returns `None` if the fit fails.
    pub(crate) fn fit_all_lines(
        &self,
        entry: &SiteCamera,
        options: &Options,
        others: SharedInputs,
    ) -> Option<(SingleFit, Option<CameraEstimate>)> {
        let first = self.fit_single(entry, options, None, SharedInputs { keeps_all: true, ..others }).ok()?;
        let Some(estimate) = self.refine_lens(entry, &first) else { return Some((first, None)) };
        let better = (&first.lens_estimate, &estimate.camera);
        let found = self.fit_single(entry, options, Some(better), others).ok()?;
        Some((found, Some(estimate)))
    }

    /// Refines the lens of one camera together with stage 1; `None` if points alone determine the camera.
    pub(crate) fn refine_lens(&self, entry: &SiteCamera, single: &SingleFit) -> Option<CameraEstimate> {
        let fits = [Ok(single.clone())];
        refine_lenses(&[entry], &fits, self.plane_priors(), false).cameras.into_iter().next()?
    }
}

/// Returns the participating cameras; `None` for cameras that do not take part.
fn members<'a>(
    entries: &[&'a SiteCamera],
    single_fits: &'a [Result<SingleFit, Failure>],
) -> Vec<Option<Member<'a>>> {
    let each = entries.iter().zip(single_fits);
    each.map(|(entry, single)| Member::new(entry, single.as_ref().ok()?)).collect()
}

/// Runs the bundle adjustment. Unconnected cameras keep their pose of stage 1.
fn adjust(
    entries: &[&SiteCamera],
    members: &[Option<Member>],
    (shared, planes): (SiteObservations, Vec<PlanePrior>),
    with_reliability: bool,
) -> BundleResult {
    let SiteObservations { landmarks, measurements, unused } = shared;
    let (sources, landmarks) = landmarks.into_iter().unzip();
    let (indices, distances) = measurements.into_iter().unzip();
    let cameras = bundle_cameras(entries, members);
    let adjustment = BundleAdjustment { cameras, landmarks, distances, planes, with_reliability };
    let mut summary = adjustment.solve_checked();
    for (estimate, member) in summary.cameras.iter_mut().zip(members) {
        let Some(member) = member else { continue };
        // An unconnected camera from points has no residuals in this adjustment. Its result of stage 1 remains.
        estimate.take_if(|estimate| !estimate.is_connected && member.has_only_points());
        if let Some(estimate) = estimate.as_mut().filter(|estimate| !estimate.is_connected) {
            estimate.camera = member.with_single_pose(&estimate.camera);
        }
    }
    BundleResult::new(summary, sources, indices, unused)
}

fn bundle_cameras<'a>(entries: &[&SiteCamera], members: &[Option<Member<'a>>]) -> Vec<BundleCamera<'a>> {
    let camera = |(entry, member): (&&SiteCamera, &Option<Member<'a>>)| match member {
        Some(member) => member.bundle_camera(lens_owner(entry, entries, members)),
        None => BundleCamera::new(ABSENT, entry.size()),
    };
    let mut cameras: Vec<BundleCamera> = entries.iter().zip(members).map(camera).collect();
    // The edges in a fisheye image determine the principal point, also in a camera that shares the lens.
    for index in 0..cameras.len() {
        let Some(owner) = cameras[index].shared_lens else { continue };
        if cameras[owner].camera.lens.distortion.is_wide() && cameras[owner].free_lens[Lens::CENTRE] {
            cameras[index].free_lens[Lens::CENTRE..Lens::ASPECT].fill(true);
        }
    }
    cameras
}

/// Returns the index of the camera whose lens this camera shares. `None` if it shares none, or if that camera is not
/// part of the bundle adjustment.
fn lens_owner(entry: &SiteCamera, entries: &[&SiteCamera], members: &[Option<Member>]) -> Option<usize> {
    let like = entry.lens.as_ref().and_then(|lens| lens.like.as_ref())?;
    let owner = entries.iter().position(|other| other.id == *like)?;
    members[owner].is_some().then_some(owner)
}

impl<'a> Member<'a> {
    /// Creates a member. Returns `None` for a camera without a maximum-likelihood fit. Exceptions are a camera from
    /// points, and a placed camera that is not recomputed ([`SiteCamera::is_given`]).
    fn new(entry: &'a SiteCamera, single: &'a SingleFit) -> Option<Self> {
        let own = single.result.solution.camera()?;
        let takes_part = if entry.is_given() {
            single.result.solution.stage > Stage::Partial
        } else {
            single.fit.is_some() || single.is_from_points
        };
        takes_part.then_some(Self { entry, single, own })
    }

    /// Whether only points (control points, or the points of a mark) determine the camera, and not lines.
    const fn has_only_points(&self) -> bool {
        self.single.is_from_points && self.single.fit.is_none()
    }

    fn bundle_camera(&self, lens_of: Option<usize>) -> BundleCamera<'a> {
        let Self { entry, single, own } = *self;
        let given = FixedParameters {
            roll: Some(own.roll),
            pitch: Some(own.pitch),
            focal: Some(own.focal),
            height: None,
        };
        BundleCamera {
            camera: self.initial_camera(),
            initial_pose: self.initial_pose(),
            fixed_pose: self.fixed_pose(),
            size: entry.size(),
            principal_point: single.principal_point.unwrap_or_else(|| entry.principal_point_near_centre()),
            pixel_aspect: entry.pixel_aspect_prior(),
            fixed: if entry.is_given() { given } else { single.fixed },
            priors: if entry.is_given() {
                Priors::default()
            } else {
                entry.priors(&single.lens_estimate.lens)
            },
            annotations: &entry.annotations,
            constraints: &single.constraints,
            fit: single.fit.as_ref(),
            noise_is_known: entry.sigma_px.is_some(),
            shared_lens: lens_of,
            free_lens: self.free_lens(),
        }
    }

    /// Refines a camera without lines by its control points. Without control points, its orientation and focal
    /// length are refined by the points of its mark.
    fn refined_by_points(&self, site: &Site) -> Option<CameraEstimate> {
        let Self { entry, single, .. } = self;
        let sigma = entry.sigma_px.unwrap_or(1.0);
        let landmarks: Vec<Landmark> = if single.mark.is_some() {
            UsedPoints::from_mark(site, entry).landmarks(sigma)
        } else {
            let points = entry.control_points.iter().enumerate();
            let used = points.filter(|(index, _)| !single.suspect_points.contains(index));
            used.filter_map(|(_, point)| site.control_point_landmark(point, 0, sigma)).collect()
        };
        // Stage 1 has already rejected points.
        let kept = landmarks.into_iter().map(|landmark| Landmark { keep: true, ..landmark });
        let mut camera = self.bundle_camera(None);
        if single.mark.is_some() {
            // The mark is at its position in the file, which is unrelated to the placement of the camera.
            camera.camera = self.own;
            (camera.initial_pose, camera.fixed_pose) = (InitialPose::Unknown, FixedPose::default());
        }
        let adjustment = BundleAdjustment {
            cameras: vec![camera],
            landmarks: kept.collect(),
            distances: Vec::new(),
            planes: site.plane_priors(),
            with_reliability: false,
        };
        let mut estimate = adjustment.solve_checked().cameras.pop()??;
        if single.mark.is_some() {
            estimate.is_connected = false;
            estimate.camera = unplaced(&estimate.camera);
        }
        Some(estimate)
    }

    fn initial_pose(&self) -> InitialPose {
        match &self.entry.placement {
            _ if self.entry.is_given() => InitialPose::Fixed,
            Some(placement) if placement.fixed => InitialPose::Fixed,
            Some(_) => InitialPose::Approximate,
            None => InitialPose::Unknown,
        }
    }

    fn fixed_pose(&self) -> FixedPose {
        let placement = self.entry.placement.as_ref().filter(|_| !self.entry.is_given());
        placement.map_or_else(FixedPose::default, |placement| {
            let FixedEntry { x, y, turn } = placement.held;
            FixedPose { x, y, yaw: turn }
        })
    }

    /// Whether stage 1 determined the height.
    fn height_is_known(&self) -> bool {
        self.single.fit.as_ref().is_some_and(|fit| fit.is_height_known)
    }

    /// Returns the initial camera: as placed by the operator, otherwise as estimated by stage 1. A height
    /// known from stage 1 is not scaled, unless the placement is fixed.
    fn initial_camera(&self) -> Camera {
        let own = self.own;
        match &self.entry.placement {
            Some(entry) if !self.entry.is_given() => {
                let placed = entry.placement().apply(&own);
                let keeps_height = self.height_is_known() && !entry.fixed;
                let z = if keeps_height { own.position.z } else { placed.position.z };
                Camera { position: WorldPoint { z, ..placed.position }, ..placed }
            }
            _ => own,
        }
    }

    /// Returns a refined camera with its pose of stage 1, because an unconnected camera is placed separately.
    fn with_single_pose(&self, refined: &Camera) -> Camera {
        let z = if self.height_is_known() { refined.position.z } else { self.own.position.z };
        Camera { position: WorldPoint { z, ..self.own.position }, yaw: self.own.yaw, ..*refined }
    }

    /// Returns the flags of the lens parameters that were fitted.
    fn free_lens(&self) -> [bool; Lens::PARAMETERS] {
        let fit = self.single.lens_estimate.fit.as_ref();
        let mut free = fit.map_or([false; Lens::PARAMETERS], |fit| fit.free);
        if self.single.has_lens_from_points {
            // The coefficients k1 and k2.
            free[..2].fill(true);
        }
        // The lens fit of a fisheye uses its own prior on the principal point if none is entered.
        let is_entered = self.entry.entered_principal_point().is_some();
        if self.single.fits_principal_point() || self.single.principal_point.is_some() && is_entered {
            free[Lens::CENTRE..Lens::ASPECT].fill(true);
        }
        free
    }
}
