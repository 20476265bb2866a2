//! Planes of the scene that views and landmarks share. Each plane has three parameters in the base system,
//! height and two slopes, with priors.
//!
//! The single-camera fit has no position. It has two separate slopes for every plane and the height of the
//! plane under the camera. For a camera at (x, y), these parameters are the slope rotated into the axes of
//! the view (`initialization.rs`), and the height of the plane at (x, y).

use crate::bundle::initialization::{base_to_view, view_to_base};
use crate::bundle::parameters::{PLANE_PARAMS, parameters_of_plane};
use crate::bundle::problem::BundleProblem;
use crate::bundle::residuals::ResidualKind;
use crate::camera::{Camera, Covariance, Plane};
use crate::optimize::{JacobianBlock, NuisanceJacobian};

/// Smallest standard deviation of a plane parameter: 0.01 mm for the height, 1e-5 for a slope. It replaces
/// the zero of a parameter that is fixed while other parameters of the plane are free.
const MIN_PLANE_SIGMA: f64 = 1e-5;

/// Derivatives of a residual of a view with respect to a plane and to the pose.
pub(crate) struct PlaneDerivatives {
    /// Index of the plane.
    pub(crate) plane: usize,
    /// Derivatives with respect to the height and the slopes along x and y of the plane.
    pub(crate) by_plane: [f64; PLANE_PARAMS],
    /// Derivatives with respect to x, y and yaw of the camera.
    pub(crate) by_pose: [f64; 3],
}

impl BundleProblem<'_> {
    /// Returns a plane at a state.
    pub(crate) fn plane(&self, state: &[f64], plane: usize) -> Plane {
        let prior = self.planes[plane].plane;
        let Some(block) = self.plane_blocks[plane] else { return prior };
        let at = self.blocks.offsets[block];
        Plane { height: state[at], slope: [state[at + 1], state[at + 2]], ..prior }
    }

    /// Returns the plane under a landmark at a state, with its block.
    pub(crate) fn ground(&self, state: &[f64], landmark: usize) -> (Plane, Option<usize>) {
        match self.landmarks[landmark].plane {
            Some(plane) => (self.plane(state, plane), self.plane_blocks[plane]),
            None => (self.landmarks[landmark].ground, None),
        }
    }

    /// Sets the nuisance parameters of the shared planes of a view at a state.
    pub(crate) fn set_planes(&self, state: &[f64], view: usize, nuisance: &mut [f64]) {
        let this = &self.views[view];
        if !this.shares_floor {
            return;
        }
        let camera = self.camera(state, view);
        for (index, drawn) in this.stage_1.constraints.planes.iter().enumerate() {
            let plane = self.plane(state, drawn.index);
            let [right, ahead] = base_to_view(plane.slope, camera.yaw);
            let foot = plane.height_at(camera.position.on_floor()) - drawn.prior.plane.height;
            let at = this.stage_1.nuisances().plane(index);
            nuisance[at..at + PLANE_PARAMS].copy_from_slice(&[right, ahead, foot]);
        }
    }

    /// Returns the derivatives of a residual of a view with respect to its plane, computed from its
    /// derivatives with respect to nuisance parameters. Returns `None` if the residual depends on no shared
    /// plane.
    pub(crate) fn plane_derivatives(
        &self,
        state: &[f64],
        view: usize,
        camera: &Camera,
        nuisance: &NuisanceJacobian,
    ) -> Option<PlaneDerivatives> {
        let this = &self.views[view];
        if !this.shares_floor {
            return None;
        }
        let first = this.stage_1.nuisances().plane(0);
        let on_planes = nuisance.entries().iter().filter(|(index, _)| *index >= first);
        let index = (on_planes.clone().next()?.0 - first) / PLANE_PARAMS;
        let mut by = [0.0; PLANE_PARAMS];
        on_planes.for_each(|&(at, derivative)| by[(at - first) % PLANE_PARAMS] += derivative);
        let [right, ahead, foot] = by;
        let drawn = this.stage_1.constraints.planes.get(index)?;
        let plane = self.plane(state, drawn.index);
        let [seen_right, seen_ahead] = base_to_view(plane.slope, camera.yaw);
        let [by_x, by_y] = view_to_base([right, ahead], camera.yaw);
        let under = plane.height_by_parameters(camera.position.on_floor());
        let [height, x, y] = under.map(|by| foot * by);
        Some(PlaneDerivatives {
            plane: drawn.index,
            by_plane: [height, x + by_x, y + by_y],
            by_pose: [foot * plane.slope[0], foot * plane.slope[1], right * seen_ahead - ahead * seen_right],
        })
    }

    /// Calls `sink` with `(value - prior) / sigma` for the height, the slope along the fall and the slope
    /// across the fall of every estimated plane.
    pub(crate) fn each_plane_prior(
        &self,
        state: &[f64],
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) {
        for (index, prior) in self.planes.iter().enumerate() {
            let Some(block) = self.plane_blocks[index] else { continue };
            let (now, mean) = (self.plane(state, index), prior.plane);
            let [now, mean] = [now, mean].map(|plane| parameters_of_plane(&plane));
            for (row, sigma) in prior.directions().into_iter().zip(prior.sigma) {
                let scale = sigma.max(MIN_PLANE_SIGMA).recip();
                let off: f64 = (0..PLANE_PARAMS).map(|k| row[k] * (now[k] - mean[k])).sum();
                let by = row.map(|by| by * scale);
                sink(scale * off, &[JacobianBlock { block, by: &by }], ResidualKind::PlanePrior);
            }
        }
    }
}

