//! How options are written where they are asked for.

/// How options are written where they are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wording {
    /// On a command line: `--at-column`.
    Flags,
    /// In a call: `at_column`.
    Keywords,
}

impl Wording {
    /// An option by its name.
    pub(crate) fn name(self, option: &str) -> String {
        match self {
            Self::Flags => format!("--{option}"),
            Self::Keywords => option.replace('-', "_"),
        }
    }

    /// An option with a value.
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
    fn an_option_is_written_as_it_is_asked_for() {
        assert_eq!(Wording::Flags.with("bad-rows", "status"), "--bad-rows status");
        assert_eq!(Wording::Keywords.with("bad-rows", "status"), "bad_rows=\"status\"");
        assert_eq!(Wording::Keywords.name("at-unit"), "at_unit");
    }
}
