//! Horizon and lens grid on the raw image, both curved by the distortion.
//!
//! Every line of the lens grid is straight in the scene.

use calib_core::floor::lens_reach;
use calib_core::{Camera, Lens, Pixel, UndistortedPixel};

use crate::image::ImageView;
use crate::item::{Geometry, Item, Meaning};

/// Returns the horizon of a camera, with a label if the view has labels.
pub(super) fn horizon_items(view: &ImageView) -> Vec<Item<Pixel>> {
    let (Some(camera), Some(entry)) = (view.pose, view.entry()) else { return Vec::new() };
    let mut items = horizon(&camera, entry.size());
    if let Some(scale) = view.label_scale {
        items.extend(horizon_label(&items, entry.size(), scale));
    }
    items
}

/// Returns the horizon of a camera on an image; `size` is its width and height in pixels.
#[must_use]
pub fn horizon(camera: &Camera, size: [f64; 2]) -> Vec<Item<Pixel>> {
    let pieces = calib_core::horizon(camera, size).into_iter();
    pieces.map(|piece| Item::polyline(Meaning::Horizon, piece)).collect()
}

/// Returns the label "horizon" near the right end of the horizon. `scale` is the size of letters relative to
/// the screen.
fn horizon_label(items: &[Item<Pixel>], [w, h]: [f64; 2], scale: f64) -> Option<Item<Pixel>> {
    let is_shown = |p: &&Pixel| p.u > 0.1 * w && p.u < 0.9 * w && p.v > 48.0 * scale && p.v < h;
    let points = items.iter().flat_map(|item| match &item.geometry {
        Geometry::Polyline(points) => points.as_slice(),
        _ => &[],
    });
    let at = points.filter(is_shown).max_by(|a, b| a.u.total_cmp(&b.u))?;
    Some(Item::label(Meaning::Horizon, *at, "horizon".into()))
}

/// Number of grid columns across the middle of the image.
const GRID_COLUMNS: f64 = 12.0;
/// Largest side of a grid cell, in image widths. Strong distortion makes the undistorted plane very large; the
/// limit ensures enough grid lines in the middle of the image.
const MAX_CELL_REL: f64 = 1.0 / 8.0;
/// Largest distance of grid lines from the principal point on the undistorted plane, in image widths.
const MAX_EXTENT_REL: f64 = 1.5;

/// Returns the grid that shows the distortion of the lens.
pub(super) fn lens_grid(view: &ImageView) -> Vec<Item<Pixel>> {
    let Some(entry) = view.entry() else { return Vec::new() };
    let Some(lens) = view.lens() else { return Vec::new() };
    let size = entry.size();
    let lines = if lens.distortion.is_wide() { fisheye_grid(&lens, size) } else { pinhole_grid(&lens, size) };
    lines.into_iter().map(|line| Item::polyline(Meaning::LensGrid, line)).collect()
}

/// Returns the grid of a fisheye lens in raw pixels, clipped to the image and the lens model. Its lines are
/// great circles: columns through the directions up and down, rows through the directions left and right of
/// the camera.
fn fisheye_grid(lens: &Lens, size: [f64; 2]) -> Vec<Vec<Pixel>> {
    use std::f64::consts::{PI, TAU};
    let across = (0..=32).filter_map(|i| {
        let [x, _, w] = lens.bearing(Pixel::new(size[0] * f64::from(i) / 32.0, lens.principal_point.v))?;
        Some((x / lens.focal).atan2(w).abs())
    });
    // The smallest round angular step with at most `GRID_COLUMNS` columns, otherwise the largest round step.
    let side = across.fold(0.0, f64::max).to_degrees();
    let step: f64 =
        [5.0, 10.0, 15.0].into_iter().find(|step| 2.0 * side <= GRID_COLUMNS * step).unwrap_or(15.0);
    let count = (180.0 / step) as i32;
    let rim = max_grid_angle(lens, size);
    let shown = |[x, y, w]: [f64; 3]| {
        let within = x.hypot(y).atan2(w) <= rim;
        lens.bearing_to_pixel([lens.focal * x, lens.focal * y, w]).filter(|_| within)
    };
    let mut found = Vec::new();
    for turn in (0..count).map(|i| (f64::from(i) * step).to_radians()) {
        let (sin, cos) = turn.sin_cos();
        // For t from -1 to 1: one full circle that starts and ends behind the camera, outside every field of view.
        let along = |t: f64| (PI + 0.5 * TAU * (1.0 + t)).sin_cos();
        let column = |t: f64| {
            let (s, c) = along(t);
            shown([sin * c, s, cos * c])
        };
        let row = |t: f64| {
            let (s, c) = along(t);
            shown([s, sin * c, cos * c])
        };
        found.extend(visible_pieces(size, column).into_iter().chain(visible_pieces(size, row)));
    }
    found
}

