//! Snapshots of cameras by HTTP or HTTPS, with Basic or Digest authentication.
//!
//! Secrets come from the environment or from a file, and are sent only to the host of the address. They are never
//! printed or written.

use std::path::PathBuf;
use std::time::Duration;

use digest_auth::AuthContext;
use image::RgbImage;
use ureq::http::{Response, StatusCode, Uri};
use ureq::{Agent, Body};

use crate::args::OutputArgs;
use crate::stop::CommandError;

/// Name of the environment variable with the user's name.
const USER: &str = "CALIB_CAMERA_USER";
/// Name of the environment variable with the password.
const PASSWORD: &str = "CALIB_CAMERA_PASSWORD";
/// Largest size of a snapshot, in bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Largest number of redirects.
const MAX_REDIRECTS: usize = 3;

/// Arguments for the address of a camera.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct SnapshotArgs {
    /// File with the user name on its first line and the password on its second [default: the environment
    /// variables `CALIB_CAMERA_USER` and `CALIB_CAMERA_PASSWORD`]
    #[arg(long, value_name = "FILE")]
    pub(crate) credentials: Option<PathBuf>,
    /// Maximum time for a snapshot, in seconds
    #[arg(long, value_name = "S", default_value = "15", value_parser = clap::value_parser!(u64).range(1..=600))]
    timeout: u64,
    /// Accept an HTTPS certificate that no authority has signed, as is usual for cameras
    #[arg(long)]
    insecure: bool,
}

/// Name and password for a camera.
struct Credentials {
    user: String,
    password: String,
}

/// Whether a source is an address and not a file.
pub(crate) fn is_address(source: &str) -> bool {
    source.split_once("://").is_some_and(|(scheme, _)| scheme.chars().all(|c| c.is_ascii_alphanumeric()))
}

/// Writes the snapshot of an address.
pub(crate) fn run(address: &str, args: &SnapshotArgs, output: &OutputArgs) -> Result<(), CommandError> {
    let (bytes, image) = read(address, args)?;
    // A JPEG stays as the camera sent it.
    if output.is_jpeg()? && is_jpeg(&bytes) { output.write(&bytes) } else { output.write_image(&image) }
}

/// Whether these bytes are a JPEG image.
pub(crate) fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\xff\xd8")
}

/// Reads the snapshot of an address: the file, and its image.
pub(crate) fn read(address: &str, args: &SnapshotArgs) -> Result<(Vec<u8>, RgbImage), CommandError> {
    let (address, in_address) = without_credentials(address);
    let credentials = match in_address {
        Some(credentials) => Some(credentials),
        None => read_credentials(args)?,
    };
    let uri: Uri = address.parse().map_err(|_| {
        invalid(
            &address,
            "is not a valid address. Use an address such as http://192.168.1.10/snapshot.jpg, without spaces",
        )
    })?;
    if !matches!(uri.scheme_str(), Some("http" | "https")) {
        let what = "is not an http or https address. Use the snapshot address of the camera (see its manual), \
                    or save one frame, for example with `ffmpeg -i ADDRESS -frames:v 1 still.png`";
        return Err(invalid(&address, what));
    }
    let bytes = fetch(uri, credentials.as_ref(), args)?;
    let image = calib_input::decode(&bytes).map_err(|error| {
        invalid(&address, format!("returned {} bytes that are not an image: {error}", bytes.len()))
    })?;
    Ok((bytes, image))
}

fn invalid(address: &str, what: impl std::fmt::Display) -> CommandError {
    CommandError::invalid(shown(address), what)
}

/// Returns the part of an address for messages: without the query, which may contain a password.
fn shown(address: &str) -> String {
    let end = address.find(['?', '#']).unwrap_or(address.len());
    let (shown, cut) = address.split_at(end);
    match () {
        // A password with a slash looks like a path.
        () if address.contains('@') => "the address".into(),
        () if cut.is_empty() => shown.into(),
        () => format!("{shown}?\u{2026}"),
    }
}

/// Returns the failure of a request.
fn failed(uri: &Uri, what: impl std::fmt::Display) -> CommandError {
    CommandError::Failed(anyhow::anyhow!("{}: {what}", shown(&uri.to_string())))
}

