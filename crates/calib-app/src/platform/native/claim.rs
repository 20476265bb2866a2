//! A folder that one window has for itself, for as long as its program lives.

use std::path::Path;

/// The claim; a kill ends it, too.
#[derive(Debug)]
pub(crate) struct Claim {
    /// Locked by the system until it is closed.
    _lock: Option<std::fs::File>,
}

impl Claim {
    /// Claims a folder; `None` when another window has it.
    #[must_use]
    pub(crate) fn of(folder: &Path) -> Option<Self> {
        let open = || {
            std::fs::create_dir_all(folder)?;
            std::fs::File::options().create(true).append(true).open(folder.join("lock"))
        };
        // A folder that cannot be written to is nobody's: what is kept there says so.
        let Ok(file) = open() else { return Some(Self { _lock: None }) };
        match file.try_lock() {
            Err(std::fs::TryLockError::WouldBlock) => None,
            Ok(()) | Err(std::fs::TryLockError::Error(_)) => Some(Self { _lock: Some(file) }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_claimed_once_until_it_is_let_go() {
        let folder = tempfile::tempdir().unwrap();
        let claim = Claim::of(folder.path());
        assert!(claim.is_some() && Claim::of(folder.path()).is_none());
        drop(claim);
        assert!(Claim::of(folder.path()).is_some());
    }
}
