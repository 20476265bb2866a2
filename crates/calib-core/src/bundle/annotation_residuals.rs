//! Residuals of stage 1 in a bundle adjustment, under the lens of the state. Their derivatives are sorted
//! into the blocks of the camera, of its nuisance parameters, and of the tilt and planes that views share.

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::initialization::{CommonTilt, common_tilt_derivatives};
use crate::bundle::problem::BundleProblem;
use crate::bundle::residuals::{
    ResidualKind, Stage1Residuals, compact_blocks, stage_1_by_lens, stage_1_residuals,
};
use crate::bundle::shared_planes::{PLANE_POSE_PARAMS, PlaneDerivatives};
use crate::camera::{Camera, Covariance, Lens};
use crate::optimize::{JacobianBlock, NormalEquations, NuisanceJacobian};
use crate::single::{Constraints, LOG_FOCAL, LOG_HEIGHT, PITCH, ROLL, State};

impl BundleProblem<'_> {
    /// Calls `sink` with the residuals of stage 1 of a view, including the priors on the camera, under the
    /// lens of the state.
    pub(crate) fn each_annotation(
        &self,
        state: &[f64],
        view: usize,
        camera: &Camera,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) -> Option<()> {
        let height = camera.position.z;
        // A camera below the floor has no log height; residuals that depend on it are impossible.
        let log_height = if height > 0.0 { height.ln() } else { f64::NEG_INFINITY };
        let parameters = [camera.roll, camera.pitch, camera.focal.ln(), log_height];
        let stage_1 = State { parameters, nuisance: self.nuisance(state, view) };
        let (residuals, d_lens) = self.stage_1(view, camera, &stage_1)?;
        let tilt = self.common_tilt(state, view);
        let mut sorted = Vec::new();
        for (i, (residual, jacobian, nuisance, source)) in residuals.iter().enumerate() {
            let mut by = [0.0; CAMERA_PARAMS];
            by[Covariance::ROLL] = jacobian[ROLL];
            by[Covariance::PITCH] = jacobian[PITCH];
            by[Covariance::FOCAL] = jacobian[LOG_FOCAL];
            by[Covariance::Z] = if height > 0.0 { jacobian[LOG_HEIGHT] / height } else { 0.0 };
            d_lens.get(i).iter().for_each(|d_lens| self.views[view].add_lens(&mut by, d_lens));
            let in_common = tilt.and_then(|(at, lean, yaw)| common_tilt_derivatives(nuisance, at, lean, yaw));
            let is_prior_of_another =
                source.is_none() && self.tilt.is_some_and(|tilt| tilt.prior_view != view);
            if in_common.is_some() && is_prior_of_another {
                continue;
            }
            let on_plane = self.plane_derivatives(state, view, camera, nuisance);
            // A shared plane has its priors once, in `each_plane_prior`.
            if on_plane.is_some() && source.is_none() {
                continue;
            }
            let tilt =
                in_common.as_ref().zip(self.tilt).map(|((by_lean, by_yaw), CommonTilt { block, .. })| {
                    by[Covariance::YAW] += *by_yaw;
                    JacobianBlock { block, by: by_lean }
                });
            let plane = on_plane.as_ref().and_then(|PlaneDerivatives { plane, by_plane, by_pose }| {
                PLANE_POSE_PARAMS.iter().zip(by_pose).for_each(|(&at, by_pose)| by[at] += by_pose);
                Some(JacobianBlock { block: self.plane_blocks[*plane]?, by: by_plane })
            });
            let own = self.nuisance_jacobian(view, nuisance, &mut sorted);
            let (others, count) = compact_blocks([tilt, plane, own]);
            let kind =
                source.map_or(ResidualKind::CameraPrior, |source| ResidualKind::Annotation { view, source });
            self.sink_view(view, *residual, &by, &others[..count], kind, sink);
        }
        Some(())
    }

    /// Removes the weak priors on focal lengths, also from the normal equations at a state.
    pub(crate) fn drop_weak_priors(&mut self, state: &[f64], normal: &mut NormalEquations) {
        for view in 0..self.views.len() {
            let Some(prior) = self.views[view].stage_1.priors.weak_log_focal.take() else { continue };
            let mut by = [0.0; CAMERA_PARAMS];
            by[Covariance::FOCAL] = prior.sigma.recip();
            let residual = (self.camera(state, view).focal.ln() - prior.value) / prior.sigma;
            let mut remove = |residual: f64, jacobian: &[JacobianBlock], _: ResidualKind| {
                self.blocks.remove(normal, residual, jacobian);
            };
            self.sink_view(view, residual, &by, &[], ResidualKind::CameraPrior, &mut remove);
        }
    }

    /// Returns the residuals of stage 1 and, for an estimated lens, their derivatives with respect to its
    /// parameters.
    fn stage_1(
        &self,
        view: usize,
        camera: &Camera,
        state: &State,
    ) -> Option<(Stage1Residuals, Vec<[f64; Lens::PARAMETERS]>)> {
        let this = &self.views[view];
        if !self.lens_is_free(view) {
            return Some((stage_1_residuals(&this.stage_1, state)?, Vec::new()));
        }
        let scene = this.stage_1.constraints.scene;
        let [start, lens] = [&this.camera.lens, &camera.lens];
        let constraints = Constraints::in_charts_of(start, this.annotations, lens, scene, &self.planes);
        let residuals = stage_1_residuals(&this.stage_1.with_constraints(&constraints), state)?;
        let constraints = Constraints::in_charts_of(start, this.annotations, lens, scene, &self.planes);
        let d_lens = stage_1_by_lens(&this.stage_1, &constraints, state)?;
        (d_lens.len() == residuals.len()).then_some((residuals, d_lens))
    }

    /// Returns the derivatives of a residual with respect to the nuisance parameters of a view, sorted into
    /// their block.
    fn nuisance_jacobian<'b>(
        &self,
        view: usize,
        nuisance: &NuisanceJacobian,
        sorted: &'b mut Vec<f64>,
    ) -> Option<JacobianBlock<'b>> {
        let entries =
            || nuisance.entries().iter().filter_map(|&(i, by)| Some((self.own_nuisance_slot(view, i)?, by)));
        let ((block, _), _) = entries().next()?;
        sorted.clear();
        sorted.resize(self.blocks.sizes[block], 0.0);
        entries().for_each(|((_, slot), by)| sorted[slot] = by);
        Some(JacobianBlock { block, by: sorted })
    }

    /// Returns the block and index of a nuisance parameter of a view; `None` if it is shared with other views
    /// or not used.
    fn own_nuisance_slot(&self, view: usize, nuisance: usize) -> Option<(usize, usize)> {
        let is_shared = |slot: &(usize, usize)| self.tilt.is_some_and(|tilt| tilt.block == slot.0);
        self.nuisance_layout[view][nuisance].filter(|slot| !is_shared(slot))
    }

    /// Returns the shared floor tilt for a view. The values are the index of the tilt among the nuisance
    /// parameters of the view, the tilt in the base system, and the yaw of the view (radians). Returns `None`
    /// if the view does not share the tilt.
    pub(crate) fn common_tilt(&self, state: &[f64], view: usize) -> Option<(usize, [f64; 2], f64)> {
        let CommonTilt { block, .. } = self.tilt?;
        let at = self.views[view].stage_1.nuisances().tilt();
        self.nuisance_layout[view].get(at).copied().flatten().filter(|slot| slot.0 == block)?;
        let offset = self.blocks.offsets[block];
        let yaw = match self.camera_layout[view][Covariance::YAW] {
            Some(at) => state[self.blocks.parameter_index(at)],
            None => self.views[view].camera.yaw,
        };
        Some((at, [state[offset], state[offset + 1]], yaw))
    }
}
