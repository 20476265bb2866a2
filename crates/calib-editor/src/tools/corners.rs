//! Corners of a shape that is drawn on the plan, one click for each corner.

use calib_core::FloorPoint;

use crate::tools::{Pane, Phase, Pointer};

/// Corners of an unfinished shape, in floor metres; the last one follows the pointer. Empty if no gesture is in
/// progress.
#[derive(Debug, Default)]
pub(super) struct Corners(Vec<FloorPoint>);

impl Corners {
    /// Processes a pointer event at a floor point. A click on the first corner closes a shape of three or more
    /// corners. A double click finishes a shape of `min_corners` or more without closing it. Returns whether the
    /// shape was closed; `None` while it is unfinished.
    pub(super) fn follow(&mut self, at: FloorPoint, pointer: &Pointer, min_corners: usize) -> Option<bool> {
        let Some(last) = self.0.last_mut() else {
            if pointer.phase == Phase::Press {
                self.0 = vec![at, at];
            }
            return None;
        };
        *last = at;
        if pointer.phase != Phase::Release {
            return None;
        }
        let set = self.set();
        let closes = set >= 3 && self.0[0].distance(at) <= pointer.radius;
        if closes || pointer.double && set >= min_corners {
            return Some(closes);
        }
        // The first press adds the first corner; its release does not add the second one.
        if self.0[set - 1].distance(at) > 0.5 * pointer.radius {
            self.0.push(at);
        }
        None
    }

    /// Ends the gesture, and returns the corners without the one that follows the pointer.
    pub(super) fn take(&mut self) -> Vec<FloorPoint> {
        let mut corners = std::mem::take(&mut self.0);
        corners.pop();
        corners
    }

    /// Removes the last corner before the one that follows the pointer. Returns whether a gesture was in progress.
    pub(super) fn step_back(&mut self) -> bool {
        let Some(end) = self.0.pop() else { return false };
        self.0.pop();
        if !self.0.is_empty() {
            self.0.push(end);
        }
        true
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns all corners, with the one that follows the pointer.
    pub(super) fn all(&self) -> &[FloorPoint] {
        &self.0
    }

    /// Returns the number of corners without the one that follows the pointer.
    pub(super) const fn set(&self) -> usize {
        self.0.len().saturating_sub(1)
    }

    /// Returns the canvas and the position of the corner that follows the pointer.
    pub(super) fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        self.0.last().map(|&at| (Pane::Plan, at.into()))
    }

    /// Returns the preview lines on a canvas.
    pub(super) fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        if pane != Pane::Plan || self.0.is_empty() {
            return Vec::new();
        }
        vec![self.0.iter().map(|&at| at.into()).collect()]
    }
}
