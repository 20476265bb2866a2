//! Stage 2 by hand: placement of cameras by the operator.

use calib_core::Placement;

use calib_site::PlacementEntry;

use crate::refine::rounded;
use crate::session::Session;

impl Session {
    /// Returns the placement of a camera for editing: as entered, or derived from its pose.
    #[must_use]
    pub fn placement(&self, index: usize) -> Option<Placement> {
        let now = self.solved.pose(index).map(Placement::from_camera);
        let Some(entry) = &self.site.cameras.get(index)?.placement else { return now };
        let scale = entry.scale.or_else(|| Some(now?.scale)).unwrap_or(1.0);
        Some(Placement { scale, ..entry.placement() })
    }

    /// Sets the placement of a camera; its fixed components stay marked as fixed. The scale is stored only if it
    /// changes, or if it was stored before.
    pub fn place(&mut self, index: usize, placement: Placement) {
        let is_scaled =
            self.placement(index).is_none_or(|now| (placement.scale / now.scale - 1.0).abs() > 1e-9);
        if let Some(camera) = self.site.cameras.get_mut(index) {
            let own = camera.placement.as_ref();
            let says_scale = is_scaled || own.is_some_and(|entry| entry.scale.is_some());
            let (fixed, held) = own.map_or_else(Default::default, |own| (own.fixed, own.held));
            let entry = rounded(placement);
            let scale = entry.scale.filter(|_| says_scale);
            // Position and rotation are now set by hand, so only an unchanged stored scale is still an estimate.
            let estimated = !is_scaled && scale.is_some() && own.is_some_and(|entry| entry.estimated);
            camera.placement = Some(PlacementEntry { fixed, held, scale, estimated, ..entry });
        }
    }

    /// Whether the operator may move a camera. If not, a note states the reason. `purpose` completes "Switch them off
    /// to".
    pub(crate) fn check_may_move(&mut self, camera: usize, purpose: &str) -> bool {
        let is_fixed = self.is_fixed_by_control_points(camera);
        if is_fixed {
            let name = &self.site.cameras[camera].id;
            let why =
                format!("Control points determine the position of {name}. Switch them off to {purpose}.");
            self.note = Some(why);
        }
        !is_fixed
    }

    /// Whether control points determine the position of a camera, so that it cannot be moved by hand.
    #[must_use]
    pub fn is_fixed_by_control_points(&self, index: usize) -> bool {
        self.site.cameras.get(index).is_some_and(|camera| {
            let is_usable =
                |p: &&calib_site::ControlPointEntry| !p.off && p.control_point(&self.site).is_some();
            let fixed = camera.placement.as_ref().is_some_and(|placement| placement.fixed);
            !fixed && camera.control_points.iter().filter(is_usable).count() >= 2
        })
    }
}
