//! Undecided automatic calibration of an image. It is shown in addition to the annotations until the operator
//! accepts or dismisses it.
//!
//! The site does not contain an undecided calibration: a group of lines is added to the site when it is
//! accepted. Groups of floor lines are distinguished by the name of their direction, which becomes the id of
//! the annotation. A group that is accepted later joins the annotation of its direction. If two directions
//! are at right angles, the annotation that is accepted later refers to the earlier one.
//!
//! The file also computes the preview of the camera with all groups accepted, and the group to decide first.
//! This group, accepted alone, minimises the predicted relative error of floor lengths. The prediction uses
//! the covariance, as for suggestions.

use std::borrow::Cow;

use calib_core::{Annotation, Camera, Kind, Lens, Orientation, Pixel};
use calib_image::{AutomaticCalibration, Confidence, EdgeClass, Group, Reason, SitePlacement};
use calib_site::{DistortionEntry, LensEntry, Options, PrincipalPointEntry, Site, SiteCamera, Solution};

use crate::period::Period;
use crate::{hit, suggest};

/// Group of detected lines of one kind, to be accepted together.
#[derive(Clone, Debug, PartialEq)]
pub struct PendingGroup {
    /// Kind of the annotation: verticals, parallels or straight edges.
    pub kind: Kind,
    /// Name of the direction of the lines on the floor; used only for floor lines.
    pub direction: String,
    /// Lines as they would be annotated, in raw pixels.
    pub lines: Vec<Vec<Pixel>>,
    /// Probability that a line belongs to the group, for each line in order.
    pub probabilities: Vec<f64>,
    /// Location of the edge (on the floor, above it, or undetermined), for each line in order.
    pub classes: Vec<EdgeClass>,
    /// Standard deviation of the lines, in pixels; `None` for the value of the camera.
    sigma_px: Option<f64>,
}

impl PendingGroup {
    /// Returns the mean probability that a line belongs to the group.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probabilities.iter().sum::<f64>() / self.probabilities.len().max(1) as f64
    }

    /// Removes the line with this index from the group.
    pub(crate) fn reject_line(&mut self, line: usize) {
        if line < self.lines.len() {
            self.lines.remove(line);
            self.probabilities.remove(line);
            self.classes.remove(line);
        }
    }

    /// Returns the number of lines whose edge has this class.
    #[must_use]
    pub fn count_of_class(&self, class: EdgeClass) -> usize {
        self.classes.iter().filter(|&&own| own == class).count()
    }

    /// Returns the name of the group for the operator.
    #[must_use]
    pub fn title(&self) -> &str {
        match self.kind {
            Kind::Vertical => "verticals",
            Kind::Straight => "straight edges",
            _ => &self.direction,
        }
    }

    /// Changes a group of verticals to floor lines, or a group of floor lines to verticals. Straight edges
    /// stay unchanged.
    pub(crate) const fn flip(&mut self) {
        self.kind = match self.kind {
            Kind::Vertical => Kind::Parallel,
            Kind::Parallel => Kind::Vertical,
            other => other,
        };
    }

    /// Creates an undecided group from a detected group; edges that are annotated already are omitted.
    fn from_group(group: &Group, direction: String, entry: &SiteCamera) -> Self {
        let scores = group.probabilities.iter().copied().zip(group.classes.iter().copied());
        let lines = group.annotation.polylines().zip(scores);
        let sigma_px = group.annotation.sigma_px;
        Self { sigma_px, ..Self::from_lines(group.annotation.kind, direction, lines, entry) }
    }

    /// Creates an undecided group from lines with their probabilities and classes; lines that are annotated
    /// already are omitted.
    fn from_lines(
        kind: Kind,
        direction: String,
        lines: impl Iterator<Item = (Vec<Pixel>, (f64, EdgeClass))>,
        entry: &SiteCamera,
    ) -> Self {
        let is_new = |(line, _): &(Vec<Pixel>, (f64, EdgeClass))| {
            let ends = line.first().copied().zip(line.last().copied());
            ends.is_some_and(|(from, to)| !suggest::is_annotated(&[from, to], entry))
        };
        let (lines, scores): (_, Vec<(f64, EdgeClass)>) = lines.filter(is_new).unzip();
        let (probabilities, classes) = scores.into_iter().unzip();
        Self { kind, direction, lines, probabilities, classes, sigma_px: None }
    }
}

