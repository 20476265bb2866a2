//! Parameters of one camera: orientation, fixed values, normal priors, priors on planes, and the choice of
//! distortion coefficients.

use crate::camera::{Distortion, DistortionModel, ImageCircle, Pixel, Plane};

/// Plane of the scene, with the uncertainty of its height and slope.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanePrior {
    /// Id for references from annotations.
    pub id: String,
    /// Expected height and slope of the plane.
    pub plane: Plane,
    /// Unit vector (x, y) of the horizontal direction in which the plane falls; +x if the direction is not known.
    pub along: [f64; 2],
    /// Standard deviations of the height in metres, and of the slope along and across the fall in rise per
    /// metre; 0 if fixed.
    pub sigma: [f64; 3],
}

/// Assumed distance of a camera from the anchor of a plane that it sees, in metres.
const ANCHOR_DISTANCE_M: f64 = 10.0;

impl PlanePrior {
    /// Returns a plane that is known exactly.
    #[must_use]
    pub fn fixed(id: impl Into<String>, plane: Plane) -> Self {
        Self { id: id.into(), plane, along: [1.0, 0.0], sigma: [0.0; 3] }
    }

    /// Whether the plane is fixed: neither its height nor its slope is estimated.
    #[must_use]
    pub fn is_fixed(&self) -> bool {
        self.sigma == [0.0; 3]
    }

    /// Returns the covariance of the height (in metres) and of the slopes in x and y (in rise per metre).
    #[must_use]
    pub fn covariance(&self) -> [[f64; 3]; 3] {
        let rows = self.directions();
        let entry = |i: usize, j: usize| -> f64 {
            (0..3).map(|k| self.sigma[k] * self.sigma[k] * rows[k][i] * rows[k][j]).sum()
        };
        std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
    }

    /// Returns the rotation from (height, slope in x, slope in y) to (height, slope along the fall, slope across the
    /// fall), row by row.
    pub(crate) fn directions(&self) -> [[f64; 3]; 3] {
        let [x, y] = self.along;
        [[1.0, 0.0, 0.0], [0.0, x, y], [0.0, -y, x]]
    }

    /// Returns the root mean square of the slope in an unknown direction, in rise per metre. A camera without a
    /// pose has an unknown direction.
    pub(crate) fn slope_in_any_direction(&self) -> f64 {
        let [x, y] = self.plane.slope;
        let [_, along, across] = self.sigma;
        (0.5 * (x * x + y * y + along * along + across * across)).sqrt()
    }

    /// Returns the standard deviation of the height of the plane under a camera without a pose, in metres.
    pub(crate) fn height_sigma_under_camera(&self) -> f64 {
        self.sigma[0].hypot(self.slope_in_any_direction() * ANCHOR_DISTANCE_M)
    }
}

/// Distortion model, and the selection of the coefficients that are fitted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FittedCoefficients {
    /// Distortion model.
    pub model: DistortionModel,
    /// Flag for every coefficient: whether it is fitted, in the order of [`Distortion::coefficients`].
    pub which: [bool; Distortion::MAX_FITTED],
}

impl FittedCoefficients {
    /// Selects the first `count` coefficients of a model.
    #[must_use]
    pub fn first(model: DistortionModel, count: usize) -> Self {
        Self { model, which: std::array::from_fn(|k| k < count) }
    }

    /// Returns the number of fitted coefficients.
    pub(super) fn len(&self) -> usize {
        self.which.iter().filter(|&&is| is).count()
    }

    /// Returns the indices of the fitted coefficients in the model.
    pub(crate) fn indices(&self) -> Vec<usize> {
        (0..Distortion::MAX_FITTED).filter(|&k| self.which[k]).collect()
    }

    /// Whether the coefficients are valid for one focal length only. This focal length is either given or fitted with
    /// the coefficients.
    pub fn has_own_focal(&self) -> bool {
        self.model.row().focal_powers.is_none()
    }

    /// Whether the lens also shows rays from beside and behind the camera.
    pub(crate) fn is_wide(&self) -> bool {
        self.model.row().is_wide
    }

    /// Returns the distortion with these values of the fitted coefficients.
    pub(super) fn distortion(&self, values: &[f64]) -> Distortion {
        let mut full = [0.0; Distortion::MAX_FITTED];
        for (&value, k) in values.iter().zip(self.indices()) {
            full[k] = value;
        }
        self.model.row().zero.with_fitted_coefficients(full)
    }
}

