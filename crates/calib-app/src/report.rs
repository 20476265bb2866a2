//! The report: one page to hand over, as `calib report` writes it.

use std::path::Path;

use calib_editor::{Action, Session};
use calib_report::{Picture, Shown, page};

use crate::platform::{Here, Platform as _};
use crate::state::App;

impl App {
    /// Writes the report of the site as it is solved now.
    pub(crate) fn save_report(&mut self, path: &Path) {
        let session = self.editor.session();
        let site = session.solved.write_into(&session.site);
        let html = page(&site, None, &mut |shown| picture(session, shown));
        match Here::write(path, html.as_bytes()) {
            Ok(()) => self.act(Action::Note(format!("Saved {}.", path.display()))),
            Err(error) => self.act(Action::Fail(error)),
        }
    }
}

/// A picture as it is, within the page.
fn picture(session: &Session, shown: Shown<'_>) -> Result<Picture, String> {
    let name = match shown {
        Shown::Camera(camera) => camera.image.as_deref(),
        Shown::Plan => session.site.plan.as_ref().and_then(|plan| plan.image.as_deref()),
    };
    let name = name.ok_or("There is no picture.")?;
    let said = |why: String| format!("{}: {why}", session.images.shown_name(name));
    // What is rendered in a worker is not waited for here.
    if !Here::HAS_FOLDERS && session.images.reader(name).made_by_name().is_some() {
        return Err(said("still being made; write the report again when it is shown".into()));
    }
    let (href, bytes) = session.images.embedded(name, Here::read_within).map_err(said)?;
    let size = match shown {
        Shown::Camera(camera) => camera.size_px,
        Shown::Plan => calib_input::size_of(&bytes).map_err(|error| said(error.to_string()))?,
    };
    Ok(Picture { href, size })
}
