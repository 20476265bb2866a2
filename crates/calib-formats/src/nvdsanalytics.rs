//! DeepStream's nvdsanalytics: one region of interest for each stream, the EFOV, in whole pixels.
//!
//! Streams are numbered in the order of the cameras in the site.

use crate::export::{Export, Scene};
use crate::frigate::corners;

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let Some(first) = scene.views.first() else { return };
    // All streams share one configured size, and regions are scaled to it.
    let [width, height] = first.size;
    let mut text = format!("[property]\nenable=1\nconfig-width={width}\nconfig-height={height}\n");
    let mut streams: Vec<&str> = Vec::new();
    for camera in &scene.site.cameras {
        if !streams.contains(&camera.id.as_str()) {
            streams.push(&camera.id);
        }
    }
    for view in &scene.views {
        let index = streams.iter().position(|id| *id == view.id).unwrap_or_default();
        let corners = corners(view);
        if corners.len() < 3 {
            export.add_loss(view, "its region: no part of the EFOV is in the image");
            continue;
        }
        let [sx, sy] =
            [f64::from(width) / f64::from(view.size[0]), f64::from(height) / f64::from(view.size[1])];
        let numbers: Vec<String> =
            corners.iter().flat_map(|p| [p.u * sx, p.v * sy]).map(|value| format!("{value:.0}")).collect();
        let id: String = view.id.chars().filter(|c| !c.is_control()).collect();
        text += &format!(
            "\n# {id}\n[roi-filtering-stream-{index}]\nenable=1\nroi-floor={}\ninverse-roi=0\nclass-id=-1\n",
            numbers.join(";")
        );
    }
    export.push(format!("nvdsanalytics.{}", scene.extension), text);
    export.notes.push(
        "streams are numbered in the order of the cameras in the site, including cameras that are not exported".into(),
    );
}
