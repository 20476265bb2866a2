//! Cameras of automatically calibrated images, placed relative to each other by the colours of the images,
//! and on a floor plan by the visible floor.

use calib_image::{PairDecision, PlacementSearch, SitePlacement, shrunk};
use calib_site::Site;
use image::RgbImage;

use crate::files::ThreadsArgs;
use crate::progress::Pulse;
use crate::stop::CommandError;

/// Places the calibrated cameras of a site relative to each other and, if `plan` is given, on this image of the floor
/// plan. `read` returns the image of a camera by its index in the site.
pub(crate) fn place(
    site: &Site,
    threads: ThreadsArgs,
    plan: Option<&RgbImage>,
    read: impl Fn(usize) -> Result<RgbImage, CommandError>,
) -> Result<SitePlacement, CommandError> {
    let cameras = match PlacementSearch::cameras(site) {
        Ok(cameras) => cameras,
        Err(reason) => return Ok(SitePlacement::refused(site, reason)),
    };
    let _pulse = Pulse::new("placing the cameras");
    let reduced = |&index: &usize| {
        let image = read(index)?;
        Ok(shrunk(&image, PlacementSearch::SIDE_PX).unwrap_or(image))
    };
    let images = cameras.iter().map(reduced).collect::<Result<Vec<_>, CommandError>>()?;
    let search = PlacementSearch::new(site, &cameras, &images, plan);
    drop(images);
    let pairs = threads.run(search.pairs(), |pair| Ok::<_, CommandError>(search.register(pair)), |_| ())?;
    let placement = search.place(site, &pairs, &mut |_| true);
    // The progress function never cancels.
    Ok(placement.unwrap_or_else(|| SitePlacement::refused(site, "the search was cancelled".into())))
}

/// Returns the lines of the text report about the placement.
pub(crate) fn text(placement: &SitePlacement, site: &Site) -> String {
    let mut out = format!("placement: {}: {}\n", confidence(placement.is_complete), placement.reason);
    for group in &placement.groups {
        let names: Vec<&str> = group.iter().map(|&camera| site.cameras[camera].id.as_str()).collect();
        out.push_str(&format!("  placed relative to each other: {}\n", names.join(", ")));
    }
    out
}

/// Returns the placement of the site as JSON: its confidence, the reason, and the compared pairs of cameras.
pub(crate) fn json(placement: &SitePlacement, site: &Site) -> serde_json::Value {
    let pairs = placement.pairs.iter().map(|pair| {
        serde_json::json!({
            "cameras": pair.cameras.map(|camera| site.cameras[camera].id.as_str()),
            "decision": match pair.decision {
                PairDecision::Found => "found",
                PairDecision::Ambiguous => "ambiguous",
                PairDecision::NotShown => "not-shown",
            },
            "score": pair.score,
            "ratio": pair.ratio,
        })
    });
    serde_json::json!({
        "confidence": confidence(placement.is_complete),
        "reason": placement.reason,
        "pairs": pairs.collect::<Vec<_>>(),
    })
}

/// Returns the placement of a camera as JSON: its confidence, its group and the reason.
pub(crate) fn camera_json(placement: &SitePlacement, camera: usize) -> serde_json::Value {
    let own = &placement.cameras[camera];
    serde_json::json!({
        "confidence": confidence(own.placement.is_some()),
        "group": own.group,
        "reason": own.reason,
    })
}

/// Returns the name of the confidence. It is never higher than `check`, because repeated structures in a scene
/// can cause a wrong placement.
const fn confidence(is_placed: bool) -> &'static str {
    if is_placed { "check" } else { "none" }
}
