//! Tour for newcomers: its steps, the current step, and the check that a step is done.

use calib_core::{Camera, Kind, Pixel};

use calib_editor::{Command, Session, StatusLevel, TOOLS, agreements, camera_status};
use calib_site::{Mark, Stage};

use crate::state::Mode;

/// Progress of the tour.
#[derive(Clone, Debug, Default)]
pub struct Tour {
    pub(crate) step: Option<usize>,
    /// True pose and lens of the camera that the newcomer calibrates, from the demonstration.
    truth: Option<Camera>,
    /// Marks at the start of the tour.
    marks: Vec<Mark>,
    /// Number of links at the start of the tour.
    links: usize,
}

/// Step of the tour.
#[derive(Clone, Copy, Debug)]
pub struct TourStep {
    /// Short task of the step.
    pub title: &'static str,
    /// Instruction for the task.
    pub text: &'static str,
    /// Buttons of the step: label and effect.
    pub buttons: &'static [(&'static str, TourButton)],
}

/// Effect of a button of a step.
#[derive(Clone, Copy, Debug)]
pub enum TourButton {
    /// Selects the tool with this title.
    Tool(&'static str),
    /// Runs this command.
    Command(Command),
}

impl TourButton {
    /// Returns the command that the button runs.
    #[must_use]
    pub fn command(self) -> Command {
        match self {
            Self::Tool(title) => {
                Command::Tool(TOOLS.iter().position(|tool| tool.title == title).unwrap_or_default())
            }
            Self::Command(command) => command,
        }
    }
}

/// Steps of the tour in their order.
pub const STEPS: [TourStep; 9] = [
    TourStep {
        title: "Draw two vertical lines",
        text: "Drag along two vertical edges that are far apart, such as the edges of columns or the fridge. \
               You can also click an edge that lights up under the pointer.",
        buttons: &[("Vertical tool (V)", TourButton::Tool("Vertical"))],
    },
    TourStep {
        title: "Draw two pairs of floor lines",
        text: "Drag along two parallel joints between the tiles. Press New direction, then drag along \
               two joints that cross them.",
        buttons: &[
            ("Parallel tool (P)", TourButton::Tool("Parallel")),
            ("New direction (W)", TourButton::Command(Command::NewGroup)),
        ],
    },
    TourStep {
        title: "Draw the field of view",
        text: "Click the corners of the floor area, then click the first corner again to close the outline. \
               The grid should look square on the floor.",
        buttons: &[("Field of view tool (F)", TourButton::Tool("Field of view"))],
    },
    TourStep {
        title: "Enter a known length",
        text: "Drag along a joint from corner to corner over several tiles, for example five. Type the length in \
               the Lines panel: one tile is 0.6 m. The length determines the scale of the camera.",
        buttons: &[("Known length tool (L)", TourButton::Tool("Known length"))],
    },
    TourStep {
        title: "Place the camera on the plan",
        text: "Drag the white dot to the camera's position. Rotate with the ring until the image matches the plan. The \
               square changes the scale.",
        buttons: &[("Plan (2)", TourButton::Command(Command::ViewPlan))],
    },
    TourStep {
        title: "Link a point that two views show",
        text: "Click a distinct point in the first view, such as the corner of a tile. Then click the same point in \
               another view, on the yellow line.",
        buttons: &[
            ("All cameras (3)", TourButton::Command(Command::ViewAll)),
            ("Link tool (K)", TourButton::Tool("Link")),
        ],
    },
    TourStep {
        title: "Refine all cameras",
        text: "The program solves all cameras together, from their lines and links. Afterwards, no camera should be \
               red, and all cameras should agree on positions on the floor.",
        buttons: &[("Refine all (F9)", TourButton::Command(Command::Refine))],
    },
    TourStep {
        title: "Check the result in every view",
        text: "Drag a mark, such as a box or a post, in one view. It should be in the same place in all views.",
        buttons: &[
            ("All cameras (3)", TourButton::Command(Command::ViewAll)),
            ("Select tool (Q)", TourButton::Tool("Select")),
        ],
    },
    TourStep {
        title: "Export the cameras",
        text: "Choose a format. The window shows the files and what the format loses. You can close it without \
               saving.",
        buttons: &[("Export for other programs\u{2026}", TourButton::Command(Command::Export))],
    },
];

impl Tour {
    /// Creates a tour at its first step; `truth` is the true pose of the first camera.
    #[must_use]
    pub const fn begun(truth: Option<Camera>, marks: Vec<Mark>, links: usize) -> Self {
        Self { step: Some(0), truth, marks, links }
    }

