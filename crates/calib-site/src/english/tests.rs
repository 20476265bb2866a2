//! Tests that every finding and every failure has a code, a subject and complete sentences.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use super::*;
use crate::document::{Site, SiteCamera};
use crate::options::Options;
use crate::solution::{FailureEntry, Warning};
use calib_core::camera::Pixel;
use calib_core::outcome::{
    Code, DisconnectionReason, Estimator, Failure, FailureCode, Finding, OtherMinimum, Parameter, Severity,
    SharedEvidence, Source, Subject, SuggestedAnnotation, Suggestion, UnusedReason,
};
use calib_core::single::{Annotation, Kind};

const LINE: Source = Source { annotation: 0, segment: 1 };
const PIXEL: Pixel = Pixel { u: 520.0, v: 960.0 };

/// Returns the index of a variant in [`findings`]. The match is exhaustive, so a new variant does not compile
/// without an index.
fn number(finding: &Finding) -> usize {
    use Finding as F;
    match finding {
        F::FocalUnobservable { .. } => 0,
        F::PriorDominates { .. } => 1,
        F::TwoSolutions { .. } => 2,
        F::Weak { .. } => 3,
        F::Unusable { .. } => 4,
        F::NoFloor => 5,
        F::LineOutlier { .. } => 6,
        F::Misfit { .. } => 7,
        F::JointMisfit { .. } => 8,
        F::CurvedEdges { .. } => 9,
        F::UninformativeEdges { .. } => 10,
        F::UncertainCorners { .. } => 11,
        F::UnusedEdges { .. } => 12,
        F::UnusedKind { .. } => 13,
        F::TooFewSegments { .. } => 14,
        F::UnusedPrior { .. } => 15,
        F::OutsideLens { .. } => 16,
        F::NoLength { .. } => 17,
        F::TooFewControlPoints { .. } => 18,
        F::HiddenControlPoints { .. } => 19,
        F::FarControlPoints { .. } => 20,
        F::ScaleConflict { .. } => 21,
        F::EfovAboveHorizon { .. } => 22,
        F::DistortionNotInvertible => 23,
        F::ControlPointOutlier { .. } => 24,
        F::ElementOutlier { .. } => 31,
        F::DistanceOutlier { .. } => 32,
        F::NotConnected { .. } => 33,
        F::UndeterminedPosition { .. } => 34,
        F::ScaleUnknown { .. } => 35,
        F::TooManyCameras { .. } => 36,
        F::Unused { .. } => 37,
        F::UnusedEvidence { .. } => 38,
        F::OutOfDate { .. } => 30,
        F::Unchecked { .. } => 25,
        F::FewResiduals { .. } => 26,
        F::UncertaintyUnknown => 27,
        F::BelowFloor { .. } => 28,
        F::ScaleAssumed { .. } => 29,
        F::PointsOutside { is_other_image: false, .. } => 39,
        F::PointsOutside { is_other_image: true, .. } => 40,
        F::ContradictoryUprights { .. } => 41,
        F::PlacedByHand => 42,
        F::CurvedInOneDirection { .. } => 43,
        F::ExchangedControlPoints { .. } => 44,
        F::UncheckedPoints { .. } => 45,
        F::WrongPrincipalPoint { .. } => 46,
        F::OffCentre { .. } => 47,
        F::NoStandardDeviations => 48,
        F::PixelsNotSquare { .. } => 49,
        F::UncheckedLinks { .. } => 50,
        F::OtherResolution { .. } => 51,
        F::UnknownSlope { .. } => 52,
        F::FarFromMap { .. } => 53,
        F::LargeSite { .. } => 54,
        F::DataSheetConflict { .. } => 55,
    }
}

