//! Samples along the edges of the old image, each with a brightness profile across the edge.

use std::collections::HashMap;

use calib_core::{Camera, Pixel};

use crate::TONE_SIZE;

use crate::compare::feature::{Luma, cubic};
use crate::compare::motion::Sight;
use crate::edges::Edge;

/// Half the length of a brightness profile across an edge, in pixels of the old image.
pub(crate) const HALF: usize = 6;
/// Number of values in a brightness profile.
pub(crate) const LENGTH: usize = 2 * HALF + 1;
/// Positions along the edge, in pixels, over which a profile is averaged.
const AVERAGING_OFFSETS_PX: [f64; 5] = [-3.0, -1.5, 0.0, 1.5, 3.0];
/// Smallest distance of samples along an edge, in pixels.
const MIN_SPACING_PX: f64 = 8.0;
/// Largest number of samples on one edge, which limits the weight of long edges.
const MAX_SAMPLES_PER_EDGE: f64 = 24.0;
/// Largest number of samples in an image, which limits the computing time.
const MAX_SAMPLES: usize = 6000;
/// Columns and rows of the image blocks, each with a common shift.
pub(crate) const BLOCKS: [usize; 2] = [8, 6];

/// Sample on an edge of the old image.
pub(crate) struct EdgeSample {
    /// Position in the old image.
    pub(crate) at: Pixel,
    /// Rays through the sample, and through the points one pixel along and one pixel across the edge.
    pub(crate) sights: [Sight; 3],
    /// Log brightness across the edge, one value a pixel.
    pub(crate) profile: [f64; LENGTH],
    /// Contrast across the edge in log brightness, times the powers 0, 1 and 2 of the brightness level. The
    /// contrast is positive if the positive side is brighter.
    pub(crate) tone: [f64; TONE_SIZE],
    /// Index of the image block.
    pub(crate) block: usize,
    /// Index of the edge.
    pub(crate) edge: usize,
    /// Direction of the edge, a unit vector.
    along: [f64; 2],
}

/// Position and direction of an edge in an image.
#[derive(Clone, Copy)]
pub(crate) struct Frame {
    pub(crate) at: Pixel,
    /// Vector along the edge: one pixel of the old image, mapped into this image.
    pub(crate) along: [f64; 2],
    /// Vector at right angles to the edge in this image. One pixel across the edge in the old image has this length in
    /// this image.
    pub(crate) across: [f64; 2],
}

impl Frame {
    /// Returns the log brightness `step` steps across the edge, averaged over a few positions along the edge.
    pub(crate) fn brightness(&self, luma: &Luma, step: f64) -> Option<f64> {
        let value = |along_offset: f64| {
            let u = self.at.u + along_offset * self.along[0] + step * self.across[0];
            let v = self.at.v + along_offset * self.along[1] + step * self.across[1];
            luma.at(u, v)
        };
        let mut sum = 0.0;
        for along_offset in AVERAGING_OFFSETS_PX {
            sum += value(along_offset)?;
        }
        Some(sum / AVERAGING_OFFSETS_PX.len() as f64)
    }
}

/// Samples the edges of an image. Earlier edges take precedence; samples along an edge that is already
/// sampled are dropped.
pub(crate) fn edge_samples(camera: &Camera, luma: &Luma, edges: &[Edge]) -> Vec<EdgeSample> {
    let of_edge = |(edge, &[a, b]): (usize, &Edge)| {
        let length = a.distance(b);
        let count = (length / MIN_SPACING_PX).clamp(1.0, MAX_SAMPLES_PER_EDGE) as usize;
        let along = [(b.u - a.u) / length, (b.v - a.v) / length];
        (0..count).filter_map(move |i| {
            let far = length * (i as f64 + 0.5) / count as f64;
            let at = Pixel::new(a.u + far * along[0], a.v + far * along[1]);
            EdgeSample::new(camera, luma, at, along, edge)
        })
    };
    let long = edges.iter().enumerate().filter(|(_, [a, b])| a.distance(*b) >= MIN_SPACING_PX);
    let mut grid = SampleGrid::default();
    long.flat_map(of_edge).filter(|place| grid.is_new(place)).take(MAX_SAMPLES).collect()
}

/// Accepted samples, by cell of the image.
#[derive(Default)]
struct SampleGrid(HashMap<[i64; 2], Vec<Along>>);

/// Sample: its position, a unit vector along its edge, and the index of the edge.
type Along = (Pixel, [f64; 2], usize);

impl SampleGrid {
    /// Largest distances of two samples that count as duplicates, along and across the edge, in pixels.
    const MAX_DUPLICATE_DISTANCE_PX: [f64; 2] = [0.75 * MIN_SPACING_PX, 2.0];
    /// Sine of the largest angle between the edges of two samples that count as duplicates.
    const MAX_DUPLICATE_SINE: f64 = 0.1;

    /// Whether no other edge has a sample at this position. If so, the sample is added to the grid.
    fn is_new(&mut self, place: &EdgeSample) -> bool {
        let along = place.along;
        let cell = [place.at.u, place.at.v].map(|c| (c / MIN_SPACING_PX).floor() as i64);
        let is_same = |&(at, other, edge): &Along| {
            let off = [place.at.u - at.u, place.at.v - at.v];
            let cross = |v: [f64; 2]| (v[0] * other[1] - v[1] * other[0]).abs();
            edge != place.edge
                && cross(along) < Self::MAX_DUPLICATE_SINE
                && cross(off) < Self::MAX_DUPLICATE_DISTANCE_PX[1]
                && (off[0] * other[0] + off[1] * other[1]).abs() < Self::MAX_DUPLICATE_DISTANCE_PX[0]
        };
        let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [cell[0] + i, cell[1] + j]));
        let is_new = !around.filter_map(|near| self.0.get(&near)).flatten().any(is_same);
        if is_new {
            self.0.entry(cell).or_default().push((place.at, along, place.edge));
        }
        is_new
    }
}

