//! What would help a camera most, and what of it the operator does not want to be asked for again.

use calib_site::DrawNext;

use crate::session::Session;

impl Session {
    /// What would help the camera in hand most, of what the operator did not dismiss.
    #[must_use]
    pub fn proposal(&self) -> Option<&DrawNext> {
        let id = &self.entry()?.id;
        let best = self.solution()?.draw_next.as_ref()?;
        let is_dismissed = |next: &&DrawNext| {
            self.dismissed.iter().any(|(camera, drawing)| camera == id && Some(*drawing) == next.drawing)
        };
        std::iter::once(best).chain(&best.otherwise).find(|next| !is_dismissed(next))
    }

    /// Something else is suggested for the camera in hand from now on.
    pub(crate) fn dismiss(&mut self) {
        let drawing = self.proposal().and_then(|next| next.drawing);
        if let (Some(drawing), Some(id)) = (drawing, self.entry().map(|entry| entry.id.clone())) {
            self.dismissed.push((id, drawing));
        }
        self.note = Some(match self.proposal() {
            Some(next) => next.message.clone(),
            None => "Nothing else would help this camera much.".into(),
        });
    }
}
