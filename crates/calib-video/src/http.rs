//! Snapshots by HTTP and HTTPS, with Basic or Digest authentication.

use std::time::{Duration, Instant};

use digest_auth::AuthContext;
use ureq::http::{Response, StatusCode, Uri};
use ureq::{Agent, Body};

use crate::address::{Credentials, SnapshotError, SnapshotOptions, without_credentials};

/// Largest size of a snapshot, in bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Largest number of redirects.
const MAX_REDIRECTS: usize = 3;

/// Creates the error of a failed request.
fn failed(uri: &Uri, what: impl std::fmt::Display) -> SnapshotError {
    SnapshotError::failed(&uri.to_string(), what)
}

/// Reads the body of an address, with its redirects and with authentication on demand.
pub(crate) fn fetch(
    mut uri: Uri,
    credentials: Option<&Credentials>,
    options: &SnapshotOptions,
) -> Result<Vec<u8>, SnapshotError> {
    let tls = ureq::tls::TlsConfig::builder().disable_verification(options.accepts_any_certificate).build();
    let agent: Agent =
        Agent::config_builder().http_status_as_error(false).max_redirects(0).tls_config(tls).build().into();
    let (first, deadline) = (uri.clone(), Instant::now() + options.timeout);
    for _ in 0..=MAX_REDIRECTS {
        let credentials = credentials.filter(|_| may_get_credentials(&first, &uri));
        let mut response = get(&agent, &uri, None, deadline)?;
        if response.status() == StatusCode::UNAUTHORIZED
            && let Some(credentials) = credentials
        {
            let header = authorization(&response, &uri, credentials)?;
            response = get(&agent, &uri, Some(&header), deadline)?;
        }
        let status = response.status();
        match status {
            StatusCode::UNAUTHORIZED if !may_get_credentials(&first, &uri) => {
                let what = "requires a user name and a password, which are not sent after a redirect from \
                            another host; enter this address directly";
                return Err(failed(&uri, what));
            }
            StatusCode::UNAUTHORIZED if credentials.is_none() => {
                return Err(SnapshotError::without_credentials(&uri.to_string()));
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
            _ => return Err(failed(&uri, format!("responded with {status}; check the address"))),
        }
    }
    Err(failed(&uri, format!("redirects more than {MAX_REDIRECTS} times; enter the final address")))
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

/// Describes why a request failed.
fn reason(error: &ureq::Error) -> String {
    use std::io::ErrorKind::{ConnectionRefused, HostUnreachable, NetworkUnreachable};
    match error {
        ureq::Error::HostNotFound => "has an unknown host; check the address".into(),
        ureq::Error::Timeout(_) => "did not answer in time; check the address and the network".into(),
        ureq::Error::Io(error) if error.kind() == ConnectionRefused => {
            "refused the connection; check the address and the port".into()
        }
        ureq::Error::Io(error) if matches!(error.kind(), HostUnreachable | NetworkUnreachable) => {
            "cannot be reached; check the address and the network".into()
        }
        error => match error.to_string() {
            text if text.contains("certificate") => {
                format!("{text}; accept any certificate (calib still --insecure) if you trust the network")
            }
            text => text,
        },
    }
}

/// Sends a request, which ends at the deadline.
fn get(
    agent: &Agent,
    uri: &Uri,
    authorization: Option<&str>,
    deadline: Instant,
) -> Result<Response<Body>, SnapshotError> {
    let left = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
    let mut request = agent.get(uri).config().timeout_global(Some(left)).build();
    if let Some(authorization) = authorization {
        request = request.header("Authorization", authorization);
    }
    request.call().map_err(|error| failed(uri, reason(&error)))
}

/// Returns the header `Authorization` for the challenge of a response: Digest if the camera offers it, otherwise
/// Basic.
fn authorization(
    response: &Response<Body>,
    uri: &Uri,
    Credentials { user, password }: &Credentials,
) -> Result<String, SnapshotError> {
    use base64::Engine as _;
    let challenges = response.headers().get_all("WWW-Authenticate");
    let challenges: Vec<&str> = challenges.iter().filter_map(|value| value.to_str().ok()).collect();
    // One header may offer both schemes.
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
fn redirected(uri: &Uri, response: &Response<Body>) -> Result<Uri, SnapshotError> {
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
