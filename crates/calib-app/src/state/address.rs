//! Sheet for an image from the address of a camera.

use egui::Context;

use crate::choice::Chosen;
use crate::platform::{Here, Platform as _, SnapshotRequest, Task};
use crate::state::App;
use crate::state::video::save_image;

/// Sheet for an image from the address of a camera. Name and password are kept only while it is open.
#[derive(Default)]
pub(crate) struct AddressSheet {
    pub(crate) address: String,
    pub(crate) user: String,
    pub(crate) password: String,
    pub(crate) accepts_any_certificate: bool,
    /// Name of the new camera; empty: the host of the address.
    pub(crate) camera: String,
    /// Whether the sheet was shown before.
    pub(crate) is_shown: bool,
    /// Reading that is running.
    pub(crate) reading: Option<Reading>,
    pub(crate) error: Option<String>,
}

/// Steps of the reading of an address.
pub(crate) enum Reading {
    /// The camera is asked.
    Asking(Task<Result<crate::platform::SnapshotFile, String>>),
    /// The image is written to the folder of the site.
    Saving {
        /// Saved image.
        task: Task<Chosen>,
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
        let request = SnapshotRequest {
            address: self.address.trim().to_owned(),
            user: self.user.clone(),
            password: self.password.clone(),
            accepts_any_certificate: self.accepts_any_certificate,
        };
        self.error = None;
        self.reading = Some(Reading::Asking(Here::snapshot(ctx, request)));
    }

    /// Returns the name of the new camera: the typed name, or the host of the address.
    pub(crate) fn name(&self) -> String {
        let typed = self.camera.trim();
        if typed.is_empty() { host(&self.address).to_owned() } else { typed.to_owned() }
    }

    /// Takes the next step of a running reading. Returns the image and its pixel aspect once it is saved.
    pub(crate) fn poll(&mut self, app: &App, ctx: &Context) -> Option<(Chosen, f64)> {
        match self.reading.take()? {
            Reading::Asking(task) => match task.outcome() {
                None => self.reading = Some(Reading::Asking(task)),
                Some(Ok(Ok(found))) => {
                    let safe = |c: char| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '-' };
                    let name: String = self.name().chars().map(safe).collect();
                    let neighbour = app.editor.session().path.clone();
                    let (ending, bytes, pixel_aspect) = (found.ending, found.bytes, found.pixel_aspect);
                    let save =
                        move || save_image(neighbour.as_deref(), name.trim_start_matches('.'), ending, bytes);
                    self.reading = Some(Reading::Saving { task: Task::spawn(ctx, save), pixel_aspect });
                }
                Some(Ok(Err(error))) => self.error = Some(error),
                Some(Err(_)) => self.error = Some("Internal error; please report this.".into()),
            },
            Reading::Saving { task, pixel_aspect } => match task.poll() {
                None => self.reading = Some(Reading::Saving { task, pixel_aspect }),
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
