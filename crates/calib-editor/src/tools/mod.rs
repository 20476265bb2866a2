//! Pointer tools of the canvases. Each tool is a small state machine, registered in [`TOOLS`].
//!
//! - `segment`, `polyline`: lines, straight edges and the field of view. `grab`: drags of their existing points.
//! - `place`, `mark`: drags of cameras and marks. `select`: selection and drags of parts.
//! - `link`, `control`: links between views, and control points.
//! - `corners`: corners of a shape on the plan, shared by the next two.
//! - `measure`: measurements, scale of the plan, and regions of planes. `survey`: walls and areas of interest.

mod grab;
mod segment;
mod polyline;
mod place;
mod mark;
mod select;
mod link;
mod control;
mod corners;
mod measure;
mod survey;

use std::sync::Arc;

use calib_core::{FloorPoint, Kind, Pixel, PlanScale};

use calib_image::Edge;
use calib_site::Site;
use image::RgbImage;

use crate::keys::{Key, Modifiers};
use crate::newer::NewerUnderPointer;
use crate::session::Session;

pub(crate) use mark::{is_on_pins, move_to_pins};
pub use place::{PlanHandle, is_inside, is_plan_empty_at, plan_handles};

/// Canvas on which the tools act.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pane {
    /// Image of the camera with this index; coordinates are raw pixels.
    Image(usize),
    /// Floor seen from above, on the plan if the site has one; coordinates are floor metres.
    Plan,
}

/// Kind of a pointer event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Movement without a pressed button.
    Hover,
    /// Press of the button.
    Press,
    /// Movement with the button down.
    Drag,
    /// Release of the button.
    Release,
}

/// Pointer event on a canvas.
#[derive(Clone, Debug)]
pub struct Pointer {
    /// Canvas of the event.
    pub pane: Pane,
    /// Position, in coordinates of the canvas (raw pixels or floor metres).
    pub at: [f64; 2],
    /// Kind of the event.
    pub phase: Phase,
    /// Modifier keys that are pressed.
    pub modifiers: Modifiers,
    /// Search radius around the pointer, in units of the canvas.
    pub radius: f64,
    /// Size of a screen point in units of the canvas, which is the accuracy of a click.
    pub point_size: f64,
    /// Whether the pointer has moved since the button was pressed.
    pub moved: bool,
    /// Whether the event belongs to the second click of a double click.
    pub double: bool,
    /// Detected image edge under the pointer, which a click accepts.
    pub edge: Option<Edge>,
    /// Capture time in the EXIF data of the image under the pointer (RFC 3339), if it is known.
    pub captured: Option<String>,
    /// Newer image of the camera, if the canvas shows it under the pointer.
    pub newer: Option<NewerUnderPointer>,
    /// Image of the canvas, used to move lines onto its edges.
    pub image: Option<Arc<RgbImage>>,
}

/// Standard deviation of a click above which the operator is warned, in pixels.
const MAX_CLICK_SIGMA_PX: f64 = 1.5;

/// Returns the note that a click is imprecise, with advice. `sigma` is its standard deviation in pixels.
fn imprecise_note(name: &str, sigma: f64) -> String {
    format!(
        "{name} is accurate to \u{b1} {sigma:.1} px at this zoom. Zoom in and drag it for better accuracy."
    )
}

/// Returns the standard deviation of annotated points of a camera, in pixels: the entered value, otherwise the
/// estimate of its solution, otherwise 1.
pub(crate) fn annotation_sigma_px(session: &Session, camera: usize) -> f64 {
    let given = session.site.cameras.get(camera).and_then(|entry| entry.sigma_px);
    let found = || session.solved.solution(camera)?.sigma_px;
    given.or_else(found).unwrap_or(1.0)
}

impl Pointer {
    /// Returns the standard deviation of a click, in pixels, if it exceeds the standard deviation of the
    /// camera's annotations. In a small view, a click is accurate only to a screen point.
    pub(crate) fn sigma_px(&self, session: &Session, camera: usize) -> Option<f64> {
        let hundredths = (100.0 * self.point_size).round() / 100.0;
        (hundredths > annotation_sigma_px(session, camera)).then_some(hundredths)
    }

    /// Returns the index of the camera and the position in raw pixels; `None` on the plan.
    #[must_use]
    pub fn pixel(&self) -> Option<(usize, Pixel)> {
        match self.pane {
            Pane::Image(camera) => Some((camera, self.at.into())),
            Pane::Plan => None,
        }
    }

    /// Returns the position of the pointer on the floor, in metres. In an image, the ray of the pixel is intersected
    /// with the horizontal plane at `height` metres. `None` without a pose or an intersection.
    #[must_use]
    pub fn floor(&self, session: &Session, height: f64) -> Option<FloorPoint> {
        match self.pane {
            Pane::Image(camera) => session.solved.pose(camera)?.pixel_to_floor(self.at.into(), height),
            Pane::Plan => Some(self.at.into()),
        }
    }
}

