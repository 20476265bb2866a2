//! Overlay of a camera's image: annotations, field of view, grid, horizon, marks, links.

mod lines;
mod horizon;
mod proposed;

use std::cell::RefCell;
use std::collections::BTreeSet;

use calib_core::{Camera, Kind, Pixel, Plane};

use calib_core::floor::annotated_line_curve;

use calib_draw::{
    Geometry, ImageLayer, ImageView, Item, Look, Meaning, Scene, Signs, guide, on_image as items_on_image,
    project,
};
use calib_editor::{Edge, Family, Part, Session, Units, hit, missing_search_line, search_line};
use calib_site::{Site, SiteCamera, Solution, SuggestionEntry};
use egui::{Align2, Color32, Painter, Pos2, Rect, Shape, Stroke, Vec2};

use crate::canvas::Mapping;
use crate::paint::{Pen, handle, line, ring, tag};
use crate::state::Layers;
use crate::theme::{self, on_image};

pub use lines::Changed;
pub(crate) use lines::right_of;
pub use proposed::ProposedLines;

/// Open site with its current results, as the scene that `calib_draw` draws.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown<'a>(pub(crate) &'a Session);

impl Shown<'_> {
    /// Returns the appearance of items with a meaning. The colour of a camera stays when other cameras are removed.
    pub(crate) fn look(&self, meaning: Meaning) -> Look {
        let slot = |camera: usize| self.0.camera_slot(camera);
        Look::of(match meaning {
            Meaning::Efov(camera) => Meaning::Efov(slot(camera)),
            Meaning::OtherEfov(camera) => Meaning::OtherEfov(slot(camera)),
            Meaning::Prism(camera) => Meaning::Prism(slot(camera)),
            Meaning::PositionEllipse(camera) => Meaning::PositionEllipse(slot(camera)),
            Meaning::Camera(camera) => Meaning::Camera(slot(camera)),
            Meaning::LinkPosition { index, camera } => {
                Meaning::LinkPosition { index, camera: camera.map(slot) }
            }
            other => other,
        })
    }
}

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

/// Input of the overlay of one image.
#[derive(Debug)]
pub struct Overlay<'a> {
    /// Open site with its results.
    pub session: &'a Session,
    /// Index of the camera whose image is shown.
    pub camera: usize,
    /// Mapping between raw pixels and the screen.
    pub mapping: Mapping,
    /// Visible layers.
    pub layers: Layers,
    /// Raw pixel under the pointer, if the pointer is on this image.
    pub cursor: Option<Pixel>,
    /// Highlighted line, as annotation and segment; the line or its table row is under the pointer.
    pub lit: Option<(usize, usize)>,
    /// Whether a gesture is active.
    pub holding: bool,
    /// Whether an annotation is being drawn; layers that could hide the edge are not shown then.
    pub drawing: bool,
    /// Time since the first rejected line (outlier) changed, in seconds; determines its blinking.
    pub time: f64,
    /// Alternative solutions of the camera that fit the annotations equally well.
    pub family: Option<&'a Family>,
    /// Index of the link that needs a click in another view.
    pub begun: Option<usize>,
    /// Detected edges along which the suggested lines can be drawn.
    pub suggested: Vec<Edge>,
    /// Automatic calibration, if this canvas shows it.
    pub proposed: Option<ProposedLines<'a>>,
    /// Newer image, if this canvas compares it.
    pub changed: Option<Changed<'a>>,
    /// Whether labels are shown; small images have none.
    pub labels: bool,
    /// Whether links and marks always show their names if there is room.
    pub names_elements: bool,
    /// Rectangles of the labels painted so far, on the screen.
    pub(crate) named: RefCell<Vec<Rect>>,
    /// Whether annotations are shown; small tiles hide them.
    pub lines: bool,
}

