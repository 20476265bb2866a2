//! The step of the tour that a newcomer has come to, and what is true of the camera that is theirs to do.

use calib_core::{Camera, Kind, Pixel};

use calib_editor::{Command, Session, Standing, TOOLS, verdict};
use calib_site::{Mark, Stage};

use crate::state::Mode;

/// How far a newcomer has come.
#[derive(Clone, Debug, Default)]
pub struct Tour {
    pub(crate) step: Option<usize>,
    /// The camera that is theirs, as it truly is.
    truth: Option<Camera>,
    /// The marks as they were when the tour began.
    marks: Vec<Mark>,
}

/// One step of the tour.
#[derive(Clone, Copy, Debug)]
pub struct TourStep {
    /// What is to be done.
    pub title: &'static str,
    /// How.
    pub text: &'static str,
    /// Buttons: what they say, and what they do.
    pub buttons: &'static [(&'static str, TourButton)],
}

/// What a button of a step does.
#[derive(Clone, Copy, Debug)]
pub enum TourButton {
    /// Takes the tool of this title.
    Tool(&'static str),
    /// Gives a command.
    Command(Command),
}

impl TourButton {
    /// The command that it gives.
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

/// The steps, in their order.
pub const STEPS: [TourStep; 5] = [
    TourStep {
        title: "Draw two plumb lines",
        text: "Drag along two edges that stand upright, far from each other: of the columns, of the fridge. An edge that lights up under the pointer is taken whole by a click.",
        buttons: &[("Vertical tool (V)", TourButton::Tool("Vertical"))],
    },
    TourStep {
        title: "Draw two pairs of floor lines",
        text: "Drag along two joints of the tiles that run the same way. Press New direction, then draw two joints that cross them.",
        buttons: &[
            ("Parallel tool (P)", TourButton::Tool("Parallel")),
            ("New direction (W)", TourButton::Command(Command::NewGroup)),
        ],
    },
    TourStep {
        title: "Draw the field of view",
        text: "Click the corners of the floor that matters, and the first one again to close. The squares of the grid should look square on the floor; they lie on the tiles once the camera is placed.",
        buttons: &[("Field of view tool (F)", TourButton::Tool("Field of view"))],
    },
    TourStep {
        title: "Place the camera on the plan",
        text: "Drag the white dot to where the camera hangs; the ring turns it, the square scales it, until its image lies on the plan.",
        buttons: &[("Plan (2)", TourButton::Command(Command::ViewPlan))],
    },
    TourStep {
        title: "Check it in every view",
        text: "Drag a mark, a box or a post, in one view: it should stand on the same spot in all of them.",
        buttons: &[
            ("All cameras (3)", TourButton::Command(Command::ViewAll)),
            ("Select tool (Q)", TourButton::Tool("Select")),
        ],
    },
];

impl Tour {
    /// Begins at the first step, with the first camera as it truly is.
    #[must_use]
    pub const fn begun(truth: Option<Camera>, marks: Vec<Mark>) -> Self {
        Self { step: Some(0), truth, marks }
    }

    /// The step one is at; `None` after the last.
    #[must_use]
    pub fn step(&self) -> Option<&'static TourStep> {
        STEPS.get(self.step?)
    }

    /// What is not right yet, in words; `None` once the step is done.
    #[must_use]
    pub(crate) fn open(&self, session: &Session, mode: Mode) -> Option<String> {
        match self.step? {
            0 => self.plumb(session),
            1 => self.floor_lines(session),
            2 => field(session),
            3 => self.placed(session),
            _ => self.checked(session, mode),
        }
    }

    fn plumb(&self, session: &Session) -> Option<String> {
        let lines = drawn(session, Kind::Vertical);
        let leaning = lines.iter().filter(|line| self.leans(line)).count();
        match (lines.len() - leaning, leaning) {
            (2.., 0) => None,
            (_, 0) => Some(format!("{} of 2 drawn", lines.len())),
            _ => Some(
                "One of them does not stand upright: undo it (Ctrl+Z), and draw along a plumb edge.".into(),
            ),
        }
    }

    /// Whether a drawn line is not plumb to the camera as it truly is.
    fn leans(&self, line: &[Pixel]) -> bool {
        const MOST: f64 = 0.07;
        let (Some(truth), [a, .., b]) = (self.truth, line) else { return false };
        calib_editor::suggest::lean(&truth, &[*a, *b]).is_none_or(|lean| lean > MOST)
    }

    fn floor_lines(&self, session: &Session) -> Option<String> {
        let entry = session.entry()?;
        let groups = entry.annotations.iter().filter(|drawn| drawn.kind == Kind::Parallel);
        let pairs = groups.filter(|drawn| drawn.polylines().count() >= 2).count();
        if pairs < 2 {
            return Some(match drawn(session, Kind::Parallel).len() {
                0 | 1 => "Two lines of one direction first.".into(),
                _ => "Now the other direction: press New direction, then draw two lines.".to_owned(),
            });
        }
        let told = verdict(session, session.camera);
        if told.standing == Standing::Wrong {
            return Some(format!("{}: undo (Ctrl+Z) the line that is off.", told.text));
        }
        let is_near = self.truth.zip(session.pose()).is_none_or(|(truth, pose)| {
            (pose.focal / truth.focal).ln().abs() < 0.15 && (pose.pitch - truth.pitch).abs() < 0.05
        });
        (!is_near).then(|| "The lines are short or near each other: draw longer ones, far apart.".into())
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
            return Some(format!("{} to go: drag the white dot.", session.units.length(off, 1)));
        }
        if turned.abs() > 8.0 {
            let side = if turned > 0.0 { "right" } else { "left" };
            return Some(format!("Turn it to the {side} by the ring, {:.0}\u{b0}.", turned.abs()));
        }
        let by = if scaled > 1.0 { "smaller" } else { "larger" };
        ((scaled - 1.0).abs() > 0.15).then(|| format!("Make it {by} by the square."))
    }

    fn checked(&self, session: &Session, mode: Mode) -> Option<String> {
        match (mode, session.site.marks == self.marks) {
            (Mode::All, false) => None,
            (Mode::All, true) => Some("Drag one of the marks.".into()),
            _ => Some("Press All cameras.".into()),
        }
    }
}

/// The lines of a kind on the image in hand.
fn drawn(session: &Session, kind: Kind) -> Vec<Vec<Pixel>> {
    let of_kind = session.entry().into_iter().flat_map(|entry| &entry.annotations).filter(|a| a.kind == kind);
    of_kind.flat_map(|annotation| annotation.polylines().collect::<Vec<_>>()).collect()
}

fn field(session: &Session) -> Option<String> {
    let Some(corners) = session.entry().and_then(|entry| entry.efov_px.as_ref()) else {
        return Some("No corner yet.".into());
    };
    let pose = session.pose()?;
    let is_sky = corners.iter().any(|&corner| pose.pixel_to_floor(corner, 0.0).is_none());
    is_sky.then(|| "A corner lies above the floor: undo (Ctrl+Z), and keep to the floor.".into())
}
