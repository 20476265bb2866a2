//! Parts of sentences: names of annotations, links and cameras, longer phrases, plural forms, and
//! suggestions.

use calib_core::outcome::{
    Code, DisconnectionReason, Estimator, Finding, OtherMinimum, Parameter, SharedEvidence, Source, Subject,
    SuggestedAnnotation, Suggestion, UnusedReason,
};
use calib_core::single::{Annotation, line_name};

use crate::document::{Site, SiteCamera};
use crate::units::Units;

impl Site {
    /// Returns a note that lengths measured with a calibrated camera can be wrong by a common factor. Returns `None`
    /// if the scale of the camera is known, or if the camera is not calibrated.
    #[must_use]
    pub fn scale_note(&self, entry: &SiteCamera) -> Option<String> {
        let solution =
            entry.solution.as_ref().filter(|_| entry.camera().is_some() && !self.scale_is_known(entry))?;
        let height = solution.position_m.filter(|_| solution.has_warning(Code::ScaleAssumed));
        let assumed = height.map_or_else(String::new, |position| {
            format!(" (assumed camera height: {})", self.units.length(position.z, 2))
        });
        Some(format!(
            "camera \"{}\": the scale is unknown{assumed}, so all lengths can be wrong by a common factor. Enter a height or a length.",
            entry.id
        ))
    }
}

/// Formats a count with the singular or plural form: "1 line", "2 lines", "0 lines".
#[must_use]
pub fn counted(count: usize, one: &str, many: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {many}") }
}

/// Describes a suggested annotation and its effect on the uncertainty of floor lengths.
pub(crate) fn suggestion_text(suggestion: &Suggestion) -> String {
    let what = match suggestion.annotation {
        SuggestedAnnotation::VerticalOnTheLeft => "A vertical near the left edge of the image",
        SuggestedAnnotation::VerticalOnTheRight => "A vertical near the right edge of the image",
        SuggestedAnnotation::ParallelsAway => {
            "Two parallel floor lines that run away from the camera, left and right"
        }
        SuggestedAnnotation::ParallelsAcross => "Two parallel floor lines across the view, near and far",
        SuggestedAnnotation::RightAngle => {
            "A right angle near the middle of the floor, at about 45\u{b0} to the view,"
        }
        SuggestedAnnotation::EqualLengths => {
            "Three floor segments of equal length (near, far, and across the view)"
        }
        SuggestedAnnotation::SharedPoints => {
            "Linking four floor points to another camera that also shows them"
        }
        SuggestedAnnotation::KnownSize => {
            "One object of known length on the floor (a tile, a lane, a parking bay)"
        }
    };
    let gain = match suggestion.ratio {
        r if r < 0.28 => "greatly reduce the floor uncertainty".into(),
        r if r < 0.4 => "reduce the floor uncertainty to a third".into(),
        r if r < 0.6 => "halve the floor uncertainty".into(),
        r => format!("reduce the floor uncertainty by {:.0} %", 100.0 * (1.0 - r)),
    };
    // If the scale is unknown, `floor_length_rel` covers only the shape of the floor. Only a known size also
    // improves the scale.
    let scale =
        if suggestion.annotation == SuggestedAnnotation::KnownSize { ", including the scale" } else { "" };
    format!("{what} would {gain} (to \u{b1} {:.1} %{scale}).", 100.0 * suggestion.floor_length_rel)
}

/// Naming scheme for annotations in sentences.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Names {
    /// Kind and index in the file: `Vertical (annotation 0)`.
    InFile,
    /// Names of the lines, as labelled on the image: `V1 to V3`.
    OnScreen,
}

/// Context for the sentences: the site, the camera and the naming scheme.
pub(super) struct SentenceContext<'a> {
    pub(super) site: &'a Site,
    /// Camera of the finding; `None` for a finding about the site.
    pub(super) entry: Option<&'a SiteCamera>,
    pub(super) names: Names,
}