/// Decision of the operator about the automatic calibration of the selected camera. Groups and lines are
/// given by index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CalibrationDecision {
    /// Selects a line by the indices of group and line, or no line.
    SelectLine(Option<(usize, usize)>),
    /// Accepts all groups.
    AcceptAll,
    /// Chooses one of two solutions that explain the edges equally well.
    Decide {
        /// Whether the alternative solution is chosen.
        other: bool,
    },
    /// Accepts the group with this index.
    Accept(usize),
    /// Changes the group with this index from verticals to floor lines, or from floor lines to verticals.
    Flip(usize),
    /// Assigns the group with this index to the floor direction with this name.
    SetDirection(usize, String),
    /// Rejects the group with this index.
    Delete(usize),
    /// Rejects a line, by the indices of group and line.
    RejectLine(usize, usize),
    /// Dismisses the whole automatic calibration.
    Dismiss,
}

/// Undecided automatic calibration of one camera.
#[derive(Clone, Debug, PartialEq)]
pub struct PendingCalibration {
    /// Camera that was calibrated, and its calibration period.
    pub of: Period,
    /// Confidence of the automatic calibration.
    pub confidence: Confidence,
    /// Reasons why the confidence is not `sure`.
    pub reasons: Vec<Reason>,
    /// Groups of lines that the operator has not decided about.
    pub groups: Vec<PendingGroup>,
    /// Roll, pitch and focal length that were estimated from all edges, if any.
    pub orientation: Option<Orientation>,
    /// Alternative solution that explains the edges almost as well, with its own groups.
    pub alternative: Option<Box<Hypothesis>>,
    /// Pairs of names of floor directions that are at right angles.
    perpendicular_pairs: Vec<[String; 2]>,
    /// Distortion that was assumed when the lines were detected.
    distortion: Option<DistortionEntry>,
    /// Principal point that was assumed when the lines were detected; `None` if only the image
    /// centre is known.
    principal_point: Option<PrincipalPointEntry>,
}

/// Result of an automatic calibration or placement.
#[derive(Clone, Debug)]
pub enum AutomaticResult {
    /// Calibration of the image of a calibration period, to be stored as undecided.
    Calibration(Period, Box<AutomaticCalibration>),
    /// Calibrations of several images. They are accepted, except those with the confidence `none`, which stay
    /// undecided.
    Calibrations(Vec<(Period, AutomaticCalibration)>),
    /// Placements that were estimated from the colours of the images of the site.
    Placement(Box<SitePlacement>),
}

/// Camera that would explain the edges of an image, as an alternative to the best one.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// Roll, pitch and focal length of this camera.
    pub orientation: Orientation,
    /// Undecided groups of lines that apply if this camera is chosen.
    groups: Vec<PendingGroup>,
    /// Pairs of names of floor directions that are at right angles.
    perpendicular_pairs: Vec<[String; 2]>,
}

impl Hypothesis {
    /// Returns a short description of a camera: horizontal field of view and pitch. `width` is the image
    /// width in pixels.
    #[must_use]
    pub fn description(orientation: &Orientation, width: f64) -> String {
        let wide = 2.0 * (0.5 * width / orientation.focal).atan().to_degrees();
        let down = orientation.pitch.to_degrees();
        let way = if down < 0.0 { "up" } else { "down" };
        format!("{wide:.0}\u{b0} wide, tilted {:.0}\u{b0} {way}", down.abs())
    }
}

impl PendingCalibration {
    /// Creates the undecided calibration from an automatic calibration. Lines that are annotated already are
    /// omitted.
    #[must_use]
    pub fn new(entry: &SiteCamera, proposal: &AutomaticCalibration) -> Self {
        let straight =
            proposal.curved_edges.iter().map(|line| (line.clone(), (1.0, EdgeClass::Undetermined)));
        let straight = PendingGroup::from_lines(Kind::Straight, String::new(), straight, entry);
        let drawable = |groups: &[Group]| {
            let (mut groups, perpendicular_pairs) = name_directions(entry, groups);
            groups.insert(0, straight.clone());
            groups.retain(|group| !group.lines.is_empty());
            (groups, perpendicular_pairs)
        };
        let (groups, perpendicular_pairs) = drawable(&proposal.groups);
        let alternative = proposal.alternative.as_ref().map(|other| {
            let (groups, perpendicular_pairs) = drawable(&other.groups);
            Box::new(Hypothesis { orientation: other.orientation, groups, perpendicular_pairs })
        });
        let lens = proposal.camera.as_ref().and_then(|camera| camera.lens.as_ref());
        Self {
            of: Period::from_camera(entry),
            confidence: proposal.confidence,
            reasons: proposal.reasons.clone(),
            groups,
            orientation: proposal.solution.as_ref().and_then(orientation),
            alternative,
            perpendicular_pairs,
            distortion: lens.and_then(|lens| lens.distortion.clone()),
            principal_point: lens.and_then(|lens| lens.principal_point_px),
        }
    }

