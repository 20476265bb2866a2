//! Snapshots from the addresses of cameras.

use std::fmt;

use ureq::http::Uri;

use crate::address::{Snapshot, SnapshotError, SnapshotOptions, without_credentials};
use crate::http;
#[cfg(feature = "rtsp")]
use crate::rtsp;

/// Reads the snapshot of an address: `http`, `https` or, with the feature `rtsp`, the next key frame of a video
/// stream.
///
/// # Errors
///
/// Fails if the address is not valid, the camera does not answer in time, or its answer is not an image.
pub fn snapshot(address: &str, options: &SnapshotOptions) -> Result<Snapshot, SnapshotError> {
    let (address, in_address) = without_credentials(address.trim());
    let credentials = in_address.as_ref().or(options.credentials.as_ref());
    let invalid = |what: &dyn fmt::Display| SnapshotError::invalid(&address, what);
    let uri: Uri = address.parse().map_err(|_| {
        invalid(&"is not a valid address. Use an address such as http://192.168.1.10/snapshot.jpg, without spaces")
    })?;
    match uri.scheme_str() {
        Some("http" | "https") => {}
        #[cfg(feature = "rtsp")]
        Some("rtsp") => return rtsp::read(&address, credentials, options.timeout),
        _ => {
            let kinds = if cfg!(feature = "rtsp") { "http, https or rtsp" } else { "http or https" };
            return Err(invalid(&format!(
                "is not an {kinds} address. Use the snapshot address of the camera (see its manual), or save one frame, \
                 for example with `ffmpeg -i ADDRESS -frames:v 1 still.png`"
            )));
        }
    }
    let bytes = http::fetch(uri, credentials, options)?;
    let image = calib_input::decode(&bytes).map_err(|error| {
        invalid(&format!("returned {} bytes that are not an image: {error}", bytes.len()))
    })?;
    let jpeg = bytes.starts_with(b"\xff\xd8").then_some(bytes);
    Ok(Snapshot { image, jpeg, pixel_aspect: 1.0 })
}