impl SentenceContext<'_> {
    fn annotations(&self) -> &[Annotation] {
        self.entry.map_or(&[], |entry| &entry.annotations)
    }

    /// Returns the name of an annotation, by its index in the file or by its lines.
    pub(super) fn label(&self, index: usize) -> String {
        let Some(annotation) = self.annotations().get(index) else { return String::new() };
        // An annotation without lines has no label on the image.
        if self.names == Names::InFile || annotation.polylines().count() == 0 {
            return annotation.label(index);
        }
        let name = |segment| line_name(self.annotations(), index, segment);
        match annotation.segments.as_ref().map_or(0, |segments| segments.len().saturating_sub(1)) {
            0 => name(0),
            last => format!("{} to {}", name(0), name(last)),
        }
    }

    /// Returns the name of a line, such as `V1`.
    fn line(&self, line: Source) -> String {
        line_name(self.annotations(), line.annotation, line.segment)
    }

    /// Returns the name of a line; with [`Names::InFile`], followed by its annotation.
    pub(super) fn line_of(&self, line: Source) -> String {
        match self.names {
            Names::InFile => format!("{} of {}", self.line(line), self.label(line.annotation)),
            Names::OnScreen => self.line(line),
        }
    }

    /// Returns the quoted id of a camera; empty quotes if the index is out of range.
    pub(super) fn id(&self, camera: usize) -> String {
        format!("\"{}\"", self.site.cameras.get(camera).map_or("", |entry| &entry.id))
    }

    fn ids(&self, cameras: &[usize]) -> String {
        let ids: Vec<String> = cameras.iter().map(|&camera| self.id(camera)).collect();
        enumerated(&ids)
    }

    /// Returns the name of a control point of a camera, as used for residuals.
    fn control_point(&self, entry: Option<&SiteCamera>, index: usize) -> String {
        entry.and_then(|entry| entry.control_points.get(index)).map_or_else(String::new, |p| p.label(index))
    }

    fn distance(&self, index: usize) -> String {
        let entry = self.site.distances.get(index);
        entry.map_or_else(String::new, |entry| {
            let [a, b] = &entry.between;
            format!("distance between \"{a}\" and \"{b}\"")
        })
    }

    /// Returns the name of a link, mark, control point, distance or camera, for use within a sentence.
    fn shared(&self, subject: Subject) -> String {
        let name = |id: Option<&String>, index: usize| id.cloned().unwrap_or_else(|| index.to_string());
        match subject {
            Subject::Link(i) => {
                format!("link \"{}\"", name(self.site.links.get(i).and_then(|link| link.id.as_ref()), i))
            }
            Subject::Mark(i) => {
                format!("mark \"{}\"", name(self.site.marks.get(i).and_then(|mark| mark.id.as_ref()), i))
            }
            Subject::ControlPoint { camera, point } => {
                format!("control point \"{}\"", self.control_point(self.site.cameras.get(camera), point))
            }
            Subject::Distance(i) => format!("the {}", self.distance(i)),
            Subject::Camera(i) => format!("camera {}", self.id(i)),
            _ => String::new(),
        }
    }

    /// Formats a length, given in metres, in the unit of the site.
    pub(super) fn length(&self, metres: f64) -> String {
        self.site.units.length(metres, 2).replace('\u{2212}', "-")
    }

    pub(super) fn scale_assumed(&self, height: f64) -> String {
        format!("The scale is unknown: a camera height of {} is assumed.", self.length(height))
    }

    /// Returns a sentence about feet if the ratio of two contradictory lengths is about 3.28 or its inverse;
    /// otherwise an empty text.
    fn feet(&self, ratio: f64) -> &'static str {
        const FEET_PER_METRE: f64 = 1.0 / 0.3048;
        /// Largest relative difference between the ratio and the number of feet in a metre, or its inverse.
        const TOLERANCE: f64 = 0.06;
        let is_near = |expected: f64| (ratio / expected - 1.0).abs() < TOLERANCE;
        match self.site.units {
            _ if !is_near(FEET_PER_METRE) && !is_near(1.0 / FEET_PER_METRE) => "",
            Units::Metres => {
                " The ratio is 3.28: one of the lengths seems to be in feet. Enter all lengths in metres (1 ft is 0.3048 m)."
            }
            Units::Feet => {
                " The ratio is 3.28: one of the lengths seems to be in the wrong unit. In the app, type the unit (1.75 m). The file contains metres."
            }
        }
    }

    pub(super) fn scale_conflict(&self, estimated: f64, placed: f64) -> String {
        format!(
            "The camera height is {} according to the annotations and entered values, but {} according to its placement.{}",
            self.length(estimated),
            self.length(placed),
            self.feet(estimated / placed)
        )
    }

    pub(super) fn line_outlier(&self, line: Source, px: Option<f64>, lengths: Option<[f64; 2]>) -> String {
        let line = self.line_of(line);
        if let Some([entered, found]) = lengths {
            return format!(
                "{line} was rejected: its length is {} as entered, but {} according to the other lines and heights.{}",
                self.length(entered),
                self.length(found),
                self.feet(entered / found)
            );
        }
        match px {
            Some(px) => format!("{line} contradicts the other lines by {px:.1} px and was rejected."),
            None => format!("{line} is above the horizon computed from the other lines and was rejected."),
        }
    }

    pub(super) fn heights_apart(&self, lowest: (Source, f64), highest: (Source, f64)) -> String {
        let [(low, lowest), (high, highest)] =
            [lowest, highest].map(|(line, height)| (self.line_of(line), height));
        format!(
            "Uprights contradict each other: the camera height is {} according to {low}, but {} according to {high}.{}",
            self.length(lowest),
            self.length(highest),
            self.feet(highest / lowest)
        )
    }

    pub(super) fn too_few(&self, annotation: usize, by: Estimator, [drawn, least]: [usize; 2]) -> String {
        let (who, label) = (estimator(by), self.label(annotation));
        format!("{who} {label}: it has {} and needs at least {least}.", counted(drawn, "segment", "segments"))
    }

    /// Describes annotated points that are outside the image.
    pub(super) fn points_outside(&self, finding: &Finding) -> String {
        let Finding::PointsOutside {
            outside,
            total: drawn,
            size: [width, height],
            fits_exchanged,
            first,
            ..
        } = finding
        else {
            return String::new();
        };
        let first = match *first {
            Subject::Annotation(index) => self.label(index),
            Subject::OwnControlPoint(point) => {
                format!("control point {}", self.control_point(self.entry, point))
            }
            Subject::Efov => "the field of view".into(),
            shared => self.shared(shared),
        };
        let exchanged =
            if *fits_exchanged { " With u and v swapped, all points would be inside." } else { "" };
        format!(
            "Points outside the image of {width} x {height} pixels: {outside} of {drawn}, the first in \
             {first}.{exchanged}"
        )
    }

    /// Describes the largest difference between a stored solution and the current site; residuals in pixels.
    pub(super) fn out_of_date(&self, what: Subject, stored: Option<f64>, now: Option<f64>) -> String {
        let name = match what {
            Subject::Line(line) if self.annotations().get(line.annotation).is_some() => self.line_of(line),
            Subject::Line(line) => format!("annotation {}", line.annotation),
            Subject::OwnControlPoint(point) => {
                format!("control point {}", self.control_point(self.entry, point))
            }
            what => self.shared(what),
        };
        match (stored, now) {
            (Some(stored), Some(now)) => format!(
                "The solution is out of date: {name} is now {:.1} px from its prediction, compared with {:.1} px when \
                 the site was solved.",
                now.abs(),
                stored.abs()
            ),
            (None, Some(_)) => format!("The solution is out of date: it does not include {name}."),
            (_, None) => {
                format!("The solution is out of date: {name} was moved or removed.")
            }
        }
    }

    pub(super) fn misfit(&self, chi2: f64, dof: i64, worst: Option<(Source, f64)>) -> String {
        let worst = worst
            .map_or_else(String::new, |(line, px)| format!(" Worst: {}, {px:.1} px.", self.line_of(line)));
        format!(
            "The lines disagree more than annotation noise explains (chi-square {chi2:.0}, {}).{worst}",
            degrees_of_freedom(dof)
        )
    }

    pub(super) fn uninformative(&self, edges: &[Source], drawn: usize, bend_px: f64) -> String {
        /// Largest number of edges listed by name; longer lists give only their count.
        const MAX_NAMED_EDGES: usize = 4;
        let names: Vec<String> = edges.iter().map(|&edge| self.line(edge)).collect();
        let who = match names.len() {
            1 => format!("{} hardly constrains", names[0]),
            2..=MAX_NAMED_EDGES => format!("{} hardly constrain", names.join(", ")),
            count => format!("{count} of {drawn} straight edges hardly constrain"),
        };
        let by = if names.len() == 1 { "this edge by" } else { "these edges by at most" };
        format!("{who} the lens: 10 px of distortion in the corner would curve {by} {bend_px:.1} px.")
    }

    pub(super) fn unused_edges(&self, first: usize, count: usize, is_undistorted: bool, px: f64) -> String {
        let which = if count == 1 { self.label(first) } else { format!("{count} straight edges") };
        let how = if is_undistorted { "without distortion" } else { "with the entered distortion" };
        format!(
            "The fit does not use {which}: the lens is fixed {how}. The deviation from a straight line is \
             {px:.2} px."
        )
    }

    pub(super) fn hidden_control_points(&self, points: &[usize]) -> String {
        let names: Vec<String> = points.iter().map(|&point| self.control_point(self.entry, point)).collect();
        format!("Control points that are not visible from the computed camera pose: {}.", names.join(", "))
    }

    pub(super) fn far_control_points(&self, rms_px: f64, worst: usize, worst_px: f64) -> String {
        let name = self.control_point(self.entry, worst);
        format!("The control points have an RMS residual of {rms_px:.1} px. Worst: {name}, {worst_px:.1} px.")
    }

    pub(super) fn exchanged_control_points(&self, points: [usize; 2]) -> String {
        let [a, b] = points.map(|point| self.control_point(self.entry, point));
        format!("Control points {a} and {b} are swapped: all points fit if you swap the pixels of these two.")
    }

    pub(super) fn far_from_map(&self, camera: usize, point: usize, distance: f64) -> String {
        let name = self.control_point(self.site.cameras.get(camera), point);
        let distance = self.length(distance);
        format!(
            "Control point {name} is {distance} away from its map coordinates, according to the other points."
        )
    }

    pub(super) fn large_site(&self, camera: usize, distance: f64, drop: f64) -> String {
        let [distance, drop] =
            [(distance, 0), (drop, 1)].map(|(length, digits)| self.site.units.length(length, digits));
        format!(
            "Camera {} is {distance} from the origin of the site. The Earth is curved, so the ground there is {drop} \
             below the plane of the floor.",
            self.id(camera)
        )
    }

    pub(super) fn control_point_outlier(&self, camera: usize, point: usize) -> String {
        let name = self.control_point(self.site.cameras.get(camera), point);
        format!("Control point {name} contradicts the others and was rejected.")
    }

    pub(super) fn element_outlier(&self, element: Subject, worst: Option<(usize, f64)>) -> String {
        let far =
            worst.map_or_else(String::new, |(camera, px)| format!(" ({px:.0} px in {})", self.id(camera)));
        let element = capitalised(&self.shared(element));
        format!("{element} contradicts the others and was rejected{far}.")
    }

    pub(super) fn unchecked_links(&self, elements: &[Subject], cameras: &[usize]) -> String {
        /// Largest number of elements that are listed.
        const MAX_LISTED: usize = 4;
        let mut names: Vec<String> = elements.iter().take(MAX_LISTED).map(|&one| self.shared(one)).collect();
        if elements.len() > MAX_LISTED {
            names.push(format!("{} more", elements.len() - MAX_LISTED));
        }
        if cameras.is_empty() {
            return format!(
                "There is no redundant point, so a wrong click cannot be detected in: {}.",
                enumerated(&names)
            );
        }
        format!(
            "There is no redundant link with {}, so a wrong click cannot be detected in: {}.",
            self.ids(cameras),
            enumerated(&names),
        )
    }

    pub(super) fn distance_outlier(&self, distance: usize, [entered, found]: [f64; 2]) -> String {
        format!(
            "The {} was rejected: it is {} as entered, but {} according to the other measurements.{}",
            self.distance(distance),
            self.length(entered),
            self.length(found),
            self.feet(entered / found)
        )
    }

    pub(super) fn not_connected(&self, cameras: &[usize], why: DisconnectionReason) -> String {
        let ids = self.ids(cameras);
        match why {
            DisconnectionReason::TooFewLandmarks => {
                format!("There are too few links to other cameras to place {ids}.")
            }
            DisconnectionReason::PlacedByOperator => {
                format!("Nothing connects {ids} to the rest of the site. The placement by hand is kept.")
            }
            DisconnectionReason::NoLandmarks => format!("Nothing connects {ids} to the rest of the site."),
        }
    }

    pub(super) fn scale_unknown(&self, cameras: &[usize], root: usize) -> String {
        let (ids, root) = (self.ids(cameras), self.id(root));
        format!(
            "The scale of {ids} is unknown. Camera {root} is assumed to be at the height from its placement, or at 3 m if it has no placement."
        )
    }

    pub(super) fn too_many(&self, count: usize, first: usize) -> String {
        let first = self.id(first);
        format!(
            "{count} cameras, including {first}, cannot be solved together: too many of them share links and marks. Each camera is solved separately."
        )
    }

    pub(super) fn unused(&self, what: &[Subject], why: UnusedReason) -> String {
        let names: Vec<String> = what.iter().map(|&subject| self.shared(subject)).collect();
        let why = match why {
            UnusedReason::NotVisible => "the computed position is not visible in one of the cameras",
            UnusedReason::SingleView => "annotated in only one camera",
            UnusedReason::UnknownLengthOrEnd => {
                "an end has no position, or the length has neither \"sigma\" nor \"fixed\""
            }
            UnusedReason::NoPoses => "no combination of camera poses makes every link and mark visible",
            UnusedReason::NoGeoreference => "the position of the site on the map is unknown",
        };
        format!("Not used: {}; {why}.", enumerated(&names))
    }
}

