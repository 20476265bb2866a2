//! Problem 3: cameras, lenses and the landmarks they have in common, all at once, every residual in pixels.
//!
//! The residuals of stage 1 stay in it: without them roll, pitch and focal would drift to suit the
//! links. Unknowns of one camera stand in one block with its lens, unless the lens is shared; landmarks and
//! the directions and lengths of stage 1 touch few cameras and are eliminated. A landmark at the end of a
//! measured distance is kept.

use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark};
use crate::bundle::parameters::{CAMERA_PARAMS, CameraLayout, LayoutBuilder};
use crate::camera::{Camera, Covariance, Distortion, Lens, ObservedPixel, POSE_PARAMS, PosedCamera};
use crate::optimize::{BlockStructure, Dual, JacobianBlock, LeastSquares, NormalEquations};
use crate::single::{
    Annotation, Constraints, Edge, LOG_FOCAL, LOG_HEIGHT, PITCH, Prior, Problem, ROLL, Source, State,
    straightness_with_slopes,
};

/// A camera with what was drawn on it.
#[derive(Clone, Debug)]
pub(crate) struct View<'a> {
    /// Where it starts, and the values of what is held.
    pub(crate) camera: Camera,
    /// Which of its unknowns are free; those of the lens are those of the first view that has it.
    pub(crate) free: [bool; CAMERA_PARAMS],
    /// Index of the lens, focal included; views with the same index share it.
    pub(crate) lens: usize,
    /// What was drawn, for evidence under another lens.
    pub(crate) annotations: &'a [Annotation],
    /// Evidence, priors and what was rejected, under the lens it starts with.
    pub(crate) stage_1: Problem<'a>,
    /// Directions and lengths of stage 1, where they start.
    pub(crate) nuisance: Vec<f64>,
    /// Lines that are straight in space.
    pub(crate) edges: Vec<Edge>,
    /// Width and height of the image, in pixels.
    pub(crate) size: [f64; 2],
}

/// All of it, with a place for every unknown.
#[derive(Clone, Debug)]
pub(crate) struct BundleProblem<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) landmarks: Vec<Landmark>,
    pub(crate) measurements: Vec<DistanceMeasurement>,
    pub(crate) blocks: BlockStructure,
    /// Block and place in it of every unknown of every view.
    camera_layout: Vec<CameraLayout>,
    /// Block of every direction and length of every view.
    nuisance_blocks: Vec<Vec<Option<usize>>>,
    /// Block and places of every landmark's unknowns.
    places: Vec<Option<usize>>,
    /// Drawn pixels without the lens, where it is held.
    observed: Vec<Vec<Option<ObservedPixel>>>,
}

/// What a residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ResidualBlock {
    /// A drawing of a view.
    Annotation { view: usize, source: Source },
    /// A point of an edge of a view.
    StraightEdge { view: usize },
    /// A prior about a view.
    Prior,
    /// An observation of a landmark.
    Observation { landmark: usize, observation: usize },
    /// A prior about a landmark's place.
    LandmarkPrior { landmark: usize },
    /// A measured distance.
    Distance { measurement: usize },
}

/// Residuals of stage 1: value in sigmas, derivatives by its core, unknown beside it, and source.
type Rows = Vec<(f64, [f64; 4], Option<(usize, f64)>, Option<Source>)>;

/// Step of differences by coefficients: a thousandth of a pixel in the corner.
const STEP: f64 = 1e-6;