/// Splits `user:password@` from an address.
fn without_credentials(address: &str) -> (String, Option<Credentials>) {
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

/// Reads name and password from the file or from the environment.
fn read_credentials(args: &SnapshotArgs) -> Result<Option<Credentials>, CommandError> {
    let Some(path) = &args.credentials else {
        let variable = |name| std::env::var(name).ok();
        return Ok(
            variable(USER).map(|user| Credentials { user, password: variable(PASSWORD).unwrap_or_default() })
        );
    };
    let text = std::fs::read_to_string(path).map_err(|error| CommandError::invalid(path.display(), error))?;
    let mut lines = text.lines();
    match (lines.next(), lines.next()) {
        (Some(user), Some(password)) => {
            Ok(Some(Credentials { user: user.trim().into(), password: password.trim_end().into() }))
        }
        _ => {
            let what = "expected the user name on the first line and the password on the second";
            Err(CommandError::invalid(path.display(), what))
        }
    }
}

/// Reads the body of an address, with its redirects and with authentication on demand.
fn fetch(
    mut uri: Uri,
    credentials: Option<&Credentials>,
    args: &SnapshotArgs,
) -> Result<Vec<u8>, CommandError> {
    let tls = ureq::tls::TlsConfig::builder().disable_verification(args.insecure).build();
    let agent: Agent = Agent::config_builder()
        .http_status_as_error(false)
        .max_redirects(0)
        .timeout_global(Some(Duration::from_secs(args.timeout)))
        .tls_config(tls)
        .build()
        .into();
    let first = uri.clone();
    for _ in 0..=MAX_REDIRECTS {
        let credentials = credentials.filter(|_| may_get_credentials(&first, &uri));
        let mut response = get(&agent, &uri, None)?;
        if response.status() == StatusCode::UNAUTHORIZED
            && let Some(credentials) = credentials
        {
            let header = authorization(&response, &uri, credentials)?;
            response = get(&agent, &uri, Some(&header))?;
        }
        let status = response.status();
        match status {
            StatusCode::UNAUTHORIZED if !may_get_credentials(&first, &uri) => {
                let what = "requires a user name and a password, which are not sent after a redirect from \
                            another host; enter this address directly";
                return Err(failed(&uri, what));
            }
            StatusCode::UNAUTHORIZED if credentials.is_none() => {
                let what = format!(
                    "requires a user name and a password: set {USER} and {PASSWORD}, or use --credentials"
                );
                return Err(failed(&uri, what));
            }
            StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN if credentials.is_some() => {
                return Err(failed(&uri, format!("rejected the user name or password ({status})")));
            }
            _ if status.is_redirection() => uri = redirected(&uri, &response)?,
            _ if status.is_success() => {
                if is_stream(&response) {
                    return Err(failed(&uri, "is a video stream; use the snapshot address of the camera"));
                }
                let body = response.body_mut().with_config().limit(MAX_BYTES).read_to_vec();
                return body.map_err(|error| failed(&uri, error));
            }
            _ => return Err(failed(&uri, format!("responded with {status}"))),
        }
    }
    Err(failed(&uri, format!("more than {MAX_REDIRECTS} redirects")))
}

/// Whether credentials for an address may be sent to another one: to the same port of the same host, or to the
/// same host by HTTPS.
fn may_get_credentials(first: &Uri, uri: &Uri) -> bool {
    let is_upgrade = first.scheme_str() == Some("http") && uri.scheme_str() == Some("https");
    let is_same = first.scheme_str() == uri.scheme_str() && first.port_u16() == uri.port_u16();
    first.host() == uri.host() && (is_same || is_upgrade)
}

/// Whether a response is an endless stream of images.
fn is_stream(response: &Response<Body>) -> bool {
    let kind = response.headers().get("Content-Type").and_then(|value| value.to_str().ok());
    kind.is_some_and(|kind| kind.to_ascii_lowercase().starts_with("multipart/"))
}

fn get(agent: &Agent, uri: &Uri, authorization: Option<&str>) -> Result<Response<Body>, CommandError> {
    let mut request = agent.get(uri);
    if let Some(authorization) = authorization {
        request = request.header("Authorization", authorization);
    }
    request.call().map_err(|error| failed(uri, error))
}

/// Returns the header `Authorization` for the challenge of a response: Digest if the camera offers it.
fn authorization(
    response: &Response<Body>,
    uri: &Uri,
    Credentials { user, password }: &Credentials,
) -> Result<String, CommandError> {
    use base64::Engine as _;
    let challenges = response.headers().get_all("WWW-Authenticate");
    let challenges: Vec<&str> = challenges.iter().filter_map(|value| value.to_str().ok()).collect();
    // One header may offer both kinds.
    let digest =
        challenges.iter().find_map(|value| value.to_ascii_lowercase().find("digest ").map(|at| &value[at..]));
    let Some(digest) = digest else {
        let pair = base64::engine::general_purpose::STANDARD.encode(format!("{user}:{password}"));
        return Ok(format!("Basic {pair}"));
    };
    let path = uri.path_and_query().map_or("/", ureq::http::uri::PathAndQuery::as_str);
    let unknown =
        |error: digest_auth::Error| failed(uri, format!("its authentication is not supported: {error}"));
    let mut prompt = digest_auth::parse(digest).map_err(unknown)?;
    let answer = prompt.respond(&AuthContext::new(user, password, path)).map_err(unknown)?;
    Ok(answer.to_header_string())
}

/// Returns the address to which a response redirects.
fn redirected(uri: &Uri, response: &Response<Body>) -> Result<Uri, CommandError> {
    let unknown = || failed(uri, "redirects to an invalid or unsupported address");
    let target = response.headers().get("Location").and_then(|value| value.to_str().ok());
    let target = target.ok_or_else(unknown)?;
    let authority = uri.authority().map_or("", ureq::http::uri::Authority::as_str);
    let absolute = match target.strip_prefix('/') {
        Some(path) => format!("{}://{authority}/{path}", uri.scheme_str().unwrap_or("http")),
        None => without_credentials(target).0,
    };
    let found: Uri = absolute.parse().map_err(|_| unknown())?;
    if matches!(found.scheme_str(), Some("http" | "https")) { Ok(found) } else { Err(unknown()) }
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
        assert!(is_address("rtsp://10.0.0.5/1") && !is_address("C:/clips/a.mp4") && !is_address("a.mp4"));
    }
}
