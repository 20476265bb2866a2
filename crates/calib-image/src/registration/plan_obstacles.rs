//! Obstacles of a floor plan, on a grid.
//!
//! The frame of the plan has x to the right, y up, and its origin at the upper left corner of the image, in metres.

use image::RgbImage;

use crate::registration::floor_scan::dominant_direction;

/// Smallest side of a cell, in metres.
const MIN_CELL_M: f64 = 0.05;
/// Largest number of cells.
const MAX_CELLS: f64 = 4e6;
/// Smallest difference between the brightness of ink and of paper, of 255.
const MIN_CONTRAST: u8 = 30;

/// Obstacles of a floor plan: everything that is drawn, such as walls, columns and furniture.
#[derive(Clone, Debug)]
pub(crate) struct PlanObstacles {
    /// Number of columns and rows.
    size: [usize; 2],
    /// Side of a cell, in metres.
    cell_m: f64,
    /// Distance of each cell from the nearest obstacle, in metres, row by row from the top.
    distance_m: Vec<f32>,
    /// Most frequent direction of lines modulo 90 degrees, counter-clockwise from the right of the plan, in radians.
    pub(crate) direction: Option<f64>,
}

impl PlanObstacles {
    /// Finds the obstacles in the image of a plan. Returns `None` if the image shows no lines, or hardly any paper.
    pub(crate) fn new(image: &RgbImage, metres_per_px: f64) -> Option<Self> {
        /// Largest share of cells with ink.
        const MAX_INK: f64 = 0.5;
        let [width, height] = [image.width() as usize, image.height() as usize];
        let area_m2 = (width * height) as f64 * metres_per_px * metres_per_px;
        let cell_m = MIN_CELL_M.max(metres_per_px).max((area_m2 / MAX_CELLS).sqrt());
        if width < 2 || height < 2 || !cell_m.is_finite() || metres_per_px <= 0.0 {
            return None;
        }
        let brightness: Vec<u8> = (image.pixels())
            .map(|pixel| (pixel.0.iter().map(|&level| u16::from(level)).sum::<u16>() / 3) as u8)
            .collect();
        let paper = median(&brightness);
        let side_px = cell_m / metres_per_px;
        let size = [width, height].map(|side| ((side as f64 / side_px).ceil() as usize).max(1));
        let mut ink = vec![0_u32; size[0] * size[1]];
        for (index, level) in brightness.iter().enumerate() {
            let [x, y] = [index % width, index / width].map(|at| ((at as f64 + 0.5) / side_px) as usize);
            let is_ink = level.abs_diff(paper) > MIN_CONTRAST;
            ink[y.min(size[1] - 1) * size[0] + x.min(size[0] - 1)] += u32::from(is_ink);
        }
        // A thin line that crosses half the cell is an obstacle.
        let least = (0.5 * side_px).max(1.0);
        let is_obstacle: Vec<bool> = ink.iter().map(|&count| f64::from(count) >= least).collect();
        let share = is_obstacle.iter().filter(|is| **is).count() as f64 / is_obstacle.len() as f64;
        if share == 0.0 || share > MAX_INK {
            return None;
        }
        let distance_m =
            distances(&is_obstacle, size).iter().map(|cells| (f64::from(*cells) * cell_m) as f32).collect();
        Some(Self { size, cell_m, distance_m, direction: line_direction(&brightness, [width, height]) })
    }

    /// Returns the width and height of the plan, in metres.
    pub(crate) fn extent(&self) -> [f64; 2] {
        self.size.map(|cells| cells as f64 * self.cell_m)
    }

    /// Returns the distance from a point to the first obstacle in a direction (unit vector), at most `limit`, in
    /// metres. The area outside the plan counts as free.
    pub(crate) fn range(&self, [x, y]: [f64; 2], [dx, dy]: [f64; 2], limit: f64) -> f64 {
        /// Largest number of steps of the sphere tracing.
        const MAX_STEPS: usize = 80;
        /// Step outside the plan, in metres.
        const OUTSIDE_STEP: f64 = 0.5;
        let mut range = 0.0;
        for _ in 0..MAX_STEPS {
            let [column, row] = [x + range * dx, -y - range * dy].map(|at| (at / self.cell_m).floor());
            let is_inside =
                column >= 0.0 && row >= 0.0 && column < self.size[0] as f64 && row < self.size[1] as f64;
            let free = if is_inside {
                f64::from(self.distance_m[row as usize * self.size[0] + column as usize])
            } else {
                OUTSIDE_STEP
            };
            if free < 0.5 * self.cell_m {
                return range;
            }
            range += (free - 0.5 * self.cell_m).max(0.5 * self.cell_m);
            if range >= limit {
                break;
            }
        }
        range.min(limit)
    }
}

/// Returns the median of brightness levels; the upper one of two.
fn median(levels: &[u8]) -> u8 {
    let mut counts = [0_usize; 256];
    levels.iter().for_each(|&level| counts[usize::from(level)] += 1);
    let mut below = 0;
    let is_reached = |count: &usize| {
        below += count;
        below > levels.len() / 2
    };
    counts.iter().position(is_reached).map_or(u8::MAX, |level| level as u8)
}

