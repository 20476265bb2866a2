//! Which coefficients of a lens are fitted.

use crate::camera::{Distortion, DistortionModel};

/// Which coefficients are fitted, of which model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fitted {
    /// The model.
    pub model: DistortionModel,
    /// Which of its coefficients, in the order of [`Distortion::coefficients`].
    pub which: [bool; Distortion::MOST],
}

impl Fitted {
    /// The first coefficients of a model.
    #[must_use]
    pub fn first(model: DistortionModel, count: usize) -> Self {
        Self { model, which: std::array::from_fn(|k| k < count) }
    }

    pub(super) fn len(&self) -> usize {
        self.which.iter().filter(|&&is| is).count()
    }

    /// Indices of what is fitted among the coefficients of the model.
    pub(crate) fn indices(&self) -> Vec<usize> {
        (0..Distortion::MOST).filter(|&k| self.which[k]).collect()
    }

    /// Whether the coefficients refer to a focal that must be known beforehand.
    pub fn has_own_focal(&self) -> bool {
        self.model.row().powers.is_none()
    }

    /// Whether the lens shows rays from beside and behind the camera, too.
    pub(crate) fn is_wide(&self) -> bool {
        self.model.row().is_wide
    }

    /// The distortion with these values of what is fitted.
    pub(super) fn distortion(&self, values: &[f64]) -> Distortion {
        let mut full = [0.0; Distortion::MOST];
        for (&value, k) in values.iter().zip(self.indices()) {
            full[k] = value;
        }
        self.model.row().zero.with_coefficients(full)
    }
}
