//! Covariance of the camera parameters, and its propagation to quantities that are computed from them.

use crate::camera::lens::Lens;

/// Covariance matrix of the camera parameters. They are x0, y0, z0 (metres), yaw, pitch, roll (radians),
/// focal length (pixels), distortion coefficients, principal point (pixels), and pixel aspect. The
/// coefficients refer to the focal length of the lens, [`Lens::focal`].
///
/// Rows and columns of parameters that were not estimated are zero. An infinite variance means that the uncertainty
/// of the parameter is unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub [[f64; Self::SIZE]; Self::SIZE]);

impl Covariance {
    /// Number of camera parameters: rows and columns of the matrix.
    pub const SIZE: usize = Self::LENS + Lens::PARAMETERS;
    /// Index of x0, the world x of the camera.
    pub const X: usize = 0;
    /// Index of y0, the world y of the camera.
    pub const Y: usize = 1;
    /// Index of z0, the height of the camera.
    pub const Z: usize = 2;
    /// Index of the yaw.
    pub const YAW: usize = 3;
    /// Index of the pitch.
    pub const PITCH: usize = 4;
    /// Index of the roll.
    pub const ROLL: usize = 5;
    /// Index of the focal length.
    pub const FOCAL: usize = 6;
    /// Index of the first distortion coefficient. The others follow in the order of the model.
    pub const LENS: usize = 7;
    /// Index of the u coordinate of the principal point; v follows.
    pub const CENTRE: usize = Self::LENS + Lens::CENTRE;
    /// Index of the pixel aspect.
    pub const ASPECT: usize = Self::LENS + Lens::ASPECT;
    /// Names in files of the parameters before the distortion coefficients. The suffix is the unit in files.
    pub const NAMES: [&str; Self::LENS] =
        ["x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg", "focal_px"];
    /// Covariance of a camera whose parameters have no errors: all zeros.
    pub const EXACT: Self = Self([[0.0; Self::SIZE]; Self::SIZE]);

    /// Covariance of a camera with an unknown uncertainty, for example of an imported camera. All variances are
    /// infinite.
    pub const UNKNOWN: Self = {
        let mut rows = [[0.0; Self::SIZE]; Self::SIZE];
        let mut index = 0;
        while index < Self::SIZE {
            rows[index][index] = f64::INFINITY;
            index += 1;
        }
        Self(rows)
    };

    /// Returns the standard deviation of the parameter with this index, in the unit of the parameter. Returns `None`
    /// if the parameter was not estimated or its uncertainty is unknown.
    #[must_use]
    pub fn sigma(&self, index: usize) -> Option<f64> {
        let variance = self.0[index][index];
        (variance > 0.0 && variance.is_finite()).then(|| variance.sqrt())
    }

    /// Returns the covariance in which the uncertainty of the parameters with the given indices is unknown.
    pub fn with_unknown(mut self, unknown: &[usize]) -> Self {
        for &index in unknown {
            self.0[index] = [0.0; Self::SIZE];
            self.0.iter_mut().for_each(|row| row[index] = 0.0);
            self.0[index][index] = f64::INFINITY;
        }
        self
    }

    /// Whether the uncertainties of all parameters are known. An uncertainty of zero counts as known.
    #[must_use]
    pub fn is_known(&self) -> bool {
        (0..Self::SIZE).all(|index| self.0[index][index].is_finite())
    }

    /// Returns the covariance after every parameter p is replaced by `scale p + by_focal focal`. `scale` and
    /// `by_focal` contain one factor for each parameter. Returns [`Self::UNKNOWN`] if an uncertainty is unknown.
    pub fn with_correlated_shift(&self, scale: &[f64; Self::SIZE], by_focal: &[f64; Self::SIZE]) -> Self {
        if !self.is_known() {
            return Self::UNKNOWN;
        }
        // The rows are replaced first, then the columns. The matrix is symmetric.
        let mut rows = self.0;
        for i in 0..Self::SIZE {
            rows[i] = std::array::from_fn(|j| scale[i] * self.0[i][j] + by_focal[i] * self.0[Self::FOCAL][j]);
        }
        Self(std::array::from_fn(|i| {
            std::array::from_fn(|j| scale[j] * rows[i][j] + by_focal[j] * rows[i][Self::FOCAL])
        }))
    }

    /// Propagates the covariance to a pair of quantities. `jacobian` contains the derivatives of both quantities with
    /// respect to each parameter. Returns `None` if an uncertainty is unknown.
    #[must_use]
    pub fn propagate(&self, jacobian: &[[f64; 2]; Self::SIZE]) -> Option<[[f64; 2]; 2]> {
        self.is_known().then(|| {
            std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let row = |a: usize| (0..Self::SIZE).map(|b| self.0[a][b] * jacobian[b][j]).sum::<f64>();
                    (0..Self::SIZE).map(|a| jacobian[a][i] * row(a)).sum()
                })
            })
        })
    }
}

impl Default for Covariance {
    fn default() -> Self {
        Self::EXACT
    }
}
