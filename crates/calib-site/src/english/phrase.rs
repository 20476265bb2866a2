//! What sentences are made of: names of what they speak about, and the longer phrases.
//!
//! How many there are, in words that agree with it.
//!
//! What to draw next.

use calib_core::outcome::{
    Drawing, Estimator, Finding, OtherMinimum, Parameter, SharedEvidence, Source, Subject, Suggestion,
    WhyNotConnected, WhyUnused,
};
use calib_core::single::{Annotation, line_name};

use crate::document::{Site, SiteCamera};

/// "1 line", "2 lines": one is never many.
#[must_use]
pub fn counted(count: usize, one: &str, many: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {many}") }
}

/// What to draw next, and what it is good for.
pub(crate) fn what_to_draw(suggestion: &Suggestion) -> String {
    let what = match suggestion.drawing {
        Drawing::VerticalOnTheLeft => "A vertical near the left edge of the image",
        Drawing::VerticalOnTheRight => "A vertical near the right edge of the image",
        Drawing::ParallelsAway => "Two parallel floor lines that run away from the camera, left and right",
        Drawing::ParallelsAcross => "Two parallel floor lines across the view, near and far",
        Drawing::RightAngle => "A right angle near the middle of the floor, at about 45 degrees to the view,",
        Drawing::EqualLengths => "Three floor segments of equal length, near, far and across,",
        Drawing::SharedPoints => "Links of four floor points to another camera that sees them as well",
        Drawing::KnownSize => "One thing on the floor whose length you know (a tile, a lane, a parking bay)",
    };
    let gain = match suggestion.ratio {
        r if r < 0.28 => "cut the uncertainty of the floor to a fraction".into(),
        r if r < 0.4 => "cut the uncertainty of the floor to a third".into(),
        r if r < 0.6 => "halve the uncertainty of the floor".into(),
        r => format!("lower the uncertainty of the floor by {:.0} %", 100.0 * (1.0 - r)),
    };
    // A floor without a scale has a smaller number, which is of its shape alone.
    let scale = if suggestion.drawing == Drawing::KnownSize { ", its scale included" } else { "" };
    format!("{what} would {gain} (then floor \u{b1} {:.1} %{scale}).", 100.0 * suggestion.floor_length_rel)
}

/// How annotations are named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Names {
    /// By where they stand in the file: `Vertical (annotation 0)`.
    InFile,
    /// By their lines, as drawings show them: `V1 to V3`.
    OnScreen,
}

/// What sentences name things by.
pub(super) struct English<'a> {
    pub(super) site: &'a Site,
    /// The camera in question.
    pub(super) entry: Option<&'a SiteCamera>,
    pub(super) names: Names,
}

