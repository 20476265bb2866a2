//! The lines that would help most, where the image has edges for them.

use calib_core::Pixel;

use calib_core::outcome::Drawing;

use calib_editor::{Edge, hit, suggest};
use calib_site::DrawNext;
use egui::Context;

use super::App;

impl App {
    /// What the camera in hand proposes to draw, while its floor is not known well enough without.
    #[must_use]
    pub fn proposal(&self) -> Option<&DrawNext> {
        /// Floors known better than this need no more lines.
        const GOOD: f64 = 0.015;
        let solution = self.editor.session().solution()?;
        let next = self.editor.session().proposal();
        let rel = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
        let is_needed =
            |next: &&DrawNext| rel.is_none_or(|rel| rel >= GOOD) || next.drawing == Some(Drawing::KnownSize);
        next.filter(|next| self.layers.suggestion && is_needed(next))
    }

    /// Edges of the image in hand on which the proposed lines can be drawn; none while something is in the hand.
    #[must_use]
    pub fn suggested(&mut self, ctx: &Context) -> Vec<Edge> {
        let Some(next) = self.proposal().cloned() else { return Vec::new() };
        let session = self.editor.session();
        let (Some(entry), Some(&pose)) = (session.entry(), session.pose()) else { return Vec::new() };
        let (entry, name) = (entry.clone(), entry.image.clone().unwrap_or_default());
        let Some(picture) = self.pictures.ready(&name).filter(|_| self.editor.tool().is_idle()) else {
            return Vec::new();
        };
        suggest::on_edges(&next, &pose, &entry, self.edges.of(ctx, &name, &picture.image))
    }

    /// The suggested edge under a pixel, while the tool that draws it is in the hand.
    pub(crate) fn suggested_under(&mut self, ctx: &Context, at: Pixel, radius: f64) -> Option<Edge> {
        let kind = self.proposal()?.kind;
        if kind.is_none() || self.editor.tool_kind() != kind {
            return None;
        }
        let edges = self.suggested(ctx);
        edges.into_iter().find(|&[a, b]| hit::to_segment(a, b, at) <= radius)
    }
}
