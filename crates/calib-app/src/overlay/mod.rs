//! What is painted on a camera's image: annotations, EFOV, grid, prism, horizon, marks, links. Reads only.

mod lines;
mod horizon;
mod proposed;

use std::cell::RefCell;
use std::collections::BTreeSet;

use calib_core::{Camera, Kind, Pixel, Plane};

use calib_core::floor::drawn_line;

use calib_draw::{
    Geometry, ImageLayer, ImageView, Item, Look, Meaning, Scene, Signs, guide, on_image as items_on_image,
    reach, seen,
};
use calib_editor::{Edge, Family, Part, Session, Trace, Units, hit};
use calib_site::{DrawNext, Site, SiteCamera, Solution};
use egui::{Align2, Color32, Painter, Pos2, Rect, Stroke, Vec2};

use crate::canvas::Mapping;
use crate::paint::{Pen, handle, line, ring, tag};
use crate::state::Layers;
use crate::theme::{self, on_image};

pub use lines::Changed;
pub(crate) use lines::right_of;
pub use proposed::Ghosts;

/// A session as what is drawn comes from it: the site in hand, and results of solves that go on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown<'a>(pub(crate) &'a Session);

impl Scene for Shown<'_> {
    fn site(&self) -> &Site {
        &self.0.site
    }

    fn pose(&self, camera: usize) -> Option<Camera> {
        self.0.solved.pose(camera).copied()
    }

    fn solution(&self, camera: usize) -> Option<&Solution> {
        self.0.solved.solution(camera)
    }

    fn plane(&self, id: Option<&str>) -> Plane {
        self.0.solved.plane(&self.0.site, id)
    }
}

/// What the overlay of one image needs to know.
#[derive(Debug)]
pub struct Overlay<'a> {
    /// The site and its results.
    pub session: &'a Session,
    /// The camera whose image it is.
    pub camera: usize,
    /// Where the image is on the screen.
    pub mapping: Mapping,
    /// What is shown.
    pub layers: Layers,
    /// Where the cursor is, if it is on this image.
    pub cursor: Option<Pixel>,
    /// A line that is lit because its row or it is under the cursor.
    pub lit: Option<(usize, usize)>,
    /// Whether a handle is in the hand.
    pub holding: bool,
    /// Whether something is being drawn: then what does not help to see the edge steps back.
    pub drawing: bool,
    /// Seconds, for what blinks.
    pub time: f64,
    /// What fits as well as the solution, where anything does.
    pub family: Option<&'a Family>,
    /// The link that is to be shown in a further view.
    pub begun: Option<usize>,
    /// Edges on which the lines that would help most can be drawn.
    pub suggested: Vec<Edge>,
    /// What the still proposes, where it is shown.
    pub proposed: Option<Ghosts<'a>>,
    /// What a newer still shows, where it is looked at.
    pub changed: Option<Changed<'a>>,
    /// Whether names are shown: not on small images.
    pub labels: bool,
    /// Whether links and marks say their names without being asked, where that covers no other name.
    pub names_elements: bool,
    /// Where names stand already.
    pub(crate) named: RefCell<Vec<Rect>>,
    /// Whether drawn lines are shown: among many views they hide what is compared.
    pub lines: bool,
}

