//! Parameter blocks: the grouping of parameters into blocks, and their positions in the state.
//!
//! A camera has one block of pose, focal length and lens. The focal length and distortion that several cameras
//! share have a separate block. Both kinds of blocks are kept in the reduced system. The nuisance parameters of
//! stage 1 form small blocks, for example a floor direction with its deviations, or a length. A landmark is a
//! block of up to three parameters. Blocks of nuisance parameters and landmarks are coupled to few cameras and
//! are eliminated (Schur complement). A landmark at the end of a measured distance is kept, because two
//! eliminated blocks must not share a residual. A tilt and planes that several views share have kept blocks, too.

use std::collections::HashSet;

use crate::bundle::camera::{CAMERA_PARAMS, View};
use crate::bundle::initialization::CommonTilt;
use crate::bundle::landmark::{DistanceMeasurement, Landmark};
use crate::camera::{Camera, Covariance, Pixel, Plane};
use crate::optimize::{BlockStructure, NuisanceLayout};
use crate::single::PlanePrior;

/// Number of parameters of a plane: height, slope along x, slope along y.
pub(crate) const PLANE_PARAMS: usize = 3;

/// Returns the height and slope of a plane.
pub(crate) fn parameters_of_plane(plane: &Plane) -> [f64; PLANE_PARAMS] {
    [plane.height, plane.slope[0], plane.slope[1]]
}

/// Returns for every plane whether it is estimated: it is not fixed, and an annotation or a landmark is on
/// it. `on_planes` lists the planes of all annotations and landmarks.
pub(crate) fn is_estimated(planes: &[PlanePrior], on_planes: impl Iterator<Item = usize>) -> Vec<bool> {
    let mut estimated = vec![false; planes.len()];
    for plane in on_planes {
        if let (Some(estimated), Some(prior)) = (estimated.get_mut(plane), planes.get(plane)) {
            *estimated = !prior.is_fixed();
        }
    }
    estimated
}

/// Position of every parameter of a camera: its block, and its index in the block. `None` if the parameter is
/// not estimated.
pub(crate) type CameraLayout = [Option<(usize, usize)>; CAMERA_PARAMS];

/// Positions of all parameters: the block of each parameter, and its index in the block.
#[derive(Clone, Debug)]
pub(crate) struct ParameterLayout {
    pub(crate) blocks: BlockStructure,
    /// Positions of the camera parameters of every view.
    pub(crate) cameras: Vec<CameraLayout>,
    /// Position of every nuisance parameter of stage 1 of every view. `None` if the parameter is not used, or
    /// belongs to a shared plane.
    pub(crate) nuisances: Vec<Vec<Option<(usize, usize)>>>,
    /// Block of the free parameters of every landmark, in their order; `None` if no parameter is free.
    pub(crate) landmarks: Vec<Option<usize>>,
    /// Block of every plane (height and slope); `None` if the plane is fixed or not used.
    pub(crate) planes: Vec<Option<usize>>,
    /// Tilt of the floor that several views share; `None` if fewer than two views constrain it.
    pub(crate) tilt: Option<CommonTilt>,
}

/// Builder of a [`ParameterLayout`]: the parameter blocks allocated so far.
#[derive(Debug, Default)]
struct LayoutBuilder {
    /// Number of parameters of every block.
    sizes: Vec<usize>,
    /// Flags of the blocks that are not eliminated by the Schur complement.
    keep: Vec<bool>,
    /// Groups of blocks that share residuals.
    coupled: Vec<Vec<usize>>,
}

