//! Corners that are found again in another still: where the scene is, before it is known to a fraction of a pixel.
//!
//! Corners are those of Shi and Tomasi (1994), one in every cell of an image at several sizes; each is described by
//! histograms of the directions of its gradients (Lowe 2004), upright and leaning: other light changes gradients, but
//! not where they point.

use calib_core::Pixel;

use crate::compare::luma::Luma;

/// Width of the largest image that corners are looked for in, in pixels.
const WIDTH: f64 = 640.0;
/// How many sizes, each smaller by the root of two.
const SIZES: u32 = 4;
/// A corner is the best of a cell of so many pixels.
const CELL: usize = 16;
/// Half the side of what is described, in pixels.
const HALF: i32 = 10;
/// Descriptions lean by so much either way, in radians.
pub(crate) const LEAN: f64 = 0.3;
const LENGTH: usize = 128;

/// A corner and how its surroundings look.
pub(crate) struct Feature {
    pub(crate) at: Pixel,
    /// Pixels of the still in one of the image it was found in.
    pub(crate) size: f64,
    look: [f32; LENGTH],
}

/// An old corner and the new one that looks the same.
pub(crate) struct Match {
    pub(crate) old: Pixel,
    pub(crate) new: Pixel,
    /// Pixels of the still in one of the coarser of the images they were found in.
    pub(crate) size: f64,
    /// How much more it looks the same than the next: less is more.
    pub(crate) doubt: f32,
}

/// An image of one size with its gradients.
struct Level {
    width: usize,
    height: usize,
    size: f64,
    slopes: Vec<[f32; 2]>,
}

/// Corners of a still, described in frames that lean by these angles.
pub(crate) fn features(luma: &Luma, leans: &[f64]) -> Vec<Feature> {
    let first = (luma.width as f64 / WIDTH).max(1.0);
    let levels = (0..SIZES).map(|i| Level::new(luma, first * 0.5_f64.powf(-0.5 * f64::from(i))));
    let mut found = Vec::new();
    for level in levels {
        for [x, y] in level.corners() {
            let at = Pixel::new((x as f64 + 0.5) * level.size, (y as f64 + 0.5) * level.size);
            let look = |&lean: &f64| Feature { at, size: level.size, look: level.look([x, y], lean) };
            found.extend(leans.iter().map(look));
        }
    }
    found
}

impl Level {
    fn new(luma: &Luma, size: f64) -> Self {
        let image = luma.reduced(size).smoothed(0.8);
        let Luma { width, height, .. } = image;
        let at = |x: usize, y: usize| image.values[y.min(height - 1) * width + x.min(width - 1)];
        let slope = |i: usize| {
            let (x, y) = (i % width, i / width);
            [at(x + 1, y) - at(x.saturating_sub(1), y), at(x, y + 1) - at(x, y.saturating_sub(1))]
        };
        Self { width, height, size, slopes: (0..width * height).map(slope).collect() }
    }

    /// The best corner of every cell.
    fn corners(&self) -> Vec<[usize; 2]> {
        /// Less than this is noise, in squares of the logarithm of brightness.
        const LEAST: f32 = 0.01;
        const MARGIN: usize = HALF as usize + 5;
        let mut best = std::collections::BTreeMap::new();
        for y in MARGIN..self.height.saturating_sub(MARGIN) {
            for x in MARGIN..self.width.saturating_sub(MARGIN) {
                let strength = self.strength(x, y);
                let place = best.entry([y / CELL, x / CELL]).or_insert((LEAST, [0, 0]));
                if strength > place.0 {
                    *place = (strength, [x, y]);
                }
            }
        }
        best.into_values().filter(|(strength, _)| *strength > LEAST).map(|(_, at)| at).collect()
    }

    /// The smaller eigenvalue of the gradients about a pixel.
    fn strength(&self, x: usize, y: usize) -> f32 {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for row in y - 2..=y + 2 {
            for [dx, dy] in &self.slopes[row * self.width + x - 2..=row * self.width + x + 2] {
                xx += dx * dx;
                xy += dx * dy;
                yy += dy * dy;
            }
        }
        0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt()
    }

