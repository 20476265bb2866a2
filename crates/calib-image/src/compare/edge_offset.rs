//! How far edges are from where a turn would have them.

use nalgebra::DVector;

use calib_core::camera::Turn;

/// Parameters of what light does to edges.
pub const TONE: usize = 3;
/// Parameters of a step.
pub const STEP: usize = 3;

/// How far an edge is, across itself, from where it is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeOffset {
    /// In pixels.
    pub offset: f64,
    /// The direction in the image that it is counted along, a unit vector.
    pub across: [f64; 2],
    /// Its noise, in pixels.
    pub sigma: f64,
    /// Derivatives of where the edge is, across itself, by a turn.
    pub turn: [f64; Turn::SIZE],
    /// How much the light on it may move it: its contrast towards the side that offsets count to, by powers of its level.
    pub tone: [f64; TONE],
    /// Derivatives by a step.
    pub step: [f64; STEP],
    /// Which part of the image it is in.
    pub block: usize,
    /// Of which edge it is one of several places; these stand one after the other.
    pub edge: Option<usize>,
}

impl EdgeOffset {
    /// Derivatives by everything that may be estimated, in its order.
    pub(super) fn by(&self, k: usize) -> f64 {
        const FROM: usize = Turn::SIZE + TONE;
        match k {
            0..Turn::SIZE => self.turn[k],
            Turn::SIZE..FROM => self.tone[k - Turn::SIZE],
            _ => self.step[k - FROM],
        }
    }

    /// The offset that these parameters tell.
    #[must_use]
    pub fn told(&self, estimate: &DVector<f64>) -> f64 {
        (0..estimate.len()).map(|k| self.by(k) * estimate[k]).sum()
    }
}
