//! North arrow of the plan, for sites with a georeference.

use calib_core::FloorPoint;
use calib_editor::Session;
use egui::{Align2, Painter, Vec2};

use crate::canvas::Mapping;
use crate::paint::{Pen, line, tag};
use crate::theme::on_image;

/// Length of the arrow, in points of the screen.
const LENGTH: f32 = 32.0;

/// Paints the direction of north, with its standard deviation if it is estimated.
pub(crate) fn paint_north(session: &Session, mapping: &Mapping, painter: &Painter) {
    let Some(georeference) = session.georeference() else { return };
    let (sin, cos) = georeference.x_axis_azimuth_deg.to_radians().sin_cos();
    let at = |x: f64, y: f64| mapping.screen(FloorPoint { x, y }.into());
    let north = (at(cos, sin) - at(0.0, 0.0)).normalized();
    let centre = painter.clip_rect().right_top() + Vec2::new(-36.0, 44.0);
    let (foot, tip) = (centre - 0.5 * LENGTH * north, centre + 0.5 * LENGTH * north);
    let pen = Pen::new(on_image::WHITE, 2.0);
    line(painter, &[foot, tip], pen);
    let side = 0.25 * LENGTH * north.rot90();
    let barb = tip - 0.3 * LENGTH * north;
    line(painter, &[barb + side, tip, barb - side], pen);
    let sigma =
        session.north_sigma_deg().map_or_else(String::new, |sigma| format!(" \u{b1} {sigma:.1}\u{b0}"));
    tag(
        painter,
        centre + Vec2::new(0.0, LENGTH),
        Align2::CENTER_CENTER,
        &format!("N{sigma}"),
        on_image::WHITE,
    );
}
