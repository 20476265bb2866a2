//! `cargo xtask serve`: an HTTP server on the loopback interface, to test the files that a web host would
//! serve.
//!
//! This module also finds a compiler for wasm32 with the sources of the standard library, either from rustup or from
//! Debian. The sources are needed to build the library optimised for size.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use crate::workspace::root;

/// Whether a compiler for wasm32 that can build the standard library is installed.
pub(crate) fn has_wasm_compiler() -> bool {
    has_library_sources() || debian_rustc().is_some()
}

/// Whether rustup's compiler has the sources of the standard library.
pub(crate) fn has_library_sources() -> bool {
    // Debian's compiler is excluded. It has the sources, but needs its own linker.
    let of_rustup = rustc_print(&["sysroot"]).filter(|root| root != "/usr");
    of_rustup.is_some_and(|root| Path::new(&root).join("lib/rustlib/src/rust/library").exists())
}

/// Returns the output of `rustc --print` with these arguments, or `None` if it fails.
pub(crate) fn rustc_print(what: &[&str]) -> Option<String> {
    let output = Command::new("rustc").arg("--print").args(what).current_dir(root()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Returns the path of Debian's compiler if the sources of the standard library are installed.
pub(crate) fn debian_rustc() -> Option<PathBuf> {
    let candidate = PathBuf::from("/usr/bin/rustc");
    let sources = Path::new("/usr/lib/rustlib/src").exists()
        || Path::new("/usr/src")
            .read_dir()
            .ok()?
            .flatten()
            .any(|e| e.file_name().to_string_lossy().starts_with("rustc-"));
    (candidate.exists() && sources).then_some(candidate)
}

/// File extensions and their media types.
const MEDIA_TYPES: [(&str, &str); 7] = [
    ("css", "text/css; charset=utf-8"),
    ("html", "text/html; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("json", "application/json"),
    ("svg", "image/svg+xml"),
    ("wasm", "application/wasm"),
    ("webmanifest", "application/manifest+json"),
];

/// Maximum length of a request, in bytes.
const MAX_REQUEST_BYTES: u64 = 16 << 10;

/// HTTP server for one folder.
#[derive(Debug)]
pub(crate) struct FolderServer {
    folder: PathBuf,
    listener: TcpListener,
}

impl FolderServer {
    /// Creates a server for a folder; port 0 selects a free port.
    pub(crate) fn new(folder: &Path, port: u16) -> anyhow::Result<Self> {
        let listener = TcpListener::bind((std::net::Ipv4Addr::LOCALHOST, port))?;
        Ok(Self { folder: folder.to_path_buf(), listener })
    }

    /// Returns the address that the server listens on.
    pub(crate) fn address(&self) -> anyhow::Result<SocketAddr> {
        Ok(self.listener.local_addr()?)
    }

    /// Serves requests until the process ends. Each request has its own thread, so that a slow client does
    /// not block others.
    pub(crate) fn serve(&self) {
        std::thread::scope(|scope| {
            for stream in self.listener.incoming().flatten() {
                // Errors are ignored: the client may have closed the connection.
                scope.spawn(|| answer(&self.folder, stream).unwrap_or_default());
            }
        });
    }
}

/// Reads the first line of a request and answers it.
fn answer(folder: &Path, mut stream: TcpStream) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream.try_clone()?.take(MAX_REQUEST_BYTES)).lines();
    let request = lines.next().transpose()?.unwrap_or_default();
    // Skips the remaining headers.
    for line in lines {
        if line?.is_empty() {
            break;
        }
    }
    let url = request.split(' ').nth(1).unwrap_or_default();
    let path = url.split(['?', '#']).next().unwrap_or_default().trim_start_matches('/');
    let path = Path::new(if path.is_empty() { "index.html" } else { path });
    let is_inside = path.components().all(|part| matches!(part, Component::Normal(_)));
    let (status, mime, bytes) = match fs::read(folder.join(path)) {
        Ok(bytes) if is_inside && request.starts_with("GET ") => {
            let end = path.extension().and_then(|end| end.to_str()).unwrap_or_default();
            let known = MEDIA_TYPES.iter().find(|(known, _)| *known == end);
            ("200 OK", known.map_or("application/octet-stream", |known| known.1), bytes)
        }
        _ => ("404 Not Found", "text/plain", b"not found".to_vec()),
    };
    let length = bytes.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {mime}\r\nContent-Length: {length}\r\n\
         Cache-Control: no-cache\r\nConnection: close\r\n\r\n"
    )?;
    stream.write_all(&bytes)?;
    stream.flush()
}