impl EdgeSample {
    fn new(camera: &Camera, luma: &Luma, at: Pixel, along: [f64; 2], edge: usize) -> Option<Self> {
        /// Smallest contrast of an edge, as a standard deviation of log brightness.
        const MIN_CONTRAST: f64 = 0.02;
        let across = [-along[1], along[0]];
        let frame = Frame { at, along, across };
        let mut profile = [0.0; LENGTH];
        for (i, value) in profile.iter_mut().enumerate() {
            *value = frame.brightness(luma, i as f64 - HALF as f64)?;
        }
        let neighbour = |way: [f64; 2]| Sight::new(camera, Pixel::new(at.u + way[0], at.v + way[1]));
        let sights = [Sight::new(camera, at)?, neighbour(along)?, neighbour(across)?];
        let [column, row] = [at.u / luma.width as f64, at.v / luma.height as f64];
        let block = (row * BLOCKS[1] as f64) as usize * BLOCKS[0] + (column * BLOCKS[0] as f64) as usize;
        let mean = profile.iter().sum::<f64>() / LENGTH as f64;
        let contrast = profile.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / LENGTH as f64;
        let tone = tone(&profile, mean);
        (contrast.sqrt() > MIN_CONTRAST).then_some(Self { at, sights, profile, tone, block, edge, along })
    }
}

/// Returns the contrast of a profile times the powers 0, 1 and 2 of its brightness level. The level is 0 at
/// medium brightness and 1 at white; `mean` is the mean of the profile.
fn tone(profile: &[f64; LENGTH], mean: f64) -> [f64; TONE_SIZE] {
    /// Log brightness of level 0: medium brightness.
    const MEDIUM_LOG_BRIGHTNESS: f64 = 4.4;
    /// Difference in log brightness between medium brightness and white.
    const LOG_BRIGHTNESS_RANGE: f64 = 1.1;
    let side = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let contrast = side(&profile[HALF + 2..]) - side(&profile[..HALF - 1]);
    let level = (mean - MEDIUM_LOG_BRIGHTNESS) / LOG_BRIGHTNESS_RANGE;
    std::array::from_fn(|power| contrast * level.powi(power as i32))
}

/// Comparison of two brightness profiles.
#[derive(Clone, Copy)]
pub(crate) struct ProfileMatch {
    /// Correlation of the profiles.
    pub(crate) correlation: f64,
    /// Sum of squares of the new profile about its mean.
    pub(crate) square: f64,
}

/// Correlates a profile with the part of a longer profile that begins at `start`, in pixels, interpolated
/// between pixels.
pub(crate) fn match_profiles(profile: &[f64; LENGTH], longer: &[f64], start: f64) -> ProfileMatch {
    let first = start.floor();
    let weights = cubic(start - first);
    let value = |i: usize| -> f64 {
        (0..4)
            .map(|k| {
                let index =
                    (first as isize + i as isize + k as isize - 1).clamp(0, longer.len() as isize - 1);
                weights[k] * longer[index as usize]
            })
            .sum()
    };
    let part: [f64; LENGTH] = std::array::from_fn(value);
    let mean = |values: &[f64; LENGTH]| values.iter().sum::<f64>() / LENGTH as f64;
    let (a, b) = (mean(profile), mean(&part));
    let (mut both, mut old, mut square) = (0.0, 0.0, 0.0);
    for (x, y) in profile.iter().zip(&part) {
        both += (x - a) * (y - b);
        old += (x - a).powi(2);
        square += (y - b).powi(2);
    }
    ProfileMatch { correlation: both / (old * square).sqrt().max(f64::MIN_POSITIVE), square }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::{Covariance, Lens, WorldPoint};
    use image::{Rgb, RgbImage};

    #[test]
    fn a_duplicate_edge_is_sampled_once_and_a_crossing_edge_in_full() {
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 0.4,
            roll: 0.0,
            focal: 300.0,
            lens: Lens::pinhole(Pixel::new(160.0, 120.0)),
            covariance: Covariance::EXACT,
        };
        // Four fields, alternately dark and bright.
        let image =
            RgbImage::from_fn(320, 240, |x, y| Rgb([if (x < 160) == (y < 120) { 60 } else { 180 }; 3]));
        let luma = Luma::new(&image).smoothed(1.0);
        let line = |a: [f64; 2], b: [f64; 2]| [a, b].map(|[u, v]| Pixel::new(u, v));
        let annotated = line([160.0, 20.0], [160.0, 100.0]);
        let found = line([160.6, 10.0], [159.7, 110.0]);
        let across = line([20.0, 120.0], [300.0, 120.0]);
        let counted = |edges: &[Edge]| {
            let places = edge_samples(&camera, &luma, edges);
            (0..edges.len()).map(|edge| places.iter().filter(|place| place.edge == edge).count()).collect()
        };
        let alone: Vec<usize> = counted(&[annotated]);
        let all: Vec<usize> = counted(&[annotated, found, across]);
        assert_eq!(all[0], alone[0]);
        assert!(all[0] >= 8 && all[1] <= 4 && all[2] > 15, "{all:?}");
        let reversed: Vec<usize> = counted(&[found, annotated]);
        assert!(reversed[0] > reversed[1], "the first edge takes precedence: {reversed:?}");
    }
}
