//! Camera as it enters the adjustment: its initial values, its constraints, and its estimated parameters.

use crate::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
use crate::single::{
    Annotation, Constraints, Edge, Fit, FitOptions, FixedParameters, LOG_HEIGHT, LensResidual,
    PrincipalPointPrior, Prior, Priors, Problem, edges, lens_prior, outermost, repeat_counts, slope_prior,
    weak_prior,
};

/// Number of parameters of a camera, including its lens, in the order of [`Covariance`].
pub(crate) const CAMERA_PARAMS: usize = Covariance::SIZE;

/// Prior knowledge of the position and yaw of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InitialPose {
    /// Unknown: initialised from landmarks that other cameras placed, or from control points.
    Unknown,
    /// Approximate. If no other information fixes the gauge of a component, one such camera fixes it. It is the first
    /// camera with the largest number of fixed coordinates.
    Approximate,
    /// Exact: position and yaw are not estimated.
    Fixed,
}

/// Coordinates of position and yaw that are fixed individually; the others are estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FixedPose {
    /// Whether the x coordinate of the position is fixed.
    pub x: bool,
    /// Whether the y coordinate of the position is fixed.
    pub y: bool,
    /// Whether the yaw is fixed.
    pub yaw: bool,
}

impl FixedPose {
    /// Returns the number of fixed coordinates.
    pub(crate) fn count(self) -> usize {
        [self.x, self.y, self.yaw].into_iter().filter(|is_fixed| *is_fixed).count()
    }

    /// Whether both coordinates of the position are fixed.
    pub(crate) const fn has_fixed_position(self) -> bool {
        self.x && self.y
    }

    /// Returns `camera` with the fixed coordinates copied from `known`, bit for bit.
    pub(crate) fn restore(self, known: &Camera, camera: Camera) -> Camera {
        let pick = |is_fixed: bool, known: f64, other: f64| if is_fixed { known } else { other };
        let (at, now) = (known.position, camera.position);
        let position = WorldPoint { x: pick(self.x, at.x, now.x), y: pick(self.y, at.y, now.y), z: now.z };
        Camera { position, yaw: pick(self.yaw, known.yaw, camera.yaw), ..camera }
    }
}

/// Camera of a [`BundleAdjustment`](crate::BundleAdjustment).
#[derive(Clone, Debug)]
pub struct BundleCamera<'a> {
    /// Initial values, and the values of the parameters that are not estimated. If the initial pose is
    /// unknown, only height, roll, pitch, focal length and lens are used, as computed by stage 1.
    pub camera: Camera,
    /// Prior knowledge of position and yaw.
    pub initial_pose: InitialPose,
    /// Coordinates of the pose that keep the values of `camera`, independently of `initial_pose`.
    pub fixed_pose: FixedPose,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Prior on the principal point, used if the principal point is estimated.
    pub principal_point: PrincipalPointPrior,
    /// Prior on the pixel aspect; `None` if the pixel aspect is known.
    pub pixel_aspect: Option<Prior>,
    /// Fixed values of roll, pitch, focal length and height. A fixed height replaces the height of `camera`.
    /// For the other parameters the values of `camera` are used.
    pub fixed: FixedParameters,
    /// Priors on roll, pitch, focal length and height.
    pub priors: Priors,
    /// Annotations of the image; their constraints are recomputed if the distortion is estimated.
    pub annotations: &'a [Annotation],
    /// Constraints of the annotations under the camera's own lens.
    pub constraints: &'a Constraints,
    /// Single-camera fit. Its outliers stay rejected, its noise is used, and its nuisance parameters are the
    /// initial values. Required if there are constraints. Without a fit, a focal length that is neither fixed
    /// nor has a prior gets the weak prior if the landmarks do not determine it.
    pub fit: Option<&'a Fit>,
    /// Whether the standard deviations of the annotations are known. They are then not inflated by large
    /// residuals.
    pub noise_is_known: bool,
    /// Index of the camera whose focal length and distortion this camera shares, if any. The owner of the
    /// lens must not share another camera's lens.
    pub shared_lens: Option<usize>,
    /// Flags of the estimated lens parameters, in the order of [`Lens::PARAMETERS`]. For a shared lens the
    /// flags of its owner apply, except for the principal point and the pixel aspect, which every camera has
    /// for itself. The flag of the pixel aspect is ignored: its prior decides. If the own focal length of a
    /// wide lens is free, it equals the focal length of the camera.
    pub free_lens: [bool; Lens::PARAMETERS],
}

