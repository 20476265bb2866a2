//! The bundle adjustment as one least-squares problem: the state, all residuals (`residuals.rs` lists them),
//! the normal equations.

use crate::bundle::camera::{CAMERA_PARAMS, View};
use crate::bundle::copies::Copies;
use crate::bundle::initialization::{CommonTilt, in_view};
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark};
use crate::bundle::local_similarity::LocalSimilarities;
use crate::bundle::parameters::parameters_of_plane;
use crate::bundle::parameters::{CameraLayout, ParameterLayout, parameters_of};
use crate::bundle::residuals::{CameraJacobian, ResidualKind, distance_residual, listed, of_free};
use crate::camera::{Camera, Covariance, Lens, ObservedPixel, Pixel, PosedCamera};
use crate::optimize::{BlockStructure, JacobianBlock, LeastSquares, NormalEquations};
use crate::single::{PlanePrior, Prior, edge_redundancy, straightness_with_jacobian};

/// Views, landmarks and distances, with the position of every parameter in the state.
#[derive(Clone, Debug)]
pub(crate) struct BundleProblem<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) landmarks: Vec<Landmark>,
    pub(crate) distances: Vec<DistanceMeasurement>,
    /// How often landmarks and distances are there.
    copies: Copies,
    pub(crate) blocks: BlockStructure,
    pub(crate) camera_layout: Vec<CameraLayout>,
    /// Block of every nuisance parameter of stage 1 of every view, and its place there.
    pub(crate) nuisance_places: Vec<Vec<Option<(usize, usize)>>>,
    /// Block of the free parameters of every landmark.
    landmark_blocks: Vec<Option<usize>>,
    /// Planes besides the floor.
    pub(crate) planes: Vec<PlanePrior>,
    /// Block of every plane that is estimated.
    pub(crate) plane_blocks: Vec<Option<usize>>,
    /// The tilt of the floor that views share.
    pub(crate) tilt: Option<CommonTilt>,
    /// Of what sees something in common.
    pub(crate) similarities: Option<LocalSimilarities>,
    /// Observed pixels, undistorted, where the lens is not estimated.
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
            nuisance_places: nuisances,
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

    fn undistort(&self, view: usize, pixel: Pixel, lens: &Lens) -> Option<ObservedPixel> {
        let this = &self.views[view];
        ObservedPixel::in_chart_of(&this.camera.lens, pixel, lens, this.lens_parameters())
    }

    pub(crate) fn lens_is_free(&self, view: usize) -> bool {
        self.views[view].lens_parameters().contains(&true)
    }

    /// The state that views and landmarks start from.
    pub(crate) fn start(&self) -> Vec<f64> {
        let mut state = vec![0.0; self.blocks.unknowns()];
        let mut set = |block: usize, place: usize, value: f64| {
            state[self.blocks.at((block, place))] = value;
        };
        for (view, layout) in self.views.iter().zip(&self.camera_layout) {
            for (parameter, value) in layout.iter().zip(parameters_of(&view.camera)) {
                parameter.iter().for_each(|&(block, place)| set(block, place, value));
            }
        }
        for (view, places) in self.views.iter().zip(&self.nuisance_places) {
            // A tilt in common starts from none.
            let is_own = |place: &(usize, usize)| self.tilt.is_none_or(|tilt| tilt.block != place.0);
            for (place, value) in places.iter().zip(&view.nuisance) {
                place.filter(is_own).iter().for_each(|&(block, place)| set(block, place, *value));
            }
        }
        for (plane, block) in self.planes.iter().zip(&self.plane_blocks) {
            let values = parameters_of_plane(&plane.plane).into_iter().enumerate();
            block.iter().for_each(|&block| values.clone().for_each(|(k, value)| set(block, k, value)));
        }
        for (landmark, block) in self.landmarks.iter().zip(&self.landmark_blocks) {
            let free = (0..LANDMARK_PARAMS).filter(|&k| landmark.free[k]);
            for (i, k) in free.enumerate() {
                block.iter().for_each(|&block| set(block, i, landmark.place[k]));
            }
        }
        state
    }

    /// A camera at a state, its covariance left as it was.
    pub(crate) fn camera(&self, state: &[f64], view: usize) -> Camera {
        let camera = self.views[view].camera;
        let mut values = parameters_of(&camera);
        for (value, parameter) in values.iter_mut().zip(&self.camera_layout[view]) {
            if let Some(at) = parameter {
                *value = state[self.blocks.at(*at)];
            }
        }
        let [x, y, z, yaw, pitch, roll, log_focal, a, b, c, d, e, u, v] = values;
        // A fixed focal keeps its last bit.
        let fits_focal = self.camera_layout[view][Covariance::FOCAL].is_some();
        let focal = if fits_focal { log_focal.exp() } else { camera.focal };
        let lens = Lens {
            principal_point: Pixel { u, v },
            focal: if self.views[view].has_one_focal { focal } else { camera.lens.focal },
            distortion: camera.lens.distortion.with_coefficients([a, b, c, d, e]),
            image_circle: None,
        };
        Camera { position: [x, y, z].into(), yaw, pitch, roll, focal, lens, ..camera }
    }

    /// The parameters of a landmark at a state.
    pub(crate) fn place(&self, state: &[f64], landmark: usize) -> [f64; LANDMARK_PARAMS] {
        let mut place = self.landmarks[landmark].place;
        let free = (0..LANDMARK_PARAMS).filter(|&k| self.landmarks[landmark].free[k]);
        for (i, k) in free.enumerate() {
            if let Some(block) = self.landmark_blocks[landmark] {
                place[k] = state[self.blocks.at((block, i))];
            }
        }
        place
    }

    /// Nuisance parameters of stage 1 of a view at a state.
    pub(crate) fn nuisance(&self, state: &[f64], view: usize) -> Vec<f64> {
        let values = self.views[view].nuisance.iter().zip(&self.nuisance_places[view]);
        let value = |at: (usize, usize)| state[self.blocks.at(at)];
        let mut values: Vec<f64> = values.map(|(&start, place)| place.map_or(start, value)).collect();
        if let Some((at, lean, yaw)) = self.common_tilt(state, view) {
            values[at..at + 2].copy_from_slice(&in_view(lean, yaw));
        }
        self.set_planes(state, view, &mut values);
        values
    }

    /// Block of the free parameters of a landmark.
    pub(crate) fn landmark_block(&self, landmark: usize) -> Option<usize> {
        self.landmark_blocks[landmark]
    }

    /// Block and place of every parameter of a view.
    pub(crate) fn camera_layout(&self, view: usize) -> &CameraLayout {
        &self.camera_layout[view]
    }

    /// Degrees of freedom of so many residuals: without parameters, and what edges and copies say again.
    pub(crate) fn dof(&self, residuals: usize) -> i64 {
        // The line through the points of an edge has two parameters, which are eliminated, and an edge that is
        // drawn again is one.
        let beyond = |view: &View| {
            let points: usize = view.edges.iter().map(|edge| edge.points.len()).sum();
            points as i64 - edge_redundancy(view.edges.iter(), &view.edge_times)
        };
        let edges: i64 = self.views.iter().map(beyond).sum();
        let repeated: i64 = self.views.iter().map(|view| view.stage_1.repeated()).sum::<i64>()
            + self.copies.repeated(&self.landmarks, &self.distances);
        residuals as i64 - repeated - edges - self.blocks.unknowns() as i64
    }

    /// Calls `sink` with every residual in sigmas, its derivatives, and what it belongs to.
    ///
    /// `None` where the geometry is impossible: a landmark behind a camera that observes it, a length above
    /// the horizon, a lens that folds back on itself.
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
            let place = self.place(state, landmark);
            self.each_observation(state, landmark, &place, &poses, &mut sink)?;
            self.each_landmark_prior(landmark, &place, &mut sink);
        }
        for distance in (0..self.distances.len()).filter(|&distance| !self.distances[distance].off) {
            self.distance(state, distance, &mut sink);
        }
        Some(())
    }

    /// Straightness of the edges, in raw pixels, and what is believed of lenses, where the lens is fitted.
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
        if !this.edges.is_empty() && !camera.lens.shows_image(this.size) {
            return None;
        }
        let scale = this.stage_1.sigma.recip();
        let is_free = this.lens_parameters();
        let free: Vec<usize> = (0..Lens::PARAMETERS).filter(|&k| is_free[k]).collect();
        for (edge, times) in this.edges.iter().zip(&this.edge_times) {
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
        // What is believed of a lens that several views have counts once.
        if this.lens == view {
            for believed in this.beliefs(&camera.lens, &free) {
                let mut by = [0.0; CAMERA_PARAMS];
                this.add_lens(&mut by, &believed.by);
                self.sink_view(view, believed.value, &by, &[], ResidualKind::CameraPrior, sink);
            }
        }
        Some(())
    }

    /// The reprojection errors of a landmark.
    fn each_observation(
        &self,
        state: &[f64],
        index: usize,
        place: &[f64; LANDMARK_PARAMS],
        poses: &[PosedCamera],
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) -> Option<()> {
        let landmark = &self.landmarks[index];
        let kind = ResidualKind::Observation { landmark: index };
        let (ground, plane) = self.ground(state, index);
        for (observation, seen) in landmark.observations.iter().enumerate() {
            let pose = &poses[seen.view];
            let observed = if self.lens_is_free(seen.view) {
                self.undistort(seen.view, seen.pixel, &pose.camera.lens)
            } else {
                self.observed[index][observation]
            }?;
            for error in landmark.model.reprojection_error(place, seen.point, &ground, pose, &observed)? {
                let by = error.d_view.map(|derivative| derivative / seen.sigma);
                let own =
                    of_free(&error.d_landmark.map(|derivative| derivative / seen.sigma), &landmark.free);
                let by_plane = error.d_plane.map(|derivative| derivative / seen.sigma);
                let plane = plane.map(|block| JacobianBlock { block, by: &by_plane });
                let (others, count) = listed([self.landmark_jacobian(index, &own), plane]);
                self.sink_view(seen.view, error.pixels / seen.sigma, &by, &others[..count], kind, sink);
            }
        }
        Some(())
    }

    /// `(value - prior) / sigma` for every prior on a free parameter of a landmark.
    fn each_landmark_prior(
        &self,
        index: usize,
        place: &[f64; LANDMARK_PARAMS],
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) {
        let landmark = &self.landmarks[index];
        for &(k, Prior { value, sigma }) in landmark.priors.iter().filter(|(k, _)| landmark.free[*k]) {
            let mut by = [0.0; LANDMARK_PARAMS];
            by[k] = sigma.recip();
            if let Some(jacobian) = self.landmark_jacobian(index, &of_free(&by, &landmark.free)) {
                let kind = ResidualKind::LandmarkPrior { landmark: index };
                sink((place[k] - value) / sigma, &[jacobian], kind);
            }
        }
    }

    fn distance(
        &self,
        state: &[f64],
        index: usize,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualKind),
    ) {
        let distance = &self.distances[index];
        let grounds = distance.between.map(|landmark| self.ground(state, landmark));
        let of_end = |end: usize| {
            let landmark = distance.between[end];
            let (model, place) = (&self.landmarks[landmark].model, self.place(state, landmark));
            let rise = model.foot(&place).map_or([0.0; 3], |foot| grounds[end].0.height_by_parameters(foot));
            (model.anchor(&place, &grounds[end].0), rise)
        };
        let [(a, rise_a), (b, rise_b)] = [of_end(0), of_end(1)];
        let (residual, by, by_z) = distance_residual(distance, &[a, b]);
        let ends = distance.between.map(|landmark| &self.landmarks[landmark].free);
        let by = [of_free(&by[0], ends[0]), of_free(&by[1], ends[1])];
        let mut by_planes = [rise_a.map(|rise| rise * by_z), rise_b.map(|rise| -rise * by_z)];
        // A residual has a block once: both ends on one plane are moved by it together.
        let on_one = grounds[0].1 == grounds[1].1;
        if on_one {
            by_planes[0] = std::array::from_fn(|k| by_planes[0][k] + by_planes[1][k]);
        }
        let plane = |end: usize| {
            let block = grounds[end].1.filter(|_| end == 0 || !on_one)?;
            Some(JacobianBlock { block, by: &by_planes[end] })
        };
        let own = |end: usize| self.landmark_jacobian(distance.between[end], &by[end]);
        let (blocks, count) = listed([own(0), own(1), plane(0), plane(1)]);
        sink(residual, &blocks[..count], ResidualKind::Distance { distance: index });
    }

    /// Derivatives by the free parameters of a landmark, if it has any.
    fn landmark_jacobian<'b>(
        &self,
        landmark: usize,
        by: &'b [f64; LANDMARK_PARAMS],
    ) -> Option<JacobianBlock<'b>> {
        let block = self.landmark_blocks[landmark]?;
        Some(JacobianBlock { block, by: &by[..self.blocks.sizes[block]] })
    }

    /// Calls `sink` with a residual of a view, its derivatives sorted into blocks.
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

    /// Normal equations at a state; `None` where the geometry is impossible.
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
        // Next to nothing: what holds a hall of cameras to one scale and straight is a millionth of the diagonal.
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
