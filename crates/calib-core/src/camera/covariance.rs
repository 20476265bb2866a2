//! The covariance of a camera's parameters, and its propagation to quantities computed from them.

use crate::camera::lens::Lens;

/// Covariance of x0, y0, z0 (metres), yaw, pitch, roll (radians), focal (pixels), the coefficients
/// of the distortion, for the focal that the lens normalises with, and the principal point (pixels); rows and columns
/// of zeros for what was not estimated. An infinite variance says that nothing is known of the error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub [[f64; Self::SIZE]; Self::SIZE]);

impl Covariance {
    /// Number of unknowns.
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
    /// Index of the focal.
    pub const FOCAL: usize = 6;
    /// Index of the first coefficient of the distortion; they follow in the order of its model.
    pub const LENS: usize = 7;
    /// Index of the principal point's u; v follows.
    pub const CENTRE: usize = Self::LENS + Lens::CENTRE;
    /// Names in files of the unknowns before the distortion's, with their units there.
    pub const NAMES: [&str; Self::LENS] =
        ["x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg", "focal_px"];
    /// Everything is known for certain.
    pub const EXACT: Self = Self([[0.0; Self::SIZE]; Self::SIZE]);

    /// Nothing is known of the errors, as of a camera that was imported without them.
    pub const UNKNOWN: Self = {
        let mut rows = [[0.0; Self::SIZE]; Self::SIZE];
        let mut index = 0;
        while index < Self::SIZE {
            rows[index][index] = f64::INFINITY;
            index += 1;
        }
        Self(rows)
    };

    /// Standard deviation of one unknown; `None` if it was not estimated, or nothing is known of it.
    #[must_use]
    pub fn sigma(&self, index: usize) -> Option<f64> {
        let variance = self.0[index][index];
        (variance > 0.0 && variance.is_finite()).then(|| variance.sqrt())
    }

    /// The same where nothing is known of the errors of some unknowns, by their indices.
    pub fn without(mut self, unknown: &[usize]) -> Self {
        for &index in unknown {
            self.0[index] = [0.0; Self::SIZE];
            self.0.iter_mut().for_each(|row| row[index] = 0.0);
            self.0[index][index] = f64::INFINITY;
        }
        self
    }

    /// Whether the errors are known; an error of zero is.
    #[must_use]
    pub fn is_known(&self) -> bool {
        (0..Self::SIZE).all(|index| self.0[index][index].is_finite())
    }

    /// Covariance of `scale * unknown + by_focal * focal` in place of the unknowns.
    pub fn with_correlated_shift(&self, scale: &[f64; Self::SIZE], by_focal: &[f64; Self::SIZE]) -> Self {
        if !self.is_known() {
            return Self::UNKNOWN;
        }
        // The rows first, then the columns of what that gives: the matrix is symmetric.
        let mut rows = self.0;
        for i in 0..Self::SIZE {
            rows[i] = std::array::from_fn(|j| scale[i] * self.0[i][j] + by_focal[i] * self.0[Self::FOCAL][j]);
        }
        Self(std::array::from_fn(|i| {
            std::array::from_fn(|j| scale[j] * rows[i][j] + by_focal[j] * rows[i][Self::FOCAL])
        }))
    }

    /// Covariance of a pair of quantities with these derivatives by the unknowns; `None` where nothing is known
    /// of the errors.
    #[must_use]
    pub fn carried(&self, jacobian: &[[f64; 2]; Self::SIZE]) -> Option<[[f64; 2]; 2]> {
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
