//! The camera as it would be with all that is proposed, and which group of it to ask about first.
//!
//! That is the group with which the solve predicts the least relative error of floor lengths: the covariance decides,
//! as it does for what is to be drawn next.

use calib_core::Camera;

use calib_site::{DistortionEntry, LensEntry, Options, Site, SiteCamera, Solution};

use crate::proposed::Proposed;

/// The camera as it would be with all that is proposed.
#[derive(Clone, Debug)]
pub struct Preview {
    /// From what it follows.
    from: (SiteCamera, Proposed),
    /// What the solve makes of it, where it does.
    pub solution: Option<Solution>,
    /// Its pose.
    pub pose: Option<Camera>,
    /// The group that would tell most.
    pub next: Option<usize>,
}

impl Preview {
    /// Of a camera, with its pose as far as it is known.
    #[must_use]
    pub fn new(entry: &SiteCamera, pose: Option<&Camera>, proposed: &Proposed) -> Self {
        let bare = alone(entry, pose);
        let with = |which: &dyn Fn(usize) -> bool| solved(proposed.drawn(&bare, which));
        let solution = with(&|_| true);
        let off = |group: usize| {
            let sigma = with(&|other| other == group)?.sigma?;
            sigma.floor_length_rel.filter(|rel| rel.is_finite())
        };
        // Without floor there is nothing to compare; the lens comes before all else.
        let first = || (!proposed.groups.is_empty()).then_some(0);
        let best = (0..proposed.groups.len()).filter_map(|group| Some((group, off(group)?)));
        let next = best.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(group, _)| group).or_else(first);
        let pose = solution.as_ref().and_then(Solution::camera);
        Self { from: (entry.clone(), proposed.clone()), solution, pose, next }
    }

    /// Whether it is still of this camera and this proposal.
    #[must_use]
    pub fn is_of(&self, entry: &SiteCamera, proposed: &Proposed) -> bool {
        self.from.0 == *entry && self.from.1 == *proposed
    }
}

/// What is drawn on a camera and known of its lens, and nothing that ties it to others.
fn alone(entry: &SiteCamera, pose: Option<&Camera>) -> SiteCamera {
    let like = entry.lens.as_ref().is_some_and(|lens| lens.like.is_some());
    SiteCamera {
        lens: if like { given(entry, pose) } else { entry.lens.clone() },
        annotations: entry.annotations.clone(),
        efov_px: entry.efov_px.clone(),
        sigma_px: entry.sigma_px,
        height_m: entry.height_m,
        ..SiteCamera::new(entry.id.clone(), entry.size_px)
    }
}

/// The lens of a pose, as if it had been entered.
fn given(entry: &SiteCamera, pose: Option<&Camera>) -> Option<LensEntry> {
    let own = entry.lens.clone().unwrap_or_default();
    let distortion = pose.and_then(|pose| {
        let entry = DistortionEntry::of(&pose.lens, pose.lens.focal)?;
        Some(DistortionEntry { focal_px: Some(pose.lens.focal), fit: None, ..entry })
    });
    let distortion = distortion.or(own.distortion.clone().filter(|entry| entry.distortion().is_some()));
    // That of a fisheye came from its edges.
    let centre = pose.filter(|pose| pose.lens.distortion.is_wide()).map(|pose| pose.lens.principal_point);
    let principal_point_px = centre.or(own.principal_point_px);
    Some(LensEntry { like: None, distortion, principal_point_px, ..own })
        .filter(|lens| *lens != LensEntry::default())
}

/// The camera with nothing drawn, its lens given where it is known by now: what a proposal starts from.
#[must_use]
pub(crate) fn undrawn(entry: &SiteCamera, pose: Option<&Camera>) -> SiteCamera {
    SiteCamera { lens: given(entry, pose), ..SiteCamera::new(entry.id.clone(), entry.size_px) }
}

fn solved(entry: SiteCamera) -> Option<Solution> {
    let site = Site { cameras: vec![entry], ..Site::new() };
    let mut report = site.calibrate(&Options::default());
    report.cameras.pop()?.1.ok()
}
