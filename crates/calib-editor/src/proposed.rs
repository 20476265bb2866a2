//! What the still of a camera proposes to draw, beside what is drawn, until the operator takes it or does not.
//!
//! Nothing of it is in the site: a group is drawn once it is taken. Groups of floor lines are told apart by the name of
//! their direction, which becomes the id of the annotation: what is taken later of a direction joins what was taken
//! of it, and directions at right angles are tied once both are drawn.
//!
//! The camera as it would be with all that is proposed, and which group of it to ask about first.
//!
//! That is the group with which the solve predicts the least relative error of floor lengths: the covariance decides,
//! as it does for what is to be drawn next.

use calib_core::{Annotation, Camera, Kind, Lens, Orientation, Pixel};
use calib_image::{Group, Lies, Proposal, Reason, Verdict};
use calib_site::{DistortionEntry, LensEntry, Options, Site, SiteCamera, Solution};

use crate::period::Period;
use crate::{hit, suggest};

/// Lines of a kind that are proposed together.
#[derive(Clone, Debug, PartialEq)]
pub struct ProposedGroup {
    /// What they would be drawn as: verticals, parallels or straight edges.
    pub kind: Kind,
    /// The direction on the floor that they lead in, or would if they lay there.
    pub direction: String,
    /// As they would be drawn.
    pub lines: Vec<Vec<Pixel>>,
    /// That a line belongs, in the order of the lines.
    pub probabilities: Vec<f64>,
    /// Where a line lies, in the order of the lines.
    pub lies: Vec<Lies>,
}

impl ProposedGroup {
    /// That all of it belongs: the mean over its lines.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probabilities.iter().sum::<f64>() / self.probabilities.len().max(1) as f64
    }

    /// Leaves a line out.
    pub(crate) fn leave_out(&mut self, line: usize) {
        if line < self.lines.len() {
            self.lines.remove(line);
            self.probabilities.remove(line);
            self.lies.remove(line);
        }
    }

    /// How many of its lines lie so.
    #[must_use]
    pub fn lying(&self, so: Lies) -> usize {
        self.lies.iter().filter(|&&lies| lies == so).count()
    }

    /// What it is called.
    #[must_use]
    pub fn title(&self) -> &str {
        match self.kind {
            Kind::Vertical => "verticals",
            Kind::Straight => "straight edges",
            _ => &self.direction,
        }
    }

    /// Verticals become floor lines of their direction, floor lines verticals; what tells the lens alone is neither.
    pub(crate) const fn flip(&mut self) {
        self.kind = match self.kind {
            Kind::Vertical => Kind::Parallel,
            Kind::Parallel => Kind::Vertical,
            other => other,
        };
    }

    /// Those of a group of edges that are not drawn on a camera yet.
    fn of(group: &Group, direction: String, entry: &SiteCamera) -> Self {
        let told = group.probabilities.iter().copied().zip(group.lies.iter().copied());
        Self::of_lines(group.annotation.kind, direction, group.annotation.polylines().zip(told), entry)
    }

    fn of_lines(
        kind: Kind,
        direction: String,
        lines: impl Iterator<Item = (Vec<Pixel>, (f64, Lies))>,
        entry: &SiteCamera,
    ) -> Self {
        let is_new = |(line, _): &(Vec<Pixel>, (f64, Lies))| {
            let ends = line.first().copied().zip(line.last().copied());
            ends.is_some_and(|(from, to)| !suggest::is_drawn(&[from, to], entry))
        };
        let (lines, told): (_, Vec<(f64, Lies)>) = lines.filter(is_new).unzip();
        let (probabilities, lies) = told.into_iter().unzip();
        Self { kind, direction, lines, probabilities, lies }
    }
}

/// What the operator decides on what the still of the camera in hand proposes; groups and lines by their index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OnProposed {
    /// Chooses a line with its group, or none.
    Pick(Option<(usize, usize)>),
    /// Draws all of it.
    AcceptAll,
    /// Of two cameras that explain the edges alike it is this one, or the other one.
    Decide {
        /// The other one.
        other: bool,
    },
    /// Draws a group.
    Accept(usize),
    /// Verticals become floor lines, floor lines verticals.
    Flip(usize),
    /// A group leads in the floor direction of this name.
    Turn(usize, String),
    /// A group is not to be drawn.
    Delete(usize),
    /// A line of a group is not to be drawn.
    LeaveOut(usize, usize),
    /// Nothing of it is to be drawn.
    Dismiss,
}

