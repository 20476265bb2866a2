//! What newer stills show: kept beside the site, and cameras recovered from them.

use calib_site::{Recovered, Site};

use crate::editor::Editor;
use crate::joint::forget_results;
use crate::newer::{Newer, OnNewer};

impl Editor {
    pub(super) fn on_newer(&mut self, action: OnNewer) {
        match action {
            OnNewer::Compared(newer) => self.keep_newer(*newer),
            OnNewer::Since(time) => {
                if let Some(newer) = self.newer_in_hand_mut() {
                    newer.since = time;
                }
            }
            OnNewer::Dismiss => {
                let own = self.newer_in_hand().cloned();
                self.newer.retain(|newer| Some(newer) != own.as_ref());
            }
            OnNewer::Recovered(camera, found) => self.take_recovered(&camera, &found.0, found.1),
        }
    }

    fn keep_newer(&mut self, newer: Newer) {
        let camera = newer.ids.first().cloned().unwrap_or_default();
        let became = newer.comparison.became;
        // Stills are done in any order: the one taken last tells what is so now.
        if let Some(known) = self.newer.iter().find(|known| newer.is_beside(known) && newer.is_before(known))
        {
            let (title, since) = (&known.title, &known.since);
            self.session.note =
                Some(format!("{camera}: {became} before {since}; {title} is newer, and stays."));
            return;
        }
        self.session.note = Some(format!("{camera}: {became}."));
        self.newer.retain(|known| !newer.is_beside(known));
        self.newer.push(newer);
    }

    fn newer_in_hand_mut(&mut self) -> Option<&mut Newer> {
        let entry = self.session.entry()?;
        self.newer.iter_mut().find(|newer| newer.is_of(entry))
    }

    /// The site with a new period of a camera, in place of that from which it was found.
    fn take_recovered(&mut self, camera: &str, from: &Site, found: Recovered) {
        self.cancel();
        if self.session.site != *from {
            let note = "Nothing was recovered: the site was changed meanwhile. Recover again.";
            self.session.note = Some(note.into());
            return;
        }
        let Recovered { mut site, left_out, carried } = found;
        forget_results(&mut site);
        self.session.site = site;
        self.session.selection.clear();
        self.session.commit(format!("recover {camera}"));
        let left_out = match left_out.len() {
            0 => String::new(),
            _ => format!(" Not on the new still, left out: {}.", left_out.join(", ")),
        };
        self.session.note =
            Some(format!("{camera}: {carried} lines and points stand on the new still.{left_out}"));
    }
}
