//! What a finding is about.

use crate::outcome::finding::Finding;
use crate::outcome::subject::{Parameter, Subject};

impl Finding {
    /// What it is about; of several things the first.
    #[must_use]
    pub fn subject(&self) -> Subject {
        match self {
            Self::FocalUnobservable { .. } | Self::PriorDominates { .. } => {
                Subject::Parameter(Parameter::Focal)
            }
            Self::TwoSolutions { .. }
            | Self::Misfit { worst: None, .. }
            | Self::Unchecked { .. }
            | Self::FewResiduals { .. }
            | Self::UncertaintyUnknown => Subject::Orientation,
            Self::BelowFloor { .. } => Subject::Parameter(Parameter::Height),
            Self::Weak { .. } | Self::Unusable { .. } | Self::NoFloor => Subject::Floor,
            Self::LineOutlier { line, .. }
            | Self::Misfit { worst: Some((line, _)), .. }
            | Self::HeightsApart { lowest: (line, _), .. }
            | Self::OutsideLens { line }
            | Self::NoLength { line } => Subject::Line(*line),
            Self::UninformativeEdges { edges, .. } => {
                edges.first().map_or(Subject::Lens, |line| Subject::Line(*line))
            }
            Self::BentEdges { .. }
            | Self::BentOneWay { .. }
            | Self::UncertainCorners { .. }
            | Self::DistortionNotInvertible => Subject::Lens,
            Self::UnusedEdges { first: annotation, .. }
            | Self::UnusedKind { annotation, .. }
            | Self::TooFewSegments { annotation, .. } => Subject::Annotation(*annotation),
            Self::UnusedPrior { parameter } => Subject::Parameter(*parameter),
            Self::TooFewControlPoints { .. } => Subject::Placement,
            Self::HiddenControlPoints { points } => {
                points.first().map_or(Subject::Placement, |&point| Subject::OwnControlPoint(point))
            }
            Self::FarControlPoints { worst, .. } => Subject::OwnControlPoint(*worst),
            Self::ScaleAssumed { .. } | Self::ScaleConflict { .. } => Subject::Parameter(Parameter::Height),
            Self::PlacedByHand => Subject::Placement,
            Self::EfovAboveHorizon { .. } => Subject::Efov,
            Self::ControlPointOutlier { camera, point } => {
                Subject::ControlPoint { camera: *camera, point: *point }
            }
            Self::ElementOutlier { element, .. } => *element,
            Self::OutOfDate { what, .. } | Self::PointsOutside { first: what, .. } => *what,
            Self::DistanceOutlier { distance } => Subject::Distance(*distance),
            Self::NotConnected { cameras, .. } => {
                cameras.first().map_or(Subject::Site, |&camera| Subject::Camera(camera))
            }
            Self::Sliding { camera }
            | Self::ScaleUnknown { root: camera, .. }
            | Self::TooManyCameras { first: camera, .. } => Subject::Camera(*camera),
            Self::Unused { what, .. } => what.first().copied().unwrap_or(Subject::Site),
            Self::JointMisfit { .. } | Self::UnusedEvidence { .. } => Subject::Site,
        }
    }
}
