//! Findings about a fit, and suggested annotations.
//!
//! Suggestions are a greedy experimental design of one step. Every candidate is added to the constraints at
//! the estimate, where its residual is 0. The error of floor lengths is then predicted with the candidate.
//! If the scale is unknown, a guessed standard deviation is used for the common scale.
//!
//! Links to another camera are evaluated in the same way. The other camera is assumed to be like this one,
//! equally well known, and to see the same floor from the side. A point seen by both gives two residuals,
//! `F(p) - S F'(p')`. F and F' are the maps of both cameras to their floors, and S is the similarity between
//! the floors. The information about this camera is the Schur complement `A - B D^-1 B'`. A, B and D are the
//! blocks of the normal matrix for this camera's parameters and the others.

use nalgebra::{DMatrix, Matrix2, Matrix4};

use crate::camera::{Camera, Covariance, FloorPoint, Pixel};
use crate::optimize::Uncertainty;
use crate::outcome::{Finding, OtherMinimum, SuggestedAnnotation, Suggestion};
use crate::single::accuracy::floor_length_rel;
use crate::single::annotation::{ConstraintKind, Kind, Known};
use crate::single::constraints::{
    Constraints, Direction, Endpoint, LengthConstraint, LineConstraint, Source,
};
use crate::single::fit::{Fit, FitOptions, LocalMinimum, grid};
use crate::single::likelihood::{Problem, State};
use crate::single::minima::MAX_LOG_FOCAL_SIGMA;
use crate::single::nuisances::Nuisances;
use crate::single::outliers::student_factor;
use crate::single::parameters::{FixedParameters, Priors};
use crate::single::residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL};
use crate::single::scene_errors::{Deviation, SceneErrors};

/// Assumed image positions of shared points, as fractions of width and height from the image centre.
const SHARED_POINT_OFFSETS: [[f64; 2]; 4] = [[-0.25, 0.1], [0.25, 0.1], [-0.2, 0.35], [0.2, 0.35]];
/// Number of parameters of one camera: roll, pitch and log focal length.
const CAMERA_PARAMETERS: usize = 3;
/// Number of parameters of both cameras and of the similarity between their floors.
const TOTAL_PARAMETERS: usize = 2 * CAMERA_PARAMETERS + 4;