    /// Histograms of eight directions in sixteen cells about a pixel, in a frame that leans.
    fn look(&self, [x, y]: [usize; 2], lean: f64) -> [f32; LENGTH] {
        let (sin, cos) = (lean.sin() as f32, lean.cos() as f32);
        let mut look = [0.0; LENGTH];
        for j in -HALF..HALF {
            for i in -HALF..HALF {
                let (s, t) = (i as f32 + 0.5, j as f32 + 0.5);
                let column = (x as f32 + cos * s - sin * t + 0.5) as usize;
                let row = (y as f32 + sin * s + cos * t + 0.5) as usize;
                let [dx, dy] = self.slopes[row * self.width + column];
                let slope = [cos * dx + sin * dy, cos * dy - sin * dx];
                spread(&mut look, [s, t], slope);
            }
        }
        normalised(look)
    }
}

/// Adds a gradient to the cells and directions it lies between.
fn spread(look: &mut [f32; LENGTH], [s, t]: [f32; 2], [dx, dy]: [f32; 2]) {
    let size = dx.hypot(dy);
    if size == 0.0 {
        return;
    }
    let half = HALF as f32;
    let weight = size * (-(s * s + t * t) / (1.3 * half * half)).exp();
    let turn = (dy.atan2(dx) / std::f32::consts::TAU).rem_euclid(1.0) * 8.0;
    let cell = |at: f32| (at + half) / (0.5 * half) - 0.5;
    let (column, row) = (cell(s), cell(t));
    for (r, by_row) in between(row) {
        for (c, by_column) in between(column) {
            for (d, by_turn) in between(turn) {
                if (0..4).contains(&r) && (0..4).contains(&c) {
                    let index = (r as usize * 4 + c as usize) * 8 + (d as usize) % 8;
                    look[index] += weight * by_row * by_column * by_turn;
                }
            }
        }
    }
}

/// The two whole numbers about a number, and how near each is.
fn between(at: f32) -> [(i32, f32); 2] {
    let low = at.floor();
    [(low as i32, 1.0 - (at - low)), (low as i32 + 1, at - low)]
}

/// Of length 1, no direction with more than a fifth: one strong edge is not all of a look.
fn normalised(mut look: [f32; LENGTH]) -> [f32; LENGTH] {
    for most in [0.2, 1.0] {
        let length = look.iter().map(|value| value * value).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        look.iter_mut().for_each(|value| *value = (*value / length).min(most));
    }
    look
}

fn alike(a: &[f32; LENGTH], b: &[f32; LENGTH]) -> f32 {
    let mut sums = [0.0_f32; 16];
    for (a, b) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for k in 0..16 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum()
}

/// The corners that look the same and like no other, the surest first.
pub(crate) fn matches(old: &[Feature], new: &[Feature]) -> Vec<Match> {
    /// What another corner may come near to the best, as a ratio of squared distances.
    const MOST: f32 = 0.8;
    let mut of_new = vec![(f32::MIN, 0); new.len()];
    let nearest: Vec<(usize, f32)> = old
        .iter()
        .enumerate()
        .map(|(index, feature)| {
            let likeness: Vec<f32> = new.iter().map(|other| alike(&feature.look, &other.look)).collect();
            for (best, &value) in of_new.iter_mut().zip(&likeness) {
                if value > best.0 {
                    *best = (value, index);
                }
            }
            nearest(new, &likeness)
        })
        .collect();
    let mut found: Vec<Match> = nearest
        .iter()
        .enumerate()
        .filter(|(index, (best, doubt))| *doubt < MOST && of_new.get(*best).is_some_and(|to| to.1 == *index))
        .map(|(index, &(best, doubt))| {
            let (old, new) = (&old[index], &new[best]);
            Match { old: old.at, new: new.at, size: old.size.max(new.size), doubt }
        })
        .collect();
    found.sort_by(|a, b| a.doubt.total_cmp(&b.doubt));
    found
}

/// The most alike, and its squared distance over that of the next elsewhere.
fn nearest(new: &[Feature], likeness: &[f32]) -> (usize, f32) {
    let most = |is_asked: &dyn Fn(usize) -> bool| {
        let asked = (0..new.len()).filter(|&index| is_asked(index));
        asked.max_by(|&a, &b| likeness[a].total_cmp(&likeness[b]))
    };
    let Some(best) = most(&|_| true) else { return (0, f32::MAX) };
    let is_elsewhere = |index: usize| new[index].at.distance(new[best].at) > 8.0 * new[best].size;
    let distance = |index: usize| (2.0 - 2.0 * likeness[index]).max(0.0);
    match most(&is_elsewhere) {
        Some(next) => (best, distance(best) / distance(next).max(f32::MIN_POSITIVE)),
        None => (best, f32::MAX),
    }
}
