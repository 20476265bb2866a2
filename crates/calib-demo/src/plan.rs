//! Floor plan image, from the same lists as the scene.

use calib_core::PlanPixel;
use calib_site::Plan;
use image::{Rgb, RgbImage};

use crate::building::{COLUMN, COLUMNS, Filling, Opening, WALLS, Wall};
use crate::picture::render_rows;
use crate::stage::Outline;
use crate::world::world;

/// Scale of the plan, in pixels per metre.
const SCALE: f32 = 40.0;
/// Border around the building, in metres.
const BORDER: f32 = 1.0;
/// West, south, east and north ends of the building, in metres.
const EXTENT: [f32; 4] = [-0.3, -12.5, 30.3, 14.7];
/// Number of samples of a plan pixel along x and y.
const FINE: usize = 4;

/// Brightness of empty floor, from 0 (black) to 255.
const PAPER: f32 = 255.0;
/// Brightness of walls and columns.
const WALL: f32 = 58.0;
/// Brightness of the outlines of furniture.
const FURNITURE: f32 = 176.0;
/// Brightness of the lines of doors and windows.
const LINE: f32 = 120.0;

/// Returns the plan entry of the site file.
pub(crate) fn plan_entry() -> Plan {
    let origin = [BORDER - EXTENT[0], BORDER + EXTENT[3]].map(|metres| f64::from((metres * SCALE).round()));
    Plan {
        image: Some("plan.png".into()),
        page: None,
        layers: None,
        metres_per_px: 1.0 / f64::from(SCALE),
        origin_px: PlanPixel::from(origin),
        x_axis_deg: 0.0,
        georeference: None,
    }
}

/// Draws the image of the demonstration's floor plan: dark walls, doors with arcs of their leaves, furniture in
/// light grey.
#[must_use]
pub fn render_plan() -> RgbImage {
    let width = ((EXTENT[2] - EXTENT[0] + 2.0 * BORDER) * SCALE).round() as usize;
    let height = ((EXTENT[3] - EXTENT[1] + 2.0 * BORDER) * SCALE).round() as usize;
    let PlanPixel { x: origin_x, y: origin_y } = plan_entry().origin_px;
    let y_of = |row: f32| (origin_y as f32 - row) / SCALE;
    let shades = render_rows(width, height, |row, shades: &mut [u8]| {
        let objects = Objects::between(y_of((row + 1) as f32), y_of(row as f32));
        let at = |column: f32, row: f32| objects.brightness((column - origin_x as f32) / SCALE, y_of(row));
        let corners: Vec<f32> =
            (0..2 * width + 2).map(|i| at((i / 2) as f32, (row + i % 2) as f32)).collect();
        for (column, shade) in shades.iter_mut().enumerate() {
            // Every object is larger than a pixel, so equal corners mean a uniform pixel.
            let around = &corners[2 * column..2 * column + 4];
            if around.iter().all(|&corner| corner == around[0]) {
                *shade = around[0] as u8;
                continue;
            }
            let mut sum = 0.0;
            for i in 0..FINE * FINE {
                let (dx, dy) = ((i % FINE) as f32 + 0.5, (i / FINE) as f32 + 0.5);
                sum += at(column as f32 + dx / FINE as f32, row as f32 + dy / FINE as f32);
            }
            *shade = (sum / (FINE * FINE) as f32).round() as u8;
        }
    });
    RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let shade = shades[y as usize * width + x as usize];
        Rgb([shade, shade, shade])
    })
}

/// Half the width of the outlines of furniture, in metres.
const HALF_OUTLINE: f32 = 0.025;

/// Objects that a row of pixels can contain.
struct Objects {
    columns: Vec<[f32; 2]>,
    walls: Vec<&'static Wall>,
    outlines: Vec<Outline>,
}

impl Objects {
    /// Returns the objects that overlap the range of y from `from` to `to`, in metres.
    fn between(from: f32, to: f32) -> Self {
        let meets = |y0: f32, y1: f32, margin: f32| y0 - margin <= to && y1 + margin >= from;
        // The leaf of an open door is as long as its opening is wide.
        let reach =
            |wall: &Wall| wall.openings.iter().map(|o| o.span[1] - o.span[0]).fold(0.0, f32::max) + 0.1;
        Self {
            columns: COLUMNS.into_iter().filter(|[_, y]| meets(*y, *y, COLUMN)).collect(),
            walls: WALLS.iter().filter(|wall| meets(wall.foot[1], wall.foot[3], reach(wall))).collect(),
            outlines: world().outlines.iter().copied().filter(|o| meets(o[1], o[3], HALF_OUTLINE)).collect(),
        }
    }