impl<'a> BundleProblem<'a> {
    /// Gives every unknown its place.
    pub(crate) fn new(
        views: Vec<View<'a>>,
        landmarks: Vec<Landmark>,
        measurements: Vec<DistanceMeasurement>,
    ) -> Self {
        let mut layout = LayoutBuilder::default();
        let lenses = views.iter().map(|view| view.lens + 1).max().unwrap_or(0);
        let users = |lens: usize| views.iter().filter(move |view| view.lens == lens);
        let shared: Vec<Option<usize>> = (0..lenses)
            .map(|lens| {
                let first = users(lens).next().filter(|_| users(lens).count() > 1)?;
                layout.block(first.free[Covariance::FOCAL..].iter().filter(|&&free| free).count(), true)
            })
            .collect();
        let camera_layout: Vec<_> =
            views.iter().map(|view| layout.camera_layout(&view.free, shared[view.lens])).collect();
        let nuisance_blocks: Vec<_> = views
            .iter()
            .zip(&camera_layout)
            .map(|(view, camera_layout)| layout.nuisance_blocks(&view.stage_1.used(), camera_layout))
            .collect();
        let on = measurements.iter().filter(|measurement| !measurement.off);
        let kept: std::collections::HashSet<usize> =
            on.clone().flat_map(|measurement| measurement.between).collect();
        let places: Vec<_> = landmarks
            .iter()
            .enumerate()
            .map(|(index, landmark)| {
                let free = landmark.free.iter().filter(|&&free| free && !landmark.off).count();
                layout.block(free, kept.contains(&index))
            })
            .collect();
        for (landmark, &place) in landmarks.iter().zip(&places).filter(|(landmark, _)| !landmark.off) {
            for view in landmark.views() {
                layout.common(camera_layout[view].iter().flatten().map(|parameter| parameter.0).chain(place));
            }
        }
        for measurement in on {
            layout.common(measurement.between.iter().filter_map(|&landmark| places[landmark]));
        }
        let blocks = BlockStructure::new(layout.sizes, &layout.keep, &layout.common);
        let mut problem = Self {
            views,
            landmarks,
            measurements,
            blocks,
            camera_layout,
            nuisance_blocks,
            places,
            observed: Vec::new(),
        };
        let observations = |landmark: &Landmark| -> Vec<Option<ObservedPixel>> {
            landmark
                .observations
                .iter()
                .map(|seen| problem.draw(seen.view, seen.pixel, &problem.views[seen.view].camera.lens))
                .collect()
        };
        problem.observed = problem.landmarks.iter().map(observations).collect();
        problem
    }

    fn draw(&self, view: usize, pixel: crate::camera::Pixel, lens: &Lens) -> Option<ObservedPixel> {
        let fitted = std::array::from_fn(|k| self.camera_layout[view][POSE_PARAMS + k].is_some());
        ObservedPixel::new(pixel, lens, fitted)
    }

    fn lens_is_free(&self, view: usize) -> bool {
        self.camera_layout[view][POSE_PARAMS..].iter().any(Option::is_some)
    }

    /// The values of all unknowns that the views and landmarks start from.
    pub(crate) fn start(&self) -> Vec<f64> {
        let mut state = vec![0.0; self.blocks.unknowns()];
        for (view, camera_layout) in self.views.iter().zip(&self.camera_layout) {
            let values = unknowns_of(&view.camera);
            for (parameter, value) in camera_layout.iter().zip(values) {
                if let Some((block, place)) = parameter {
                    state[self.blocks.offsets[*block] + place] = value;
                }
            }
        }
        for (view, blocks) in self.views.iter().zip(&self.nuisance_blocks) {
            for (block, value) in blocks.iter().zip(&view.nuisance) {
                if let Some(block) = block {
                    state[self.blocks.offsets[*block]] = *value;
                }
            }
        }
        for (landmark, place) in self.landmarks.iter().zip(&self.places) {
            let free = (0..LANDMARK_PARAMS).filter(|&k| landmark.free[k]);
            for (i, k) in free.enumerate() {
                if let Some(block) = place {
                    state[self.blocks.offsets[*block] + i] = landmark.place[k];
                }
            }
        }
        state
    }

    /// A camera at a state, its covariance left as it was.
    pub(crate) fn camera(&self, state: &[f64], view: usize) -> Camera {
        let mut values = unknowns_of(&self.views[view].camera);
        for (value, parameter) in values.iter_mut().zip(&self.camera_layout[view]) {
            if let Some((block, place)) = parameter {
                *value = state[self.blocks.offsets[*block] + place];
            }
        }
        let [x, y, z, yaw, pitch, roll, log_focal, coefficients @ ..] = values;
        let camera = self.views[view].camera;
        let focal = if self.camera_layout[view][Covariance::FOCAL].is_some() {
            log_focal.exp()
        } else {
            camera.focal
        };
        let distortion = camera.lens.distortion.with_coefficients(coefficients);
        let lens = Lens { distortion, ..camera.lens };
        Camera { position: [x, y, z].into(), yaw, pitch, roll, focal, lens, ..camera }
    }

    /// Where a landmark is at a state.
    pub(crate) fn place(&self, state: &[f64], landmark: usize) -> [f64; LANDMARK_PARAMS] {
        let mut place = self.landmarks[landmark].place;
        let free = (0..LANDMARK_PARAMS).filter(|&k| self.landmarks[landmark].free[k]);
        for (i, k) in free.enumerate() {
            if let Some(block) = self.places[landmark] {
                place[k] = state[self.blocks.offsets[block] + i];
            }
        }
        place
    }

