//! What every page begins and ends with.

use crate::svg::escape;

/// The page brings all that it shows, and runs nothing.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

/// The end of a page.
pub(crate) const CLOSED: &str = "</main></body></html>\n";

/// The begin of a page with this title.
pub(crate) fn opened(title: &str) -> String {
    let title = escape(title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\
         <title>{title}</title><style>{}</style></head><body><main><h1>{title}</h1>\n",
        include_str!("report.css")
    )
}
