//! Sheet for an image from the address of a camera.

use egui::Context;

use crate::choice::Chosen;
use crate::platform::{Here, Platform as _, SnapshotFile, SnapshotRequest, Task};
use crate::state::App;
use crate::state::video::save_image;

/// Sheet for an image from the address of a camera. Name and password are kept only while it is open.
#[derive(Default)]
pub(crate) struct AddressSheet {
    pub(crate) address: String,
    pub(crate) user: String,
    pub(crate) password: String,
    pub(crate) accepts_any_certificate: bool,
    /// Name of the new camera; if it is empty, the host of the address is the name.
    pub(crate) camera: String,
    /// Whether the sheet was shown before.
    pub(crate) is_shown: bool,
    /// Current step of a running request.
    pub(crate) request: Option<SnapshotStep>,
    pub(crate) error: Option<String>,
}

/// Step of a running request to a camera.
pub(crate) enum SnapshotStep {
    /// Waiting for the image.
    Asking(Task<Result<SnapshotFile, String>>),
    /// Writing the image to the folder of the site.
    Saving {
        task: Task<Chosen>,
        /// Pixel aspect from the metadata of the video; 1 for images.
        pixel_aspect: f64,
    },
}

impl std::fmt::Debug for AddressSheet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("AddressSheet").field("camera", &self.camera).finish_non_exhaustive()
    }
}

impl AddressSheet {
    /// Starts reading the image.
    pub(crate) fn read(&mut self, ctx: &Context) {
        let asked = SnapshotRequest {
            address: self.address.trim().to_owned(),
            user: self.user.clone(),
            password: self.password.clone(),
            accepts_any_certificate: self.accepts_any_certificate,
        };
        self.error = None;
        self.request = Some(SnapshotStep::Asking(Here::snapshot(ctx, asked)));
    }

    /// Returns the name of the new camera: the typed name, or the host of the address.
    pub(crate) fn name(&self) -> String {
        let typed = self.camera.trim();
        if typed.is_empty() { host(&self.address).to_owned() } else { typed.to_owned() }
    }

    /// Continues a running request. Returns the image and its pixel aspect once it is saved.
    pub(crate) fn poll(&mut self, app: &App, ctx: &Context) -> Option<(Chosen, f64)> {
        match self.request.take()? {
            SnapshotStep::Asking(task) => match task.outcome() {
                None => self.request = Some(SnapshotStep::Asking(task)),
                Some(Ok(Ok(found))) => {
                    let safe = |c: char| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '-' };
                    let name: String = self.name().chars().map(safe).collect();
                    let neighbour = app.editor.session().path.clone();
                    let (ending, bytes, pixel_aspect) = (found.ending, found.bytes, found.pixel_aspect);
                    let save =
                        move || save_image(neighbour.as_deref(), name.trim_start_matches('.'), ending, bytes);
                    self.request = Some(SnapshotStep::Saving { task: Task::spawn(ctx, save), pixel_aspect });
                }
                Some(Ok(Err(error))) => self.error = Some(error),
                Some(Err(_)) => self.error = Some("Internal error; please report this.".into()),
            },
            SnapshotStep::Saving { task, pixel_aspect } => match task.poll() {
                None => self.request = Some(SnapshotStep::Saving { task, pixel_aspect }),
                Some(file) => return Some((file, pixel_aspect)),
            },
        }
        None
    }
}

/// Returns the host of an address, without name, password and port.
fn host(address: &str) -> &str {
    let rest = address.trim().split_once("://").map_or(address.trim(), |(_, rest)| rest);
    let authority = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let host = authority.rsplit('@').next().unwrap_or_default();
    let host = match host.strip_prefix('[') {
        Some(long) => long.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    if host.is_empty() { "camera" } else { host }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_host_is_found_without_secrets() {
        for (address, expected) in [
            ("http://admin:pass@10.0.0.5:8080/snap?x=1", "10.0.0.5"),
            ("rtsp://door.local/stream1", "door.local"),
            ("rtsp://[fe80::1]:554/", "fe80::1"),
            ("https://?", "camera"),
        ] {
            assert_eq!(host(address), expected);
        }
    }
}