/// Joins names as "a, b, c and 7 more".
fn enumerated(names: &[String]) -> String {
    /// Largest number of names in a complete list; longer lists end with a count.
    const MAX_LISTED_NAMES: usize = 6;
    match names.len() {
        0..=MAX_LISTED_NAMES => names.join(", "),
        count => {
            format!("{} and {} more", names[..MAX_LISTED_NAMES - 1].join(", "), count - MAX_LISTED_NAMES + 1)
        }
    }
}

/// Returns the text with an uppercase first letter.
fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

pub(super) fn undetermined_focal(sigma: f64, floor_seen_from_above: Option<f64>) -> String {
    let known =
        if sigma > 1.0 { String::new() } else { format!(" to better than \u{b1} {:.0} %", 100.0 * sigma) };
    match floor_seen_from_above {
        Some(rel) => format!(
            "The camera looks down, so the lines do not determine the focal length{known}. Floor lengths are accurate to \u{b1} {:.1} %, but heights are not.",
            100.0 * rel
        ),
        None => {
            format!(
                "Focal length and pitch cannot be separated: the lines do not determine the focal length{known}."
            )
        }
    }
}

pub(super) fn default_focal(focal: f64, sigma: f64) -> String {
    format!(
        "The focal length ({focal:.0} px \u{b1} {:.0} %) is a default; the lines do not determine it.",
        100.0 * sigma
    )
}

