//! Actions on the annotations of the selected image and on its lens.

use calib_core::{Annotation, Kind};

use calib_core::single::Known;

use calib_site::LensEntry;

use crate::command::Lines;
use crate::edit;
use crate::editor::Editor;
use crate::tools::{Icon, TOOLS, ToolRow};

impl Editor {
    pub(super) fn on_lines(&mut self, command: Lines) {
        self.cancel();
        match command {
            Lines::NewGroup => {
                self.session.tool.fresh_group = true;
                self.session.note = Some("The next line starts a new group.".into());
            }
            Lines::RightAngle => self.right_angle(),
            Lines::TakeSuggestion => self.select_suggested_tool(),
            Lines::DismissSuggestion => self.session.dismiss_suggestion(),
            Lines::TakeSecondSolution => {
                let other = self.session.solution().and_then(|s| s.alternatives.first());
                let Some(focal) = other.map(|other| other.focal_px) else { return };
                self.set_focal_prior(focal, "use the second solution");
            }
            Lines::CopyLines => {
                let entry = self.session.entry();
                self.copied_annotations = entry.map(|entry| (entry.annotations.clone(), entry.size_px));
                self.session.note = Some("Annotations copied. Select a camera and paste them.".into());
            }
            Lines::PasteLines => self.paste_lines(),
        }
    }

    /// Selects the tool for the suggested line. It adds no line, because only lines that the operator places
    /// on the image are evidence.
    fn select_suggested_tool(&mut self) {
        let Some(next) = self.session.suggestion().cloned() else { return };
        let makes_it = |tool: &ToolRow| match next.kind {
            Some(kind) => tool.kind == Some(kind),
            None => tool.icon == Icon::Link,
        };
        let Some(tool) = TOOLS.iter().position(makes_it) else { return };
        self.select_tool(tool);
        // Lines of one direction form one annotation.
        self.session.tool.fresh_group = next.segments_px.len() >= 2;
        self.session.note = Some(next.message);
    }

    fn right_angle(&mut self) {
        let Some(entry) = self.session.entry_mut() else { return };
        let is_parallel = |&i: &usize| entry.annotations[i].kind == Kind::Parallel;
        let groups: Vec<usize> = (0..entry.annotations.len()).filter(is_parallel).collect();
        let [.., first, second] = groups[..] else {
            self.session.note =
                Some("Draw two groups of parallel lines first. Press W to start the second group.".into());
            return;
        };
        let is_used = |id: &String| entry.annotations.iter().any(|a| a.id.as_ref() == Some(id));
        let free = (b'a'..=b'z').map(|c| char::from(c).to_string()).find(|id| !is_used(id));
        let id = entry.annotations[first].id.clone().or(free);
        entry.annotations[first].id.clone_from(&id);
        let tied = &mut entry.annotations[second].at_right_angles_to;
        let name = match tied.is_some() {
            true => "remove the right angle between two directions",
            false => "set two directions at right angles",
        };
        *tied = if tied.is_some() { None } else { id };
        self.session.commit(name);
    }

    /// Adds the copied annotations to the selected camera, scaled to the size of its image.
    fn paste_lines(&mut self) {
        let Some((copied, from)) = self.copied_annotations.clone() else { return };
        let Some(entry) = self.session.entry_mut() else { return };
        let ratio = [0, 1].map(|axis| f64::from(entry.size_px[axis]) / f64::from(from[axis].max(1)));
        let id = entry.id.clone();
        let used_ids: Vec<String> = entry.annotations.iter().filter_map(|known| known.id.clone()).collect();
        for mut annotation in copied {
            edit::scale(&mut annotation, ratio);
            annotation.id.take_if(|id| used_ids.contains(id));
            // The reference is removed: the id belongs to another annotation of this camera.
            annotation.at_right_angles_to.take_if(|id| used_ids.contains(id));
            entry.annotations.push(annotation);
        }
        self.session.commit(format!("paste annotations onto {id}"));
    }

    pub(super) fn annotate(&mut self, index: usize, annotation: Annotation, name: String) {
        self.cancel();
        if let Some(own) = self.session.entry_mut().and_then(|entry| entry.annotations.get_mut(index)) {
            *own = annotation;
        }
        self.session.commit(name);
    }

    pub(super) fn set_lens(&mut self, lens: LensEntry, name: impl Into<String>) {
        if let Some(entry) = self.session.entry_mut() {
            entry.lens = Some(lens).filter(|lens| *lens != LensEntry::default());
            self.session.commit(name);
        }
    }

    pub(super) fn set_height(&mut self, known: Option<Known>, name: String) {
        if let Some(entry) = self.session.entry_mut() {
            entry.height_m = known;
        }
        self.session.commit(name);
    }

    /// Sets a prior on the focal length in pixels, which the operator can see and remove.
    pub(super) fn set_focal_prior(&mut self, focal: f64, name: &str) {
        let lens = self.session.entry().and_then(|entry| entry.lens.clone()).unwrap_or_default();
        self.set_lens(LensEntry { focal_px: Some(Known::prior(focal, 0.05 * focal)), ..lens }, name);
    }

    pub(super) fn show_view(&mut self, which: usize, view: f64) {
        let Some((camera, family)) = &mut self.family else { return };
        let lenses = self.session.solved.lenses(*camera);
        family.show(&self.session.site, *camera, which, view, &lenses);
    }
}
