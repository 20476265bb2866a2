//! Drag of an existing point of a line while a drawing tool is active.

use calib_core::Pixel;

use crate::edit;
use crate::hit::{self, Part};
use crate::session::Session;
use crate::snap;
use crate::tools::{Phase, Pointer};

/// Ratio of the movement of a part to the movement of the pointer while Shift is pressed.
pub(super) const FINE_DRAG: f64 = 0.1;

/// Press on an existing point of a line. A drag moves the point; a click belongs to the drawing tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grab {
    /// Index of the camera.
    pub(super) camera: usize,
    /// Point that a drag moves.
    part: Part,
    /// Raw pixel of the press.
    pub(super) from: Pixel,
    /// Current raw pixel of the point.
    pub(super) at: Pixel,
    /// Whether the point was moved.
    pub(super) has_moved: bool,
}

impl Grab {
    /// Returns the grab of the line point under a press on an image; `None` if no point is near the press.
    pub(super) fn start(session: &Session, pointer: &Pointer) -> Option<Self> {
        let (camera, from) = pointer.pixel()?;
        let part = hit::line_point(&session.site, camera, from, pointer.radius)?;
        Some(Self { camera, part, from, at: from, has_moved: false })
    }

    /// Moves the point with the pointer, and ends the move on a release. Returns the grab while the button is down.
    pub(super) fn follow(mut self, session: &mut Session, pointer: &Pointer) -> Option<Self> {
        if pointer.moved {
            self.has_moved = true;
            session.select_only(self.camera, self.part);
            self.at = drag_selection(session, self.camera, self.from, pointer);
        }
        if pointer.phase != Phase::Release {
            return Some(self);
        }
        if self.has_moved {
            let name = session.selection_name();
            session.commit(format!("move {name}"));
        }
        None
    }

    /// Returns the hint for the status line.
    pub(super) fn hint(&self, session: &Session) -> String {
        let name = session.part_name(self.part);
        format!("Drag to move {name}; release here to start a line.  Shift: fine, Alt: snap to edge")
    }
}

/// Moves the selected parts with the pointer, and returns the position of the dragged point in raw pixels. If Alt is
/// pressed, a single point of a line moves onto the edge under the pointer.
pub(super) fn drag_selection(session: &mut Session, camera: usize, from: Pixel, pointer: &Pointer) -> Pixel {
    let at: Pixel = pointer.at.into();
    let share = if pointer.modifiers.shift { FINE_DRAG } else { 1.0 };
    let by = [share * (at.u - from.u), share * (at.v - from.v)];
    session.revert();
    let parts = session.selection.clone();
    edit::shift(&mut session.site, camera, &parts, by);
    let first = edit::points_of(&session.site, camera, &parts).into_iter().next();
    match (parts.len(), first) {
        (1, Some(part)) if parts.contains(&part) => {
            snap_point(session, camera, part, pointer);
            edit::pixel_mut(&mut session.site, camera, part).map_or(at, |pixel| *pixel)
        }
        _ => Pixel::new(from.u + by[0], from.v + by[1]),
    }
}

/// Moves a point of a line onto the image edge under it, if Alt is pressed.
fn snap_point(session: &mut Session, camera: usize, part: Part, pointer: &Pointer) {
    let image = pointer.image.as_deref().filter(|_| pointer.modifiers.alt);
    let lens = hit::lens_of(&session.site, camera, session.solved.pose(camera));
    if let (Some(image), Some(lens)) = (image, lens) {
        snap::pull_point(&mut session.site, camera, part, &lens, image);
    }
}
