//! Coordinate systems of the calibrated cameras. The positions of two cameras are comparable only in the same
//! system.

use crate::document::{ControlPointEntry, Site, SiteCamera};
use crate::geographic::SurveyedPosition;
use crate::solution::Stage;

/// Coordinate system of a camera's position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Frame {
    /// System of the site: the plan, the control points, or the fixed marks.
    Site,
    /// System of a connected component of cameras. No placement, control point, mark or link determines its position
    /// in the system of the site. The number is the index of the component.
    Component(usize),
    /// Own system of a camera: the origin is the floor point below the camera.
    Own,
}

impl Site {
    /// Returns the coordinate system of a calibrated camera.
    pub(crate) fn frame(&self, entry: &SiteCamera) -> Frame {
        match entry.solution.as_ref().map(|solution| solution.stage) {
            Some(Stage::Placed) => Frame::Site,
            Some(Stage::Refined) => self.component_frame(entry),
            _ => Frame::Own,
        }
    }

    /// Returns the coordinate system of a jointly solved camera.
    fn component_frame(&self, entry: &SiteCamera) -> Frame {
        let components = self.solution.as_ref().map_or(&[][..], |solution| &solution.components[..]);
        let Some(index) = components.iter().position(|ids| ids.contains(&entry.id)) else {
            return Frame::Site;
        };
        let is_member = |id: &str| components[index].iter().any(|own| own == id);
        let is_placed = |camera: &SiteCamera| {
            let is_known = |point: &ControlPointEntry| !point.off && point.control_point(self).is_some();
            camera.placement.is_some() || camera.control_points.iter().any(is_known)
        };
        let by_camera = self.cameras.iter().any(|camera| is_member(&camera.id) && is_placed(camera));
        let by_mark = self.marks.iter().any(|mark| {
            !mark.off
                && mark.seen.iter().any(|seen| is_member(&seen.camera))
                && (mark.fixed || self.world_of_survey(&SurveyedPosition::of_mark(mark)).is_some())
        });
        let by_link = self.links.iter().any(|link| {
            !link.off
                && link.seen.iter().any(|seen| is_member(&seen.camera))
                && self.world_of_survey(&SurveyedPosition::of_link(link)).is_some()
        });
        if by_camera || by_mark || by_link { Frame::Site } else { Frame::Component(index) }
    }

    /// Returns the system of the site if any camera has it, otherwise the system of the component with the most
    /// cameras. Returns [`Frame::Own`] only for a single camera. Returns `None` without cameras, and for several
    /// cameras without a common system.
    pub(crate) fn main_frame<'a>(&self, entries: impl Iterator<Item = &'a SiteCamera>) -> Option<Frame> {
        let frames: Vec<Frame> = entries.map(|entry| self.frame(entry)).collect();
        if frames.contains(&Frame::Site) {
            return Some(Frame::Site);
        }
        let count = |frame: &Frame| frames.iter().filter(|own| *own == frame).count();
        let of_component = frames
            .iter()
            .filter(|frame| matches!(frame, Frame::Component(_)))
            .max_by_key(|frame| count(frame));
        of_component.copied().or_else(|| (frames.len() == 1).then_some(Frame::Own))
    }
}