/// What the still of one camera proposes.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposed {
    /// The camera.
    pub of: Period,
    /// Whether to believe it.
    pub verdict: Verdict,
    /// Why it is not sure.
    pub reasons: Vec<Reason>,
    /// What is not decided yet.
    pub groups: Vec<ProposedGroup>,
    /// The camera that all edges make, where they make one.
    pub orientation: Option<Orientation>,
    /// Another camera that explains the edges nearly as well: with its own groups, to be taken in place of these.
    pub alternative: Option<Box<Hypothesis>>,
    /// Directions at right angles.
    ties: Vec<[String; 2]>,
    /// The distortion with which the lines were found.
    distortion: Option<DistortionEntry>,
}

/// A camera that would explain the edges of a still.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// Its roll, pitch and focal.
    pub orientation: Orientation,
    /// Its groups.
    groups: Vec<ProposedGroup>,
    /// Of its directions, those at right angles.
    ties: Vec<[String; 2]>,
}

impl Hypothesis {
    /// What it is to whoever looks at the image, of so many pixels across: how wide it looks, and where to.
    #[must_use]
    pub fn words(orientation: &Orientation, width: f64) -> String {
        let wide = 2.0 * (0.5 * width / orientation.focal).atan().to_degrees();
        let down = orientation.pitch.to_degrees();
        let way = if down < 0.0 { "up" } else { "down" };
        format!("{wide:.0}\u{b0} wide, {:.0}\u{b0} {way}", down.abs())
    }
}

impl Proposed {
    /// What a proposal adds to a camera: lines that are drawn already are left out.
    #[must_use]
    pub fn new(entry: &SiteCamera, proposal: &Proposal) -> Self {
        let straight = proposal.straight.iter().map(|line| (line.clone(), (1.0, Lies::Open)));
        let straight = ProposedGroup::of_lines(Kind::Straight, String::new(), straight, entry);
        let drawable = |groups: &[Group]| {
            let (mut groups, ties) = named(entry, groups);
            groups.insert(0, straight.clone());
            groups.retain(|group| !group.lines.is_empty());
            (groups, ties)
        };
        let (groups, ties) = drawable(&proposal.groups);
        let alternative = proposal.alternative.as_ref().map(|other| {
            let (groups, ties) = drawable(&other.groups);
            Box::new(Hypothesis { orientation: other.orientation, groups, ties })
        });
        Self {
            of: Period::of(entry),
            verdict: proposal.verdict,
            reasons: proposal.reasons.clone(),
            groups,
            orientation: proposal.solution.as_ref().and_then(orientation),
            alternative,
            ties,
            distortion: proposal.camera.as_ref().and_then(|camera| camera.lens.clone()?.distortion),
        }
    }

    /// Another camera explains the edges as well, and the operator sees which it is: this one, or the `other` one. What
    /// spoke against it besides still does.
    pub(crate) fn decide(&mut self, other: bool) {
        let Some(rival) = self.alternative.take() else { return };
        if other {
            let Hypothesis { orientation, groups, ties } = *rival;
            (self.orientation, self.groups, self.ties) = (Some(orientation), groups, ties);
        }
        self.reasons.retain(|reason| !matches!(reason, Reason::TwoHypotheses { .. }));
        if self.reasons.is_empty() {
            self.verdict = Verdict::Check;
        }
    }

    /// How many lines are not decided yet.
    #[must_use]
    pub fn count(&self) -> usize {
        self.groups.iter().map(|group| group.lines.len()).sum()
    }

