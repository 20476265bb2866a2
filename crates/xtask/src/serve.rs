//! `cargo xtask serve`: a folder on loopback, for trying what a web host would serve.

use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::anyhow;
use tiny_http::{Header, Request, Response, Server};

/// Endings and what they are.
const TYPES: [(&str, &str); 7] = [
    ("css", "text/css; charset=utf-8"),
    ("html", "text/html; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("json", "application/json"),
    ("svg", "image/svg+xml"),
    ("wasm", "application/wasm"),
    ("webmanifest", "application/manifest+json"),
];

/// As many as a browser opens connections.
const THREADS: usize = 8;

/// A folder that is served.
pub(crate) struct Site {
    folder: PathBuf,
    server: Server,
}

impl Site {
    /// A server for a folder; port 0 takes a free one.
    pub(crate) fn new(folder: &Path, port: u16) -> anyhow::Result<Self> {
        let server = Server::http(("127.0.0.1", port)).map_err(|error| anyhow!("port {port}: {error}"))?;
        Ok(Self { folder: folder.to_path_buf(), server })
    }

    /// Where it answers.
    pub(crate) fn address(&self) -> String {
        self.server.server_addr().to_string()
    }

    /// Serves until it is stopped.
    pub(crate) fn serve(&self) {
        // A browser that reads one answer slowly still asks for the others.
        std::thread::scope(|scope| {
            for _ in 0..THREADS {
                scope.spawn(|| {
                    for request in self.server.incoming_requests() {
                        // Whoever asked may have gone away.
                        let _ = answer(&self.folder, request);
                    }
                });
            }
        });
    }
}

fn answer(folder: &Path, request: Request) -> std::io::Result<()> {
    let path = request.url().split(['?', '#']).next().unwrap_or_default().trim_start_matches('/').to_owned();
    let path = Path::new(if path.is_empty() { "index.html" } else { &path });
    let is_inside = path.components().all(|part| matches!(part, Component::Normal(_)));
    match fs::read(folder.join(path)) {
        Ok(bytes) if is_inside => {
            let end = path.extension().and_then(|end| end.to_str()).unwrap_or_default();
            let mime = TYPES.iter().find(|(known, _)| *known == end).map_or("application/octet-stream", |t| t.1);
            let mut response = Response::from_data(bytes);
            for (name, value) in [("Content-Type", mime), ("Cache-Control", "no-cache"), ("Connection", "close")] {
                if let Ok(header) = Header::from_bytes(name, value) {
                    response.add_header(header);
                }
            }
            request.respond(response)
        }
        _ => request.respond(Response::from_string("not there").with_status_code(404)),
    }
}
