//! Joint solve of a whole site; its poses are written into the site as placements.

use calib_core::Placement;

use calib_site::{Options, PlacementEntry, Site, Solution, Stage};

/// Returns the site with the jointly estimated poses of cameras and marks as placements, and with its
/// results.
#[must_use]
pub fn refined(mut site: Site) -> Site {
    let report = site.calibrate(&Options::default());
    for (index, result) in &report.cameras {
        let pose = result.as_ref().ok().filter(|s| s.stage == Stage::Refined);
        if let Some(pose) = pose.and_then(Solution::camera) {
            let entry = &mut site.cameras[*index];
            let found = PlacementEntry { estimated: true, ..rounded(Placement::from_camera(&pose)) };
            entry.placement = Some(keep_fixed_numbers(entry.placement.as_ref(), found));
        }
    }
    for (mark, found) in site.marks.iter_mut().zip(&report.marks) {
        let Some(found) = found.as_ref().filter(|_| !mark.fixed) else { continue };
        mark.turn_deg = found.turn_deg.unwrap_or(mark.turn_deg);
        // Map coordinates are a measurement, which the estimate does not replace.
        if !mark.has_map_coordinates() {
            mark.at_m = found.at_m;
        }
    }
    // The site is solved again from the new placements, as a program that opens the saved file does.
    site.calibrate(&Options::default()).write_into(&site)
}

/// Returns the new placement `now`, in which the fixed components keep exactly the values of `before`.
fn keep_fixed_numbers(before: Option<&PlacementEntry>, mut now: PlacementEntry) -> PlacementEntry {
    let Some(before) = before else { return now };
    let held = before.held;
    let pick = |is_held: bool, before: f64, now: f64| if is_held { before } else { now };
    now.move_m.x = pick(held.x, before.move_m.x, now.move_m.x);
    now.move_m.y = pick(held.y, before.move_m.y, now.move_m.y);
    now.turn_deg = pick(held.turn, before.turn_deg, now.turn_deg);
    PlacementEntry { fixed: before.fixed, held, estimated: now.estimated && !before.fixed, ..now }
}

/// Rounds a placement to 1e-6 m, 1e-6 degrees and a scale of 1e-8, to avoid meaningless digits in files.
pub(crate) fn rounded(placement: Placement) -> PlacementEntry {
    let round = |value: f64, digits: f64| (value * digits).round() / digits;
    let mut entry = PlacementEntry::from(placement);
    entry.move_m.x = round(entry.move_m.x, 1e6);
    entry.move_m.y = round(entry.move_m.y, 1e6);
    entry.turn_deg = round(entry.turn_deg, 1e6);
    entry.scale = entry.scale.map(|scale| round(scale, 1e8));
    entry
}