/// Returns the information about roll, pitch, log focal length and log height that four shared points add to
/// `information`.
///
/// `sigma` is the standard deviation of pixels. `None` if the floor is not visible at all four points.
pub(crate) fn shared_points(
    camera: &Camera,
    size: [f64; 2],
    sigma: f64,
    information: &Matrix4<f64>,
) -> Option<Matrix4<f64>> {
    let [w, h] = size;
    let pixel = |[x, y]: [f64; 2]| Pixel::new((0.5 + x) * w, (0.5 + y) * h);
    let pixels = SHARED_POINT_OFFSETS.map(pixel);
    let points: Vec<FloorPoint> =
        pixels.iter().map(|&pixel| camera.pixel_to_floor(pixel, 0.0)).collect::<Option<_>>()?;
    let count = points.len() as f64;
    let middle = FloorPoint {
        x: points.iter().map(|at| at.x).sum::<f64>() / count,
        y: points.iter().map(|at| at.y).sum::<f64>() / count,
    };
    let known = orientation_information(information);
    let mut normal = DMatrix::<f64>::zeros(TOTAL_PARAMETERS, TOTAL_PARAMETERS);
    normal
        .view_mut((CAMERA_PARAMETERS, CAMERA_PARAMETERS), (CAMERA_PARAMETERS, CAMERA_PARAMETERS))
        .copy_from(&known);
    for (&pixel, point) in pixels.iter().zip(&points) {
        let (own, noise) = jacobian(camera, pixel, sigma)?;
        let (x, y) = (point.x - middle.x, point.y - middle.y);
        // The other camera looks from the side: the point is rotated by 90 degrees about the middle.
        let turned = FloorPoint { x: middle.x + y, y: middle.y - x };
        let (other, noise_of_other) = jacobian(camera, camera.world_to_pixel(turned.at_height(0.0))?, sigma)?;
        let back = Matrix2::new(0.0, -1.0, 1.0, 0.0);
        let mut row = DMatrix::<f64>::zeros(2, TOTAL_PARAMETERS);
        row.view_mut((0, 0), (2, CAMERA_PARAMETERS)).copy_from(&own);
        row.view_mut((0, CAMERA_PARAMETERS), (2, CAMERA_PARAMETERS)).copy_from(&(-(back * other)));
        row.view_mut((0, 2 * CAMERA_PARAMETERS), (2, 4)).copy_from(&DMatrix::from_row_slice(
            2,
            4,
            &[1.0, 0.0, -y, x, 0.0, 1.0, x, y],
        ));
        let weight = (noise + back * noise_of_other * back.transpose()).try_inverse()?;
        normal += row.transpose() * weight * row;
    }
    let rest = TOTAL_PARAMETERS - CAMERA_PARAMETERS;
    let (own, cross, others) = (
        normal.view((0, 0), (CAMERA_PARAMETERS, CAMERA_PARAMETERS)),
        normal.view((0, CAMERA_PARAMETERS), (CAMERA_PARAMETERS, rest)),
        normal.view((CAMERA_PARAMETERS, CAMERA_PARAMETERS), (rest, rest)),
    );
    let added = own - cross * others.clone_owned().try_inverse()? * cross.transpose();
    let places = [ROLL, PITCH, LOG_FOCAL];
    let mut full = Matrix4::zeros();
    for (i, &a) in places.iter().enumerate() {
        for (j, &b) in places.iter().enumerate() {
            full[(a, b)] = added[(i, j)];
        }
    }
    Some(full)
}

/// Returns the information about roll, pitch and log focal length, with the height eliminated.
fn orientation_information(information: &Matrix4<f64>) -> DMatrix<f64> {
    let height = information[(3, 3)];
    DMatrix::from_fn(CAMERA_PARAMETERS, CAMERA_PARAMETERS, |i, j| {
        let through = if height > 0.0 { information[(i, 3)] * information[(3, j)] / height } else { 0.0 };
        // Regularisation of undetermined parameters, so that they can be eliminated.
        information[(i, j)] - through + if i == j { 1e-6 } else { 0.0 }
    })
}

/// Returns the derivatives of a floor point with respect to roll, pitch and log focal length, and its covariance
/// for pixels with the standard deviation `sigma`.
fn jacobian(camera: &Camera, pixel: Pixel, sigma: f64) -> Option<(DMatrix<f64>, Matrix2<f64>)> {
    let by = camera.floor_jacobian(pixel)?;
    let columns =
        [by[Covariance::ROLL], by[Covariance::PITCH], by[Covariance::FOCAL].map(|by| by * camera.focal)];
    let [[xx, xy], [_, yy]] = camera.floor_covariance(pixel, sigma)?.pixel;
    Some((DMatrix::from_fn(2, CAMERA_PARAMETERS, |i, k| columns[k][i]), Matrix2::new(xx, xy, xy, yy)))
}

/// Relative error of floor lengths above which a result is weak.
const MAX_GOOD_FLOOR_ERROR: f64 = 0.03;
/// Relative error of floor lengths above which a result is unusable.
const MAX_USABLE_FLOOR_ERROR: f64 = 0.10;

/// Relative standard deviation of an unknown scale: cameras are usually 2 to 5 m high.
const GUESSED_SCALE_SIGMA_REL: f64 = 0.5;

/// Length of a suggested measurement, in camera heights.
const MEASURED_LENGTH: f64 = 0.5;
/// Relative standard deviation of a suggested measurement.
const MEASURED_SIGMA_REL: f64 = 0.01;

