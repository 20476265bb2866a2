//! Snapshots from the addresses of cameras.

use std::fmt;

use ureq::http::Uri;

use crate::address::{Snapshot, SnapshotError, SnapshotOptions, without_credentials};
use crate::http;
#[cfg(feature = "rtsp")]
use crate::rtsp;

/// Reads an image from an address: a snapshot by `http` or `https` or, with the feature `rtsp`, the next key frame of
/// a video stream.
///
/// # Errors
///
/// Fails if the address is not valid, the camera does not answer in time, or its answer is not an image.
pub fn snapshot(address: &str, options: &SnapshotOptions) -> Result<Snapshot, SnapshotError> {
    let (address, in_address) = without_credentials(address.trim());
    let credentials = in_address.as_ref().or(options.credentials.as_ref());
    let invalid = |what: &dyn fmt::Display| SnapshotError::invalid(&address, what);
    if has_split_password(&address) {
        let what = "has a port that is not a number. In a password, write / as %2F and @ as %40";
        return Err(SnapshotError::invalid(&address, what));
    }
    let address = lower_scheme(&address);
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
                "is not an {kinds} address. Use the snapshot address of the camera (see its manual), or save one frame of its \
                 video, for example with `ffmpeg -i ADDRESS -frames:v 1 still.png`"
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

/// Returns an address with its scheme in lower case. Some keyboards capitalise the first letter.
fn lower_scheme(address: &str) -> String {
    let (scheme, rest) = address.split_once("://").unwrap_or(("", address));
    if scheme.is_empty() { address.to_owned() } else { format!("{}://{rest}", scheme.to_ascii_lowercase()) }
}

/// Whether a slash cuts the password off from its address, as in `http://admin:p/ss@host`: the port is not a number.
fn has_split_password(address: &str) -> bool {
    let rest = address.split_once("://").map_or("", |(_, rest)| rest);
    let authority = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let port = authority.rsplit(']').next().and_then(|rest| rest.split_once(':')).map(|(_, port)| port);
    port.is_some_and(|port| !port.chars().all(|c| c.is_ascii_digit()))
}
