//! How the list of cameras is filtered and sorted.

/// How the list is ordered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// As in the site.
    #[default]
    Site,
    /// Those that miss most first.
    Missing,
    /// Those whose floor is known worst first.
    Sigma,
}

/// How the list is filtered and sorted.
#[derive(Clone, Debug, Default)]
pub struct List {
    /// Part of a name.
    pub filter: String,
    /// Only those that are not finished.
    pub unfinished: bool,
    /// How it is ordered.
    pub order: Order,
}