impl Overlay<'_> {
    pub(crate) fn at(&self, pixel: Pixel) -> Pos2 {
        self.mapping.screen(pixel.into())
    }

    pub(crate) fn path(&self, pixels: &[Pixel]) -> Vec<Pos2> {
        self.mapping.path(pixels)
    }

    /// Lines that are drawn by their ends, as the lens bends them.
    pub(crate) fn curve(&self, pixels: &[Pixel]) -> Vec<Pos2> {
        let Some(entry) = self.entry() else { return self.path(pixels) };
        self.path(&drawn_line(&hit::shown_lens(entry, self.session.solved.pose(self.camera)), pixels))
    }

    pub(crate) fn entry(&self) -> Option<&SiteCamera> {
        self.session.site.cameras.get(self.camera)
    }

    /// Whether a thing says its name: all of them at once hide the image.
    fn says_name(&self, at: Pos2, selected: bool) -> bool {
        const NEAR: f32 = 48.0;
        let over = self.cursor.is_some_and(|cursor| self.at(cursor).distance(at) < NEAR);
        self.labels && (over || selected && self.session.camera == self.camera)
    }

    /// Paints everything.
    pub fn paint(&self, painter: &Painter) {
        let Some(entry) = self.entry() else { return };
        if self.layers.hidden {
            return;
        }
        let pose = self.session.solved.pose(self.camera);
        let solution = self.session.solved.solution(self.camera);
        let shown = Shown(self.session);
        let view = ImageView::new(&shown, self.camera);
        match &self.proposed {
            // One grid and one horizon: those of the camera that is proposed.
            Some(ghosts) if ghosts.is_camera() => self.paint_supposed(painter, ghosts),
            _ => {
                self.paint_items(painter, &items_on_image(&view, &self.on_floor(solution)));
                if let (Some(camera), Some(_)) = (pose, solution) {
                    self.paint_horizon(painter, camera, entry);
                }
            }
        }
        if let (Some(camera), Some(_)) = (pose, solution) {
            self.paint_guide(painter, camera);
        }
        self.paint_items(painter, &items_on_image(&view, &self.drawn()));
        if let Some(camera) = pose {
            self.paint_traces(painter, camera, entry);
        }
        if let Some(changed) = &self.changed {
            self.paint_changed(painter, changed);
        }
        match &self.proposed {
            Some(ghosts) => self.paint_proposed(painter, ghosts),
            None => self.paint_suggestion(painter, solution),
        }
        self.paint_selection(painter);
    }

    /// What lies under all that was drawn.
    fn on_floor(&self, solution: Option<&Solution>) -> Vec<ImageLayer> {
        let polygon = solution.map_or(&[][..], |solution| &solution.efov_m);
        let grid = ImageLayer::Grid(grid_step(polygon, self.session.units));
        let prism = (self.layers.prism && !self.drawing).then_some(ImageLayer::DrawnPrism);
        (self.layers.grid && !self.drawing).then_some(grid).into_iter().chain(prism).collect()
    }

    /// What was drawn, from the lowest.
    fn drawn(&self) -> Vec<ImageLayer> {
        let (field, free) = (self.layers.field, !self.drawing);
        let layers = [
            (field && free, ImageLayer::Planes),
            (field, ImageLayer::DrawnEfov),
            (field && free, ImageLayer::OtherEfovs),
            (free, ImageLayer::Marks),
            (free, ImageLayer::Pins),
            (self.lines, ImageLayer::Annotations(Signs::OfKinds)),
            (free, ImageLayer::ControlPoints),
            (free, ImageLayer::Links { begun: self.begun }),
        ];
        layers.into_iter().filter_map(|(is_shown, layer)| is_shown.then_some(layer)).collect()
    }

    pub(crate) fn paint_items(&self, painter: &Painter, items: &[Item<Pixel>]) {
        for item in items {
            match (&item.geometry, item.meaning) {
                (Geometry::Polyline(points), Meaning::Annotation(drawn)) => {
                    self.paint_line(painter, points, &drawn);
                }
                (Geometry::Polyline(points), meaning) => line(painter, &self.path(points), self.pen(meaning)),
                (Geometry::Polygon(points), meaning) => {
                    let closed: Vec<Pixel> = points.iter().chain(points.first()).copied().collect();
                    line(painter, &self.path(&closed), self.pen(meaning));
                }
                (Geometry::Point(at), meaning) => self.paint_point(painter, self.at(*at), meaning),
                (Geometry::Sign(sign, ends), Meaning::Annotation(drawn)) => {
                    self.paint_sign(painter, sign, ends.map(|end| self.at(end)), &drawn);
                }
                (Geometry::Label(at, text), meaning) => {
                    self.paint_label(painter, self.at(*at), text, meaning);
                }
                (Geometry::Sign(..) | Geometry::Cone { .. }, _) => {}
            }
        }
    }

    fn is_selected(&self, meaning: Meaning) -> bool {
        let part = match meaning {
            Meaning::Mark(index) => Part::Mark(index),
            Meaning::ControlPoint { index, .. } => Part::Control(index),
            _ => return false,
        };
        self.session.selection.contains(&part)
    }

    fn pen(&self, meaning: Meaning) -> Pen {
        let pen = Pen::of(Look::of(meaning));
        match meaning {
            Meaning::Mark(_) if self.is_selected(meaning) => pen.coloured(on_image::ACCENT),
            // A prism that follows the hand must not hide what is drawn.
            Meaning::Prism(_) => pen.faint(),
            Meaning::Plane(index) if self.session.plane == Some(index) => pen.coloured(on_image::ACCENT),
            _ => pen,
        }
    }

    fn paint_point(&self, painter: &Painter, at: Pos2, meaning: Meaning) {
        let pen = self.pen(meaning);
        match meaning {
            Meaning::Annotation(drawn) => handle(painter, at, self.line_colour(painter, &drawn)),
            Meaning::ControlPoint { .. } => {
                for arm in [Vec2::new(9.0, 0.0), Vec2::new(0.0, 9.0)] {
                    line(painter, &[at - arm, at - 0.4 * arm], pen);
                    line(painter, &[at + 0.4 * arm, at + arm], pen);
                }
                painter.circle_stroke(at, 5.0, Stroke::new(1.5, pen.colour));
            }
            Meaning::Link { .. } => diamond(painter, at, pen.colour),
            Meaning::Suggestion(_) => {
                painter.circle_stroke(at, 4.0, Stroke::new(1.25, pen.colour));
            }
            _ => handle(painter, at, pen.colour),
        }
    }

    /// A thing says its name when it is held, waits, or the cursor is near.
    fn paint_label(&self, painter: &Painter, at: Pos2, text: &str, meaning: Meaning) {
        let is_selected = self.is_selected(meaning);
        let (is_shown, by, align) = match meaning {
            // Where cameras are compared, one thing is known in all of them by its name.
            Meaning::Mark(_) => {
                let is_shown = is_selected || self.names_elements || self.says_name(at, false);
                (is_shown, Vec2::new(0.0, 6.0), Align2::CENTER_TOP)
            }
            Meaning::Link { waits, .. } => {
                let is_shown = waits || self.names_elements || self.says_name(at, false);
                (is_shown, Vec2::new(9.0, -2.0), Align2::LEFT_BOTTOM)
            }
            _ => (self.says_name(at, is_selected), Vec2::new(11.0, -4.0), Align2::LEFT_BOTTOM),
        };
        let is_asked = !self.names_elements || is_selected || self.says_name(at, false);
        if is_shown && (self.has_room(align, at + by, text) || is_asked) {
            tag(painter, at + by, align, text, theme::colour(Look::of(meaning).colour));
        }
    }

    /// Whether a name covers no other one; then its place is taken.
    fn has_room(&self, align: Align2, at: Pos2, text: &str) -> bool {
        /// A letter and a tag, in points.
        const LETTER: f32 = 6.5;
        const TAG: Vec2 = Vec2::new(14.0, 18.0);
        let size = TAG + Vec2::new(LETTER * text.chars().count() as f32, 0.0);
        let place = align.anchor_size(at, size);
        let mut named = self.named.borrow_mut();
        let is_free = named.iter().all(|taken| !taken.intersects(place));
        if is_free {
            named.push(place);
        }
        is_free
    }

    /// A person on the floor under the cursor: a thing to judge height and plumb by.
    fn paint_guide(&self, painter: &Painter, camera: &Camera) {
        const HEIGHT: f64 = 1.75;
        let Some(foot) = self.cursor.filter(|_| self.layers.guide && !self.holding) else { return };
        let Some((items, head)) = guide(camera, foot, HEIGHT) else { return };
        self.paint_items(painter, &items);
        if let Some(head) = head.filter(|_| self.labels) {
            let text = format!("person {}", self.session.units.length(HEIGHT, 2));
            let at = self.at(head) - Vec2::new(0.0, 6.0);
            tag(painter, at, Align2::CENTER_BOTTOM, &text, on_image::WHITE);
        }
    }

    /// Of every link that waits for this view.
    fn paint_traces(&self, painter: &Painter, camera: &Camera, entry: &SiteCamera) {
        for (index, link) in self.session.site.links.iter().enumerate() {
            let waits = link.seen.len() == 1 || self.begun == Some(index);
            if waits && link.seen.iter().all(|seen| seen.camera != entry.id) {
                self.paint_trace(painter, camera, link);
            }
        }
    }

    /// Where this view must show the link that another view shows.
    fn paint_trace(&self, painter: &Painter, camera: &Camera, link: &calib_site::Link) {
        let may_show = self.session.site.has_shared(self.camera);
        if !may_show || self.session.solved.placed(self.camera).is_none() {
            return;
        }
        let trace = link.seen.iter().find_map(|seen| {
            let other = self.session.site.cameras.iter().position(|entry| entry.id == seen.camera)?;
            let plane = self.session.solved.plane(&self.session.site, link.plane.as_deref());
            Trace::of(self.session.solved.placed(other)?, link, &plane, seen)
        });
        let Some(trace) = trace else { return };
        self.paint_items(painter, &seen(camera, Meaning::Epipolar, &trace.path));
        if let Some(at) = trace.at.and_then(|point| camera.world_to_pixel(point)) {
            let at = self.at(at);
            painter.circle_stroke(at, 8.0, Stroke::new(1.5, on_image::WAITING));
            let text = format!("{} {}", link.id.as_deref().unwrap_or("the link"), trace.invites);
            tag(painter, at + Vec2::new(12.0, 0.0), Align2::LEFT_CENTER, &text, on_image::WAITING);
        }
    }

    /// Ghosts of the lines that would help most, on edges of the image; numbered where it needs several.
    fn paint_suggestion(&self, painter: &Painter, solution: Option<&Solution>) {
        if solution.is_none() || !self.labels || self.session.camera != self.camera {
            return;
        }
        let Some(next) = self.session.proposal() else { return };
        let Some(kind) = next.kind else { return };
        let colour = theme::kind(kind);
        let look = Look::of(Meaning::Suggestion(kind));
        for (index, edge) in self.suggested.iter().enumerate() {
            let ends = edge.map(|end| self.at(end));
            line(painter, &self.curve(edge), Pen::of(look).coloured(colour));
            let middle = ends[0] + 0.5 * (ends[1] - ends[0]) + Vec2::new(10.0, 0.0);
            let text = match (index, self.suggested.len()) {
                (0, 1) => proposal(next, kind),
                (0, _) => format!("1  {}", proposal(next, kind)),
                (index, _) => (index + 1).to_string(),
            };
            tag(painter, middle, Align2::LEFT_CENTER, &text, colour);
        }
    }

    fn paint_selection(&self, painter: &Painter) {
        if self.session.camera != self.camera {
            return;
        }
        let points: BTreeSet<Part> =
            calib_editor::edit::points_of(&self.session.site, self.camera, &self.session.selection);
        let handles = hit::handles(&self.session.site, self.camera);
        for (part, pixel) in handles.into_iter().filter(|(part, _)| points.contains(part)) {
            let whole = !self.session.selection.contains(&part);
            ring(painter, self.at(pixel), on_image::ACCENT, self.holding && !whole);
        }
    }
}

/// What drawing there would bring.
fn proposal(next: &DrawNext, kind: Kind) -> String {
    let gain = 100.0 * next.floor_length_rel;
    format!("{} here? then floor about \u{b1} {gain:.1} %   N", kind.row().title.to_lowercase())
}

fn diamond(painter: &Painter, at: Pos2, colour: Color32) {
    let corners = [[0.0, -6.0], [6.0, 0.0], [0.0, 6.0], [-6.0, 0.0], [0.0, -6.0]];
    let points: Vec<Pos2> = corners.iter().map(|&[x, y]| at + Vec2::new(x, y)).collect();
    line(painter, &points, Pen::new(colour, 1.75));
    painter.circle_filled(at, 1.25, colour);
}

/// A step of the grid that leaves cells to be told apart: 1, 2, 5, 10, ... of the unit.
#[must_use]
pub fn grid_step(polygon: &[calib_core::FloorPoint], units: Units) -> f64 {
    units.step(reach(polygon), 30.0).max(0.5 * units.metres())
}
