//! Share of each colour class in the cells of the space around a camera, for the coarse search.

use crate::registration::colour_classes::ClassShares;
use crate::registration::local_view::LocalView;

/// Number of cells of a class volume along x, and along y.
pub(crate) const CELLS: usize = 64;
/// Side of a cell, in heights of the camera.
pub(crate) const CELL: f64 = 0.25;
/// Largest horizontal distance between a point on a ray and the camera of the ray, in heights of the other camera.
pub(crate) const MAX_RAY: f64 = 5.5;
/// Number of levels of cells, from the floor upward.
pub(crate) const LEVELS: usize = 7;
/// Distance between two levels, in heights of the camera.
pub(crate) const LEVEL: f64 = 0.1;
/// Number of cells around the volume, so that every shifted ray stays in the array.
pub(crate) const PADDING: usize = (MAX_RAY / CELL) as usize + 1;
/// Number of cells of a row, with the padding at both ends.
pub(crate) const STRIDE: usize = CELLS + 2 * PADDING;
/// Stored value of the share 1. The sum of five stored shares fits in 16 bits.
pub(crate) const UNIT: f32 = 8192.0;
/// Share added to both shares of a likelihood ratio, in units of 1 / [`UNIT`]: a class may be absent from one
/// image by chance.
pub(crate) const ADDED_SHARE: f32 = 0.002 * UNIT;

/// Largest horizontal distance of a visible cell from the camera, in heights of the camera.
const MAX_DISTANCE: f64 = 6.75;
/// Points of a cell that are projected to the image: x, y in cells, and z in levels.
const POINTS: [[f64; 3]; 5] =
    [[0.0, 0.0, 0.0], [-0.35, -0.35, 0.3], [0.35, -0.35, -0.3], [-0.35, 0.35, -0.3], [0.35, 0.35, 0.3]];
/// Smallest number of visible points of a visible cell.
const MIN_VISIBLE_POINTS: u32 = 3;
/// Smallest sum of the shares of a visible pixel; less means that its neighbourhood is hidden.
pub(crate) const MIN_VISIBLE_SHARE: f32 = 0.5;

/// Class shares in the cells around a camera. Hidden cells contain the background shares, which are no
/// evidence.
#[derive(Clone, Debug)]
pub(crate) struct ClassVolume {
    /// Shares in units of 1 / [`UNIT`], by class, level, row y and column x, with padding.
    shares: Vec<u16>,
    /// Mean shares of the classes in the visible cells, in units of 1 / [`UNIT`].
    pub(crate) background: Vec<u16>,
}

impl ClassVolume {
    /// Projects the cells to the image. `scale` is the number of pixels of `shares` per pixel of the image.
    pub(crate) fn new(shares: &ClassShares, view: &LocalView, scale: f64) -> Self {
        let classes = shares.classes;
        let mut cells = vec![0.0_f32; LEVELS * CELLS * CELLS * classes];
        let mut is_visible = vec![false; LEVELS * CELLS * CELLS];
        let (mut background, mut count) = (vec![0.0_f64; classes], 0.0_f64);
        for (index, cell) in cells.chunks_exact_mut(classes.max(1)).enumerate() {
            is_visible[index] = cell_shares(cell, index, shares, view, scale);
            if is_visible[index] {
                count += 1.0;
                background.iter_mut().zip(&*cell).for_each(|(sum, share)| *sum += f64::from(*share));
            }
        }
        let mean = |sum: f64| (sum / count.max(1.0)) as f32;
        let background: Vec<u16> = background.into_iter().map(|sum| to_unit(mean(sum))).collect();
        let plane = STRIDE * STRIDE;
        let mut result = vec![0; classes * LEVELS * plane];
        let planes = result.chunks_exact_mut(LEVELS * plane).zip(&background);
        planes.for_each(|(planes, &background)| planes.fill(background));
        for index in (0..is_visible.len()).filter(|index| is_visible[*index]) {
            let (level, y, x) = (index / (CELLS * CELLS), index / CELLS % CELLS, index % CELLS);
            for class in 0..classes {
                let at = (class * LEVELS + level) * plane + (y + PADDING) * STRIDE + x + PADDING;
                result[at] = to_unit(cells[index * classes + class]);
            }
        }
        Self { shares: result, background }
    }

    /// Returns the padded plane of a class at a level. Row 0 and column 0 are padding.
    pub(crate) fn plane(&self, class: usize, level: usize) -> &[u16] {
        let start = (class * LEVELS + level) * STRIDE * STRIDE;
        &self.shares[start..start + STRIDE * STRIDE]
    }
}

/// Returns the x or y of the centre of a cell, in heights of the camera.
pub(crate) fn cell_centre(index: usize) -> f64 {
    (index as f64 + 0.5 - 0.5 * CELLS as f64) * CELL
}

/// Converts a share to units of 1 / [`UNIT`].
pub(crate) fn to_unit(share: f32) -> u16 {
    (share * UNIT).round().clamp(0.0, UNIT) as u16
}

/// Computes the mean shares of the points of a cell. Returns whether the cell is visible.
fn cell_shares(cell: &mut [f32], index: usize, shares: &ClassShares, view: &LocalView, scale: f64) -> bool {
    let (level, y, x) = (index / (CELLS * CELLS), index / CELLS % CELLS, index % CELLS);
    let (cx, cy) = (cell_centre(x), cell_centre(y));
    if cx * cx + cy * cy > MAX_DISTANCE * MAX_DISTANCE {
        return false;
    }
    let mut count = 0;
    for [dx, dy, dz] in POINTS {
        let z = ((level as f64 + dz) * LEVEL).max(0.0);
        let Some(pixel) = view.project([cx + dx * CELL, cy + dy * CELL, z]) else { continue };
        let [u, v] = [pixel.u, pixel.v].map(|at| (at * scale) as usize);
        let pixel = shares.pixel(u.min(shares.size[0] - 1), v.min(shares.size[1] - 1));
        let sum: f32 = pixel.iter().sum();
        if sum >= MIN_VISIBLE_SHARE {
            count += 1;
            cell.iter_mut().zip(pixel).for_each(|(cell, share)| *cell += share / sum);
        }
    }
    cell.iter_mut().for_each(|share| *share /= count.max(1) as f32);
    count >= MIN_VISIBLE_POINTS
}
