//! Colour items: rays of small image blocks with one colour class and a weight.

use calib_core::Pixel;

use crate::registration::colour_classes::ClassShares;
use crate::registration::lab_image::LabImage;
use crate::registration::local_view::LocalView;

/// Smallest share of a class in a block for which an item is created.
const MIN_SHARE: f32 = 0.2;
/// Smallest share of a class in a block that belongs to a blob of the class.
const MIN_BLOB_SHARE: f32 = 0.15;
/// Exponent of the mass of a blob. The parts of a large blob are not independent evidence.
const BLOB_EXPONENT: f32 = -0.7;
/// Exponent of the total weight of a class, in the factor that is applied to the weights of its items. It is
/// negative, so that classes with many items do not dominate.
const CLASS_EXPONENT: f32 = -0.3;
/// Largest distance of the floor point of a ray, in heights of the camera.
const MAX_FLOOR_DISTANCE: f64 = 9.0;
/// Share added to the background share of a class, so that the information of the class is finite.
const MIN_BACKGROUND: f32 = 0.004;
/// Sum of the weights of the items of both directions of a pair.
const TOTAL_WEIGHT: f32 = 1000.0;

/// Ray of an image block, with a colour class.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item {
    /// Index of the class.
    pub(crate) class: usize,
    /// Weight in the score.
    pub(crate) weight: f32,
    /// Horizontal unit vector of the ray, in the local frame.
    pub(crate) heading: [f32; 2],
    /// Descent of the ray per horizontal distance; positive.
    pub(crate) slope: f32,
}

/// All items of an image, for blocks of one size.
#[derive(Clone, Debug)]
pub(crate) struct ItemCandidates {
    items: Vec<Item>,
    /// Mean share of each class in the blocks of the image.
    background: Vec<f32>,
}

impl ItemCandidates {
    /// Collects the items of blocks of `step` by `step` pixels. The weight of an item is the share of its
    /// class in the block, times a factor. The factor decreases with the size of the blob that contains the
    /// block.
    pub(crate) fn new(shares: &ClassShares, image: &LabImage, view: &LocalView, step: usize) -> Self {
        let blocks = shares.block_means(step);
        let [w, h] = blocks.size;
        let factors = blob_factors(&blocks);
        let mut background = vec![0.0; blocks.classes];
        let (mut items, mut count) = (Vec::new(), 0.0);
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let Some((heading, slope)) = block_ray(image, view, step, [x, y]) else { continue };
            count += 1.0;
            for (class, &share) in blocks.pixel(x, y).iter().enumerate() {
                background[class] += share;
                let weight = share * factors[(y * w + x) * blocks.classes + class];
                if share > MIN_SHARE {
                    items.push(Item { class, weight, heading, slope });
                }
            }
        }
        background.iter_mut().for_each(|share| *share /= f32::max(count, 1.0));
        Self { items, background }
    }

    /// Returns the `count` most informative items, ordered by class. Reduces their weights if their class has
    /// a large total weight. `other` contains the background share of each class in the other camera. A rare
    /// class is more informative.
    pub(crate) fn select(&self, other: &[f32], count: usize) -> Vec<Item> {
        let mean = |class: usize| 0.5 * (other[class] + self.background[class]);
        let information: Vec<f32> =
            (0..other.len()).map(|class| -(mean(class) + MIN_BACKGROUND).ln()).collect();
        let gain = |item: &Item| item.weight * information[item.class];
        let mut order: Vec<usize> = (0..self.items.len()).collect();
        order.sort_by(|&a, &b| gain(&self.items[b]).total_cmp(&gain(&self.items[a])));
        order.truncate(count);
        // Rays of neighbouring blocks use neighbouring nodes of a direction map.
        order.sort_by_key(|&index| (self.items[index].class, index));
        let mut items: Vec<Item> = order.into_iter().map(|index| self.items[index]).collect();
        let mut totals = vec![0.0; other.len()];
        items.iter().for_each(|item| totals[item.class] += item.weight);
        let factor = |class: usize| f32::max(totals[class], 0.1).powf(CLASS_EXPONENT);
        items.iter_mut().for_each(|item| item.weight *= factor(item.class));
        items
    }
}

/// Scales the weights of the items of both directions to a common sum.
pub(crate) fn normalise_weights(items: [&mut Vec<Item>; 2]) {
    let total: f32 = items.iter().flat_map(|items| items.iter()).map(|item| item.weight).sum();
    let factor = if total > 0.0 { TOTAL_WEIGHT / total } else { 0.0 };
    items.into_iter().flatten().for_each(|item| item.weight *= factor);
}

/// Returns the horizontal unit vector and the slope of the ray of a block. Returns `None` if a pixel of the
/// block is hidden, or if the ray meets no near floor point.
fn block_ray(image: &LabImage, view: &LocalView, step: usize, [x, y]: [usize; 2]) -> Option<([f32; 2], f32)> {
    let mut rows = (y * step..(y + 1) * step).map(|row| row * image.size[0] + x * step);
    if !rows.all(|start| image.is_visible[start..start + step].iter().all(|is_visible| *is_visible)) {
        return None;
    }
    let [u, v] = [x, y].map(|i| (i as f64 + 0.5) * step as f64 / image.scale);
    let [dx, dy, dz] = view.direction(Pixel::new(u, v))?;
    let level = (dx * dx + dy * dy).sqrt();
    let slope = -dz / level;
    let is_near = slope * MAX_FLOOR_DISTANCE > 1.0 && slope.is_finite();
    is_near.then(|| ([dx / level, dy / level].map(|c| c as f32), slope as f32))
}

/// Returns a weight for each block and class: the power [`BLOB_EXPONENT`] of the mass of its blob. A blob is
/// a set of blocks of one class that are connected, also diagonally. Its mass is the sum of their shares.
fn blob_factors(blocks: &ClassShares) -> Vec<f32> {
    let ([w, h], classes) = (blocks.size, blocks.classes);
    let mut factors = vec![0.0; w * h * classes];
    let mut is_seen = vec![false; w * h * classes];
    for start in 0..w * h * classes {
        let (class, block) = (start % classes, start / classes);
        let share = |block: usize| blocks.pixel(block % w, block / w)[class];
        if is_seen[start] || share(block) <= MIN_BLOB_SHARE {
            continue;
        }
        is_seen[start] = true;
        let (mut blob, mut next, mut mass) = (vec![block], 0, 0.0);
        while let Some(&block) = blob.get(next) {
            next += 1;
            mass += share(block);
            let [x, y] = [block % w, block / w];
            for other in (y.saturating_sub(1)..(y + 2).min(h))
                .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(w)).map(move |x| y * w + x))
            {
                if !is_seen[other * classes + class] && share(other) > MIN_BLOB_SHARE {
                    is_seen[other * classes + class] = true;
                    blob.push(other);
                }
            }
        }
        let factor = f32::max(mass, 0.5).powf(BLOB_EXPONENT);
        blob.iter().for_each(|block| factors[block * classes + class] = factor);
    }
    factors
}
