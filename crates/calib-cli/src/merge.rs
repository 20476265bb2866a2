//! Cameras of another program in a site that is there: its lines, links and marks stay.

use calib_site::{Plan, Site, SiteCamera};

use crate::files::{SiteFile, say};
use crate::stop::Stop;
use calib_report::few;

/// The site with the cameras and the plan that were imported. What is there already is replaced only when that
/// is wanted.
pub(crate) fn merged(file: SiteFile, imported: Site, replaces: bool) -> Result<Site, Stop> {
    let SiteFile { mut site, path, .. } = file;
    let (mut added, mut taken) = (Vec::new(), Vec::new());
    for camera in imported.cameras {
        let mut of_id = site.cameras.iter_mut().filter(|entry| entry.id == camera.id);
        match (of_id.next(), of_id.next()) {
            (None, _) => {
                added.push(camera.id.clone());
                site.cameras.push(camera);
            }
            (Some(entry), None) => {
                taken.push(camera.id.clone());
                take(entry, camera, &path)?;
            }
            (Some(_), Some(_)) => {
                let what =
                    format!("several periods of camera \"{}\" are there; choose one by hand", camera.id);
                return Err(Stop::invalid(path, what));
            }
        }
    }
    let mut there: Vec<String> = taken.iter().map(|id| format!("camera \"{id}\"")).collect();
    if let Some(plan) = imported.plan {
        there.extend(site.plan.is_some().then(|| "a plan".into()));
        site.plan = Some(with_picture(plan, site.plan));
    }
    if !replaces && !there.is_empty() {
        let what =
            format!("has {} already; --replace takes lens and pose, or the plan, in its place", list(&there));
        return Err(Stop::invalid(path, what));
    }
    site.check().map_err(|error| Stop::invalid(&path, format!("merged, {error}")))?;
    tell(&path, &added, &there);
    Ok(site)
}

fn list(names: &[String]) -> String {
    few(names.iter().map(String::as_str))
}

fn tell(path: &str, added: &[String], replaced: &[String]) {
    if !added.is_empty() {
        say(format_args!("added to {path}: {}", list(added)));
    }
    if !replaced.is_empty() {
        say(format_args!("replaced in {path}: lens and pose, or scale and place, of {}", list(replaced)));
    }
}

/// What is drawn belongs to an image of one size.
fn take(entry: &mut SiteCamera, camera: SiteCamera, path: &str) -> Result<(), Stop> {
    if entry.size_px != camera.size_px {
        let ([w, h], [found_w, found_h]) = (entry.size_px, camera.size_px);
        let what = format!(
            "camera \"{}\" has {w} x {h} pixels, and what is imported {found_w} x {found_h}; scale it first",
            entry.id
        );
        return Err(Stop::invalid(path, what));
    }
    entry.lens = camera.lens;
    entry.solution = camera.solution.or(entry.solution.take());
    entry.error = None;
    entry.image = entry.image.take().or(camera.image);
    let is_new = |point: &calib_site::ControlPointEntry| !entry.control_points.contains(point);
    let new: Vec<_> = camera.control_points.into_iter().filter(is_new).collect();
    entry.control_points.extend(new);
    Ok(())
}

/// A world file names no picture that it knows to be there.
fn with_picture(plan: Plan, there: Option<Plan>) -> Plan {
    let Some(there) = there else { return plan };
    Plan { image: there.image.or(plan.image), georeference: plan.georeference.or(there.georeference), ..plan }
}