impl ParameterLayout {
    pub(crate) fn new(
        views: &[View],
        landmarks: &[Landmark],
        distances: &[DistanceMeasurement],
        planes: &[PlanePrior],
    ) -> Self {
        let mut builder = LayoutBuilder::default();
        let shared = builder.shared_lenses(views);
        let cameras: Vec<CameraLayout> =
            views.iter().map(|view| builder.camera(&view.free, shared[view.lens])).collect();
        let tilt = builder.common_tilt(views);
        let planes = builder.planes(planes, views, landmarks);
        let nuisances = views
            .iter()
            .zip(&cameras)
            .map(|(view, camera)| {
                let tilt = tilt.filter(|_| observes_tilt(view)).map(|tilt| tilt.block);
                builder.nuisances(view, camera, tilt, &planes)
            })
            .collect();
        let used: Vec<&DistanceMeasurement> = distances.iter().filter(|distance| !distance.off).collect();
        let kept: HashSet<usize> = used.iter().flat_map(|distance| distance.between).collect();
        let landmark_blocks = builder.landmarks(landmarks, &kept, &cameras, &planes);
        let ground = |landmark: usize| landmarks[landmark].plane.and_then(|plane| planes[plane]);
        for distance in used {
            let ends = distance.between.iter().flat_map(|&end| [landmark_blocks[end], ground(end)]);
            builder.couple(ends.flatten());
        }
        let blocks = BlockStructure::new(builder.sizes, &builder.keep, &builder.coupled);
        Self { blocks, cameras, nuisances, landmarks: landmark_blocks, planes, tilt }
    }
}

impl LayoutBuilder {
    /// Allocates a block of `size` parameters and returns its index; `None` for size 0. A block without
    /// `keep` is eliminated by the Schur complement.
    fn block(&mut self, size: usize, keep: bool) -> Option<usize> {
        (size > 0).then(|| {
            self.sizes.push(size);
            self.keep.push(keep);
            self.sizes.len() - 1
        })
    }

    /// Records that residuals depend on all of these blocks together.
    fn couple(&mut self, blocks: impl Iterator<Item = usize>) {
        self.coupled.push(blocks.collect());
    }

    /// Allocates a block for every lens that several views share. Returns the block of each lens; `None` for
    /// a lens of a single view.
    fn shared_lenses(&mut self, views: &[View]) -> Vec<Option<usize>> {
        let count = views.iter().map(|view| view.lens + 1).max().unwrap_or(0);
        let mut users: Vec<Vec<&View>> = vec![Vec::new(); count];
        views.iter().for_each(|view| users[view.lens].push(view));
        let is_free = |view: &View| {
            view.free[Covariance::FOCAL..Covariance::CENTRE].iter().filter(|&&free| free).count()
        };
        users
            .iter()
            .map(|users| match users[..] {
                [first, _, ..] => self.block(is_free(first), true),
                _ => None,
            })
            .collect()
    }

    /// Allocates the block of a view: its pose and principal point, and its lens unless the lens is shared.
    /// Returns the position of every camera parameter.
    fn camera(&mut self, free: &[bool; CAMERA_PARAMS], shared_lens: Option<usize>) -> CameraLayout {
        let is_of_lens = |k: usize| (Covariance::FOCAL..Covariance::CENTRE).contains(&k);
        let is_own = |k: usize| free[k] && !(shared_lens.is_some() && is_of_lens(k));
        let own = self.block((0..CAMERA_PARAMS).filter(|&k| is_own(k)).count(), true);
        let (mut next, mut next_shared) = (0, 0);
        let layout = std::array::from_fn(|k| {
            let counter = if is_own(k) { &mut next } else { &mut next_shared };
            let block = if is_own(k) { own } else { shared_lens.filter(|_| free[k] && is_of_lens(k)) }?;
            *counter += 1;
            Some((block, *counter - 1))
        });
        self.couple(own.into_iter().chain(shared_lens));
        layout
    }

    /// Allocates the block of the shared floor tilt if more than one view constrains the tilt.
    fn common_tilt(&mut self, views: &[View]) -> Option<CommonTilt> {
        let showing: Vec<usize> = (0..views.len()).filter(|&view| observes_tilt(&views[view])).collect();
        let [first, _, ..] = showing[..] else { return None };
        // The prior on the crossfall comes from a view that observes it.
        let is_marked = |&view: &usize| views[view].stage_1.constraints.has_crossfall();
        let first = showing.into_iter().find(is_marked).unwrap_or(first);
        let block = self.block(2, true)?;
        Some(CommonTilt { block, prior_view: first })
    }

    /// Allocates the blocks of the estimated planes; `None` for the other planes.
    fn planes(
        &mut self,
        planes: &[PlanePrior],
        views: &[View],
        landmarks: &[Landmark],
    ) -> Vec<Option<usize>> {
        let drawn = views.iter().filter(|view| view.shares_floor);
        let drawn = drawn.flat_map(|view| view.stage_1.constraints.planes.iter().map(|drawn| drawn.index));
        let stood_on =
            landmarks.iter().filter(|landmark| !landmark.off).filter_map(|landmark| landmark.plane);
        let estimated = is_estimated(planes, drawn.chain(stood_on));
        estimated.into_iter().map(|is| if is { self.block(PLANE_PARAMS, true) } else { None }).collect()
    }