    /// The group and line that lie under a pixel as the lens bends them.
    #[must_use]
    pub fn under(&self, lens: &Lens, at: Pixel, radius: f64) -> Option<(usize, usize)> {
        let lines = self.groups.iter().enumerate().flat_map(|(group, of)| {
            of.lines.iter().enumerate().filter_map(move |(line, points)| {
                Some(((group, line), hit::nearest_drawn(lens, points, at)?.1))
            })
        });
        let near = lines.filter(|(_, distance)| *distance <= radius);
        near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(which, _)| which)
    }

    /// The floor directions that a group may lead in: those there are, and one more.
    #[must_use]
    pub fn directions(&self) -> Vec<String> {
        let mut own: Vec<String> = Vec::new();
        for group in self.groups.iter().filter(|group| group.kind != Kind::Straight) {
            if !own.contains(&group.direction) {
                own.push(group.direction.clone());
            }
        }
        own.sort();
        own.extend(names().find(|name| !own.contains(name)));
        own
    }

    /// The camera with some groups drawn.
    #[must_use]
    pub(crate) fn drawn(&self, entry: &SiteCamera, which: impl Fn(usize) -> bool) -> SiteCamera {
        let mut drawn = entry.clone();
        let chosen = self.groups.iter().enumerate().filter(|(index, _)| which(*index));
        let groups: Vec<&ProposedGroup> = chosen.map(|(_, group)| group).collect();
        for group in &groups {
            self.draw(&mut drawn, group);
        }
        if !groups.is_empty() {
            self.give_lens(&mut drawn);
        }
        drawn
    }

    fn draw(&self, entry: &mut SiteCamera, group: &ProposedGroup) {
        match group.kind {
            Kind::Straight => {
                entry.annotations.extend(group.lines.iter().cloned().map(Annotation::of_points));
            }
            Kind::Parallel => self.draw_level(entry, group),
            kind => entry.annotations.push(Annotation::of_segments(kind, group.lines.clone())),
        }
    }

    /// Floor lines join those of their direction, and are tied to what is at right angles to them.
    fn draw_level(&self, entry: &mut SiteCamera, group: &ProposedGroup) {
        let of = |id: &String| entry.annotations.iter().position(|drawn| drawn.id.as_ref() == Some(id));
        if let Some(known) = of(&group.direction) {
            entry.annotations[known].segments.get_or_insert_default().extend(group.lines.clone());
            return;
        }
        let own = self.ties.iter().filter(|tie| tie.contains(&group.direction));
        let tied = own.flatten().find(|id| **id != group.direction && of(id).is_some()).cloned();
        entry.annotations.push(Annotation {
            id: Some(group.direction.clone()),
            at_right_angles_to: tied,
            ..Annotation::of_segments(Kind::Parallel, group.lines.clone())
        });
    }

    /// The distortion that the lines were found with, where nothing is known of it and no edges are to tell it.
    fn give_lens(&self, entry: &mut SiteCamera) {
        let has_edges = entry.annotations.iter().any(Annotation::is_straight_edge);
        let waits = self.groups.iter().any(|group| group.kind == Kind::Straight);
        let known = entry.lens.as_ref().is_some_and(|lens| lens.like.is_some() || lens.distortion.is_some());
        if let Some(distortion) = self.distortion.as_ref().filter(|_| !(has_edges || waits || known)) {
            entry.lens.get_or_insert_default().distortion = Some(distortion.clone());
        }
    }
}

/// Groups of edges under names of directions that no annotation of the camera has, and which of these are at right
/// angles.
fn named(entry: &SiteCamera, groups: &[Group]) -> (Vec<ProposedGroup>, Vec<[String; 2]>) {
    let is_taken = |name: &String| entry.annotations.iter().any(|drawn| drawn.id.as_ref() == Some(name));
    let mut free = names().filter(|name| !is_taken(name));
    let mut name = |group: &Group| (group.annotation.id.clone(), free.next().unwrap_or_default());
    let (plumb, level): (Vec<&Group>, Vec<&Group>) =
        groups.iter().partition(|group| group.annotation.kind == Kind::Vertical);
    let names: Vec<(Option<String>, String)> = level.iter().chain(&plumb).map(|group| name(group)).collect();
    let tie = |(group, (_, own)): (&&Group, &(Option<String>, String))| {
        let other = group.annotation.at_right_angles_to.as_ref()?;
        let (_, other) = names.iter().find(|(id, _)| id.as_ref() == Some(other))?;
        Some([own.clone(), other.clone()])
    };
    let ties = level.iter().zip(&names).filter_map(tie).collect();
    let named = plumb.iter().zip(names.iter().skip(level.len())).chain(level.iter().zip(&names));
    let groups = named.map(|(group, (_, direction))| ProposedGroup::of(group, direction.clone(), entry));
    (groups.collect(), ties)
}