/// Constraints of a camera without annotations.
static NO_CONSTRAINTS: Constraints = Constraints::EMPTY;

impl<'a> BundleCamera<'a> {
    /// Creates a camera of known roll, pitch, focal length and lens, without annotations. Position and yaw
    /// are estimated without initial values, and the height starts at the height of `camera`. `size` is the
    /// size of the image, in pixels.
    #[must_use]
    pub fn new(camera: Camera, size: [f64; 2]) -> Self {
        Self {
            camera,
            initial_pose: InitialPose::Unknown,
            fixed_pose: FixedPose::default(),
            size,
            principal_point: PrincipalPointPrior::of_image(size),
            pixel_aspect: None,
            fixed: FixedParameters {
                roll: Some(camera.roll),
                pitch: Some(camera.pitch),
                focal: Some(camera.focal),
                height: None,
            },
            priors: Priors::default(),
            annotations: &[],
            constraints: &NO_CONSTRAINTS,
            fit: None,
            noise_is_known: true,
            shared_lens: None,
            free_lens: [false; Lens::PARAMETERS],
        }
    }

    /// Creates a camera from its single-camera fit and the inputs of that fit.
    #[must_use]
    pub fn from_fit(
        fit: &'a Fit,
        constraints: &'a Constraints,
        annotations: &'a [Annotation],
        options: &FitOptions,
    ) -> Self {
        Self {
            fixed: options.fixed,
            priors: options.priors,
            annotations,
            constraints,
            fit: Some(fit),
            noise_is_known: options.sigma.is_some(),
            ..Self::new(fit.camera, options.size)
        }
    }

    /// Returns the residuals of stage 1, with the outliers, noise and weak prior of the single-camera fit.
    pub(crate) fn stage_1(&self) -> Problem<'a> {
        let width = self.size[0];
        let sigma = self.fit.map_or(1.0, |fit| fit.sigma);
        let rejected = self.fit.map_or(&[][..], |fit| &fit.outliers[..]);
        let focal = self.priors.focal.filter(|_| self.fixed.focal.is_none());
        let has_weak_prior = match self.fit {
            Some(fit) => fit.has_weak_prior,
            None => self.fixed.focal.is_none() && focal.is_none(),
        };
        let weak_log_focal: Option<Prior> = has_weak_prior.then(|| weak_prior(width));
        let priors = Priors { focal, weak_log_focal, ..self.priors };
        Problem { rejected, ..Problem::new(self.constraints, self.fixed, priors, sigma, width) }
    }

    /// Whether the height is determined by other information than the placement: it is fixed, or stage 1
    /// estimates it.
    pub(crate) fn height_is_known(&self) -> bool {
        self.initial_pose != InitialPose::Fixed
            && (self.fixed.height.is_some() || self.stage_1().free[LOG_HEIGHT])
    }

    /// Returns the height if it is fixed, in metres.
    pub(crate) fn fixed_height(&self) -> Option<f64> {
        self.fixed.height.filter(|_| self.initial_pose != InitialPose::Fixed)
    }

    /// Returns the index of the camera that owns the lens; `index` is the index of this camera.
    pub(crate) fn lens_owner(&self, index: usize) -> usize {
        self.shared_lens.unwrap_or(index)
    }

    /// Whether the focal length of a wide lens and the focal length of the camera are one estimated
    /// parameter.
    fn has_tied_focal(&self) -> bool {
        self.camera.lens.distortion.is_wide()
            && self.free_lens[Lens::LENS_FOCAL]
            && self.fixed.focal.is_none()
    }

    /// Whether lens parameters are estimated.
    pub(crate) fn fits_lens(&self) -> bool {
        self.free_lens.contains(&true) || self.pixel_aspect.is_some()
    }

    /// Whether lens parameters besides the principal point and the pixel aspect are estimated.
    fn fits_distortion(&self) -> bool {
        self.free_lens[..Lens::CENTRE].contains(&true)
    }
}

