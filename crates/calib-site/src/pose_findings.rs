//! What is wrong with the pose of a camera, whatever it was made of.

use crate::document::SiteCamera;
use calib_core::camera::{Camera, Pixel};
use calib_core::floor::{default_efov, efov_on_floor};
use calib_core::outcome::{Code, Finding};

impl SiteCamera {
    /// What keeps the camera, as it is now, from being relied on, before any line is looked at: it stands below
    /// the floor, shows none of it, or nothing is known of its errors.
    #[must_use]
    pub fn pose_findings(&self) -> Vec<Finding> {
        self.camera().map_or_else(Vec::new, |camera| self.findings_at(&camera))
    }

    /// [`Self::pose_findings`] of a camera that it is to become.
    pub(crate) fn findings_at(&self, camera: &Camera) -> Vec<Finding> {
        let height = camera.position.z;
        let mut findings = Vec::new();
        if height < 0.0 {
            findings.push(Finding::BelowFloor { height });
        }
        if !shows_floor(camera, self.efov_px.as_deref(), self.size()) {
            findings.push(Finding::NoFloor);
        }
        if !camera.covariance.is_known() {
            findings.push(Finding::UncertaintyUnknown);
        }
        findings
    }
}

/// Whether a code is one of [`SiteCamera::pose_findings`], or of where the drawing lies: these are found anew
/// whatever a solution says.
pub(crate) const fn is_found_anew(code: Code) -> bool {
    matches!(
        code,
        Code::BelowFloor
            | Code::NoFloor
            | Code::UncertaintyUnknown
            | Code::PointsOutside
            | Code::NotThisImage
    )
}

fn shows_floor(camera: &Camera, efov: Option<&[Pixel]>, size: [f64; 2]) -> bool {
    let polygon = match efov {
        Some(corners) => efov_on_floor(camera, corners).polygon,
        None => default_efov(camera, size).polygon,
    };
    !polygon.is_empty()
}