/// Minimum pitch of a camera that looks almost straight down, in radians.
const MIN_LOOKS_DOWN_PITCH_RAD: f64 = 1.2;

/// Suggested annotation with an example on the image.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedLine {
    /// Kind of annotation, and the predicted error of floor lengths with the annotation.
    pub suggestion: Suggestion,
    /// Kind of the annotation to create; `None` for links.
    pub kind: Option<Kind>,
    /// Raw pixels of an example, segment by segment.
    pub segments: Vec<[Pixel; 2]>,
}

/// Returns the findings about a fit, in the order of reports.
#[must_use]
pub fn findings(fit: &Fit, next: Option<Suggestion>) -> Vec<Finding> {
    let mut findings = Vec::new();
    if let Some(sigma) = fit.log_focal_sigma.filter(|&sigma| sigma > MAX_LOG_FOCAL_SIGMA) {
        findings.push(Finding::FocalUnobservable {
            sigma,
            looks_down: fit.camera.pitch > MIN_LOOKS_DOWN_PITCH_RAD,
            good_floor: fit.floor_length_rel.filter(|&rel| rel <= MAX_GOOD_FLOOR_ERROR),
            next,
        });
        let narrowed = fit.log_focal_sigma_with_prior();
        if fit.has_weak_prior && narrowed < 0.5 * sigma {
            findings.push(Finding::PriorDominates { focal: fit.camera.focal, sigma: narrowed });
        }
    }
    if fit.has_two_solutions {
        let rival = |other: &LocalMinimum| OtherMinimum {
            focal: other.orientation.focal,
            pitch: other.orientation.pitch,
            roll: other.orientation.roll,
        };
        let is_turned = |other: &LocalMinimum| (other.orientation.roll - fit.camera.roll).cos() < 0.0;
        findings.push(Finding::TwoSolutions {
            others: fit.alternatives.iter().map(rival).collect(),
            is_turned: fit.alternatives.iter().all(is_turned),
            next,
        });
    }
    match fit.floor_length_rel {
        _ if fit.is_inconsistent => findings.push(Finding::UncertaintyUnknown),
        None => findings.push(Finding::NoFloor),
        Some(rel) => findings.extend(floor_finding(rel, fit.floor_shape_rel, next)),
    }
    findings.extend(unchecked(fit, next));
    findings.extend(few_residuals(fit));
    findings.extend(fit.outliers.iter().map(|&source| Finding::LineOutlier {
        line: source,
        px: residual_px(fit, source).filter(|px| px.is_finite()),
        lengths: None,
    }));
    if fit.is_misfit {
        findings.push(misfit(fit));
    }
    findings
}

/// Returns the finding about the error of floor lengths, if it is large; `shape_rel` is the error of their
/// ratios.
pub fn floor_finding(
    floor_length_rel: f64,
    shape_rel: Option<f64>,
    next: Option<Suggestion>,
) -> Option<Finding> {
    let has_good_shape = |shape: &f64| *shape <= MAX_GOOD_FLOOR_ERROR && *shape < 0.5 * floor_length_rel;
    let scale_rel = shape_rel.filter(has_good_shape).map(|shape| floor_length_rel.powi(2) - shape.powi(2));
    let scale_rel = scale_rel.map(f64::sqrt);
    if floor_length_rel > MAX_USABLE_FLOOR_ERROR {
        Some(Finding::Unusable { floor_length_rel, scale_rel, next })
    } else {
        (floor_length_rel > MAX_GOOD_FLOOR_ERROR).then_some(Finding::Weak {
            floor_length_rel,
            scale_rel,
            next,
        })
    }
}