impl Overlay<'_> {
    /// Maps a raw pixel to the screen.
    pub(crate) fn at(&self, pixel: Pixel) -> Pos2 {
        self.mapping.screen(pixel.into())
    }

    /// Maps a line of raw pixels to the screen.
    pub(crate) fn path(&self, pixels: &[Pixel]) -> Vec<Pos2> {
        self.mapping.path(pixels)
    }

    /// Returns the image of a straight line of the scene through these raw pixels, curved by the distortion, as
    /// screen points.
    pub(crate) fn curve(&self, pixels: &[Pixel]) -> Vec<Pos2> {
        let Some(entry) = self.entry() else { return self.path(pixels) };
        self.path(&annotated_line_curve(
            &hit::shown_lens(entry, self.session.solved.pose(self.camera)),
            pixels,
        ))
    }

    /// Returns the site entry of the camera.
    pub(crate) fn entry(&self) -> Option<&SiteCamera> {
        self.session.site.cameras.get(self.camera)
    }

    /// Whether the name of an element at a screen point is shown: the element is near the pointer or
    /// selected.
    fn shows_name(&self, at: Pos2, selected: bool) -> bool {
        /// Largest distance of the pointer at which an element shows its name, in points.
        const MAX_POINTER_DISTANCE: f32 = 48.0;
        let over = self.cursor.is_some_and(|cursor| self.at(cursor).distance(at) < MAX_POINTER_DISTANCE);
        self.labels && (over || selected && self.session.camera == self.camera)
    }

    /// Paints all visible layers of the overlay.
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
            // While an automatic calibration is shown, grid and horizon belong to its camera.
            Some(ghosts) if ghosts.is_camera() => self.paint_supposed(painter, ghosts),
            _ => {
                self.paint_items(painter, &items_on_image(&view, &self.floor_layers(solution)));
                if let (Some(camera), Some(_)) = (pose, solution) {
                    self.paint_horizon(painter, camera, entry);
                }
            }
        }
        if let (Some(camera), Some(_)) = (pose, solution) {
            self.paint_guide(painter, camera);
        }
        self.paint_items(painter, &items_on_image(&view, &self.annotation_layers()));
        if let Some(camera) = pose {
            self.paint_traces(painter, camera, entry);
        }
        self.paint_missing_trace(painter);
        if let Some(changed) = &self.changed {
            self.paint_changed(painter, changed);
        }
        match &self.proposed {
            Some(ghosts) => self.paint_proposed(painter, ghosts),
            None => self.paint_suggestion(painter, solution),
        }
        self.paint_selection(painter);
    }

    /// Returns the layers below the annotations.
    fn floor_layers(&self, solution: Option<&Solution>) -> Vec<ImageLayer> {
        let polygon = solution.map_or(&[][..], |solution| &solution.efov_m);
        let grid = ImageLayer::Grid(grid_step(polygon, self.session.site.units));
        let prism = (self.layers.prism && !self.drawing).then_some(ImageLayer::AnnotatedPrism);
        (self.layers.grid && !self.drawing).then_some(grid).into_iter().chain(prism).collect()
    }

    /// Returns the layers of annotations, lowest first.
    fn annotation_layers(&self) -> Vec<ImageLayer> {
        let (field, free) = (self.layers.field, !self.drawing);
        let layers = [
            (field && free, ImageLayer::Planes),
            (field, ImageLayer::AnnotatedEfov),
            (field && free, ImageLayer::OtherEfovs),
            (free, ImageLayer::Marks),
            (free, ImageLayer::Pins),
            (self.lines, ImageLayer::Annotations(Signs::All)),
            (free, ImageLayer::ControlPoints),
            (free, ImageLayer::Links { incomplete: self.begun }),
        ];
        layers.into_iter().filter_map(|(is_shown, layer)| is_shown.then_some(layer)).collect()
    }

    /// Paints lines, points and labels. The `Meaning` of an item determines its colour and line style.
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
        let pen = Pen::of(Shown(self.session).look(meaning));
        match meaning {
            Meaning::Mark(_) if self.is_selected(meaning) => pen.coloured(on_image::ACCENT),
            // The walls of the field of view must not hide annotations.
            Meaning::Prism(_) => pen.faint(),
            Meaning::Plane(index) if self.session.tool.plane == Some(index) => pen.coloured(on_image::ACCENT),
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
            Meaning::Link { index, .. } => diamond(painter, at, pen.colour, !self.is_link_unchecked(index)),
            Meaning::Suggestion(_) => {
                painter.circle_stroke(at, 4.0, Stroke::new(1.25, pen.colour));
            }
            _ => handle(painter, at, pen.colour),
        }
    }

    /// Whether an error of this link's click in the shown camera may stay undetected, because too few other
    /// observations check it.
    fn is_link_unchecked(&self, link: usize) -> bool {
        self.session.solved.is_link_unchecked(&self.session.site, link, self.camera)
    }

    /// Paints the name of an element if it is selected, incomplete or near the pointer. With `names_elements`, also
    /// paints the names of other marks and links that have room.
    fn paint_label(&self, painter: &Painter, at: Pos2, text: &str, meaning: Meaning) {
        let is_selected = self.is_selected(meaning);
        let (is_shown, by, align) = match meaning {
            // When several cameras are shown, names identify an element in all views.
            Meaning::Mark(_) => {
                let is_shown = is_selected || self.names_elements || self.shows_name(at, false);
                (is_shown, Vec2::new(0.0, 6.0), Align2::CENTER_TOP)
            }
            Meaning::Link { is_incomplete: waits, .. } => {
                let is_shown = waits || self.names_elements || self.shows_name(at, false);
                (is_shown, Vec2::new(9.0, -2.0), Align2::LEFT_BOTTOM)
            }
            _ => (self.shows_name(at, is_selected), Vec2::new(11.0, -4.0), Align2::LEFT_BOTTOM),
        };
        let is_asked = !self.names_elements || is_selected || self.shows_name(at, false);
        if is_shown && (self.has_room(align, at + by, text) || is_asked) {
            tag(painter, at + by, align, text, theme::colour(Look::of(meaning).colour));
        }
    }

    /// Whether a label overlaps no earlier label; if so, reserves its rectangle.
    fn has_room(&self, align: Align2, at: Pos2, text: &str) -> bool {
        /// Estimated width of a letter, in points.
        const LETTER_WIDTH: f32 = 6.5;
        /// Margin of the text in a label, both sides together, in points.
        const LABEL_MARGIN: Vec2 = Vec2::new(14.0, 18.0);
        let size = LABEL_MARGIN + Vec2::new(LETTER_WIDTH * text.chars().count() as f32, 0.0);
        let place = align.anchor_size(at, size);
        let mut named = self.named.borrow_mut();
        let is_free = named.iter().all(|taken| !taken.intersects(place));
        if is_free {
            named.push(place);
        }
        is_free
    }

    /// Paints a person at the pointer, to judge height and vertical direction of the calibration.
    fn paint_guide(&self, painter: &Painter, camera: &Camera) {
        /// Height of the person, in metres.
        const PERSON_HEIGHT_M: f64 = 1.75;
        let Some(foot) = self.cursor.filter(|_| self.layers.guide && !self.holding) else { return };
        let Some((items, head)) = guide(camera, foot, PERSON_HEIGHT_M) else { return };
        self.paint_items(painter, &items);
        if let Some(head) = head.filter(|_| self.labels) {
            let text = format!("person {}", self.session.site.units.length(PERSON_HEIGHT_M, 2));
            let at = self.at(head) - Vec2::new(0.0, 6.0);
            tag(painter, at, Align2::CENTER_BOTTOM, &text, on_image::WHITE);
        }
    }

    /// Paints the epipolar lines of all links that need a click in this view.
    fn paint_traces(&self, painter: &Painter, camera: &Camera, entry: &SiteCamera) {
        for (index, link) in self.session.site.links.iter().enumerate() {
            let waits = link.seen.len() == 1 || self.begun == Some(index);
            if waits && link.seen.iter().all(|seen| seen.camera != entry.id) {
                self.paint_trace(painter, camera, link);
            }
        }
    }

    /// Paints the epipolar line of a link that another view observes.
    fn paint_trace(&self, painter: &Painter, camera: &Camera, link: &calib_site::Link) {
        let may_show = self.session.site.owns_links(self.camera);
        if !may_show || self.session.solved.placed_pose(self.camera).is_none() {
            return;
        }
        let trace = link.seen.iter().find_map(|seen| search_line(self.session, link, seen));
        let Some(trace) = trace else { return };
        self.paint_items(painter, &project(camera, Meaning::Epipolar, &trace.path));
        if let Some(at) = trace.at.and_then(|point| camera.world_to_pixel(point)) {
            let at = self.at(at);
            painter.circle_stroke(at, 8.0, Stroke::new(1.5, on_image::WAITING));
            let text = format!("{} {}", link.id.as_deref().unwrap_or("the link"), trace.instruction);
            let rect = self.mapping.rect;
            // The label is on the side with more room; a point outside the view has none.
            let (side, align) = if at.x < rect.center().x {
                (12.0, Align2::LEFT_CENTER)
            } else {
                (-12.0, Align2::RIGHT_CENTER)
            };
            if rect.contains(at) {
                tag(painter, at + Vec2::new(side, 0.0), align, &text, on_image::WAITING);
            }
        }
    }

    /// Paints the reason why this view shows no epipolar line of the link that needs a click.
    fn paint_missing_trace(&self, painter: &Painter) {
        let link = self.begun.and_then(|index| self.session.site.links.get(index));
        let Some(text) = link.and_then(|link| missing_search_line(self.session, link, self.camera)) else {
            return;
        };
        let at = self.mapping.rect.center_top() + Vec2::new(0.0, 12.0);
        tag(painter, at, Align2::CENTER_TOP, &text, on_image::WAITING);
    }

    /// Paints the suggested lines on detected edges, numbered if there are several.
    fn paint_suggestion(&self, painter: &Painter, solution: Option<&Solution>) {
        if solution.is_none() || !self.labels || self.session.camera != self.camera {
            return;
        }
        let Some(next) = self.session.suggestion() else { return };
        let Some(kind) = next.kind else { return };
        let colour = theme::kind(kind);
        let look = Look::of(Meaning::Suggestion(kind));
        for (index, edge) in self.suggested.iter().enumerate() {
            let ends = edge.map(|end| self.at(end));
            line(painter, &self.curve(edge), Pen::of(look).coloured(colour));
            let middle = ends[0] + 0.5 * (ends[1] - ends[0]) + Vec2::new(10.0, 0.0);
            let text = match (index, self.suggested.len()) {
                (0, 1) => suggestion_text(next, kind),
                (0, _) => format!("1  {}", suggestion_text(next, kind)),
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

/// Returns the label of a suggested line: its kind, and the predicted relative floor error after it is drawn, in
/// percent.
fn suggestion_text(next: &SuggestionEntry, kind: Kind) -> String {
    let gain = 100.0 * next.floor_length_rel;
    format!("{} here: floor error drops to \u{b1} {gain:.1} %   N", kind.row().title.to_lowercase())
}

fn diamond(painter: &Painter, at: Pos2, colour: Color32, is_filled: bool) {
    let corners = [[0.0, -6.0], [6.0, 0.0], [0.0, 6.0], [-6.0, 0.0], [0.0, -6.0]];
    let points: Vec<Pos2> = corners.iter().map(|&[x, y]| at + Vec2::new(x, y)).collect();
    if is_filled {
        // The fill is translucent, so that the image stays visible.
        let fill = colour.gamma_multiply(0.4);
        painter.add(Shape::convex_polygon(points.clone(), fill, Stroke::NONE));
    }
    line(painter, &points, Pen::new(colour, 1.75));
    painter.circle_filled(at, 1.25, colour);
}

/// Returns the step of the floor grid, in metres: 0.5, 1, 2, 5, 10, … units of the site. The diagonal of the bounding
/// box of `polygon` has fewer than 30 cells.
#[must_use]
pub fn grid_step(polygon: &[calib_core::FloorPoint], units: Units) -> f64 {
    calib_draw::grid_step(polygon, units, 30.0)
}
