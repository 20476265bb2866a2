//! Addresses of cameras, credentials, and errors.
//!
//! Secrets are sent only to the host of the address. They are never part of a message.

use std::fmt;
use std::time::Duration;

use image::RgbImage;

/// Name and password for a camera.
#[derive(Clone, PartialEq, Eq)]
pub struct Credentials {
    /// Name of the user.
    pub user: String,
    /// Password of the user.
    pub password: String,
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Credentials")
    }
}

/// Options for reading an image from an address.
#[derive(Clone, Debug)]
pub struct SnapshotOptions {
    /// Name and password, used if the address contains none.
    pub credentials: Option<Credentials>,
    /// Longest time for reading an address.
    pub timeout: Duration,
    /// Whether any HTTPS certificate is accepted, without verification.
    pub accepts_any_certificate: bool,
}

impl Default for SnapshotOptions {
    fn default() -> Self {
        Self { credentials: None, timeout: Duration::from_secs(15), accepts_any_certificate: false }
    }
}

/// Image from the address of a camera.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Decoded image.
    pub image: RgbImage,
    /// The JPEG file that the camera sent; `None` for another format and for video.
    pub jpeg: Option<Vec<u8>>,
    /// Pixel aspect `fy / fx` of a video; 1 for images.
    pub pixel_aspect: f64,
}

/// Kind of a [`SnapshotError`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SnapshotErrorKind {
    /// The address or its response is not usable.
    Invalid,
    /// The camera requires a user name and a password.
    NoCredentials,
    /// The connection or the camera failed.
    Failed,
}

/// Reason why a snapshot is missing. The text contains the address without its secrets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SnapshotError {
    /// Kind of the error.
    pub kind: SnapshotErrorKind,
    address: String,
    what: String,
}

impl SnapshotError {
    fn new(kind: SnapshotErrorKind, address: &str, what: impl fmt::Display) -> Self {
        // Texts of libraries can have several paragraphs, and can repeat the address.
        let what = what.to_string();
        let what = what.lines().next().unwrap_or_default().trim_end_matches('.');
        let unexpected = "did not answer as expected; check the address";
        let what = if repeats(what, address) { unexpected } else { what }.to_owned();
        Self { kind, address: shown(address), what }
    }

    pub(crate) fn invalid(address: &str, what: impl fmt::Display) -> Self {
        Self::new(SnapshotErrorKind::Invalid, address, what)
    }

    pub(crate) fn failed(address: &str, what: impl fmt::Display) -> Self {
        Self::new(SnapshotErrorKind::Failed, address, what)
    }

    pub(crate) fn without_credentials(address: &str) -> Self {
        let what = "requires a user name and a password";
        Self::new(SnapshotErrorKind::NoCredentials, address, what)
    }
}

impl fmt::Display for SnapshotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.address, self.what)
    }
}

impl std::error::Error for SnapshotError {}

/// Whether a text is an address and not the path of a file.
#[must_use]
pub fn is_address(source: &str) -> bool {
    source.split_once("://").is_some_and(|(scheme, _)| scheme.chars().all(|c| c.is_ascii_alphanumeric()))
}

/// Returns the part of an address for messages: without its query, and without a path like `/user=admin&password=x`.
fn shown(address: &str) -> String {
    let end = address.find(['?', '#']).unwrap_or(address.len());
    let (shown, cut) = address.split_at(end);
    let path_at =
        shown.find("://").and_then(|at| Some(at + 3 + shown[at + 3..].find('/')?)).unwrap_or(shown.len());
    match () {
        // A password with a slash looks like a path.
        () if address.contains('@') => "the address".into(),
        () if shown[path_at..].contains(['=', '&']) => format!("{}/\u{2026}", &shown[..path_at]),
        () if cut.is_empty() => shown.into(),
        () => format!("{shown}?\u{2026}"),
    }
}

/// Whether a text may reveal a secret of an address: it contains a value such as in `password=x`, or any address if
/// this address has such values.
fn repeats(text: &str, address: &str) -> bool {
    let rest = address.split_once("://").map_or(address, |(_, rest)| rest);
    let parts = rest.split(['/', '?', '#', '&', '_', '@']).skip(1);
    parts.flat_map(|part| part.split('=').skip(1)).any(|value| value.len() > 2 && text.contains(value))
        || text.contains("://") && address.contains(['?', '=', '@'])
}

/// Splits `user:password@` from an address.
pub(crate) fn without_credentials(address: &str) -> (String, Option<Credentials>) {
    let Some((scheme, rest)) = address.split_once("://") else { return (address.into(), None) };
    let end = rest.find(['/', '?', '#']).unwrap_or(rest.len());
    let Some(at) = rest[..end].rfind('@') else { return (address.into(), None) };
    let (user, password) = rest[..at].split_once(':').unwrap_or((&rest[..at], ""));
    let credentials = Credentials { user: percent_decoded(user), password: percent_decoded(password) };
    (format!("{scheme}://{}", &rest[at + 1..]), Some(credentials))
}

/// Decodes `%40` and similar codes of an address.
fn percent_decoded(text: &str) -> String {
    let bytes = text.as_bytes();
    let (mut decoded, mut at) = (Vec::new(), 0);
    while at < bytes.len() {
        let code = (bytes[at] == b'%').then(|| text.get(at + 1..at + 3)).flatten();
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => {
                decoded.push(byte);
                at += 3;
            }
            None => {
                decoded.push(bytes[at]);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credentials_leave_the_address() {
        let (address, credentials) = without_credentials("http://admin:p%40ss:1@10.0.0.5:8080/snap?user=a@b");
        let credentials = credentials.unwrap();
        assert_eq!(address, "http://10.0.0.5:8080/snap?user=a@b");
        assert_eq!((&credentials.user[..], &credentials.password[..]), ("admin", "p@ss:1"));
        assert!(without_credentials("https://camera.local/a@b").1.is_none());
        assert_eq!(shown("http://10.0.0.5/snap?password=x"), "http://10.0.0.5/snap?\u{2026}");
        assert_eq!(shown("http://admin:p/ss@10.0.0.5/snap"), "the address");
        assert_eq!(
            shown("rtsp://10.0.0.5:554/user=admin_password=x_stream=0.sdp"),
            "rtsp://10.0.0.5:554/\u{2026}"
        );
        assert!(is_address("rtsp://10.0.0.5/1") && !is_address("C:/clips/a.mp4") && !is_address("a.mp4"));
    }

    #[test]
    fn texts_of_libraries_do_not_repeat_secrets() {
        let address = "rtsp://10.0.0.5/user=admin_password=tlJwpbo6_stream=0.sdp";
        for text in ["no rtsp://10.0.0.5/x", "bad tlJwpbo6"] {
            let shown = SnapshotError::failed(address, text).to_string();
            assert_eq!(shown, "rtsp://10.0.0.5/\u{2026}: did not answer as expected; check the address");
        }
        let shown =
            SnapshotError::failed("http://10.0.0.5/snap.jpg?1", "responded with 401\n\nconn: x").to_string();
        assert_eq!(shown, "http://10.0.0.5/snap.jpg?\u{2026}: responded with 401");
    }
}
