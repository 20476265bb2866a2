//! What the operator should know of a fit, and what to draw next.

use crate::finding::{Code, Warning};
use crate::optimize::Uncertainty;
use crate::single::accuracy::floor_length_rel;
use crate::single::annotation::{Annotation, Evidence, Kind, line_name};
use crate::single::constraints::{Constraints, Direction, Endpoint, Length, Line, Source};
use crate::single::fit::{Fit, FitOptions, grid};
use crate::single::likelihood::{Problem, State};
use crate::single::minima::OPEN_FOCAL;

/// Relative error of floor lengths above which a result is weak, and above which it is unusable.
const WEAK: f64 = 0.03;
const UNUSABLE: f64 = 0.10;

/// A drawing that would help most.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DrawNext {
    /// What to draw.
    pub kind: Kind,
    /// Where, in a sentence.
    pub message: String,
    /// Raw pixels of an example, segment by segment.
    pub segments_px: Vec<[crate::camera::Pixel; 2]>,
    /// The predicted relative error of floor lengths with it.
    pub floor_length_rel: f64,
}

/// The remarks on a fit, the gravest first.
#[must_use]
pub fn warnings(fit: &Fit, annotations: &[Annotation], next: Option<&DrawNext>) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut warn =
        |code: Code, message: String, advice: String| warnings.push(Warning { code, message, advice });
    let next = next
        .map_or_else(|| "Draw lines elsewhere and in other directions.".into(), |next| next.message.clone());
    if let Some(sigma) = fit.log_focal_sigma.filter(|&sigma| sigma > OPEN_FOCAL) {
        warn(Code::FocalUnobservable, open_focal(fit, sigma), format!("{} {next}", open_focal_advice(fit)));
        let narrowed = fit.log_focal_sigma_of_answer();
        if fit.weak_prior_used && narrowed < 0.5 * sigma {
            let message = format!(
                "The focal of {:.0} px \u{b1} {:.0} % comes from what cameras usually have, not from the lines.",
                fit.camera.focal,
                100.0 * narrowed
            );
            warn(
                Code::PriorDominates,
                message,
                "Enter the focal if you know it, or draw what tells it.".into(),
            );
        }
    }
    if fit.two_solutions {
        let list: Vec<String> = fit
            .alternatives
            .iter()
            .map(|other| {
                format!(
                    "focal {:.0} px with pitch {:.1}\u{b0}",
                    other.orientation.focal,
                    other.orientation.pitch.to_degrees()
                )
            })
            .collect();
        let message = format!("The lines fit another camera as well: {}.", list.join("; "));
        warn(Code::TwoSolutions, message, format!("One more line decides. {next}"));
    }
    warnings.extend(floor_warning(fit.floor_length_rel, &next));
    let mut warn =
        |code: Code, message: String, advice: String| warnings.push(Warning { code, message, advice });
    for source in &fit.outliers {
        let (label, pixels) = named(fit, annotations, *source);
        let message = if pixels.is_finite() {
            format!("{label} contradicts the others by {pixels:.1} px and was set aside.")
        } else {
            format!("{label} lies above the horizon that the others give, and was set aside.")
        };
        let advice = "Draw it again, delete it, or mark it \"keep\" if it is right.";
        warn(Code::Outlier, message, advice.into());
    }
    if fit.misfit {
        warn(Code::Misfit, misfit(fit, annotations), "Look at the largest residuals: a line off its edge, a direction that is not parallel, or a bent lens.".into());
    }
    warnings
}

/// What is to be said of the error of lengths on the floor, if it is large.
pub(crate) fn floor_warning(rel: Option<f64>, advice: &str) -> Option<Warning> {
    let percent = |rel: f64| format!("Lengths on the floor are known to \u{b1} {:.1} %.", 100.0 * rel);
    match rel {
        Some(rel) if rel > UNUSABLE => Some(Warning::new(Code::Unusable, percent(rel), advice)),
        Some(rel) if rel > WEAK => Some(Warning::new(Code::Weak, percent(rel), advice)),
        Some(_) => None,
        None => Some(Warning::new(
            Code::Unusable,
            "The camera sees no floor where its field of view is.",
            "Check that floor lines and verticals were not exchanged; draw the field of view on the floor.",
        )),
    }
}

fn open_focal(fit: &Fit, sigma: f64) -> String {
    let covariance =
        if sigma > 1.0 { "at all".into() } else { format!("better than \u{b1} {:.0} %", 100.0 * sigma) };
    match fit.floor_length_rel {
        Some(rel) if rel <= WEAK && fit.camera.pitch > 1.2 => format!(
            "Looking down, the lines do not tell the focal {covariance}; the floor is good to {:.1} %, heights above it are not.",
            100.0 * rel
        ),
        _ => {
            format!(
                "Focal length and pitch cannot be told apart: the lines do not tell the focal {covariance}."
            )
        }
    }
}

