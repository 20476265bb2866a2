//! Confidence of an automatic calibration, and the reasons that reduce it.

use std::fmt;

use crate::bars::Bars;

/// Confidence of an automatic calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub enum Confidence {
    /// Usable without review.
    Sure,
    /// Likely, but needs review.
    Check,
    /// Not usable.
    None,
}

impl Confidence {
    /// Returns the name of the confidence in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sure => "sure",
            Self::Check => "check",
            Self::None => "none",
        }
    }
}

/// Reason for a reduced confidence.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Reason {
    /// Too few straight edges to find directions.
    FewEdges {
        /// Number of edges found.
        found: usize,
    },
    /// Round image with an unknown lens: a fisheye has more distortion than the grouping can estimate.
    RoundImage,
    /// No vanishing points beyond chance.
    NoDirections,
    /// No vertical edges.
    NoVerticals,
    /// Only one floor direction, which does not determine the focal length.
    OneDirection {
        /// Relative standard deviation of the focal length.
        sigma: f64,
    },
    /// Directions that do not determine the focal length.
    FocalUncertain {
        /// Relative standard deviation of the focal length.
        sigma: f64,
    },
    /// Another camera that explains the edges nearly as well.
    TwoHypotheses {
        /// Focal lengths of the solution and of the alternative solution, in pixels.
        focals: [f64; 2],
    },
    /// Roll or focal length unusual for installed cameras.
    Unusual {
        /// Focal length, in pixels.
        focal: f64,
    },
    /// Image size with which recorders code pixels that are not square, without a known pixel aspect.
    PixelsNotSquare {
        /// Usual pixel aspect of images of this size.
        aspect: f64,
    },
    /// Black bars that are wider at one side, so that the principal point is not near the image centre.
    Bars {
        /// Bars of the image.
        bars: Bars,
    },
    /// Camera that may hang upside down: it looks up.
    MayBeUpsideDown {
        /// Pitch, in degrees.
        pitch_deg: f64,
    },
    /// Camera that may lie on its side: it looks straight ahead, and a floor direction could be the vertical.
    MayLieOnItsSide,
    /// Known focal length that contradicts the edges.
    FocalConflict,
    /// Contradictory edges: residuals larger than their noise.
    Misfit {
        /// Chi-square of the residuals, divided by the degrees of freedom.
        chi2_per_dof: f64,
    },
}

/// Messages for the operator.
impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewEdges { found } => {
                write!(f, "too few straight edges were found ({found}); draw more lines by hand")
            }
            Self::RoundImage => f.write_str(
                "the image is round (fisheye), and its lens is unknown; draw long straight edges by hand, then try again",
            ),
            Self::NoDirections => {
                f.write_str("the edges have no common directions; draw verticals and floor lines by hand")
            }
            Self::NoVerticals => f.write_str("no vertical edges were found; draw verticals by hand"),
            Self::OneDirection { sigma } => write!(
                f,
                "the edges have only one floor direction, and the focal length is uncertain (\u{b1} {:.0} %); draw floor lines in another direction",
                100.0 * sigma
            ),
            Self::FocalUncertain { sigma } => write!(
                f,
                "the focal length is uncertain (\u{b1} {:.0} %); draw floor lines that run away from the camera",
                100.0 * sigma
            ),
            Self::TwoHypotheses { focals: [one, other] } => write!(
                f,
                "focal lengths of {one:.0} px and {other:.0} px fit the edges equally well; check which lines belong together"
            ),
            Self::Unusual { focal } => write!(
                f,
                "the roll, or the focal length of {focal:.0} px, is unusual; check that the lines marked as vertical are vertical in the scene"
            ),
            Self::PixelsNotSquare { aspect } => write!(
                f,
                "images of this size usually have pixels that are not square (aspect {aspect:.3}); \
                 enter the pixel aspect (lens.pixel_aspect), then try again"
            ),
            Self::Bars { bars } => write!(
                f,
                "the image has black bars ({bars}), so the principal point is not near the image centre; use an image without bars"
            ),
            Self::MayBeUpsideDown { pitch_deg } => write!(
                f,
                "the camera looks up by {:.0}\u{b0}, or it hangs upside down; check where the image shows the \
                 floor, and check the entered roll, if any",
                -pitch_deg
            ),
            Self::MayLieOnItsSide => f.write_str(
                "the camera looks straight ahead, or it lies on its side; check that the floor is at the bottom of the image",
            ),
            Self::FocalConflict => f.write_str(
                "the entered focal length or data sheet contradicts the edges; check the values and the verticals",
            ),
            Self::Misfit { chi2_per_dof } => write!(
                f,
                "the lines contradict each other (chi-square {chi2_per_dof:.1} per degree of freedom); remove the \
                 wrong lines"
            ),
        }
    }
}