/// Returns a finding if errors in the annotations cannot be detected.
///
/// Wrong lines agree by chance with one redundant residual about once in a hundred cases, with two once in
/// ten thousand. Every rejected line was chosen to make the rest agree, so it costs one degree of freedom.
fn unchecked(fit: &Fit, next: Option<Suggestion>) -> Option<Finding> {
    /// Minimum degrees of freedom, without the rejected lines, with which errors can be detected.
    const MIN_DOF: i64 = 2;
    let (dof, rejected) = (fit.dof, fit.outliers.len());
    (dof - (rejected as i64) < MIN_DOF).then_some(Finding::Unchecked { dof, rejected, next })
}

/// Returns a finding if few residuals widen the standard deviations noticeably.
fn few_residuals(fit: &Fit) -> Option<Finding> {
    /// Minimum widening factor of standard deviations that is reported.
    const MIN_REPORTED_FACTOR: f64 = 1.2;
    let dof = fit.noise_dof.filter(|_| !fit.is_inconsistent)?;
    let factor = student_factor(dof);
    (factor > MIN_REPORTED_FACTOR).then_some(Finding::FewResiduals { dof, factor })
}

/// Returns the absolute residual of a constraint, in pixels.
fn residual_px(fit: &Fit, source: Source) -> Option<f64> {
    fit.residuals.iter().find(|(s, _)| *s == source).map(|(_, pixels)| pixels.abs())
}

/// Returns the finding that the residuals are too large for the annotation noise.
fn misfit(fit: &Fit) -> Finding {
    let worst = fit.residuals.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let worst = worst.map(|&(source, _)| (source, residual_px(fit, source).unwrap_or(f64::NAN)));
    Finding::Misfit { chi2: fit.chi2, dof: fit.dof, worst }
}

/// Returns the candidates that would reduce the error of floor lengths by at least a fifth, the best first.
///
/// The candidates include links to other cameras if `options` allow links.
#[must_use]
pub fn suggest_lines(fit: &Fit, constraints: &Constraints, options: &FitOptions) -> Vec<SuggestedLine> {
    /// Maximum ratio of the floor-length error with a candidate annotation to the present one, at
    /// which the candidate is suggested.
    const MAX_RATIO: f64 = 0.8;
    let inliers: Constraints = without(constraints, &fit.outliers);
    let grid = grid(&fit.camera, options.efov, options.size);
    let sigma = fit.sigma;
    let information = |constraints: &Constraints, state: &State| {
        let problem = Problem::new(constraints, options.fixed, options.priors, sigma, options.size[0]);
        Some((problem.normal(state)?.information(problem.free), problem.free))
    };
    let rel = |(information, free): (Matrix4<f64>, [bool; 4])| {
        let uncertainty = Uncertainty::new(&information, free);
        let height_known = free[LOG_HEIGHT] || options.fixed.height.is_some();
        floor_length_rel(&fit.state.parameters, &grid, &uncertainty.covariance, height_known)
    };
    let Some(own) = information(&inliers, &fit.state) else { return Vec::new() };
    let Some(now) = rel(own) else { return Vec::new() };
    let suggested =
        |then: f64, annotation: SuggestedAnnotation, kind: Option<Kind>, segments| SuggestedLine {
            suggestion: Suggestion { annotation, ratio: then / now, floor_length_rel: then },
            kind,
            segments,
        };
    let with = |candidate: &Candidate| {
        let (constraints, state) = candidate.added_to(&inliers, &fit.state)?;
        rel(information(&constraints, &state)?)
    };
    let drawn = candidates(fit, options).into_iter().filter_map(|candidate| {
        Some(suggested(with(&candidate)?, candidate.annotation, Some(candidate.kind), candidate.pixels(fit)))
    });
    let linked = || {
        let added = shared_points(&fit.camera, options.size, sigma, &own.0)?;
        Some(suggested(rel((own.0 + added, own.1))?, SuggestedAnnotation::SharedPoints, None, Vec::new()))
    };
    let mut suggestions: Vec<SuggestedLine> =
        drawn.chain(linked().filter(|_| options.has_neighbours)).collect();
    let size = known_size(fit, options).and_then(|candidate| Some((with(&candidate)?, candidate)));
    let guessed = if fit.is_height_known { 0.0 } else { GUESSED_SCALE_SIGMA_REL };
    suggestions.extend(size.map(|(then, Candidate { annotation, kind, .. })| {
        let suggestion = Suggestion { annotation, ratio: then / now.hypot(guessed), floor_length_rel: then };
        SuggestedLine { suggestion, kind: Some(kind), segments: Vec::new() }
    }));
    // A comparison with NaN is false, so invalid candidates are removed.
    suggestions.retain(|line| line.suggestion.ratio < MAX_RATIO && line.suggestion.ratio.is_finite());
    suggestions.sort_by(|a, b| a.suggestion.floor_length_rel.total_cmp(&b.suggestion.floor_length_rel));
    // If the scale is guessed, the suggestion of a known size comes last: the shape has priority.
    suggestions.sort_by_key(|line| {
        !fit.is_height_known && line.suggestion.annotation == SuggestedAnnotation::KnownSize
    });
    suggestions
}