    /// Chooses between two solutions that explain the edges equally well. If `other` is set, the alternative is
    /// chosen. Other reasons for a reduced confidence remain.
    pub(crate) fn decide(&mut self, other: bool) {
        let Some(rival) = self.alternative.take() else { return };
        if other {
            let Hypothesis { orientation, groups, perpendicular_pairs } = *rival;
            (self.orientation, self.groups, self.perpendicular_pairs) =
                (Some(orientation), groups, perpendicular_pairs);
        }
        self.reasons.retain(|reason| !matches!(reason, Reason::TwoHypotheses { .. }));
        if self.reasons.is_empty() {
            self.confidence = Confidence::Check;
        }
    }

    /// Returns the number of undecided lines.
    #[must_use]
    pub fn count(&self) -> usize {
        self.groups.iter().map(|group| group.lines.len()).sum()
    }

    /// Returns the indices of the group and of the line nearest to a raw pixel. `None` if no line is within
    /// `radius` pixels. With a fisheye lens, lines are curved by its distortion.
    #[must_use]
    pub fn line_at(&self, lens: &Lens, at: Pixel, radius: f64) -> Option<(usize, usize)> {
        let lines = self.groups.iter().enumerate().flat_map(|(group, of)| {
            of.lines.iter().enumerate().filter_map(move |(line, points)| {
                Some(((group, line), hit::nearest_drawn(lens, points, at)?.1))
            })
        });
        let near = lines.filter(|(_, distance)| *distance <= radius);
        near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(which, _)| which)
    }

    /// Returns the names of the floor directions to which a group can be assigned: the existing directions
    /// and a new one.
    #[must_use]
    pub fn directions(&self) -> Vec<String> {
        let mut own: Vec<String> = Vec::new();
        for group in self.groups.iter().filter(|group| group.kind != Kind::Straight) {
            if !own.contains(&group.direction) {
                own.push(group.direction.clone());
            }
        }
        own.sort();
        own.extend(direction_names().find(|name| !own.contains(name)));
        own
    }

    /// Returns the camera with the accepted groups, which `which` selects by index. The assumed distortion and
    /// principal point are set if they are unknown.
    #[must_use]
    pub(crate) fn with_groups(&self, entry: &SiteCamera, which: impl Fn(usize) -> bool) -> SiteCamera {
        let mut drawn = entry.clone();
        let chosen = self.groups.iter().enumerate().filter(|(index, _)| which(*index));
        let groups: Vec<&PendingGroup> = chosen.map(|(_, group)| group).collect();
        for group in &groups {
            self.add_group(&mut drawn, group);
        }
        if !groups.is_empty() {
            self.set_distortion(&mut drawn);
            self.set_principal_point(&mut drawn);
        }
        drawn
    }

    /// Adds the annotations of a group to a camera.
    fn add_group(&self, entry: &mut SiteCamera, group: &PendingGroup) {
        match group.kind {
            Kind::Straight => {
                entry.annotations.extend(group.lines.iter().cloned().map(Annotation::from_points));
            }
            Kind::Parallel => self.add_floor_lines(entry, group),
            kind => entry.annotations.push(Annotation {
                sigma_px: group.sigma_px,
                ..Annotation::from_segments(kind, group.lines.clone())
            }),
        }
    }

    /// Adds floor lines to the annotation of their direction. A new annotation refers to an annotation whose
    /// direction is at right angles, if any.
    fn add_floor_lines(&self, entry: &mut SiteCamera, group: &PendingGroup) {
        let of = |id: &String| entry.annotations.iter().position(|drawn| drawn.id.as_ref() == Some(id));
        if let Some(known) = of(&group.direction) {
            let usual = entry.sigma_px.unwrap_or(1.0);
            let known = &mut entry.annotations[known];
            known.segments.get_or_insert_default().extend(group.lines.clone());
            // An annotation has one standard deviation for all its lines, so the larger one is used.
            let own = known.sigma_px.unwrap_or(usual);
            known.sigma_px = group.sigma_px.filter(|sigma| *sigma > own).or(known.sigma_px);
            return;
        }
        let own = self.perpendicular_pairs.iter().filter(|tie| tie.contains(&group.direction));
        let tied = own.flatten().find(|id| **id != group.direction && of(id).is_some()).cloned();
        entry.annotations.push(Annotation {
            id: Some(group.direction.clone()),
            at_right_angles_to: tied,
            sigma_px: group.sigma_px,
            ..Annotation::from_segments(Kind::Parallel, group.lines.clone())
        });
    }

    /// Sets the distortion that was assumed when the lines were detected. It is set only if the distortion is
    /// unknown and no straight edges can determine it.
    fn set_distortion(&self, entry: &mut SiteCamera) {
        let has_edges = entry.annotations.iter().any(Annotation::is_straight_edge);
        let waits = self.groups.iter().any(|group| group.kind == Kind::Straight);
        let known = entry.lens.as_ref().is_some_and(|lens| lens.like.is_some() || lens.distortion.is_some());
        if let Some(distortion) = self.distortion.as_ref().filter(|_| !(has_edges || waits || known)) {
            entry.lens.get_or_insert_default().distortion = Some(distortion.clone());
        }
    }

    /// Sets the principal point that was assumed when the lines were detected, for example in the middle between black
    /// bars. It is not set if the lens entry has a principal point, an image circle, a window or a shared lens.
    fn set_principal_point(&self, entry: &mut SiteCamera) {
        let lens = entry.lens.as_ref();
        let is_known = lens.is_some_and(|lens| {
            lens.like.is_some()
                || lens.window_px.is_some()
                || lens.principal_point_px.is_some()
                || lens.image_circle_px.is_some()
        });
        if let Some(assumed) = self.principal_point.filter(|_| !is_known) {
            entry.lens.get_or_insert_default().principal_point_px = Some(assumed);
        }
    }
}

