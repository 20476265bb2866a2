//! Demonstration site, whose images are rendered on first use and cached on disk.

use std::path::PathBuf;

use calib_core::Camera;

use calib_editor::Images;
use calib_site::Site;

use crate::platform::{Here, Platform as _};

/// Returns the folder of the rendered images of the demonstration; `None` in the browser.
fn folder() -> Option<PathBuf> {
    Here::data_dir().map(|folder| folder.join("demonstration"))
}

/// Returns the demonstration site and its image source.
#[must_use]
pub fn open() -> (Site, Images) {
    let (site, images, _) = open_with_truth();
    (site, images)
}

/// Returns the demonstration site, its image source, and the true pose of its first camera.
#[must_use]
pub fn open_with_truth() -> (Site, Images, Option<Camera>) {
    let demo = calib_demo::demo_site();
    let truth = demo.truth.first().map(|(_, camera)| *camera);
    (demo.site, Images::in_folder(folder(), Some(render)), truth)
}

/// Renders an image of the demonstration site as PNG.
///
/// # Errors
/// When the site has no image of this name.
pub fn render(name: &str) -> Result<Vec<u8>, String> {
    let demo = calib_demo::demo_site();
    let is_plan = demo.site.plan.as_ref().and_then(|plan| plan.image.as_deref()) == Some(name);
    let entry = demo.site.cameras.iter().position(|camera| camera.image.as_deref() == Some(name));
    let image = match entry.and_then(|index| Some((demo.truth.get(index)?, demo.site.cameras.get(index)?))) {
        Some(((_, camera), entry)) => calib_demo::render(camera, entry.size_px),
        None if is_plan => calib_demo::render_plan(),
        None => return Err(format!("{name} is not an image of the demonstration site")),
    };
    let bytes = calib_editor::images::png(&image)?;
    if let Some(folder) = folder() {
        // After a failed write, the next use renders the image again.
        let _ = Here::write(&folder.join(name), &bytes);
    }
    Ok(bytes)
}