/// Returns the suggestion to enter one length on the near floor, measured with a tape. `None` if the height is fixed
/// or known about as precisely as from a tape, if a plan or other cameras give the scale, or if the near floor is not
/// visible.
fn known_size(fit: &Fit, options: &FitOptions) -> Option<Candidate> {
    let sigma = fit.core_covariance[(LOG_HEIGHT, LOG_HEIGHT)].sqrt();
    let is_known = options.fixed.height.is_some() || fit.is_height_known && sigma < 2.0 * MEASURED_SIGMA_REL;
    let is_asked_for = options.is_scale_unknown && !is_known;
    let segment =
        floor_at(fit, [0.0, 0.25 * options.size[1]], 0.0, MEASURED_LENGTH).filter(|_| is_asked_for)?;
    Some(Candidate {
        kind: Kind::KnownLength,
        annotation: SuggestedAnnotation::KnownSize,
        segments: vec![segment],
    })
}

/// Returns the constraints without the rejected ones.
fn without(constraints: &Constraints, rejected: &[Source]) -> Constraints {
    let mut kept = constraints.clone();
    kept.lines.retain(|line| !rejected.contains(&line.source));
    kept.lengths.retain(|length| !rejected.contains(&length.source));
    kept.uprights.retain(|upright| !rejected.contains(&upright.source));
    kept
}

impl Constraints {
    /// Adds the deviation of a new direction, with the scene's errors, and returns its index. Returns `None` for
    /// a vertical, and for a scene whose directions are exact.
    fn deviation_of(&mut self, direction: Direction) -> Option<usize> {
        let Direction::Floor { group, orthogonal } = direction else { return None };
        let SceneErrors { angle, .. } = self.scene;
        let (azimuth, level) = (if orthogonal { angle } else { 0.0 }, self.scene.level());
        (level > 0.0).then(|| {
            self.deviations.push(Deviation { group, orthogonal, azimuth, level, plane: None });
            self.deviations.len() - 1
        })
    }
}

/// Candidate annotation, in undistorted pixels relative to the principal point.
struct Candidate {
    kind: Kind,
    annotation: SuggestedAnnotation,
    segments: Vec<[[f64; 2]; 2]>,
}