/// Of a camera that was solved.
fn orientation(solution: &Solution) -> Option<Orientation> {
    let [roll, pitch] = [solution.roll_deg?, solution.pitch_deg?].map(f64::to_radians);
    Some(Orientation { roll, pitch, focal: solution.focal_px })
}

/// Names of floor directions.
fn names() -> impl Iterator<Item = String> {
    (1..).map(|number| format!("floor {number}"))
}

/// The camera as it would be with all that is proposed.
#[derive(Clone, Debug)]
pub struct Preview {
    /// From what it follows.
    from: (SiteCamera, Proposed),
    /// What the solve makes of it, where it does.
    pub solution: Option<Solution>,
    /// Its pose.
    pub pose: Option<Camera>,
    /// The group that would tell most.
    pub next: Option<usize>,
}

impl Preview {
    /// Of a camera, with its pose as far as it is known.
    #[must_use]
    pub fn new(entry: &SiteCamera, pose: Option<&Camera>, proposed: &Proposed) -> Self {
        let bare = alone(entry, pose);
        let with = |which: &dyn Fn(usize) -> bool| solved(proposed.drawn(&bare, which));
        let solution = with(&|_| true);
        let off = |group: usize| {
            let sigma = with(&|other| other == group)?.sigma?;
            sigma.floor_length_rel.filter(|rel| rel.is_finite())
        };
        // Without floor there is nothing to compare; the lens comes before all else.
        let first = || (!proposed.groups.is_empty()).then_some(0);
        let best = (0..proposed.groups.len()).filter_map(|group| Some((group, off(group)?)));
        let next = best.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(group, _)| group).or_else(first);
        let pose = solution.as_ref().and_then(Solution::camera);
        Self { from: (entry.clone(), proposed.clone()), solution, pose, next }
    }

    /// Whether it is still of this camera and this proposal.
    #[must_use]
    pub fn is_of(&self, entry: &SiteCamera, proposed: &Proposed) -> bool {
        self.from.0 == *entry && self.from.1 == *proposed
    }
}

/// What is drawn on a camera and known of its lens, and nothing that ties it to others.
fn alone(entry: &SiteCamera, pose: Option<&Camera>) -> SiteCamera {
    let like = entry.lens.as_ref().is_some_and(|lens| lens.like.is_some());
    SiteCamera {
        lens: if like { given(entry, pose) } else { entry.lens.clone() },
        annotations: entry.annotations.clone(),
        efov_px: entry.efov_px.clone(),
        sigma_px: entry.sigma_px,
        height_m: entry.height_m,
        ..SiteCamera::new(entry.id.clone(), entry.size_px)
    }
}

/// The lens of a pose, as if it had been entered.
fn given(entry: &SiteCamera, pose: Option<&Camera>) -> Option<LensEntry> {
    let own = entry.lens.clone().unwrap_or_default();
    let distortion = pose.and_then(|pose| {
        let entry = DistortionEntry::of(&pose.lens, pose.lens.focal)?;
        Some(DistortionEntry { focal_px: Some(pose.lens.focal), fit: None, ..entry })
    });
    let distortion = distortion.or(own.distortion.clone().filter(|entry| entry.distortion().is_some()));
    // That of a fisheye came from its edges.
    let centre = pose.filter(|pose| pose.lens.distortion.is_wide()).map(|pose| pose.lens.principal_point);
    let principal_point_px = centre.or(own.principal_point_px);
    Some(LensEntry { like: None, distortion, principal_point_px, ..own })
        .filter(|lens| *lens != LensEntry::default())
}

/// The camera with nothing drawn, its lens given where it is known by now: what a proposal starts from.
#[must_use]
pub(crate) fn undrawn(entry: &SiteCamera, pose: Option<&Camera>) -> SiteCamera {
    SiteCamera { lens: given(entry, pose), ..SiteCamera::new(entry.id.clone(), entry.size_px) }
}

fn solved(entry: SiteCamera) -> Option<Solution> {
    let site = Site { cameras: vec![entry], ..Site::new() };
    let mut report = site.calibrate(&Options::default());
    report.cameras.pop()?.1.ok()
}
