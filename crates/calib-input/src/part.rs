//! Output files that appear only when they are complete.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::{fmt, io};

use tempfile::NamedTempFile;

/// Reason why a file cannot be created at a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathError {
    /// Path of an existing file.
    Exists(PathBuf),
    /// Symbolic link to a missing target.
    BrokenLink(PathBuf),
}

impl fmt::Display for PathError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exists(path) => write!(f, "{} already exists", path.display()),
            Self::BrokenLink(path) => {
                write!(f, "{} is a link to a missing file; delete it, or choose another file", path.display())
            }
        }
    }
}

impl std::error::Error for PathError {}

/// Returns the path of the file that output for `path` is written to: a symbolic link is followed and stays a
/// link. With `over`, an existing file is accepted.
///
/// # Errors
///
/// Fails if the file exists without `over`, or a link has no target.
pub fn resolve_target(path: &Path, over: bool) -> Result<PathBuf, PathError> {
    let is_link = path.symlink_metadata().is_ok_and(|about| about.is_symlink());
    match path.canonicalize() {
        Ok(_) if !over => Err(PathError::Exists(path.to_owned())),
        Ok(real) if is_link => Ok(real),
        Err(_) if is_link => Err(PathError::BrokenLink(path.to_owned())),
        _ => Ok(path.to_owned()),
    }
}

/// Temporary file that is moved to its path when it is complete.
#[derive(Debug)]
pub struct PartialFile(Kind);

#[derive(Debug)]
enum Kind {
    /// File without a name, which disappears if the program ends. Not every system and disk supports it.
    #[cfg(target_os = "linux")]
    Nameless(File),
    /// File in the target's folder, with a name that starts with a dot. It stays there if the program is
    /// killed.
    Named(NamedTempFile),
}

impl PartialFile {
    /// Creates an empty temporary file in the folder of the target `place`.
    ///
    /// # Errors
    ///
    /// Fails if the folder is not writable.
    pub fn new_for(place: &Path) -> io::Result<Self> {
        let folder = place.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{Mode, OFlags};
            let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
            if let Ok(file) = rustix::fs::open(folder, flags, Mode::from_raw_mode(0o644)) {
                return Ok(Self(Kind::Nameless(file.into())));
            }
        }
        NamedTempFile::new_in(folder).map(|file| Self(Kind::Named(file)))
    }

    /// Returns the file to write to.
    #[must_use]
    pub fn file(&self) -> &File {
        match &self.0 {
            #[cfg(target_os = "linux")]
            Kind::Nameless(file) => file,
            Kind::Named(file) => file.as_file(),
        }
    }

    /// Moves the complete file to its path. With `over`, it replaces an existing file and keeps its mode.
    ///
    /// # Errors
    ///
    /// Fails if the file exists without `over`, or the system refuses.
    pub fn persist(self, path: &Path, over: bool) -> io::Result<()> {
        let mode = path.metadata().ok().filter(|_| over).map(|about| about.permissions());
        match self.0 {
            #[cfg(target_os = "linux")]
            Kind::Nameless(file) => {
                mode.map_or(Ok(()), |mode| file.set_permissions(mode))?;
                link_name(&file, path, over)
            }
            Kind::Named(file) => {
                make_readable(file.path());
                mode.map_or(Ok(()), |mode| file.as_file().set_permissions(mode))?;
                let placed = if over { file.persist(path) } else { file.persist_noclobber(path) };
                Ok(placed.map(drop)?)
            }
        }
    }
}

/// Moves a file without a name to `path`. With `over`, it replaces an existing file.
#[cfg(target_os = "linux")]
fn link_name(file: &File, path: &Path, over: bool) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd as _;
    let nameless = format!("/proc/self/fd/{}", file.as_raw_fd());
    let link = |to: &Path| linkat(CWD, nameless.as_str(), CWD, to, AtFlags::SYMLINK_FOLLOW);
    match link(path) {
        Err(error) if over && error == rustix::io::Errno::EXIST => {}
        done => return Ok(done?),
    }
    // A hard link cannot replace an existing file, but a rename can.
    let mut sibling = path.file_name().unwrap_or_default().to_owned();
    sibling.push(format!(".{}", std::process::id()));
    let sibling = path.with_file_name(sibling);
    link(&sibling)?;
    std::fs::rename(&sibling, path).inspect_err(|_| {
        // The error of the rename is returned, not the error of this cleanup.
        let _ = std::fs::remove_file(&sibling);
    })
}

/// Makes a temporary file, which only its owner can read, readable to others.
fn make_readable(path: &Path) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // If the file system refuses, the file stays private.
        let _ = std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o644));
    }
    #[cfg(not(unix))]
    let _ = path;
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn write(path: &Path, text: &str) -> Result<(), Box<dyn std::error::Error>> {
        let place = resolve_target(path, true)?;
        let part = PartialFile::new_for(&place)?;
        part.file().write_all(text.as_bytes())?;
        Ok(part.persist(&place, true)?)
    }

    #[cfg(unix)]
    #[test]
    fn links_and_file_modes_are_preserved() {
        use std::os::unix::fs::{PermissionsExt as _, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [file, link, dead] = ["file", "link", "dead"].map(|name| folder.path().join(name));
        std::fs::write(&file, "old").unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
        symlink(&file, &link).unwrap();
        symlink(folder.path().join("nowhere"), &dead).unwrap();
        write(&link, "new").unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "new");
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(resolve_target(&dead, true), Err(PathError::BrokenLink(dead.clone())));
        assert_eq!(resolve_target(&file, false), Err(PathError::Exists(file)));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