    /// Directions and lengths of a view at a state.
    pub(crate) fn nuisance(&self, state: &[f64], view: usize) -> Vec<f64> {
        let values = self.views[view].nuisance.iter().zip(&self.nuisance_blocks[view]);
        values.map(|(&start, block)| block.map_or(start, |b| state[self.blocks.offsets[b]])).collect()
    }

    /// Block of a landmark's free unknowns.
    pub(crate) fn landmark_block(&self, landmark: usize) -> Option<usize> {
        self.places[landmark]
    }

    /// Block and place of every unknown of a view.
    pub(crate) fn camera_layout(&self, view: usize) -> &CameraLayout {
        &self.camera_layout[view]
    }

    /// Residuals less unknowns.
    pub(crate) fn dof(&self, state: &[f64]) -> Option<i64> {
        let mut count = 0_i64;
        self.each_residual(state, |_, _, _| count += 1)?;
        // A line through an edge's points has two unknowns of its own.
        let edges: i64 = self.views.iter().map(|view| view.edges.len() as i64).sum();
        Some(count - 2 * edges - self.blocks.unknowns() as i64)
    }

    /// Calls `sink` with every residual in sigmas, its derivatives, and what it belongs to.
    ///
    /// `None` where the geometry is impossible: something seen is behind its camera, a length above the
    /// horizon, a lens that folds back on itself.
    pub(crate) fn each_residual(
        &self,
        state: &[f64],
        mut sink: impl FnMut(f64, &[JacobianBlock], ResidualBlock),
    ) -> Option<()> {
        let cameras: Vec<Camera> = (0..self.views.len()).map(|view| self.camera(state, view)).collect();
        for (view, camera) in cameras.iter().enumerate() {
            self.each_annotation(state, view, camera, &mut sink)?;
            self.each_edge(view, camera, &mut sink)?;
        }
        let poses: Vec<PosedCamera> = cameras.into_iter().map(PosedCamera::new).collect();
        for landmark in (0..self.landmarks.len()).filter(|&landmark| !self.landmarks[landmark].off) {
            self.each_observation(state, landmark, &poses, &mut sink)?;
        }
        for (index, measurement) in
            self.measurements.iter().enumerate().filter(|(_, measurement)| !measurement.off)
        {
            self.distance_residual(state, measurement, |residual, jacobian| {
                sink(residual, jacobian, ResidualBlock::Distance { measurement: index })
            })?;
        }
        Some(())
    }

