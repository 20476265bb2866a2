//! Relative paths.

use std::path::Path;

/// Returns `path` relative to `folder`, with `/` between its parts, or unchanged if they share no root.
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
    use super::*;

    #[test]
    fn paths_are_relative_to_the_file() {
        assert_eq!(relative(Path::new("/a/b/c.png"), Path::new("/a/d")), "../b/c.png");
        assert_eq!(relative(Path::new("/a/d/c.png"), Path::new("/a/d")), "c.png");
    }
}
