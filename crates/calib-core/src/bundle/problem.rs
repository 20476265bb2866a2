//! Problem 3: cameras, lenses and the things they have in common, all at once, every residual in pixels.
//!
//! The residuals of stage 1 stay in it: without them roll, pitch and focal would drift to suit the
//! links. Unknowns of one camera stand in one block with its lens, unless the lens is shared; things and
//! the directions and lengths of stage 1 touch few cameras and are eliminated. A thing at the end of a
//! measured distance is kept.

use crate::bundle::landmark::{Gap, PLACE, Tie};
use crate::bundle::parameters::{Layout, Slots, VIEW};
use crate::camera::{Camera, Covariance, Distortion, Drawn, Lens, POSE, Pose};
use crate::optimize::{BlockNormal, Blocks, Dual, LeastSquares, Slope};
use crate::single::{
    Annotation, Edge, Evidence, LOG_FOCAL, LOG_HEIGHT, PITCH, Prior, Problem, ROLL, Source, State,
    straightness,
};

/// A camera with what was drawn on it.
#[derive(Clone, Debug)]
pub(crate) struct View<'a> {
    /// Where it starts, and the values of what is held.
    pub(crate) camera: Camera,
    /// Which of its unknowns are free; those of the lens are those of the first view that has it.
    pub(crate) free: [bool; VIEW],
    /// Index of the lens, focal included; views with the same index share it.
    pub(crate) lens: usize,
    /// What was drawn, for evidence under another lens.
    pub(crate) annotations: &'a [Annotation],
    /// Evidence, beliefs and what was set aside, under the lens it starts with.
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
pub(crate) struct Joint<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) ties: Vec<Tie>,
    pub(crate) gaps: Vec<Gap>,
    pub(crate) blocks: Blocks,
    /// Block and place in it of every unknown of every view.
    slots: Vec<Slots>,
    /// Block of every direction and length of every view.
    beside: Vec<Vec<Option<usize>>>,
    /// Block and places of every tie's unknowns.
    places: Vec<Option<usize>>,
    /// Drawn pixels without the lens, where it is held.
    drawn: Vec<Vec<Option<Drawn>>>,
}

/// What a residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Of {
    /// A drawing of a view.
    Drawing { view: usize, source: Source },
    /// A point of an edge of a view.
    Edge { view: usize },
    /// A belief about a view.
    Belief,
    /// A sighting of a tie.
    Sighting { tie: usize, sighting: usize },
    /// A belief about a tie's place.
    Place { tie: usize },
    /// A measured distance.
    Gap { gap: usize },
}

/// Residuals of stage 1: value in sigmas, slopes by its core, unknown beside it, and source.
type Rows = Vec<(f64, [f64; 4], Option<(usize, f64)>, Option<Source>)>;

/// Step of differences by coefficients: a thousandth of a pixel in the corner.
const STEP: f64 = 1e-6;

impl<'a> Joint<'a> {
    /// Gives every unknown its place.
    pub(crate) fn new(views: Vec<View<'a>>, ties: Vec<Tie>, gaps: Vec<Gap>) -> Self {
        let mut layout = Layout::default();
        let lenses = views.iter().map(|view| view.lens + 1).max().unwrap_or(0);
        let users = |lens: usize| views.iter().filter(move |view| view.lens == lens);
        let shared: Vec<Option<usize>> = (0..lenses)
            .map(|lens| {
                let first = users(lens).next().filter(|_| users(lens).count() > 1)?;
                layout.block(first.free[Covariance::FOCAL..].iter().filter(|&&free| free).count(), true)
            })
            .collect();
        let slots: Vec<_> = views.iter().map(|view| layout.slots(&view.free, shared[view.lens])).collect();
        let beside: Vec<_> = views
            .iter()
            .zip(&slots)
            .map(|(view, slots)| layout.beside(&view.stage_1.used(), slots))
            .collect();
        let on = gaps.iter().filter(|gap| !gap.off);
        let kept: std::collections::HashSet<usize> = on.clone().flat_map(|gap| gap.between).collect();
        let places: Vec<_> = ties
            .iter()
            .enumerate()
            .map(|(index, tie)| {
                let free = tie.free.iter().filter(|&&free| free && !tie.off).count();
                layout.block(free, kept.contains(&index))
            })
            .collect();
        for (tie, &place) in ties.iter().zip(&places).filter(|(tie, _)| !tie.off) {
            for view in tie.views() {
                layout.common(slots[view].iter().flatten().map(|slot| slot.0).chain(place));
            }
        }
        for gap in on {
            layout.common(gap.between.iter().filter_map(|&tie| places[tie]));
        }
        let blocks = Blocks::new(layout.sizes, &layout.keep, &layout.common);
        let mut joint = Self { views, ties, gaps, blocks, slots, beside, places, drawn: Vec::new() };
        let sightings = |tie: &Tie| -> Vec<Option<Drawn>> {
            tie.sightings
                .iter()
                .map(|seen| joint.draw(seen.view, seen.pixel, &joint.views[seen.view].camera.lens))
                .collect()
        };
        joint.drawn = joint.ties.iter().map(sightings).collect();
        joint
    }

