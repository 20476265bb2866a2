//! Suggestions of the next annotation, without the suggestions that the operator dismissed.

use calib_site::SuggestionEntry;

use crate::session::Session;

impl Session {
    /// Returns the best suggestion for the selected camera that the operator has not dismissed.
    #[must_use]
    pub fn suggestion(&self) -> Option<&SuggestionEntry> {
        let id = &self.entry()?.id;
        let best = self.solution()?.draw_next.as_ref()?;
        let is_dismissed = |next: &&SuggestionEntry| {
            self.pending
                .dismissed
                .iter()
                .any(|(camera, drawing)| camera == id && Some(*drawing) == next.drawing)
        };
        std::iter::once(best).chain(&best.otherwise).find(|next| !is_dismissed(next))
    }

    /// Dismisses the current suggestion for the selected camera.
    pub(crate) fn dismiss_suggestion(&mut self) {
        let drawing = self.suggestion().and_then(|next| next.drawing);
        if let (Some(drawing), Some(id)) = (drawing, self.entry().map(|entry| entry.id.clone())) {
            self.pending.dismissed.push((id, drawing));
        }
        self.note = Some(match self.suggestion() {
            Some(next) => next.message.clone(),
            None => "No further suggestions for this camera.".into(),
        });
    }
}