    /// The residuals of stage 1, and of the prior on the camera.
    fn each_annotation(
        &self,
        state: &[f64],
        view: usize,
        camera: &Camera,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualBlock),
    ) -> Option<()> {
        let this = &self.views[view];
        let height = camera.position.z;
        let parameters = [camera.roll, camera.pitch, camera.focal.ln(), height.ln()];
        // A camera below the floor has no log height; evidence that asks for it is impossible there.
        let parameters = if height > 0.0 {
            parameters
        } else {
            [parameters[0], parameters[1], parameters[2], f64::NEG_INFINITY]
        };
        let stage_1 = State { parameters, nuisance: self.nuisance(state, view) };
        let is_free = self.lens_is_free(view);
        let constraints = is_free.then(|| Constraints::new(this.annotations, &camera.lens, false));
        let rows = rows(&this.stage_1, constraints.as_ref(), &stage_1)?;
        let d_lens =
            if is_free { self.rows_by_lens(view, camera, &stage_1, rows.len())? } else { Vec::new() };
        for (i, (residual, jacobian, nuisance_blocks, source)) in rows.iter().enumerate() {
            let mut by = [0.0; CAMERA_PARAMS];
            by[Covariance::ROLL] = jacobian[ROLL];
            by[Covariance::PITCH] = jacobian[PITCH];
            by[Covariance::FOCAL] = jacobian[LOG_FOCAL];
            by[Covariance::Z] = if height > 0.0 { jacobian[LOG_HEIGHT] / height } else { 0.0 };
            for (k, column) in &d_lens {
                by[POSE_PARAMS + k] = column[i];
            }
            let own = nuisance_blocks
                .and_then(|(index, jacobian)| Some((self.nuisance_blocks[view][index]?, [jacobian])));
            let of = source.map_or(ResidualBlock::Prior, |source| ResidualBlock::Annotation { view, source });
            self.sink_view(
                view,
                *residual,
                &by,
                own.as_ref().map(|(block, by)| JacobianBlock { block: *block, by }),
                of,
                sink,
            );
        }
        Some(())
    }

    /// Derivatives of the residuals of stage 1 by every coefficient that is free, by differences: a coefficient
    /// moves the ends of a segment, the noise that whitens its residual, which is the derivative of the
    /// undistortion there, and the spread of a polyline. The chain through all three, for every kind of residual,
    /// is longer than these residuals are, and one evaluation serves a whole column.
    fn rows_by_lens(
        &self,
        view: usize,
        camera: &Camera,
        stage_1: &State,
        count: usize,
    ) -> Option<Vec<(usize, Vec<f64>)>> {
        let this = &self.views[view];
        let free = (0..Distortion::MOST).filter(|&k| self.camera_layout[view][POSE_PARAMS + k].is_some());
        free.map(|k| {
            let at = |by: f64| {
                let lens = camera.nudged(POSE_PARAMS + k, by).lens;
                let constraints = Constraints::new(this.annotations, &lens, false);
                rows(&this.stage_1, Some(&constraints), stage_1).filter(|rows| rows.len() == count)
            };
            let (ahead, behind) = (at(STEP)?, at(-STEP)?);
            Some((k, ahead.iter().zip(&behind).map(|(a, b)| (a.0 - b.0) / (2.0 * STEP)).collect()))
        })
        .collect()
    }

    /// Straightness of the edges, in raw pixels, where the lens is fitted to them.
    fn each_edge(
        &self,
        view: usize,
        camera: &Camera,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualBlock),
    ) -> Option<()> {
        let this = &self.views[view];
        if !self.lens_is_free(view) || this.edges.is_empty() {
            return Some(());
        }
        if !camera.lens.shows_image(this.size) {
            return None;
        }
        let scale = this.stage_1.sigma.recip();
        let free: Vec<usize> =
            (0..Distortion::MOST).filter(|&k| self.camera_layout[view][POSE_PARAMS + k].is_some()).collect();
        for edge in &this.edges {
            let (distances, columns) = straightness_with_slopes(&camera.lens, &edge.points, &free)?;
            for (i, distance) in distances.iter().enumerate() {
                let mut by = [0.0; CAMERA_PARAMS];
                for (&k, column) in free.iter().zip(&columns) {
                    by[POSE_PARAMS + k] = scale * column[i];
                }
                self.sink_view(view, scale * distance, &by, None, ResidualBlock::StraightEdge { view }, sink);
            }
        }
        Some(())
    }

    /// Where cameras show a landmark against where it was drawn, and the prior on its place.
    fn each_observation(
        &self,
        state: &[f64],
        index: usize,
        poses: &[PosedCamera],
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualBlock),
    ) -> Option<()> {
        let landmark = &self.landmarks[index];
        let place = self.place(state, index);
        let free: Vec<usize> = (0..LANDMARK_PARAMS).filter(|&k| landmark.free[k]).collect();
        for (observation, seen) in landmark.observations.iter().enumerate() {
            let pose = &poses[seen.view];
            let observed = if self.lens_is_free(seen.view) {
                self.draw(seen.view, seen.pixel, &pose.camera.lens)
            } else {
                self.observed[index][observation]
            }?;
            let of = ResidualBlock::Observation { landmark: index, observation };
            for row in landmark.model.reprojection_error(&place, seen.point, pose, &observed)? {
                let by = row.d_view.map(|jacobian| jacobian / seen.sigma);
                let mut own = [0.0; LANDMARK_PARAMS];
                for (i, &k) in free.iter().enumerate() {
                    own[i] = row.d_landmark[k] / seen.sigma;
                }
                let own = self.places[index].map(|block| JacobianBlock { block, by: &own[..free.len()] });
                self.sink_view(seen.view, row.off / seen.sigma, &by, own, of, sink);
            }
        }
        for &(k, Prior { value, sigma }) in &landmark.priors {
            let mut own = [0.0; LANDMARK_PARAMS];
            if let (Some(i), Some(block)) = (free.iter().position(|&f| f == k), self.places[index]) {
                own[i] = sigma.recip();
                let jacobian = JacobianBlock { block, by: &own[..free.len()] };
                sink(
                    (place[k] - value) / sigma,
                    &[jacobian],
                    ResidualBlock::LandmarkPrior { landmark: index },
                );
            }
        }
        Some(())
    }

    /// `(|A - B| - length) / sigma`.
    fn distance_residual(
        &self,
        state: &[f64],
        measurement: &DistanceMeasurement,
        mut sink: impl FnMut(f64, &[JacobianBlock]),
    ) -> Option<()> {
        let ends = measurement
            .between
            .map(|landmark| self.landmarks[landmark].model.anchor(&self.place(state, landmark)));
        let [a, b] = [ends[0].0, ends[1].0].map(<[f64; 3]>::from);
        let way: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
        let length = crate::camera::dot(&way, &way).sqrt();
        // Of two landmarks at one place no way is the shorter one.
        let way = if length > 0.0 { way.map(|along| along / length) } else { [0.0; 3] };
        let mut by = [[0.0; LANDMARK_PARAMS]; 2];
        for (end, jacobian) in by.iter_mut().enumerate() {
            let sign = if end == 0 { 1.0 } else { -1.0 };
            let free = (0..LANDMARK_PARAMS).filter(|&k| self.landmarks[measurement.between[end]].free[k]);
            for (i, k) in free.enumerate() {
                let along: f64 = (0..3).map(|axis| way[axis] * ends[end].1[axis][k]).sum();
                jacobian[i] = sign * along / measurement.length.sigma;
            }
        }
        let jacobian: Vec<JacobianBlock> = (0..2)
            .filter_map(|end| {
                let block = self.places[measurement.between[end]]?;
                Some(JacobianBlock { block, by: &by[end][..self.blocks.sizes[block]] })
            })
            .collect();
        sink((length - measurement.length.value) / measurement.length.sigma, &jacobian);
        Some(())
    }

    /// Hands on a residual of a view with its derivatives sorted into blocks.
    fn sink_view(
        &self,
        view: usize,
        residual: f64,
        by: &[f64; CAMERA_PARAMS],
        own: Option<JacobianBlock>,
        of: ResidualBlock,
        sink: &mut impl FnMut(f64, &[JacobianBlock], ResidualBlock),
    ) {
        let mut sorted = [(usize::MAX, [0.0; CAMERA_PARAMS], 0_usize); 2];
        for (parameter, jacobian) in self.camera_layout[view].iter().zip(by) {
            let Some((block, place)) = parameter else { continue };
            let which = usize::from(sorted[0].0 != usize::MAX && sorted[0].0 != *block);
            sorted[which].0 = *block;
            sorted[which].1[*place] = *jacobian;
            sorted[which].2 = self.blocks.sizes[*block];
        }
        let mut jacobian = [JacobianBlock { block: 0, by: &[] }; 3];
        let mut count = 0;
        for (block, by, size) in &sorted {
            if *size > 0 {
                jacobian[count] = JacobianBlock { block: *block, by: &by[..*size] };
                count += 1;
            }
        }
        if let Some(own) = own {
            jacobian[count] = own;
            count += 1;
        }
        sink(residual, &jacobian[..count], of);
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

    fn linearize(&self, state: &Vec<f64>) -> Option<(f64, NormalEquations)> {
        let normal = self.normal(state)?;
        Some((normal.cost, normal))
    }

    fn step(&self, state: &Vec<f64>, normal: &NormalEquations, damping: f64) -> Option<(Vec<f64>, f64, f64)> {
        let (step, promised) = self.blocks.step(normal, damping)?;
        let next: Vec<f64> = state.iter().zip(&step).map(|(value, step)| value + step).collect();
        let relative = |(value, step): (&f64, &f64)| step.abs() / (1.0 + value.abs());
        let size = state.iter().zip(&step).map(relative).fold(0.0, f64::max);
        size.is_finite().then_some((next, promised, size))
    }
}

/// x, y, z, yaw, pitch, roll, log focal and the coefficients.
fn unknowns_of(camera: &Camera) -> [f64; CAMERA_PARAMS] {
    let [x, y, z] = camera.position.into();
    let [a, b, c, d, e] = camera.lens.distortion.coefficients();
    [x, y, z, camera.yaw, camera.pitch, camera.roll, camera.focal.ln(), a, b, c, d, e]
}

/// All residuals of stage 1 under other evidence than its own, if any is given.
fn rows(problem: &Problem, constraints: Option<&Constraints>, state: &State) -> Option<Rows> {
    let mut rows = Rows::new();
    let mut sink = |residual: Dual, nuisance_blocks, source| {
        rows.push((residual.value, residual.gradient, nuisance_blocks, source))
    };
    match constraints {
        Some(constraints) => Problem { constraints, ..problem.clone() }.each_residual(state, &mut sink)?,
        None => problem.each_residual(state, &mut sink)?,
    }
    Some(rows)
}