    fn draw(&self, view: usize, pixel: crate::camera::Pixel, lens: &Lens) -> Option<Drawn> {
        let fitted = std::array::from_fn(|k| self.slots[view][POSE + k].is_some());
        Drawn::new(pixel, lens, fitted)
    }

    fn lens_is_free(&self, view: usize) -> bool {
        self.slots[view][POSE..].iter().any(Option::is_some)
    }

    /// The values of all unknowns that the views and ties start from.
    pub(crate) fn start(&self) -> Vec<f64> {
        let mut state = vec![0.0; self.blocks.unknowns()];
        for (view, slots) in self.views.iter().zip(&self.slots) {
            let values = unknowns_of(&view.camera);
            for (slot, value) in slots.iter().zip(values) {
                if let Some((block, place)) = slot {
                    state[self.blocks.offsets[*block] + place] = value;
                }
            }
        }
        for (view, blocks) in self.views.iter().zip(&self.beside) {
            for (block, value) in blocks.iter().zip(&view.nuisance) {
                if let Some(block) = block {
                    state[self.blocks.offsets[*block]] = *value;
                }
            }
        }
        for (tie, place) in self.ties.iter().zip(&self.places) {
            let free = (0..PLACE).filter(|&k| tie.free[k]);
            for (i, k) in free.enumerate() {
                if let Some(block) = place {
                    state[self.blocks.offsets[*block] + i] = tie.place[k];
                }
            }
        }
        state
    }

    /// A camera at a state, its covariance left as it was.
    pub(crate) fn camera(&self, state: &[f64], view: usize) -> Camera {
        let mut values = unknowns_of(&self.views[view].camera);
        for (value, slot) in values.iter_mut().zip(&self.slots[view]) {
            if let Some((block, place)) = slot {
                *value = state[self.blocks.offsets[*block] + place];
            }
        }
        let [x, y, z, yaw, pitch, roll, log_focal, coefficients @ ..] = values;
        let camera = self.views[view].camera;
        let focal =
            if self.slots[view][Covariance::FOCAL].is_some() { log_focal.exp() } else { camera.focal };
        let distortion = camera.lens.distortion.with_coefficients(coefficients);
        let lens = Lens { distortion, ..camera.lens };
        Camera { position: [x, y, z].into(), yaw, pitch, roll, focal, lens, ..camera }
    }

    /// Where a tie is at a state.
    pub(crate) fn place(&self, state: &[f64], tie: usize) -> [f64; PLACE] {
        let mut place = self.ties[tie].place;
        let free = (0..PLACE).filter(|&k| self.ties[tie].free[k]);
        for (i, k) in free.enumerate() {
            if let Some(block) = self.places[tie] {
                place[k] = state[self.blocks.offsets[block] + i];
            }
        }
        place
    }

    /// Directions and lengths of a view at a state.
    pub(crate) fn nuisance(&self, state: &[f64], view: usize) -> Vec<f64> {
        let values = self.views[view].nuisance.iter().zip(&self.beside[view]);
        values.map(|(&start, block)| block.map_or(start, |b| state[self.blocks.offsets[b]])).collect()
    }

