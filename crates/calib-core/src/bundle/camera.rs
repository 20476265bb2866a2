//! A camera as it enters the adjustment: its initial values, its constraints, and which of its parameters are
//! estimated.

use crate::camera::{Camera, Covariance, ImageCircle, Lens, Pixel, WorldPoint};
use crate::single::{
    Annotation, Constraints, Edge, Fit, FitOptions, FixedParameters, LOG_HEIGHT, LensResidual, Prior, Priors,
    Problem, edges, lens_prior, outermost, slope_prior, times_drawn, weak_prior,
};

/// Parameters of a camera, those of its lens among them, in the order of [`Covariance`].
pub(crate) const CAMERA_PARAMS: usize = Covariance::SIZE;

/// What is known of position and yaw of a camera before the adjustment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InitialPose {
    /// Nothing: they are initialised from landmarks that other cameras or control points place.
    Unknown,
    /// Approximate: where nothing else fixes the gauge of a component of the view graph, its first such
    /// camera does.
    Approximate,
    /// Exact: position and yaw are not estimated.
    Fixed,
}

/// Which of position and yaw are held by themselves: they are not estimated, while the others are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeldPose {
    /// x0.
    pub x: bool,
    /// y0.
    pub y: bool,
    /// The yaw.
    pub yaw: bool,
}

impl HeldPose {
    /// How many are held.
    pub(crate) fn count(self) -> usize {
        [self.x, self.y, self.yaw].into_iter().filter(|held| *held).count()
    }

    /// Whether both numbers of the position are held.
    pub(crate) const fn is_at(self) -> bool {
        self.x && self.y
    }

    /// `camera` with what is held as `known` has it, to the last bit.
    pub(crate) fn put(self, known: &Camera, camera: Camera) -> Camera {
        let pick = |is_held: bool, known: f64, other: f64| if is_held { known } else { other };
        let (at, now) = (known.position, camera.position);
        let position = WorldPoint { x: pick(self.x, at.x, now.x), y: pick(self.y, at.y, now.y), z: now.z };
        Camera { position, yaw: pick(self.yaw, known.yaw, camera.yaw), ..camera }
    }
}

/// A camera of a [`BundleAdjustment`](crate::BundleAdjustment).
#[derive(Clone, Debug)]
pub struct BundleCamera<'a> {
    /// Where it starts; also the values of the parameters that are not estimated. Of a camera whose
    /// initial pose is unknown, height, roll, pitch, focal and lens are used, as stage 1 leaves them.
    pub camera: Camera,
    /// What is known of position and yaw.
    pub initial_pose: InitialPose,
    /// Which of position and yaw hold as `camera` has them, whatever is known of the others.
    pub held: HeldPose,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Where the scene is in the image of a fisheye, if that is known.
    pub circle: Option<ImageCircle>,
    /// Which of roll, pitch, focal and height are not estimated. A fixed height takes the place of the
    /// camera's; of the others the camera's values hold.
    pub fixed: FixedParameters,
    /// Priors on roll, pitch, focal and height.
    pub priors: Priors,
    /// What was drawn on the image: evaluated anew wherever the distortion is estimated.
    pub annotations: &'a [Annotation],
    /// The constraints of the annotations under the camera's own lens.
    pub constraints: &'a Constraints,
    /// The fit of this camera alone: its outliers stay rejected, its noise is used, and its nuisance
    /// parameters are the initial ones. Needed wherever there are constraints.
    pub fit: Option<&'a Fit>,
    /// The standard deviations of what was drawn are known: they are not inflated where the residuals are
    /// larger.
    pub noise_is_known: bool,
    /// Index of the camera whose focal and distortion this one shares, if any. That camera must have a lens of
    /// its own.
    pub lens_of: Option<usize>,
    /// Which parameters of the lens are estimated, in the order of [`Lens::PARAMETERS`]; of a shared lens those of its
    /// own camera count. With its own focal a wide lens has that of the camera.
    pub free_lens: [bool; Lens::PARAMETERS],
}

/// The constraints of a camera on which nothing was drawn.
static NO_CONSTRAINTS: Constraints = Constraints::EMPTY;

