//! The closed list of the codes of findings, and their severity.

use std::fmt;

/// Declares a closed list of codes that read and write in kebab case.
macro_rules! codes {
    ($(#[$doc:meta])* $name:ident { $($(#[$code_doc:meta])* $code:ident = $text:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[derive(serde::Serialize, serde::Deserialize)]
        #[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
        pub enum $name {
            $($(#[$code_doc])* #[serde(rename = $text)] $code),+
        }

        impl $name {
            /// Every code of the list.
            pub const ALL: &'static [Self] = &[$(Self::$code),+];

            /// The code in files.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self { $(Self::$code => $text),+ }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.as_str())
            }
        }
    };
}

pub(crate) use codes;

codes! {
    /// What an operator should know about a result that exists.
    Code {
        /// The predicted standard deviation of the focal, before the weak prior, is over 20 %.
        FocalUnobservable = "focal-unobservable",
        /// A second minimum has a chi-square within 6 of the best.
        TwoSolutions = "two-solutions",
        /// The predicted relative error of floor lengths is over 3 %.
        Weak = "weak",
        /// The predicted relative error of floor lengths is over 10 %.
        Unusable = "unusable",
        /// One annotation contradicts the others and was rejected.
        Outlier = "outlier",
        /// The annotations contradict each other and none of them explains it.
        Misfit = "misfit",
        /// Too few lines are drawn beyond those that the camera needs: nothing checks the drawing.
        Unchecked = "unchecked",
        /// The drawing noise is estimated from so few residuals that the standard deviations are widened.
        FewResiduals = "few-residuals",
        /// Nothing is known of the errors of the camera.
        UncertaintyUnknown = "uncertainty-unknown",
        /// The solution is not of what is drawn now.
        OutOfDate = "out-of-date",
        /// Some of what is drawn lies outside the image.
        PointsOutside = "points-outside",
        /// What is drawn is not of an image of this size.
        NotThisImage = "not-this-image",
        /// The camera stands below the floor.
        BelowFloor = "below-floor",
        /// The camera sees no floor where its field of view is.
        NoFloor = "no-floor",
        /// The weak prior on the focal lowers its standard deviation by more than half.
        PriorDominates = "prior-dominates",
        /// The method does not use this annotation, control point, link or mark.
        UnusedAnnotation = "unused-annotation",
        /// A part of the EFOV lies on or above the horizon.
        EfovAboveHorizon = "efov-above-horizon",
        /// A polyline says next to nothing about distortion.
        UninformativePolyline = "uninformative-polyline",
        /// The distortion folds back on itself inside the image.
        DistortionNotInvertible = "distortion-not-invertible",
        /// Nothing gives the scale of the site.
        ScaleUnknown = "scale-unknown",
        /// Nothing gives the scale of the camera: its height is taken to be the 3 m of the paper.
        ScaleAssumed = "scale-assumed",
        /// A hand says where the camera stands, and nothing tells how well.
        PlacedByHand = "placed-by-hand",
        /// Placement and a height, length or upright disagree beyond 3 sigma.
        ScaleConflict = "scale-conflict",
        /// Nothing ties the camera to the rest of the site.
        NotConnected = "not-connected",
    }
}

/// The severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Information; the result is valid.
    Note,
    /// To be resolved before the result is relied on.
    Warning,
    /// Something is wrong: a line, a value, or the result.
    Error,
}

impl Severity {
    /// What it is called in other languages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

impl Code {
    /// Its severity.
    #[must_use]
    pub const fn severity(self) -> Severity {
        match self {
            Self::Outlier
            | Self::Unusable
            | Self::Misfit
            | Self::OutOfDate
            | Self::BelowFloor
            | Self::NoFloor => Severity::Error,
            Self::FocalUnobservable
            | Self::TwoSolutions
            | Self::Unchecked
            | Self::UncertaintyUnknown
            | Self::NotThisImage
            | Self::DistortionNotInvertible => Severity::Warning,
            _ => Severity::Note,
        }
    }

    /// Whether a site with this finding must not go into service.
    #[must_use]
    pub const fn fails_check(self) -> bool {
        matches!(
            self,
            Self::Unusable
                | Self::Misfit
                | Self::FocalUnobservable
                | Self::TwoSolutions
                | Self::Unchecked
                | Self::UncertaintyUnknown
                | Self::OutOfDate
                | Self::NotThisImage
                | Self::BelowFloor
                | Self::NoFloor
                | Self::ScaleConflict
                | Self::DistortionNotInvertible
                | Self::NotConnected
                | Self::ScaleUnknown
        )
    }
}
