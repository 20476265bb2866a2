//! The site as a bundle adjustment: its cameras and what they share as values, and the result in the
//! numbering of the site.

use std::collections::HashMap;

use crate::document::{HeldEntry, Site, SiteCamera};
use crate::observations::{LandmarkSource, Shared, Unused};
use crate::single_step::SingleFit;
use crate::solution::Stage;
use calib_core::bundle::{
    BundleAdjustment, BundleCamera, BundleSummary, CameraEstimate, Component, CrossCovariance,
    DistanceMeasurement, HeldPose, InitialPose, Landmark, OutlierCandidate, PlaneEstimate,
};
use calib_core::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
use calib_core::floor::STAGE_1_HEIGHT;
use calib_core::outcome::Failure;
use calib_core::single::{FixedParameters, PlanePrior, Priors};

/// The result of the bundle adjustment of a site.
#[derive(Clone, Debug, Default)]
pub(crate) struct BundleResult {
    /// For every camera of the site that took part. Those that are not connected are where stage 1 has
    /// them, with a better lens.
    pub(crate) cameras: Vec<Option<CameraEstimate>>,
    /// Every landmark and what it is in the site, where it was found, switched off if it was rejected.
    pub(crate) landmarks: Vec<(LandmarkSource, Landmark)>,
    /// Covariance of the parameters of landmarks.
    pub(crate) covariances: Vec<Option<[[f64; 3]; 3]>>,
    /// With the index of the distance in the site.
    pub(crate) measurements: Vec<(usize, DistanceMeasurement)>,
    /// Landmarks and distances rejected, by their index here.
    pub(crate) rejected: Vec<OutlierCandidate>,
    pub(crate) components: Vec<Component>,
    /// Cameras that share too little with others to be placed.
    pub(crate) unreached: Vec<usize>,
    /// Cameras that share so much that no machine fits them together.
    pub(crate) too_many: Vec<usize>,
    /// Cameras that have no place from which everything they share can be seen.
    pub(crate) unfitted: Vec<usize>,
    /// Landmarks that a camera cannot see where the others have them.
    pub(crate) lost: Vec<usize>,
    /// Landmarks and distances that carry no information.
    pub(crate) unused: Unused,
    /// Planes that were estimated.
    pub(crate) planes: Vec<Option<PlaneEstimate>>,
    pub(crate) loop_closure: Option<f64>,
    /// Covariance of pairs of cameras that were refined together.
    pub(crate) pairs: HashMap<[usize; 2], CrossCovariance>,
}

/// Stands in for a camera without a result; nothing observes it.
pub(crate) const ABSENT: Camera = Camera {
    position: WorldPoint { x: 0.0, y: 0.0, z: STAGE_1_HEIGHT },
    yaw: 0.0,
    pitch: 0.0,
    roll: 0.0,
    focal: 1.0,
    lens: Lens::pinhole(Pixel { u: 0.0, v: 0.0 }),
    covariance: Covariance::EXACT,
};

/// A camera that can take part: its entry and what stage 1 made of it.
struct Member<'a> {
    entry: &'a SiteCamera,
    single: &'a SingleFit,
    /// Where stage 1 has it.
    own: Camera,
}

impl BundleResult {
    /// The cameras that are connected; those that are not are [`ABSENT`].
    pub(crate) fn tied_cameras(&self) -> Vec<Camera> {
        let connected = |joined: &Option<CameraEstimate>| {
            joined.as_ref().filter(|estimate| estimate.is_connected).map_or(ABSENT, |joined| joined.camera)
        };
        self.cameras.iter().map(connected).collect()
    }

    fn new(
        summary: BundleSummary,
        sources: Vec<LandmarkSource>,
        distances: Vec<usize>,
        unused: Unused,
    ) -> Self {
        Self {
            cameras: summary.cameras,
            landmarks: sources.into_iter().zip(summary.landmarks).collect(),
            covariances: summary.landmark_covariances,
            measurements: distances.into_iter().zip(summary.distances).collect(),
            rejected: summary.rejected,
            components: summary.components,
            unreached: summary.unreached,
            too_many: summary.oversized,
            unfitted: summary.unsolved,
            lost: summary.unobservable,
            unused,
            planes: summary.planes,
            loop_closure: summary.loop_closure,
            pairs: summary.cross_covariances,
        }
    }
}

impl Site {
    /// The bundle adjustment of all cameras with all that they share.
    pub(crate) fn join(&self, single_fits: &[Result<SingleFit, Failure>]) -> BundleResult {
        let entries: Vec<&SiteCamera> = self.cameras.iter().collect();
        let members = members(&entries, single_fits);
        let planes = self.plane_priors();
        let shared = self.shared(single_fits, &planes, &|camera| members[camera].is_some());
        adjust(&entries, &members, shared, planes)
    }
}

