//! Transfer of annotations from the old image to the new one: mapped by the rotation and checked against the
//! new image.

use calib_core::{Camera, Pixel};

use calib_core::camera::{RotatedCamera, RotationZoom};

use calib_site::ImageTransfer;
use image::RgbImage;

use crate::compare::alignment::Search;
use crate::compare::comparison::SMOOTHING_PX;
use crate::compare::feature::Luma;
use crate::compare::place::edge_samples;
use crate::edges::Edge;
use crate::pull::snap_polyline;

/// Transfer of annotations from an old to a new image.
#[derive(Debug)]
pub(crate) struct AnnotationTransfer<'a> {
    camera: &'a Camera,
    turn: RotationZoom,
    turned: RotatedCamera,
    old: Luma,
    new: Luma,
    image: &'a RgbImage,
}

/// Length below which a transferred line is dropped, in pixels.
const MIN_LENGTH_PX: f64 = 16.0;

impl<'a> AnnotationTransfer<'a> {
    /// Creates the transfer from the `old` image of a camera to the `new` image of the same size. The camera
    /// rotated by `turn` between them.
    pub(crate) fn new(camera: &'a Camera, turn: RotationZoom, old: &RgbImage, new: &'a RgbImage) -> Self {
        let [before, after] = [old, new].map(|image| Luma::new(image).smoothed(SMOOTHING_PX));
        Self { camera, turn, turned: turn.for_camera(camera), old: before, new: after, image: new }
    }
}

impl ImageTransfer for AnnotationTransfer<'_> {
    /// Maps a line and pulls it onto its edge.
    fn line(&self, points: &[Pixel], whole: bool) -> Option<Vec<Pixel>> {
        /// Largest distance from a mapped line to its edge, in pixels; a farther edge is another one.
        const SAME: f64 = 2.5;
        let carried = if whole { self.all(points)? } else { self.shown_part(points)? };
        if length(&carried) < MIN_LENGTH_PX || !self.is_there(points) {
            return None;
        }
        let pulled = snap_polyline(self.image, &carried);
        let is_same = |pulled: &Vec<Pixel>| pulled.iter().zip(&carried).all(|(a, b)| a.distance(*b) < SAME);
        Some(pulled.filter(is_same).unwrap_or(carried))
    }

    fn point(&self, old: Pixel) -> Option<Pixel> {
        /// Smallest correlation of the surroundings of the same point.
        const ALIKE: f64 = 0.75;
        const REACH: i32 = 3;
        let steps =
            (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| [f64::from(x), f64::from(y)]));
        let alike = |step: [f64; 2]| self.likeness(old, step);
        let best = steps.max_by(|&a, &b| alike(a).total_cmp(&alike(b)))?;
        let here = alike(best);
        let is_inner = best.iter().all(|step| step.abs() < f64::from(REACH));
        if here < ALIKE || !is_inner {
            return None;
        }
        let vertex = |axis: usize| {
            let neighbour = |by: f64| {
                let mut step = best;
                step[axis] += by;
                alike(step)
            };
            let (before, after) = (neighbour(-1.0), neighbour(1.0));
            let bend = before - 2.0 * here + after;
            best[axis] + if bend < -1e-9 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
        };
        let at = self.turned.map_pixel(old)?;
        Some(Pixel::new(at.u + vertex(0), at.v + vertex(1)))
    }

    fn corner(&self, old: Pixel) -> Option<Pixel> {
        self.turned.map_pixel(old)
    }
}

impl AnnotationTransfer<'_> {
    /// Correlates the surroundings of a point with the new image, `step` pixels from the mapped position.
    fn likeness(&self, old: Pixel, step: [f64; 2]) -> f64 {
        const HALF: i32 = 6;
        let pair = |x: i32, y: i32| {
            let before = Pixel::new(old.u + f64::from(x), old.v + f64::from(y));
            let after = self.turned.map_pixel(before)?;
            Some([self.old.at(before.u, before.v)?, self.new.at(after.u + step[0], after.v + step[1])?])
        };
        let cells = (-HALF..=HALF).flat_map(|y| (-HALF..=HALF).map(move |x| (x, y)));
        let Some(pairs) = cells.map(|(x, y)| pair(x, y)).collect::<Option<Vec<[f64; 2]>>>() else {
            return -1.0;
        };
        correlation(&pairs)
    }

    fn all(&self, points: &[Pixel]) -> Option<Vec<Pixel>> {
        points.iter().map(|&point| self.turned.map_pixel(point).filter(|&at| self.is_inside(at))).collect()
    }

    /// Returns the longest visible part of a line: a section of a two-point line, or a run of points of a
    /// polyline.
    fn shown_part(&self, points: &[Pixel]) -> Option<Vec<Pixel>> {
        const STEPS: usize = 64;
        let dense: Vec<Pixel> = match points {
            &[a, b] => (0..=STEPS)
                .map(|i| i as f64 / STEPS as f64)
                .map(|t| Pixel::new(a.u + t * (b.u - a.u), a.v + t * (b.v - a.v)))
                .collect(),
            _ => points.to_vec(),
        };
        let carried: Vec<Option<Pixel>> = dense
            .iter()
            .map(|&point| self.turned.map_pixel(point).filter(|&at| self.is_inside(at)))
            .collect();
        let runs =
            carried.split(Option::is_none).map(|run| run.iter().flatten().copied().collect::<Vec<Pixel>>());
        let longest = runs.max_by(|a, b| length(a).total_cmp(&length(b)))?;
        match (points.len(), longest.first(), longest.last()) {
            (2, Some(&first), Some(&last)) => Some(vec![first, last]),
            (2, ..) => None,
            (count, ..) => (longest.len() >= count.min(3)).then_some(longest),
        }
    }

    /// Whether the edge along a line of the old image also exists in the new image.
    fn is_there(&self, points: &[Pixel]) -> bool {
        /// Largest offset, in pixels.
        const NEAR: f64 = 1.0;
        const REACH: usize = 3;
        let edges: Vec<Edge> = points.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        let search = Search::new(self.camera, &self.new, &self.turn.into());
        let places = edge_samples(self.camera, &self.old, &edges);
        let shown: Vec<_> = places.iter().filter(|place| search.is_visible(place)).collect();
        let near = shown.iter().filter(|place| {
            search.offset(place, REACH).is_some_and(|row| row.offset.abs() < NEAR + 2.0 * row.sigma)
        });
        2 * near.count() >= shown.len() && !shown.is_empty()
    }

    fn is_inside(&self, at: Pixel) -> bool {
        const MARGIN: f64 = 2.0;
        let within = |at: f64, side: usize| (MARGIN..side as f64 - MARGIN).contains(&at);
        within(at.u, self.new.width) && within(at.v, self.new.height)
    }
}

fn length(points: &[Pixel]) -> f64 {
    points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

fn correlation(pairs: &[[f64; 2]]) -> f64 {
    /// Contrast below which a patch cannot be compared, in log brightness.
    const FLAT: f64 = 0.02;
    let count = pairs.len() as f64;
    let mean = [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).sum::<f64>() / count);
    let moment =
        |i: usize, j: usize| pairs.iter().map(|pair| (pair[i] - mean[i]) * (pair[j] - mean[j])).sum::<f64>();
    let (old, new) = (moment(0, 0), moment(1, 1));
    if old < count * FLAT * FLAT || new < count * FLAT * FLAT {
        -1.0
    } else {
        moment(0, 1) / (old * new).sqrt()
    }
}
