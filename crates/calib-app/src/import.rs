//! Lenses and cameras of other programs: read here, taken by the editor.

use calib_editor::{Action, recognise};
use calib_formats::{File, Format, Imported};

use crate::choice::Chosen;
use crate::state::App;

impl App {
    /// Takes what files of another program say about cameras.
    pub(crate) fn import(&mut self, chosen: Vec<Chosen>) {
        let Some(first) = chosen.first().map(|file| file.name.clone()) else { return };
        let read = chosen.into_iter().map(|file| {
            let name = file.name.clone();
            let bytes = file.into_bytes().map_err(|error| format!("{name}: {error}"))?;
            Ok(File { name, bytes })
        });
        let taken = read.collect::<Result<Vec<File>, String>>().and_then(|files| recognise(&files));
        match taken {
            Ok((format, imported)) => self.take_imported(&first, format, imported),
            Err(error) => self.act(Action::Fail(error)),
        }
    }

    fn take_imported(&mut self, name: &str, format: &Format, Imported { site, notes }: Imported) {
        // A world file alone lays the plan that is there.
        let open = self.editor.site();
        if let (Some(plan), true, Some(_)) = (&site.plan, site.cameras.is_empty(), &open.plan) {
            self.act(Action::LayPlan(plan.clone(), name.to_owned()));
            return;
        }
        if open.cameras.is_empty() {
            let images = self.editor.session().images.clone();
            self.open_site(site, images, None);
            self.act(Action::Note(format!("Read as {}. {}", format.name, notes.join("; "))));
            return;
        }
        self.act(Action::Import(Box::new(site), notes));
    }
}
