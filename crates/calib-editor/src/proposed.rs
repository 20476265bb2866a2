//! What the still of a camera proposes to draw, beside what is drawn, until the operator takes it or does not.
//!
//! Nothing of it is in the site: a group is drawn once it is taken. Groups of floor lines are told apart by the name of
//! their direction, which becomes the id of the annotation: what is taken later of a direction joins what was taken
//! of it, and directions at right angles are tied once both are drawn.

use calib_core::{Annotation, DistortionEntry, Kind, Lens, Orientation, Pixel, SiteCamera};
use calib_image::{Group, Proposal, Reason, Verdict};

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
}

impl ProposedGroup {
    /// That all of it belongs: the mean over its lines.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probabilities.iter().sum::<f64>() / self.probabilities.len().max(1) as f64
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
        let lines = group.annotation.polylines().zip(group.probabilities.iter().copied());
        Self::of_lines(group.annotation.kind, direction, lines, entry)
    }

    fn of_lines(
        kind: Kind,
        direction: String,
        lines: impl Iterator<Item = (Vec<Pixel>, f64)>,
        entry: &SiteCamera,
    ) -> Self {
        let is_new = |(line, _): &(Vec<Pixel>, f64)| {
            let ends = line.first().copied().zip(line.last().copied());
            ends.is_some_and(|(from, to)| !suggest::is_drawn(&[from, to], entry))
        };
        let (lines, probabilities) = lines.filter(is_new).unzip();
        Self { kind, direction, lines, probabilities }
    }
}

/// What the operator decides on what the still of the camera in hand proposes; groups and lines by their index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OnProposed {
    /// Chooses a line with its group, or none.
    Pick(Option<(usize, usize)>),
    /// Draws all of it.
    AcceptAll,
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
    /// Another camera that explains the edges nearly as well.
    pub alternative: Option<Orientation>,
    /// Directions at right angles.
    ties: Vec<[String; 2]>,
    /// The distortion with which the lines were found.
    distortion: Option<DistortionEntry>,
}

impl Proposed {
    /// What a proposal adds to a camera: lines that are drawn already are left out.
    #[must_use]
    pub fn new(entry: &SiteCamera, proposal: &Proposal) -> Self {
        let is_taken = |name: &String| entry.annotations.iter().any(|drawn| drawn.id.as_ref() == Some(name));
        let mut free = names().filter(|name| !is_taken(name));
        let mut name = |group: &Group| (group.annotation.id.clone(), free.next().unwrap_or_default());
        let (plumb, level): (Vec<&Group>, Vec<&Group>) =
            proposal.groups.iter().partition(|group| group.annotation.kind == Kind::Vertical);
        let names: Vec<(Option<String>, String)> =
            level.iter().chain(&plumb).map(|group| name(group)).collect();
        let tie = |(group, (_, own)): (&&Group, &(Option<String>, String))| {
            let other = group.annotation.at_right_angles_to.as_ref()?;
            let (_, other) = names.iter().find(|(id, _)| id.as_ref() == Some(other))?;
            Some([own.clone(), other.clone()])
        };
        let ties = level.iter().zip(&names).filter_map(tie).collect();
        let plumb_names = names.iter().skip(level.len());
        let straight = proposal.straight.iter().map(|line| (line.clone(), 1.0));
        let straight = ProposedGroup::of_lines(Kind::Straight, String::new(), straight, entry);
        let named = plumb.iter().zip(plumb_names).chain(level.iter().zip(&names));
        let groups = named.map(|(group, (_, direction))| ProposedGroup::of(group, direction.clone(), entry));
        let groups = std::iter::once(straight).chain(groups).filter(|group| !group.lines.is_empty());
        Self {
            of: Period::of(entry),
            verdict: proposal.verdict,
            reasons: proposal.reasons.clone(),
            groups: groups.collect(),
            alternative: proposal.alternative,
            ties,
            distortion: proposal.camera.as_ref().and_then(|camera| camera.lens.clone()?.distortion),
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

/// Names of floor directions.
fn names() -> impl Iterator<Item = String> {
    (1..).map(|number| format!("floor {number}"))
}