impl<'a> BundleCamera<'a> {
    /// A camera of known roll, pitch, focal and lens, on which nothing was drawn: position and
    /// yaw are estimated from nothing, the height from where it is in `camera`. `size` is that of the
    /// image, in pixels.
    #[must_use]
    pub fn new(camera: Camera, size: [f64; 2]) -> Self {
        Self {
            camera,
            initial_pose: InitialPose::Unknown,
            held: HeldPose::default(),
            size,
            circle: None,
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
            lens_of: None,
            free_lens: [false; Lens::PARAMETERS],
        }
    }

    /// The camera as the fit of it alone left it, with all that the fit used.
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

    /// The residuals of stage 1 with what the fit of the camera alone made of them.
    pub(crate) fn stage_1(&self) -> Problem<'a> {
        let width = self.size[0];
        let sigma = self.fit.map_or(1.0, |fit| fit.sigma);
        let rejected = self.fit.map_or(&[][..], |fit| &fit.outliers[..]);
        let weak_log_focal: Option<Prior> =
            self.fit.filter(|fit| fit.weak_prior_used).map(|_| weak_prior(width));
        let focal = self.priors.focal.filter(|_| self.fixed.focal.is_none());
        let priors = Priors { focal, weak_log_focal, ..self.priors };
        Problem { rejected, ..Problem::new(self.constraints, self.fixed, priors, sigma, width) }
    }

    /// Whether its height is determined by anything but its placement.
    pub(crate) fn height_is_known(&self) -> bool {
        self.initial_pose != InitialPose::Fixed
            && (self.fixed.height.is_some() || self.stage_1().free[LOG_HEIGHT])
    }

    /// Its height, where it is fixed.
    pub(crate) fn fixed_height(&self) -> Option<f64> {
        self.fixed.height.filter(|_| self.initial_pose != InitialPose::Fixed)
    }

    /// Index of the camera whose lens it has, of this one at `index`.
    pub(crate) fn lens_owner(&self, index: usize) -> usize {
        self.lens_of.unwrap_or(index)
    }

    /// Whether its wide lens has the focal of the camera.
    fn has_one_focal(&self) -> bool {
        self.camera.lens.distortion.is_wide() && self.free_lens[Lens::OWN_FOCAL] && self.fixed.focal.is_none()
    }

    pub(crate) fn fits_distortion(&self) -> bool {
        self.free_lens.contains(&true)
    }
}

/// Which of position, yaw and scale of its component the placement of a camera fixes, because nothing else
/// does: the gauge of the adjustment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Gauge {
    pub(crate) x: bool,
    pub(crate) y: bool,
    pub(crate) yaw: bool,
    pub(crate) scale: bool,
}

/// A camera with its residuals of stage 1, as a part of one problem.
#[derive(Clone, Debug)]
pub(crate) struct View<'a> {
    /// Where it starts, and the values of what is not estimated.
    pub(crate) camera: Camera,
    /// Which of its parameters are estimated; those of the lens are those of the first view that has it.
    pub(crate) free: [bool; CAMERA_PARAMS],
    /// Index of the lens, focal included; views with the same index share it.
    pub(crate) lens: usize,
    /// What was drawn, for the constraints under another lens.
    pub(crate) annotations: &'a [Annotation],
    /// Constraints, priors and what was rejected, under the lens it starts with.
    pub(crate) stage_1: Problem<'a>,
    /// Directions and lengths of stage 1, where they start.
    pub(crate) nuisance: Vec<f64>,
    /// Whether it stands on the floor of its cluster, and not on one of its own.
    pub(crate) shares_floor: bool,
    /// Lines that are straight in space.
    pub(crate) edges: Vec<Edge>,
    /// How often each of them is drawn.
    pub(crate) edge_times: Vec<f64>,
    /// The drawn point that is farthest from the middle of its lens.
    pub(crate) outermost: Option<Pixel>,
    /// Width and height of the image, in pixels.
    pub(crate) size: [f64; 2],
    /// Where the scene is in it, of a fisheye, if that is known.
    pub(crate) circle: Option<ImageCircle>,
    /// Whether its wide lens has the focal of the camera, and changes with it.
    pub(crate) has_one_focal: bool,
}

