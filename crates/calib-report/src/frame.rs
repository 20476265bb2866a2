//! Start and end of every HTML page.

use crate::svg::escape;

/// Content security policy: the page loads nothing and runs no scripts.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

/// End of a page.
pub(crate) const PAGE_END: &str = "</main></body></html>\n";

/// Returns the start of a page with this title, and the note that explains "±".
pub(crate) fn page_start(title: &str) -> String {
    let title = escape(title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\
         <title>{title}</title><style>{}</style></head><body><main><h1>{title}</h1>\n\
         <p class=dim>\u{b1} is one standard deviation.</p>\n",
        include_str!("report.css")
    )
}
