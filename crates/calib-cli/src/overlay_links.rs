//! What a camera's image shows of links and marks: where they were drawn, and where they are.

use calib_core::{Site, SiteCamera};

use crate::agreement::elements;
use crate::style;
use crate::svg::{Anchor, Stroke, Svg};

/// What was there to draw.
#[derive(Clone, Copy)]
pub(crate) struct Shared {
    pub(crate) has_any: bool,
    /// Something was set aside.
    pub(crate) has_aside: bool,
}

/// Links and marks that this camera shows: a ring where they were drawn, a cross where they are, and the
/// way between.
pub(crate) fn draw(svg: &mut Svg, site: &Site, entry: &SiteCamera) -> Shared {
    let mut shared = Shared { has_any: false, has_aside: false };
    for element in elements(site) {
        for view in element.views.iter().filter(|view| std::ptr::eq(view.entry, entry)) {
            shared.has_any = true;
            shared.has_aside |= element.is_aside;
            let colour = if element.is_aside { style::BAD } else { style::WHITE };
            let stroke =
                Stroke { opacity: if element.is_off { 0.5 } else { 1.0 }, ..Stroke::new(colour, 1.25) };
            let crosses: Vec<[f64; 2]> = view.sightings.iter().map(|seen| seen.shown.into()).collect();
            if element.is_long {
                svg.line(&crosses, false, stroke);
            }
            for seen in &view.sightings {
                let drawn = seen.drawn.into();
                svg.line(&[drawn, seen.shown.into()], false, stroke);
                svg.ring(drawn, style::HANDLE + 1.0, stroke);
                cross(svg, seen.shown.into(), stroke);
            }
            // A mark's own drawing has its name.
            if let Some([x, y]) = crosses.first().filter(|_| element.what == "link") {
                let arm = 7.0 * svg.scale;
                svg.text([x + arm, y - 0.6 * arm], &element.id, colour, Anchor::Start);
            }
        }
    }
    shared
}

fn cross(svg: &mut Svg, [u, v]: [f64; 2], stroke: Stroke) {
    let arm = 4.0 * svg.scale;
    svg.line(&[[u - arm, v], [u + arm, v]], false, stroke);
    svg.line(&[[u, v - arm], [u, v + arm]], false, stroke);
}
