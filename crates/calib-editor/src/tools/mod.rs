//! What the pointer does on a canvas. A tool is a small state machine; this list is the registry.

mod segment;
mod polyline;
mod place;
mod mark;
mod select;
mod link;
mod control;
mod measure;

use std::sync::Arc;

use calib_core::{FloorPoint, Kind, Pixel, PlanScale};

use calib_image::Edge;
use calib_site::Site;
use image::RgbImage;

use crate::keys::{Key, Modifiers};
use crate::session::Session;

pub use place::{PlanHandle, is_inside, plan_handles};

/// A canvas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pane {
    /// The image of a camera; its points are raw pixels.
    Image(usize),
    /// The floor, on its plan if there is one; its points are metres.
    Plan,
}

/// What the pointer just did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Moved with no button down.
    Hover,
    /// The button went down.
    Press,
    /// Moved with the button down.
    Drag,
    /// The button came up.
    Release,
}

/// The pointer on a canvas.
#[derive(Clone, Debug)]
pub struct Pointer {
    /// Which canvas.
    pub pane: Pane,
    /// Where on it, in its own units.
    pub at: [f64; 2],
    /// What it did.
    pub phase: Phase,
    /// The keys held with it.
    pub modifiers: Modifiers,
    /// The hit radius, in the canvas's own units.
    pub radius: f64,
    /// A point of the screen, in the canvas's own units: no finer is a click.
    pub grain: f64,
    /// Whether it has moved since the button went down.
    pub moved: bool,
    /// Whether this is the second of two quick clicks.
    pub double: bool,
    /// The edge of the image under the pointer, offered to be taken.
    pub offer: Option<Edge>,
    /// The picture of the canvas, to pull lines onto its edges.
    pub still: Option<Arc<RgbImage>>,
}

/// What is clicked worse than this is said, in pixels.
const COARSE: f64 = 1.5;

/// That something is not clicked well, and what helps.
fn coarse(name: &str, sigma: f64) -> String {
    format!("{name} is clicked to \u{b1} {sigma:.1} px at this zoom; zoom in and drag it to place it finer.")
}

/// Standard deviation of what is drawn on a camera, in pixels: given, or as its solution has it.
pub(crate) fn drawn_sigma(session: &Session, camera: usize) -> f64 {
    let given = session.site.cameras.get(camera).and_then(|entry| entry.sigma_px);
    let found = || session.solved.solution(camera)?.sigma_px;
    given.or_else(found).unwrap_or(1.0)
}

impl Pointer {
    /// Standard deviation of the pixel of a click on a camera, where that is more than its drawings have: seen
    /// small, a thing is clicked no better than to a point of the screen.
    pub(crate) fn sigma_px(&self, session: &Session, camera: usize) -> Option<f64> {
        let hundredths = (100.0 * self.grain).round() / 100.0;
        (hundredths > drawn_sigma(session, camera)).then_some(hundredths)
    }

    /// As a pixel of an image, with the camera it belongs to.
    #[must_use]
    pub fn pixel(&self) -> Option<(usize, Pixel)> {
        match self.pane {
            Pane::Image(camera) => Some((camera, self.at.into())),
            Pane::Plan => None,
        }
    }

    /// As a point of the floor: through the camera of an image.
    #[must_use]
    pub fn floor(&self, session: &Session, height: f64) -> Option<FloorPoint> {
        match self.pane {
            Pane::Image(camera) => session.solved.pose(camera)?.pixel_to_floor(self.at.into(), height),
            Pane::Plan => Some(self.at.into()),
        }
    }
}

/// Something the pointer can do on canvases.
pub trait Tool: std::fmt::Debug {
    /// Takes what the pointer did.
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer);

    /// Enter: ends what needs an end.
    fn accept(&mut self, _session: &mut Session) {}

    /// Backspace: takes the last point of a gesture back. Whether there was one.
    fn step_back(&mut self, _session: &mut Session) -> bool {
        false
    }

    /// Drops the gesture that is under way; the session puts the site back.
    fn cancel(&mut self);

    /// The link that is to be shown in a further view.
    fn begun(&self, _session: &Session) -> Option<usize> {
        None
    }

    /// Whether no gesture is under way.
    fn is_idle(&self) -> bool;

    /// Whether it has made the one thing that it makes, so that the hand is free.
    fn is_over(&self) -> bool {
        false
    }

    /// What the next click or release does.
    fn hint(&self, session: &Session) -> String;

    /// The point that is held, for the loupe.
    fn held(&self) -> Option<(Pane, [f64; 2])> {
        None
    }

    /// Lines to be shown while the gesture is under way, in the pane's own units.
    fn rubber(&self, _pane: Pane) -> Vec<Vec<[f64; 2]>> {
        Vec::new()
    }
}

