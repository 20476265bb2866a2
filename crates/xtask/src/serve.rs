//! `cargo xtask serve`: a folder on loopback, for trying what a web host would serve.
//!
//! What builds for the browser: a compiler with the sources of its standard library, rustup's or Debian's own, so that the
//! library is built as small as the page wants it.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use crate::workspace::root;

/// Whether there is a compiler for wasm32 that builds its library, too.
pub(crate) fn is_there() -> bool {
    has_sources() || debian_rustc().is_some()
}

/// Whether rustup's compiler has the sources of the standard library.
pub(crate) fn has_sources() -> bool {
    // Debian's own, which wants its own linker, has them, too.
    let of_rustup = printed(&["sysroot"]).filter(|root| root != "/usr");
    of_rustup.is_some_and(|root| Path::new(&root).join("lib/rustlib/src/rust/library").exists())
}

/// What the compiler answers where it is asked to print.
pub(crate) fn printed(what: &[&str]) -> Option<String> {
    let output = Command::new("rustc").arg("--print").args(what).current_dir(root()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Debian's own compiler, which comes with the sources of the standard library.
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

/// A request is at most so long, in bytes.
const LONGEST: u64 = 16 << 10;

/// A folder that is served.
#[derive(Debug)]
pub(crate) struct Site {
    folder: PathBuf,
    listener: TcpListener,
}

impl Site {
    /// A server for a folder; port 0 takes a free one.
    pub(crate) fn new(folder: &Path, port: u16) -> anyhow::Result<Self> {
        let listener = TcpListener::bind((std::net::Ipv4Addr::LOCALHOST, port))?;
        Ok(Self { folder: folder.to_path_buf(), listener })
    }

    /// Where it answers.
    pub(crate) fn address(&self) -> anyhow::Result<SocketAddr> {
        Ok(self.listener.local_addr()?)
    }

    /// Serves until it is stopped: a thread a request, so that a slow reader holds up nobody.
    pub(crate) fn serve(&self) {
        std::thread::scope(|scope| {
            for stream in self.listener.incoming().flatten() {
                // Whoever asked may have gone away.
                scope.spawn(|| answer(&self.folder, stream).unwrap_or_default());
            }
        });
    }
}

/// Reads the first line of a request and answers it.
fn answer(folder: &Path, mut stream: TcpStream) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream.try_clone()?.take(LONGEST)).lines();
    let request = lines.next().transpose()?.unwrap_or_default();
    // The rest of the head says nothing that matters here.
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
            let known = TYPES.iter().find(|(known, _)| *known == end);
            ("200 OK", known.map_or("application/octet-stream", |known| known.1), bytes)
        }
        _ => ("404 Not Found", "text/plain", b"not there".to_vec()),
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