/// Gauge of a component: flags of the position, yaw and scale that the placement of one camera fixes, because
/// no other information determines them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Gauge {
    pub(crate) x: bool,
    pub(crate) y: bool,
    pub(crate) yaw: bool,
    pub(crate) scale: bool,
}

/// Camera of one bundle problem, with its residuals of stage 1.
#[derive(Clone, Debug)]
pub(crate) struct View<'a> {
    /// Initial values, and the values of the parameters that are not estimated.
    pub(crate) camera: Camera,
    /// Flags of the estimated parameters. For a shared lens the flags of its owner apply.
    pub(crate) free: [bool; CAMERA_PARAMS],
    /// Index of the lens, including the focal length; views with the same index share the lens.
    pub(crate) lens: usize,
    /// Annotations, from which the constraints under another lens are computed.
    pub(crate) annotations: &'a [Annotation],
    /// Constraints, priors and rejected annotations, under the initial lens.
    pub(crate) stage_1: Problem<'a>,
    /// Initial nuisance parameters of stage 1 (directions and lengths).
    pub(crate) nuisance: Vec<f64>,
    /// Whether the view shares the floor with the other views of its cluster; otherwise its floor is
    /// separate.
    pub(crate) shares_floor: bool,
    /// Straight edges of the annotations; empty if the distortion is not estimated.
    pub(crate) edges: Vec<Edge>,
    /// Number of times that each edge is annotated.
    pub(crate) edge_counts: Vec<f64>,
    /// Annotated point farthest from the principal point, in raw pixels.
    pub(crate) outermost: Option<Pixel>,
    /// Width and height of the image, in pixels.
    pub(crate) size: [f64; 2],
    /// Prior on the principal point.
    pub(crate) principal_point: PrincipalPointPrior,
    /// Prior on the pixel aspect; `None` if the pixel aspect is known.
    pub(crate) pixel_aspect: Option<Prior>,
    /// Whether the focal length of a wide lens and the focal length of the camera are one estimated
    /// parameter.
    pub(crate) has_tied_focal: bool,
}

impl<'a> View<'a> {
    /// Creates the view of a camera that starts at `start` and has the lens of `owner`. `lens` is the index
    /// of the lens in the problem. Without a gauge the camera is not connected, and position and yaw stay
    /// fixed.
    pub(crate) fn new(
        entry: &BundleCamera<'a>,
        start: &Camera,
        owner: &BundleCamera,
        lens: usize,
        gauge: Option<Gauge>,
    ) -> Self {
        let stage_1 = entry.stage_1();
        let free = free_parameters(entry, owner, &stage_1, gauge);
        let fits_distortion = owner.fits_distortion();
        // Without a fit the view has no annotations, so no residual depends on a nuisance parameter.
        let unfitted = || vec![0.0; stage_1.nuisances().count()];
        let nuisance = entry.fit.map_or_else(unfitted, |fit| fit.state.nuisance.clone());
        let edges = if fits_distortion { edges(entry.annotations) } else { Vec::new() };
        let camera = with_lens_and_height(entry, start, owner);
        let drawn: Vec<Pixel> = entry.annotations.iter().flat_map(Annotation::polylines).flatten().collect();
        View {
            outermost: outermost(drawn.iter(), camera.lens.principal_point),
            camera,
            free,
            lens,
            annotations: entry.annotations,
            stage_1,
            nuisance,
            shares_floor: gauge.is_some(),
            edge_counts: repeat_counts(edges.iter()),
            edges,
            size: entry.size,
            principal_point: entry.principal_point,
            pixel_aspect: entry.pixel_aspect,
            has_tied_focal: owner.has_tied_focal(),
        }
    }
}