pub(super) fn other_minima(others: &[OtherMinimum]) -> String {
    let list: Vec<String> = others
        .iter()
        .map(|other| {
            let [roll, pitch] = [other.roll, other.pitch].map(f64::to_degrees);
            format!("focal length {:.0} px with roll {roll:.1}\u{b0} and pitch {pitch:.1}\u{b0}", other.focal)
        })
        .collect();
    let who = if list.len() == 1 { "Another solution also fits" } else { "Other solutions also fit" };
    format!("{who}: {}.", list.join("; "))
}

pub(super) const fn unchecked_points(dof: i64) -> &'static str {
    if dof < 1 {
        "The points have no redundant coordinate, so a wrong point cannot be detected."
    } else {
        "The points have one redundant coordinate, which is too few to detect a wrong point reliably."
    }
}

pub(super) fn unchecked(dof: i64, rejected: usize) -> String {
    let aside = match rejected {
        0 => "",
        1 => " after a line was rejected",
        _ => " after lines were rejected",
    };
    match dof {
        ..=0 => format!("There are no redundant lines{aside}, so errors cannot be detected."),
        1 => format!("There is only one redundant line{aside}, which is too few to detect errors reliably."),
        _ => {
            format!(
                "There are only {dof} redundant lines{aside}, which are too few to detect errors reliably."
            )
        }
    }
}

