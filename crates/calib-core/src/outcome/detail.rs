//! What findings name beside subjects and numbers: reasons, estimators, kinds of evidence.

/// Another local minimum: a camera that the lines fit as well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherMinimum {
    /// In pixels.
    pub focal: f64,
    /// In radians.
    pub pitch: f64,
}

/// The estimator that does not use something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// The maximum-likelihood fit.
    MaximumLikelihood,
    /// The paper's criterion.
    Paper,
}

/// Why cameras are not connected to the rest of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhyNotConnected {
    /// They share too few landmarks with the others to be placed by them.
    TooLittle,
    /// They share nothing and keep the placement of the operator.
    Placed,
    /// They share nothing.
    Alone,
}

/// Why something that cameras share is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhyUnused {
    /// A camera that observes it cannot show the place that the others give it.
    OutOfSight,
    /// One camera alone shows it.
    SeenOnce,
    /// A distance: an end of it has no place, or its length is not given.
    Unmeasured,
    /// Cameras: no poses were found from which everything shared is visible.
    Unfitted,
}

/// Evidence that cameras share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SharedEvidence {
    /// Links.
    Links,
    /// Marks tied to pixels.
    Marks,
    /// Distances.
    Distances,
}