/// Returns the findings about the entered values of a lens, and about the map.
fn lens_and_map_findings() -> [(Finding, Subject); 7] {
    use Finding as F;
    [
        (F::WrongPrincipalPoint { entered: PIXEL, estimated: PIXEL, is_exchanged: true }, Subject::Lens),
        (F::OffCentre { estimated: PIXEL, distance: 0.2 }, Subject::Lens),
        (F::PixelsNotSquare { size: [960, 1080], aspect: 2.0 }, Subject::Lens),
        (F::OtherResolution { entered: PIXEL, size: [2064, 1544] }, Subject::Lens),
        (
            F::DataSheetConflict {
                entered: 1119.0,
                entered_sigma: Some(34.0),
                estimated: 835.0,
                sigma: 14.0,
            },
            Subject::Parameter(Parameter::Focal),
        ),
        (F::LargeSite { camera: 0, distance: 7200.0, drop: 4.1, is_compact: true }, Subject::Camera(0)),
        (
            F::FarFromMap { camera: 0, point: 0, distance: 25.0 },
            Subject::ControlPoint { camera: 0, point: 0 },
        ),
    ]
}

/// Returns one finding of every kind about a camera, each with its expected subject.
fn camera_findings() -> Vec<(Finding, Subject)> {
    use Finding as F;
    let next =
        Some(Suggestion { annotation: SuggestedAnnotation::RightAngle, ratio: 0.5, floor_length_rel: 0.02 });
    let (annotation, by) = (0, Estimator::Paper);
    vec![
        (
            F::FocalUnobservable { sigma: 0.3, looks_down: false, good_floor: None, next },
            Subject::Parameter(Parameter::Focal),
        ),
        (F::PriorDominates { focal: 1400.0, sigma: 0.2 }, Subject::Parameter(Parameter::Focal)),
        (
            F::TwoSolutions {
                others: vec![OtherMinimum { focal: 900.0, pitch: 0.4, roll: 0.1 }],
                is_turned: false,
                next,
            },
            Subject::Orientation,
        ),
        (F::Weak { floor_length_rel: 0.05, scale_rel: None, next }, Subject::Floor),
        (F::Unusable { floor_length_rel: 0.2, scale_rel: Some(0.19), next: None }, Subject::Floor),
        (F::NoFloor, Subject::Floor),
        (F::LineOutlier { line: LINE, px: Some(12.0), lengths: None }, Subject::Line(LINE)),
        (F::Misfit { chi2: 90.0, dof: 4, worst: Some((LINE, 9.0)) }, Subject::Line(LINE)),
        (F::JointMisfit { chi2: 90.0, dof: 4 }, Subject::Site),
        (F::CurvedEdges { px: 4.0, px_without_lens: 5.0 }, Subject::Lens),
        (F::UninformativeEdges { edges: vec![LINE], total: 3, sagitta_px: 0.2 }, Subject::Line(LINE)),
        (F::CurvedInOneDirection { px: 5.0 }, Subject::Lens),
        (F::UncertainCorners { px: f64::INFINITY, is_round: false, is_reached: false }, Subject::Lens),
        (F::UnusedEdges { first: 0, count: 1, is_undistorted: true, px: 0.4 }, Subject::Annotation(0)),
        (F::UnusedKind { annotation, by }, Subject::Annotation(0)),
        (F::TooFewSegments { annotation, by, count: 1, required: 2 }, Subject::Annotation(0)),
        (F::UnusedPrior { parameter: Parameter::Height }, Subject::Parameter(Parameter::Height)),
        (F::OutsideLens { line: LINE }, Subject::Line(LINE)),
        (F::NoLength { line: LINE }, Subject::Line(LINE)),
        (F::TooFewControlPoints { count: 1 }, Subject::Placement),
        (F::HiddenControlPoints { points: vec![0] }, Subject::OwnControlPoint(0)),
        (F::ExchangedControlPoints { points: [0, 0] }, Subject::OwnControlPoint(0)),
        (F::UncheckedPoints { dof: 0 }, Subject::Placement),
        (F::UncheckedLinks { elements: vec![Subject::Link(0)], cameras: vec![0] }, Subject::Link(0)),
        (F::UnknownSlope { usual: 0.02, sloping: Some(0.07) }, Subject::Floor),
        (F::FarControlPoints { rms_px: 9.0, worst: 0, worst_px: 14.0 }, Subject::OwnControlPoint(0)),
        (F::ScaleConflict { estimated: 3.0, placed: 5.0 }, Subject::Parameter(Parameter::Height)),
        (F::EfovAboveHorizon { is_whole: false }, Subject::Efov),
        (F::DistortionNotInvertible, Subject::Lens),
        (F::ControlPointOutlier { camera: 0, point: 0 }, Subject::ControlPoint { camera: 0, point: 0 }),
        (F::Unchecked { dof: 1, rejected: 1, next }, Subject::Orientation),
        (F::FewResiduals { dof: 3, factor: 1.6 }, Subject::Orientation),
        (F::UncertaintyUnknown, Subject::Orientation),
        (F::NoStandardDeviations, Subject::Orientation),
        (F::BelowFloor { height: -2.0 }, Subject::Parameter(Parameter::Height)),
        (F::ScaleAssumed { height: 3.0 }, Subject::Parameter(Parameter::Height)),
        (F::PlacedByHand, Subject::Placement),
        (
            F::OutOfDate { subject: Subject::Line(LINE), stored: Some(0.5), now: Some(90.0) },
            Subject::Line(LINE),
        ),
    ]
}