impl View<'_> {
    /// Returns a flag for every lens parameter: whether it is estimated, separately or as one parameter with the
    /// focal length of the camera.
    pub(crate) fn lens_parameters(&self) -> [bool; Lens::PARAMETERS] {
        std::array::from_fn(|k| {
            self.free[Covariance::LENS + k] || self.has_tied_focal && k == Lens::LENS_FOCAL
        })
    }

    /// Returns the residuals of the priors on the free lens parameters. If `is_owner` is false, the view shares the
    /// lens of another view, and only the principal point and the pixel aspect have priors.
    pub(crate) fn lens_prior_residuals(
        &self,
        lens: &Lens,
        free: &[usize],
        is_owner: bool,
    ) -> Vec<LensResidual> {
        let free: Vec<usize> = free.iter().copied().filter(|&k| is_owner || k >= Lens::CENTRE).collect();
        let of_slope = if is_owner { slope_prior(lens, self.outermost) } else { None };
        let priors = (self.principal_point, self.pixel_aspect);
        lens_prior(lens, self.size, priors, &free).into_iter().chain(of_slope).collect()
    }

    /// Adds the derivatives with respect to the lens parameters to the derivatives with respect to the
    /// camera.
    pub(crate) fn add_lens(&self, by: &mut [f64; CAMERA_PARAMS], by_lens: &[f64; Lens::PARAMETERS]) {
        for (k, by_lens) in by_lens.iter().enumerate() {
            let is_focal = self.has_tied_focal && k == Lens::LENS_FOCAL;
            by[if is_focal { Covariance::FOCAL } else { Covariance::LENS + k }] += by_lens;
        }
    }
}

/// Returns a flag for each camera parameter: whether the adjustment estimates it.
fn free_parameters(
    entry: &BundleCamera,
    owner: &BundleCamera,
    stage_1: &Problem,
    gauge: Option<Gauge>,
) -> [bool; CAMERA_PARAMS] {
    let is_fixed = entry.initial_pose == InitialPose::Fixed;
    let fixed_pose = entry.fixed_pose;
    let is_free = |is_axis_fixed: bool, fixed: fn(Gauge) -> bool| {
        !(is_fixed || is_axis_fixed) && gauge.is_some_and(|gauge| !fixed(gauge))
    };
    let height_is_free = gauge.map_or(stage_1.free[LOG_HEIGHT], |gauge| !is_fixed && !gauge.scale);
    let mut free = [false; CAMERA_PARAMS];
    free[Covariance::X] = is_free(fixed_pose.x, |gauge| gauge.x);
    free[Covariance::Y] = is_free(fixed_pose.y, |gauge| gauge.y);
    free[Covariance::Z] = height_is_free && entry.fixed.height.is_none();
    free[Covariance::YAW] = is_free(fixed_pose.yaw, |gauge| gauge.yaw);
    free[Covariance::PITCH] = entry.fixed.pitch.is_none();
    free[Covariance::ROLL] = entry.fixed.roll.is_none();
    free[Covariance::FOCAL] = owner.fixed.focal.is_none();
    free[Covariance::LENS..Covariance::CENTRE].copy_from_slice(&owner.free_lens[..Lens::CENTRE]);
    free[Covariance::CENTRE..].copy_from_slice(&entry.free_lens[Lens::CENTRE..]);
    free[Covariance::ASPECT] = entry.pixel_aspect.is_some();
    if owner.camera.lens.distortion.is_wide() {
        free[Covariance::LENS + Lens::LENS_FOCAL] = false;
    }
    free
}

/// Returns the start camera with the focal length and distortion of the lens owner, and with the fixed height
/// if one is set.
fn with_lens_and_height(entry: &BundleCamera, start: &Camera, owner: &BundleCamera) -> Camera {
    let Lens { distortion, focal, .. } = owner.camera.lens;
    let z = entry.fixed_height().unwrap_or(start.position.z);
    Camera {
        position: WorldPoint { z, ..start.position },
        // Straight edges determine the focal length of a lens better than the lines do under a different
        // lens.
        focal: if owner.has_tied_focal() { focal } else { owner.camera.focal },
        lens: Lens { distortion, focal, ..start.lens },
        ..*start
    }
}