    /// Block of a tie's free unknowns.
    pub(crate) fn tie_block(&self, tie: usize) -> Option<usize> {
        self.places[tie]
    }

    /// Block and place of every unknown of a view.
    pub(crate) fn slots(&self, view: usize) -> &Slots {
        &self.slots[view]
    }

    /// Residuals less unknowns.
    pub(crate) fn dof(&self, state: &[f64]) -> Option<i64> {
        let mut count = 0_i64;
        self.each_residual(state, |_, _, _| count += 1)?;
        // A line through an edge's points has two unknowns of its own.
        let edges: i64 = self.views.iter().map(|view| view.edges.len() as i64).sum();
        Some(count - 2 * edges - self.blocks.unknowns() as i64)
    }

    /// Calls `sink` with every residual in sigmas, its slopes, and what it belongs to.
    ///
    /// `None` where the geometry is impossible: something seen is behind its camera, a length above the
    /// horizon, a lens that folds back on itself.
    pub(crate) fn each_residual(&self, state: &[f64], mut sink: impl FnMut(f64, &[Slope], Of)) -> Option<()> {
        let cameras: Vec<Camera> = (0..self.views.len()).map(|view| self.camera(state, view)).collect();
        for (view, camera) in cameras.iter().enumerate() {
            self.each_drawing(state, view, camera, &mut sink)?;
            self.each_edge(view, camera, &mut sink)?;
        }
        let poses: Vec<Pose> = cameras.into_iter().map(Pose::new).collect();
        for tie in (0..self.ties.len()).filter(|&tie| !self.ties[tie].off) {
            self.each_sighting(state, tie, &poses, &mut sink)?;
        }
        for (index, gap) in self.gaps.iter().enumerate().filter(|(_, gap)| !gap.off) {
            self.gap_residual(state, gap, |residual, slopes| sink(residual, slopes, Of::Gap { gap: index }))?;
        }
        Some(())
    }

    /// The residuals of stage 1, and of what is believed of the camera.
    fn each_drawing(
        &self,
        state: &[f64],
        view: usize,
        camera: &Camera,
        sink: &mut impl FnMut(f64, &[Slope], Of),
    ) -> Option<()> {
        let this = &self.views[view];
        let height = camera.position.z;
        let core = [camera.roll, camera.pitch, camera.focal.ln(), height.ln()];
        // A camera below the floor has no log height; evidence that asks for it is impossible there.
        let core = if height > 0.0 { core } else { [core[0], core[1], core[2], f64::NEG_INFINITY] };
        let stage_1 = State { core, nuisance: self.nuisance(state, view) };
        let is_free = self.lens_is_free(view);
        let evidence = is_free.then(|| Evidence::new(this.annotations, &camera.lens, false));
        let rows = rows(&this.stage_1, evidence.as_ref(), &stage_1)?;
        let by_lens =
            if is_free { self.rows_by_lens(view, camera, &stage_1, rows.len())? } else { Vec::new() };
        for (i, (residual, slope, beside, source)) in rows.iter().enumerate() {
            let mut by = [0.0; VIEW];
            by[Covariance::ROLL] = slope[ROLL];
            by[Covariance::PITCH] = slope[PITCH];
            by[Covariance::FOCAL] = slope[LOG_FOCAL];
            by[Covariance::Z] = if height > 0.0 { slope[LOG_HEIGHT] / height } else { 0.0 };
            for (k, column) in &by_lens {
                by[POSE + k] = column[i];
            }
            let own = beside.and_then(|(index, slope)| Some((self.beside[view][index]?, [slope])));
            let of = source.map_or(Of::Belief, |source| Of::Drawing { view, source });
            self.sink_view(
                view,
                *residual,
                &by,
                own.as_ref().map(|(block, by)| Slope { block: *block, by }),
                of,
                sink,
            );
        }
        Some(())
    }

