//! Start and end of every HTML page.

use crate::svg::escape;

/// Content security policy of a page: the page loads no other files and runs no scripts.
const CONTENT_SECURITY_POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

/// HTML at the end of a page.
pub(crate) const PAGE_END: &str = "</main></body></html>\n";

/// Returns the HTML at the start of a page: head with style sheet, title, and the note that explains "±".
pub(crate) fn page_start(title: &str) -> String {
    let title = escape(title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{CONTENT_SECURITY_POLICY}\">\
         <title>{title}</title><style>{}</style></head><body><main><h1>{title}</h1>\n\
         <p class=dim>\u{b1} is one standard deviation.</p>\n",
        include_str!("report.css")
    )
}