pub(super) fn few_residuals(dof: i64, factor: f64) -> String {
    let lines = counted(usize::try_from(dof).unwrap_or_default(), "redundant line", "redundant lines");
    format!(
        "The annotation noise is estimated from only {lines}, so every \u{b1} is wider by a factor of \
         {factor:.1} (Student's t)."
    )
}

pub(super) fn floor(rel: f64) -> String {
    // A relative error of 100 % or more provides no information about lengths.
    if rel >= 1.0 {
        return "Lengths on the floor are undetermined.".into();
    }
    format!("Lengths on the floor are accurate to \u{b1} {:.1} %.", 100.0 * rel)
}

fn degrees_of_freedom(dof: i64) -> String {
    counted(usize::try_from(dof).unwrap_or_default(), "degree of freedom", "degrees of freedom")
}

pub(super) fn joint_misfit(chi2: f64, dof: i64) -> String {
    format!(
        "Control points, links and marks contradict each other or the lines (chi-square {chi2:.0}, {}).",
        degrees_of_freedom(dof)
    )
}

pub(super) fn curved(px: f64, px_without_lens: f64) -> String {
    format!(
        "The straight edges deviate from straight lines by {px:.2} px RMS \
         ({px_without_lens:.2} px without a distortion model)."
    )
}