/// Returns the most frequent direction of the lines of a plan.
fn line_direction(brightness: &[u8], [width, height]: [usize; 2]) -> Option<f64> {
    let gradient = |index: usize| {
        let [x, y] = [1 + index % (width - 2).max(1), 1 + index / (width - 2).max(1)];
        let at = |x: usize, y: usize| f64::from(brightness[y * width + x]);
        let [right, down] = [at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)];
        // Directions modulo a quarter turn: the line and its gradient are equivalent. The y axis of the plan points up.
        ((-down).atan2(right), right.hypot(down))
    };
    let count = width.saturating_sub(2) * height.saturating_sub(2);
    dominant_direction((0..count).map(gradient).filter(|(_, size)| *size > f64::from(MIN_CONTRAST)))
}

/// Returns the Euclidean distance of each cell from the nearest obstacle, in cells (Felzenszwalb and Huttenlocher,
/// *Distance transforms of sampled functions*, 2012).
fn distances(is_obstacle: &[bool], [width, height]: [usize; 2]) -> Vec<f32> {
    /// Squared distance of cells without an obstacle in their column.
    const FAR: f32 = 1e12;
    let mut squares: Vec<f32> = is_obstacle.iter().map(|&is| if is { 0.0 } else { FAR }).collect();
    for x in 0..width {
        let column: Vec<f32> = (0..height).map(|y| squares[y * width + x]).collect();
        lower_envelope(&column).iter().enumerate().for_each(|(y, square)| squares[y * width + x] = *square);
    }
    for row in squares.chunks_exact_mut(width) {
        let envelope = lower_envelope(row);
        row.copy_from_slice(&envelope);
    }
    squares.iter().map(|square| square.sqrt()).collect()
}

/// Returns `min over q of (p - q)^2 + f(q)` for each p: the lower envelope of parabolas.
fn lower_envelope(f: &[f32]) -> Vec<f32> {
    // Apex of each parabola of the envelope, and the position where it starts.
    let mut parabolas: Vec<(usize, f64)> = Vec::with_capacity(f.len());
    let height = |q: usize| f64::from(f[q]) + (q * q) as f64;
    for q in 0..f.len() {
        let mut start = f64::NEG_INFINITY;
        while let Some(&(last, from)) = parabolas.last() {
            start = (height(q) - height(last)) / (2.0 * (q - last) as f64);
            if start > from {
                break;
            }
            parabolas.pop();
            start = f64::NEG_INFINITY;
        }
        parabolas.push((q, start));
    }
    let mut current = 0;
    let value = |p: usize| {
        while parabolas.get(current + 1).is_some_and(|(_, start)| *start <= p as f64) {
            current += 1;
        }
        let apex = parabolas[current].0;
        (p.abs_diff(apex) * p.abs_diff(apex)) as f32 + f[apex]
    };
    (0..f.len()).map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn distances_equal_brute_force() {
        let (width, height) = (23, 17);
        let is_obstacle: Vec<bool> = (0..width * height).map(|i| (i * 7919) % 61 == 3).collect();
        let obstacles: Vec<usize> = (0..width * height).filter(|&i| is_obstacle[i]).collect();
        for (i, found) in distances(&is_obstacle, [width, height]).iter().enumerate() {
            let apart = |&o: &usize| {
                let [dx, dy] = [(i % width).abs_diff(o % width), (i / width).abs_diff(o / width)];
                (dx as f32).hypot(dy as f32)
            };
            let expected = obstacles.iter().map(apart).fold(f32::INFINITY, f32::min);
            assert!((found - expected).abs() < 1e-3, "{i}: {found} {expected}");
        }
    }

    #[test]
    fn a_ray_ends_at_the_wall_and_leaves_through_the_door() {
        // A room of 10 by 8 m at 0.02 m per pixel, with a door of 1 m in the right wall, below the middle.
        let is_door = |x: u32, y: u32| x >= 490 && (220..270).contains(&y);
        let is_room = |x: u32, y: u32| (10..490).contains(&x) && (10..390).contains(&y);
        let image = RgbImage::from_fn(500, 400, |x, y| {
            Rgb([if is_room(x, y) || is_door(x, y) { 250 } else { 40 }; 3])
        });
        let plan = PlanObstacles::new(&image, 0.02).unwrap();
        assert!((plan.extent()[0] - 10.0).abs() < 0.06 && (plan.extent()[1] - 8.0).abs() < 0.06);
        let off =
            |from: [f64; 2], along: [f64; 2], expected: f64| (plan.range(from, along, 20.0) - expected).abs();
        assert!(off([5.0, -4.0], [-1.0, 0.0], 4.8) < 0.06 && off([5.0, -4.0], [0.0, 1.0], 3.8) < 0.06);
        assert!(off([5.0, -2.0], [0.6, -0.8], 5.8 / 0.8) < 0.1);
        assert!(off([5.0, -4.9], [1.0, 0.0], 20.0) < 1e-9);
        let direction = plan.direction.unwrap();
        assert!(direction.min(std::f64::consts::FRAC_PI_2 - direction) < 0.01, "{direction}");
        assert!(PlanObstacles::new(&RgbImage::from_pixel(50, 50, Rgb([255; 3])), 0.02).is_none());
    }
}