impl Candidate {
    /// Returns the constraints and the state with the candidate added.
    fn added_to(&self, constraints: &Constraints, state: &State) -> Option<(Constraints, State)> {
        let mut joined = constraints.clone();
        let end = |point: [f64; 2]| Endpoint { point, covariance: [1.0, 0.0, 1.0] };
        let source = |segment: usize| Source { annotation: usize::MAX, segment };
        let group = joined.groups;
        let constraint = self.kind.row().constraint;
        if matches!(constraint, ConstraintKind::Parallel | ConstraintKind::RightAngle) {
            joined.groups += 1;
        }
        let is_known = self.kind.row().has_length;
        if constraint == ConstraintKind::Length {
            let length = Known::fixed(MEASURED_LENGTH * state.parameters[LOG_HEIGHT].exp());
            joined.length_groups.push(is_known.then_some(length));
        }
        for (i, segment) in self.segments.iter().enumerate() {
            let ends = segment.map(end);
            let orthogonal = constraint == ConstraintKind::RightAngle && i > 0;
            let direction = if constraint == ConstraintKind::Vertical {
                Direction::Vertical
            } else {
                Direction::Floor { group, orthogonal }
            };
            match constraint {
                ConstraintKind::Length => {
                    let group = joined.length_groups.len() - 1;
                    let spread = if is_known { MEASURED_SIGMA_REL } else { joined.scene.length };
                    joined.lengths.push(LengthConstraint {
                        chart: None,
                        ends,
                        group,
                        spread,
                        is_mark: !is_known,
                        plane: None,
                        source: source(i),
                    });
                }
                _ => {
                    let deviation = joined.deviation_of(direction);
                    joined.lines.push(LineConstraint {
                        chart: None,
                        ends,
                        direction,
                        deviation,
                        source: source(i),
                    });
                }
            }
        }
        let at = extended_state(constraints, &joined, state)?;
        Some((joined, at))
    }

    /// Returns the segments of the candidate on the raw image.
    fn pixels(&self, fit: &Fit) -> Vec<[Pixel; 2]> {
        let lens = fit.camera.lens;
        let raw = |[x, y]: [f64; 2]| {
            let centre = lens.principal_point;
            lens.distort(crate::camera::UndistortedPixel { u: centre.u + x, v: centre.v + y })
        };
        self.segments.iter().filter_map(|&[a, b]| Some([raw(a)?, raw(b)?])).collect()
    }
}

/// Returns the state of the constraints with a candidate. The fitted nuisance parameters keep their values;
/// the parameters of the candidate are computed in closed form.
fn extended_state(constraints: &Constraints, joined: &Constraints, state: &State) -> Option<State> {
    let problem = Problem::new(joined, FixedParameters::default(), Priors::default(), 1.0, 1e3);
    let mut at = problem.state_at(state.parameters)?;
    let (old, new) = (Nuisances::new(constraints), Nuisances::new(joined));
    let mut copy = |from: std::ops::Range<usize>, to: usize| {
        at.nuisance[to..to + from.len()].copy_from_slice(&state.nuisance[from]);
    };
    copy(0..old.length(0), 0);
    copy(old.length(0)..old.deviation(0), new.length(0));
    copy(old.deviation(0)..old.tilt(), new.deviation(0));
    copy(old.tilt()..old.count(), new.tilt());
    Some(at)
}

/// Table entry of a candidate: suggested annotation, its kind, and its segments; `None` for an invisible
/// segment.
type CandidateRow = (SuggestedAnnotation, Kind, Vec<Option<[[f64; 2]; 2]>>);

/// Returns candidates of every kind at their most informative positions, from the estimated floor.
fn candidates(fit: &Fit, options: &FitOptions) -> Vec<Candidate> {
    let [w, h] = options.size;
    let at = |x: f64, y: f64| [x * w, y * h];
    let vertical = |x: f64| vertical_at(fit, at(x, 0.2), 0.35 * h);
    let floor = |x: f64, y: f64, azimuth: f64, length: f64| floor_at(fit, at(x, y), azimuth, length);
    let half = std::f64::consts::FRAC_PI_2;
    let (away, slant) = (half, 0.5 * half);
    let list: [CandidateRow; 6] = [
        (SuggestedAnnotation::VerticalOnTheLeft, Kind::Vertical, vec![vertical(-0.4)]),
        (SuggestedAnnotation::VerticalOnTheRight, Kind::Vertical, vec![vertical(0.4)]),
        (
            SuggestedAnnotation::ParallelsAway,
            Kind::Parallel,
            vec![floor(-0.3, 0.25, away, 1.2), floor(0.3, 0.25, away, 1.2)],
        ),
        (
            SuggestedAnnotation::ParallelsAcross,
            Kind::Parallel,
            vec![floor(0.0, 0.4, 0.1, 0.8), floor(0.0, 0.05, 0.1, 1.6)],
        ),
        (
            SuggestedAnnotation::RightAngle,
            Kind::Perpendicular,
            vec![floor(0.05, 0.2, slant, 0.8), floor(-0.05, 0.2, slant + half, 0.8)],
        ),
        (
            SuggestedAnnotation::EqualLengths,
            Kind::EqualLength,
            vec![floor(-0.2, 0.35, away, 0.5), floor(0.2, 0.1, away, 0.5), floor(0.0, 0.25, 0.0, 0.5)],
        ),
    ];
    list.into_iter()
        .filter_map(|(annotation, kind, segments)| {
            let segments: Option<Vec<_>> = segments.into_iter().collect();
            Some(Candidate { annotation, kind, segments: segments? })
        })
        .collect()
}