fn points_outside(is_other_image: bool) -> Finding {
    let (size, first) = ([1920, 1080], Subject::Efov);
    Finding::PointsOutside { outside: 2, total: 9, size, fits_exchanged: false, is_other_image, first }
}

/// Returns one finding of every kind about the site, each with its expected subject.
fn site_findings() -> Vec<(Finding, Subject)> {
    use Finding as F;
    let distance = Subject::Distance(0);
    vec![
        (F::ElementOutlier { element: Subject::Link(0), worst: Some((0, 30.0)) }, Subject::Link(0)),
        (F::DistanceOutlier { distance: 0, lengths: [4.0, 2.0] }, distance),
        (
            F::NotConnected { cameras: vec![0], reason: DisconnectionReason::PlacedByOperator },
            Subject::Camera(0),
        ),
        (F::UndeterminedPosition { camera: 0 }, Subject::Camera(0)),
        (F::ScaleUnknown { cameras: vec![0], root: 0 }, Subject::Camera(0)),
        (F::TooManyCameras { count: 900, first: 0 }, Subject::Camera(0)),
        (F::Unused { subjects: vec![distance], reason: UnusedReason::UnknownLengthOrEnd }, distance),
        (F::UnusedEvidence { evidence: SharedEvidence::Marks, count: 3 }, Subject::Site),
        (points_outside(false), Subject::Efov),
        (points_outside(true), Subject::Efov),
        (F::ContradictoryUprights { lowest: (LINE, 2.9), highest: (LINE, 3.6) }, Subject::Line(LINE)),
    ]
}

fn findings() -> Vec<(Option<usize>, Finding, Subject)> {
    let camera = camera_findings()
        .into_iter()
        .chain(lens_and_map_findings())
        .map(|(finding, subject)| (Some(0), finding, subject));
    camera.chain(site_findings().into_iter().map(|(finding, subject)| (None, finding, subject))).collect()
}

fn failures() -> Vec<Failure> {
    vec![
        Failure::TooFewVerticals { count: 1 },
        Failure::CoincidentVerticals,
        Failure::NoFloorAnnotations,
        Failure::NoAnnotations,
        Failure::UndeterminedByPoints { count: 2 },
        Failure::ExchangedControlPoints { points: ["a".into(), "b".into()] },
        Failure::ContradictoryPoints { count: 5 },
        Failure::MirroredControlPoints,
        Failure::ImpossibleCamera { focal: 9e5, height: 9e3 },
        Failure::NoPitchAndFocal,
        Failure::NoOrientation,
        Failure::Underdetermined { weakest: Some(Parameter::Roll) },
        Failure::SharedLensFailed { camera: "door".into(), reason: Box::new(Failure::NoAnnotations) },
        Failure::TooExtreme,
    ]
}

/// Builds a site with one camera (two verticals and a control point), two links, and a distance.
fn site() -> Site {
    let segment = |x: f64| vec![Pixel::new(x, 900.0), Pixel::new(x + 20.0, 300.0)];
    let verticals = Annotation::from_segments(Kind::Vertical, vec![segment(300.0), segment(1500.0)]);
    let text = r#"{"format": "calib-site", "version": 1, "cameras": [{"id": "door", "size_px": [1920, 1080],
        "control_points": [{"id": "p", "px": [900, 700], "world_m": [1, 2, 0]}]}],
        "links": [{"id": "a", "kind": "point", "seen": []}, {"id": "b", "kind": "point", "seen": []}],
        "distances": [{"between": ["a", "b"], "length_m": {"value": 2, "fixed": true}}]}"#;
    let mut site = Site::from_json(text).unwrap();
    site.cameras[0].annotations.push(verticals);
    site
}

