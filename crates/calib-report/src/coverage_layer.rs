//! Coverage on the plan: the visible floor coloured by its pixel density, walls, and areas of interest.

use calib_core::FloorPoint;
use calib_core::floor::{DensityLevel, LevelLimits};
use calib_draw::Rgb;
use calib_site::{Site, SiteCoverage, counted};

use crate::plan_quality::Sample;
use crate::svg::{Anchor, Stroke, Svg};

/// Colour of visible floor below all levels.
const BELOW_LEVELS: Rgb = Rgb::hex(0xD9DCDF);
/// Opacity of the colours over the plan.
const OPACITY: f64 = 0.72;

/// Returns the colour of a level. The colours are distinguishable with colour blindness and in print without
/// colour, because they become darker with the density (viridis, reversed).
pub const fn level_colour(level: Option<DensityLevel>) -> Rgb {
    match level {
        None => BELOW_LEVELS,
        Some(DensityLevel::Monitor) => Rgb::hex(0xFDE725),
        Some(DensityLevel::Detect) => Rgb::hex(0x7AD151),
        Some(DensityLevel::Observe) => Rgb::hex(0x22A884),
        Some(DensityLevel::Recognise) => Rgb::hex(0x2A788E),
        Some(DensityLevel::Identify) => Rgb::hex(0x414487),
    }
}

/// Returns the colour of floor that `cameras` cameras see. The number is at least one. One camera has the colour of the
/// lowest level, each further camera the colour of the next level.
pub fn count_colour(cameras: usize) -> Rgb {
    level_colour(DensityLevel::ALL.get(cameras.saturating_sub(1)).or(DensityLevel::ALL.last()).copied())
}

/// Describes a level and its smallest pixel density.
pub fn level_text(level: Option<DensityLevel>, limits: &LevelLimits) -> String {
    match level {
        None => format!("visible, below {} px/m", limits.of(DensityLevel::Monitor)),
        Some(level) => format!("{}, from {} px/m", level.name(), limits.of(level)),
    }
}

/// Returns the levels in the order of the legend; `None` is visible floor below all levels.
pub fn levels() -> impl Iterator<Item = Option<DensityLevel>> {
    std::iter::once(None).chain(DensityLevel::ALL.into_iter().map(Some))
}

/// Describes the walls that were made from the lines of a drawing, such as "4 walls added from WALLS; left out: 2
/// curves". `curves` and `short` are the numbers of lines that became no walls.
#[must_use]
pub fn added_walls_text(layers: &str, added: usize, curves: usize, short: usize) -> String {
    let left_out =
        [(curves, "curve", "curves"), (short, "line shorter than 0.1 m", "lines shorter than 0.1 m")];
    let left_out = left_out.into_iter().filter(|(count, ..)| *count > 0);
    let left_out: Vec<String> = left_out.map(|(count, one, more)| counted(count, one, more)).collect();
    let left_out =
        if left_out.is_empty() { String::new() } else { format!("; left out: {}", left_out.join(", ")) };
    format!("{} added from {layers}{left_out}", counted(added, "wall", "walls"))
}

/// Returns the entries of the legend.
pub(crate) fn legend(site: &Site) -> Vec<(Sample, String)> {
    let limits = site.level_limits();
    let mut rows: Vec<(Sample, String)> = levels()
        .map(|level| (Sample::Fill(level_colour(level), OPACITY), level_text(level, &limits)))
        .collect();
    if !site.walls.is_empty() {
        rows.push((Sample::Line(wall_stroke()), "wall".into()));
    }
    if !site.areas.is_empty() {
        rows.push((Sample::Line(area_stroke()), "area of interest".into()));
    }
    rows
}

/// Colours the visible floor.
pub(crate) fn draw_floor(
    svg: &mut Svg,
    coverage: &SiteCoverage<'_>,
    on_plan: &dyn Fn(FloorPoint) -> [f64; 2],
) {
    for rectangle in coverage.rectangles() {
        svg.tile(&rectangle.corners().map(on_plan), level_colour(rectangle.value), OPACITY);
    }
}

/// Draws the walls, and the outlines and names of the areas.
pub(crate) fn draw_survey(svg: &mut Svg, site: &Site, on_plan: &dyn Fn(FloorPoint) -> [f64; 2]) {
    for wall in &site.walls {
        svg.line(&[on_plan(wall.from_m), on_plan(wall.to_m)], false, wall_stroke());
    }
    for area in &site.areas {
        let corners: Vec<[f64; 2]> = area.polygon_m.iter().map(|&corner| on_plan(corner)).collect();
        svg.line(&corners, true, area_stroke());
        let mean =
            |axis: usize| corners.iter().map(|corner| corner[axis]).sum::<f64>() / corners.len() as f64;
        svg.ink([mean(0), mean(1)], area.name.as_deref().unwrap_or(&area.id), Rgb::INK, Anchor::Middle);
    }
}

const fn wall_stroke() -> Stroke<'static> {
    Stroke { outlined: false, ..Stroke::new(Rgb::INK, 4.0) }
}

const fn area_stroke() -> Stroke<'static> {
    Stroke { outlined: false, ..Stroke::new(Rgb::BAD_ON_LIGHT, 2.0) }
}