impl<'a> View<'a> {
    /// The view of a camera that starts at `start`, with the lens of `owner`, which is number `lens` of its
    /// problem. Without a gauge the camera is not connected, and position and yaw stay fixed.
    pub(crate) fn new(
        entry: &BundleCamera<'a>,
        start: &Camera,
        owner: &BundleCamera,
        lens: usize,
        gauge: Option<Gauge>,
    ) -> Self {
        let stage_1 = entry.stage_1();
        let free = free_parameters(entry, owner, &stage_1, gauge);
        let fits_lens = owner.fits_distortion();
        // Without a fit there is nothing drawn on which a nuisance parameter depends.
        let unfitted = || vec![0.0; stage_1.nuisances().count()];
        let nuisance = entry.fit.map_or_else(unfitted, |fit| fit.state.nuisance.clone());
        let edges = if fits_lens { edges(entry.annotations) } else { Vec::new() };
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
            edge_times: times_drawn(edges.iter()),
            edges,
            size: entry.size,
            circle: entry.circle,
            has_one_focal: owner.has_one_focal(),
        }
    }
}

impl View<'_> {
    /// The parameters of its lens on which residuals depend, by their indices.
    pub(crate) fn lens_parameters(&self) -> [bool; Lens::PARAMETERS] {
        std::array::from_fn(|k| self.free[Covariance::LENS + k] || self.has_one_focal && k == Lens::OWN_FOCAL)
    }

    /// What is believed of the parameters of its lens that are free.
    pub(crate) fn beliefs(&self, lens: &Lens, free: &[usize]) -> Vec<LensResidual> {
        let of_slope = slope_prior(lens, self.outermost);
        lens_prior(lens, (self.size, self.circle), free).into_iter().chain(of_slope).collect()
    }

    /// Adds derivatives by the parameters of its lens to those by the camera.
    pub(crate) fn add_lens(&self, by: &mut [f64; CAMERA_PARAMS], by_lens: &[f64; Lens::PARAMETERS]) {
        for (k, by_lens) in by_lens.iter().enumerate() {
            let is_focal = self.has_one_focal && k == Lens::OWN_FOCAL;
            by[if is_focal { Covariance::FOCAL } else { Covariance::LENS + k }] += by_lens;
        }
    }
}

fn free_parameters(
    entry: &BundleCamera,
    owner: &BundleCamera,
    stage_1: &Problem,
    gauge: Option<Gauge>,
) -> [bool; CAMERA_PARAMS] {
    let is_fixed = entry.initial_pose == InitialPose::Fixed;
    let held = entry.held;
    let is_free = |is_held: bool, fixed: fn(Gauge) -> bool| {
        !(is_fixed || is_held) && gauge.is_some_and(|gauge| !fixed(gauge))
    };
    let height_is_free = gauge.map_or(stage_1.free[LOG_HEIGHT], |gauge| !is_fixed && !gauge.scale);
    let mut free = [false; CAMERA_PARAMS];
    free[Covariance::X] = is_free(held.x, |gauge| gauge.x);
    free[Covariance::Y] = is_free(held.y, |gauge| gauge.y);
    free[Covariance::Z] = height_is_free && entry.fixed.height.is_none();
    free[Covariance::YAW] = is_free(held.yaw, |gauge| gauge.yaw);
    free[Covariance::PITCH] = entry.fixed.pitch.is_none();
    free[Covariance::ROLL] = entry.fixed.roll.is_none();
    free[Covariance::FOCAL] = owner.fixed.focal.is_none();
    free[Covariance::LENS..].copy_from_slice(&owner.free_lens);
    if owner.camera.lens.distortion.is_wide() {
        free[Covariance::LENS + Lens::OWN_FOCAL] = false;
    }
    free
}

/// A camera with the focal and distortion of the one whose lens it has, at its fixed height if any.
fn with_lens_and_height(entry: &BundleCamera, start: &Camera, owner: &BundleCamera) -> Camera {
    let Lens { distortion, focal, .. } = owner.camera.lens;
    let z = entry.fixed_height().unwrap_or(start.position.z);
    Camera {
        position: WorldPoint { z, ..start.position },
        // Straight edges know the focal of a lens better than the lines do under a lens of another.
        focal: if owner.has_one_focal() { focal } else { owner.camera.focal },
        lens: Lens { distortion, focal, ..start.lens },
        ..*start
    }
}
