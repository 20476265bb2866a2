//! Snapshots of all cameras of a list: a TOML file with an id and an address for each camera.
//!
//! ```toml
//! [[cameras]]
//! id = "shop-1"
//! address = "http://10.0.0.21/snapshot.jpg"
//! credentials = "shop-1.txt"
//! ```

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use calib_video::Snapshot;
use serde::Deserialize;

use crate::args::OutputArgs;
use crate::files::print_message;
use crate::picture;
use crate::snapshot::{self, SnapshotArgs};
use crate::stop::CommandError;

/// Largest size of the list, in bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Maximum number of cameras that are read at the same time. Cameras answer slowly, and snapshots are small.
const MAX_PARALLEL: usize = 8;

/// List of cameras.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraList {
    cameras: Vec<ListedCamera>,
}

/// Camera of the list.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedCamera {
    /// Id of the camera in the site file, and the name of its image.
    id: String,
    /// Address of its snapshot.
    address: String,
    /// File with the user's name and password, relative to the list.
    credentials: Option<PathBuf>,
}

impl ListedCamera {
    /// Returns the reason why the entry is invalid: the id is not a file name, or the address is incomplete.
    fn fault(&self) -> Option<&'static str> {
        let is_path =
            self.id.contains(['/', '\\', ':']) || self.id.starts_with('.') || self.id.ends_with(['.', ' ']);
        match () {
            () if self.id.trim().is_empty() => Some("the id is empty"),
            () if is_path || self.id.chars().any(char::is_control) => {
                Some("the id cannot be used as a file name")
            }
            () if !calib_video::is_address(&self.address) => Some(
                "the address is incomplete, expected http://\u{2026}, https://\u{2026} or rtsp://\u{2026}",
            ),
            () => None,
        }
    }

    /// Returns the possible paths of the image in the output folder: as JPEG, and as PNG.
    fn paths(&self, output: &OutputArgs) -> [String; 2] {
        ["jpg", "png"].map(|ending| output.path_in(&format!("{}.{ending}", self.id)))
    }

    /// Writes the snapshot into the output folder. An existing image is removed first, so that no old image remains
    /// if the snapshot fails.
    fn write(&self, list: &Path, args: &SnapshotArgs, output: &OutputArgs) -> Result<(), CommandError> {
        let paths = self.paths(output);
        for path in paths.iter().filter(|path| Path::new(path).exists()) {
            std::fs::remove_file(path).map_err(|error| CommandError::invalid(path, error))?;
        }
        let own = self.credentials.as_ref().map(|file| list.with_file_name("").join(file));
        let mut args = args.clone();
        args.credentials = own.or(args.credentials);
        let Snapshot { image, jpeg, pixel_aspect } = snapshot::read(&self.address, &args)?;
        snapshot::print_pixel_aspect(&format!("{}: ", self.id), pixel_aspect);
        // A JPEG stays as the camera sent it.
        let path = &paths[usize::from(jpeg.is_none())];
        let bytes = jpeg.map_or_else(|| picture::encode(&image, path), Ok)?;
        output.write_to(path, &bytes)
    }
}

/// Writes a snapshot of every camera into the output folder. A camera that fails does not stop the others, and
/// leaves no image.
pub(crate) fn run(list: &Path, args: &SnapshotArgs, output: &OutputArgs) -> Result<(), CommandError> {
    let cameras = read_list(list)?;
    if output.is_stdout() {
        let what = "--output: expected a folder, because --all writes several images";
        return Err(CommandError::Usage(what.into()));
    }
    for path in cameras.iter().flat_map(|camera| camera.paths(output)) {
        output.check_path_free(&path)?;
    }
    output.create_folder()?;
    let (next, failures) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..MAX_PARALLEL.min(cameras.len()) {
            scope.spawn(|| {
                while let Some(camera) = cameras.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(error) = camera.write(list, args, output) {
                        let why = error.message().unwrap_or_default();
                        print_message(format_args!("calib: {}: {why}", camera.id));
                        if let Ok(mut failures) = failures.lock() {
                            failures.push(camera.id.as_str());
                        }
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().unwrap_or_default();
    let count = cameras.len();
    print_message(format_args!("calib: {} of {count} snapshots written", count - failures.len()));
    if failures.is_empty() {
        Ok(())
    } else {
        Err(CommandError::Failed(anyhow::anyhow!("no snapshot from {}", failures.join(", "))))
    }
}

/// Reads and checks the list.
fn read_list(path: &Path) -> Result<Vec<ListedCamera>, CommandError> {
    let invalid = |what: String| CommandError::invalid(path.display(), what);
    let bytes = calib_input::read(path, MAX_BYTES).map_err(|error| invalid(error.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|_| invalid("is not a UTF-8 text file".into()))?;
    let list: CameraList = toml::from_str(&text).map_err(|error| {
        // Neither the line nor the message is printed, because they may contain a password.
        let start = error.span().map_or(0, |span| span.start);
        let line = 1 + text.bytes().take(start).filter(|&byte| byte == b'\n').count();
        invalid(format!(
            "line {line}: expected [[cameras]], each with id, address and, optionally, credentials"
        ))
    })?;
    let mut ids = HashSet::new();
    for camera in &list.cameras {
        if let Some(fault) = camera.fault() {
            return Err(invalid(format!("camera {:?}: {fault}", camera.id)));
        }
        if !ids.insert(camera.id.to_lowercase()) {
            return Err(invalid(format!("camera {:?} is listed twice", camera.id)));
        }
    }
    if list.cameras.is_empty() {
        return Err(invalid("contains no cameras".into()));
    }
    Ok(list.cameras)
}
