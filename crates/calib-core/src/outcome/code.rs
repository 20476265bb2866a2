//! Closed list of the finding codes, and their severities.

use std::fmt;

/// Declares a closed list of codes that are read and written in kebab case.
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
            /// All codes of the list, in the order of declaration.
            pub const ALL: &'static [Self] = &[$(Self::$code),+];

            /// Returns the code as written in site files.
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
    /// Code of a finding about a result.
    Code {
        /// The predicted standard deviation of the focal length, before the weak prior, is over 20 %.
        FocalUnobservable = "focal-unobservable",
        /// Another camera fits the lines almost as well: the chi-square of a second minimum is larger by less than 6.
        TwoSolutions = "two-solutions",
        /// The predicted relative error of floor lengths is over 3 %.
        Weak = "weak",
        /// The predicted relative error of floor lengths is over 10 %.
        Unusable = "unusable",
        /// One annotation contradicts the others and was rejected.
        Outlier = "outlier",
        /// The annotations contradict each other, and no single annotation explains it.
        Misfit = "misfit",
        /// The pixels of two control points are exchanged.
        PointsExchanged = "points-exchanged",
        /// There are too few redundant lines to detect errors in the annotations.
        Unchecked = "unchecked",
        /// The annotation noise is estimated from few residuals, so the standard deviations are widened.
        FewResiduals = "few-residuals",
        /// The uncertainty of the camera is unknown.
        UncertaintyUnknown = "uncertainty-unknown",
        /// The annotations have changed since the camera was solved.
        OutOfDate = "out-of-date",
        /// Some annotated points are outside the image.
        PointsOutside = "points-outside",
        /// The annotations belong to an image of another size.
        NotThisImage = "not-this-image",
        /// The camera is below the floor.
        BelowFloor = "below-floor",
        /// The camera sees no floor in its field of view.
        NoFloor = "no-floor",
        /// The weak prior on the focal length reduces its standard deviation by more than half.
        PriorDominates = "prior-dominates",
        /// The method does not use this annotation, control point, link or mark.
        UnusedAnnotation = "unused-annotation",
        /// A part of the EFOV is on or above the horizon.
        EfovAboveHorizon = "efov-above-horizon",
        /// A polyline carries almost no information about the distortion.
        UninformativePolyline = "uninformative-polyline",
        /// The principal point is far from the image centre, or the entered one contradicts the lines.
        PrincipalPoint = "principal-point",
        /// The entered principal point is the centre of an image of another resolution.
        TwoResolutions = "two-resolutions",
        /// The focal length of the data sheet contradicts the lines by more than 3 sigma.
        FocalConflict = "focal-conflict",
        /// Floor lengths depend on the slope of the ground, which is unknown.
        FloorSlope = "floor-slope",
        /// Recorders code images of this size with pixels that are not square, and no pixel aspect is entered.
        PixelsNotSquare = "pixels-not-square",
        /// The distortion folds back on itself inside the image.
        DistortionNotInvertible = "distortion-not-invertible",
        /// The scale of the site is unknown.
        ScaleUnknown = "scale-unknown",
        /// The scale of the camera is unknown: its height is assumed to be 3 m, as in the paper.
        ScaleAssumed = "scale-assumed",
        /// The camera was placed by hand, so the uncertainty of its position is unknown.
        PlacedByHand = "placed-by-hand",
        /// The placement disagrees with a height, length or upright by more than 3 sigma.
        ScaleConflict = "scale-conflict",
        /// The camera is not connected to the rest of the site.
        NotConnected = "not-connected",
        /// A camera is so far from the origin of the map that the earth's curvature matters.
        LargeSite = "large-site",
    }
}

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Information; the result is valid.
    Note,
    /// The result should not be used before the finding is resolved.
    Warning,
    /// A line, a value or the result is wrong.
    Error,
}

impl Severity {
    /// Returns the name of the severity in the language bindings.
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
    /// Returns the severity of the code.
    #[must_use]
    pub const fn severity(self) -> Severity {
        match self {
            Self::Outlier
            | Self::Unusable
            | Self::Misfit
            | Self::PointsExchanged
            | Self::OutOfDate
            | Self::BelowFloor
            | Self::NoFloor => Severity::Error,
            Self::FocalUnobservable
            | Self::TwoSolutions
            | Self::Unchecked
            | Self::UncertaintyUnknown
            | Self::NotThisImage
            | Self::PixelsNotSquare
            | Self::TwoResolutions
            | Self::FocalConflict
            | Self::FloorSlope
            | Self::DistortionNotInvertible
            | Self::ScaleUnknown
            | Self::ScaleConflict
            | Self::NotConnected => Severity::Warning,
            _ => Severity::Note,
        }
    }

    /// Whether a site with this finding fails `calib check`. Rejected lines and exchanged points are counted
    /// separately.
    #[must_use]
    pub const fn fails_check(self) -> bool {
        !matches!(self.severity(), Severity::Note) && !matches!(self, Self::Outlier | Self::PointsExchanged)
    }
}
