//! From where images of a site are read without asking.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The folder of a site, and the files elsewhere that its operator chose or allowed. Whoever made a site file may
/// name any picture of this machine in it, and would see that in what is handed back.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reach {
    /// The folder of the site; of a site that has no file yet, none.
    pub folder: Option<PathBuf>,
    /// Files elsewhere, without links in their paths.
    pub allowed: BTreeSet<PathBuf>,
}

impl Reach {
    /// Whether a file is within it. `real` tells where a path leads once every link is followed; none where it
    /// leads nowhere.
    #[must_use]
    pub fn holds(&self, file: &Path, real: impl Fn(&Path) -> Option<PathBuf>) -> bool {
        let Some(file) = real(file) else { return false };
        // The folder of a file that is named without one is the current one.
        let of_site = self.folder.as_deref();
        let folder =
            of_site.map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
        self.allowed.contains(&file) || folder.and_then(real).is_some_and(|folder| file.starts_with(folder))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk on which `/site/link.png` leads elsewhere.
    fn real(path: &Path) -> Option<PathBuf> {
        match path.to_str()? {
            "/site/link.png" | "/site/../private.png" => Some("/private.png".into()),
            "/site/gone.png" => None,
            other => Some(other.into()),
        }
    }

    #[test]
    fn what_leads_out_of_the_folder_is_out_of_reach_until_it_is_allowed() {
        let mut reach = Reach { folder: Some("/site".into()), ..Reach::default() };
        let holds = |reach: &Reach, path: &str| reach.holds(Path::new(path), real);
        assert!(holds(&reach, "/site/a.png") && holds(&reach, "/site/stills/a.png"));
        for out in ["/site/link.png", "/site/../private.png", "/siteless/a.png", "/site/gone.png"] {
            assert!(!holds(&reach, out), "{out}");
        }
        reach.allowed.insert("/private.png".into());
        assert!(holds(&reach, "/site/link.png") && holds(&reach, "/private.png"));
        assert!(!holds(&Reach::default(), "/a.png"), "what has no folder reaches what was chosen alone");
    }
}