/// Returns a vertical segment, `length` pixels long, upwards from a point relative to the principal point.
fn vertical_at(fit: &Fit, [x, y]: [f64; 2], length: f64) -> Option<[[f64; 2]; 2]> {
    let v = fit.camera.vanishing_point([0.0, 0.0, -1.0]);
    let (dx, dy) = (v[0] - x * v[2], v[1] - y * v[2]);
    let norm = dx.hypot(dy);
    (norm > 1e-6).then(|| [[x, y], [x - length * dx / norm, y - length * dy / norm]])
}

/// Returns a floor segment centred at the floor point of an undistorted pixel relative to the principal point.
/// It is `length` camera heights long, at `azimuth` radians counter-clockwise from the camera's right.
fn floor_at(fit: &Fit, [x, y]: [f64; 2], azimuth: f64, length: f64) -> Option<[[f64; 2]; 2]> {
    let camera = fit.camera;
    let centre = camera.lens.principal_point;
    let middle = camera
        .undistorted_to_floor(crate::camera::UndistortedPixel { u: centre.u + x, v: centre.v + y }, 0.0)?;
    let (sin, cos) = azimuth.sin_cos();
    let end = |sign: f64| {
        let reach = 0.5 * sign * length * camera.position.z;
        let point = crate::camera::WorldPoint::new(middle.x + reach * cos, middle.y + reach * sin, 0.0);
        let shown = camera.world_to_undistorted(point)?;
        Some([shown.u - centre.u, shown.v - centre.v])
    };
    Some([end(-1.0)?, end(1.0)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Lens, WorldPoint};

    fn camera() -> Camera {
        let mut covariance = Covariance::EXACT;
        for index in [Covariance::ROLL, Covariance::PITCH, Covariance::FOCAL] {
            covariance.0[index][index] = 1e-4;
        }
        Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 0.6,
            roll: 0.02,
            focal: 1200.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance,
        }
    }

    #[test]
    fn shared_points_add_more_information_if_the_other_camera_is_more_accurate() {
        let information_with = |known: f64| {
            let information = Matrix4::from_diagonal(&nalgebra::Vector4::new(known, known, known, 0.0));
            shared_points(&camera(), [1920.0, 1080.0], 1.0, &information).unwrap()
        };
        let (little, much) = (information_with(10.0), information_with(1e5));
        for k in [ROLL, PITCH, LOG_FOCAL] {
            assert!(much[(k, k)] > little[(k, k)] && little[(k, k)] >= -1e-9, "{k}: {little} {much}");
        }
        // The information of the shared points is limited.
        assert!(much[(ROLL, ROLL)] < 1e7, "{much}");
    }

    #[test]
    fn camera_without_floor_has_no_shared_points() {
        let up = Camera { pitch: -0.6, ..camera() };
        assert!(shared_points(&up, [1920.0, 1080.0], 1.0, &Matrix4::identity()).is_none());
    }
}