/// Indices in [`Covariance`] of the pose parameters of [`PlaneDerivatives::by_pose`].
pub(crate) const PLANE_POSE_PARAMS: [usize; 3] = [Covariance::X, Covariance::Y, Covariance::YAW];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::camera::{CAMERA_PARAMS, View};
    use crate::bundle::copies::Copies;
    use crate::bundle::landmark::{DistanceMeasurement, Landmark, LandmarkModel, Observation};
    use crate::bundle::residuals::ResidualKind;
    use crate::camera::{Camera, Distortion, FloorPoint, Lens, Pixel, WorldPoint};
    use crate::optimize::NormalEquations;
    use crate::single::{
        Annotation, Constraints, Edge, FixedParameters, Kind, Known, PlanePrior, PrincipalPointPrior, Prior,
        Priors, Problem, SceneErrors, Source,
    };
    use proptest::prelude::*;

    fn any_plane() -> impl Strategy<Value = PlanePrior> {
        (-0.5..0.5_f64, [-0.1..0.1_f64, -0.1..0.1_f64]).prop_map(|(height, slope)| PlanePrior {
            id: "ramp".into(),
            plane: Plane { height, slope, anchor: FloorPoint { x: 1.0, y: 6.0 } },
            along: [0.6, 0.8],
            sigma: [0.1, 0.03, 0.02],
        })
    }

    fn camera(x: f64, yaw: f64) -> Camera {
        Camera {
            position: WorldPoint::new(x, 0.5, 4.0),
            yaw,
            pitch: 0.6,
            roll: 0.03,
            focal: 1100.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        }
    }

    /// Returns the same camera with a fisheye lens of the same focal length.
    fn fisheye(camera: Camera) -> Camera {
        let distortion = Distortion::KannalaBrandt { k: [0.02, -0.004, 0.0, 0.0] };
        Camera { lens: Lens { focal: camera.focal, distortion, ..camera.lens }, ..camera }
    }

    fn edges() -> Vec<Edge> {
        let bow = |v: f64, sag: f64| {
            (0..5)
                .map(|i| 0.5 * f64::from(i) - 1.0)
                .map(|x| Pixel::new(960.0 + 850.0 * x, v + sag * x * x))
                .collect()
        };
        let source = Source { annotation: 0, segment: 0 };
        vec![Edge { points: bow(200.0, 90.0), source }, Edge { points: bow(950.0, -120.0), source }]
    }

    fn drawn(jitter: f64) -> Vec<Annotation> {
        let line =
            |a: [f64; 2], b: [f64; 2]| vec![Pixel::new(a[0] + jitter, a[1]), Pixel::new(b[0], b[1] + jitter)];
        let on_ramp = |annotation| Annotation { plane: Some("ramp".into()), ..annotation };
        let of = Annotation::from_segments;
        vec![
            of(
                Kind::Vertical,
                vec![line([300.0, 300.0], [330.0, 700.0]), line([1500.0, 300.0], [1460.0, 700.0])],
            ),
            on_ramp(of(
                Kind::Parallel,
                vec![line([700.0, 500.0], [500.0, 900.0]), line([1200.0, 500.0], [1500.0, 900.0])],
            )),
            on_ramp(of(
                Kind::EqualLength,
                vec![line([700.0, 500.0], [900.0, 520.0]), line([600.0, 800.0], [900.0, 820.0])],
            )),
            on_ramp(Annotation {
                length_m: Some(2.0),
                ..of(Kind::KnownLength, vec![line([900.0, 700.0], [1100.0, 720.0])])
            }),
            on_ramp(Annotation {
                foot: Some(Pixel::new(1000.0, 800.0)),
                head: Some(Pixel::new(1000.0 + jitter, 550.0)),
                height_m: Some(Known::prior(1.7, 0.05)),
                ..of(Kind::Upright, Vec::new())
            }),
        ]
    }

    fn landmarks(prior: &PlanePrior) -> Vec<Landmark> {
        let seen = |point: usize| {
            let pixel = |view: usize, u: f64| Observation {
                view,
                point,
                ..Observation::new(view, Pixel::new(u, 600.0))
            };
            vec![pixel(0, 900.0), pixel(1, 1000.0)]
        };
        let on_ramp = |model, params, observations| Landmark {
            params,
            plane: Some(0),
            ground: prior.plane,
            ..Landmark::new(model, observations)
        };
        let both = || [seen(0), seen(1)].concat();
        vec![
            on_ramp(LandmarkModel::Point { height: 0.2 }, [0.5, 5.0, 0.0], seen(0)),
            on_ramp(LandmarkModel::Post, [1.5, 6.0, 1.2], both()),
            on_ramp(
                LandmarkModel::Mark { z: 0.1, points: vec![[0.3, 0.0, 0.0], [0.0, 0.4, 0.5]] },
                [-0.5, 7.0, 0.4],
                both(),
            ),
            on_ramp(LandmarkModel::Line { origin: [0.0, 6.0] }, [0.2, 0.3, 0.0], both()),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn derivatives_of_all_residuals_match_finite_differences(
            prior in any_plane(), is_fisheye in any::<bool>(), jitter in -20.0..20.0_f64, yaw in -0.4..0.4_f64, nudges in proptest::collection::vec(-1.0..1.0_f64, 64),
        ) {
            const STEP: f64 = 1e-5;
            let (planes, annotations) = (vec![prior.clone()], [drawn(jitter), drawn(0.5 * jitter)]);
            let cameras = [camera(0.0, 0.1), camera(1.5, yaw)].map(|camera| if is_fisheye { fisheye(camera) } else { camera });
            let scene = SceneErrors::default();
            let constraints = annotations.each_ref().map(|drawn| Constraints::on_planes(drawn, &cameras[0].lens, scene, &planes));
            let view = |index: usize| {
                let weak_log_focal = Some(Prior { value: 7.0, sigma: 0.35 });
                let priors = Priors { weak_log_focal, ..Priors::default() };
                let stage_1 = Problem::new(&constraints[index], FixedParameters::default(), priors, 1.0, 1920.0);
                let mut free = [false; CAMERA_PARAMS];
                free[..Covariance::LENS].fill(true);
                if is_fisheye {
                    free[Covariance::LENS..Covariance::LENS + 2].fill(true);
                    free[Covariance::CENTRE..].fill(true);
                }
                View {
                    outermost: is_fisheye.then(|| Pixel::new(1700.0, 900.0)),
                    camera: cameras[index], free, lens: index, annotations: &annotations[index],
                    nuisance: vec![0.0; stage_1.nuisances().count()], stage_1, shares_floor: true, edges: if is_fisheye { edges() } else { Vec::new() },
                    edge_counts: vec![1.0; 2], size: [1920.0, 1080.0], principal_point: PrincipalPointPrior::of_fisheye([1920.0, 1080.0], None), pixel_aspect: Some(Prior { value: 1.0, sigma: 0.01 }), has_tied_focal: is_fisheye,
                }
            };
            let distances = vec![DistanceMeasurement::new([0, 1], 2.0, 0.1)];
            let problem = BundleProblem::new(vec![view(0), view(1)], (landmarks(&prior), distances, Copies::default()), planes);
            let mut state = problem.start();
            state.iter_mut().zip(nudges.iter().cycle()).for_each(|(value, nudge)| *value += 1e-3 * nudge);
            let residuals = |state: &[f64]| {
                let mut rows: Vec<(f64, Vec<f64>, bool)> = Vec::new();
                problem.each_residual(state, |value, blocks, kind| {
                    let mut row = vec![0.0; state.len()];
                    for block in blocks {
                        let at = problem.blocks.offsets[block.block];
                        block.by.iter().enumerate().for_each(|(k, by)| row[at + k] += by);
                    }
                    rows.push((value, row, matches!(kind, ResidualKind::Observation { .. })));
                })?;
                Some(rows)
            };
            let rows = residuals(&state).unwrap();
            prop_assert!(rows.len() > 30);
            for index in 0..state.len() {
                let nudged = |step: f64| { let mut moved = state.clone(); moved[index] += step; residuals(&moved) };
                let (Some(ahead), Some(behind)) = (nudged(STEP), nudged(-STEP)) else { continue };
                let (Some(ahead_2), Some(behind_2)) = (nudged(2.0 * STEP), nudged(-2.0 * STEP)) else { continue };
                for (k, (value, row, is_observation)) in rows.iter().enumerate() {
                    let half = (ahead[k].0 - behind[k].0) / (2.0 * STEP);
                    let whole = (ahead_2[k].0 - behind_2[k].0) / (4.0 * STEP);
                    let numeric = (4.0 * half - whole) / 3.0;
                    // The map back to raw pixels is constant in the derivatives, although it changes with the
                    // lens.
                    if is_fisheye && *is_observation {
                        continue;
                    }
                    let most = 1e-4 * (1.0 + row[index].abs() + value.abs());
                    prop_assert!((numeric - row[index]).abs() < most, "residual {k} of {value} by {index}: {numeric} {}", row[index]);
                }
            }
            // Removing the weak priors gives the same normal equations as a problem without them.
            let (mut dropped, mut normal) = (problem.clone(), problem.normal(&state).unwrap());
            dropped.drop_weak_priors(&state, &mut normal);
            let without = dropped.normal(&state).unwrap();
            prop_assert_eq!([normal.residuals, without.residuals], [rows.len() - 2; 2]);
            let values = |normal: &NormalEquations| [&[normal.cost], &normal.gradient[..], &normal.kept, &normal.own, &normal.cross].concat();
            for (value, exact) in values(&normal).iter().zip(values(&without)) {
                prop_assert!((value - exact).abs() <= 1e-11 * normal.cost.max(exact.abs()), "{value} {exact}");
            }
        }
    }
}