    /// Returns the current step; `None` without a tour and after the last step.
    #[must_use]
    pub fn step(&self) -> Option<&'static TourStep> {
        STEPS.get(self.step?)
    }

    /// Returns the missing part of the current step as a sentence; `None` once the step is done. `has_exported` is
    /// whether the export sheet shows files.
    #[must_use]
    pub(crate) fn open(&self, session: &Session, mode: Mode, has_exported: bool) -> Option<String> {
        match self.step? {
            0 => self.missing_verticals(session),
            1 => self.floor_lines(session),
            2 => field(session),
            3 => self.scaled(session),
            4 => self.placed(session),
            5 => self.linked(session),
            6 => refined(session),
            7 => contradiction(session).or_else(|| self.checked(session, mode)),
            _ => (!has_exported).then(|| "Press Export for other programs.".into()),
        }
    }

    fn missing_verticals(&self, session: &Session) -> Option<String> {
        let lines = drawn(session, Kind::Vertical);
        let leaning = lines.iter().filter(|line| self.is_leaning(line)).count();
        match (lines.len() - leaning, leaning) {
            (2.., 0) => None,
            (_, 0) => Some(format!("{} of 2 lines drawn.", lines.len())),
            _ => Some(
                "One of the lines is not vertical. Undo it (Ctrl+Z), and draw along a vertical edge.".into(),
            ),
        }
    }

    /// Whether a line is not vertical in space, according to the true camera of the demonstration.
    fn is_leaning(&self, line: &[Pixel]) -> bool {
        /// Largest angle in the image between a line and the true vertical, in radians.
        const MAX_LEAN_RAD: f64 = 0.07;
        let (Some(truth), [a, .., b]) = (self.truth, line) else { return false };
        calib_editor::suggest::lean(&truth, &[*a, *b]).is_none_or(|lean| lean > MAX_LEAN_RAD)
    }

    fn floor_lines(&self, session: &Session) -> Option<String> {
        let entry = session.entry()?;
        let groups = entry.annotations.iter().filter(|drawn| drawn.kind == Kind::Parallel);
        let pairs = groups.filter(|drawn| drawn.polylines().count() >= 2).count();
        if pairs < 2 {
            return Some(match drawn(session, Kind::Parallel).len() {
                0 | 1 => "Draw two parallel lines first.".into(),
                _ => "Now the other direction: press New direction, then draw two lines.".to_owned(),
            });
        }
        if camera_status(session, session.camera).level == StatusLevel::Contradictory {
            return Some("One of the lines is wrong. Undo it (Ctrl+Z), and draw it again.".into());
        }
        let is_near = self.truth.zip(session.pose()).is_none_or(|(truth, pose)| {
            (pose.focal / truth.focal).ln().abs() < 0.15 && (pose.pitch - truth.pitch).abs() < 0.05
        });
        (!is_near).then(|| {
            "The lines are too short or too close together. Draw longer lines that are far apart.".into()
        })
    }

    fn scaled(&self, session: &Session) -> Option<String> {
        let entry = session.entry()?;
        let known = entry.annotations.iter().rfind(|drawn| drawn.kind == Kind::KnownLength);
        let Some(known) = known else { return Some("No line of known length yet.".into()) };
        let Some(length) = known.length_m.filter(|_| !known.off) else {
            return Some("Type the length of the line in the Lines panel.".into());
        };
        let line = known.polylines().next().unwrap_or_default();
        let on_floor = |pixel: &Pixel| self.truth?.pixel_to_floor(*pixel, 0.0);
        let real =
            line.first().and_then(on_floor).zip(line.last().and_then(on_floor)).map(|(a, b)| a.distance(b));
        let is_right = real.is_none_or(|real| (length / real).ln().abs() < MAX_LENGTH_ERROR);
        (!is_right)
            .then(|| "The length does not fit the line. Count the tiles again: one tile is 0.6 m.".into())
    }