/// Pointer tool of the canvases.
pub trait Tool: std::fmt::Debug {
    /// Processes a pointer event.
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer);

    /// Finishes a gesture that does not end with a click, when the operator presses Enter.
    fn accept(&mut self, _session: &mut Session) {}

    /// Removes the last point of a gesture (Backspace). Returns whether a point was removed.
    fn step_back(&mut self, _session: &mut Session) -> bool {
        false
    }

    /// Cancels the current gesture. The caller restores the site.
    fn cancel(&mut self);

    /// Returns the index of the unfinished link that gets an observation by a click in another view, if any.
    fn open_link(&self, _session: &Session) -> Option<usize> {
        None
    }

    /// Whether no gesture is in progress.
    fn is_idle(&self) -> bool;

    /// Whether the tool draws a single object, such as the field of view, and has finished it. The selection tool
    /// then replaces the tool.
    fn is_done(&self) -> bool {
        false
    }

    /// Returns a hint about the next click, for the status line.
    fn hint(&self, session: &Session) -> String;

    /// Returns the canvas and the position of the dragged point, for the magnifier.
    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        None
    }

    /// Returns the preview lines of the current gesture on a canvas, in units of the canvas.
    fn preview_lines(&self, _pane: Pane) -> Vec<Vec<[f64; 2]>> {
        Vec::new()
    }
}

/// Icon of a tool in the toolbar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "each icon is named after its tool")]
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
    Area,
    Wall,
}

/// Entry of the list of tools.
#[derive(Clone, Copy, Debug)]
pub struct ToolRow {
    /// Title of the tool in the app.
    pub title: &'static str,
    /// Key that selects the tool, if it has one.
    pub key: Option<Key>,
    /// Icon of the tool.
    pub icon: Icon,
    /// Kind of annotation that the tool draws, if any.
    pub kind: Option<Kind>,
    /// Function that creates the tool.
    pub make: fn() -> Box<dyn Tool>,
}

impl ToolRow {
    /// Whether the tool acts on the plan. Otherwise, a drag on the plan moves the handles of cameras.
    #[must_use]
    pub fn acts_on_plan(&self) -> bool {
        self.draws_survey()
            || matches!(self.icon, Icon::Select | Icon::Control | Icon::Mark | Icon::Measure | Icon::Region)
    }

    /// Whether the tool draws walls or areas of interest, which the coverage shows.
    #[must_use]
    pub const fn draws_survey(&self) -> bool {
        matches!(self.icon, Icon::Area | Icon::Wall)
    }
}

/// All tools, in the order of the toolbar.
pub const TOOLS: &[ToolRow] = &[
    ToolRow {
        title: "Select",
        key: Some(Key::Q),
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
        key: Some(Key::F),
        icon: Icon::Field,
        kind: None,
        make: || Box::new(polyline::Polyline::field()),
    },
    ToolRow {
        title: "Control point",
        key: Some(Key::C),
        icon: Icon::Control,
        kind: None,
        make: || Box::new(control::Control::default()),
    },
    ToolRow {
        title: "Link",
        key: Some(Key::K),
        icon: Icon::Link,
        kind: None,
        make: || Box::new(link::Linking::default()),
    },
    ToolRow {
        title: "Mark",
        key: Some(Key::M),
        icon: Icon::Mark,
        kind: None,
        make: || Box::new(mark::Marking::default()),
    },
    ToolRow {
        title: "Measure",
        key: Some(Key::A),
        icon: Icon::Measure,
        kind: None,
        make: || Box::new(measure::Measure::default()),
    },
    ToolRow {
        title: "Region of a plane",
        key: Some(Key::O),
        icon: Icon::Region,
        kind: None,
        make: || Box::new(measure::Region::default()),
    },
    ToolRow {
        title: "Area of interest",
        key: None,
        icon: Icon::Area,
        kind: None,
        make: || Box::new(survey::Survey::area()),
    },
    ToolRow {
        title: "Wall",
        key: None,
        icon: Icon::Wall,
        kind: None,
        make: || Box::new(survey::Survey::walls()),
    },
];

/// Creates the list entry of a tool that draws annotations of this kind.
const fn line(kind: Kind, key: Key, icon: Icon, make: fn() -> Box<dyn Tool>) -> ToolRow {
    ToolRow {
        title: calib_core::single::KINDS[kind as usize].title,
        key: Some(key),
        icon,
        kind: Some(kind),
        make,
    }
}

/// Returns the index of the tool with this title in [`TOOLS`]; 0 if the title is unknown.
pub(crate) fn tool_index(title: &str) -> usize {
    TOOLS.iter().position(|tool| tool.title == title).unwrap_or(0)
}

/// Returns the scale of the plan; 1 cm per pixel if the site has no plan.
#[must_use]
pub fn plan_scale(site: &Site) -> PlanScale {
    let bare = PlanScale { metres_per_px: 0.01, origin: calib_core::PlanPixel::new(0.0, 0.0), x_axis: 0.0 };
    site.plan.as_ref().map_or(bare, calib_site::Plan::scale)
}