fn is_sentence(text: &str) -> bool {
    text.ends_with('.') && text.chars().next().is_some_and(|first| first.is_uppercase() || first.is_numeric())
}

#[test]
fn every_finding_has_a_subject_a_code_and_sentences() {
    let site = site();
    let list = findings();
    let mut numbers: Vec<usize> = list.iter().map(|(_, finding, _)| number(finding)).collect();
    numbers.sort_unstable();
    assert_eq!(numbers, (0..list.len()).collect::<Vec<_>>(), "each variant must occur once");
    for (camera, finding, subject) in &list {
        assert_eq!(finding.subject(), *subject, "{finding:?}");
        assert_eq!(finding.severity(), finding.code().severity());
        for names in [Names::InFile, Names::OnScreen] {
            let Warning { code, message, advice } = site.describe_finding(*camera, finding, names);
            assert_eq!(code, finding.code());
            assert!(is_sentence(&message) && is_sentence(&advice), "{message:?} {advice:?}");
        }
    }
    for code in Code::ALL {
        assert!(list.iter().any(|(_, finding, _)| finding.code() == *code), "no finding has the code {code}");
    }
}

#[test]
fn every_failure_has_a_code_and_sentences() {
    for failure in failures() {
        let FailureEntry { code, message, advice } = FailureEntry::from(&failure);
        assert_eq!(code, failure.code());
        assert!(is_sentence(&message) && is_sentence(&advice), "{message:?} {advice:?}");
    }
    for code in FailureCode::ALL {
        assert!(failures().iter().any(|failure| failure.code() == *code), "no failure has the code {code}");
    }
}

#[test]
fn only_notes_and_counted_errors_pass_the_check() {
    let counted = [Code::Outlier, Code::PointsExchanged];
    for &code in Code::ALL {
        let is_serious = code.severity() > Severity::Note && !counted.contains(&code);
        assert_eq!(code.fails_check(), is_serious, "{code}");
    }
    assert!(!Code::Weak.fails_check() && !Code::Outlier.fails_check());
    let failing = || Code::ALL.iter().filter(|code| code.fails_check());
    assert_eq!(failing().count(), 18, "{:?}", failing().collect::<Vec<_>>());
}

#[test]
fn screen_names_lines_and_file_names_annotations() {
    let (site, finding) = (site(), Finding::LineOutlier { line: LINE, px: Some(12.0), lengths: None });
    let message = |names| site.describe_finding(Some(0), &finding, names).message;
    assert!(message(Names::InFile).starts_with("V2 of Vertical (annotation 0) contradicts"));
    assert!(message(Names::OnScreen).starts_with("V2 contradicts"));
    let unused = Finding::UnusedKind { annotation: 0, by: Estimator::Paper };
    let message = |names| site.describe_finding(Some(0), &unused, names).message;
    assert!(message(Names::InFile).ends_with("Vertical (annotation 0)."));
    assert!(message(Names::OnScreen).ends_with("V1 to V2."));
}

#[test]
fn finding_about_a_missing_camera_has_a_message() {
    for (camera, finding, _) in findings() {
        let warning = Site::new().describe_finding(camera, &finding, Names::OnScreen);
        assert!(!warning.message.is_empty());
    }
}

#[test]
fn warnings_of_a_report_match_its_findings() {
    let site = site();
    for refine in [false, true] {
        let report = site.calibrate(&Options { refine, ..Options::default() });
        let solution = report.cameras[0].1.as_ref().unwrap();
        let findings = report.findings[0].as_ref().unwrap();
        assert!(!findings.is_empty());
        assert_eq!(solution.warnings, site.warnings(Some(0), findings));
        assert_eq!(report.site.warnings, site.warnings(None, &report.site_findings));
    }
    let nothing = Site { cameras: vec![SiteCamera::new("door", [1920, 1080])], ..Site::new() };
    let report = nothing.calibrate(&Options::default());
    let failure = report.findings[0].as_ref().unwrap_err();
    assert_eq!(report.cameras[0].1.as_ref().unwrap_err(), &FailureEntry::from(failure));
}
