//! The operator's hand: finds what can be seen, chooses lines that are long and far apart, and draws
//! them with a small tremor.

use calib_core::{Camera, Distortion, Pixel, WorldPoint};
use rand_chacha::ChaCha8Rng;

use crate::edge::Edge;
use crate::random::normal;
use crate::world::{is_shown, visible};

/// Standard deviation of a usual tremor, in pixels.
pub(crate) const TREMOR: f64 = 0.7;
/// How far from the image's border lines end, in pixels.
const MARGIN: f64 = 14.0;
/// What may hide the last stretch of the way to a point, in metres: the corner the point lies on.
const SLACK: f64 = 0.02;

/// Somebody who draws on the image of one camera.
#[derive(Debug)]
pub(crate) struct Hand {
    pub(crate) camera: Camera,
    pub(crate) size: [u32; 2],
    /// Standard deviation of the tremor, in pixels.
    pub(crate) tremor: f64,
    pub(crate) random: ChaCha8Rng,
}

/// The part of an edge that an image shows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    /// Where it lies in space.
    pub(crate) edge: Edge,
    /// Its ends on the image, exact.
    pub(crate) ends: [Pixel; 2],
}

impl Run {
    /// In pixels.
    pub(crate) fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }

    pub(crate) fn middle(&self) -> Pixel {
        let [a, b] = self.ends;
        Pixel { u: 0.5 * (a.u + b.u), v: 0.5 * (a.v + b.v) }
    }
}

impl Hand {
    /// Whether the image shows a point of an edge.
    pub(crate) fn sees(&self, point: WorldPoint) -> bool {
        self.pixel(point).is_some_and(|pixel| is_shown(&self.camera, self.size, pixel, MARGIN))
            && visible(&self.camera, self.size, point, SLACK)
    }

    /// Where a point is on the image, exactly.
    pub(crate) fn pixel(&self, point: WorldPoint) -> Option<Pixel> {
        self.camera.world_to_pixel(point)
    }

    /// Where the hand puts a point of the scene.
    pub(crate) fn touch(&mut self, point: WorldPoint) -> Option<Pixel> {
        let Pixel { u, v } = self.pixel(point)?;
        let mut shaken = |value: f64| {
            // A hundredth of a pixel is what a screen resolves.
            ((value + self.tremor * normal(&mut self.random)) * 100.0).round() / 100.0
        };
        Some(Pixel { u: shaken(u), v: shaken(v) })
    }

    /// The longest unbroken part of an edge that the image shows.
    pub(crate) fn run(&self, edge: &Edge) -> Option<Run> {
        const STEPS: usize = 160;
        let seen: Vec<bool> = (0..=STEPS).map(|i| self.sees(edge.at(i as f64 / STEPS as f64))).collect();
        let (mut best, mut start) = ((0, 0), None);
        for i in 0..=STEPS + 1 {
            match (seen.get(i).copied().unwrap_or(false), start) {
                (true, None) => start = Some(i),
                (false, Some(from)) => {
                    best = if i - from > best.1 - best.0 { (from, i) } else { best };
                    start = None;
                }
                _ => {}
            }
        }
        let (from, to) = (best.0, best.1.checked_sub(1)?);
        let part = |i: usize| edge.at(i as f64 / STEPS as f64);
        let edge = Edge { from: part(from), to: part(to) };
        Some(Run { edge, ends: [self.pixel(edge.from)?, self.pixel(edge.to)?] })
    }

    /// The parts of edges that are at least `least` pixels long on the image.
    pub(crate) fn runs(&self, edges: &[Edge], least: f64) -> Vec<Run> {
        edges.iter().filter_map(|edge| self.run(edge)).filter(|run| run.length() >= least).collect()
    }

    /// Points along a run, at equal steps on the image: two, and more on long lines that a lens bends.
    pub(crate) fn stroke(&mut self, run: &Run) -> Vec<Pixel> {
        const STEP: f64 = 140.0;
        const MOST: usize = 5;
        let bent = self.camera.lens.distortion != Distortion::None;
        self.polyline(run, if bent { ((run.length() / STEP) as usize + 1).clamp(2, MOST) } else { 2 })
    }

    /// Two or more points along a run, at equal steps on the image.
    pub(crate) fn polyline(&mut self, run: &Run, count: usize) -> Vec<Pixel> {
        let points = along(&self.camera, &run.edge, count);
        points.into_iter().filter_map(|point| self.touch(point)).collect()
    }
}

/// `count` points of an edge at equal steps on the image.
fn along(camera: &Camera, edge: &Edge, count: usize) -> Vec<WorldPoint> {
    const FINE: usize = 400;
    let steps: Vec<Pixel> =
        (0..=FINE).filter_map(|i| camera.world_to_pixel(edge.at(i as f64 / FINE as f64))).collect();
    let mut way = vec![0.0];
    way.extend(steps.windows(2).scan(0.0, |sum, pair| {
        *sum += pair[0].distance(pair[1]);
        Some(*sum)
    }));
    let total = way.last().copied().unwrap_or(0.0);
    (0..count)
        .map(|i| {
            let wanted = total * i as f64 / (count - 1) as f64;
            let index = way.partition_point(|&w| w < wanted - 1e-9).min(FINE);
            edge.at(index as f64 / FINE as f64)
        })
        .collect()
}

/// Up to `count` of `items`, each worth much and far from those before it.
pub(crate) fn spread<T: Copy>(
    items: &[T],
    count: usize,
    middle: impl Fn(&T) -> Pixel,
    worth: impl Fn(&T) -> f64,
) -> Vec<T> {
    /// Farther apart than this, in pixels, is far enough.
    const FAR: f64 = 900.0;
    let mut chosen: Vec<T> = Vec::new();
    for _ in 0..count {
        let value = |item: &T| {
            let gap = chosen.iter().map(|c| middle(c).distance(middle(item))).fold(FAR, f64::min);
            worth(item) * gap
        };
        let best = items.iter().max_by(|a, b| value(a).total_cmp(&value(b)));
        match best {
            Some(item) if value(item) > 0.0 => chosen.push(*item),
            _ => break,
        }
    }
    chosen
}
