//! Transfer of annotations from the old image to the new image: mapped by the rotation and checked against
//! the new image.

use calib_core::{Camera, Pixel};

use calib_core::camera::{RotatedCamera, RotationZoom};

use calib_site::ImageTransfer;
use image::RgbImage;

use crate::compare::alignment::Search;
use crate::compare::edge_sample::edge_samples;
use crate::compare::feature::{Luma, SMOOTHING_PX};
use crate::edges::Edge;
use crate::pull::snap_polyline;

/// Transfer of annotations from an old to a new image.
#[derive(Debug)]
pub(crate) struct AnnotationTransfer<'a> {
    /// Calibrated camera of the old image.
    camera: &'a Camera,
    /// Rotation and zoom from the old to the new image.
    turn: RotationZoom,
    turned: RotatedCamera,
    /// Smoothed log brightness of the old image.
    old: Luma,
    /// Smoothed log brightness of the new image.
    new: Luma,
    /// New image.
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
    /// Maps a line and snaps it to its edge in the new image.
    fn line(&self, points: &[Pixel], whole: bool) -> Option<Vec<Pixel>> {
        /// Largest distance from a mapped line to its edge, in pixels; a farther edge is a different edge.
        const MAX_SNAP_DISTANCE_PX: f64 = 2.5;
        let carried = if whole { self.map_line(points)? } else { self.map_visible_part(points)? };
        if length(&carried) < MIN_LENGTH_PX || !self.is_edge_found(points) {
            return None;
        }
        let pulled = snap_polyline(self.image, &carried);
        let is_same = |pulled: &Vec<Pixel>| {
            pulled.iter().zip(&carried).all(|(a, b)| a.distance(*b) < MAX_SNAP_DISTANCE_PX)
        };
        Some(pulled.filter(is_same).unwrap_or(carried))
    }

    /// Maps a point and moves it to the position with the most similar surroundings.
    fn point(&self, old: Pixel) -> Option<Pixel> {
        /// Smallest correlation of the surroundings of a point in both images.
        const MIN_CORRELATION: f64 = 0.75;
        /// Search radius about the mapped position, in pixels.
        const SEARCH_RADIUS_PX: i32 = 3;
        let steps = (-SEARCH_RADIUS_PX..=SEARCH_RADIUS_PX)
            .flat_map(|y| (-SEARCH_RADIUS_PX..=SEARCH_RADIUS_PX).map(move |x| [f64::from(x), f64::from(y)]));
        let alike = |step: [f64; 2]| self.correlation_at(old, step);
        let best = steps.max_by(|&a, &b| alike(a).total_cmp(&alike(b)))?;
        let here = alike(best);
        let is_inner = best.iter().all(|step| step.abs() < f64::from(SEARCH_RADIUS_PX));
        if here < MIN_CORRELATION || !is_inner {
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

    /// Maps a corner of a polygon.
    fn corner(&self, old: Pixel) -> Option<Pixel> {
        self.turned.map_pixel(old)
    }
}

impl AnnotationTransfer<'_> {
    /// Returns the correlation between the surroundings of a point of the old image and the new image. The position
    /// in the new image is the mapped point plus `step`, in pixels. Returns -1 at the image border.
    fn correlation_at(&self, old: Pixel, step: [f64; 2]) -> f64 {
        /// Half the side of the compared surroundings, in pixels of the old image.
        const PATCH_HALF_PX: i32 = 6;
        let pair = |x: i32, y: i32| {
            let before = Pixel::new(old.u + f64::from(x), old.v + f64::from(y));
            let after = self.turned.map_pixel(before)?;
            Some([self.old.at(before.u, before.v)?, self.new.at(after.u + step[0], after.v + step[1])?])
        };
        let cells = (-PATCH_HALF_PX..=PATCH_HALF_PX)
            .flat_map(|y| (-PATCH_HALF_PX..=PATCH_HALF_PX).map(move |x| (x, y)));
        let Some(pairs) = cells.map(|(x, y)| pair(x, y)).collect::<Option<Vec<[f64; 2]>>>() else {
            return -1.0;
        };
        correlation(&pairs)
    }

    /// Maps all points of a line; `None` if the new image does not show every point.
    fn map_line(&self, points: &[Pixel]) -> Option<Vec<Pixel>> {
        points.iter().map(|&point| self.turned.map_pixel(point).filter(|&at| self.is_inside(at))).collect()
    }

    /// Maps the longest part of a line that the new image shows. The part is a section of a two-point line,
    /// or a run of points of a polyline.
    fn map_visible_part(&self, points: &[Pixel]) -> Option<Vec<Pixel>> {
        /// Number of sections into which a two-point line is divided.
        const SECTION_COUNT: usize = 64;
        let dense: Vec<Pixel> = match points {
            &[a, b] => (0..=SECTION_COUNT)
                .map(|i| i as f64 / SECTION_COUNT as f64)
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

    /// Whether the edges along a line of the old image are at their predicted positions in the new image.
    fn is_edge_found(&self, points: &[Pixel]) -> bool {
        /// Largest offset of a sample from its predicted position, in pixels, without its noise.
        const MAX_OFFSET_PX: f64 = 1.0;
        /// Search radius across the edge, in pixels.
        const SEARCH_RADIUS_PX: usize = 3;
        let edges: Vec<Edge> = points.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        let search = Search::new(self.camera, &self.new, &self.turn.into());
        let places = edge_samples(self.camera, &self.old, &edges);
        let shown: Vec<_> = places.iter().filter(|place| search.is_visible(place)).collect();
        let near = shown.iter().filter(|place| {
            search
                .offset(place, SEARCH_RADIUS_PX)
                .is_some_and(|row| row.offset.abs() < MAX_OFFSET_PX + 2.0 * row.sigma)
        });
        2 * near.count() >= shown.len() && !shown.is_empty()
    }

    /// Whether a pixel is inside the new image, not at its border.
    fn is_inside(&self, at: Pixel) -> bool {
        /// Smallest distance from the image border, in pixels.
        const MARGIN_PX: f64 = 2.0;
        let within = |at: f64, side: usize| (MARGIN_PX..side as f64 - MARGIN_PX).contains(&at);
        within(at.u, self.new.width) && within(at.v, self.new.height)
    }
}

/// Returns the length of a polyline, in pixels.
fn length(points: &[Pixel]) -> f64 {
    points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

/// Returns the correlation of pairs of log brightness, old and new; -1 without contrast.
fn correlation(pairs: &[[f64; 2]]) -> f64 {
    /// Contrast below which a patch cannot be compared, as a standard deviation of log brightness.
    const MIN_CONTRAST: f64 = 0.02;
    let count = pairs.len() as f64;
    let mean = [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).sum::<f64>() / count);
    let moment =
        |i: usize, j: usize| pairs.iter().map(|pair| (pair[i] - mean[i]) * (pair[j] - mean[j])).sum::<f64>();
    let (old, new) = (moment(0, 0), moment(1, 1));
    if old < count * MIN_CONTRAST * MIN_CONTRAST || new < count * MIN_CONTRAST * MIN_CONTRAST {
        -1.0
    } else {
        moment(0, 1) / (old * new).sqrt()
    }
}
