//! SVG image of the site from above: plan, EFOVs, cameras. One unit is a plan pixel, or a centimetre without
//! a plan.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use calib_core::{FloorPoint, PlanPixel, PlanScale};

use crate::export::{Export, Scene};
use crate::file::File;
use crate::tree::escaped;

/// Colours of the cameras. Further cameras repeat them from the first.
const COLOURS: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f3c8d", "#8c613c"];
/// Size of a unit of the SVG for a site without a plan, in metres.
const UNIT_M: f64 = 0.01;

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let scale = scene.site.plan.as_ref().map_or(
        PlanScale { metres_per_px: UNIT_M, origin: PlanPixel::default(), x_axis: 0.0 },
        calib_site::Plan::scale,
    );
    let at = |point: FloorPoint| <[f64; 2]>::from(scale.plan_from_floor(point));
    let mut corners: Vec<[f64; 2]> = Vec::new();
    for view in &scene.views {
        corners.extend(view.efov_m.iter().copied().chain([view.camera.position.on_floor()]).map(at));
    }
    let picture = scene.options.plan.as_ref();
    if let Some(plan) = picture {
        corners.extend([[0.0, 0.0], plan.size.map(f64::from)]);
    }
    let (low, high) = corners.iter().fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), p| {
        ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])])
    });
    let [w, h] = [high[0] - low[0], high[1] - low[1]].map(|side| side.max(1.0));
    let unit = w.max(h) / 100.0;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{:.2} {:.2} {:.2} {:.2}\" font-family=\"sans-serif\" font-size=\"{:.2}\">\n",
        low[0] - 3.0 * unit,
        low[1] - 3.0 * unit,
        w + 6.0 * unit,
        h + 6.0 * unit,
        2.0 * unit
    );
    if let Some(plan) = picture {
        let [width, height] = plan.size;
        let href = if scene.options.embeds {
            format!("data:image/png;base64,{}", STANDARD.encode(&plan.png))
        } else {
            export.files.push(File { name: "plan.png".into(), bytes: plan.png.clone() });
            "plan.png".into()
        };
        let _ =
            writeln!(text, "<image href=\"{href}\" width=\"{width}\" height=\"{height}\" opacity=\"0.6\"/>");
    }
    for (index, view) in scene.views.iter().enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        let foot = at(view.camera.position.on_floor());
        draw(&mut text, view, colour, foot, unit, &at);
    }
    text += "</svg>\n";
    export.push("site.svg", text);
}

fn draw(
    text: &mut String,
    view: &crate::view::View,
    colour: &str,
    [x, y]: [f64; 2],
    unit: f64,
    at: &impl Fn(FloorPoint) -> [f64; 2],
) {
    let points: Vec<String> =
        view.efov_m.iter().map(|&p| at(p)).map(|[x, y]| format!("{x:.2},{y:.2}")).collect();
    let stroke = 0.3 * unit;
    let _ = writeln!(
        text,
        "<polygon points=\"{}\" fill=\"{colour}\" fill-opacity=\"0.2\" stroke=\"{colour}\" stroke-width=\"{stroke:.2}\"/>",
        points.join(" ")
    );
    let (sin, cos) = view.camera.yaw.sin_cos();
    let ahead = view.camera.position.on_floor();
    let [tx, ty] = at(FloorPoint::new(ahead.x - sin, ahead.y + cos));
    let length = (tx - x).hypot(ty - y).max(1e-9) / (2.5 * unit);
    let _ = writeln!(
        text,
        "<path d=\"M{x:.2} {y:.2}L{:.2} {:.2}\" stroke=\"{colour}\" stroke-width=\"{stroke:.2}\"/>\n\
         <circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{unit:.2}\" fill=\"{colour}\"/>\n\
         <text x=\"{:.2}\" y=\"{:.2}\" fill=\"{colour}\">{}</text>",
        x + (tx - x) / length,
        y + (ty - y) / length,
        x + 1.4 * unit,
        y - 0.6 * unit,
        escaped(&view.id)
    );
}