/// Orientation and focal length of a camera, the result of stage 1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Orientation {
    /// Roll, in radians.
    pub roll: f64,
    /// Pitch, in radians, positive down.
    pub pitch: f64,
    /// Focal length, in pixels.
    pub focal: f64,
}

/// Fixed values of parameters; `None` for a parameter that is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FixedParameters {
    /// Roll, in radians.
    pub roll: Option<f64>,
    /// Pitch, in radians.
    pub pitch: Option<f64>,
    /// Focal length, in pixels.
    pub focal: Option<f64>,
    /// Height, in metres. The paper's method never estimates the height; it assumes the height of stage 1 if this
    /// value is `None`.
    pub height: Option<f64>,
}

/// Normal prior on one parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Mean, in the unit of the parameter: radians, pixels, metres.
    pub value: f64,
    /// Standard deviation, in the unit of `value`.
    pub sigma: f64,
}

/// Priors on roll, pitch, focal length and height.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Priors {
    /// Prior on the roll, in radians.
    pub roll: Option<Prior>,
    /// Prior on the pitch, in radians.
    pub pitch: Option<Prior>,
    /// Prior on the focal length, in pixels.
    pub focal: Option<Prior>,
    /// Prior on the height of the camera, in metres.
    pub height: Option<Prior>,
    /// Weak prior on the log of the focal length in pixels, used if the constraints contain little
    /// information about it.
    pub weak_log_focal: Option<Prior>,
}

/// Standard deviation of each coordinate of a fisheye's principal point from the image centre, as a fraction of
/// the image diagonal. Sensors of small fisheyes are some percent off the lens axis.
const FISHEYE_SIGMA_PER_DIAGONAL: f64 = 0.02;

/// Standard deviation of each coordinate of a fisheye's principal point from the centre of the image circle, as
/// a fraction of the circle's radius. A stop or the mount, slightly off the lens axis, produces the rim.
const FISHEYE_SIGMA_PER_RADIUS: f64 = 0.01;

/// Standard deviation of each coordinate of the principal point from the image centre, as a fraction of the
/// longer side of the image.
///
/// Restricted maximum likelihood over 639 photographs of rooms with annotated lines, with the principal point
/// integrated out, is best at 2.0 to 2.3 %. Published calibrations of three cameras are off by 1.7 %, 1.8 %
/// and 2.8 % per coordinate.
const SIGMA_PER_SIDE: f64 = 0.022;

/// Standard deviation of each coordinate of the principal point of a cropped image from its centre, as a
/// fraction of the longer side. An assumption: the window is anywhere in an image of twice its size.
const CROP_SIGMA_PER_SIDE: f64 = 0.25;

/// Normal prior on the principal point; both coordinates have the same standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipalPointPrior {
    /// Expected principal point, in raw pixels.
    pub value: Pixel,
    /// Standard deviation of each coordinate, in pixels.
    pub sigma: f64,
}

impl PrincipalPointPrior {
    /// Returns the prior for a camera about which nothing is known except its image size: the principal point
    /// is near the image centre.
    #[must_use]
    pub fn of_image([w, h]: [f64; 2]) -> Self {
        Self { value: Pixel::new(0.5 * w, 0.5 * h), sigma: SIGMA_PER_SIDE * w.max(h) }
    }

    /// Returns the prior for an image that is cropped: the principal point is anywhere in the image or near it.
    #[must_use]
    pub fn of_crop([w, h]: [f64; 2]) -> Self {
        Self { sigma: CROP_SIGMA_PER_SIDE * w.max(h), ..Self::of_image([w, h]) }
    }

    /// Whether a principal point is farther from the expected one than three standard deviations.
    #[must_use]
    pub fn contradicts(&self, at: Pixel) -> bool {
        at.distance(self.value) > 3.0 * self.sigma
    }

    /// Returns the prior for a fisheye: the principal point is near the centre of its image circle, or without
    /// a known circle near the image centre.
    #[must_use]
    pub fn of_fisheye([w, h]: [f64; 2], circle: Option<ImageCircle>) -> Self {
        match circle {
            Some(circle) => Self { value: circle.centre(), sigma: FISHEYE_SIGMA_PER_RADIUS * circle.radius },
            None => {
                Self { value: Pixel::new(0.5 * w, 0.5 * h), sigma: FISHEYE_SIGMA_PER_DIAGONAL * w.hypot(h) }
            }
        }
    }
}