/// Lenses refined together with stage 1, of cameras among which are those whose lens others share: the
/// bundle adjustment without landmarks.
pub(crate) fn refine_lenses(
    entries: &[&SiteCamera],
    single_fits: &[Result<SingleFit, Failure>],
    planes: Vec<PlanePrior>,
) -> BundleResult {
    adjust(entries, &members(entries, single_fits), Shared::default(), planes)
}

fn members<'a>(
    entries: &[&'a SiteCamera],
    single_fits: &'a [Result<SingleFit, Failure>],
) -> Vec<Option<Member<'a>>> {
    let each = entries.iter().zip(single_fits);
    each.map(|(entry, single)| Member::new(entry, single.as_ref().ok()?)).collect()
}

fn adjust(
    entries: &[&SiteCamera],
    members: &[Option<Member>],
    shared: Shared,
    planes: Vec<PlanePrior>,
) -> BundleResult {
    let Shared { landmarks, measurements, unused } = shared;
    let (sources, landmarks) = landmarks.into_iter().unzip();
    let (indices, distances) = measurements.into_iter().unzip();
    let cameras = bundle_cameras(entries, members);
    let mut summary = BundleAdjustment { cameras, landmarks, distances, planes }.solve_checked();
    for (estimate, member) in summary.cameras.iter_mut().zip(members) {
        if let (Some(estimate), Some(member)) = (estimate, member)
            && !estimate.is_connected
        {
            estimate.camera = member.unplaced(&estimate.camera);
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
    // Cameras of one lens have sensors of their own, each beside it somewhere else.
    let owners: Vec<usize> = cameras.iter().filter_map(|camera| camera.lens_of).collect();
    owners.into_iter().for_each(|owner| cameras[owner].free_lens[Lens::CENTRE..].fill(false));
    cameras
}

/// The camera whose lens this one shares, if both take part.
fn lens_owner(entry: &SiteCamera, entries: &[&SiteCamera], members: &[Option<Member>]) -> Option<usize> {
    let like = entry.lens.as_ref().and_then(|lens| lens.like.as_ref())?;
    let owner = entries.iter().position(|other| other.id == *like)?;
    members[owner].is_some().then_some(owner)
}

impl<'a> Member<'a> {
    /// `None` for a camera without maximum-likelihood fit, unless it is given with its place.
    fn new(entry: &'a SiteCamera, single: &'a SingleFit) -> Option<Self> {
        let own = single.result.solution.camera()?;
        let takes_part = if entry.is_given() {
            single.result.solution.stage > Stage::Partial
        } else {
            single.fit.is_some()
        };
        takes_part.then_some(Self { entry, single, own })
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
            camera: self.placed(),
            initial_pose: self.initial_pose(),
            held: self.held(),
            size: entry.size(),
            circle: entry.image_circle(),
            fixed: if entry.is_given() { given } else { single.fixed },
            priors: if entry.is_given() { Priors::default() } else { entry.priors() },
            annotations: &entry.annotations,
            constraints: &single.constraints,
            fit: single.fit.as_ref(),
            noise_is_known: entry.sigma_px.is_some(),
            lens_of,
            free_lens: self.free_lens(),
        }
    }

    fn initial_pose(&self) -> InitialPose {
        match &self.entry.placement {
            _ if self.entry.is_given() => InitialPose::Fixed,
            Some(placement) if placement.fixed => InitialPose::Fixed,
            Some(_) => InitialPose::Approximate,
            None => InitialPose::Unknown,
        }
    }

    fn held(&self) -> HeldPose {
        let placement = self.entry.placement.as_ref().filter(|_| !self.entry.is_given());
        placement.map_or_else(HeldPose::default, |placement| {
            let HeldEntry { x, y, turn } = placement.held;
            HeldPose { x, y, yaw: turn }
        })
    }

    fn height_is_known(&self) -> bool {
        self.single.fit.as_ref().is_some_and(|fit| fit.height_known)
    }

    /// Where the operator placed the camera, or where stage 1 has it. A height that stage 1 knows is not
    /// scaled, unless the placement is fixed.
    fn placed(&self) -> Camera {
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

    /// A refined camera back where stage 1 has it: what is not connected is placed on its own.
    fn unplaced(&self, refined: &Camera) -> Camera {
        let z = if self.height_is_known() { refined.position.z } else { self.own.position.z };
        Camera { position: WorldPoint { z, ..self.own.position }, yaw: self.own.yaw, ..*refined }
    }

    /// Which parameters of its lens were fitted.
    fn free_lens(&self) -> [bool; Lens::PARAMETERS] {
        let fit = self.single.lens_estimate.fit.as_ref();
        fit.map_or([false; Lens::PARAMETERS], |fit| fit.free)
    }
}