/// Converts detected groups to undecided groups, each with a new direction name. No annotation of the camera
/// has this name as its id. Also returns the pairs of direction names that are at right angles.
fn name_directions(entry: &SiteCamera, groups: &[Group]) -> (Vec<PendingGroup>, Vec<[String; 2]>) {
    let is_taken = |name: &String| entry.annotations.iter().any(|drawn| drawn.id.as_ref() == Some(name));
    let mut free = direction_names().filter(|name| !is_taken(name));
    let mut name = |group: &Group| (group.annotation.id.clone(), free.next().unwrap_or_default());
    let (plumb, level): (Vec<&Group>, Vec<&Group>) =
        groups.iter().partition(|group| group.annotation.kind == Kind::Vertical);
    let names: Vec<(Option<String>, String)> = level.iter().chain(&plumb).map(|group| name(group)).collect();
    let tie = |(group, (_, own)): (&&Group, &(Option<String>, String))| {
        let other = group.annotation.at_right_angles_to.as_ref()?;
        let (_, other) = names.iter().find(|(id, _)| id.as_ref() == Some(other))?;
        Some([own.clone(), other.clone()])
    };
    let perpendicular_pairs = level.iter().zip(&names).filter_map(tie).collect();
    let named = plumb.iter().zip(names.iter().skip(level.len())).chain(level.iter().zip(&names));
    let groups =
        named.map(|(group, (_, direction))| PendingGroup::from_group(group, direction.clone(), entry));
    (groups.collect(), perpendicular_pairs)
}

/// Returns the roll, pitch and focal length of a solution; `None` if the solution has no roll or pitch.
fn orientation(solution: &Solution) -> Option<Orientation> {
    let [roll, pitch] = [solution.roll_deg?, solution.pitch_deg?].map(f64::to_radians);
    Some(Orientation { roll, pitch, focal: solution.focal_px })
}

/// Returns the names of floor directions in order: "floor 1", "floor 2", …
fn direction_names() -> impl Iterator<Item = String> {
    (1..).map(|number| format!("floor {number}"))
}

