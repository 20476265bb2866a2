//! The covariance of a camera's parameters, and its propagation to quantities computed from them.

use crate::camera::lens::Lens;

/// Covariance of a camera's unknowns: x0, y0, z0 (metres), yaw, pitch, roll (radians), focal (pixels),
/// distortion coefficients (for the focal that the lens normalises with), and principal point (pixels). Rows
/// and columns of parameters that were not estimated are zero. An infinite variance means that the error is
/// unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub [[f64; Self::SIZE]; Self::SIZE]);

impl Covariance {
    /// Number of parameters.
    pub const SIZE: usize = Self::LENS + Lens::PARAMETERS;
    /// Index of x0.
    pub const X: usize = 0;
    /// Index of y0.
    pub const Y: usize = 1;
    /// Index of z0.
    pub const Z: usize = 2;
    /// Index of yaw.
    pub const YAW: usize = 3;
    /// Index of pitch.
    pub const PITCH: usize = 4;
    /// Index of roll.
    pub const ROLL: usize = 5;
    /// Index of the focal length.
    pub const FOCAL: usize = 6;
    /// Index of the first distortion coefficient. The others follow in the order of the model.
    pub const LENS: usize = 7;
    /// Index of the u coordinate of the principal point; v follows.
    pub const CENTRE: usize = Self::LENS + Lens::CENTRE;
    /// Names of the parameters before the distortion coefficients in files, with their units there.
    pub const NAMES: [&str; Self::LENS] =
        ["x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg", "focal_px"];
    /// Covariance of a camera without errors.
    pub const EXACT: Self = Self([[0.0; Self::SIZE]; Self::SIZE]);

    /// Covariance with unknown errors, for example of a camera that was imported without uncertainty.
    pub const UNKNOWN: Self = {
        let mut rows = [[0.0; Self::SIZE]; Self::SIZE];
        let mut index = 0;
        while index < Self::SIZE {
            rows[index][index] = f64::INFINITY;
            index += 1;
        }
        Self(rows)
    };

    /// Returns the standard deviation of one unknown; `None` if it was not estimated or is not known.
    #[must_use]
    pub fn sigma(&self, index: usize) -> Option<f64> {
        let variance = self.0[index][index];
        (variance > 0.0 && variance.is_finite()).then(|| variance.sqrt())
    }

    /// Returns the covariance with unknown errors of some unknowns, given by their indices.
    pub fn with_unknown(mut self, unknown: &[usize]) -> Self {
        for &index in unknown {
            self.0[index] = [0.0; Self::SIZE];
            self.0.iter_mut().for_each(|row| row[index] = 0.0);
            self.0[index][index] = f64::INFINITY;
        }
        self
    }

    /// Whether all errors are known. An error of zero counts as known.
    #[must_use]
    pub fn is_known(&self) -> bool {
        (0..Self::SIZE).all(|index| self.0[index][index].is_finite())
    }

    /// Returns the covariance of `scale * unknown + by_focal * focal`, which replace the unknowns.
    pub fn with_correlated_shift(&self, scale: &[f64; Self::SIZE], by_focal: &[f64; Self::SIZE]) -> Self {
        if !self.is_known() {
            return Self::UNKNOWN;
        }
        // First the rows, then the columns of the result; the matrix is symmetric.
        let mut rows = self.0;
        for i in 0..Self::SIZE {
            rows[i] = std::array::from_fn(|j| scale[i] * self.0[i][j] + by_focal[i] * self.0[Self::FOCAL][j]);
        }
        Self(std::array::from_fn(|i| {
            std::array::from_fn(|j| scale[j] * rows[i][j] + by_focal[j] * rows[i][Self::FOCAL])
        }))
    }

    /// Propagates the covariance to a pair of quantities with these derivatives; `None` if an error is
    /// unknown.
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