    /// Slopes of the residuals of stage 1 by every coefficient that is free, by differences.
    fn rows_by_lens(
        &self,
        view: usize,
        camera: &Camera,
        stage_1: &State,
        count: usize,
    ) -> Option<Vec<(usize, Vec<f64>)>> {
        let this = &self.views[view];
        let free = (0..Distortion::MOST).filter(|&k| self.slots[view][POSE + k].is_some());
        free.map(|k| {
            let at = |by: f64| {
                let lens = camera.nudged(POSE + k, by).lens;
                let evidence = Evidence::new(this.annotations, &lens, false);
                rows(&this.stage_1, Some(&evidence), stage_1).filter(|rows| rows.len() == count)
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
        sink: &mut impl FnMut(f64, &[Slope], Of),
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
            (0..Distortion::MOST).filter(|&k| self.slots[view][POSE + k].is_some()).collect();
        for edge in &this.edges {
            let distances = straightness(&camera.lens, &edge.points)?;
            let columns: Vec<Vec<f64>> = free
                .iter()
                .map(|&k| {
                    let at = |by: f64| straightness(&camera.nudged(POSE + k, by).lens, &edge.points);
                    let (ahead, behind) = (at(STEP)?, at(-STEP)?);
                    Some(ahead.iter().zip(behind).map(|(a, b)| (a - b) / (2.0 * STEP)).collect())
                })
                .collect::<Option<_>>()?;
            for (i, distance) in distances.iter().enumerate() {
                let mut by = [0.0; VIEW];
                for (&k, column) in free.iter().zip(&columns) {
                    by[POSE + k] = scale * column[i];
                }
                self.sink_view(view, scale * distance, &by, None, Of::Edge { view }, sink);
            }
        }
        Some(())
    }

    /// Where cameras show a thing against where it was drawn, and what is believed of its place.
    fn each_sighting(
        &self,
        state: &[f64],
        index: usize,
        poses: &[Pose],
        sink: &mut impl FnMut(f64, &[Slope], Of),
    ) -> Option<()> {
        let tie = &self.ties[index];
        let place = self.place(state, index);
        let free: Vec<usize> = (0..PLACE).filter(|&k| tie.free[k]).collect();
        for (sighting, seen) in tie.sightings.iter().enumerate() {
            let pose = &poses[seen.view];
            let drawn = if self.lens_is_free(seen.view) {
                self.draw(seen.view, seen.pixel, &pose.camera.lens)
            } else {
                self.drawn[index][sighting]
            }?;
            let of = Of::Sighting { tie: index, sighting };
            for row in tie.thing.sighted(&place, seen.point, pose, &drawn)? {
                let by = row.by_view.map(|slope| slope / seen.sigma);
                let mut own = [0.0; PLACE];
                for (i, &k) in free.iter().enumerate() {
                    own[i] = row.by_place[k] / seen.sigma;
                }
                let own = self.places[index].map(|block| Slope { block, by: &own[..free.len()] });
                self.sink_view(seen.view, row.off / seen.sigma, &by, own, of, sink);
            }
        }
        for &(k, Prior { value, sigma }) in &tie.beliefs {
            let mut own = [0.0; PLACE];
            if let (Some(i), Some(block)) = (free.iter().position(|&f| f == k), self.places[index]) {
                own[i] = sigma.recip();
                let slope = Slope { block, by: &own[..free.len()] };
                sink((place[k] - value) / sigma, &[slope], Of::Place { tie: index });
            }
        }
        Some(())
    }

    /// `(|A - B| - length) / sigma`.
    fn gap_residual(&self, state: &[f64], gap: &Gap, mut sink: impl FnMut(f64, &[Slope])) -> Option<()> {
        let ends = gap.between.map(|tie| self.ties[tie].thing.anchor(&self.place(state, tie)));
        let [a, b] = [ends[0].0, ends[1].0].map(<[f64; 3]>::from);
        let way: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
        let length = crate::camera::dot(&way, &way).sqrt();
        // Of two things at one place no way is the shorter one.
        let way = if length > 0.0 { way.map(|along| along / length) } else { [0.0; 3] };
        let mut by = [[0.0; PLACE]; 2];
        for (end, slopes) in by.iter_mut().enumerate() {
            let sign = if end == 0 { 1.0 } else { -1.0 };
            let free = (0..PLACE).filter(|&k| self.ties[gap.between[end]].free[k]);
            for (i, k) in free.enumerate() {
                let along: f64 = (0..3).map(|axis| way[axis] * ends[end].1[axis][k]).sum();
                slopes[i] = sign * along / gap.length.sigma;
            }
        }
        let slopes: Vec<Slope> = (0..2)
            .filter_map(|end| {
                let block = self.places[gap.between[end]]?;
                Some(Slope { block, by: &by[end][..self.blocks.sizes[block]] })
            })
            .collect();
        sink((length - gap.length.value) / gap.length.sigma, &slopes);
        Some(())
    }

    /// Hands on a residual of a view with its slopes sorted into blocks.
    fn sink_view(
        &self,
        view: usize,
        residual: f64,
        by: &[f64; VIEW],
        own: Option<Slope>,
        of: Of,
        sink: &mut impl FnMut(f64, &[Slope], Of),
    ) {
        let mut sorted = [(usize::MAX, [0.0; VIEW], 0_usize); 2];
        for (slot, slope) in self.slots[view].iter().zip(by) {
            let Some((block, place)) = slot else { continue };
            let which = usize::from(sorted[0].0 != usize::MAX && sorted[0].0 != *block);
            sorted[which].0 = *block;
            sorted[which].1[*place] = *slope;
            sorted[which].2 = self.blocks.sizes[*block];
        }
        let mut slopes = [Slope { block: 0, by: &[] }; 3];
        let mut count = 0;
        for (block, by, size) in &sorted {
            if *size > 0 {
                slopes[count] = Slope { block: *block, by: &by[..*size] };
                count += 1;
            }
        }
        if let Some(own) = own {
            slopes[count] = own;
            count += 1;
        }
        sink(residual, &slopes[..count], of);
    }

    /// Normal equations at a state; `None` where the geometry is impossible.
    pub(crate) fn normal(&self, state: &[f64]) -> Option<BlockNormal> {
        let mut normal = self.blocks.normal();
        self.each_residual(state, |residual, slopes, _| self.blocks.add(&mut normal, residual, slopes))?;
        normal.cost.is_finite().then_some(normal)
    }
}

impl LeastSquares for Joint<'_> {
    type State = Vec<f64>;
    type Normal = BlockNormal;

    fn linearise(&self, state: &Vec<f64>) -> Option<(f64, BlockNormal)> {
        let normal = self.normal(state)?;
        Some((normal.cost, normal))
    }

    fn step(&self, state: &Vec<f64>, normal: &BlockNormal, damping: f64) -> Option<(Vec<f64>, f64, f64)> {
        let (step, promised) = self.blocks.step(normal, damping)?;
        let next: Vec<f64> = state.iter().zip(&step).map(|(value, step)| value + step).collect();
        let relative = |(value, step): (&f64, &f64)| step.abs() / (1.0 + value.abs());
        let size = state.iter().zip(&step).map(relative).fold(0.0, f64::max);
        size.is_finite().then_some((next, promised, size))
    }
}

/// x, y, z, yaw, pitch, roll, log focal and the coefficients.
fn unknowns_of(camera: &Camera) -> [f64; VIEW] {
    let [x, y, z] = camera.position.into();
    let [a, b, c, d, e] = camera.lens.distortion.coefficients();
    [x, y, z, camera.yaw, camera.pitch, camera.roll, camera.focal.ln(), a, b, c, d, e]
}

/// All residuals of stage 1 under other evidence than its own, if any is given.
fn rows(problem: &Problem, evidence: Option<&Evidence>, state: &State) -> Option<Rows> {
    let mut rows = Rows::new();
    let mut sink =
        |residual: Dual, beside, source| rows.push((residual.value, residual.slope, beside, source));
    match evidence {
        Some(evidence) => Problem { evidence, ..problem.clone() }.each_residual(state, &mut sink)?,
        None => problem.each_residual(state, &mut sink)?,
    }
    Some(rows)
}
