//! Least-squares problem of the bundle adjustment: the state, all residuals (listed in `residuals.rs`), and
//! the normal equations.

use crate::bundle::camera::{CAMERA_PARAMS, View};
use crate::bundle::copies::Copies;
use crate::bundle::initialization::{CommonTilt, base_to_view};
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark};
use crate::bundle::local_similarity::LocalSimilarities;
use crate::bundle::parameters::parameters_of_plane;
use crate::bundle::parameters::{CameraLayout, ParameterLayout, parameters_of};
use crate::bundle::residuals::{CameraJacobian, ResidualKind, compact_blocks, distance_residual, pack_free};
use crate::camera::{Camera, Covariance, Lens, ObservedPixel, Pixel, PosedCamera};
use crate::optimize::{BlockStructure, JacobianBlock, LeastSquares, NormalEquations};
use crate::single::{PlanePrior, Prior, edge_redundancy, straightness_with_jacobian};

/// Views, landmarks and distances, with the position of every parameter in the state.
#[derive(Clone, Debug)]
pub(crate) struct BundleProblem<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) landmarks: Vec<Landmark>,
    pub(crate) distances: Vec<DistanceMeasurement>,
    /// Number of times that each landmark and each distance is annotated.
    copies: Copies,
    pub(crate) blocks: BlockStructure,
    pub(crate) camera_layout: Vec<CameraLayout>,
    /// Position of every nuisance parameter of stage 1 of every view: its block, and its index in the block.
    /// `None` if the parameter is not estimated, or belongs to a shared plane.
    pub(crate) nuisance_layout: Vec<Vec<Option<(usize, usize)>>>,
    /// Block of the free parameters of every landmark; `None` if no parameter is free.
    landmark_blocks: Vec<Option<usize>>,
    /// Priors of the planes other than the floor.
    pub(crate) planes: Vec<PlanePrior>,
    /// Block of the height and slope of every plane; `None` if the plane is not estimated.
    pub(crate) plane_blocks: Vec<Option<usize>>,
    /// Tilt of the floor that several views share; `None` if fewer than two views constrain it.
    pub(crate) tilt: Option<CommonTilt>,
    /// Graph of views and landmarks for the second-order corrections of a step (`local_similarity.rs`).
    pub(crate) similarities: Option<LocalSimilarities>,
    /// Undistorted pixel of every observation of every landmark under the initial lens; `None` if it is
    /// outside the lens. It is used for views whose lens is not estimated.
    observed: Vec<Vec<Option<ObservedPixel>>>,
}

impl<'a> BundleProblem<'a> {
    pub(crate) fn new(
        views: Vec<View<'a>>,
        (landmarks, distances, copies): (Vec<Landmark>, Vec<DistanceMeasurement>, Copies),
        planes: Vec<PlanePrior>,
    ) -> Self {
        let ParameterLayout {
            blocks,
            cameras,
            nuisances,
            landmarks: landmark_blocks,
            planes: plane_blocks,
            tilt,
        } = ParameterLayout::new(&views, &landmarks, &distances, &planes);
        let mut problem = Self {
            views,
            landmarks,
            distances,
            copies,
            blocks,
            camera_layout: cameras,
            nuisance_layout: nuisances,
            landmark_blocks,
            planes,
            plane_blocks,
            tilt,
            similarities: None,
            observed: Vec::new(),
        };
        let undistort = |landmark: &Landmark| -> Vec<Option<ObservedPixel>> {
            let seen = landmark.observations.iter();
            seen.map(|seen| problem.undistort(seen.view, seen.pixel, &problem.views[seen.view].camera.lens))
                .collect()
        };
        problem.observed = problem.landmarks.iter().map(undistort).collect();
        problem.similarities = problem.local_similarities();
        problem
    }

    /// Undistorts an observed pixel of a view under a lens; `None` if the pixel is outside the lens.
    fn undistort(&self, view: usize, pixel: Pixel, lens: &Lens) -> Option<ObservedPixel> {
        let this = &self.views[view];
        ObservedPixel::with_derivatives(&this.camera.lens, pixel, lens, this.lens_parameters())
    }

    /// Whether lens parameters of a view are estimated.
    pub(crate) fn lens_is_free(&self, view: usize) -> bool {
        self.views[view].lens_parameters().contains(&true)
    }