    /// Returns the brightness of the plan, from 0 to 255, at a floor point in metres.
    fn brightness(&self, x: f32, y: f32) -> f32 {
        let within = |[x0, y0, x1, y1]: [f32; 4]| x >= x0 && x < x1 && y >= y0 && y < y1;
        for [cx, cy] in &self.columns {
            if within([cx - COLUMN, cy - COLUMN, cx + COLUMN, cy + COLUMN]) {
                return WALL;
            }
        }
        for wall in &self.walls {
            if let Some(ink) = opening_brightness(wall, x, y) {
                return ink;
            }
            if within(wall.foot) {
                return WALL;
            }
        }
        let widened = |[x0, y0, x1, y1]: Outline, by: f32| [x0 - by, y0 - by, x1 + by, y1 + by];
        let is_edge = |&outline: &Outline| {
            within(widened(outline, HALF_OUTLINE)) && !within(widened(outline, -HALF_OUTLINE))
        };
        if self.outlines.iter().any(is_edge) {
            FURNITURE
        } else if self.outlines.iter().any(|&outline| within(outline)) {
            246.0
        } else {
            PAPER
        }
    }
}

/// Returns the brightness at a floor point if it belongs to an opening of a wall: the leaf and arc of a door,
/// the panes of a window, or the gap of a gate.
fn opening_brightness(wall: &Wall, x: f32, y: f32) -> Option<f32> {
    let (along, across) = if wall.is_along_x() { (x, y) } else { (y, x) };
    let [x0, y0, x1, y1] = wall.foot;
    let (low, high) = if wall.is_along_x() { (y0, y1) } else { (x0, x1) };
    wall.openings.iter().find_map(|opening| {
        let [from, to] = opening.span;
        let inside = along >= from && along < to && across >= low && across < high;
        match opening.filling {
            Filling::Door { positive } => {
                let out = if positive { across - high } else { low - across };
                door_brightness(opening, along, out).or(inside.then_some(PAPER))
            }
            Filling::Shutter if inside => {
                let line = (across - 0.5 * (low + high)).abs() < 0.02 || on_rim(across, low, high);
                Some(if line { LINE } else { PAPER })
            }
            Filling::Open if inside && opening.sill > 0.0 => {
                let line = (across - 0.5 * (low + high)).abs() < 0.0125 || on_rim(across, low, high);
                Some(if line { LINE } else { PAPER })
            }
            Filling::Open if inside => Some(PAPER),
            _ => None,
        }
    })
}

fn on_rim(across: f32, low: f32, high: f32) -> bool {
    across - low < 0.025 || high - across < 0.025
}

/// Returns the brightness at a point on the leaf or the arc of a door that is open at right angles to the
/// wall. `along` is the position along the wall, and `out` the distance from the wall's face, in metres.
fn door_brightness(opening: &Opening, along: f32, out: f32) -> Option<f32> {
    /// Half the width of the arc, in metres.
    const HALF_LINE: f32 = 0.02;
    let [from, to] = opening.span;
    let width = to - from;
    if out < 0.0 || along < from {
        return None;
    }
    let (run, radius) = (along - from, (along - from).hypot(out));
    let leaf = run < 0.045 && out < width;
    let arc = (radius - width).abs() < HALF_LINE;
    (leaf || arc).then_some(LINE)
}

#[cfg(test)]
mod tests {
    use calib_core::FloorPoint;

    use super::*;

    #[test]
    fn the_plan_shows_walls_and_columns_where_they_are() {
        let (picture, entry) = (render_plan(), plan_entry());
        let shade = |x: f64, y: f64| {
            let at = entry.scale().plan_from_floor(FloorPoint { x, y });
            picture.get_pixel(at.x as u32, at.y as u32).0[0]
        };
        assert_eq!(shade(-0.15, 5.0), WALL as u8);
        assert_eq!(shade(24.1, 3.0), WALL as u8);
        for [x, y] in COLUMNS {
            assert_eq!(shade(f64::from(x), f64::from(y)), WALL as u8);
        }
        assert_eq!(shade(14.1, 2.0), PAPER as u8);
        assert!(shade(-0.8, 0.0) == PAPER as u8, "the border is paper");
    }
}
