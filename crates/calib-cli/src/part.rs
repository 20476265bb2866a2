//! A file while it is written: nobody sees it before it is whole.

use std::fs::File;
use std::path::Path;

use tempfile::NamedTempFile;

/// A file that becomes another one when it is whole.
pub(crate) enum Part {
    /// Without a name: gone with the program, however that ends. Not every system and disk has these.
    #[cfg(target_os = "linux")]
    Nameless(File),
    /// Beside its place; a killed program leaves it there under a name that begins with a dot.
    Named(NamedTempFile),
}

impl Part {
    /// An empty file in a folder.
    pub(crate) fn new_in(folder: &Path) -> std::io::Result<Self> {
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{Mode, OFlags};
            let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
            if let Ok(file) = rustix::fs::open(folder, flags, Mode::from_raw_mode(0o644)) {
                return Ok(Self::Nameless(file.into()));
            }
        }
        NamedTempFile::new_in(folder).map(Self::Named)
    }

    pub(crate) fn file(&self) -> &File {
        match self {
            #[cfg(target_os = "linux")]
            Self::Nameless(file) => file,
            Self::Named(file) => file.as_file(),
        }
    }

    /// Puts the whole file in its place: over what is there and with its mode, if that is wanted, else only
    /// where nothing is.
    pub(crate) fn persist(self, path: &Path, over: bool) -> std::io::Result<()> {
        let mode = path.metadata().ok().filter(|_| over).map(|about| about.permissions());
        match self {
            #[cfg(target_os = "linux")]
            Self::Nameless(file) => {
                mode.map_or(Ok(()), |mode| file.set_permissions(mode))?;
                name(&file, path, over)
            }
            Self::Named(file) => {
                open_to_others(file.path());
                mode.map_or(Ok(()), |mode| file.as_file().set_permissions(mode))?;
                let placed = if over { file.persist(path) } else { file.persist_noclobber(path) };
                Ok(placed.map(drop)?)
            }
        }
    }
}

/// Gives a file without a name one.
#[cfg(target_os = "linux")]
fn name(file: &File, path: &Path, over: bool) -> std::io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd as _;
    let nameless = format!("/proc/self/fd/{}", file.as_raw_fd());
    let link = |to: &Path| linkat(CWD, nameless.as_str(), CWD, to, AtFlags::SYMLINK_FOLLOW);
    match link(path) {
        Err(error) if over && error == rustix::io::Errno::EXIST => {}
        done => return Ok(done?),
    }
    // A link cannot replace what is there, a name beside it can.
    let mut beside = path.file_name().unwrap_or_default().to_owned();
    beside.push(format!(".{}", std::process::id()));
    let beside = path.with_file_name(beside);
    link(&beside)?;
    std::fs::rename(&beside, path).inspect_err(|_| {
        // The error of the rename is the one that is told.
        let _ = std::fs::remove_file(&beside);
    })
}

/// Temporary files are for their owner's eyes only; what they become is an ordinary file.
fn open_to_others(path: &Path) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // Where the file system refuses, the file stays private: no reason to lose it.
        let _ = std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o644));
    }
    #[cfg(not(unix))]
    let _ = path;
}