    /// Returns the initial state: the start values of all estimated parameters.
    pub(crate) fn start(&self) -> Vec<f64> {
        let mut state = vec![0.0; self.blocks.unknowns()];
        let mut set = |block: usize, index: usize, value: f64| {
            state[self.blocks.parameter_index((block, index))] = value;
        };
        for (view, layout) in self.views.iter().zip(&self.camera_layout) {
            for (parameter, value) in layout.iter().zip(parameters_of(&view.camera)) {
                parameter.iter().for_each(|&(block, index)| set(block, index, value));
            }
        }
        for (view, slots) in self.views.iter().zip(&self.nuisance_layout) {
            // The shared tilt starts at zero.
            let is_own = |slot: &(usize, usize)| self.tilt.is_none_or(|tilt| tilt.block != slot.0);
            for (slot, value) in slots.iter().zip(&view.nuisance) {
                slot.filter(is_own).iter().for_each(|&(block, index)| set(block, index, *value));
            }
        }
        for (plane, block) in self.planes.iter().zip(&self.plane_blocks) {
            let values = parameters_of_plane(&plane.plane).into_iter().enumerate();
            block.iter().for_each(|&block| values.clone().for_each(|(k, value)| set(block, k, value)));
        }
        for (landmark, block) in self.landmarks.iter().zip(&self.landmark_blocks) {
            let free = (0..LANDMARK_PARAMS).filter(|&k| landmark.free[k]);
            for (i, k) in free.enumerate() {
                block.iter().for_each(|&block| set(block, i, landmark.params[k]));
            }
        }
        state
    }

    /// Returns the camera of a view at a state, with the covariance of its initial camera.
    pub(crate) fn camera(&self, state: &[f64], view: usize) -> Camera {
        let camera = self.views[view].camera;
        let mut values = parameters_of(&camera);
        for (value, parameter) in values.iter_mut().zip(&self.camera_layout[view]) {
            if let Some(at) = parameter {
                *value = state[self.blocks.parameter_index(*at)];
            }
        }
        let [x, y, z, yaw, pitch, roll, log_focal, a, b, c, d, e, u, v, pixel_aspect] = values;
        // A fixed focal length is copied, because the logarithm and its inverse would round it.
        let fits_focal = self.camera_layout[view][Covariance::FOCAL].is_some();
        let focal = if fits_focal { log_focal.exp() } else { camera.focal };
        let lens = Lens {
            principal_point: Pixel { u, v },
            focal: if self.views[view].has_tied_focal { focal } else { camera.lens.focal },
            distortion: camera.lens.distortion.with_fitted_coefficients([a, b, c, d, e]),
            image_circle: None,
            pixel_aspect,
        };
        Camera { position: [x, y, z].into(), yaw, pitch, roll, focal, lens, ..camera }
    }

    /// Returns the parameters of a landmark at a state.
    pub(crate) fn landmark_params(&self, state: &[f64], landmark: usize) -> [f64; LANDMARK_PARAMS] {
        let mut params = self.landmarks[landmark].params;
        let free = (0..LANDMARK_PARAMS).filter(|&k| self.landmarks[landmark].free[k]);
        for (i, k) in free.enumerate() {
            if let Some(block) = self.landmark_blocks[landmark] {
                params[k] = state[self.blocks.parameter_index((block, i))];
            }
        }
        params
    }

    /// Returns the nuisance parameters of stage 1 of a view at a state.
    pub(crate) fn nuisance(&self, state: &[f64], view: usize) -> Vec<f64> {
        let values = self.views[view].nuisance.iter().zip(&self.nuisance_layout[view]);
        let value = |at: (usize, usize)| state[self.blocks.parameter_index(at)];
        let mut values: Vec<f64> = values.map(|(&start, slot)| slot.map_or(start, value)).collect();
        if let Some((at, lean, yaw)) = self.common_tilt(state, view) {
            values[at..at + 2].copy_from_slice(&base_to_view(lean, yaw));
        }
        self.set_planes(state, view, &mut values);
        values
    }

    /// Returns the block of the free parameters of a landmark.
    pub(crate) fn landmark_block(&self, landmark: usize) -> Option<usize> {
        self.landmark_blocks[landmark]
    }

    /// Returns the layout of the parameters of a view: for each parameter, its block and its index in the block.
    pub(crate) fn camera_layout(&self, view: usize) -> &CameraLayout {
        &self.camera_layout[view]
    }

    /// Returns the degrees of freedom: the number of residuals minus the parameters and the redundant
    /// residuals of edges and copies.
    pub(crate) fn dof(&self, residuals: usize) -> i64 {
        // The line through the points of an edge has two parameters, which are eliminated. An edge that is
        // annotated twice counts once.
        let beyond = |view: &View| {
            let points: usize = view.edges.iter().map(|edge| edge.points.len()).sum();
            points as i64 - edge_redundancy(view.edges.iter(), &view.edge_counts)
        };
        let edges: i64 = self.views.iter().map(beyond).sum();
        let repeated: i64 = self.views.iter().map(|view| view.stage_1.repeated_residuals()).sum::<i64>()
            + self.copies.redundant_dof(&self.landmarks, &self.distances);
        residuals as i64 - repeated - edges - self.blocks.unknowns() as i64
    }