impl English<'_> {
    fn annotations(&self) -> &[Annotation] {
        self.entry.map_or(&[], |entry| &entry.annotations)
    }

    /// An annotation by where it stands in the file, or by its lines.
    pub(super) fn label(&self, index: usize) -> String {
        let Some(annotation) = self.annotations().get(index) else { return String::new() };
        // One without lines has no name on the screen.
        if self.names == Names::InFile || annotation.polylines().count() == 0 {
            return annotation.label(index);
        }
        let name = |segment| line_name(self.annotations(), index, segment);
        match annotation.segments.as_ref().map_or(0, |segments| segments.len().saturating_sub(1)) {
            0 => name(0),
            last => format!("{} to {}", name(0), name(last)),
        }
    }

    fn line(&self, line: Source) -> String {
        line_name(self.annotations(), line.annotation, line.segment)
    }

    /// A line, and in files its annotation.
    pub(super) fn line_of(&self, line: Source) -> String {
        match self.names {
            Names::InFile => format!("{} of {}", self.line(line), self.label(line.annotation)),
            Names::OnScreen => self.line(line),
        }
    }

    /// The id of a camera.
    pub(super) fn id(&self, camera: usize) -> &str {
        self.site.cameras.get(camera).map_or("", |entry| &entry.id)
    }

    fn ids(&self, cameras: &[usize]) -> String {
        let ids: Vec<String> = cameras.iter().map(|&camera| self.id(camera).to_owned()).collect();
        enumerated(&ids)
    }

    /// A control point as residuals call it.
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

    /// Something that cameras share, in the midst of a sentence.
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

    pub(super) fn line_outlier(&self, line: Source, px: Option<f64>) -> String {
        let line = self.line_of(line);
        match px {
            Some(px) => format!("{line} contradicts the others by {px:.1} px and was set aside."),
            None => format!("{line} lies above the horizon that the others give, and was set aside."),
        }
    }

    pub(super) fn heights_apart(&self, lowest: (Source, f64), highest: (Source, f64)) -> String {
        let [(low, lowest), (high, highest)] =
            [lowest, highest].map(|(line, height)| (self.line_of(line), height));
        format!(
            "Uprights contradict each other: the camera is {lowest:.2} m high by {low}, and {highest:.2} m by {high}."
        )
    }

    pub(super) fn too_few(&self, annotation: usize, by: Estimator, [drawn, least]: [usize; 2]) -> String {
        let (who, label) = (estimator(by), self.label(annotation));
        format!("{who} {label}: it has {drawn} segment(s) and needs {least}.")
    }

    /// Points of the drawing that the image has not.
    pub(super) fn points_outside(&self, finding: &Finding) -> String {
        let Finding::PointsOutside { outside, drawn, size: [width, height], fits_exchanged, first, .. } =
            finding
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
        let exchanged = if *fits_exchanged { " With u and v exchanged all would lie inside." } else { "" };
        format!(
            "{outside} of {drawn} points that are drawn lie outside the image of {width} x {height} pixels, first in {first}.{exchanged}"
        )
    }

    /// What is not as the solution has it.
    pub(super) fn out_of_date(&self, what: Subject, stored: Option<f64>, now: Option<f64>) -> String {
        let name = match what {
            Subject::Line(line) if self.annotations().get(line.annotation).is_some() => self.line_of(line),
            Subject::Line(line) => format!("Annotation {}", line.annotation),
            Subject::OwnControlPoint(point) => {
                format!("Control point {}", self.control_point(self.entry, point))
            }
            what => capitalised(&self.shared(what)),
        };
        match (stored, now) {
            (Some(stored), Some(now)) => format!(
                "The solution is out of date: {name} is {:.1} px from its prediction, and was {:.1} px when it was solved.",
                now.abs(),
                stored.abs()
            ),
            (None, Some(_)) => format!("The solution is out of date: it does not know {name}."),
            (_, None) => {
                format!("The solution is out of date: {name} is not where it was when it was solved.")
            }
        }
    }

    pub(super) fn misfit(&self, chi2: f64, dof: i64, worst: Option<(Source, f64)>) -> String {
        let worst = worst.map_or_else(String::new, |(line, px)| {
            format!(" The largest is {}: {px:.1} px.", self.line_of(line))
        });
        format!("Residuals are larger than drawing noise (chi-square {chi2:.0} on {dof}).{worst}")
    }

    pub(super) fn says_little(&self, edges: &[Source], drawn: usize, bend_px: f64) -> String {
        /// Edges that are named one by one; more are counted.
        const NAMED: usize = 4;
        let names: Vec<String> = edges.iter().map(|&edge| self.line(edge)).collect();
        let who = match names.len() {
            1 => format!("{} says", names[0]),
            2..=NAMED => format!("{} say", names.join(", ")),
            count => format!("{count} of {drawn} straight edges say"),
        };
        let by = if names.len() == 1 { "it by" } else { "none of them by more than" };
        format!(
            "{who} next to nothing about the lens: 10 px of distortion in the corner would bend {by} {bend_px:.1} px."
        )
    }

    pub(super) fn unused_edges(&self, first: usize, count: usize, is_undistorted: bool, px: f64) -> String {
        let which = if count == 1 { self.label(first) } else { format!("{count} straight edges") };
        let bent = if is_undistorted { "no distortion" } else { "the distortion that is given" };
        format!("The fit does not use {which}: {bent} is held. They are {px:.2} px off straight under it.")
    }

    pub(super) fn hidden(&self, points: &[usize]) -> String {
        let names: Vec<String> = points.iter().map(|&point| self.control_point(self.entry, point)).collect();
        format!("The camera does not show control points {} where it stands now.", names.join(", "))
    }

    pub(super) fn far(&self, rms_px: f64, worst: usize, worst_px: f64) -> String {
        let name = self.control_point(self.entry, worst);
        format!("The control points are {rms_px:.1} px rms off; the worst is {name}: {worst_px:.1} px.")
    }

    pub(super) fn control_point_outlier(&self, camera: usize, point: usize) -> String {
        let name = self.control_point(self.site.cameras.get(camera), point);
        format!("Control point {name} contradicts the others and was set aside.")
    }

    pub(super) fn element_outlier(&self, element: Subject, worst: Option<(usize, f64)>) -> String {
        let far =
            worst.map_or_else(String::new, |(camera, px)| format!(" ({px:.0} px in {})", self.id(camera)));
        let element = capitalised(&self.shared(element));
        format!("{element} contradicts the others and was set aside{far}.")
    }

    pub(super) fn distance_outlier(&self, distance: usize) -> String {
        format!("The {} contradicts the rest and was set aside.", self.distance(distance))
    }

    pub(super) fn not_connected(&self, cameras: &[usize], why: WhyNotConnected) -> String {
        let ids = self.ids(cameras);
        match why {
            WhyNotConnected::TooLittle => {
                format!("What {ids} shares with other cameras is too little to place it.")
            }
            WhyNotConnected::Placed => {
                format!("Nothing ties {ids} to the rest of the site: it stands where it was placed.")
            }
            WhyNotConnected::Alone => format!("Nothing ties {ids} to the rest of the site."),
        }
    }

    pub(super) fn scale_unknown(&self, cameras: &[usize], root: usize) -> String {
        let (ids, root) = (self.ids(cameras), self.id(root));
        format!("Nothing gives the scale of {ids}: camera {root} stands at the height it was placed with.")
    }

    pub(super) fn too_many(&self, count: usize, first: usize) -> String {
        let first = self.id(first);
        format!(
            "{count} cameras, {first} among them, share more than can be fitted together: each is solved by itself."
        )
    }

    pub(super) fn unused(&self, what: &[Subject], why: WhyUnused) -> String {
        let names: Vec<String> = what.iter().map(|&subject| self.shared(subject)).collect();
        let why = match why {
            WhyUnused::OutOfSight => "a camera that shows it cannot see anything where the others put it",
            WhyUnused::SeenOnce => "one camera alone shows it",
            WhyUnused::Unmeasured => "an end of it has no place, or its length no \"sigma\" and no \"fixed\"",
            WhyUnused::Unfitted => "no place was found from which all that is shared can be seen",
        };
        format!("Not used: {}; {why}.", enumerated(&names))
    }
}