    /// Allocates the blocks of the used nuisance parameters of a view, with the layout of the single-camera
    /// fit. A shared tilt refers to its shared block. The parameters of shared planes have no position.
    fn nuisances(
        &mut self,
        view: &View,
        camera: &CameraLayout,
        common_tilt: Option<usize>,
        planes: &[Option<usize>],
    ) -> Vec<Option<(usize, usize)>> {
        let stage_1 = &view.stage_1;
        let mut used = stage_1.used();
        let tilt = stage_1.nuisances().tilt();
        if common_tilt.is_some() {
            used[tilt..tilt + 2].fill(false);
        }
        let mut own: Vec<usize> = blocks_of(camera).collect();
        if view.shares_floor {
            used[stage_1.nuisances().plane(0)..].fill(false);
            let drawn = stage_1.constraints.planes.iter();
            own.extend(drawn.filter_map(|drawn| planes[drawn.index]));
        }
        let NuisanceLayout { positions: places, sizes } = stage_1.nuisances().layout(stage_1.constraints);
        let mut counts = vec![0; sizes.len()];
        let places: Vec<Option<(usize, usize)>> = places
            .iter()
            .zip(&used)
            .map(|(&(block, _), &is_used)| {
                counts[block] += usize::from(is_used);
                is_used.then(|| (block, counts[block] - 1))
            })
            .collect();
        let blocks: Vec<Option<usize>> = counts.iter().map(|&count| self.block(count, false)).collect();
        blocks.iter().flatten().for_each(|&block| self.couple(own.iter().copied().chain([block])));
        self.couple(own.into_iter().chain(common_tilt));
        let mut places: Vec<Option<(usize, usize)>> =
            places.iter().map(|slot| slot.and_then(|(block, at)| Some((blocks[block]?, at)))).collect();
        if let Some(block) = common_tilt {
            places[tilt..tilt + 2].copy_from_slice(&[Some((block, 0)), Some((block, 1))]);
        }
        places
    }

    /// Allocates the blocks of the active landmarks. Landmarks in `kept` are not eliminated.
    fn landmarks(
        &mut self,
        landmarks: &[Landmark],
        kept: &HashSet<usize>,
        cameras: &[CameraLayout],
        planes: &[Option<usize>],
    ) -> Vec<Option<usize>> {
        let blocks: Vec<Option<usize>> = landmarks
            .iter()
            .enumerate()
            .map(|(index, landmark)| {
                let free = landmark.free.iter().filter(|&&free| free && !landmark.off).count();
                self.block(free, kept.contains(&index))
            })
            .collect();
        for (landmark, &block) in landmarks.iter().zip(&blocks).filter(|(landmark, _)| !landmark.off) {
            let ground = landmark.plane.and_then(|plane| planes[plane]);
            for view in landmark.views() {
                self.couple(blocks_of(&cameras[view]).chain(block).chain(ground));
            }
        }
        blocks
    }
}

/// Whether a view constrains the tilt of the floor that it shares with other views.
fn observes_tilt(view: &View) -> bool {
    view.shares_floor && view.stage_1.constraints.tilt_sigma().is_some()
}

/// Returns the blocks of the estimated parameters of a camera, with repetitions.
fn blocks_of(camera: &CameraLayout) -> impl Iterator<Item = usize> + '_ {
    camera.iter().flatten().map(|(block, _)| *block)
}

/// Returns the parameters of a camera in the order of [`Covariance`], with the log of the focal length.
pub(crate) fn parameters_of(camera: &Camera) -> [f64; CAMERA_PARAMS] {
    let [x, y, z] = camera.position.into();
    let [a, b, c, d, e] = camera.lens.distortion.fitted_coefficients();
    let Pixel { u, v } = camera.lens.principal_point;
    let aspect = camera.lens.pixel_aspect;
    [x, y, z, camera.yaw, camera.pitch, camera.roll, camera.focal.ln(), a, b, c, d, e, u, v, aspect]
}