    /// Calls `sink` with every residual in standard deviations, its derivatives, and its kind.
    ///
    /// Returns `None` if the geometry is impossible. Examples are a landmark behind a camera that observes
    /// it, an annotated length above the horizon, or a lens that is not invertible over the image.
    pub(crate) fn each_residual(
        &self,
        state: &[f64],
        mut sink: impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) -> Option<()> {
        let posed = |view: usize| PosedCamera::new(self.camera(state, view));
        let poses: Vec<PosedCamera> = (0..self.views.len()).map(posed).collect();
        for (view, PosedCamera { camera, .. }) in poses.iter().enumerate() {
            self.each_annotation(state, view, camera, &mut sink)?;
            self.each_edge(view, camera, &mut sink)?;
        }
        self.each_plane_prior(state, &mut sink);
        for landmark in (0..self.landmarks.len()).filter(|&landmark| !self.landmarks[landmark].off) {
            let params = self.landmark_params(state, landmark);
            self.each_observation(state, landmark, &params, &poses, &mut sink)?;
            self.each_landmark_prior(landmark, &params, &mut sink);
        }
        for distance in (0..self.distances.len()).filter(|&distance| !self.distances[distance].off) {
            self.each_distance(state, distance, &mut sink);
        }
        Some(())
    }

    /// Calls `sink` with the residuals of an estimated lens: the deviations of straight edges from straight
    /// lines, and the priors on the lens parameters. Does nothing if the lens is not estimated.
    fn each_edge(
        &self,
        view: usize,
        camera: &Camera,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) -> Option<()> {
        let this = &self.views[view];
        if !self.lens_is_free(view) {
            return Some(());
        }
        if camera.lens.pixel_aspect <= 0.0 {
            return None;
        }
        if !this.edges.is_empty() && !camera.lens.covers_image(this.size) {
            return None;
        }
        let scale = this.stage_1.sigma.recip();
        let is_free = this.lens_parameters();
        let free: Vec<usize> = (0..Lens::PARAMETERS).filter(|&k| is_free[k]).collect();
        for (edge, times) in this.edges.iter().zip(&this.edge_counts) {
            let scale = scale / times.sqrt();
            let (distances, columns) =
                straightness_with_jacobian([&camera.lens, &this.camera.lens], &edge.points, &free)?;
            for (i, distance) in distances.iter().enumerate() {
                let mut by_lens = [0.0; Lens::PARAMETERS];
                free.iter().zip(&columns).for_each(|(&k, column)| by_lens[k] = scale * column[i]);
                let mut by = [0.0; CAMERA_PARAMS];
                this.add_lens(&mut by, &by_lens);
                self.sink_view(view, scale * distance, &by, &[], ResidualKind::StraightEdge, sink);
            }
        }
        for prior in this.lens_prior_residuals(&camera.lens, &free, this.lens == view) {
            let mut by = [0.0; CAMERA_PARAMS];
            this.add_lens(&mut by, &prior.by);
            self.sink_view(view, prior.value, &by, &[], ResidualKind::CameraPrior, sink);
        }
        Some(())
    }

    /// Calls `sink` with the reprojection errors of all observations of a landmark, in standard deviations.
    fn each_observation(
        &self,
        state: &[f64],
        index: usize,
        params: &[f64; LANDMARK_PARAMS],
        poses: &[PosedCamera],
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) -> Option<()> {
        let landmark = &self.landmarks[index];
        let (ground, plane) = self.ground(state, index);
        for (observation, seen) in landmark.observations.iter().enumerate() {
            let kind = ResidualKind::Observation { landmark: index, observation };
            let pose = &poses[seen.view];
            let observed = if self.lens_is_free(seen.view) {
                self.undistort(seen.view, seen.pixel, &pose.camera.lens)
            } else {
                self.observed[index][observation]
            }?;
            for error in landmark.model.reprojection_error(params, seen.point, &ground, pose, &observed)? {
                let by = error.d_view.map(|derivative| derivative / seen.sigma);
                let own =
                    pack_free(&error.d_landmark.map(|derivative| derivative / seen.sigma), &landmark.free);
                let by_plane = error.d_plane.map(|derivative| derivative / seen.sigma);
                let plane = plane.map(|block| JacobianBlock { block, by: &by_plane });
                let (others, count) = compact_blocks([self.landmark_jacobian(index, &own), plane]);
                self.sink_view(seen.view, error.pixels / seen.sigma, &by, &others[..count], kind, sink);
            }
        }
        Some(())
    }

