//! Sheet for an image from the address of a camera.

use std::path::Path;

use egui::Context;

use crate::choice::Chosen;
use crate::platform::{Here, Platform as _, SnapshotFile, SnapshotRequest, Task};
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
    /// Reading that is running.
    pub(crate) reading: Option<Task<Result<SnapshotFile, String>>>,
    pub(crate) error: Option<String>,
}

impl std::fmt::Debug for AddressSheet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("AddressSheet").field("camera", &self.camera).finish_non_exhaustive()
    }
}

impl AddressSheet {
    /// Starts reading the image.
    pub(crate) fn read(&mut self, ctx: &Context) {
        self.error = None;
        self.reading = Some(Here::snapshot(
            ctx,
            SnapshotRequest {
                address: self.address.trim().to_owned(),
                user: self.user.clone(),
                password: self.password.clone(),
                accepts_any_certificate: self.accepts_any_certificate,
            },
        ));
    }

    /// Saves an image that was read in the folder of `site`.
    pub(crate) fn save(&self, found: SnapshotFile, site: Option<&Path>) -> Chosen {
        let typed = if self.camera.trim().is_empty() { host(&self.address) } else { self.camera.trim() };
        let name: String =
            typed.chars().map(|c| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '-' }).collect();
        save_image(site, name.trim_start_matches('.'), found.ending, found.bytes)
    }
}

/// Returns the host of an address, without name, password and port.
fn host(address: &str) -> &str {
    let rest = address.trim().split_once("://").map_or(address.trim(), |(_, rest)| rest);
    let authority = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let host = authority.rsplit('@').next().unwrap_or_default();
    let host = host.split(':').next().unwrap_or_default();
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
            ("https://?", "camera"),
        ] {
            assert_eq!(host(address), expected);
        }
    }
}