pub(super) fn corners(px: f64, is_round: bool) -> String {
    /// Uncertainty above which the distortion counts as undetermined, in pixels: the width of a large image.
    const MAX_CORNER_SIGMA_PX: f64 = 4000.0;
    let place = if is_round { "at the rim" } else { "in the corners" };
    if px < MAX_CORNER_SIGMA_PX {
        format!("The distortion {place} of the image is uncertain by \u{b1} {px:.0} px.")
    } else {
        format!("The straight edges do not determine the distortion {place} of the image.")
    }
}

pub(super) const fn estimator(by: Estimator) -> &'static str {
    match by {
        Estimator::MaximumLikelihood => "The fit does not use",
        Estimator::Paper => "The paper's method does not use",
    }
}

/// Returns the JSON field in a camera's entry that sets this parameter.
pub(super) const fn field(parameter: Parameter) -> &'static str {
    match parameter {
        Parameter::Focal => "lens.focal_px",
        Parameter::Pitch => "lens.pitch_deg",
        Parameter::Roll => "lens.roll_deg",
        Parameter::Height => "height_m",
    }
}

pub(super) const fn efov(is_whole: bool) -> &'static str {
    if is_whole {
        "The whole field of view (EFOV) is above the horizon or beyond the view of the lens."
    } else {
        "Part of the field of view (EFOV) was cut off: it is above the horizon, more than 50 camera heights away, or beyond the view of the lens."
    }
}

pub(super) fn evidence(shared: SharedEvidence, count: usize) -> String {
    match shared {
        SharedEvidence::Links => counted(count, "link is", "links are"),
        SharedEvidence::Marks => {
            counted(count, "mark annotated in images is", "marks annotated in images are")
        }
        SharedEvidence::Distances => counted(count, "distance is", "distances are"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counted_uses_the_plural_for_zero_and_two() {
        let words = [0, 1, 2].map(|count| counted(count, "lens", "lenses"));
        assert_eq!(words, ["0 lenses", "1 lens", "2 lenses"]);
    }
}