/// The picture of a tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "it is the picture of the tool of its name")]
pub enum Icon {
    Select,
    Vertical,
    Parallel,
    Perpendicular,
    Equal,
    Known,
    Straight,
    Upright,
    Field,
    Control,
    Link,
    Mark,
    Measure,
    Region,
}

/// A row of the list of tools.
#[derive(Clone, Copy, Debug)]
pub struct ToolRow {
    /// Its name on screen.
    pub title: &'static str,
    /// The key that takes it.
    pub key: Key,
    /// Its picture.
    pub icon: Icon,
    /// The kind of annotation that it draws.
    pub kind: Option<Kind>,
    /// Makes one.
    pub make: fn() -> Box<dyn Tool>,
}

impl ToolRow {
    /// Whether it does something on the plan; where it does not, the handles there are moved.
    #[must_use]
    pub fn acts_on_plan(&self) -> bool {
        matches!(self.icon, Icon::Select | Icon::Control | Icon::Mark | Icon::Measure | Icon::Region)
    }
}

/// Every tool, in the order of the tool strip.
pub const TOOLS: &[ToolRow] = &[
    ToolRow {
        title: "Select",
        key: Key::Q,
        icon: Icon::Select,
        kind: None,
        make: || Box::new(select::Select::default()),
    },
    line(Kind::Vertical, Key::V, Icon::Vertical, || Box::new(segment::Segment::new(Kind::Vertical))),
    line(Kind::Parallel, Key::P, Icon::Parallel, || Box::new(segment::Segment::new(Kind::Parallel))),
    line(Kind::Perpendicular, Key::R, Icon::Perpendicular, || {
        Box::new(segment::Segment::new(Kind::Perpendicular))
    }),
    line(Kind::EqualLength, Key::E, Icon::Equal, || Box::new(segment::Segment::new(Kind::EqualLength))),
    line(Kind::KnownLength, Key::L, Icon::Known, || Box::new(segment::Segment::new(Kind::KnownLength))),
    line(Kind::Straight, Key::S, Icon::Straight, || Box::new(polyline::Polyline::straight())),
    line(Kind::Upright, Key::U, Icon::Upright, || Box::new(segment::Segment::new(Kind::Upright))),
    ToolRow {
        title: "Field of view",
        key: Key::F,
        icon: Icon::Field,
        kind: None,
        make: || Box::new(polyline::Polyline::field()),
    },
    ToolRow {
        title: "Control point",
        key: Key::C,
        icon: Icon::Control,
        kind: None,
        make: || Box::new(control::Control::default()),
    },
    ToolRow {
        title: "Link",
        key: Key::K,
        icon: Icon::Link,
        kind: None,
        make: || Box::new(link::Linking::default()),
    },
    ToolRow {
        title: "Mark",
        key: Key::M,
        icon: Icon::Mark,
        kind: None,
        make: || Box::new(mark::Marking::default()),
    },
    ToolRow {
        title: "Measure plan",
        key: Key::A,
        icon: Icon::Measure,
        kind: None,
        make: || Box::new(measure::Measure::default()),
    },
    ToolRow {
        title: "Region of a plane",
        key: Key::O,
        icon: Icon::Region,
        kind: None,
        make: || Box::new(measure::Region::default()),
    },
];

const fn line(kind: Kind, key: Key, icon: Icon, make: fn() -> Box<dyn Tool>) -> ToolRow {
    ToolRow { title: calib_core::single::KINDS[kind as usize].title, key, icon, kind: Some(kind), make }
}

/// The index of the tool of this title.
pub(crate) fn tool_called(title: &str) -> usize {
    TOOLS.iter().position(|tool| tool.title == title).unwrap_or(0)
}

/// How the plan lies, or a plan of a centimetre a pixel where there is none.
#[must_use]
pub fn plan_scale(site: &Site) -> PlanScale {
    let bare = PlanScale { metres_per_px: 0.01, origin: calib_core::PlanPixel::new(0.0, 0.0), x_axis: 0.0 };
    site.plan.as_ref().map_or(bare, calib_site::Plan::scale)
}
