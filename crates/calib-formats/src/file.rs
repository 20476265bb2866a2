//! A file in memory: what an export gives and what an import takes.

use crate::error::{FormatError, Problem};

/// Largest file that is read, in bytes.
pub const MAX_BYTES: usize = 64 << 20;
/// Most files that are read as one.
pub const MAX_FILES: usize = 20_000;
/// Longest name that a file is given, in characters.
const MAX_NAME: usize = 100;

/// A file in memory; its name may have folders, with `/` between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Relative to the folder of the export.
    pub name: String,
    /// What is in it.
    pub bytes: Vec<u8>,
}

impl File {
    pub(crate) fn text(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self { name: name.into(), bytes: text.into().into_bytes() }
    }

    /// Last part of the name.
    pub(crate) fn base(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or_default()
    }

    /// Last part of the name, without its extension.
    pub(crate) fn stem(&self) -> &str {
        self.base().rsplit_once('.').map_or(self.base(), |(stem, _)| stem)
    }

    /// What follows the last dot, in lower case.
    pub(crate) fn extension(&self) -> String {
        self.base().rsplit_once('.').map_or(String::new(), |(_, extension)| extension.to_lowercase())
    }

    pub(crate) fn as_text(&self) -> Result<&str, FormatError> {
        let found = self.bytes.len();
        if found > MAX_BYTES {
            return Err(FormatError::expected(
                &self.name,
                format!("{found} bytes"),
                format!("at most {MAX_BYTES}"),
            ));
        }
        let text = std::str::from_utf8(&self.bytes)
            .map_err(|error| FormatError::new(&self.name, Problem::NotUtf8 { at: error.valid_up_to() }))?;
        Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
    }
}

/// An id as one component of a path that every system takes.
pub(crate) fn file_name(id: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let name: String = id.chars().take(MAX_NAME).map(plain).collect();
    let dots = name.chars().take_while(|&c| c == '.').count();
    if dots == 0 { name } else { format!("{}{}", "_".repeat(dots), &name[dots..]) }
}