fn open_focal_advice(fit: &Fit) -> &'static str {
    if fit.camera.pitch > 1.2 {
        "Enter the focal if heights matter, or draw verticals."
    } else {
        "Draw floor lines that run away from the camera, or a right angle at about 45 degrees to the view, or enter the focal."
    }
}

fn named(fit: &Fit, annotations: &[Annotation], source: Source) -> (String, f64) {
    let pixels =
        fit.residuals.iter().find(|(s, _)| *s == source).map_or(f64::NAN, |(_, pixels)| pixels.abs());
    let label = annotations.get(source.annotation).map_or_else(String::new, |a| a.label(source.annotation));
    (format!("{} of {label}", line_name(annotations, source.annotation, source.segment)), pixels)
}

fn misfit(fit: &Fit, annotations: &[Annotation]) -> String {
    let worst = fit.residuals.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let worst = worst.map_or_else(String::new, |(source, _)| {
        let (label, pixels) = named(fit, annotations, *source);
        format!(" The largest is {label}: {pixels:.1} px.")
    });
    format!("Residuals are larger than drawing noise (chi-square {:.0} on {}).{worst}", fit.chi2, fit.dof)
}

/// Of drawings not made yet the one that would lower the error of floor lengths most; `None` when
/// none of them lowers it by a fifth.
#[must_use]
pub fn draw_next(fit: &Fit, constraints: &Constraints, options: &FitOptions) -> Option<DrawNext> {
    /// Share of the error that must go, to be worth a click.
    const WORTH: f64 = 0.8;
    let kept: Constraints = without(constraints, &fit.outliers);
    let grid = grid(&fit.camera, options.efov, options.size);
    let sigma = fit.sigma;
    let rel = |constraints: &Constraints, state: &State| {
        let problem = Problem::new(constraints, options.held, options.priors, sigma, options.size[0]);
        let information = problem.normal(state)?.information(problem.free);
        let uncertainty = Uncertainty::new(&information, problem.free);
        floor_length_rel(&fit.state.parameters, &grid, &uncertainty.covariance, fit.height_known)
    };
    let now = rel(&kept, &fit.state)?;
    let best = candidates(fit, options)
        .into_iter()
        .filter_map(|candidate| {
            let (constraints, state) = candidate.join(&kept, &fit.state)?;
            Some((rel(&constraints, &state)?, candidate))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    let (then, candidate) = best;
    // A comparison with NaN is false: then nothing is advised.
    (then < WORTH * now && then.is_finite()).then(|| DrawNext {
        kind: candidate.kind,
        message: format!(
            "{} would {} (then floor \u{b1} {:.1} %).",
            candidate.what,
            gain(then / now),
            100.0 * then
        ),
        segments_px: candidate.pixels(fit),
        floor_length_rel: then,
    })
}

fn gain(ratio: f64) -> String {
    match ratio {
        r if r < 0.28 => "cut the uncertainty of the floor to a fraction".into(),
        r if r < 0.4 => "cut the uncertainty of the floor to a third".into(),
        r if r < 0.6 => "halve the uncertainty of the floor".into(),
        r => format!("lower the uncertainty of the floor by {:.0} %", 100.0 * (1.0 - r)),
    }
}

fn without(constraints: &Constraints, rejected: &[Source]) -> Constraints {
    let mut kept = constraints.clone();
    kept.lines.retain(|line| !rejected.contains(&line.source));
    kept.lengths.retain(|length| !rejected.contains(&length.source));
    kept.uprights.retain(|upright| !rejected.contains(&upright.source));
    kept
}

/// A drawing that could be made, in undistorted pixels relative to the principal point.
struct Candidate {
    kind: Kind,
    what: &'static str,
    segments: Vec<[[f64; 2]; 2]>,
}

impl Candidate {
    /// The evidence and the state with this drawing in it.
    fn join(&self, constraints: &Constraints, state: &State) -> Option<(Constraints, State)> {
        let mut joined = constraints.clone();
        let end = |at: [f64; 2]| Endpoint { at, covariance: [1.0, 0.0, 1.0] };
        let source = |segment: usize| Source { annotation: usize::MAX, segment };
        let group = joined.groups;
        let evidence = self.kind.row().evidence;
        if matches!(evidence, Evidence::Parallel | Evidence::RightAngle) {
            joined.groups += 1;
        }
        if evidence == Evidence::Length {
            joined.length_groups.push(None);
        }
        for (i, segment) in self.segments.iter().enumerate() {
            let ends = segment.map(end);
            let orthogonal = evidence == Evidence::RightAngle && i > 0;
            let direction = if evidence == Evidence::Plumb {
                Direction::Vertical
            } else {
                Direction::Floor { group, orthogonal }
            };
            match evidence {
                Evidence::Length => {
                    let group = joined.length_groups.len() - 1;
                    joined.lengths.push(Length { ends, group, source: source(i) });
                }
                _ => joined.lines.push(Line { ends, direction, source: source(i) }),
            }
        }
        // Directions and lengths of what is there keep their values: the new one is exact there.
        let problem = Problem::new(
            &joined,
            crate::single::abramov::FixedParameters::default(),
            crate::single::likelihood::Priors::default(),
            1.0,
            1e3,
        );
        let mut at = problem.state_at(state.parameters)?;
        let old = constraints.groups;
        at.nuisance[..old].copy_from_slice(&state.nuisance[..old]);
        let lengths = state.nuisance.len() - old;
        at.nuisance[joined.groups..joined.groups + lengths].copy_from_slice(&state.nuisance[old..]);
        Some((joined, at))
    }

    /// Its segments on the raw image.
    fn pixels(&self, fit: &Fit) -> Vec<[crate::camera::Pixel; 2]> {
        let lens = fit.camera.lens;
        let raw = |[x, y]: [f64; 2]| {
            let centre = lens.principal_point;
            lens.distort(crate::camera::UndistortedPixel { u: centre.u + x, v: centre.v + y })
        };
        self.segments.iter().filter_map(|&[a, b]| Some([raw(a)?, raw(b)?])).collect()
    }
}

/// A kind, what to say of it, and its segments where they are on the image.
type Sketch = (Kind, &'static str, Vec<Option<[[f64; 2]; 2]>>);

/// Drawings of every kind at the places where they say most, as the fit sees the floor.
fn candidates(fit: &Fit, options: &FitOptions) -> Vec<Candidate> {
    let [w, h] = options.size;
    let at = |x: f64, y: f64| [x * w, y * h];
    let vertical = |x: f64| vertical_at(fit, at(x, 0.2), 0.35 * h);
    let floor = |x: f64, y: f64, azimuth: f64, length: f64| floor_at(fit, at(x, y), azimuth, length);
    let half = std::f64::consts::FRAC_PI_2;
    let (away, slant) = (half, 0.5 * half);
    let list: [Sketch; 6] = [
        (Kind::Vertical, "A vertical near the left edge of the image", vec![vertical(-0.4)]),
        (Kind::Vertical, "A vertical near the right edge of the image", vec![vertical(0.4)]),
        (
            Kind::Parallel,
            "Two parallel floor lines that run away from the camera, left and right",
            vec![floor(-0.3, 0.25, away, 1.2), floor(0.3, 0.25, away, 1.2)],
        ),
        (
            Kind::Parallel,
            "Two parallel floor lines across the view, near and far",
            vec![floor(0.0, 0.4, 0.1, 0.8), floor(0.0, 0.05, 0.1, 1.6)],
        ),
        (
            Kind::Perpendicular,
            "A right angle near the middle of the floor, at about 45 degrees to the view,",
            vec![floor(0.05, 0.2, slant, 0.8), floor(-0.05, 0.2, slant + half, 0.8)],
        ),
        (
            Kind::EqualLength,
            "Three floor segments of equal length, near, far and across,",
            vec![floor(-0.2, 0.35, away, 0.5), floor(0.2, 0.1, away, 0.5), floor(0.0, 0.25, 0.0, 0.5)],
        ),
    ];
    list.into_iter()
        .filter_map(|(kind, what, segments)| {
            let segments: Option<Vec<_>> = segments.into_iter().collect();
            Some(Candidate { kind, what, segments: segments? })
        })
        .collect()
}

fn vertical_at(fit: &Fit, [x, y]: [f64; 2], length: f64) -> Option<[[f64; 2]; 2]> {
    let v = fit.camera.vanishing_point([0.0, 0.0, -1.0]);
    let (dx, dy) = (v[0] - x * v[2], v[1] - y * v[2]);
    let norm = dx.hypot(dy);
    (norm > 1e-6).then(|| [[x, y], [x - length * dx / norm, y - length * dy / norm]])
}

/// A floor segment about what the camera shows at a pixel, `length` camera heights long.
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