/// "a, b, c and 7 more".
fn enumerated(names: &[String]) -> String {
    const MOST: usize = 6;
    match names.len() {
        0..=MOST => names.join(", "),
        count => format!("{} and {} more", names[..MOST - 1].join(", "), count - MOST + 1),
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

pub(super) fn open_focal(sigma: f64, floor_seen_from_above: Option<f64>) -> String {
    let known =
        if sigma > 1.0 { "at all".into() } else { format!("better than \u{b1} {:.0} %", 100.0 * sigma) };
    match floor_seen_from_above {
        Some(rel) => format!(
            "Looking down, the lines do not tell the focal {known}; the floor is good to {:.1} %, heights above it are not.",
            100.0 * rel
        ),
        None => {
            format!("Focal length and pitch cannot be told apart: the lines do not tell the focal {known}.")
        }
    }
}

pub(super) fn from_prior(focal: f64, sigma: f64) -> String {
    format!(
        "The focal of {focal:.0} px \u{b1} {:.0} % comes from what cameras usually have, not from the lines.",
        100.0 * sigma
    )
}

pub(super) fn other_minima(others: &[OtherMinimum]) -> String {
    let list: Vec<String> = others
        .iter()
        .map(|other| format!("focal {:.0} px with pitch {:.1}\u{b0}", other.focal, other.pitch.to_degrees()))
        .collect();
    format!("The lines fit another camera as well: {}.", list.join("; "))
}

pub(super) fn unchecked(dof: i64, rejected: usize) -> String {
    let aside = match rejected {
        0 => "",
        1 => " after a line was set aside",
        _ => " after lines were set aside",
    };
    match dof {
        ..=0 => format!("Nothing checks the drawing{aside}: another camera would fit other lines as well."),
        1 => format!(
            "One line more than needed is drawn{aside}: it agrees by chance too often to check the rest."
        ),
        _ => {
            format!("Only {dof} lines more than needed are drawn{aside}: choosing among them checks little.")
        }
    }
}

pub(super) fn few_residuals(dof: i64, factor: f64) -> String {
    let lines = counted(usize::try_from(dof).unwrap_or_default(), "line", "lines");
    format!(
        "The drawing noise is estimated from {lines} more than needed: every \u{b1} is {factor:.1} times wider for it (Student's t)."
    )
}

pub(super) fn floor(rel: f64) -> String {
    // A length that may be twice as long or nothing is not known.
    if rel >= 1.0 {
        return "Lengths on the floor are not known.".into();
    }
    format!("Lengths on the floor are known to \u{b1} {:.1} %.", 100.0 * rel)
}

pub(super) fn joint_misfit(chi2: f64, dof: i64) -> String {
    format!(
        "The cameras that are fitted together contradict each other: chi-square {chi2:.0} for {dof} degrees of freedom."
    )
}

pub(super) fn bent(px: f64, px_without_lens: f64) -> String {
    format!(
        "The edges drawn as straight are {px:.2} px rms off straight ({px_without_lens:.2} px without a lens)."
    )
}

pub(super) fn corners(px: f64, is_round: bool) -> String {
    // By more than an image is wide is altogether.
    let how = if px < 4000.0 { format!("by \u{b1} {px:.0} px") } else { "altogether".into() };
    let what = if is_round { "rim" } else { "corners" };
    format!("The straight edges leave the {what} of the image uncertain {how}.")
}

pub(super) const fn estimator(by: Estimator) -> &'static str {
    match by {
        Estimator::MaximumLikelihood => "The fit does not use",
        Estimator::Paper => "The paper's method does not use",
    }
}

/// The field of a camera's entry that tells a parameter.
pub(super) const fn field(parameter: Parameter) -> &'static str {
    match parameter {
        Parameter::Focal => "lens.focal_px",
        Parameter::Pitch => "lens.pitch_deg",
        Parameter::Roll => "lens.roll_deg",
        Parameter::Height => "height_m",
    }
}

pub(super) fn scale_assumed(height: f64) -> String {
    format!("Nothing gives the scale: the camera is taken to be {height:.2} m high.")
}

pub(super) fn scale_conflict(estimated: f64, placed: f64) -> String {
    format!(
        "The camera is {estimated:.2} m high by what was entered and drawn, and {placed:.2} m as it is placed."
    )
}

pub(super) const fn efov(is_whole: bool) -> &'static str {
    if is_whole {
        "The whole EFOV lies above the horizon or outside the lens."
    } else {
        "A part of the EFOV lies above the horizon, farther than 50 camera heights, or outside the lens; it was cut off."
    }
}

pub(super) const fn evidence(shared: SharedEvidence) -> &'static str {
    match shared {
        SharedEvidence::Links => "links",
        SharedEvidence::Marks => "marks tied to pixels",
        SharedEvidence::Distances => "distances",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_not_many_and_none_is() {
        let words = [0, 1, 2].map(|count| counted(count, "lens", "lenses"));
        assert_eq!(words, ["0 lenses", "1 lens", "2 lenses"]);
    }
}
