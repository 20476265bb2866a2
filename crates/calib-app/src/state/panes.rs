//! What canvases remember between frames: how each is looked at, and the pointer on them.

use std::collections::HashMap;

use calib_editor::Pane;
use egui::{Pos2, Rect};

use crate::canvas::{Bend, Mapping, View};

/// Where a pane stands: a camera alone and among others is looked at in two ways.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// It has the canvas.
    Main,
    /// It stands beside the plan.
    Half,
    /// One of many.
    Tile,
}

/// What canvases remember between frames.
#[derive(Debug, Default)]
pub struct Panes {
    /// How each is looked at.
    pub views: HashMap<(Place, Pane), View>,
    /// What the views were when they were made to fit.
    pub(crate) fitted: HashMap<(Place, Pane), View>,
    /// The plan whose picture was shown last.
    pub(crate) plan: Option<String>,
    /// Whether there are more tiles than the window shows.
    pub tiles_overflow: bool,
    /// Where the cursor is, in the pane's units.
    pub cursor: Option<(Pane, [f64; 2])>,
    /// The pane and place that holds the pointer while a button is down.
    pub(crate) captured: Option<(Place, Pane)>,
    pub(crate) pressed: Pos2,
    pub(crate) moved: bool,
    /// The last point of the document that the pointer was at while a button was down.
    pub(crate) pointed: [f64; 2],
    pub(crate) double: bool,
    /// Whether nothing was in the hand before the last press.
    pub(crate) was_idle: bool,
    pub(crate) last_press: Option<(f64, Pos2)>,
    /// The pane over which the whole image lies small, and where.
    pub(crate) minimap: Option<((Place, Pane), Rect)>,
    /// The pane over which a line wipes between two stills, and the strip in which it is taken.
    pub(crate) wipe: Option<((Place, Pane), Rect)>,
    /// The pane that was used last: zoom keys mean it.
    pub active: Option<(Place, Pane)>,
    /// Where every pane was shown last, for zoom keys and tests.
    pub rects: HashMap<(Place, Pane), Rect>,
    /// The middle of the window, whatever it shows.
    pub middle: Option<Rect>,
    /// What is taken out of what panes show.
    pub(crate) bends: HashMap<(Place, Pane), Bend>,
}

impl Panes {
    /// Forgets a pointer whose release will never be told.
    pub fn forget_pointer(&mut self) {
        (self.captured, self.last_press) = (None, None);
    }

    /// Forgets where panes were, and a cursor on one that is no longer shown.
    pub fn begin_frame(&mut self) {
        let is_shown = |pane: Pane| self.rects.keys().any(|(_, shown)| *shown == pane);
        self.cursor = self.cursor.filter(|(pane, _)| is_shown(*pane));
        self.rects.clear();
        self.bends.clear();
    }

    /// The view the operator chose, or the one that fits: a pane that nobody panned goes on fitting.
    pub(crate) fn fitted_or_chosen(&mut self, key: (Place, Pane), whole: View) -> View {
        let chosen = self.views.get(&key).copied();
        let was_fitted = chosen.is_none() || chosen == self.fitted.get(&key).copied();
        if was_fitted {
            self.fitted.insert(key, whole);
            self.views.insert(key, whole);
        }
        chosen.filter(|_| !was_fitted).unwrap_or(whole)
    }

    /// Whether something lies over a pane there.
    pub(crate) fn is_covered(&self, key: (Place, Pane), at: Pos2) -> bool {
        let over = [self.minimap, self.wipe];
        over.into_iter().flatten().any(|(own, rect)| own == key && rect.contains(at))
    }

    /// Where a pane shows its document.
    #[must_use]
    pub fn mapping(&self, place: Place, pane: Pane) -> Option<Mapping> {
        let bend = self.bends.get(&(place, pane)).copied();
        let (view, rect) = (*self.views.get(&(place, pane))?, *self.rects.get(&(place, pane))?);
        Some(Mapping { view, rect, bend })
    }
}
