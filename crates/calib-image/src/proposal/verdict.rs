//! Whether a proposal is to be believed.

use std::fmt;

/// Whether a proposal is to be believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub enum Verdict {
    /// It may be used as it is.
    Sure,
    /// It is likely, and wants a look.
    Check,
    /// There is none.
    None,
}

impl Verdict {
    /// Its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sure => "sure",
            Self::Check => "check",
            Self::None => "none",
        }
    }
}

/// Why a proposal is not sure.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Reason {
    /// There are fewer straight edges than directions could be told from.
    FewEdges {
        /// How many there are.
        found: usize,
    },
    /// The image is round, and its lens is not known: a fisheye bends edges by more than grouping finds out.
    RoundImage,
    /// The edges lead nowhere in common, more than chance would make them.
    NoDirections,
    /// No edge is plumb.
    NoVerticals,
    /// Besides the verticals there is one direction only, and it leaves the focal open.
    OneDirection {
        /// Relative standard deviation of the focal.
        sigma: f64,
    },
    /// The directions leave the focal open.
    FocalOpen {
        /// Relative standard deviation of the focal.
        sigma: f64,
    },
    /// Other cameras explain the edges nearly as well.
    TwoHypotheses {
        /// Their focals, in pixels, this one first.
        focals: [f64; 2],
    },
    /// No camera that somebody set up has such a roll or focal.
    Unusual {
        /// In pixels.
        focal: f64,
    },
    /// The edges do not agree with each other as well as their noise would have them.
    Misfit {
        /// Sum of squared residuals over their number.
        chi2_per_dof: f64,
    },
}

/// What an operator reads.
impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewEdges { found } => {
                write!(f, "only {found} straight edges were found; draw what is straight by hand")
            }
            Self::RoundImage => f.write_str(
                "the image is round, as a fisheye's is; draw long straight edges by hand, which tell its lens, and propose again",
            ),
            Self::NoDirections => {
                f.write_str("the edges lead to no common directions; draw verticals and floor lines by hand")
            }
            Self::NoVerticals => f.write_str("no edges are plumb; draw verticals by hand"),
            Self::OneDirection { sigma } => write!(
                f,
                "there is one floor direction only, and the focal is open (\u{b1} {:.0} %); draw floor lines of another direction",
                100.0 * sigma
            ),
            Self::FocalOpen { sigma } => write!(
                f,
                "the directions leave the focal open (\u{b1} {:.0} %); draw floor lines that run away from the camera",
                100.0 * sigma
            ),
            Self::TwoHypotheses { focals: [one, other] } => write!(
                f,
                "a focal of {one:.0} px and one of {other:.0} px explain the edges alike; look which lines belong together"
            ),
            Self::Unusual { focal } => write!(
                f,
                "a camera of such a roll, or with a focal of {focal:.0} px, is unusual; look whether the verticals are plumb"
            ),
            Self::Misfit { chi2_per_dof } => write!(
                f,
                "the lines contradict each other (chi-square {chi2_per_dof:.1} per degree of freedom); look which do not belong"
            ),
        }
    }
}