/// Preview of a camera with its whole automatic calibration accepted.
#[derive(Clone, Debug)]
pub struct Preview {
    /// Camera and automatic calibration from which the preview was computed.
    from: (SiteCamera, PendingCalibration),
    /// Solution of the camera; `None` if it cannot be solved.
    pub solution: Option<Solution>,
    /// Pose and lens of the solution, if it has a pose.
    pub pose: Option<Camera>,
    /// Index of the group to decide first: accepted alone, it gives the smallest predicted error of floor lengths.
    /// It is 0 if no error can be predicted, and `None` without groups.
    pub next: Option<usize>,
}

impl Preview {
    /// Computes the preview of a camera, given its current pose if known.
    #[must_use]
    pub fn new(entry: &SiteCamera, pose: Option<&Camera>, proposed: &PendingCalibration) -> Self {
        let bare = without_links(entry, pose);
        let with = |which: &dyn Fn(usize) -> bool| solve_alone(proposed.with_groups(&bare, which));
        let solution = with(&|_| true);
        let off = |group: usize| {
            let sigma = with(&|other| other == group)?.sigma?;
            sigma.floor_length_rel.filter(|rel| rel.is_finite())
        };
        // Errors can only be compared with a solved floor. Otherwise the first group, which contains any
        // straight edges, is decided first.
        let first = || (!proposed.groups.is_empty()).then_some(0);
        let best = (0..proposed.groups.len()).filter_map(|group| Some((group, off(group)?)));
        let next = best.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(group, _)| group).or_else(first);
        let pose = solution.as_ref().and_then(Solution::camera);
        Self { from: (entry.clone(), proposed.clone()), solution, pose, next }
    }

    /// Whether the preview was computed from this camera and this automatic calibration.
    #[must_use]
    pub fn is_current(&self, entry: &SiteCamera, proposed: &PendingCalibration) -> bool {
        self.from.0 == *entry && self.from.1 == *proposed
    }
}

/// Returns the camera without its placement and its control points, and with a copy of a shared lens. It can then be
/// solved without other cameras.
fn without_links(entry: &SiteCamera, pose: Option<&Camera>) -> SiteCamera {
    let like = entry.lens.as_ref().is_some_and(|lens| lens.like.is_some());
    SiteCamera {
        lens: if like { fixed_lens(entry, pose) } else { entry.lens.clone() },
        annotations: entry.annotations.clone(),
        efov_px: entry.efov_px.clone(),
        sigma_px: entry.sigma_px,
        height_m: entry.height_m,
        ..SiteCamera::new(entry.id.clone(), entry.size_px)
    }
}

/// Returns the lens entry of a camera, with the distortion of `pose` entered as known and without a reference to
/// another camera's lens. `None` if the entry has no values.
fn fixed_lens(entry: &SiteCamera, pose: Option<&Camera>) -> Option<LensEntry> {
    let own = entry.lens_of_image().map(Cow::into_owned).unwrap_or_default();
    let distortion = pose.and_then(|pose| {
        let entry = DistortionEntry::from_lens(&pose.lens, pose.lens.focal)?;
        Some(DistortionEntry { focal_px: Some(pose.lens.focal), fit: None, ..entry })
    });
    let distortion = distortion.or(own.distortion.clone().filter(|entry| entry.distortion().is_some()));
    // The principal point is copied for a fisheye lens only, where it was estimated from the straight edges.
    let centre = pose
        .filter(|pose| pose.lens.distortion.is_wide())
        .map(|pose| PrincipalPointEntry::known(pose.lens.principal_point));
    let principal_point_px = centre.or(own.principal_point_px);
    Some(LensEntry { like: None, distortion, principal_point_px, ..own })
        .filter(|lens| *lens != LensEntry::default())
}

/// Returns the camera without annotations and with its lens fixed if it is known. It is the input of an
/// automatic calibration.
#[must_use]
pub(crate) fn without_annotations(entry: &SiteCamera, pose: Option<&Camera>) -> SiteCamera {
    SiteCamera { lens: fixed_lens(entry, pose), ..SiteCamera::new(entry.id.clone(), entry.size_px) }
}

/// Solves a camera without other cameras; `None` if it cannot be solved.
fn solve_alone(entry: SiteCamera) -> Option<Solution> {
    let site = Site { cameras: vec![entry], ..Site::new() };
    let mut report = site.calibrate(&Options::default());
    report.cameras.pop()?.1.ok()
}