    /// Calls `sink` with `(value - prior) / sigma` for every prior on a free parameter of a landmark.
    fn each_landmark_prior(
        &self,
        index: usize,
        params: &[f64; LANDMARK_PARAMS],
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) {
        let landmark = &self.landmarks[index];
        for &(k, Prior { value, sigma }) in landmark.priors.iter().filter(|(k, _)| landmark.free[*k]) {
            let mut by = [0.0; LANDMARK_PARAMS];
            by[k] = sigma.recip();
            if let Some(jacobian) = self.landmark_jacobian(index, &pack_free(&by, &landmark.free)) {
                let kind = ResidualKind::LandmarkPrior { landmark: index };
                sink((params[k] - value) / sigma, &[jacobian], kind);
            }
        }
    }

    /// Calls `sink` with the residual of a measured distance, in standard deviations.
    fn each_distance(
        &self,
        state: &[f64],
        index: usize,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) {
        let distance = &self.distances[index];
        let grounds = distance.between.map(|landmark| self.ground(state, landmark));
        let of_end = |end: usize| {
            let landmark = distance.between[end];
            let (model, params) = (&self.landmarks[landmark].model, self.landmark_params(state, landmark));
            let rise = model.foot(&params).map_or([0.0; 3], |foot| grounds[end].0.height_by_parameters(foot));
            (model.anchor(&params, &grounds[end].0), rise)
        };
        let [(a, rise_a), (b, rise_b)] = [of_end(0), of_end(1)];
        let (residual, by, by_z) = distance_residual(distance, &[a, b]);
        let ends = distance.between.map(|landmark| &self.landmarks[landmark].free);
        let by = [pack_free(&by[0], ends[0]), pack_free(&by[1], ends[1])];
        let mut by_planes = [rise_a.map(|rise| rise * by_z), rise_b.map(|rise| -rise * by_z)];
        // A residual may list each block only once. If both ends are on one plane, their derivatives are
        // added.
        let on_one = grounds[0].1 == grounds[1].1;
        if on_one {
            by_planes[0] = std::array::from_fn(|k| by_planes[0][k] + by_planes[1][k]);
        }
        let plane = |end: usize| {
            let block = grounds[end].1.filter(|_| end == 0 || !on_one)?;
            Some(JacobianBlock { block, by: &by_planes[end] })
        };
        let own = |end: usize| self.landmark_jacobian(distance.between[end], &by[end]);
        let (blocks, count) = compact_blocks([own(0), own(1), plane(0), plane(1)]);
        sink(residual, &blocks[..count], ResidualKind::Distance { distance: index });
    }

    /// Returns the Jacobian block of a landmark from the derivatives with respect to its free parameters;
    /// `None` if no parameter is free.
    fn landmark_jacobian<'b>(
        &self,
        landmark: usize,
        by: &'b [f64; LANDMARK_PARAMS],
    ) -> Option<JacobianBlock<'b>> {
        let block = self.landmark_blocks[landmark]?;
        Some(JacobianBlock { block, by: &by[..self.blocks.sizes[block]] })
    }

    /// Calls `sink` with a residual of a view, in standard deviations. `by` contains its derivatives with
    /// respect to all camera parameters, and `others` its Jacobian blocks for other parameters.
    pub(crate) fn sink_view(
        &self,
        view: usize,
        residual: f64,
        by: &[f64; CAMERA_PARAMS],
        others: &[JacobianBlock],
        kind: ResidualKind,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) {
        let jacobian = CameraJacobian::new(by, &self.camera_layout[view], &self.blocks.sizes);
        jacobian.with(others, |jacobian| sink(residual, jacobian, kind));
    }

    /// Returns the normal equations at a state; `None` if the geometry is impossible.
    pub(crate) fn normal(&self, state: &[f64]) -> Option<NormalEquations> {
        let mut normal = self.blocks.normal();
        self.each_residual(state, |residual, jacobian, _| self.blocks.add(&mut normal, residual, jacobian))?;
        normal.cost.is_finite().then_some(normal)
    }
}

impl LeastSquares for BundleProblem<'_> {
    type State = Vec<f64>;
    type Normal = NormalEquations;

    fn first_damping(&self) -> f64 {
        // The damping must be tiny. In a long hall, the terms that constrain the relative rotation and scale
        // of distant cameras are a millionth of the diagonal.
        1e-9
    }

    fn linearize(&self, state: &Vec<f64>) -> Option<(f64, NormalEquations)> {
        let normal = self.normal(state)?;
        Some((normal.cost, normal))
    }

    fn step(&self, state: &Vec<f64>, normal: &NormalEquations, damping: f64) -> Option<(Vec<f64>, f64, f64)> {
        let (step, predicted) = self.blocks.step(normal, damping)?;
        let next = self.retract(state, &step);
        let relative = |(value, step): (&f64, &f64)| step.abs() / (1.0 + value.abs());
        let size = state.iter().zip(&step).map(relative).fold(0.0, f64::max);
        size.is_finite().then_some((next, predicted, size))
    }
}