    fn linked(&self, session: &Session) -> Option<String> {
        let first = session.site.cameras.first()?;
        let new = session.site.links.iter().skip(self.links);
        let views = new.filter(|link| link.seen.iter().any(|seen| seen.camera == first.id));
        match views.map(|link| link.seen.len()).max() {
            Some(2..) => None,
            Some(_) => Some("Now click the same point in another view.".into()),
            None => Some(format!("No new link in {} yet.", first.id)),
        }
    }

    fn placed(&self, session: &Session) -> Option<String> {
        let solution = session.solution()?;
        if solution.stage < Stage::Placed {
            return Some("Not placed yet: drag the white dot.".into());
        }
        let (truth, pose) = self.truth.zip(session.pose())?;
        let off = pose.position.on_floor().distance(truth.position.on_floor());
        let turned = (pose.yaw - truth.yaw).sin().atan2((pose.yaw - truth.yaw).cos()).to_degrees();
        let scaled = pose.position.z / truth.position.z;
        if off > 1.5 {
            let off = session.site.units.length(off, 1);
            return Some(format!("{off} from the true position: drag the white dot."));
        }
        if turned.abs() > 8.0 {
            let side = if turned > 0.0 { "right" } else { "left" };
            return Some(format!("Rotate the image {:.0}\u{b0} to the {side} with the ring.", turned.abs()));
        }
        let by = if scaled > 1.0 { "smaller" } else { "larger" };
        ((scaled - 1.0).abs() > 0.15).then(|| format!("Make the image {by} with the square."))
    }

    fn checked(&self, session: &Session, mode: Mode) -> Option<String> {
        match (mode, session.site.marks == self.marks) {
            (Mode::All, false) => None,
            (Mode::All, true) => Some("Drag one of the marks.".into()),
            _ => Some("Press All cameras.".into()),
        }
    }
}

/// Largest accepted relative error of the length that the newcomer enters.
const MAX_LENGTH_ERROR: f64 = 0.05;

/// Largest RMS distance between the positions of a link according to two cameras, in metres.
const MAX_GAP_M: f64 = 0.3;

/// Returns the reason why the refinement is missing or wrong.
fn refined(session: &Session) -> Option<String> {
    let is_refined = session.solved.solution(0).is_some_and(|solution| solution.stage == Stage::Refined);
    if !is_refined || session.solved.is_joint_out_of_date() {
        return Some("Press Refine all.".into());
    }
    contradiction(session)
}

/// Returns a sentence about a camera that contradicts its annotations or the other cameras.
fn contradiction(session: &Session) -> Option<String> {
    for (index, camera) in session.site.cameras.iter().enumerate() {
        if camera_status(session, index).level == StatusLevel::Contradictory {
            return Some(format!(
                "{} is red. Undo the wrong line or link (Ctrl+Z), then draw it again.",
                camera.id
            ));
        }
        let apart = agreements(session, index, &[]).into_iter().filter_map(|found| {
            let apart = found.distance?.metres;
            (apart > MAX_GAP_M).then_some((found.other, apart))
        });
        if let Some((other, apart)) = apart.max_by(|a, b| a.1.total_cmp(&b.1)) {
            let other = &session.site.cameras.get(other)?.id;
            let apart = session.site.units.short_length(apart);
            let is_current = !session.solved.is_joint_out_of_date();
            let advice = if is_current && session.solved.joint_report().is_some() {
                "Check the links between them: undo the wrong one, then link the point again."
            } else {
                "Press Refine all."
            };
            return Some(format!("{} and {other} disagree by {apart}. {advice}", camera.id));
        }
    }
    None
}

/// Returns the annotated lines of a kind on the current image, in pixels.
fn drawn(session: &Session, kind: Kind) -> Vec<Vec<Pixel>> {
    let of_kind = session.entry().into_iter().flat_map(|entry| &entry.annotations).filter(|a| a.kind == kind);
    of_kind.flat_map(|annotation| annotation.polylines().collect::<Vec<_>>()).collect()
}

fn field(session: &Session) -> Option<String> {
    let Some(corners) = session.entry().and_then(|entry| entry.efov_px.as_ref()) else {
        return Some("No corners yet.".into());
    };
    let pose = session.pose()?;
    let is_sky = corners.iter().any(|&corner| pose.pixel_to_floor(corner, 0.0).is_none());
    is_sky.then(|| {
        "A corner is above the horizon. Undo it (Ctrl+Z), then click only points on the floor.".into()
    })
}