/// Returns the largest angle between grid lines and the axis of a fisheye lens, in radians. It is the angle
/// at the rim of the image circle if this circle is inside the image; otherwise it is unlimited.
fn max_grid_angle(lens: &Lens, size: [f64; 2]) -> f64 {
    /// Smallest angle at the rim of an image circle inside the image, in degrees. A lens with a smaller angle
    /// at the sides of its image has a larger one in the corners.
    const MIN_CIRCLE_ANGLE_DEG: f64 = 85.0;
    Some(lens_reach(lens, lens.focal, size))
        .filter(|reach| *reach > MIN_CIRCLE_ANGLE_DEG.to_radians())
        .unwrap_or(f64::MAX)
}

/// Returns the grid of a lens that is not a fisheye: columns and rows of the undistorted plane in raw pixels,
/// clipped to the image and the lens model.
fn pinhole_grid(lens: &Lens, size: [f64; 2]) -> Vec<Vec<Pixel>> {
    let [w, h] = size;
    let centre = lens.principal_point;
    let share = |i: i32| f64::from(i) / 32.0;
    let [side, _] = grid_extent(lens, w, (0..=32).map(|i| Pixel::new(w * share(i), centre.v)));
    let [u, v] = grid_extent(lens, w, (0..33 * 33).map(|k| Pixel::new(w * share(k % 33), h * share(k / 33))));
    let cell = (2.0 * side / GRID_COLUMNS).min(MAX_CELL_REL * w);
    // A lens without valid pixels has no grid.
    let count = |reach: f64| if cell > 0.0 { (reach / cell) as i32 } else { -1 };
    let offsets = |count: i32| (-count..=count).map(move |i| f64::from(i) * cell);
    let at = |du: f64, dv: f64| lens.distort(UndistortedPixel { u: centre.u + du, v: centre.v + dv });
    let columns = offsets(count(u)).flat_map(|du| visible_pieces(size, |t| at(du, t * v)));
    let rows = offsets(count(v)).flat_map(|dv| visible_pieces(size, |t| at(t * u, dv)));
    columns.chain(rows).collect()
}

/// Returns the largest horizontal and vertical distances of undistorted pixels from the principal point, in
/// pixels. `width` is the width of the image in pixels.
fn grid_extent(lens: &Lens, width: f64, pixels: impl Iterator<Item = Pixel>) -> [f64; 2] {
    let Pixel { u: cu, v: cv } = lens.principal_point;
    pixels.filter_map(|pixel| lens.undistort(pixel)).fold([0.0, 0.0], |[u, v], seen| {
        [
            u.max((seen.u - cu).abs()).min(MAX_EXTENT_REL * width),
            v.max((seen.v - cv).abs()).min(MAX_EXTENT_REL * width),
        ]
    })
}

/// Returns the visible parts of an image curve. `line` maps a parameter from -1 to 1 to a raw pixel, or to
/// `None` outside the lens model.
fn visible_pieces([w, h]: [f64; 2], line: impl Fn(f64) -> Option<Pixel>) -> Vec<Vec<Pixel>> {
    /// Number of samples on each half of a curve.
    const SAMPLES: i32 = 400;
    // Margin around the image, in pixels: lines then reach the border of the image.
    let margin = 0.05 * w;
    let shown = |p: &Pixel| p.u > -margin && p.v > -margin && p.u < w + margin && p.v < h + margin;
    let points: Vec<Option<Pixel>> =
        (-SAMPLES..=SAMPLES).map(|i| line(f64::from(i) / f64::from(SAMPLES)).filter(shown)).collect();
    let pieces = points.split(Option::is_none).map(|piece| piece.iter().flatten().copied().collect());
    pieces.filter(|piece: &Vec<Pixel>| piece.len() > 1).collect()
}
