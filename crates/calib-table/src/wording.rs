//! Style of option names in messages.

/// Style of option names in messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wording {
    /// Command line: `--at-column`.
    Flags,
    /// Function call: `at_column`.
    Keywords,
}

impl Wording {
    /// Formats the name of an option.
    pub(crate) fn name(self, option: &str) -> String {
        match self {
            Self::Flags => format!("--{option}"),
            Self::Keywords => option.replace('-', "_"),
        }
    }

    /// Formats an option with its value.
    pub(crate) fn with(self, option: &str, value: &str) -> String {
        match self {
            Self::Flags => format!("--{option} {value}"),
            Self::Keywords => format!("{}={value:?}", self.name(option)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_formatted_as_flags_or_keywords() {
        assert_eq!(Wording::Flags.with("bad-rows", "status"), "--bad-rows status");
        assert_eq!(Wording::Keywords.with("bad-rows", "status"), "bad_rows=\"status\"");
        assert_eq!(Wording::Keywords.name("at-unit"), "at_unit");
    }
}
