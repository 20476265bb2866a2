//! A file while it is written: nobody sees it before it is whole.
//!
//! Paths as they are seen from a folder.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::{fmt, io};

use tempfile::NamedTempFile;

/// Why a file cannot stand where it is wanted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoPlace {
    /// Another one stands there.
    Taken(PathBuf),
    /// A link that leads nowhere.
    DeadLink(PathBuf),
}

impl fmt::Display for NoPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Taken(path) => write!(f, "{} exists", path.display()),
            Self::DeadLink(path) => {
                write!(f, "{} is a link that leads nowhere; remove it, or name another file", path.display())
            }
        }
    }
}

impl std::error::Error for NoPlace {}

/// Where what is written to a path ends up, over what is there or not: a link is followed, and stays a link.
///
/// # Errors
/// When something is there that is not to be replaced, or a link leads nowhere.
pub fn place(path: &Path, over: bool) -> Result<PathBuf, NoPlace> {
    let is_link = path.symlink_metadata().is_ok_and(|about| about.is_symlink());
    match path.canonicalize() {
        Ok(_) if !over => Err(NoPlace::Taken(path.to_owned())),
        Ok(real) if is_link => Ok(real),
        Err(_) if is_link => Err(NoPlace::DeadLink(path.to_owned())),
        _ => Ok(path.to_owned()),
    }
}

/// A file that becomes another one when it is whole.
#[derive(Debug)]
pub struct Part(Kind);

#[derive(Debug)]
enum Kind {
    /// Without a name: gone with the program, however that ends. Not every system and disk has these.
    #[cfg(target_os = "linux")]
    Nameless(File),
    /// Beside its place; a killed program leaves it there under a name that begins with a dot.
    Named(NamedTempFile),
}

impl Part {
    /// An empty file beside the one that it becomes.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn beside(place: &Path) -> io::Result<Self> {
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

    /// To write to.
    #[must_use]
    pub fn file(&self) -> &File {
        match &self.0 {
            #[cfg(target_os = "linux")]
            Kind::Nameless(file) => file,
            Kind::Named(file) => file.as_file(),
        }
    }

    /// Puts the whole file in its place: over what is there and with its mode, if that is wanted, else only
    /// where nothing is.
    ///
    /// # Errors
    /// When something is there that is not to be replaced, or the system refuses.
    pub fn persist(self, path: &Path, over: bool) -> io::Result<()> {
        let mode = path.metadata().ok().filter(|_| over).map(|about| about.permissions());
        match self.0 {
            #[cfg(target_os = "linux")]
            Kind::Nameless(file) => {
                mode.map_or(Ok(()), |mode| file.set_permissions(mode))?;
                name(&file, path, over)
            }
            Kind::Named(file) => {
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
fn name(file: &File, path: &Path, over: bool) -> io::Result<()> {
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

/// `path` as seen from `folder`, with `/` between its parts; as it is where they share no root.
#[must_use]
pub fn relative(path: &Path, folder: &Path) -> String {
    let parts = |path: &Path| -> Vec<String> {
        path.components().map(|part| part.as_os_str().to_string_lossy().into_owned()).collect()
    };
    if path.is_absolute() != folder.is_absolute() {
        return path.to_string_lossy().into_owned();
    }
    let (path_parts, folder_parts) = (parts(path), parts(folder));
    let shared = path_parts.iter().zip(&folder_parts).take_while(|(a, b)| a == b).count();
    if shared == 0 && path.is_absolute() {
        return path.to_string_lossy().into_owned();
    }
    let up = std::iter::repeat_n("..".to_owned(), folder_parts.len() - shared);
    up.chain(path_parts.into_iter().skip(shared)).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn write(path: &Path, text: &str) -> Result<(), Box<dyn std::error::Error>> {
        let place = place(path, true)?;
        let part = Part::beside(&place)?;
        part.file().write_all(text.as_bytes())?;
        Ok(part.persist(&place, true)?)
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_a_mode_a_mode() {
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
        assert_eq!(place(&dead, true), Err(NoPlace::DeadLink(dead.clone())));
        assert_eq!(place(&file, false), Err(NoPlace::Taken(file)));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    }

    #[test]
    fn paths_are_relative_to_the_file() {
        assert_eq!(relative(Path::new("/a/b/c.png"), Path::new("/a/d")), "../b/c.png");
        assert_eq!(relative(Path::new("/a/d/c.png"), Path::new("/a/d")), "c.png");
    }
}
